"""The program ``vinefab``: runs a command, and turns errors into one line and an exit code."""

import gc
import logging
import os
import shlex
import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper
from tempfile import NamedTemporaryFile
from traceback import format_exception

from vinefab.core import __version__
from vinefab.core.errors import (
    ExportRefusedError,
    InterruptedRunError,
    KeptAsideWarning,
    VinefabError,
    shortened,
)
from vinefab.core.interruption import StopRequest, stop_requests, stop_with_input
from vinefab.core.plain_text import visible

_MOST_LETTERS = 2_000  # of a line that names an error
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
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        # Names of files and designs may hold letters that the terminal cannot show.
        sys.stdout.reconfigure(errors="backslashreplace")
    with stop_requests() as request:
        stop_with_input()
        try:
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
        except KeyboardInterrupt:  # while an error was being printed
            return _print_error(INTERRUPTED, request.exit_code)


def dispatch(arguments: Sequence[str]) -> int:
    """Do what a command line asks for, and return the exit code."""
    # What is not asked for is not loaded: the list of commands needs no command.
    from vinefab.app.verbs import HELP
    from vinefab.cli import help as helps

    if "_VINEFAB_COMPLETE" in os.environ:
        from vinefab.cli.completion import answer

        return answer(arguments)
    first, *rest = arguments or HELP
    if first in HELP:
        return _print(helps.program_help())
    if first == "--version":
        return _print(f"vinefab {__version__}")
    if first in ("--show-completion", "--install-completion"):
        from vinefab.cli.completion import install, script_for, shell_name

        done = script_for if first == "--show-completion" else install
        return _print(done(rest[0] if rest else shell_name()))
    return _command(arguments)


def _command(arguments: Sequence[str]) -> int:
    """Run a command, or print its help."""
    from vinefab.app.verbs import GROUPS, HELP
    from vinefab.cli.commands import Command, UsageError, command_for, names_in
    from vinefab.cli.help import command_help, group_help

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
            warnings.simplefilter("always", KeptAsideWarning)
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
    line = shortened(visible(" ".join(message.split())), _MOST_LETTERS)
    with suppress(OSError, AttributeError):  # a closed terminal, a full disk; the code still tells
        sys.stderr.write(f"error: {line}\n")
        sys.stderr.flush()
    return code
