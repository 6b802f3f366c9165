"""Reference pages made from the code, so that they cannot drift from it.

Formats come from the models that read files, rules from the catalogue, commands from the program,
parts from their registries. A key without a meaning is refused: `tests/test_docs.py`.
"""

import inspect
import types
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from vinefab.app.verbs import GROUPS, VERBS
from vinefab.cli.commands import Command, names_in
from vinefab.cli.help import command_help, group_help
from vinefab.core.table import DeclaredKey, Table, declared_keys
from vinefab.core.units import deg
from vinefab.fabrication.rules.catalog import grouped_rules
from vinefab.fabrication.rules.rule import Rule
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.contacts import ContactsFile
from vinefab.model.design import Design
from vinefab.model.files.run_context import RunContext
from vinefab.model.laser import Machine, Material, Quantity, Recipe
from vinefab.model.map import Start
from vinefab.model.start_place import StartTable
from vinefab.rig.rig_options import PrinterForm
from vinefab.search.optimizers.shipped_optimizers import OPTIMIZERS
from vinefab.search.settings import RunFile
from vinefab.search.space import Bounds
from vinefab.tasks.shipped_tasks import TASKS


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
        title="Machine (`vinefab/machine-1`, TOML)",
        form=Machine,
        about="A laser cutter; `vinefab new machine mine.toml` writes one. A recipe names it "
        "(`machine`) and finds it beside itself, or in your "
        "[own folder](../files.md#where-files-are-found). "
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
        about="What photos of grown robots say of assumed numbers; `vinefab observe` writes it, "
        "`--contacts` reads it.",
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
    pages |= {"rules.md": rules_page(), "commands.md": commands_page(), "parts.md": parts_page()}
    folder.mkdir(exist_ok=True)
    for name, text in pages.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


# --- File formats -------------------------------------------------------------------------------


def format_page(one: Format) -> str:
    """Return the page of a kind of file: a table for each of its tables."""
    parts = [f"# {one.title}\n\n{one.about}\n"]
    for title, form in tables_of(one.form):
        rows = [
            f"| `{key.name}` | {key.kind} | {key.default or 'required'} | {key.meaning} |"
            for key in keys_of(form)
        ]
        heading = f"## `{title}`" if title else "## Top of the file"
        head = "| key | kind | default | meaning |\n|---|---|---|---|"
        parts.append("\n".join([heading, "", head, *rows, ""]))
    kinds = [key.kind for _, table in tables_of(one.form) for key in keys_of(table)]
    if any(kind.startswith(_WITH_STANDING) for kind in kinds):
        rows = [f"| `{key.name}` | {key.kind} | {key.meaning} |" for key in keys_of(Quantity)]
        head = ["## A number with its standing", "", "| key | kind | meaning |", "|---|---|---|"]
        parts.append("\n".join([*head, *rows, ""]))
    return "\n".join(parts)


_WITH_STANDING = "a number with its standing"


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
    limits = [text for one in metadata for text in _limit_words(one)]
    return f"{words}, {' '.join(limits)}" if limits else words


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


def _limit_words(one: object) -> Iterator[str]:
    for name, words in (("gt", "above"), ("ge", "from"), ("lt", "below"), ("le", "to")):
        value = getattr(one, name, None)
        if value is not None:
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
        "Each picture shows what breaks a rule, then what keeps it. Both were drawn and checked by "
        "vinefab itself: shapes and numbers are computed, from values that are assumed or "
        "published; none was measured.\n"
    ]
    for title, rules in grouped_rules().items():
        parts.append(f"## {title.capitalize()}\n")
        parts += [_rule_part(rule) for rule in rules]
    return "\n".join(parts)


def _rule_part(rule: Rule) -> str:
    limits = "; ".join(rule.limit_text(name) for name in rule.limits) or "none: it holds or not"
    picture = Path(__file__).parent / "pictures" / "rules" / f"{rule.id}.svg"
    shown = (
        f"\n![{rule.id} broken and kept](../pictures/rules/{rule.id}.svg)\n"
        if picture.is_file()
        else ""
    )
    return (
        f"### {rule.id}: {rule.title}\n{shown}\n- **Broken:** {rule.broken}\n"
        f"- **Limits:** {limits}\n- **Why:** {rule.reason}\n"
        f"- **Remedy:** {rule.remedy}\n"
    )


# --- Commands -----------------------------------------------------------------------------------


COMMANDS_INTRODUCTION = """# Commands

Every command has `-h`. What stands here is what it prints. A design, recipe, machine or printer is
a path or the name of a shipped one; `--json FILE` writes the result for programs.

## Exit codes

| code | meaning |
|---|---|
| 0 | good; of `studio` also Ctrl-C |
| 1 | a rule forbids it, or no manufacturable robot was found |
| 2 | bad input: one line names file, key, value and what is allowed |
| 2 | the system refuses: no room, no permission, not enough memory |
| 3 | a fault of vinefab: one line names a log to report |
| 129, 130, 143 | terminal closed, interrupted, terminated |
| 141 | the reader of the output is gone |
"""


def commands_page() -> str:
    """Return the help of every command, as the program prints it."""
    parts = [COMMANDS_INTRODUCTION]
    for first in dict.fromkeys(name.split()[0] for name in VERBS):
        shown = [
            (f"## vinefab {first}", group_help(first, 100) if first in GROUPS else _help(first))
        ]
        if first in GROUPS:
            names = [f"{first} {last}" for last in names_in(first)]
            shown += [(f"### vinefab {name}", _help(name)) for name in names]
        parts += [f"{heading}\n\n```text\n{text}\n```\n" for heading, text in shown]
    return "\n".join(parts)


def _help(name: str) -> str:
    return command_help(Command.named(name), 100)


# --- Parts --------------------------------------------------------------------------------------


def parts_page() -> str:
    """Return the page of environments, tasks and optimizers with their parameters."""
    parts = [
        "# Parts and their parameters\n\nEnvironments, tasks and optimizers are named in run files "
        "and on the command line; their parameters are keys beside the name, `--set NAME=VALUE`, "
        "or options of `vinefab map NAME`.\n"
    ]
    groups = (
        ("Environments", {name: one.options for name, one in ENVIRONMENTS.items()}),
        ("Tasks", dict(TASKS.items())),
        ("Optimizers", dict(OPTIMIZERS.items())),
    )
    for title, kinds in groups:
        parts.append(f"## {title}\n")
        parts += [_part(name, kind) for name, kind in kinds.items()]
    return "\n".join(parts)


def _part(name: str, kind: type[Table]) -> str:
    first = (inspect.getdoc(kind) or "").split("\n\n")[0].replace("\n", " ")
    rows = [
        f"| `{key.name}` | {key.kind} | {key.default} | {key.meaning} |" for key in keys_of(kind)
    ]
    head = "| parameter | kind | default | meaning |\n|---|---|---|---|"
    table = [head, *rows] if rows else ["No parameters."]
    return "\n".join([f"### {name}\n", first, "", *table, ""])


if __name__ == "__main__":
    write_reference(Path(__file__).parent / "reference")
