"""How wide a prediction is: over what contacts and pressures are assumed to be.

Whether a tip that meets a wall slides or stops changes scores more than most designs do. So do the
tube that the growth pressure was fitted to, and how the film is stored. None of them is known.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Annotated, Any

import numpy as np
import shapely

from vinefab.core.codec import IF_KNOWN, Record
from vinefab.core.limits import rad
from vinefab.core.plain_text import counted
from vinefab.core.progress import Phase, Progress, each
from vinefab.core.rng import child
from vinefab.core.statistics import ANY_NUMBER, PAIRED_TAILS, MeanValue
from vinefab.core.validation import Floats, frozen_floats
from vinefab.core.view import Data, Number, Picture, Rows, Section
from vinefab.growth.batch import Batch, GrowthBlock, Launches, Workspace
from vinefab.growth.options import (
    BRANCH_CONTACTS,
    BranchContact,
    GrowthOptions,
    UnknownRule,
    surface_words,
)
from vinefab.growth.plan import Plan, Plans
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.model.tree import BranchTree
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    INK,
    LEVEL_COLOURS,
    SOFT,
    TICK_PT,
    Ink,
    Page,
    Panel,
    curve,
    ends_of,
    page_of,
    page_of_rows,
    series_colour,
    upright,
)
from vinefab.physics.anchoring import ASSUMED_FRICTION
from vinefab.prediction.family_deployments import (
    PredictionPlan,
    PreparedFamily,
)
from vinefab.prediction.measures import (
    COVERAGE,
    GROWN,
    LOOSE_PRESSURE,
    REACH,
    SEEN,
    STUCK,
    TOUCHED,
    Measure,
    MeasureTable,
    block_shares_percent,
    task_measure,
    touched_percent,
    worst_pressures_of,
)
from vinefab.prediction.pressure_window import PressureRange
from vinefab.search.record.winner import KnownBy
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import Poses
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import Task, outcomes

CONTACT_MEASURES = (COVERAGE, SEEN, REACH, GROWN, STUCK, TOUCHED)
"""Targets where a family's maps have any."""


def contact_measures_with(task: Task | None) -> tuple[Measure, ...]:
    """Return the measures over contacts, the score of a task that was asked for first."""
    first = () if task is None else (task_measure(task),)
    return tuple(dict.fromkeys((*first, *CONTACT_MEASURES)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactRange:
    """Measures of a design over what is assumed about contacts, from the same poses."""

    label: str  # of the map family
    deployments: int  # at each half-angle
    values: Mapping[str, tuple[MeanValue, ...]]  # by measure key, one for each half-angle
    angles_deg: tuple[float, ...]  # the head-on half-angles
    standing: str  # where their ends come from: ``assumed``, or ``measured`` and how
    rules: tuple["RuleRange", ...] = ()  # what else is assumed; none for a robot without branches
    measures: tuple[Measure, ...] = CONTACT_MEASURES  # those that ``values`` may have

    def ends(self, measure: Measure) -> tuple[float, float]:
        """Return the least and the greatest mean of a measure over the range."""
        means = [value.mean for value in self.values[measure.key]]
        return min(means), max(means)

    @property
    def over(self) -> str:
        """The range in a few words: ``head-on half-angles of 1 to 15 deg (assumed)``."""
        return contact_angles_words(self.angles_deg, self.standing)

    def over_rules(self, measure: Measure) -> str:
        """Return a measure over what else is assumed: ``; 0.509 to 0.503 from bodies that ...``."""
        parts = []
        for rule in self.rules:
            first, last = (measure.number(rule.values[measure.key][end].mean) for end in (0, -1))
            parts.append(f"; {first} to {last} {rule.over}")
        return "".join(parts)


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleRange:
    """Measures of a design under each choice of one growth option, from the same poses."""

    option: UnknownRule  # name of the growth option
    title: str  # what it is about
    choices: tuple[BranchContact | float, ...]  # its values
    headings: tuple[str, ...]  # what tables call them
    over: str  # the range in a few words
    standing: str  # ``assumed``, or ``measured`` and how
    values: Mapping[str, tuple[MeanValue, ...]]  # by measure key, one for each choice
    measures: tuple[Measure, ...] = CONTACT_MEASURES  # those that ``values`` may have

    @property
    def numbers(self) -> "RuleMeans":
        """The means as JSON has them."""
        return RuleMeans(choices=self.choices, standing=self.standing, means=means_of(self))

    def rows(self, measures: Sequence[Measure]) -> Rows:
        """Return measures under each choice, with their intervals."""
        return Rows(
            caption=f"{self.title}: means with 95 % intervals over the same maps (simulated; "
            f"{self.standing.partition(':')[0]})",
            headings=("measure", *self.headings),
            rows=tuple(
                (m.label, *(m.of(v.mean, v.low, v.high) for v in self.values[m.key]))
                for m in measures
            ),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleMeans:
    """Means of measures under each choice of a growth option."""

    choices: tuple[BranchContact | float, ...]
    standing: KnownBy
    means: Mapping[str, tuple[float, ...]]  # by measure key


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactMeans:
    """Means of measures at each head-on half-angle."""

    head_on_half_angle_deg: tuple[float, ...]
    standing: KnownBy
    deployments: int  # at each
    means: Mapping[str, tuple[float, ...]]  # by measure key


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionWidth(Record):
    """How wide a prediction is over what is assumed of contacts."""

    contacts: ContactMeans
    branch_contact: Annotated[RuleMeans | None, IF_KNOWN] = None
    emergence: Annotated[RuleMeans | None, IF_KNOWN] = None

    @classmethod
    def of(cls, found: ContactRange) -> "PredictionWidth":
        """Return the width of a range."""
        contacts = ContactMeans(
            head_on_half_angle_deg=found.angles_deg,
            standing=found.standing,
            deployments=found.deployments,
            means=means_of(found),
        )
        return cls(contacts=contacts, **{rule.option: rule.numbers for rule in found.rules})


def means_of(found: ContactRange | RuleRange) -> dict[str, tuple[float, ...]]:
    """Return the means of a range by measure key, with the digits that are shown."""
    return {m.key: tuple(m.rounded(v.mean) for v in found.values[m.key]) for m in known(found)}


def contact_angles_words(angles_deg: Sequence[float], standing: str) -> str:
    """Return a range of head-on half-angles in a few words, with its standing."""
    short = standing.partition(":")[0]
    return f"head-on half-angles of {angles_deg[0]:g} to {angles_deg[-1]:g} deg ({short})"


def contact_range(
    design: Design, prepared: PreparedFamily, options: GrowthOptions, task: Task | None = None
) -> ContactRange:
    """Deploy a design from a family's poses under all that contacts may be like.

    Parameters
    ----------
    task
        Whose score is a measure too.
    """
    prepared, measures = prepared.distinct, contact_measures_with(task)
    measured = partial(_contact_measures, design, prepared, task)
    return range_over_contacts(design, prepared, options, measured, measures)


def range_over_contacts(
    design: Design,
    prepared: PreparedFamily,
    options: GrowthOptions,
    measured: Callable[[GrowthOptions], Mapping[str, Floats]],
    measures: tuple[Measure, ...] = CONTACT_MEASURES,
) -> ContactRange:
    """Return values at every half-angle, and under every other choice that contacts leave open.

    Parameters
    ----------
    measured
        Returns the values from every pose by growth options, by name, shape (n,) each.
    measures
        The measures that names may mean.
    """
    names, chances = prepared.launch_names, options.emergences
    told = Phase(Progress(phase="assumptions on contacts"))

    @cache  # some ranges have a choice in common: the one of the prediction
    def tables(choice: GrowthOptions) -> Mapping[str, Floats]:
        told.more()
        return measured(choice)

    def means(
        variants: Sequence[GrowthOptions], limits: Mapping[str, tuple[float, float]]
    ) -> dict[str, tuple[MeanValue, ...]]:
        found = [tables(one) for one in variants]
        return {
            key: tuple(
                MeanValue.of(table[key], names, limits.get(key, ANY_NUMBER)) for table in found
            )
            for key in found[0]
        }

    def rule(
        option: UnknownRule,
        choices: Sequence[BranchContact | float],
        **words: Any,  # noqa: ANN401
    ) -> RuleRange:
        values = means([options.changed(**{option: choice}) for choice in choices], {})
        return RuleRange(
            option=option, choices=tuple(choices), values=values, measures=measures, **words
        )

    angles_deg = options.contact_angles_deg
    at_angles = [options.changed(head_on_half_angle_rad=rad(angle)) for angle in angles_deg]
    rules = () if design.branch_count == 1 else (
        rule(
            "branch_contact",
            BRANCH_CONTACTS,
            title="What a tip does at the body of another branch",
            headings=("passes through", "stops there"),
            over="from bodies that pass through each other to tips that stop there (assumed)",
            standing="assumed",
        ),
        rule(
            "emergence",
            chances,
            title="Probability that a child comes out of its parent's tip",
            headings=tuple(f"{chance:.3g}" for chance in chances),
            over=f"where a child comes out with probability {chances[0]:.3g} to {chances[-1]:.3g} "
            f"({options.emergences_standing.partition(':')[0]})",
            standing=options.emergences_standing,
        ),
    )  # fmt: skip
    return ContactRange(
        label=prepared.label,
        deployments=len(names),
        values=means(at_angles, {one.key: one.ends for one in measures}),
        angles_deg=angles_deg,
        standing=options.contact_angles_standing,
        rules=rules,
        measures=measures,
    )


def known(found: ContactRange | RuleRange) -> tuple[Measure, ...]:
    """Return the measures that a range has."""
    return tuple(measure for measure in found.measures if measure.key in found.values)


def _contact_measures(
    design: Design, prepared: PreparedFamily, task: Task | None, options: GrowthOptions
) -> dict[str, Floats]:
    """Return the measures of every deployment by their keys, shape (deployments,) each."""
    measures = contact_measures_with(task)
    contexts = [prepared_map.context for prepared_map in prepared.maps]
    areas = [context.without_targets for context in contexts]

    def measured(block: GrowthBlock) -> Floats:
        coverage = outcomes(Coverage(area="fast"), block, contexts)
        reach = outcomes(Reach(area="fast"), block, areas)
        grown, stuck, _ = block_shares_percent(block)
        rows = (coverage.score, 100 * coverage.terms["area"], 100 * reach.score, grown, stuck)
        first = []
        if task is not None and len(measures) > len(CONTACT_MEASURES):
            first.append(outcomes(task, block, contexts).score)
        return np.array([*first, *rows, touched_percent(block, contexts)])

    batch = Batch(Plans.of([design], options), prepared.launches(), options)
    table = np.concatenate(list(batch.each(measured)), axis=1)
    every = zip(measures, table, strict=True)
    return {measure.key: values for measure, values in every if not np.isnan(values).all()}


# --- As they are shown --------------------------------------------------------------------------


COST_CAPTION = "What contacts cost, assumed unless said; line: predicted (grey: 95 % interval)."


CostRow = tuple[str, tuple[float, ...]]
"""Words on an assumption, and the mean under each choice of it."""


def contact_costs(
    found: ContactRange, measured: MeasureTable, measure: Measure
) -> tuple[str, tuple[float, ...], tuple[CostRow, ...]]:
    """Return the data of `cost_chart`: a measure as predicted and over what is assumed."""
    spread, key, digits = measured.spread(measure), measure.key, measure.digits
    predicted = (math.nan,) if spread is None else (spread.mean, spread.low, spread.high)
    return f"{measure.label}, simulated", predicted, (
        cost_row("", found.angles_deg, _means(found.values[key]), found.standing, digits),
        *(cost_row(one.option, one.choices, _means(one.values[key]), one.standing, digits)
          for one in found.rules),
    )  # fmt: skip


def _means(values: Sequence[MeanValue]) -> list[float]:
    return [value.mean for value in values]


def cost_row(
    option: str,
    choices: Sequence[Any],
    means: Sequence[float],
    standing: str,
    digits: int = 3,
) -> CostRow:
    """Return a row of `cost_chart` for a growth option; without a name, for half-angles."""
    low, high = choices[0], choices[-1]
    if not option:
        words = f"tips stop within {low:g} to {high:g} deg"
    elif option == "branch_contact":
        words = "branches pass, or stop at each other"
    else:
        words = f"children come out, {low:.3g} to {high:.3g}"
    words += ", measured" * standing.startswith("measured")
    return f"{words}: {means[0]:z.{digits}f} to {means[-1]:z.{digits}f}", tuple(means)


RULE_WORDS = (
    "Whether a tube that meets another one climbs over it or jams was not measured, nor how often "
    "a child fails to come out of its parent's tip: growth was seen to be prevented at branching "
    "points. Both ends are shown, at the half-angle of the prediction and from the same poses."
)


def contact_words(found: ContactRange) -> str:
    """Return the meaning of a range of half-angles, and its source."""
    if not found.standing.startswith("measured"):
        middle = found.angles_deg[len(found.angles_deg) // 2]
        return (
            f"Whether a tip that meets a wall slides on or stops there is not known: "
            f"{surface_words()}. Every number here holds for one half-angle within which a tip "
            "stops, and the same poses. The range is the honest width of a prediction. A "
            f"half-angle of {middle:g} degrees is the cone of Coulomb friction "
            f"{math.tan(rad(middle)):.2g}, for a tip that slides as a solid; an everting tip lies "
            "below it. Growth uses the half-angle alone, and anchoring another friction, "
            f"{ASSUMED_FRICTION.value:g}."
        )
    return (
        "Whether a tip that meets a wall slides on or stops there was measured "
        f"({found.standing.removeprefix('measured: ')}). Every number here holds for one "
        "half-angle within which a tip stops, and the same poses. What was left open is the width "
        "of a prediction."
    )


def width_blocks(
    contacts: ContactRange, pressure: PressureRange | None
) -> Iterator[Data | Section]:
    """Yield how wide predictions are over contacts and pressure."""
    yield Data(
        {
            "width": {
                **PredictionWidth.of(contacts).content,
                "pressure": None if pressure is None else {"working_kpa": pressure.working_kpa},
            }
        }
    )
    over_contacts = Rows(
        caption=f"Means over {contacts.label}, {counted(contacts.deployments, 'deployment')} at "
        "each half-angle, with 95 % intervals over maps (simulated)",
        headings=("measure", *(f"{angle:g} deg" for angle in contacts.angles_deg)),
        rows=tuple(
            (m.label, *(m.of(v.mean, v.low, v.high, over=v.over) for v in contacts.values[m.key]))
            for m in known(contacts)
        ),
    )
    tables, words = [over_contacts], [contact_words(contacts)]
    if contacts.rules:
        tables += [rule.rows(known(rule)) for rule in contacts.rules]
        words.append(RULE_WORDS)
    if pressure is not None:
        percent = partial(Number, unit="%", form=".1f", decimals=1)
        reaches = Rows(
            caption=f"How far it gets at {pressure.working_kpa:g} kPa on {pressure.label}, "
            f"{counted(pressure.deployments, 'deployment')} (simulated; assumed constants)",
            headings=(
                "film stored", "fitted tube", "length grown", "branches out of pressure",
                "deployments without any", "95 % need",
            ),
            rows=tuple(
                (reach.storage, Number(reach.fitted_diameter_mm, "mm", "g"),
                 percent(reach.grown_percent), percent(reach.stopped_percent),
                 percent(reach.full_percent), percent(reach.needed_kpa, unit="kPa"))
                for reach in pressure.reaches
            ),
            key="width.pressure.reaches",
            keys=("film_stored", "fitted_diameter_mm", "grown_percent", "stopped_percent",
                  "full_percent", "needed_kpa"),
        )  # fmt: skip
        tables.append(reaches)
        words.append(
            f"At {pressure.working_kpa:g} kPa a tip stops where drag and turns have used up the "
            "pressure. What that takes depends on how the film lies in its store, and on the "
            "diameter of the tube that the published constants were fitted to, which was not "
            "published (both assumed)."
        )
    picture = Picture(
        image=lambda: page_svg(contact_chart({"": contacts}, COVERAGE)),
        caption=f"{COVERAGE.title.capitalize()} over the head-on half-angle, with its 95 % "
        "interval over maps (simulated).",
    )
    yield Section(
        title="How wide the prediction is",
        paragraphs=tuple(words),
        tables=tuple(tables),
        pictures=(picture,),
        folded=True,
    )


def contact_chart(shown: Mapping[str, ContactRange], measure: Measure) -> Page:
    """Return a measure over the range of half-angles, a line with its interval for each name."""
    (first, *_) = shown.values()
    angles = first.angles_deg
    every = [v for found in shown.values() for v in found.values[measure.key]]
    x0, x1 = ends_of(angles)
    y0, y1 = ends_of([v.low for v in every], [v.high for v in every], [v.mean for v in every])
    standing = first.standing.partition(":")[0]
    panel = Panel(
        box=(x0, y0, x1, y1),
        width_pt=370.0,
        height_pt=150.0,
        x_name=f"head-on half-angle (degrees, {standing})",
        y_name=measure.label,
        x_ticks=[(angle, f"{angle:g}") for angle in angles],
        frame=True,
        legend_shown=len(shown) > 1,
    )
    for index, (name, found) in enumerate(shown.items()):
        values = found.values[measure.key]
        colour = series_colour(index)
        low, high = [v.low for v in values], [v.high for v in values]
        panel.band(found.angles_deg, low, high, colour, 0.16)
        curve(panel, found.angles_deg, [v.mean for v in values], colour, name)
    return page_of(panel)


def cost_chart(
    name: str, predicted: Sequence[float], changed: Sequence[tuple[str, Sequence[float]]]
) -> Page:
    """Return the shifts of a mean by assumptions, a bar for each of them, as wide as a column.

    Parameters
    ----------
    name
        What the mean is of, with its unit.
    predicted
        The mean as predicted, and the ends of its 95 % interval over maps, if it has one.
    changed
        By words, the mean under each choice of one assumption.
    """
    every = [float(mean) for _, means in changed for mean in means]
    _, right = ends_of([0.0, *every], predicted)
    rows = len(changed)
    panel = Panel(
        box=(min(0.0, *every, *predicted), rows, right, 0.0), width_pt=232.0, height_pt=27.0 * rows,
        x_name=name, y_ticks=[], frame=True, y_grid=False,
    )  # fmt: skip
    mean, *ends = predicted
    if ends and np.isfinite(ends).all():
        panel.bars([(ends[0], rows, ends[1], 0.0)], SOFT, 0.18)
    for row, (words, means) in enumerate(changed):
        upright(panel, mean, (row + 0.42, min(row + 1.08, rows)), INK, 1.6)  # clear of words
        colour = series_colour(row)
        panel.words((panel.box[0], row + 0.26), words, TICK_PT, shift_pt=(3.0, 0.0), halo=True)
        panel.bars([(min(means), row + 0.88, max(means), row + 0.55)], colour, 0.45)
        for value in means:
            upright(panel, value, (row + 0.5, row + 0.93), colour, 2.0)
    return page_of(panel)


# --- How sensitive predictions are: to the start, to the design, to the model, to fabrication -----


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """What one change of a design, a start or the model does to the measures."""

    knob: str  # what is changed (``heading``)
    step: float  # by how much, in ``unit``
    unit: str
    count: int  # deployments compared, each with itself without the change
    changes: Mapping[str, MeanValue]  # by measure key

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

HEAD_ON_STEPS_DEG = (-14.0, -7.0, 7.0, 14.0)

LENGTH_TOLERANCE_PERCENT = 1.0

ANGLE_TOLERANCE_DEG = 2.0
"""Half-widths of the fabrication errors [assumed]: measure your own robots."""

ROBOTS = 40

ROBOTS_TOGETHER = 8
"""So many are grown at once: what a map costs is paid once for all of them."""


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
        loose_kpa, _ = worst_pressures_of(unpressed)
        table = np.column_stack([rows, loose_kpa])
        return table.reshape(len(launches), len(plans), -1).transpose(1, 0, 2)

    def effect(self, variant: PredictionVariant) -> Effect:
        """Return the effect of a change, over the poses that are free with it and without."""
        is_free = np.array([pose is not None for row in variant.poses for pose in row])
        poses = tuple(tuple(pose for pose in row if pose is not None) for row in variant.poses)
        growth_plan = Plan.of(variant.design, variant.options)
        values = np.full((len(is_free), len(QUICK_MEASURES)), np.nan)
        values[is_free] = self.grow([growth_plan], variant.options, poses)[0]
        differences = values - self.exact
        changes = {}
        for column, measure in enumerate(QUICK_MEASURES):
            change = differences[:, column]
            if np.isfinite(change).any():
                changes[measure.key] = MeanValue.of(change, self.maps, tails=PAIRED_TAILS)
        return Effect(
            knob=variant.knob,
            step=variant.step,
            unit=variant.unit,
            count=int(is_free.sum()),
            changes=changes,
        )


def sensitivity(evaluator: VariantEvaluator) -> tuple[Effect, ...]:
    """Return the effect of every change of the start, the lengths and the head-on angle."""
    design, options, poses = evaluator.design, evaluator.plan.options, evaluator.prepared.poses
    exact = PredictionVariant(
        knob="", step=0.0, unit="", design=design, options=options, poses=poses
    )
    variants = list[PredictionVariant]()
    for knob, step, unit, move in placings():
        moved = moved_poses(evaluator.prepared, move)
        variants.append(replace(exact, knob=knob, step=step, unit=unit, poses=moved))
    for step in LENGTH_STEPS_PERCENT:
        other = scaled_tree(design, 1.0 + step / 100.0)
        variants.append(replace(exact, knob="lengths", step=step, unit="%", design=other))
    for step in HEAD_ON_STEPS_DEG:
        low_rad, high_rad = (angle + rad(step) for angle in options.half_angle_range_rad)
        if low_rad < 0.0 or high_rad > math.pi / 2.0:
            continue
        wider = options.changed(head_on_half_angle_rad=(low_rad, high_rad))
        variants.append(
            replace(exact, knob="head-on half-angle", step=step, unit="deg", options=wider)
        )
    tried = each("changes of place and size", variants, lambda variant: variant.knob)
    return tuple(evaluator.effect(variant) for variant in tried)


def tolerance(evaluator: VariantEvaluator, seed: int) -> Tolerance:
    """Return how robots of the same design differ when each branch is made a little off."""
    options, tree = evaluator.plan.options, evaluator.design.tree
    rows = []
    stream = 1703
    for first in each("groups of robots as made", range(0, ROBOTS, ROBOTS_TOGETHER)):
        made = [
            made_tree(tree, child(seed, stream, robot))
            for robot in range(first, min(first + ROBOTS_TOGETHER, ROBOTS))
        ]
        rows += [
            *evaluator.grow([Plan.of(evaluator.design, options, one) for one in made], options)
        ]
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
    return replace(
        tree,
        offset_rad=frozen_floats("offset_rad", tree.offset_rad + turns),
        length_mm=frozen_floats("length_mm", tree.length_mm * (1.0 + lengths)),
        bend_mm=frozen_floats("bend_mm", tree.bend_mm * (1.0 + lengths[tree.bend_branch])),
    )


def placings() -> Iterator[tuple[str, float, str, Callable[[Pose], Pose]]]:
    """Yield the errors of a base's place: knob, step, unit, and the function that moves a pose."""
    for step in HEADING_STEPS_DEG:
        yield "heading", step, "deg", partial(turned_pose, turn_rad=rad(step))
    for step in SIDEWAYS_STEPS_MM:
        yield "position", step, "mm", partial(shifted_pose, step_mm=step)


def scaled_tree(design: Design, factor: float) -> Design:
    """Return a design with all lengths times a factor; widths stay."""
    return design.shaped(design.tree.scaled(factor))


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
    """Yield the effects of changes of start, lengths and model."""
    drawn = (measures[0], measures[-1])
    count = max(effect.count for effect in effects)
    words = (
        f"Every change is tried from the same {counted(count, 'pose')} as without it, and each "
        "deployment is "
        "compared with itself (simulated). Position: sideways to the heading, left is positive. "
        "Lengths: all branches alike. Head-on half-angle: on top of the one that it was grown at; "
        f"{surface_words()}."
    )

    def cell(change: MeanValue | None, measure: Measure) -> str:
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


def effect_panels(effects: Sequence[Effect], measures: Sequence[Measure]) -> Page:
    """Return the effect of every change: a column per knob, a row per measure."""
    knobs = list(dict.fromkeys(effect.knob for effect in effects))
    rows = []
    for measure in measures:
        shown = [[e for e in effects if e.knob == k and measure.key in e.changes] for k in knobs]
        changes = [e.changes[measure.key] for some in shown for e in some]
        y0, y1 = ends_of([0.0], [c.low for c in changes], [c.high for c in changes])
        panels = list[Panel]()
        for knob, some in zip(knobs, shown, strict=True):
            x0, x1 = ends_of([0.0], [e.step for e in some])
            panel = Panel(
                box=(x0, y0, x1, y1), width_pt=430.0 / len(knobs), height_pt=122.0, frame=True,
            )  # fmt: skip
            points = [
                (e.step, c.mean, c.low, c.high) for e in some for c in [e.changes[measure.key]]
            ]
            step, mean, low, high = np.array(sorted([*points, (0.0, 0.0, 0.0, 0.0)])).T
            panel.band(step, low, high, LEVEL_COLOURS[2], 0.22)
            panel.line([(x0, 0.0), (x1, 0.0)], Ink(line=SOFT, width_pt=0.8))
            line = np.column_stack([step, mean])
            panel.line(line, Ink(line=LEVEL_COLOURS[0], width_pt=1.3))
            panel.marks(line, "o", 3.5, Ink(fill=LEVEL_COLOURS[0]))
            if panels:
                panel.y_ticks = [(value, "") for value, _ in panel.ticks(1)]
            else:
                panel.y_name = f"change of\n{measure.title}\n({measure.unit})"
            if measure is measures[-1]:
                unit = next(effect.unit for effect in effects if effect.knob == knob)
                panel.x_name = f"{knob} ({unit})"
            panels.append(panel)
        rows.append(panels)
    return page_of_rows(rows)
