"""The simulator of one design on one map from one pose."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vinefab.core.compiling import imported_later, interpreted
from vinefab.core.errors import UnknownNameError
from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import (
    Growth,
    JobArrays,
    Launch,
    Rules,
    TerrainSetArrays,
    TreeArrays,
    TreesArrays,
    WallArrays,
)
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.physics.growth_pressure import FITTED

if TYPE_CHECKING:
    from vinefab.growth import contact_kernel, kernel
else:
    kernel = imported_later("vinefab.growth.kernel")
    contact_kernel = imported_later("vinefab.growth.contact_kernel")

Engine = Literal["auto", "kernel", "interpreted"]
"""``kernel``: the compiled simulator. ``interpreted``: the same code run by Python, which begins at
once, with the same results to the last bit. ``auto``: one of the two, see `quickest_engine`."""

KERNEL = "vinefab.growth.kernel"
CONTACT_KERNEL = "vinefab.growth.contact_kernel"

GrowBranches = Callable[[WallArrays, TreeArrays, Rules, Launch, Growth, int, int], int]

TOLERANCE_RAD = 2.0**-42
"""Directions that differ by less are parallel: far below the bend of any corner of a terrain."""

TIE = 1e-9
"""Angles (rad) and shares of a pressure that differ by less are equal: above what rounding leaves
of the directions of walls and bodies, far below what anybody measures."""

MOST_EVENTS = 100_000
"""Guard against a branch that never ends; the most seen in tests is below a hundred."""

POINTS_PER_BRANCH = 6
SPARE_POINTS = 16
"""Initial room for chain points; doubled when a tree needs more."""

INTERPRETED_BRANCHES = 4_000
"""So many branches a process leaves to the interpreter, half a second of them. Loading the compiled
kernel takes as long; compiling it, once on every computer, takes many times longer."""

INTERPRETED_CORNERS = 4_000
"""Maps of more corners are never left to the interpreter: one branch there may take a second."""


def grow_on(
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions | None = None,
    engine: Engine | GrowBranches = "auto",
    plan: Plan | None = None,
) -> Deployment:
    """Return how a design deploys from a pose.

    Parameters
    ----------
    design
        The robot.
    terrain
        The map, prepared with `Terrain.of`.
    pose
        Where the trunk is launched. A start on a wall is allowed.
    options
        Options of the growth model; the defaults if None.
    engine
        What computes it, see `Engine`; also a function with the interface of the kernel's
        ``grow_branches``.
    plan
        The branches to grow, such as a part of the design's, cut shorter; the design's if None.

    Returns
    -------
    Deployment
        Chains, stop reasons, lengths and turns. A branch that stopped at once has a chain of two
        equal points; one that never emerged has none. With inflated bodies, a branch without room
        for its base has not deployed.

    Raises
    ------
    BadInputError
        If the pose is inside an obstacle or outside the bounds.
    """
    options = options or GrowthOptions()
    start = Launch(*terrain.start_mm(pose), math.cos(pose.heading_rad), math.sin(pose.heading_rad))
    plan = plan or Plan.of(design, options)
    rules = rules_of(options, terrain.tolerance_mm)
    rules = rules._replace(head_on_half_angle_rad=options.only_half_angle_rad)
    if engine == "auto":
        engine = quickest_engine(len(plan), terrain.corners)
    # Span by span, with enough room for the chain points.
    arrays, grow_branches = plan.arrays(), grow_branches_of(engine)
    growth = Growth.empty(len(plan), POINTS_PER_BRANCH * len(plan) + SPARE_POINTS)
    reached_mm = 0.0
    for first, last, radius_mm in zip(plan.edges, plan.edges[1:], plan.radii_mm, strict=False):
        # Only a body wider than the one that reached the place can lack room there.
        if radius_mm > reached_mm:
            bases_mm = np.array([[start.x, start.y]])
            if first > 0:
                parent = arrays.parent[first:last]
                bases_mm = growth.points[growth.first_point[parent + 1] - 1]
            arrays.fits[first:last] = terrain.have_room(bases_mm, radius_mm)
        reached_mm = radius_mm
        walls, done = terrain.walls(radius_mm), first
        while (done := grow_branches(walls, arrays, rules, start, growth, done, last)) < last:
            growth = growth.with_room(2 * len(growth.points))
    settling = Settling.of(options)
    if settling.is_needed:
        jobs = JobArrays.alone(start, 0.0, arrays.fits, len(growth.points), 0, len(plan))
        trees, tolerances = TreesArrays.of([arrays]), np.array([terrain.tolerance_mm])
        by = engine if isinstance(engine, str) else "kernel"
        settling.settle(trees, plan.radius_mm, jobs, growth, tolerances, jobs.tree, by)
    used = growth.first_point[-1]
    return Deployment(
        tree=plan.tree,
        pose=pose,
        points_mm=growth.points[:used].copy(),
        first_point=growth.first_point,
        stop=growth.stop,
        grown_mm=growth.grown,
        contact_turn_rad=growth.turn,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """What branches do to each other in finished growths."""

    stops: bool  # whether a tip that meets the body of another branch stops there
    emergence: float  # probability that a child comes out of its parent's tip

    @classmethod
    def of(cls, options: GrowthOptions) -> "Settling":
        """Return what some options of the growth model ask for."""
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


def quickest_engine(branches: int, corners: int) -> Engine:
    """Return the engine that is done first with so many branches more: compiled code once loaded.

    Until then the interpreter, up to `INTERPRETED_BRANCHES` in all, on maps of up to
    `INTERPRETED_CORNERS`.
    """
    jagged = corners > INTERPRETED_CORNERS
    if KERNEL in sys.modules or jagged or branches > _ALLOWANCE.branches:
        return "kernel"
    _ALLOWANCE.branches -= branches
    return "interpreted"


def grow_branches_of(engine: Engine | GrowBranches) -> GrowBranches:
    """Return an engine by its name, imported when first used; a function is one itself.

    Raises
    ------
    UnknownNameError
        If there is no such engine.
    """
    if engine == "kernel":
        return _grow_as_batch
    if engine == "interpreted":
        return _interpreted("grow_branches")
    if callable(engine):
        return engine
    raise UnknownNameError("growth engine", engine, ("auto", "kernel", "interpreted"))


def grow_jobs_of(engine: Engine) -> Callable[..., None]:
    """Return ``grow_jobs`` of the compiled kernel, or as the interpreter runs it."""
    if engine == "interpreted":
        return _interpreted("grow_jobs")
    grow_jobs: Callable[..., None] = kernel.grow_jobs
    return grow_jobs


def _interpreted(name: str) -> Callable[..., Any]:
    """Return a function of the kernel as the interpreter runs it, which does not warn either."""
    function: Callable[..., Any] = getattr(interpreted(KERNEL), name)
    return np.errstate(all="ignore")(function)


def _grow_as_batch(  # noqa: PLR0913, PLR0917  as both engines are called
    walls: WallArrays,
    tree: TreeArrays,
    rules: Rules,
    start: Launch,
    growth: Growth,
    first: int,
    last: int,
) -> int:
    """Grow some branches of a tree as a batch of one; return the first that is not done.

    The same compiled code as for batches: compiling another entry would take ten seconds more.
    """
    angle_rad, room = rules.head_on_half_angle_rad, len(growth.points)
    jobs = JobArrays.alone(start, angle_rad, tree.fits, room, first, last)
    atlas = TerrainSetArrays.of([walls], [rules.tolerance_mm])
    grow_jobs_of("kernel")(atlas, TreesArrays.of([tree]), rules, jobs, growth, 0, 1)
    return int(jobs.done[0])


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
