"""Engines: the computation of growths, their rules, and the steps after a growth."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from vinefab.core.compiling import imported_later, interpreted
from vinefab.core.errors import UnknownNameError
from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import Growth, JobArrays, Rules, TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.physics.growth_pressure import FITTED

if TYPE_CHECKING:
    from vinefab.growth import contact_kernel, kernel
else:
    kernel = imported_later("vinefab.growth.kernel")
    contact_kernel = imported_later("vinefab.growth.contact_kernel")

Engine = Literal["auto", "kernel", "interpreted"]
"""``kernel``: the compiled simulator. ``interpreted``: the same code run by Python, which begins at
once, with the same results to the last bit. ``auto``: one of the two, see `chosen_engine`."""

KERNEL = "vinefab.growth.kernel"
CONTACT_KERNEL = "vinefab.growth.contact_kernel"


TOLERANCE_RAD = 2.0**-42
"""Directions that differ by less are parallel: far below the bend of any corner of a terrain."""

TIE = 1e-9
"""Angles (rad) and shares of a pressure that differ by less are equal: above what rounding leaves
of the directions of walls and bodies, far below what anybody measures."""

MOST_EVENTS = 100_000
"""Guard against a branch that never ends; the most seen in tests is below a hundred."""

INTERPRETED_BRANCHES = 4_000
"""So many branches a process leaves to the interpreter, half a second of them. Loading the compiled
kernel takes as long; compiling it, once on every computer, takes many times longer."""

INTERPRETED_CORNERS = 4_000
"""Maps of more corners are never left to the interpreter: one branch there may take a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """What branches do to each other in finished growths."""

    stops: bool  # whether a tip that meets the body of another branch stops there
    emergence: float  # probability that a child comes out of its parent's tip

    @classmethod
    def of(cls, options: GrowthOptions) -> "Settling":
        """Return the settling that some options of the growth model ask for."""
        return cls(stops=options.branch_contact == "stop", emergence=options.emergence)

    @property
    def is_needed(self) -> bool:
        """Whether anything can change."""
        return self.stops or self.emergence < 1.0

    def settle(  # noqa: PLR0913, PLR0917  arrays of a batch
        self,
        trees: TreesArrays,
        radius_mm: Floats,
        jobs: JobArrays,
        growth: Growth,
        tolerance_mm: Floats,
        seeds: Ints,
        engine: Engine,
    ) -> None:
        """Cut finished growths where branches meet or did not come out.

        Parameters
        ----------
        trees, jobs, growth
            See `vinefab.growth.arrays`; ``growth`` is written to.
        radius_mm
            Radius of the body of each branch, in the order of the trees.
        tolerance_mm
            Of the map of each job.
        seeds
            Of the draws of each job.
        engine
            What computes it.
        """
        module = interpreted(CONTACT_KERNEL) if engine == "interpreted" else contact_kernel
        room = np.empty((int(np.diff(trees.first).max()), module.WORK_COLUMNS))
        with np.errstate(all="ignore"):
            module.settle_jobs(
                trees,
                radius_mm,
                jobs,
                tolerance_mm,
                self.emergence,
                seeds,
                self.stops,
                growth,
                room,
            )


class _Allowance:
    """The branches that this process may still leave to the interpreter."""

    def __init__(self) -> None:
        self.branches = INTERPRETED_BRANCHES


_ALLOWANCE = _Allowance()


def chosen_engine(engine: Engine, branches: int, corners: int) -> Engine:
    """Return the engine that grows so many branches; of ``auto``, the one that is done first.

    That is compiled code once it is loaded. Until then it is the interpreter, up to
    `INTERPRETED_BRANCHES` in all, on maps of up to `INTERPRETED_CORNERS`.

    Raises
    ------
    UnknownNameError
        If there is no such engine.
    """
    if engine not in get_args(Engine):
        raise UnknownNameError("growth engine", engine, get_args(Engine))
    if engine != "auto":
        return engine
    jagged = corners > INTERPRETED_CORNERS
    if KERNEL in sys.modules or jagged or branches > _ALLOWANCE.branches:
        return "kernel"
    _ALLOWANCE.branches -= branches
    return "interpreted"


def grow_jobs_of(engine: Engine) -> Callable[..., None]:
    """Return ``grow_jobs`` of the compiled kernel, or as the interpreter runs it."""
    grow_jobs: Callable[..., None] = kernel.grow_jobs if engine == "kernel" else _plain_grow_jobs
    return grow_jobs


def _plain_grow_jobs(*arrays: Any) -> None:  # noqa: ANN401  as the kernel
    with np.errstate(all="ignore"):  # compiled code does not warn either
        interpreted(KERNEL).grow_jobs(*arrays)


def rules_of(options: GrowthOptions, tolerance_mm: float) -> Rules:
    """Return the rules of growth for a map's tolerance; of a range of half-angles, the least."""
    return Rules(
        head_on_half_angle_rad=options.half_angle_range_rad[0],
        deploys_stuck=options.deploys_stuck,
        tolerance_mm=tolerance_mm,
        tolerance_rad=TOLERANCE_RAD,
        tie=TIE,
        most_events=MOST_EVENTS,
        friction=FITTED.friction.value,
        drag_kpa_mm=FITTED.drag_kpa_m.value / 1000.0,
    )
