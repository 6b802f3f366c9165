"""What is printed and laid beside a rig: a cube to check the printer's scale, an arrow to north."""

import numpy as np
import shapely
from shapely import Polygon

from vinefab.model.checked import Floats
from vinefab.rig.clean import pieces_of
from vinefab.rig.glyphs import centred, grooves, strokes
from vinefab.rig.options import GRID_MM
from vinefab.rig.part import RigPart
from vinefab.rig.solid import Hollow, stacked

CUBE_MM = 20.0
_ARROW_MM = (24.0, 44.0, 4.0)
_DEPTH_MM, _STROKE_MM, _APART_MM = 0.6, 1.0, 12.0


def extras_of(
    plate_box_mm: tuple[float, float, float, float], to_map: Floats
) -> tuple[RigPart, ...]:
    """Return the scale cube and the north arrow.

    Parameters
    ----------
    plate_box_mm
        Box of the rig's plate in plan: the two lie to the right of it, on the same table.
    to_map
        Transform from the plan, z = 0 under the plate, into map coordinates.
    """
    right_mm, top_mm = plate_box_mm[2] + _APART_MM, plate_box_mm[3]
    wide_mm, long_mm, thick_mm = _ARROW_MM
    outline = Polygon(
        [
            (0.3 * wide_mm, 0.0),
            (0.7 * wide_mm, 0.0),
            (0.7 * wide_mm, 0.5 * long_mm),
            (wide_mm, 0.5 * long_mm),
            (0.5 * wide_mm, long_mm),
            (0.0, 0.5 * long_mm),
            (0.3 * wide_mm, 0.5 * long_mm),
        ]
    )
    cube = shapely.box(0.0, 0.0, CUBE_MM, CUBE_MM)
    north_text = (0.5 * wide_mm, 0.42 * long_mm, "N", 8.0)
    cube_text = (0.5 * CUBE_MM, 0.5 * CUBE_MM, f"{CUBE_MM:.0f}", 10.0)
    north = _placed(to_map, right_mm, top_mm - long_mm)
    scale = _placed(to_map, right_mm, top_mm - long_mm - _APART_MM - CUBE_MM)
    return (
        _part("scale_cube_20mm", cube, CUBE_MM, cube_text, scale),
        _part("north_arrow", outline, thick_mm, north_text, north),
    )


def _part(
    name: str,
    outline: Polygon,
    thick_mm: float,
    text: tuple[float, float, str, float],
    to_map: Floats,
) -> RigPart:
    """Return a flat part with a text engraved into its top."""
    x_mm, y_mm, words, height_mm = text
    marks = grooves(centred(strokes(words, height_mm), x_mm, y_mm), _STROKE_MM)
    marks = shapely.set_precision(marks, GRID_MM)
    hollow = Hollow(pieces=pieces_of(marks), low_mm=thick_mm - _DEPTH_MM, high_mm=thick_mm + 1.0)
    vertices, faces = stacked(pieces_of(outline), pieces_of(Polygon()), thick_mm, 0.0, [hollow])
    volume_mm3 = outline.area * thick_mm - marks.area * _DEPTH_MM
    return RigPart(
        name=name, vertices_mm=vertices, faces=faces, to_map=to_map, volume_mm3=volume_mm3
    )


def _placed(to_map: Floats, x_mm: float, y_mm: float) -> Floats:
    shift = np.eye(4)
    shift[:2, 3] = x_mm, y_mm
    return np.asarray(to_map @ shift, dtype=np.float64)
