"""``vinefab fabricate``: the fabrication package."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    EXIT_FINDINGS,
    CommandOutput,
    DesignIn,
    DesignRecipeIn,
    Force,
    Quiet,
)
from vinefab.core.atomic import ensure_writable, write_bytes, write_folder
from vinefab.core.plain_text import counted
from vinefab.fabrication.formats.laser_formats import broken_formats
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.package.prepare import PACKAGE_MARK, Prepared, package, prepare, zip_bytes
from vinefab.model.files.design_toml import read_design


def fabricate_command(
    *,
    design: DesignIn,
    out: Annotated[Path, typer.Option("--out", help="The folder to write.")],
    recipe: DesignRecipeIn = None,
    make_zip: Annotated[bool, typer.Option("--zip", help="Also write the folder as DIR.zip.")] = (
        False
    ),
    allow_uncalibrated: Annotated[
        bool, typer.Option(help="Write files for a recipe that no coupon has confirmed.")
    ] = False,
    r12: Annotated[
        bool, typer.Option("--r12", help="Also write a DXF of release 12, which knows no unit.")
    ] = False,
    copies: Annotated[
        int, typer.Option(min=1, max=200, help="How many robots to nest on one bed.")
    ] = 1,
    beside: Annotated[
        list[str] | None,
        typer.Option("--with", help="Another design for the same sheet; may be repeated."),
    ] = None,
    process: Annotated[
        str,
        typer.Option(help="weldcut (one pass), weld+cut, or auto: what the recipe has."),
    ] = "auto",
    pass_through: Annotated[
        bool, typer.Option("--pass-through", help="Film may be fed along the bed's width.")
    ] = False,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Write laser files, checks, report and instructions; exit code 1 when a rule forbids it.

    Example: vinefab fabricate three_level_tree --out package --allow-uncalibrated
    """
    output = CommandOutput(quiet=quiet, force=force)
    output.ensure_folder(out, PACKAGE_MARK)
    archive = out.with_name(f"{out.name}.zip")
    if make_zip:
        ensure_writable(archive, force=force)
    others = tuple(read_design(name) for name in beside or ())
    sheet = SheetOptions(copies=copies, beside=others, process=process, pass_through=pass_through)
    robot = read_design(design)
    prepared = prepare(robot, output.recipe_of(robot, recipe).profile, sheet=sheet, r12=r12)
    for line in _report_lines(prepared):
        output.say(line)
    if why := prepared.refusal(allow_uncalibrated=allow_uncalibrated):
        is_older = (out / PACKAGE_MARK).is_file()
        older = f"; {out} still holds an earlier package, not this design" if is_older else ""
        typer.echo(f"nothing written: {why}{older}", err=True)
        return EXIT_FINDINGS
    files = package(prepared)
    write_folder(out, files, PACKAGE_MARK, force=force)
    if make_zip:
        write_bytes(archive, zip_bytes(files, prepared.design.name), force=force)
        output.say(f"wrote {archive}")
    elif archive.exists():
        output.say(f"note: {archive} is from an earlier run; --zip replaces it")
    output.say(f"wrote {out}/ ({counted(len(files), 'file')}; begin with README.txt)")
    return 0


def _report_lines(prepared: Prepared) -> Iterator[str]:
    """Yield the report on every design, and the laser formats that could not be loaded."""
    for report in (prepared.report, *prepared.beside):
        yield from report.summary
    yield from broken_formats()
