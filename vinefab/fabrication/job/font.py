"""A small single-line font: letters as strokes that a laser can follow.

Letters are drawn on a grid four units wide and six high; lower case is written as upper case.
"""

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.outline import Contour

WIDTH, HEIGHT, ADVANCE = 4, 6, 6

# Each word is one stroke, each pair of digits a point: across, then up.
_STROKES = {
    "A": "002640 1333",
    "B": "00063645443342413000 0333",
    "C": "4536160501103041",
    "D": "00062644422000",
    "E": "46060040 0333",
    "F": "460600 0333",
    "G": "45361605011030414323",
    "H": "0006 4046 0343",
    "I": "1636 2620 1030",
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
    "0": "100105163645413010 1234",
    "1": "152620 1030",
    "2": "05163645440040",
    "3": "0516364544334241301001 1333",
    "4": "30360242",
    "5": "460603334241301001",
    "6": "453616050110304142331302",
    "7": "064610",
    "8": "13040516364544331302011030414233",
    "9": "011030414536160504133344",
    "-": "1333",
    "_": "0040",
    ".": "2021",
    "+": "1333 2422",
    "/": "0046",
    ":": "2122 2425",
    "=": "1232 1434",
}


def _points(word: str) -> list[tuple[int, int]]:
    return [(int(word[i]), int(word[i + 1])) for i in range(0, len(word), 2)]


def unwritten(text: str) -> str:
    """Return the letters of a text that have no strokes, each once.

    >>> unwritten("caché no. 2 é")
    'É'
    """
    return "".join(dict.fromkeys(c for c in text.upper() if c != " " and c not in _STROKES))


def text_width_mm(text: str, height_mm: float) -> float:
    """Return how wide a line of text is."""
    return max(0, ADVANCE * len(text.upper()) - (ADVANCE - WIDTH)) * height_mm / HEIGHT


def text_strokes_mm(text: str, height_mm: float) -> list[Floats]:
    """Return the strokes of one line of text that begins at the origin, each shape (k, 2).

    Examples
    --------
    >>> [stroke.tolist() for stroke in text_strokes_mm("l", 6.0)]
    [[[0.0, 6.0], [0.0, 0.0], [4.0, 0.0]]]
    """
    unit = height_mm / HEIGHT
    return [
        (np.array(_points(word)) + np.array([ADVANCE * place, 0.0])) * unit
        for place, letter in enumerate(text.upper())
        for word in _STROKES.get(letter, "").split()
    ]


def lettered(text: str, corner_mm: tuple[float, float], height_mm: float) -> tuple[Contour, ...]:
    """Return a line of text as open contours, one per stroke.

    Examples
    --------
    >>> [len(stroke.points_mm) for stroke in lettered("T1", (0.0, 0.0), 6.0)]
    [2, 2, 3, 2]
    """
    strokes = text_strokes_mm(text, height_mm)
    return tuple(Contour.polyline(np.array(corner_mm) + s, closed=False) for s in strokes)
