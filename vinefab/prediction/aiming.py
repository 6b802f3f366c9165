"""Where to put a robot's base on a map, held against a plain vine: results, words and JSON."""

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import front_door
from vinefab.core.jsontext import json_text
from vinefab.core.rng import child
from vinefab.core.statistics import mean_interval
from vinefab.core.units import deg, rad
from vinefab.core.validation import Floats, number, whole
from vinefab.core.verbs import MOST_SEED
from vinefab.growth.options import (
    HALF_ANGLE_DEG,
    GrowthChoice,
    GrowthOptions,
    growth_text,
)
from vinefab.model.deployment import Deployment
from vinefab.model.design import ORIGIN_GROWTH, Build, Design
from vinefab.model.map import Map, Pose
from vinefab.model.tree import branch_tree
from vinefab.prediction.deploy import pose_text
from vinefab.prediction.family_deployments import ProgressCallback, no_progress, numbered_names
from vinefab.prediction.pose_search import (
    MOST_PLACING_DEG,
    MOST_PLACING_MM,
    PLACING_DEG,
    PLACING_MM,
    BaseRegion,
    DeploymentCounter,
    PoseErrors,
    PoseLandscape,
    PoseSearch,
    PoseTrial,
    nearest_places,
    printed_pose,
    search_poses,
)
from vinefab.prediction.provenance import Origin
from vinefab.prediction.robot_set import (
    FRESH_SET_DRAWS,
    GREEDY_SHARE,
    LARGEST_TEAM,
    SET_DRAWS,
    RobotSet,
    TeamSearch,
    union_curve,
)
from vinefab.tasks.covered_cells import Cover, cover_of
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.task import Task, check_on_map, search_form

AIM_SCHEMA = "vinefab/aim-1"

FEWEST_DEPLOYMENTS, MOST_DEPLOYMENTS = 5_000, 10_000_000

FRESH_DRAWS = 300
"""Draws that no choice has seen, for what is reported of a pose."""

WORST_SHARE = 0.1

PROFILE_HEADINGS, PROFILE_DRAWS = 72, 32
"""Headings at the best place, and draws at each, for the chart of headings."""

DEPLOYMENTS_PER_CANDIDATE, MOST_TEAM_CANDIDATES = 100, 3_000
"""Several robots are chosen from one pose for so many deployments of the search."""

SHOWN_DEPLOYMENTS = 24
"""Deployments from the best pose that are drawn."""

_FRESH, _SETS = 2001, 2002


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
        """The placing errors, in words."""
        return f"placed within {self.placing_mm:g} mm and {self.placing_deg:g} deg (assumed)"


def aim_growth(designs: Sequence[Design], given: Mapping[str, object] | None) -> GrowthChoice:
    """Return how designs are grown: over all that contacts may be like unless the user says."""
    choice = GrowthChoice.of(designs, given)
    if given and HALF_ANGLE_DEG in given:
        return choice
    angles_deg = choice.options.contact_angles_deg
    ends = (rad(angles_deg[0]), rad(angles_deg[-1]))
    return replace(choice, options=replace(choice.options, head_on_half_angle_rad=ends))


def plain_vine_of(design: Design) -> Design:
    """Return the plain vine of a design's trunk that is as long as all its branches together."""
    build = design.build
    origin = {key: value for key, value in design.origin.items() if key == ORIGIN_GROWTH}
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
        origin=origin,
    )


def held_against(
    design: Design, against: Design | None = None, *, alone: bool = False
) -> list[Design]:
    """Return a design and what it is held against: the plain vine of its length unless said."""
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
    def worst_tenth(self) -> float:
        """Mean of the worst tenth of the scores."""
        count = max(1, math.ceil(WORST_SHARE * len(self.scores)))
        return float(np.sort(self.scores)[:count].mean())

    def content(self) -> dict[str, object]:
        """Return it as it stands in JSON."""
        low, high = self.interval
        return {
            "pose": _pose_content(self.pose),
            "mean": _rounded(self.mean),
            "low": _rounded(low),
            "high": _rounded(high),
            "worst_tenth": _rounded(self.worst_tenth),
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
    notes: tuple[str, ...] = ()  # what a user should know, a sentence each

    @property
    def gain(self) -> tuple[float, float, float] | None:
        """Mean gain over the map's own start with its 95 % interval, paired draw by draw."""
        return None if self.start is None else paired_gain(self.best, self.start)


def paired_gain(one: PoseEstimate, other: PoseEstimate) -> tuple[float, float, float]:
    """Return the mean of one estimate minus another's, and its 95 % interval."""
    differences = one.scores - other.scores
    return float(differences.mean()), *mean_interval(differences)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AimResult:
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
        The design, and what it is held against.
    notes
        What a user should know, a sentence each.
    origin
        What it takes to get the result again.
    """

    world: Map
    task: Task
    plan: AimPlan
    robots: tuple[AimedRobot, ...]
    notes: tuple[str, ...] = ()
    origin: Origin | None = None

    def json_text(self) -> str:
        """Return the result as JSON: ``vinefab/aim-1``."""
        return aim_text(self, self.origin)

    def __repr__(self) -> str:
        return f"<AimResult {self.first.name} on {self.world.name}: {pose_text(self.pose)}>"

    def _repr_html_(self) -> str:
        """Show what was found, and a robot grown from the best pose, in a notebook."""
        shown: str = front_door().html_of(self)
        return shown

    @property
    def first(self) -> AimedRobot:
        """The design that was asked about."""
        return self.robots[0]

    @property
    def pose(self) -> Pose:
        """The best robust pose."""
        return self.first.best.pose

    @property
    def poses(self) -> tuple[Pose, ...]:
        """The poses of the robots that together cover most; the best pose for one robot."""
        team = self.first.team
        return (self.pose,) if team is None else tuple(pose_of(row) for row in team.poses)

    @property
    def region(self) -> str:
        """Where bases may stand, in words."""
        return f"base {self.first.search.words}"

    @property
    def mean(self) -> float:
        """Expected score from the best pose, at fresh draws (simulated)."""
        return self.first.best.mean

    @property
    def summary(self) -> tuple[str, ...]:
        """The result, a line each."""
        return tuple(aim_lines(self))


def pose_of(row: Floats) -> Pose:
    """Return the pose of a row of `printed_pose`: what is printed is what was tried."""
    x_mm, y_mm, heading_rad = (float(value) for value in row)
    return Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=heading_rad)


def aim_robots(
    designs: Sequence[Design],
    world: Map,
    task: Task,
    plan: AimPlan,
    progress: ProgressCallback = no_progress,
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
    progress(0.0, "preparing the map")
    prepared = PreparedMap.of(world)
    check_on_map(task, world, prepared.context)
    cover = cover_of(search_form(task), prepared.context) if plan.robots > 1 else None
    names = numbered_names([design.name for design in designs])
    robots = list[AimedRobot]()
    with ThreadPoolExecutor(workers or min(8, os.cpu_count() or 1)) as pool:
        for index, (name, design) in enumerate(zip(names, designs, strict=True)):
            trial = PoseTrial.of(design, prepared, plan.options, pool.map)
            tell = _counted(progress, name, index, len(designs), plan)
            robots.append(_aimed(name, trial, task, plan, cover, tell))
    notes = [note for robot in robots for note in robot.notes]
    if not world.starts:
        notes.append("the map has no start of its own to compare with")
    return AimResult(world=world, task=task, plan=plan, robots=tuple(robots), notes=tuple(notes))


def _counted(
    progress: ProgressCallback, name: str, index: int, count: int, plan: AimPlan
) -> DeploymentCounter:
    """Return what tells the share of the work that is done from numbers of deployments."""
    expected = plan.deployments + 2 * FRESH_DRAWS + PROFILE_HEADINGS * PROFILE_DRAWS
    if plan.robots > 1:
        expected += plan.candidates * SET_DRAWS + plan.robots * FRESH_SET_DRAWS
    done = 0

    def tell(more: int) -> None:
        nonlocal done
        done += more
        share = min(1.0, done / expected)
        progress((index + share) / count, f"{name}: {done:,} deployments")

    return tell


def _aimed(
    name: str,
    trial: PoseTrial,
    task: Task,
    plan: AimPlan,
    cover: Cover | None,
    tell: DeploymentCounter,
) -> AimedRobot:
    region = BaseRegion.of(trial, plan.where)
    found = search_poses(trial, search_form(task), region, plan.errors, plan.deployments, tell)
    fresh = plan.errors.drawn(FRESH_DRAWS, child(plan.seed, _FRESH))
    best = pose_of(printed_pose(trial, found.pose))
    starts = [start.pose for start in trial.prepared.world.starts[:1]]
    rows = np.array([(p.x_mm, p.y_mm, p.heading_rad) for p in (best, *starts)])
    # What is reported is scored as `vinefab score` does, not by the search's approximation.
    scores = trial.scores(task, rows, fresh, tell)
    estimates = [
        PoseEstimate(pose=pose, scores=row)
        for pose, row in zip((best, *starts), scores, strict=True)
    ]
    headings = 2.0 * math.pi * np.arange(PROFILE_HEADINGS) / PROFILE_HEADINGS
    around = np.column_stack([np.tile(found.pose[:2], (PROFILE_HEADINGS, 1)), headings])
    even = plan.errors.even(PROFILE_DRAWS)
    team = None
    if cover is not None:
        team = TeamSearch(trial=trial, cover=cover, errors=plan.errors, tell=tell).choose(
            found.landscape, found.pose, plan.robots, plan.candidates, child(plan.seed, _SETS)
        )
    return AimedRobot(
        name=name,
        design=trial.design,
        search=found,
        best=estimates[0],
        start=estimates[1] if starts else None,
        turned=TurnedScores(
            headings_rad=headings, scores=trial.scores(search_form(task), around, even, tell)
        ),
        shown=tuple(trial.deployments(rows[0], fresh.part(0, SHOWN_DEPLOYMENTS))),
        team=team,
        notes=tuple(note for start in starts for note in _start_notes(name, trial, start)),
    )


def _start_notes(name: str, trial: PoseTrial, start: Pose) -> tuple[str, ...]:
    """Return by how much a start without room for the trunk was moved; nothing if there is room."""
    place = np.array([[start.x_mm, start.y_mm]])
    if trial.prepared.terrain.have_room(place, trial.radius_mm)[0]:
        return ()
    away_mm = float(np.hypot(*(nearest_places(trial.room, place) - place)[0]))
    return (
        f"the trunk of {name} has no room at the map's start: there it begins {away_mm:.1f} mm "
        "aside, at the nearest place with room",
    )


# --- In words and as JSON -----------------------------------------------------------------------


def aim_lines(found: AimResult) -> list[str]:
    """Return the result as lines for the user."""
    plan, first = found.plan, found.first
    growth = growth_text(plan.options, [robot.design for robot in found.robots])
    lines = [
        f"best robust pose of {first.name} on {found.world.name}: {pose_text(found.pose)}",
        f"expected {found.task.name} score: mean over {FRESH_DRAWS} fresh deployments (simulated), "
        f"{plan.placing_text}, {found.region}",
        f"growth: {growth}",
        *found.notes,
    ]
    for robot in found.robots:
        lines += _robot_lines(robot)
    if len(found.robots) > 1:
        for other in found.robots[1:]:
            gain = _interval_text(*paired_gain(first.best, other.best))
            lines.append(f"{first.name} minus {other.name}, each at its best pose: {gain}")
    for robot in found.robots:
        lines += _team_lines(robot)
    return lines


def _robot_lines(robot: AimedRobot) -> list[str]:
    best, found = robot.best, robot.search
    low, high = best.interval
    lines = [
        f"  {robot.name} from {pose_text(best.pose)}: {best.mean:.4f} [{low:.4f}, {high:.4f}], "
        f"worst tenth {best.worst_tenth:.4f}; the search's own estimate "
        f"{found.estimate:.4f} (the best of many in {found.deployments:,} deployments: biased)"
    ]
    if robot.start is not None and robot.gain is not None:
        lines.append(
            f"    from the map's start {pose_text(robot.start.pose)}: {robot.start.mean:.4f}, "
            f"worst tenth {robot.start.worst_tenth:.4f}; gain {_interval_text(*robot.gain)}"
        )
    return lines


def _team_lines(robot: AimedRobot) -> list[str]:
    if robot.team is None:
        return []
    team = robot.team
    lines = [
        f"{len(team.poses)} robots {robot.name} that together cover most of: {team.cover.words} "
        f"(mean over fresh deployments, simulated; chosen among {team.candidates:,} poses)"
    ]
    for row, (count, mean, low, high, _) in zip(team.poses, union_curve(team), strict=True):
        lines.append(
            f"  {count}: {pose_text(pose_of(row))}  together {100 * mean:.1f} % "
            f"[{100 * low:.1f}, {100 * high:.1f}]"
        )
    lines.append(
        f"  chosen greedily: at least {100 * GREEDY_SHARE:.0f} % of what the best "
        f"{len(team.poses)} of these poses cover (1 - 1/e), and by this case's own bound at least "
        f"{team.least_percent:.1f} %"
    )
    return lines


def _interval_text(mean: float, low: float, high: float) -> str:
    return f"{mean:+.4f} [{low:+.4f}, {high:+.4f}]"


def aim_text(found: AimResult, origin: Origin | None) -> str:
    """Return the result as JSON."""
    plan = found.plan
    content = {
        "standing": {
            "scores": "simulated",
            "placing": "assumed",
            "contacts": plan.options.contact_angles_standing,
        },
        "task": found.task.name,
        "task_parameters": _parameters(found.task),
        "map": found.world.name,
        "where": plan.where,
        "placing_mm": plan.placing_mm,
        "placing_deg": plan.placing_deg,
        "seed": plan.seed,
        "growth": plan.options.content,
        "notes": list(found.notes),
        "pose": _pose_content(found.pose),
        "robots": [_robot_content(robot, found.first) for robot in found.robots],
        "reproduce": asdict(origin) if origin else None,
    }
    return json_text(AIM_SCHEMA, content)


def _parameters(task: Task) -> dict[str, object]:
    names = getattr(task, "__dataclass_fields__", {})
    values = {name: getattr(task, name) for name in names}
    return {
        name: value
        for name, value in values.items()
        if isinstance(value, bool | int | float | str | tuple)
    }


def _robot_content(robot: AimedRobot, first: AimedRobot) -> dict[str, object]:
    found = robot.search
    content: dict[str, object] = {
        "design": robot.name,
        "branches": robot.design.branch_count,
        "length_mm": round(branch_tree(robot.design).total_length_mm, 3),
        "deployments": found.deployments,
        "best": robot.best.content(),
        "search_mean": _rounded(found.estimate),
        "search_draws": found.draws,
        "start": None if robot.start is None else robot.start.content(),
        "gain_over_start": _gain_content(robot.gain),
        "first_minus_this": None
        if robot is first
        else _gain_content(paired_gain(first.best, robot.best)),
        "landscape": _landscape_content(found.landscape),
        "headings_at_best": {
            "heading_deg": [round(deg(value), 2) for value in robot.turned.headings_rad],
            "mean": [_rounded(value) for value in robot.turned.scores.mean(axis=1)],
        },
        "together": None if robot.team is None else _team_content(robot.team),
    }
    return content


def _gain_content(gain: tuple[float, float, float] | None) -> dict[str, object] | None:
    if gain is None:
        return None
    return {
        name: _rounded(value) for name, value in zip(("mean", "low", "high"), gain, strict=True)
    }


def _landscape_content(found: PoseLandscape) -> dict[str, object]:
    """Return the map of expected scores: a row of scores over the headings for each place."""
    return {
        "draws": found.draws,
        "spacing_mm": round(found.spacing_mm, 3),
        "heading_deg": [round(deg(value), 2) for value in found.headings_rad],
        "places_mm": [[round(value, 2) for value in place] for place in found.places_mm.tolist()],
        "mean": [[_rounded(value) for value in row] for row in found.scores.tolist()],
    }


def _team_content(team: RobotSet) -> dict[str, object]:
    return {
        "covered": team.cover.words,
        "candidates": team.candidates,
        "poses": [_pose_content(pose_of(row)) for row in team.poses],
        "robots": [
            {
                "count": count,
                "share": _rounded(mean),
                "low": _rounded(low),
                "high": _rounded(high),
                "search_share": _rounded(share),
                "search_bound": _rounded(bound),
            }
            for (count, mean, low, high, bound), share in zip(
                union_curve(team), team.choice.covered, strict=True
            )
        ],
        "least_share_of_best": {
            "always": round(GREEDY_SHARE, 4),
            "here": _rounded(team.least_share),
        },
    }


def _pose_content(pose: Pose) -> dict[str, object]:
    return {
        "x_mm": pose.x_mm,
        "y_mm": pose.y_mm,
        "heading_deg": round(pose.heading_deg, 2),
        "text": pose_text(pose),
    }


def _rounded(value: float) -> float | None:
    return round(float(value), 5) if math.isfinite(value) else None
