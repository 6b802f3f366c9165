"""The files of the page in a real browser: opening, saving, changes on disk, unsaved work."""

import pytest

from tests.studio.conftest import TWIG
from vinefab.maps import generate
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate
from vinefab.model.map import Map, map_text


def with_length(length):
    return TWIG.replace("length = 90.0 ", f"length = {length} ")


def set_length(tab, length_mm):
    tab.page.evaluate(
        "mm => studio.store.change('length', (state) => { state.design.trunk.length = mm; })",
        length_mm,
    )


def length(tab):
    return tab.page.evaluate("studio.store.get().design.trunk.length")


def test_a_design_is_found_by_keys_and_undo_goes_back_to_its_file(twig, tab):
    page = tab.page
    assert tab.shown() == ("twig", "saved")
    page.keyboard.press("Control+o")
    page.wait_for_selector("dialog[open] .choice")
    page.keyboard.type("plain dragon")
    tab.soon(0, lambda: page.locator("dialog[open] .choice").count())
    page.fill("#open-search", "plain_v")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    tab.soon(("plain_vine", "read only"), tab.shown)
    # A design that is read only is saved under another name.
    set_length(tab, 333.0)
    page.keyboard.press("Control+s")
    page.fill("#save-path", "twig")
    page.keyboard.press("Enter")
    problem = "dialog[open] .problem"
    tab.soon("twig.toml exists (twig).", lambda: page.text_content(problem))
    page.fill("#save-path", "../other")
    page.keyboard.press("Enter")
    page.wait_for_selector(f"{problem}:text('path:')")
    page.fill("#save-path", "vine")
    page.keyboard.press("Enter")
    tab.soon(("vine", "saved"), tab.shown)
    written = twig.with_name("vine.toml").read_text()
    assert 'name = "vine"' in written
    assert "length = 333.0" in written
    for _ in range(3):
        page.keyboard.press("Control+z")
    assert tab.shown() == ("twig", "saved")
    assert length(tab) == 90.0
    assert twig.read_text() == TWIG


def test_both_sides_of_a_conflict_can_be_taken(twig, tab):
    set_length(tab, 130.0)
    twig.write_text(with_length(140.0).replace("to be dragged", "by another"))
    tab.page.click(".file-note button:text('Keep mine')")
    assert tab.shown() == ("twig", "unsaved")
    tab.page.keyboard.press("Control+s")
    tab.soon(("twig", "saved"), tab.shown)
    assert twig.read_text() == with_length(130.0).replace("to be dragged", "by another")
    set_length(tab, 150.0)
    twig.write_text(TWIG)
    tab.page.click(".file-note button:text('Take it')")
    assert (length(tab), tab.shown()) == (90.0, ("twig", "saved"))
    tab.page.keyboard.press("Control+z")
    assert (length(tab), tab.shown()) == (150.0, ("twig", "unsaved"))
    tab.page.keyboard.press("Control+s")
    tab.soon(("twig", "saved"), tab.shown)


@pytest.fixture
def sources(studio):
    """A map and a recipe of the folder."""
    (studio.folder / "own.geojson").write_text(map_text(generate("grid", 3)))
    recipe = locate("recipe", DEFAULT_RECIPE).read_text()
    (studio.folder / "laser.toml").write_text(recipe.replace(f'"{DEFAULT_RECIPE}"', '"laser"', 1))
    return studio.folder / "own.geojson", studio.folder / "laser.toml"


@pytest.mark.thorough
def test_map_and_recipe_are_read_anew_when_they_change_on_disk(sources, tab):
    on_disk, laser = sources
    tab.page.evaluate(
        """async () => {
          const { source } = await studio.request("open_map", { path: "own.geojson" });
          const { recipe } = await studio.request("open_recipe", { recipe: "laser.toml" });
          studio.store.change("an edit", (state) => {
            Object.assign(state, { map: { source, edits: [["remove", 0]] }, recipe });
          });
        }"""
    )
    walls = tab.page.locator("#map [data-obstacle]")
    tab.soon(len(generate("grid", 3).obstacles) - 1, walls.count)
    other = generate("grid", 4, columns=3, rows=3)
    on_disk.write_text(map_text(other))
    tab.soon(len(other.obstacles) - 1, walls.count)
    tab.page.click(".file-note button:text('Drop my changes')")
    tab.soon(len(other.obstacles), walls.count)
    tab.until("() => document.querySelector('#sheet').ariaBusy === 'false'")
    tab.page.evaluate(
        "() => { globalThis.ruled = 0; studio.onAnswer('rules', () => { ruled += 1; }); }"
    )
    assert tab.page.evaluate("ruled") == 1  # the last answer is told at once
    laser.write_text(laser.read_text() + "# looked at\n")
    tab.until("() => ruled > 1")
    said = "document.querySelector('#status').textContent"
    tab.until(f"() => {said}.includes('laser.toml changed on disk')")


def test_unsaved_work_outlives_its_tab_and_is_offered_once(studio, twig, open_tab):
    tab = open_tab()
    set_length(tab, 160.0)
    kept = studio.folder / "profiles" / "studio"
    tab.soon(1, lambda: len(list(kept.glob("*"))))
    beside = open_tab(context=tab.page.context)
    beside.page.wait_for_timeout(900)  # as long as other tabs have to answer
    held = beside.page.locator(".file-note")
    assert held.count() == 1, "the tab that it belongs to is open"
    assert held.get_attribute("data-note") == "other"
    assert "Another tab holds unsaved work: twig (twig.toml)" in held.inner_text()
    tab.page.context.close()
    after = open_tab()
    after.page.wait_for_selector(".file-note")
    assert "twig (twig.toml)" in after.page.text_content(".file-note")
    after.page.click(".file-note button:text('Open it')")
    wanted = (160.0, ("twig", "unsaved"))
    after.soon(wanted, lambda: (length(after), after.shown()))
    after.page.reload()
    after.page.wait_for_selector("html[data-ready=true]")
    after.soon(wanted, lambda: (length(after), after.shown()))
    after.page.keyboard.press("Control+s")
    after.soon(("twig", "saved"), after.shown)
    assert twig.read_text() == with_length(160.0)
    after.soon([], lambda: list(kept.glob("*")))


@pytest.mark.thorough
def test_a_tab_says_when_the_work_of_another_is_saved(open_tab):
    tab = open_tab()
    set_length(tab, 160.0)
    tab.until("() => studio.request('autosaves').then((found) => found.autosaves.length === 1)")
    beside = open_tab(context=tab.page.context)
    beside.page.wait_for_selector(".file-note[data-note=other]")
    tab.page.keyboard.press("Control+s")
    beside.page.wait_for_selector(".file-note[data-note=other]", state="detached")


@pytest.mark.thorough
def test_unsaved_work_of_another_folder_is_a_copy(tmp_path, start_studio, open_tab, twig):
    """Another project's file of the same name stays as it is, byte for byte."""
    other = with_length(120.0).replace("to be dragged", "of another project")
    folder = tmp_path / "beside"
    folder.mkdir()
    (folder / "twig.toml").write_text(other)
    tab = open_tab()
    set_length(tab, 160.0)
    tab.until("() => studio.request('autosaves').then((found) => found.autosaves.length === 1)")
    tab.page.context.close()
    profiles = {"VINEFAB_PROFILES": str(twig.parent / "profiles")}
    with start_studio(folder, "twig.toml", extra=profiles) as studio:
        beside = open_tab(studio.address)
        beside.page.wait_for_selector(f".file-note:has-text('{twig}')")
        beside.page.click(".file-note button:text('Open a copy')")
        beside.soon(160.0, lambda: length(beside))
        beside.soon(("twig", "unsaved"), beside.shown)
        beside.page.keyboard.press("Control+s")  # it has no file: a name is asked for
        beside.page.wait_for_selector("#save-path")
        assert beside.page.input_value("#save-path") == "twig.toml"
        beside.page.keyboard.press("Enter")
        beside.page.wait_for_selector("dialog[open] .problem:has-text('twig.toml exists')")
        assert (folder / "twig.toml").read_text() == other
        beside.page.fill("#save-path", "copied")
        beside.page.keyboard.press("Enter")
        beside.soon(("copied", "saved"), beside.shown)
        assert "length = 160.0" in (folder / "copied.toml").read_text()
        assert (folder / "twig.toml").read_text() == other
        beside.page.keyboard.press("Control+z")
        beside.page.evaluate("studio.remember = () => {}")
        beside.page.close()
    assert twig.read_text() == TWIG


@pytest.mark.thorough
def test_work_on_a_file_that_was_changed_since_asks_before_it_is_saved(open_tab, twig):
    tab = open_tab()
    set_length(tab, 160.0)
    tab.until("() => studio.request('autosaves').then((found) => found.autosaves.length === 1)")
    tab.page.context.close()
    twig.write_text(with_length(140.0))
    after = open_tab()
    after.page.click(".file-note button:text('Open it')")
    after.soon(160.0, lambda: length(after))
    after.page.keyboard.press("Control+s")
    after.page.wait_for_selector("dialog[open]:has-text('changed outside')")
    assert twig.read_text() == with_length(140.0)


@pytest.mark.thorough
def test_a_moved_start_is_unsaved_work_until_it_is_saved_with_the_map(studio, open_tab):
    tab = open_tab()
    assert "●" not in tab.page.title()
    pose = {"x_mm": 150.0, "y_mm": 40.0, "heading_deg": 80.0}
    tab.page.evaluate("(pose) => studio.store.change('', (s) => { s.pose = pose; })", pose)
    assert "●" in tab.page.title()
    tab.until("() => studio.request('autosaves').then((found) => found.autosaves.length === 1)")
    tab.page.evaluate(
        "() => studio.store.change('', (s) => { s.map = {source: {environment: 'grid', seed: 5},"
        " edits: []}; })"
    )
    tab.page.get_by_role("button", name="Save map").click()
    tab.page.fill("#save-map-path", "started")
    tab.page.keyboard.press("Enter")
    tab.until("() => studio.store.get().map.source.file === 'started.geojson'")
    assert "●" not in tab.page.title()
    start = Map.read(studio.folder / "started.geojson").starts[0].pose
    assert (start.x_mm, start.y_mm) == (150.0, 40.0)


def test_changes_of_the_map_alone_are_unsaved_work_and_a_map_is_saved(studio, open_tab):
    world = generate("pegs", 1)
    tab = open_tab()
    tab.page.evaluate(
        """() => studio.store.change("", (state) => {
          const targets = [{name: "A", point_mm: [150, 150], tolerance_mm: 20}];
          state.map = {source: {environment: "pegs", seed: 1}, edits: [["remove", 0]], targets};
        })"""
    )
    assert "●" in tab.page.title()
    tab.until("() => studio.request('autosaves').then((found) => found.autosaves.length === 1)")
    tab.page.context.close()
    after = open_tab()
    after.page.click(".file-note button:text('Open it')")
    after.until("() => studio.store.get().map.edits.length === 1")
    after.page.get_by_role("button", name="Save map").click()
    after.page.wait_for_selector("dialog[open] #save-map-path")  # it has no file yet
    after.page.fill("#save-map-path", "saved")
    after.page.keyboard.press("Enter")
    after.until("() => studio.store.get().map.source.file === 'saved.geojson'")
    after.until("() => studio.store.get().map.edits.length === 0")
    assert "●" not in after.page.title()
    saved = Map.read(studio.folder / "saved.geojson")
    assert len(saved.obstacles) == len(world.obstacles) - 1
    assert [one.name for one in saved.targets] == ["A"]
    after.until("() => studio.answers.live.targets.length === 1")

    # Into the same file: what was done by numbers of obstacles is not done twice by undo.
    edit = "studio.store.change('', (s) => { s.map.edits = [['remove', 0]]; })"
    after.page.evaluate(edit)
    after.page.get_by_role("button", name="Save map").click()
    after.until("() => studio.store.get().map.edits.length === 0")
    assert len(Map.read(studio.folder / "saved.geojson").obstacles) == len(world.obstacles) - 2
    walls = after.page.locator("#map [data-obstacle]")
    after.soon(len(world.obstacles) - 2, walls.count)
    after.page.keyboard.press("Control+z")
    assert after.state()["map"]["source"] == {"environment": "pegs", "seed": 1}
    after.page.keyboard.press("Control+y")
    after.soon(len(world.obstacles) - 2, walls.count)

    # Changed outside meanwhile: nothing is overwritten before somebody has said so.
    after.page.evaluate(edit)
    text = map_text(world)
    (studio.folder / "saved.geojson").write_text(text)
    after.page.wait_for_selector("text=/changed on disk; your 1 changes/")
    after.page.get_by_role("button", name="Save map").click()
    after.page.wait_for_selector("dialog[open] .problem:has-text('changed outside')")
    assert (studio.folder / "saved.geojson").read_text() == text
