"""Ways to damage the content of a file: bytes, numbers, strings, keys, nesting, records."""

import json
import random
import re
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

NUMBERS = (
    *("0", "-1", "1", "1e308", "-1e308", "1e-308", "5e-324", "nan", "NaN", "inf", "-inf"),
    *("Infinity", "1e999", "9" * 30, "9" * 5000, "0x7fffffffffffffff", "1_000", "1,5", "-0.0"),
    *("2147483648", "0.1e", "true", "null", '"1"', "[]", "{}", "2001-01-01", ""),
)
STRINGS = (
    "",
    "x" * 100_000,
    "a\nb",
    "\x00",
    "\x1b[31m",
    "\u202etxet",
    "\ufeff",
    "\\ud800",
    "\U0010ffff",
    "../../../tmp/x",
    "/dev/zero",
    "-q",
    "CON",
    "$\\foo$",
    "<script>alert(1)</script>",
    "%s%n{0}",
    "=1+1",
    "'; DROP TABLE run; --",
)
DEPTHS = (2, 60, 3_000, 100_000)
ENCODINGS = ("utf-16", "utf-32-be", "latin-1", "utf-8-sig", "cp037", "utf-7")
_NUMBER = re.compile(r"-?\b\d+(?:\.\d+)?(?:[eE][+-]?\d+)?\b")
_STRING = re.compile(r'"(?:[^"\\\n]|\\.)*"')
_KEY = re.compile(r'"[\w.]+"(?=\s*:)|^[\w.]+(?=\s*[=:])|(?<=[\s<])[\w:.-]+(?==")', re.MULTILINE)
_PAIRS = ("[]", "{}", "()")

Data = bytes
Mutator = Callable[[random.Random, bytes], bytes]


def flip_bits(rng: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 3, 30)) if data else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _chunk(rng: random.Random, data: bytes) -> tuple[int, int]:
    begin = rng.randrange(len(data) + 1)
    return begin, min(len(data), begin + rng.choice((1, 16, 300, 5_000)))


def remove_chunk(rng: random.Random, data: bytes) -> bytes:
    begin, end = _chunk(rng, data)
    return data[:begin] + data[end:]


def duplicate_chunk(rng: random.Random, data: bytes) -> bytes:
    begin, end = _chunk(rng, data)
    return data[:begin] + data[begin:end] * rng.choice((2, 3, 200)) + data[end:]


def swap_chunks(rng: random.Random, data: bytes) -> bytes:
    a, b = sorted((_chunk(rng, data), _chunk(rng, data)))
    if a[1] > b[0]:
        return data
    return data[: a[0]] + data[b[0] : b[1]] + data[a[1] : b[0]] + data[a[0] : a[1]] + data[b[1] :]


def insert_noise(rng: random.Random, data: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice((b"\x00", b"\xff\xfe", rng.randbytes(50))) + data[at:]


def empty(rng: random.Random, data: bytes) -> bytes:
    return rng.choice((b"", b"\n", b" ", b"\x00", data[:1]))


def _replace(
    rng: random.Random, text: str, pattern: re.Pattern[str], new: Callable[[str], str]
) -> str:
    """Replace one match of a pattern, or all that read the same."""
    matches = list(pattern.finditer(text))
    if not matches:
        return text
    chosen = rng.choice(matches)
    if rng.random() < 0.1:
        return text.replace(chosen[0], new(chosen[0]))
    return text[: chosen.start()] + new(chosen[0]) + text[chosen.end() :]


def replace_number(rng: random.Random, text: str) -> str:
    value = rng.choice(NUMBERS)
    return _replace(rng, text, _NUMBER, lambda _: value)


def scale_number(rng: random.Random, text: str) -> str:
    factor = rng.choice((-1.0, 1e-9, 0.1, 0.999, 10.0, 1e3, 1e6, 1e15))
    return _replace(rng, text, _NUMBER, lambda old: f"{float(old) * factor:.17g}")


def replace_string(rng: random.Random, text: str) -> str:
    value = rng.choice(STRINGS)
    quoted = rng.choice((f'"{value}"', json.dumps(value)))
    return _replace(rng, text, _STRING, lambda _: quoted)


def rename_key(rng: random.Random, text: str) -> str:
    return _replace(rng, text, _KEY, lambda old: rng.choice((old[:-1] + 'x"', "x", old.upper())))


def duplicate_line(rng: random.Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    if lines:
        chosen = rng.randrange(len(lines))
        lines[chosen:chosen] = [lines[chosen]] * rng.choice((1, 2, 500))
    return "".join(lines)


def remove_line(rng: random.Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    if lines:
        del lines[rng.randrange(len(lines))]
    return "".join(lines)


def swap_lines(rng: random.Random, text: str) -> str:
    lines = text.splitlines(keepends=True)
    if lines:
        a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
        lines[a], lines[b] = lines[b], lines[a]
    return "".join(lines)


def nest(rng: random.Random, text: str) -> str:
    opening, closing = rng.choice(_PAIRS)
    depth = rng.choice(DEPTHS)
    pattern = rng.choice((_NUMBER, _STRING))
    return _replace(rng, text, pattern, lambda old: opening * depth + old + closing * depth)


def nest_elements(rng: random.Random, text: str) -> str:
    """Wrap the content of an XML document, or a piece of any other text, in many elements."""
    begin = text.find(">", text.find("<svg")) + 1
    end = max(begin, text.rfind("</"))
    depth = rng.choice(DEPTHS)
    return text[:begin] + "<g>" * depth + text[begin:end] + "</g>" * depth + text[end:]


def insert_string(rng: random.Random, text: str) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(STRINGS) + text[at:]


def change_encoding(rng: random.Random, text: str) -> bytes:
    return text.encode(rng.choice(ENCODINGS), errors="replace")


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    entries = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    return [path, *(place for key, one in entries for place in _places(one, (*path, key)))]


HOSTILE_VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 1e308, 1e-308, float("nan"), float("inf"), 10**30, "", "x" * 1000),
    *([], {}, [[]], [None], {"": {}}, [1, "a"], [[0, 0]], "\ud800", "a\nb"),
)


def change_tree(rng: random.Random, text: str) -> str:
    """Replace, remove, double or rename a value of a JSON document."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        return text
    places = _places(document)
    place = rng.choice(places)
    if not place:
        return json.dumps(rng.choice((document, [document], {"x": document}, *HOSTILE_VALUES)))
    _change_place(rng, document, place, _at(document, rng.choice(places)))
    return json.dumps(document)


def _at(document: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        document = document[key]
    return document


def _change_place(rng: random.Random, document: Any, place: tuple[Any, ...], other: Any) -> None:
    """Change what stands at a place of a document; ``other`` is what stands elsewhere."""
    holder = _at(document, place[:-1])
    key, action = place[-1], rng.choice(("replace", "remove", "double", "rename", "exchange"))
    if action == "remove":
        del holder[key]
    elif action == "double" and isinstance(holder, list):
        holder.extend([holder[key]] * rng.choice((1, 3, 1000)))
    elif action == "rename" and isinstance(holder, dict):
        holder[rng.choice(("x", "", "a" * 1000))] = holder.pop(key)
    elif action == "exchange":
        holder[key] = json.loads(json.dumps(other))
    else:
        holder[key] = rng.choice(HOSTILE_VALUES)


BYTE_MUTATORS: tuple[Mutator, ...] = (
    *(flip_bits, truncate, remove_chunk, duplicate_chunk, swap_chunks, insert_noise, empty),
)
TEXT_MUTATORS: tuple[Callable[[random.Random, str], str | bytes], ...] = (
    *(replace_number, replace_number, replace_number, scale_number, scale_number),
    *(replace_string, rename_key, duplicate_line, remove_line, swap_lines, nest, nest_elements),
    *(insert_string, change_encoding, change_tree, change_tree),
)


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Return content with one to three damages; the same for the same generator."""
    if data.startswith(b"SQLite format 3") and rng.random() < 0.8:
        return mutated_record(rng, data)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if rng.random() < 0.75:
            try:
                text = data.decode("utf-8")
            except UnicodeDecodeError:
                text = data.decode("latin-1")
                data = rng.choice((replace_number, scale_number))(rng, text).encode("latin-1")
                continue
            damaged = rng.choice(TEXT_MUTATORS)(rng, text)
            data = damaged if isinstance(damaged, bytes) else damaged.encode(errors="surrogatepass")
        else:
            data = rng.choice(BYTE_MUTATORS)(rng, data)
    return data


def mutated_record(rng: random.Random, data: bytes) -> bytes:
    """Return an SQLite file with a cell changed, a row or a table gone."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record"
        path.write_bytes(data)
        connection = sqlite3.connect(path)
        tables = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        (table,) = rng.choice(sorted(tables.fetchall()))
        with suppress(sqlite3.Error):  # a GeoPackage has tables and triggers that refuse changes
            _damage_table(rng, connection, table)
        connection.commit()
        connection.close()
        return path.read_bytes()


def _damage_table(rng: random.Random, connection: sqlite3.Connection, table: str) -> None:
    columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
    rows = [row[0] for row in connection.execute(f"SELECT rowid FROM {table} ORDER BY 1")]  # noqa: S608
    action, column = rng.choice(("change", "change", "change", "delete", "drop")), columns
    if action == "drop" or not rows:
        connection.execute(f"DROP TABLE {table}")
        return
    row = rng.choice(rows)
    if action == "delete":
        connection.execute(f"DELETE FROM {table} WHERE rowid = ?", (row,))  # noqa: S608
        return
    name = rng.choice(column)
    (old,) = connection.execute(f"SELECT {name} FROM {table} WHERE rowid = ?", (row,)).fetchone()  # noqa: S608
    new: Any = rng.choice((None, -1, 10**18, 1e308, "", "x", b"", b"\x00" * 7, "[]", "{}", "NaN"))
    if isinstance(old, str) and rng.random() < 0.7:
        new = change_tree(rng, old) if rng.random() < 0.6 else replace_number(rng, old)
        new = new.encode(errors="replace").decode()
    elif isinstance(old, bytes) and old and rng.random() < 0.7:
        new = rng.choice((flip_bits, truncate, remove_chunk))(rng, old)
    try:
        connection.execute(f"UPDATE {table} SET {name} = ? WHERE rowid = ?", (new, row))  # noqa: S608
    except sqlite3.Error:
        connection.execute(f"DELETE FROM {table} WHERE rowid = ?", (row,))  # noqa: S608
