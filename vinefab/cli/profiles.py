"""``vinefab profiles``: machines, materials and recipes, and what is known of each number."""

from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, JsonOut, Quiet
from vinefab.fabrication.profile_listing import ProfileListing, ProfileNumbers


def profiles_command(
    *,
    name: Annotated[
        str | None, typer.Argument(help="A machine, material or recipe to explain; default: list.")
    ] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """List machines, materials and recipes, or explain one: every number with its standing.

    Example: vinefab profiles co2_60w__stretchlon_200
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    found = ProfileListing() if name is None else ProfileNumbers(name=name)
    output.give_json(found.json_text())
    for line in found.summary:
        output.say(line)
    return 0
