"""SVG drawings against a browser: ``python tests/maps/importers/against_chromium.py 200``, or
``SEED`` after the count to begin there.

Each drawing holds shapes that hide, move or clip each other in the ways of `FEATURES`, one in each
cell of a grid. Its page is drawn by Chromium, and so are the obstacles of its import; the two
pictures are compared pixel by pixel.
"""

import io
import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from typing import Any

import numpy as np
import shapely
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from vinefab.core.errors import BadInputError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_suffixes
from vinefab.model.map import Map

WIDTH, HEIGHT, PER_MM, CELL = 400, 300, 3, 100
MOST_SHARE = 0.002
"""Area on which picture and map may differ, as a share of the page."""

Rng = random.Random
Feature = Callable[[Rng, int], tuple[str, str, str]]
"""Style sheet, definitions and elements of what is drawn around 0, 0, at most 45 from it."""


def shape(rng: Rng, more: str = "") -> str:
    a, b = rng.uniform(8, 22), rng.uniform(8, 22)
    return rng.choice(
        (
            f'<rect x="{-a:.2f}" y="{-b:.2f}" width="{2 * a:.2f}" height="{b:.2f}" {more}/>',
            f'<rect x="{-a:.2f}" y="{-b:.2f}" width="{a:.2f}" height="{b:.2f}" rx="3" {more}/>',
            f'<circle cx="{0.3 * a:.2f}" r="{b:.2f}" {more}/>',
            f'<ellipse cy="{0.2 * a:.2f}" rx="{a:.2f}" ry="{b:.2f}" {more}/>',
            f'<polygon points="{-a:.2f},{-b:.2f} {a:.2f},0 0,{b:.2f}" {more}/>',
            f'<path d="M{-a:.2f} 0A{a:.2f} {b:.2f} 20 0 1 {b:.2f} {-a:.2f}L0 {b:.2f}z" {more}/>',
            f'<path d="M0 {-b:.2f}C{a:.2f} {-b:.2f} {a:.2f} {b:.2f} 0 {b:.2f}q-9 -3-9-9" {more}/>',
        )
    )


def transforms(rng: Rng, _: int) -> tuple[str, str, str]:
    angle, k = rng.uniform(-170, 170), rng.uniform(0.5, 1.3)
    texts = (
        f'transform="rotate({angle:.2f}) scale({k:.3f} 0.8)"',
        f'transform="translate(4,-3) skewX({angle / 6:.2f})"',
        f'style="transform:rotate({angle:.2f}deg) translate(3px, 1mm)"',
        f'style="transform:scaleX({k:.3f}) skewY({angle / 6:.2f}deg)" transform="rotate(9)"',
        f'style="transform:rotate(0.2turn);transform-origin:5px {k:.2f}em"',
        f'style="transform:rotate({angle:.2f}deg);transform-box:fill-box;transform-origin:center"',
        'transform="rotate(30)" transform-origin="4 7"',
    )
    return "", "", shape(rng, rng.choice(texts))


def styles(rng: Rng, n: int) -> tuple[str, str, str]:
    rules = rng.choice(
        (
            f".s{n} {{display:none}} #i{n} {{display:inline}}",
            f".s{n} {{visibility:hidden !important}}",
            f"g.g{n} > .s{n} {{opacity:0}}",
            f"g.g{n} .s{n} {{fill:none}} .s{n} {{fill:#000}}",
            f"@media print {{.s{n} {{display:none}}}}",
            f"@media screen {{.s{n}:first-child {{display:none}}}}",
            f"[data-n='{n}'] {{visibility:collapse}}",
            f"rect.s{n}, circle.s{n} {{fill-opacity:0; stroke-opacity:0}}",
            f".s{n} {{fill:rgba(0,0,0,0)}} .s{n}.s{n} {{fill:url(#none) black}}",
        )
    )
    own = rng.choice(("", "", 'style="visibility:visible"', 'style="display:inline"'))
    more = f'class="s{n}" id="i{n}" data-n="{n}" {own}'
    return rules, "", f'<g class="g{n}">{shape(rng, more)}</g>'


def hidden(rng: Rng, _: int) -> tuple[str, str, str]:
    around = rng.choice(
        (
            'visibility="hidden"',
            'display="none"',
            'opacity="0"',
            'style="visibility:hidden"',
            'fill="none"',
            'fill="transparent"',
            'fill-opacity="0"',
            'systemLanguage="de"',
            'requiredExtensions="x"',
        )
    )
    inner = rng.choice(("", 'visibility="visible"', 'fill="#000"', 'display="inline"'))
    return "", "", f"<g {around}>{shape(rng, inner)}</g>"


def lengths(rng: Rng, n: int) -> tuple[str, str, str]:
    texts = (
        '<circle r="1.2em"/>',
        '<g font-size="20"><rect width="1.5em" height="9"/></g>',
        '<rect width="5%" height="5%"/>',
        '<circle r="4%"/>',
        '<rect width="5mm" height="0.2in"/>',
        f'<rect class="c{n}" width="9" height="9"/>',
        '<ellipse rx="12"/>',
        '<rect style="width:20px;height:30;x:-4px" height="12"/>',
        "<path style=\"d:path('M0 0h20v9h-20z')\"/>",
    )
    return f".c{n} {{width:2em;height:10%;rx:4px}}", "", rng.choice(texts)


def clips(rng: Rng, n: int) -> tuple[str, str, str]:
    unit = "objectBoundingBox"
    inner = rng.choice(
        (
            f'<clipPath id="c{n}"><circle r="15"/></clipPath>',
            f'<clipPath id="c{n}"><rect x="-9" y="-9" width="12" height="40"/>'
            '<circle cx="8" r="7"/></clipPath>',
            f'<clipPath id="c{n}" clipPathUnits="{unit}">'
            '<circle cx=".5" cy=".5" r=".4"/></clipPath>',
            f'<clipPath id="c{n}" transform="rotate(20)">'
            '<path d="M-20-20h30v30h-30zM-15-15h9v9h-9z"'
            ' clip-rule="evenodd"/></clipPath>',
            f'<mask id="c{n}" maskUnits="userSpaceOnUse" x="-50" y="-50" width="100" height="100">'
            '<rect x="-12" y="-12" width="24" height="20" fill="white"/></mask>',
        )
    )
    name = "mask" if inner.startswith("<mask") else "clip-path"
    on = f'{name}="url(#c{n})"'
    if unit in inner or rng.random() < 0.5:
        return "", inner, shape(rng, on)
    turned = shape(rng, 'transform="rotate(15)"')
    return "", inner, f"<g {on}>{turned}</g>"


def uses(rng: Rng, n: int) -> tuple[str, str, str]:
    aspect = rng.choice(("", "none", "xMinYMax meet", "xMidYMid slice"))
    box = f'viewBox="-20 -10 40 30" preserveAspectRatio="{aspect}"' if aspect else ""
    flow = rng.choice(("", 'overflow="visible"'))
    symbol = f'<symbol id="u{n}" {box} {flow}>{shape(rng)}</symbol>'
    group = f'<g id="u{n}">{shape(rng)}</g>'
    svg = f'<svg x="-20" y="-20" width="40" height="30" {box} {flow}>{shape(rng)}</svg>'
    sized = f'<use href="#u{n}" x="-20" y="-15" width="40" height="36"/>'
    return rng.choice(
        (
            ("", symbol, sized),
            ("", group, f'<use href="#u{n}" x="6" fill="#000"/>'),
            ("", group, f'<use href="#u{n}" visibility="hidden"/>'),
            ("", "", svg),
        )
    )


def rules(rng: Rng, _: int) -> tuple[str, str, str]:
    inner = rng.choice(("M-10-10h20v20h-20z", "M-10-10v20h20v-20z"))
    rule = rng.choice(("", 'fill-rule="evenodd"', 'fill-rule="nonzero"'))
    return "", "", f'<path d="M-20-20h40v40h-40z{inner}" {rule}/>'


FEATURES: tuple[Feature, ...] = (transforms, styles, hidden, lengths, clips, uses, rules)


def drawing(seed: int) -> str:
    """Return a drawing; the same for the same seed."""
    rng = random.Random(seed)  # noqa: S311
    sheet, definitions, body = "", "", ""
    for n in range((WIDTH // CELL) * (HEIGHT // CELL)):
        row, column = divmod(n, WIDTH // CELL)
        style, define, elements = rng.choice(FEATURES)(rng, n)
        sheet, definitions = sheet + style, definitions + define
        x, y = (column + 0.5) * CELL, (row + 0.5) * CELL
        body += f'<g transform="translate({x} {y})">{elements}</g>\n'
    frame = f'<rect width="{WIDTH}" height="{HEIGHT}" style="fill:none;stroke:#fff"/>'
    aspect = rng.choice(("", 'preserveAspectRatio="none"'))
    size = f'width="{WIDTH}mm" height="{HEIGHT}mm" viewBox="0 0 {WIDTH} {HEIGHT}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} {aspect}><style>{sheet}</style>'
        f"<defs>{definitions}</defs>{frame}\n{body}</svg>"
    )


@contextmanager
def browser() -> Iterator[Page]:
    """Open a page of Chromium."""
    with sync_playwright() as programs:
        opened = programs.chromium.launch(executable_path=which("chromium"), args=["--no-sandbox"])
        yield opened.new_page(viewport={"width": WIDTH * PER_MM, "height": HEIGHT * PER_MM})
        opened.close()


def dark(page: Page, text: str) -> Any:
    """Return how dark each pixel of a drawing is, 0 to 1, shape (rows, columns)."""
    pixels = re.sub(
        r'width="\w+" height="\w+"',
        f'width="{WIDTH * PER_MM}" height="{HEIGHT * PER_MM}"',
        text,
        count=1,
    )
    with tempfile.NamedTemporaryFile("w", suffix=".svg") as file:
        file.write(pixels)
        file.flush()
        page.goto(f"file://{file.name}")
        shot = page.screenshot()
    grey = np.asarray(Image.open(io.BytesIO(shot)).convert("L"), dtype=np.float64)
    return 1.0 - grey / 255.0


def imported(text: str) -> Map:
    """Return the map in a drawing."""
    with tempfile.NamedTemporaryFile("w", suffix=".svg") as file:
        file.write(text)
        file.flush()
        options = ImportOptions(simplify_mm=0.01)
        return import_suffixes()[".svg"].read(Path(file.name), options)


def redrawn(world: Map) -> str:
    """Return the obstacles of a map as a plain drawing."""
    left, low, _, _ = world.bounds.bounds
    rings = [
        "M" + "L".join(f"{x - left:.4f} {HEIGHT - (y - low):.4f}" for x, y in ring.coords) + "z"
        for obstacle in world.obstacles
        for ring in shapely.get_rings(obstacle)
    ]
    size = f'width="{WIDTH}mm" height="{HEIGHT}mm" viewBox="0 0 {WIDTH} {HEIGHT}"'
    path = f'<path fill-rule="evenodd" d="{"".join(rings)}"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{path}</svg>'


def differing_share(page: Page, text: str) -> float:
    """Return the share of the page on which a drawing's picture and its map differ."""
    picture, world = dark(page, text), imported(text)
    solid = picture > 0.02  # any colour but white
    ours = dark(page, redrawn(world))
    # Edges of light shapes are light: whole pixels are compared there.
    return float(
        np.abs(np.where(picture > 0.9, 1.0, picture) - ours)[solid | (ours > 0.0)].sum()
    ) / (picture.size)


def main(arguments: list[str]) -> int:
    """Print the drawings that differ; return 1 if any does."""
    count, first = (*map(int, arguments), 0)[:2] if arguments else (200, 0)
    found = Counter[str]()
    worst = 0.0
    with browser() as page:
        for seed in range(first, first + count):
            try:
                share = differing_share(page, drawing(seed))
            except BadInputError as error:
                found["refused"] += 1
                sys.stdout.write(f"{seed}: {error}\n")
                continue
            worst = max(worst, share)
            found["differs" if share > MOST_SHARE else "same"] += 1
            if share > MOST_SHARE:
                sys.stdout.write(f"{seed}: {100.0 * share:.3f} % of the page differ\n")
    sys.stdout.write(f"{dict(found)}, most {100.0 * worst:.3f} % of the page\n")
    return 1 if found["differs"] or found["refused"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
