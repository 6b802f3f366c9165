"""What follows the pointer: the robot grown on the open map, and its scores."""

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.plain_text import counted
from vinefab.growth.options import GrowthChoice, growth_text
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import ORIGIN_GROWTH, Design, UnevenLevel
from vinefab.model.map import Map
from vinefab.model.score import IDEAL_CASE
from vinefab.pages.map_view import STOP_WORDS
from vinefab.pages.plan_svg import (
    frame_svg,
    ground_svg,
    pose_svg,
    robot_svg,
    shape_path,
    targets_svg,
    view_box,
)
from vinefab.physics.tube import inflated_radius_mm
from vinefab.prediction.deploy import places_text, stayed_text, wedged, without_room
from vinefab.prediction.measures import worst_pressures_of
from vinefab.studio.edited_map import Ground
from vinefab.studio.panels import Tell
from vinefab.studio.scene import grown, prepared_map
from vinefab.studio.state import StudioState
from vinefab.studio.warming import engine_now
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.shipped_tasks import TASKS, make_task
from vinefab.tasks.targets import touched_targets
from vinefab.tasks.task import Task, check_on_map

MOST_LIVE_INTERPRETED = 1500
"""More branches than this grow once the simulator is compiled: interpreted they take a second."""

MOST_FOLLOWED = 5000
"""The exact scores of a robot with more branches take several seconds."""

COMPILED_TASKS = ("anchoring",)
"""Tasks that cannot be scored before code is compiled."""


def live_answer(state: StudioState, ask: Mapping[str, Any], _: Tell) -> dict[str, Any]:
    """Return growth and scores of what is open.

    Parameters
    ----------
    ask
        ``have``: key of the ground that the page shows; ``ground = false`` and ``scores = false``
        while an obstacle is dragged: the page keeps what it has; ``obstacle``: index of the one
        that is chosen, which is drawn for itself.
    """
    answer: dict[str, Any] = {"engine": engine_now(), "growth": _growth(state)}
    if state.world is None or state.ground is None:
        return {**answer, "ground_key": "", "facts": _planned(state.design)}
    key = state.ground.key
    wanted = ask.get("ground", True) and ask.get("have") != key
    answer |= {
        "ground_key": key,
        "ground_svg": ground_svg(state.world) if wanted else None,
        "view_box": view_box(state.world.bounds.bounds, 0.03 * max(state.world.size_mm)),
        "map_size_mm": list(state.world.size_mm),
        "targets": [target.content for target in state.world.targets],
        "targets_svg": targets_svg(state.world.targets),
        "obstacle": _obstacle(state.ground, ask.get("obstacle")),
    }
    return answer | _grown(state, state.world, with_scores=bool(ask.get("scores", True)))


def _obstacle(ground: Ground, index: object) -> dict[str, Any] | None:
    """Return frame and drawing of the obstacle that is chosen."""
    if type(index) is not int or not 0 <= index < len(ground.world.obstacles):
        return None
    frame = ground.frame(index)
    return {
        "index": index,
        "frame": frame.content,
        "path": shape_path(ground.world.obstacles[index]),
        "svg": frame_svg(frame.place_mm),
    }


def _grown(state: StudioState, world: Map, *, with_scores: bool) -> dict[str, Any]:
    start = state.start
    if start is None:
        return _not_grown(state.design, "the map has no start: put one on it")
    place = {
        "pose": {"x_mm": start.x_mm, "y_mm": start.y_mm, "heading_deg": start.heading_deg},
        "pose_svg": pose_svg(start, 0.055 * max(world.size_mm)),
    }
    if problem := not_followed(state.design):
        return place | _not_grown(state.design, problem)
    try:
        deployment, _ = grown(state, start)
    except BadInputError as error:
        return place | _not_grown(state.design, str(error))
    widths_mm = state.growth.drawn_widths_mm(state.design.build.widths_mm)
    return (
        place
        | _touched(deployment, world)
        | {
            "robot_svg": robot_svg(deployment, widths_mm),
            "front_full_mm": deployment.full_mm,
            "facts": _facts(state.design, deployment),
            "problems": _troubles(state, deployment),
        }
        | (_scores(deployment, prepared_map(state)) if with_scores else {})
    )


def _touched(deployment: Deployment, world: Map) -> dict[str, Any]:
    """Return which targets of the map are touched, and the others with what is missing."""
    found = touched_targets([(deployment, world)])
    if found is None:
        return {}
    states = [outcome.state for outcome in found.outcomes]
    return {
        "targets": [
            {**content, "state": state}
            for content, state in zip(found.content, states, strict=True)
        ],
        "targets_svg": targets_svg(world.targets, states),
        "targets_headline": found.headline,
        "targets_tone": found.tone,
    }


def _growth(state: StudioState) -> dict[str, Any]:
    """Return the growth options in force, those that the design has by itself, and a line."""
    usual = GrowthChoice.of([state.design]).options.values
    return {
        "values": state.growth.values,
        "usual": usual,
        "trained": bool(state.design.origin.get(ORIGIN_GROWTH)),
        "text": growth_text(state.growth, [state.design]),
    }


def not_followed(design: Design) -> str:
    """Return why a design is not grown while a pointer waits, or nothing."""
    if design.branch_count > MOST_FOLLOWED:
        return (
            f"{counted(design.branch_count, 'branch')}: the page follows designs of at most "
            f"{MOST_FOLLOWED};"
            " vinefab grow DESIGN --map MAP grows them all"
        )
    if design.branch_count > MOST_LIVE_INTERPRETED and engine_now() != "kernel":
        return (
            f"{counted(design.branch_count, 'branch')}: growth follows as soon as the simulator "
            "is compiled,"
            " once on this computer"
        )
    return ""


def _not_grown(design: Design, problem: str) -> dict[str, Any]:
    nothing = dict.fromkeys(TASKS)
    return {
        "robot_svg": "", "front_full_mm": 0.0, "scores": nothing, "facts": _planned(design),
        "problems": [problem], "unscored": [],
    }  # fmt: skip


def _scores(deployment: Deployment, prepared: PreparedMap) -> dict[str, Any]:
    """Return score and title of each task (simulated), None where a map has none, and why."""
    scores: dict[str, Any] = {}
    titles: dict[str, str] = {}
    unscored = []
    for name in TASKS:
        if name in COMPILED_TASKS and engine_now() != "kernel":
            scores[name] = None
            unscored.append(f"{name}: as soon as the simulator is compiled, once on this computer")
            continue
        task = _task(name)
        try:
            check_on_map(task, prepared.world, prepared.context)
            scores[name], terms = task.evaluate(deployment, prepared.context)
            titles[name] = f"{name}, ideal case" if terms.get(IDEAL_CASE) else name
        except VinefabError as error:
            scores[name] = None
            unscored.append(f"{name}: {error}")
    return {"scores": scores, "titles": titles, "unscored": unscored}


def _planned(design: Design) -> dict[str, Any]:
    return {"branches": design.branch_count, "text": counted(design.branch_count, "branch")}


def _facts(design: Design, deployment: Deployment) -> dict[str, Any]:
    needed_kpa = float(worst_pressures_of([deployment], design)[0, 0])
    return {
        "branches": len(deployment.tree),
        "deployed": int(deployment.deployed.sum()),
        "grown_mm": float(deployment.grown_mm.sum()),
        "planned_mm": deployment.tree.total_length_mm,
        "text": _grown_text(deployment),
        "pressure_needed_kpa": None if math.isnan(needed_kpa) else needed_kpa,
        "inflated_mm": [2.0 * inflated_radius_mm(w) for w in design.build.widths_mm],
    }


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


def _troubles(state: StudioState, deployment: Deployment) -> list[str]:
    """Return what a user should know about how the robot grew, as `vinefab grow` says it."""
    lost = without_room(state.design, deployment, state.growth)
    unknown = [
        f"level {number}: grown at its designed angles; no table says what it deploys as"
        for number, level in enumerate(state.grown_now.levels, start=2)
        if state.design.build.compensation == "none" and not isinstance(level, UnevenLevel)
    ]
    return [
        *unknown,
        *stayed_text([bool(deployment.deployed[0])], state.design, state.growth),
        *places_text("no room for the body of", lost),
        *places_text("stuck in a corner", wedged(state.design, deployment, state.growth)),
    ]


@cache
def _task(name: str) -> Task:
    return make_task(name, {})
