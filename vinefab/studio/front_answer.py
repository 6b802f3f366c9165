"""The robot on the map while it grows: its exact shape at a length of its front."""

from collections.abc import Mapping
from typing import Any

from vinefab.core.validation import LARGEST_MM, number
from vinefab.pages.plan_svg import robot_svg
from vinefab.prediction.deploy import History
from vinefab.studio.panels import Tell
from vinefab.studio.state import StudioState
from vinefab.studio.tip_answer import deployed_robot
from vinefab.studio.warming import engine_now

_LEAST_MM = 1e-6


def front_answer(state: StudioState, ask: Mapping[str, Any], _: Tell) -> dict[str, Any]:
    """Return the robot at a front length (simulated); from the full length on, the whole robot.

    The page could cut the final shape to length by itself, but a tip that slides along a wall turns
    the stretch behind it: the final shape does not show where that lay.

    Parameters
    ----------
    ask
        ``front_mm``: way along the body from the base to the growing tips.
    """
    final, terrain = deployed_robot(state)
    history = History(
        design=state.grown_now,
        terrain=terrain,
        options=state.growth,
        final=final,
    )
    given: Any = ask.get("front_mm")
    front_mm = number("front_mm", given, _LEAST_MM, LARGEST_MM, "mm")
    frame = history.at(front_mm, engine=engine_now())
    widths_mm = state.growth.drawn_widths_mm(state.design.build.widths_mm)
    return {
        "front_mm": frame.front_mm,
        "full_mm": history.full_mm,
        "robot_svg": robot_svg(frame.deployment, widths_mm, is_growing=frame.is_growing),
    }
