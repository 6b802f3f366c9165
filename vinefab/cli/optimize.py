"""``vinefab optimize``: search for the best design, and write the front where there is one."""

import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import EXIT_FINDINGS, CommandOutput, Force, JsonOut, Quiet
from vinefab.core.atomic import ensure_writable, write_bytes, write_text
from vinefab.core.errors import CannotWriteError, InterruptedRunError
from vinefab.model.files.design_toml import design_text
from vinefab.search.record.result import Progress, RunResult
from vinefab.search.run import (
    complaint_of,
    progress_words,
    result_json,
    result_lines,
    run_search,
    training_maps,
    workforce,
)
from vinefab.search.run_file import read_run
from vinefab.search.settings import RunSettings

FRONT_FILES = ("front.json", "front.svg", "front.png")


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
            write_front(result, settings, out, voice)
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


def write_front(result: RunResult, settings: RunSettings, out: Path, voice: CommandOutput) -> None:
    """Write the designs of a front, ``front.json`` and its picture, and say what they are worth."""
    # What draws takes seconds to load, and most runs have no front.
    from vinefab.pages.figure import png_bytes, svg_bytes  # noqa: PLC0415
    from vinefab.search.front_files import (  # noqa: PLC0415
        front_json,
        front_lines,
        front_of,
        front_picture,
    )

    members = front_of(result, settings)
    for member in members:
        path = out / "front" / f"{member.design.name}.toml"
        write_text(path, design_text(member.design), force=voice.force)
    write_text(out / "front.json", front_json(members, result, settings), force=voice.force)
    figure = front_picture(members, result, settings, training_maps(settings)[0])
    write_bytes(out / "front.svg", svg_bytes(figure), force=voice.force)
    write_bytes(out / "front.png", png_bytes(figure), force=voice.force)
    for line in front_lines(members, settings):
        voice.say(line)
    voice.say(f"wrote {out / 'front.json'}, {out / 'front.svg'} and the designs in {out / 'front'}")
