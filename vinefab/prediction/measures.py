"""The measures of a deployment, and their spread over deployments."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.statistics import group_means, mean_interval
from vinefab.core.validation import Floats, Ints
from vinefab.core.view import Number, bracketed
from vinefab.growth.batch import GrowthBlock
from vinefab.model.deployment import STUCK_STOPS, Deployment
from vinefab.model.design import Design
from vinefab.model.laser import GrowthConstants
from vinefab.model.map import Pose
from vinefab.physics.growth_pressure import (
    FITTED,
    FITTED_DIAMETER_MM,
    NO_TENSION,
    riding_mm,
)
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.reach import Reach


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """A number that every deployment has."""

    key: str  # its name in files, unit included
    title: str  # its name in words
    unit: str  # shown behind the number; empty for a ratio
    digits: int  # decimals that are shown and written
    better: Literal["more", "less"]  # whether more or less of it is wanted
    meaning: str  # one sentence
    does: tuple[str, str] = ("", "")  # how a sentence says that a robot does it, around a number
    # least, most: no value lies outside
    least: float = -math.inf
    most: float = math.inf

    def text(self, value: float) -> str:
        """Return a value as it is shown, with its unit; a dash where there is none."""
        shown = self.number(value)
        return shown if shown == "-" or not self.unit else f"{shown} {self.unit}"

    def number(self, value: float) -> str:
        """Return a value as it is shown, without its unit."""
        return f"{self.rounded(value):.{self.digits}f}" if np.isfinite(value) else "-"

    def rounded(self, value: float) -> float:
        """Return a value with the digits that are shown; the same number goes into files."""
        # Adding 0 turns a rounded -0.0 into 0.0.
        return round(float(value), self.digits) + 0.0

    def content(self, value: float) -> float | None:
        """Return a value as it stands in JSON; None where there is none."""
        return self.rounded(value) if np.isfinite(value) else None

    def of(self, mean: float, *interval: float, over: str = "") -> Number:
        """Return a value, and its interval where both ends are given, to be shown and written.

        Parameters
        ----------
        over
            How many samples the interval is over: ``24 maps``.
        """
        ends = (interval[0], interval[1]) if interval else None
        form = f"z.{self.digits}f"
        return Number(mean, form=form, interval=ends, decimals=self.digits, over=over)

    def interval(self, mean: float, low: float, high: float, over: str) -> str:
        """Return a mean with its interval and the samples behind it, without unit."""
        known = np.isfinite(low) and np.isfinite(high)
        ends = (self.number(low), self.number(high)) if known else None
        return f"{self.number(mean)} {bracketed(ends, over)}"

    def within(self, low: float, high: float) -> tuple[float, float]:
        """Return the ends of an interval without what no value of this measure can be."""
        return float(np.maximum(low, self.least)), float(np.minimum(high, self.most))

    @property
    def label(self) -> str:
        """Title and unit, for an axis."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


COVERAGE = Measure(
    key="coverage_score",
    title="sensor coverage score",
    unit="",
    digits=4,
    better="more",
    meaning="what the optimizer maximizes: area seen minus what branches and film cost",
)

SEEN = Measure(
    key="seen_percent",
    title="free space seen by sensors",
    unit="%",
    digits=1,
    better="more",
    meaning="share of the free space within the discs of sight around the tips",
    does=("sees", "of the free space"),
    least=0.0,
    most=100.0,
)

REACH = Measure(
    key="reach_percent",
    title="free space reached",
    unit="%",
    digits=1,
    better="more",
    meaning="share of the free space near the deployed body",
    does=("reaches", "of the free space"),
    least=0.0,
    most=100.0,
)

TOUCHED = Measure(
    key="targets_touched_percent",
    title="targets touched",
    unit="%",
    digits=1,
    better="more",
    meaning="share of the map's targets that the body comes within tolerance of",
    does=("touches", "of its targets"),
    least=0.0,
    most=100.0,
)

ANCHORING = Measure(
    key="anchoring_amplification",
    title="anchoring amplification",
    unit="x",
    digits=2,
    better="more",
    meaning="holding force over that of one pouch, at the assumed friction; pouches in gaps "
    "narrower than theirs count",
    least=0.0,
)

IDEAL_ANCHORING = Measure(
    key="ideal_anchoring_amplification",
    title="anchoring amplification, ideal case",
    unit="x",
    digits=2,
    better="more",
    meaning="the same by the formula, for a robot without pouches: every leaf that came out holds",
    least=0.0,
)

GROWN = Measure(
    key="grown_percent",
    title="length grown",
    unit="%",
    digits=1,
    better="more",
    meaning="length of all deployed branches over the planned length",
    least=0.0,
    most=100.0,
)

STUCK = Measure(
    key="stuck_percent",
    title="branches that got stuck",
    unit="%",
    digits=1,
    better="less",
    meaning="share of the branches that stopped before their full length: head-on, in a corner, or "
    "for want of pressure",
    least=0.0,
    most=100.0,
)

UNDEPLOYED = Measure(
    key="undeployed_percent",
    title="branches that never emerged",
    unit="%",
    digits=1,
    better="less",
    meaning="share of the branches that stay inside: their parent is stuck, or they have no room",
    least=0.0,
    most=100.0,
)

LOOSE_PRESSURE = Measure(
    key="growth_pressure_loose_kpa",
    title="growth pressure, loose film",
    unit="kPa",
    digits=1,
    better="less",
    meaning="to grow to the worst tip, by the nested capstan along its simulated path; nothing "
    "holds the film back as it leaves its store",
    least=0.0,
)

TIGHT_PRESSURE = Measure(
    key="growth_pressure_tight_kpa",
    title="growth pressure, tight film",
    unit="kPa",
    digits=1,
    better="less",
    meaning="the same, with the tension of a tight spool",
    least=0.0,
)

MEASURES = (
    COVERAGE, SEEN, REACH, TOUCHED, ANCHORING, IDEAL_ANCHORING, GROWN, STUCK, UNDEPLOYED,
    LOOSE_PRESSURE, TIGHT_PRESSURE,
)  # fmt: skip


def samples_text(count: int, maps: Sequence[str]) -> str:
    """Return over how many independent samples an interval is, see `means_by_map`."""
    return counted(count, "map" if len(set(maps)) > 1 or count == 1 else "pose")


def means_by_map(values: Floats, maps: Sequence[str]) -> Floats:
    """Return the mean of each map, or the known values where there is one map.

    Deployments on one map are alike; where there is one map, poses have to do.
    """
    return group_means(values, maps) if len(set(maps)) > 1 else values[np.isfinite(values)]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureSpread:
    """How a measure is spread over deployments."""

    count: int  # deployments that have a value
    mean: float  # mean of the maps' means
    # low, high: 95 % interval of that mean over maps (over poses where there is one map); NaN
    # where there is none
    low: float
    high: float
    over: str  # how many independent samples that is
    deviation: float  # standard deviation over deployments
    # p05, median, p95: percentiles over deployments
    p05: float
    median: float
    p95: float
    # least, greatest: extremes
    least: float
    greatest: float

    def shown(self, measure: Measure) -> Number:
        """Return the mean with its interval, as a measure is shown."""
        return measure.of(self.mean, self.low, self.high, over=self.over)

    @property
    def has_interval(self) -> bool:
        """Whether the samples differ, or are many enough to be alike."""
        return math.isfinite(self.low)

    NUMBERS = ("mean", "low", "high", "deviation", "p05", "median", "p95", "least", "greatest")

    @classmethod
    def of(
        cls, values: Floats, groups: Sequence[str], measure: Measure | None = None
    ) -> "MeasureSpread | None":
        """Return the spread of some values, or None if there is not one number among them."""
        known = values[np.isfinite(values)]
        if len(known) == 0:
            return None
        means = means_by_map(values, groups)
        low, high = mean_interval(means)
        if measure is not None:
            low, high = measure.within(low, high)
        p05, median, p95 = (float(value) for value in np.percentile(known, [5.0, 50.0, 95.0]))
        return cls(
            count=len(known),
            mean=float(means.mean()),
            low=low,
            high=high,
            over=samples_text(len(means), groups),
            deviation=float(known.std()),
            p05=p05,
            median=median,
            p95=p95,
            least=float(known.min()),
            greatest=float(known.max()),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasureTable:
    """The measures of one design's deployments on one family of maps."""

    label: str  # of the map family
    maps: tuple[str, ...]  # name of the map of each deployment, n of them
    poses: tuple[Pose, ...]  # pose of each deployment
    # for each measure, by its key, one value per deployment, shape (n,); NaN where there is none
    values: Mapping[str, Floats]

    def __post_init__(self) -> None:
        for key, column in self.values.items():
            if column.shape != (len(self.maps),):
                raise BadInputError(key, column.shape, f"shape ({len(self.maps)},)")
            column.setflags(write=False)

    def __len__(self) -> int:
        return len(self.maps)

    @property
    def map_count(self) -> int:
        """Number of different maps."""
        return len(set(self.maps))

    def spread(self, measure: Measure) -> MeasureSpread | None:
        """Return how a measure is spread, or None where no deployment has it."""
        return MeasureSpread.of(self.values[measure.key], self.maps, measure)


def spreads_content(outcomes: MeasureTable) -> dict[str, object]:
    """Return how every measure is spread, rounded as it is shown, by the measures' keys."""
    spreads: dict[str, object] = {}
    for measure in MEASURES:
        spread = outcomes.spread(measure)
        if spread is not None:
            numbers = {
                name: measure.content(getattr(spread, name)) for name in MeasureSpread.NUMBERS
            }
            spreads[measure.key] = {"count": spread.count, "over": spread.over, **numbers}
    return spreads


def measured_shapes(
    block: GrowthBlock, design: Design, contexts: Sequence[MapContext], anchoring: Anchoring
) -> Floats:
    """Return all but the last two of `MEASURES`, which are the pressures, a row per growth."""
    coverage = Coverage().evaluate_block(block, contexts)
    reach = Reach().evaluate_block(block, [one.without_targets for one in contexts])
    rows = []
    for index, terrain in enumerate(block.terrain.tolist()):
        grown = block.deployment(index)
        held = anchoring.anchored(grown, design.build, contexts[terrain])
        amplified = held.amplification(anchoring.friction)[0]
        # A robot has one of both, so that neither is taken for the other.
        both = (amplified, math.nan) if held.has_pouches[0] else (math.nan, amplified)
        rows.append((*both, *shares_percent(grown)))
    areas = coverage.score, 100.0 * coverage.terms["area"], 100.0 * reach.score
    return np.column_stack([*areas, touched_percent(block, contexts), np.array(rows)])


def touched_percent(block: GrowthBlock, contexts: Sequence[MapContext]) -> Floats:
    """Return the share of their maps' targets that growths touch; NaN where a map has none."""
    if not all(context.targets for context in contexts):
        return np.full(len(block.terrain), np.nan)
    return 100.0 * Reach(falloff_mm=0.0).evaluate_block(block, contexts).score


def shares_percent(deployment: Deployment) -> tuple[float, float, float]:
    """Return length grown, branches that got stuck and branches never emerged, in percent."""
    grown = deployment.grown_mm.sum() / deployment.tree.total_length_mm
    stuck = np.isin(deployment.stop, STUCK_STOPS).mean()
    return 100.0 * float(grown), 100.0 * float(stuck), 100.0 * float((~deployment.deployed).mean())


def worst_pressures_of(deployments: Sequence[Deployment], design: Design) -> Floats:
    """Return the pressures that growth to the worst tip takes, film stored loosely and tightly.

    Shape (2, n); NaN where nothing emerged.
    """
    pressures = growth_pressures_kpa(deployments, design)
    first = np.cumsum([0, *(len(deployment.tree) for deployment in deployments[:-1])])
    worst = np.fmax.reduceat(pressures, first, axis=1)
    return np.asarray(worst)


LOOSE = FITTED.changed(storage_kpa=NO_TENSION)

TIGHT = FITTED
"""Film that nothing holds back as it leaves its store, and film on a tight spool."""


def growth_pressures_kpa(
    deployments: Sequence[Deployment],
    design: Design,
    fits: Sequence[GrowthConstants] = (LOOSE, TIGHT),
) -> Floats:
    """Return the pressure that growth to each tip takes, a row per fit, shape (fits, n).

    Of several deployments the tips come one after the other.

    The same model as `physics.growth_pressure`, which says what counts as a turn. There every
    path is worked out from its base; here each branch goes on from its parent's result, on arrays.
    Branches that never emerged get NaN.

    Parameters
    ----------
    fits
        Constants of the tube that was measured, with the same friction; they are scaled to the
        diameter of each level.

    Notes
    -----
    ``P = Y + (T + f l_r) G + f M``: G is the product of ``e^(mu theta)`` over all turns of the
    path, M the sum of its lengths, each times that product over the turns behind it.
    """
    gain, drawn_mm = _path_gains(deployments, fits[0].friction.value)
    own = np.concatenate([deployment.tree.level for deployment in deployments]) - 1
    of_tree: dict[int, Floats] = {}  # deployments of one plan share their tree
    for deployment in deployments:
        if id(deployment.tree) not in of_tree:
            of_tree[id(deployment.tree)] = riding_mm(deployment.tree, design.build.widths_mm)
    riding = np.concatenate([of_tree[id(deployment.tree)] for deployment in deployments])
    rows = []
    for fit in fits:
        levels = constants_by_level(design, fit)
        yielding = np.array([level.yield_kpa.value for level in levels])[own]
        storage = np.array([level.storage_kpa.value for level in levels])[own]
        drag_kpa_mm = np.array([level.drag_kpa_m.value / 1000.0 for level in levels])[own]
        rows.append(yielding + (storage + drag_kpa_mm * riding) * gain + drag_kpa_mm * drawn_mm)
    return np.array(rows)


def constants_by_level(design: Design, fit: GrowthConstants) -> tuple[GrowthConstants, ...]:
    """Return the growth constants of each level's tube, trunk first."""
    return tuple(
        fit.at_diameter(inflated_diameter_mm(width_mm), FITTED_DIAMETER_MM.value)
        for width_mm in design.build.widths_mm
    )


def _path_gains(deployments: Sequence[Deployment], friction: float) -> tuple[Floats, Floats]:
    """Return G and M (mm) of the path to each tip; NaN where none emerged.

    All deployments are worked out together, as one forest: its arrays are theirs one after the
    other, shape (n,) each in all.
    """
    counts = [len(deployment.tree) for deployment in deployments]
    begin = np.repeat(np.cumsum([0, *counts[:-1]]), counts)
    levels = np.concatenate([deployment.tree.level for deployment in deployments])
    parent = np.concatenate([deployment.tree.parent for deployment in deployments]) + begin
    offset_rad = np.concatenate([deployment.tree.offset_rad for deployment in deployments])
    deployed = np.concatenate([deployment.deployed for deployment in deployments])
    start_rad = np.repeat([deployment.pose.heading_rad for deployment in deployments], counts)
    runs = _Runs.of(deployments)
    gain, drawn_mm, heading = np.full((3, len(levels)), np.nan)
    for level in range(1, int(levels.max()) + 1):
        members = np.flatnonzero((levels == level) & deployed)
        parents, joint = parent[members], offset_rad[members]
        if level == 1:
            before, g, m = start_rad[members], np.ones(len(members)), np.zeros(len(members))
        else:
            before, g, m = heading[parents], gain[parents], drawn_mm[parents]
        turn = np.abs(joint)
        for step in range(max(1, int(runs.count[members].max(initial=0)))):
            has = runs.count[members] > step
            at = runs.first[members[has]] + step
            # At the base net: a joint and the hinge that bends it back are one turn.
            between = np.remainder(runs.heading[at] - before[has] + math.pi, math.tau) - math.pi
            turn[has] = np.abs(between)
            bend = np.exp(friction * turn)
            g, m = g * bend, m * bend
            m[has] += runs.length_mm[at]
            before[has] = runs.heading[at]
            turn = np.zeros(len(members))
        straight = runs.count[members] == 0  # it emerged and stopped at once
        gain[members], drawn_mm[members] = g, m
        heading[members] = np.where(straight, before + joint, before)
    return gain, drawn_mm


@dataclass(frozen=True, slots=True)
class _Runs:
    """The straight stretches of all branches, one branch after the other."""

    heading: Floats
    length_mm: Floats
    first: Ints
    count: Ints

    @classmethod
    def of(cls, deployments: Sequence[Deployment]) -> "_Runs":
        """Return the stretches of deployments that have a length."""
        points = np.concatenate([deployment.points_mm for deployment in deployments])
        of_branch = np.concatenate([np.diff(one.first_point) for one in deployments])
        run = np.diff(points, axis=0)
        length = np.hypot(run[:, 0], run[:, 1])
        branch = np.repeat(np.arange(len(of_branch)), of_branch)
        real = (branch[:-1] == branch[1:]) & (length > 0.0)
        count = np.bincount(branch[:-1][real], minlength=len(of_branch))
        return cls(
            np.arctan2(run[real, 1], run[real, 0]), length[real], np.cumsum(count) - count, count
        )
