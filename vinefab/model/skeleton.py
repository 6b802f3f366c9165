"""Skeletons that are drawn as line segments, and the branches that they are."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import scipy  # its parts load at their first use
from numpy.typing import ArrayLike

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM, Floats, number
from vinefab.model.tree import Bend

MOST_SEGMENTS = 100_000

Place = tuple[float, float]
"""x and y, mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnBranch:
    """A branch as lines draw it, from the joint at its base to the next joint or its tip."""

    name: str  # its path below the trunk, `0-2`; the trunk's is `trunk`
    of: str  # name of its parent; of the trunk empty
    angle_deg: float  # from the parent's heading at its end, counter-clockwise positive
    length_mm: float
    bends: tuple[Bend, ...]
    width_mm: float | None  # as its first line that has one says
    ends_mm: tuple[Place, Place]  # where it begins and ends

    @property
    def where(self) -> str:
        """Its name in messages."""
        one, two = self.ends_mm
        return f"the line from {place_text(one)} to {place_text(two)}"


def place_text(place_mm: Sequence[float]) -> str:
    """Return a place as text."""
    return f"({place_mm[0]:.6g}, {place_mm[1]:.6g})"


def traced_branches(
    segments_mm: ArrayLike,
    *,
    base_mm: Sequence[float] | None,
    snap_mm: float,
    widths_mm: ArrayLike | None,
    most_branches: int,
) -> tuple[tuple[float, float, float], list[DrawnBranch]]:
    """Return the branches that segments draw, level by level, and the trunk's pose.

    Parameters
    ----------
    segments_mm
        x and y of both ends of each, in any order and direction; shape (n, 4).
    base_mm
        The end where the trunk begins; the lowest loose end, of several the left one, if None.
    snap_mm
        Ends no further apart are one joint.
    widths_mm
        Of each, shape (n,); NaN where it is not known. Where it changes, a branch ends.
    most_branches
        Of the trace.

    Returns
    -------
    tuple
        x and y of the base, mm, and the trunk's heading, degrees; then the trunk, and the others
        by level and clockwise-most first.

    Raises
    ------
    BadInputError
        If the segments make no tree, or the base lies in the middle; the message names the place.
    """
    lines = _checked(segments_mm)
    number("snap_mm", snap_mm, 1e-6, 1000.0, "mm")
    widths = np.full(len(lines), math.nan) if widths_mm is None else np.asarray(widths_mm, float)
    if widths.shape != (len(lines),):
        raise BadInputError("widths_mm", widths.shape, f"one width per segment, ({len(lines)},)")
    places, nodes = _snapped(lines.reshape(-1, 2).tolist(), snap_mm)
    ends = [(nodes[2 * row], nodes[2 * row + 1]) for row in range(len(lines))]
    at: list[list[int]] = [[] for _ in places]  # segments at each node
    for row, (one, two) in enumerate(ends):
        length_mm = math.dist(lines[row, :2], lines[row, 2:])
        if one == two or length_mm <= snap_mm:
            problem = f"a line at {place_text(places[one])} is {length_mm:.3g} mm long"
            remedy = f"lines are longer than {snap_mm:g} mm, within which ends are one joint"
            raise UnfitInputError("segments", problem, remedy)
        at[one].append(row)
        at[two].append(row)
    base = _base_of(places, at, base_mm, snap_mm)
    walk = _Walk(places=places, ends=ends, at=at, widths=widths.tolist(), most=most_branches)
    traced = walk.branches(base)
    _refuse_loose(places, ends, walk.used)
    trunk = traced[0]
    return (*places[base], trunk.angle_deg), traced


def _checked(segments_mm: ArrayLike) -> Floats:
    try:
        lines = np.asarray(segments_mm, dtype=np.float64)
    except (TypeError, ValueError):
        lines = np.zeros(0)
    if lines.ndim != 2 or lines.shape[1] != 4:
        raise BadInputError("segments", np.shape(lines), "numbers x1, y1, x2, y2, shape (n, 4)")
    if not 1 <= len(lines) <= MOST_SEGMENTS:
        given = counted(len(lines), "line")
        raise BadInputError("segments", given, f"1 to {MOST_SEGMENTS}")
    wrong = ~(np.abs(lines) <= LARGEST_MM).all(axis=1)
    if wrong.any():
        row = int(np.argmax(wrong))
        allowed = f"coordinates from -{LARGEST_MM:g} to {LARGEST_MM:g} mm"
        raise BadInputError(f"segments[{row + 1}]", lines[row].tolist(), allowed)
    return lines


def _snapped(points_mm: list[list[float]], snap_mm: float) -> tuple[list[Place], list[int]]:
    """Return the joints, and the one of each point: the nearest within a distance, or a new one.

    A joint stands where its first point does.
    """
    places: list[Place] = []
    cells: dict[tuple[int, int], list[int]] = {}
    around = [(right, up) for right in (-1, 0, 1) for up in (-1, 0, 1)]
    nodes = []
    for x, y in points_mm:
        column, row = math.floor(x / snap_mm), math.floor(y / snap_mm)
        near = [
            (math.dist(places[node], (x, y)), node)
            for right, up in around
            for node in cells.get((column + right, row + up), ())
        ]
        off_mm, node = min(near, default=(math.inf, -1))
        if off_mm > snap_mm:
            node = len(places)
            places.append((x, y))
            cells.setdefault((column, row), []).append(node)
        nodes.append(node)
    return places, nodes


def _base_of(
    places: list[Place], at: list[list[int]], base_mm: Sequence[float] | None, snap_mm: float
) -> int:
    """Return the node where the trunk begins."""
    loose = [node for node, rows in enumerate(at) if len(rows) == 1]
    if base_mm is None:
        if not loose:
            problem = f"the lines at {place_text(places[0])} are a loop without a loose end"
            raise UnfitInputError("segments", problem, "draw a tree")
        return min(loose, key=lambda node: places[node][::-1])
    try:
        x, y = (number("base", one, -LARGEST_MM, LARGEST_MM, "mm") for one in base_mm)
    except (TypeError, ValueError) as error:
        if isinstance(error, BadInputError):
            raise
        raise BadInputError("base", base_mm, "x and y, mm") from None
    off_mm, node = min((math.dist(place, (x, y)), node) for node, place in enumerate(places))
    if off_mm > snap_mm:
        near = f"no line ends within {snap_mm:g} mm of {place_text((x, y))}"
        remedy = f"the nearest end is at {place_text(places[node])}"
        raise UnfitInputError("base", near, remedy)
    if len(at[node]) > 1:
        problem = f"{place_text((x, y))} lies in the middle: {len(at[node])} lines meet there"
        raise UnfitInputError("base", problem, "name a loose end")
    return node


def _refuse_loose(places: list[Place], ends: list[tuple[int, int]], used: list[bool]) -> None:
    """Refuse lines that are not joined to the trunk; name the place where they come nearest."""
    if all(used):
        return
    joined = sorted({node for row, one in enumerate(ends) if used[row] for node in one})
    apart = sorted({node for row, one in enumerate(ends) if not used[row] for node in one})
    tree = scipy.spatial.KDTree(np.array([places[node] for node in joined]))
    off_mm, nearest = tree.query(np.array([places[node] for node in apart]))
    off_mm, nearest = np.asarray(off_mm), np.asarray(nearest)
    closest = int(np.argmin(off_mm))
    here, there = places[apart[closest]], places[joined[int(nearest[closest])]]
    problem = f"the lines at {place_text(here)} are joined to no others"
    remedy = (
        f"the nearest end of the tree is {off_mm[closest]:.3g} mm away at {place_text(there)}: "
        "lines are joined end to end"
    )
    raise UnfitInputError("segments", problem, remedy)


@dataclass(slots=True, kw_only=True)
class _Walk:
    """A walk along lines from the base, joint by joint."""

    places: list[Place]
    ends: list[tuple[int, int]]  # nodes of each segment
    at: list[list[int]]  # segments of each node
    widths: list[float]
    most: int
    used: list[bool] = field(init=False)  # by segment

    def __post_init__(self) -> None:
        self.used = [False] * len(self.ends)

    def branches(self, base: int) -> list[DrawnBranch]:
        """Return the trunk and all others, level by level."""
        seen = [False] * len(self.places)
        seen[base] = True
        level = [("trunk", "", 0.0, self._chain(base, self.at[base][0], seen))]
        found: list[DrawnBranch] = []
        while level:
            below = []
            for name, of, from_rad, (nodes, width) in level:
                branch, to_rad = self._branch(name, of, from_rad, nodes, width)
                found.append(branch)
                chains = [
                    self._chain(nodes[-1], row, seen)
                    for row in self.at[nodes[-1]]
                    if not self.used[row]
                ]
                chains.sort(key=lambda one: _turn(to_rad, self._heading(*one[0][:2])))
                above = "" if name == "trunk" else f"{name}-"
                below += [(f"{above}{k}", name, to_rad, one) for k, one in enumerate(chains)]
                if len(found) + len(below) > self.most + 1:
                    given = f"more than {self.most}"
                    raise BadInputError("segments", given, f"at most {self.most} branches")
            level = below
        return found

    def _chain(self, node: int, row: int, seen: list[bool]) -> tuple[list[int], float]:
        """Return the nodes from a joint along a segment to the next joint, and the width."""
        nodes, width = [node], math.nan
        while True:
            self.used[row] = True
            width = self.widths[row] if math.isnan(width) else width
            one, two = self.ends[row]
            node = two if one == nodes[-1] else one
            if seen[node]:
                problem = f"lines close a loop at {place_text(self.places[node])}"
                raise UnfitInputError("segments", problem, "a robot is a tree: open it")
            seen[node] = True
            nodes.append(node)
            on = [one for one in self.at[node] if not self.used[one]]
            if len(on) != 1 or (width != self.widths[on[0]] and not self._unknown(width, on[0])):
                return nodes, width
            row = on[0]

    def _unknown(self, width: float, row: int) -> bool:
        return math.isnan(width) or math.isnan(self.widths[row])

    def _heading(self, one: int, two: int) -> float:
        (x1, y1), (x2, y2) = self.places[one], self.places[two]
        return math.atan2(y2 - y1, x2 - x1)

    def _branch(
        self, name: str, of: str, from_rad: float, nodes: list[int], width: float
    ) -> tuple[DrawnBranch, float]:
        """Return the branch along some nodes, and its heading at its end."""
        kept = [nodes[0]]
        straight_rad = 1e-9  # A line that turns by less goes straight on
        for node, after in pairwise(nodes[1:]):
            turn = _turn(self._heading(kept[-1], node), self._heading(node, after))
            if abs(turn) > straight_rad:
                kept.append(node)
        kept.append(nodes[-1])
        headings = [self._heading(one, two) for one, two in pairwise(kept)]
        run_mm, bends = 0.0, list[Bend]()
        for index, (one, two) in enumerate(pairwise(kept)):
            if index:
                turn = _turn(headings[index - 1], headings[index])
                bends.append((_tidy(run_mm), _tidy(math.degrees(turn))))
            run_mm += math.dist(self.places[one], self.places[two])
        traced = DrawnBranch(
            name=name,
            of=of,
            angle_deg=_tidy(math.degrees(_turn(from_rad, headings[0]))),
            length_mm=_tidy(run_mm),
            bends=tuple(bends),
            width_mm=None if math.isnan(width) else width,
            ends_mm=(self.places[nodes[0]], self.places[nodes[-1]]),
        )
        return traced, headings[-1]


def _turn(one_rad: float, two_rad: float) -> float:
    """Return the turn from one heading to another, within half a turn."""
    return math.remainder(two_rad - one_rad, math.tau)


def _tidy(value: float) -> float:
    """Return a length or an angle without the noise of its last bits."""
    digits = 12
    return round(value, digits)
