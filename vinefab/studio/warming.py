"""Compiled code for the server without anyone waiting for it.

The first growths are run by the interpreter. Meanwhile a process of its own compiles the simulator,
once on every computer, and ends; then the server loads what is on disk.
"""

import asyncio
import sys

from vinefab.growth.engine import Engine
from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow_on
from vinefab.maps.generators.pegs import PegsOptions, pegs_map
from vinefab.model.design import Build, Design, Level
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.shipped_tasks import TASKS, make_task


class _Engines:
    """Which engine grows the robot on the page."""

    def __init__(self) -> None:
        self.now: Engine = "interpreted"


_ENGINES = _Engines()


def engine_now() -> Engine:
    """Return the engine for a growth that a pointer waits for."""
    return _ENGINES.now


def load_kernel() -> None:
    """Grow a small robot with the compiled simulator; afterwards `engine_now` returns it."""
    levels = (Level.of(branches=2, length_mm=40.0, angle_deg=90.0),)
    design = Design(name="warm", trunk_length_mm=40.0, levels=levels, build=Build.standard(2))
    place = PreparedMap.of(pegs_map(1, PegsOptions()))
    start = place.world.starts[0].pose
    grown = grow_on(design, place.terrain, start, GrowthOptions(), engine="kernel")
    for task in TASKS:
        make_task(task, {}).evaluate(grown, place.context)
    _ENGINES.now = "kernel"


async def warm() -> bool:
    """Compile in a process of its own, then load the result in a thread; return whether it could.

    Without it the interpreter goes on: slower, with the same results.
    """
    compiling = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "vinefab.studio.warming", stdin=asyncio.subprocess.DEVNULL
    )
    try:
        code = await compiling.wait()
    except asyncio.CancelledError:
        compiling.kill()
        raise
    if code == 0:
        await asyncio.to_thread(load_kernel)
    return code == 0


if __name__ == "__main__":
    load_kernel()
