"""How a robot is mounted: which face of its film ends outside, in words and drawn."""

from collections.abc import Sequence

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.model.design import Build
from vinefab.pages.panel import ALERT, INK, SOFT, Ink, Panel

FACES_PT = 132.0
"""Height of the drawing."""

_TEXT_PT = 8.0
_PLY_PT = 2.4
"""Distance of the two faces of a ply in the drawing."""


def face_words(build: Build) -> str:
    """Return which face ends outside, a sentence without a full stop."""
    if build.mounting == "turned":
        return "Deployed, the face that lies outside as cut is outside again"
    return "Deployed, the face that lies inside as cut is outside"


def draw_faces(panel: Panel, build: Build, sides_pt: tuple[float, float], y: float) -> None:
    """Draw a tube lengthwise, each face in its colour: as cut, mounted, while it grows.

    Parameters
    ----------
    sides_pt
        Left and right end of the drawing.
    y
        Height of the tubes' axes.
    """
    is_turned = build.mounting == "turned"
    as_cut, turned = (INK, ALERT), (ALERT, INK)  # outer face of the tube, inner face
    flat = ("as cut, mouth to the left", _AS_CUT, as_cut)
    inside_out = [("turned inside out", _AS_CUT, turned)] if is_turned else []
    mounted = turned if is_turned else as_cut
    stages = [
        flat,
        *inside_out,
        ("mounted, tail over the base", _MOUNTED, mounted),
        ("growing", _GROWING, mounted),
    ]
    left, right = sides_pt
    wide = (right - left) / len(stages)
    for number, (words, path, colours) in enumerate(stages):
        x = left + number * wide
        panel.written((x, y + 36.0), words, _TEXT_PT, colour=SOFT)
        if path is not _AS_CUT:
            for side in (-1.0, 1.0):  # the base: a pipe out of a vessel
                pipe = np.array([(0.0, 30.0), (0.0, 14.0), (40.0, 14.0)]) * (1.0, side)
                panel.line(pipe + np.array([x + 80.0, y]), Ink(line=SOFT, width_pt=2.2))
        _draw_film(panel, np.array(path) + np.array([x, y]), colours)
    for row, (words, colour) in enumerate(
        (("face outside as cut", INK), ("face inside as cut", ALERT))
    ):
        at = left + 190.0 * row
        panel.line([(at, y - 41.0), (at + 14.0, y - 41.0)], Ink(line=colour, width_pt=1.5))
        panel.written((at + 18.0, y - 44.0), words, _TEXT_PT, colour=colour)


# A ply from one end of the mouth around the tip to the other, the tube's outer face to the left.
_AS_CUT = [(0.0, 18.0), (120.0, 18.0), (132.0, 9.0), (132.0, -9.0), (120.0, -18.0), (0.0, -18.0)]
_BELOW = [(92.0, -20.0), (126.0, -20.0), (126.0, -9.0)]
_MOUNTED = [*_BELOW, (20.0, -9.0), (12.0, 0.0), (20.0, 9.0), *((x, -y) for x, y in _BELOW[::-1])]
_TIP = [(92.0, -20.0), (176.0, -20.0), (186.0, -13.0), (176.0, -6.0)]
_GROWING = [*_TIP, (42.0, -6.0), (34.0, 0.0), (42.0, 6.0), *((x, -y) for x, y in _TIP[::-1])]


def _draw_film(panel: Panel, path_pt: Floats, colours: Sequence[str]) -> None:
    """Draw both faces of a ply beside its middle: the left one, the right one."""
    line = shapely.LineString(path_pt)
    for side, colour in zip((1.0, -1.0), colours, strict=True):
        face = shapely.get_coordinates(line.offset_curve(side * _PLY_PT / 2.0))
        panel.line(face, Ink(line=colour, width_pt=1.6))
