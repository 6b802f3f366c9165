"""Film the studio's real page: python docs/studio_film.py [docs/pictures/studio.webp].

A server is started, Chromium (Debian's, driven by Playwright) opens the page, and every frame waits
for the answers that it shows. Nothing is staged but the pointer, which headless browsers do not
draw. The same page gives the same frames.
"""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image
from playwright.sync_api import Locator, Page, sync_playwright

WIDTH, HEIGHT = 1280, 780
MOST_BYTES = 2_500_000
STEP_MS, HOLD_MS = 70, 600
CHROMIUM = "/usr/bin/chromium"
DESIGN, MAP = "three_level_tree", ("--environment", "grid")

_POINTER = """() => {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.innerHTML = '<path d="M1 1 L1 17 L5.5 13 L8.5 20 L11.5 18.7 L8.5 12 L14 12 Z"'
    + ' fill="black" stroke="white"/>';
  for (const [name, value] of Object.entries({
    position: "fixed", zIndex: 99, width: "22px", height: "24px", pointerEvents: "none",
    left: "600px", top: "450px",
  })) svg.style[name] = value;
  svg.id = "pointer";
  document.body.append(svg);
}"""
_MOVE = """([x, y]) => {
  Object.assign(document.getElementById("pointer").style, { left: `${x}px`, top: `${y}px` });
}"""
_ON_MAP = """([x, y]) => {
  const at = document.querySelector("#map svg.plan").getScreenCTM();
  const point = new DOMPoint(x, -y).matrixTransform(at);
  return [point.x, point.y];
}"""


class Film:
    """Frames of a page, and the pointer on it."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._at = (600.0, 450.0)
        self.frames: list[Image.Image] = []
        self.times_ms: list[int] = []
        page.evaluate(_POINTER)

    def take(self, time_ms: int = STEP_MS) -> None:
        """Add what is to be seen once the answers are there; equal frames become one."""
        self._page.wait_for_timeout(60)
        self._page.locator("html[data-link=up]").wait_for()
        picture = Image.open(BytesIO(self._page.screenshot())).convert("RGB")
        if self.frames and np.array_equal(np.asarray(picture), np.asarray(self.frames[-1])):
            self.times_ms[-1] += time_ms
            return
        self.frames.append(picture)
        self.times_ms.append(time_ms)

    def go(self, x: float, y: float, steps: int = 2, *, seen: bool = True) -> None:
        """Move the pointer in a straight line."""
        from_x, from_y = self._at
        for number in range(1, steps + 1):
            share = number / steps
            self._at = (from_x + share * (x - from_x), from_y + share * (y - from_y))
            self._page.mouse.move(*self._at)
            self._page.evaluate(_MOVE, list(self._at))
            if seen:
                self.take()

    def to(self, place: Locator, share: float = 0.5, *, steps: int = 2) -> None:
        """Move the pointer to a place; ``share`` of its width from its left."""
        place.scroll_into_view_if_needed()
        box = place.bounding_box()
        if box is None:
            raise RuntimeError(f"not to be seen: {place}")
        self.go(box["x"] + share * box["width"], box["y"] + box["height"] / 2, steps)

    def drag(self, *ways: tuple[float, float], steps: int = 6) -> None:
        """Press, move by each way in turn, let go."""
        self._page.mouse.down()
        for dx, dy in ways:
            self.go(self._at[0] + dx, self._at[1] + dy, steps)
        self._page.mouse.up()

    def to_map(self, x_mm: float, y_mm: float, steps: int = 2) -> None:
        """Move the pointer to a place of the map."""
        self.go(*self._page.evaluate(_ON_MAP, [x_mm, y_mm]), steps)

    def drag_on_map(self, *places: tuple[float, float], steps: int = 6) -> None:
        """Press, move to each place of the map in turn, let go."""
        self._page.mouse.down()
        for x_mm, y_mm in places:
            self.to_map(x_mm, y_mm, steps)
        self._page.mouse.up()

    def click(self, place: Locator, *, steps: int = 2) -> None:
        """Go there and click."""
        self.to(place, steps=steps)
        self._page.mouse.down()
        self._page.mouse.up()

    def settle(self, time_ms: int = HOLD_MS) -> None:
        """Wait for the rules, then hold."""
        self._page.wait_for_timeout(400)
        self._page.locator("#sheet[aria-busy=false]").wait_for()
        self.take(time_ms)


def play(film: Film, page: Page) -> None:
    """Do what is filmed."""
    film.settle()
    slider(film, page, "level.0.angle_deg", (24, -14))
    film.settle(300)
    film.to_map(250, 15)
    film.drag_on_map((256, 60), (246, 32), steps=5)
    film.settle(500)
    film.click(page.get_by_role("button", name="Add a target"))
    film.to_map(333, 300)
    film.drag_on_map((333, 300), steps=1)
    film.settle(700)
    film.drag_on_map((333, 252), (290, 250), steps=2)  # between obstacles
    film.settle(700)
    film.to_map(300, 205)
    film.drag_on_map((322, 228), (285, 220), steps=5)
    film.settle(500)
    slider(film, page, "build.widths_mm.2", (14,))
    film.settle(600)
    film.click(page.locator("#findings li.error button").first)
    film.settle(900)
    film.click(page.locator("#fix"))
    page.locator("#fix-take").wait_for(timeout=60_000)
    film.settle(1100)
    film.click(page.locator("#fix-take"))
    film.click(page.get_by_role("button", name="Whole sheet"))
    film.settle(600)
    film.to(page.locator("#front"), 0.98)
    page.locator("#front").fill("0")
    film.to(page.locator("#front"), 0.02, steps=1)
    wide = page.locator("#front").bounding_box()
    film.drag((0.96 * (wide["width"] if wide else 0), 0), steps=14)
    film.settle(1100)


def slider(film: Film, page: Page, key: str, ways: tuple[float, ...]) -> None:
    """Drag a slider of the design by its thumb, pixels to the right."""
    place = page.locator(f"input[type=range][data-key='{key}']")
    least, most = (float(place.get_attribute(name) or 0) for name in ("min", "max"))
    value = float(place.input_value())
    film.to(place, 0.06 + 0.88 * (value - least) / (most - least))
    film.drag(*((way, 0) for way in ways), steps=4)


def webp(film: Film, quality: int) -> bytes:
    """Return the frames as an animated WebP: a GIF has too few colours for marks and levels."""
    stream, (first, *others) = BytesIO(), film.frames
    first.save(
        stream, "WEBP", save_all=True, append_images=others, duration=film.times_ms, loop=0,
        quality=quality, method=4,
    )  # fmt: skip
    return stream.getvalue()


def filmed(address: str, act: Callable[[Film, Page], None]) -> Film:
    """Return the film of the actions on a page."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.goto(address)
        page.locator("html[data-ready=true]").wait_for()
        page.locator("#map .robot-layer path[data-branch]").first.wait_for(state="attached")
        page.wait_for_timeout(8000)  # the simulator is loaded meanwhile
        film = Film(page)
        act(film, page)
        browser.close()
    return film


def main(out: Path) -> None:
    """Start a server, film it, write the picture."""
    words = [sys.executable, "-u", "-m", "vinefab", "studio", DESIGN, *MAP, "--no-browser"]
    with TemporaryDirectory() as folder:
        own = {**os.environ, "VINEFAB_PROFILES": folder}  # without the unsaved work of others
        server = subprocess.Popen(  # noqa: S603  nothing of it comes from outside
            words, cwd=folder, env=own, stdout=subprocess.PIPE, text=True
        )
        try:
            line = server.stdout.readline() if server.stdout else ""
            film = filmed(re.findall(r"http://\S+", line)[0], play)
        finally:
            server.terminate()
            server.wait()
    data = next(found for n in (75, 60, 45, 30) if len(found := webp(film, n)) <= MOST_BYTES)
    out.write_bytes(data)
    seconds = sum(film.times_ms) / 1000
    sys.stdout.write(f"{out}: {len(film.frames)} frames, {seconds:.1f} s, {len(data)} bytes\n")
    if frames := os.environ.get("FRAMES"):  # to be looked at
        for number, picture in enumerate(film.frames):
            picture.save(Path(frames) / f"{number:03d}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "docs/pictures/studio.webp"))
