"""Answers that follow the pointer: growth on the open map, and scores."""

import asyncio
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point, Polygon

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM, number
from vinefab.growth.batch import Engine, grow_on
from vinefab.growth.options import GrowthChoice, GrowthOptions, growth_text
from vinefab.growth.terrain import Terrain
from vinefab.inflation.pattern import pattern_of
from vinefab.maps.generators.pegs import PegsOptions, pegs_map
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import ORIGIN_GROWTH, Build, Design, Level
from vinefab.model.map import Map, Pose
from vinefab.model.score import IDEAL_CASE
from vinefab.pages.plan import STOP_WORDS
from vinefab.pages.plan_svg import (
    frame_svg,
    ground_svg,
    pose_svg,
    robot_svg,
    shape_path,
    targets_svg,
    view_box,
)
from vinefab.prediction.deploy import DeployedDesign, places_text, stayed_text, wedged, without_room
from vinefab.prediction.measures import worst_pressures_of
from vinefab.studio.chosen_branch import chosen_branch, labels_of
from vinefab.studio.state import PAGE, EditedMap, StudioState
from vinefab.tasks import TASKS, make_task
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.reach import touched_targets
from vinefab.tasks.task import check_on_map, evaluated

_ENGINE: list[Engine] = ["interpreted"]


def current_engine() -> Engine:
    """Return the engine for a growth that a pointer waits for.

    The first growths are interpreted. Meanwhile `compile_kernel` compiles the simulator, once on
    every computer.
    """
    return _ENGINE[0]


def load_kernel() -> None:
    """Grow a small robot with the compiled simulator; afterwards `current_engine` returns it."""
    levels = (Level.of(branches=2, length_mm=40.0, angle_deg=90.0),)
    design = Design(name="small", trunk_length_mm=40.0, levels=levels, build=Build.standard(2))
    place = PreparedMap.of(pegs_map(1, PegsOptions()))
    start = place.world.starts[0].pose
    grown = grow_on(design, place.terrain, start, GrowthOptions(), engine="kernel")
    for task in (name for name in TASKS if name not in TASKS.packages):
        evaluated(make_task(task, {}), grown, place.context)
    _ENGINE[0] = "kernel"


async def compile_kernel() -> bool:
    """Compile in another process, then load the result in a thread; return whether it could.

    Without it growths stay interpreted: slower, with the same results.
    """
    compiling = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        "from vinefab.studio.live_answers import load_kernel; load_kernel()",
        stdin=asyncio.subprocess.DEVNULL,
    )
    try:
        code = await compiling.wait()
    except asyncio.CancelledError:
        compiling.kill()
        raise
    if code == 0:
        await asyncio.to_thread(load_kernel)
    return code == 0


_SLACK = 1.25
"""Obstacles so much farther than a branch grows are taken too: with them it may start elsewhere."""

_LAST_NEAR: dict[tuple[str, int], NDArray[np.bool_]] = {}
"""The obstacles near the robot at the last growth on a map of some name and count: a first guess.

A guess that is too large costs time; one that is too small, a second growth. No result depends on
it.
"""


def prepared_map(state: StudioState) -> PreparedMap:
    """Return the open map with all that growth and tasks need of it."""
    if state.ground is None or state.world is None:
        raise ValueError("no map is open")
    found = _prepared(state.ground)
    targets = state.world.targets  # of the page: moving one leaves the ground as it is
    return replace(found, world=state.world, context=replace(found.context, targets=targets))


@lru_cache(maxsize=64)
def _prepared(ground: EditedMap) -> PreparedMap:
    return PreparedMap.of(ground.world)


_Grown = tuple[Deployment, Terrain]

_LAST_GROWN: list[tuple[tuple[object, ...], _Grown]] = []
"""The last growth after all that it depends on: a tip is dragged from where it was shown."""


def grown(state: StudioState, start: Pose) -> _Grown:
    """Return the deployment from a start, and a terrain with every obstacle that it meets."""
    of = state.ground, start, state.growth, current_engine(), state.profile, state.design
    if not _LAST_GROWN or _LAST_GROWN[0][0] != of:
        _LAST_GROWN[:] = [(of, _grown_anew(state, start))]
    return _LAST_GROWN[0][1]


def _grown_anew(state: StudioState, start: Pose) -> _Grown:
    """Return the same, simulated.

    Building walls for every body radius takes time with every obstacle of a map, far more than
    growing. So obstacles are left out that no branch could come to, however it turned: those
    farther from its base than it grows. Where fewer obstacles make it grow farther, it is grown
    again with those that it comes to; those of the last growth are the first guess.
    """
    world, design, options = state.world, state.grown_now, state.growth
    if world is None:
        raise ValueError("no map is open")
    tree = shapely.STRtree(world.obstacles)
    tolerance_mm = _terrain(world.name, world.bounds, ()).tolerance_mm
    body_mm = options.radius_mm(float(design.tree.width_mm.max())) + tolerance_mm
    map_key = world.name, len(world.obstacles)
    near = _LAST_NEAR.get(map_key, np.zeros(len(world.obstacles), dtype=np.bool_)).copy()
    near[tree.query(Point(start.x_mm, start.y_mm), "dwithin", body_mm)] = True
    while True:
        obstacles = tuple(world.obstacles[index] for index in np.flatnonzero(near).tolist())
        terrain = _terrain(world.name, world.bounds, obstacles)
        deployment = grow_on(design, terrain, start, options, engine=current_engine())
        out = np.flatnonzero(deployment.deployed)
        bases = shapely.points(deployment.points_mm[deployment.first_point[:-1][out]])
        reach_mm = deployment.grown_mm[out] + body_mm
        wider = np.zeros_like(near)
        wider[tree.query(bases, "dwithin", _SLACK * reach_mm)[1]] = True
        is_whole = near[tree.query(bases, "dwithin", reach_mm)[1]].all()
        if is_whole:
            _LAST_NEAR.clear()
            _LAST_NEAR[map_key] = near if near.sum() <= 2 * wider.sum() else wider
            return deployment, terrain
        near |= wider


@lru_cache(maxsize=32)
def _terrain(name: str, bounds: Polygon, obstacles: tuple[Polygon, ...]) -> Terrain:
    return Terrain.of(Map(name=name, bounds=bounds, obstacles=obstacles))


MOST_LIVE_INTERPRETED = 1500
"""More branches than this grow once the simulator is compiled: interpreted they take a second."""


COMPILED_TASKS = ("anchoring",)
"""Tasks that cannot be scored before code is compiled."""


def live_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return growth and scores of the open design.

    Parameters
    ----------
    ask
        ``have``: key of the ground that the page shows; ``ground = false`` and ``scores = false``
        while an obstacle is dragged: the page keeps its old ones; ``obstacle``: index of the one
        that is chosen, which is drawn for itself; ``branch``: what `labels_of` calls the one that
        is chosen.
    """
    growth = {
        "values": state.growth.values,
        "usual": GrowthChoice.of([state.design]).options.values,
        "trained": bool(state.design.origin.get(ORIGIN_GROWTH)),
        "text": growth_text(state.growth, [state.design]),
    }
    ids, names = state.design.tree.ids, state.design.names
    answer: dict[str, Any] = {
        "engine": current_engine(),
        "growth": growth,
        "names": dict(zip(ids, names, strict=True)) if names else {},
    }
    if state.world is None or state.ground is None:
        found = _with_branch({"facts": _planned(state.design)}, state, ask)
        return {**answer, "ground_key": "", **found}
    key, index, chosen = state.ground.key, ask.get("obstacle"), None
    if type(index) is int and 0 <= index < len(state.ground.world.obstacles):
        frame = state.ground.frame(index)
        chosen = {
            "index": index,
            "frame": frame.content,
            "path": shape_path(state.ground.world.obstacles[index]),
            "svg": frame_svg(frame.place_mm),
        }
    wanted = ask.get("ground", True) and ask.get("have") != key
    answer |= {
        "ground_key": key,
        "ground_svg": ground_svg(state.world) if wanted else None,
        "view_box": view_box(state.world.bounds.bounds, 0.03 * max(state.world.size_mm)),
        "targets": [target.content for target in state.world.targets],
        "targets_svg": targets_svg(state.world.targets),
        "obstacle": chosen,
        "source": _of_source(state.ground, len(state.world.obstacles)),
    }
    grown_answer, deployment = _grown(state, state.world, with_scores=bool(ask.get("scores", True)))
    return answer | _with_branch(grown_answer, state, ask, deployment)


def _with_branch(
    answer: dict[str, Any],
    state: StudioState,
    ask: Mapping[str, Any],
    deployment: Deployment | None = None,
) -> dict[str, Any]:
    """Return an answer with the branch that is chosen, if it is still there."""
    label = ask.get("branch")
    if not isinstance(label, str) or label not in labels_of(state.design):
        return {**answer, "branch": None}
    return {**answer, "branch": chosen_branch(state.design, deployment, label)}


def _of_source(ground: EditedMap, count: int) -> dict[str, Any]:
    """Return what a map is before the page changes it: what edits of the page start from."""
    starts = ground.world.starts
    return {
        "pose": starts[0].pose.content if starts else None,
        "targets": [target.content for target in ground.world.targets],
        "obstacles": count - ground.more,
    }


def _grown(
    state: StudioState, world: Map, *, with_scores: bool
) -> tuple[dict[str, Any], Deployment | None]:
    start = state.start
    if start is None:
        return _not_grown(state.design, "the map has no start: put one on it"), None
    place = {
        "pose": start.content,
        "pose_svg": pose_svg(start, 0.055 * max(world.size_mm)),
    }
    if problem := not_followed(state.design):
        return place | _not_grown(state.design, problem), None
    try:
        deployment, _ = grown(state, start)
    except BadInputError as error:
        return place | _not_grown(state.design, str(error)), None
    answer: dict[str, Any] = {**place}
    if (found := touched_targets([(deployment, world)])) is not None:
        states = [outcome.state for outcome in found.outcomes]
        answer |= {
            "targets": [
                {**content, "state": state}
                for content, state in zip(found.content, states, strict=True)
            ],
            "targets_svg": targets_svg(world.targets, states),
            "targets_headline": found.headline,
            "targets_tone": found.tone,
        }
    lost = without_room(deployment, state.growth)
    is_cut_as_designed = state.design.build.compensation == "none"
    unknown = [
        f"{joint.name}: grown at its designed angles; no table gives its deployed angles"
        for joint in (
            pattern_of(state.design, state.profile, known_only=True).joints
            if is_cut_as_designed
            else ()
        )
        if joint.found is None
    ]
    needed_kpa = float(worst_pressures_of([deployment])[0, 0])
    answer |= {
        "robot_svg": robot_svg(deployment, state.growth.drawn_widths_mm(deployment.tree)),
        "front_full_mm": deployment.full_mm,
        "facts": {
            "branches": len(deployment.tree),
            "deployed": int(deployment.deployed.sum()),
            "grown_mm": float(deployment.grown_mm.sum()),
            "planned_mm": deployment.tree.total_length_mm,
            "text": _grown_text(deployment),
            "pressure_needed_kpa": None if math.isnan(needed_kpa) else needed_kpa,
        },
        "problems": [
            *unknown,
            *stayed_text([bool(deployment.deployed[0])], state.design, state.growth),
            *places_text("no room to start", lost),
            *places_text("stopped in a corner", wedged(deployment, state.growth)),
        ],
    }
    scores = _scores(deployment, prepared_map(state)) if with_scores else {}
    return answer | scores, deployment


def not_followed(design: Design) -> str:
    """Return the reason not to grow a design while a pointer waits, or an empty text."""
    most_followed = 5000  # the exact scores of a robot with more branches take several seconds
    if design.branch_count > most_followed:
        return (
            f"{counted(design.branch_count, 'branch')}: the page follows designs of at most "
            f"{most_followed};"
            " vinefab grow DESIGN --map MAP grows them all"
        )
    if design.branch_count > MOST_LIVE_INTERPRETED and current_engine() != "kernel":
        return (
            f"{counted(design.branch_count, 'branch')}: growth follows as soon as the simulator "
            "is compiled,"
            " once on this computer"
        )
    return ""


def _not_grown(design: Design, problem: str) -> dict[str, Any]:
    nothing = dict.fromkeys(TASKS.names())
    return {
        "robot_svg": "", "front_full_mm": 0.0, "scores": nothing, "facts": _planned(design),
        "problems": [problem], "unscored": [],
    }  # fmt: skip


def _scores(deployment: Deployment, prepared: PreparedMap) -> dict[str, Any]:
    """Return score and title of each task (simulated), None where a map has none, and why."""
    scores: dict[str, Any] = {}
    titles: dict[str, str] = {}
    unscored = []
    for name in TASKS.names():
        if name in COMPILED_TASKS and current_engine() != "kernel":
            scores[name] = None
            unscored.append(f"{name}: as soon as the simulator is compiled, once on this computer")
            continue
        try:
            task = _task(name)
            check_on_map(task, prepared.world, prepared.context)
            scores[name], terms = evaluated(task, deployment, prepared.context)
            titles[name] = f"{name}, ideal case" if terms.get(IDEAL_CASE) else name
        except VinefabError as error:
            scores[name] = None
            unscored.append(f"{name}: {error}")
    return {"scores": scores, "titles": titles, "unscored": unscored}


def _planned(design: Design) -> dict[str, Any]:
    return {"branches": design.branch_count, "text": counted(design.branch_count, "branch")}


def _grown_text(deployment: Deployment) -> str:
    """Return the share of the planned length that grew, and where the rest was lost."""
    tree, stop = deployment.tree, deployment.stop
    lost_mm = tree.length_mm - deployment.grown_mm
    planned_m = tree.total_length_mm / 1000.0
    share = 100.0 * float(deployment.grown_mm.sum()) / tree.total_length_mm
    text = (
        f"{int(deployment.deployed.sum())} of {counted(len(tree), 'branch')} out, "
        f"{share:.0f} % of {planned_m:.2f} m grown"
    )
    parts = [
        f"{lost_mm[stop == kind].sum():.0f} mm of {counted(int((stop == kind).sum()), 'branch')} "
        f"{STOP_WORDS[kind]}"
        for kind in Stop
        if kind != Stop.FULL_LENGTH and (stop == kind).any()
    ]
    return f"{text}; missing: {', '.join(parts)}" if parts else text


_task = cache(make_task)


def deployed_robot(state: StudioState) -> DeployedDesign:
    """Return the robot on the open map (simulated)."""
    if state.world is None or state.start is None:
        raise BadInputError("map", None, "a map with a start", PAGE)
    if problem := not_followed(state.design):
        raise VinefabError(problem)
    final, terrain = grown(state, state.start)
    return DeployedDesign(
        design=state.grown_now,
        world=state.world,
        terrain=terrain,
        options=state.growth,
        deployment=final,
    )


def front_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the robot at a front length (simulated); from the full length on, the whole robot.

    The page could cut the final shape to length by itself, but a tip that slides along a wall turns
    the stretch behind it: the final shape does not show where that lay.

    Parameters
    ----------
    ask
        ``front_mm``: way along the body from the base to the growing tips.
    """
    history = deployed_robot(state).history
    given: Any = ask.get("front_mm")
    front_mm = number("front_mm", given, 1e-6, LARGEST_MM, "mm")
    frame = history.at(front_mm, engine=current_engine())
    widths_mm = state.growth.drawn_widths_mm(frame.deployment.tree)
    return {
        "front_mm": frame.front_mm,
        "full_mm": history.full_mm,
        "robot_svg": robot_svg(frame.deployment, widths_mm, is_growing=frame.is_growing),
    }
