"""Compiled code for the server without anyone waiting for it.

The first growths are run by the interpreter. Meanwhile a process of its own compiles the simulator,
once on every computer, and ends; then the server loads what is on disk.
"""

import asyncio
import sys

from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import Engine, grow
from vinefab.growth.terrain import Terrain
from vinefab.maps.make_map import generate
from vinefab.model.design import Build, Design, Level


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
    world = generate("pegs", 1)
    terrain = Terrain.of(world)
    grow(design, terrain, world.starts[0].pose, GrowthOptions(), engine="kernel")
    _ENGINES.now = "kernel"


async def warm() -> None:
    """Compile in a process of its own, then load the result in a thread."""
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


if __name__ == "__main__":
    load_kernel()
