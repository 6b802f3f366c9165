"""The outlines of SVG shapes: path data with all of its commands, and the basic shapes."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.environments.curves import Arc, Bezier, Piece, Straight, run_flat
from vinefab.model.checked import Floats

_NUMBER = re.compile(r"[\s,]*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)")
_FLAG = re.compile(r"[\s,]*([01])")
_COMMAND = re.compile(r"[\s,]*([A-Za-z])")
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}


@dataclass(slots=True)
class Subpath:
    """One run of the pen: its pieces, and whether it is closed."""

    pieces: list[Piece] = field(default_factory=list)
    closed: bool = False


def path_outlines(data: str) -> list[Subpath]:
    """Return the subpaths of a path's ``d``.

    Raises
    ------
    BadInputError
        If it is not path data; the message says after how many characters.

    Examples
    --------
    >>> [(len(run.pieces), run.closed) for run in path_outlines("M0 0h9v9z m20 0 l5,5")]
    [(2, True), (1, False)]
    """
    return _Pen(data).run()


def run_points(run: Subpath, tolerance: float) -> Floats:
    """Return the points of a subpath, shape (n, 2), curves as chords within a tolerance."""
    return run_flat(tuple(run.pieces), tolerance)


class _Pen:
    """Reads path data (SVG 1.1, chapter 8)."""

    def __init__(self, data: str) -> None:
        self.data = data
        self.at = 0
        self.now = self.first = np.zeros(2)
        self.control: tuple[str, Floats] = ("", np.zeros(2))
        self.subpaths: list[Subpath] = []
        self.draw: Mapping[str, Callable[[list[float], Floats], None]] = {
            "L": self._line,
            "H": self._line,
            "V": self._line,
            "C": self._cubic,
            "S": self._cubic,
            "Q": self._quadratic,
            "T": self._quadratic,
            "A": self._arc,
        }

    def run(self) -> list[Subpath]:
        command = ""
        while self.data[self.at :].strip(" \t\r\n,"):
            letter = self._match(_COMMAND)
            if letter is not None:
                command = letter
            elif command in ("", "Z", "z"):
                raise self._wrong()
            if not self.subpaths and command not in ("M", "m"):
                raise self._wrong()
            self._step(command)
            # Further pairs after a move are lines.
            command = {"M": "L", "m": "l"}.get(command, command)
        return [run for run in self.subpaths if run.pieces]

    def _step(self, command: str) -> None:
        kind = command.upper()
        if kind not in _COUNTS:
            raise self._wrong()
        values = [self._value(kind, index) for index in range(_COUNTS[kind])]
        origin = self.now if command.islower() else np.zeros(2)
        if kind == "M":
            self.now = self.first = origin + values
            self.subpaths.append(Subpath())
        elif kind == "Z":
            self.subpaths[-1].closed = True
            self.now = self.first
        else:
            if self.subpaths[-1].closed:
                # Drawing on after a close begins a new subpath at the same place.
                self.subpaths.append(Subpath())
            self.control = self.control if kind in "CSQT" else ("", self.now)
            self._curve_or_line(kind, values, origin)

    def _curve_or_line(self, kind: str, values: list[float], origin: Floats) -> None:
        if kind == "H":
            values = [values[0], self.now[1] - origin[1]]
        elif kind == "V":
            values = [self.now[0] - origin[0], values[0]]
        if kind in "ST":
            family = "C" if kind == "S" else "Q"
            mirrored = self.now
            if self.control[0] == family:
                mirrored = 2.0 * self.now - self.control[1]
            values = [*(mirrored - origin), *values]
        self.draw[kind](values, origin)

    def _line(self, values: list[float], origin: Floats) -> None:
        end = origin + values
        pieces = self.subpaths[-1].pieces
        pieces.append(Straight(np.array([self.now, end])))
        self.now = end

    def _cubic(self, values: list[float], origin: Floats) -> None:
        controls = origin + np.array(values).reshape(-1, 2)
        self.subpaths[-1].pieces.append(Bezier(np.vstack([self.now, controls])))
        self.control, self.now = ("C", controls[1]), controls[2]

    def _quadratic(self, values: list[float], origin: Floats) -> None:
        control, end = origin + np.array(values).reshape(-1, 2)
        thirds = (self.now + 2.0 * control) / 3.0, (end + 2.0 * control) / 3.0
        self.subpaths[-1].pieces.append(Bezier(np.array([self.now, *thirds, end])))
        self.control, self.now = ("Q", control), end

    def _arc(self, values: list[float], origin: Floats) -> None:
        end = origin + values[5:]
        shape = (abs(values[0]), abs(values[1]), math.radians(values[2]))
        piece = _end_point_arc((self.now, end), shape, large=values[3] == 1, sweep=values[4] == 1)
        if piece is not None:
            self.subpaths[-1].pieces.append(piece)
        self.now = end

    def _value(self, kind: str, index: int) -> float:
        text = self._match(_FLAG if kind == "A" and index in (3, 4) else _NUMBER)
        if text is None or not math.isfinite(float(text)):
            raise self._wrong()
        return float(text)

    def _match(self, pattern: re.Pattern[str]) -> str | None:
        match = pattern.match(self.data, self.at)
        if match is None:
            return None
        self.at = match.end()
        return match[1]

    def _wrong(self) -> BadInputError:
        rest = " ".join(self.data[self.at :].split())[:30]
        return BadInputError(f"d, character {self.at + 1}", rest, "path data such as M 0 0 L 9 9 Z")


def _end_point_arc(
    ends: tuple[Floats, Floats], shape: tuple[float, float, float], *, large: bool, sweep: bool
) -> Piece | None:
    """Return the elliptical arc between two points (SVG 1.1, F.6.5 and F.6.6).

    Parameters
    ----------
    ends
        Where it begins and ends.
    shape
        Both radii and the turn of the first one, rad. Radii that are too small grow.
    large, sweep
        The longer way round; the way of growing angles.
    """
    start, end = ends
    wide, high, turn = shape
    if not (end - start).any():
        return None
    if wide == 0.0 or high == 0.0:
        return Straight(np.array([start, end]))
    turned = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    # In units of the radii the ellipse is a circle of radius 1.
    half = (turned.T @ (0.5 * (start - end))) / (wide, high)
    squared = float(half @ half)
    grown = max(1.0, math.sqrt(squared))
    aside = math.sqrt(max(0.0, 1.0 / squared - 1.0)) * (-1.0 if large == sweep else 1.0)
    middle = aside * np.array([half[1], -half[0]]) if grown == 1.0 else np.zeros(2)
    axes = turned * np.array([wide, high]) * grown
    first, last = (half / grown - middle), (-half / grown - middle)
    angles = [math.atan2(point[1], point[0]) for point in (first, last)]
    swept = (angles[1] - angles[0]) % math.tau
    return Arc(
        middle=0.5 * (start + end) + axes @ middle,
        first=axes[:, 0],
        second=axes[:, 1],
        start_rad=angles[0],
        turn_rad=swept if sweep else swept - math.tau,
    )


def rectangle(x: float, y: float, size: tuple[float, float], radii: tuple[float, float]) -> Subpath:
    """Return a rectangle, its corners rounded by elliptical radii (0 for sharp ones)."""
    width, height = size
    rx, ry = min(radii[0], 0.5 * width), min(radii[1], 0.5 * height)
    if rx <= 0.0 or ry <= 0.0:
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
        return Subpath([Straight(np.array(corners, dtype=np.float64))], closed=True)
    pieces: list[Piece] = []
    for index, (side_x, side_y) in enumerate(((1, 1), (0, 1), (0, 0), (1, 0))):
        middle = (x + rx + side_x * (width - 2 * rx), y + ry + side_y * (height - 2 * ry))
        arc = Arc(
            middle=np.array(middle),
            first=np.array([rx, 0.0]),
            second=np.array([0.0, ry]),
            start_rad=0.5 * math.pi * index,
            turn_rad=0.5 * math.pi,
        )
        pieces.append(arc)
    return Subpath(pieces, closed=True)


def ellipse(x: float, y: float, radii: tuple[float, float]) -> Subpath:
    """Return a whole ellipse about (x, y)."""
    arc = Arc(
        middle=np.array([x, y]), first=np.array([radii[0], 0.0]), second=np.array([0.0, radii[1]])
    )
    return Subpath([arc], closed=True)


def moved(piece: Piece, matrix: Floats) -> Piece:
    """Return a piece after an affine map, shape (2, 3)."""
    linear, shift = matrix[:, :2], matrix[:, 2]
    if isinstance(piece, Straight):
        return Straight(piece.points @ linear.T + shift)
    if isinstance(piece, Bezier):
        return Bezier(piece.controls @ linear.T + shift)
    if not isinstance(piece, Arc):
        raise TypeError(f"no affine map for {type(piece).__name__}")
    return Arc(
        middle=linear @ piece.middle + shift,
        first=linear @ piece.first,
        second=linear @ piece.second,
        start_rad=piece.start_rad,
        turn_rad=piece.turn_rad,
    )
