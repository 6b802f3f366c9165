"""``vinefab optimize``: search for the best design, and write the front where there is one."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.options import EXIT_FINDINGS, CommandOutput, Force, JsonOut, Quiet
from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.errors import CannotWriteError, InterruptedRunError
from vinefab.model.files.design_toml import design_text
from vinefab.search.record.result import Progress, RunResult
from vinefab.search.run import (
    complaint_of,
    progress_words,
    result_json,
    result_lines,
    run_search,
    workforce,
)
from vinefab.search.run_file import read_run
from vinefab.search.settings import RunSettings

FRONT_FILES = ("front.json", "front.svg", "front.png")


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("optimize")(optimize_command)


def optimize_command(
    *,
    run_file: Annotated[Path, typer.Argument(metavar="RUN.toml", help="The run file.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for the record and best.toml.")],
    workers: Annotated[int, typer.Option(min=1, help="Threads; results do not depend on it.")] = 1,
    cluster: Annotated[
        str | None,
        typer.Option(help="local:N, or a dask scheduler's address, in place of --workers."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the run in --out.")] = False,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Search for the best design; every generation is kept, so that --resume goes on from there.

    Example: vinefab optimize examples/grid_coverage.toml --out run --workers 2
    """
    voice = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    settings = read_run(run_file)
    for name in ("best.toml", *(FRONT_FILES if settings.objectives else ())):
        ensure_writable(out / name, force=force)
    voice.ensure_json()

    again = ["vinefab", "optimize", str(run_file), "--out", str(out), "--resume"]
    again += ["--cluster", cluster] if cluster else ["--workers", str(workers)]
    command = shlex.join(again)
    with _resumable(command):
        with voice.progress(f"optimizing {settings.name}") as show:

            def tell(progress: Progress) -> None:
                show(progress.generation / progress.generations, progress_words(progress))

            crew = workforce(workers, cluster)
            result = run_search(
                settings, out, resume=resume, workers=crew, tell=tell, source=run_file
            )
        complaint = complaint_of(result, settings)
    with _resumable(command), _recorded(command):
        write_text(out / "best.toml", design_text(result.best), force=force)
        for line in result_lines(result, complaint):
            voice.say(line)
        voice.give_json(result_json(result))
        if settings.objectives:
            _write_front(result, settings, out, voice)
    voice.say(f"wrote {out / 'best.toml'} and {out / 'run.sqlite'}")
    return EXIT_FINDINGS if complaint else 0


@contextmanager
def _resumable(command: str) -> Iterator[None]:
    """Say how to go on when the user stops what is done meanwhile."""
    try:
        yield
    except KeyboardInterrupt as stop:
        raise InterruptedRunError("what was done is recorded", command) from stop


@contextmanager
def _recorded(command: str) -> Iterator[None]:
    """Say, when a file cannot be written, that all it would say is in the record."""
    try:
        yield
    except CannotWriteError as error:
        words = f"{error.problem}; the run has ended and is recorded, to write its files: {command}"
        raise CannotWriteError(error.path, words) from error


def _write_front(result: RunResult, settings: RunSettings, out: Path, voice: CommandOutput) -> None:
    """Write a front, and say what its designs are worth."""
    # What draws takes seconds to load, and most runs have no front.
    from vinefab.search.front_files import front_lines, write_front  # noqa: PLC0415

    for line in front_lines(write_front(result, settings, out, force=voice.force), settings):
        voice.say(line)
    voice.say(f"wrote {out / 'front.json'}, {out / 'front.svg'} and the designs in {out / 'front'}")
