"""Occupancy grids in the form of the ROS map_server: a YAML file that names an image."""

import io
import math
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from vinefab.core.errors import BadInputError, UnfitInputError, UnreadableFileError, located
from vinefab.core.hashing import sha256_of
from vinefab.core.plain_text import visible
from vinefab.core.validation import number, positive
from vinefab.maps.cleanup.raster import (
    LARGEST_CELL_MM,
    LEAST_CELL_MM,
    GridPlacement,
    Mask,
    raster_map,
)
from vinefab.maps.importers.doubts import with_notes
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_unit import SourceUnit
from vinefab.model.files.shipped import path_inside, read_bytes, read_text
from vinefab.model.map import Map

_DEEP = ("I", "I;16", "I;16B", "I;16L")
_DEEP_TO_BYTE = 1.0 / 257.0
_GREY = ("1", "L")
_COLOUR = ("LA", "P", "PA", "RGB", "RGBA")

Values = NDArray[Any]
"""Pixel values from 0 to 255; uint8 for grey images."""


def _read_values(path: Path, data: bytes) -> tuple[Values, Values | None]:
    """Return brightness and opacity of every pixel, 0 to 255, the image's lowest row first.

    Brightness is the mean of red, green and blue.

    Returns
    -------
    tuple
        Two arrays of shape (rows, columns); the second is None when the image has no
        transparency.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data))
            image.load()
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise UnreadableFileError(path, "is an image of more than 89 million pixels") from None
    except UnidentifiedImageError:
        raise UnreadableFileError(path, "is not an image; allowed: PGM, PNG, BMP") from None
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        raise UnreadableFileError(path, f"is not an image that can be read: {error}") from None
    if image.mode in _DEEP:
        return np.asarray(image, dtype=np.float64)[::-1] * _DEEP_TO_BYTE, None
    if image.mode in _GREY:
        return np.asarray(image.convert("L"), dtype=np.uint8)[::-1], None
    if image.mode not in _COLOUR:
        raise UnreadableFileError(
            path, f"has pixels of kind {image.mode}; allowed: grey, colour or palette images"
        )
    pixels = np.asarray(image.convert("RGBA"), dtype=np.float64)[::-1]
    opacity = pixels[..., 3] if image.has_transparency_data else None
    return pixels[..., :3].mean(axis=2), opacity


_MODES = ("trinary", "scale", "raw")
_ONLY_DRAWINGS = ("join_mm", "layers", "drawn", "bounds", "margin_mm", "wall_mm", "open_lines")


@dataclass(frozen=True, slots=True, kw_only=True)
class _RosMap:
    """The YAML file: the map's metadata, as the map_server calls it."""

    image: object  # path of the image, as the file names it
    resolution_m: float  # width of a cell
    # x (m), y (m) and yaw (rad, counter-clockwise) of the lower left corner of the image's lower
    # left pixel
    origin: tuple[float, float, float]
    negate: bool  # whether white is occupied
    occupied_thresh: float  # cells above it are occupied
    free_thresh: float  # cells below it are free, those in between unknown
    mode: str  # how a pixel gives an occupancy, see `_classify`

    def __post_init__(self) -> None:
        number("resolution", self.resolution_m, 1e-6, 1e6, "m")
        for value in self.origin:
            number("origin", value, -1e7, 1e7)
        number("occupied_thresh", self.occupied_thresh, 0.0, 1.0)
        number("free_thresh", self.free_thresh, 0.0, self.occupied_thresh)
        if self.mode not in _MODES:
            raise BadInputError("mode", self.mode, ", ".join(_MODES))

    def placement(self, scale_mm_per_m: float) -> GridPlacement:
        """Return where its cells lie in a map of some scale."""
        cell_mm = self.resolution_m * scale_mm_per_m
        if not LEAST_CELL_MM <= cell_mm <= LARGEST_CELL_MM:
            allowed = f"so much that a cell of {self.resolution_m:g} m becomes 0.01 to 1e6 mm"
            raise BadInputError("scale_mm_per_unit", scale_mm_per_m, allowed)
        return GridPlacement(
            cell_mm=cell_mm,
            x_mm=self.origin[0] * scale_mm_per_m,
            y_mm=self.origin[1] * scale_mm_per_m,
            turn_rad=math.remainder(self.origin[2], 2.0 * math.pi),
        )


def import_ros(path: Path, options: ImportOptions) -> Map:
    """Return the map in a ROS map_server file.

    The bounds are the outer boundary of the largest free region, or of the one with the start;
    the solid islands in it are obstacles: see `raster_map`. The map's facts list the parts read
    and left out. ``scale_mm_per_unit`` is per metre, full size (1000) by default.
    """
    options.refuse(_ONLY_DRAWINGS, "a ROS map", path)
    full_size = 1000.0
    scale = full_size if options.scale_mm_per_unit is None else options.scale_mm_per_unit
    unknown = options.unknown or "obstacle"
    positive("scale_mm_per_unit", scale, 1e6, "mm per metre")
    if unknown not in ("obstacle", "free"):
        raise BadInputError("unknown", unknown, "obstacle or free")
    source = _read_ros_yaml(path)
    largest_image_bytes = 1 << 30
    with located(path):
        image, notes = _image(source.image, path)
    data = read_bytes(image, largest_image_bytes)
    occupied, free, doubts = _cells(_read_values(image, data), source)
    notes += doubts
    facts = {
        "source": path.name,
        "image": image.name,
        "image_sha256": sha256_of(data),
        "resolution_m": source.resolution_m,
        "origin": list(source.origin),
        "negate": source.negate,
        "occupied_thresh": source.occupied_thresh,
        "free_thresh": source.free_thresh,
        "mode": source.mode,
        "unknown": unknown,
        "cells": list(free.shape[::-1]),
        "cells_free": int(free.sum()),
        "cells_occupied": int(occupied.sum()),
        "cells_unknown": int(free.size - free.sum() - occupied.sum()),
    }
    with located(path):
        world = raster_map(
            visible(path.stem),
            free if unknown == "obstacle" else ~occupied,
            source.placement(scale),
            options,
            facts,
        )
    unit = SourceUnit(name="metre", mm=full_size, known="file", by="a ROS map")
    world = unit.scaled(options.scale_mm_per_unit).of(world)
    return with_notes(replace(world, environment="ros"), *notes)


def _cells(image: tuple[Values, Values | None], source: _RosMap) -> tuple[Mask, Mask, list[str]]:
    """Return the masks of occupied and of free cells, and notes on how they are read."""
    values, opacity = image
    saved = source.mode == "trinary" and not source.negate and opacity is None
    saved = saved and _is_saved(values)
    occupied, free = _classify(values, opacity, source, saved=saved)
    if not saved or not _classified(np.array([float(_SAVED_UNKNOWN)]), None, source)[1][0]:
        return occupied, free, []
    note = (
        f"cells of {_SAVED_UNKNOWN} are unknown, as savers of maps write them; read by "
        f"free_thresh {source.free_thresh:g} they would be free (--unknown free)"
    )
    return occupied, free, [note]


_SAVED_UNKNOWN = 205


def _is_saved(values: Values) -> bool:
    """Return whether an image has the three values that map savers write, unknown and free."""
    if values.dtype == np.uint8:
        # Row by row: `bincount` copies what it counts as 8-byte integers.
        counts = sum(np.bincount(row, minlength=256) for row in values)
        held = set(np.flatnonzero(counts).tolist())
    else:
        held = set(np.unique(values).tolist())
    return {_SAVED_UNKNOWN, 254} <= held <= {0, _SAVED_UNKNOWN, 254}


def _classify(
    values: Values, opacity: Values | None, source: _RosMap, *, saved: bool
) -> tuple[Mask, Mask]:
    """Return the masks of occupied and of free cells by the rules of the map_server.

    With occupancy p = (255 - value) / 255 (value / 255 when negated): occupied when
    p > ``occupied_thresh``, free when p < ``free_thresh``, else unknown.

    - *trinary*: opacity is averaged in as a fourth colour, as the map_server does.
    - *scale*: pixels that are not opaque are unknown.
    - *saved*: cells of 205 are unknown whatever the thresholds.
    - *raw*: the value, 0 to 100, is the occupancy in percent; larger ones are unknown and
      ``negate`` does not matter.
    """
    if values.dtype == np.uint8 and opacity is None:
        occupied, free = _classified(np.arange(256.0), None, source)
        if saved:
            occupied[_SAVED_UNKNOWN] = free[_SAVED_UNKNOWN] = False
        return occupied[values], free[values]
    occupied, free = _classified(values, opacity, source)
    known = values != _SAVED_UNKNOWN if saved else True
    return occupied & known, free & known


def _classified(values: Values, opacity: Values | None, source: _RosMap) -> tuple[Mask, Mask]:
    known = np.ones(values.shape, dtype=np.bool_)
    if source.mode == "raw":
        known = np.round(values) <= 100.0
        occupancy = np.round(values) / 100.0
    else:
        if opacity is not None and source.mode == "trinary":
            values = (3.0 * values + opacity) / 4.0
        elif opacity is not None:
            known = opacity >= 255.0
        occupancy = (values if source.negate else 255.0 - values) / 255.0
    return (occupancy > source.occupied_thresh) & known, (occupancy < source.free_thresh) & known


class _PlainLoader(yaml.SafeLoader):
    """Reads YAML without aliases: a few of them make a file of 1 kB a value of gigabytes."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: yaml.NodeEvent = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or event.anchor:
            raise yaml.composer.ComposerError(
                problem="anchors (&) and aliases (*) are not read; write values out",
                problem_mark=event.start_mark,  # type: ignore[arg-type]
            )
        return super().compose_node(parent, index)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:  # noqa: ANN401, FBT001, FBT002  as in PyYAML
        try:
            return super().construct_object(node, deep)
        except (ValueError, OverflowError, LookupError, TypeError) as error:
            kind = node.tag.rpartition(":")[2]
            problem = f"{str(node.value)[:30]!r} is not a valid {kind}"
            raise yaml.constructor.ConstructorError(
                problem=problem, problem_mark=node.start_mark
            ) from error


def _read_ros_yaml(path: Path) -> _RosMap:
    """Return the metadata in a map_server's YAML file."""
    largest_yaml_bytes = 1 << 16
    text = read_text(path, largest_yaml_bytes)
    try:
        data = yaml.load(text, _PlainLoader)  # noqa: S506  a SafeLoader
    except yaml.MarkedYAMLError as error:
        where = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise UnreadableFileError(path, f"is not YAML: {where}{error.problem}") from None
    except (yaml.YAMLError, RecursionError) as error:
        problem = " ".join(str(error).split())
        raise UnreadableFileError(path, f"is not YAML: {problem}") from None
    if not isinstance(data, dict):
        raise UnreadableFileError(path, "is not a ROS map: no keys such as image and resolution")
    with located(path):
        image, origin = data.get("image"), data.get("origin")
        if not isinstance(origin, list) or len(origin) != 3:
            raise BadInputError("origin", origin, "[x, y, yaw]")
        x, y, yaw = (_number("origin", value) for value in origin)
        resolution_m = _number("resolution", data.get("resolution"))
        if (negate := data.get("negate")) not in (0, 1):
            raise BadInputError("negate", negate, "0 or 1")
        return _RosMap(
            image=image,
            resolution_m=resolution_m,
            origin=(x, y, yaw),
            negate=bool(negate),
            occupied_thresh=_number("occupied_thresh", data.get("occupied_thresh")),
            free_thresh=_number("free_thresh", data.get("free_thresh")),
            mode=str(data.get("mode", "trinary")),
        )


def _image(given: object, path: Path) -> tuple[Path, list[str]]:
    """Return the image that a map names, or the one of that name next to it, and a note on that.

    Paths in such files are often those of the machine on which the map was saved.
    """
    try:
        found = path_inside("image", given, (path.parent,), path)
        problem = None if found.is_file() else f"there is no {str(given)!r}"
    except BadInputError as error:
        if not isinstance(given, str):
            raise
        found, problem = path, str(error.value)
    if problem is None:
        return found, []
    name = re.split(r"[/\\]", str(given))[-1]
    beside = path.parent / name
    if name and name not in (".", "..") and beside.is_file():
        note = f"image {beside.name} is the one next to {path.name}, which names {given}"
        return path_inside("image", name, (path.parent,), path), [note]
    remedy = f"put {name} next to {path.name} and write image: {name}"
    raise UnfitInputError("image", problem, remedy, path)


def _number(key: str, value: object) -> float:
    """Return a number, also from text: in YAML 5e-2 without a point is a string."""
    try:
        if isinstance(value, int | float | str) and not isinstance(value, bool):
            return float(value)
    except (ValueError, OverflowError):
        pass
    raise BadInputError(key, value, "a number")
