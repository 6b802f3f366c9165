"""What stands on a page of the drawing layer, measured by the letters of a real font."""

from functools import cache

import matplotlib as mpl
import shapely
from PIL import ImageFont

from vinefab.pages.panel import MIDDLE, Page, Primitive, Words


def primitives_of(page: Page) -> list[Primitive]:
    return [primitive for layer in page.layers for primitive in layer.primitives]


def texts_of(page: Page) -> list[str]:
    return [one.text for one in primitives_of(page) if isinstance(one, Words)]


@cache
def _font(*, bold: bool) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold" if bold else "DejaVuSans"
    return ImageFont.truetype(f"{mpl.get_data_path()}/fonts/ttf/{name}.ttf", 100)


def placed_texts(page: Page) -> list[tuple[str, shapely.Polygon]]:
    """Return every text that is not blank with the box around its letters, y down."""
    found = []
    for one in primitives_of(page):
        if isinstance(one, Words) and one.text.strip():
            anchor = {"start": "ls", "middle": "ms", "end": "rs"}[one.anchor]
            ends = _font(bold=one.bold).getbbox(one.text, anchor=anchor)
            x0, y0, x1, y1 = (end * one.size_pt / 100.0 for end in ends)
            x = one.at[0] + one.shift_pt[0]
            y = one.at[1] - one.shift_pt[1] + MIDDLE * one.size_pt
            found.append((one.text, shapely.box(x + x0, y + y0, x + x1, y + y1)))
    return found
