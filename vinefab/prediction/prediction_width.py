"""How wide a prediction is: over what contacts and pressures are assumed to be.

Whether a tip that meets a wall slides or stops changes scores more than most designs do. So do the
tube that the growth pressure was fitted to, and how the film is stored. None of them is known.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from vinefab.core.plain_text import counted
from vinefab.core.statistics import mean_interval
from vinefab.core.units import rad
from vinefab.core.validation import Floats
from vinefab.core.view import Data, Number, Picture, Rows, Section
from vinefab.growth.batch import Batch, GrowthBlock
from vinefab.growth.options import BRANCH_CONTACTS, GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.model.deployment import Stop
from vinefab.model.design import Design
from vinefab.pages.page_files import page_svg
from vinefab.physics.growth_pressure import FITTED, FITTED_DIAMETER_MM, FITTED_DIAMETER_RANGE_MM
from vinefab.prediction.family_deployments import PreparedFamily
from vinefab.prediction.measures import (
    COVERAGE,
    GROWN,
    LOOSE_PRESSURE,
    REACH,
    SEEN,
    STUCK,
    TIGHT_PRESSURE,
    TOUCHED,
    Measure,
    MeasureTable,
    block_shares_percent,
    means_by_map,
    samples_text,
    touched_percent,
)
from vinefab.prediction.pictures import contact_chart
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import outcomes

CONTACT_MEASURES = (COVERAGE, SEEN, REACH, GROWN, STUCK, TOUCHED)
"""Targets where a family's maps have any."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactValue:
    """A measure's mean at one head-on half-angle."""

    mean: float  # mean of the maps' means
    # 95 % interval of it over maps (over poses where there is one map)
    low: float
    high: float
    over: str  # how many independent samples that is


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactRange:
    """Measures of a design over what is assumed about contacts, from the same poses."""

    label: str  # of the map family
    deployments: int  # at each half-angle
    values: Mapping[str, tuple[ContactValue, ...]]  # by measure key, one for each half-angle
    angles_deg: tuple[float, ...]  # the head-on half-angles
    standing: str  # where their ends come from: ``assumed``, or ``measured`` and how
    rules: tuple["RuleRange", ...] = ()  # what else is assumed; none for a robot without branches

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

    option: str  # name of the growth option
    title: str  # what it is about
    choices: tuple[str | float, ...]  # its values
    headings: tuple[str, ...]  # what tables call them
    over: str  # the range in a few words
    short: str  # the same where there is little room
    standing: str  # ``assumed``, or ``measured`` and how
    values: Mapping[str, tuple[ContactValue, ...]]  # by measure key, one for each choice

    @property
    def content(self) -> dict[str, object]:
        """The means as they stand in JSON."""
        means = {m.key: [m.rounded(v.mean) for v in self.values[m.key]] for m in known(self.values)}
        standing = {} if self.standing == "assumed" else {"standing": self.standing}
        return {"choices": list(self.choices), **standing, "means": means}

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


def contact_angles_words(angles_deg: Sequence[float], standing: str) -> str:
    """Return a range of head-on half-angles in a few words, with its standing."""
    short = standing.partition(":")[0]
    return f"head-on half-angles of {angles_deg[0]:g} to {angles_deg[-1]:g} deg ({short})"


def contact_range(design: Design, prepared: PreparedFamily, options: GrowthOptions) -> ContactRange:
    """Deploy a design from a family's poses at every half-angle of the range."""
    prepared = prepared.distinct
    names = prepared.launch_names

    @cache  # some ranges have a choice in common: the one of the prediction
    def measured(choice: GrowthOptions) -> dict[Measure, Floats]:
        return _contact_measures(design, prepared, choice)

    columns = dict[str, list[ContactValue]]()
    for angle_deg in options.contact_angles_deg:
        table = measured(options.changed(head_on_half_angle_rad=rad(angle_deg)))
        for measure, values in table.items():
            columns.setdefault(measure.key, []).append(contact_value(values, names, measure))
    return ContactRange(
        label=prepared.label,
        deployments=len(names),
        values={key: tuple(values) for key, values in columns.items()},
        angles_deg=options.contact_angles_deg,
        standing=options.contact_angles_standing,
        rules=_rule_ranges(measured, names, options) if design.levels else (),
    )


def _rule_ranges(
    measured: Callable[[GrowthOptions], dict[Measure, Floats]],
    names: Sequence[str],
    options: GrowthOptions,
) -> tuple[RuleRange, ...]:
    """Return measures under every other choice that contacts leave open."""

    def over(variants: Sequence[GrowthOptions], **words: Any) -> RuleRange:  # noqa: ANN401
        tables = [measured(one) for one in variants]
        values = {
            measure.key: tuple(contact_value(table[measure], names) for table in tables)
            for measure in tables[0]
        }
        choices = tuple(getattr(one, words["option"]) for one in variants)
        return RuleRange(choices=choices, values=values, **words)

    chances = options.emergences
    return (
        over(
            [options.changed(branch_contact=choice) for choice in BRANCH_CONTACTS],
            option="branch_contact",
            title="What a tip does at the body of another branch",
            headings=("passes through", "stops there"),
            over="from bodies that pass through each other to tips that stop there (assumed)",
            short="branches pass, or stop at each other",
            standing="assumed",
        ),
        over(
            [options.changed(emergence=chance) for chance in chances],
            option="emergence",
            title="Probability that a child comes out of its parent's tip",
            headings=tuple(f"{chance:.3g}" for chance in chances),
            over=f"where a child comes out with probability {chances[0]:.3g} to {chances[-1]:.3g} "
            f"({options.emergences_standing.partition(':')[0]})",
            short=f"children come out, {chances[0]:.3g} to {chances[-1]:.3g}",
            standing=options.emergences_standing,
        ),
    )


def known(values: Mapping[str, object]) -> tuple[Measure, ...]:
    """Return the measures that a range has."""
    return tuple(measure for measure in CONTACT_MEASURES if measure.key in values)


def _contact_measures(
    design: Design, prepared: PreparedFamily, options: GrowthOptions
) -> dict[Measure, Floats]:
    """Return `CONTACT_MEASURES` of every deployment, shape (deployments,) each."""
    contexts = [prepared_map.context for prepared_map in prepared.maps]
    areas = [context.without_targets for context in contexts]

    def measured(block: GrowthBlock) -> Floats:
        coverage = outcomes(Coverage(area="fast"), block, contexts)
        reach = outcomes(Reach(area="fast"), block, areas)
        grown, stuck, _ = block_shares_percent(block)
        rows = (coverage.score, 100 * coverage.terms["area"], 100 * reach.score, grown, stuck)
        return np.array([*rows, touched_percent(block, contexts)])

    batch = Batch(Plans.of([design], options), prepared.launches(), options)
    table = np.concatenate(list(batch.each(measured)), axis=1)
    every = zip(CONTACT_MEASURES, table, strict=True)
    return {measure: values for measure, values in every if not np.isnan(values).all()}


def contact_value(
    values: Floats, names: Sequence[str], measure: Measure | None = None
) -> ContactValue:
    """Return the mean of values with its interval, each under the name of its map."""
    means = means_by_map(values, names)
    low, high = mean_interval(means)
    if measure is not None:
        low, high = measure.within(low, high)
    over = samples_text(len(means), names)
    return ContactValue(mean=float(means.mean()), low=low, high=high, over=over)


# --- Pressure -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureReach:
    """How far a robot gets at its working pressure, under one set of assumptions."""

    storage: str  # how the film is stored: ``loosely`` or ``tightly``
    fitted_diameter_mm: float  # diameter of the tube that the constants were fitted to
    grown_percent: float  # mean length grown
    stopped_percent: float  # share of the branches that ran out of pressure
    full_percent: float  # share of the deployments in which no branch did
    # pressure with which 95 % of the deployments grow to every tip; None if no trunk ever left
    needed_kpa: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureRange:
    """How far a robot gets at its working pressure, over what is assumed."""

    label: str  # of the map family
    deployments: int
    working_kpa: float
    reaches: tuple[PressureReach, ...]  # loosely stored first, by rising diameter


_DIAMETERS_MM = (FITTED_DIAMETER_RANGE_MM[0], FITTED_DIAMETER_MM.value, FITTED_DIAMETER_RANGE_MM[1])


def pressure_range(
    design: Design, prepared: PreparedFamily, options: GrowthOptions, measured: MeasureTable
) -> PressureRange | None:
    """Return how far a design gets at its working pressure; None if it has none.

    Parameters
    ----------
    measured
        The family's measures; growth pressures are inverse to the fitted diameter, so that the
        pressures in it are enough to know what every other assumption needs.
    """
    working_kpa = design.build.pressure_kpa
    if working_kpa <= 0.0:
        return None
    reaches = []
    for storage, tension_kpa, measure in (
        ("loosely", 0.0, LOOSE_PRESSURE),
        ("tightly", FITTED.storage_kpa.value, TIGHT_PRESSURE),
    ):
        values = measured.values[measure.key]
        known_kpa = values[np.isfinite(values)]
        usual_kpa = float(np.percentile(known_kpa, 95.0)) if len(known_kpa) else None
        for diameter_mm in _DIAMETERS_MM:
            pressed = options.changed(
                pressure_stop=True,
                storage_kpa=tension_kpa,
                fitted_diameter_mm=diameter_mm,
            )
            grown, stopped, full = _pressed(design, prepared, pressed)
            reaches.append(
                PressureReach(
                    storage=storage,
                    fitted_diameter_mm=diameter_mm,
                    grown_percent=grown,
                    stopped_percent=stopped,
                    full_percent=full,
                    needed_kpa=None
                    if usual_kpa is None
                    else usual_kpa * diameter_mm / FITTED_DIAMETER_MM.value,
                )
            )
    return PressureRange(
        label=prepared.label,
        deployments=len(measured),
        working_kpa=working_kpa,
        reaches=tuple(reaches),
    )


def _pressed(
    design: Design, prepared: PreparedFamily, options: GrowthOptions
) -> tuple[float, float, float]:
    """Return grown length, stopped branches and deployments without any, in percent."""

    def measured(block: GrowthBlock) -> Floats:
        edges = block.branch[:-1]
        stopped = np.add.reduceat((block.growth.stop == Stop.PRESSURE).astype(np.float64), edges)
        grown = np.add.reduceat(block.growth.grown, edges) / block.planned_mm()
        return np.array([grown, stopped / np.diff(block.branch), stopped == 0.0])

    batch = Batch(Plans.of([design], options), prepared.launches(), options)
    grown, stopped, full = np.concatenate(list(batch.each(measured)), axis=1).mean(axis=1).tolist()
    return 100.0 * grown, 100.0 * stopped, 100.0 * full


# --- As they are shown --------------------------------------------------------------------------


COST_CAPTION = "What contacts cost, assumed unless said; line: predicted (grey: 95 % interval)."


def contact_costs(
    found: ContactRange, measured: MeasureTable, measure: Measure
) -> tuple[str, tuple[float, ...], tuple[tuple[str, tuple[float, ...]], ...]]:
    """Return what `cost_chart` draws: a measure as predicted and over what is assumed."""
    spread = measured.spread(measure)
    predicted = (math.nan,) if spread is None else (spread.mean, spread.low, spread.high)

    def row(
        words: str, values: Sequence[ContactValue], standing: str
    ) -> tuple[str, tuple[float, ...]]:
        words += ", measured" * (standing != "assumed")
        means = tuple(value.mean for value in values)
        ends = " to ".join(measure.number(means[place]) for place in (0, -1))
        return f"{words}: {ends}", means

    low, high = found.angles_deg[0], found.angles_deg[-1]
    return f"{measure.label}, simulated", predicted, (
        row(f"tips stop within {low:g} to {high:g} deg", found.values[measure.key], found.standing),
        *(row(rule.short, rule.values[measure.key], rule.standing) for rule in found.rules),
    )  # fmt: skip


CONTACT_WORDS = (
    "Whether a tip that meets a wall slides on or stops there is not known: films of real robots "
    "show sliding down to 15 degrees from head-on. Every number here holds for one half-angle "
    "within which a tip stops, and the same poses. The range is the honest width of a prediction."
)


RULE_WORDS = (
    "Whether a tube that meets another one climbs over it or jams was not measured, nor how often "
    "a child fails to come out of its parent's tip: growth was seen to be prevented at branching "
    "points. Both ends are shown, at the half-angle of the prediction and from the same poses."
)


def contact_words(found: ContactRange) -> str:
    """Return what a range of half-angles means, and where it comes from."""
    if found.standing == "assumed":
        return CONTACT_WORDS
    return (
        "Whether a tip that meets a wall slides on or stops there was measured on photos of grown "
        f"robots ({found.standing}). Every number here holds for one half-angle "
        "within which a tip stops, and the same poses. What the photos leave open is the width of "
        "a prediction."
    )


def width_blocks(
    contacts: ContactRange, pressure: PressureRange | None
) -> Iterator[Data | Section]:
    """Yield how wide predictions are over contacts and pressure."""
    yield Data(
        {
            "width": {
                "contacts": {
                    "head_on_half_angle_deg": list(contacts.angles_deg),
                    **({} if contacts.standing == "assumed" else {"standing": contacts.standing}),
                    "deployments": contacts.deployments,
                    "means": {
                        m.key: [m.rounded(v.mean) for v in contacts.values[m.key]]
                        for m in known(contacts.values)
                    },
                },
                **{rule.option: rule.content for rule in contacts.rules},
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
            for m in known(contacts.values)
        ),
    )
    tables, words = [over_contacts], [contact_words(contacts)]
    if contacts.rules:
        tables += [rule.rows(known(rule.values)) for rule in contacts.rules]
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
