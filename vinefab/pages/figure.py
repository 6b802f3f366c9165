"""Blank figures, and their way into bytes; knows matplotlib's file side."""

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from vinefab.core.errors import shortened
from vinefab.core.jsontext import GENERATOR
from vinefab.pages.colours import INK, SOFT
from vinefab.pages.panel import MOST_LETTERS, MOST_LINES

_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "vinefab",
    "svg.fonttype": "path",
    "font.size": 9.0,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "legend.frameon": False,
    "text.parse_math": False,  # names of maps and designs may hold dollars
}


def _shorten_texts(figure: Figure) -> None:
    """Leave out the middle of the long texts of a figure: names may have any length."""
    for text in cast("list[Text]", figure.findobj(Text)):
        lines = text.get_text().split("\n")[:MOST_LINES]
        text.set_text("\n".join(shortened(line, MOST_LETTERS) for line in lines))


@contextmanager
def house_style() -> Iterator[None]:
    """Draw and save in the house's style, without changing global settings."""
    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        # A name with a letter that no font has is drawn with boxes; that is no news to a user.
        warnings.filterwarnings("ignore", message=r"Glyph \d+")
        # Nor that texts of the most letters leave a small figure no room to arrange itself.
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        yield


def blank(width_in: float = 6.0, height_in: float = 6.0) -> tuple[Figure, Axes]:
    """Return an empty figure with one set of axes."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, figure.add_subplot()


def frame(axes: Axes) -> None:
    """Leave of the box around a chart only what is read off, and add a faint grid."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(visible=True, color=SOFT, alpha=0.15)


def svg_bytes(figure: Figure) -> bytes:
    """Return a figure as SVG; the same figure gives the same bytes."""
    stream = io.BytesIO()
    _shorten_texts(figure)
    with house_style():
        figure.savefig(
            stream,
            format="svg",
            bbox_inches="tight",
            metadata={"Date": None, "Creator": GENERATOR},
        )
    # matplotlib repeats every text in a comment, with characters that XML forbids.
    valid = _NOT_XML.sub(b"?", stream.getvalue())
    return re.sub(rb' d="[^"]*"', _shortened, valid)


_NOT_XML = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]|\xef\xbf[\xbe\xbf]")


def _shortened(path: re.Match[bytes]) -> bytes:
    """Return a path with its numbers to a hundredth of a point; matplotlib writes six decimals."""
    return re.sub(rb"(\.\d\d)\d+", rb"\1", path.group())
