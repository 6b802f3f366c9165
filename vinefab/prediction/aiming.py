"""Where to put a robot's base on a map, held against a plain vine."""

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.limits import MOST_SEED, deg, rad
from vinefab.core.plain_text import counted, rounded
from vinefab.core.progress import each, phase
from vinefab.core.registry import parameter_values
from vinefab.core.rng import child
from vinefab.core.statistics import PAIRED_TAILS, mean_interval
from vinefab.core.validation import Floats, number, whole
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
    Text,
    Value,
    bracketed,
)
from vinefab.growth.options import HALF_ANGLE_DEG, GrowthChoice, GrowthOptions, growth_text
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose
from vinefab.model.target import TargetsResult
from vinefab.model.tree import branch_tree
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    ALERT,
    COLUMN_PT,
    HEAT_COLOURS,
    INK,
    SOFT,
    TICK_PT,
    Ink,
    Marks,
    Page,
    Panel,
    Raster,
    Shape,
    Words,
    blended,
    curve,
    ends_of,
    page_of,
    page_of_rows,
    plan_panel,
    rgb,
    round_ticks,
    series_colour,
)
from vinefab.pages.plan import (
    draw_deployment,
    draw_map,
    draw_pose,
    draw_targets,
    draw_thin,
    page_bytes,
)
from vinefab.prediction.deploy import pose_text
from vinefab.prediction.family_deployments import names_apart
from vinefab.prediction.pose_search import (
    MOST_PLACING_DEG,
    MOST_PLACING_MM,
    PLACING_DEG,
    PLACING_MM,
    BaseRegion,
    PoseErrors,
    PoseSearch,
    PoseTrial,
    nearest_places,
    pose_of,
    printed_pose,
    search_poses,
)
from vinefab.prediction.robot_set import (
    FRESH_SET_DRAWS,
    GREEDY_SHARE,
    LARGEST_TEAM,
    SET_DRAWS,
    RobotSet,
    TeamSearch,
    union_curve,
)
from vinefab.tasks.areas import BodyCover, Cover, TargetCover, TipCover
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.reach import task_targets, touched_targets
from vinefab.tasks.task import Task, check_on_map, cover_of, search_form

FEWEST_DEPLOYMENTS, MOST_DEPLOYMENTS = 5_000, 10_000_000

FRESH_DRAWS = 300
"""Draws that no choice has seen, for the values that are reported of a pose."""

WORST_SHARE = 0.1

PROFILE_HEADINGS, PROFILE_DRAWS = 72, 32
"""Headings at the best place, and draws at each, for the chart of headings."""

DEPLOYMENTS_PER_CANDIDATE, MOST_TEAM_CANDIDATES = 100, 3_000
"""Several robots are chosen from one pose for so many deployments of the search."""

SHOWN_DEPLOYMENTS = 24
"""Deployments from the best pose that are drawn."""

_FRESH, _SETS = 2001, 2002
_PLAIN = (bool, int, float, str, tuple)


@dataclass(frozen=True, slots=True, kw_only=True)
class AimPlan:
    """How poses are searched."""

    where: str = "border"  # where a base may stand, see `BaseRegion.of`
    deployments: int = 100_000  # of each design's search, about
    placing_mm: float = PLACING_MM  # a base is placed within so far
    placing_deg: float = PLACING_DEG  # and turned within so much
    robots: int = 1  # how many are to cover most together
    seed: int = 0  # seed of the fresh draws
    # the growth model's choices; half-angles are drawn from their range
    options: GrowthOptions = field(default_factory=GrowthOptions)

    def __post_init__(self) -> None:
        whole("--deployments", self.deployments, FEWEST_DEPLOYMENTS, MOST_DEPLOYMENTS)
        whole("--robots", self.robots, 1, LARGEST_TEAM)
        whole("--seed", self.seed, 0, MOST_SEED)
        number("--placing-mm", self.placing_mm, 0.0, MOST_PLACING_MM, "mm")
        number("--placing-deg", self.placing_deg, 0.0, MOST_PLACING_DEG, "deg")

    @property
    def errors(self) -> PoseErrors:
        """What differs from deployment to deployment."""
        return PoseErrors(
            placing_mm=self.placing_mm,
            placing_deg=self.placing_deg,
            half_angle_range_rad=self.options.half_angle_range_rad,
        )

    @property
    def candidates(self) -> int:
        """About how many poses several robots are chosen from."""
        return min(MOST_TEAM_CANDIDATES, self.deployments // DEPLOYMENTS_PER_CANDIDATE)

    @property
    def placing_text(self) -> str:
        """The placing errors, as text."""
        return f"placed within {self.placing_mm:g} mm and {self.placing_deg:g} deg (assumed)"


def aim_growth(designs: Sequence[Design], given: Mapping[str, object] | None) -> GrowthChoice:
    """Return how designs are grown: over all that contacts may be like unless the user says."""
    choice = GrowthChoice.of(designs, given)
    if given and HALF_ANGLE_DEG in given:
        return choice
    angles_deg = choice.options.contact_angles_deg
    ends = (rad(angles_deg[0]), rad(angles_deg[-1]))
    return replace(choice, options=choice.options.changed(head_on_half_angle_rad=ends))


def plain_vine_of(design: Design) -> Design:
    """Return the plain vine of a design's trunk that is as long as all its branches together."""
    build = design.build
    return Design(
        name=f"{design.name[:80]}_as_plain_vine",
        trunk_length_mm=branch_tree(design).total_length_mm,
        build=Build(
            widths_mm=build.widths_mm[:1],
            taper=build.taper[:1],
            fillet_mm=(),
            tail_mm=build.tail_mm,
            pressure_kpa=build.pressure_kpa,
        ),
    )


def held_against(
    design: Design, against: Design | None = None, *, alone: bool = False
) -> list[Design]:
    """Return a design and its rival: the plain vine of its length unless another is given."""
    if alone and against is not None:
        raise BadInputError("--alone", "together with --against", "one of them")
    if against is not None:
        return [design, against]
    return [design] if alone or not design.levels else [design, plain_vine_of(design)]


# --- Results ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseEstimate:
    """What a pose scores at fresh draws, the same for all poses."""

    pose: Pose
    scores: Floats  # one per draw

    @property
    def mean(self) -> float:
        """Expected score."""
        return float(self.scores.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the expected score."""
        return mean_interval(self.scores)

    @property
    def over(self) -> str:
        """How many independent samples the interval is over."""
        return counted(len(self.scores), "draw")

    @property
    def worst_tenth(self) -> float:
        """Mean of the worst tenth of the scores."""
        count = max(1, math.ceil(WORST_SHARE * len(self.scores)))
        return float(np.sort(self.scores)[:count].mean())

    def content(self) -> dict[str, object]:
        """Return it as it stands in JSON."""
        low, high = self.interval
        numbers = {"mean": self.mean, "low": low, "high": high, "worst_tenth": self.worst_tenth}
        return {
            "pose": _pose_content(self.pose),
            **rounded(numbers, 5),
            "deployments": len(self.scores),
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnedScores:
    """Scores over the heading at one place, at the draws of the search."""

    headings_rad: Floats  # shape (h,)
    scores: Floats  # shape (h, k)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AimedRobot:
    """One design's search on a map."""

    name: str
    design: Design
    search: PoseSearch
    best: PoseEstimate
    start: PoseEstimate | None  # at the map's own start, if it has one
    turned: TurnedScores  # at the best place
    shown: tuple[Deployment, ...]  # from the best pose, at some fresh draws
    team: RobotSet | None  # where several robots are asked for
    targets: TargetsResult | None = None  # that it touches at fresh draws; None without targets
    notes: tuple[str, ...] = ()  # what a user should know, a sentence each

    @property
    def cells(self) -> tuple[Value, ...]:
        """The design as a row: best pose, score, worst tenth, search, start."""
        best, start = self.best, self.start
        score = partial(Number, form=".4f", decimals=5)
        from_start = "-" if start is None else f"{start.mean:.4f} from {start.pose.text}"
        return (
            self.name,
            best.pose.text,
            score(best.mean, interval=best.interval, over=best.over),
            score(best.worst_tenth),
            score(self.search.estimate),
            from_start,
        )

    @property
    def gain(self) -> tuple[float, float, float] | None:
        """Mean gain over the map's own start with its 95 % interval, paired draw by draw."""
        return None if self.start is None else paired_gain(self.best, self.start)


def paired_gain(one: PoseEstimate, other: PoseEstimate) -> tuple[float, float, float]:
    """Return the mean of one estimate minus another's, and its 95 % interval."""
    differences = one.scores - other.scores
    return float(differences.mean()), *mean_interval(differences, tails=PAIRED_TAILS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class AimResult(Result):
    """Where to put a robot's base on a map, what it scores there, and how sure that is.

    Parameters
    ----------
    world
        The map.
    task
        What deployments are scored on.
    plan
        How poses were searched.
    robots
        The design, and the one that it is compared with.
    notes
        What a user should know, a sentence each.
    growth_notes
        Why robots were grown by these rules, a sentence each.
    origin
        What it takes to get the result again.
    """

    world: Map
    task: Task
    plan: AimPlan
    robots: tuple[AimedRobot, ...]
    notes: tuple[str, ...] = ()
    growth_notes: tuple[str, ...] = ()
    origin: Origin | None = None
    schema = "vinefab/aim-1"

    @property
    def targets(self) -> TargetsResult | None:
        """Which targets the design touches from its best pose; None where there are none."""
        return self.first.targets

    @property
    def title(self) -> str:
        """What was asked."""
        return f"Where to put {self.first.name} on {self.world.name}"

    def view(self) -> Iterator[Block]:
        """Yield the best pose, its expected score, and how the designs compare."""
        plan, first, best = self.plan, self.first, self.first.best
        gains = [(f"over {other.name}", paired_gain(best, other.best)) for other in self.robots[1:]]
        if first.gain is not None:
            gains.insert(0, ("over the map's start", first.gain))
        score = Number(
            best.mean, form=".3f", interval=best.interval, standing="simulated", over=best.over
        )
        touched = f"{self.targets.headline}; " if self.targets else ""
        one = (
            f"put the base of {first.name} at {best.pose.text}: {touched}expected "
            f"{self.task.name} score {score}."
        )
        team = first.team
        yield Answer(
            f"Best found: {one}"
            if team is None
            else f"{team.answer(first.name)} The best of one robot: {one}",
            self.targets.tone if self.targets else "plain",
        )
        yield Picture(
            image=partial(_svg, landscape_panel, self, first),
            caption=f"Expected score of {counted(len(first.search.landscape.places_mm), 'place')}, "
            "each at the best of its headings (arrows); ring: the best pose found (simulated).",
            file="landscape",
        )
        yield Picture(
            image=partial(_svg, best_deployments_panel, self, first),
            caption=f"{counted(len(first.shown), 'deployment')} from there with contacts and "
            "placing errors, one in full (simulated).",
            file="best_pose",
        )
        yield Picture(
            image=partial(_svg, turned_panel, self.robots),
            caption=f"Score over the heading there: mean of {PROFILE_DRAWS} deployments, worst to "
            "best tenth; dotted: the best (simulated).",
            file="heading",
        )
        yield Facts(
            (
                Fact(
                    "expected score",
                    Number(best.mean, form=".4f"),
                    detail=f"{self._ends(best.interval)}, mean of {FRESH_DRAWS} fresh deployments",
                    standing="simulated",
                ),
                Fact(
                    "worst tenth",
                    Number(best.worst_tenth, form=".4f"),
                    detail="mean of the worst tenth of these",
                    standing="simulated",
                ),
                *(
                    Fact(
                        name,
                        Number(gain[0], form="+.4f"),
                        detail=f"{self._ends(gain[1:], '+')}, paired draw by draw",
                        tone="plain" if gain[1] > 0.0 else "caution",
                        standing="simulated",
                    )
                    for name, gain in gains
                ),
            ),
            lead=True,
        )
        if self.targets is not None:
            yield from self.targets.below
        yield Notes(self.growth_notes)
        yield Notes(self.notes, "notes")
        yield Rows(
            caption=f"Expected {self.task.name} score at the best pose found for each, over the "
            "same fresh deployments (simulated); the search's own estimate is biased",
            headings=("design", "X,Y,DEG", "score", "worst tenth", "in the search",
                      "from the map's start"),
            rows=tuple(robot.cells for robot in self.robots),
            key="robots",
            keys=("design", "", "best.mean", "best.worst_tenth", "search_mean", ""),
            data=lambda: [_robot_content(robot, first) for robot in self.robots],
        )  # fmt: skip
        for robot in self.robots:
            if (team := robot.team) is not None:
                percent = partial(Number, unit="%", form=".1f", per=0.01)
                over = counted(team.fresh.shape[1], "draw")
                yield Rows(
                    caption=f"{len(team.poses)} robots {robot.name} that together cover most of: "
                    f"{team.cover.words} (mean of fresh deployments, simulated; chosen among "
                    f"{team.candidates:,} poses)",
                    headings=("robots", "the last at X,Y,DEG", "together", "in the search",
                              "no set beats"),
                    rows=tuple(
                        (count, pose_of(row).text,
                         percent(mean, interval=(low, high), over=over), percent(share),
                         percent(bound))
                        for row, share, (count, mean, low, high, bound) in zip(
                            team.poses, team.choice.covered, union_curve(team), strict=True
                        )
                    ),
                )  # fmt: skip
                yield Text(
                    f"The poses of {robot.name} were chosen one after the other, each for its "
                    f"gain: at least {100 * GREEDY_SHARE:.0f} % (1 - 1/e) of the cover of the best "
                    f"{len(team.poses)} of these poses, and by this case's own bound "
                    f"at least {team.least_percent:.1f} %."
                )
        yield Facts(
            (
                Fact("bases", first.search.words),
                Fact("placing", plan.placing_text),
                Fact("growth", growth_text(plan.options, [robot.design for robot in self.robots])),
            )
        )
        task = self.task
        task_values = {"name": task.name, "lowest": task.lowest, **parameter_values(task)}
        yield Data(
            {
                "standing": {
                    "scores": "simulated",
                    "placing": "assumed",
                    "contacts": plan.options.contact_angles_standing,
                },
                "task": self.task.name,
                "task_parameters": {
                    name: value for name, value in task_values.items() if isinstance(value, _PLAIN)
                },
                "map": self.world.name,
                "where": plan.where,
                "placing_mm": plan.placing_mm,
                "placing_deg": plan.placing_deg,
                "seed": plan.seed,
                "growth": plan.options.content,
                "pose": _pose_content(self.pose),
            }
        )
        yield from self._sections()

    def _ends(self, interval: Sequence[float], sign: str = "") -> str:
        low, high = (f"{end:{sign}z.4f}" for end in interval)
        return bracketed((low, high), self.first.best.over)

    def _sections(self) -> Iterator[Section]:
        """Yield the other pictures, and how the pose was found."""
        plan, first = self.plan, self.first
        others = [
            Picture(
                image=partial(_svg, landscape_panel, self, robot),
                caption=f"{robot.name}: expected score of its places. Ring: its best robust pose, "
                f"{robot.best.pose.text} (simulated).",
            )
            for robot in self.robots[1:]
        ]
        grown = [
            Picture(
                image=partial(_svg, best_deployments_panel, self, robot),
                caption=f"{robot.name} from {robot.best.pose.text}: "
                f"{counted(len(robot.shown), 'deployment')} with contacts and placing errors, one "
                "of them in full (simulated).",
            )
            for robot in self.robots[1:]
        ]
        if others:
            names = ", ".join(robot.name for robot in self.robots[1:])
            title = f"At its best pose: {names}"
            yield Section(title=title, pictures=(*grown, *others), folded=True)
        teams = [
            Picture(
                image=partial(_svg, team_panel, self, robot.team),
                caption=f"{robot.name}: {robot.team.cover.words}; each robot's colour where it is "
                "the first to cover, at one fresh draw (simulated).",
            )
            for robot in self.robots
            if robot.team is not None
        ]
        if teams:
            union = Picture(
                image=partial(_svg, union_panel, self.robots),
                caption="Covered share over the number of robots: mean and 95 % interval at fresh "
                "draws; dashed: what no set of as many candidates can exceed at the draws of the "
                "search (simulated).",
            )
            yield Section(title="Several robots", pictures=(*teams, union), folded=True)
        low, high = (f"{deg(angle):g}" for angle in plan.options.half_angle_range_rad)
        words = (
            f"{first.search.deployments:,} deployments of {first.name} were simulated in "
            f"{counted(first.search.starts, 'search')} on grids of their own: all over "
            "the region at first, then at the best poses there, then around the best of these, "
            "with the same contacts and placing errors at every pose. The pose of an earlier "
            "search is kept unless a later one finds a clearly better one: more deployments "
            "never give a clearly worse pose; a better one may still exist. Head-on "
            f"half-angles are even from {low} to {high} deg "
            f"({plan.options.contact_angles_standing}), bases are even within {plan.placing_mm:g} "
            f"mm of their place and {plan.placing_deg:g} deg of their heading (assumed). The best "
            "of many estimates looks better than it is, so the scores that are reported come from "
            f"{FRESH_DRAWS} draws that the search has not seen."
        )
        yield Section(title="How it was found", paragraphs=(words,), folded=True)

    def picture(self, suffix: str) -> bytes:
        """Return the maps, the best deployments and the headings of all designs in one picture."""
        return page_bytes(aim_sheet(self), suffix)

    @property
    def first(self) -> AimedRobot:
        """The design that was asked about."""
        return self.robots[0]

    @property
    def pose(self) -> Pose:
        """The best robust pose that was found."""
        return self.first.best.pose

    @property
    def poses(self) -> tuple[Pose, ...]:
        """The poses of the robots that together cover most; the best pose for one robot."""
        team = self.first.team
        return (self.pose,) if team is None else tuple(pose_of(row) for row in team.poses)

    @property
    def region(self) -> str:
        """Where bases may stand, as text."""
        return f"base {self.first.search.words}"

    @property
    def mean(self) -> float:
        """Expected score from the best pose, at fresh draws (simulated)."""
        return self.first.best.mean


def _svg(panel: Callable[..., Panel], *args: object) -> bytes:
    return page_svg(page_of(panel(*args)))


def aim_robots(
    designs: Sequence[Design],
    world: Map,
    task: Task,
    plan: AimPlan,
    workers: int | None = None,
) -> AimResult:
    """Search the best pose of each design on a map.

    Parameters
    ----------
    designs
        The one that is asked about, and others to hold it against; each at its own best pose.
    workers
        Threads; results do not depend on it. None: as many as there are processors, at most 8.
    """
    prepared = PreparedMap.of(world)
    check_on_map(task, world, prepared.context)
    cover = cover_of(search_form(task), prepared.context) if plan.robots > 1 else None
    names = names_apart(designs)
    robots = list[AimedRobot]()
    with ThreadPoolExecutor(workers or min(8, os.cpu_count() or 1)) as pool:
        asked = each("robots", list(zip(names, designs, strict=True)), lambda one: one[0])
        for name, design in asked:
            trial = PoseTrial.of(design, prepared, plan.options, pool.map)
            robots.append(_aimed(name, trial, task, plan, cover))
    notes = [note for robot in robots for note in robot.notes]
    if not world.starts:
        notes.append("the map has no start to compare with")
    return AimResult(world=world, task=task, plan=plan, robots=tuple(robots), notes=tuple(notes))


def _aimed(
    name: str,
    trial: PoseTrial,
    task: Task,
    plan: AimPlan,
    cover: Cover | None,
) -> AimedRobot:
    with phase("places for the base"):
        region = BaseRegion.of(trial, plan.where)
    with phase("trial deployments", plan.deployments) as tried:
        found = search_poses(
            trial, search_form(task), region, plan.errors, plan.deployments, tried.more
        )
    fresh = plan.errors.drawn(FRESH_DRAWS, child(plan.seed, _FRESH))
    best = pose_of(printed_pose(trial, found.pose))
    starts = [start.pose for start in trial.prepared.world.starts[:1]]
    rows = np.array([(p.x_mm, p.y_mm, p.heading_rad) for p in (best, *starts)])
    # What is reported is scored as `vinefab score` does, not by the search's approximation.
    with phase("fresh deployments from the best pose", len(rows) * FRESH_DRAWS) as drawn:
        scores = trial.scores(task, rows, fresh, drawn.more)
    estimates = [
        PoseEstimate(pose=pose, scores=row)
        for pose, row in zip((best, *starts), scores, strict=True)
    ]
    headings = 2.0 * math.pi * np.arange(PROFILE_HEADINGS) / PROFILE_HEADINGS
    around = np.column_stack([np.tile(found.pose[:2], (PROFILE_HEADINGS, 1)), headings])
    even = plan.errors.even(PROFILE_DRAWS)
    team = None
    if cover is not None:
        most = plan.candidates * SET_DRAWS + plan.robots * FRESH_SET_DRAWS
        with phase("deployments of several robots", most) as drawn:
            team = TeamSearch(trial=trial, cover=cover, errors=plan.errors, tell=drawn.more).choose(
                found.landscape, found.pose, plan.robots, plan.candidates, child(plan.seed, _SETS)
            )
    notes = []
    for start in starts:
        place = np.array([[start.x_mm, start.y_mm]])
        if not trial.prepared.terrain.have_room(place, trial.radius_mm)[0]:
            away_mm = float(np.hypot(*(nearest_places(trial.room, place) - place)[0]))
            notes.append(
                f"the trunk of {name} has no room at the map's start: there it begins "
                f"{away_mm:.1f} mm aside, at the nearest place with room"
            )
    with phase("deployments at other headings", len(around) * PROFILE_DRAWS) as drawn:
        turned = trial.scores(search_form(task), around, even, drawn.more)
    targets = None
    if task_targets(task, world := trial.prepared.world):
        grown = trial.deployments(rows[0], fresh)
        targets = touched_targets(((deployment, world) for deployment in grown), task)
    return AimedRobot(
        name=name,
        design=trial.design,
        search=found,
        best=estimates[0],
        start=estimates[1] if starts else None,
        turned=TurnedScores(headings_rad=headings, scores=turned),
        shown=tuple(trial.deployments(rows[0], fresh.part(0, SHOWN_DEPLOYMENTS))),
        team=team,
        targets=targets,
        notes=tuple(notes),
    )


# --- As JSON ------------------------------------------------------------------------------------


def _robot_content(robot: AimedRobot, first: AimedRobot) -> dict[str, object]:
    """Return the JSON values of a design that the shown row lacks."""
    found, best, team, together = robot.search, robot.best, robot.team, None
    if team is not None:
        names = ("count", "share", "low", "high", "search_bound", "search_share")
        together = {
            "covered": team.cover.words,
            "candidates": team.candidates,
            "poses": [_pose_content(pose_of(row)) for row in team.poses],
            "robots": [
                rounded(dict(zip(names, (*row, share), strict=True)), 5)
                for row, share in zip(union_curve(team), team.choice.covered, strict=True)
            ],
            "least_share_of_best": {
                "always": round(GREEDY_SHARE, 4),
                "here": rounded(team.least_share, 5),
            },
        }
    return {
        "branches": robot.design.branch_count,
        "length_mm": round(branch_tree(robot.design).total_length_mm, 3),
        "deployments": found.deployments,
        "best.pose": _pose_content(best.pose),
        "best.deployments": len(best.scores),
        "search_draws": found.draws,
        "start": None if robot.start is None else robot.start.content(),
        "gain_over_start": _gain_content(robot.gain),
        "first_minus_this": None
        if robot is first
        else _gain_content(paired_gain(first.best, best)),
        "landscape": {  # a row of scores over the headings for each place
            "draws": found.landscape.draws,
            "spacing_mm": round(found.landscape.spacing_mm, 3),
            "heading_deg": [round(deg(value), 2) for value in found.landscape.headings_rad],
            "places_mm": rounded(found.landscape.places_mm.tolist(), 2),
            "mean": rounded(found.landscape.scores.tolist(), 5),
        },
        "headings_at_best": {
            "heading_deg": [round(deg(value), 2) for value in robot.turned.headings_rad],
            "mean": rounded(robot.turned.scores.mean(axis=1).tolist(), 5),
        },
        "together": together,
    }


def _gain_content(gain: tuple[float, float, float] | None) -> dict[str, object] | None:
    names = ("mean", "low", "high")
    return None if gain is None else rounded(dict(zip(names, gain, strict=True)), 5)


def _pose_content(pose: Pose) -> dict[str, object]:
    return {
        "x_mm": pose.x_mm,
        "y_mm": pose.y_mm,
        "heading_deg": round(pose.heading_deg, 2),
        "text": pose.text,
    }


# --- Pictures of where to put a robot's base: landscapes, deployments, headings, several robots ---


PLAN_PT = 360.0
"""Longer side of a plan in the picture that has all."""

MOST_ARROWS = 150

ARROWS_APART = 0.035
"""Arrows stand this far apart, as a share of the map's longer side."""

_ARROW_PT = 9.0


def score_ends(found: AimResult) -> tuple[float, float]:
    """Return the ends of the scale of expected scores that all maps of a result share."""
    some = np.concatenate([robot.search.landscape.best_scores for robot in found.robots])
    some = some[np.isfinite(some)]
    low, high = float(some.min()), float(some.max())
    return low, high if high > low else low + 1e-9


def landscape_panel(
    found: AimResult, robot: AimedRobot, *, bar: bool = True, longest_pt: float = COLUMN_PT - 15.0
) -> Panel:
    """Return expected scores over places, each at its best heading, with arrows along some."""
    landscape, world = robot.search.landscape, found.world
    known = landscape.known
    places, scores = landscape.places_mm[known], landscape.best_scores[known]
    most_pt = 14.0 if found.plan.where == "anywhere" else 7.0
    size_mm = max(world.size_mm)
    panel = plan_panel(world.bounds.bounds, longest_pt)
    side_pt = float(np.clip(landscape.spacing_mm * longest_pt / size_mm, 3.0, most_pt))
    low, high = score_ends(found)
    draw_map(panel, world)
    levels = np.rint(63.0 * (scores - low) / (high - low)).astype(int)
    # A few shades, the best on top: one group of marks for each.
    shades = blended(np.linspace(0.0, 1.0, 64), HEAT_COLOURS)[:, :3].tolist()
    for level in np.unique(levels).tolist():
        colour = "#{:02x}{:02x}{:02x}".format(*shades[level])
        panel.marks(places[levels == level], "s", side_pt, Ink(fill=colour), rank=1.5)
    if bar:
        words = f"expected {found.task.name} score (simulated)"
        panel.bar = (words, low, high, HEAT_COLOURS)
    # The best headings at some places, the best places first.
    headings, taken = landscape.best_headings_rad[known], list[int]()
    for index in np.argsort(-scores, kind="stable").tolist():
        if len(taken) == MOST_ARROWS:
            break
        away = np.hypot(*(places[taken] - places[index]).T)
        if not (away < ARROWS_APART * size_mm).any():
            taken.append(index)
    reach_mm = _ARROW_PT * (panel.box[2] - panel.box[0]) / panel.width_pt
    ink = Ink(line=INK, width_pt=1.1, line_alpha=0.8)
    for index in taken:
        towards = np.array([np.cos(headings[index]), np.sin(headings[index])])
        panel.arrow(places[index], places[index] + reach_mm * towards, ink, 4.0, 4.0)
    _draw_best(panel, found, robot)
    return panel


def _draw_best(panel: Panel, found: AimResult, robot: AimedRobot) -> None:
    pose = robot.best.pose
    draw_pose(panel, pose, max(found.world.size_mm))
    panel.marks([(pose.x_mm, pose.y_mm)], "o", 13.0, Ink(line=ALERT, width_pt=1.8), rank=8.0)
    draw_targets(panel, robot.targets.outcomes if robot.targets else ())


def best_deployments_panel(
    found: AimResult, robot: AimedRobot, longest_pt: float = COLUMN_PT
) -> Panel:
    """Return the deployments from the best pose: one in full, the others as thin lines."""
    panel = plan_panel(found.world.bounds.bounds, longest_pt)
    draw_map(panel, found.world)
    draw_thin(panel, robot.shown[1:], Ink(line=SOFT, width_pt=0.6, line_alpha=0.35), 2.0)
    widths_mm = found.plan.options.drawn_widths_mm(robot.design.build.widths_mm)
    draw_deployment(panel, robot.shown[0], widths_mm)
    _draw_best(panel, found, robot)
    return panel


def turned_panel(robots: Sequence[AimedRobot]) -> Panel:
    """Return scores over the heading at each robot's best place, mean and worst to best tenth."""
    curves = []
    for robot in robots:
        scores = robot.turned.scores
        low, high = np.percentile(scores, [10.0, 90.0], axis=1)
        curves.append((robot.turned.headings_rad, scores.mean(axis=1), low, high))
    inner, outer = ends_of(*(values for one in curves for values in one[1:]))
    if min(float(one[2].min()) for one in curves) >= 0.0:
        inner = max(0.0, inner)
    reach = 1.22
    panel = Panel(
        box=(-reach, -reach, reach, reach), width_pt=COLUMN_PT + 24.0, height_pt=COLUMN_PT + 24.0,
        x_ticks=(), y_ticks=(),
    )  # fmt: skip

    def placed(angle: Floats, score: Floats) -> Floats:
        away = (np.asarray(score) - inner) / (outer - inner)
        return np.column_stack([away * np.cos(angle), away * np.sin(angle)])

    turns = np.linspace(0.0, 2.0 * np.pi, 121)
    faint = Ink(line=SOFT, width_pt=0.6, line_alpha=0.3)
    rim = np.column_stack([np.cos(turns), np.sin(turns)])
    panel.lines([rim], Ink(line=SOFT, width_pt=0.8), rank=0.0)
    for degrees in range(0, 360, 45):
        along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        panel.lines([np.array([(0.0, 0.0), along])], faint, rank=0.0)
        x, y = (1.12 * along).tolist()
        panel.words((x, y), f"{degrees}°", TICK_PT, colour=SOFT, anchor="middle")
    for value, words in round_ticks(inner, outer, 5):
        if value > inner:
            panel.lines([placed(turns, np.full(len(turns), value))], faint, rank=0.0)
            x, y = placed(np.array([np.radians(22.5)]), np.array([value]))[0].tolist()
            panel.words((x, y), words, TICK_PT, colour=SOFT, anchor="middle", halo=True)
    for index, (robot, (headings, mean, low, high)) in enumerate(zip(robots, curves, strict=True)):
        colour, around = series_colour(index), np.append(headings, headings[0])
        inside, outside, middle = (placed(around, np.append(v, v[0])) for v in (low, high, mean))
        # Even-odd: what lies between two closed curves.
        between = Shape([outside, inside], Ink(fill=colour, fill_alpha=0.18), closed=True)
        panel.add(between, 1.0)
        panel.line(middle, Ink(line=colour, width_pt=1.6), label=robot.name)
        best = robot.best
        at = np.array([best.pose.heading_rad] * 2)
        dotted = Ink(line=colour, width_pt=1.2, dash_pt=(1.2, 2.0))
        panel.line(placed(at, np.array([inner, best.mean])), dotted)
    return panel


def team_panel(found: AimResult, team: RobotSet, longest_pt: float = COLUMN_PT) -> Panel:
    """Return the cover of several robots together, each in a colour, and their bases by number."""
    panel = plan_panel(found.world.bounds.bounds, longest_pt)
    colours = [series_colour(index) for index in range(len(team.poses))]
    cover = team.cover
    if isinstance(cover, BodyCover | TipCover):
        # Which robot covers a cell first; none where no robot does.
        first = np.where(team.covered.any(axis=0), team.covered.argmax(axis=0), len(colours))
        rows, columns = cover.grid.free_mm2.shape
        shown = np.full(rows * columns, len(colours))
        shown[cover.grid.is_free] = first
        shades = [(*rgb(colour), 90) for colour in colours] + [(0, 0, 0, 0)]
        pixels = np.array(shades, dtype=np.uint8)[shown.reshape(rows, columns)[::-1]]
        x, y, side = cover.grid.box.tolist()
        panel.add(Raster((x, y, x + columns * side, y + rows * side), pixels), 0.5)
    elif isinstance(cover, TargetCover):
        draw_targets(panel, task_targets(found.task, found.world))
        for index, colour in enumerate(colours):
            reached = cover.targets_mm[team.covered[index]]
            panel.marks(reached, "o", 5.0, Ink(fill=colour), rank=6.5)
    draw_map(panel, found.world)
    for place, (deployment, colour) in enumerate(zip(team.shown, colours, strict=True), start=1):
        draw_thin(panel, [deployment], Ink(line=colour, width_pt=1.3), 4.0)
        base = (deployment.pose.x_mm, deployment.pose.y_mm)
        dot = Ink(fill=colour, line="#ffffff", width_pt=1.0)
        panel.add(Marks(np.array([base]), "o", 11.0, dot), 8.0)
        panel.add(Words(base, f"{place}", TICK_PT, "#ffffff", "middle"), 9.0)
    return panel


def union_panel(robots: Sequence[AimedRobot]) -> Panel:
    """Return the covered share over the number of robots, with intervals and bounds."""
    curves = {
        robot.name: np.array(union_curve(robot.team)).T
        for robot in robots
        if robot.team is not None
    }
    counts = max((rows[0] for rows in curves.values()), key=len)
    low, high = ends_of(counts)
    panel = Panel(
        box=(low, 0.0, high, 103.0),
        width_pt=COLUMN_PT,
        height_pt=COLUMN_PT,
        x_name="robots",
        y_name="covered together (%, simulated)",
        x_ticks=[(count, f"{count:g}") for count in counts.tolist()],
        frame=True,
    )
    for index, (name, (count, mean, low, high, bound)) in enumerate(curves.items()):
        colour = series_colour(index)
        panel.band(count, 100 * low, 100 * high, colour, 0.2)
        curve(panel, count, 100 * mean, colour, name)
        dashed = Ink(line=colour, width_pt=1.0, dash_pt=(4.0, 2.0))
        points = np.column_stack([count, 100 * bound])
        panel.line(points, dashed, label=f"no {name} set beats this")
    return panel


# --- One picture ----------------------------------------------------------------------------------


def aim_sheet(found: AimResult) -> Page:
    """Return the maps, the best deployments and the headings of all designs in one picture."""
    robots = found.robots
    plans = list[list[Panel]]([[], []])
    for robot in robots:
        first = landscape_panel(found, robot, bar=robot is robots[-1], longest_pt=PLAN_PT)
        best, (low, high) = robot.best, robot.best.interval
        first.title = (
            f"{robot.name} from {pose_text(best.pose)}\n"
            f"{best.mean:.3f} [{low:.3f}, {high:.3f}; {best.over}], "
            f"worst tenth {best.worst_tenth:.3f} (simulated)"
        )
        second = best_deployments_panel(found, robot, PLAN_PT)
        tried = counted(len(robot.shown), "deployment")
        second.title = f"{tried} from there, one in full (simulated)"
        plans[0].append(first)
        plans[1].append(second)
    teams = [robot.team for robot in robots if robot.team is not None]
    if teams:
        third = [team_panel(found, team, PLAN_PT) for team in teams]
        for panel in third:
            panel.title = "robots that together cover most, at one draw (simulated)"
        plans.append(third)
    for row in plans:
        for panel in row:
            panel.x_name = panel.y_name = ""
            panel.legend_shown = False
    last = [turned_panel(robots)]
    if teams and len(robots) > 1:
        last.append(union_panel(robots))
    return page_of_rows([*plans, last])
