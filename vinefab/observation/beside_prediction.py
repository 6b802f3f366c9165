"""Comparison of observation and prediction: shapes, contacts, stops, and which half-angle fits.

A line is the best explanation of the film, and it may be wrong. So every branch is looked at again,
at its base, at its tip and along its line; `branch_sights` lists the doubts that remain.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import LineString

from vinefab.core.limits import deg
from vinefab.core.validation import Floats
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.observation.centre_lines import BLUR_MM, TracedBranch, TracedTree
from vinefab.observation.film import SeenFilm
from vinefab.observation.observed_contacts import (
    HEADING_ERROR_DEG,
    JOINT_ERROR_DEG,
    Replays,
    SeenBranch,
    WallMeeting,
    apart_mm,
    seen_meetings,
    wall_order,
)
from vinefab.physics.tube import inflated_radius_mm

GOES_ON: Final = "film continues beyond its tip"
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
"""From a tip's edge: there lies neither its blur nor its seam, but film that continues would."""

WIDE_ENOUGH = 0.5
"""Film that continues is at least this share of the tube wide."""

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
    """Return the visibility of each branch of a tree, parents before their children.

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
        """Return the doubts about one branch."""
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
        """Return the difference of a branch's heading from the plan at its base, in degrees."""
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
    """Return the mask of the pixels of a plan in areas."""
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


HALF_ANGLES_DEG = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 12.0, 15.0)
"""Head-on half-angles that predictions are made with: the contact range, which is assumed."""

SHAPE_ERROR_MM = 2.0
SHAPE_ERROR_SHARE = 0.03
"""Standard error of a predicted branch, plus this share of the way to it [assumed]: real robots
were 0.3 to 3.5 % of their length off predictions of the model."""

WORST_ERRORS = 4.0
"""A branch is never counted as farther off than so many standard errors, so that one that went
another way, or did not deploy, does not decide alone."""

POINTS = 60
"""Points at equal arc lengths at which two lines are compared."""

UNCLEAR = "unclear"
"""A stop of which it is not known how it came about."""

LEAST_EXPLAINED = 0.8
"""With less of the film in the lines, or of the lines on film, design and photo do not fit."""

MOST_DOUBTFUL = 0.5
"""With more of the branches in doubt, they do not either."""

TOLD_APART_SHARE = 0.5
"""A branch of which less than this share lies alone could not be told from others."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedBranch:
    """One branch, seen and predicted.

    Parameters
    ----------
    stop_observed
        ``full_length``, ``head_on``, ``corner``, ``not_deployed`` or ``unclear``.
    mean_mm, most_mm
        Distance of both lines at equal arc lengths, up to the shorter one's end; None unless both
        are there.
    hausdorff_mm
        The largest distance from a point of one line to the other.
    tip_and_base_seen
        Whether both of its ends are on film.
    doubts
        What the photo leaves open of it. With any, nothing is claimed of its stop and contacts.
    """

    id: str
    level: int
    planned_mm: float
    observed_mm: float
    predicted_mm: float
    points_mm: Floats
    predicted_points_mm: Floats
    stop_observed: str
    stop_predicted: str
    mean_mm: float | None
    most_mm: float | None
    hausdorff_mm: float | None
    width_mm: float | None
    nominal_width_mm: float
    seen: float
    told_apart: float
    contacts: tuple[WallMeeting, ...]
    order_observed: tuple[str, ...]
    order_predicted: tuple[str, ...]
    tip_and_base_seen: bool
    doubts: tuple[str, ...] = ()

    @property
    def deployed_observed(self) -> bool:
        """Whether it was seen."""
        return len(self.points_mm) > 0

    @property
    def deployed_predicted(self) -> bool:
        """Whether it was predicted to emerge."""
        return self.stop_predicted != Stop.NOT_DEPLOYED.label

    @property
    def share(self) -> float | None:
        """Mean distance as a share of the length seen."""
        if self.mean_mm is None or self.observed_mm == 0.0:
            return None
        return self.mean_mm / self.observed_mm

    @property
    def is_ambiguous(self) -> bool:
        """Whether it could not be told from other branches."""
        return self.deployed_observed and self.told_apart < TOLD_APART_SHARE


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfAngleFit:
    """How well the prediction with one head-on half-angle has the shape seen.

    Parameters
    ----------
    mean_mm
        Mean distance at equal arc lengths over the length of all branches that are in both.
    same_stops
        Branches that end as predicted.
    log_likelihood
        Of the shape [assumed errors], less that of the best half-angle.
    """

    half_angle_deg: float
    mean_mm: float
    same_stops: int
    log_likelihood: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A photo's robot with its prediction."""

    is_read: bool  # whether this design from this pose can be what the photo shows
    prediction: Deployment
    options: GrowthOptions
    branches: tuple[ComparedBranch, ...]
    fits: tuple[HalfAngleFit, ...]
    notes: tuple[str, ...]

    @property
    def best_half_angles_deg(self) -> tuple[float, ...]:
        """Half-angles that explain the shape about as well as the best: within 2 of its log."""
        return tuple(fit.half_angle_deg for fit in self.fits if fit.log_likelihood > -2.0)


def compare_with_prediction(
    traced: TracedTree,
    design: Design,
    world: Map,
    pose: Pose,
    given: Mapping[str, object] | None = None,
    *,
    sights: Sequence[BranchSight] = (),
) -> Compared:
    """Return a traced robot with the prediction of the growth model.

    Parameters
    ----------
    given
        Growth options by name that replace those of the design.
    sights
        How well each branch was seen; all well if none are given.
    """
    choice = GrowthChoice.of([design], given).single
    terrain, replays = Terrain.of(world), Replays(world)
    prediction = grow_on(design, terrain, pose, choice.options)
    branches = tuple(
        _compared(index, traced, design, prediction, choice.options, replays)
        for index in range(len(traced.tree))
    )
    if sights:
        branches = tuple(map(_as_seen, branches, sights))
    is_read = _is_read(traced, branches)
    if not is_read:
        branches = tuple(
            _unclaimed(replace(branch, doubts=(*branch.doubts, NO_VERDICT))) for branch in branches
        )
    return Compared(
        is_read=is_read,
        prediction=prediction,
        options=choice.options,
        branches=branches,
        fits=_half_angle_fits(traced, branches, design, terrain, pose, choice.options),
        notes=choice.notes,
    )


def _as_seen(branch: ComparedBranch, sight: BranchSight) -> ComparedBranch:
    """Return a branch of which no more is claimed than was seen."""
    doubts = sight.doubts
    if branch.stop_observed == UNCLEAR:
        doubts = (*doubts, NO_WALL)
    known = replace(branch, tip_and_base_seen=sight.tip_and_base, doubts=doubts)
    return _unclaimed(known) if doubts else known


def _unclaimed(branch: ComparedBranch) -> ComparedBranch:
    """Return a branch without claims about the effect of walls on it."""
    contacts = tuple(contact.changed(outcome="unclear") for contact in branch.contacts)
    at_wall = branch.stop_observed in (Stop.HEAD_ON.label, Stop.CORNER.label)
    stop = UNCLEAR if at_wall else branch.stop_observed
    return replace(branch, contacts=contacts, stop_observed=stop)


def _is_read(traced: TracedTree, branches: Sequence[ComparedBranch]) -> bool:
    """Tell whether a design from a pose can be what a photo shows.

    Lines explain the film, film supports the lines, and joints explain the branches.
    """
    explained = min(traced.film_explained, traced.lines_supported) >= LEAST_EXPLAINED
    doubtful = sum(bool(branch.doubts) for branch in branches)
    return explained and doubtful <= MOST_DOUBTFUL * len(branches)


def _compared(
    index: int,
    traced: TracedTree,
    design: Design,
    prediction: Deployment,
    options: GrowthOptions,
    replays: Replays,
) -> ComparedBranch:
    seen, tree = traced.branches[index], traced.tree
    level = int(tree.level[index])
    radius = inflated_radius_mm(design.build.widths_mm[level - 1])
    contacts: tuple[WallMeeting, ...] = ()
    stop = Stop.NOT_DEPLOYED.label
    if seen.deployed:
        contacts, stop = seen_meetings(replays, _seen_branch(index, traced, prediction, radius))
    chain = prediction.chain_mm(index)
    mean, most = distance_mm(seen.points_mm, chain)
    hausdorff = apart_mm(seen.points_mm, chain)
    return ComparedBranch(
        id=tree.ids[index],
        level=level,
        planned_mm=float(tree.length_mm[index]),
        observed_mm=seen.length_mm,
        predicted_mm=float(prediction.grown_mm[index]),
        points_mm=seen.points_mm,
        predicted_points_mm=chain,
        stop_observed=stop,
        stop_predicted=Stop(int(prediction.stop[index])).label,
        mean_mm=mean,
        most_mm=most,
        hausdorff_mm=hausdorff if np.isfinite(hausdorff) else None,
        width_mm=seen.width_mm if np.isfinite(seen.width_mm) else None,
        nominal_width_mm=2.0 * radius,
        seen=seen.seen,
        told_apart=seen.told_apart,
        contacts=contacts,
        order_observed=tuple(
            wall_order([c for c in contacts if c.front_mm <= seen.length_mm + radius])
        ),
        order_predicted=_predicted_order(index, prediction, options, replays, radius),
        tip_and_base_seen=seen.deployed,
    )


def _seen_branch(
    index: int, traced: TracedTree, prediction: Deployment, radius: float
) -> SeenBranch:
    """Return the initial data for the replay of a branch."""
    seen, tree = traced.branches[index], traced.tree
    parent = int(tree.parent[index])
    if parent < 0:
        heading, error = prediction.pose.heading_rad, 1.5
    else:
        corners = traced.branches[parent].corners_mm
        last = corners[-1] - corners[-2]
        heading = float(np.arctan2(last[1], last[0])) + float(tree.offset_rad[index])
        # The shorter the last straight stretch, the less its heading is known.
        line_error = HEADING_ERROR_DEG * max(1.0, 40.0 / max(1.0, float(np.hypot(*last))))
        error = float(np.hypot(line_error, JOINT_ERROR_DEG))
    return SeenBranch(
        points_mm=seen.points_mm,
        length_mm=seen.length_mm,
        planned_mm=float(tree.length_mm[index]),
        ends_early=seen.ends_early,
        radius_mm=radius,
        heading_rad=heading,
        heading_error_deg=min(error, 30.0),
    )


def _predicted_order(
    index: int, prediction: Deployment, options: GrowthOptions, replays: Replays, radius: float
) -> tuple[str, ...]:
    """Return the walls that a predicted branch's tip met, in their order."""
    chain, tree = prediction.chain_mm(index), prediction.tree
    if len(chain) < 2:
        return ()
    parent = int(tree.parent[index])
    heading = prediction.pose.heading_rad
    if parent >= 0:
        before = prediction.chain_mm(parent)
        last = before[-1] - before[-2]
        heading = float(np.arctan2(last[1], last[0])) + float(tree.offset_rad[index])
    half_angle = options.only_half_angle_rad
    length = float(tree.length_mm[index])
    replay = replays.grown(chain[0], heading, length, radius, half_angle)
    if replay is None:
        return ()
    grown = float(prediction.grown_mm[index])
    return tuple(wall_order([m for m in replay.meetings if m.front_mm <= grown + 1e-6]))


def distance_mm(one: Floats, other: Floats) -> tuple[float | None, float | None]:
    """Return mean and largest distance of two lines at equal arc lengths; None without both."""
    if len(one) < 2 or len(other) < 2:
        return None, None
    lines = LineString(one), LineString(other)
    at = np.linspace(0.0, min(line.length for line in lines), POINTS)
    places = [shapely.get_coordinates(shapely.line_interpolate_point(line, at)) for line in lines]
    away = np.hypot(*(places[0] - places[1]).T)
    return float(away.mean()), float(away.max())


# --- Which half-angle fits ------------------------------------------------------------------------


def _half_angle_fits(
    traced: TracedTree,
    branches: Sequence[ComparedBranch],
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions,
) -> tuple[HalfAngleFit, ...]:
    """Return the fits of predictions over the contact range to the shape seen."""
    own = deg(options.only_half_angle_rad)
    rows = []
    for angle in sorted({*HALF_ANGLES_DEG, own}):
        changed = GrowthOptions.of({"head_on_half_angle_deg": angle}, options)
        predicted = grow_on(design, terrain, pose, changed)
        rows.append((angle, *_likeness(traced, branches, predicted)))
    top = max((row[3] for row in rows), default=0.0)
    return tuple(
        HalfAngleFit(
            half_angle_deg=round(angle, 6),
            mean_mm=mean,
            same_stops=same,
            log_likelihood=log - top,
        )
        for angle, mean, same, log in rows
    )


def _likeness(
    traced: TracedTree, branches: Sequence[ComparedBranch], predicted: Deployment
) -> tuple[float, int, float]:
    """Return the mean distance, how many branches end as seen, and the shape's log likelihood."""
    total, weight, same, log = 0.0, 0.0, 0, 0.0
    begins = [0.0] * len(traced.tree)  # the planned way along the body to each branch's base
    for index, parent in enumerate(traced.tree.parent.tolist()):
        if parent >= 0:
            begins[index] = begins[parent] + float(traced.tree.length_mm[parent])
    for index, branch in enumerate(branches):
        seen, chain = branch.points_mm, predicted.chain_mm(index)
        label = Stop(int(predicted.stop[index])).label
        same += label == branch.stop_observed
        error = SHAPE_ERROR_MM + SHAPE_ERROR_SHARE * (begins[index] + branch.planned_mm)
        mean, _ = distance_mm(seen, chain)
        if mean is None:
            missed = (len(seen) > 1) != (len(chain) > 1)
            log -= 0.5 * WORST_ERRORS**2 * missed
            continue
        length = min(branch.observed_mm, float(predicted.grown_mm[index]))
        total, weight = total + mean * length, weight + length
        away = max(mean, abs(branch.observed_mm - float(predicted.grown_mm[index])))
        log -= 0.5 * min(away / error, WORST_ERRORS) ** 2
    return total / weight if weight else 0.0, same, log
