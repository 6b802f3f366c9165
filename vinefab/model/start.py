"""Where robots start: a pose, a start with the range around it, and checks of outlines."""

from dataclasses import dataclass
from weakref import WeakSet

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.units import deg, rad, warn_of_radians
from vinefab.core.validation import LARGEST_MM, number

_MANY_CORNERS = 1000
_FOUND_VALID = WeakSet[BaseGeometry]()
"""Polygons of many corners: looking at a jagged one takes time that grows with their square."""

START_CLEARANCE_MM = 15.0
"""From walls, of positions drawn from an area: room for a trunk of up to 47 mm lay-flat width."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Position of a robot's base and direction in which its trunk is launched.

    Parameters
    ----------
    x_mm, y_mm
        Position in map coordinates.
    heading_rad
        Direction of growth, counter-clockwise from +x.
    """

    x_mm: float
    y_mm: float
    heading_rad: float

    def __post_init__(self) -> None:
        number("pose.x_mm", self.x_mm, -LARGEST_MM, LARGEST_MM, "mm")
        number("pose.y_mm", self.y_mm, -LARGEST_MM, LARGEST_MM, "mm")
        number("pose.heading", self.heading_rad, -1e6, 1e6, "rad")

    @classmethod
    def of(cls, given: "Pose | tuple[float, float, float]") -> "Pose":
        """Return the pose that a user means.

        Parameters
        ----------
        given
            A pose, or ``(x_mm, y_mm, heading_deg)``.

        Raises
        ------
        BadInputError
            If it is neither.

        Examples
        --------
        >>> Pose.of((250, 15, 90)).heading_deg
        90.0
        """
        if isinstance(given, Pose):
            return given
        try:
            x_mm, y_mm, heading_deg = given
        except (TypeError, ValueError) as error:
            raise BadInputError("pose", given, "(x_mm, y_mm, heading_deg)") from error
        number("pose.heading_deg", heading_deg, -1e6, 1e6, "deg")
        warn_of_radians("pose.heading_deg", heading_deg)
        return cls(
            x_mm=number("pose.x_mm", x_mm, -LARGEST_MM, LARGEST_MM, "mm"),
            y_mm=number("pose.y_mm", y_mm, -LARGEST_MM, LARGEST_MM, "mm"),
            heading_rad=rad(float(heading_deg)),
        )

    @property
    def text(self) -> str:
        """The pose as a user types it: ``X,Y,DEG``."""
        return f"{self.x_mm:.2f},{self.y_mm:.2f},{self.heading_deg:.2f}"

    @property
    def content(self) -> dict[str, float]:
        """The pose as it stands in JSON."""
        return {"x_mm": self.x_mm, "y_mm": self.y_mm, "heading_deg": self.heading_deg}

    @property
    def heading_deg(self) -> float:
        """Direction of growth in degrees, counter-clockwise from +x."""
        return deg(self.heading_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Start:
    """A start pose of a map, and the range that poses are drawn from.

    Parameters
    ----------
    pose
        What a single growth takes. The middle of the range; with an area, a free place in it and
        the middle of the headings.
    spread_x_mm, spread_y_mm
        Half-widths of the range of positions; not with an area.
    spread_heading_rad
        Half-width of the range of headings.
    area
        A line or a polygon in map coordinates: positions are drawn evenly from its free part.
    clearance_mm
        Least distance from walls of positions drawn from the area.
    """

    pose: Pose
    spread_x_mm: float = 0.0
    spread_y_mm: float = 0.0
    spread_heading_rad: float = 0.0
    area: LineString | Polygon | None = None
    clearance_mm: float = START_CLEARANCE_MM

    def __post_init__(self) -> None:
        number("start.spread_x_mm", self.spread_x_mm, 0.0, LARGEST_MM, "mm")
        number("start.spread_y_mm", self.spread_y_mm, 0.0, LARGEST_MM, "mm")
        number("start.spread_heading", self.spread_heading_rad, 0.0, 7.0, "rad")
        number("start.clearance_mm", self.clearance_mm, 0.0, LARGEST_MM, "mm")
        if self.area is None:
            return
        key = "start.area"
        if isinstance(self.area, Polygon):
            check_polygon(key, self.area)
        elif not isinstance(self.area, LineString) or self.area.is_empty:
            kind = self.area.geom_type if isinstance(self.area, BaseGeometry) else type(self.area)
            given = kind if isinstance(kind, str) else kind.__name__
            raise BadInputError(key, given, "a LineString or a Polygon")
        else:
            _check_near(key, self.area)
            if self.area.length == 0.0:
                raise BadInputError(key, "a line without length", "a line between different points")
        for name in ("spread_x_mm", "spread_y_mm"):
            if getattr(self, name):
                allowed = "left out: positions are drawn from the area"
                raise BadInputError(f"start.{name}", getattr(self, name), allowed)

    @property
    def has_spread(self) -> bool:
        """Whether poses drawn from it differ."""
        spread = max(self.spread_x_mm, self.spread_y_mm, self.spread_heading_rad)
        return self.area is not None or spread > 0.0


def are_valid(polygons: NDArray[np.object_]) -> NDArray[np.bool_]:
    """Return the mask of valid polygons, shape (n,); jagged ones are looked at once."""
    valid: NDArray[np.bool_] = np.ones(len(polygons), dtype=np.bool_)
    many = shapely.get_num_coordinates(polygons) > _MANY_CORNERS
    valid[~many] = shapely.is_valid(polygons[~many])
    for index in np.flatnonzero(many):
        if polygons[index] not in _FOUND_VALID:
            valid[index] = shapely.is_valid(polygons[index])
            if valid[index]:
                _FOUND_VALID.add(polygons[index])
    return valid


_MOST_CROSSINGS = 5e7
"""Corners of an outline times the walls of it that a line across meets, on average. What sweeps
across an outline takes as long as that: at the limit some seconds to validate and to clip."""


_SIMPLER = "a simpler outline: import the drawing again (vinefab map import --simplify-mm)"


def refuse_jagged(key: str, polygon: Polygon, allowed: str = _SIMPLER) -> None:
    """Refuse an outline of so many and so long teeth that no command would end with it."""
    corners = int(shapely.get_num_coordinates(polygon))
    if corners <= _MANY_CORNERS:
        return
    steps = np.abs(np.diff(shapely.get_coordinates(polygon), axis=0)).sum(axis=0)
    x0, y0, x1, y1 = polygon.bounds
    crossed = float((steps / np.maximum([x1 - x0, y1 - y0], 1e-9)).max())
    if corners * crossed > _MOST_CROSSINGS:
        given = f"{counted(corners, 'corner')}, {counted(round(crossed), 'wall')} across"
        raise BadInputError(key, given, allowed)


def check_polygon(key: str, polygon: Polygon) -> None:
    """Refuse all but a valid polygon of finite size."""
    if not isinstance(polygon, BaseGeometry):
        raise BadInputError(key, polygon, "a Polygon: shapely.box(0, 0, 500, 400)")
    if polygon.is_empty or polygon.geom_type != "Polygon":
        raise BadInputError(key, polygon.geom_type, "one polygon with an area")
    _check_near(key, polygon)
    refuse_jagged(key, polygon)
    if not are_valid(np.array([polygon], dtype=np.object_))[0]:
        raise BadInputError(key, shapely.is_valid_reason(polygon), "a polygon that is valid")


def _check_near(key: str, shape: BaseGeometry) -> None:
    box = shape.bounds
    if not all(abs(value) <= LARGEST_MM for value in box):
        raise BadInputError(key, box, f"finite coordinates up to {LARGEST_MM:g} mm")
