"""Where to put a robot's base on a map, held against a plain vine."""

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vinefab.core.errors import UnfitInputError
from vinefab.core.limits import deg, rad
from vinefab.core.plain_text import counted
from vinefab.core.progress import each, phase
from vinefab.core.registry import parameter_values
from vinefab.core.rng import child
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
    bracketed,
)
from vinefab.growth.options import HALF_ANGLE_DEG, GrowthChoice, growth_text
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose
from vinefab.model.target import TargetsResult
from vinefab.pages.panel import Page
from vinefab.pages.plan import page_bytes
from vinefab.prediction.aim_pictures import (
    aim_sheet,
    aim_svg,
    best_deployments_panel,
    landscape_panel,
    team_panel,
    turned_panel,
    union_panel,
)
from vinefab.prediction.aimed_robot import (
    AimedRobot,
    AimPlan,
    Aims,
    PoseEstimate,
    TurnedScores,
    TypedPose,
)
from vinefab.prediction.family_deployments import names_apart
from vinefab.prediction.pose_search import (
    BaseRegion,
    PoseTrial,
    nearest_places,
    pose_of,
    printed_pose,
    search_poses,
)
from vinefab.prediction.robot_set import (
    FRESH_SET_DRAWS,
    GREEDY_SHARE,
    SET_DRAWS,
    TeamSearch,
    union_curve,
)
from vinefab.tasks.areas import Cover
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.reach import task_targets, touched_targets
from vinefab.tasks.task import Task, check_on_map, cover_of, search_form

FRESH_DRAWS = 300
"""Draws that no choice has seen, for the values that are reported of a pose."""

PROFILE_HEADINGS, PROFILE_DRAWS = 72, 32
"""Headings at the best place, and draws at each, for the chart of headings."""

SHOWN_DEPLOYMENTS = 24
"""Deployments from the best pose that are drawn."""

_FRESH, _SETS = 2001, 2002
_PLAIN = (bool, int, float, str, tuple)


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
        trunk_length_mm=design.tree.total_length_mm,
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
        raise UnfitInputError(
            "--alone", "is given together with --against", "leave one of them out"
        )
    if against is not None:
        return [design, against]
    return [design] if alone or design.branch_count == 1 else [design, plain_vine_of(design)]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class AimResult(Result, Aims):
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
        gains = [(f"over {other.name}", best.above(other.best)) for other in self.robots[1:]]
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
            image=partial(aim_svg, landscape_panel, self, first),
            caption=f"Expected score of {counted(len(first.search.landscape.places_mm), 'place')}, "
            "each at the best of its headings (arrows); ring: the best pose found (simulated).",
            file="landscape",
        )
        yield Picture(
            image=partial(aim_svg, best_deployments_panel, self, first),
            caption=f"{counted(len(first.shown), 'deployment')} from there with contacts and "
            "placing errors, one in full (simulated).",
            file="best_pose",
        )
        yield Picture(
            image=partial(aim_svg, turned_panel, self.robots),
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
                        Number(gain.mean, form="+.4f"),
                        detail=f"{self._ends((gain.low, gain.high), '+')}, paired draw by draw",
                        tone="plain" if gain.low > 0.0 else "caution",
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
                "pose": TypedPose.of(self.pose).content,
            }
        )
        yield Data(lambda: {"robots": [one.numbers(first).content for one in self.robots]})
        yield from self._sections()

    def _ends(self, interval: Sequence[float], sign: str = "") -> str:
        low, high = (f"{end:{sign}z.4f}" for end in interval)
        return bracketed((low, high), self.first.best.over)

    def _sections(self) -> Iterator[Section]:
        """Yield the other pictures, and how the pose was found."""
        plan, first = self.plan, self.first
        others = [
            Picture(
                image=partial(aim_svg, landscape_panel, self, robot),
                caption=f"{robot.name}: expected score of its places. Ring: its best robust pose, "
                f"{robot.best.pose.text} (simulated).",
            )
            for robot in self.robots[1:]
        ]
        grown = [
            Picture(
                image=partial(aim_svg, best_deployments_panel, self, robot),
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
                image=partial(aim_svg, team_panel, self, robot.team),
                caption=f"{robot.name}: {robot.team.cover.words}; each robot's colour where it is "
                "the first to cover, at one fresh draw (simulated).",
            )
            for robot in self.robots
            if robot.team is not None
        ]
        if teams:
            union = Picture(
                image=partial(aim_svg, union_panel, self.robots),
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
        return page_bytes(self.drawing(), suffix)

    def drawing(self) -> Page:
        """Return the same as a page."""
        return aim_sheet(self)

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
