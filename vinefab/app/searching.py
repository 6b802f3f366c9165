"""Verbs about searches and studies: runs, contests, the paper, the studio, the demonstration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

from vinefab.app.common import (
    MOST_WORKERS,
    OptimizerLike,
    OutFolder,
    PoseCount,
    StudyOutcome,
    TaskLike,
    UnseenEnvironment,
    Workers,
    WrittenFile,
    page_path,
    task_of,
    write_page,
)
from vinefab.core.atomic import ensure_own_folder, ensure_writable
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    InterruptedRunError,
    UnfitInputError,
)
from vinefab.core.extras import ensure_extra
from vinefab.core.plain_text import counted
from vinefab.core.progress import Progress, heard_by
from vinefab.core.verbs import (
    IN_PLACE,
    SHELL,
    Force,
    Kind,
    ProgressLike,
    Seed,
    Within,
    also,
    note,
    registered_names,
    this_call,
    told,
    verb,
    wrote,
)
from vinefab.core.view import Answer, Fact, Facts
from vinefab.model.inputs import (
    DESIGNS,
    FOLDER,
    PAIRS,
    DesignLike,
    DesignsLike,
    MapLike,
    PathText,
    RecipeLike,
    all_names,
    as_designs,
    as_path,
    as_several,
    name_or_path,
    written,
)

if TYPE_CHECKING:
    from vinefab.search.optimizers.optimizer import OptimizerConfig
    from vinefab.search.record.result import RunResult
    from vinefab.search.run_pages import RunListing
    from vinefab.search.settings import RunSettings
    from vinefab.studies.frozen_problems import BenchmarkResults
    from vinefab.studies.optimizer_contest import Contender
    from vinefab.tasks.task import Task

    RunLike = RunSettings | str | PathLike[str]
    RunsLike = RunLike | tuple[RunLike, ...]
    Contenders = str | tuple[str, ...]
    ContendersLike = Contenders | OptimizerConfig
else:
    RunLike = Annotated[object, Kind(metavar="RUN.toml", files=partial(all_names, "run file"))]
    RunsLike = Annotated[
        object, Kind(metavar="RUN.toml", files=partial(all_names, "run file"), several=True)
    ]
    Contenders = Annotated[
        object,
        Kind(
            metavar="NAME[:KEY=VALUE,...]",
            known=registered_names("vinefab.search.optimizers.optimizer:OPTIMIZERS"),
            several=True,
        ),
    ]
    ContendersLike = Contenders

_FRONT_FILES = ("front.json", "front.svg", "front.png", "front.pdf")


@verb
def optimize(
    run: RunLike,
    *,
    out: Annotated[PathText | None, FOLDER] = None,
    workers: Annotated[int | None, Within(0, MOST_WORKERS)] = None,
    cluster: Annotated[str | None, Kind(metavar="ADDRESS")] = None,
    seed: Seed | None = None,
    task: TaskLike | None = None,
    optimizer: OptimizerLike | None = None,
    resume: bool = False,
    generations: int | None = None,
    evaluations: int | None = None,
    wall_time_s: float | None = None,
    page: bool = True,
    progress: ProgressLike = True,
    force: Force = False,
) -> RunResult:
    """Search for the best design of a run; a page shows it, also while it is going on.

    Every generation is recorded: the same call continues a stopped run and gives the result of one
    that has ended; with ``resume`` and ``generations``, ``evaluations`` or ``wall_time_s`` it
    searches on, as if it had been asked for more at once. The exit code of the command is 1 where
    no manufacturable robot was found.

    Parameters
    ----------
    run
        A run file, or the name of a shipped one, in Python also settings.
    out
        A folder for the record (``run.sqlite``), ``best.toml``, the page ``index.html`` with its
        pictures and, for several objectives, the front; in Python None keeps the result in memory.
    workers
        Threads; no result depends on it. With a cluster they evaluate what is too little to hand
        out; 0: nothing is evaluated here. Default: 1; N with local:N.
    cluster
        local:N, or the address of a dask scheduler that you trust: generations that are worth it
        are handed out. For tls:// dask takes PEM files from DASK_DISTRIBUTED__COMM__TLS__CA_FILE,
        DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and ..._TLS__CLIENT__KEY.
    seed
        Seed of the search in place of the run's.
    task
        A task in place of the run's: its name, in Python also a task of your own.
    optimizer
        An optimizer in place of the run's: its name, in Python also one of your own.
    resume
        Continue the run in ``out``; needed to raise its limits, and with a task or an optimizer of
        your own.
    generations
        With ``resume``: go on until so many generations.
    evaluations
        With ``resume``: until so many designs are evaluated; 0: no limit.
    wall_time_s
        With ``resume``: until all sessions took so long; 0: no limit.
    page
        Write the page, also while the run is going on.
    progress
        True: a line in notebooks and on terminals after two seconds; False: nothing; a function:
        called with a Progress, the phase of the work and its count, whenever it changes; after
        every generation it is a SearchProgress, with ``best``, ``mean`` and ``history``.

    Returns
    -------
    RunResult
        The winner is ``best``; ``history`` holds every generation, ``score`` the winner's score on
        fresh poses, and ``prediction`` the winner's scores on unseen maps, over contacts and placed
        off: ``prediction.unseen.score.mean``, ``prediction.unseen.over_contacts`` and others.

    Raises
    ------
    BadInputError
        If a setting cannot be used, no design of the space can be made, or ``out`` holds another
        run.
    ForeignFileError
        If ``out`` holds something else.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab optimize grid_coverage --out run --workers 2

    >>> from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings
    >>> from vinefab.search.settings import SearchSettings
    >>> found = optimize(
    ...     RunSettings(
    ...         maps=MapSettings(count=1, options={"columns": 3, "rows": 3}),
    ...         search=SearchSettings(population=4, generations=2),
    ...         evaluation=EvaluationSettings(fabricable=False),
    ...     )
    ... )
    >>> len(found.history)
    2
    """
    from dataclasses import replace

    from vinefab.search.record.result import RECORD_FILE
    from vinefab.search.run import make_point_evaluator, violations_of
    from vinefab.search.run_pages import PAGE_NAME
    from vinefab.search.settings import LIMIT_NAMES, PartSettings

    settings, source = _run_of(run)
    own_task = None if task is None or isinstance(task, str) else task_of(task, {})
    if isinstance(task, str):
        settings = settings.changed(task=PartSettings(name=task))
    settings, own_optimizer = _searched_by(settings, optimizer)
    if seed is not None:
        settings = settings.changed(search=settings.search.changed(seed=seed))
    limits = {
        name: value
        for name, value in zip(LIMIT_NAMES, (generations, evaluations, wall_time_s), strict=True)
        if value is not None
    }
    for name in limits:
        if not resume:
            remedy = f"give resume, or set optimizer.{name} in its file"
            raise UnfitInputError(name, "changes a run that is resumed", remedy)
    if out is None:
        if resume:
            raise UnfitInputError("resume", "needs the folder of the run", "give out")
        if SHELL.get() is not None:
            raise BadInputError("out", None, "the folder for the record and best.toml")
        evaluator = make_point_evaluator(workers, cluster)
        with told(progress), heard_by(_Advised().hear):
            return _searched(settings, own_task, own_optimizer, evaluator)

    from vinefab.prediction.run_winner import run_in_folder

    folder = as_path("out", out)
    # The code of a user's parts is not part of a run's identity: it may have changed.
    own = own_task is not None or own_optimizer is not None
    if not resume and not own and (folder / RECORD_FILE).is_file():
        resume = True
        note(f"{folder} holds a run: if it is this one, it is continued", only_in_shell=True)
    pages = (PAGE_NAME,) if page else ()
    for name in ("best.toml", *pages, *(_FRONT_FILES if settings.objectives else ())):
        ensure_writable(folder / name, force=force)
    again = this_call().text(resume=True)
    with told(progress), heard_by(_Advised().hear):
        with _resumable(again):
            ended = run_in_folder(
                settings,
                folder,
                again=again,
                page=page,
                resume=resume,
                limits=limits or None,
                workers=make_point_evaluator(workers, cluster),
                source=source,
                task=own_task,
                optimizer=own_optimizer,
            )
            result = ended.result
            again_scored = _score_again(result, settings, folder / "best.toml", own_task)
            result = replace(result, violations=violations_of(result, settings), again=again_scored)
        with _resumable(again), _recorded(again):
            result.write_winner(folder, force=force)
            if settings.objectives:
                from vinefab.search.front import front_table, write_front

                members = write_front(result, settings, folder, force=force)
                result = replace(result, front=front_table(members, settings))
                note(
                    f"wrote {folder / 'front.json'}, {folder / 'front.svg'} and designs in "
                    f"{folder / 'front'}",
                    only_in_shell=True,
                )
            if page:
                from vinefab.prediction.run_winner import write_run_page

                wrote(write_run_page(folder, replace(ended, result=result), force=force))
    note(f"wrote {folder / 'best.toml'} and {folder / 'run.sqlite'}", only_in_shell=True)
    return result


def _score_again(
    result: RunResult, settings: RunSettings, best: Path, task: Task | None = None
) -> str:
    """Return the call that scores a winner as its run did; empty where no call says so much."""
    from vinefab.app.predicting import score
    from vinefab.model.map import Start

    start, evaluation = settings.maps.start, settings.evaluation
    if isinstance(start, Start) or evaluation.pose_range != 1.0:
        return ""
    names = dict.fromkeys(one.map_name for one in result.score.evaluations)
    maps = tuple(settings.maps.files or (f"{name}.geojson" for name in names))
    most_named = 16  # as many as a line that people read can name
    if len(maps) > most_named:
        return ""
    call = this_call().to(
        score,
        design=best,
        **({"task": task} if task else {}),
        maps=maps,
        **({} if start is None else {"start": start.text}),
        poses=evaluation.final_poses_per_map,
        seed=result.best.origin["seed_of_score"],
    )
    return call.text()


def _searched_by(
    settings: RunSettings, optimizer: OptimizerLike | None
) -> tuple[RunSettings, OptimizerConfig | None]:
    """Return settings with an optimizer that is named, or one that is an object."""
    from vinefab.search.optimizers.optimizer import make_optimizer_config
    from vinefab.search.settings import PartSettings

    if optimizer is None:
        return settings, None
    if isinstance(optimizer, str):
        make_optimizer_config(optimizer)  # an unknown name is refused here
        return settings.changed(optimizer=PartSettings(name=optimizer)), None
    if not callable(getattr(optimizer, "start", None)):
        allowed = "a name, or an object with start(axes, population, seed)"
        raise BadInputError("optimizer", optimizer, allowed)
    return settings, optimizer


def _run_of(given: RunLike, key: str = "run") -> tuple[RunSettings, Path | None]:
    """Return the settings of a run, and the file that they come from."""
    from vinefab.model.files.shipped import locate
    from vinefab.search.manufacturability import with_build_for_film
    from vinefab.search.settings import RunSettings, read_run

    if isinstance(given, RunSettings):
        return with_build_for_film(given), None
    allowed = "RunSettings, the path of a run file (TOML), or the name of a shipped one"
    path = locate("run file", name_or_path(key, given, allowed, "run file"))
    return with_build_for_film(read_run(path)), path


class _Advised:
    """Hears a search, and passes on its advice, each once."""

    def __init__(self) -> None:
        self._given = {""}

    def hear(self, progress: Progress) -> None:
        """Say an advice that is new."""
        advice = getattr(progress, "advice", "")
        if progress.within is None and advice not in self._given:
            self._given.add(advice)
            note(advice, only_in_shell=True)


def _searched(
    settings: RunSettings,
    task: Task | None,
    optimizer: OptimizerConfig | None,
    workers: Any,
) -> RunResult:
    """Return the result of a search that is not recorded."""
    from dataclasses import replace

    from vinefab.core.compiling import precompile
    from vinefab.prediction.run_winner import predict_winner
    from vinefab.search.needed_code import needed_code
    from vinefab.search.run import Search, fresh_maps, penalty_of, recipe_of, training_maps

    maps, fresh = training_maps(settings), fresh_maps(settings)
    search = Search.of(
        settings, maps, penalty_of(settings), task=task, optimizer=optimizer, fresh_maps=fresh
    )
    precompile(needed_code(settings, maps) if task is None else ())
    result, recipe = search.run(workers=workers), recipe_of(settings)
    if recipe is not None:
        result = result.with_recipe(recipe)
        if (file := Path(settings.evaluation.recipe)).is_file():  # nothing keeps a copy
            best, folder = result.best, file.resolve().parent
            found = {**best.origin["recipe"], "file": file.name}
            best = best.changed(origin={**best.origin, "recipe": found}, folder=folder)
            result = replace(result, best=best)
    return result.with_prediction(predict_winner(search, result))


@contextmanager
def _resumable(again: str) -> Iterator[None]:
    """Report how to resume when the user interrupts the block of a command."""
    try:
        yield
    except KeyboardInterrupt as stop:
        if SHELL.get() is None:
            raise
        raise InterruptedRunError("the generations so far are recorded", again) from stop


@contextmanager
def _recorded(again: str) -> Iterator[None]:
    """Report, when a file cannot be written, that the record is complete."""
    try:
        yield
    except CannotWriteError as error:
        problem = f"{error.problem}; the run is complete and recorded, to write its files: "
        raise CannotWriteError(error.path, f"{problem}{again}") from None


@verb
def runs(
    *folders: Annotated[PathText, Kind(metavar="DIR")],
    rebuild: Annotated[PathText | None, FOLDER] = None,
    best: Annotated[PathText | None, Kind(metavar="FILE", writes="file")] = None,
    force: Force = False,
) -> RunListing:
    """List the records of runs in folders and below, with mean and deviation over seeds.

    The exit code of the command is 1 where some runs of the best winner have not ended, or no
    record can be read.

    Parameters
    ----------
    *folders
        Folders of runs, or folders above them.
    rebuild
        Write best.toml, page and figures of the run in the one folder here, from its record alone.
    best
        Write the best winner of runs that differ in their seed alone to this file.

    Returns
    -------
    RunListing
        ``rows``, one for each run with its ``folder``, ``seed``, ``winner_score`` and others, and
        ``summary``; `RunResult.read` reads one of them.

    Raises
    ------
    BadInputError
        If a folder has no run in it or below.

    Examples
    --------
    $ vinefab runs . --json -

    >>> runs("night")  # doctest: +SKIP
    """
    from dataclasses import replace

    from vinefab.search.run_pages import list_runs, write_best
    from vinefab.search.run_pages import rebuild as rebuilt

    if not folders:
        raise BadInputError("folders", None, "folders of runs, or folders above them")
    paths = [as_path("folders", folder) for folder in folders]
    if rebuild is not None and len(paths) > 1:
        problem = f"{counted(len(paths), 'folder')} are given, and one record is rebuilt"
        raise UnfitInputError("rebuild", problem, "name one folder")
    listing = list_runs(paths)
    if rebuild is not None:
        from vinefab.prediction.run_winner import EndedRun, write_run_page

        out, run = as_path("rebuild", rebuild), EndedRun.read(paths[0])
        again = _score_again(run.result, run.settings, out / "best.toml")
        run = replace(run, result=replace(run.result, again=again))
        for path in (*rebuilt(paths[0], out, force=force), write_run_page(out, run, force=force)):
            wrote(path)
    if best is not None:
        file = as_path("best", best)
        listing = replace(listing, whole=write_best(listing, file, force=force))
        wrote(file, "" if listing.whole else ", of the runs that have ended")
    return listing


@verb
def contest(
    run_files: RunsLike,
    *,
    optimizers: Annotated[Contenders, also("--optimizer")],
    out: Annotated[PathText, FOLDER],
    seeds: int = 10,
    unseen: int = 25,
    poses: PoseCount = 3,
    workers: Annotated[Workers, also("--jobs")] = 1,
    progress: ProgressLike = True,
    force: Force = False,
) -> StudyOutcome:
    """Compare optimizers on run files at equal evaluations; run again, it continues.

    Parameters
    ----------
    run_files
        The problems: run files, or shipped names; in Python RunSettings too.
    optimizers
        NAME or NAME:KEY=VALUE,...; several; the first is the reference.
    out
        Folder for table, figure and record.
    seeds
        Runs of each optimizer on each problem.
    unseen
        Maps to test every winner on.

    Raises
    ------
    BadInputError
        If a setting cannot be used.
    UnknownNameError
        If there is no such optimizer.

    Examples
    --------
    $ vinefab study contest examples/contest/grid.toml --optimizer cmaes --optimizer random
      --seeds 2 --unseen 5 --out contest

    >>> contest("grid_coverage", optimizers=("cmaes", "random"), out="x")  # doctest: +SKIP
    """
    from vinefab.studies.optimizer_contest import (
        Contest,
        comparison_blocks,
        comparison_json,
        comparison_svg,
        contest_rows,
    )

    problems = [_run_of(one, "run_files") for one in as_several(run_files)]
    plan = Contest(
        problems=tuple(settings for settings, _ in problems),
        contenders=tuple(_contenders(optimizers)),
        seeds=seeds,
        unseen=unseen,
        poses=poses,
        sources=tuple(path or Path(settings.name) for settings, path in problems),
    )
    folder = as_path("out", out)
    with told(progress):
        rows = contest_rows(plan, folder / "bouts.jsonl", jobs=workers, force=force)
    document = comparison_json(plan, rows)
    write_page(folder / "comparison.json", document, force=force)
    write_page(folder / "comparison.svg", comparison_svg(plan, rows), force=force)
    blocks = tuple(comparison_blocks(plan, rows))
    return StudyOutcome(found=rows, blocks=blocks, text=document)


@verb
def benchmark(
    *problems: Annotated[
        str,
        Kind(metavar="PROBLEM", known=registered_names("vinefab.studies.frozen_problems:DIGESTS")),
    ],
    optimizers: Annotated[ContendersLike, also("--optimizer")] = (),
    designs: Annotated[DesignsLike, DESIGNS] = (),
    out: Annotated[PathText, FOLDER],
    seeds: int = 10,
    workers: Annotated[Workers, also("--jobs")] = 1,
    progress: ProgressLike = True,
    force: Force = False,
) -> BenchmarkResults:
    """Score optimizers or designs on problems that never change; run again, it continues.

    ``compare`` ranks the files of several people together.

    Parameters
    ----------
    *problems
        Problems; default: all.
    optimizers
        NAME or NAME:KEY=VALUE,...; several; in Python also one of your own.
    designs
        Designs to score, however they were found.
    out
        Folder for record and benchmark.json.
    seeds
        Searches of each optimizer on each problem.

    Raises
    ------
    BadInputError
        If there is neither an optimizer nor a design.
    UnfitInputError
        If this version would pose another problem.
    UnknownNameError
        If there is no such problem, optimizer or design.

    Examples
    --------
    $ vinefab study benchmark grid-coverage-free-pass --optimizer islands --seeds 2 --out mine
    $ vinefab compare mine/benchmark.json

    >>> benchmark("grid-reach-levels-pass", designs="grid_explorer", out="x")  # doctest: +SKIP
    """
    from vinefab.studies.frozen_problems import (
        BENCHMARK_FILE,
        BenchmarkResults,
        BenchmarkRow,
        benchmark_contest,
        posed,
        rows_of_designs,
    )
    from vinefab.studies.optimizer_contest import contest_rows

    contenders, robots = _contenders(optimizers), as_designs(designs, "designs")
    if not contenders and not robots:
        raise BadInputError("--optimizer", None, "an optimizer, or --designs")
    folder = as_path("out", out)
    with told(progress):
        chosen = posed(problems)
        rows = list[BenchmarkRow]()
        if contenders:
            plan = benchmark_contest(chosen, contenders, seeds)
            done = contest_rows(plan, folder / "bouts.jsonl", jobs=workers, force=force)
            rows += map(BenchmarkRow.of_run, done)
        rows += rows_of_designs(robots, chosen)
    found = BenchmarkResults(rows=tuple(rows))
    write_page(folder / BENCHMARK_FILE, found.json_text(), force=force)
    return found


def _contenders(given: ContendersLike) -> list[Contender]:
    """Return optimizers by name with their parameters, or one of the caller's."""
    from vinefab.search.optimizers.optimizer import make_optimizer_config
    from vinefab.search.settings import PartSettings
    from vinefab.studies.optimizer_contest import Contender

    if callable(getattr(given, "start", None)):
        own = cast("OptimizerConfig", given)
        return [Contender(label=type(own).__name__, part=PartSettings(name="islands"), own=own)]
    contenders = []
    for text in as_several(given):
        name, _, rest = text.partition(":")
        assert PAIRS.read is not None  # noqa: S101  for the type checker
        parameters: Mapping[str, Any] = dict(map(PAIRS.read, rest.split(",") if rest else []))
        make_optimizer_config(name, parameters)
        part = PartSettings(name=name, parameters=parameters)
        contenders.append(Contender(label=text, part=part))
    return contenders


@verb
def reproduce(
    *names: Annotated[
        str, Kind(metavar="NAME", known=registered_names("vinefab.studies:EXPERIMENTS"))
    ],
    out: Annotated[PathText, FOLDER],
    quick: bool = False,
    large_maps: bool = False,
    workers: Annotated[Workers, Within(1, 256)] = 2,
    progress: ProgressLike = True,
) -> StudyOutcome:
    """Do the paper's experiments again and compare our numbers with the paper's.

    Finished parts are kept in the folder and not done again; no number depends on how many
    processes work or on how often the run was stopped. The exit code is 0 whether the paper's
    claims hold or not.

    Parameters
    ----------
    *names
        Experiments, or all.
    out
        The folder; a stopped run continues in it.
    quick
        A smoke run within a minute.
    large_maps
        Maps of the scale of Fig. 4 (Grid 1,250 mm, Cave 900 mm) instead of 500 mm.

    Raises
    ------
    BadInputError
        If no experiment is named.
    UnknownNameError
        If there is no such experiment.

    Examples
    --------
    $ vinefab study reproduce all --quick --out reproduction

    >>> reproduce("transfer", out="reproduction", quick=True)  # doctest: +SKIP
    """
    from dataclasses import replace

    from vinefab.studies import EXPERIMENTS
    from vinefab.studies.study_runs import (
        NUMBERS,
        PAPER_SIZE,
        QUICK_SIZE,
        STUDY_PAGE,
        claims_table,
        do_experiments,
        numbers_text,
    )

    if not names:
        raise BadInputError("NAME", None, f"{', '.join(EXPERIMENTS)}, or all")
    ensure_extra("studies", "reproduce")
    folder, size = as_path("out", out), QUICK_SIZE if quick else PAPER_SIZE
    size = replace(size, large_maps=large_maps)
    with told(progress):
        done = do_experiments(
            names, folder, size, workers=workers,
            announce=lambda name: note(name, only_in_shell=True),
        )  # fmt: skip
    held, claims = done.held
    spent = f"{done.spent_s:.0f} s of work in this session"
    blocks = (
        claims_table(done.findings, columns=6),
        Answer(f"{held} of {claims} claims of the paper hold; {spent}"),
        _written_facts({"read this first": folder / STUDY_PAGE, "numbers": folder / NUMBERS}),
    )
    claimed = ((one.name, claim.plain()) for one in done.findings for claim in one.claims)
    table = tuple({"experiment": name, **plain} for name, plain in claimed)
    return StudyOutcome(found=done, blocks=blocks, text=numbers_text(done), table=table)


def _written_facts(files: Mapping[str, Path]) -> Facts:
    return Facts(tuple(Fact(words, str(path)) for words, path in files.items()))


@verb
def bench(*, million: bool = False, progress: ProgressLike = True) -> StudyOutcome:
    """Measure growth against other ways to compute the same and its floor, and a search's time.

    Parameters
    ----------
    million
        Grow on a map of a million walls too.

    Raises
    ------
    BadInputError
        If a value cannot be used.

    Examples
    --------
    $ vinefab study bench --json bench.json

    >>> bench()  # doctest: +SKIP
    """
    from vinefab.studies.benchmark import bench_blocks, run_benchmark

    with told(progress):
        result = run_benchmark(million=million)
    return StudyOutcome(found=result, blocks=tuple(bench_blocks(result)), text=result.text())


@verb
def demo(
    *,
    out: OutFolder = "demo",
    seed: Seed = 1,
    generations: Annotated[int, Within(1, 1_000_000)] = 40,
    population: Annotated[int, Within(2, 1_000_000)] = 32,
    progress: ProgressLike = True,
    force: Force = False,
) -> StudyOutcome:
    """Run the main job at small size: maps, optimization, unseen-map test, files, rig, report.

    The exit code of the command is 1 where a rule forbids the robot.

    Parameters
    ----------
    generations
        Generations of the search.
    population
        Designs per generation.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    ForeignFileError
        If ``out`` holds something else.

    Examples
    --------
    $ vinefab demo --out demo

    >>> demo(out="demo")  # doctest: +SKIP
    """
    from vinefab.core.atomic import new_folder
    from vinefab.demonstration import DemoSettings, run_demo

    mark = "results.json"  # by which a folder of this verb is known again
    folder = as_path("out", out)
    ensure_own_folder(folder, mark, force=force)

    def say(words: str) -> None:
        note(words, only_in_shell=True)

    say("vinefab demo: sensor coverage in a Grid environment, a robot that can be cut")
    settings = DemoSettings(seed=seed, generations=generations, population=population)
    with told(progress), new_folder(folder, mark, force=force) as place:
        found = run_demo(place, settings, say)
    where = {
        "read this first": "report.html",
        "for the laser": "package/README.txt",
        "for the printer": "rig/rig.json",
        "the design": "run/best.toml",
        "numbers": mark,
    }
    written = {words: folder / name for words, name in where.items()}
    name = f"{found.result.best.name}, run {found.result.run_id}"
    return StudyOutcome(
        found=found,
        blocks=(Answer(name), found.table(), _written_facts(written)),
        text=(folder / mark).read_text(encoding="utf-8"),
        exit_code=0 if found.is_manufacturable else 1,
    )


@verb
def studio(
    design: Annotated[DesignLike, IN_PLACE] = "grid_explorer_levels",
    map: MapLike | None = None,
    *,
    environment: UnseenEnvironment = "grid",
    recipe: RecipeLike | None = None,
    port: int = 0,
    browser: bool = True,
    snapshot: Annotated[PathText | None, written(".html")] = None,
    family: bool = False,
    progress: ProgressLike = True,
    force: Force = False,
) -> WrittenFile | None:
    """Design with the robot under your hands: a page where every change is seen at once.

    Parameters
    ----------
    design
        A design file, or the name of a shipped design; a snapshot is opened again.
    map
        A map file.
    environment
        The environment of the maps, where no map is given.
    recipe
        A recipe file, or a shipped one's name.
    port
        Where to listen; 0: any port that is free.
    browser
        Open the page in the browser.
    snapshot
        Serve nothing: write the page as it begins, with all that it shows, as one HTML file that
        needs no server. `vinefab studio FILE.html` opens it again.
    family
        With a snapshot: the robot on many maps too.

    Raises
    ------
    BadInputError
        If a value cannot be used, or the packages of the studio are missing.

    Examples
    --------
    $ vinefab studio grid_explorer --environment cave
    $ vinefab studio mine.toml --map table.geojson --snapshot state.html

    >>> studio("mine.toml", snapshot="state.html")  # doctest: +SKIP
    """
    ensure_extra("studio", "the studio")
    from vinefab.studio.server import LaunchOptions, serve

    page = page_path("snapshot", snapshot, force=force)
    opened = LaunchOptions(
        design=str(name_or_path("design", design, "a design file, or a shipped name", "design")),
        map_file=None if map is None else as_path("map", map, "the path of a map file"),
        environment=environment,
        recipe=""
        if recipe is None
        else str(name_or_path("recipe", recipe, "a path or a name", "recipe")),
    )
    if page is None:
        if family:
            raise UnfitInputError("family", "belongs to a snapshot", "give --snapshot too")
        serve(opened, port=port, browser=browser, say=lambda words: note(words, only_in_shell=True))
        return None
    from vinefab.studio.file_exports import SnapshotOptions, write_snapshot
    from vinefab.studio.server import StudioWorkspace

    options = SnapshotOptions(family=family, file=opened.design)
    with told(progress):
        write_snapshot(StudioWorkspace(opened).state, page, options, force=force)
    wrote(page)
    return WrittenFile(path=page)
