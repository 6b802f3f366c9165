"""``vinefab optimize``: search for the best design, and write the front where there is one."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    EXIT_FINDINGS,
    CommandOutput,
    Force,
    JsonOut,
    Quiet,
    Verbose,
    names_like,
)
from vinefab.core.atomic import ensure_writable
from vinefab.core.errors import BadInputError, CannotWriteError, InterruptedRunError
from vinefab.model.files.shipped import locate
from vinefab.prediction.run_folder import run_in_folder
from vinefab.search.live_page import PAGE_NAME
from vinefab.search.record.generations import Progress
from vinefab.search.record.result import RunResult
from vinefab.search.run import (
    make_point_evaluator,
    progress_line,
    result_json,
    result_lines,
    violations_of,
)
from vinefab.search.settings import RunLimits, RunSettings, limit_option, read_run

FRONT_FILES = ("front.json", "front.svg", "front.png")


def _runs_like(incomplete: str) -> list[str]:
    return names_like("run file", incomplete)


def optimize_command(
    *,
    run_file: Annotated[
        str,
        typer.Argument(
            metavar="RUN.toml",
            help="A run file, or the name of a shipped example.",
            autocompletion=_runs_like,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for the record and best.toml.")],
    workers: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Threads; results do not depend on it. With --cluster they evaluate what is too "
            "little to hand out; 0: nothing is evaluated here.  [default: 1; N with local:N]",
            show_default=False,
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            help="local:N, or the address of a dask scheduler that you trust: generations that "
            "are worth it are handed out. For tls:// dask takes PEM files from "
            "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and "
            "..._TLS__CLIENT__KEY."
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Seed of the search in place of the run file's.", metavar="N"),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the run in --out.")] = False,
    generations: Annotated[
        int | None, typer.Option(help="With --resume: go on until so many generations.")
    ] = None,
    evaluations: Annotated[
        int | None,
        typer.Option(help="With --resume: until so many designs are evaluated; 0: no limit."),
    ] = None,
    wall_time_s: Annotated[
        float | None,
        typer.Option(help="With --resume: until all sessions took so long; 0: no limit."),
    ] = None,
    page: Annotated[
        bool, typer.Option("--page/--no-page", help="Write index.html, also during the run.")
    ] = True,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    force: Force = False,
) -> int:
    """Search for the best design; DIR/index.html shows it, also while it is going on.

    Example: vinefab optimize grid_coverage --out run --workers 2

    Every generation is recorded: --resume continues a stopped run, and with --generations,
    --evaluations or --wall-time-s a run that has ended, as if it had been asked for more at once.
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    source = locate("run file", run_file)
    settings = read_run(source)
    if seed is not None:
        settings = settings.changed(search=settings.search.changed(seed=seed))
    limits = _limits(generations, evaluations, wall_time_s, resume=resume)
    pages = (PAGE_NAME,) if page else ()
    for name in ("best.toml", *pages, *(FRONT_FILES if settings.objectives else ())):
        ensure_writable(out / name, force=force)
    output.ensure_json()

    again = ["vinefab", "optimize", str(run_file), "--out", str(out), "--resume"]
    again += ["--cluster", cluster] if cluster else []
    again += ["--workers", str(workers)] if workers is not None else []
    again += ["--seed", str(seed)] if seed is not None else []
    for name, value in limits.given.items() if limits else ():
        again += [limit_option(name), f"{value:g}" if isinstance(value, float) else str(value)]
    again += [] if page else ["--no-page"]
    command = shlex.join(again)
    with _resumable(command):
        with output.progress(f"optimizing {settings.name}") as show:

            def report(progress: Progress) -> None:
                line = progress_line(progress, checked=settings.evaluation.fabricable)
                show(progress.share, line)

            result = run_in_folder(
                settings,
                out,
                again=command,
                page=page,
                resume=resume,
                limits=limits,
                workers=make_point_evaluator(workers, cluster),
                progress=report,
                source=source,
            )
        violations = violations_of(result, settings)
    with _resumable(command), _recorded(command):
        result.write_winner(out, force=force)
        for line in result_lines(result, violations, verbose=verbose):
            output.say(line)
        output.give_json(result_json(result))
        if settings.objectives:
            _write_front(result, settings, out, output)
        with output.progress(f"page of {settings.name}") as show:
            show(0.0, "drawing the winner")
            lines = _outcome(result, violations, out, page=page, force=force)
        for line in lines:
            output.say(line)
    return EXIT_FINDINGS if violations else 0


def _limits(
    generations: int | None, evaluations: int | None, wall_time_s: float | None, *, resume: bool
) -> RunLimits | None:
    """Return the limits to raise; None if none is given."""
    limits = RunLimits(generations=generations, evaluations=evaluations, wall_time_s=wall_time_s)
    for name, value in limits.given.items():
        if not resume:
            allowed = f"only with --resume; of a new run it stands in its file, optimizer.{name}"
            raise BadInputError(limit_option(name), value, allowed)
    return limits if limits.given else None


def _outcome(
    result: RunResult, violations: str, out: Path, *, page: bool, force: bool
) -> list[str]:
    """Write the page if one is asked for, and return what was found, in short at the end."""
    # Matplotlib takes seconds to load.
    from vinefab.prediction.run_page import (  # noqa: PLC0415
        EndedRun,
        outcome_line,
        write_run_page,
    )
    from vinefab.prediction.run_winner import prediction_lines  # noqa: PLC0415

    run = EndedRun.read(out, result)
    where = write_run_page(out, run, force=force) if page else out / "best.toml"
    wrote = f"wrote {out / 'best.toml'} and {out / 'run.sqlite'}"
    return [*prediction_lines(result.prediction), wrote, outcome_line(run, violations, where)]


@contextmanager
def _resumable(command: str) -> Iterator[None]:
    """Report how to resume when the user interrupts the block."""
    try:
        yield
    except KeyboardInterrupt as stop:
        raise InterruptedRunError("the generations so far are recorded", command) from stop


@contextmanager
def _recorded(command: str) -> Iterator[None]:
    """Report, when a file cannot be written, that the record is complete."""
    try:
        yield
    except CannotWriteError as error:
        problem = f"{error.problem}; the run is complete and recorded, to write its files: "
        raise CannotWriteError(error.path, f"{problem}{command}") from error


def _write_front(
    result: RunResult, settings: RunSettings, out: Path, output: CommandOutput
) -> None:
    """Write the files of a front and list its designs."""
    # Matplotlib takes seconds to load, and most runs have no front.
    from vinefab.search.front_files import front_lines, write_front  # noqa: PLC0415

    for line in front_lines(write_front(result, settings, out, force=output.force), settings):
        output.say(line)
    output.say(f"wrote {out / 'front.json'}, {out / 'front.svg'} and designs in {out / 'front'}")
