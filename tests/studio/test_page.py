"""The studio's page in a real browser: what the hand does, and what the library says of it."""

import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest
import shapely

import vinefab as vf
from tests.studio.conftest import PATIENCE_S, TWIG, WINDOW, TabSession
from vinefab.core.view import Picture
from vinefab.growth.options import GrowthOptions, growth_text
from vinefab.inflation.pattern import pattern_of
from vinefab.model.files.run_context import ChosenRecipe
from vinefab.outline.body_outline import body_outline
from vinefab.pages.html import page as html_page
from vinefab.pages.plan_svg import outline_svg, robot_svg
from vinefab.search.record.result import RunArchive
from vinefab.studio.pattern_answers import cut_notes
from vinefab.studio.state import Frame
from vinefab.tasks import make_task
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.reach import touched_targets

LENGTH = "level.0.length"

pytestmark = pytest.mark.filterwarnings("default::ResourceWarning")


@pytest.fixture(scope="module")
def grid(studio):
    return vf.Map.read(studio.folder / "grid.geojson")


# --- What the library says -----------------------------------------------------------------------


def shapes(svg):
    """Return the paths by branch of a robot as the library draws it."""
    return dict(re.findall(r'data-branch="([^"]+)"[^>]*? d="([^"]+)"', svg))


def expected(design, world, pose=None):
    """Return robot, score and outline of a design, from the library alone."""
    deployment = design.grow(world, pose)
    prepared = PreparedMap.of(world)
    score = make_task("coverage", {}).evaluate(deployment, prepared.context)[0]
    flat = pattern_of(design, ChosenRecipe.of(design).profile, known_only=True).flat
    return {
        "robot": shapes(robot_svg(deployment, deployment.tree.width_mm)),
        "score": score,
        "outline": outline_svg(body_outline(flat).contour),
    }


def shows(tab, world, pose=None):
    """Wait until the page shows what the library says of its design, and compare all of it."""
    design, end = None, time.monotonic() + PATIENCE_S
    while True:
        if design != tab.design():
            design = tab.design()
            wanted = expected(design, world, pose)
        score = pytest.approx(wanted["score"], abs=5.1e-4)
        found = tab.robot(), tab.page.evaluate("studio.answers.cut?.outline_svg")
        if found == (wanted["robot"], wanted["outline"]) and tab.score() == score:
            return design
        if time.monotonic() > end:
            assert found == (wanted["robot"], wanted["outline"])
            assert tab.score() == score
        tab.page.wait_for_timeout(50)


MM_PER_PX = "document.querySelector('#map svg.plan').style.getPropertyValue('--mm-per-px')"
LAST_EDIT = "studio.store.get().map.edits.at(-1)"


def start_of(world):
    pose = world.starts[0].pose
    return pose.x_mm, pose.y_mm, pose.heading_deg


def shown_pose(tab):
    return list(tab.page.evaluate("studio.answers.live.pose").values())


def pose_of(state):
    pose = state["pose"]
    return pose["x_mm"], pose["y_mm"], pose["heading_deg"]


# --- Cases ---------------------------------------------------------------------------------------


def test_values_of_the_design_change_robot_score_and_sheet(tab, grid):
    assert shows(tab, grid).name == "twig"
    assert tab.page.locator("#scores .score").count() == 3
    assert "simulated" in tab.page.inner_text("#scores")
    tab.page.wait_for_selector("#verdict:has-text('manufacturable')")
    assert tab.page.locator("#sheet-drawing path").count() >= 5
    assert tab.page.inner_text(".file-name") == "twig"
    before = tab.robot()
    tab.drag(f'input[type=range][data-key="{LENGTH}"]', (18, 0))
    number = tab.page.locator(f'input[type=number][data-key="{LENGTH}"]')
    assert 70.0 != float(number.input_value()) == shows(tab, grid).levels[0].length_mm
    assert tab.robot() != before
    assert tab.page.inner_text(".file-mark") == "● unsaved"
    tab.set(LENGTH, 83.25)
    assert shows(tab, grid).levels[0].length_mm == 83.25
    tab.set(LENGTH, -3)
    assert tab.design().levels[0].length_mm == 83.25
    assert "0.000001 to 10000000 mm" in tab.page.inner_text("#status")
    tab.page.get_by_label("Lock Level 2 Length").click()
    assert number.is_disabled()
    assert tab.state()["locks"] == [LENGTH]


def test_the_start_and_its_heading_are_dragged_and_the_plan_keeps_its_size(tab, grid):
    height = "document.querySelector('#map .canvas').clientHeight"
    x, y = tab.grasp(".pose-layer .base")
    before = tab.page.evaluate(height)
    tab.page.mouse.move(x, y + 60, steps=4)
    tab.page.get_by_text("outside the bounds").first.wait_for()  # a line more below the map
    assert tab.page.evaluate(height) == before
    tab.page.mouse.up()
    tab.painted()
    assert tab.page.evaluate(height) == before, "no jump under the hand"
    tab.page.keyboard.press("ArrowUp")  # a change by key lets it take what room there is
    tab.until(f"(before) => {height} !== before", before)
    for _ in range(2):
        tab.page.keyboard.press("Control+z")

    tab.soon(list(start_of(grid)), lambda: shown_pose(tab))
    tab.drag(".pose-layer .base", (25, -30))
    pose = pose_of(tab.state())
    start = grid.starts[0].pose
    assert pose[0] > start.x_mm
    assert pose[1] > start.y_mm
    shows(tab, grid, pose)
    tab.drag(".pose-layer .heading", (40, 10))
    turned = pose_of(tab.state())
    assert turned[:2] == pose[:2]
    assert turned[2] < pose[2] - 5.0
    shows(tab, grid, turned)
    tab.until(  # the number follows with the next painted frame
        "deg => Math.abs(Number(document.querySelector('#pose-heading_deg').value) - deg) < 0.01",
        turned[2],
    )


def test_a_tip_is_dragged(tab, grid):
    tip = '.robot-layer .mark[data-branch="0.1"]'  # the other arm leans on a wall
    tab.page.wait_for_selector(tip)
    start = tab.drag(tip, (-6, -25), steps=8, drop=False)

    def follows():
        x, y = tab.middle(tip)
        return np.hypot(x - start[0] + 6, y - start[1] + 25) < 10.0

    tab.soon(True, follows, "the tip follows the hand")  # noqa: FBT003
    tab.page.mouse.up()
    level = shows(tab, grid).levels[0]
    assert (level.length_mm, level.fan_rad) != (70.0, np.deg2rad(100.0))


def test_a_dragged_angle_shows_what_must_be_cut_and_how_sensitive_it_is(tab):
    note = tab.page.locator("#note-level-0-angle_deg")
    note.wait_for()  # the first loads the simulation of joints
    before = note.inner_text()
    tab.drag('input[type=range][data-key="level.0.angle_deg"]', (-8, 0), drop=False)
    tab.until("(text) => document.querySelector('.value-note').textContent !== text", before)
    design = tab.design()
    assert design.levels[0].fan_rad != pytest.approx(np.deg2rad(100.0))
    profile = ChosenRecipe.of(design).profile
    patterns = (pattern_of(design, profile, known_only=known) for known in (True, False))
    # The table's words while the hand holds it, those of the simulated joint once it lets go.
    says = [cut_notes(pattern, profile)["level.0.angle_deg"]["text"] for pattern in patterns]
    tab.until("(says) => says.includes(document.querySelector('.value-note').textContent)", says)
    tab.page.mouse.up()
    tab.until("(text) => document.querySelector('.value-note').textContent === text", says[1])
    assert re.fullmatch(r"cut [\d.]+°, x[\d.]+ sensitive", says[1])
    slider = tab.page.locator('input[type=range][data-key="level.0.angle_deg"]')
    assert slider.get_attribute("aria-describedby") == "note-level-0-angle_deg"


MOVES = """(selector) => {
  const [slider, ask, asked] = [document.querySelector(selector), studio.ask, []];
  studio.ask = (panel, ...more) => { asked.push(panel); return ask(panel, ...more); };
  for (let step = 0; step < 20; step++) {
    slider.stepUp();
    slider.dispatchEvent(new Event("input", {bubbles: true}));
  }
  studio.ask = ask;
  return asked.concat(document.querySelector(".stale-notes") ? ["stale"] : []);
}"""
"""Twenty steps of a slider at once, and what the page has asked meanwhile."""


def test_the_sheet_leaves_a_moving_hand_alone_and_follows_one_that_rests(tab, grid):
    slider = f'input[type=range][data-key="{LENGTH}"]'
    tab.drag(slider, (4, 0), drop=False)
    before = shows(tab, grid).levels[0].length_mm
    asked = tab.page.evaluate(MOVES, slider)
    assert "cut" not in asked
    assert "stale" in asked  # the notes on angles
    assert shows(tab, grid).levels[0].length_mm > before  # the hand still holds the slider
    tab.until("() => !document.querySelector('.stale-notes')")


BUSY_MOVES = """(selector) => new Promise((resolve) => {
  const [slider, ask, asked] = [document.querySelector(selector), studio.ask, []];
  studio.ask = (panel, ...more) => { asked.push(panel); return ask(panel, ...more); };
  let step = 0;
  const move = () => {
    if (step++ === 6) { studio.ask = ask; resolve(asked); return; }
    requestAnimationFrame(move);
    slider.stepUp();
    slider.dispatchEvent(new Event("input", {bubbles: true}));
    for (const began = performance.now(); performance.now() - began < 300;);
  };
  requestAnimationFrame(move);
})"""
"""Six moves of a slider, after each of which the page is busy for longer than a hand rests."""


@pytest.mark.thorough
def test_a_busy_page_takes_no_moving_hand_for_one_that_rests(tab):
    slider = f'input[type=range][data-key="{LENGTH}"]'
    tab.drag(slider, (4, 0), drop=False)
    asked = tab.page.evaluate(BUSY_MOVES, slider)
    assert "live" in asked
    assert "cut" not in asked
    tab.until("() => !document.querySelector('.stale-notes')")


@pytest.mark.thorough
def test_the_sheet_shows_the_inflated_body_until_the_design_changes(tab):
    toggle = tab.page.locator("#deployed-toggle")
    toggle.click()
    body = tab.page.locator(".sheet-drawing .inflated")
    body.wait_for()
    assert toggle.get_attribute("aria-pressed") == "true"
    words = tab.page.inner_text("#deployed")
    assert "tips end" in words
    assert "simulated, unverified" in words
    wide = tab.page.evaluate(
        """() => ["inflated", "flat"].map((name) =>
          document.querySelector(`.sheet-drawing .outline .${name}`).getBBox().width)"""
    )
    assert wide[0] == pytest.approx(wide[1], rel=0.2)
    assert tab.page.locator("#deployed table").count() == 3
    tab.drag(f'input[type=range][data-key="{LENGTH}"]', (18, 0), drop=False)
    body.wait_for(state="detached")
    assert tab.page.locator(".sheet-drawing .outline path").count() == 1, "the flat outline follows"
    tab.page.mouse.up()
    body.wait_for()
    toggle.click()
    tab.page.wait_for_selector(".sheet-drawing .job path")
    assert body.count() == 0
    assert tab.page.locator("#deployed").is_hidden()


def test_obstacles_are_moved_added_and_deleted_and_scores_wait_for_the_hand(tab, grid):
    tab.page.evaluate(
        """() => {
          window.seen = [];
          const scores = document.getElementById("scores");
          const note = () => seen.push(scores.classList.contains("stale"));
          new MutationObserver(note).observe(scores, {attributes: true});
        }"""
    )
    tab.drag('[data-obstacle="4"]', (30, 0), drop=False)
    tab.until("() => seen.length > 1 && !seen.at(-1)")  # dimmed, then known: the hand is still down
    assert tab.page.evaluate("seen[0]")
    ((kind, index, dx, dy),) = tab.state()["map"]["edits"]
    assert (kind, index) == ("move", 4)
    assert dx > 5.0
    assert dy == pytest.approx(0.0, abs=1e-6)
    moved = list(grid.obstacles)
    moved[4] = shapely.affinity.translate(moved[4], dx, dy)
    world = replace(grid, obstacles=tuple(moved))
    shows(tab, world)
    tab.page.mouse.up()

    button = tab.page.get_by_role("button", name="Add an obstacle")
    button.focus()
    tab.page.keyboard.press("Enter")  # by key it stands in the middle
    added = tab.state()["map"]["edits"][1]
    shows(tab, replace(grid, obstacles=(*moved, shapely.Polygon(added[1]))))
    tab.until("() => document.querySelectorAll('[data-obstacle]').length === 10")

    tab.page.get_by_role("button", name="Delete it").click()
    assert tab.state()["map"]["edits"][2] == ["remove", 9]
    shows(tab, world)
    tab.until("() => document.querySelectorAll('[data-obstacle]').length === 9")


def test_an_added_obstacle_is_drawn_by_a_drag(tab, grid):
    tab.rest()
    tab.page.get_by_role("button", name="Add an obstacle").click()
    tab.drag(".pose-layer .base", (60, -45), steps=6)  # whatever lies there
    ((kind, corners),) = tab.state()["map"]["edits"]
    assert (kind, tab.state()["pose"]) == ("add", None)
    (x0, y0), (x1, _), (_, y1), _ = corners
    per_px = float(tab.page.evaluate(MM_PER_PX))
    assert (x1 - x0, y1 - y0) == pytest.approx((60 * per_px, 45 * per_px), rel=0.03)
    start = grid.starts[0].pose
    assert (x0, y0) == pytest.approx((start.x_mm, start.y_mm), abs=2.0 * per_px)
    tab.until("() => document.querySelectorAll('[data-obstacle]').length === 10")
    assert tab.page.input_value("#thing") == "obstacle 9", "it is chosen"
    assert tab.page.get_by_role("button", name="Add an obstacle").get_attribute("aria-pressed") == (
        "false"
    )
    tab.page.locator("#undo").click()
    assert tab.state()["map"]["edits"] == [], "a drag is one step"
    tab.page.get_by_role("button", name="Add an obstacle").click()
    tab.page.mouse.click(*tab.middle("#map svg.plan"))  # without a drag: a small one
    assert [kind for kind, _ in tab.state()["map"]["edits"]] == ["add"]


@pytest.mark.thorough
def test_an_obstacle_is_typed_resized_and_turned(tab, grid):
    """Its frame as the library has it, before and after."""
    tab.page.select_option("#thing", "obstacle 4")
    tab.until("() => studio.answers.live.obstacle?.index === 4")
    frame = Frame.around(grid.obstacles[4])
    of_page = "studio.answers.live.obstacle.frame"
    assert tab.page.evaluate(of_page) == pytest.approx(frame.content)
    for key, value in (("x_mm", 140.5), ("width_mm", 33.0), ("turn_deg", 20.0)):
        field = tab.page.locator(f"#obstacle-{key}")
        field.fill(str(value))
        field.press("Enter")
        tab.until(f"([key, value]) => {of_page}[key] === value", [key, value])
    placed = frame.changed(x_mm=140.5, width_mm=33.0, turn_deg=20.0)
    assert tab.page.evaluate(of_page) == pytest.approx(placed.content)
    moved = list(grid.obstacles)
    moved[4] = frame.taken_to(placed, grid.obstacles[4])
    assert Frame.around(moved[4]).content == pytest.approx(placed.content)
    shows(tab, replace(grid, obstacles=tuple(moved)))
    for handle, by in ((".turn", (0, 40)), (".size", (15, -5))):
        tab.rest()
        before = tab.page.evaluate(of_page)
        tab.drag(f".edit-layer {handle}", by)
        tab.until(f"(before) => JSON.stringify({of_page}) !== before", json.dumps(before))
        tab.until(
            f"() => Object.entries({LAST_EDIT}[2]).every(([k, v]) => {of_page}[k] === v)",
        )
    moved[4] = frame.taken_to(Frame(**tab.page.evaluate(of_page)), grid.obstacles[4])
    shows(tab, replace(grid, obstacles=tuple(moved)))
    for _ in range(5):
        tab.page.locator("#undo").click()
    shows(tab, grid)


def test_targets_are_placed_dragged_renamed_removed_and_their_state_is_live(tab, grid):
    mark = '.robot-layer .mark[data-branch="0.1"]'
    tab.rest()
    tip = tab.middle(mark)
    tab.page.get_by_role("button", name="Add a target").click()
    tab.page.mouse.click(tip[0] + 40, tip[1] - 60)
    tab.page.wait_for_selector("#targets:has-text('0 of 1 touched, A missed by')")

    def agrees():
        world = replace(grid, targets=tab.state()["map"]["targets"])
        found = touched_targets([(tab.design().grow(world), world)])
        tab.page.wait_for_selector(f"#targets b:text-is('Targets: {found.headline}')")
        states = [f"{one.target.name} {one.state}" for one in found.outcomes]
        assert tab.page.locator("#targets button").all_inner_texts() == states
        assert tab.page.locator(".target-layer .touched").count() == len(states) - len(found.missed)
        return found

    assert not agrees().all_touched
    tab.rest()
    cross = '.target-layer [data-target="A"] .cross'
    tab.drag(cross, np.subtract(tab.middle(mark), tab.middle(cross)).tolist())
    tab.page.wait_for_selector("#targets:has-text('1 of 1 touched')")
    assert agrees().all_touched
    for key, value in (("tolerance_mm", "7.5"), ("name", "shelf")):
        field = tab.page.locator(f"#target-{key}")
        field.fill(value)
        field.press("Enter")
    tab.page.wait_for_selector('[data-target="shelf"]')
    tab.page.get_by_role("button", name="Add a target").focus()
    tab.page.keyboard.press("Enter")  # by key it stands in the middle
    agrees()
    names = [one["name"] for one in tab.state()["map"]["targets"]]
    assert names == ["shelf", "A"]
    assert tab.state()["map"]["targets"][0]["tolerance_mm"] == 7.5
    tab.page.get_by_role("button", name="Delete it").click()
    tab.until("() => studio.store.get().map.targets.length === 1")
    agrees()
    tab.page.locator("#undo").click()
    assert [one["name"] for one in tab.state()["map"]["targets"]] == names


@pytest.mark.thorough
def test_scale_bar_cursor_measure_snap_and_legend(tab):
    tab.page.select_option("#snap", "10")
    tab.drag(".pose-layer .base", (23, -31))
    x, y, _ = pose_of(tab.state())
    assert (x % 10.0, y % 10.0) == (0.0, 0.0)
    tab.rest()
    perpx = float(tab.page.evaluate(MM_PER_PX))
    bar = tab.page.locator(".scale-bar")
    assert tab.box(".scale-bar")["width"] * perpx == pytest.approx(
        float(bar.inner_text().removesuffix(" mm")), rel=0.01
    )
    tab.page.get_by_role("button", name="Measure").click()
    tab.drag("#map svg.plan", (80, 0))
    words = tab.page.locator(".tool-layer text").text_content()
    assert float(words.split(" mm")[0]) == pytest.approx(80 * perpx, abs=10.0)
    assert words.endswith("0°")
    assert len(tab.state()["map"]["edits"]) == 0, "nothing is moved while a way is measured"
    tab.page.mouse.move(*tab.middle(".pose-layer .base"))
    assert tab.page.inner_text(".cursor").startswith(f"{x:.0f}")
    tab.page.locator(".legend summary").click()
    assert tab.page.locator(".legend li:visible").count() >= 10
    assert tab.page.evaluate(MEASURED)["covers"] == 0
    tab.page.locator(".legend summary").click()


def test_the_ground_is_of_the_state_however_fast_it_changes(tab, grid):
    walls = tab.page.locator("#map [data-obstacle]")
    tab.rest()
    tab.page.evaluate(
        """() => {
          globalThis.seen = 0;
          studio.onAnswer("live", () => { seen += 1; });
          studio.store.change("", (state) => { state.map.edits.push(["remove", 0]); });
          studio.store.undo();
        }"""
    )
    tab.until("() => seen >= 2")
    tab.soon(len(grid.obstacles), walls.count)


def test_names_of_targets_are_not_cut_by_the_edge_of_the_plan(tab, grid):
    right = grid.bounds.bounds[2]
    targets = [
        {"name": "a shelf with a long name", "point_mm": [right - 10, 50], "tolerance_mm": 5}
    ]
    tab.page.set_viewport_size({"width": 390, "height": 844})
    tab.page.evaluate(
        "(targets) => studio.store.change('', (s) => { s.map.targets = targets; })", targets
    )
    name = tab.page.locator(".target-layer text", has_text="missed")
    name.wait_for()
    tab.painted()
    right_of = "(one) => one.getBoundingClientRect().right"
    assert name.evaluate(right_of) <= tab.page.locator("#map svg.plan").evaluate(right_of)


@pytest.mark.thorough
def test_how_sure_scores_are_is_asked_for_once_the_hand_is_away(tab):
    tab.rest()
    tab.set(LENGTH, 71)
    tab.grasp("#map svg.plan")
    tab.page.wait_for_timeout(1000)  # longer than answers rest before it is asked for
    tab.page.mouse.up()
    tab.rest()


SHOWN = """(kind) => [...document.querySelectorAll(`.sheet-drawing .job path${kind}`)]
  .filter((part) => part.checkVisibility()).length"""
AT_REST = """(least) => document.querySelector("#sheet").ariaBusy === "false"
  && document.querySelectorAll(".sheet-drawing .job path[data-piece]").length > 0
  && document.querySelectorAll("#sheet-piece option").length > least"""


@pytest.mark.thorough
def test_layers_and_pieces_of_the_sheet_are_switched(tab):
    pieces = tab.state()["design"]  # its outer fans lie on each other
    pieces["level"] = [
        {**pieces["level"][0], "length": 160.0, "angle_deg": angle_deg}
        for angle_deg in (60.0, 250.0)
    ]
    build = {"widths_mm": [30.0, 20.0, 14.0], "fillet_mm": [4.0, 3.0]}
    pieces["build"] |= {**build, "pieces": {"most": 6}, "compensation": "none"}
    tab.page.evaluate("(design) => studio.store.change('', (s) => { s.design = design; })", pieces)
    tab.until(AT_REST, 2)
    tab.page.locator("#layers summary").click()
    piece = tab.page.locator("#sheet-piece option").nth(1).get_attribute("value")
    others = f'[data-piece]:not([data-piece="{piece}"], [data-piece=""])'
    assert tab.page.evaluate(SHOWN, others) > 0
    tab.page.select_option("#sheet-piece", piece)
    assert tab.page.evaluate(SHOWN, others) == 0
    assert tab.page.evaluate(SHOWN, f'[data-piece="{piece}"]') > 0
    tab.page.select_option("#sheet-piece", "")
    assert tab.page.evaluate(SHOWN, ".weldcut") > 0
    tab.page.locator("[data-layer=weldcut]").uncheck()
    assert tab.page.evaluate(SHOWN, ".weldcut") == 0
    assert tab.page.evaluate(SHOWN, "[data-piece]") > 0
    tab.set("trunk.length", pieces["trunk"]["length"] + 1)  # the next drawing keeps to it
    tab.page.wait_for_selector("#sheet[aria-busy=true]")
    tab.until(AT_REST, 0)
    assert tab.page.evaluate(SHOWN, ".weldcut") == 0


GROWN = """([count, share]) => {
  const paths = [...document.querySelectorAll(".robot-layer path[data-branch]")];
  const {front_mm, full_mm} = studio.answers.front ?? {};
  return new Set(paths.map((path) => path.dataset.branch)).size === count
    && Math.abs(front_mm / full_mm - share) < 1e-3;
}"""


def test_the_length_grown_shows_what_is_out_then(tab, grid):
    """Every branch is as long as the front is past its base, and not longer than it grows."""
    final = robot_svg(tab.design().grow(grid), tab.design().tree.width_mm)
    (full_mm,) = (float(text) for text in re.findall(r'data-full="([^"]+)"', final))
    span = r'data-branch="([^"]+)" data-base="([^"]+)" data-grown="([^"]+)"'
    spans = set(re.findall(span, final))  # of bodies and centrelines
    assert len(spans) == 3
    for share in (250, 700):
        tab.page.locator("#front").fill(str(share))
        front_mm = full_mm * share / 1000
        out_mm = {name: min(front_mm - float(base), float(grown)) for name, base, grown in spans}
        wanted = {name: length for name, length in out_mm.items() if length > 0.0}
        tab.until(GROWN, [len(wanted), share / 1000])
        drawn = {name: length_mm(path) for name, path in tab.robot().items()}
        assert drawn == pytest.approx(wanted, abs=0.01)
        assert f"of {full_mm:.0f} mm" in tab.page.inner_text("output[for=front]")
    tab.page.locator("#front").fill("1000")
    shows(tab, grid)


def length_mm(path):
    """Return the length of a path of lines: pairs of numbers, y turned over."""
    points = np.array(re.findall(r"-?[\d.]+", path), dtype=float).reshape(-1, 2)
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


FIX = """(design) => {
  const {ask} = studio;
  const found = {
    design, lines: ["wider"], changes: ["level 2: wider"], keep: [], keep_words: [], scores: [],
    scores_note: "no map is open",
  };
  studio.ask = async (panel, ...more) => panel === "fix" ? found : ask(panel, ...more);
}"""
"""The search for a fix takes seconds: here it finds a design at once."""


def test_a_finding_appears_and_its_fix_is_previewed_before_it_is_taken(tab):
    tab.page.evaluate(FIX, tab.state()["design"])
    tab.page.wait_for_selector("#verdict:has-text('✓ manufacturable')")
    tab.set("build.widths_mm.1", 3)
    tab.page.wait_for_selector("#verdict:has-text('✕ not manufacturable')")
    finding = tab.page.locator('#findings li.error[data-rule="VF-W01"]').first
    finding.locator("button").first.click()
    detail = finding.locator(".detail").inner_text()
    assert "measured" in detail
    assert "limit" in detail
    tab.page.locator("#fix:enabled").click()
    tab.page.wait_for_selector("#fix-take")
    narrow = tab.state()["design"]
    assert narrow["build"]["widths_mm"][1] == 3, "a preview changes nothing"
    assert tab.page.evaluate("studio.previewed.build.widths_mm[1]") == 14
    assert tab.page.locator(".fix .changes li").all_inner_texts() == ["level 2: wider"]
    tab.page.locator("#fix-take").click()
    tab.page.wait_for_selector("#verdict:has-text('✓ manufacturable')")
    assert tab.page.locator("#findings li.error").count() == 0
    assert tab.state()["design"]["build"]["widths_mm"][1] == 14
    tab.page.locator("#undo").click()
    assert tab.state()["design"] == narrow


def test_undo_and_redo_go_over_everything(tab, grid):
    steps = [tab.state()]

    def did(action):
        action()
        steps.append(tab.state())
        assert steps[-1] != steps[-2]

    did(lambda: tab.drag(f'input[type=range][data-key="{LENGTH}"]', (10, 0), steps=9))
    did(lambda: tab.drag(".pose-layer .base", (15, -10), steps=9))
    did(lambda: tab.drag('[data-obstacle="3"]', (9, 4), steps=9))
    did(lambda: tab.page.get_by_role("button", name="Add a level").click())
    did(lambda: tab.page.get_by_label("Lock Trunk Length").click())
    for step in reversed(steps[:-1]):
        tab.page.keyboard.press("Control+z")
        assert tab.state() == step, "a drag is one step"
    assert tab.page.locator("#undo").is_disabled()
    shows(tab, grid)
    for step in steps[1:]:
        tab.page.locator("#redo").click()
        assert tab.state() == step
    assert tab.page.locator("#redo").is_disabled()


def test_saving_keeps_the_comments_and_the_file_is_followed(tab, twig, grid):
    tab.set(LENGTH, 75)
    tab.page.keyboard.press("Control+s")
    tab.page.wait_for_selector(".file-mark:has-text('saved'):not([data-dirty=true])")
    assert twig.read_text() == TWIG.replace("length = 70.0 ", "length = 75.0 ")
    # An editor beside it: the page follows, and undo goes back.
    twig.write_text(TWIG.replace("length = 70.0 ", "length = 66.0 "))
    tab.until("() => studio.store.get().design.level[0].length === 66")
    shows(tab, grid)
    tab.page.locator("#undo").click()
    assert tab.state()["design"]["level"][0]["length"] == 75
    twig.write_text("schema = [\n")
    tab.page.wait_for_selector(".file-note:has-text('twig.toml')")
    line = tab.page.inner_text("#status")
    assert "twig.toml" in line
    assert "\n" not in line
    tab.set(LENGTH, 72)
    shows(tab, grid)


def test_two_tabs_do_not_overwrite_each_other(open_tab, twig):
    one, other = open_tab(), open_tab()
    one.set(LENGTH, 71)
    other.set(LENGTH, 64)
    one.page.keyboard.press("Control+s")
    one.page.wait_for_selector(".file-mark:not([data-dirty=true])")
    mine = twig.read_text()
    assert "length = 71.0 " in mine
    other.page.wait_for_selector(".file-note:has-text('unsaved changes')")
    other.page.get_by_role("button", name="Save", exact=True).click()
    other.page.get_by_role("button", name="Keep mine").last.wait_for()
    assert twig.read_text() == mine, "nothing is written before somebody has said so"
    other.page.locator("dialog[open]").get_by_role("button", name="Keep mine").click()
    other.page.wait_for_selector(".file-mark:not([data-dirty=true])")
    assert "length = 64.0 " in twig.read_text()
    one.until("() => studio.store.get().design.level[0].length === 64")


@pytest.mark.thorough
def test_a_reload_in_the_middle_of_a_drag_keeps_the_state_and_the_token(tab, studio, grid):
    assert tab.page.url == f"{studio.origin}/"
    tab.drag(".pose-layer .base", (30, -20), drop=False)
    state = tab.state()
    assert state["pose"] is not None
    tab.page.reload()
    tab.page.wait_for_selector("#scores .score")
    assert tab.state()["pose"] == state["pose"]
    assert tab.state()["design"] == state["design"]
    shows(tab, grid, pose_of(state))
    beside = TabSession(tab.page.context.new_page()).open(f"{studio.origin}/")
    beside.page.close()
    assert beside.problems == []


def test_a_reload_keeps_what_can_be_undone(tab):
    steps = [tab.state()]
    for value in (75, 80, 85):
        tab.set(LENGTH, value)
        steps.append(tab.state())
    tab.page.keyboard.press("Control+z")
    tab.page.reload()
    tab.page.wait_for_selector("#scores .score")
    assert tab.state() == steps[2]
    for step in (steps[1], steps[0]):
        tab.page.locator("#undo").click()
        assert tab.state() == step
    assert tab.page.locator("#undo").is_disabled()
    for step in steps[1:]:
        tab.page.locator("#redo").click()
        assert tab.state() == step


@pytest.mark.thorough
def test_a_server_that_ends_and_one_that_starts_anew(tmp_path, start_studio, open_context):
    (tmp_path / "twig.toml").write_text(TWIG)
    page = open_context().new_page()
    with start_studio(tmp_path, "twig.toml") as first:
        page.goto(f"{first.origin}/")
        page.wait_for_selector("text=Open the whole address")  # no token yet
        tab = TabSession(page).open(first.address)
        tab.set(LENGTH, 81)
        assert first.interrupt() == 0
        page.wait_for_selector("html[data-connection=down]")
        assert "does not answer" in page.inner_text("#status")
        tab.set(LENGTH, 82)
        with start_studio(tmp_path, "twig.toml", "--port", first.port) as after:
            page.wait_for_selector("#status:has-text('started anew')")
            assert tab.state()["design"]["level"][0]["length"] == 82
            page.goto(f"{after.origin}/")  # with the token of the server before
            page.wait_for_selector("text=Open the whole address")
            tab.open(after.address)
            assert page.url == f"{after.origin}/"
    page.close()
    # The browser itself says in the console that it could not connect, or was refused.
    refused = "Failed to load", "WebSocket connection"
    assert [text for text in tab.problems if not text.startswith(refused)] == []


def test_many_walls(tab, studio):
    rocks = [
        shapely.box(25 * i, 25 * j, 25 * i + 9, 25 * j + 9) for i in range(20) for j in range(14)
    ]
    world = vf.Map(
        name="walls",
        bounds=shapely.box(-30, -30, 520, 370),
        obstacles=tuple(rocks),
        starts=(vf.Start(pose=vf.Pose.of((17.0, -10.0, 80.0))),),
    )
    world.write(studio.folder / "walls.geojson")
    tab.page.keyboard.press("Control+o")
    tab.page.locator("dialog[open] .choice", has_text="walls").click()
    tab.until("() => document.querySelectorAll('[data-obstacle]').length === 280")
    shows(tab, world)
    tab.drag(".pose-layer .base", (2, -20))
    shows(tab, world, pose_of(tab.state()))


def test_export(tab, studio):
    tab.set(LENGTH, 77)
    tab.page.get_by_role("button", name="Export", exact=True).click()
    box = tab.page.locator('[data-export="picture"]')
    out = box.locator("input[type=text]").first
    out.fill("drawn.svg")
    box.get_by_role("button", name=re.compile("^Write")).click()
    box.locator(".result:has-text('Written')").wait_for()
    written = studio.folder / "drawn.svg"
    assert "<svg" in written.read_text()
    box.locator("code.command:has-text('vinefab')").wait_for()


def test_late_answers_are_dropped(tab):
    """The order of the link, through the page's own module, with a socket that this test plays."""
    assert tab.page.evaluate(
        """async () => {
          const sockets = [];
          const Real = WebSocket;
          globalThis.WebSocket = class {
            static OPEN = 1;
            readyState = 1;
            sent = [];
            constructor() { sockets.push(this); }
            send(text) { this.sent.push(JSON.parse(text)); }
          };
          const {createConnection} = await import("studio/connection.js");
          const connection = createConnection("t", {onEvent() {}, onState() {}});
          globalThis.WebSocket = Real;
          const [socket] = sockets;
          const told = [];
          const note = (name, promise) => promise.then(
            (found) => told.push([name, found.answer]),
            (error) => told.push([name, error.stale ? "stale" : "error"]));
          for (const name of ["a", "b", "c"]) note(name, connection.ask("live", {}, {name}));
          const say = (message) => socket.onmessage({data: JSON.stringify(message)});
          const first = socket.sent[0].seq;
          say({panel: "live", seq: first + 7, answer: "late"});
          say({panel: "rules", seq: first, answer: "of another panel"});
          say({panel: "live", seq: first, answer: "A"});
          say({panel: "live", seq: first, answer: "twice"});
          await 0; await 0;
          say({panel: "live", seq: socket.sent[1].seq, answer: "C"});
          await new Promise((done) => setTimeout(done));
          return [told, socket.sent.map((one) => one.state?.name ?? "hello")];
        }"""
    ) == [[["b", "stale"], ["a", "A"], ["c", "C"]], ["a", "c"]]


def test_a_search_takes_map_and_targets_of_the_page_and_says_what_the_command_says(tab, studio):
    search = tab.page.locator("#search")
    tab.page.get_by_role("tab", name="Search").click()
    tab.until("() => document.getElementById('search-maps').value === 'shown'")
    assert tab.page.input_value("#search-task") == "coverage"

    # An unedited generated map is the page's map, too: the first choice, and what is taken.
    tab.page.evaluate(
        "() => studio.store.change('', (s) => { s.map = {source: {environment: 'grid', seed: 3,"
        " options: {columns: 2, rows: 2, size_mm: 300}}, edits: []}; s.pose = null; })"
    )
    tab.painted()
    tab.soon("shown", lambda: tab.page.input_value("#search-maps"))
    first = tab.page.locator("#search-maps option").first
    assert first.inner_text() == "the map on this page"

    tab.page.evaluate(
        """() => studio.store.change("", (state) => {
          const points = [["A", 150, 60], ["B", 150, 100], ["C", 20, 180]];
          state.map.targets = points.map(([name, ...point_mm]) =>
            ({name, point_mm, tolerance_mm: 20}));
        })"""
    )
    tab.soon("reach", lambda: tab.page.input_value("#search-task"))
    assert tab.page.input_value("#search-maps") == "shown"
    for name, value in (("population", 4), ("generations", 2)):
        tab.page.fill(f"#search-{name}", str(value))
        tab.page.press(f"#search-{name}", "Tab")
    tab.page.uncheck("#search-fabricable")
    tab.page.fill("#search-folder", "run_targets")
    tab.page.press("#search-folder", "Tab")
    search.get_by_role("button", name="Start", exact=True).click()
    tab.page.wait_for_selector(
        "#search .card [data-state=ended]:has-text('run_targets')", timeout=3000 * PATIENCE_S
    )
    archive = RunArchive.read(studio.folder / "run_targets" / "run.sqlite")
    assert archive.settings.task.name == "reach"
    assert [[one.name for one in world.targets] for world in archive.maps] == [["A", "B", "C"]]
    result = archive.result()
    said = search.locator(".best .value")
    tab.soon(result.targets.headline, said.inner_text)
    assert re.match(r"\d of 3 touched", result.targets.headline)
    assert result.answer.text.startswith(result.targets.headline), "as the command ends"


def test_a_search_is_started_and_stopped(tab, studio):
    tab.page.get_by_role("tab", name="Search").click()
    start = tab.page.locator("#search").get_by_role("button", name="Start", exact=True)
    folder = tab.page.locator("#search-folder")
    tab.until("() => document.getElementById('search-folder').value !== ''")
    for name, value in (("population", 4), ("generations", 200)):
        tab.page.locator(f"#search-{name}").fill(str(value))
        tab.page.locator(f"#search-{name}").press("Tab")
    folder.fill("run_page")
    folder.press("Tab")
    start.click()
    card = "#search .card [data-state={}]:has-text('run_page')"
    tab.page.wait_for_selector(card.format("running"))
    tab.page.locator("#search").get_by_role("button", name="Stop", exact=True).click()
    tab.page.wait_for_selector(card.format("stopped"))
    assert (studio.folder / "run_page").is_dir()


# --- Keyboard and screen readers ------------------------------------------------------------------

REACHED = """() => {
  const shown = (node) => node.checkVisibility({visibilityProperty: true}) && !node.disabled
    && !node.closest("[inert]");
  const wanted = [...document.querySelectorAll(
    "a[href], button, input, select, textarea, summary, [tabindex='0']")]
    .filter((node) => shown(node) && node.tabIndex >= 0);
  globalThis.reached = new Set();
  addEventListener("focusin", (event) => reached.add(event.target), true);
  globalThis.missed = () => wanted.filter((node) => node.isConnected && !reached.has(node))
    .map((node) => node.outerHTML.slice(0, 120));
  return wanted.length;
}"""


def test_every_control_has_a_name_and_is_reached_by_tab(tab):
    tab.rest()
    count = tab.page.evaluate(REACHED)
    assert count > 60
    for stops in range(count + 5):
        if tab.page.evaluate("document.activeElement.matches('#map svg.plan')"):
            assert stops <= 12, "few stops lead to the map"
        tab.page.keyboard.press("Tab")
    assert tab.page.evaluate("missed()") == []

    tab.page.evaluate(
        "for (const one of document.querySelectorAll('[role=tabpanel]')) one.hidden = false"
    )
    session = tab.page.context.new_cdp_session(tab.page)
    session.send("Accessibility.enable")
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    kinds = {
        "button", "slider", "spinbutton", "textbox", "combobox", "checkbox", "tab", "link",
        "application", "searchbox", "radio", "listbox",
    }  # fmt: skip
    controls = [node for node in nodes if node.get("role", {}).get("value") in kinds]
    assert len(controls) > 60
    nameless = [node for node in controls if not node.get("name", {}).get("value", "").strip()]
    assert [node["role"]["value"] for node in nameless] == []


def test_arrow_keys_move_handles_and_obstacles(tab, grid):
    tab.page.locator(".pose-layer .base").focus()
    tab.page.keyboard.press("ArrowUp")
    tab.until("() => studio.store.get().pose?.y_mm === studio.answers.live.pose.y_mm")
    tab.page.keyboard.press("Shift+ArrowRight")
    start = grid.starts[0].pose
    x, y, _ = pose_of(tab.state())
    assert (x, y) == pytest.approx((start.x_mm + 10.0, start.y_mm + 1.0))
    shows(tab, grid, pose_of(tab.state()))
    assert tab.page.evaluate("document.activeElement.classList.contains('base')")
    slider = tab.page.locator(f'input[type=range][data-key="{LENGTH}"]')
    slider.focus()
    slider.press("ArrowRight")
    assert tab.design().levels[0].length_mm == 71.0


@pytest.mark.thorough
def test_ten_arrows_are_ten_steps(tab):
    """Every edit is a function of the state: keys wait for no answer."""
    target = {"name": "A", "point_mm": [60.0, 150.0]}
    tab.page.evaluate(
        "(one) => studio.store.change('', (s) => { s.map.targets = [one]; })",
        target,
    )
    tab.page.wait_for_selector('.target-layer [data-target="A"]')
    tab.rest()

    def press(key):
        for _ in range(10):
            tab.page.keyboard.press(key)
            tab.page.wait_for_timeout(33)

    tab.page.select_option("#thing", "target A")
    tab.page.locator("#map svg.plan").focus()
    press("ArrowRight")
    assert tab.state()["map"]["targets"][0]["point_mm"] == [70.0, 150.0]

    x, y, _ = tab.page.evaluate("Object.values(studio.answers.live.source.pose)")
    tab.page.locator(".pose-layer .base").focus()
    press("ArrowUp")
    assert pose_of(tab.state())[:2] == pytest.approx((x, y + 10.0))
    tab.page.locator(".pose-layer .heading").focus()
    press("ArrowLeft")
    assert pose_of(tab.state()) == pytest.approx((x, y + 10.0, 100.0))

    tab.page.select_option("#thing", "obstacle 4")
    tab.page.locator("#map svg.plan").focus()
    press("ArrowDown")
    edits = tab.state()["map"]["edits"]
    assert sum(dy for _, index, _, dy in edits if index == 4) == -10.0

    slider = tab.page.locator(f'input[type=range][data-key="{LENGTH}"]')
    slider.focus()
    press("ArrowRight")
    assert tab.design().levels[0].length_mm == 80.0


MEASURED = """() => {
  const seen = (node) => node.checkVisibility({visibilityProperty: true})
    && node.closest("header, main");
  const box = (node) => node.getBoundingClientRect();
  const name = (node) => node.getAttribute("aria-label") || node.textContent || node.id;
  const buttons = [...document.querySelectorAll("button, select, input, summary")].filter(seen);
  const small = buttons.filter((node) => {
    const isBox = node.type === "checkbox";
    const {width, height} = box(isBox ? node.closest("label, .field, span") : node);
    return width < 24 || height < 24;
  });
  const heads = [...document.querySelectorAll("header button")].filter(seen).map(box);
  const overlaps = heads.filter((one, index) => heads.slice(index + 1).some((two) =>
    one.left < two.right && two.left < one.right && one.top < two.bottom && two.top < one.bottom));
  const {left, top, right, bottom} = box(document.querySelector("#map svg.plan"));
  const around = [...document.querySelectorAll("#map .zoom, #map .rulers > *, #map .legend")];
  const map = document.getElementById("map");
  const cut = [map, ...map.children].filter((one) => one.scrollWidth > one.clientWidth + 1);
  return {
    covers: around.map(box).filter((one) => one.left < right && left < one.right
      && one.top < bottom - 1 && top < one.bottom).length,
    cut: cut.filter(seen).map((one) => one.className),
    small: small.map(name), overlaps: overlaps.length,
    wide: document.documentElement.scrollWidth, map: [left, top, right, bottom],
  };
}"""


WINDOWS = (
    (1280, 800, 400),
    (1024, 768, 350),
    (800, 1000, 350),
    (390, 844, 200),
    (640, 400, 190),  # 1280 x 800 at 200 %
)
"""Width, height, and the least height of the map in it."""


@pytest.mark.thorough
def test_the_map_is_in_view_at_every_width(tab):
    tab.page.locator("#theme").click()
    assert tab.page.get_attribute("html", "data-theme") == "dark"
    tab.rest()
    for width, height, least in WINDOWS:
        if tab.page.locator("#tab-side").is_visible():
            tab.page.get_by_role("tab", name="Design").click()
        tab.page.set_viewport_size({"width": width, "height": height})
        tab.painted()
        found = tab.page.evaluate(MEASURED)
        assert found["small"] == [], width
        assert found["overlaps"] == 0, width
        assert found["wide"] <= width
        assert found["covers"] == 0, f"{width}: the map is covered"
        assert found["cut"] == [], width
        left, top, right, bottom = found["map"]
        assert 0 <= left < right <= width
        assert bottom - top >= least, width
        assert bottom <= height
        assert tab.page.locator("#design").is_visible()
        if width <= 1150:
            tab.page.get_by_role("tab", name="Sheet").click()
        assert tab.box("#sheet-drawing")["width"] > 200
        assert tab.page.evaluate(MEASURED)["map"] == [left, top, right, bottom], "it stays in view"
        for selector in ("#files", "#export", "#undo", "#theme"):
            box = tab.box(selector)
            assert box["x"] >= 0
            assert box["x"] + box["width"] <= width


def test_pictures_of_pages_fit_a_narrow_window_and_scroll_at_full_size(tab, tmp_path):
    wide = b'<svg xmlns="http://www.w3.org/2000/svg" width="740" height="90" viewBox="0 0 74 9"/>'
    path = tmp_path / "report.html"
    path.write_text(html_page("A rig", [Picture(image=wide, caption="plan")]))
    tab.page.set_viewport_size({"width": 390, "height": 844})
    tab.page.goto(path.as_uri())
    width = "document.querySelector('figure img').getBoundingClientRect().width"
    assert tab.page.evaluate(width) <= 390
    tab.page.get_by_role("button", name="Full size").click()
    assert tab.page.evaluate(width) == 740
    assert tab.page.evaluate("document.documentElement.scrollWidth") == 390
    tab.page.set_viewport_size(WINDOW)
    assert not tab.page.get_by_role("button", name="Full size").is_visible()


def test_growth_options_are_seen_and_changed_in_one_place(tab, grid):
    tab.page.get_by_role("button", name="By which rules?").click()
    for key, value in (
        ("head_on_half_angle_deg", 15),
        ("body", "centerline"),
        ("pressure_stop", False),
    ):
        if isinstance(value, bool):
            tab.page.locator(f"#growth-{key}").uncheck()
        elif isinstance(value, int):
            number = tab.page.locator(f'#growth input[type=number][data-key="{key}"]')
            assert float(number.input_value()) == GrowthOptions().values[key]
            number.fill(str(value))
            number.press("Enter")
        else:
            tab.page.select_option(f"#growth-{key}", value)
        assert tab.state()["growth"] == {key: value}
        options = GrowthOptions.of({key: value})
        wanted = robot_svg(
            tab.design().grow(grid, growth={key: value}),
            options.drawn_widths_mm(tab.design().tree),
        )
        tab.until(
            "([key, value]) => studio.answers.live.growth.values[key] === value", [key, value]
        )
        assert tab.robot() == shapes(wanted)
        assert growth_text(options, [tab.design()]) in tab.page.inner_text("#growth")
        tab.page.get_by_role("button", name="As usual for this design").click()
        assert tab.state()["growth"] == {}


@pytest.mark.thorough
def test_the_comparison_folds_away_until_something_changed(tab):
    summary = tab.page.locator("#compare summary")
    assert not summary.is_visible()
    tab.set(LENGTH, 95)
    tab.page.wait_for_selector("#compare summary:has-text('coverage')")
    assert not tab.page.locator("#compare table").first.is_visible()
    summary.click()
    assert tab.page.locator("#compare .now").first.is_visible()
    tab.page.get_by_role("tab", name="Many maps").click()
    tab.page.wait_for_selector("#family .tile")
    assert tab.page.locator("#map").is_hidden()
