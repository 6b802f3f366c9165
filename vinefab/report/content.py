"""What a report says, before it is a page: sections of words, tables and pictures."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A drawing with its caption.

    Parameters
    ----------
    svg
        The drawing as a complete SVG document, or a PNG where there are too many lines for one.
    caption
        What is to be seen, with the standing of the numbers in it.
    wide
        Whether it takes the whole width of the page.
    """

    svg: bytes
    caption: str
    wide: bool = False


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
    """

    caption: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


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
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """A whole report.

    Parameters
    ----------
    title
        Name of the design and what the report is about.
    verdict
        One sentence: can it be made, and what is to be expected.
    good
        Whether the verdict is a good one.
    facts
        Short name and value pairs shown at the top.
    sections
        In order.
    """

    title: str
    verdict: str
    good: bool
    facts: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
