"""How fast the studio's page is, measured in a real browser.

    python tests/studio/measure_page.py [RUNS] [DRAGS]

RUNS (5) starts of each kind, DRAGS (1000) for the memory. A table: start to first picture with an
empty and a full cache of compiled code; pointer move to the picture that shows it; full rules after
a release; memory. It takes some ten minutes and wants a quiet machine.

A pointer move counts until the first frame has been painted whose growth and scores are of that
position or a later one; its beginning is the time stamp that the browser gives the event. A robot
that does not grow costs little: moves whose picture shows none are left out, and counted.
"""

import shutil
import sys
import tempfile
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import shapely
from playwright.sync_api import sync_playwright

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import vinefab as vf
from tests.studio.conftest import running_studio

MOVES = 150
TIMES = 3
HZ = 60.0
OBSTACLES = {36: (6, 6, 500.0), 506: (23, 22, 2000.0)}
BRANCHES = {10: (3, 2), 40: (3, 3, 3), 149: (4, 4, 8)}
SLIDER = 'input[type=range][data-key="level.0.length"]'
HANDLE = ".pose-layer .base"
TIP = '.robot-layer .mark[data-branch="0.0.0"]'
"""Of one branch of the design written branch by branch; others may hang on it."""

WATCH = """() => {
  const key = (state) => JSON.stringify([state.pose, state.design, state.map]);
  const moves = [];
  const made = []; // which state was made by which move
  const shown = [];
  const painted = (fn) => requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = () => fn(performance.now());
    channel.port2.postMessage(0);
  });
  // On the window: after the page's own listeners have changed the state.
  for (const name of ["pointermove", "input"]) addEventListener(name, (event) => {
    if (studio.watchedEvent !== name) return;
    moves.push(event.timeStamp);
    const entry = {key: key(studio.store.get()), at: event.timeStamp, move: moves.length - 1};
    if (!isTip) made.push(entry);
  });
  // A tip changes the state once the server has said how: by the newest move when it was asked.
  const {ask} = studio;
  let isTip = false;
  let answered = -1;
  studio.ask = async (panel, ...more) => {
    const move = moves.length - 1;
    const found = await ask(panel, ...more);
    if (panel === "tip") answered = move;
    return found;
  };
  studio.store.subscribe((state) => {
    if (isTip) made.push({key: key(state), at: performance.now(), move: answered});
  });
  globalThis.watch = (event, ofTip) => { [studio.watchedEvent, isTip] = [event, ofTip]; };
  // Registered last: the panels have drawn the answer when this is called.
  studio.onAnswer("live", (answer, state) => {
    const entry = {key: key(state), grew: answer.facts.deployed > 0};
    painted((at) => shown.push({...entry, at}));
  });
  let up = 0;
  globalThis.ruled = [];
  addEventListener("pointerup", (event) => { up = event.timeStamp; }, true);
  studio.onAnswer("rules", () => {
    if (up && document.getElementById("sheet").getAttribute("aria-busy") === "false") {
      const since = up;
      up = 0;
      painted((at) => ruled.push(at - since));
    }
  });
  globalThis.latencies = () => {
    // A hand that comes back shows a state again: the picture is of the last time before it.
    const arrivals = shown.map(({key, at, grew}) =>
      ({shows: made.findLast((one) => one.key === key && one.at <= at)?.move ?? -1,
        when: at, grew}));
    const found = moves.map((at, index) => {
      const seen = arrivals.filter(({shows}) => shows >= index);
      const first = seen.reduce((one, other) => (other.when < one.when ? other : one), seen[0]);
      return first && {ms: first.when - at, grew: first.grew};
    }).filter(Boolean);
    moves.length = made.length = shown.length = 0;
    answered = -1;
    return found;
  };
}"""


def design_text(branches):
    """Return a design file of so many branches per level."""
    widths = [round(40.0 * 0.6**level, 2) for level in range(len(branches) + 1)]
    levels = "".join(
        f"[[level]]\nbranches = {count}\nlength = {70 - 12 * level}.0\nangle_deg = 150.0\n"
        "growth_percent = 100.0\n"
        for level, count in enumerate(branches)
    )
    return (
        f'schema = "vinefab/design-1"\nname = "measured"\n[trunk]\nlength = 90.0\n{levels}'
        f"[build]\nwidths_mm = {widths}\nfillet_mm = {[2.0] * len(branches)}\ntail_mm = 200.0\n"
    )


@contextmanager
def opened(browser, folder, *arguments, extra=()):
    """Give a page with the robot on it, and its server."""
    with running_studio(folder, *arguments, extra=extra) as studio:
        page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
        page.goto(studio.address)
        page.wait_for_selector(".robot-layer path[data-branch]", state="attached")
        yield page, studio
        page.context.close()


# Told by the page itself: a program that asks it again and again adds half a second by chance.
FIRST = """new MutationObserver((_, observer) => {
  if (!document.querySelector(".robot-layer path[data-branch]")) return;
  observer.disconnect();
  requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = () => {
      globalThis.firstPicture = performance.timeOrigin + performance.now();
    };
    channel.port2.postMessage(0);
  });
}).observe(document, {childList: true, subtree: true});"""


def first_pictures_s(browser, folder, runs, cache):
    """Return the times from the command to the address and to the first picture."""
    times = []
    for _ in range(runs):
        extra = {"VINEFAB_CACHE_DIR": tempfile.mkdtemp(dir=folder)} if cache == "empty" else {}
        began = time.time()
        with running_studio(folder, extra=extra) as studio:
            said = time.time() - began
            page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
            page.add_init_script(FIRST)
            page.goto(studio.address, wait_until="commit")
            while not (shown := page.evaluate("globalThis.firstPicture ?? 0")):
                time.sleep(0.05)
            times.append((said, shown / 1000.0 - began))
            page.context.close()
    return np.array(times)


def wait_until_compiled(page):
    """Wait until the server grows with compiled code: anchoring has a score then."""
    for _ in range(2400):
        if page.evaluate("typeof studio.answers.live?.scores?.anchoring === 'number'"):
            return
        page.wait_for_timeout(100)
    raise SystemExit("the simulator was not compiled within four minutes")


def drag(page, start, path, *, pause_s=1.0 / HZ):
    """Press, follow a path of offsets in pixels at 60 Hz, release."""
    page.mouse.move(*start)
    page.mouse.down()
    began = time.perf_counter()
    for step, (dx, dy) in enumerate(path):
        page.mouse.move(start[0] + dx, start[1] + dy)
        time.sleep(max(0.0, began + (step + 1) * pause_s - time.perf_counter()))
    page.mouse.up()


def middle(page, selector):
    box = None
    while box is None:
        box = page.locator(selector).first.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def thumb(page):
    """Return where the slider's thumb is."""
    box = page.locator(SLIDER).bounding_box()
    low, high, value = page.locator(SLIDER).evaluate(
        "({min, max, value}) => [min, max, value].map(Number)"
    )
    share = (value - low) / (high - low)
    return box["x"] + 8 + share * (box["width"] - 16), box["y"] + box["height"] / 2


def latencies_ms(page, selector):
    """Return a latency per pointer move of a drag there and back."""
    event = "input" if selector == SLIDER else "pointermove"
    page.evaluate("([event, ofTip]) => watch(event, ofTip)", [event, selector == TIP])
    turns = np.linspace(0.0, 4.0 * np.pi, MOVES)
    reach = 18.0 if selector == SLIDER else 6.0 if selector == HANDLE else 25.0
    # Up, and not far: elsewhere a start has no room for a robot.
    path = [(reach * np.sin(turn), -6.0 * np.sin(turn) ** 2) for turn in turns]
    drag(page, thumb(page) if selector == SLIDER else middle(page, selector), path)
    page.wait_for_timeout(1500)
    found = page.evaluate("latencies()")
    page.evaluate("watch('', false)")
    return np.array([one["ms"] for one in found if one["grew"]]), len(found)


def rules_ms(page, count=8):
    """Return the times from releasing the slider to the full rules on the page."""
    page.evaluate("ruled.length = 0")
    for index in range(count):
        drag(page, thumb(page), [(2 * (1 + index % 2) * (-1) ** (index // 2), 0)] * 2)
        before = time.monotonic()
        while page.evaluate("ruled.length") <= index and time.monotonic() < before + 10:
            page.wait_for_timeout(20)
    return np.array(page.evaluate("ruled"))


def heap_mb(page):
    """Return the page's memory after a collection, and how many nodes it has."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    session.send("HeapProfiler.collectGarbage")
    found = session.send("Performance.getMetrics")["metrics"]
    session.detach()
    metrics = {one["name"]: one["value"] for one in found}
    return metrics["JSHeapUsedSize"] / 1e6, int(metrics["Nodes"]), int(metrics["JSEventListeners"])


def say(what, text):
    print(f"{what:<58} {text}", flush=True)  # noqa: T201  a table for who runs it


def summary(found, count=None):
    if not len(found):
        return "no picture"
    typical, late = np.percentile(found, [50, 95])
    of_all = "" if count in (None, len(found)) else f" of {count}, the others without a robot"
    text = f"median {typical:5.0f}, 95 % {late:5.0f}, most {found.max():5.0f} ms, n {len(found)}"
    return text + of_all


def main(runs=5, drags=1000):
    """Print the table."""
    folder = Path(tempfile.mkdtemp(prefix="measure-page-"))
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium") or shutil.which("chromium-browser"),
                args=["--no-sandbox", "--enable-precise-memory-info"],
            )
            measure_starts(browser, folder, runs)
            measure_drags(browser, folder)
            measure_memory(browser, folder, drags)
            browser.close()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def measure_starts(browser, folder, runs):
    for cache in ("empty", "full"):
        times = first_pictures_s(browser, folder, runs, cache)
        said, seen = np.median(times, axis=0)
        say(
            f"start, {cache} cache: address, first picture",
            f"{said:.2f} s, {seen:.2f} s (most {times[:, 1].max():.2f} s, n {runs})",
        )


def measure_drags(browser, folder):
    """Drag values and the robot, then an obstacle next to it, with few and many on the map."""
    for count, branches in BRANCHES.items():
        dragged = {"slider": SLIDER, "start of the robot": HANDLE, "tip of a branch": TIP}
        measure_scene(browser, folder, f"{count} branches", branches, dragged)
    for count, (columns, rows, size_mm) in OBSTACLES.items():
        world = vf.maps.grid(3, columns=columns, rows=rows, size_mm=size_mm)
        path, start = world.write(folder / "obstacles.geojson", force=True), world.starts[0].pose
        beside = shapely.Point(start.x_mm + 30.0, start.y_mm + 60.0)
        near = min(range(count), key=lambda index: world.obstacles[index].distance(beside))
        for branches in (10, 40):
            title = f"{count} obstacles, {branches} branches"
            dragged = {"obstacle": f'[data-obstacle="{near}"]'}
            measure_scene(browser, folder, title, BRANCHES[branches], dragged, "--map", path)


def measure_scene(browser, folder, title, branches, dragged, *arguments):
    (folder / "measured.toml").write_text(design_text(branches))
    with opened(browser, folder, "measured.toml", *arguments) as (page, _):
        page.evaluate(WATCH)
        wait_until_compiled(page)
        page.wait_for_timeout(3000)
        for name, selector in [*dragged.items()] * TIMES:  # in turns: the load changes
            with freed(page) if selector == TIP else nullcontext():
                say(f"{title}: {name}", summary(*latencies_ms(page, selector)))
        if SLIDER in dragged.values():
            say(f"{title}: release to full rules", summary(rules_ms(page)))


@contextmanager
def freed(page):
    """Write the design branch by branch for a while."""
    page.evaluate("studio.edits.edit('free')")
    page.wait_for_timeout(3000)
    yield
    page.evaluate("while (studio.store.get().design.branch) studio.store.undo()")
    page.wait_for_timeout(3000)


def measure_memory(browser, folder, drags):
    (folder / "measured.toml").write_text(design_text(BRANCHES[40]))
    with opened(browser, folder, "measured.toml", "--environment", "grid") as (page, studio):
        wait_until_compiled(page)
        for done in range(1, drags + 1):
            drag(page, thumb(page), [((-1) ** done * 3 * step, 0) for step in (1, 2)], pause_s=0.01)
            if done in (drags // 10, drags):
                page.wait_for_timeout(2500)
                heap, nodes, listeners = heap_mb(page)
                say(
                    f"memory after {done} drags",
                    f"page {heap:.1f} MB, {nodes} nodes, {listeners} listeners;"
                    f" server {studio.memory_mb():.0f} MB;"
                    f" {page.evaluate('studio.store.steps()')} steps of undo",
                )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
