"""Helps in plain text, from the registry and from signatures; no library of command lines."""

import shutil
import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

from vinefab.app.verbs import GROUPS, VERBS
from vinefab.core import __version__

if TYPE_CHECKING:
    from vinefab.cli.commands import Command
    from vinefab.core.verbs import Option

_HOW_TO_CITE = (
    f"Cite vinefab {__version__} and Glick et al., Branching Vine Robots for Unmapped Environments "
    "(2022), doi 10.3389/frobt.2022.838913. Licence: MIT."
)
WIDEST = 100


def _width() -> int:
    return min(WIDEST, shutil.get_terminal_size((80, 24)).columns)


def program_help(width: int = 0) -> str:
    """Return ``vinefab --help``: from the list of verbs alone; width 0: as the terminal."""
    width = width or _width()
    rows = dict[str, str]()
    for name, verb in VERBS.items():
        first = name.split()[0]
        if verb.listed:
            rows.setdefault(first, GROUPS.get(first, verb.summary))
    return "\n".join(
        [
            "Usage: vinefab COMMAND [ARGUMENTS] [OPTIONS]",
            "",
            "Design, simulate, optimize and make branching vine robots.",
            "",
            "Commands:",
            *_rows(rows.items(), width),
            "",
            "Options:",
            *_rows(
                [
                    ("-h, --help", "Show this help, or that of a command, and stop."),
                    ("--version", "Print the version and stop."),
                    ("--install-completion", "Let the shell complete commands, options and names."),
                    ("--show-completion", "Print what --install-completion would install."),
                ],
                width,
            ),
            "",
            *textwrap.wrap(_HOW_TO_CITE, width),
        ]
    )


def group_help(group: str, width: int = 0) -> str:
    """Return the help of a word that stands before several commands; width 0: as the terminal."""
    from vinefab.cli.commands import summaries

    width = width or _width()
    example = {"map": "vinefab map grid --seed 3 --out grid.geojson"}.get(
        group, "vinefab study reproduce transfer --quick --out transfer"
    )
    return "\n".join(
        [
            f"Usage: vinefab {group} COMMAND [ARGUMENTS] [OPTIONS]",
            "",
            GROUPS[group],
            "",
            f"Example: {example}",
            "",
            "Commands:",
            *_rows(summaries(group).items(), width),
        ]
    )


def command_help(command: "Command", width: int = 0) -> str:
    """Return the help of a command; width 0: as the terminal."""
    from vinefab.cli.commands import all_options

    width = width or _width()
    options = all_options(command)
    places = [one for one in options if one.positional]
    first, rest = command.description()
    lines = [f"Usage: vinefab {' '.join([command.name, *map(_place, places)])} [OPTIONS]", ""]
    lines += textwrap.wrap(_plain(first), width)
    for paragraph in rest.split("\n\n") if rest else []:
        lines += ["", *textwrap.wrap(_plain(" ".join(paragraph.split())), width)]
    for example in command.examples():
        lines += ["", *textwrap.wrap(f"Example: {example}", width, break_on_hyphens=False)]
    if places:
        lines += ["", "Arguments:", *_rows([(_named(one), _words(one)) for one in places], width)]
    more = [one for one in options if not one.positional]
    lines += ["", "Options:", *_rows([(_named(one), _words(one)) for one in more], width)]
    lines += _rows([("-h, --help", "Show this help and stop.")], width)
    return "\n".join(lines)


def _place(option: "Option") -> str:
    many = "..." if option.starred or option.kind.several else ""
    shown = f"{option.metavar}{many}"
    return shown if option.required else f"[{shown}]"


def _named(option: "Option") -> str:
    from vinefab.cli.commands import flags_of

    flags = ", ".join(flags_of(option))
    if option.starred or (option.positional and option.kind.several):
        return _place(option)
    if option.positional:
        return f"{option.metavar}, {flags}"
    return flags if option.base is bool else f"{flags} {option.metavar}"


def _words(option: "Option") -> str:
    from vinefab.core.verbs import REQUIRED, text_of

    words = _plain(option.help)
    if option.kind.known is not None:
        known = option.kind.known()
        words = f"{words.rstrip('.')}: {', '.join(known)}."
    if option.required and not option.positional:
        return f"{words} [required]"
    plain = isinstance(option.default, int | float | str) and not isinstance(option.default, bool)
    if option.default is not REQUIRED and plain and option.default != "":
        return f"{words} [default: {text_of(option.default)}]"
    return words


def _plain(words: str) -> str:
    return words.replace("``", "").replace("`", "")


def _rows(rows: Iterable[tuple[str, str]], width: int) -> list[str]:
    """Return names with words next to them, below where a name is long."""
    lines = list[str]()
    for name, words in rows:
        begin = f"  {name}"
        told = textwrap.wrap(words, width - 26, break_on_hyphens=False) or [""]
        if len(begin) > 24:
            lines.append(begin)
        else:
            lines.append(f"{begin:<26}{told.pop(0)}".rstrip())
        lines += [f"{'':26}{line}" for line in told]
    return lines
