"""The two kinds of work that studies are made of, kept in a folder and never done twice.

A job is a value: its result depends on nothing else, so it can be done in any process, in any
order, and once for several experiments. Below are the runs and tests that several experiments
share, and the experiments done: one page and one JSON file of results.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from vinefab.core import __version__
from vinefab.core.atomic import ensure_writable, is_ours, write_text
from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError, ForeignFileError, UnreadableFileError
from vinefab.core.hashing import fingerprint
from vinefab.core.limits import rad
from vinefab.core.plain_text import json_text
from vinefab.core.progress import each
from vinefab.core.validation import Floats
from vinefab.core.view import Answer, Block, Fact, Facts, Rows, Section
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Build, Design
from vinefab.model.files.run_context import package_versions
from vinefab.model.map import Map
from vinefab.pages.html import page
from vinefab.search.record.generations import RunIdentity
from vinefab.search.run import Search, generated_maps, penalty_of
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
    plain_settings,
)
from vinefab.studies import EXPERIMENTS
from vinefab.studies.claims import (
    CLAIM_HEADINGS,
    Claim,
    StudyResult,
    difference,
    held,
    held_corrected,
)
from vinefab.studies.workers import WorkerProcesses
from vinefab.tasks import make_task
from vinefab.tasks.evaluate import PreparedMap, composites, poses_on, score_design

USUAL_MM = 500.0
"""Size of the maps where a study does not say otherwise."""

USUAL_MAPS: Mapping[str, Mapping[str, Any]] = {"grid": {}, "cave": {"loops": 1.0}}
"""Options of an environment's maps that are not the generator's default: the
paper's Cave is "a series of interconnected closed pathways" (docs/studies/paper.md)."""

LARGE_MAPS: Mapping[str, Mapping[str, Any]] = {
    "grid": {"columns": 4, "rows": 4, "size_mm": 1250.0},
    "cave": {"loops": 1.0, "size_mm": 900.0},
}
"""The maps nearest to the paper's Fig. 4 in the study `scale`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySize:
    """Numbers of runs, maps and poses, and the maps' scale; the defaults are the paper's or larger.

    Lengths of Table 1 are the same at both scales. Lengths that the paper does not give, those of
    sensor, buffer and plain vine, are shares of the map.
    """

    seed: int = 1  # seed of the first run; run ``i`` has the i-th seed after it
    seeds: int = 10  # runs per setting, each on separate training maps [paper: 5]
    repeats: int = 10  # runs of `convergence` and `search` [paper: 10]
    single_seeds: int = 24  # runs per setting of `maps`: as many maps, where each trains on one
    ablation_seeds: int = 10  # runs per setting of `ablation`
    making_seeds: int = 10  # runs of each of the three ways per setting of `price`
    # population, generations: size of a search on coverage; 100 is the size of the paper's swarm in
    # MATLAB
    population: int = 100
    generations: int = 40
    training_maps: int = 24  # maps that a design is trained on
    maps_at_once: int = 6  # how many of them, drawn anew, every generation meets
    reach_maps_at_once: int = 2  # the same in training for reach, whose areas take longest
    choice_maps: int = 24  # maps on which the kept design of several is chosen
    # unseen_maps, poses: unseen maps, and poses on each [paper: 25 and 3]
    unseen_maps: int = 25
    poses: int = 3
    transfer_maps: int = 300  # unseen maps of `transfer`
    reach_maps: int = 25  # unseen maps of `reach`, one start on each
    headings: int = 50  # redeployments of a plain vine [paper: 50]
    large_maps: bool = False  # maps of the scale of Fig. 4 instead of 500 mm

    def map_options(self, environment: str) -> Mapping[str, Any]:
        """Return the common options of an environment's maps."""
        return (LARGE_MAPS if self.large_maps else USUAL_MAPS)[environment]

    @property
    def quick(self) -> bool:
        """Whether this is a smoke run."""
        return replace(self, large_maps=False) == QUICK_SIZE

    def scaled_mm(self, environment: str, length_mm: float) -> float:
        """Return the length that has the same share of these maps as one on maps of 500 mm."""
        size_mm: float = self.map_options(environment).get("size_mm", USUAL_MM)
        return length_mm * size_mm / USUAL_MM


PAPER_SIZE = StudySize()

QUICK_SIZE = StudySize(
    seeds=2,
    repeats=2,
    single_seeds=2,
    ablation_seeds=2,
    making_seeds=2,
    population=6,
    generations=2,
    training_maps=3,
    maps_at_once=2,
    choice_maps=2,
    unseen_maps=3,
    poses=2,
    transfer_maps=4,
    reach_maps=2,
    headings=6,
)
"""A smoke run: everything is done, nothing is learned from it."""


def as_tested(design: Design) -> Design:
    """Return a design with its shape and build alone: tests depend on nothing else of it."""
    return design.changed(origin={}, waivers=(), limits={}, folder=None)


def plain_vine(length_mm: float) -> Design:
    """Return an unbranched robot."""
    return Design(name="plain_vine", trunk_length_mm=length_mm, build=Build.standard(1))


def design_words(design: Design) -> str:
    """Return the size of a design in a few words."""
    fans = " x ".join(str(level.branches) for level in design.levels) or "no branches"
    length_m = total_length_mm(design) / 1000.0
    return f"{design.branch_count} branches ({fans}), {length_m:.1f} m of film in all"


def total_length_mm(design: Design) -> float:
    """Return the planned length of all branches together."""
    total, parents = design.trunk_length_mm, 1
    for level in design.levels:
        parents *= level.branches
        total += parents * level.length_mm * (1.0 + level.growth) / 2.0
    return total


FIRST_TEST_SEED = 900_001
"""Seed of the first map for testing; no design has trained on any of them."""

MAPS_KEPT = 600

PAPER_GROWTH = GrowthOptions.published(
    head_on_half_angle_rad=rad(1.0),
    children_of_stuck="stop",
    body="centerline",
    pressure_stop=False,
)
"""Growth in every study that does not say otherwise: the paper's model, whose body is a
line and which has no pressure. Nothing here depends on the default of `GrowthOptions`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobResult(Record):
    """The result of a job, as it is kept."""

    schema: ClassVar[str] = "vinefab/reproduction-part-2"
    key: str  # of the job


F_co = TypeVar("F_co", bound=JobResult, covariant=True)


class StudyJob(Protocol[F_co]):
    """Work with a unique name."""

    @property
    def key(self) -> str:
        """Its fingerprint, the same in every session."""
        ...

    @property
    def gives(self) -> type[F_co]:
        """Type of its result."""
        ...

    def run(self) -> F_co:
        """Do it."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained(JobResult):
    """The winner of a run, and how the search went."""

    design: Design
    fitness: float  # of the winner on fresh poses on the training maps
    # best, mean: fitness of each generation
    best: tuple[float, ...]
    mean: tuple[float, ...]
    evaluations: int
    penalty: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Training:
    """A run of the optimizer on generated maps."""

    gives: ClassVar = Trained
    settings: RunSettings  # the run

    @property
    def key(self) -> str:
        """Name of the run."""
        making = penalty_of(self.settings)
        return f"train_{RunIdentity.of(self.settings, (), making).run_id}"

    def run(self) -> Trained:
        """Run it."""
        settings = self.settings
        maps = [world(settings.maps, index) for index in range(settings.maps.count)]
        result = Search.of(settings, maps, penalty_of(settings)).run()
        return Trained(
            key=self.key,
            design=as_tested(result.best),
            fitness=result.finalists[0].fitness,
            best=tuple(g.best for g in result.history),
            mean=tuple(float(np.nanmean(g.composite)) for g in result.history),
            evaluations=result.evaluations,
            penalty=result.finalists[0].penalty,
        )


MapsByPoses = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tested(JobResult):
    """Scores of a design, maps by poses, and every term likewise."""

    scores: MapsByPoses
    terms: Mapping[str, MapsByPoses]


@dataclass(frozen=True, slots=True, kw_only=True)
class Testing:
    """A design scored over maps and poses."""

    gives: ClassVar = Tested
    design: Design  # `as_tested`
    worlds: MapSettings  # the maps; generated ones
    poses: int  # poses on each
    task: PartSettings  # what counts; areas are exact unless it says otherwise
    growth: GrowthOptions = PAPER_GROWTH  # how robots grow

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"test_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> Tested:
        """Score it."""
        sites = tuple(site(self.worlds, index) for index in range(self.worlds.count))
        # Poses go by the map's seed: every design tested on a map meets the same ones.
        first = self.worlds.seed
        poses = poses_on(sites, self.poses, range(first, first + self.worlds.count))
        task = make_task(self.task.name, self.task.parameters)
        score = score_design(self.design, sites, poses, task, self.growth)

        def by_map(values: Sequence[float]) -> MapsByPoses:
            rows = np.reshape(values, (self.worlds.count, self.poses)).tolist()
            return tuple(map(tuple, rows))

        names = tuple(score.evaluations[0].terms)
        return Tested(
            key=self.key,
            scores=by_map([one.score for one in score.evaluations]),
            terms={name: by_map([e.terms[name] for e in score.evaluations]) for name in names},
        )


def run_job(job: StudyJob[F_co]) -> F_co:
    """Do a job: what a worker process calls."""
    return job.run()


def site(worlds: MapSettings, index: int) -> PreparedMap:
    """Return one of some generated maps, made ready."""
    return _site(*_place(worlds, index))


def world(worlds: MapSettings, index: int) -> Map:
    """Return one of some generated maps; many runs train on the same ones."""
    return _world(*_place(worlds, index))


MapOptions = tuple[tuple[str, object], ...]


def _place(worlds: MapSettings, index: int) -> tuple[str, int, MapOptions]:
    return worlds.environment, worlds.seed + index, tuple(sorted(worlds.options.items()))


@lru_cache(maxsize=MAPS_KEPT)
def _site(environment: str, seed: int, options: MapOptions) -> PreparedMap:
    return PreparedMap.of(_world(environment, seed, options))


@lru_cache(maxsize=MAPS_KEPT)
def _world(environment: str, seed: int, options: MapOptions) -> Map:
    maps = MapSettings(environment=environment, count=1, seed=seed, options=dict(options))
    return generated_maps(maps)[0]


SETTINGS = "settings.json"

FINISHED = "finished.json"
"""The file by which the folder is known again; it names the experiments finished in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BegunStudies(Record):
    """What a folder was begun with."""

    schema: ClassVar[str] = "vinefab/reproduction-settings-2"
    vinefab: str  # version
    size: StudySize


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedStudies(Record):
    """The experiments finished in a folder."""

    schema: ClassVar[str] = "vinefab/reproduction-finished-1"
    names: tuple[str, ...] = ()


class JobStore:
    """A folder of finished jobs, and processes to do more; closed at the end of its block."""

    def __init__(self, folder: Path, size: StudySize, workers: int) -> None:
        self.folder = folder
        self.size = size
        self.workers = workers
        self.spent_s = 0.0
        self._pool: WorkerProcesses | None = None
        _begin(folder, size)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._pool is not None:
            self._pool.__exit__(kind)
            self._pool = None

    def finished(self) -> list[str]:
        """Return the names of the experiments that were finished in the folder."""
        path = self.folder / FINISHED
        return list(FinishedStudies.read(path).names) if path.exists() else []

    def finish(self, name: str) -> None:
        """Write down that an experiment is finished."""
        names = tuple(sorted({*self.finished(), name}))
        write_text(self.folder / FINISHED, FinishedStudies(names=names).json_text())

    def train(self, jobs: Sequence[Training]) -> list[Trained]:
        """Return the result of each run."""
        return self.do(jobs, "trainings")

    def test(self, jobs: Sequence[Testing]) -> list[Floats]:
        """Return the scores of each test, shape (maps, poses)."""
        return [np.array(found.scores) for found in self.do(jobs, "tests")]

    def terms(self, jobs: Sequence[Testing], name: str) -> list[Floats]:
        """Return one term of each test, shape (maps, poses)."""
        return [np.array(found.terms[name]) for found in self.do(jobs, "testing")]

    def do(self, jobs: Sequence[StudyJob[F_co]], words: str) -> list[F_co]:
        """Return the result of each job; results that are kept are not computed again."""
        keyed = {job.key: job for job in jobs}
        known = {key: self._kept(key, job) for key, job in keyed.items()}
        todo = {key: job for key, job in keyed.items() if known[key] is None}
        began_s = time.perf_counter()
        for key, found in each(words, self._done(todo), total=len(todo)):
            known[key] = found
            write_text(self._path(key), found.json_text())
        self.spent_s += time.perf_counter() - began_s
        return [result for job in jobs if (result := known[job.key]) is not None]

    def _done(self, todo: dict[str, StudyJob[F_co]]) -> Iterator[tuple[str, F_co]]:
        if self.workers == 1 or len(todo) < 2:
            yield from ((key, run_job(job)) for key, job in todo.items())
            return
        keys = list(todo)
        if self._pool is None:
            # Compiled here first: processes that compile at once would write the same cache.
            first = keys.pop(0)
            yield first, run_job(todo[first])
            # One pool for all: a process takes seconds to start.
            self._pool = WorkerProcesses(self.workers)
        found = self._pool.map(run_job, [todo[key] for key in keys])
        yield from zip(keys, found, strict=True)

    def _kept(self, key: str, job: StudyJob[F_co]) -> F_co | None:
        path = self._path(key)
        if not path.is_file():
            return None
        found = job.gives.read(path)
        if found.key != key:
            raise UnreadableFileError(path, "is not the part that it is called after")
        return found

    def _path(self, key: str) -> Path:
        return self.folder / "parts" / f"{key}.json"


def _begin(folder: Path, size: StudySize) -> None:
    """Write down what is done in a folder, or check that it is the same as before."""
    path = folder / SETTINGS
    now = BegunStudies(vinefab=__version__, size=size)
    if not path.exists():
        # A run that was killed as it began may have left the settings under a temporary name.
        begun_names = f".{SETTINGS}."
        if folder.is_dir() and any(not p.name.startswith(begun_names) for p in folder.iterdir()):
            raise ForeignFileError(folder, "holds other files; name another folder")
        write_text(path, now.json_text())
        return
    if not is_ours(path):
        raise ForeignFileError(path)
    ensure_writable(path, force=True)  # it is read only: changed values are named below
    begun = BegunStudies.read(path)
    before = {"vinefab": begun.vinefab, **asdict(begun.size)}
    for key, value in {"vinefab": now.vinefab, **asdict(size)}.items():
        if before[key] != value:
            allowed = f"{before[key]!r}, as it was begun; or another folder"
            raise BadInputError(key, value, allowed, path)


STUDIED_ENVIRONMENTS = ("grid", "cave")

NAMES = {"grid": "Grid", "cave": "Cave"}

FIRST_TRAINING = 1

FIRST_CHOICE = 800_001
"""Seed of the first map on which the kept design of several is chosen: none trains or is tested
there."""

SENSOR_MM = 50.0
"""Radius that a sensor sees, on maps of 500 mm. The paper does not publish it."""


def coverage_task(size: StudySize, environment: str) -> PartSettings:
    """Return coverage by sensors of the maps' scale."""
    radius_mm = size.scaled_mm(environment, SENSOR_MM)
    return PartSettings(name="coverage", parameters={"radius_mm": radius_mm})


def measured_fast(task: PartSettings) -> PartSettings:
    """Return a task with areas measured as in a search; anchoring has none.

    Of coverage that is 0.1 % off in the mean square, and a hundred times faster than exact areas.
    """
    if task.name == "anchoring":
        return task
    return task.changed(parameters={**task.parameters, "area": "fast"})


SWARM = PartSettings(name="particleswarm")
"""The paper's optimizer."""


def maps_of(size: StudySize, environment: str, first: int, count: int) -> MapSettings:
    """Return maps of an environment from the seed of the first."""
    options = size.map_options(environment)
    return MapSettings(environment=environment, count=count, seed=first, options=options)


def coverage_run(size: StudySize, environment: str, number: int) -> RunSettings:
    """Return the run that most experiments start from: coverage, all of Table 1, no making.

    Runs of other numbers have other training maps: what is said of all of them is not of one
    choice of maps only.
    """
    first = FIRST_TRAINING + number * size.training_maps
    return RunSettings(
        name=f"coverage_{environment}",
        maps=maps_of(size, environment, first, size.training_maps),
        task=coverage_task(size, environment),
        growth=PAPER_GROWTH,
        optimizer=SWARM,
        search=SearchSettings(
            population=size.population, generations=size.generations, seed=size.seed + number
        ),
        evaluation=EvaluationSettings(
            maps_per_generation=size.maps_at_once, final_poses_per_map=2, fabricable=False
        ),
    )


def with_evaluation(run: RunSettings, **changes: Any) -> RunSettings:  # noqa: ANN401
    """Return a run with another way of evaluating."""
    return run.changed(evaluation=run.evaluation.changed(**changes))


def trained(store: JobStore, runs: list[RunSettings]) -> list[Trained]:
    """Return the result of each run."""
    return store.train([Training(settings=run) for run in runs])


def unseen_test(
    size: StudySize,
    design: Design,
    environment: str,
    task: PartSettings | None = None,
    growth: GrowthOptions | None = None,
) -> Testing:
    """Return the test of a design on unseen maps of an environment; of coverage, measured fast."""
    return Testing(
        design=design,
        worlds=maps_of(size, environment, FIRST_TEST_SEED, size.unseen_maps),
        poses=size.poses,
        task=task or measured_fast(coverage_task(size, environment)),
        growth=growth or PAPER_GROWTH,
    )


def training_test(size: StudySize, run: RunSettings, design: Design) -> Testing:
    """Return the test of a run's design on its training maps, from fresh poses."""
    return replace(unseen_test(size, design, run.maps.environment), worlds=run.maps)


def study_scores(store: JobStore, tests: list[Testing]) -> Floats:
    """Return the scores of several tests, shape (tests, maps, poses)."""
    return np.stack(store.test(tests))


def kept(store: JobStore, runs: list[RunSettings], designs: list[Design]) -> int:
    """Return which run's design is kept: the best by its own weighting on maps for the choice.

    The paper takes the best in training. Here every run trains on separate maps, and the best in
    training would be the one with the easiest maps.
    """
    size = store.size
    tests = [
        replace(
            unseen_test(size, design, run.maps.environment, measured_fast(run.task), run.growth),
            worlds=run.maps.changed(seed=FIRST_CHOICE, count=size.choice_maps),
            poses=1,
        )
        for run, design in zip(runs, designs, strict=True)
    ]
    evaluation = runs[0].evaluation
    scores = study_scores(store, tests).reshape(len(runs), -1)
    worth = composites(scores, evaluation.composite, evaluation.reference_deviation)
    return int(np.argmax(worth))


def train_and_test(
    store: JobStore, names: Sequence[str], runs: list[RunSettings]
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Train several kinds of runs and test their designs on the Grid's unseen maps.

    Returns
    -------
    scores
        By kind, of all its designs, shape (runs, maps, poses).
    best
        Of the kept one only, shape (1, maps, poses).
    """
    found, each = trained(store, runs), len(runs) // len(names)
    scores: dict[str, Floats] = {}
    best: dict[str, Floats] = {}
    for place, name in enumerate(names):
        some = slice(place * each, (place + 1) * each)
        designs = [run.design for run in found[some]]
        scores[name] = study_scores(store, [unseen_test(store.size, d, "grid") for d in designs])
        best[name] = scores[name][kept(store, runs[some], designs)][None]
    return scores, best


MakeRun = Callable[[str, int], RunSettings]
"""The run of an environment and a number."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exchange:
    """Designs of both environments, and their scores in both."""

    designs: Mapping[str, list[Design]]  # for each environment, those that trained there
    best: Mapping[str, int]  # for each environment, which of them is kept
    # scores on fresh poses on the training maps, each of shape (runs, maps, poses)
    training: Mapping[str, Floats]
    # scores by where a design trained and where it was tested, likewise
    unseen: Mapping[tuple[str, str], Floats]

    @classmethod
    def of(
        cls,
        store: JobStore,
        make_run: MakeRun,
        count: int,
        *,
        unseen_maps: int = 0,
    ) -> "Exchange":
        """Train designs and test them, as their runs grow robots and score them.

        ``unseen_maps``: on how many; 0: as many as most experiments.
        """
        size = replace(store.size, unseen_maps=unseen_maps or store.size.unseen_maps)
        runs = {
            home: [make_run(home, number) for number in range(count)]
            for home in STUDIED_ENVIRONMENTS
        }
        found = trained(store, [run for home in STUDIED_ENVIRONMENTS for run in runs[home]])
        groups = {
            home: found[place * count : (place + 1) * count]
            for place, home in enumerate(STUDIED_ENVIRONMENTS)
        }
        designs = {home: [run.design for run in group] for home, group in groups.items()}
        training, unseen = {}, {}
        for home in STUDIED_ENVIRONMENTS:
            tests = [
                training_test(size, run, design)
                for run, design in zip(runs[home], designs[home], strict=True)
            ]
            training[home] = study_scores(store, _as_run(tests, runs[home][0]))
            for place in STUDIED_ENVIRONMENTS:
                tests = [unseen_test(size, design, place) for design in designs[home]]
                unseen[home, place] = study_scores(store, _as_run(tests, runs[place][0]))
        return cls(
            designs=designs,
            best={home: kept(store, runs[home], designs[home]) for home in STUDIED_ENVIRONMENTS},
            training=training,
            unseen=unseen,
        )

    def kept_design(self, home: str) -> Design:
        """Return the kept design of an environment."""
        return self.designs[home][self.best[home]]

    def kept_training(self, home: str) -> Floats:
        """Return the scores of a kept design on its training maps, shape (1, maps, poses)."""
        best = self.best[home]
        return self.training[home][best : best + 1]

    def kept_unseen(self, home: str, place: str) -> Floats:
        """Return the scores of a kept design on unseen maps, shape (1, maps, poses)."""
        best = self.best[home]
        return self.unseen[home, place][best : best + 1]

    def native_claim(self, place: str) -> Claim:
        """Return the claim that an environment's own designs do better there."""
        other = STUDIED_ENVIRONMENTS[1 - STUDIED_ENVIRONMENTS.index(place)]
        return Claim(
            text=f"On unseen {NAMES[place]} maps, {NAMES[place]} designs score above "
            f"{NAMES[other]} designs",
            tested=difference(self.unseen[place, place], self.unseen[other, place]),
            kept=difference(self.kept_unseen(place, place), self.kept_unseen(other, place)),
        )

    def harder_claim(self) -> Claim:
        """Return the claim that the Cave gives lower scores than the Grid."""
        return Claim(
            text="The Cave gives lower scores than the Grid, each to its own designs",
            tested=difference(
                self.unseen["grid", "grid"], self.unseen["cave", "cave"], same_maps=False
            ),
            kept=difference(
                self.kept_unseen("grid", "grid"),
                self.kept_unseen("cave", "cave"),
                same_maps=False,
            ),
        )


def _as_run(tests: list[Testing], run: RunSettings) -> list[Testing]:
    """Return tests on a run's kind of maps that grow robots and score them as it does."""
    return [
        replace(
            test,
            worlds=test.worlds.changed(options=run.maps.options),
            task=measured_fast(run.task),
            growth=run.growth,
        )
        for test in tests
    ]


STUDY_PAGE, NUMBERS = "reproduction.html", "reproduction.json"

REPRODUCTION_SCHEMA = "vinefab/reproduction-2"

ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """Experiments, done."""

    size: StudySize  # how large they were
    findings: tuple[StudyResult, ...]  # in the order of the registry
    spent_s: float  # what this session took; it is in no file, so that two runs give the same files

    @property
    def held(self) -> tuple[int, int]:
        """The number of claims that hold, and of all."""
        return held(self.findings)


def do_experiments(
    names: Sequence[str],
    folder: Path,
    size: StudySize,
    *,
    workers: int = 1,
    announce: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Do some experiments, and write all that the folder holds into one page and one JSON file."""
    wanted = [name for given in names for name in (EXPERIMENTS if given == ALL else [given])]
    for name in wanted:
        EXPERIMENTS[name]
    with JobStore(folder, size, workers) as store:
        ensure_writable(folder / STUDY_PAGE)
        ensure_writable(folder / NUMBERS)
        here = set(store.finished()) | set(wanted)
        findings = []
        asked = {name: EXPERIMENTS[name] for name in EXPERIMENTS if name in here}
        for name in each("experiments", asked, str):
            announce(name)
            findings.append(asked[name](store))
            store.finish(name)
    done = Reproduction(size=size, findings=tuple(findings), spent_s=store.spent_s)
    write_text(folder / NUMBERS, numbers_text(done))
    blocks = study_blocks(done.findings, done.size)
    write_text(folder / STUDY_PAGE, page("The paper's experiments, done again", blocks))
    return done


def numbers_text(done: Reproduction) -> str:
    """Return everything that was found as JSON: ``vinefab/reproduction-2``."""
    holding, claims = done.held
    content = {
        "quick": done.size.quick,
        "size": asdict(done.size),
        "claims_held": holding,
        "claims_held_corrected": held_corrected(done.findings),
        "claims": claims,
        "experiments": {finding.name: finding.plain() for finding in done.findings},
        "versions": package_versions(),
    }
    return json_text(REPRODUCTION_SCHEMA, content)


SUMMARY = (
    "Glick et al., Branching Vine Robots for Unmapped Environments (2022). All numbers are "
    "simulated unless a row says measured (the paper's hardware) or computed.",
    "A claim is a difference that should be above 0. It is held when all of its 95 % interval is. "
    "Intervals are Student's, with the variance between seeds and that between maps, poses kept "
    "together with their map, and maps or seeds paired where both sides met the same ones; of "
    "differences that are 0 about 5 % are taken for real (measured by simulation). 'Undecided' "
    "means that the interval holds 0. The last column is the interval for the kept designs alone, "
    "which is what the paper compares: over maps only.",
    "Only claims of the paper are counted. 'Our threshold' marks those with a limit or a form "
    "that the paper does not give, 'calibrated' those that come out because maps were set so.",
)

DIFFERENCES = (
    "The paper's supplement with map generators, fitness weights, its evolutionary algorithm and "
    "its sizes is not available. What fills these gaps is vinefab's own and assumed: the size of "
    "maps, lengths of Table 1 read as mm, sensors that see a tenth of a map's size, a buffer of 8 "
    "% of it, LGF as the length of "
    "the last child over the first, weights of coverage, friction 0.3. Numbers may differ for "
    "that; orderings should not.",
    "Training maps: the paper trains on 'several'. Here designs first trained on 6 fixed maps; the "
    "first full results showed Cave designs a quarter worse on unseen maps than in training, and "
    "training grew to 24 maps of which every generation meets 6, at the same number of "
    "evaluations. That change was made after a look at the final table, on the test maps of that "
    "time. Sizes, intervals and kinds of claims were set later still, after all claims had been "
    "seen at a smaller size.",
    "Cave maps: at first 0.4 of a Cave's possible short cuts were open, and one tree reached 85 % "
    "of unseen Caves. On training maps and maps of their own it was not the search that kept trees "
    "short but long tours, and fifty plain vines reached 43 % there, not the paper's 62 %. With "
    "all short cuts open plain vines reach 62 % in 5.5 shapes on the training maps (the paper: 5), "
    "so that was taken, for every experiment, before the new Caves' test maps were met. The "
    "'ablation' keeps the old Cave.",
    "Tests: the paper compares one kept design of five on one set of 75 evaluations, and shows one "
    "map of each environment for reach. Here every claim is tested over all seeds, each of which "
    "trained on separate maps, and over unseen maps; small differences that the paper calls an "
    "improvement may be undecided here.",
    "Growth: the body is a line and no pressure stops it, as in the paper. A tip that meets a wall "
    "within 1 degree of head-on stops, a tip in a corner stops, and branches of a stopped branch "
    "stay inside: the paper says none of this; 'ablation' changes the angle and the branches that "
    "stay inside.",
)


def study_blocks(findings: Sequence[StudyResult], size: StudySize) -> Iterator[Block]:
    """Yield the page of some experiments of one size."""
    holding, claims = held(findings)
    verdict = f"{holding} of {claims} orderings that the paper claims hold in these simulations."
    if size.quick:
        verdict = f"Smoke run: nothing is to be learned from these numbers. {verdict}"
    yield Answer(verdict, "good" if holding == claims and not size.quick else "caution")
    yield from next((finding.pictures[:1] for finding in findings if finding.pictures), ())
    yield Facts(
        (
            Fact("experiments", ", ".join(finding.name for finding in findings)),
            Fact("maps", maps_words(size)),
            Fact("training maps", size.training_maps),
            Fact("unseen maps x poses", f"{size.unseen_maps} x {size.poses}"),
            Fact("search", f"{size.population} designs x {size.generations} generations"),
            Fact("seeds", f"{size.seeds}, repeats {size.repeats}"),
        )
    )
    corrected = (
        f"{holding} of {claims} claims of the paper hold one by one; corrected for their number "
        f"(Holm), "
        f"{held_corrected(findings)} still do."
    )
    yield Section(
        title="What the paper claims, and whether it holds",
        paragraphs=(*SUMMARY, corrected),
        tables=(claims_table(findings),),
    )
    yield Section(title="What differs from the paper, and why", paragraphs=DIFFERENCES)
    for finding in findings:
        numbers = Rows(
            caption="Our numbers next to the paper's (simulated, with 95 % intervals)",
            headings=("", "here", "paper"),
            rows=tuple((row.what, row.ours, row.paper) for row in finding.rows),
        )
        tested = Rows(
            caption="Orderings, tested",
            headings=CLAIM_HEADINGS,
            rows=tuple(claim.cells() for claim in finding.claims),
        )
        yield Section(
            title=f"{finding.name}: {finding.title}",
            paragraphs=(*finding.protocol, *finding.remarks),
            tables=(numbers, tested) if finding.claims else (numbers,),
            pictures=finding.pictures,
        )


def maps_words(size: StudySize) -> str:
    """Return the size of the maps in a few words."""
    sizes = {home: size.scaled_mm(home, USUAL_MM) for home in STUDIED_ENVIRONMENTS}
    return ", ".join(f"{NAMES[home]} {size_mm:,.0f} mm" for home, size_mm in sizes.items())


def claims_table(findings: Sequence[StudyResult], columns: int | None = None) -> Rows:
    """Return all claims of some experiments, or the first columns of the table."""
    return Rows(
        caption="All claims",
        headings=("experiment", *CLAIM_HEADINGS)[:columns],
        rows=tuple(
            (finding.name, *claim.cells())[:columns]
            for finding in findings
            for claim in finding.claims
        ),
    )
