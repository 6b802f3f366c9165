"""Predictions for a design over maps and unseen environments: all numbers and the report."""

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property, partial
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from vinefab.core.codec import Record, decimals
from vinefab.core.compiling import precompile
from vinefab.core.limits import deg, rad
from vinefab.core.plain_text import counted, rounded
from vinefab.core.progress import phase
from vinefab.core.statistics import means_by_map
from vinefab.core.validation import Floats
from vinefab.core.view import (
    Answer,
    Block,
    Data,
    Fact,
    Facts,
    Notes,
    Number,
    Origin,
    Picture,
    Rows,
    Section,
    Tone,
    WrittenResult,
    bracketed,
)
from vinefab.fabrication.package.bom import bill_of_materials
from vinefab.fabrication.package.prepare import (
    Prepared,
    assumption_section,
    design_facts,
    making_facts,
    making_sections,
    prepare,
    pressure_section,
    recipe_cautions,
    recipe_verdict,
)
from vinefab.fabrication.rules.catalog import RULES
from vinefab.growth.options import GrowthOptions, growth_text, surface_words
from vinefab.inflation.pattern import as_grown
from vinefab.model.contacts import MeasuredNumber
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.finding import CheckReport
from vinefab.model.laser import LaserProfile, Material
from vinefab.model.map import Map
from vinefab.model.quantity import Quantity, Standing
from vinefab.model.score import FAILED_PERCENT, HARDLY_GROWN, NOTHING_TOUCHED, Failures
from vinefab.model.target import TargetsResult
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import Page
from vinefab.physics.anchoring import ASSUMED_FRICTION, payload_over_mass
from vinefab.physics.growth_pressure import FITTED, FITTED_DIAMETER_MM, NO_TENSION
from vinefab.physics.supply import SupplyFlow
from vinefab.physics.tube import seam_load_n_mm, self_weight_span_mm
from vinefab.prediction.family_deployments import (
    FamilyDeployments,
    HeatMap,
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    deployment_notes,
    deployment_pictures,
    deployment_section,
    heat_blocks,
    heat_map_of,
    spread_blocks,
    typical,
)
from vinefab.prediction.measures import (
    GROWN,
    REACH,
    SEEN,
    STUCK,
    TOUCHED,
    UNDEPLOYED,
    Measure,
    MeasureTable,
    task_content,
    task_measure,
)
from vinefab.prediction.prediction_width import (
    ANGLE_TOLERANCE_DEG,
    COST_CAPTION,
    LENGTH_TOLERANCE_PERCENT,
    QUICK_MEASURES,
    ContactRange,
    Effect,
    Tolerance,
    VariantEvaluator,
    contact_costs,
    contact_range,
    cost_chart,
    sensitivity,
    sensitivity_blocks,
    tolerance,
    tolerance_blocks,
    width_blocks,
)
from vinefab.prediction.pressure_window import (
    PressureRange,
    PressureWindow,
    burst_basis,
    pressure_range,
    window_blocks,
    window_of,
)
from vinefab.search.needed_code import PREDICTION
from vinefab.tasks.anchoring_force import IDLE_SHARE, Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.reach import Reach, counts_targets, touched_targets

# --- Anchoring: the simulated holding force, and the formula's ideal case -------------------------


TwoDecimals = Annotated[float, decimals(2)]
OneDecimal = Annotated[float, decimals(1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class OverMaps:
    """A number over maps, each the mean of its deployments; over those where there is one map."""

    median: TwoDecimals
    # low, high: what 90 % of the maps lie between
    low: TwoDecimals
    high: TwoDecimals

    @classmethod
    def of(cls, values: Floats, maps: Sequence[str]) -> "OverMaps":
        """Return the spread of one value per deployment; ``maps`` has the map of each."""
        low, median, high = np.percentile(means_by_map(values, maps), [5.0, 50.0, 95.0]).tolist()
        return cls(median=median, low=low, high=high)

    def text(self) -> str:
        """Return median and range as they are shown."""
        return f"{self.median:.2f} ({self.low:.2f} to {self.high:.2f})"


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldForces:
    """What is held at one coefficient of friction, over that of one pouch without any turn."""

    friction: float  # the coefficient
    engaged: OverMaps  # by the engaged leaves, as far as film and seam stand it; 0 without pouches
    some_idle: OverMaps  # the same with a third of them idle, those that turned most
    ideal: OverMaps  # by every leaf that came out, and nothing fails: the formula
    force_n: OverMaps  # by the engaged leaves, in newtons; 0 without pouches


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchoringPrediction(Record):
    """Anchoring over deployments, for a range of friction."""

    label: str  # of the map family
    leaves: int  # leaves of the design
    has_pouches: bool  # whether it has pouches, which alone hold
    # at the least, the likely and the greatest friction
    held: tuple[HeldForces, HeldForces, HeldForces]
    # engaged_percent, nothing_percent, limited_percent: leaves that are engaged, deployments that
    # hold nothing, deployments in which film or seam limits some branch at the greatest friction
    engaged_percent: OneDecimal
    nothing_percent: OneDecimal
    limited_percent: OneDecimal
    pressure_kpa: float  # working pressure that forces are for
    mass_g: Annotated[float, Field(exclude=True)]  # film of the robot; 0 when it is not known

    def over_friction(self, part: str) -> tuple[float, float]:
        """Return the bounds of 90 % of the maps at any of the frictions."""
        every: list[OverMaps] = [getattr(held, part) for held in self.held]
        return min(one.low for one in every), max(one.high for one in every)

    @property
    def likely(self) -> HeldForces:
        """What is held at the friction that is assumed."""
        return self.held[1]


def anchoring_on(material: Material) -> Anchoring:
    """Return the anchoring task with the limits of a film and its seam."""
    return Anchoring(
        film_n_mm=material.strength_mpa.value * material.ply_mm.value,
        seam_n_mm=seam_load_n_mm(material.seam),
    )


def predict_anchoring(
    design: Design, result: FamilyDeployments, task: Anchoring, mass_g: float = 0.0
) -> AnchoringPrediction:
    """Return the expected holding force of a design on one family of maps."""
    frictions = (task.friction_low, task.friction, task.friction_high)
    numbers, engaged, limited, leaves = [], [], [], 0
    has_pouches = design.build.pouch is not None
    for index, deployment in enumerate(result.deployments):
        robot = task.anchored(deployment, design.build, result.prepared_map(index).context)
        numbers.append(
            [
                (has_pouches * robot.amplification(mu)[0],
                 has_pouches * robot.amplification(mu, 1.0 - IDLE_SHARE)[0],
                 robot.ideal(mu)[0], robot.pulls_n(mu)[1][0])
                for mu in frictions
            ]
        )  # fmt: skip
        engaged.append(has_pouches * np.count_nonzero(robot.engaged))
        limited.append(robot.pulls_n(task.friction_high)[2][0] > 0.0)
        leaves = int(deployment.tree.is_leaf.sum())
    parts = ("engaged", "some_idle", "ideal", "force_n")
    low, likely, high = (
        HeldForces(
            friction=mu,
            **{
                part: OverMaps.of(column, result.outcomes.map_names)
                for part, column in zip(parts, columns, strict=True)
            },
        )
        for mu, columns in zip(frictions, np.array(numbers).transpose(1, 2, 0), strict=True)
    )
    return AnchoringPrediction(
        label=result.prepared.label,
        leaves=leaves,
        has_pouches=has_pouches,
        held=(low, likely, high),
        engaged_percent=100.0 * float(np.mean(engaged)) / leaves,
        nothing_percent=100.0 * float(np.mean(np.equal(engaged, 0))),
        limited_percent=100.0 * float(np.mean(limited)),
        pressure_kpa=design.build.pressure_kpa,
        mass_g=mass_g,
    )


def anchoring_headline(found: AnchoringPrediction) -> Fact:
    """Return the simulated holding force, next to the ideal case."""
    likely, (least, _, most) = found.likely, found.held
    ideal, over = likely.ideal, f"friction {least.friction:g} to {most.friction:g} (assumed)"
    if not found.has_pouches:
        low, high = found.over_friction("ideal")
        return Fact(
            name="anchoring amplification, ideal case",
            value=f"{ideal.median:.1f} x",
            detail=f"the design has no pouches: were every leaf that came out to hold like one, "
            f"median over {found.label} at friction {likely.friction:g}; 90 % of the maps "
            f"{low:.1f} to {high:.1f} over {over}",
            tone="caution",
        )
    held, force_n = likely.engaged, likely.force_n
    (low, high), (low_n, high_n) = map(found.over_friction, ("engaged", "force_n"))
    return Fact(
        name="anchoring amplification",
        value=f"{held.median:.1f} x",
        detail=f"{force_n.median:.2f} N at {found.pressure_kpa:g} kPa: median over {found.label} "
        f"at friction {likely.friction:g}; 90 % of the maps {low:.1f} to {high:.1f} x, "
        f"{low_n:.2f} to {high_n:.2f} N over {over}; "
        f"{found.engaged_percent:.0f} % of the leaves jam, {found.nothing_percent:.0f} % of the "
        f"deployments hold nothing (simulated). Ideal case, every leaf that came out jams: "
        f"{ideal.median:.1f} x",
        tone="plain" if held.median >= 1.0 else "caution",
    )


ANCHORING_NOTE = (
    "Force at the base over that of one pouch without any turn: the sum of e^(mu gamma) over the "
    "leaves that hold, gamma the turns at contacts on the way (equations 1 and 2 of the paper); "
    "joints and hinges at bases, where no wall need be touched, wrap nothing. A leaf holds where "
    "it grew in full, so that its pouch is out, and its inflated pouch is wider than the gap that "
    "it ended in; no branch, the trunk included, holds more than film and seam are known to stand. "
    "Of six branches in the paper's test one touched nothing and one hung slack: a third of the "
    "engaged leaves may be idle. The friction of film on the obstacles is assumed; measure yours."
)


def anchoring_blocks(anchoring: Sequence[AnchoringPrediction]) -> Iterator[Data | Section]:
    """Yield anchoring by friction: engaged leaves, some of them idle, and the ideal case."""
    parts = ("engaged", "ideal", "force_n")
    yield Data(
        {
            "anchoring": [
                found.content
                | {"over_friction": {part: rounded(found.over_friction(part), 2) for part in parts}}
                for found in anchoring
            ]
        }
    )
    number = partial(Number, form=".2f")
    engaged = [
        f"{found.engaged_percent:.1f} % of the leaves are engaged; {found.nothing_percent:.1f} % "
        "of the deployments hold nothing"
        if found.has_pouches
        else "Without pouches none is engaged: ideal case only"
        for found in anchoring
    ]
    tables = [
        Rows(
            caption=f"Amplification on {found.label}, {found.leaves} leaves: median over maps "
            f"(90 % of the maps). {words} (simulated paths, assumed friction)",
            headings=("what holds", *(f"friction {held.friction:g}" for held in found.held)),
            rows=(
                *(
                    (
                        ("leaves that are engaged", *(h.engaged.text() for h in found.held)),
                        ("a third of them idle", *(h.some_idle.text() for h in found.held)),
                    )
                    if found.has_pouches
                    else ()
                ),
                ("ideal case: every leaf that came out",
                 *(held.ideal.text() for held in found.held)),
            ),
        )
        for found, words in zip(anchoring, engaged, strict=True)
    ]  # fmt: skip
    tables += [
        Rows(
            caption=f"Force on {found.label} at {found.pressure_kpa:g} kPa: only leaves that are "
            f"engaged hold; film or seam limits some branch in {found.limited_percent:.1f} % of "
            "the deployments at the highest friction (simulated paths, computed contact, assumed "
            "friction)",
            headings=("friction", "median N", "5 % N", "95 % N", "times its own mass"),
            rows=tuple(
                (f"{held.friction:g}", number(n.median), number(n.low), number(n.high),
                 f"{payload_over_mass(n.median, found.mass_g):.0f}" if found.mass_g else "-")
                for held in found.held for n in (held.force_n,)
            ),
        )
        for found in anchoring
        if found.has_pouches
    ]  # fmt: skip
    without = () if anchoring[0].has_pouches else (
        "The design has no pouches, so that every leaf that came out counts and forces in newtons "
        "are not predicted: only the ideal case is.",
    )  # fmt: skip
    yield Section(
        title="Anchoring",
        paragraphs=(ANCHORING_NOTE, *without),
        tables=tuple(tables),
        folded=True,
    )


# --- The report -----------------------------------------------------------------------------------

MOST_PICTURES = 6

_SHARES = ((0.0, "Worst"), (0.5, "Median"), (1.0, "Best"))

_ASKED = {"coverage": SEEN, "reach": REACH}
"""What the report of a robot shows first, by the task that it was searched for."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Predicted(WrittenResult):
    """What a design is expected to do, and how it is made."""

    prepared: Prepared  # job and check
    results: tuple[FamilyDeployments, ...]  # deployments in each family, the maps given first
    plan: PredictionPlan  # how it was deployed
    window: PressureWindow | None  # the pressure window; None where nothing ever emerged
    anchoring: tuple[AnchoringPrediction, ...]  # anchoring in each family
    heat: HeatMap  # where it grows on the first map
    # contacts, pressure: how wide predictions are; no pressure range without a working pressure
    contacts: ContactRange
    pressure: PressureRange | None
    # effects, tolerance: sensitivity, and scatter from making
    effects: tuple[Effect, ...]
    tolerance: Tolerance
    more: tuple[Section, ...] = ()  # what else its page shows
    growth_notes: tuple[str, ...] = ()  # why it was grown by these rules, a sentence each
    origin: Origin | None = None  # what it takes to get it again
    path: Path | None = None  # its page
    schema = "vinefab/prediction-1"

    @property
    def main(self) -> FamilyDeployments:
        """What headlines are about."""
        return _main(self.results)

    @property
    def growth(self) -> str:
        """By which rules it was grown."""
        return growth_text(self.plan.options, [self.prepared.design])

    @property
    def targets(self) -> TargetsResult | None:
        """Which targets of the maps it touches, in which share of deployments; None without any."""
        task = self.plan.task
        return touched_targets((pair for one in self.results for pair in one.aimed(task)), task)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about the deployments, a sentence each."""
        families = [result.prepared for result in self.results]
        found = deployment_notes(families, self.plan, {"": self.prepared.design})
        return tuple(f"{note[:1].upper()}{note[1:]}." for note in found)

    @property
    def title(self) -> str:
        """What the page is about."""
        main = self.main
        (first, *others) = main.prepared.maps
        where = main.outcomes.label if others else first.world.name
        return f"{self.prepared.design.name} on {where}"

    @property
    def asked(self) -> Measure:
        """The measure that shows whether the robot does what was asked for, else its search."""
        if self.plan.task is not None:
            return task_measure(self.plan.task)
        if self.main.outcomes.spread(TOUCHED) is not None:
            return TOUCHED
        return _ASKED.get(str(self.prepared.design.origin.get("task")), SEEN)

    @property
    def records(self) -> list[dict[str, object]]:
        """Every deployment as plain values: family, map, pose and all measures."""
        return [
            {"maps": one.outcomes.label, **row}
            for one in self.results
            for row in one.outcomes.records
        ]

    def drawing(self) -> Page:
        """Return the chart of the score and the cost of assumed contacts."""
        return cost_chart(*contact_costs(self.contacts, self.main.outcomes, self.asked))

    @property
    def supply(self) -> SupplyFlow | None:
        """The flow of air that all tips take together; None where no speed is named."""
        design, speed = self.prepared.design, self.plan.tip_speed_mm_s
        if speed is None:
            return None
        return SupplyFlow.of(design.tree, design.build.pressure_kpa, speed)

    @property
    def _over_contacts(self) -> str:
        """The half-angle of the headline, and the range of the measure over half-angles."""
        measure, options = self.asked, self.plan.options
        low, high = (measure.number(value) for value in self.contacts.ends(measure))
        unit = f" {measure.unit}".rstrip()
        return (
            f"where tips stop within {options.half_angle_text} of head-on, {low} to {high}{unit} "
            f"over {self.contacts.over}"
        )

    def view(self) -> tuple[Block, ...]:
        """Return its scores, its rate of failure, the cost to make it, then all the rest."""
        return self._blocks

    @cached_property
    def _blocks(self) -> tuple[Block, ...]:
        """The view, made once: a page, JSON and lines are asked for one after the other."""
        return tuple(self._made())

    def __getstate__(self) -> dict[str, object]:
        # Blocks hold functions that draw, which cannot be pickled: a copy makes its own.
        return {name: value for name, value in vars(self).items() if name != "_blocks"}

    def _made(self) -> Iterator[Block]:
        prepared, outcomes = self.prepared, self.main.outcomes
        design, profile = prepared.design, prepared.profile
        words, tone = verdict_on(prepared.report, self.window, recipe_verdict(profile))
        targets = self.targets
        asked = targets if counts_targets(self.plan.task) else None
        spread, (does, what) = outcomes.spread(self.asked), self.asked.does
        share = "-" if spread is None else self.asked.text(spread.mean)
        deed = f" {does} {share} {what}" if asked is None else f": {asked.headline}"
        yield Answer(f"{design.name}{deed} {self._over_contacts}; {words}", tone, "verdict")
        if targets is not None:
            yield Data({"targets_headline": targets.headline})
        yield from self._typical()
        yield Facts(tuple(self._headlines(asked)), lead=True)
        yield Picture(
            image=lambda: page_svg(self.drawing()),
            caption=COST_CAPTION,
            file="contacts",
        )
        if targets is not None:
            yield targets.table
        yield Notes(self.growth_notes)
        yield Notes(self.notes, "notes")
        yield Notes(cautions(prepared, self.window, outcomes))
        yield Facts((Fact("growth model", self.growth),))
        yield Data(
            {
                "design": design.name,
                "recipe": profile.recipe.name,
                "standing": "simulated",
                **task_content(self.plan.task),
                "growth": self.plan.options.content,
                "tone": tone,
                "pressure_window": None,
                **({} if self.supply is None else {"supply": asdict(self.supply)}),
            }
        )
        *sheet, rules, pattern, bill = making_sections(prepared)
        yield from (replace(one, tables=()) for one in sheet)
        yield Section(
            title="Sheet and pieces in numbers",
            tables=tuple(replace(table, folded=False) for one in sheet for table in one.tables),
            folded=True,
        )
        yield from self.more
        yield self._deployments()
        design_rows = tuple((fact.name, fact.value) for fact in design_facts(prepared))
        yield Section(
            title="Design and machine",
            tables=(Rows(caption="Planned", headings=("", ""), rows=design_rows),),
            folded=True,
        )
        if self.window is None:
            yield pressure_section(design, profile)
        else:
            yield from window_blocks(self.window, burst_basis(profile))
        yield from spread_blocks([result.outcomes for result in self.results])
        yield from heat_blocks(self.heat)
        yield from anchoring_blocks(self.anchoring)
        yield from width_blocks(self.contacts, self.pressure)
        yield from sensitivity_blocks(self.effects, QUICK_MEASURES)
        yield from tolerance_blocks(self.tolerance)
        yield from (rules, pattern, bill)
        yield assumption_section(profile, model_assumptions(self.plan.options))

    def _typical(self) -> Iterator[Picture]:
        """Yield the median, the worst and the best deployment by the measure asked for.

        One legend, below the first, explains all of them.
        """
        found, main = self.asked, self.main
        indices = typical(main.outcomes, [share for share, _ in _SHARES], found.key, SEEN.key)
        shown = dict(zip(indices[::-1], [words for _, words in _SHARES[::-1]], strict=True))
        if len(shown) == 1:  # one deployment is its own worst, median and best
            shown = dict.fromkeys(shown, "Deployment")
        middle = indices[len(indices) // 2]
        order = [middle, *(index for index in indices if index != middle)]
        named = sorted(shown.items(), key=lambda pair: order.index(pair[0]))

        @cache
        def pictures() -> tuple[bytes, ...]:
            deployed = [(main.prepared_map(i).world, main.deployments[i]) for i, _ in named]
            return deployment_pictures(self.prepared.design, deployed, self.plan.options)

        for number, (index, words) in enumerate(named):
            yield Picture(
                image=partial(lambda at: pictures()[at], number),
                caption=f"{words}: {self._caption(main, index)} (simulated).",
                file=words.lower(),
            )

    def _headlines(self, targets: TargetsResult | None) -> Iterator[Fact]:
        """Yield the numbers to take away: what was asked, failures, pressure, making."""
        outcomes, prepared, window = self.main.outcomes, self.prepared, self.window
        held = next(one for one in self.anchoring if one.label == outcomes.label)
        if targets is not None:
            total = len(targets.outcomes)
            yield Fact(
                "asked: targets",
                f"touches {total - len(targets.missed)} of {total}",
                detail=f"all in {100.0 * targets.together:.0f} % of the deployments",
                tone=targets.tone,
                standing="simulated",
            )
        elif self.plan.task is not None:
            yield replace(measured(outcomes, self.asked), name=f"asked: {self.plan.task.name}")
        elif prepared.design.origin.get("task") == "anchoring" or held.has_pouches:
            yield anchoring_headline(held)
        else:
            task = prepared.design.origin.get("task", "no task")
            yield replace(measured(outcomes, self.asked), name=f"asked: {task}")
        yield failures(outcomes).fact
        if window is not None:
            room = f"{window.needed_kpa:.1f} to {window.allowed_kpa:.1f} kPa"
            yield Fact(
                "pressure",
                room if window.is_open else "no room",
                detail=f"growth needs, widest part may take; working {window.working_kpa:g} kPa",
                tone="plain" if window.is_open and window.holds_working else "bad",
                standing="computed, assumed",
            )
        if (supply := self.supply) is not None:
            yield Fact(
                "supply",
                f"{supply.peak_l_min:.2g} litres per minute",
                detail=f"{counted(supply.tips, 'tip')} at once at {supply.tip_speed_mm_s:g} mm/s "
                f"each, {supply.pressure_kpa:g} kPa; {supply.free_l_min:.2g} of free air; grown in "
                f"full after {supply.time_s:.0f} s with {supply.volume_l:.2g} litres",
                standing="computed, assumed",
            )
        yield from making_facts(prepared)

    def _deployments(self) -> Section:
        shown = list[tuple[str, Map, Deployment]]()
        for result in self.results:
            first = [result.map_of.index(number) for number in sorted(set(result.map_of))]
            shown += [
                (f"{self._caption(result, index)}, first pose", result.prepared_map(index).world,
                 result.deployments[index])
                for index in first[: MOST_PICTURES - len(shown)]
            ]  # fmt: skip
        ended = [(result.prepared.label, result.deployments) for result in self.results]
        return deployment_section(self.prepared.design, shown, ended, self.plan.options)

    def _caption(self, result: FamilyDeployments, index: int) -> str:
        does, _ = self.asked.does
        found = self.asked.text(result.outcomes.values[self.asked.key][index])
        return f"{result.outcomes.map_names[index]}, {does} {found}"


def predict(
    design: Design,
    profile: LaserProfile,
    families: Sequence[MapFamily],
    plan: PredictionPlan | None = None,
) -> Predicted:
    """Deploy a design on families of maps, measure it and check it with its deployments."""
    grown = as_grown(design, profile)
    plan = replace(plan or PredictionPlan(), anchoring=anchoring_on(profile.material))
    prepared_families = [PreparedFamily.of(family, plan) for family in families]
    precompile(PREDICTION)
    results = tuple(deploy_family(grown, prepared, plan) for prepared in prepared_families)
    main = _main(results)
    evaluator = VariantEvaluator(grown, main.prepared, plan)
    effects = sensitivity(evaluator)
    scatter = tolerance(evaluator, plan.seed)
    with phase("where it grows on one map"):
        heat = heat_map_of(grown, prepared_families[0].maps[0], plan)
    # The rules ask what growth to every tip would take (VF-P03): no pressure may stop it before.
    prepared = prepare(design, profile, _AllDeployments(results))
    bill = bill_of_materials(prepared.job, prepared.profile)
    mass_g = next((line.value for line in bill if line.item == "robot film mass"), 0.0)
    return Predicted(
        prepared=prepared,
        results=results,
        plan=plan,
        window=window_of(grown, profile, [result.outcomes for result in results]),
        anchoring=tuple(
            predict_anchoring(grown, result, plan.anchoring, mass_g) for result in results
        ),
        heat=heat,
        contacts=contact_range(grown, main.prepared, plan.options, plan.task),
        pressure=pressure_range(grown, main.prepared, plan.options, main.outcomes),
        effects=effects,
        tolerance=scatter,
    )


def _main(results: Sequence[FamilyDeployments]) -> FamilyDeployments:
    """Return the family with targets, or of several the one with most deployments."""

    def weight(result: FamilyDeployments) -> tuple[bool, int]:
        return result.outcomes.spread(TOUCHED) is not None, len(result.deployments)

    return max(results, key=weight)


class _AllDeployments(Collection[Deployment]):
    """The deployments of all families where no pressure stops them, none of which is kept."""

    def __init__(self, results: Sequence[FamilyDeployments]) -> None:
        self._parts = [result.unpressed for result in results]

    def __len__(self) -> int:
        return sum(len(part) for part in self._parts)

    def __iter__(self) -> Iterator[Deployment]:
        return chain.from_iterable(self._parts)

    def __contains__(self, deployment: object) -> bool:
        return any(deployment is one for one in self)


MANY_PERCENT = 10.0
"""From so many stuck or missing branches on, the summary says so."""

FEW_MAPS = 10
"""With fewer maps, intervals are wide."""


def verdict_on(
    report: CheckReport, window: PressureWindow | None, reservation: str = ""
) -> tuple[str, Tone]:
    """Return in one sentence whether a robot is manufacturable and deployable, and the tone."""
    made = "manufacturable"
    if reservation:  # as `recipe_verdict` gives it
        made += f" by the rules ({reservation})"
    if report.blocking:
        broken = ", ".join(sorted({finding.rule for finding in report.blocking}))
        return (
            f"not manufacturable and deployable as designed: broken rules {broken}.",
            "bad",
        )
    if window is None:
        return f"{made}, but has no room to emerge from any of the poses.", "bad"
    safe = window.holds_working and window.is_open_tight and not reservation
    tone: Tone = "plain" if safe else "caution" if window.is_open else "bad"
    return f"{made}, {window.words}.", tone


def cautions(
    prepared: Prepared, window: PressureWindow | None, outcomes: MeasureTable
) -> tuple[str, ...]:
    """Return the reservations to the verdict, a sentence each."""
    sentences = [*recipe_cautions(prepared.profile)]
    if window is not None and window.is_open and not window.is_open_tight:
        sentences.append(
            f"Store the film loosely: off a tight spool growth needs {window.tight.p95_kpa:.1f} "
            f"kPa, more than the {window.allowed_kpa:.1f} kPa that the widest part may take."
        )
    if window is not None and window.standing is Standing.ASSUMED:
        sentences.append(
            "Pressures rest on assumed numbers: the width of the seam's test, the diameter of the "
            "tube that growth was fitted to."
        )
    for measure, words in ((STUCK, "get stuck"), (UNDEPLOYED, "never emerge")):
        spread = outcomes.spread(measure)
        if spread is not None and spread.mean >= MANY_PERCENT:
            sentences.append(f"{measure.text(spread.mean)} of its branches {words} (simulated).")
    if outcomes.map_count < FEW_MAPS:
        sentences.append(
            f"Predictions rest on {counted(outcomes.map_count, 'map')}: intervals are wide; "
            "--environment deploys it on many more."
        )
    sentences += span_notes(prepared)
    return tuple(sentences)


def span_notes(prepared: Prepared) -> list[str]:
    """Return which branches fold under their own weight where nothing holds them, by their width.

    Branches that lie on a floor, or on obstacles, do not.
    """
    design, film = prepared.design, prepared.profile.material
    build, notes = design.build, list[str]()
    if build.pressure_kpa <= 0.0:
        return notes
    for tubes in design.tubes:
        span_mm = self_weight_span_mm(
            build.pressure_kpa, tubes.width_mm, film.ply_mm.value, film.density_kg_m3.value
        )
        rows = [row for row in tubes.rows if design.tree.length_mm[row] > span_mm]
        if rows:
            longest_mm = float(design.tree.length_mm[rows].max())
            of_level = design.branches is None
            words = f"branches of level {tubes.level}" if of_level else design.words(rows)
            verb = "are" if of_level or len(rows) > 1 else "is"
            notes.append(
                f"Self-weight: {words} {verb} up to {longest_mm:.0f} mm long; from "
                f"about {span_mm:.0f} mm without support they fold at {build.pressure_kpa:g} kPa "
                f"(computed; density of the film {film.density_kg_m3.standing})."
            )
    return notes


def failures(outcomes: MeasureTable) -> Failures:
    """Return in how many deployments a robot touches no target, or hardly leaves its base.

    On maps without targets the second counts.
    """
    touched = outcomes.values[TOUCHED.key]
    aimed = ~np.isnan(touched)
    hardly = outcomes.values[GROWN.key] < FAILED_PERCENT
    what = NOTHING_TOUCHED if aimed.any() else HARDLY_GROWN
    if aimed.any() and not aimed.all():
        what += f"; on maps without targets, {HARDLY_GROWN}"
    return Failures.of(np.where(aimed, touched == 0.0, hardly), outcomes.map_names, what)


def measured(outcomes: MeasureTable, measure: Measure) -> Fact:
    """Return the mean of a measure with its interval, and its range over deployments."""
    spread = outcomes.spread(measure)
    if spread is None:
        return Fact(measure.title, "-", standing="simulated")
    low, high, p05, p95 = (
        measure.number(value) for value in (spread.low, spread.high, spread.p05, spread.p95)
    )
    over = "" if spread.count < 2 else f"; 90 % of deployments {p05} to {p95}"
    return Fact(
        measure.title,
        f"{measure.does[0]} {measure.text(spread.mean)}",
        detail=f"{bracketed((low, high) if spread.has_interval else None, spread.over)}{over}",
        standing="simulated",
    )


# --- The numbers that predictions rest on ---------------------------------------------------------


Numbers = tuple[tuple[str, Quantity], ...]


def model_assumptions(options: GrowthOptions) -> Numbers:
    """Return the numbers of the models behind predictions, by name with unit."""
    angles = dict.fromkeys(deg(angle_rad) for angle_rad in options.half_angle_range_rad)
    factor = RULES["VF-P01"].limits["safety_factor"]
    coverage, friction = Coverage(), ASSUMED_FRICTION
    yours, printed = "measure your robots", "film on printed plastic"
    own = "vinefab's own, the paper does not give it"
    return (
        *chain.from_iterable(_half_angle_numbers(options, angle) for angle in angles),
        _assumed("making.length_tolerance_percent", LENGTH_TOLERANCE_PERCENT, yours),
        _assumed("making.angle_tolerance_deg", ANGLE_TOLERANCE_DEG, yours),
        *_contact_numbers(options),
        ("pressure.yield_kpa", FITTED.yield_kpa),
        ("pressure.drag_kpa_m", FITTED.drag_kpa_m),
        ("pressure.storage_tight_kpa", FITTED.storage_kpa),
        ("pressure.storage_loose_kpa", NO_TENSION),
        ("pressure.friction", FITTED.friction),
        ("pressure.fitted_diameter_mm", FITTED_DIAMETER_MM),
        _assumed("pressure.safety_factor", factor, "burst over allowed pressure"),
        _assumed("anchoring.friction", friction.value, printed),
        _assumed("anchoring.friction_low", friction.low, printed),
        _assumed("anchoring.friction_high", friction.high, printed),
        _assumed("coverage.sensor_radius_mm", coverage.radius_mm, own),
        _assumed("coverage.weight_area", coverage.weight_area, own),
        _assumed("coverage.weight_count", coverage.weight_count, own),
        _assumed("coverage.weight_length", coverage.weight_length, own),
        _assumed("coverage.weight_film", coverage.weight_film, own),
        _assumed("reach.buffer_mm", Reach().buffer_mm, own),
    )


def _half_angle_numbers(options: GrowthOptions, angle_deg: float) -> Numbers:
    """Return a half-angle that growth uses, and the friction that it is for a solid."""
    known, standing = options.known_half_angle, Standing.ASSUMED
    source = f"{surface_words()}; {known.standing}"
    if options.uses_measured and angle_deg in known.measured_deg:
        standing, source = Standing.MEASURED, f"{known.standing}; {known.source}"
    cone = "Coulomb's cone: tangent of the half-angle, for a tip that slides as a solid; not used"
    angle = Quantity(value=angle_deg, standing=standing, source=source)
    friction = Quantity(value=math.tan(rad(angle_deg)), standing=Standing.COMPUTED, source=cone)
    return ("growth.head_on_half_angle_deg", angle), ("growth.friction_of_half_angle", friction)


def _ends_of(found: MeasuredNumber) -> list[float]:
    """Return the measurement of a number: value and interval, or the one bound."""
    bounds = {"both": [found.low, found.high], "upper": [found.high], "lower": [found.low]}
    return [*([] if found.value is None else [found.value]), *bounds[found.side]]


def _contact_numbers(options: GrowthOptions) -> Numbers:
    """Return the width of bodies: the one measured on photos and the one that growth uses."""
    contacts, ratio = options.contacts, options.body_width_ratio
    found = None if contacts is None else contacts.body_width_ratio
    rows = list[tuple[str, Quantity]]()
    if found is not None and found.value == ratio:
        rows.append(("growth.body_width_ratio", _of_photos(found, ratio)))
    elif ratio != 1.0:
        rows.append(_assumed("growth.body_width_ratio", ratio, "given with the command"))
    friction = None if contacts is None else contacts.tip_friction
    if friction is not None:
        name = "contact.tip_friction"
        rows += [(name, _of_photos(friction, end)) for end in _ends_of(friction)]
    share = None if contacts is None else contacts.emergence
    if share is not None and share.value == options.emergence:
        source = f"{share.text}; {share.source}"
        measured = Quantity(value=share.value, standing=Standing.MEASURED, source=source)
        rows.append(("growth.emergence", measured))
    elif options.emergence < 1.0:
        rows.append(_assumed("growth.emergence", options.emergence, "given with the command"))
    return tuple(rows)


def _of_photos(found: MeasuredNumber, value: float) -> Quantity:
    source = f"{found.text()}; {found.source}"
    return Quantity(value=value, standing=Standing.MEASURED, source=source)


def _assumed(name: str, value: float, source: str) -> tuple[str, Quantity]:
    return name, Quantity(value=value, standing=Standing.ASSUMED, source=source)
