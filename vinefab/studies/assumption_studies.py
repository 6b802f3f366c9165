"""Studies of assumptions: conclusions under open choices, and the price of manufacturability."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

import numpy as np

from vinefab.core import __version__
from vinefab.core.hashing import fingerprint
from vinefab.core.limits import rad
from vinefab.core.validation import Floats
from vinefab.core.view import Picture
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Design, PieceSettings, Pouch
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.settings import MapSettings, RunSettings, plain_settings
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings
from vinefab.studies.claims import (
    ConfidenceInterval,
    PaperNumber,
    StudyResult,
    difference,
    interval,
    interval_text,
    percent_text,
    share_interval,
)
from vinefab.studies.deployment_studies import (
    ANCHORING_TASK,
    BUFFER_MM,
    SPACE,
    RedeploymentJob,
    reach_designs,
    reach_run,
    reach_task,
    reach_test,
    redeployments,
)
from vinefab.studies.paper_charts import Bar, forest, grouped_bars, svg_bytes
from vinefab.studies.study_runs import (
    NAMES,
    PAPER_GROWTH,
    SENSOR_MM,
    STUDIED_ENVIRONMENTS,
    Exchange,
    JobResult,
    JobStore,
    StudySize,
    Testing,
    coverage_run,
    measured_fast,
    study_scores,
    trained,
    unseen_test,
    with_evaluation,
)

SLIM = BuildSettings(trunk_width_mm=24.0, width_ratio=0.65)
"""A robot whose inflated trunk, 15 mm, has room in passages of 22 mm."""

SPECIALIZATION, REACHABILITY = "specialization", "reachability"


@dataclass(frozen=True, slots=True, kw_only=True)
class AblationVariant:
    """One assumption, changed."""

    name: str  # what it is called
    asks: tuple[str, ...] = (SPECIALIZATION, REACHABILITY)  # which conclusions it may touch
    growth: GrowthOptions = PAPER_GROWTH  # how robots grow
    clip: str = "free"  # what the sensors see
    space: SpaceSettings = field(default_factory=SpaceSettings)  # the design space
    maps: Mapping[str, object] = field(default_factory=dict)  # of the Cave, other options
    buffer: float = 1.0  # distance from the body that counts as reached, in usual ones
    large_maps: bool = False  # at the scale of Fig. 4; trees are trained there too
    sensor_mm: float | None = None  # radius that a sensor sees; none: as the maps' scale asks

    def of(self, size: StudySize) -> StudySize:
        """Return the size of the study with the scale of these maps."""
        return replace(size, large_maps=size.large_maps or self.large_maps)

    def run(self, size: StudySize, environment: str, number: int) -> RunSettings:
        """Return a run of half the usual length, under this assumption."""
        run = coverage_run(self.of(size), environment, number)
        seen: dict[str, object] = {"area": "fast", "clip": self.clip}
        if self.sensor_mm is not None:
            seen["radius_mm"] = self.sensor_mm
        return run.changed(
            maps=self.worlds(run.maps),
            space=self.space,
            build=SLIM,
            growth=self.growth,
            task=run.task.changed(parameters={**run.task.parameters, **seen}),
            search=run.search.changed(generations=max(1, size.generations // 2)),
        )

    def reach_test(self, size: StudySize, design: Design, home: str) -> Testing:
        """Return the test of one branched deployment, under this assumption."""
        test = reach_test(self.of(size), design, home)
        task = reach_task(self.buffer * self.of(size).scaled_mm(home, BUFFER_MM))
        return replace(test, worlds=self.worlds(test.worlds), task=task, growth=self.growth)

    def redeployments(self, size: StudySize, home: str) -> list[RedeploymentJob]:
        """Return the plain vine's redeployments, under this assumption."""
        return [
            replace(
                job,
                design=slim(job.design),
                worlds=self.worlds(job.worlds),
                buffer_mm=self.buffer * job.buffer_mm,
                growth=self.growth,
            )
            for job in redeployments(self.of(size), home)
        ]

    def worlds(self, maps: MapSettings) -> MapSettings:
        """Return maps with the options of this assumption."""
        if maps.environment != "cave":
            return maps
        return maps.changed(options={**maps.options, **self.maps})


BASE = AblationVariant(name="base")
VARIANTS = (
    BASE,
    AblationVariant(
        name="head-on half-angle 5 degrees",
        growth=PAPER_GROWTH.changed(head_on_half_angle_rad=rad(5.0)),
    ),
    AblationVariant(
        name="head-on half-angle 15 degrees",
        growth=PAPER_GROWTH.changed(head_on_half_angle_rad=rad(15.0)),
    ),
    AblationVariant(
        name="stuck children deploy", growth=PAPER_GROWTH.changed(children_of_stuck="deploy")
    ),
    AblationVariant(
        name="inflated body, 24 mm trunk", growth=PAPER_GROWTH.changed(body="inflated")
    ),
    AblationVariant(
        name="fan: theta to either side",
        asks=(SPECIALIZATION,),
        space=SpaceSettings(angle_deg=Bounds(low=40.0, high=320.0)),
    ),
    AblationVariant(name="sensors see through walls", asks=(SPECIALIZATION,), clip="none"),
    AblationVariant(
        name="sensors see in line of sight",
        asks=(SPECIALIZATION,),
        clip="sight",
    ),
    AblationVariant(name="Cave with 0.4 of its short cuts", maps={"loops": 0.4}),
    AblationVariant(name="buffer 25 mm", asks=(REACHABILITY,), buffer=25.0 / BUFFER_MM),
    AblationVariant(name="buffer 55 mm", asks=(REACHABILITY,), buffer=55.0 / BUFFER_MM),
    AblationVariant(name="maps of the scale of Fig. 4", large_maps=True),
    AblationVariant(
        name="the same, sensors of 50 mm",
        asks=(SPECIALIZATION,),
        large_maps=True,
        sensor_mm=SENSOR_MM,
    ),
)


LEADS = {home: f"{NAMES[home]} designs lead\nin the {NAMES[home]}" for home in STUDIED_ENVIRONMENTS}
REACHES = {home: f"one branched above\nall plain, {NAMES[home]}" for home in STUDIED_ENVIRONMENTS}
CONCLUSIONS = (*LEADS.values(), *REACHES.values())

Differences = dict[str, ConfidenceInterval]
"""By conclusion."""

Shares = dict[str, Floats]
"""Of one tree, by environment, shape (1, maps, 1)."""


def conclusions(store: JobStore, variant: AblationVariant) -> tuple[Differences, Shares]:
    """Train and test under one variant: its conclusions, and the shares that trees reach."""
    size, found, reached = store.size, Differences(), Shares()
    if SPECIALIZATION in variant.asks:
        exchange = Exchange.of(store, partial(variant.run, size), size.ablation_seeds)
        for home in STUDIED_ENVIRONMENTS:
            found[LEADS[home]] = exchange.native_claim(home).tested
    if REACHABILITY in variant.asks:
        for home in STUDIED_ENVIRONMENTS:
            # The kept designs of `reach`, as slim as all others here.
            designs, best = reach_designs(store, variant.of(size), home)
            test = variant.reach_test(size, slim(designs[best]), home)
            one = reached[home] = study_scores(store, [test])
            plain = store.do(variant.redeployments(size, home), "redeploying")
            many = np.array([part.share for part in plain])
            found[REACHES[home]] = difference(one, many.reshape(1, -1, 1))
    return found, reached


def ablation(store: JobStore) -> StudyResult:
    """Train and test under every variant."""
    size, ones = store.size, dict[str, Shares]()
    results: dict[str, Differences] = {}
    rows = list[PaperNumber]()
    for variant in VARIANTS:
        name = variant.name
        results[name], ones[name] = found, shares = conclusions(store, variant)
        rows += [
            PaperNumber(
                what=f"{name}: {what.replace(chr(10), ' ')}",
                ours=f"{interval_text(result)}, {result.verdict}",
            )
            for what, result in found.items()
        ]
        rows += [
            PaperNumber(
                what=f"{name}: reached by one branched, {NAMES[home]}",
                ours=percent_text(share_interval(share)),
            )
            for home, share in shares.items()
        ]
    panels = {
        what: {name: found[what] for name, found in results.items() if what in found}
        for what in CONCLUSIONS
    }
    figure = forest(panels, list(results), "difference of scores or shares (simulated)")
    return StudyResult(
        name="ablation",
        title="Which conclusions stand when open assumptions change",
        protocol=(
            "The base is a head-on half-angle of 1 degree, centrelines, children of a stuck branch "
            "that stay inside, a fan of theta in all, sensors that see the free space within their "
            "radius, and a buffer of 40 mm. Each variant changes one of these, in training and in "
            "testing unless it says otherwise. Specialization: "
            f"{size.ablation_seeds} seeds in each environment, half as many generations as in "
            f"'transfer', tested on {size.unseen_maps} unseen maps, areas measured fast (0.1 % "
            "off in the mean square). Reachability: the kept designs of 'reach', not trained "
            f"again, against {size.headings} redeployments of a plain vine under the same variant.",
            "At the scale of Fig. 4 a Grid has 1,250 mm and 4 x 4 cells, a Cave 900 mm; buffer, "
            "plain vine and, unless it says otherwise, sensors are the same share of a map, and "
            "the trees of 'reach' are trained there.",
            "'Theta to either side' reads the paper's 'starting angle of new branches' as the "
            "angle of the outermost ones, so that fans are twice as wide. Every robot here is "
            "24 mm wide at the trunk, 0.65 of that at each next level, which matters to the "
            "inflated body only.",
        ),
        rows=tuple(rows),
        remarks=(
            "Differences are those of scores or of shares of free space; 'held' means that the "
            "95 % interval over seeds and maps is above 0.",
        ),
        pictures=(
            Picture(
                image=svg_bytes(figure),
                caption="Four conclusions under every variant (simulated), with 95 % intervals "
                "over seeds and maps.",
            ),
        ),
        data={
            name: {
                "differences": {
                    what.replace("\n", " "): [r.value, r.low, r.high] for what, r in found.items()
                },
                "one_branched": {home: float(share.mean()) for home, share in ones[name].items()},
            }
            for name, found in results.items()
        },
    )


def slim(design: Design) -> Design:
    """Return a design with the widths of this experiment."""
    build = SLIM.build(design.depth)
    return design.changed(
        build=design.build.changed(widths_mm=build.widths_mm, fillet_mm=build.fillet_mm)
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FullyChecked(JobResult):
    """Whether a design passes the whole check; one that breaks cheap rules does not."""

    passes: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FullCheckJob:
    """The whole check of a design, as `vinefab check` makes it, without a map."""

    gives: ClassVar = FullyChecked
    design: Design  # `as_tested`

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"check_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> FullyChecked:
        """Check it."""
        making = ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))
        passes = making(self.design) == 0.0 and making.passes(self.design)
        return FullyChecked(key=self.key, passes=passes)


_TASKS = ("coverage", "reach", "anchoring")
POUCHED = BuildSettings(pouch=Pouch(shape="rectangle", length_mm=25.0, width_mm=40.0))


_WAYS = {"free": "free", "pieces": "pieces", "fabricable": "one outline"}
"""What winners must be, as data and pages call it: nothing, or manufacturable, either in pieces or
in one flat outline."""

FREE_SEARCH, PIECES, OUTLINE = _WAYS

_MOST_PIECES = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThreeWays:
    """One task in one environment, searched in three ways."""

    scores: Mapping[str, Floats]  # of the winners by way, shape (runs, maps, poses) each
    passes: Mapping[str, int]  # how many winners of a way pass the whole check

    @classmethod
    def of(cls, store: JobStore, home: str, task: str) -> "ThreeWays":
        """Search in the three ways, and test the winners."""
        size = store.size
        free = [making_run(size, home, task, number) for number in range(size.making_seeds)]
        found = trained(store, [run_of_way(run, way) for way in _WAYS for run in free])
        scores = study_scores(
            store,
            [unseen_test(size, run.design, home, measured_fast(free[0].task)) for run in found],
        )
        checked = store.do([FullCheckJob(design=run.design) for run in found], "checking")
        passing = np.array([part.passes for part in checked]).reshape(len(_WAYS), -1)
        by_way = scores.reshape(len(_WAYS), -1, *scores.shape[1:])
        return cls(
            scores=dict(zip(_WAYS, by_way, strict=True)),
            passes=dict(zip(_WAYS, passing.sum(axis=1).tolist(), strict=True)),
        )


def making_run(size: StudySize, environment: str, task: str, number: int) -> RunSettings:
    """Return a run on a task that need not be made; anchors have a pouch on each leaf."""
    if task == "reach":
        return reach_run(size, environment, number)
    run = coverage_run(size, environment, number)
    if task == "coverage":
        return run
    return run.changed(
        name=f"{task}_{environment}", task=ANCHORING_TASK, space=SPACE, build=POUCHED
    )


def run_of_way(free: RunSettings, way: str) -> RunSettings:
    """Return a run that asks of its winner what a way asks."""
    if way == FREE_SEARCH:
        return free
    run = with_evaluation(free, fabricable=True)
    if way == OUTLINE:
        return run
    return run.changed(build=run.build.changed(pieces=PieceSettings(most=_MOST_PIECES)))


def price(store: JobStore) -> StudyResult:
    """Search without asking for a manufacturable robot and with it, in pieces and in one outline.

    All seed by seed.
    """
    size = store.size
    designs = size.population * size.generations
    found = {
        f"{NAMES[home]}, {task}": ThreeWays.of(store, home, task)
        for task in _TASKS
        for home in STUDIED_ENVIRONMENTS
    }
    rows, kinds = list[PaperNumber](), "; ".join(_WAYS.values())
    for name, ways in found.items():
        digits, scores = 2 if "anchoring" in name else 3, ways.scores
        cost = difference(scores[FREE_SEARCH], scores[OUTLINE], same_runs=True)
        back = difference(scores[PIECES], scores[OUTLINE], same_runs=True)
        passes = [f"{ways.passes[way]} of {size.making_seeds}" for way in _WAYS]
        rows += [
            PaperNumber(what=f"{name}: {what}", ours=ours)
            for what, ours in (
                (kinds, "; ".join(interval_text(interval(scores[w]), digits) for w in _WAYS)),
                ("price of one outline, paired by seed and map", interval_text(cost, digits)),
                ("what pieces bring back, paired by seed and map", interval_text(back, digits)),
                (f"winners that pass the whole check, {kinds}", "; ".join(passes)),
            )
        ]
    return StudyResult(
        name="price",
        title="The price of fabricability (beyond the paper)",
        protocol=(
            f"The same search ({designs} designs in {size.generations} generations; "
            f"{size.making_seeds} seeds, each on separate training maps) three times: free, and "
            "with `fabricable = true` either cut in pieces that sleeves join (at most "
            f"{_MOST_PIECES}) or as one flat outline: "
            "designs that break the rules of the shipped recipe rank below all others. Three runs "
            "have the same seed, training maps and poses; seeds and maps are drawn together. "
            f"{size.unseen_maps} unseen maps, {size.poses} poses. Widths, clearances, laps and "
            "limits are the recipe's, most of them assumed.",
            "Anchors are a trunk and one fan with a rectangular pouch of 25 x 40 mm on each leaf; "
            "only pouches that are wider than the gap they end in hold.",
        ),
        rows=tuple(rows),
        remarks=(
            "A flat sheet has two dimensions: trees of many branches cross themselves on it, which "
            "is the rule that free winners break nearly always. Branches on different pieces may "
            "cross; all other rules hold for pieces too.",
        ),
        pictures=(
            _price_picture(
                {name: ways for name, ways in found.items() if "anchoring" not in name}, "score"
            ),
            _price_picture(
                {name: ways for name, ways in found.items() if "anchoring" in name}, "pouches"
            ),
        ),
        data={
            name: {
                **{way: ways.scores[way].tolist() for way in _WAYS},
                "passes": dict(ways.passes),
            }
            for name, ways in found.items()
        },
    )


def _price_picture(found: dict[str, ThreeWays], label: str) -> Picture:
    groups = {
        name.replace(", ", ",\n"): [
            Bar(label=label, found=interval(ways.scores[way])) for way, label in _WAYS.items()
        ]
        for name, ways in found.items()
    }
    return Picture(
        image=svg_bytes(grouped_bars(groups, {}, f"{label} (simulated)")),
        caption="Winners on unseen maps (simulated), with 95 % intervals over seeds and maps. "
        f"Pieces: at most {_MOST_PIECES}.",
    )
