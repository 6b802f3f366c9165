"""Benchmark of growth and search: against other ways, in size, in threads."""

import importlib
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vinefab.core.atomic import write_text
from vinefab.core.compiling import rebindable
from vinefab.core.plain_text import json_text
from vinefab.core.progress import Progress, announce, each
from vinefab.core.rng import child
from vinefab.core.validation import Floats, Ints
from vinefab.core.view import Block, Notes, Number, Rows, Value
from vinefab.growth import kernel
from vinefab.growth.arrays import Growth
from vinefab.growth.batch import KERNEL, Batch, BlockMapper, Launches, TerrainSet, grow_on, rules_of
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.poses import draw_poses
from vinefab.model.design import Build, Design, Level
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.map import Map, Pose, map_text
from vinefab.search.evaluator import (
    Evaluator,
    EvaluatorSpec,
    TimeSplit,
    Work,
)
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.run import run_search
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap, score_designs


def least_s(work: Callable[[], object], times: int = 5, *, wall_clock: bool = False) -> float:
    """Return the least time that some work takes."""
    (found,) = least_each_s((work,), times, wall_clock=wall_clock)
    return found


def least_each_s(
    works: Sequence[Callable[[], object]], times: int = 5, *, wall_clock: bool = False
) -> list[float]:
    """Return the least time that each of some works takes, done in turns.

    A processor that is faster at one time than at another is so for all of them: what counts is
    how they compare.
    """
    clock = time.perf_counter if wall_clock else time.process_time
    for work in works:
        work()
    found = [math.inf] * len(works)
    for _ in range(times):
        for number, work in enumerate(works):
            began = clock()
            work()
            found[number] = min(found[number], clock() - began)
    return found


_STREAM = 1901

_CELLS = 7
"""Cells along one side of the smallest map, which has about 300 walls."""

WALLS_PER_CELL = 5.5
"""Walls per cell of the default Grid, from its largest maps."""

_CELL_MM = 500.0 / _CELLS

BENCH_GROWTH = GrowthOptions(
    head_on_half_angle_rad=math.radians(1.0),
    children_of_stuck="deploy",
    body="centerline",
    pressure_stop=False,
)
"""Children of stuck branches grow, so that every branch of every growth counts."""


def tree_of_40() -> Design:
    """Return a design with 1 + 3 + 9 + 27 branches that fills the smallest map."""
    fans = ((150.0, 110.0), (120.0, 90.0), (90.0, 80.0))
    return Design(
        name="bench",
        trunk_length_mm=200.0,
        levels=tuple(
            Level(branches=3, length_mm=length, fan_rad=math.radians(fan), growth=0.8)
            for length, fan in fans
        ),
        build=Build.standard(4),
    )


def square_map(walls: int) -> Map:
    """Return a Grid map of about so many walls, always with the same density."""
    cells = round(math.sqrt(walls / WALLS_PER_CELL))
    options = GridOptions(columns=cells, rows=cells, size_mm=cells * _CELL_MM)
    return grid_map(1, options)


def free_poses(terrain: Terrain, count: int) -> tuple[Pose, ...]:
    """Return poses anywhere in the free space of a map, heading anywhere."""
    rng = child(0, _STREAM)
    width_mm, height_mm = terrain.world.size_mm
    poses: list[Pose] = []
    while len(poses) < count:
        x, y, turn = rng.uniform(0.0, 1.0, 3).tolist()
        pose = Pose(x_mm=x * width_mm, y_mm=y * height_mm, heading_rad=turn * math.tau)
        if terrain.is_free(pose):
            poses.append(pose)
    return tuple(poses)


def batch_on(terrain: Terrain, poses: tuple[Pose, ...]) -> Batch:
    """Return the growths of the tree from some poses on a map."""
    launches = Launches.of(TerrainSet([terrain]), [poses])
    return Batch(Plans.of([tree_of_40()], BENCH_GROWTH), launches, BENCH_GROWTH)


def events(batch: Batch) -> int:
    """Return the number of events in all growths of a batch."""
    return int(np.sum(list(batch.each(lambda block: int(block.growth.events.sum())))))


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """Tests per event, and their time in a loop of nothing else."""

    # wall_tests, corner_tests: tests of a ray against a wall, and of a turning body against a
    # corner, per event
    wall_tests: float
    corner_tests: float
    # wall_ns, corner_ns: time of one such test in a compiled loop over the tests of real growths
    wall_ns: float
    corner_ns: float

    @property
    def ns_per_event(self) -> float:
        """The floor."""
        return self.wall_tests * self.wall_ns + self.corner_tests * self.corner_ns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Tests:
    """All tests of some growths."""

    events: int  # number of events that they belong to
    # what `vinefab.growth.kernel.meet_all` and ``sweep_all`` take
    rays: Floats
    wall: Ints
    sweeps: Floats
    corner: Ints


def floor_on(terrain: Terrain, poses: tuple[Pose, ...]) -> Floor:
    """Return the floor of the benchmark's growths on a map."""
    tests = _tests(terrain, poses)
    walls, rules = terrain.walls(), rules_of(BENCH_GROWTH, terrain.tolerance_mm)
    wall_s = least_s(lambda: kernel.meet_all(walls, rules, tests.rays, tests.wall))
    corner_s = least_s(lambda: kernel.sweep_all(walls, rules, tests.sweeps, tests.corner))
    return Floor(
        wall_tests=len(tests.wall) / tests.events,
        corner_tests=len(tests.corner) / tests.events,
        wall_ns=1e9 * wall_s / len(tests.wall),
        corner_ns=1e9 * corner_s / len(tests.corner),
    )


def _tests(terrain: Terrain, poses: tuple[Pose, ...]) -> _Tests:
    """Return every test that some growths make, from an interpreted kernel that notes them."""
    batch = batch_on(terrain, poses)
    walls, rules = terrain.walls(), rules_of(BENCH_GROWTH, terrain.tolerance_mm)
    plan, rays, sweeps, count = batch.plans.each[0], [], [], 0
    plain = rebindable(KERNEL)
    meeting, sweep_to = plain["_meeting"], plain["_sweep_to"]

    def note_ray(walls: Any, rules: Any, *ray: Any) -> Any:  # noqa: ANN401  as the kernel
        rays.append(ray)
        return meeting(walls, rules, *ray)

    def note_sweep(walls: Any, rules: Any, vertex: Any, *sweep: Any) -> Any:  # noqa: ANN401
        sweeps.append((*sweep[0], *sweep[1], sweep[2], vertex))
        return sweep_to(walls, rules, vertex, *sweep)

    plain["_meeting"], plain["_sweep_to"] = note_ray, note_sweep
    tree, fits = plan.arrays(), np.ones(len(plan), dtype=np.bool_)
    for start in batch.launches.start.tolist():
        growth = Growth.empty(len(plan), 20 * len(plan))
        plain["grow_branches"](walls, tree, fits, rules, tuple(start), growth, 0, len(plan))
        count += int(growth.events.sum())
    ray, sweep = np.array(rays, dtype=np.float64), np.array(sweeps, dtype=np.float64)
    return _Tests(
        events=count,
        rays=np.ascontiguousarray(ray[:, :4]),
        wall=ray[:, 4].astype(np.int64),
        sweeps=np.ascontiguousarray(sweep[:, :12]),
        corner=sweep[:, 12].astype(np.int64),
    )


def peak_mb() -> float | None:
    """Return the largest memory of this process so far, or None where the system does not tell."""
    try:
        resource = importlib.import_module("resource")
    except ModuleNotFoundError:
        return None
    # Bytes on a Mac, units of 1024 bytes elsewhere.
    per_mb = 2**20 if sys.platform == "darwin" else 2**10
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / per_mb)


SEARCHES = ("particleswarm", "islands", "manufacturable")
"""The paper's optimizer, the default, and the default for designs that can be cut."""

BENCH_MAPS, BENCH_DESIGNS = 5, 100


def search_split(search: str, threads: int, generations: int) -> TimeSplit:
    """Return the split of a search's time: coverage of five Grids, Table 1, with a record."""
    fabricable = search == "manufacturable"
    settings = RunSettings(
        name="bench",
        maps=MapSettings(count=BENCH_MAPS),
        growth=GrowthOptions.published(),
        optimizer=PartSettings(name="islands" if fabricable else search),
        search=SearchSettings(population=BENCH_DESIGNS, generations=generations),
        evaluation=EvaluationSettings(fabricable=fabricable, finalists_by="training"),
    )
    with tempfile.TemporaryDirectory() as folder:
        return run_search(settings, Path(folder), workers=threads).times


class SearchEvaluation(NamedTuple):
    """Trees of 40 branches as a search evaluates them: planned, grown and scored for coverage."""

    trees_per_s: float  # of one core
    # of it, the time that planning and growth take, and scoring, us per tree
    growth_us: float
    scoring_us: float


def search_evaluation(world: Map) -> SearchEvaluation:
    """Measure trees whose trunks differ in length, from five poses, as `Evaluator` takes them."""
    space = SpaceSettings(levels=_fixed(4), by_level=_table_of(tree_of_40()))
    settings = RunSettings(
        name="bench",
        maps=MapSettings(count=1),
        growth=BENCH_GROWTH,
        space=space,
        evaluation=EvaluationSettings(fabricable=False, poses_per_map=BENCH_MAPS),
    )
    evaluator = Evaluator.of(EvaluatorSpec(settings=settings, maps=(world,)))
    conditions = evaluator.training_conditions(1, 1)
    evaluator.prepare_launches([conditions])
    x, parts = np.linspace(0.0, 1.0, BENCH_DESIGNS)[:, None], list[Work]()
    taken_s = least_s(lambda: parts.append(evaluator.evaluate(x, conditions)[1]))
    trees = BENCH_DESIGNS * BENCH_MAPS
    return SearchEvaluation(
        trees_per_s=trees / taken_s,
        growth_us=1e6 * min(part.growth_s for part in parts) / trees,
        scoring_us=1e6 * min(part.scoring_s for part in parts) / trees,
    )


class PenaltyTimes(NamedTuple):
    """Time of the penalty of a design of 40 branches, us."""

    at_once_us: float  # of a generation, compiled
    alone_us: float  # of one design, by the readable rules


def penalty_times() -> PenaltyTimes:
    """Measure the penalties of random designs of the paper's space with 3 children on 3 levels."""
    profile = read_profile(DEFAULT_RECIPE)
    three = SpaceSettings(levels=_fixed(4), branches=_fixed(3))
    space, penalty = Space(three, BuildSettings()), ManufacturabilityPenalty(profile=profile)
    x = np.random.default_rng(1).random((BENCH_DESIGNS, len(space)))
    at_once, batch = penalty.within(space), space.batch(x)
    designs = [space.design(point) for point in x]
    taken_s = least_each_s((lambda: at_once(batch), lambda: [penalty(one) for one in designs]))
    return PenaltyTimes(*(1e6 * each_s / BENCH_DESIGNS for each_s in taken_s))


def _fixed(value: float) -> Bounds:
    return Bounds(low=value, high=value)


def _table_of(design: Design) -> dict[int, dict[str, Bounds]]:
    """Return the ranges that leave nothing free of a design but a tenth of its trunk's length."""
    trunk_mm = design.trunk_length_mm
    table = {1: {"length_mm": Bounds(low=0.95 * trunk_mm, high=1.05 * trunk_mm)}}
    for number, level in enumerate(design.levels, start=2):
        table[number] = {
            "length_mm": _fixed(level.length_mm),
            "angle_deg": _fixed(math.degrees(level.fan_rad)),
            "branches": _fixed(level.branches),
            "growth_percent": _fixed(100.0 * level.growth),
        }
    return table


FIRST_GROWTHS = {"interpreted": "", "compiled": "import vinefab.growth.kernel\n"}
"""Ways of the first growth, and the code that a process runs before it."""

_FIRST_GROWTH = """
import sys, time
from vinefab.cli.main import main
code = main(["grow", "three_level_tree", "--map", sys.argv[1], "--quiet"])
print(time.process_time())
sys.exit(code)
"""


def first_growth_s(world: Map, before: str) -> float:
    """Return the processor time of ``vinefab grow`` where nothing was ever compiled."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.geojson"
        write_text(path, map_text(world))
        done = subprocess.run(  # noqa: S603  this interpreter, on our own code
            [sys.executable, "-c", before + _FIRST_GROWTH, str(path)],
            env=os.environ | {"VINEFAB_CACHE_DIR": folder},
            stdout=subprocess.PIPE,
            check=True,
        )
    return float(done.stdout)


_SCHEMA = "vinefab/bench-2"
SIZES = (300, 3_000, 30_000, 300_000)
MILLION = 1_010_000
"""Rounding and chance leave a little less."""

BATCH_SIZES = (1, 8, 64, 128, 512)
THREADS = (1, 2)
MEMORY_AFTER = (10_000, 100_000)
GROWTHS = 500
FORESEEN_GROWTHS = 10
BENCH_GENERATIONS = 100
FLOOR_GROWTHS = 100
"""Enough growths that the processor cannot predict the outcome of their tests."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchSize:
    """One map of the scaling."""

    walls: int  # number of walls
    prepare_s: float  # time to make walls and index out of the map
    ns_per_event: float  # time of one event of growth, one core


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkResult:
    """Everything that was measured.

    Times are of one core, for poses around the start of the smallest map, if not said otherwise.
    """

    # branches_per_s, evaluations_per_s: branches grown, and trees of 40 branches grown and scored
    # for coverage
    branches_per_s: float
    evaluations_per_s: float
    search: SearchEvaluation  # the same evaluations by the search's own evaluator
    penalty: PenaltyTimes  # how far designs are from manufacturable
    first_grow_s: dict[str, float]  # time of ``vinefab grow`` on a new computer, by `FIRST_GROWTHS`
    interpreted_branches_per_s: float  # grown by the kernel as the interpreter runs it
    evaluation_over_growth: float  # time of a full evaluation over that of growth alone
    # events_per_branch, ns_per_event: mean number of events, and the time of one
    events_per_branch: float
    ns_per_event: float
    # maps of growing size and the same density, grown on from poses anywhere on them
    sizes: tuple[BenchSize, ...]
    floor: Floor  # what the tests alone would take
    # time of one event where the same growth is done again and again, so that the processor
    # foresees every branch of the code: the rest of an event's time is wrong guesses
    foreseen_ns_per_event: float
    threads: dict[int, float]  # evaluations per second by number of threads, by the clock
    batches: dict[int, float]  # growths per second by number of growths in one compiled call
    # largest memory of the process so far (MB) after numbers of evaluations; empty where the system
    # does not tell
    memory: dict[int, float]
    # where the time of searches of the paper's size went, by optimizer, on two threads
    searches: dict[str, TimeSplit]

    @property
    def over_floor(self) -> float:
        """Time of an event over its floor."""
        return self.ns_per_event / self.floor.ns_per_event

    def text(self) -> str:
        """Return everything as JSON: ``vinefab/bench-2``."""
        content = asdict(self)
        content |= {
            "start_ns_per_event": self.ns_per_event,
            "edges": [size.walls for size in self.sizes],
            "ns_per_event": [size.ns_per_event for size in self.sizes],
            "floor_ns_per_event": self.floor.ns_per_event,
            "over_floor": self.over_floor,
            "search": self.search._asdict(),
            "penalty": self.penalty._asdict(),
        }
        for name in ("threads", "batches", "memory"):
            content[name] = {str(key): value for key, value in content[name].items()}
        content["searches"] = {
            name: {**split.content, "shares": split.shares} for name, split in self.searches.items()
        }
        return json_text(_SCHEMA, content)


def run_benchmark(*, million: bool = False) -> BenchmarkResult:
    """Measure everything; takes about a minute."""
    site = PreparedMap.of(square_map(SIZES[0]))
    poses = draw_poses(site.world, GROWTHS, 1)
    announce(Progress(phase="memory"))
    # First of all, because large maps leave the peak where no evaluation could raise it.
    memory, done = {}, 0
    launches = batch_on(site.terrain, poses).launches
    for count in MEMORY_AFTER:
        while done < count:
            _evaluate(site, launches)
            done += len(poses)
        peak = peak_mb()
        if peak is not None:
            memory[count] = peak
    walls = (*SIZES, MILLION) if million else SIZES
    sizes = []
    for wanted in each("maps of many walls", walls, lambda wanted: f"{wanted:,} walls"):
        world = square_map(wanted)
        began = time.process_time()
        terrain = Terrain.of(world)
        count = len(terrain.walls().wall)
        prepare_s = time.process_time() - began
        per_event = _ns_per_event(batch_on(terrain, free_poses(terrain, GROWTHS)))
        sizes.append(BenchSize(walls=count, prepare_s=prepare_s, ns_per_event=per_event))
    announce(Progress(phase="the smallest map"))
    batch = batch_on(site.terrain, poses)
    branches, count = len(batch) * len(batch.plans.each[0]), events(batch)
    grown_s, evaluated_s = least_each_s(
        (lambda: events(batch), lambda: _evaluate(site, batch.launches))
    )
    again = [batch_on(site.terrain, (pose,) * GROWTHS) for pose in poses[:FORESEEN_GROWTHS]]
    foreseen_ns = [_ns_per_event(growths) for growths in again]
    announce(Progress(phase="threads and batches"))
    return BenchmarkResult(
        branches_per_s=branches / grown_s,
        evaluations_per_s=len(batch) / evaluated_s,
        search=search_evaluation(site.world),
        penalty=penalty_times(),
        first_grow_s={name: first_growth_s(site.world, do) for name, do in FIRST_GROWTHS.items()},
        interpreted_branches_per_s=_interpreted(site.terrain, poses[:5]),
        evaluation_over_growth=evaluated_s / grown_s,
        events_per_branch=count / branches,
        ns_per_event=1e9 * grown_s / count,
        sizes=tuple(sizes),
        floor=floor_on(site.terrain, poses[:FLOOR_GROWTHS]),
        foreseen_ns_per_event=float(np.mean(foreseen_ns)),
        threads={count: _threaded(site, poses, count) for count in THREADS},
        batches={
            size: len(batch) / least_s(lambda size=size: list(batch.each(len, size=size)), 3)  # type: ignore[misc]
            for size in BATCH_SIZES
        },
        memory=memory,
        searches={name: search_split(name, max(THREADS), BENCH_GENERATIONS) for name in SEARCHES},
    )


def _ns_per_event(batch: Batch) -> float:
    return 1e9 * least_s(lambda: events(batch)) / events(batch)


def _evaluate(site: PreparedMap, launches: Launches, over: BlockMapper = map) -> None:
    score_designs([tree_of_40()], [site], launches, Coverage(area="fast"), BENCH_GROWTH, over)


def _interpreted(terrain: Terrain, poses: tuple[Pose, ...]) -> float:
    """Return the branches per second of the kernel as the interpreter runs it."""
    design = tree_of_40()
    taken_s = least_s(
        lambda: [grow_on(design, terrain, pose, BENCH_GROWTH, "interpreted") for pose in poses], 1
    )
    return len(poses) * len(design.tree) / taken_s


def _threaded(site: PreparedMap, poses: tuple[Pose, ...], threads: int) -> float:
    """Return evaluations per second on several threads, by the clock."""
    launches = batch_on(site.terrain, 8 * poses).launches
    with ThreadPoolExecutor(max_workers=threads) as pool:
        taken_s = least_s(lambda: _evaluate(site, launches, pool.map), wall_clock=True)
    return len(launches) / taken_s


def bench_blocks(result: BenchmarkResult) -> Iterator[Block]:
    """Yield everything that was measured."""
    yield Rows(
        caption="one tree of 40 branches on Grid maps, bare centreline; times of one core",
        headings=("", "", ""),
        rows=tuple(_compared(result)),
    )
    yield Rows(
        caption="growth from anywhere on maps of one density",
        headings=("walls", "prepare", "per event", "to the first"),
        rows=tuple(
            (
                f"{size.walls:,d}",
                Number(size.prepare_s, "s", ".2f"),
                Number(size.ns_per_event, "ns", ".1f"),
                Number(size.ns_per_event / result.sizes[0].ns_per_event, form=".2f"),
            )
            for size in result.sizes
        ),
    )
    floor = result.floor
    yield Notes(
        (
            f"floor: {floor.wall_tests:.2f} wall tests of {floor.wall_ns:.1f} ns and "
            f"{floor.corner_tests:.2f} corner tests of {floor.corner_ns:.1f} ns per event"
            f" = {floor.ns_per_event:.1f} ns",
            f"an event takes {result.ns_per_event:.1f} ns, {result.over_floor:.1f} times that; "
            f"{result.foreseen_ns_per_event:.1f} ns where the processor has learnt the growth",
            "the rest without the tests: wrong guesses of branches, finding cells, the tips "
            "themselves",
        )
    )
    for name, unit, rates in (
        ("threads", "evaluations/s", result.threads),
        ("growths per call", "growths/s", result.batches),
    ):
        yield Rows(
            caption=f"by number of {name}",
            headings=(name, "", "to one"),
            rows=tuple(
                (count, Number(rate, unit, ",.0f"), Number(rate / rates[1], form=".2f"))
                for count, rate in rates.items()
            ),
        )
    yield Notes(
        tuple(
            f"after {count:,} evaluations the process had taken {peak:.1f} MB at most"
            for count, peak in result.memory.items()
        )
    )
    yield Rows(
        caption=f"a search of the paper's size, {BENCH_DESIGNS} designs a generation on "
        f"{BENCH_MAPS} Grid maps",
        headings=("", ""),
        rows=tuple((name, split.summary) for name, split in result.searches.items()),
    )


def _compared(result: BenchmarkResult) -> Iterator[tuple[Value, ...]]:
    """Yield the rows of the table: a name, its rate or time, and a comment."""
    growths_per_s = result.branches_per_s / 40.0
    slower = result.branches_per_s / result.interpreted_branches_per_s
    search, penalty = result.search, result.penalty
    for name, rate, unit, words in (
        ("growth", result.branches_per_s, "branches/s",
         f"{growths_per_s:,.0f} trees/s, {result.events_per_branch:.2f} events a branch"),
        ("interpreted kernel", result.interpreted_branches_per_s, "branches/s",
         f"{slower:,.0f} times slower"),
        ("full evaluation", result.evaluations_per_s, "trees/s", "scored for coverage, "
         f"{result.evaluation_over_growth:.2f} times the time of growth alone"),
        ("full evaluation in a search", search.trees_per_s, "trees/s",
         f"growth {search.growth_us:.1f} us, scoring {search.scoring_us:.1f} us"),
    ):  # fmt: skip
        yield name, Number(rate, unit, ",.0f"), words
    longer = f"{penalty.alone_us / penalty.at_once_us:,.0f} times longer one by one"
    each = Number(penalty.at_once_us, "us", ".1f")
    yield "penalty", each, f"for each design of a generation, {longer}"
    for name, taken_s in result.first_grow_s.items():
        yield "first grow ever", Number(taken_s, "s", ".2f"), name
