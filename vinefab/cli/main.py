"""The program ``vinefab``: commands, their helps, and errors as one line and an exit code."""

import gc
import logging
import os
import shlex
import shutil
import signal
import sys
import textwrap
import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from io import TextIOWrapper
from tempfile import NamedTemporaryFile
from traceback import format_exception
from typing import TYPE_CHECKING

from vinefab.app.verbs import GROUPS, HELP, VERBS
from vinefab.core import __version__
from vinefab.core.errors import (
    ExportRefusedError,
    InterruptedRunError,
    NotCachedWarning,
    VinefabError,
    shortened,
)
from vinefab.core.interruption import StopRequest, stop_requests, stop_with_input
from vinefab.core.plain_text import visible

if TYPE_CHECKING:
    from vinefab.cli.commands import Command
    from vinefab.core.verbs import Option

EXIT_FINDINGS = 1
EXIT_BAD_INPUT = 2
EXIT_UNFORESEEN = 3
INTERRUPTED = "interrupted; what was being written was left as it was"
NO_MEMORY = "there is not enough memory; what was being written was left as it was"
_WANT_OF_MEMORY = ("failed to map segment", "annot allocate memory", "can't start new thread")
"""What the loader of libraries and of threads say of it, in errors of other kinds."""
EXIT_BROKEN_PIPE = 141


def main(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code."""
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors in ("strict", "surrogateescape"):
        # Names of files and designs may hold letters that the terminal cannot show. In the locale
        # C the stream passes bytes on, and no letters.
        sys.stdout.reconfigure(errors="backslashreplace")
    request = StopRequest()
    try:
        with stop_requests(request):
            stop_with_input()
            return _answered(arguments, request)
    except KeyboardInterrupt:  # while an error was being printed, or handlers came and went
        return _print_error(INTERRUPTED, request.exit_code)


def _answered(arguments: Sequence[str], request: StopRequest) -> int:
    try:
        code = dispatch(arguments)
        if sys.stdout is not None:  # as with >&- in a shell
            sys.stdout.flush()
    except BrokenPipeError:
        # The reader has closed the pipe; nothing more can be written to it.
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115  stays open until the end
        return EXIT_BROKEN_PIPE
    except (Exception, KeyboardInterrupt) as error:  # the last net, the only one
        return _print_error(*_explained(error, arguments, request))
    return _print_error(INTERRUPTED, request.exit_code) if request.number else code


def dispatch(arguments: Sequence[str]) -> int:
    """Do what a command line asks for, and return the exit code."""
    # What is not asked for is not loaded: the list of commands needs no command.
    if "_VINEFAB_COMPLETE" in os.environ:
        from vinefab.cli.commands import answer

        return answer(arguments)
    first, *rest = arguments or HELP
    if first in HELP:
        return _print(program_help())
    if first == "--version":
        return _print(f"vinefab {__version__}")
    if first in ("--show-completion", "--install-completion"):
        from vinefab.cli.commands import install, script_for, shell_name

        done = script_for if first == "--show-completion" else install
        return _print(done(rest[0] if rest else shell_name()))
    from vinefab.cli.commands import Command, UsageError, command_for, names_in

    name, typed = command_for(arguments)
    if name in GROUPS and typed:
        return _print(group_help(name))
    if name in GROUPS:
        raise UsageError(f"a command is missing; there are: {', '.join(names_in(name))}")
    command = Command.named(name)
    options = typed[: typed.index("--")] if "--" in typed else typed
    if any(word in HELP for word in options):
        return _print(command_help(command))
    return command.run(typed)


def _print(text: str) -> int:
    if sys.stdout is not None:
        sys.stdout.write(f"{text}\n")
    return 0


def run() -> None:
    """Run the program: the entry point of the installed command.

    Warnings and log messages of the packages below are for developers: ``python -W default -m
    vinefab`` shows the warnings.
    """
    logging.getLogger().addHandler(logging.NullHandler())
    # Imports make a hundred thousand objects that stay: looking for garbage among them, time and
    # again, would take a tenth of a short command.
    gc.set_threshold(100_000, 20, 20)
    # Matrices are small: threads of BLAS would wait for each other, and take a third of the time
    # of a command that fits cameras. Read when NumPy is first imported, here or in a worker.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", NotCachedWarning)
            warnings.formatwarning = lambda message, *_: f"note: {message}\n"
        code = main(sys.argv[1:])
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        # All is done; what is left could only end in a traceback.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # `python -m` ends itself by SIGINT if the last text that it ran was interrupted, such as that
    # of which a dataclass is made, whatever became of that since: let another text be the last.
    exec("")  # noqa: S102
    sys.exit(code)


def _explained(
    error: BaseException, arguments: Sequence[str], request: StopRequest
) -> tuple[str, int]:
    """Return the text to print for an error, and the exit code."""
    if isinstance(error, InterruptedRunError):
        return str(error), request.exit_code
    # A request may have come where other code made another error of it.
    if request.number or isinstance(error, KeyboardInterrupt):
        return INTERRUPTED, request.exit_code
    match error:
        case ExportRefusedError():
            return str(error), EXIT_FINDINGS
        case VinefabError():
            return str(error), EXIT_BAD_INPUT
        case OSError():
            return f"{error.filename or 'output'}: {error.strerror}", EXIT_BAD_INPUT
    wants_memory = any(words in str(error) for words in _WANT_OF_MEMORY)
    if isinstance(error, MemoryError) or wants_memory:
        message, code = NO_MEMORY, EXIT_BAD_INPUT
    else:
        message, code = _unforeseen(error, arguments), EXIT_UNFORESEEN
    return message, code


def _unforeseen(error: BaseException, arguments: Sequence[str]) -> str:
    """Write a log of an error that no one foresaw, and return the line that asks for a report."""
    about = f"vinefab {__version__}, Python {sys.version}, {sys.platform}"
    log = f"{about}\n{shlex.join(['vinefab', *arguments])}\n\n{''.join(format_exception(error))}"
    try:
        with NamedTemporaryFile(
            "w",
            prefix="vinefab-error-",
            suffix=".log",
            delete=False,
            encoding="utf-8",
            errors="backslashreplace",
        ) as stream:
            stream.write(log)
        where = f"please report it with the log {stream.name}"
    except OSError:
        where = "please report it; no log could be written"
    return f"this is a fault of vinefab, not of your input ({type(error).__name__}); {where}"


def _print_error(message: str, code: int) -> int:
    most_letters = 2_000  # of a line that names an error
    line = shortened(visible(" ".join(message.split())), most_letters)
    with suppress(OSError, AttributeError):  # a closed terminal, a full disk; the code still tells
        sys.stderr.write(f"error: {line}\n")
        sys.stderr.flush()
    return code


_HOW_TO_CITE = (
    f"Cite vinefab {__version__} and Glick et al., Branching Vine Robots for Unmapped Environments "
    "(2022), doi 10.3389/frobt.2022.838913. Licence: MIT."
)


def _width() -> int:
    widest = 100
    return min(widest, shutil.get_terminal_size((80, 24)).columns)


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
