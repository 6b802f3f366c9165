"""``vinefab calibrate``: from coupon results to a recipe of your own."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, JsonOut, Quiet, RecipeIn
from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.errors import located
from vinefab.fabrication.calibration.calibrated_recipe import (
    calibrated_recipe,
    calibration_json,
    calibration_lines,
)
from vinefab.fabrication.calibration.coupon_results import read_results
from vinefab.fabrication.calibration.fit_recipe import fitted_recipe
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE


def calibrate_command(
    *,
    results: Annotated[Path, typer.Argument(help="The table of `vinefab coupon`, filled in.")],
    out: Annotated[Path, typer.Option("--out", help="The recipe file to write, NAME.toml.")],
    recipe: RecipeIn = DEFAULT_RECIPE,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Fit kerf, seam, shrinkage, burst loads, friction, growth pressure; write a recipe with them.

    Example: vinefab calibrate coupons/results.csv --recipe co2_60w__stretchlon_200
    --out my_recipe.toml
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    ensure_writable(out, force=force)
    profile = read_profile(recipe)
    with located(results):
        calibration = fitted_recipe(read_results(results), profile)
    text = calibrated_recipe(calibration, recipe, out, results)
    write_text(out, text, force=force)
    output.give_json(calibration_json(calibration))
    for line in calibration_lines(calibration):
        output.say(line)
    output.say(f"wrote {out}; use it with --recipe {out}")
    return 0
