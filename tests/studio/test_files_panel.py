"""The files of the page in a real browser: opening, saving, changes on disk, unsaved work."""

import time

import pytest

from vinefab.maps import generate
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate
from vinefab.model.map import map_text

MINE = """\
# by hand
schema = "vinefab/design-1"
name = "mine"
[trunk]
length = 120.0  # mm
[[level]]
branches = 3
length = 90.0  # BL
"""


@pytest.fixture(scope="module")
def studio(tmp_path_factory, start_studio):
    folder = tmp_path_factory.mktemp("files")
    (folder / "mine.toml").write_text(MINE)
    (folder / "grid.geojson").write_text(map_text(generate("grid", 3)))
    recipe = locate("recipe", DEFAULT_RECIPE).read_text()
    (folder / "laser.toml").write_text(recipe.replace(f'"{DEFAULT_RECIPE}"', '"laser"', 1))
    arguments = ("mine.toml", "--map", "grid.geojson", "--recipe", "laser.toml")
    with start_studio(folder, *arguments) as running:
        yield running


@pytest.fixture
def mine(studio):
    """The file that the command names, as it was; nothing unsaved."""
    for left in (studio.folder / "profiles").glob("studio/*"):
        left.unlink()
    path = studio.folder / "mine.toml"
    path.write_text(MINE)
    return path


@pytest.fixture
def open_tab(studio, browser):
    contexts, problems = [], []

    def open_one(context=None):
        if context is None:
            context = browser.new_context(viewport={"width": 1280, "height": 800})
            context.set_default_timeout(15_000)
            contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(studio.address)
        page.wait_for_selector("html[data-ready=true]")
        return page

    yield open_one
    for context in contexts:
        context.close()
    assert problems == []


def soon(page, wanted, found):
    """Wait until something is so; the page's policy forbids texts that are evaluated in it."""
    end = time.monotonic() + 15
    while (now := found()) != wanted:
        assert time.monotonic() < end, (now, wanted, page.text_content("#status"))
        page.wait_for_timeout(40)


def set_length(page, length_mm):
    page.evaluate(
        "mm => studio.store.change('length', (state) => { state.design.trunk.length = mm; })",
        length_mm,
    )


def length(page):
    return page.evaluate("studio.store.get().design.trunk.length")


def shown(page):
    """Return the name of the open file, and what stands beside it."""
    return page.text_content(".file-name"), page.text_content(".file-mark").removeprefix("● ")


def test_a_design_is_found_by_keys_and_undo_goes_back_to_its_file(mine, open_tab):
    page = open_tab()
    assert shown(page) == ("mine", "saved")
    page.keyboard.press("Control+o")
    page.wait_for_selector("dialog[open] .choice")
    page.keyboard.type("plain dragon")
    soon(page, 0, lambda: page.locator("dialog[open] .choice").count())
    page.fill("#open-search", "plain_v")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    soon(page, ("plain_vine", "read only"), lambda: shown(page))
    # A design that is read only is saved under another name.
    set_length(page, 333.0)
    page.keyboard.press("Control+s")
    page.fill("#save-path", "mine")
    page.keyboard.press("Enter")
    soon(page, "mine.toml exists (mine).", lambda: problem(page))
    page.fill("#save-path", "../other")
    page.keyboard.press("Enter")
    page.wait_for_selector("dialog[open] .problem:text('path is')")
    page.fill("#save-path", "vine")
    page.keyboard.press("Enter")
    soon(page, ("vine", "saved"), lambda: shown(page))
    written = mine.with_name("vine.toml").read_text()
    assert 'name = "vine"' in written
    assert "length = 333.0" in written
    for _ in range(3):
        page.keyboard.press("Control+z")
    assert shown(page) == ("mine", "saved")
    assert length(page) == 120.0
    assert mine.read_text() == MINE


def problem(page):
    return page.text_content("dialog[open] .problem")


def test_both_sides_of_a_conflict_can_be_taken(mine, open_tab):
    page = open_tab()
    set_length(page, 130.0)
    mine.write_text(MINE.replace("120.0", "140.0").replace("by hand", "by another"))
    page.click(".file-note button:text('Keep mine')")
    assert shown(page) == ("mine", "unsaved")
    page.keyboard.press("Control+s")
    soon(page, ("mine", "saved"), lambda: shown(page))
    assert mine.read_text() == MINE.replace("120.0", "130.0").replace("by hand", "by another")
    set_length(page, 150.0)
    mine.write_text(MINE)
    page.click(".file-note button:text('Take it')")
    assert (length(page), shown(page)) == (120.0, ("mine", "saved"))
    page.keyboard.press("Control+z")
    assert (length(page), shown(page)) == (150.0, ("mine", "unsaved"))
    page.keyboard.press("Control+s")
    soon(page, ("mine", "saved"), lambda: shown(page))


@pytest.mark.usefixtures("mine")
def test_map_and_recipe_are_read_anew_when_they_change_on_disk(studio, open_tab):
    page = open_tab()
    page.evaluate(
        """() => {
        globalThis.answers = { live: 0, rules: 0 };
        for (const panel of ["live", "rules"]) {
            studio.onAnswer(panel, () => { answers[panel] += 1; });
        }
        studio.store.change("an edit", (state) => { state.map.edits.push(["remove", 0]); });
    }"""
    )
    walls = page.locator("#map [data-obstacle]")
    count = len(generate("grid", 3).obstacles)
    soon(page, count - 1, walls.count)
    other = generate("grid", 4, columns=3, rows=3)
    (studio.folder / "grid.geojson").write_text(map_text(other))
    soon(page, len(other.obstacles) - 1, walls.count)
    page.click(".file-note button:text('Drop my changes')")
    soon(page, len(other.obstacles), walls.count)
    page.wait_for_timeout(600)
    before = page.evaluate("answers.rules")
    laser = studio.folder / "laser.toml"
    laser.write_text(laser.read_text() + "# looked at\n")
    soon(page, before + 1, lambda: min(before + 1, page.evaluate("answers.rules")))
    said = "laser.toml changed on disk"
    soon(page, True, lambda: said in page.text_content("#status"))  # noqa: FBT003  as compared


def test_unsaved_work_outlives_its_tab_and_is_offered_once(studio, mine, open_tab):
    page = open_tab()
    set_length(page, 160.0)
    kept = studio.folder / "profiles" / "studio"
    soon(page, 1, lambda: len(list(kept.glob("*"))))
    beside = open_tab(page.context)
    beside.wait_for_timeout(900)
    # The tab that it belongs to is open.
    assert beside.locator(".file-note").count() == 0
    page.context.close()
    after = open_tab()
    assert "mine (mine.toml)" in after.text_content(".file-note")
    after.click(".file-note button:text('Open it')")
    soon(after, (160.0, ("mine", "unsaved")), lambda: (length(after), shown(after)))
    after.reload()
    after.wait_for_selector("html[data-ready=true]")
    soon(after, (160.0, ("mine", "unsaved")), lambda: (length(after), shown(after)))
    after.keyboard.press("Control+s")
    soon(after, ("mine", "saved"), lambda: shown(after))
    assert mine.read_text() == MINE.replace("120.0", "160.0")
    soon(after, [], lambda: list(kept.glob("*")))
