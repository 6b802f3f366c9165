"""``vinefab rules``: what must hold, why, and what to do where it does not."""

from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, JsonOut, Quiet
from vinefab.fabrication.rule_listing import RuleBook


def rules_command(
    *,
    rule: Annotated[
        str | None,
        typer.Argument(
            metavar="ID", help="A rule to explain, or a word of titles; default: list all."
        ),
    ] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """List the design rules, or explain one: limits, reason and remedy.

    Example: vinefab rules VF-C01
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    book = RuleBook.of(rule)
    output.give_json(book.json_text())
    for line in book.summary:
        output.say(line)
    return 0
