"""How a photo is to be read: its markers, the rig's height, the film's colour or outline."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import shapely
from pydantic import Field
from shapely import Polygon
from shapely.errors import ShapelyError
from shapely.geometry.base import BaseGeometry

from vinefab.core.bounded import bounded
from vinefab.core.errors import BadInputError, UnreadableFileError, located
from vinefab.core.table import TablePart, validated
from vinefab.core.validation import Floats, number, whole
from vinefab.maps.importers.svg_drawing import Node, after, read_nodes, svg_outlines, transform
from vinefab.model.corner_marker import CornerMarker
from vinefab.model.files.shipped import read_text
from vinefab.observation.film import FilmColour
from vinefab.observation.observed_contacts import json_object

_MOST_OUTLINE_BYTES = 1 << 26
_FLAT_PX = 0.2
_SHAPES = ("path", "polygon", "polyline", "rect", "circle", "ellipse")
_NOT_DRAWN = ("defs", "metadata", "namedview", "image", "clipPath", "mask", "symbol", "style")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhotoSetup:
    """How a photo is to be read.

    Parameters
    ----------
    markers
        Markers by which it is rectified; those of the map if None.
    corners_px
        Where the corners of the box of the bounds are in the photo, (column, row), shape (4, 2):
        lower left, lower right, upper right, upper left; instead of markers.
    obstacle_mm
        Height of the obstacles, which hide what lies behind them; None if unknown.
    film_colour
        Red, green and blue of the film, if it is to be given.
    outline
        Areas of film outlined by hand, instead of its colour.
    outline_in_pixels
        Whether the outline is in pixels of the photo; else it is in map millimetres.
    """

    markers: tuple[CornerMarker, ...] | None = None
    corners_px: Floats | None = None
    obstacle_mm: float | None = None
    film_colour: FilmColour | None = None
    outline: BaseGeometry | None = None
    outline_in_pixels: bool = False

    @classmethod
    def of(
        cls,
        *,
        rig: Path | None = None,
        corners_px: tuple[float, ...] | None = None,
        obstacle_mm: float | None = None,
        film_colour: tuple[float, ...] | None = None,
        outline: Path | None = None,
    ) -> "PhotoSetup":
        """Return the setup that options of the command say.

        Raises
        ------
        BadInputError
            If a value cannot be used, or options contradict each other.
        UnreadableFileError
            If a file cannot be read.
        """
        if rig is not None and corners_px is not None:
            raise BadInputError("--corners", "given", "without --rig, whose markers say more")
        if outline is not None and film_colour is not None:
            raise BadInputError("--film-colour", "given", "without --outline, which needs none")
        markers, height = (None, None) if rig is None else _rig_facts(rig)
        if obstacle_mm is not None:
            height = number("--obstacle-height", obstacle_mm, 0.0, 10_000.0, "mm")
        if corners_px is not None and len(corners_px) != 8:
            allowed = "eight numbers: X,Y of four corners"
            raise BadInputError("--corners", list(corners_px), allowed)
        if film_colour is not None and len(film_colour) != 3:
            raise BadInputError("--film-colour", list(film_colour), "three numbers: R,G,B")
        corners = [number("--corners", part, -1e6, 1e6, "px") for part in corners_px or ()]
        red, green, blue = (
            whole("--film-colour", int(part) if part == int(part) else -1, 0, 255)
            for part in film_colour or (0, 0, 0)
        )
        is_svg = outline is not None and outline.suffix.lower() == ".svg"
        return cls(
            markers=markers,
            corners_px=np.array(corners).reshape(4, 2) if corners else None,
            obstacle_mm=height,
            film_colour=None if film_colour is None else (red, green, blue),
            outline=None if outline is None else bounded(outline, _outline, outline, is_svg=is_svg),
            outline_in_pixels=is_svg,
        )

    @property
    def content(self) -> dict[str, object]:
        """As it stands in JSON."""
        return {
            "film_colour": None if self.film_colour is None else list(self.film_colour),
            "outlined": self.outline is not None,
            "corners_px": None if self.corners_px is None else self.corners_px.tolist(),
            "obstacle_height_mm": self.obstacle_mm,
        }


# --- The rig --------------------------------------------------------------------------------------


_Place = Annotated[list[float], Field(min_length=2, max_length=2)]


class _MarkerForm(TablePart):
    number: Annotated[int, Field(ge=0, le=3)]
    corners_mm: Annotated[list[_Place], Field(min_length=4, max_length=4)]
    z_mm: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.0


class _OptionsForm(TablePart):
    height_mm: Annotated[float, Field(gt=0, le=1e5)]
    scale: Annotated[float, Field(gt=0, le=1e5)] = 1.0


class _RigForm(TablePart):
    """The part of rig.json that a photo of it needs; other keys are left alone."""

    options: _OptionsForm
    markers: Annotated[list[_MarkerForm], Field(min_length=1, max_length=4)]


def _rig_facts(path: Path) -> tuple[tuple[CornerMarker, ...], float]:
    """Return the markers and the height of the obstacles, in map millimetres, of a rig.json."""
    content = json_object(read_text(path, _MOST_OUTLINE_BYTES), path)
    if "markers" not in content:
        raise BadInputError("markers", None, "a rig.json whose rig carries corner markers", path)
    form = validated(_RigForm, content, path)
    markers = tuple(
        CornerMarker(number=m.number, corners_mm=np.array(m.corners_mm), z_mm=m.z_mm)
        for m in form.markers
    )
    return markers, form.options.height_mm / form.options.scale


# --- Outlines -------------------------------------------------------------------------------------


def _outline(path: Path, *, is_svg: bool) -> BaseGeometry:
    """Return the areas in a file, as one."""
    with located(path):
        areas = list(_svg_areas(path)) if is_svg else _geojson_areas(path)
        if not areas:
            allowed = "closed areas: polygons of GeoJSON, or paths, polygons, rects of SVG"
            raise BadInputError("--outline", "no areas", allowed)
    return shapely.union_all([shapely.make_valid(area) for area in areas])


def _geojson_areas(path: Path) -> list[Polygon]:
    content = json_object(read_text(path, _MOST_OUTLINE_BYTES), path)
    try:
        found = shapely.from_geojson(json.dumps(content))
    except (ShapelyError, ValueError, TypeError) as error:
        raise UnreadableFileError(path, f"is not GeoJSON: {str(error)[:100]}") from error
    parts = shapely.get_parts(found)
    flat = [piece for part in parts for piece in shapely.get_parts(part)]
    return [piece for piece in flat if isinstance(piece, Polygon) and not piece.is_empty]


def _svg_areas(path: Path) -> Iterator[Polygon]:
    """Yield the areas of an SVG file, in its user units: pixels of the photo under it."""
    identity = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    waiting: list[tuple[Node, Floats]] = [(read_nodes(path), identity)]
    while waiting:
        node, outer = waiting.pop()
        if node.tag in _NOT_DRAWN:
            continue
        frame = after(outer, transform(node))
        for run in svg_outlines(node) if node.tag in _SHAPES else ():
            ring = np.vstack([piece.flat(_FLAT_PX) for piece in run.pieces])
            if len(ring) > 2:
                yield Polygon(ring @ frame[:, :2].T + frame[:, 2])
        waiting += [(child, frame) for child in node.children]
