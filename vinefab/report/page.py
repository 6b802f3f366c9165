"""A report as one HTML file that needs nothing else: no scripts, no links to elsewhere."""

import base64

from jinja2 import Environment, PackageLoader, StrictUndefined

from vinefab.core.jsontext import GENERATOR
from vinefab.report.content import Picture, Report


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
    return environment.get_template("report.html.j2").render(report=report, generator=GENERATOR)


def _data_uri(picture: Picture) -> str:
    kind = "png" if picture.svg.startswith(b"\x89PNG") else "svg+xml"
    return f"data:image/{kind};base64,{base64.b64encode(picture.svg).decode()}"
