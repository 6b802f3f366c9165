"""A report as one HTML file that needs nothing else: no scripts, no links to elsewhere."""

import base64
import re

from jinja2 import Environment, PackageLoader, StrictUndefined

from vinefab.core.jsontext import GENERATOR
from vinefab.report.content import Picture, Report, Table

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
        loader=PackageLoader("vinefab.report"),
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
