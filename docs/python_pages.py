"""Pages of the Python names, made from ``dir(vf)``: functions, classes and all their members.

They are in the directives of Sphinx's Python domain, which fill the site's index. A public member
without a docstring, or a field without a meaning, is refused.
"""

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from functools import cached_property
from types import ModuleType
from typing import Any

import vinefab as vf
from vinefab.app.verbs import VERBS
from vinefab.core.table import Table
from vinefab.core.verbs import parameter_words
from vinefab.core.view import Result

SHARED: dict[str, type] = {"Result": Result, "Table": Table}
"""Bases that are no names of ``vf``, whose members many have: a page each."""

INTRODUCTION = """# Python

Every name of `import vinefab as vf`, and of each class every field, property and method. Lengths \
are millimetres, angles degrees unless a name ends in `_rad`, pressures kPa. [The library](../\
library.md) shows them at work.

## Functions

Each does the same as its [command](commands.md), whose page has all parameters. What stands for a \
design, a map or a task is an object, a path or a name.
"""

HEADINGS = (
    ("Results", "What the functions return. All have the members of [Result](python/Result.md)."),
    ("Nouns", "Designs, maps, settings and their parts. Those of files have the members of "
              "[Table](python/Table.md)."),
    ("Errors", "Each is one line, and a matching built-in too."),
)  # fmt: skip


class UndocumentedError(LookupError):
    """A public member without words."""


def python_pages() -> dict[str, str]:
    """Return the page of all names, and one for each class."""
    kinds = public_classes()
    pages = {f"python/{name}.md": class_page(name, kind, kinds) for name, kind in kinds.items()}
    return {"python.md": names_page(kinds), **pages}


def public_classes() -> dict[str, type]:
    """Return the classes of ``dir(vf)``, and those whose members they share, by name."""
    named = {name: getattr(vf, name) for name in vf.__all__}
    return {name: one for name, one in named.items() if isinstance(one, type)} | SHARED


def public_functions() -> dict[str, Any]:
    """Return the functions of ``dir(vf)`` and of ``vf.maps`` by name."""
    found = dict[str, Any]()
    for name in vf.__all__:
        thing = getattr(vf, name)
        if isinstance(thing, ModuleType) and not callable(thing):
            found |= {f"{name}.{own}": getattr(thing, own) for own in thing.__all__}
        elif not isinstance(thing, type):
            found[name] = thing
    return found


def names_page(kinds: dict[str, type]) -> str:
    """Return the page of all names: functions, then classes by what they are."""
    parts = [INTRODUCTION]
    commands = {inspect.unwrap(verb.function): name for name, verb in VERBS.items()}
    for name, function in public_functions().items():
        words = first_words(f"vf.{name}", function)
        command = commands.get(inspect.unwrap(function), "")
        page = f"verbs/{command.replace(' ', '_').replace('-', '_')}.md"
        said = f"{words} [vinefab {command}]({page})" if command else markdown(function.__doc__)
        parts.append(directive("function", f"vf.{name}{signature_of(function)}", [said]))
    groups: dict[str, list[str]] = {title: [] for title, _ in HEADINGS}
    for name, kind in kinds.items():
        title = (
            "Errors" if issubclass(kind, Exception)
            else "Results" if issubclass(kind, Result)
            else "Nouns"
        )  # fmt: skip
        groups[title].append(f"- [{name}](python/{name}.md): {first_words(name, kind)}")
    for title, about in HEADINGS:
        parts.append(f"\n## {title}\n\n{about}\n\n" + "\n".join(groups[title]) + "\n")
    parts.append("```{toctree}\n:hidden:\n:glob:\n\npython/*\n```\n")
    return "\n".join(parts)


def class_page(name: str, kind: type, kinds: dict[str, type]) -> str:
    """Return the page of a class: what it is, how it is made, and every member."""
    shown = name if name in SHARED else f"vf.{name}"
    is_made = inspect.isfunction(kind.__init__) and not issubclass(kind, Enum)
    made = signature_of(kind) if is_made and name not in SHARED else ""
    about, _, _ = (inspect.getdoc(kind) or "").partition("\nParameters\n---")
    if not about.strip():
        raise UndocumentedError(f"{shown} has no docstring")
    body = [markdown(about), *members(shown, kind, kinds)]
    return f"# {shown}\n\n{directive('class', f'{shown}{made}', body, fence=4)}"


def members(shown: str, kind: type, kinds: dict[str, type]) -> Iterator[str]:
    """Yield the fields, properties and methods of a class, but those that have another page."""
    elsewhere = [base for base in kinds.values() if base is not kind and issubclass(kind, base)]
    words = field_words(kind)
    if issubclass(kind, Enum):
        for one in kind:
            yield directive("attribute", f"{one.name}\n:value: {one.value!r}", [])
    fields = dict(fields_of(kind))
    for name, annotation in fields.items():
        if not words.get(name):
            raise UndocumentedError(f"{shown}.{name} has no meaning")
        yield directive(
            "attribute", f"{name}\n:type: {type_words(annotation)}", [markdown(words[name])]
        )
    done = {*fields, "model_config", "schema"}
    for base in kind.__mro__:
        if base in elsewhere or not base.__module__.startswith("vinefab"):
            continue
        for name in sorted(vars(base)):
            inherited = any(name in vars(one) and one is not kind for one in elsewhere)
            if name.startswith("_") or name in done or (inherited and base is not kind):
                continue
            done.add(name)
            yield from member(shown, kind, name)
    pages = [name for name, base in kinds.items() if base in elsewhere and base in SHARED.values()]
    if pages:
        yield f"Also the members of {', '.join(f'[{one}]({one}.md)' for one in pages)}."


def member(shown: str, kind: type, name: str) -> Iterator[str]:
    """Yield one property or method."""
    static, bound = inspect.getattr_static(kind, name), getattr(kind, name)
    if issubclass(kind, Enum) and isinstance(static, kind):
        return
    if isinstance(static, cached_property):
        static = property(static.func)
    if not callable(bound) and not isinstance(static, property):
        text = field_words(kind).get(name, "")
        head, role = name, "attribute"
    elif isinstance(static, property):
        text = inspect.getdoc(static.fget) or ""
        returned = inspect.signature(static.fget).return_annotation
        head, role = f"{name}\n:type: {type_words(returned)}", "property"
    else:
        text = inspect.getdoc(bound) or ""
        option = "\n:classmethod:" if isinstance(static, classmethod) else ""
        option = "\n:staticmethod:" if isinstance(static, staticmethod) else option
        head, role = f"{name}{signature_of(bound)}{option}", "method"
    if not text:
        raise UndocumentedError(f"{shown}.{name} has no docstring")
    yield directive(role, head, [markdown(text)])


def fields_of(kind: type) -> Iterator[tuple[str, object]]:
    """Yield the fields of a class with their annotations, as its constructor takes them."""
    if issubclass(kind, Table):
        for name, one in inspect.signature(kind).parameters.items():
            yield name, one.annotation
    elif dataclasses.is_dataclass(kind):
        for field in dataclasses.fields(kind):
            yield field.name, field.type


def field_words(kind: type) -> dict[str, str]:
    """Return the meaning of each field: declared, of the docstring, or the comment next to it."""
    found = dict[str, str]()
    for base in reversed(kind.__mro__):
        if base.__module__.startswith("vinefab"):
            found |= commented(base)
    found |= parameter_words(kind)
    if issubclass(kind, Table):
        for key in kind.python_keys():
            unit = f" ({key.unit})" if key.unit else ""
            meaning = f"{key.meaning[:1].upper()}{key.meaning[1:]}{unit}".removesuffix(".")
            found[key.field] = f"{meaning}."
    return found


def commented(kind: type) -> dict[str, str]:
    """Return the comments on the fields of a class: behind them, above them, or a docstring."""
    try:
        lines = textwrap.dedent(inspect.getsource(kind)).splitlines()
    except (OSError, TypeError):  # made when it runs
        return {}
    body = ast.parse("\n".join(lines)).body[0].body  # type: ignore[attr-defined]
    found = dict[str, str]()
    for place, node in enumerate(body):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        words = lines[node.end_lineno - 1].partition("  # ")[2].partition("  # ")[0]
        above = node.lineno - 2
        while not words.strip() and lines[above].lstrip().startswith("# "):
            while lines[above - 1].lstrip().startswith("# "):
                above -= 1
            words = " ".join(one.strip("# ") for one in lines[above : node.lineno - 1])
        after = body[place + 1] if place + 1 < len(body) else None
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            words = str(after.value.value)
        if words:
            found[node.target.id] = f"{words[:1].upper()}{words[1:]}"
    return found


# --- How they are written -----------------------------------------------------------------------


def directive(role: str, head: str, body: Iterable[str], *, fence: int = 3) -> str:
    """Return an entry of the Python domain, which the site's index lists."""
    content = "\n\n".join(part for part in body if part)
    fenced = ":" * fence
    return f"{fenced}{{py:{role}}} {head}\n\n{content}\n{fenced}\n"


def signature_of(thing: Callable[..., object]) -> str:
    """Return a signature with the plain words of its types."""
    parts, starred = list[str](), False
    for one in inspect.signature(thing).parameters.values():
        if one.name in ("self", "cls"):
            continue
        mark = {one.VAR_KEYWORD: "**", one.VAR_POSITIONAL: "*"}.get(one.kind, "")
        if one.kind is one.KEYWORD_ONLY and not starred:
            parts, starred = [*parts, "*"], True
        starred |= mark == "*"
        kind = type_words(one.annotation)
        typed = f"{mark}{one.name}: {kind}" if kind else f"{mark}{one.name}"
        parts.append(typed if one.default is one.empty else f"{typed} = {default_words(one)}")
    returned = inspect.signature(thing).return_annotation
    gives = "" if isinstance(thing, type) else type_words(returned)
    return f"({', '.join(parts)})" + (f" -> {gives}" if gives else "")


def default_words(parameter: inspect.Parameter) -> str:
    """Return a default that the domain can read: a value, a name, or dots."""
    text = repr(parameter.default)
    return text if re.fullmatch(r"[\w.'\"-]*|[(\[{][\w., '\"-]*[)\]}]|\w+\(\)", text) else "..."


def type_words(annotation: object) -> str:
    """Return an annotation as people say it: no modules, no marks, arrays as arrays."""
    if annotation in (inspect.Parameter.empty, Any):
        return ""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    while text.startswith(("Annotated[", "typing.Annotated[")):
        text = ast.unparse(ast.parse(text).body[0].value.slice.elts[0])  # type: ignore[attr-defined]
    text = re.sub(r"ForwardRef\('([\w.]+)'\)", r"\1", text)
    if "numpy" in text or re.fullmatch(r"(Floats|Ints|Bools|NDArray\b.*)", text):
        return "array"
    text = re.sub(r"\b(?:[a-z_]\w*\.)+(?=[A-Z_])", "", text).replace("PathLike[str]", "PathLike")
    if "Annotated" in text:
        return ""
    return text.replace("'", "") if "Literal" not in text else text


def first_words(name: str, thing: object) -> str:
    """Return the first sentence of a docstring."""
    text = inspect.getdoc(thing) or ""
    if not text:
        raise UndocumentedError(f"{name} has no docstring")
    return markdown(text.split("\n\n")[0])


def markdown(text: str) -> str:
    """Return a docstring as Markdown: sections as lists, examples as blocks."""
    head, *sections = re.split(r"(?:^|\n\n)(?=[A-Z][\w ]+\n-{3,}\n)", inspect.cleandoc(text))
    parts = [_paragraphs(head)]
    for section in sections:
        title, _, rest = section.partition("\n")
        body = rest.partition("\n")[2]
        if title == "Examples":
            # Lines for a shell stand on the page of the command.
            body = re.sub(r"^\$ .*\n+", "", body, flags=re.MULTILINE)
            if body.strip():
                parts.append(f"**{title}**\n\n```text\n{body.strip()}\n```")
        elif title in ("See Also", "Notes"):
            parts.append(f"**{title}**\n\n{_paragraphs(body)}")
        else:
            rows = re.findall(r"^(\S.*)\n((?:[ \t]+.*\n?|\n)*)", f"{body}\n", re.MULTILINE)
            said = [f"- `{one}`: {_line(more)}" if more.strip() else f"- `{one}`"
                    for one, more in rows]  # fmt: skip
            parts.append(f"**{title}**\n\n" + "\n".join(said))
    return "\n\n".join(part for part in parts if part)


def _paragraphs(text: str) -> str:
    found = list[str]()
    for paragraph in re.split(r"\n\s*\n", text.strip()):
        if paragraph.startswith((" ", ">>>")):
            found.append(f"```text\n{textwrap.dedent(paragraph)}\n```")
        else:
            found.append(_line(re.sub(r"::$", ":", paragraph)))
    return "\n\n".join(found)


def _line(text: str) -> str:
    """Return running text on one line; what Markdown would obey is escaped outside of code."""
    parts = re.split(r"(`[^`]*`)", " ".join(text.replace("``", "`").split()))
    return "".join(one if one.startswith("`") else re.sub(r"([*<\[])", r"\\\1", one)
                   for one in parts)  # fmt: skip
