"""The text of a design file, changed to another design; what did not change stays as it stands.

tomlkit changes values where they stand. Lines that are new are put in as marks first, so that they
come before the comments above the next table, and so that comments of lines that went stay.
"""

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import islice
from pathlib import Path
from typing import Any

import tomli_w
import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Table

from vinefab.core.errors import CannotWriteError, VinefabError
from vinefab.core.hashing import sha256_of
from vinefab.core.limits import file_number
from vinefab.core.table import declared_keys, inner_table
from vinefab.model.design import (
    PER_LEVEL,
    Branch,
    Build,
    Design,
    Level,
    Trunk,
    design_content,
    design_of,
)
from vinefab.model.files.toml import table_content, toml_content

LARGEST_EDITED_BYTES = 1 << 16
"""Thirty times the largest that is shipped; more may take tomlkit seconds."""

_MOST_DOTTED = 200
_DOTTED = re.compile(r"""(?<![\w"'.-])[\w"'-]++[ \t]*+\.[\w."' \t-]{1,200}+=""")
"""Keys in parts, ``build.tail_mm = 9``: tomlkit needs time that grows with the square of them."""

_ELSEWHERE = "save it under another name"

_AFTER = {"level": "trunk", "branch": "trunk"}
"""The table that new ones of an array stand below, where the file has none of them."""

Order = list[int | None]
"""For each entry of a new list, the old entry that it continues; None for a new one."""


def edited_text(text: str, design: Design, source: str | Path) -> str:
    """Return the text of a design file changed so that reading it gives a design.

    Comments, order, spacing and every value that is the same stay as they stand; comments of
    removed parts become separate lines. Lengths that no number of the file gives exactly, as its
    scale is not a power of two, are off by at most one unit in the last place.

    Parameters
    ----------
    source
        What messages call the text.

    Raises
    ------
    VinefabError
        If the text is not a design file, or tomlkit cannot change it in place.
    """
    bom = "\ufeff" if text.startswith("\ufeff") else ""
    body = text.removeprefix(bom)
    content = toml_content(body, source)
    old = design_of(content, source)
    if old == design:
        return text
    too_much = ""
    if len(body.encode()) > LARGEST_EDITED_BYTES:
        too_much = f"files of over {LARGEST_EDITED_BYTES} bytes"
    elif next(islice(_DOTTED.finditer(body), _MOST_DOTTED, None), None):
        too_much = f"files with over {_MOST_DOTTED} dotted keys"
    if too_much:
        raise CannotWriteError(source, f"{too_much} are not changed in place; {_ELSEWHERE}")
    orders = [_by_place(range(1, old.depth), range(1, design.depth))]  # which level continues which
    if len(old.levels) != len(design.levels):
        orders.insert(0, _order(old.levels, design.levels))  # likelier
    for order in orders:
        changed = _changed(body, content, old, design, order)
        for result in _with_lost_comments(body, changed):
            with suppress(VinefabError):
                if _is_near(design_of(toml_content(result, source), source), design):
                    return bom + result
    raise CannotWriteError(source, f"its layout cannot be changed in place; {_ELSEWHERE}")


def _by_place(old: Sequence[object], new: Sequence[object]) -> Order:
    return [place if place < len(old) else None for place in range(len(new))]


def _branch_names(design: Design) -> list[str]:
    return [branch.name for branch in design.branches or ()]


def _order(old: Sequence[object], new: Sequence[object]) -> Order:
    order: Order = []
    for kind, i1, i2, j1, j2 in SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        pairs = range(i1, i2) if kind in ("equal", "replace") else ()
        order += [*pairs, *[None] * (j2 - j1)][: j2 - j1]
    return order


def _changed(
    body: str, content: Mapping[str, Any], old: Design, new: Design, order: Order
) -> str | None:
    """Return the changed text; None where its layout is beyond tomlkit."""
    ended = body if body.endswith("\n") else f"{body}\n"
    try:
        file = _EditedFile(document=tomlkit.parse(ended), token=sha256_of(body.encode())[:16])
        _edit(file, content, old, new, order)
        changed = file.text()
    except (TOMLKitError, RecursionError, ValueError, KeyError, IndexError, AttributeError):
        # Of unusual layouts, such as tables in pieces, tomlkit gives parts that do not do it all.
        return None
    if "\r\n" in body and "\n" not in body.replace("\r\n", ""):
        changed = re.sub(r"(?<!\r)\n", "\r\n", changed)
    return changed if body.endswith("\n") else changed.removesuffix("\n").removesuffix("\r")


def _edit(
    file: "_EditedFile", content: Mapping[str, Any], old: Design, new: Design, order: Order
) -> None:
    scale = float(content.get("scale_mm_per_unit", 1.0))
    waived = _order(old.waivers, new.waivers)
    if waived[:1] == [None]:  # there may be nothing that a first one could follow
        waived = _by_place(old.waivers, new.waivers)
    given, wanted = (_in_units_of_file(design, scale) for design in (old, new))
    continued = {
        "level": order if new.levels else [],
        "branch": _order(_branch_names(old), _branch_names(new)),
        "waive": waived,
    }
    for key in declared_keys(Design):
        name, before, after = key.name, given.get(key.name), wanted.get(key.name)
        if name == "build":
            file.put_build(_build_changes(content.get(name, {}), old.build, new.build), order)
        elif isinstance(after, list):
            file.put_tables(name, before or [], after, continued[name])
        elif isinstance(after, dict) and inner_table(key.annotation) is None:
            file.put_free_table(name, before or {}, after)
        elif isinstance(after, dict):
            file.put_changes(file.document[name], before or {}, after)
        elif before != after:
            file.put(file.document, name, after)


def _in_units_of_file(design: Design, scale: float) -> dict[str, Any]:
    """Return the content of a design with lengths that are read right with a file's scale."""
    content = design_content(design)
    for table in (content["trunk"], *content["level"], *content.get("branch", ())):
        table["length"] = _in_units(table["length"], scale)
        if table.get("bends"):
            table["bends"] = [[_in_units(at, scale), turn] for at, turn in table["bends"]]
    return content


def _in_units(length_mm: float, scale: float) -> float:
    return file_number(length_mm, length_mm / scale, scale.__mul__)


def _build_changes(table: Mapping[str, Any], old: Build, new: Build) -> dict[str, Any]:
    """Return the changes of ``[build]``; values that follow from others stay while they do."""
    changes: dict[str, Any] = {}
    ratios = {name: table.get(name) for name in ("trunk_width_mm", "width_ratio")}
    depth, widths_mm = len(new.widths_mm), table.get("widths_mm")
    if tuple(widths_mm or Build(**ratios).for_levels(depth).widths_mm) != new.widths_mm:
        changes |= {"widths_mm": list(new.widths_mm), "trunk_width_mm": None, "width_ratio": None}
    fillets_mm = table.get("fillet_mm")
    if fillets_mm is None:
        ratio = table.get("fillet_ratio")
        fillets_mm = Build(widths_mm=new.widths_mm, fillet_ratio=ratio).fillet_mm
    if tuple(fillets_mm) != new.fillet_mm:
        changes |= {"fillet_mm": list(new.fillet_mm), "fillet_ratio": None}
    given, wanted = (table_content(build) for build in (old, new))
    for key in declared_keys(Build):
        usual = key.default if isinstance(key.default, str) else None
        before, after = (content.get(key.name, usual) for content in (given, wanted))
        if key.name in ("widths_mm", "fillet_mm") or before == after:
            continue
        if isinstance(after, dict):
            was = before or {}
            after = {k: after.get(k) for k in {**was, **after} if after.get(k) != was.get(k)}
        changes[key.name] = None if after == [] else after
    return changes


@dataclass(slots=True)
class _EditedFile:
    """A document that is being changed."""

    document: tomlkit.TOMLDocument
    token: str  # in every mark; in no text by chance
    blocks: list[str] = field(default_factory=list)  # by the number of their mark
    at_end: list[str] = field(default_factory=list)  # tables to be added below all others

    def text(self) -> str:
        """Return the document with the new lines in the places of their marks."""
        marks = re.compile(rf"[ \t]*# {self.token}:(\d+)\r?\n")
        text = marks.sub(lambda mark: self.blocks[int(mark[1])], self.document.as_string())
        return "".join([text, *(f"\n{block}" for block in self.at_end)])

    def put(self, table: Any, key: str, value: Any) -> None:  # noqa: ANN401  tomlkit's tables
        """Set a value, or remove it with None; a new one stands below the others of its table."""
        if value is None:
            if key in table:
                del table[key]
        elif key in table or not _takes_lines(table):
            table[key] = _inline(value) if isinstance(value, dict) else value
        else:
            self._add(table, _line(key, value))

    def put_tables(
        self,
        name: str,
        old: Sequence[Mapping[str, Any]],
        new: Sequence[Mapping[str, Any]],
        order: Order,
    ) -> None:
        """Change the tables of an array of them: new ones, old ones, and values that differ."""
        if list(old) == list(new):
            return
        tables = self.document.get(name)
        if not isinstance(tables, list) or not tables or not _takes_lines(tables[0]):
            self._put_inline_tables(name, tables, old, new, order)
            return
        kept = list(tables)
        for index, values in zip(order, new, strict=True):
            if index is not None:
                self.put_changes(kept[index], old[index], values)
        last = None if order[:1] == [None] else kept[0]
        for index, values in zip(order, new, strict=True):
            if index is None:
                before = self.document[_AFTER[name]] if last is None else last
                self._add(before, _table_block(name, values))
            else:
                last = kept[index]
        _remove_all_but(tables, order)
        if not tables:
            del self.document[name]

    def _put_inline_tables(
        self,
        name: str,
        tables: Any,  # noqa: ANN401  tomlkit's array, if there is one
        old: Sequence[Mapping[str, Any]],
        new: Sequence[Mapping[str, Any]],
        order: Order,
    ) -> None:
        """Change an array of inline tables, or add tables where there are none."""
        if tables is None or len(tables) == 0:
            if tables is not None:
                del self.document[name]
            before = self.document.get(_AFTER.get(name, ""))
            for values in new:
                block = _table_block(name, values)
                if before is not None and _takes_lines(before):
                    self._add(before, block)
                else:
                    self.at_end.append(block.removeprefix("\n"))
            return
        kept = [tables[index] for index in range(len(tables))]
        _remove_all_but(tables, order)
        for place, (old_place, values) in enumerate(zip(order, new, strict=True)):
            if old_place is None:
                tables.insert(place, _inline(values))
            else:
                self.put_changes(kept[old_place], old[old_place], values)

    def put_changes(
        self,
        table: Any,  # noqa: ANN401  tomlkit's
        old: Mapping[str, Any],
        new: Mapping[str, Any],
    ) -> None:
        """Change the values of a table that differ."""
        for key in {**old, **new}:
            if new.get(key) != old.get(key):
                self.put(table, key, new.get(key))

    def put_build(self, changes: Mapping[str, Any], order: Order) -> None:
        """Change table ``[build]``, or add it."""
        table = self.document.get("build")
        if table is None:
            given = {key: value for key, value in changes.items() if value is not None}
            if given:
                parts = {k: _inline(v) if isinstance(v, dict) else v for k, v in given.items()}
                lines = "".join(_line(key, value) for key, value in parts.items())
                self.at_end.append(f"[build]\n{lines}")
            return
        by_level: Order = [0, *(None if index is None else index + 1 for index in order)]
        orders = {name: by_level if mark.first == 1 else order for name, mark in PER_LEVEL.items()}
        for key, value in changes.items():
            if key in orders and key in table and value is not None:
                _put_list(table[key], value, orders[key])
            elif isinstance(value, dict) and key in table:
                for name, part in value.items():
                    self.put(table[key], name, part)
            elif isinstance(value, dict):
                self.put(table, key, _inline(value))
            else:
                self.put(table, key, value)

    def put_free_table(self, name: str, old: dict[str, Any], new: dict[str, Any]) -> None:
        """Change a table of free content to another."""
        if old == new:
            return
        if name not in self.document:
            self.at_end.append(tomli_w.dumps({name: new}))
        elif not new:
            del self.document[name]
        else:
            self._merge(self.document[name], old, new)

    def _merge(self, table: Any, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:  # noqa: ANN401
        for key in old.keys() - new.keys():
            del table[key]
        for key, value in new.items():
            before = old.get(key)
            if key in old and before == value and type(before) is type(value):
                continue
            if isinstance(value, dict) and isinstance(before, dict):
                self._merge(table[key], before, value)
            elif isinstance(value, dict):
                table[key] = value
            else:
                self.put(table, key, value)

    def _add(self, table: Any, block: str) -> None:  # noqa: ANN401  tomlkit's
        """Put lines below the last value of a table, before the comments above the next one."""
        body = table.value.body
        place = len(body)
        while (
            place
            and body[place - 1][0] is None
            and self.token not in body[place - 1][1].as_string()
        ):
            place -= 1
        # Entries without a key are in no index of the table.
        body.insert(place, (None, tomlkit.comment(f"{self.token}:{len(self.blocks)}")))
        self.blocks.append(block)


def _takes_lines(table: Any) -> bool:  # noqa: ANN401  tomlkit's
    """Tell whether lines can be put below the last value of a table: it has a header."""
    if not isinstance(table, Table) or table.is_super_table():
        return False
    if any(key is not None and key.is_dotted() for key, _ in table.value.body):
        return False
    return not any(isinstance(entry, Table | AoT) for _, entry in table.value.body)


def _put_list(array: Any, values: Sequence[float], order: Order) -> None:  # noqa: ANN401  tomlkit's
    """Change an array of numbers; entries that stay keep their place among the comments."""
    _remove_all_but(array, order)
    for place, (old_place, value) in enumerate(zip(order, values, strict=True)):
        if old_place is None:
            array.insert(place, value)
        elif array[place] != value:
            array[place] = value


def _remove_all_but(entries: Any, order: Order) -> None:  # noqa: ANN401  tomlkit's
    for index in sorted(set(range(len(entries))) - set(order), reverse=True):
        del entries[index]


def _inline(values: Mapping[str, Any]) -> Any:  # noqa: ANN401  tomlkit's
    table = tomlkit.inline_table()
    table.update({key: value for key, value in values.items() if value is not None})
    return table


def _line(key: str, value: Any) -> str:  # noqa: ANN401  any that TOML has
    item = _inline(value) if isinstance(value, dict) else tomlkit.item(value)
    return f"{tomlkit.key(key).as_string()} = {item.as_string()}\n"


def _table_block(name: str, values: Mapping[str, Any]) -> str:
    plain = {key: value for key, value in values.items() if not isinstance(value, dict)}
    tables = "".join(_line(key, value) for key, value in values.items() if key not in plain)
    return f"\n[[{name}]]\n{tomli_w.dumps(plain)}{tables}"


_TOKENS = re.compile(
    r'''"""(?:\\.|[^\\])*?"""(?:"{0,2})|\'\'\'.*?\'\'\'(?:'{0,2})'''
    r"""|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|(?P<comment>\#[^\n]*)""",
    re.DOTALL,
)


def comments_in(text: str) -> list[tuple[int, str]]:
    r"""Return the comments of a TOML text, each with the number of its line, from 0.

    Examples
    --------
    >>> comments_in('# one\na = "# not" # two')
    [(0, '# one'), (1, '# two')]
    """
    found = [match for match in _TOKENS.finditer(text) if match["comment"]]
    comments, line, seen = [], 0, 0
    for match in found:
        line += text.count("\n", seen, match.start())
        seen = match.start()
        comments.append((line, match["comment"].rstrip()))
    return comments


def _with_lost_comments(old: str, changed: str | None) -> Iterator[str]:
    """Give the changed text with the comments that it lost, in their places, or else at its end."""
    if changed is None:
        return
    lost = Counter(c for _, c in comments_in(old)) - Counter(c for _, c in comments_in(changed))
    if not lost:
        yield changed
        return
    newline = "\r\n" if "\r\n" in old else "\n"
    yield _in_their_places(old, changed, lost, newline)
    last = "" if changed.endswith("\n") else newline
    yield changed + last + "".join(f"{comment}{newline}" for comment in lost.elements())


def _in_their_places(old: str, changed: str, lost: Counter[str], newline: str) -> str:
    of_line: dict[int, list[str]] = {}
    for line, comment in comments_in(old):
        of_line.setdefault(line, []).append(comment)
    before, after = old.splitlines(keepends=True), changed.splitlines(keepends=True)
    left, result = Counter(lost), list[str]()
    for kind, i1, i2, j1, j2 in _line_changes(before, after):
        kept = list[str]()
        for line in range(i1, i2 if kind != "equal" else i1):
            for comment in of_line.get(line, ()):
                if left[comment] > 0:
                    left[comment] -= 1
                    kept.append(f"{comment}{newline}")
            if kept and kept[-1].strip() and not before[line].strip():
                kept.append(newline)
        result += [*kept, *after[j1:j2]]
    return "".join(result)


def _line_changes(
    before: Sequence[str], after: Sequence[str]
) -> Iterator[tuple[str, int, int, int, int]]:
    """Give the differences of two lists of lines; only what is between equal ends is compared."""
    shorter = min(len(before), len(after))
    head = next((i for i in range(shorter) if before[i] != after[i]), shorter)
    tail = next(
        (i for i in range(shorter - head) if before[-1 - i] != after[-1 - i]), shorter - head
    )
    yield "equal", 0, head, 0, head
    old, new = (lines[head : len(lines) - tail] for lines in (before, after))
    for kind, i1, i2, j1, j2 in SequenceMatcher(None, old, new, autojunk=False).get_opcodes():
        yield kind, head + i1, head + i2, head + j1, head + j2
    yield "equal", len(before) - tail, len(before), len(after) - tail, len(after)


def _is_near(read: Design, wanted: Design) -> bool:
    """Tell whether designs are the same but for the last place of lengths."""
    pairs = list(zip(_bodies(read), _bodies(wanted), strict=False))
    if len(_bodies(read)) != len(_bodies(wanted)) or not all(_is_near_body(*two) for two in pairs):
        return False
    others = {field: getattr(wanted, field) for field in ("trunk", "levels", "branches")}
    return read.changed(**others) == wanted


def _bodies(design: Design) -> list[Trunk | Level | Branch]:
    return [design.trunk, *design.levels, *(design.branches or ())]


def _is_near_body(read: Trunk | Level | Branch, wanted: Trunk | Level | Branch) -> bool:
    bends, wanted_bends = read.bends or (), wanted.bends or ()
    one = [read.length_mm, *(at_mm for at_mm, _ in bends)]
    two = [wanted.length_mm, *(at_mm for at_mm, _ in wanted_bends)]
    if type(read) is not type(wanted) or len(one) != len(two):
        return False
    near = all(math.isclose(*pair, rel_tol=4e-16) for pair in zip(one, two, strict=True))
    same = read.changed(length_mm=wanted.length_mm, bends=wanted.bends)
    turns = [[turn for _, turn in some] for some in (bends, wanted_bends)]
    return near and turns[0] == turns[1] and same == wanted
