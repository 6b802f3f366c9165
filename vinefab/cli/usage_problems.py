"""What is wrong with a command line as it was typed, in one line that says how it is written."""

import difflib
import re
from collections.abc import Sequence
from typing import Any

from vinefab.core.errors import shortened

_ALIKE = 0.75
"""So alike are two names at least of which one may be meant for the other, 0 to 1."""

_ALLOWED = (
    (r"valid number", "a number"),
    (r"valid integer", "a whole number"),
    (r"greater than or equal to (\S+)", r"\1 or more"),
    (r"less than or equal to (\S+)", r"\1 or less"),
)
"""What the reader of values says of them, and how it is said here."""

_WITH_UNIT = re.compile(r"[-+]?[\d.]+(?:e[-+]?\d+)?\s*[a-zA-Z%]+")


def usage_line(problem: Any, arguments: Sequence[str]) -> str:  # noqa: ANN401  of typer's own click
    """Return what to print of a usage error.

    Parameters
    ----------
    problem
        The error of the library that reads command lines.
    arguments
        What was typed after ``vinefab``.
    """
    message, context = str(problem.format_message()), getattr(problem, "ctx", None)
    if context is None:
        return message
    if hasattr(problem, "possibilities"):
        return _unknown_option(str(problem.option_name), context)
    if unknown := re.match(r"No such command '(.*?)'", message):
        return _unknown_command(unknown[1], context)
    if message.startswith("Missing command"):
        return f"a command is missing; there are: {', '.join(_commands(context))}"
    wrong = _wrong_value(problem, arguments) if message.startswith("Invalid value for") else None
    return wrong or _with_example(message, context)


def _with_example(message: str, context: Any) -> str:  # noqa: ANN401
    """Return a message with a command line that works."""
    example = re.search(r"Example: (.+?)(?:\n\n|\Z)", context.command.help or "", re.DOTALL)
    if example is None:
        return message
    return f"{message.rstrip('.')}; for example: {' '.join(example[1].split())}"


def _unknown_option(typed: str, context: Any) -> str:  # noqa: ANN401
    known = [name for parameter in context.command.get_params(context) for name in parameter.opts]
    known = [name for name in known if name.startswith("--")]
    begun = [name for name in known if len(typed) > 3 and name.startswith(typed)]
    alike = begun or difflib.get_close_matches(typed, known, cutoff=_ALIKE)
    if alike:
        return f"there is no option {typed}; did you mean {' or '.join(alike)}?"
    where = context.command_path
    if context.parent is None:
        return f"there is no option {typed} before a command; {where} COMMAND {typed} ..."
    return f"there is no option {typed}; {where} --help lists them"


def _unknown_command(typed: str, context: Any) -> str:  # noqa: ANN401
    known = _commands(context)
    meant = difflib.get_close_matches(typed.lower(), known, cutoff=_ALIKE)
    if meant:
        hint = f"did you mean {' or '.join(repr(name) for name in meant)}?"
    else:
        hint = f"there are: {', '.join(known)}"
    return f"there is no command {shortened(typed, 80)!r}; {hint}"


def _commands(context: Any) -> list[str]:  # noqa: ANN401
    listed = context.command.commands.items()
    return [name for name, command in listed if not command.hidden]


def _wrong_value(problem: Any, arguments: Sequence[str]) -> str | None:  # noqa: ANN401
    """Return an option, what was typed for it and what is allowed, if all that is known."""
    names = getattr(getattr(problem, "param", None), "opts", ())
    typed = [
        value
        for one, two in zip(arguments, [*arguments[1:], ""], strict=True)
        for name, _, value in [one.partition("=") if "=" in one else (one, "", two)]
        if name in names
    ]
    for pattern, words in _ALLOWED:
        if typed and (found := re.search(pattern, problem.message)):
            unit = ", without a unit" if _WITH_UNIT.fullmatch(typed[-1]) else ""
            option = max(names, key=len)
            return f"{option} is {shortened(typed[-1], 80)!r}; allowed: {found.expand(words)}{unit}"
    return None
