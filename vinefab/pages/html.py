"""A report as sections of words, tables and pictures, and as one HTML file without links."""

import base64
import re
from dataclasses import dataclass
from typing import Literal

from jinja2 import Environment, PackageLoader, StrictUndefined

from vinefab.core.errors import BadInputError
from vinefab.core.jsontext import GENERATOR

Tone = Literal["good", "caution", "bad"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A drawing with its caption.

    Parameters
    ----------
    image
        The drawing as a complete SVG document or PNG file.
    caption
        What is to be seen, with the standing of the numbers in it.
    wide
        Whether it takes the whole width of the page.
    """

    image: bytes
    caption: str
    wide: bool = False

    @property
    def media_type(self) -> str:
        """What kind of image it is."""
        return "image/png" if self.image.startswith(b"\x89PNG") else "image/svg+xml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of text under headings.

    Parameters
    ----------
    caption
        What the table shows.
    headings
        One per column.
    rows
        Cells as text, one tuple per row.
    folded
        Whether a reader has to open it; what is folded is not printed.
    """

    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    folded: bool = False

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.headings):
                raise BadInputError(self.caption, len(row), f"{len(self.headings)} cells per row")


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the report under one title.

    Parameters
    ----------
    title
        Its heading.
    paragraphs
        Words, before everything else.
    tables, pictures
        What follows.
    code
        Lines to be typed, shown as they are.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    code: str = ""

    @property
    def anchor(self) -> str:
        """The name by which the list of contents finds the section."""
        return "-".join("".join(c if c.isalnum() else " " for c in self.title.lower()).split())


@dataclass(frozen=True, slots=True, kw_only=True)
class Headline:
    """One number that a reader should take away.

    Parameters
    ----------
    name
        What it is.
    value
        The number with its unit.
    detail
        How sure it is, and its standing.
    tone
        Whether it is good news.
    """

    name: str
    value: str
    detail: str
    tone: Tone = "good"


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A whole report.

    Parameters
    ----------
    title
        Name of the design and what the report is about.
    verdict
        One sentence: can it be made, and what is to be expected.
    tone
        What kind of news the verdict is.
    facts
        Short name and value pairs shown at the top.
    sections
        In order.
    cautions
        What stands between the verdict and blind trust, a sentence each.
    headlines
        The numbers to take away.
    """

    title: str
    verdict: str
    tone: Tone
    facts: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
    cautions: tuple[str, ...] = ()
    headlines: tuple[Headline, ...] = ()


_NUMBER = re.compile(r"^(-|[-+]?[\d.,]+(e[-+]?\d+)?( ?%)?)?$")


def page_html(report: Report) -> str:
    """Return a report as a complete HTML document.

    Pictures are embedded as images, so that the ids inside one SVG cannot meet those of another.

    Parameters
    ----------
    report
        What to say; all text is escaped.
    """
    environment = Environment(
        loader=PackageLoader("vinefab.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = _data_uri
    environment.filters["number_columns"] = _number_columns
    return environment.get_template("report.html.j2").render(report=report, generator=GENERATOR)


def _data_uri(picture: Picture) -> str:
    return f"data:{picture.media_type};base64,{base64.b64encode(picture.image).decode()}"


def _number_columns(table: Table) -> list[bool]:
    """Tell of each column whether it holds nothing but numbers: those are set flush right."""
    columns = zip(*table.rows, strict=True) if table.rows else [()] * len(table.headings)
    return [any(cells) and all(map(_NUMBER.match, cells)) for cells in columns]
