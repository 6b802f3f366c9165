"""Shaded pictures of a rig: put together, and bed by bed."""

import numpy as np
import shapely
from shapely import Polygon

from vinefab.model.checked import Floats
from vinefab.report.relief import Colour, Label, Solid, relief_png
from vinefab.rig.clean import pieces_of
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.printing import Bed
from vinefab.rig.solid import stacked

_TINTS: tuple[Colour, ...] = ((120, 164, 190), (196, 168, 118), (142, 176, 140), (186, 146, 160))
_EXTRA: Colour = (234, 176, 0)
_TABLE: Colour = (214, 219, 222)
_BOARD: Colour = (232, 222, 204)


def assembled_png(rig: Rig, *, width_px: int = 1400) -> bytes:
    """Return a picture of the assembled rig, every part where rig.json puts it."""
    solids, labels = _board(rig), []
    for part in rig.printed:
        points = _on_map(part, rig.options.scale)
        solids.append(
            Solid(
                vertices_mm=points,
                faces=part.faces,
                colour=_tint(part),
                light_from_mm=0.5 * rig.options.height_mm if part.number else -np.inf,
            )
        )
        if part.number:
            labels.append(Label(text=str(part.number), at_mm=_spot(part, points)))
    return relief_png(solids, labels, width_px=width_px)


def bed_png(rig: Rig, bed: Bed, *, width_px: int = 700) -> bytes:
    """Return a picture of one bed as it is printed, the printer's plate below."""
    printer = rig.printer
    solids = [_plate(printer.bed_width_mm, printer.bed_depth_mm)]
    labels = []
    for at in bed.places:
        part = rig.printed[at.index]
        points = part.vertices_mm + np.array([at.x_mm, at.y_mm, 0.0])
        solids.append(
            Solid(
                vertices_mm=points,
                faces=part.faces,
                colour=_tint(part),
                light_from_mm=0.5 * part.size_mm[2] if part.number else -np.inf,
            )
        )
        if part.number:
            labels.append(Label(text=str(part.number), at_mm=_spot(part, points)))
    return relief_png(solids, labels, width_px=width_px)


def layered_png(rig: Rig, *, width_px: int = 1400) -> bytes:
    """Return a picture of a rig whose obstacles are cut in layers: walls on their board."""
    scale, height_mm = rig.options.scale, rig.options.height_mm
    pieces = pieces_of(shapely.transform(rig.walls, lambda points: scale * points), Polygon())
    vertices, faces = stacked(pieces, pieces_of(Polygon()), height_mm, 0.0)
    walls = Solid(vertices_mm=vertices, faces=faces, colour=_TINTS[1])
    return relief_png([*_board(rig), walls], width_px=width_px)


def _board(rig: Rig) -> list[Solid]:
    """Return the board that loose obstacles stand on; tiles bring their own plate."""
    if rig.style == "plate":
        return []
    scale, plate_mm = rig.options.scale, rig.options.plate_mm
    pieces = pieces_of(shapely.transform(rig.plate, lambda points: scale * points), Polygon())
    vertices, faces = stacked(pieces, pieces_of(Polygon()), plate_mm, 0.0)
    return [Solid(vertices_mm=vertices - (0.0, 0.0, plate_mm), faces=faces, colour=_BOARD)]


def _spot(part: RigPart, points_mm: Floats) -> tuple[float, float, float]:
    """Return where a part's number is written: the middle of a tile, or the top of a piece."""
    top_mm = float(points_mm[:, 2].max())
    if part.row:
        x_mm, y_mm = 0.5 * (points_mm.min(axis=0) + points_mm.max(axis=0))[:2]
        return float(x_mm), float(y_mm), top_mm
    corners = points_mm[part.faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    x_mm, y_mm, z_mm = corners[int(doubled.argmax())].mean(axis=0).tolist()
    return x_mm, y_mm, z_mm


def _tint(part: RigPart) -> Colour:
    """Return a colour in which neighbouring tiles differ."""
    if not part.number:
        return _EXTRA
    if part.row:
        return _TINTS[2 * (part.row % 2) + part.column % 2]
    return _TINTS[part.number % len(_TINTS)]


def _on_map(part: RigPart, scale: float) -> Floats:
    """Return a part's corners where they stand, in millimetres of the rig."""
    return np.asarray(scale * (part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]))


def _plate(width_mm: float, depth_mm: float) -> Solid:
    """Return the printer's plate: a box of 2 mm below the parts."""
    x, y, z = np.meshgrid([0.0, width_mm], [0.0, depth_mm], [-2.0, 0.0], indexing="ij")
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    sides = [(1, 5, 7, 3), (0, 4, 5, 1), (4, 6, 7, 5), (6, 2, 3, 7), (2, 0, 1, 3), (0, 2, 6, 4)]
    faces = [corner for a, b, c, d in sides for corner in ((a, b, c), (a, c, d))]
    return Solid(vertices_mm=points, faces=np.array(faces), colour=_TABLE)
