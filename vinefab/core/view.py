"""Results as blocks: one class holds a result, every medium has a renderer.

A result yields its `view`: the answer, facts, tables, pictures, findings and notes. Renderers know
blocks and no feature: `lines` (terminal) and `document` (JSON) are here, pages and notebooks in
`vinefab.pages.html`, the studio's form is `plain_blocks`. A number that is added to the view of a
result stands in all of them. A folded block stands whole in JSON and print, is opened on demand on
a page and in a notebook. A terminal leaves out folded blocks and sections.
"""

import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.extras import ensure_extra
from vinefab.core.front_door import ABOVE, imported_later
from vinefab.core.plain_text import counted, json_text, visible
from vinefab.core.progress import each

if TYPE_CHECKING:
    import pandas
else:
    pandas = imported_later("pandas")

NO_INTERVAL = "no interval"

Tone = Literal["plain", "good", "caution", "bad"]
"""What kind of news something is: good where what was asked for is met, and nowhere else."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number as it is shown and written.

    Parameters
    ----------
    value
        The number as JSON holds it; None or NaN where there is none.
    unit
        Its unit as it is shown.
    form
        Format of the shown number.
    interval
        Its 95 % interval, in the unit of `value`.
    over
        How many independent samples the interval is over: ``24 maps``.
    standing
        How far it may be trusted: simulated, measured, assumed, published, computed.
    per
        How much of `value` one shown unit is: 0.01 for a share shown in percent.
    decimals
        Decimals in JSON; None: all.
    least
        Below it a positive number is shown as ``< least``: a p-value is never 0.
    """

    value: float | None
    unit: str = ""
    form: str = ".4g"
    interval: tuple[float, float] | None = None
    standing: str = ""
    per: float = 1.0
    decimals: int | None = None
    over: str = ""
    least: float = 0.0

    def __str__(self) -> str:
        """Return the number with its interval, unit and standing; a dash where there is none.

        >>> str(Number(0.831, interval=(0.8, 0.86), form=".2f", over="24 maps"))
        '0.83 [0.80, 0.86; 24 maps]'
        >>> str(Number(0.25, "%", ".1f", per=0.01))
        '25.0 %'
        """
        standing = f" ({self.standing})" if self.standing else ""
        return f"{self.text}{standing}"

    @property
    def text(self) -> str:
        """The number with its interval and unit."""
        if not self._is_known(self.value):
            return "-"
        return " ".join(filter(None, (self._shown(self.value), self.bracket, self.unit)))

    @property
    def bracket(self) -> str:
        """The interval alone; empty where none was asked for."""
        if self.interval is None:
            return ""
        low, high = self.interval
        known = self._is_known(low) and self._is_known(high)
        return bracketed((self._shown(low), self._shown(high)) if known else None, self.over)

    @property
    def data(self) -> float | None:
        """The number as it stands in JSON."""
        if self.value is None or not self._is_known(self.value):
            return None
        if self.decimals is None:
            return self.value
        # Adding 0 turns a rounded -0.0 into 0.0.
        return round(float(self.value), self.decimals) + 0.0

    @staticmethod
    def _is_known(value: float | None) -> bool:
        return value is not None and math.isfinite(value)

    def _shown(self, value: float | None) -> str:
        if value is None:
            return "-"
        if 0.0 <= value < self.least:
            return f"< {self.least:g}"
        return f"{value if self.per == 1.0 else value / self.per:{self.form}}"


def p_value(p: float, decimals: int | None = None) -> Number:
    """Return a p-value as it is shown, not closer than 0.001.

    >>> str(p_value(0.0123)), str(p_value(2e-9))
    ('0.012', '< 0.001')
    """
    least_p = 0.001
    return Number(p, form=".3f", least=least_p, decimals=decimals)


def p_equation(p: float) -> str:
    """Return a p-value as part of a sentence.

    >>> p_equation(0.0123), p_equation(0.0)
    ('p = 0.012', 'p < 0.001')
    """
    shown = p_value(p).text
    return f"p {shown}" if shown.startswith("<") else f"p = {shown}"


def bracketed(ends: tuple[str, str] | None, over: str) -> str:
    """Return the ends of an interval with the samples that it is over, or that there is none.

    >>> bracketed(("0.80", "0.86"), "24 maps"), bracketed(None, "1 map")
    ('[0.80, 0.86; 24 maps]', '(1 map: no interval)')
    """
    if ends is None:
        return f"({over}: {NO_INTERVAL})" if over else f"({NO_INTERVAL})"
    return f"[{', '.join(ends)}; {over}]" if over else f"[{', '.join(ends)}]"


Value = Number | str | int
"""What a fact or a cell holds."""


@dataclass(frozen=True, slots=True)
class Answer:
    """The result in one sentence."""

    text: str
    tone: Tone = "plain"
    key: str = ""  # its key in JSON; empty: not there


@dataclass(frozen=True, slots=True)
class Fact:
    """A named value."""

    name: str
    value: Value
    key: str = ""  # its key in JSON, dots between levels; empty: not there
    detail: str = ""  # how sure it is, where it comes from
    tone: Tone = "plain"  # where it leads a page
    data: Any = None  # what stands in JSON where that is not the value
    standing: str = ""  # how far it may be trusted, as of a `Number`: shown once, by its name

    @property
    def text(self) -> str:
        """The value as it is shown."""
        named = isinstance(self.value, Number) and (self.detail or self.standing)
        return self.value.text if named and isinstance(self.value, Number) else str(self.value)


@dataclass(frozen=True, slots=True)
class Facts:
    """Named values."""

    facts: tuple[Fact, ...]
    lead: bool = False  # the numbers to take away


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Rows of cells under headings."""

    caption: str  # what the table shows
    headings: tuple[str, ...]  # one per column
    rows: tuple[tuple[Value, ...], ...]  # one cell for each heading
    folded: bool = False  # whether a reader has to open it
    key: str = ""  # its key in JSON, a list of objects; empty: not there
    keys: tuple[str, ...] = ()  # keys of the cells in JSON, one per column; empty: not there
    # what else stands in JSON, one for each row, with keys as above; or what makes it
    data: Sequence[Mapping[str, Any]] | Callable[[], Sequence[Mapping[str, Any]]] = ()
    most: int = 100  # rows that are shown; a page shows all

    def __post_init__(self) -> None:
        if self.key and len(self.keys) != len(self.headings):
            allowed = f"{counted(len(self.headings), 'key')}"
            raise BadInputError(self.caption, len(self.keys), allowed)
        for row in self.rows:
            if len(row) != len(self.headings):
                raise BadInputError(
                    self.caption, len(row), f"{counted(len(self.headings), 'cell')} per row"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A drawing or a chart with its caption."""

    image: bytes | Callable[[], bytes]  # a complete SVG document or PNG file, or what draws it
    caption: str  # what is to be seen, with the standing of the numbers in it
    file: str = ""  # its name where it is saved, without ending; a run has it next to its page

    @property
    def drawn(self) -> bytes:
        """The image."""
        return self.image if isinstance(self.image, bytes) else self.image()

    @property
    def file_name(self) -> str:
        """Its file next to the page, with its ending."""
        return f"{self.file}.{'png' if self.drawn.startswith(PNG) else 'svg'}"


PNG = b"\x89PNG"


@dataclass(frozen=True, slots=True)
class Remark:
    """A finding or a note: what kind it is, what it says, and details below it."""

    text: str
    kind: str = "note"  # error, warning, info, waived, note, ...
    details: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Notes:
    """What a user should know, a sentence each."""

    notes: tuple[str, ...]
    key: str = ""  # their key in JSON; empty: not there


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True, slots=True)
class Code:
    """Lines to be typed, shown as they are."""

    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of a page under one title."""

    title: str  # its heading
    paragraphs: tuple[str, ...] = ()  # words, before everything else
    # tables, pictures: what follows
    tables: tuple[Rows, ...] = ()
    pictures: tuple[Picture, ...] = ()
    code: str = ""  # lines to be typed, shown as they are
    folded: bool = False  # whether a reader has to open it

    @property
    def anchor(self) -> str:
        """The name by which the list of contents finds the section."""
        return "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())


@dataclass(frozen=True, slots=True)
class Data:
    """Plain values that stand in JSON alone, by their keys as of a fact, or what makes them."""

    content: Mapping[str, Any] | Callable[[], Mapping[str, Any]]


Block = Answer | Facts | Rows | Picture | Remark | Notes | Text | Code | Section | Data


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """What it takes to get a result again."""

    command: str  # what to type
    inputs: Mapping[str, str]  # fingerprints of the contents that went in, by name
    versions: Mapping[str, str]  # versions of the programs that computed it

    @property
    def section(self) -> Section:
        """The command, the inputs' fingerprints and the versions behind a page."""
        return Section(
            title="How to reproduce",
            folded=True,
            paragraphs=(
                "The same command with the same inputs and versions gives the same file, byte for "
                "byte; results do not depend on the computer beyond rounding.",
            ),
            code=self.command,
            tables=(
                Rows(
                    caption="Fingerprints of the inputs (SHA-256, shortened)",
                    headings=("input", "fingerprint"),
                    rows=tuple(self.inputs.items()),
                ),
                Rows(
                    caption="Versions",
                    headings=("program", "version"),
                    rows=tuple(self.versions.items()),
                ),
            ),
        )


class Result:
    """What a verb returns: its `view` is shown by every medium."""

    __slots__ = ()
    schema: ClassVar[str] = ""
    origin: Origin | None = None  # the call by which it can be got again; None where there is none

    @property
    def title(self) -> str:
        """What the result is called: title of its page."""
        return type(self).__name__

    def view(self) -> Iterable[Block]:
        """Return the result: the answer, a picture, numbers and notes, then what is folded."""
        raise NotImplementedError

    @property
    def summary(self) -> tuple[str, ...]:
        """The result, a line each."""
        return tuple(lines(self.view()))

    @property
    def details(self) -> tuple[str, ...]:
        """The summary and the lines that ``--verbose`` adds."""
        return self.summary

    def json_text(self) -> str:
        """Return the result as JSON."""
        reproduce = {"reproduce": asdict(self.origin)} if self.origin else {}
        return json_text(self.schema, {**document(self.view()), **reproduce})

    @property
    def numbers(self) -> Mapping[str, Any]:
        """Every number as plain values, as in JSON."""
        plain: Mapping[str, Any] = json.loads(self.json_text())
        return plain

    @property
    def records(self) -> list[dict[str, Any]]:
        """Its main table as plain values, a dict for each row: the first list in its JSON."""
        return main_table(self.numbers)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield its `records`."""
        return iter(self.records)

    def to_pandas(self) -> Any:  # noqa: ANN401  pandas is optional
        """Return its `records` as a `pandas.DataFrame`.

        Inner values have columns with dots, ``pose.x_mm``.

        Raises
        ------
        MissingPackageError
            If pandas is not installed.
        """
        ensure_extra("tables", "to_pandas")
        return pandas.json_normalize(self.records)

    def drawing(self) -> Any:  # noqa: ANN401  a page of a room above
        """Return the page that `plot` draws; None where there is none."""
        return None

    def plot(self, ax: Any = None, *, legend: bool = True) -> Any:  # noqa: ANN401  of Matplotlib
        """Draw its main picture on axes of Matplotlib, and return them.

        Parameters
        ----------
        ax
            The axes; None: new ones.
        legend
            Whether to explain signs and colours next to the axes.

        Raises
        ------
        BadInputError
            If the result has no picture.
        MissingPackageError
            If Matplotlib is not installed.
        """
        drawn = self.drawing()
        if drawn is None:
            name = type(self).__name__
            raise UnfitInputError("plot", f"a {name} has no picture", "plot its records yourself")
        return ABOVE.plot(drawn, ax, legend=legend)

    def page(self) -> str:
        """Return the result as an HTML page."""
        blocks = [*self.view(), *([self.origin.section] if self.origin else [])]
        for place, block in enumerate(each("parts of the page", tuple(blocks))):
            if isinstance(block, Section):
                drawn = tuple(replace(one, image=one.drawn) for one in block.pictures)
                blocks[place] = replace(block, pictures=drawn)
        made: str = ABOVE.page(self.title, blocks)
        return made

    def __repr__(self) -> str:
        every = tuple(lines(self.view()))
        most_lines = 60  # of a result where Python shows it
        shown, hidden = every[:most_lines], len(every[most_lines:])
        more = [f"... {hidden} more lines: print(*result.summary, sep='\\n')"] if hidden else []
        return "\n".join([f"<{type(self).__name__}>", *shown, *more])

    def _repr_html_(self) -> str:
        """Show the result in a notebook."""
        shown: str = ABOVE.blocks_html(self.view())
        return shown


def main_table(numbers: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the first list of records in a result's JSON; an empty one where there is none."""
    return next((one for one in numbers.values() if _is_table(one)), [])


def _is_table(value: object) -> bool:
    """Tell whether a value of JSON is a table with rows."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


class WrittenResult(Result):
    """A result that can be passed where the path of its file is expected."""

    __slots__ = ()
    path: Path | None = None  # what was written; None if nothing was asked for

    def __fspath__(self) -> str:
        """Return the path: fitted numbers are passed as ``contacts``, observations to the fit."""
        if self.path is None:
            raise BadInputError("path", None, "a file: call it with out=")
        return str(self.path)


# --- As lines on a terminal --------------------------------------------------------------------


def lines(blocks: Iterable[Block]) -> Iterator[str]:
    """Yield blocks as lines for the user; pictures, sections and folded tables are left out."""
    for block in blocks:
        match block:
            case Answer(text) | Text(text):
                yield text
            case Code(text):
                yield from (f"  {line}" for line in text.splitlines())
            case Facts(facts):
                yield from map(fact_line, facts)
            case Rows():
                yield from _table_lines(block)
            case Remark(text, kind, details):
                yield f"{_SIGNS.get(kind, kind):<6} {text}"
                yield from (f"       {detail}" for detail in details)
            case Notes(notes):
                yield from notes


_SIGNS = {"error": "ERROR", "warning": "warn"}


def fact_line(fact: Fact) -> str:
    """Return a fact as a line: name, value, detail, standing."""
    standing = f" ({fact.standing})" if fact.standing else ""
    detail = f", {fact.detail}" if "(" in fact.detail or standing else f" ({fact.detail})"
    return f"{fact.name}: {fact.text}{detail if fact.detail else ''}{standing}"


def _table_lines(table: Rows) -> Iterator[str]:
    if table.folded or not table.rows:
        return
    if table.caption:
        yield f"{table.caption}:"
    shown = [tuple(map(str, row)) for row in table.rows[: table.most]]
    columns = list(zip(table.headings, *shown, strict=True))
    widths = [max(map(len, column)) for column in columns]
    right = number_columns(table)
    rows = [table.headings, *shown] if any(table.headings) else shown
    for row in rows:
        cells = (
            f"{visible(cell):>{width}}" if is_number else f"{visible(cell):<{width}}"
            for cell, width, is_number in zip(row, widths, right, strict=True)
        )
        yield f"  {'  '.join(cells)}".rstrip()
    if len(table.rows) > len(shown):
        yield f"  ... and {len(table.rows) - len(shown)} more"


def number_columns(table: Rows) -> list[bool]:
    """Return for each column whether it holds only numbers: those are set flush right."""
    columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.headings)
    return [
        any(map(str, cells))
        and all(isinstance(cell, Number | int) or _NUMBER.match(cell) for cell in cells)
        for cells in columns
    ]


_NUMBER = re.compile(r"^(-|[-+]?[\d.,]+(e[-+]?\d+)?( ?%)?)?$")


# --- As JSON -----------------------------------------------------------------------------------


def document(blocks: Iterable[Block]) -> dict[str, Any]:
    """Return the JSON of blocks, by their keys."""
    found: dict[str, Any] = {}
    for block in blocks:
        match block:
            case Answer(text, _, key) if key:
                _put(found, key, text)
            case Facts(facts):
                for fact in facts:
                    if fact.key:
                        _put(found, fact.key, fact.value if fact.data is None else fact.data)
            case Rows(key=key) if key:
                _put(found, key, _objects(block))
            case Notes(notes, key) if key:
                _put(found, key, list(notes))
            case Section(tables=tables):
                for table in tables:
                    if table.key:
                        _put(found, table.key, _objects(table))
            case Data(content):
                for key, value in (content() if callable(content) else content).items():
                    _put(found, key, value)
    return found


def _objects(table: Rows) -> list[dict[str, Any]]:
    objects = list[dict[str, Any]]()
    given = table.data() if callable(table.data) else table.data
    for row, rest in zip(table.rows, given or [{}] * len(table.rows), strict=True):
        one: dict[str, Any] = {}
        for key, value in [*zip(table.keys, row, strict=True), *rest.items()]:
            if key:
                _put(one, key, value)
        objects.append(one)
    return objects


def _put(found: dict[str, Any], key: str, value: object) -> None:
    """Put a value at a key with dots between its levels; the ends of an interval next to a mean."""
    *levels, last = key.split(".")
    for level in levels:
        found = found.setdefault(level, {})
    found[last] = value.data if isinstance(value, Number) else value
    if isinstance(value, Number) and value.interval is not None:
        ends = ("low", "high") if last == "mean" else (f"{last}_low", f"{last}_high")
        for name, end in zip(ends, value.interval, strict=True):
            found[name] = replace(value, value=end, interval=None).data


# --- As the studio takes it --------------------------------------------------------------------


def plain_blocks(blocks: Iterable[Block]) -> list[dict[str, Any]]:
    """Return blocks as plain values for the studio's page, which shows each kind in one way."""
    found = list[dict[str, Any]]()
    for block in blocks:
        match block:
            case Answer(text, tone):
                found.append({"kind": "answer", "text": text, "tone": tone})
            case Facts(facts):
                rows = [
                    [fact.name, fact.text, ", ".join(filter(None, (fact.detail, fact.standing)))]
                    for fact in facts
                ]
                found.append({"kind": "facts", "rows": rows})
            case Rows(caption=caption, headings=headings, rows=rows, folded=False):
                shown = [list(map(str, row)) for row in rows[: block.most]]
                found.append(
                    {"kind": "table", "caption": caption, "headings": headings, "rows": shown}
                )
            case Remark(text, kind, details):
                found.append({"kind": "remark", "weight": kind, "text": text, "more": details})
            case Notes(notes):
                found += [{"kind": "text", "text": note} for note in notes]
            case Text(text) | Code(text):
                found.append({"kind": "text", "text": text})
    return found
