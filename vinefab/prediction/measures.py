"""The measures of a deployment, and their spread over deployments."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Literal

import numpy as np

from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError
from vinefab.core.statistics import MeanValue
from vinefab.core.validation import Floats, Ints
from vinefab.core.view import Number, bracketed
from vinefab.growth.batch import GrowthBlock
from vinefab.model.deployment import STUCK_STOPS, Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.physics.growth_pressure import (
    FITTED,
    NO_TENSION,
    growth_pressures_kpa,
)
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import Task, outcomes


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """A number that every deployment has."""

    key: str  # its name in files, unit included
    title: str  # its name as text
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

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest value that can be."""
        return self.least, self.most

    @property
    def label(self) -> str:
        """Title and unit, for an axis."""
        return f"{self.title} ({self.unit})" if self.unit else self.title


_percent = partial(Measure, unit="%", digits=1, least=0.0, most=100.0)

COVERAGE = Measure(
    key="coverage_score",
    title="sensor coverage score",
    unit="",
    digits=4,
    better="more",
    meaning="what the optimizer maximizes: area seen minus what branches and film cost",
)

SEEN = _percent(
    key="seen_percent",
    title="free space seen by sensors",
    better="more",
    meaning="share of the free space within the discs of sight around the tips",
    does=("sees", "of the free space"),
)

REACH = _percent(
    key="reach_percent",
    title="free space reached",
    better="more",
    meaning="share of the free space near the deployed body",
    does=("reaches", "of the free space"),
)

TOUCHED = _percent(
    key="targets_touched_percent",
    title="targets touched",
    better="more",
    meaning="share of the map's targets that the body comes within tolerance of",
    does=("touches", "of its targets"),
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

GROWN = _percent(
    key="grown_percent",
    title="length grown",
    better="more",
    meaning="length of all deployed branches over the planned length",
)

STUCK = _percent(
    key="stuck_percent",
    title="branches that got stuck",
    better="less",
    meaning="share of the branches that stopped before their full length: head-on, in a corner, or "
    "for want of pressure",
)

UNDEPLOYED = _percent(
    key="undeployed_percent",
    title="branches that never emerged",
    better="less",
    meaning="share of the branches that stay inside: their parent is stuck, or they have no room",
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

TASK_SCORE = "task_score"
"""Key of the measure that `task_measure` returns."""


def task_measure(task: Task) -> Measure:
    """Return the score of a task as a measure; coverage at its defaults is one already."""
    if isinstance(task, Coverage) and task == Coverage():
        return COVERAGE
    return Measure(
        key=TASK_SCORE,
        title=f"{task.name} score",
        unit="",
        digits=4,
        better="more",
        meaning=f"what task {task.name} gives for the final state",
        does=("scores", f"on task {task.name}"),
        least=task.lowest,
    )


def task_content(task: Task | None) -> dict[str, object]:
    """Return the task that was asked for, as it stands in JSON."""
    return {} if task is None else {"task": task.name}


def measures_with(task: Task | None) -> tuple[Measure, ...]:
    """Return all measures of a deployment, the score of a task that was asked for first."""
    return MEASURES if task is None else tuple(dict.fromkeys((task_measure(task), *MEASURES)))


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureSpread(MeanValue, Record):
    """How a measure is spread over deployments: its mean, and their distribution."""

    count: int  # deployments that have a value
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

    def rounded(self, measure: Measure) -> "MeasureSpread":
        """Return the spread with the digits of a measure."""
        numbers = {name: measure.rounded(getattr(self, name)) for name in self.NUMBERS}
        return MeasureSpread(over=self.over, count=self.count, **numbers)

    NUMBERS = ("mean", "low", "high", "deviation", "p05", "median", "p95", "least", "greatest")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasureTable:
    """The measures of one design's deployments on one family of maps."""

    label: str  # of the map family
    map_names: tuple[str, ...]  # of the map of each deployment, n of them
    poses: tuple[Pose, ...]  # pose of each deployment
    # for each measure, by its key, one value per deployment, shape (n,); NaN where there is none
    values: Mapping[str, Floats]
    measures: tuple[Measure, ...] = MEASURES  # which these are, in the order in which they stand

    def __post_init__(self) -> None:
        for key, column in self.values.items():
            if column.shape != (len(self.map_names),):
                raise BadInputError(key, column.shape, f"shape ({len(self.map_names)},)")
            column.setflags(write=False)

    def __len__(self) -> int:
        return len(self.map_names)

    @property
    def map_count(self) -> int:
        """Number of different maps."""
        return len(set(self.map_names))

    @property
    def records(self) -> list[dict[str, object]]:
        """Every deployment as plain values: its map, its pose and each measure, None without."""
        columns = [(m.key, self.values[m.key].tolist()) for m in self.measures]
        return [
            {
                "map": name,
                "pose": pose.content,
                **{key: None if math.isnan(found[row]) else found[row] for key, found in columns},
            }
            for row, (name, pose) in enumerate(zip(self.map_names, self.poses, strict=True))
        ]

    def spread(self, measure: Measure) -> MeasureSpread | None:
        """Return how a measure is spread, or None where no deployment has it."""
        values = self.values[measure.key]
        known = values[np.isfinite(values)]
        if len(known) == 0:
            return None
        p05, median, p95 = np.percentile(known, [5.0, 50.0, 95.0]).tolist()
        return MeasureSpread(
            **asdict(MeanValue.of(values, self.map_names, measure.ends)),
            count=len(known),
            deviation=float(known.std()),
            p05=p05,
            median=median,
            p95=p95,
            least=float(known.min()),
            greatest=float(known.max()),
        )

    @property
    def spreads(self) -> dict[str, dict[str, object]]:
        """How every measure is spread, as in JSON, by the measures' keys."""
        known = ((measure, self.spread(measure)) for measure in self.measures)
        return {
            measure.key: spread.rounded(measure).content
            for measure, spread in known
            if spread is not None
        }


def measured_shapes(
    block: GrowthBlock,
    design: Design,
    contexts: Sequence[MapContext],
    anchoring: Anchoring,
    task: Task | None = None,
) -> Floats:
    """Return all but the last two of `measures_with`, which are the pressures, a row per growth."""
    coverage = Coverage().evaluate_block(block, contexts)
    reach = Reach().evaluate_block(block, [one.without_targets for one in contexts])
    held_by = []
    for index, terrain in enumerate(block.terrain.tolist()):
        grown = block.deployment(index)
        held = anchoring.anchored(grown, design.build, contexts[terrain])
        amplified = held.amplification(anchoring.friction)[0]
        # A robot has one of both, so that neither is taken for the other.
        both = (amplified, math.nan) if held.has_pouches[0] else (math.nan, amplified)
        held_by.append(both)
    areas = coverage.score, 100.0 * coverage.terms["area"], 100.0 * reach.score
    anchored, touched = np.array(held_by).T, touched_percent(block, contexts)
    shapes = [*areas, touched, *anchored, *block_shares_percent(block)]
    if task is not None and task_measure(task) is not COVERAGE:
        shapes.insert(0, outcomes(task, block, contexts).score)
    return np.column_stack(shapes)


def touched_percent(block: GrowthBlock, contexts: Sequence[MapContext]) -> Floats:
    """Return the share of their maps' targets that growths touch; NaN where a map has none."""
    if not all(context.targets for context in contexts):
        return np.full(len(block.terrain), np.nan)
    return 100.0 * Reach(falloff_mm=0.0).evaluate_block(block, contexts).score


def block_shares_percent(block: GrowthBlock) -> Floats:
    """Return `shares_percent` of every growth of a block."""
    growth = block.growth
    return shares_percent(growth.stop, growth.grown, block.branch, block.planned_mm())


def shares_percent(stop: Ints, grown_mm: Floats, first: Ints, planned_mm: Floats) -> Floats:
    """Return length grown, branches that got stuck and branches never emerged, in percent.

    Parameters
    ----------
    stop, grown_mm
        Of every branch, growth after growth.
    first
        Where the branches of each growth begin, with the total at the end, shape (j + 1,).
    planned_mm
        Planned length of each growth's tree, shape (j,).

    Returns
    -------
    array
        Shape (3, j).
    """
    stuck, inside = np.isin(stop, STUCK_STOPS), stop == Stop.NOT_DEPLOYED
    sums = np.add.reduceat(
        np.array([grown_mm, stuck, inside], dtype=np.float64), first[:-1], axis=1
    )
    return np.asarray(100.0 * sums / np.array([planned_mm, *[np.diff(first)] * 2]))


def worst_pressures_of(deployments: Sequence[Deployment]) -> Floats:
    """Return the pressures that growth to the worst tip takes, film stored loosely and tightly.

    Shape (2, n); NaN where nothing emerged.
    """
    pressures = growth_pressures_kpa(deployments, (LOOSE, TIGHT))
    first = np.cumsum([0, *(len(deployment.tree) for deployment in deployments[:-1])])
    worst = np.fmax.reduceat(pressures, first, axis=1)
    return np.asarray(worst)


LOOSE = FITTED.changed(storage_kpa=NO_TENSION)

TIGHT = FITTED
"""Film that nothing holds back as it leaves its store, and film on a tight spool."""
