"""``vinefab coupon``: test pieces for a recipe."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import EXIT_FINDINGS, CommandOutput, Force, Quiet, RecipeIn
from vinefab.core.atomic import write_folder
from vinefab.core.plain_text import counted
from vinefab.fabrication.calibration.coupon_package import (
    COUPON_MARK,
    coupon_files,
    ensure_results_not_filled_in,
    make_coupons,
)
from vinefab.fabrication.formats.laser_formats import broken_formats
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE


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
    output.ensure_folder(out, COUPON_MARK)
    ensure_results_not_filled_in(out, force=force)
    coupons = make_coupons(read_profile(recipe))
    for line in (*coupons.report.summary, *broken_formats()):
        output.say(line)
    if coupons.report.blocking:
        typer.echo("nothing written: a rule forbids these coupons", err=True)
        return EXIT_FINDINGS
    files = coupon_files(coupons)
    write_folder(out, files, COUPON_MARK, force=force)
    output.say(f"wrote {out}/ ({counted(len(files), 'file')}; begin with README.txt)")
    return 0
