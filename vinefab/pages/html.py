"""Blocks as HTML: one page without links, and the view in a notebook."""

import base64
import io
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import groupby

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from PIL import Image

from vinefab.core.plain_text import GENERATOR, visible
from vinefab.core.view import (
    PNG,
    Block,
    Picture,
    Section,
    number_columns,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Live:
    """Settings of an unfinished page, which loads itself again."""

    refresh_s: int  # after how long
    written_ms: int  # when it was written, since 1970
    patience_s: int  # silence after which its writer has ended; 0: the writer says so
    again: str  # the command that continues


def page(title: str, blocks: Iterable[Block], live: Live | None = None) -> str:
    """Return blocks as a complete HTML document.

    Pictures are embedded as images, so that the ids inside one SVG cannot meet those of another.

    Parameters
    ----------
    live
        How the page stays current; None where it is final.
    """
    shown = list(blocks)
    first = next((k for k, one in enumerate(shown) if isinstance(one, Section)), len(shown))
    # What is folded is a list of its titles.
    sections = [one for one in shown if isinstance(one, Section) and not one.folded]
    return _template("page.html.j2").render(
        title=title,
        top=list(_parts(shown[:first])),
        below=list(_parts(shown[first:])),
        sections=sections,
        live=live,
        generator=GENERATOR,
    )


def blocks_html(blocks: Iterable[Block]) -> str:
    """Return blocks as HTML to be shown in a notebook."""
    shown = _template("blocks.html.j2").module.show_all(list(_parts(blocks)))  # type: ignore[attr-defined]
    return str(shown)


def _parts(blocks: Iterable[Block]) -> Iterator[tuple[str, list[Block]]]:
    """Yield blocks with the name of their kind; pictures that follow each other are together."""
    for kind, same in groupby(blocks, key=lambda block: type(block).__name__):
        together = list(same)
        yield from [(kind, together)] if kind == "Picture" else ((kind, [one]) for one in together)


@cache
def _template(name: str) -> Template:
    environment = Environment(
        loader=PackageLoader("vinefab.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = _data_uri
    environment.filters["size_px"] = _size_px
    environment.filters["number_columns"] = number_columns
    environment.filters["shown"] = lambda value: visible(str(value))
    return environment.get_template(name)


def _data_uri(picture: Picture) -> str:
    image = picture.drawn
    kind = "image/png" if image.startswith(PNG) else "image/svg+xml"
    return f"data:{kind};base64,{base64.b64encode(image).decode()}"


_PX = {"pt": 96.0 / 72.0, "mm": 96.0 / 25.4, "px": 1.0, "": 1.0}
"""Of a screen's pixels, an inch has 96."""


def _size_px(picture: Picture) -> tuple[int, int]:
    """Return width and height at which a picture is as large as it was drawn."""
    image = picture.drawn
    if image.startswith(PNG):
        with Image.open(io.BytesIO(image)) as opened:
            per_inch = opened.info.get("dpi", (96.0, 96.0))[0]
            wide, high = (round(96.0 * side / per_inch) for side in opened.size)
            return wide, high
    head = image[: image.find(b">", image.find(b"<svg"))].decode()
    sides = dict(re.findall(r'\s(width|height)="([\d.]+(?:pt|mm|px|))"', head))
    wide, high = (
        round(float(sides[side].rstrip("ptmx")) * _PX[sides[side].lstrip("0123456789.")])
        for side in ("width", "height")
    )
    return wide, high
