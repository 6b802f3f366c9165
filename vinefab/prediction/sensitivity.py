"""How sensitive predictions are: to the start, to the design, to the model, to fabrication."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import shapely

from vinefab.core.plain_text import counted
from vinefab.core.rng import child
from vinefab.core.statistics import PAIRED_TAILS, mean_interval
from vinefab.core.units import rad
from vinefab.core.validation import Floats, frozen_floats
from vinefab.core.view import Data, Picture, Rows, Section
from vinefab.growth.batch import Batch, GrowthBlock, Launches, Workspace
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan, Plans
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.model.tree import BranchTree, branch_tree
from vinefab.pages.page_files import page_svg
from vinefab.prediction.family_deployments import (
    PredictionPlan,
    PreparedFamily,
    ProgressCallback,
    no_progress,
)
from vinefab.prediction.measures import (
    GROWN,
    LOOSE_PRESSURE,
    REACH,
    SEEN,
    STUCK,
    Measure,
    block_shares_percent,
    means_by_map,
    samples_text,
    worst_pressures_of,
)
from vinefab.prediction.pictures import effect_panels
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import Poses
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import outcomes


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanDifference:
    """A mean paired difference and its interval."""

    mean: float  # mean over deployments of value with the change minus value without
    # low, high: its 95 % interval over maps, or over poses where there is one map
    low: float
    high: float
    over: str  # how many maps (or poses) that is

    @property
    def is_clear(self) -> bool:
        """Whether the interval leaves out 0."""
        return self.low > 0.0 or self.high < 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """What one change of a design, a start or the model does to the measures."""

    knob: str  # what is changed (``heading``)
    step: float  # by how much, in ``unit``
    unit: str
    count: int  # deployments compared, each with itself without the change
    changes: Mapping[str, MeanDifference]  # by measure key

    @property
    def text(self) -> str:
        """The step as it is shown."""
        return f"{self.step:+g} {self.unit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """How robots of one design differ because of fabrication errors."""

    measure: Measure
    exact: float  # mean over deployments of the robot as designed
    # p05, p95: percentiles over robots of that mean
    p05: float
    p95: float
    typical: float  # median absolute change of a single deployment

    @classmethod
    def of(cls, measure: Measure, exact: Floats, made: Floats) -> "Scatter":
        """Return the scatter over robots and launches, ``made`` of shape (robots, launches)."""
        p05, p95 = np.percentile(np.nanmean(made, axis=1), [5.0, 95.0]).tolist()
        typical = float(np.nanmedian(np.abs(made - exact)))
        return cls(
            measure=measure, exact=float(np.nanmean(exact)), p05=p05, p95=p95, typical=typical
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """Scatter from fabrication: independent errors of every branch's length and angle."""

    # length_percent, angle_deg: half-widths of the uniform ranges of the errors
    length_percent: float
    angle_deg: float
    robots: int  # how many robots were drawn
    launches: int  # from how many poses each was deployed
    scatter: tuple[Scatter, ...]  # one per measure


QUICK_MEASURES = (SEEN, REACH, GROWN, STUCK, LOOSE_PRESSURE)
"""The measures that are quick enough for thousands of deployments."""

MOST_LAUNCHES = 60
"""Variants are tried from so many poses at most, spread evenly over the maps."""

HEADING_STEPS_DEG = (-20.0, -10.0, -5.0, 5.0, 10.0, 20.0)

SIDEWAYS_STEPS_MM = (-20.0, -10.0, -5.0, 5.0, 10.0, 20.0)

LENGTH_STEPS_PERCENT = (-10.0, -5.0, 5.0, 10.0)

HEAD_ON_STEPS_DEG = (4.0, 9.0, 14.0)
"""Beyond the 1 degree that is assumed: 5, 10 and 15 degrees, the most that is plausible."""

LENGTH_TOLERANCE_PERCENT = 1.0

ANGLE_TOLERANCE_DEG = 2.0
"""Half-widths of the fabrication errors [assumed]: measure your own robots."""

ROBOTS = 40

ROBOTS_TOGETHER = 8
"""So many are grown at once: what a map costs is paid once for all of them."""

_STREAM = 1703


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictionVariant:
    """One change, and how to grow with it."""

    # knob, step, unit: as in `Effect`
    knob: str
    step: float
    unit: str
    # design, options, poses: what to grow, how and from where; None stands for a pose that is not
    # free
    design: Design
    options: GrowthOptions
    poses: tuple[tuple[Pose | None, ...], ...]


class VariantEvaluator:
    """A design on a few maps, to be grown again and again with changes."""

    def __init__(self, design: Design, prepared: PreparedFamily, plan: PredictionPlan) -> None:
        keep = max(1, MOST_LAUNCHES // max(len(poses) for poses in prepared.poses))
        chosen = sorted({round(i) for i in np.linspace(0, len(prepared.maps) - 1, keep).tolist()})
        maps = tuple(prepared.maps[index] for index in chosen)
        poses = tuple(prepared.poses[index][:MOST_LAUNCHES] for index in chosen)
        self.design, self.plan = design, plan
        self.prepared = PreparedFamily(label=prepared.label, maps=maps, poses=poses)
        self.launches = self.prepared.launches()
        self._workspaces = list[Workspace]()  # of all batches: what one allocated, others use
        self.maps = [str(index) for index in self.launches.terrain.tolist()]
        self.exact = self.grow([Plan.of(design, plan.options)], plan.options)[0]

    def grow(
        self, plans: Sequence[Plan], options: GrowthOptions, poses: Poses | None = None
    ) -> Floats:
        """Return the quick measures of every plan from every pose, shape (plans, launches, 5)."""
        launches = self.launches if poses is None else Launches.of(self.launches.atlas, poses)
        if not len(launches):
            return np.empty((len(plans), 0, len(QUICK_MEASURES)))
        contexts = [place.context.without_targets for place in self.prepared.maps]
        unpressed = list[Deployment]()

        def measured(block: GrowthBlock) -> Floats:
            seen = outcomes(Coverage(area="fast"), block, contexts).terms["area"]
            reached = outcomes(Reach(area="fast"), block, contexts).score
            unpressed.extend(block.deployment(index) for index in range(len(block)))
            grown, stuck, _ = block_shares_percent(block)
            return np.column_stack([100.0 * seen, 100.0 * reached, grown, stuck])

        batch = Batch(Plans.joined(plans), launches, options, self._workspaces)
        rows = np.concatenate(list(batch.each(measured)))
        if any((deployment.stop == Stop.PRESSURE).any() for deployment in unpressed):
            free = Plans.joined([plan.without_pressure for plan in plans])
            unpressed = Batch(free, launches, options).deployments()
        loose_kpa, _ = worst_pressures_of(unpressed, self.design)
        table = np.column_stack([rows, loose_kpa])
        return table.reshape(len(launches), len(plans), -1).transpose(1, 0, 2)

    def effect(self, variant: PredictionVariant) -> Effect:
        """Return what a change does, over the poses that are free with it and without."""
        is_free = np.array([pose is not None for row in variant.poses for pose in row])
        poses = tuple(tuple(pose for pose in row if pose is not None) for row in variant.poses)
        growth_plan = Plan.of(variant.design, variant.options)
        values = np.full((len(is_free), len(QUICK_MEASURES)), np.nan)
        values[is_free] = self.grow([growth_plan], variant.options, poses)[0]
        differences = values - self.exact
        changes = {}
        for column, measure in enumerate(QUICK_MEASURES):
            means = means_by_map(differences[:, column], self.maps)
            if len(means):
                low, high = mean_interval(means, tails=PAIRED_TAILS)
                changes[measure.key] = MeanDifference(
                    mean=float(means.mean()),
                    low=low,
                    high=high,
                    over=samples_text(len(means), self.maps),
                )
        return Effect(
            knob=variant.knob,
            step=variant.step,
            unit=variant.unit,
            count=int(is_free.sum()),
            changes=changes,
        )


def sensitivity(
    evaluator: VariantEvaluator, progress: ProgressCallback = no_progress
) -> tuple[Effect, ...]:
    """Return what every change of the start, the lengths and the head-on angle does."""
    variants = list(_variants(evaluator))
    effects = []
    for index, variant in enumerate(variants):
        effects.append(evaluator.effect(variant))
        progress((index + 1) / len(variants), f"sensitivity to {variant.knob}")
    return tuple(effects)


def tolerance(
    evaluator: VariantEvaluator, seed: int, progress: ProgressCallback = no_progress
) -> Tolerance:
    """Return how robots of the same design differ when each branch is made a little off."""
    options, tree = evaluator.plan.options, branch_tree(evaluator.design)
    rows = []
    for first in range(0, ROBOTS, ROBOTS_TOGETHER):
        made = [
            made_tree(tree, child(seed, _STREAM, robot))
            for robot in range(first, min(first + ROBOTS_TOGETHER, ROBOTS))
        ]
        rows += [
            *evaluator.grow([Plan.of(evaluator.design, options, one) for one in made], options)
        ]
        progress(len(rows) / ROBOTS, f"{len(rows)} of {ROBOTS} robots as made")
    values = np.array(rows)
    return Tolerance(
        length_percent=LENGTH_TOLERANCE_PERCENT,
        angle_deg=ANGLE_TOLERANCE_DEG,
        robots=ROBOTS,
        launches=len(evaluator.launches),
        scatter=tuple(
            Scatter.of(measure, evaluator.exact[:, column], values[:, :, column])
            for column, measure in enumerate(QUICK_MEASURES)
            if np.isfinite(values[:, :, column]).any(axis=1).all()
        ),
    )


def made_tree(tree: BranchTree, rng: np.random.Generator) -> BranchTree:
    """Return a tree as it comes out of the workshop: lengths and angles off, each on its own.

    The trunk has no joint, so its angle stays.
    """
    lengths = rng.uniform(-1.0, 1.0, len(tree)) * LENGTH_TOLERANCE_PERCENT / 100.0
    turns = rng.uniform(-1.0, 1.0, len(tree)) * rad(ANGLE_TOLERANCE_DEG)
    turns[0] = 0.0
    return BranchTree(
        parent=tree.parent,
        level=tree.level,
        offset_rad=frozen_floats("offset_rad", tree.offset_rad + turns),
        length_mm=frozen_floats("length_mm", tree.length_mm * (1.0 + lengths)),
    )


def _variants(evaluator: VariantEvaluator) -> Iterator[PredictionVariant]:
    design, options, poses = evaluator.design, evaluator.plan.options, evaluator.prepared.poses
    exact = PredictionVariant(
        knob="", step=0.0, unit="", design=design, options=options, poses=poses
    )
    for knob, step, unit, move in placings():
        moved = moved_poses(evaluator.prepared, move)
        yield replace(exact, knob=knob, step=step, unit=unit, poses=moved)
    for step in LENGTH_STEPS_PERCENT:
        other = scaled_tree(design, 1.0 + step / 100.0)
        yield replace(exact, knob="lengths", step=step, unit="%", design=other)
    for step in HEAD_ON_STEPS_DEG:
        low_rad, high_rad = (
            min(angle + rad(step), math.pi / 2.0) for angle in options.half_angle_range_rad
        )
        wider = options.changed(head_on_half_angle_rad=(low_rad, high_rad))
        yield replace(exact, knob="head-on half-angle", step=step, unit="deg", options=wider)


def placings() -> Iterator[tuple[str, float, str, Callable[[Pose], Pose]]]:
    """Yield how a base may be placed off: knob, step, unit, and what moves a pose so."""
    for step in HEADING_STEPS_DEG:
        yield "heading", step, "deg", partial(turned_pose, turn_rad=rad(step))
    for step in SIDEWAYS_STEPS_MM:
        yield "position", step, "mm", partial(shifted_pose, step_mm=step)


def scaled_tree(design: Design, factor: float) -> Design:
    """Return a design with all lengths times a factor; widths stay."""
    levels = tuple(level.changed(length_mm=level.length_mm * factor) for level in design.levels)
    return design.changed(trunk_length_mm=design.trunk_length_mm * factor, levels=levels)


def moved_poses(
    prepared: PreparedFamily, move: Callable[[Pose], Pose]
) -> tuple[tuple[Pose | None, ...], ...]:
    """Return the poses of a family after a move; None where that place is not free."""
    rows = []
    for prepared_map, poses in zip(prepared.maps, prepared.poses, strict=True):
        moved = [move(pose) for pose in poses]
        free = [
            shapely.intersects_xy(prepared_map.context.free, pose.x_mm, pose.y_mm) for pose in moved
        ]
        rows.append(tuple(p if ok else None for p, ok in zip(moved, free, strict=True)))
    return tuple(rows)


def turned_pose(pose: Pose, turn_rad: float) -> Pose:
    """Return a pose turned to its left."""
    return replace(pose, heading_rad=pose.heading_rad + turn_rad)


def shifted_pose(pose: Pose, step_mm: float) -> Pose:
    """Return a pose moved to its left."""
    return replace(
        pose,
        x_mm=pose.x_mm - step_mm * math.sin(pose.heading_rad),
        y_mm=pose.y_mm + step_mm * math.cos(pose.heading_rad),
    )


def sensitivity_blocks(effects: Sequence[Effect], measures: Sequence[Measure]) -> Iterator[Section]:
    """Yield what changes of start, lengths and model do."""
    drawn = (measures[0], measures[-1])
    count = max(effect.count for effect in effects)
    words = (
        f"Every change is tried from the same {counted(count, 'pose')} as without it, and each "
        "deployment is "
        "compared with itself (simulated). Position: sideways to the heading, left is positive. "
        "Lengths: all branches alike. Head-on half-angle: on top of the angle assumed; the real "
        "one is not known, at most about 15 degrees."
    )

    def cell(change: MeanDifference | None, measure: Measure) -> str:
        if change is None:
            return "-"
        text = measure.interval(change.mean, change.low, change.high, change.over)
        return f"{text}{'*' if change.is_clear else ''}"

    table = Rows(
        caption="Mean change, in square brackets its 95 % interval over maps (poses "
        "where there is one map); an "
        "asterisk where the interval leaves out 0 (simulated)",
        headings=("changed", "by", *(m.label for m in measures), "poses"),
        rows=tuple(
            (effect.knob, effect.text, *(cell(effect.changes.get(m.key), m) for m in measures),
             effect.count)
            for effect in effects
        ),
        key="sensitivity",
        keys=("knob", "", *("" for _ in measures), "poses"),
        data=[
            {
                "step": effect.step,
                "unit": effect.unit,
                "changes": {
                    m.key: {end: m.content(getattr(change, end)) for end in ("mean", "low", "high")}
                    for m in QUICK_MEASURES
                    if (change := effect.changes.get(m.key)) is not None
                },
            }
            for effect in effects
        ],
    )  # fmt: skip
    picture = Picture(
        image=lambda: page_svg(effect_panels(effects, drawn)),
        caption="Mean change with its 95 % interval (simulated).",
    )
    yield Section(
        title="Sensitivity", paragraphs=(words,), pictures=(picture,), tables=(table,), folded=True
    )


def tolerance_blocks(tolerance: Tolerance) -> Iterator[Data | Section]:
    """Yield how robots of one design differ."""
    numbers = {"exact": "as designed", "p05": "5 % of robots", "p95": "95 % of robots",
               "typical": "one deployment, typically"}  # fmt: skip
    scatter = [
        (one.measure, {name: one.measure.of(getattr(one, name)) for name in numbers})
        for one in tolerance.scatter
    ]
    yield Data(
        {
            "tolerance": {
                "length_percent": tolerance.length_percent,
                "angle_deg": tolerance.angle_deg,
                "robots": tolerance.robots,
                "launches": tolerance.launches,
                "scatter": {
                    measure.key: {name: value.data for name, value in values.items()}
                    for measure, values in scatter
                },
            }
        }
    )
    words = (
        f"{counted(tolerance.robots, 'robot')} were drawn, every branch's length off by up to "
        f"{tolerance.length_percent:g} % and its angle by up to {tolerance.angle_deg:g} degrees, "
        "uniformly and each on its own (assumed), and deployed from "
        f"{counted(tolerance.launches, 'pose')} "
        "each (simulated)."
    )
    table = Rows(
        caption="Means over poses of the robot as designed and of robots as made (simulated)",
        headings=("measure", "unit", *numbers.values()),
        rows=tuple((measure.title, measure.unit, *row.values()) for measure, row in scatter),
    )
    yield Section(title="Tolerances of making", paragraphs=(words,), tables=(table,), folded=True)
