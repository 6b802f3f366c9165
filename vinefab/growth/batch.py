"""Growths: one design from one pose, or a batch, every design from every launch."""

import itertools
import math
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeVar, get_args, overload

import numpy as np
from numpy.typing import NDArray

from vinefab.core.compiling import interpreted, is_compiler_installed
from vinefab.core.errors import UnknownNameError
from vinefab.core.front_door import imported_later
from vinefab.core.progress import each, phase
from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import Growth, JobArrays, Rules, TerrainSetArrays, TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import BranchParts, Plan, Plans
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.physics.growth_pressure import FITTED

if TYPE_CHECKING:
    from vinefab.growth import batch_kernel, contact_kernel, kernel
else:
    batch_kernel = imported_later("vinefab.growth.batch_kernel")
    contact_kernel = imported_later("vinefab.growth.contact_kernel")
    kernel = imported_later("vinefab.growth.kernel")

# --- What computes growths, and the steps after them ---------------------------------------------

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
        emergence: Floats,
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
        emergence
            Probability that each comes out, in that order.
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
                emergence,
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
    `INTERPRETED_BRANCHES` in all, on maps of up to `INTERPRETED_CORNERS`; without a compiler it
    grows all.

    Raises
    ------
    UnknownNameError
        If there is no such engine.
    """
    if engine not in get_args(Engine):
        raise UnknownNameError("growth engine", engine, get_args(Engine))
    if engine != "auto":
        return engine
    if not is_compiler_installed():
        return "interpreted"  # slow, with the same results
    jagged = corners > INTERPRETED_CORNERS
    if KERNEL in sys.modules or jagged or branches > _ALLOWANCE.branches:
        return "kernel"
    _ALLOWANCE.branches -= branches
    return "interpreted"


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


# --- Many growths --------------------------------------------------------------------------------

MOST_KEPT = 8
"""Arrays are kept for so many sets of radii, then the oldest are dropped."""


class TerrainSet:
    """Terrains whose walls are concatenated once and used by many batches."""

    __slots__ = ("_kept", "_making", "terrains")

    def __init__(self, terrains: Sequence[Terrain]) -> None:
        self.terrains = tuple(terrains)
        self._kept: dict[tuple[float, ...], TerrainSetArrays] = {}
        self._making = threading.Lock()

    def __reduce__(self) -> tuple[type, tuple[tuple[Terrain, ...]]]:
        return type(self), (self.terrains,)

    def arrays(self, radii_mm: tuple[float, ...]) -> TerrainSetArrays:
        """Return the walls of all terrains for some body radii, one page for each pair.

        Thread-safe.
        """
        with self._making:
            if radii_mm not in self._kept:
                terrains = each("walls of maps", self.terrains)
                pages = [terrain.walls(radius) for terrain in terrains for radius in radii_mm]
                tolerances = np.repeat([t.tolerance_mm for t in self.terrains], len(radii_mm))
                while len(self._kept) >= MOST_KEPT:
                    self._kept.pop(next(iter(self._kept)))
                self._kept[radii_mm] = TerrainSetArrays.of(pages, tolerances.tolist())
            return self._kept[radii_mm]

    @property
    def tolerances_mm(self) -> Floats:
        """Distances up to this count as touching, on each terrain, shape (terrains,)."""
        return np.array([terrain.tolerance_mm for terrain in self.terrains])

    def pages(self, radii_mm: tuple[float, ...]) -> Ints:
        """Return the page of each terrain and radius, shape (terrains, radii)."""
        return np.arange(len(self.terrains) * len(radii_mm)).reshape(-1, len(radii_mm))


_HEARD_S = 0.1
"""Blocks take a millisecond; so often their number is announced."""

POINTS_PER_BRANCH = 6
SPARE_POINTS = 16
"""Initial room for chain points; doubled when a tree needs more."""


class Workspace:
    """Arrays that are allocated once and reused: allocation costs as much as growth."""

    __slots__ = ("_growth", "points_per_branch")

    def __init__(self) -> None:
        self._growth = Growth.empty(0, 0)
        # As many as any block took so far: where one runs out it grows all over again.
        self.points_per_branch = POINTS_PER_BRANCH

    def growth(self, jobs: int, branches: int, room: int) -> Growth:
        """Return cleared arrays for several jobs, concatenated."""
        held = self._growth
        if branches + jobs >= len(held.first_point) or room > len(held.points):
            held = self._growth = Growth.empty(2 * (branches + jobs), 2 * room)
        size = {"first_point": branches + jobs, "points": room}
        size |= {name: room for name in Growth._fields if name.startswith("chain_")}
        each = held._asdict().items()
        part = Growth(**{name: array[: size.get(name, branches)] for name, array in each})
        for name in ("first_point", "stop", "grown", "turn", "heading", "events"):
            getattr(part, name).fill(0)
        return part


GROWTHS_PER_CALL = 128
"""Growths in one compiled call: enough to amortize the call, few enough for the caches."""


_Result = TypeVar("_Result")


class BlockMapper(Protocol):
    """How blocks are processed: `map`, or that of a pool of threads."""

    def __call__(self, function: Callable[[Any], Any], items: Iterable[Any], /) -> Iterable[Any]:
        """Return the function's results in the order of the items."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Launches:
    """The l poses on maps that trunks are launched from."""

    atlas: TerrainSet  # the maps' terrains
    terrain: Ints  # index of the map of each launch, shape (l,)
    poses: tuple[Pose, ...]  # the poses, one per launch
    start: Floats  # base x and y (mm) and heading ux, uy of each trunk, shape (l, 4)
    # head-on half-angle of each launch, shape (l,); None: that of the growth model's options
    half_angle_rad: Floats | None = None
    # seed of the random draws in each launch, shape (l,); empty: their numbers
    draw_seeds: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @classmethod
    def of(
        cls,
        atlas: TerrainSet,
        poses: Sequence[Sequence[Pose]],
        half_angles_rad: Sequence[float] = (),
        draw_seeds: Sequence[int] = (),
    ) -> "Launches":
        """Return the launches from the poses on each map.

        Parameters
        ----------
        atlas
            The maps.
        poses
            Poses on each map, at least one in all.
        half_angles_rad
            Head-on half-angle of each pose, map by map; empty: as the growth model's options say.
        draw_seeds
            Seed of the random draws in each deployment, map by map; empty: their numbers.

        Raises
        ------
        BadInputError
            If a pose is inside an obstacle or outside the bounds.
        """
        flat = tuple(pose for places in poses for pose in places)
        bases = [t.starts_mm(places) for t, places in zip(atlas.terrains, poses, strict=True)]
        # As in `grow_on`: numpy's cosine differs in the last digit.
        headings = [(math.cos(pose.heading_rad), math.sin(pose.heading_rad)) for pose in flat]
        return cls(
            atlas=atlas,
            terrain=np.repeat(np.arange(len(poses)), [len(places) for places in poses]),
            poses=flat,
            start=np.column_stack([np.concatenate(bases), np.reshape(headings, (-1, 2))]),
            half_angle_rad=np.array(half_angles_rad) if len(half_angles_rad) else None,
            draw_seeds=np.array(draw_seeds, dtype=np.int64),
        )

    @property
    def seeds(self) -> Ints:
        """Seed of the random draws in each launch, the same for all designs, shape (l,)."""
        return self.draw_seeds if len(self.draw_seeds) else np.arange(len(self))

    def __len__(self) -> int:
        return len(self.poses)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GrowthBlock:
    """Finished growths of a batch, j of them."""

    # plan, launch: index of the design and of the launch of each, shape (j,)
    plan: Ints
    launch: Ints
    # plans, launches: of the whole batch
    plans: Plans
    launches: Launches
    # branch, room: where each growth's branches and chain points begin, shape (j + 1,)
    branch: Ints
    room: Ints
    growth: Growth  # the results, concatenated
    at_bend: NDArray[np.bool_]  # whether each chain point is a preformed bend

    def __len__(self) -> int:
        return len(self.plan)

    @property
    def terrain(self) -> Ints:
        """Index of each growth's map, rising, shape (j,)."""
        return self.launches.terrain[self.launch]

    def by_terrain(self) -> list[tuple[int, int, int]]:
        """Return (map, one, two) for each map: its growths are ``one .. two - 1``."""
        terrain = self.terrain
        edges = np.flatnonzero(np.diff(terrain, prepend=-1, append=-1)).tolist()
        return [(int(terrain[one]), one, two) for one, two in itertools.pairwise(edges)]

    def planned_mm(self) -> Floats:
        """Return the planned length of each growth's tree, shape (j,)."""
        return self.plans.lengths_mm[self.plan]

    def tips_mm(self) -> tuple[Floats, Ints]:
        """Return the tips of all deployed branches, shape (m, 2), and where each growth's begin."""
        tips_mm, first = np.empty((len(self.growth.stop), 2)), np.empty_like(self.branch)
        count = batch_kernel.gather_tips(
            self.branch,
            self.room,
            self.growth.points,
            self.growth.first_point,
            self.growth.stop,
            int(Stop.NOT_DEPLOYED),
            tips_mm,
            first,
        )
        return tips_mm[:count], first

    def read_only(self) -> "GrowthBlock":
        """Return the same block for foreign code, which must not write into it."""
        growth = {name: array.view() for name, array in self.growth._asdict().items()}
        names = ("plan", "launch", "branch", "room", "at_bend")
        own = {name: getattr(self, name).view() for name in names}
        for view in (*growth.values(), *own.values()):
            view.setflags(write=False)
        return replace(self, growth=Growth(**growth), **own)

    def deployment(self, index: int) -> Deployment:
        """Return one growth as `grow_on` does."""
        one, two = self.branch[index], self.branch[index + 1]
        first_point = self.growth.first_point[one + index : two + index + 1].copy()
        room = self.room[index]
        plan = self.plans.each[self.plan[index]]
        return Deployment(
            tree=plan.tree,
            pose=self.launches.poses[self.launch[index]],
            points_mm=self.growth.points[room : room + first_point[-1]].copy(),
            first_point=first_point,
            stop=self.growth.stop[one:two].copy(),
            grown_mm=self.growth.grown[one:two].copy(),
            contact_turn_rad=self.growth.turn[one:two].copy(),
            bend_points=np.flatnonzero(self.at_bend[room : room + first_point[-1]]),
        )


def _joined(
    joined: BranchParts, jobs: JobArrays, grown: Growth, at_bend: NDArray[np.bool_]
) -> tuple[Ints, Growth]:
    """Return where each growth's branches begin, and the growths of whole branches."""
    branch = np.zeros(len(jobs.tree) + 1, dtype=np.int64)
    np.cumsum(np.diff(joined.first)[jobs.tree], out=branch[1:])
    whole = Growth.empty(int(branch[-1]), len(grown.points))
    whole = whole._replace(first_point=np.zeros(branch[-1] + len(jobs.tree), dtype=np.int64))
    batch_kernel.join_parts(
        jobs.tree,
        *joined,
        jobs.branch,
        jobs.room,
        grown,
        branch,
        int(Stop.NOT_DEPLOYED),
        whole,
        at_bend,
    )
    return branch, whole


def _deployments_of(block: GrowthBlock) -> list[Deployment]:
    return [block.deployment(index) for index in range(len(block))]


class Regrown(Sequence[Deployment]):
    """The growths of a batch, none of which is kept: growing takes microseconds."""

    def __init__(self, batch: "Batch") -> None:
        self._batch = batch

    def __len__(self) -> int:
        return len(self._batch)

    @overload
    def __getitem__(self, index: int) -> Deployment: ...

    @overload
    def __getitem__(self, index: slice) -> "list[Deployment]": ...

    def __getitem__(self, index: int | slice) -> Deployment | list[Deployment]:
        """Return one growth, or some."""
        if isinstance(index, slice):
            return [self[one] for one in range(*index.indices(len(self)))]
        (one,) = self._batch.worked(range(len(self))[index], 1, _deployments_of)
        return one

    def __iter__(self) -> Iterator[Deployment]:
        for block in self._batch.each(_deployments_of):
            yield from block


class Batch:
    """Every design from every launch: growth number ``launch * designs + design``.

    Parameters
    ----------
    plans
        The designs.
    launches
        The poses on maps.
    options
        Options of the growth model, the same that the plans were made with.
    idle
        Workspaces shared with other batches; threads take and return them.
    engine
        ``kernel``, ``interpreted`` or ``auto``, see `vinefab.growth.batch.Engine`.

    Notes
    -----
    The batch is split into blocks of a fixed size, whatever the number of threads. Each is one
    compiled call (one per level for inflated bodies) without the interpreter lock. Blocks share
    nothing that is written to, so results do not depend on the threads.
    """

    def __init__(
        self,
        plans: Plans,
        launches: Launches,
        options: GrowthOptions,
        idle: list[Workspace] | None = None,
        engine: Engine = "kernel",
    ) -> None:
        self.plans = plans
        half_angle_rad = launches.half_angle_rad
        if half_angle_rad is None:
            half_angle_rad = options.half_angles_rad(len(launches))
        if options.draws_half_angle:
            launches = replace(launches, half_angle_rad=half_angle_rad)
        self.launches = launches
        self._rules, self._half_angle = rules_of(options, 0.0), half_angle_rad
        self._settling = Settling.of(options)
        self._radius_mm = self._emergence = np.zeros(0)
        if self._settling.is_needed:
            self._radius_mm = plans.radius_mm
            self._emergence = plans.emergence(self._settling.emergence)
        self._walls = launches.atlas.arrays(plans.spans.radii_mm)
        self._page = launches.atlas.pages(plans.spans.radii_mm)
        # Appending and popping are safe between threads.
        self._idle = [] if idle is None else idle
        corners = max((one.corners for one in launches.atlas.terrains), default=0)
        self._engine = chosen_engine(engine, len(launches) * len(plans.trees.parent), corners)

    def __len__(self) -> int:
        return len(self.plans) * len(self.launches)

    def each(
        self,
        work: Callable[[GrowthBlock], _Result],
        over: BlockMapper = map,
        size: int = GROWTHS_PER_CALL,
    ) -> Iterator[_Result]:
        """Grow all blocks and yield the result of ``work`` on each, in order.

        Parameters
        ----------
        work
            Called with every block in the thread that grew it. The block's arrays are reused
            afterwards: copy what must last.
        """
        blocks = over(lambda first: self.worked(first, size, work), range(0, len(self), size))
        if over is not map or len(self) <= size:  # who has a pool counts for several batches
            yield from blocks
            return
        with phase("deployments", len(self)) as count:
            heard_s = time.monotonic()
            for number, result in enumerate(blocks, start=1):
                yield result
                if time.monotonic() - heard_s > _HEARD_S:
                    heard_s = time.monotonic()
                    count.at(min(number * size, len(self)))

    def worked(self, first: int, size: int, work: Callable[[GrowthBlock], _Result]) -> _Result:
        """Grow ``size`` growths from ``first`` on, and return the result of ``work`` on them."""
        try:
            scratch = self._idle.pop()
        except IndexError:
            scratch = Workspace()
        launch, plan = np.divmod(np.arange(first, min(first + size, len(self))), len(self.plans))
        while (block := self._grown(plan, launch, scratch.points_per_branch, scratch)) is None:
            scratch.points_per_branch *= 2
        result = work(block)
        self._idle.append(scratch)
        return result

    def deployments(self, over: BlockMapper = map) -> list[Deployment]:
        """Return every growth as `grow_on` does."""
        blocks = self.each(_deployments_of, over)
        return [deployment for block in blocks for deployment in block]

    def regrown(self) -> "Regrown":
        """Return every growth, grown again whenever it is asked for: for more than memory holds."""
        return Regrown(self)

    def _grown(
        self, plan: Ints, launch: Ints, room_each: int, scratch: Workspace
    ) -> GrowthBlock | None:
        """Return some growths, or None if they need more chain points per branch."""
        branches = np.diff(self.plans.trees.first)[plan]
        branch, room = np.zeros((2, len(plan) + 1), dtype=np.int64)
        np.cumsum(branches, out=branch[1:])
        np.cumsum(room_each * branches + SPARE_POINTS, out=room[1:])
        jobs = JobArrays(
            tree=plan,
            page=np.zeros(len(plan), dtype=np.int64),
            start=self.launches.start[launch],
            half_angle=self._half_angle[launch],
            fits=np.ones(branch[-1], dtype=np.bool_),
            branch=branch,
            room=room,
            done=np.zeros(len(plan), dtype=np.int64),
            until=np.zeros(len(plan), dtype=np.int64),
        )
        module = interpreted(KERNEL) if self._engine == "interpreted" else kernel
        growth = scratch.growth(len(plan), int(jobs.branch[-1]), int(jobs.room[-1]))
        terrain = self.launches.terrain[launch]
        spans, trees = self.plans.spans, self.plans.trees
        for span in range(int(spans.number[plan].max())):
            jobs.page[:] = self._page[terrain, spans.radius[plan, span]]
            jobs.until[:] = spans.until[plan, span]
            wider = np.flatnonzero(spans.is_wider[plan, span])
            if span == 0:
                self._mark_trunks(wider, launch, jobs)
            else:
                for job in wider.tolist():
                    self._mark_fits(job, jobs, growth, span)
            with np.errstate(all="ignore"):  # as compiled code
                module.grow_jobs(self._walls, trees, self._rules, jobs, growth, 0, len(plan))
            if (jobs.done < jobs.until).any():
                return None
        if self._settling.is_needed:
            tolerance_mm = self.launches.atlas.tolerances_mm[terrain]
            self._settling.settle(
                trees,
                self._radius_mm,
                self._emergence,
                jobs,
                growth,
                tolerance_mm,
                self.launches.seeds[launch],
                self._engine,
            )
        branch, at_bend = jobs.branch, np.zeros(len(growth.points), dtype=np.bool_)
        if self.plans.parts is not None:
            branch, growth = _joined(self.plans.parts, jobs, growth, at_bend)
        return GrowthBlock(
            plan=plan,
            launch=launch,
            plans=self.plans,
            launches=self.launches,
            branch=branch,
            room=jobs.room,
            growth=growth,
            at_bend=at_bend,
        )

    def _mark_trunks(self, which: Ints, launch: Ints, jobs: JobArrays) -> None:
        """Mark which trunks have room at their base: once for each launch and body radius."""
        radii_mm = self.plans.spans.radii_mm
        radius = self.plans.spans.radius[jobs.tree[which], 0]
        pairs, pair = np.unique(launch[which] * len(radii_mm) + radius, return_inverse=True)
        place, size = np.divmod(pairs, len(radii_mm))
        terrain = self.launches.terrain[place]
        fits = np.ones(len(pairs), dtype=np.bool_)
        # All places of one map and radius at once: one by one takes as long as growing.
        for page in np.unique(terrain * len(radii_mm) + size).tolist():
            world, radius = divmod(page, len(radii_mm))
            rows = np.flatnonzero((terrain == world) & (size == radius))
            starts_mm = self.launches.start[place[rows], :2]
            fits[rows] = self.launches.atlas.terrains[world].have_room(starts_mm, radii_mm[radius])
        jobs.fits[jobs.branch[:-1][which]] = fits[pair]

    def _mark_fits(self, job: int, jobs: JobArrays, growth: Growth, level: int) -> None:
        """Mark which branches of one job's next span have room at their base."""
        plan = int(jobs.tree[job])
        first, last = int(jobs.done[job]), int(jobs.until[job])
        start = jobs.start[job, None, :2]
        if first > 0:
            ends = growth.first_point[jobs.branch[job] + job + 1 :]
            start = growth.points[
                jobs.room[job] - 1 + ends[self.plans.each[plan].parts.parent[first:last]]
            ]
        radii_mm = self.plans.each[plan].radii_mm
        terrain = int(jobs.page[job]) // len(self.plans.spans.radii_mm)
        fits = self.launches.atlas.terrains[terrain].have_room(start, radii_mm[level])
        jobs.fits[jobs.branch[job] + first : jobs.branch[job] + last] = fits


def grow_on(
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions | None = None,
    engine: Engine = "auto",
    plan: Plan | None = None,
) -> Deployment:
    """Return the deployment of a design from a pose: a batch of one.

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
        What computes it, see `Engine`.
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
    UnknownNameError
        If there is no such engine.
    """
    options = options or GrowthOptions()
    launches = Launches.of(TerrainSet([terrain]), [[pose]], [options.only_half_angle_rad])
    plans = Plans.joined([plan or Plan.of(design, options)])
    (deployment,) = Batch(plans, launches, options, engine=engine).deployments()
    return deployment
