"""The unit of a file of another program: one noun from every importer, and the unit of a CRS."""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from vinefab.core.errors import UnfitInputError
from vinefab.core.extras import ensure_extra
from vinefab.core.front_door import imported_later
from vinefab.core.validation import Floats
from vinefab.model.map import Map

if TYPE_CHECKING:
    import pyproj
else:
    pyproj = imported_later("pyproj")

TRIANGLES_ADVICE = (
    "a plan needs areas or lines: ogr2ogr -nlt MULTIPOLYGON plan.gpkg FILE makes areas of them"
)

_KNOWN = {
    "file": "as the file says",
    "program": "as the program that wrote it means it",
    "option": "as given",
    "guess": "guessed",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceUnit:
    """The unit of the coordinates in a file, and how it is known."""

    name: str  # of one
    mm: float  # how many mm of the map it is
    known: Literal["file", "program", "option", "guess"]
    by: str = ""  # what in the file tells it, or what is missing

    @property
    def words(self) -> str:
        """Unit and how it is known, as text."""
        return f"{self.name}, {_KNOWN[self.known]}{f' ({self.by})' if self.by else ''}"

    def scaled(self, mm_per_unit: float | None) -> "SourceUnit":
        """Return the same unit with the scale that a user gives, if any."""
        if mm_per_unit is None:
            return self
        return replace(self, mm=mm_per_unit, known="option", by="--scale-mm-per-unit")

    def of(self, world: Map) -> Map:
        """Return a map of this unit, with a fact that tells it."""
        wide, high = (side / self.mm for side in world.size_mm)
        facts = {
            "unit": f"{self.words}: {wide:.6g} x {high:.6g}, {self.mm:.6g} mm each",
            "unit_known_by": self.known,
            "scale_mm_per_unit": self.mm,
        }
        return replace(world, facts={**world.facts, **facts})


def unit_of(system: str, points: Floats, otherwise: SourceUnit) -> SourceUnit:
    """Return the unit of a drawing in a reference system, or of one whose file names none.

    Raises
    ------
    UnfitInputError
        As `unit_of_system`; also if coordinates without a system are surely degrees.
    """
    if system:
        return unit_of_system(system, points)
    if looks_like_degrees(points):
        low, high = points.min(axis=0), points.max(axis=0)
        place = "{:.6g}, {:.6g} to {:.6g}, {:.6g}".format(*low, *high)
        problem = f"{place} are longitude and latitude in degrees, as no unit is named"
        error = degrees_refused("coordinates", problem, points)
        raise UnfitInputError(
            error.key, problem, f"{error.allowed}; or give --scale-mm-per-unit if they are lengths"
        )
    return otherwise


def unit_of_system(system: str, points: Floats) -> SourceUnit:
    """Return the unit of a coordinate reference system where a drawing lies.

    Parameters
    ----------
    system
        A code such as ``EPSG:25832``, a URN or a definition (WKT).
    points
        Corners of the drawing, shape (n, 2), n at least 1: its size fixes a unit that the
        projection stretches, as Web Mercator does.

    Raises
    ------
    UnfitInputError
        If coordinates are angles, or the projection changes shapes there.
    """
    shown = system if len(system) <= 40 else f"{system[:37]}..."
    ensure_extra("gis", f"the reference system {shown}")
    try:
        crs = pyproj.CRS.from_user_input(system)
    except pyproj.exceptions.CRSError:
        remedy = "give --scale-mm-per-unit, how many mm a unit is"
        raise UnfitInputError("reference system", f"{shown} is unknown", remedy) from None
    flat = crs.sub_crs_list[0] if crs.is_compound else crs
    axis = flat.axis_info[0] if flat.axis_info else None
    if flat.is_geographic or flat.is_geocentric or axis is None:
        raise degrees_refused("reference system", f"{shown} is in degrees", points)
    code = ":".join(crs.to_authority() or ()) or crs.name or shown
    mm = float(f"{1000.0 * axis.unit_conversion_factor:.12g}")
    own = SourceUnit(name=axis.unit_name, mm=mm, known="file", by=code)
    if not flat.is_projected:
        return own
    latitude, longitude = _place(flat, points)
    if not _is_used_at(flat, latitude, longitude):
        return own
    stretch, skew = _stretch(flat, latitude, longitude)
    # UTM zones and national grids stay within; what is left is less than a cut is exact.
    most_stretch, most_skew = 5e-3, 5e-3
    if skew > most_skew:
        problem = f"{shown} stretches this place {100.0 * skew:.0f} % more one way than the other"
        raise UnfitInputError("reference system", problem, _project(longitude, latitude))
    if abs(stretch - 1.0) <= most_stretch:
        return own
    by = f"{code}, {stretch:.4g} times too long at latitude {latitude:.3f}"
    return replace(own, mm=mm / stretch, by=by)


def degrees_refused(key: str, problem: str, points: Floats | None) -> UnfitInputError:
    """Return the error for coordinates in degrees, longitude first, with the zone to use."""
    middle = None if points is None else 0.5 * (points.min(axis=0) + points.max(axis=0))
    if middle is None or not (np.abs(middle) <= (180.0, 84.0)).all():
        middle = np.array([9.0, 48.0])
    return UnfitInputError(key, problem, _project(float(middle[0]), float(middle[1])))


def looks_like_degrees(points: Floats) -> bool:
    """Return whether coordinates without a unit are surely longitude and latitude.

    They fit the globe, and lie farther from its origin than they are wide: a place, no drawing.
    """
    most_degrees = 5.0
    low, high = points.min(axis=0), points.max(axis=0)
    size = float((high - low).max())
    if (points == np.round(points)).all():
        return False
    inside = bool((np.abs(points) <= (180.0, 90.0)).all())
    away = float(np.abs(0.5 * (low + high)).max())
    return inside and 0.0 < size <= most_degrees and away > 2.0 * size


def _project(longitude: float, latitude: float) -> str:
    zone = min(60, int((longitude + 180.0) // 6.0) + 1)
    code = f"EPSG:{32600 + zone if latitude >= 0.0 else 32700 + zone}"
    return (
        "project the layer in your GIS program (QGIS: Export, Save Features As, a projected CRS), "
        f"or ogr2ogr -t_srs {code} metres.gpkg FILE ({code} is UTM zone {zone})"
    )


def _place(crs: "pyproj.CRS", points: Floats) -> tuple[float, float]:
    """Return latitude and longitude of the middle of a drawing, degrees."""
    x, y = 0.5 * (points.min(axis=0) + points.max(axis=0))
    longitude, latitude = pyproj.Proj(crs)(x, y, inverse=True)
    return float(latitude), float(longitude)


def _is_used_at(crs: "pyproj.CRS", latitude: float, longitude: float) -> bool:
    """Return whether a system is made for a place: a drawing near its origin may lie nowhere."""
    area = crs.area_of_use
    if area is None or not math.isfinite(latitude + longitude):
        return False
    west, south, east, north = area.bounds
    return south <= latitude <= north and (west <= longitude <= east or west > east)


def _stretch(crs: "pyproj.CRS", latitude: float, longitude: float) -> tuple[float, float]:
    """Return how many times too long a projection draws lengths, and how unlike its two ways."""
    factors = pyproj.Proj(crs).get_factors(longitude, latitude)
    scale = float(factors.areal_scale) ** 0.5
    major, minor = float(factors.tissot_semimajor), float(factors.tissot_semiminor)
    if not (np.isfinite(scale) and scale > 0.0 and minor > 0.0):
        return 1.0, 0.0
    return scale, major / minor - 1.0
