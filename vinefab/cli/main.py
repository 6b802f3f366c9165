"""The program ``vinefab``: finds the command, and turns errors into one line and an exit code."""

import importlib
import logging
import os
import shlex
import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import TextIOWrapper
from tempfile import NamedTemporaryFile
from traceback import format_exception
from typing import Annotated

import typer

from vinefab.cli.usage_problems import usage_line
from vinefab.core.errors import InterruptedRunError, KeptAsideWarning, VinefabError, shortened
from vinefab.core.interruption import StopRequest, stop_requests, stop_with_input
from vinefab.core.plain_text import visible
from vinefab.core.version import __version__


@dataclass(frozen=True, slots=True)
class CommandEntry:
    """Where a command is found, and its line of ``--help``."""

    module: str  # in `vinefab.cli`
    function: str  # the command; of a group, what returns it with its subcommands
    summary: str
    is_group: bool = False

    def register(self, app: typer.Typer, name: str) -> None:
        """Load the command and register it."""
        loaded = getattr(importlib.import_module(f"vinefab.cli.{self.module}"), self.function)
        if self.is_group:
            app.add_typer(loaded(), name=name)
        else:
            app.command(name)(loaded)


COMMANDS = {
    "new": CommandEntry(
        "new", "new_command", "Write a file to begin with: a design, run, map, recipe, machine."
    ),
    "examples": CommandEntry(
        "examples", "examples_command", "List the examples that ship with vinefab, or copy them."
    ),
    "studio": CommandEntry(
        "studio",
        "studio_command",
        "Design in the browser: growth, score, rules and sheet follow every change.",
    ),
    "demo": CommandEntry(
        "demo",
        "demo_command",
        "Run the main job at small size: maps, optimization, package, rig, report.",
    ),
    "map": CommandEntry("map_commands", "map_group", "Generate or import a map.", is_group=True),
    "grow": CommandEntry("grow", "grow_command", "Deploy a design on a map."),
    "score": CommandEntry(
        "score_command", "score_command", "Score a design on a task over maps and poses."
    ),
    "aim": CommandEntry("aim", "aim_command", "Search a map for the best place of a robot's base."),
    "optimize": CommandEntry(
        "optimize", "optimize_command", "Search for the best design of a run file."
    ),
    "runs": CommandEntry(
        "runs", "runs_command", "List the records of runs, or rebuild their files."
    ),
    "compare": CommandEntry(
        "compare",
        "compare_command",
        "Compare designs on the same maps and poses, with paired statistics.",
    ),
    "contest": CommandEntry(
        "contest", "contest_command", "Compare optimizers on run files, with statistics."
    ),
    "check": CommandEntry(
        "check", "check_command", "Check a design against the rules of making and deploying it."
    ),
    "rules": CommandEntry(
        "rules_command", "rules_command", "List the design rules, or explain one."
    ),
    "fabricate": CommandEntry(
        "fabricate",
        "fabricate_command",
        "Write the fabrication package: laser files, checks, report.",
    ),
    "coupon": CommandEntry(
        "coupon",
        "coupon_command",
        "Write test pieces for a recipe: files, instructions, a table to fill in.",
    ),
    "calibrate": CommandEntry(
        "calibrate", "calibrate_command", "Fit a recipe to coupon results, and write it."
    ),
    "profiles": CommandEntry(
        "profiles", "profiles_command", "List machines, materials and recipes, or explain one."
    ),
    "rig": CommandEntry("rig", "rig_command", "Write printable obstacles for a test rig."),
    "observe": CommandEntry(
        "observe",
        "observe_command",
        "Trace a grown robot on a photo and put it beside the prediction.",
    ),
    "report": CommandEntry(
        "report", "report_command", "Write predictions for a design as one HTML page."
    ),
    "reproduce": CommandEntry(
        "reproduce", "reproduce_command", "Do the paper's experiments again, with statistics."
    ),
    "study": CommandEntry(
        "study",
        "study_group",
        "Compare optimizers, do the paper's experiments again, measure speed.",
        is_group=True,
    ),
    "bench": CommandEntry(
        "bench", "bench_command", "Measure the speed of the growth simulator on this computer."
    ),
}
"""Every command, in the order of ``--help``."""

UNDER_STUDY = ("contest", "reproduce", "bench")
"""Commands that few need; they stand under ``study``, and go on working under their own names."""

_HOW_TO_CITE = (
    f"Cite vinefab {__version__} and Glick et al., Branching Vine Robots for Unmapped Environments "
    "(2022), doi 10.3389/frobt.2022.838913. Licence: MIT."
)

MAP_OPTIONS = ("--maps", "--map")
MAP_SUFFIXES = (".geojson", ".json")

_MOST_LETTERS = 2_000  # of a line that names an error
EXIT_BAD_INPUT = 2
EXIT_UNFORESEEN = 3
INTERRUPTED = "interrupted; what was being written was left as it was"
NO_MEMORY = "there is not enough memory; what was being written was left as it was"
_WANT_OF_MEMORY = ("failed to map segment", "annot allocate memory", "can't start new thread")
"""What the loader of libraries and of threads say of it, in errors of other kinds."""
EXIT_BROKEN_PIPE = 141

# typer carries its own click, whose usage errors have this public ancestor.
UsageProblem: type[Exception] = typer.BadParameter.__mro__[1]


def build_app(wanted: str | None) -> typer.Typer:
    """Return the program with one command loaded and the others as lines of ``--help``.

    Loading all of them would import the simulator, the exporters and the plots just to print a
    list of names.
    """
    app = typer.Typer(
        name="vinefab",
        help="Design, simulate, optimize and make branching vine robots.",
        epilog=_HOW_TO_CITE,
        context_settings={"help_option_names": ["-h", "--help"]},
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    app.callback()(_program_options)
    for name, command in COMMANDS.items():
        if name == wanted:
            command.register(app, name)
        else:
            app.command(name, help=command.summary, hidden=name in UNDER_STUDY)(_not_loaded)
    return app


def _print_version(asked: bool) -> None:  # noqa: FBT001  typer calls it with the value
    if asked:
        typer.echo(f"vinefab {__version__}")
        raise typer.Exit


def _program_options(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version and stop."
        ),
    ] = False,
) -> None:
    """Design, simulate, optimize and make branching vine robots."""
    del version


def _not_loaded() -> None:
    """Stand in for a command that was not asked for."""


def main(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code."""
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        # Names of files and designs may hold letters that the terminal cannot show.
        sys.stdout.reconfigure(errors="backslashreplace")
    with stop_requests() as request:
        stop_with_input()
        try:
            return _run_command(arguments, request)
        except KeyboardInterrupt:  # while an error was being printed
            return _print_error(INTERRUPTED, request.exit_code)


def _run_command(arguments: Sequence[str], request: StopRequest) -> int:
    typed = os.environ["_TYPER_COMPLETE_ARGS"].split()[1:] if _completes() else arguments
    named = [argument for argument in typed if not argument.startswith("-")]
    try:
        app = build_app(named[0] if named and named[0] in COMMANDS else None)
        result = app(
            each_map_named(arguments) or ["--help"], prog_name="vinefab", standalone_mode=False
        )
        if sys.stdout is not None:  # as with >&- in a shell
            sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as ended:  # typer makes the second of the first
        if _completes() and isinstance(ended, SystemExit):  # fish asks by the exit code
            return ended.code if isinstance(ended.code, int) else 0
        # The reader has closed the pipe; nothing more can be written to it.
        sys.stdout = open(os.devnull, "w")  # noqa: PTH123, SIM115  stays open until the end
        return EXIT_BROKEN_PIPE
    except (Exception, KeyboardInterrupt) as error:  # the last net of the project, the only one
        return _print_error(*_explained(error, arguments, request))
    code = result if isinstance(result, int) else 0
    # Some versions of typer return it instead of raising.
    interrupted = request.number or code == request.exit_code
    return _print_error(INTERRUPTED, request.exit_code) if interrupted else code


def _completes() -> bool:
    """Tell whether a shell asks what a half-typed word may become."""
    return "_VINEFAB_COMPLETE" in os.environ and "_TYPER_COMPLETE_ARGS" in os.environ


def each_map_named(arguments: Sequence[str]) -> list[str]:
    """Return arguments with the option before each of several map files.

    A shell makes ``--maps a.geojson b.geojson`` of ``--maps *.geojson``.

    >>> each_map_named(["score", "vine", "--maps", "a.geojson", "b.geojson", "-q"])
    ['score', 'vine', '--maps', 'a.geojson', '--maps', 'b.geojson', '-q']
    """
    named: list[str] = []
    option = ""
    for argument in arguments:
        if argument.startswith("-"):
            option = argument if argument in MAP_OPTIONS else ""
        elif option and not named[-1].startswith("-") and argument.endswith(MAP_SUFFIXES):
            named.append(option)
        elif named and not named[-1].startswith("-"):
            option = ""
        named.append(argument)
    return named


def run() -> None:
    """Run the program: the entry point of the installed command.

    Warnings and log messages of the packages below are for developers: ``python -W default -m
    vinefab`` shows the warnings.
    """
    logging.getLogger().addHandler(logging.NullHandler())
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
    """Return what to print of an error, and the exit code."""
    if isinstance(error, InterruptedRunError):
        return str(error), request.exit_code
    # A request may have come where other code made another error of it.
    if request.number or isinstance(error, KeyboardInterrupt | typer.Abort):
        return INTERRUPTED, request.exit_code
    match error:
        case UsageProblem():
            return usage_line(error, arguments), EXIT_BAD_INPUT
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
    with suppress(OSError):  # a terminal that was closed, or a full disk; the code still tells
        typer.echo(f"error: {line}", err=True)
    return code
