"""Letters as strokes: a plotter's alphabet of straight lines, for marks that a laser draws."""

import numpy as np

from vinefab.model.checked import Floats
from vinefab.model.outline import Contour

_UNITS_HIGH, _ADVANCE = 6.0, 6.0

# Strokes of each sign on a grid 4 wide and 6 high; two digits are one point, x and y.
_SIGNS = {
    "A": "002640 1232",
    "B": "00063645443303 3342413000",
    "C": "4536160501103041",
    "D": "00062644422000",
    "E": "46060040 0333",
    "F": "460600 0333",
    "G": "45361605011030414323",
    "H": "0006 4046 0343",
    "I": "2026",
    "J": "4641301001",
    "K": "0006 460340",
    "L": "060040",
    "M": "0006234640",
    "N": "00064046",
    "O": "100105163645413010",
    "P": "00063645443303",
    "Q": "100105163645413010 2240",
    "R": "00063645443303 2340",
    "S": "453616050413334241301001",
    "T": "0646 2620",
    "U": "060110304146",
    "V": "062046",
    "W": "0610233046",
    "X": "0046 0640",
    "Y": "062346 2320",
    "Z": "06460040",
    "0": "100105163645413010",
    "1": "152620",
    "2": "05163645440040",
    "3": "0516364544331333 334241301001",
    "4": "30360242",
    "5": "460603334241301001",
    "6": "4536160501103041423303",
    "7": "064610",
    "8": "13040516364544331302011030414233",
    "9": "4313040516364541301001",
    ".": "2021",
    "-": "1333",
    "/": "0046",
    "+": "0343 2125",
    "=": "1232 1434",
    ":": "2122 2425",
}


def lettered(text: str, corner_mm: tuple[float, float], height_mm: float) -> tuple[Contour, ...]:
    """Return a line of text as open contours, one per stroke.

    Parameters
    ----------
    text
        Letters, digits and ``. - / + = :``; small letters are drawn as capitals, and a sign that
        the alphabet does not have as a gap.
    corner_mm
        Lower left corner of the first sign.
    height_mm
        Height of a sign; each takes as much width, its gap included.

    Examples
    --------
    >>> [len(stroke.points_mm) for stroke in lettered("T1", (0.0, 0.0), 6.0)]
    [2, 2, 3]
    """
    scale = height_mm / _UNITS_HIGH
    found = []
    for place, sign in enumerate(text.upper()):
        for stroke in _SIGNS.get(sign, "").split():
            digits = np.array([int(digit) for digit in stroke], dtype=np.float64).reshape(-1, 2)
            shift = np.array([place * _ADVANCE, 0.0])
            points: Floats = np.array(corner_mm) + scale * (digits + shift)
            found.append(Contour.polyline(points, closed=False))
    return tuple(found)


def text_width_mm(text: str, height_mm: float) -> float:
    """Return how wide a line of text is, its last gap included."""
    return len(text) * _ADVANCE * height_mm / _UNITS_HIGH
