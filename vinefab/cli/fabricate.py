"""``vinefab fabricate``: the fabrication package."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.options import EXIT_FINDINGS, DesignIn, Force, Quiet, RecipeIn, Voice
from vinefab.core.atomic import ensure_own_folder, ensure_writable, new_folder, write_bytes
from vinefab.export.archive import zip_bytes
from vinefab.files.design import read_design
from vinefab.files.profile import read_profile
from vinefab.files.shipped import DEFAULT_RECIPE
from vinefab.pipeline.check import check_lines
from vinefab.pipeline.fabricate import package, prepare


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("fabricate")(fabricate_command)


def fabricate_command(
    *,
    design: DesignIn,
    out: Annotated[Path, typer.Option("--out", help="The folder to write.")],
    recipe: RecipeIn = DEFAULT_RECIPE,
    make_zip: Annotated[bool, typer.Option("--zip", help="Also write the folder as DIR.zip.")] = (
        False
    ),
    allow_uncalibrated: Annotated[
        bool, typer.Option(help="Write files for a recipe that no coupon has confirmed.")
    ] = False,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Write laser files, checks, report and instructions; exit code 1 when a rule forbids it.

    Example: vinefab fabricate three_level_tree --out package --allow-uncalibrated
    """
    voice = Voice(quiet=quiet, force=force)
    archive = out.with_name(f"{out.name}.zip")
    ensure_own_folder(out, force=force)
    if make_zip:
        ensure_writable(archive, force=force)
    prepared = prepare(read_design(design), read_profile(recipe))
    for line in check_lines(prepared.report):
        voice.say(line)
    if prepared.report.blocking:
        voice.say("nothing written: mend the errors, or waive them in the design with a reason")
        return EXIT_FINDINGS
    if not prepared.calibrated and not allow_uncalibrated:
        voice.say(
            f"nothing written: no coupon has confirmed recipe {prepared.profile.recipe.name};"
        )
        voice.say(
            "--allow-uncalibrated writes the files all the same, for coupons and first trials"
        )
        return EXIT_FINDINGS
    files = package(prepared)
    with new_folder(out, force=force) as folder:
        for name, data in files.items():
            write_bytes(folder / name, data)
    if make_zip:
        write_bytes(archive, zip_bytes(files, out.name), force=force)
        voice.say(f"wrote {archive}")
    voice.say(f"wrote {out}/ ({len(files)} files; begin with README.txt)")
    return 0
