"""``vinefab optimize``: search for the best design, and write the front where there is one."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import EXIT_FINDINGS, CommandOutput, Force, JsonOut, Quiet
from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.errors import CannotWriteError, InterruptedRunError
from vinefab.model.files.design_toml import design_text
from vinefab.search.record.result import Progress, RunResult
from vinefab.search.run import (
    make_point_evaluator,
    progress_line,
    result_json,
    result_lines,
    run_search,
    violations_of,
)
from vinefab.search.run_file import read_run
from vinefab.search.settings import RunSettings

FRONT_FILES = ("front.json", "front.svg", "front.png")


def optimize_command(
    *,
    run_file: Annotated[Path, typer.Argument(metavar="RUN.toml", help="The run file.")],
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
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Search for the best design. Every generation is recorded; --resume continues a stopped run.

    Example: vinefab optimize examples/grid_coverage.toml --out run --workers 2
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    settings = read_run(run_file)
    if seed is not None:
        settings = replace(settings, search=replace(settings.search, seed=seed))
    for name in ("best.toml", *(FRONT_FILES if settings.objectives else ())):
        ensure_writable(out / name, force=force)
    output.ensure_json()

    again = ["vinefab", "optimize", str(run_file), "--out", str(out), "--resume"]
    again += ["--cluster", cluster] if cluster else []
    again += ["--workers", str(workers)] if workers is not None else []
    again += ["--seed", str(seed)] if seed is not None else []
    command = shlex.join(again)
    with _resumable(command):
        with output.progress(f"optimizing {settings.name}") as show:

            def report(progress: Progress) -> None:
                line = progress_line(progress, checked=settings.evaluation.fabricable)
                show(progress.generation / progress.generations, line)

            result = run_search(
                settings,
                out,
                resume=resume,
                workers=make_point_evaluator(workers, cluster),
                progress=report,
                source=run_file,
            )
        violations = violations_of(result, settings)
    with _resumable(command), _recorded(command):
        write_text(out / "best.toml", design_text(result.best), force=force)
        for line in result_lines(result, violations):
            output.say(line)
        output.give_json(result_json(result))
        if settings.objectives:
            _write_front(result, settings, out, output)
    output.say(f"wrote {out / 'best.toml'} and {out / 'run.sqlite'}")
    return EXIT_FINDINGS if violations else 0


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
