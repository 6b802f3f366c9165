"""Reference pages made from the code, so that they cannot drift from it.

Formats come from the models that read files, rules from the catalogue, commands from the program,
parts from their registries. A key without a meaning is refused: `tests/test_docs.py`.
"""

import inspect
import re
import textwrap
import types
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from python_pages import python_pages

from vinefab.app.verbs import VERBS
from vinefab.cli.commands import COMMON, Command, flags_of
from vinefab.core.limits import deg
from vinefab.core.table import DeclaredKey, Table, declared_keys
from vinefab.core.verbs import REQUIRED, Force, Option, described, text_of
from vinefab.fabrication.rules.catalog import grouped_rules
from vinefab.fabrication.rules.rule import Rule
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.contacts import ContactsFile, MeasuredContacts
from vinefab.model.design import Design
from vinefab.model.files.run_context import RunContext
from vinefab.model.laser import Material, Recipe
from vinefab.model.machine import HotTipMachine, KnifeMachine, LaserMachine, SealerMachine
from vinefab.model.map import Start
from vinefab.model.quantity import Quantity
from vinefab.model.start import StartTable
from vinefab.rig.part import PrinterForm
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.search.settings import RunFile
from vinefab.search.space import Bounds
from vinefab.tasks import TASKS


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """A kind of file and the model that reads it."""

    name: str
    title: str
    form: type[Table]
    about: str


FORMATS = (
    Format(
        name="design",
        title="Design file (`vinefab/design-1`, TOML)",
        form=Design,
        about="`vinefab new design mine.toml` writes one with comments. Lengths are millimetres.",
    ),
    Format(
        name="run",
        title="Run file (`vinefab/run-1`, TOML)",
        form=RunFile,
        about="What `vinefab optimize` searches; `vinefab new run mine.toml` writes one. Every key "
        "but `schema` may be left out. Parameters of tasks, optimizers and environments: "
        "[parts](parts.md).",
    ),
    Format(
        name="recipe",
        title="Recipe (`vinefab/recipe-1`, TOML)",
        form=Recipe,
        about="One material on one machine. `vinefab new recipe mine.toml` writes one "
        "(`--from NAME`: of another film), "
        "`vinefab calibrate` another from coupons. Every number is a table with its standing.",
    ),
    Format(
        name="machine",
        title="Machine: a laser cutter (`vinefab/machine-1`, TOML)",
        form=LaserMachine,
        about="A laser cutter; `vinefab new machine mine.toml` writes one. A recipe names it "
        "(`machine`) and finds it in the same folder, or in your "
        "[own folder](../files.md#where-files-are-found). "
        "Every number is a table with its standing. Other kinds: [hot tip](machine_hot_tip.md), "
        "[knife](machine_knife.md), [sealer](machine_sealer.md).",
    ),
    Format(
        name="machine_hot_tip",
        title="Machine: a hot tip (`vinefab/machine-1`, TOML)",
        form=HotTipMachine,
        about='A printer or router whose heated tip seals, `kind = "hot_tip"`. '
        "Every number is a table with its standing.",
    ),
    Format(
        name="machine_knife",
        title="Machine: a knife (`vinefab/machine-1`, TOML)",
        form=KnifeMachine,
        about='A drag knife or an oscillating blade, `kind = "knife"`; recipes name it as '
        "`cutter`. Every number is a table with its standing.",
    ),
    Format(
        name="machine_sealer",
        title="Machine: a sealer (`vinefab/machine-1`, TOML)",
        form=SealerMachine,
        about='An impulse sealer with straight bars, `kind = "sealer"`. '
        "Every number is a table with its standing.",
    ),
    Format(
        name="material",
        title="Material (`vinefab/material-1`, TOML)",
        form=Material,
        about="A film; `vinefab new material mine.toml` writes one, found as a "
        "[machine](machine.md) is. "
        "Every number is a table with its standing.",
    ),
    Format(
        name="printer",
        title="Printer (`vinefab/printer-1`, TOML)",
        form=PrinterForm,
        about="A 3-D printer for rigs. Every number is a table with its standing.",
    ),
    Format(
        name="contacts",
        title="Measured contacts (`vinefab/contacts-1`, TOML)",
        form=ContactsFile,
        about="What photos of grown robots and coupons say of assumed numbers; "
        "`vinefab fit-observations` writes it, `--contacts` reads it.",
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """One key of a file."""

    name: str  # with the tables that it stands in
    kind: str
    default: str  # empty: it must be given
    meaning: str


def write_reference(folder: Path) -> None:
    """Write every reference page into a folder; a page that is as it should be is not touched."""
    pages = {f"{one.name}.md": format_page(one) for one in FORMATS}
    pages |= {"rules.md": rules_page(), "parts.md": parts_page()}
    pages |= command_pages() | python_pages()
    for name in ("verbs", "python"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    for name, text in pages.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


# --- File formats -------------------------------------------------------------------------------


def format_page(one: Format) -> str:
    """Return the page of a kind of file: a table for each of its tables."""
    parts = [f"# {one.title}\n\n{one.about}\n"]
    pages, titles = described_on(), dict[type[Table], list[str]]()
    for title, form in tables_of(one.form):
        titles.setdefault(form, []).append(f"`{title}`" if title else "Top of the file")
    for form, named in titles.items():
        heading = f"## {', '.join(named)}"
        page = pages[form]
        if page != one.name:
            parts.append(f"{heading}\n\nAs on the page [{page}]({page}.md).\n")
            continue
        parts.append("\n".join([heading, "", *map(key_line, keys_of(form)), ""]))
    kinds = [key.kind for _, table in tables_of(one.form) for key in keys_of(table)]
    if any(kind.startswith(_WITH_STANDING) for kind in kinds):
        head = "## A quantity: a number with its standing\n"
        parts.append("\n".join([head, *map(key_line, keys_of(Quantity)), ""]))
    return "\n".join(parts)


def key_line(key: Key) -> str:
    """Return a key with its kind, its default and its meaning."""
    default = {"": "; required", "none": ""}.get(key.default, f"; {key.default}")
    return f"- `{key.name}` ({key.kind}{default}): {key.meaning}"


def described_on() -> dict[type[Table], str]:
    """Return the page that describes each table: some stand in several kinds of files."""
    pages = {StartTable: "map", MeasuredContacts: "contacts"}
    for one in sorted(FORMATS, key=lambda one: one.name == "run"):
        for _, form in tables_of(one.form):
            pages.setdefault(form, one.name)
    return pages


_WITH_STANDING = "quantity"


def tables_of(form: type[Table], prefix: str = "") -> Iterator[tuple[str, type[Table]]]:
    """Yield the tables of a file with the names of their headings, in the order of the model."""
    yield prefix, form
    for name, field in form.model_fields.items():
        inner, many = _inner_form(field.annotation)
        if name == "origin":  # free-form, but for these
            inner = RunContext
        if inner not in (None, Quantity, Bounds):
            key = field.alias or name
            path = f"{prefix.strip('[]')}.{key}" if prefix else key
            yield from tables_of(inner, f"[[{path}]]" if many else f"[{path}]")


def keys_of(table: type[Table]) -> list[Key]:
    """Return the keys of one table."""
    return [
        Key(
            name=key.name,
            # Limits within a list or an optional value stand in its annotation.
            kind=_kind(key.annotation, table.model_fields[key.field].metadata),
            default="" if key.required else _default_words(_as_in_files(key)),
            meaning=key.meaning,
        )
        for key in declared_keys(table)
    ]


def _inner_form(annotation: object) -> tuple[type[Table] | None, bool]:
    """Return the model of a table that a field holds, and whether the field holds several."""
    origin, inside = get_origin(annotation), get_args(annotation)
    if annotation is Start:
        return StartTable, False
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, False
    if origin is Annotated:
        return _inner_form(inside[0])
    if origin in (Union, types.UnionType):
        forms = [_inner_form(one) for one in inside]
        return next((one for one in forms if one[0] is not None), (None, False))
    if origin in (list, tuple):
        return _inner_form(inside[0])[0], True
    return None, False


_KINDS = {
    str: "text",
    float: "number",
    int: "whole number",
    bool: "true or false",
    Path: "path",
    Start: "text",
}


def _kind(annotation: object, metadata: Iterable[object] = ()) -> str:
    words = _kind_words(annotation)
    limits = " ".join(text for one in metadata for text in _limit_words(one))
    limits = re.sub(r"^from (\S+ to )", r"\1", limits)
    return f"{words}, {limits}" if limits else words


def _kind_words(annotation: object) -> str:
    origin, inside = get_origin(annotation), get_args(annotation)
    if isinstance(annotation, type):
        return _class_words(annotation)
    if origin is Annotated:
        return _annotated_words(inside)
    if origin is Literal:
        return " or ".join(f"`{one}`" for one in inside)
    if origin in (list, tuple):
        inner, _ = _inner_form(inside[0])
        return "tables" if inner is not None else f"list, each {_kind_words(inside[0])}"
    if origin in (dict, Mapping):
        return "table of any keys"
    return " or ".join(_kind_words(one) for one in inside if one is not type(None))


def _class_words(kind: type) -> str:
    if kind is Bounds:
        return "number, or a range `[low, high]`"
    if kind is Quantity:
        return _WITH_STANDING
    if issubclass(kind, Enum):
        return " or ".join(f"`{one.value}`" for one in kind)
    return _KINDS.get(kind, "table")


def _annotated_words(inside: tuple[object, ...]) -> str:
    limits = [one for outer in inside[1:] for one in getattr(outer, "metadata", [outer])]
    return _kind(inside[0], limits)


MOST = 1e6
"""From here on a limit only guards against nonsense: it is left out."""


def _limit_words(one: object) -> Iterator[str]:
    for name, words in (("gt", "above"), ("ge", "from"), ("lt", "below"), ("le", "to")):
        value = getattr(one, name, None)
        if value == 1e-6:
            yield "above 0"
        elif value is not None and abs(value) < MOST:
            yield f"{words} {value:g}"


def _as_in_files(key: DeclaredKey) -> Any:  # noqa: ANN401  of any key
    """Return a default as files have it: angles in degrees."""
    in_radians = key.field.endswith("_rad") and key.unit == "deg"
    return deg(key.default) if in_radians else key.default


def _default_words(value: object) -> str:
    if isinstance(value, Bounds):
        return f"`[{value.low:g}, {value.high:g}]`"
    if isinstance(value, BaseModel) or value in (None, {}, ()):
        return "none"
    return f"`{str(value).lower() if isinstance(value, bool) else value!r}`".replace("'", '"')


# --- Rules --------------------------------------------------------------------------------------


def rules_page() -> str:
    """Return the page of all design rules."""
    parts = [
        "# Design rules\n\n`vinefab rules VF-C01` explains one in the terminal. An error forbids "
        "cutting unless it is waived; a warning does not. Limits are changed by a recipe, by "
        "`[limits.VF-C01]` of a design, or by `vinefab check --limit VF-C01.warning=6`.\n\n"
        "Each picture shows a rule broken, then kept. Both were drawn and checked by "
        "vinefab itself: shapes and numbers are computed, from values that are assumed or "
        "published; none was measured.\n"
    ]
    for title, rules in grouped_rules().items():
        parts.append(f"## {title.capitalize()}\n")
        parts += [_rule_part(rule) for rule in rules]
    return "\n".join(parts)


def _rule_part(rule: Rule) -> str:
    limits = "; ".join(rule.limit_text(name) for name in rule.limits)
    first = f"- **Limits:** {limits}\n" if limits else ""
    picture = Path(__file__).parent / "pictures" / "rules" / f"{rule.id}.svg"
    shown = (
        f"\n![{rule.id} broken and kept](../pictures/rules/{rule.id}.svg)\n"
        if picture.is_file()
        else ""
    )
    return (
        f"### {rule.id}: {rule.title}\n{shown}\n{first}- **Why:** {rule.reason}\n"
        f"- **Remedy:** {rule.remedy}\n"
    )


# --- Commands -----------------------------------------------------------------------------------


COMMANDS_INTRODUCTION = """# Commands

A command is its function: parameters, defaults and meanings are the same, and \
`--head-on-half-angle-deg 5` is `head_on_half_angle_deg=5`; a unit at the end may be left out. \
A design, recipe, machine or printer \
is a path or the name of a shipped one; Python takes objects too. `vinefab COMMAND -h` prints all \
options of a command.

## Exit codes

| code | meaning |
|---|---|
| 0 | good; of `studio` also Ctrl-C |
| 1 | a rule forbids it, or no manufacturable robot was found |
| 2 | bad input or a refusing system: one line names file, key, value and the allowed range |
| 3 | a fault of vinefab: one line names a log to report |
| 129, 130, 143 | terminal closed, interrupted, terminated |
| 141 | the reader of the output is gone |
"""

PICTURES = {
    "aim": ("aim.svg", "Expected score along the border, and deployments from the best pose"),
    "check": ("findings.svg", "Findings numbered at their branches and listed with their limits"),
    "coupon": ("joints.webp", "The sheet of joint coupons"),
    "fabricate": ("sheet.svg", "The sheet: order, starts and directions of the paths on the bed"),
    "grow": ("grown.svg", "A robot grown on a table with three blocks"),
    "map import": ("walls.webp", "Walls that were read from a photo, drawn in red"),
    "map info": ("arena.svg", "Five narrow passages with their widths"),
    "map start": ("start.svg", "A start area: the free part filled, headings as a fan"),
    "observe": ("seen_3.webp", "The traced film in yellow, the prediction dashed in blue"),
    "report": ("report.webp", "First screen of a report"),
    "rig": ("rig.svg", "Plan of a rig: numbered parts, markers, base holder"),
    "score": ("targets.svg", "Two targets touched, one missed"),
    "studio": ("../studio.webp", "The studio: what is dragged, the robot grows anew"),
}
"""Pictures of verbs, which other pages show too."""

GENERATE = "map NAME"
"""The page of the commands that generate maps: each has the parameters of its environment."""


def command_pages() -> dict[str, str]:
    """Return the page of all commands, and one for each."""
    commands = {name: Command.named(name) for name in VERBS}
    commands[GENERATE] = Command.named(f"map {next(iter(ENVIRONMENTS))}")
    shared = shared_options(commands.values())
    pages = {
        f"verbs/{page_name(name)}.md": verb_page(name, one, shared)
        for name, one in commands.items()
    }
    return {"commands.md": commands_page(shared), **pages}


def page_name(name: str) -> str:
    """Return the name of a command's page."""
    return name.lower().replace(" ", "_").replace("-", "_")


def own_options(command: Command) -> list[Option]:
    """Return the options of a command, but for parameters of environments."""
    if not command.fixed:
        return list(command.options)
    elsewhere = {
        key.field for key in declared_keys(ENVIRONMENTS[command.fixed["environment"]].options)
    }
    return [one for one in command.options if one.name not in elsewhere]


def shared_options(commands: Iterable[Command]) -> list[Option]:
    """Return the options that say the same in several commands."""
    found = dict[str, Option]()
    counted = Counter[str]()
    for command in commands:
        for option in own_options(command):
            if option.name in ("out", "force"):
                continue
            found.setdefault(option_line(option), option)
            counted[option_line(option)] += 1
    return [option for line, option in found.items() if counted[line] > 1]


PLAIN = {"", "N", "NUMBER", "TEXT"}
"""Forms of values that an option's meaning tells."""


def option_line(option: Option) -> str:
    """Return the typed form of an option and its meaning."""
    words = option.help.replace("``", "`").rstrip(".")
    known = [*(option.kind.known() if option.kind.known else ()), *option.choices]
    if not all(name in words for name in known):
        words += f"; one of {', '.join(known)}"
    needed = " (required)" if option.required and not option.positional else ""
    plain = isinstance(option.default, int | float | str) and not isinstance(option.default, bool)
    shows_default = plain and option.default not in ("", REQUIRED)
    default = f" (`{text_of(option.default)}`)" if shows_default else ""
    return f"- {option_names(option)}{needed or default}: {words}."


def option_names(option: Option) -> str:
    """Return the names of an option, the first with the form of its value."""
    if option.positional:
        return f"`{option.metavar}`"
    first, *others = flags_of(option)[:2]
    takes = "" if option.base is bool or option.choices else option.metavar
    typed = first if takes in PLAIN else f"{first} {takes}"
    others = [flag for flag in others if flag != re.sub(r"-(mm|deg|px)$", "", first)]
    return ", ".join(f"`{name}`" for name in [typed, *others])


def commands_page(shared: Iterable[Option]) -> str:
    """Return the page of all commands: exit codes, a list, and the options that many have."""
    does = {name: verb.summary for name, verb in VERBS.items()}
    does[GENERATE] = "Generate a map: grid, cave, corridors, pegs, rubble."
    rows = [f"- [{name}](verbs/{page_name(name)}.md): {summary}" for name, summary in does.items()]
    every = [option_line(one) for one in COMMON]
    every.append(f"- `--force`: {get_args(Force)[1].documentation}")
    parts = [
        COMMANDS_INTRODUCTION,
        "## One page for each\n",
        "\n".join([*rows, ""]),
        "## Options of every command\n",
        "\n".join([*every, ""]),
        "## Options of several commands\n",
        "\n".join([*map(option_line, shared), ""]),
        "```{toctree}\n:hidden:\n:glob:\n\nverbs/*\n```\n",
    ]
    return "\n".join(parts)


def verb_page(name: str, command: Command, shared: Iterable[Option]) -> str:
    """Return the page of a command: what it does, an example, its function and its options."""
    first, rest = described(command.function)
    said = " ".join(f"{first} {rest}".replace("``", "`").split())
    parts = [f"# vinefab {name}\n\n{said}\n"]
    if name in PICTURES:
        file, words = PICTURES[name]
        parts.append(f"![{words}](../../pictures/pages/{file})\n")
    parts.append(f"```sh\n{command.examples()[0]}\n```\n")
    parts.append(f"```text\n{python_call(command)}\n```\n")
    result = re.search(
        r"Returns\n-+\n(\w+)\n(.*?)\n\n", inspect.getdoc(command.function) or "", re.S
    )
    if result is not None:
        words = " ".join(result[2].replace("``", "`").split())
        parts.append(f"Returns in Python `{result[1]}`: {words}\n")
    known = {option_line(one) for one in shared}
    options = [one for one in own_options(command) if one.name != "force"]
    own = [line for one in options if (line := option_line(one)) not in known]
    if own:
        parts.append("\n".join([*own, ""]))
    if name == GENERATE:
        parts.append("More options are the parameters of each [environment](../parts.md).\n")
    names = [
        f"`{one.metavar if one.positional else one.flag}`"
        for one in options
        if option_line(one) in known
    ]
    if names:
        where = "../commands.md#options-of-several-commands"
        parts.append(f"[As in other commands]({where}): {'; '.join(names)}.\n")
    return "\n".join(parts)


_STAR = {
    inspect.Parameter.VAR_POSITIONAL: "*",
    inspect.Parameter.VAR_KEYWORD: "**",
}


def python_call(command: Command) -> str:
    """Return the signature of a command's function, without kinds."""
    function = inspect.unwrap(command.function)
    shown, keyword_only = list[str](), False
    for one in inspect.signature(function).parameters.values():
        if one.kind is one.KEYWORD_ONLY and not keyword_only:
            keyword_only = True
            shown.append("*")
        keyword_only |= one.kind is one.VAR_POSITIONAL
        default = "" if one.default is one.empty else f"={one.default!r}"
        shown.append(f"{_STAR.get(one.kind, '')}{one.name}{default}")
    room = "vf.maps." if function.__module__.endswith(".maps") else "vf."
    return textwrap.fill(
        f"{room}{function.__name__}({', '.join(shown)})", 100, subsequent_indent="    "
    )


# --- Parts --------------------------------------------------------------------------------------


def parts_page() -> str:
    """Return the page of environments, tasks and optimizers with their parameters."""
    parts = [
        "# Parts and their parameters\n\nEnvironments, tasks and optimizers are named in run files "
        "and on the command line; their parameters are keys next to the name, `--set NAME=VALUE`, "
        "or options of `vinefab map NAME`.\n"
    ]
    groups = (
        ("Environments", {name: one.options for name, one in ENVIRONMENTS.items()}),
        ("Tasks", dict(TASKS.items())),
        ("Optimizers", dict(OPTIMIZERS.items())),
    )
    about = {name: f"{one.description.capitalize()}." for name, one in ENVIRONMENTS.items()}
    for title, kinds in groups:
        shared = _shared_keys(kinds)
        parts.append(f"## {title}\n\n### Parameters of several\n")
        parts.append(_parameters([(key, default) for key, default in shared.items()]))
        parts += [_part(name, kind, shared, about.get(name, "")) for name, kind in kinds.items()]
    return "\n".join(parts)


def _unlike(key: Key) -> Key:
    return replace(key, default="")


def _shared_keys(kinds: Mapping[str, type[Table]]) -> dict[Key, str]:
    """Return the parameters that several parts have, each with its defaults by part."""
    having = dict[Key, dict[str, str]]()
    for name, kind in kinds.items():
        for key in keys_of(kind):
            having.setdefault(_unlike(key), {})[name] = key.default
    found = dict[Key, str]()
    for key, defaults in having.items():
        by_default = dict[str, list[str]]()
        for name, default in defaults.items():
            by_default.setdefault(default, []).append(name)
        if len(defaults) == len(kinds) and len(by_default) == 1:
            (found[key],) = by_default
        elif len(defaults) > 1:
            found[key] = "; ".join(
                f"{one}: {', '.join(names)}" for one, names in by_default.items()
            )
    return found


def _parameters(keys: Iterable[tuple[Key, str]]) -> str:
    return "\n".join([*(key_line(replace(key, default=default)) for key, default in keys), ""])


def _part(name: str, kind: type[Table], shared: Container[Key], about: str) -> str:
    first = about or (inspect.getdoc(kind) or "").split("\n\n")[0].replace("\n", " ")
    keys = keys_of(kind)
    own = [(key, key.default) for key in keys if _unlike(key) not in shared]
    several = [f"`{key.name}`" for key in keys if _unlike(key) in shared]
    said = f"{first} Above: {', '.join(several)}." if several else first
    return "\n".join([f"### {name}\n", said, "", *([_parameters(own)] if own else [])])


if __name__ == "__main__":
    write_reference(Path(__file__).parent / "reference")
