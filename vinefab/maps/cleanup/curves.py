"""Pieces of drawings that are not straight, and their points to a tolerance."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vinefab.core.validation import Floats

MOST_POINTS = 1_000_000
"""Of one piece: a tolerance that asks for more was surely mixed up."""


class CurvePiece(Protocol):
    """A piece of a line, in the units of its source."""

    def hull(self) -> Floats:
        """Return points, shape (n, 2), whose box holds the piece."""

    def flat(self, tolerance: float) -> Floats:
        """Return points along it, shape (n, 2); chords stay within the tolerance."""


@dataclass(frozen=True, slots=True)
class Straight:
    """A polyline: its points, shape (n, 2)."""

    points: Floats

    def hull(self) -> Floats:
        """Return the points."""
        return self.points

    def flat(self, tolerance: float) -> Floats:  # noqa: ARG002  nothing to flatten
        """Return the points."""
        return self.points


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """A piece of an ellipse: ``middle + first cos(t) + second sin(t)``."""

    # middle, first, second: shape (2,) each; any two conjugate radii, so that it may be sheared and
    # scaled
    middle: Floats
    first: Floats
    second: Floats
    # start_rad, turn_rad: first t, and by how much it grows (or shrinks when negative)
    start_rad: float = 0.0
    turn_rad: float = math.tau

    def hull(self) -> Floats:
        """Return samples of it, moved out and in by as much as it may bulge between them."""
        turns = np.linspace(self.start_rad, self.start_rad + self.turn_rad, 17)
        bulge = 1.0 - math.cos(self.turn_rad / 32.0)
        reach = bulge * np.hypot(self.first, self.second)
        samples = self.at(turns)
        return np.vstack([samples - reach, samples + reach])

    def at(self, turns_rad: Floats) -> Floats:
        """Return the points at some t, shape (n, 2)."""
        cosine, sine = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
        return np.asarray(self.middle + cosine * self.first + sine * self.second)

    def flat(self, tolerance: float) -> Floats:
        """Return points on the arc; a chord's middle is at most the tolerance off."""
        # For a sheared ellipse the longer radius is at most the root of the sum of squares.
        radius = math.hypot(*self.first, *self.second)
        count = _steps(abs(self.turn_rad) / _chord_rad(radius, tolerance))
        count = max(count, math.ceil(abs(self.turn_rad) / (0.5 * math.pi) - 1e-9))
        points = self.at(self.start_rad + self.turn_rad * np.linspace(0.0, 1.0, count + 1))
        if abs(abs(self.turn_rad) - math.tau) < 1e-12:
            points[-1] = points[0]
        return points


@dataclass(frozen=True, slots=True)
class Bezier:
    """A cubic Bezier curve: its control points, shape (4, 2)."""

    controls: Floats

    def hull(self) -> Floats:
        """Return the control points."""
        return self.controls

    def flat(self, tolerance: float) -> Floats:
        """Return points on the curve, evenly spaced in its parameter (Wang's bound)."""
        bend = np.diff(self.controls, n=2, axis=0)
        worst = float(np.hypot(*bend.T).max())
        count = _steps(math.sqrt(0.75 * worst / tolerance))
        share = np.linspace(0.0, 1.0, count + 1)[:, None]
        rest = 1.0 - share
        weights = (rest**3, 3 * rest**2 * share, 3 * rest * share**2, share**3)
        points = sum(w * c for w, c in zip(weights, self.controls, strict=True))
        return np.asarray(points, dtype=np.float64)


def _chord_rad(radius: float, tolerance: float) -> float:
    """Return the angle of a chord whose middle is the tolerance off the arc."""
    if radius <= tolerance:
        return math.tau
    return 2.0 * math.acos(1.0 - tolerance / radius)


def _steps(wanted: float) -> int:
    return max(1, min(math.ceil(wanted - 1e-9), MOST_POINTS)) if math.isfinite(wanted) else 1


def bulge_arc(start: Floats, end: Floats, bulge: float) -> CurvePiece:
    """Return the arc between two points of a DXF polyline."""
    chord = end - start
    if bulge == 0.0 or not chord.any():
        return Straight(np.array([start, end]))
    # The middle lies beside the chord's, on its left for a short counter-clockwise arc.
    aside = 0.25 * (1.0 / bulge - bulge)
    middle = 0.5 * (start + end) + aside * np.array([-chord[1], chord[0]])
    first = start - middle
    return Arc(
        middle=middle,
        first=first,
        second=np.array([-first[1], first[0]]),
        turn_rad=4.0 * math.atan(bulge),
    )


def run_flat(pieces: tuple[CurvePiece, ...], tolerance: float) -> Floats:
    """Return the points of pieces that follow one another, each turned to begin where it fits."""
    parts = [piece.flat(tolerance) for piece in pieces]
    for index in range(1, len(parts)):
        if index == 1 and _nearer_at_start(parts[0], parts[1]):
            parts[0] = parts[0][::-1]
        here = parts[index - 1][-1]
        if math.dist(parts[index][-1], here) < math.dist(parts[index][0], here):
            parts[index] = parts[index][::-1]
        if len(parts[index]) > 1 and (parts[index][0] == here).all():
            parts[index] = parts[index][1:]
    return np.concatenate(parts)


def _nearer_at_start(first: Floats, second: Floats) -> bool:
    ends = (second[0], second[-1])
    return min(math.dist(first[0], end) for end in ends) < min(
        math.dist(first[-1], end) for end in ends
    )
