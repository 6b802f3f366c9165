"""A report as sections of words, tables and pictures, and as one HTML file without links."""

import base64
import re
from dataclasses import dataclass
from functools import cache
from typing import Literal

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

from vinefab.core.errors import BadInputError
from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import counted

Tone = Literal["good", "caution", "bad"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A drawing with its caption."""

    image: bytes  # the drawing as a complete SVG document or PNG file
    caption: str  # what is to be seen, with the standing of the numbers in it
    wide: bool = False  # whether it takes the whole width of the page
    file: str = ""  # name of the file beside the page that has it too, without ending

    @property
    def media_type(self) -> str:
        """What kind of image it is."""
        return "image/png" if self._is_png else "image/svg+xml"

    @property
    def file_name(self) -> str:
        """Its file beside the page, with its ending."""
        return f"{self.file}.{'png' if self._is_png else 'svg'}"

    @property
    def _is_png(self) -> bool:
        return self.image.startswith(b"\x89PNG")


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of text under headings."""

    caption: str  # what the table shows
    headings: tuple[str, ...]  # one per column
    rows: tuple[tuple[str, ...], ...]  # cells as text, one tuple per row
    folded: bool = False  # whether a reader has to open it; what is folded is not printed

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.headings):
                raise BadInputError(
                    self.caption, len(row), f"{counted(len(self.headings), 'cell')} per row"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the report under one title."""

    title: str  # its heading
    paragraphs: tuple[str, ...] = ()  # words, before everything else
    # tables, pictures: what follows
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    code: str = ""  # lines to be typed, shown as they are

    @property
    def anchor(self) -> str:
        """The name by which the list of contents finds the section."""
        return "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())


@dataclass(frozen=True, slots=True, kw_only=True)
class Headline:
    """A key number of the report."""

    name: str
    value: str  # with its unit
    detail: str  # how sure it is, and its standing
    tone: Tone = "good"  # whether it is good news


@dataclass(frozen=True, slots=True, kw_only=True)
class Live:
    """How the page of something unfinished stays current: it loads itself again."""

    refresh_s: int  # after how long
    written_ms: int  # when it was written, since 1970
    patience_s: int  # without news for so long, whoever writes it has been ended; 0: it says so
    again: str  # the command that goes on


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A whole report."""

    title: str  # name of the design and what the report is about
    verdict: str  # one sentence: whether it is manufacturable, and what to expect
    tone: Tone  # what kind of news the verdict is
    facts: tuple[tuple[str, str], ...]  # short name and value pairs shown at the top
    sections: tuple[Section, ...]  # in order
    # reservations to the verdict, a sentence each
    cautions: tuple[str, ...] = ()
    headlines: tuple[Headline, ...] = ()  # the numbers to take away
    live: Live | None = None  # None where it is final


_NUMBER = re.compile(r"^(-|[-+]?[\d.,]+(e[-+]?\d+)?( ?%)?)?$")


def page_html(report: Report) -> str:
    """Return a report as a complete HTML document.

    Pictures are embedded as images, so that the ids inside one SVG cannot meet those of another.
    """
    return _template().render(report=report, generator=GENERATOR)


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("vinefab.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = _data_uri
    environment.filters["number_columns"] = _number_columns
    return environment.get_template("report.html.j2")


def _data_uri(picture: Picture) -> str:
    return f"data:{picture.media_type};base64,{base64.b64encode(picture.image).decode()}"


def _number_columns(table: Table) -> list[bool]:
    """Return for each column whether it holds only numbers: those are set flush right."""
    columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.headings)
    return [any(cells) and all(map(_NUMBER.match, cells)) for cells in columns]
