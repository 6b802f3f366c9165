"""One branch under the hand: chosen, dragged, typed, bent, added, removed, mirrored, saved."""

import numpy as np
import pytest

import vinefab as vf
from tests.studio.test_page import shows

pytestmark = pytest.mark.filterwarnings("default::ResourceWarning")

FREE = """# A robot, branch by branch.
schema = "vinefab/design-1"
name = "free"

[trunk]
length = 70.0   # up to the fork

# To the left wall.
[[branch]]
name = "left"
angle_deg = 50.0   # by hand
length = 60.0

# Around the corner.
[[branch]]
name = "right"
angle_deg = -40.0
length = 80.0
bends = [[40.0, 40.0]]

[build]
trunk_width_mm = 16.0   # a thin one
pressure_kpa = 20.0
"""
OPEN = {"x_mm": 150.0, "y_mm": 60.0, "heading_deg": 90.0}
"""A start on a map without obstacles, where no branch meets a wall."""

REDRAWN = """for (const part of document.querySelectorAll(".robot-layer [data-branch]")) {
  part.replaceWith(part.cloneNode(true));
}"""


@pytest.fixture(scope="module")
def free_studio(tmp_path_factory, start_studio):
    """A server in a folder with a design of branches and a map with nothing on it."""
    folder = tmp_path_factory.mktemp("branches")
    (folder / "free.toml").write_text(FREE)
    world = vf.maps.grid(2, columns=3, rows=3, size_mm=300)
    vf.Map(name="open", bounds=world.bounds, starts=world.starts).write(folder / "open.geojson")
    with start_studio(folder, "free.toml", "--map", "open.geojson") as started:
        yield started
        assert "Traceback" not in started.said()


@pytest.fixture
def world(free_studio):
    return vf.Map.read(free_studio.folder / "open.geojson")


@pytest.fixture
def tab(free_studio, open_tab):
    (free_studio.folder / "free.toml").write_text(FREE)
    opened = open_tab(free_studio.address)
    opened.page.evaluate(
        "(pose) => studio.store.change('start', (state) => { state.pose = pose; })", OPEN
    )
    return opened


def pose():
    return OPEN["x_mm"], OPEN["y_mm"], OPEN["heading_deg"]


def tip(design, world, name):
    """Return where the library says that a branch ends."""
    grown = design.grow(world, pose())
    return grown.chain_mm(design.names.index(name))[-1]


def branch(tab, name):
    return {one.name: one for one in tab.design().branches}[name]


def choose(tab, name):
    """Choose a branch from the list, and wait for the library's words on it."""
    tab.page.select_option("#thing", f"branch {name}")
    tab.until("(name) => studio.answers.live.branch?.label === name", name)


def number(tab, label):
    return tab.page.locator("#branch").get_by_label(label, exact=True)


MM_PER_PX = "document.querySelector('#map svg.plan').style.getPropertyValue('--mm-per-px')"


def on_screen(tab, place_mm):
    """Return where a place of the map is seen."""
    return tab.page.evaluate(
        """([x, y]) => {
          const svg = document.querySelector("#map svg.plan");
          const at = new DOMPoint(x, -y).matrixTransform(svg.getScreenCTM());
          return [at.x, at.y];
        }""",
        list(map(float, place_mm)),
    )


def test_a_branch_is_chosen_by_a_click_and_its_numbers_are_typed(tab, world):
    shows(tab, world, pose())
    tab.rest()
    left = tab.design().grow(world, pose()).chain_mm(2)
    tab.page.mouse.click(*on_screen(tab, left.mean(axis=0)))
    tab.page.wait_for_selector("#branch h2:has-text('Branch left')")
    assert tab.page.evaluate("document.querySelectorAll('.line .chosen').length") == 1
    assert tab.page.input_value("#thing") == "branch left"
    tab.until("() => document.querySelector('#branch .facts').textContent.includes('60.0 of 60.0')")
    for label, key, value in (
        ("Angle", "angle_deg", 63.5),
        ("Length", "length_mm", 41.25),
        ("Width", "width_mm", 7.5),
        ("Taper", "taper", 0.8),
        ("Fillet", "fillet_mm", 2.5),
    ):
        field = number(tab, label)
        field.fill(str(value))
        field.press("Enter")
        assert getattr(branch(tab, "left"), key) == value
    shows(tab, world, pose())
    tab.page.get_by_role("button", name="Branch left Width as its level").click()
    assert branch(tab, "left").width_mm is None
    tab.page.select_option("#branch-pouch", "round")
    assert branch(tab, "left").pouch.shape == "round"
    tab.page.select_option("#branch-pouch", "none")
    assert branch(tab, "left").pouch is False
    shows(tab, world, pose())


def test_a_dragged_tip_changes_its_branch_alone_and_is_one_step(tab, world):
    shows(tab, world, pose())
    tab.rest()
    before = tab.design()
    mark = '.robot-layer .mark[data-branch="0.1"]'  # the left one
    tab.drag(mark, (30, -12), steps=6)
    per_px = float(tab.page.evaluate(MM_PER_PX))
    wanted = tip(before, world, "left") + np.array([30.0, 12.0]) * per_px

    def is_there():
        return bool(np.hypot(*(tip(tab.design(), world, "left") - wanted)) < 3.0 * per_px)

    tab.soon(True, is_there, "the tip follows the hand")  # noqa: FBT003
    after = shows(tab, world, pose())
    assert after.branches[1] == before.branches[1]
    assert after.trunk == before.trunk
    assert tab.page.input_value("#thing") == "branch left", "it is chosen"
    tab.page.locator("#undo").click()
    assert tab.design() == before
    tab.page.locator("#redo").click()
    assert shows(tab, world, pose()) == after


def test_arrow_keys_move_the_tip_and_none_is_lost(tab, world):
    before = tip(shows(tab, world, pose()), world, "right")
    choose(tab, "right")
    tab.page.locator("#map svg.plan").focus()
    for key in ("ArrowUp",) * 5 + ("Shift+ArrowLeft",) + ("ArrowRight",) * 3:
        tab.page.keyboard.press(key)
    wanted = before + np.array([-7.0, 5.0])

    def is_there():
        return bool(np.hypot(*(tip(tab.design(), world, "right") - wanted)) < 0.3)

    tab.soon(True, is_there, "every press counts")  # noqa: FBT003
    assert branch(tab, "right").bends == ((40.0, 40.0),)
    shows(tab, world, pose())


def test_a_bend_is_made_dragged_typed_and_removed(tab, world):
    shows(tab, world, pose())
    tab.rest()
    left = tab.design().grow(world, pose()).chain_mm(2)
    mouse = tab.page.mouse
    mouse.move(*on_screen(tab, left[0] + 0.5 * (left[-1] - left[0])))
    mouse.down()
    mouse.up()
    mouse.down(click_count=2)
    tab.page.evaluate(REDRAWN)  # as an answer does that comes while the branch is pressed
    mouse.up(click_count=2)
    tab.soon(1, lambda: len(branch(tab, "left").bends or ()))
    ((at_mm, turn_deg),) = branch(tab, "left").bends
    assert at_mm == pytest.approx(30.0, abs=1.5)
    assert turn_deg == 0.0
    tab.page.wait_for_selector(".edit-layer .bend")
    tab.rest()
    ends = shows(tab, world, pose()).grow(world, pose()).chain_mm(2)
    tab.drag(".edit-layer .bend", (18, -8), steps=5)
    tab.until("() => studio.store.get().design.branch[0].bends[0][1] !== 0")
    after = shows(tab, world, pose()).grow(world, pose()).chain_mm(2)
    assert len(after) == 3
    assert after[[0, -1]] == pytest.approx(ends[[0, -1]], abs=0.1), "base and tip stay"
    turn = number(tab, "turn")
    turn.fill("-35")
    turn.press("Enter")
    assert branch(tab, "left").bends[0][1] == -35.0
    shows(tab, world, pose())
    tab.page.get_by_role("button", name="Remove bend 1").click()
    assert branch(tab, "left").bends is None
    tab.page.get_by_role("button", name="Add a bend").click()  # as a keyboard does
    tab.soon(1, lambda: len(branch(tab, "left").bends or ()))


def test_branches_are_added_mirrored_and_removed_with_all_that_grow_from_them(tab, world):
    shows(tab, world, pose())
    first = tab.design()
    choose(tab, "right")
    tab.page.get_by_role("button", name="Add a child").click()
    tab.page.wait_for_selector("#branch h2:has-text('Branch right-0')")
    assert branch(tab, "right-0").of == "right"
    choose(tab, "right")
    tab.page.get_by_role("button", name="Mirror").click()
    tab.page.wait_for_selector("#branch h2:has-text('Branch right-m0')")
    assert {one.name for one in tab.design().branches} == {
        "left", "right", "right-0", "right-m0", "right-0-m0"
    }  # fmt: skip
    shows(tab, world, pose())
    tab.page.locator("#map svg.plan").focus()
    tab.page.keyboard.press("Delete")
    tab.soon(3, lambda: len(tab.design().branches))
    assert branch(tab, "right-0").of == "right"
    for _ in range(3):
        tab.page.locator("#undo").click()
    assert shows(tab, world, pose()) == first
    assert tab.page.locator("#branch").is_hidden() or "trunk" in tab.page.input_value("#thing")


def test_what_is_typed_wrong_is_one_line_with_the_branch_and_the_way_out(tab, world):
    choose(tab, "right")
    length = number(tab, "Length")
    length.fill("-5")
    length.press("Enter")
    line = tab.page.inner_text("#status")
    assert "Branch right Length is -5; type 0.000001 to 10000000 mm" in line
    assert branch(tab, "right").length_mm == 80.0
    length.fill("30")
    length.press("Enter")
    tab.page.wait_for_selector("#status[data-kind=error]:has-text('bends of branch')")
    line = tab.page.inner_text("#status")
    assert "bends of branch 'right' is 40.0; allowed: bends on the branch, which is 30 mm" in line
    tab.page.locator("#undo").click()
    shows(tab, world, pose())


def test_a_saved_branch_leaves_the_comments_of_the_others(tab, free_studio):
    choose(tab, "left")
    length = number(tab, "Length")
    length.fill("52.5")
    length.press("Enter")
    choose(tab, "right")
    tab.page.get_by_role("button", name="Add a bend").click()
    tab.soon(2, lambda: len(branch(tab, "right").bends))
    assert tab.shown()[1] == "unsaved"
    tab.page.get_by_role("button", name="Save", exact=True).click()
    tab.soon("saved", lambda: tab.shown()[1])
    text = (free_studio.folder / "free.toml").read_text()
    changed = FREE.replace("length = 60.0", "length = 52.5")
    assert vf.Design.read(free_studio.folder / "free.toml") == tab.design()
    assert [line for line in text.splitlines() if "bends" not in line] == [
        line for line in changed.splitlines() if "bends" not in line
    ]


@pytest.mark.thorough
def test_a_design_of_levels_is_freed_and_then_each_branch_moves_alone(open_tab, studio):
    tab, world = open_tab(studio.address), vf.Map.read(studio.folder / "grid.geojson")
    before = shows(tab, world)
    tab.rest()
    tab.page.select_option("#thing", "branch 0.1")
    tab.page.wait_for_selector("#branch dd:has-text('70 mm')")
    panel = tab.page.locator("#branch")
    assert panel.locator("input").count() == 0, "its level has the numbers"
    assert panel.get_by_role("button", name="Remove").is_hidden()
    panel.get_by_role("button", name="Free this design").click()
    tab.page.wait_for_selector("#branch h2:has-text('Branch 1')")
    assert shows(tab, world) == before.by_branches
    tab.rest()
    tab.drag('.robot-layer .mark[data-branch="0.1"]', (-6, -25), steps=5)
    tab.until("() => studio.store.get().design.branch[1].length !== 70")
    after = shows(tab, world)
    assert after.branches[0] == before.by_branches.branches[0]
    while tab.design().branches is not None:
        tab.page.locator("#undo").click()
    assert shows(tab, world) == before
    assert tab.page.locator("#branch").is_hidden()


def test_controls_of_a_branch_have_names_and_are_large_enough_for_fingers(tab):
    choose(tab, "right")
    found = tab.page.evaluate(
        """[...document.querySelectorAll("#branch button, #branch input, #branch select")]
          .filter((one) => one.checkVisibility()).map((one) => {
            const {width, height} = one.getBoundingClientRect();
            const name = one.ariaLabel || one.labels?.[0]?.textContent || one.textContent;
            return [name.trim(), width, height];
          })"""
    )
    assert len(found) > 15
    assert all(name for name, _, _ in found)
    assert [one for one in found if min(one[1:]) < 24.0] == []
    tab.page.set_viewport_size({"width": 390, "height": 844})
    box, window = tab.box("#branch"), tab.page.evaluate("innerWidth")
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= window


def test_a_search_is_offered_the_chosen_branch_alone(tab, world):
    shows(tab, world, pose())
    tab.page.evaluate(
        """() => {
          const {request} = studio;
          studio.request = (name, ask) => {
            if (name !== "search_start") return request(name, ask);
            globalThis.sent = ask;
            return new Promise(() => {});
          };
        }"""
    )
    choose(tab, "right")
    tab.page.click("#tab-search")
    tab.page.check("#search-only")
    assert "only branch right" in tab.page.inner_text("label[for=search-only]")
    tab.page.click("#search button:has-text('Start')")
    tab.until("() => globalThis.sent?.only === 'right'")
    tab.page.uncheck("#search-here")
    assert not tab.page.is_visible("#search-only")
