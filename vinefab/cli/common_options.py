"""Options that commands share, and `CommandOutput`: messages, results and progress."""

import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from vinefab.core.atomic import ensure_own_folder, ensure_writable, write_text
from vinefab.core.errors import BadInputError, located
from vinefab.core.plain_text import visible
from vinefab.core.progress_lines import progress_in_lines
from vinefab.core.replacement import moved_aside
from vinefab.core.units import rad
from vinefab.core.validation import check_plain
from vinefab.model.design import Design
from vinefab.model.files.run_recipe import ChosenRecipe
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate, names, user_names
from vinefab.model.map import Map, Pose, Start
from vinefab.model.start_place import StartPlace, start_from, with_starts

if TYPE_CHECKING:
    from vinefab.growth.options import GrowthChoice
    from vinefab.model.contacts import MeasuredContacts

EXIT_FINDINGS = 1

Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say where the time went, too.")]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Overwrite files that vinefab did not write, or that were changed since."
    ),
]
JsonOut = Annotated[
    str | None, typer.Option("--json", help="Machine-readable result: a file, or - for the output.")
]


def names_like(kind: str, incomplete: str = "") -> list[str]:
    """Return the names of shipped and own files of a kind that begin like a word: completion."""
    known = sorted({*names(kind), *user_names(kind)})
    return [name for name in known if name.startswith(incomplete)]


def _designs_like(incomplete: str) -> list[str]:
    return names_like("design", incomplete)


def _recipes_like(incomplete: str) -> list[str]:
    return names_like("recipe", incomplete)


DesignIn = Annotated[
    str,
    typer.Argument(
        help="A design file, or the name of a shipped design.", autocompletion=_designs_like
    ),
]
RecipeIn = Annotated[
    str,
    typer.Option(
        "--recipe",
        help="A recipe file, or a shipped one's name.",
        autocompletion=_recipes_like,
    ),
]
DesignRecipeIn = Annotated[
    str | None,
    typer.Option(
        "--recipe",
        help="A recipe file, or a shipped one's name; default: that of the run that found the "
        f"design, else {DEFAULT_RECIPE}.",
        autocompletion=_recipes_like,
    ),
]
MapsIn = Annotated[
    list[Path], typer.Option("--maps", "--map", help="A map file, or several: --maps *.geojson.")
]
MapsOptional = Annotated[
    list[Path] | None,
    typer.Option("--maps", "--map", help="A map file, or several: --maps *.geojson."),
]
EnvironmentIn = Annotated[
    str | None, typer.Option(help="Unseen maps of an environment: grid, cave, ...")
]
Count = Annotated[int, typer.Option(help="How many unseen maps.")]
SetIn = Annotated[
    list[str] | None, typer.Option("--set", help="The environment's option: size_mm=300.")
]
GrowthIn = Annotated[
    list[str] | None,
    typer.Option(
        "--growth",
        metavar="NAME=VALUE",
        help="A growth option in place of the design's or the default: pressure_stop=false, "
        "head_on_half_angle_deg=1,15 (a range); may be repeated.",
    ),
]
BodyIn = Annotated[
    str | None, typer.Option("--body", help="inflated or centerline; short for --growth body=...")
]
HalfAngleIn = Annotated[
    float | None,
    typer.Option(
        "--head-on-half-angle-deg",
        help="Contacts closer to head-on than this stop a tip (assumed); short for --growth ...",
    ),
]
ContactsIn = Annotated[
    str | None,
    typer.Option(
        "--contacts",
        metavar="FILE",
        help="Numbers that photos measured (vinefab observe --fit), in place of assumed ones; "
        "short for --growth contacts=FILE.",
    ),
]
PoseIn = Annotated[
    str | None,
    typer.Option("--pose", help="Start as X,Y,DEG in mm and degrees; default: the map's start."),
]

StartIn = Annotated[
    list[str] | None,
    typer.Option(
        "--start",
        metavar="START",
        help="Where robots start, in place of the map's starts: X,Y,DEG+-SPREAD, 'left side', "
        "'line X,Y X,Y' or 'area X,Y X,Y', then heading DEG+-SPREAD (docs/maps.md); may be "
        "repeated.",
    ),
]


_STYLES = {
    "ERROR": "bold red",
    "warn": "yellow",
    "waived": "cyan",
    **dict.fromkeys(("info", "ran", "note", "limit", "skipped", "next:"), "dim"),
}
"""Colours of lines by their first word; the words say the same where there is no colour."""


class _PlainConsole(Console):
    """Prints texts as they are: no markup in them, and nothing that a terminal would obey."""

    def render_str(self, text: str, **options: Any) -> Text:  # noqa: ANN401  as in rich
        """Return a text to print: messages and the cells of tables."""
        return super().render_str(visible(text), **{**options, "markup": False})


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandOutput:
    """Where a command's messages, results and progress go."""

    quiet: bool = False  # print nothing but errors
    # where the machine-readable result goes; with ``-`` messages go to standard error
    json_out: str | None = None
    force: bool = False  # overwrite files that vinefab did not write
    console: Console = field(init=False)
    """For messages and progress; one, so that messages appear above the bar."""

    def __post_init__(self) -> None:
        console = _PlainConsole(stderr=self.json_out == "-", quiet=self.quiet, highlight=False)
        object.__setattr__(self, "console", console)

    def say(self, text: str = "") -> None:
        """Print a line for the user; on a terminal its first word gives it a colour."""
        style = _STYLES.get(text.partition(" ")[0])
        self.console.print(text, soft_wrap=True, style=style)

    def recipe_of(self, design: Design, recipe: str | None) -> ChosenRecipe:
        """Return the recipe to make a design with, and say why where it was not named."""
        chosen = ChosenRecipe.of(design, recipe)
        if chosen.note:
            self.say(chosen.note)
        return chosen

    def show(self, table: Table) -> None:
        """Print a table for the user."""
        self.console.print(table)

    def ensure_folder(self, path: Path, mark: str) -> None:
        """Check, before any long work, that a folder may be filled; name what lies beside it."""
        ensure_own_folder(path, mark, force=self.force)
        for aside in moved_aside(path):
            self.say(
                f"note: {aside} has files of {path} from before a run was killed; vinefab leaves "
                "it alone: move out what you miss, then remove it"
            )

    def ensure_json(self) -> None:
        """Check, before work that takes long, that `give_json` will be able to write."""
        if self.json_out not in (None, "-"):
            ensure_writable(Path(str(self.json_out)), force=self.force)

    def give_json(self, text: str) -> None:
        """Write the machine-readable result if one was asked for."""
        if self.json_out == "-":
            sys.stdout.write(text)
        elif self.json_out is not None:
            write_text(Path(self.json_out), text, force=self.force)
            self.say(f"wrote {self.json_out}")

    @contextmanager
    def progress(self, title: str) -> Iterator[Callable[[float, str], None]]:
        """Show a bar with the time left on a terminal while a block runs, elsewhere some lines."""
        if not self.quiet and not self.console.is_terminal:
            with progress_in_lines(title) as tell:
                yield tell
            return
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[text]}"),
            TimeRemainingColumn(),
        )
        console = self.console
        with Progress(*columns, console=console, transient=True, disable=self.quiet) as bar:
            task = bar.add_task(title, total=1.0, text="")
            yield lambda share, text: bar.update(task, completed=share, text=text)


_DRAWN = (".dxf", ".gif", ".jpeg", ".jpg", ".pdf", ".png", ".stl", ".svg")
OTHER_KINDS = (*_DRAWN, ".csv", ".geojson", ".htm", ".html", ".json", ".toml", ".yaml", ".zip")
"""Endings of files that a name promises; a file of another kind is not written under one."""


def ensure_kind(option: str, path: Path | None, endings: tuple[str, ...], *, force: bool) -> None:
    """Check before any work that a file, if one is asked for, can be written: kind and place."""
    if path is None:
        return
    if path.suffix.lower() not in endings:
        raise BadInputError(option, str(path), f"a file name ending in {' or '.join(endings)}")
    ensure_writable(path, force=force)


def ensure_text_kind(
    option: str, path: Path, endings: tuple[str, ...], *, force: bool = False
) -> None:
    """Check before any work that a file can be written, and is not named as one of another kind."""
    if path.suffix.lower() in OTHER_KINDS and path.suffix.lower() not in endings:
        raise BadInputError(option, str(path), f"a file name ending in {' or '.join(endings)}")
    ensure_writable(path, force=force)


def ensure_apart(option: str, path: Path, source: Path, what: str) -> None:
    """Check that what is to be written is another file than what is read."""
    # Unlike Path.resolve, realpath takes a link that leads to itself.
    same = os.path.realpath(path) == os.path.realpath(source)
    if same or (path.exists() and source.exists() and path.samefile(source)):
        raise BadInputError(option, str(path), f"another file than {what}")


def pose_from(text: str | None, option: str = "--pose") -> Pose | None:
    """Return a pose from ``X,Y,DEG``, or None."""
    if text is None:
        return None
    try:
        x_mm, y_mm, heading_deg = (float(part) for part in text.split(","))
    except ValueError as error:
        raise BadInputError(option, text, "X,Y,DEG: three numbers, mm and degrees") from error
    try:
        return Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=rad(heading_deg))
    except BadInputError as error:
        raise error.at(option) from error


def starts_from(texts: list[str] | None) -> list[Start | StartPlace]:
    """Return what was given with ``--start``."""
    return [start_from(text, "--start") for text in texts or []]


def started_maps(worlds: Iterable[Map], texts: list[str] | None) -> tuple[Map, ...]:
    """Return maps with the starts given with ``--start``; without any, with their own."""
    starts = starts_from(texts)
    return tuple(with_starts(world, starts, "--start") if starts else world for world in worlds)


def numbers_from(option: str, text: str, count: int) -> tuple[float, ...]:
    """Return numbers from a text like ``400,300``."""
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise BadInputError(option, text, f"{count} finite numbers with commas between them")
    return numbers


def map_arguments(
    maps: list[Path] | None,
    environment: str | None,
    count: int,
    parameter: list[str] | None,
    start: list[str] | None = None,
) -> list[str]:
    """Return the arguments that select the same maps again."""
    arguments = [word for path in maps or [] for word in ("--maps", str(path))]
    if environment:
        arguments += ["--environment", environment, "--count", str(count)]
        arguments += [word for text in parameter or [] for word in ("--set", text)]
    return arguments + [word for text in start or [] for word in ("--start", text)]


def parameters_from(texts: list[str]) -> dict[str, object]:
    """Return parameters from texts like ``radius_mm=60``.

    Numbers, booleans and lists, ``target_mm=[[120, 80]]``, become such.
    """
    parameters: dict[str, object] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise BadInputError("--set", text, "NAME=VALUE")
        parameters[name] = _plain(value)
    check_plain(parameters, finite=False)
    return parameters


def growth_from(texts: list[str] | None, **shortcuts: object) -> dict[str, object]:
    """Return growth options from texts like ``pressure_stop=false``, and from options of their own.

    Parameters
    ----------
    shortcuts
        Options with a parameter of their own; None where it was not given.
    """
    options: dict[str, object] = {}
    for text in texts or []:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise BadInputError("--growth", text, "NAME=VALUE, such as pressure_stop=false")
        if name in options:
            raise BadInputError("--growth", text, f"{name} once")
        parts = [_plain(part) for part in value.split(",")]
        options[name] = parts if len(parts) > 1 else parts[0]
    for name, given in shortcuts.items():
        if given is None:
            continue
        if name in options:
            option = f"--{name.replace('_', '-')}"
            raise BadInputError(option, given, f"not beside --growth {name}={options[name]}")
        options[name] = given
    if "contacts" in options:
        # Read here, so that a wrong file is reported before any work and read only once.
        options["contacts"] = _contacts_from(options["contacts"])
    return options


def contacts_arguments(contacts: str | None) -> list[str]:
    """Return the arguments that choose the same measured contacts again."""
    return [] if contacts is None else ["--contacts", contacts]


def _contacts_from(given: object) -> "MeasuredContacts":
    # Commands that do not grow anything do not wait for the schemas of files.
    from vinefab.model.files.contacts_toml import contacts_given  # noqa: PLC0415

    return contacts_given(given)


def growth_choice(
    names: list[str], designs: Sequence[Design], given: Mapping[str, object]
) -> "GrowthChoice":
    """Return the growth options for designs; an error in the origin of one names its file."""
    # Commands that do not grow anything do not wait for the simulator's packages.
    from vinefab.growth.options import GrowthChoice, trained_growth  # noqa: PLC0415

    for name, design in zip(names, designs, strict=True):
        with located(locate("design", name)):
            trained_growth(design)
    return GrowthChoice.of(designs, given)


def _plain(text: str) -> object:
    if text in ("true", "false"):
        return text == "true"
    if text.startswith("["):
        try:
            listed: object = json.loads(text)
        except (ValueError, RecursionError):
            return text
        return listed
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
