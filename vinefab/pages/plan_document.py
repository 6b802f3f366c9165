"""Plans that stand alone: one SVG document with style, scale bar and legend, for notebooks."""

import math
import re
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.resources import files
from xml.sax.saxutils import escape

import numpy as np

from vinefab.core.errors import shortened
from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import one_line
from vinefab.model.deployment import Deployment, Stop
from vinefab.pages.colours import LEVEL_COLOURS
from vinefab.pages.map_view import STOP_WORDS, Box, longer_mm
from vinefab.pages.panel import round_length_mm
from vinefab.pages.plan_svg import CONTACT, STOP_SIGNS, stop_class, view_box

LONGEST_PX = 600.0
"""Of a plan's longer side; the documentation draws smaller ones, whose words a phone shows."""

_LEAST_WIDTH_PX = 340.0
_TOP_PX, _ROW_PX = 26.0, 18.0
_LETTER_PX, _TITLE_PX = 6.0, 6.8  # of a letter in the legend and in the title
_RIM = 0.02  # around the box, as a share of its longer side
_MOST_LETTERS = 90

LegendEntry = tuple[str, str]
"""A symbol, in pixels around the origin, and what it means."""

START_ENTRY: LegendEntry = (
    '<g class="pose"><circle class="handle base" r="3"/></g>',
    "start",
)
RANGE: LegendEntry = (
    '<g class="range"><path class="fan" d="M-7-4H7V4H-7Z"/></g>',
    "range of starts",
)


BODY_LINE: LegendEntry = (
    '<path class="swatch thin" d="M-7 0H7"/>',
    "body: a line without width",
)


def plan_document(
    parts: Iterable[str], box_mm: Box, *, title: str = "", legend: Sequence[LegendEntry] = ()
) -> str:
    """Return a complete SVG document that shows parts of `vinefab.pages.plan_svg` in a box.

    Its style stands in it with the light colours on white paper: a picture looks the same in every
    notebook and program.
    """
    rim_mm = _RIM * longer_mm(box_mm)
    width_mm, height_mm = (box_mm[i + 2] - box_mm[i] + 2.0 * rim_mm for i in (0, 1))
    mm_per_px = max(width_mm, height_mm) / LONGEST_PX
    plan_px = (width_mm / mm_per_px, height_mm / mm_per_px)
    name = escape(shortened(one_line(title), _MOST_LETTERS))
    width_px = max(plan_px[0], _LEAST_WIDTH_PX, 16.0 + _TITLE_PX * len(name))
    top_px = _TOP_PX if title else 4.0
    foot = [_scale_bar(box_mm, mm_per_px, top_px + plan_px[1])]
    foot += _legend(legend, width_px, top_px + plan_px[1] + 2.2 * _ROW_PX)
    height_px = top_px + plan_px[1] + _ROW_PX * (1.6 + len(foot) - (len(foot) == 1))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" class="plan" role="img" '
            f'width="{width_px:.0f}" height="{height_px:.0f}" '
            f'viewBox="0 0 {width_px:.0f} {height_px:.0f}">',
            f"<title>{name}</title><desc>{GENERATOR}</desc>"
            if name
            else f"<desc>{GENERATOR}</desc>",
            f"<style>{plan_style(mm_per_px)}</style>",
            '<rect width="100%" height="100%" fill="#fff"/>',
            f'<g class="words"><text x="8" y="17">{name}</text></g>' if name else "",
            f'<svg x="{(width_px - plan_px[0]) / 2.0:.1f}" y="{top_px:g}" width="{plan_px[0]:.1f}" '
            f'height="{plan_px[1]:.1f}" viewBox="{view_box(box_mm, rim_mm)}">',
            *parts,
            "</svg>",
            f'<g class="words">{"".join(foot)}</g>',
            "</svg>\n",
        ]
    )


def robot_legend(deployment: Deployment) -> list[LegendEntry]:
    """Return what is to be seen of a robot, with counts: levels, contacts, why branches stopped."""
    levels, out = deployment.tree.level, deployment.deployed
    entries: list[LegendEntry] = []
    for level in range(1, int(levels.max()) + 1):
        here = levels == level
        count = f"{np.count_nonzero(here & out)} of {np.count_nonzero(here)}"
        colour = (level - 1) % len(LEVEL_COLOURS) + 1
        swatch = f'<path class="swatch level-{colour}" d="M-7 0H7"/>'
        entries.append((swatch, f"level {level} ({count})"))
    inner = np.maximum(np.diff(deployment.first_point) - 2, 0)
    if deployment.growth.get("body") == "centerline":
        entries.append(BODY_LINE)
    if contacts := int(inner.sum()):
        entries.append((f'<g class="contacts">{CONTACT}</g>', f"contact ({contacts})"))
    for stop in Stop:
        count_stopped = deployment.stops[stop.label]
        if count_stopped:
            mark = f'<g class="mark {stop_class(stop)}">{STOP_SIGNS[stop]}</g>'
            entries.append((mark, f"{STOP_WORDS[stop]} ({count_stopped})"))
    return entries


@cache
def plan_css() -> str:
    """Return the style sheet of all plans."""
    return (files("vinefab.pages") / "templates" / "plan.css").read_text(encoding="utf-8")


def plan_style(mm_per_px: float) -> str:
    """Return the light style for one scale, without what only browsers know: variables and such."""
    text = re.sub(r"/\*.*?\*/", "", plan_css().partition("/* Dark")[0], flags=re.DOTALL)
    text = _NON_SCALING.sub(r"stroke-width: calc(\1px * var(--mm-per-px, 1))", text)
    text = text.replace("var(--mm-per-px, 1)", f"{mm_per_px:.6g}")
    text = re.sub(r"var\(--[\w-]+, ([^()]*)\)", r"\1", text)
    text = re.sub(r"calc\(([\d.]+)px \* ([^()]*)\)", _product, text)
    return " ".join(text.split())


_NON_SCALING = re.compile(r"stroke-width: ([\d.]+)px; vector-effect: non-scaling-stroke")


def _product(found: re.Match[str]) -> str:
    return f"{float(found[1]) * float(found[2]):.4g}px"


def _scale_bar(box_mm: Box, mm_per_px: float, top_px: float) -> str:
    """Return a bar of a round length, at the left below the plan."""
    length_mm = round_length_mm(0.3 * (box_mm[2] - box_mm[0]))
    y, end = top_px + 0.6 * _ROW_PX, 10.0 + length_mm / mm_per_px
    return (
        f'<path class="scale" d="M10 {y - 4:.1f}v4H{end:.1f}v-4"/>'
        f'<text class="soft" x="{end + 7:.1f}" y="{y + 2:.1f}">{length_mm:g} mm</text>'
    )


def _legend(entries: Sequence[LegendEntry], width_px: float, top_px: float) -> list[str]:
    """Return the legend row by row."""
    rows: list[str] = []
    x = math.inf
    for symbol, words in entries:
        wide = 34.0 + _LETTER_PX * len(words)
        if x + wide > width_px:
            rows.append("")
            x = 8.0
        y = top_px + _ROW_PX * (len(rows) - 1)
        rows[-1] += (
            f'<g transform="translate({x + 9:.0f} {y - 4:.1f})">{symbol}</g>'
            f'<text class="soft" x="{x + 22:.0f}" y="{y:.1f}">{escape(words)}</text>'
        )
        x += wide
    return rows
