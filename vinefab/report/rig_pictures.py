"""Shaded pictures of a rig: put together, and bed by bed."""

import numpy as np

from vinefab.model.checked import Floats
from vinefab.report.relief import Colour, Label, Solid, relief_png
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.printing import Bed

_TINTS: tuple[Colour, ...] = ((120, 164, 190), (196, 168, 118), (142, 176, 140), (186, 146, 160))
_EXTRA: Colour = (234, 176, 0)
_TABLE: Colour = (214, 219, 222)


def assembled_png(rig: Rig, *, width_px: int = 1400) -> bytes:
    """Return a picture of the assembled rig, every part where rig.json puts it."""
    solids, labels = [], []
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
            low, high = points.min(axis=0), points.max(axis=0)
            x, y = (0.5 * (low + high))[:2].tolist()
            labels.append(Label(text=str(part.number), at_mm=(x, y, rig.options.height_mm)))
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
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        if part.number:
            place = float(middle[0]), float(middle[1]), part.size_mm[2]
            labels.append(Label(text=str(part.number), at_mm=place))
    return relief_png(solids, labels, width_px=width_px)


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
