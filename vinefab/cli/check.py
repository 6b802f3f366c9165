"""``vinefab check``: the design rules."""

from typing import Annotated

import typer

from vinefab.cli.options import EXIT_FINDINGS, DesignIn, Force, JsonOut, Quiet, RecipeIn, Voice
from vinefab.export.checks_json import checks_text
from vinefab.files.design import read_design
from vinefab.files.profile import read_profile
from vinefab.files.shipped import DEFAULT_RECIPE
from vinefab.pipeline.check import check, check_lines


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("check")(check_command)


def check_command(
    *,
    design: DesignIn,
    recipe: RecipeIn = DEFAULT_RECIPE,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="List every rule.")] = False,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Check a design against the rules; exit code 1 when an error stands in the way of cutting.

    Example: vinefab check three_level_tree --recipe co2_60w__stretchlon_200
    """
    voice = Voice(quiet=quiet, json_out=json_out, force=force)
    report = check(read_design(design), read_profile(recipe))
    voice.give_json(checks_text(report))
    for line in check_lines(report, verbose=verbose):
        voice.say(line)
    return EXIT_FINDINGS if report.blocking else 0
