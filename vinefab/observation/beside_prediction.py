"""What was seen beside what was predicted: shapes, contacts, stops, and which half-angle fits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import LineString

from vinefab.core.units import deg
from vinefab.core.validation import Floats
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.observation.centre_lines import TracedTree
from vinefab.observation.doubts import NO_VERDICT, NO_WALL, BranchSight
from vinefab.observation.meetings import (
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
    """A photo's robot beside its prediction."""

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
    """Return a traced robot beside what the growth model says.

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
    """Return a branch without claims of what walls did to it."""
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
    """Return what the replay of a branch begins with."""
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
    """Return how well predictions over the contact range have the shape seen."""
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
