"""Studies of deployed robots: reach (Fig. 4) and anchoring (Fig. 7), against a plain vine."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import shapely
from scipy.sparse.csgraph import connected_components

from vinefab.core import __version__
from vinefab.core.hashing import fingerprint
from vinefab.core.validation import Floats
from vinefab.core.view import Picture
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design, design_content
from vinefab.model.map import Map, Pose
from vinefab.pages.page_files import page_svg
from vinefab.physics.anchoring import ASSUMED_FRICTION, amplification_interval
from vinefab.search.settings import MapSettings, PartSettings, RunSettings, plain_settings
from vinefab.search.space import Bounds, SpaceSettings
from vinefab.studies.claims import (
    Claim,
    ClaimKind,
    PaperNumber,
    StudyResult,
    difference,
    interval,
    interval_text,
    percent_text,
    share_interval,
)
from vinefab.studies.paper_charts import PlanPanel, reach_plan
from vinefab.studies.study_runs import (
    FIRST_TEST_SEED,
    NAMES,
    PAPER_GROWTH,
    STUDIED_ENVIRONMENTS,
    USUAL_MM,
    Exchange,
    JobResult,
    JobStore,
    StudySize,
    Testing,
    coverage_run,
    design_words,
    kept,
    maps_of,
    plain_vine,
    site,
    study_scores,
    trained,
    unseen_test,
    with_evaluation,
)
from vinefab.tasks.evaluate import PreparedMap, poses_on
from vinefab.tasks.reach import near_chains

FANNED_DEG = 120.0
"""Headings are spread evenly over so much, around the start's own."""

SAME_MM = 10.0
"""Final shapes nearer than this all along, directly or through others, count as one."""

FINENESS = 0.02
"""Shapes are compared at their corners and at points between, this share of a segment apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Redeployed(JobResult):
    """The share of free space that robots reach, and their final shapes."""

    share: float  # by all together
    each: float  # mean share that one deployment reaches
    shapes: int  # of whole trunks
    tips: int  # groups of their tips
    ends: Mapping[str, int]  # how many trunks ended how


@dataclass(frozen=True, slots=True, kw_only=True)
class RedeploymentJob:
    """A robot on one map, from one place, with many headings or with that of the start."""

    gives: ClassVar = Redeployed
    design: Design  # `as_tested`
    worlds: MapSettings  # the map: the first of these
    headings: int  # how many; 1: the start's own
    buffer_mm: float  # distance from the body that counts as reached
    growth: GrowthOptions = PAPER_GROWTH  # how robots grow
    # whether the bounds let robots through: what lies beyond them counts for nothing
    open_bounds: bool = False

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"redeploy_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> Redeployed:
        """Deploy it."""
        place = site(self.worlds, 0)
        grown = self.deployments(place)
        each = [self.reached(place, [deployment]) for deployment in grown]
        ends = [trunk_end(place.world, deployment) for deployment in grown]
        return Redeployed(
            key=self.key,
            share=self.reached(place, grown),
            each=float(np.mean(each)),
            shapes=shape_count(place.world, grown),
            tips=tip_groups(np.array([deployment.tips_mm[0] for deployment in grown])),
            ends={name: ends.count(name) for name in ENDS},
        )

    def deployments(self, place: PreparedMap) -> list[Deployment]:
        """Return one growth for each heading."""
        ((start,),) = poses_on([place], 1, [self.worlds.seed])
        terrain = place.terrain
        if self.open_bounds:  # they are too far away for any robot here to meet
            west_mm, _, east_mm, _ = place.world.bounds.bounds
            away_mm = 2.0 * VINE_MM / USUAL_MM * (east_mm - west_mm)
            bounds = shapely.box(*place.world.bounds.buffer(away_mm).bounds)
            terrain = Terrain.of(replace(place.world, bounds=bounds))
        if self.headings == 1:
            return [grow_on(self.design, terrain, start, self.growth)]
        middle_rad = place.world.starts[0].pose.heading_rad
        half_rad = math.radians(FANNED_DEG / 2.0)
        poses = [
            Pose(x_mm=start.x_mm, y_mm=start.y_mm, heading_rad=middle_rad + offset)
            for offset in np.linspace(-half_rad, half_rad, self.headings).tolist()
        ]
        return [grow_on(self.design, terrain, pose, self.growth) for pose in poses]

    def reached(self, place: PreparedMap, grown: list[Deployment]) -> float:
        """Return the share of free space within the buffer of all bodies together."""
        chains = [
            deployment.chain_mm(int(branch)).tolist()
            for deployment in grown
            for branch in np.flatnonzero(deployment.deployed)
        ]
        near = near_chains(chains, self.buffer_mm)
        return float(shapely.intersection(near, place.context.free).area / place.context.area_mm2)


AT_BOUNDS_MM = 0.1
"""A tip so near to the bounds ended there."""

BEYOND = "beyond the open bounds"

_TRUNK_STOPS = [stop for stop in Stop if stop <= Stop.PRESSURE]

ENDS = (*(stop.label + place for stop in _TRUNK_STOPS for place in (" at the bounds", "")), BEYOND)
"""Ends of a trunk: its reason to stop, and the place."""


def trunk_end(world: Map, robot: Deployment) -> str:
    """Return the end of a trunk."""
    tip, label = shapely.Point(robot.tips_mm[0]), Stop(int(robot.stop[0])).label
    if tip.distance(world.bounds.exterior) < AT_BOUNDS_MM:
        return f"{label} at the bounds"
    return label if world.bounds.contains(tip) else BEYOND


def shape_count(world: Map, grown: list[Deployment]) -> int:
    """Return the number of whole shapes of the trunks within the bounds."""
    whole = [shapely.LineString(robot.chain_mm(0)) for robot in grown]
    lines = shapely.intersection(whole, world.bounds.buffer(AT_BOUNDS_MM))
    one, two = np.triu_indices(len(lines), 1)
    apart_mm = np.zeros((len(lines), len(lines)))
    apart_mm[one, two] = shapely.hausdorff_distance(lines[one], lines[two], densify=FINENESS)
    return int(connected_components((apart_mm + apart_mm.T) < SAME_MM)[0])


def tip_groups(tips_mm: Floats) -> int:
    """Return the number of groups of tips, which says nothing of the ways to them."""
    apart_mm = np.hypot(*(tips_mm[:, None] - tips_mm[None]).transpose(2, 0, 1))
    return int(connected_components(apart_mm < SAME_MM)[0])


BUFFER_MM = 40.0
"""Twelve to a map, here of 500 mm. The paper does not publish its buffer; this one is assumed."""

MOST = 0.9
"""Least share for one branched deployment; the paper's reached 93 and 94 %."""

VINE_MM = 1500.0
"""A plain vine so long on a map of 500 mm that walls stop it, not its length."""

PAPER_REACH = {
    "grid": {"one": "93.0 %", "many": "68.3 %", "shapes": "6", "more": "24.7"},
    "cave": {"one": "94.3 %", "many": "61.6 %", "shapes": "5", "more": "32.7"},
}


def reach_task(buffer_mm: float) -> PartSettings:
    """Return reach with a buffer, without any cost of film or branches."""
    return PartSettings(name="reach", parameters={"buffer_mm": buffer_mm})


def reach_run(size: StudySize, environment: str, number: int) -> RunSettings:
    """Return a run that is paid for its reach and for nothing else, as in the paper."""
    run = coverage_run(size, environment, number)
    run = with_evaluation(run, maps_per_generation=size.reach_maps_at_once)
    task = reach_task(size.scaled_mm(environment, BUFFER_MM))
    return run.changed(name=f"reach_{environment}", task=task)


def redeployments(size: StudySize, environment: str) -> list[RedeploymentJob]:
    """Return the plain vine's redeployments on every unseen map."""
    return [
        RedeploymentJob(
            design=plain_vine(size.scaled_mm(environment, VINE_MM)),
            worlds=maps_of(size, environment, FIRST_TEST_SEED + index, 1),
            headings=size.headings,
            buffer_mm=size.scaled_mm(environment, BUFFER_MM),
        )
        for index in range(size.reach_maps)
    ]


SET_BY: dict[str, ClaimKind] = {"grid": "our threshold", "cave": "calibrated"}
"""Kind of claims on plain vines: in the Cave the short cuts were set by their reach."""

OPEN = "grid"
"""The environment that is tested with open bounds too; a Cave is closed in by its own rock."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenBounds:
    """Branching compared with redeploying; here where the bounds let robots through.

    Shapes are (runs, maps, 1) each.
    """

    one: Floats  # share reached by one deployment of each branching design
    many: Floats  # by all redeployments of the plain vine together
    shapes: Floats  # number of their final shapes, whole ones within the bounds
    ends: dict[str, int]  # how many of them ended how

    @classmethod
    def measured(cls, store: JobStore, designs: list[Design]) -> "OpenBounds":
        """Measure it for some branching designs."""
        plain = [replace(job, open_bounds=True) for job in redeployments(store.size, OPEN)]
        branched = [replace(job, design=design, headings=1) for design in designs for job in plain]
        many = store.do(plain, "redeploying")
        ones = [part.share for part in store.do(branched, "redeploying")]
        return cls(
            one=np.array(ones).reshape(len(designs), -1, 1),
            many=_column(part.share for part in many),
            shapes=_column(part.shapes for part in many),
            ends=_ends(many),
        )

    def plain(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "one": self.one.tolist(),
            "many": self.many.ravel().tolist(),
            "shapes": self.shapes.ravel().tolist(),
            "ends": self.ends,
        }


def reach_test(size: StudySize, design: Design, environment: str) -> Testing:
    """Return the test of one deployment on the same maps, from the same places."""
    worlds = maps_of(size, environment, FIRST_TEST_SEED, size.reach_maps)
    task = reach_task(size.scaled_mm(environment, BUFFER_MM))
    return replace(unseen_test(size, design, environment, task), worlds=worlds, poses=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Redeployments(OpenBounds):
    """The same in one environment as it is, for the kept design: (1, maps, 1) each."""

    design: Design  # the kept one
    all_seeds: Floats  # `one` for all trained designs, shape (runs, maps, 1)
    each: Floats  # share reached by one redeployment on average
    tips: Floats  # number of groups of tips
    open: OpenBounds | None  # the same with open bounds, where that makes a difference


def redeployment_study(store: JobStore) -> StudyResult:
    """Compare branching and redeploying in both environments."""
    size = store.size
    found, panels = dict[str, Redeployments](), list[PlanPanel]()
    for environment in STUDIED_ENVIRONMENTS:
        designs, best = reach_designs(store, size, environment)
        again = store.do(redeployments(size, environment), "redeploying")
        tests = [reach_test(size, design, environment) for design in designs]
        all_seeds = study_scores(store, tests)
        found[environment] = Redeployments(
            design=designs[best],
            one=all_seeds[best][None],
            all_seeds=all_seeds,
            many=_column(part.share for part in again),
            each=_column(part.each for part in again),
            shapes=_column(part.shapes for part in again),
            tips=_column(part.tips for part in again),
            ends=_ends(again),
            open=OpenBounds.measured(store, designs) if environment == OPEN else None,
        )
        job = redeployments(size, environment)[0]
        place = site(job.worlds, 0)
        ((pose,),) = poses_on([place], 1, [job.worlds.seed])
        one = grow_on(designs[best], place.terrain, pose, PAPER_GROWTH)
        for title, shares, grown in (
            ("one branched deployment", found[environment].one, [one]),
            (f"{size.headings} of a plain vine", found[environment].many, job.deployments(place)),
        ):
            panels.append(
                PlanPanel(
                    title=f"{NAMES[environment]}: {title}, {100 * shares[0, 0, 0]:.0f} %",
                    world=place.world,
                    deployments=tuple(grown),
                    buffer_mm=job.buffer_mm,
                )
            )
    return StudyResult(
        name="reach",
        title="Reachability (Fig. 4)",
        protocol=(
            f"A plain vine of {VINE_MM / USUAL_MM:g} sizes of its map was deployed {size.headings} "
            f"times from one place with headings spread over {FANNED_DEG:g} degrees; what lies "
            f"within {BUFFER_MM / USUAL_MM:.0%} of that size of any of its bodies counts as "
            "reached. The branching design was trained on the same "
            f"measure ({size.training_maps} maps, {size.seeds} seeds, no cost for film or "
            f"branches) and deployed once from that place. {size.reach_maps} unseen maps in each "
            "environment, areas exact.",
            f"Buffer, lengths and map size are assumed: the paper publishes none of them. Two "
            f"final shapes count as one when they are within {SAME_MM:g} mm of each other all "
            "along, directly or through others. The paper shows "
            "one example of each environment and does not say whether its design had met that map "
            "in training; here no map was met.",
        ),
        rows=tuple(row for name, part in found.items() for row in _reach_rows(name, part, size)),
        claims=tuple(
            claim for name, part in found.items() for claim in _reach_claims(name, part, size)
        ),
        remarks=(
            "The branching designs are as large as Table 1 allows, because nothing is charged for "
            "film here: no such robot can be cut ('price' gives the reach of those that can). "
            "The buffer reaches through thin walls in this measure, for both kinds of robot alike.",
            "Most plain vines slide along the bounds of the Grid and end in a corner there; the "
            "paper does not say whether its maps had walls around them. With open bounds a robot "
            "leaves the map, and only what it reaches within counts.",
            "How far a tree gets in a Cave is decided by how interconnected its passages are: with "
            "every short cut open, as here, most places can be reached in a few bends; with 0.4 of "
            "them open ('ablation'), long tours remain that five levels cannot follow. The share "
            "was chosen on training maps by the reach of the plain vines there, not of the trees.",
        ),
        pictures=(
            Picture(
                image=page_svg(reach_plan(panels)),
                caption="What lies within the buffer of the body, on the first unseen map of each "
                "environment (simulated). Left: the kept branching design, once. Right: all "
                "redeployments of a plain vine together.",
            ),
        ),
        data={
            environment: {
                "one": part.all_seeds.tolist(),
                "many": part.many.ravel().tolist(),
                "shapes": part.shapes.ravel().tolist(),
                "tips": part.tips.ravel().tolist(),
                "ends": part.ends,
                **({"open_bounds": part.open.plain()} if part.open else {}),
                "design": design_content(part.design),
            }
            for environment, part in found.items()
        },
    )


def reach_designs(store: JobStore, size: StudySize, environment: str) -> tuple[list[Design], int]:
    """Return the designs trained for reach, and which of them is kept."""
    runs = [reach_run(size, environment, number) for number in range(size.seeds)]
    designs = [run.design for run in trained(store, runs)]
    return designs, kept(store, runs, designs)


def _column(values: Iterable[float]) -> Floats:
    return np.array([*values], dtype=float).reshape(1, -1, 1)


def _ends(parts: Sequence[Redeployed]) -> dict[str, int]:
    """Return the number of trunks by their end, the ends that occur only."""
    counts = {name: sum(part.ends[name] for part in parts) for name in ENDS}
    return {name: count for name, count in counts.items() if count}


def _ends_text(ends: dict[str, int]) -> str:
    whole = sum(ends.values())
    return f"of {whole}: " + ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in ends.items())


def _reach_rows(environment: str, part: Redeployments, size: StudySize) -> list[PaperNumber]:
    paper, name = PAPER_REACH[environment], NAMES[environment]
    more = difference(part.one, part.many)
    points = ", ".join(f"{100 * value:.1f}" for value in (more.low, more.high))
    rows = [
        PaperNumber(what=f"{name}: branching design", ours=design_words(part.design)),
        PaperNumber(
            what=f"{name}: reached by one branched deployment",
            ours=percent_text(share_interval(part.one)),
            paper=paper["one"],
        ),
        PaperNumber(
            what=f"{name}: maps of which it reaches more than {100 * MOST:.0f} %",
            ours=percent_text(share_interval((part.one > MOST).astype(float))),
        ),
        PaperNumber(
            what=f"{name}: reached by {size.headings} of a plain vine",
            ours=percent_text(share_interval(part.many)),
            paper=paper["many"],
        ),
        PaperNumber(
            what=f"{name}: branching above plain, points",
            ours=f"{100 * more.value:.1f} [{points}]",
            paper=paper["more"],
        ),
        PaperNumber(
            what=f"{name}: reached by one of a plain vine",
            ours=percent_text(share_interval(part.each)),
        ),
        PaperNumber(
            what=f"{name}: final shapes of {size.headings} headings",
            ours=interval_text(interval(part.shapes), 1),
            paper=paper["shapes"],
        ),
        PaperNumber(
            what=f"{name}: groups of tips of {size.headings} headings",
            ours=interval_text(interval(part.tips), 1),
        ),
        PaperNumber(what=f"{name}: how plain vines end", ours=_ends_text(part.ends)),
    ]
    if part.open is not None:
        rows += [
            PaperNumber(
                what=f"{name}, open bounds: reached by one branched deployment, all seeds",
                ours=percent_text(share_interval(part.open.one)),
            ),
            PaperNumber(
                what=f"{name}, open bounds: reached by the plain vine's redeployments",
                ours=percent_text(share_interval(part.open.many)),
            ),
            PaperNumber(
                what=f"{name}, open bounds: final shapes within them",
                ours=interval_text(interval(part.open.shapes), 1),
            ),
            PaperNumber(
                what=f"{name}, open bounds: how plain vines end", ours=_ends_text(part.open.ends)
            ),
        ]
    return rows


def _reach_claims(environment: str, part: Redeployments, size: StudySize) -> list[Claim]:
    name = NAMES[environment]
    few = 0.2 * size.headings
    claims = [
        Claim(
            text=f"{name}: one branched deployment reaches more than {size.headings} plain ones",
            tested=difference(part.all_seeds, part.many),
            kept=difference(part.one, part.many),
        ),
        Claim(
            text=f"{name}: it reaches more than {100 * MOST:.0f} % (share above that)",
            tested=interval(part.all_seeds - MOST),
            kept=interval(part.one - MOST),
            kind="our threshold",
        ),
        Claim(
            text=f"{name}: {size.headings} plain deployments reach less than 70 % (share below)",
            tested=interval(0.7 - part.many),
            kind=SET_BY[environment],
        ),
        Claim(
            text=f"{name}: {size.headings} headings condense to fewer than {few:g} shapes",
            tested=interval(few - part.shapes),
            digits=1,
            kind=SET_BY[environment],
        ),
    ]
    if part.open is not None:
        claims.append(
            Claim(
                text=f"{name}, open bounds: one branched deployment reaches more than "
                f"{size.headings} plain ones",
                tested=difference(part.open.one, part.open.many),
                kind="our threshold",
            )
        )
    return claims


ANCHORING_TASK = PartSettings(name="anchoring")
SPACE = SpaceSettings(
    levels=Bounds(low=2, high=2), by_level={2: {"branches": Bounds(low=2, high=6)}}
)
"""The simplified design space: a trunk and one fan of two to six; lengths and angles of Table 1."""

PAPER_PREDICTED, PAPER_MEASURED, PAPER_BRANCHES = 6.86, 6.54, 6
POUCH_N, HELD_N = 0.65, 4.25
"""The paper's figures. The robot that held 4.25 N had been deployed by hand, not grown."""

ENGAGED = (
    (4, 4, "4 of 6 engaged, as seen: one without contact, one slack"),
    (4, 5, "4 to 5 of 6 engaged, the slack one in part"),
    (6, 6, "all 6 engaged, as in its prediction"),
)
"""Numbers of the paper's branches that may hold: least, most and the reason."""
ALIKE = 0.8


def anchor_run(size: StudySize, environment: str, number: int) -> RunSettings:
    """Return a run on anchoring in the simplified space."""
    run = coverage_run(size, environment, number)
    return run.changed(name=f"anchor_{environment}", task=ANCHORING_TASK, space=SPACE)


def anchor(store: JobStore) -> StudyResult:
    """Train anchors in both environments, test them in both, and compare them with a plain vine."""
    size = store.size
    found = Exchange.of(store, lambda home, number: anchor_run(size, home, number), size.seeds)
    single, panels, claims = dict[str, Floats](), list[PlanPanel](), list[Claim]()
    for home, other in (STUDIED_ENVIRONMENTS, STUDIED_ENVIRONMENTS[::-1]):
        # A plain vine as long as the trunk with its longest branch.
        design, name = found.kept_design(home), NAMES[home]
        level = design.levels[0]
        longest_mm = level.length_mm * max(1.0, level.growth)
        plain = plain_vine(design.trunk_length_mm + longest_mm)
        single[home] = study_scores(store, [unseen_test(size, plain, home, ANCHORING_TASK)])
        native, kept_native = found.unseen[home, home], found.kept_unseen(home, home)
        claims += [
            Claim(
                text=f"{name}: six branches hold more than a plain vine as long as trunk and "
                "branch",
                tested=difference(native, single[home]),
                kept=difference(kept_native, single[home]),
                digits=2,
            ),
            Claim(
                text=f"{name}: designs of the other environment hold over 80 % as much (similar)",
                tested=difference(found.unseen[other, home], ALIKE * native),
                kept=difference(found.kept_unseen(other, home), ALIKE * kept_native),
                digits=2,
                kind="our threshold",
            ),
        ]
        place = site(maps_of(size, home, FIRST_TEST_SEED, 1), 0)
        ((pose,),) = poses_on([place], 1, [FIRST_TEST_SEED])
        robot = grow_on(design, place.terrain, pose, PAPER_GROWTH)
        title = f"{name}: amplification {kept_native[0, 0, 0]:.2f}"
        panels.append(PlanPanel(title=title, world=place.world, deployments=(robot,)))
    turn_rad = float(np.log(PAPER_PREDICTED / PAPER_BRANCHES) / ASSUMED_FRICTION.value)
    paper_rows = []
    for fewest, most, words in ENGAGED:
        ends = amplification_interval([turn_rad] * PAPER_BRANCHES, fewest, most)
        where = "inside" if ends.low <= PAPER_MEASURED <= ends.high else "outside"
        forces = " to ".join(f"{POUCH_N * end:.2f}" for end in (ends.low, ends.high))
        paper_rows.append(
            PaperNumber(
                what=f"the paper's robot (computed): {words}",
                ours=f"{ends.low:.2f} to {ends.high:.2f}; {forces} N",
                paper=f"{PAPER_MEASURED} and {HELD_N} N measured, deployed by hand: {where}",
            )
        )
    return StudyResult(
        name="anchor",
        title="Anchoring (Fig. 7)",
        protocol=(
            "Anchoring: the sum over all leaves that deployed of exp(mu gamma), gamma the turns at "
            "contacts from base to tip: the force over that of one pouch without any turn. "
            "Friction mu 0.3 (assumed); joint angles and hinges at bases do not count. The design "
            "space is simplified to a trunk and one fan of two to six branches, as nothing is "
            f"charged for branches. {size.seeds} seeds in each environment, "
            f"{size.training_maps} training maps, {size.unseen_maps} unseen ones with "
            f"{size.poses} poses.",
            "Intervals of friction and idle branches: low is mu 0.2 with a third of the branches "
            "idle (as two of six were in the paper's test), high is mu 0.8 with all engaged.",
        ),
        rows=(
            *(row for home in STUDIED_ENVIRONMENTS for row in _anchor_rows(store, found, home)),
            *paper_rows,
        ),
        claims=tuple(claims),
        remarks=(
            "The paper's 6.86 is 6 branches times 1.14, so its branches turned little (gamma 0.45 "
            "at mu 0.3). That ours comes near it says little: six branches that all deploy give 6 "
            "without any model. What tests the model is the paper's own measurement, last rows.",
            "In the Cave the six branches often condense into one passage and turn at the same "
            "corners. The model lets them lie there on top of each other; real pouches would share "
            "one gap. The shipped six_branch_anchor was trained with pouches that must jam.",
        ),
        pictures=(
            Picture(
                image=page_svg(reach_plan(panels)),
                caption="The kept anchors on the first unseen map of each environment (simulated).",
            ),
        ),
        data={
            "unseen": {f"{a}_on_{b}": scores.tolist() for (a, b), scores in found.unseen.items()},
            "plain": {home: scores.tolist() for home, scores in single.items()},
            "kept": dict(found.best),
            "designs": {
                home: design_content(found.kept_design(home)) for home in STUDIED_ENVIRONMENTS
            },
        },
    )


def _anchor_rows(store: JobStore, found: Exchange, home: str) -> list[PaperNumber]:
    name, design = NAMES[home], found.kept_design(home)
    native = found.kept_unseen(home, home)
    test = unseen_test(store.size, design, home, ANCHORING_TASK)
    low, high, deployed = (
        float(store.terms([test], t)[0].mean()) for t in ("low", "high", "leaves")
    )
    return [
        PaperNumber(what=f"{name}: design", ours=design_words(design), paper="six branches"),
        PaperNumber(
            what=f"{name}: amplification on unseen maps, mu 0.3, those that deployed engaged",
            ours=interval_text(interval(native), 2),
            paper=f"{PAPER_PREDICTED} predicted",
        ),
        PaperNumber(
            what=f"{name}: from mu 0.2, a third idle, to mu 0.8, all engaged",
            ours=f"{low:.2f} to {high:.2f}",
            paper=f"{PAPER_MEASURED} measured, deployed by hand",
        ),
        PaperNumber(
            what=f"{name}: force at {POUCH_N} N for one pouch",
            ours=f"{POUCH_N * float(native.mean()):.2f} N "
            f"({POUCH_N * low:.2f} to {POUCH_N * high:.2f})",
            paper=f"{HELD_N} N measured, deployed by hand",
        ),
        PaperNumber(
            what=f"{name}: branches that deployed",
            ours=f"{deployed:.2f} of {design.levels[0].branches}",
            paper="6 (1 without contact, 1 slack)",
        ),
    ]
