"""Designs side by side: the same maps and poses, paired statistics."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations

import numpy as np

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.core.plain_text import counted
from vinefab.core.progress import each
from vinefab.core.statistics import (
    PAIRED_TAILS,
    SIGNIFICANT,
    MeanValue,
    mean_interval,
    mean_p,
    means_by_map,
    samples_text,
)
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
    Result,
    Rows,
    Section,
    Value,
    p_equation,
    p_value,
)
from vinefab.growth.options import growth_text
from vinefab.model.design import Design
from vinefab.model.target import TargetsResult
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    INK,
    LEVEL_COLOURS,
    SOFT,
    Ink,
    Page,
    Panel,
    ends_of,
    page_of,
    upright,
)
from vinefab.prediction.family_deployments import (
    FamilyDeployments,
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    deployment_notes,
    deployment_picture,
    names_apart,
    spread_pictures,
)
from vinefab.prediction.measures import (
    COVERAGE,
    TOUCHED,
    Measure,
    MeasureTable,
    measures_with,
    task_content,
    task_measure,
)
from vinefab.prediction.prediction_width import (
    ContactRange,
    contact_chart,
    contact_range,
    contact_words,
)
from vinefab.tasks.reach import touched_targets
from vinefab.tasks.task import Task


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedDifference(MeanValue):
    """The paired difference of two designs in one measure, first minus second.

    The intervals of all pairs of designs hold together with 95 % (Bonferroni).
    """

    measure: Measure  # what is compared
    # first, second: names of the designs
    first: str
    second: str
    # p, p_adjusted: two-sided p-value of no difference by the paired t test, and the same adjusted
    # for the number of pairs: below 0.05 exactly where the interval leaves out 0
    p: float
    p_adjusted: float
    won_percent: float  # share of the maps on which the first is better, ties as half
    pairs: int  # independent differences

    @property
    def pair(self) -> str:
        """The two sides of the difference, as text."""
        return f"{self.first} minus {self.second}"

    @property
    def interval(self) -> str:
        """The mean difference with its interval."""
        return self.measure.interval(self.mean, self.low, self.high, self.over)

    @property
    def cells(self) -> tuple[Value, ...]:
        """The difference as a row: measure, pair, mean, p values, wins, pairs, better."""
        chance = partial(p_value, decimals=5)
        return (
            self.measure.label,
            self.pair,
            self.measure.of(self.mean, self.low, self.high, over=self.over),
            chance(self.p),
            chance(self.p_adjusted),
            Number(round(self.won_percent), "%", "d"),
            self.pairs,
            self.winner if self.is_clear else "not clear",
        )

    @property
    def is_clear(self) -> bool:
        """Whether the difference is significant; that of one pair never is."""
        return self.p_adjusted < SIGNIFICANT

    @property
    def winner(self) -> str:
        """The design that is better in the mean."""
        more = self.measure.better == "more"
        return self.first if (self.mean > 0.0) == more else self.second

    @property
    def words(self) -> str:
        """The result in one sentence."""
        unit = f" {self.measure.unit}".rstrip()
        by = f"{self.interval}{unit}"
        if self.pairs == 1:
            return f"{self.measure.title}: {self.pair}: {by}, no p value"
        pair = f"{self.pair}: {by}, {p_equation(self.p_adjusted)}"
        if self.is_clear:
            return f"{self.measure.title}: {self.winner} is better; {pair}"
        return f"{self.measure.title}: no clear difference; {pair}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class DesignComparison(Result):
    """Designs on the same maps from the same poses (simulated).

    Parameters
    ----------
    names
        What each design is called, all different.
    designs
        The designs.
    results
        Deployments of each.
    differences
        Every pair in every measure that both have: ``mean``, ``low``, ``high``, ``p_adjusted``,
        ``is_clear``, ``winner`` and ``words``.
    contacts
        Of each design, over the range of half-angles.
    plan
        How they were deployed.
    measure
        What counts most.
    targets
        Which targets each touches; None without any.
    growth_notes
        Why they were grown by these rules, a sentence each.
    origin
        What it takes to get the result again.
    """

    names: tuple[str, ...]
    designs: tuple[Design, ...]
    results: tuple[FamilyDeployments, ...]
    differences: tuple[PairedDifference, ...]
    contacts: tuple[ContactRange, ...]
    plan: PredictionPlan
    measure: Measure = COVERAGE
    targets: Mapping[str, TargetsResult | None] = field(default_factory=dict)
    growth_notes: tuple[str, ...] = ()
    origin: Origin | None = None
    schema = "vinefab/design-comparison-1"

    @property
    def title(self) -> str:
        """Which designs are compared."""
        return f"Comparison of {', '.join(self.names)}"

    def view(self) -> Iterator[Block]:
        """Yield the best design, means, paired differences and every measure of every design."""
        measure, outcomes = self.measure, self.outcomes()
        some, ranked = self.results[0].outcomes, self.ranked(self.measure)
        best = [d for d in self.in_measure(measure) if ranked[0][0] in (d.first, d.second)]
        clear = all(difference.is_clear for difference in best)
        sizes = {
            name: f"{counted(one.branch_count, 'branch')} on {counted(one.depth, 'level')}"
            for name, one in zip(self.names, self.designs, strict=True)
        }
        yield Answer(
            f"{ranked[0][0]} has the best mean {measure.title}, {measure.text(ranked[0][1])} "
            f"at {self.plan.options.half_angle_text}, {'' if clear else 'not '}clearly ahead of "
            f"every other (simulated); {self.order_words}.",
            "plain" if clear else "caution",
        )
        yield Picture(
            image=lambda: page_svg(self.drawing()),
            caption=f"Paired differences in {measure.title}, with 95 % intervals (simulated).",
        )
        yield Notes(self.growth_notes)
        yield Notes(self.notes, "notes")
        yield Facts(
            (
                Fact("maps", some.label, "label"),
                Fact("deployments of each design", len(some), "deployments"),
                Fact("growth", self.growth),
            )
        )
        yield Rows(
            caption=f"{measure.title} (simulated)",
            headings=("design", "mean", "over what contacts may be like", "size"),
            rows=tuple(
                (name, measure.text(mean), self.over_contacts(name, measure), sizes[name])
                for name, mean in ranked
            ),
        )
        yield paired_difference_table(self.differences)
        yield side_by_side_table(outcomes)
        found = {name: touched for name, touched in self.targets.items() if touched is not None}
        yield Rows(
            caption="Targets (simulated; tolerances assumed)",
            headings=("design", "touched"),
            rows=tuple((name, touched.headline) for name, touched in found.items()),
            key="targets",
            keys=("", ""),
            data=tuple({"design": name, "of": one.content} for name, one in found.items()),
        )
        yield Data({"standing": "simulated", "growth": self.plan.options.content,
                    "measure": measure.key, **task_content(self.plan.task),
                    "orders": [{"head_on_half_angle_deg": angle, "designs": order}
                               for angle, order in self.orders.items()],
                    "maps": some.map_count})  # fmt: skip
        yield Data(lambda: {"designs": {name: o.spreads for name, o in outcomes.items()}})
        # Charts of every measure, designs over contacts and on the same map.
        words = (
            "Each design met the same maps from the same poses, so that differences are paired: "
            "first minus second, averaged on each map. Interval and p-value are those of one "
            "paired t test over maps; with more than two designs both are adjusted for the number "
            "of pairs (Bonferroni), within each measure. Clear means p below 0.05: the interval "
            "leaves out 0."
        )
        yield Section(
            title="Side by side",
            paragraphs=(words,),
            pictures=spread_pictures(self.outcomes()),
            folded=True,
        )
        yield contact_section(self, measure)
        index = self.median_deployment(measure)
        world, options = self.results[0].prepared_map(index).world, self.plan.options
        grown = tuple(
            Picture(
                image=partial(
                    deployment_picture,
                    design,
                    world,
                    result.deployments[index],
                    options,
                    whole=True,
                ),
                caption=f"{name} on {world.name} (simulated).",
            )
            for name, design, result in zip(self.names, self.designs, self.results, strict=True)
        )
        yield Section(title="On the same map", pictures=grown, folded=True)

    @property
    def means(self) -> dict[str, float]:
        """The mean of the chosen measure by the designs' names, the best first."""
        return dict(self.ranked(self.measure))

    @property
    def growth(self) -> str:
        """By which rules they were grown."""
        return growth_text(self.plan.options, self.designs)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know about the deployments, a sentence each."""
        named = {f"{name}: ": design for name, design in zip(self.names, self.designs, strict=True)}
        return deployment_notes([self.results[0].prepared], self.plan, named)

    @property
    def records(self) -> list[dict[str, object]]:
        """Every deployment as plain values: design, map, pose and all measures."""
        return [
            {"design": name, **row} for name, one in self.outcomes().items() for row in one.records
        ]

    def drawing(self) -> Page:
        """Return the chart of paired differences in the measure that counts most."""
        return paired_difference_chart(self.measure, self.in_measure(self.measure))

    def outcomes(self) -> dict[str, MeasureTable]:
        """Return the outcomes by the designs' names."""
        return {
            name: result.outcomes for name, result in zip(self.names, self.results, strict=True)
        }

    def in_measure(self, measure: Measure) -> tuple[PairedDifference, ...]:
        """Return the differences in one measure."""
        return tuple(difference for difference in self.differences if difference.measure is measure)

    def median_deployment(self, measure: Measure) -> int:
        """Return the deployment with the median mean over all designs."""
        table = np.array([result.outcomes.values[measure.key] for result in self.results])
        order = np.argsort(np.nan_to_num(table).mean(axis=0), kind="stable")
        return int(order[len(order) // 2])

    def over_contacts(self, name: str, measure: Measure) -> str:
        """Return a design's range of a measure over possible contacts, as text."""
        contacts = self.contacts[self.names.index(name)]
        if measure.key not in contacts.values:
            return ""
        low, high = (measure.number(value) for value in contacts.ends(measure))
        least, most = contacts.angles_deg[0], contacts.angles_deg[-1]
        over = f"half-angles of {least:g} to {most:g} deg, {contacts.standing.partition(':')[0]}"
        return f"{low} to {high} over {over}{contacts.over_rules(measure)}"

    @property
    def orders(self) -> dict[float, tuple[str, ...]]:
        """Names by their mean, the best first, at each half-angle; empty where it has no mean."""
        key, sign = self.measure.key, 1.0 if self.measure.better == "more" else -1.0
        if not all(key in found.values for found in self.contacts):
            return {}
        means = np.array([[v.mean for v in found.values[key]] for found in self.contacts])
        places = np.argsort(-sign * means, axis=0, kind="stable").T.tolist()
        angles = self.contacts[0].angles_deg
        return {
            angle: tuple(self.names[place] for place in row)
            for angle, row in zip(angles, places, strict=True)
        }

    @property
    def order_words(self) -> str:
        """Whether the order of the means survives the range of half-angles, as text."""
        over, kept = self.contacts[0].over, tuple(name for name, _ in self.ranked(self.measure))
        if not self.orders:
            return f"{self.measure.title} is not followed over {over}"
        others = {angle: order for angle, order in self.orders.items() if order != kept}
        if not others:
            return f"the order of the means is the same over {over}"
        turned = ", ".join(f"{' > '.join(order)} at {angle:g}" for angle, order in others.items())
        return f"the order does not survive {over}: {turned}"

    def ranked(self, measure: Measure) -> list[tuple[str, float]]:
        """Return names and means, the best first; designs without any value are left out."""
        found = [
            (name, spread.mean)
            for name, outcomes in self.outcomes().items()
            if (spread := outcomes.spread(measure)) is not None
        ]
        return sorted(found, key=lambda pair: pair[1], reverse=measure.better == "more")


def compare_designs(
    designs: Sequence[Design],
    families: Sequence[MapFamily],
    plan: PredictionPlan,
    *,
    measure: Measure | None = None,
    growth_notes: tuple[str, ...] = (),
) -> DesignComparison:
    """Deploy designs on the same maps from the same poses and compare them pair by pair.

    Parameters
    ----------
    measure
        What counts most; None: the plan's task, else targets touched where all maps have some, else
        coverage.
    growth_notes
        Why they are grown by these rules, a sentence each.
    """
    most_designs = 12
    if not 2 <= len(designs) <= most_designs:
        raise BadInputError("designs", counted(len(designs), "design"), f"2 to {most_designs}")
    worlds = tuple(world for family in families for world in family.worlds)
    label = " and ".join(family.label for family in families)
    prepared = PreparedFamily.of(MapFamily(label=label, worlds=worlds), plan)
    names = names_apart(designs)
    each_one = each("designs", designs, lambda design: design.name)
    results = [deploy_family(design, prepared, plan) for design in each_one]
    measures = results[0].outcomes.measures
    if measure is None and plan.task is not None:
        measure = task_measure(plan.task)
    if measure is None:
        touched = np.concatenate([result.outcomes.values[TOUCHED.key] for result in results])
        measure = COVERAGE if np.isnan(touched).any() else TOUCHED
    if not any(result.outcomes.spread(measure) for result in results):
        known = [m.key for m in measures if any(r.outcomes.spread(m) for r in results)]
        raise BadInputError("--measure", measure.key, f"one that a design has: {', '.join(known)}")
    return DesignComparison(
        names=names,
        designs=tuple(designs),
        results=tuple(results),
        differences=tuple(
            difference
            for one in measures
            for difference in paired_differences(
                one, names, [result.outcomes for result in results]
            )
        ),
        contacts=tuple(
            contact_range(design, prepared, plan.options, plan.task)
            for design in each("designs over contacts", designs, lambda design: design.name)
        ),
        plan=plan,
        measure=measure,
        targets={
            name: touched_targets(result.aimed(plan.task), plan.task)
            for name, result in zip(names, results, strict=True)
        },
        growth_notes=growth_notes,
    )


def paired_differences(
    measure: Measure, names: Sequence[str], outcomes: Sequence[MeasureTable]
) -> tuple[PairedDifference, ...]:
    """Return every pair of designs in one measure, adjusted for the number of pairs."""
    found = []
    for one, two in combinations(range(len(names)), 2):
        apart = outcomes[one].values[measure.key] - outcomes[two].values[measure.key]
        means = means_by_map(apart, outcomes[one].map_names)
        if len(means):
            found.append((names[one], names[two], means))
    made = list[PairedDifference]()
    for first, second, means in found:
        p = mean_p(means, PAIRED_TAILS)
        low, high = mean_interval(means, 1.0 - SIGNIFICANT / len(found), PAIRED_TAILS)
        better = means > 0.0 if measure.better == "more" else means < 0.0
        won = np.mean(better + 0.5 * (means == 0.0))
        made.append(
            PairedDifference(
                measure=measure,
                first=first,
                second=second,
                mean=float(means.mean()),
                low=low,
                high=high,
                p=p,
                p_adjusted=float(np.minimum(1.0, len(found) * p)),
                won_percent=100.0 * float(won),
                pairs=len(means),
                over=samples_text(len(means), outcomes[0].map_names),
            )
        )
    return tuple(made)


def side_by_side_table(outcomes: Mapping[str, MeasureTable]) -> Rows:
    """Return every measure of every design, as numbers."""
    some = next(iter(outcomes.values()))
    spreads = [(m, [found.spread(m) for found in outcomes.values()]) for m in some.measures]
    rows = tuple(
        (measure.label, *("-" if one is None else one.shown(measure) for one in some))
        for measure, some in spreads
        if any(some)
    )
    return Rows(
        caption=f"Means over {some.label} with 95 % intervals, "
        f"{counted(len(some), 'deployment')} of each design (simulated)",
        headings=("measure", *outcomes),
        rows=rows,
    )


def paired_difference_table(differences: Sequence[PairedDifference]) -> Rows:
    """Return pairs in their measures, as numbers."""
    return Rows(
        caption="Paired differences (simulated); the intervals of all pairs hold together",
        headings=(
            "measure", "pair", "mean [95 % interval]", "p", "adjusted p", "first wins on", "pairs",
            "better",
        ),
        rows=tuple(difference.cells for difference in differences),
        key="duels",
        keys=("", "", "mean", "p", "p_adjusted", "first_wins_percent", "pairs", ""),
        data=tuple(
            {
                "measure": difference.measure.key,
                "first": difference.first,
                "second": difference.second,
                "better": difference.winner if difference.is_clear else None,
            }
            for difference in differences
        ),
    )  # fmt: skip


def contact_section(found: DesignComparison, measure: Measure) -> Section:
    """Return the designs over the range of half-angles, in the main measure where it has one."""
    shown = measure if measure.key in found.contacts[0].values else COVERAGE
    rows = tuple(
        (name, *(shown.number(value.mean) for value in contacts.values[shown.key]))
        for name, contacts in zip(found.names, found.contacts, strict=True)
    )
    tables = [
        Rows(
            caption=f"Mean {shown.title} over the same maps and poses (simulated)",
            headings=("design", *(f"{angle:g} deg" for angle in found.contacts[0].angles_deg)),
            rows=rows,
        )
    ]
    options = dict.fromkeys(rule.option for contacts in found.contacts for rule in contacts.rules)
    for option in options:
        rules = {
            name: rule
            for name, contacts in zip(found.names, found.contacts, strict=True)
            for rule in contacts.rules
            if rule.option == option
        }
        first = next(iter(rules.values()))
        title, standing = first.title[0].lower() + first.title[1:], first.standing.partition(":")[0]
        tables.append(
            Rows(
                caption=f"Mean {shown.title}; {title} (simulated; {standing})",
                headings=("design", *first.headings),
                rows=tuple(
                    (name, *(shown.number(value.mean) for value in rule.values[shown.key]))
                    for name, rule in rules.items()
                ),
            )
        )
    picture = Picture(
        image=lambda: page_svg(
            contact_chart(dict(zip(found.names, found.contacts, strict=True)), shown)
        ),
        caption=f"{shown.title.capitalize()} over the head-on half-angle, with 95 % intervals over "
        "maps (simulated).",
    )
    return Section(
        title="Over what contacts may be like",
        paragraphs=(contact_words(found.contacts[0]),),
        tables=tuple(tables),
        pictures=(picture,),
        folded=True,
    )


def measure_named(key: str, task: Task | None = None) -> Measure:
    """Return a measure by its key, with or without the unit at its end; a task's is one too."""
    known = {measure.key: measure for measure in measures_with(task)}
    meant = [name for name in known if name == key or name.startswith(f"{key}_")]
    if len(meant) != 1:
        raise UnknownNameError("measure", key, known)
    return known[meant[0]]


def paired_difference_chart(measure: Measure, differences: Sequence[PairedDifference]) -> Page:
    """Return paired differences with their intervals, a row per pair; clear ones are solid."""
    rows = max(2, len(differences))
    x0, x1 = ends_of([0.0], [d.low for d in differences], [d.high for d in differences])
    panel = Panel(
        box=(x0, rows - 0.4, x1, -0.6),
        width_pt=340.0,
        height_pt=27.0 * rows,
        x_name=f"difference in {measure.label}; {measure.better} is better",
        y_ticks=[(row, difference.pair) for row, difference in enumerate(differences)],
        frame=True,
    )
    upright(panel, 0.0, (rows - 0.4, -0.6), INK, 1.0)
    for row, difference in enumerate(differences):
        colour = LEVEL_COLOURS[0] if difference.is_clear else SOFT
        ends = [(difference.low, row), (difference.high, row)]
        panel.line(ends, Ink(line=colour, width_pt=2.2))
        ink = Ink(fill=colour if difference.is_clear else "#ffffff", line=colour, width_pt=1.2)
        panel.marks([(difference.mean, row)], "o", 7.0, ink)
    return page_of(panel)
