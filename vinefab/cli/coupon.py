"""``vinefab coupon``: test pieces for a recipe."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import EXIT_FINDINGS, CommandOutput, Force, Quiet, RecipeIn
from vinefab.core.atomic import ensure_unchanged, new_folder, write_bytes
from vinefab.core.plain_text import counted
from vinefab.fabrication.calibration.coupon_package import RESULTS_NAME, coupon_files, make_coupons
from vinefab.fabrication.checking import check_lines
from vinefab.fabrication.formats.laser_formats import broken_formats
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE

_MARK = "coupon.json"
"""The file by which a folder of this command is recognized."""


def coupon_command(
    *,
    out: Annotated[Path, typer.Option("--out", help="The folder to write.")],
    recipe: RecipeIn = DEFAULT_RECIPE,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Write test pieces for a recipe: laser files, what to measure, and a table to fill in.

    Example: vinefab coupon --recipe co2_60w__stretchlon_200 --out coupons
    """
    output = CommandOutput(quiet=quiet, force=force)
    output.ensure_folder(out, _MARK)
    ensure_unchanged(out / RESULTS_NAME, force=force)
    coupons = make_coupons(read_profile(recipe))
    for line in (*check_lines(coupons.report), *broken_formats()):
        output.say(line)
    if coupons.report.blocking:
        typer.echo("nothing written: a rule forbids these coupons", err=True)
        return EXIT_FINDINGS
    files = coupon_files(coupons)
    with new_folder(out, _MARK, force=force) as folder:
        for name, data in files.items():
            write_bytes(folder / name, data)
    output.say(f"wrote {out}/ ({counted(len(files), 'file')}; begin with README.txt)")
    return 0
