"""What a photo leaves open of each branch: where its film was not seen, or may be another's.

A line is the best explanation of the film, and it may be wrong. So every branch is looked at again,
at its base, at its tip and along its line, and what could be otherwise is said.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import LineString

from vinefab.core.units import deg
from vinefab.core.validation import Floats
from vinefab.observation.centre_lines import BLUR_MM, TracedBranch, TracedTree
from vinefab.observation.film import SeenFilm
from vinefab.physics.tube import inflated_radius_mm

GOES_ON: Final = "film goes on beyond its tip"
AT_OTHERS: Final = "its tip lies at other film"
TIP_UNSEEN: Final = "its tip is not seen"
BASE_UNSEEN: Final = "its base is not seen"
UNEXPLAINED: Final = "film near its tip that no line explains"
OFF_FILM: Final = "its line leaves the film"
ON_OTHERS: Final = "lies on or along other branches"
OTHER_WAY: Final = "leaves its parent in another direction than planned"
SIBLING: Final = "may be its sibling"
MAY_BE_OUT: Final = "film where it would begin"
PARENT: Final = "its parent is uncertain"
NO_WALL: Final = "ends early without a wall at its end"

NO_VERDICT: Final = "the photo gives no verdict"

ON_FILM = 0.6
"""Least share of film over the middle of a tube, of 1, where it is on film."""

AHEAD_DEG = 60.0
"""To both sides of a tip's heading film would go on."""

BEYOND_MM = 2.0, 4.5
"""From a tip's edge: there lies neither its blur nor its seam, but film that goes on would."""

WIDE_ENOUGH = 0.5
"""Film that goes on is at least this share of the tube wide."""

NEAR_MM, NEAR_RADII = 15.0, 4.0
"""Film so near to a tip should belong to a line."""

MOST_NEAR = 0.25
"""Unexplained film near a tip, over the square of the tube's diameter."""

THICK_MM = 3.0
"""Thinner unexplained film is an edge's: seams, gloss and shadows make it."""

MOST_GAP_MM = 6.0
"""Longer stretches of a line without film are no crossing or gloss."""

MOST_TURN_DEG, MOST_HINGE_DEG = 20.0, 60.0
"""Joints of real robots were up to 7 degrees off; three times that is another branch, unless a wall
that the body touches has turned it about its joint."""

TOUCHING_MM = 3.0
"""A body so near to a wall may lean on it."""

LEAST_ALONE = 0.5
"""Of a branch of which less lies alone it is not known which film is its."""

DIRECTIONS_MM = 40.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchSight:
    """How well one branch was seen."""

    tip_and_base: bool  # both on film
    doubts: tuple[str, ...]


def branch_sights(
    film: SeenFilm, traced: TracedTree, widths_mm: tuple[float, ...]
) -> tuple[BranchSight, ...]:
    """Return how well each branch of a tree was seen, parents before their children.

    Parameters
    ----------
    widths_mm
        Lay-flat widths of the levels.
    """
    looks = _Looks.of(film, traced, widths_mm)
    sights = list[BranchSight]()
    for index, parent in enumerate(traced.tree.parent.tolist()):
        doubts = looks.doubts(index)
        if parent >= 0 and sights[parent].doubts:
            doubts = [*doubts, PARENT]
        branch = traced.branches[index]
        both = branch.deployed and not {TIP_UNSEEN, BASE_UNSEEN} & set(doubts)
        sights.append(BranchSight(tip_and_base=both, doubts=tuple(dict.fromkeys(doubts))))
    return tuple(sights)


@dataclass(slots=True, eq=False)
class _Looks:
    """Film and lines, with the area that each line explains."""

    film: SeenFilm
    traced: TracedTree
    radius_mm: list[float]  # of each branch, as wide as its film is seen
    areas: Sequence[shapely.Geometry]  # of each branch on the plan; empty where none
    unexplained: NDArray[np.bool_]  # thick film that no line explains

    @classmethod
    def of(cls, film: SeenFilm, traced: TracedTree, widths_mm: tuple[float, ...]) -> "_Looks":
        radii, areas = [], []
        for branch, level in zip(traced.branches, traced.tree.level.tolist(), strict=True):
            nominal = inflated_radius_mm(widths_mm[level - 1])
            seen = 0.5 * branch.width_mm if np.isfinite(branch.width_mm) else nominal
            radii.append(max(nominal, seen))
            line = film.moved(branch.points_mm, nominal, film.sight.plane_mm)
            area = LineString(line) if len(line) > 1 else shapely.Polygon()
            areas.append(shapely.buffer(area, radii[-1] + BLUR_MM))
        explained = _drawn(areas, film)
        left = (film.share > 0.5) & ~film.solid & ~explained
        thick = max(1, round(THICK_MM / film.view.mm_per_pixel))
        left = scipy.ndimage.binary_opening(left, np.ones((thick, thick), dtype=np.bool_))
        return cls(film, traced, radii, areas, np.asarray(left))

    def doubts(self, index: int) -> list[str]:
        """Return what could be otherwise of one branch."""
        branch = self.traced.branches[index]
        if not branch.deployed:
            return self._absent(index)
        found = []
        children = np.flatnonzero(self.traced.tree.parent == index)
        grew_on = any(self.traced.branches[child].deployed for child in children)
        if not self._on_film(branch.points_mm[0], index):
            found.append(BASE_UNSEEN)
        if not self._on_film(branch.points_mm[-1], index):
            found.append(TIP_UNSEEN)
        if not grew_on:
            found += self._beyond(index)
        found += self._along(index)
        found += self._direction(index)
        return found

    def _radius(self, index: int) -> float:
        return self.radius_mm[index]

    def _on_film(self, point_mm: Floats, index: int) -> bool:
        """Tell whether the middle of a tube is seen as film at a point."""
        radius = self._radius(index)
        angle = np.arange(0.0, 2.0 * np.pi, np.pi / 4.0)
        around = 0.4 * radius * np.column_stack([np.cos(angle), np.sin(angle)])
        points = point_mm + np.vstack([np.zeros(2), around])
        if self.film.hidden(points, radius).mean() > 0.5:
            return False
        return float(self.film.at(points, radius).mean()) >= ON_FILM

    def _beyond(self, index: int) -> list[str]:
        """Return whether the film ends at the tip, all around the way ahead."""
        film, radius = self.film, self._radius(index)
        line = self.traced.branches[index].points_mm
        tip, heading = line[-1], _heading(line[::-1], max(3.0, radius)) + np.pi
        step = max(2.0, deg(0.7 / radius))
        angle = heading + np.radians(np.arange(-AHEAD_DEG, AHEAD_DEG + 0.1, step))
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        rings = [tip + (radius + out) * way for out in BEYOND_MM]
        is_film = np.logical_and.reduce(
            [(film.at(ring, radius) > 0.5) & ~film.is_solid(ring) for ring in rings]
        )
        other = shapely.union_all([a for i, a in enumerate(self.areas) if i != index])
        seen = film.moved(rings[0], radius, film.sight.plane_mm)
        in_other = shapely.contains_xy(other, seen)
        hidden = film.hidden(rings[0], radius) & ~film.is_solid(rings[0])
        arc = (radius + BEYOND_MM[0]) * np.radians(step)
        found = []
        if _longest(is_film & ~in_other) * arc >= WIDE_ENOUGH * 2.0 * radius:
            found.append(GOES_ON)
        if _longest(is_film) * arc >= WIDE_ENOUGH * 2.0 * radius and not found:
            found.append(AT_OTHERS)
        middle = np.abs(np.arange(len(angle)) - len(angle) // 2) <= len(angle) // 4
        if hidden[middle].mean() > 0.5:
            found.append(TIP_UNSEEN)
        if self._near(tip, radius) > MOST_NEAR * (2.0 * radius) ** 2:
            found.append(UNEXPLAINED)
        return found

    def _near(self, tip_mm: Floats, radius: float) -> float:
        """Return the area of unexplained film near a tip, in mm2."""
        view = self.film.view
        reach = (NEAR_MM + NEAR_RADII * radius) / view.mm_per_pixel
        at = view.to_pixels(self.film.moved(tip_mm[None], radius, self.film.sight.plane_mm))[0]
        rows, columns = self.unexplained.shape
        row, column = (np.arange(size) + 0.5 for size in (rows, columns))
        box = np.abs(row - at[1]) <= reach, np.abs(column - at[0]) <= reach
        cut = self.unexplained[box[0]][:, box[1]]
        away = np.hypot(row[box[0]][:, None] - at[1], column[box[1]][None] - at[0])
        return float((cut & (away <= reach)).sum()) * view.mm_per_pixel**2

    def _along(self, index: int) -> list[str]:
        """Return whether the line leaves the film, or lies along others'."""
        branch, radius = self.traced.branches[index], self._radius(index)
        line = shapely.get_coordinates(shapely.segmentize(LineString(branch.points_mm), 1.0))
        there = (self.film.at(line, radius) > 0.5) | self.film.hidden(line, radius)
        gap = _longest(~there) * branch.length_mm / max(1, len(line))
        found = [OFF_FILM] if gap > MOST_GAP_MM else []
        if branch.told_apart < LEAST_ALONE:
            found.append(ON_OTHERS)
        return found

    def _launch(self, index: int) -> float | None:
        """Return how far a branch's heading is from the planned one at its base, in degrees."""
        tree, branch = self.traced.tree, self.traced.branches[index]
        parent = int(tree.parent[index])
        if parent < 0 or not branch.deployed or not self.traced.branches[parent].deployed:
            return None
        planned = self._end_heading(parent) + float(tree.offset_rad[index])
        return _turn_deg(_launch_heading(branch, self._radius(index)), planned)

    def _end_heading(self, index: int) -> float:
        line = self.traced.branches[index].points_mm
        return _heading(line[::-1], max(10.0, 2.0 * self._radius(index))) + np.pi

    def _direction(self, index: int) -> list[str]:
        off = self._launch(index)
        if off is None:
            return []
        most = MOST_HINGE_DEG if self._touches_wall(index) else MOST_TURN_DEG
        found = [OTHER_WAY] if abs(off) > most else []
        if self._fits_absent_sibling(index):
            found.append(SIBLING)
        return found

    def _touches_wall(self, index: int) -> bool:
        """Tell whether a body lies at a wall, away from its joint."""
        radius, line = self._radius(index), self.traced.branches[index].points_mm
        line = shapely.get_coordinates(shapely.segmentize(LineString(line), 1.0))
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        line = line[along > 2.0 * radius]
        angle = np.arange(0.0, 2.0 * np.pi, np.pi / 8.0)
        around = (radius + TOUCHING_MM) * np.column_stack([np.cos(angle), np.sin(angle)])
        spots = (line[:, None] + around[None]).reshape(-1, 2)
        return bool(len(line) and self.film.is_solid(spots).any())

    def _fits_absent_sibling(self, index: int) -> bool:
        """Tell whether the film leaves as an absent sibling would, as nearly as its own plan."""
        tree, branch = self.traced.tree, self.traced.branches[index]
        own = self._launch(index)
        for other in np.flatnonzero(tree.parent == tree.parent[index]).tolist():
            if other == index or self.traced.branches[other].deployed or own is None:
                continue
            planned = self._end_heading(int(tree.parent[index])) + float(tree.offset_rad[other])
            theirs = _turn_deg(_launch_heading(branch, self._radius(index)), planned)
            if abs(theirs) <= MOST_TURN_DEG and abs(theirs) < abs(own) + 0.5 * MOST_TURN_DEG:
                return True
        return False

    def _absent(self, index: int) -> list[str]:
        """Return whether a branch that no line follows may be there all the same."""
        tree = self.traced.tree
        parent = int(tree.parent[index])
        before = self.traced.branches[parent]
        if parent < 0 or not before.deployed:
            return []
        if before.ends_early:  # its children stay in, if that is true: its own doubts say
            return []
        found = []
        radius = self._radius(index)
        tip, planned = before.points_mm[-1], self._end_heading(parent)
        planned += float(tree.offset_rad[index])
        reach = 1.1 * self._radius(parent) + radius + 4.0
        angle = planned + np.radians(np.arange(-MOST_TURN_DEG, MOST_TURN_DEG + 0.1, 4.0))
        out = np.arange(reach, reach + 8.1, 2.0)
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        points = tip + out[None, :, None] * way[:, None, :]
        flat = points.reshape(-1, 2)
        is_film = (self.film.at(flat, radius) > 0.5) & ~self.film.is_solid(flat)
        unseen = self.film.hidden(flat, radius) & ~self.film.is_solid(flat)
        along = (is_film | unseen).reshape(len(angle), len(out)).all(axis=1)
        if along.any():
            found.append(MAY_BE_OUT)
        return found


def _heading(line_mm: Floats, over_mm: float) -> float:
    """Return the direction in which a line begins, over a length of it."""
    line = LineString(line_mm)
    there = shapely.get_coordinates(line.interpolate(min(over_mm, line.length)))[0]
    way = there - line_mm[0]
    return float(np.arctan2(way[1], way[0]))


def _launch_heading(branch: TracedBranch, radius: float) -> float:
    """Return the direction in which a branch leaves its joint, where its film is its own."""
    line = LineString(branch.points_mm)
    ends = np.array([min(1.5 * radius, 0.3 * line.length), min(DIRECTIONS_MM, line.length)])
    one, two = shapely.get_coordinates(shapely.line_interpolate_point(line, ends))
    return float(np.arctan2(two[1] - one[1], two[0] - one[0]))


def _turn_deg(one_rad: float, other_rad: float) -> float:
    return deg(float(np.remainder(one_rad - other_rad + np.pi, 2.0 * np.pi) - np.pi))


def _longest(there: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of True."""
    runs, count = scipy.ndimage.label(there)
    return int(np.bincount(runs)[1:].max()) if count else 0


def _drawn(areas: Sequence[shapely.Geometry], film: SeenFilm) -> NDArray[np.bool_]:
    """Return which pixels of a plan lie in areas."""
    rows, columns = film.share.shape
    area = shapely.union_all(areas)
    inside = np.zeros((rows, columns), dtype=np.bool_)
    near = np.argwhere(film.share > 0.3)
    if area.is_empty or not len(near):
        return inside
    shapely.prepare(area)
    places = film.view.to_map(near[:, ::-1].astype(np.float64) + 0.5)
    inside[near[:, 0], near[:, 1]] = shapely.contains_xy(area, places)
    return inside
