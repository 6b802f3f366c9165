"""The text of a design file, changed to another design; what did not change stays as it stands.

tomlkit changes values where they stand. Lines that are new are put in as marks first, so that they
come before the comments above the next table, and so that comments of lines that went stay.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tomli_w

from vinefab.core.errors import BadInputError, CannotWriteError, VinefabError
from vinefab.core.hashing import sha256_of
from vinefab.core.units import rad
from vinefab.model.design import Build, Design, Level, default_fillets_mm
from vinefab.model.files.design_toml import design_of
from vinefab.model.files.toml import toml_content

if TYPE_CHECKING:
    from tomlkit import TOMLDocument

LARGEST_EDITED_BYTES = 1 << 16
"""Thirty times the largest that is shipped; more may take tomlkit seconds."""

_MOST_DOTTED = 200
_DOTTED = re.compile(r"""(?<![\w"'.-])[\w"'-]++[ \t]*+\.[\w."' \t-]{1,200}+=""")
"""Keys in parts, ``build.tail_mm = 9``: tomlkit needs time that grows with the square of them."""

_ELSEWHERE = "save it under another name"

Order = list[int | None]
"""For each entry of a new list, the old entry that it continues; None for a new one."""


def edited_text(text: str, design: Design, source: str | Path) -> str:
    """Return the text of a design file changed so that reading it gives a design.

    Comments, order, spacing and every value that is the same stay as they stand; comments of what
    was removed become lines of their own. Lengths that no number of the file gives exactly, as its
    scale is no power of two, are off by at most one unit in the last place.

    Parameters
    ----------
    source
        What messages call the text.

    Raises
    ------
    VinefabError
        If the text is no design file, or tomlkit is missing or cannot change it in place.
    """
    bom = "\ufeff" if text.startswith("\ufeff") else ""
    body = text.removeprefix(bom)
    content = toml_content(body, source)
    old = design_of(content, source)
    if old == design:
        return text
    too_much = _too_much(body)
    if too_much:
        raise CannotWriteError(source, f"{too_much} are not changed in place; {_ELSEWHERE}")
    for order in _level_orders(old, design):
        changed = _changed(body, content, old, design, order)
        for result in _with_lost_comments(body, changed):
            if _gives(result, design, source):
                return bom + result
    raise CannotWriteError(source, f"its layout cannot be changed in place; {_ELSEWHERE}")


def _too_much(body: str) -> str:
    if len(body.encode()) > LARGEST_EDITED_BYTES:
        return f"files of over {LARGEST_EDITED_BYTES} bytes"
    dotted = islice(_DOTTED.finditer(body), _MOST_DOTTED, None)
    return f"files with over {_MOST_DOTTED} dotted keys" if next(dotted, None) else ""


def _level_orders(old: Design, new: Design) -> list[Order]:
    """Return which level continues which, the likeliest first."""
    by_place = _by_place(old.levels, new.levels)
    if len(old.levels) == len(new.levels):
        return [by_place]
    return [_order(old.levels, new.levels), by_place]


def _by_place(old: Sequence[object], new: Sequence[object]) -> Order:
    return [place if place < len(old) else None for place in range(len(new))]


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
    parse = _parser()
    from tomlkit.exceptions import TOMLKitError  # noqa: PLC0415  of the extra, as above

    ended = body if body.endswith("\n") else f"{body}\n"
    try:
        file = _EditedFile(document=parse(ended), token=sha256_of(body.encode())[:16])
        _edit(file, content, old, new, order)
        changed = file.text()
    except (TOMLKitError, RecursionError, ValueError, KeyError, IndexError, AttributeError):
        # Of unusual layouts, such as tables in pieces, tomlkit gives parts that do not do it all.
        return None
    if "\r\n" in body and "\n" not in body.replace("\r\n", ""):
        changed = re.sub(r"(?<!\r)\n", "\r\n", changed)
    return changed if body.endswith("\n") else changed.removesuffix("\n").removesuffix("\r")


def _parser() -> "Callable[[str], TOMLDocument]":
    try:
        from tomlkit import parse  # noqa: PLC0415  of the extra, and only where a file is changed
    except ImportError as error:
        allowed = "only with the extra: pip install 'vinefab[studio]'"
        raise BadInputError("tomlkit", None, allowed) from error
    return parse


def _edit(
    file: "_EditedFile", content: Mapping[str, Any], old: Design, new: Design, order: Order
) -> None:
    scale = float(content.get("scale_mm_per_unit", 1.0))
    if new.name != old.name:
        file.document["name"] = new.name
    if new.trunk_length_mm != old.trunk_length_mm:
        length = file_number(new.trunk_length_mm, new.trunk_length_mm / scale, scale.__mul__)
        file.put(file.document["trunk"], "length", length)
    levels = [_level_values(level, scale) for level in new.levels]
    unchanged = [_level_values(level, scale) for level in old.levels]
    file.put_tables("level", unchanged, levels, order, after="trunk")
    _edit_build(file, content.get("build", {}), old.build, new.build, order)
    given, wanted = (
        [{"fingerprint": w.fingerprint, "reason": w.reason} for w in design.waivers]
        for design in (old, new)
    )
    continued = _order(old.waivers, new.waivers)
    if continued[:1] == [None]:  # there may be nothing that a first one could follow
        continued = _by_place(old.waivers, new.waivers)
    file.put_tables("waive", given, wanted, continued)
    for name, before, after in (
        ("limits", old.limits, new.limits),
        ("origin", old.origin, new.origin),
    ):
        file.put_free_table(name, _plain_tables(before), _plain_tables(after))


def _level_values(level: Level, scale: float) -> dict[str, Any]:
    percent = 100.0 * level.growth
    return {
        "branches": level.branches,
        "length": file_number(level.length_mm, level.length_mm / scale, scale.__mul__),
        "angle_deg": file_number(level.fan_rad, math.degrees(level.fan_rad), rad),
        "growth_percent": file_number(level.growth, percent, lambda given: given / 100.0),
    }


def file_number(wanted: float, guess: float, read: Callable[[float], float]) -> float:
    """Return the shortest number that is read as the one wanted.

    Parameters
    ----------
    guess
        Near what is looked for; it is returned where nothing near it is read exactly so.
    read
        What becomes of a number of a file.

    Examples
    --------
    >>> file_number(12.500000000000002 / 100.0, 12.500000000000002, lambda n: n / 100.0)
    12.500000000000002
    >>> file_number(0.3, 0.1 + 0.2, float)
    0.3
    """
    short = (float(f"{guess:.{digits}g}") for digits in range(1, 18))
    for number in (*short, *_neighbours(guess)):
        if read(number) == wanted:
            return number
    return guess


def _neighbours(number: float, most: int = 8) -> Iterator[float]:
    above = below = number
    for _ in range(most):
        above, below = math.nextafter(above, math.inf), math.nextafter(below, -math.inf)
        yield above
        yield below


def _edit_build(
    file: "_EditedFile", table: Mapping[str, Any], old: Build, new: Build, order: Order
) -> None:
    """Change what differs in ``[build]``; what others follow from stays while they still do."""
    changes: dict[str, Any] = {}
    widths = _widths_that_follow(table, len(new.widths_mm))
    if widths != new.widths_mm:
        changes |= {"widths_mm": list(new.widths_mm), "trunk_width_mm": None, "width_ratio": None}
    if _fillets_that_follow(table, new.widths_mm) != new.fillet_mm:
        changes |= {"fillet_mm": list(new.fillet_mm), "fillet_ratio": None}
    if new.taper != old.taper:
        changes["taper"] = list(new.taper) or None
    for name in ("tail_mm", "pressure_kpa", "mounting"):
        if getattr(new, name) != getattr(old, name):
            changes[name] = getattr(new, name)
    for name, keys in _PARTS.items():
        before, after = (_part(getattr(build, name), keys) for build in (old, new))
        if before != after:
            differing = {key: after[key] for key in after if after[key] != before.get(key)}
            changes[name] = differing or None
    file.put_build(changes, order)


_PARTS = {
    "pouch": ("shape", "radius_mm", "length_mm", "width_mm"),
    "collar": ("clamp_diameter_mm", "length_mm", "flare_mm"),
    "pieces": ("most", "lap_mm", "ease_mm"),
}
"""Tables in ``[build]``, and their keys."""


def _part(part: object, keys: Sequence[str]) -> dict[str, Any]:
    return {} if part is None else {key: getattr(part, key) for key in keys}


def _widths_that_follow(table: Mapping[str, Any], depth: int) -> tuple[float, ...]:
    """Return the widths that a file gives for a number of levels."""
    if "widths_mm" in table:
        return tuple(table["widths_mm"])
    ratios = {
        "trunk_width_mm": table.get("trunk_width_mm"),
        "width_ratio": table.get("width_ratio"),
    }
    return Build.standard(depth, **{k: v for k, v in ratios.items() if v is not None}).widths_mm


def _fillets_that_follow(
    table: Mapping[str, Any], widths_mm: tuple[float, ...]
) -> tuple[float, ...]:
    """Return the fillets that a file gives for some widths."""
    if "fillet_mm" in table:
        return tuple(table["fillet_mm"])
    ratio = table.get("fillet_ratio")
    return default_fillets_mm(widths_mm) if ratio is None else default_fillets_mm(widths_mm, ratio)


def _plain_tables(content: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: _plain_tables(value) if isinstance(value, Mapping) else value
        for name, value in content.items()
    }


@dataclass(slots=True)
class _EditedFile:
    """A document that is being changed."""

    document: "TOMLDocument"
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
        from tomlkit import item  # noqa: PLC0415  of the extra
        from tomlkit import key as toml_key  # noqa: PLC0415  as above

        if value is None:
            if key in table:
                del table[key]
        elif key in table or not _takes_lines(table):
            table[key] = value
        else:
            self._add(table, f"{toml_key(key).as_string()} = {item(value).as_string()}\n")

    def put_tables(
        self,
        name: str,
        old: Sequence[Mapping[str, Any]],
        new: Sequence[Mapping[str, Any]],
        order: Order,
        *,
        after: str = "",
    ) -> None:
        """Change the tables of an array of them: new ones, old ones, and values that differ."""
        if list(old) == list(new):
            return
        tables = self.document.get(name)
        if not isinstance(tables, list) or not tables or not _takes_lines(tables[0]):
            self._put_inline_tables(name, tables, old, new, order, after=after)
            return
        kept = list(tables)
        for index, values in zip(order, new, strict=True):
            if index is not None:
                self._put_changes(kept[index], old[index], values)
        last = None if order[:1] == [None] else kept[0]
        for index, values in zip(order, new, strict=True):
            if index is None:
                self._add(
                    self.document[after] if last is None else last, _table_block(name, values)
                )
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
        *,
        after: str,
    ) -> None:
        """Change an array of inline tables, or add tables where there are none."""
        if tables is None or len(tables) == 0:
            if tables is not None:
                del self.document[name]
            before = self.document.get(after)
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
                self._put_changes(kept[old_place], old[old_place], values)

    def _put_changes(
        self,
        table: Any,  # noqa: ANN401  tomlkit's
        old: Mapping[str, Any],
        new: Mapping[str, Any],
    ) -> None:
        for key, value in new.items():
            if value != old[key]:
                self.put(table, key, value)

    def put_build(self, changes: Mapping[str, Any], order: Order) -> None:
        """Change table ``[build]``, or add it."""
        table = self.document.get("build")
        if table is None:
            given = {key: value for key, value in changes.items() if value is not None}
            lines = [f"{key} = {_value_text(value)}\n" for key, value in given.items()]
            if lines:
                self.at_end.append(f"[build]\n{''.join(lines)}")
            return
        by_level: Order = [0, *(None if index is None else index + 1 for index in order)]
        orders = {"widths_mm": by_level, "taper": by_level, "fillet_mm": order}
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
            if key in old and _same(before, value):
                continue
            if isinstance(value, dict) and isinstance(before, dict):
                self._merge(table[key], before, value)
            elif isinstance(value, dict):
                table[key] = value
            else:
                self.put(table, key, value)

    def _add(self, table: Any, block: str) -> None:  # noqa: ANN401  tomlkit's
        """Put lines below the last value of a table, before the comments above the next one."""
        from tomlkit import comment  # noqa: PLC0415  of the extra

        body = table.value.body
        place = len(body)
        while place and body[place - 1][0] is None and not self._is_mark(body[place - 1][1]):
            place -= 1
        # Entries without a key are in no index of the table.
        body.insert(place, (None, comment(f"{self.token}:{len(self.blocks)}")))
        self.blocks.append(block)

    def _is_mark(self, entry: Any) -> bool:  # noqa: ANN401  tomlkit's
        return self.token in entry.as_string()


def _takes_lines(table: Any) -> bool:  # noqa: ANN401  tomlkit's
    """Tell whether lines can be put below the last value of a table: it has a header of its own."""
    from tomlkit.items import AoT, Table  # noqa: PLC0415  of the extra

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
    from tomlkit import inline_table  # noqa: PLC0415  of the extra

    table = inline_table()
    table.update({key: value for key, value in values.items() if value is not None})
    return table


def _value_text(value: Any) -> str:  # noqa: ANN401  a number, a list or a table
    from tomlkit import item  # noqa: PLC0415  of the extra

    return str((_inline(value) if isinstance(value, dict) else item(value)).as_string())


def _table_block(name: str, values: Mapping[str, Any]) -> str:
    return f"\n[[{name}]]\n{tomli_w.dumps(values)}"


def _same(one: object, other: object) -> bool:
    return one == other and type(one) is type(other)


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


def _gives(text: str, design: Design, source: str | Path) -> bool:
    """Tell whether a text is read as a design, lengths to the last place."""
    with suppress(VinefabError):
        return _is_near(design_of(toml_content(text, source), source), design)
    return False


def _is_near(read: Design, wanted: Design) -> bool:
    if read == wanted:
        return True
    lengths = [
        (one.trunk_length_mm, *(level.length_mm for level in one.levels)) for one in (read, wanted)
    ]
    return _without_lengths(read) == _without_lengths(wanted) and all(
        math.isclose(one, other, rel_tol=4e-16) for one, other in zip(*lengths, strict=True)
    )


def _without_lengths(design: Design) -> tuple[object, ...]:
    levels = [(level.branches, level.fan_rad, level.growth) for level in design.levels]
    return (design.name, levels, design.build, design.waivers, design.origin, design.limits)
