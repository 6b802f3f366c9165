import asyncio
import json
import os
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest

from vinefab.core.atomic import write_text
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    ForeignFileError,
    UnreadableFileError,
    VinefabError,
)
from vinefab.core.plain_text import GENERATOR
from vinefab.maps import generate
from vinefab.model.design import Design, design_content, design_text
from vinefab.model.files.run_context import RunRecipe, recipe_digest
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate
from vinefab.model.map import Map, Pose, map_text
from vinefab.studio.file_store import FILE_REQUESTS, MOST_AUTOSAVES, FileStore, autosave_folder

MINE = """\
# by hand
schema = "vinefab/design-1"
name = "mine"
[trunk]
length = 120.0  # mm
[[level]]
branches = 3
length = 90.0
angle_deg = 33.333333333333336  # a third
"""


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("VINEFAB_PROFILES", str(tmp_path / "own"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "mine.toml").write_text(MINE)
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def store(folder):
    return FileStore(folder)


def opened(store: FileStore, name: str = "mine.toml") -> dict:
    return store.open_design({"design": name})


def with_length(content: dict, length_mm: float) -> dict:
    return {**content, "trunk": {"length": length_mm}}


def test_a_design_is_opened_changed_and_saved_with_its_comments(store, folder):
    file = opened(store)
    assert file["writable"]
    assert file["path"] == "mine.toml"
    assert file["text"] == MINE
    answer = store.save_design(
        {"path": "mine.toml", "design": with_length(file["design"], 130), "stamp": file["stamp"]}
    )
    assert answer["saved"]
    # The page shows the third rounded: that is no change.
    assert (folder / "mine.toml").read_text() == MINE.replace("120.0", "130.0")
    assert opened(store)["stamp"] == answer["stamp"]
    again = {"path": "mine.toml", "design": with_length(file["design"], 9), **answer}
    assert store.save_design(again)["saved"]


def test_a_file_changed_elsewhere_is_left_alone_unless_forced(store, folder):
    file = opened(store)
    theirs = MINE.replace("120.0", "77.0").replace("# by hand", "# by another hand")
    (folder / "mine.toml").write_text(theirs)
    ask = {"path": "mine.toml", "design": with_length(file["design"], 130), "stamp": file["stamp"]}
    answer = store.save_design(ask)
    assert (answer["saved"], answer["why"]) == (False, "changed")
    assert answer["design"]["trunk"]["length"] == 77.0
    assert (folder / "mine.toml").read_text() == theirs
    assert store.save_design({**ask, "force": True})["saved"]
    assert (folder / "mine.toml").read_text() == theirs.replace("77.0", "130.0")


def test_tabs_that_save_at_once_never_overwrite_each_other(store):
    file = opened(store)

    def save(length_mm: float) -> dict:
        content = with_length(file["design"], length_mm)
        return store.save_design({"path": "mine.toml", "design": content, "stamp": file["stamp"]})

    with ThreadPoolExecutor(4) as threads:
        answers = list(threads.map(save, [1.0, 2.0, 3.0, 4.0]))
    won = [length for length, answer in zip([1, 2, 3, 4], answers, strict=True) if answer["saved"]]
    assert [opened(store)["design"]["trunk"]["length"]] == won


def test_a_broken_version_on_disk_is_a_conflict_and_keeping_mine_keeps_the_comments(store, folder):
    file = opened(store)
    (folder / "mine.toml").write_text("half a fi")
    ask = {"path": "mine.toml", "design": with_length(file["design"], 130), "stamp": file["stamp"]}
    answer = store.save_design(ask)
    assert not answer["saved"]
    assert answer["design"] is None
    assert "not TOML" in answer["problem"]
    forced = store.save_design({**ask, "force": True})
    assert "broken" in forced["note"]
    assert (folder / "mine.toml").read_text() == MINE.replace("120.0", "130.0")
    assert (folder / "mine.toml.old").read_text() == "half a fi"


@pytest.mark.parametrize("text", ["my diary", map_text(generate("grid", 3)), 'schema = "x"'])
def test_what_is_no_design_is_never_replaced(store, folder, text):
    (folder / "diary.toml").write_text(text)
    ask = {"path": "diary.toml", "design": opened(store)["design"], "force": True}
    with pytest.raises(VinefabError, match="not a design"):
        store.save_design(ask)
    assert (folder / "diary.toml").read_text() == text


def test_a_saved_design_counts_as_changed_by_hand(store, folder):
    write_text(folder / "mine.toml", f"# {GENERATOR}\n{MINE}", force=True)
    file = opened(store)
    store.save_design(
        {"path": "mine.toml", "design": with_length(file["design"], 130), "stamp": file["stamp"]}
    )
    with pytest.raises(ForeignFileError, match="changed"):
        write_text(folder / "mine.toml", f"# {GENERATOR}\n{MINE}")


@pytest.mark.parametrize("text", ["Infinity", "NaN", "1e999", "9" * 30, '"\\ud800"', "[" * 900])
def test_odd_recovery_files_are_refused_in_one_line(store, text):
    path = Path(store.keep_autosave({"key": "tab00001", "state": {"a": 1}, "file": None})["kept"])
    path.write_text(path.read_text().replace('"a": 1', f'"a": {text}'))
    with pytest.raises(VinefabError, match="recovery-tab00001"):
        store.open_autosave({"key": "tab00001"})
    assert store.autosaves({}) == {"autosaves": []}


def test_a_file_that_went_is_written_again_with_its_comments(store, folder):
    file = opened(store)
    (folder / "mine.toml").unlink()
    ask = {"path": "mine.toml", "design": file["design"], "stamp": file["stamp"]}
    assert store.save_design(ask)["saved"]
    assert (folder / "mine.toml").read_text() == MINE


def test_save_as_takes_the_comments_along_and_asks_before_it_replaces(store, folder):
    shipped = opened(store, "grid_explorer_levels")
    assert not shipped["writable"]
    assert shipped["path"] == "grid_explorer_levels"
    ask = {"path": "copy.toml", "design": shipped["design"], "from": "grid_explorer_levels"}
    assert store.save_design(ask)["saved"]
    assert (folder / "copy.toml").read_text() == locate(
        "design", "grid_explorer_levels"
    ).read_text()
    (folder / "other.toml").write_text(MINE)
    answer = store.save_design({**ask, "path": "other.toml"})
    assert (answer["saved"], answer["why"]) == (False, "exists")
    assert (folder / "other.toml").read_text() == MINE
    assert store.save_design({**ask, "path": "new.toml", "from": None})["saved"]
    assert Design.read(folder / "new.toml") == Design.read("grid_explorer_levels")


def test_shipped_and_own_designs_are_never_overwritten(folder, tmp_path):
    designs = tmp_path / "own" / "designs"
    designs.mkdir(parents=True)
    (designs / "kept.toml").write_text(MINE)
    store = FileStore(folder, [designs / "kept.toml"])
    for path in (designs / "kept.toml", locate("design", "grid_explorer_levels")):
        file = opened(store, str(path))
        assert not file["writable"]
        before = path.read_text()
        with pytest.raises(BadInputError, match=r"path: .*(leads out of|read only)"):
            store.save_design({"path": str(path), "design": file["design"], "force": True})
        assert path.read_text() == before
    assert opened(store, "kept")["design"]["name"] == "mine"


def outside_paths(folder, tmp_path) -> list[str]:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "secret.toml").write_text(MINE)
    (folder / "link.toml").symlink_to(outside / "secret.toml")
    (folder / "folder").symlink_to(outside)
    (folder / "round").symlink_to(folder / "round")
    os.mkfifo(folder / "pipe.toml")
    return [
        "../outside/secret.toml",
        str(outside / "secret.toml"),
        "link.toml",
        "folder/secret.toml",
        "round",
        "pipe.toml",
        "/proc/self/environ",
        "/proc/self/mem",
        "/dev/zero",
        "/etc/passwd",
        ".",
        "",
        "a\0b",
        "\ud800.toml",
        "a" * 5000,
        "b" * 300 + ".toml",
        "~/x.toml",
    ]


def test_nothing_outside_the_folders_is_read_or_written(store, folder, tmp_path):
    design = opened(store)["design"]
    for path in outside_paths(folder, tmp_path):
        for refused in (
            lambda path=path: store.open_design({"design": path}),
            lambda path=path: store.open_map({"path": path}),
            lambda path=path: store.open_recipe({"recipe": path}),
            lambda path=path: store.check_paths({"map": {"source": {"file": path}}}),
            lambda path=path: store.check_paths({"family": {"files": [path]}}),
        ):
            with pytest.raises(VinefabError) as error:
                refused()
            assert "\n" not in str(error.value)
            assert len(str(error.value)) < 2000
        if path != "~/x.toml":
            with pytest.raises(VinefabError):
                store.save_design({"path": path, "design": design, "force": True})
    with pytest.raises(BadInputError, match="recipe"):
        store.check_paths({"recipe": "../outside/secret.toml"})
    assert (tmp_path / "outside" / "secret.toml").read_text() == MINE
    for wrong in (None, 7, ["mine.toml"], {"a": 1}):
        with pytest.raises(VinefabError):
            store.open_design({"design": wrong})
    store.check_paths({"design": {}, "map": None, "family": {"files": None}, "recipe": None})
    store.check_paths({"recipe": "co2_60w__stretchlon_200"})


def test_files_named_on_the_command_line_open_their_folders(folder, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "robot.toml").write_text(MINE)
    (elsewhere / "grid.geojson").write_text("{}")
    store = FileStore(folder, [elsewhere / "robot.toml"])
    assert opened(store, str(elsewhere / "robot.toml"))["writable"]
    store.check_paths({"map": {"source": {"file": str(elsewhere / "grid.geojson")}}})


def test_a_path_that_was_checked_is_checked_again(store, folder, tmp_path, monkeypatch):
    state = {"family": {"files": ["a.geojson"]}}
    (folder / "a.geojson").write_text("{}")
    store.check_paths(state)
    (folder / "a.geojson").unlink()
    (folder / "a.geojson").symlink_to(tmp_path / "other.geojson")
    (tmp_path / "other.geojson").write_text("{}")
    later = time.monotonic() + 1.1
    monkeypatch.setattr("vinefab.studio.file_store.monotonic", lambda: later)
    with pytest.raises(BadInputError, match=r"family\.files"):
        store.check_paths(state)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"\xff\xfe", "is not UTF-8 text"),
        (b"name = [", "is not TOML"),
        (b'schema = "vinefab/design-1"\nname = "x"\n', "trunk is missing"),
        (b"a" * 2_000_000, "is larger than 1048576 bytes"),
        (b"a = " + b"[" * 1_000_000, "nested too deep"),
    ],
)
def test_what_is_no_design_is_refused_in_one_line(store, folder, data, says):
    (folder / "odd.toml").write_bytes(data)
    with pytest.raises(VinefabError, match=says) as error:
        opened(store, "odd.toml")
    assert str(error.value).count("odd.toml") == 1
    assert "\n" not in str(error.value)


def test_a_file_of_100_mb_is_refused_without_reading_it(store, folder):
    for name, open_it in (
        ("huge.toml", lambda: opened(store, "huge.toml")),
        ("huge.geojson", lambda: store.open_map({"path": "huge.geojson"})),
    ):
        with (folder / name).open("wb") as stream:
            stream.truncate(100_000_000)
        began = time.process_time()
        with pytest.raises(UnreadableFileError, match="is larger than"):
            open_it()
        assert time.process_time() - began < 0.5
    answer = store.save_design({"path": "huge.toml", "design": opened(store)["design"]})
    assert not answer["saved"]
    assert "is larger than" in answer["problem"]


@pytest.mark.parametrize(
    ("path", "kind", "says"),
    [
        ("mine.txt", BadInputError, r"ending in \.toml"),
        ("no/mine.toml", CannotWriteError, "folder does not exist"),
        ("folder.toml", CannotWriteError, "not a plain file"),
    ],
)
def test_places_that_cannot_be_written_are_refused(store, folder, path, kind, says):
    (folder / "folder.toml").mkdir()
    with pytest.raises(kind, match=says):
        store.save_design({"path": path, "design": opened(store)["design"]})


def test_choices_are_what_lies_in_the_folders_and_what_ships(store, folder, tmp_path):
    (folder / "maps").mkdir()
    (folder / "maps" / "a.geojson").write_text(map_text(generate("grid", 3)))
    (folder / "run.toml").write_text('schema = "vinefab/run-1"\n')
    (folder / ".hidden").mkdir()
    shutil.copy(folder / "mine.toml", folder / ".hidden" / "other.toml")
    recipe = locate("recipe", "co2_60w__stretchlon_200").read_text()
    (folder / "recipe.toml").write_text(recipe.replace('"co2_60w__stretchlon_200"', '"recipe"', 1))
    (folder / "up").symlink_to(tmp_path)
    found = store.choices({})
    here = {"mine.toml": "folder"}
    assert {e["path"]: e["where"] for e in found["designs"] if e["where"] == "folder"} == here
    assert [entry["path"] for entry in found["maps"]] == ["maps/a.geojson"]
    assert {
        "name": "grid_explorer_levels",
        "path": "grid_explorer_levels",
        "where": "shipped",
    } in found["designs"]
    assert "recipe.toml" in [entry["path"] for entry in found["recipes"]]
    cave = next(entry for entry in found["environments"] if entry["name"] == "cave")
    assert cave["options"]["size_mm"] > 0
    assert found["complete"]
    json.dumps(found)
    assert store.open_map({"path": "maps/a.geojson"})["source"]["file"] == "maps/a.geojson"
    assert store.open_recipe({"recipe": "recipe.toml"})["recipe"] == "recipe.toml"


def test_choices_of_a_crowded_folder_are_bounded_and_say_so(store, folder):
    for number in range(400):
        (folder / f"{number}.geojson").touch()
    found = store.choices({})
    assert len(found["maps"]) == 300
    assert not found["complete"]


def test_a_crowded_folder_is_looked_at_in_bounded_time(store, folder, monkeypatch):
    monkeypatch.setattr("vinefab.studio.file_store._MOST_LOOKED_AT", 50)
    assert store.choices({})["complete"]
    for number in range(60):
        (folder / f"d{number}").mkdir()
    found = store.choices({})
    assert not found["complete"]
    (folder / "d1" / "deep" / "deeper" / "deepest").mkdir(parents=True)
    shutil.copy("mine.toml", folder / "d1" / "deep" / "deeper" / "a.toml")
    shutil.copy("mine.toml", folder / "d1" / "deep" / "deeper" / "deepest" / "b.toml")
    monkeypatch.setattr("vinefab.studio.file_store._MOST_LOOKED_AT", 5000)
    paths = [entry["path"] for entry in store.choices({})["designs"] if entry["where"] == "folder"]
    assert paths == ["mine.toml", "d1/deep/deeper/a.toml"]


def test_a_write_protected_file_is_left_alone_and_modes_stay(store, folder):
    file = opened(store)
    ask = {"path": "mine.toml", "design": with_length(file["design"], 9), "stamp": file["stamp"]}
    (folder / "mine.toml").chmod(0o444)
    assert not opened(store)["writable"]
    with pytest.raises(CannotWriteError, match="write-protected"):
        store.save_design(ask)
    assert (folder / "mine.toml").read_text() == MINE
    (folder / "mine.toml").chmod(0o600)
    assert store.save_design(ask)["saved"]
    assert (folder / "mine.toml").stat().st_mode & 0o777 == 0o600


def test_unsaved_work_is_kept_listed_and_dropped(store):
    state = {"design": opened(store)["design"], "locks": ["trunk.length"]}
    for number in range(MOST_AUTOSAVES + 5):
        store.keep_autosave(
            {"key": f"tab{number:05}", "state": state, "file": {"path": "mine.toml"}}
        )
    listed = store.autosaves({})["autosaves"]
    assert len(listed) == MOST_AUTOSAVES == len(list(autosave_folder().iterdir()))
    assert listed[0]["key"] == "tab00024"
    assert listed[0]["name"] == "mine"
    assert store.open_autosave({"key": "tab00024"})["state"] == state
    path = autosave_folder() / "recovery-tab00024.json"
    for _ in range(2):  # the user's own, whatever it was
        assert path.stat().st_mode & 0o777 == 0o600
        path.chmod(0o644)
        store.keep_autosave({"key": "tab00024", "state": state, "file": None})
    store.drop_autosave({"key": "tab00024"})
    (autosave_folder() / "recovery-tab00023.json").write_text("{")
    assert len(store.autosaves({})["autosaves"]) == MOST_AUTOSAVES - 2
    for key in ("../../x", "", None, "a" * 41, "A" * 8):
        with pytest.raises(BadInputError):
            store.keep_autosave({"key": key, "state": state})
    with pytest.raises(BadInputError, match="at most"):
        store.keep_autosave({"key": "tab00001", "state": {"a": "x" * 5_000_000}})


def test_work_taken_over_from_a_closed_tab_is_kept_once(store):
    state = {"design": opened(store)["design"]}
    store.keep_autosave({"key": "closedtab", "state": state})
    ask = {"key": "thistab", "instead": "closedtab"}
    with pytest.raises(BadInputError, match="at most"):
        store.keep_autosave({**ask, "state": {"a": "x" * 5_000_000}})
    assert [kept["key"] for kept in store.autosaves({})["autosaves"]] == ["closedtab"]
    store.keep_autosave({**ask, "state": state})
    assert [kept["key"] for kept in store.autosaves({})["autosaves"]] == ["thistab"]
    store.keep_autosave({"key": "thistab", "instead": "thistab", "state": state})
    assert [kept["key"] for kept in store.autosaves({})["autosaves"]] == ["thistab"]


def test_a_save_drops_the_unsaved_work_and_a_refused_one_keeps_it(store):
    file = opened(store)
    store.keep_autosave({"key": "thistab", "state": {"design": file["design"]}})
    ask = {"path": "mine.toml", "design": file["design"], "autosave": "thistab"}
    assert not store.save_design({**ask, "stamp": "old"})["saved"]
    assert store.autosaves({})["autosaves"]
    assert store.save_design({**ask, "stamp": file["stamp"]})["saved"]
    assert not store.autosaves({})["autosaves"]


def watched(store: FileStore, *changes) -> list[dict]:
    """Make changes one after the other while the store watches; return the events of each."""
    events: list[dict] = []

    async def scene() -> list[list[dict]]:
        task = asyncio.create_task(store.watch(events.append))
        await asyncio.sleep(0.25)
        seen = []
        for change in changes:
            events.clear()
            change()
            for _ in range(100):
                await asyncio.sleep(0.05)
                if events:
                    break
            await asyncio.sleep(0.1)
            seen.append(list(events))
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return seen

    return asyncio.run(scene())


def by_rename(path, text):
    """Save as vim does: the old file is moved away, the new one written and moved here."""
    path.rename(path.with_suffix(".bak"))
    beside = path.with_suffix(".new")
    beside.write_text(text)
    beside.rename(path)


def test_changes_from_outside_are_told_once_each(store, folder):
    file = opened(store)
    path = folder / "mine.toml"
    grid = folder / "grid.geojson"
    grid.write_text(map_text(generate("grid", 3)))
    store.open_map({"path": "grid.geojson"})
    in_place, renamed, broken, mended, on_the_map = watched(
        store,
        lambda: path.write_text(MINE.replace("120.0", "121.0")),
        lambda: by_rename(path, MINE.replace("120.0", "122.0")),
        lambda: path.write_text("half a"),
        lambda: path.write_text(MINE),
        lambda: grid.write_text(map_text(generate("grid", 4))),
    )
    assert [event["design"]["trunk"]["length"] for event in in_place] == [121.0]
    assert [event["design"]["trunk"]["length"] for event in renamed] == [122.0]
    assert [(event["design"], "not TOML" in event["problem"]) for event in broken] == [(None, True)]
    assert [event["stamp"] for event in mended] == [file["stamp"]]
    assert [(event["kind"], event["path"]) for event in on_the_map] == [("map", "grid.geojson")]
    assert all(event["event"] == "file_changed" for event in in_place + on_the_map)


def test_what_is_opened_while_watching_is_watched_and_own_saves_carry_their_stamp(store, folder):
    file = opened(store)
    other = folder / "sub" / "other.toml"
    other.parent.mkdir()
    other.write_text(MINE)
    saved = {}

    def save():
        content = with_length(file["design"], 5.0)
        ask = {"path": "mine.toml", "design": content, "stamp": file["stamp"]}
        saved.update(store.save_design(ask))

    def open_and_change():
        opened(store, "sub/other.toml")
        other.write_text(MINE.replace("120.0", "6.0"))

    own, theirs = watched(store, save, open_and_change)
    assert [event["stamp"] for event in own] == [saved["stamp"]]
    assert [event["design"]["trunk"]["length"] for event in theirs] == [6.0]


def test_every_request_takes_what_a_page_may_send(store):
    for function in FILE_REQUESTS.values():
        for ask in ({}, {"path": 1, "design": [], "key": {}, "state": 3, "recipe": []}):
            with suppress(VinefabError):
                json.dumps(function(store, ask))
    assert design_content(Design.read("mine.toml"))["name"] == "mine"


def test_a_design_opens_with_the_recipe_of_its_run(tmp_path):
    shipped = RunRecipe.of(DEFAULT_RECIPE)
    recipe = RunRecipe(
        name="mine",
        digest="",
        files={
            name.replace(DEFAULT_RECIPE, "mine"): text.replace(f'"{DEFAULT_RECIPE}"', '"mine"')
            for name, text in shipped.files.items()
        },
    )
    recipe.write(tmp_path)
    file = next(iter(recipe.files))
    digest = recipe_digest(tmp_path / file)
    for given, opened, note in (
        (digest, file, "of the design's run"),
        ("other", file, "has changed since"),
    ):
        origin = {"recipe": {"name": "mine", "file": file, "digest": given}}
        path = tmp_path / "best.toml"
        path.write_text(design_text(Design.read("plain_vine").changed(origin=origin)))
        answer = FileStore(tmp_path).open_design({"design": "best.toml"})
        assert answer["recipe"] == opened
        assert note in answer["run_note"]
    assert "recipe" not in FileStore(tmp_path).open_design({"design": "plain_vine"})
    origin = {"run": "ab", "run_name": "night", "task": "reach", "growth": {"storage_kpa": 2.0}}
    path.write_text(design_text(Design.read("plain_vine").changed(origin=origin)))
    answer = FileStore(tmp_path).open_design({"design": "best.toml"})
    assert answer["task"] == "reach"
    assert answer["run_note"] == "task reach, growth options of run night (ab)"


def test_unsaved_work_names_its_files_from_any_folder(store, folder, tmp_path):
    """In another folder with a file of the same name it is a copy: nothing leads to that file."""
    shutil.copy(folder / "mine.toml", folder / "own.toml")
    generate("pegs", 1).write(folder / "pegs.geojson")
    state = {
        "design": store.open_design({"design": "mine.toml"})["design"],
        "opened": "mine.toml",
        "recipe": DEFAULT_RECIPE,
        "map": {"source": {"file": "pegs.geojson"}, "edits": [["remove", 0]]},
        "family": {"files": ["pegs.geojson"]},
    }
    file = {"path": "mine.toml", "name": "mine", "stamp": "of then"}
    store.keep_autosave({"key": "tab00001", "state": state, "file": file})
    there = store.open_autosave({"key": "tab00001"})
    assert (there["state"], there["file"], there["left"]) == (state, file, [])

    beside = tmp_path / "beside"
    beside.mkdir()
    for name in ("mine.toml", "pegs.geojson"):
        shutil.copy(folder / name, beside / name)
    found = FileStore(beside).open_autosave({"key": "tab00001"})
    assert found["file"] == {**file, "path": None}
    assert found["state"]["opened"] is None
    assert found["state"]["map"] is None
    assert found["state"]["family"]["files"] == []
    assert found["state"]["recipe"] == DEFAULT_RECIPE
    assert found["state"]["design"] == state["design"]
    assert found["left"] == [str(folder / "mine.toml"), str(folder / "pegs.geojson")]


def test_unsaved_work_of_before_without_a_folder_is_a_copy(store):
    path = Path(store.keep_autosave({"key": "tab00001", "state": {}, "file": None})["kept"])
    text = path.read_text().replace('"file": null', '"file": {"path": "mine.toml"}')
    path.write_text(text)
    assert store.open_autosave({"key": "tab00001"})["file"] == {"path": None}


def test_a_map_is_saved_with_the_care_of_a_design(store, folder):
    world = generate("pegs", 1)
    target = {"name": "A", "point_mm": [100.0, 100.0], "tolerance_mm": 20.0}
    pose = {"x_mm": 101.0, "y_mm": 20.0, "heading_deg": 80.0}
    source = {"environment": "pegs", "seed": 1}
    ask = {"path": "own.geojson", "map": {"source": source, "edits": [["remove", 0]]}, "pose": pose}
    ask["map"]["targets"] = [target]
    saved = store.save_map(ask)
    assert saved["saved"]
    written = Map.read(folder / "own.geojson")
    assert len(written.obstacles) == len(world.obstacles) - 1
    assert [one.name for one in written.targets] == ["A"]
    assert written.starts[0].pose == Pose.of((101.0, 20.0, 80.0))
    assert written.starts[1:] == world.starts[1:]

    text = (folder / "own.geojson").read_text()
    refused = store.save_map(ask)
    assert (refused["saved"], refused["why"]) == (False, "exists")
    refused = store.save_map({**ask, "stamp": "of another"})
    assert (refused["saved"], refused["why"]) == (False, "changed")
    assert (folder / "own.geojson").read_text() == text
    again = {"path": "own.geojson", "map": {"source": saved["source"], "edits": [["remove", 0]]}}
    assert store.save_map({**again, "stamp": saved["stamp"]})["saved"]
    assert len(Map.read(folder / "own.geojson").obstacles) == len(world.obstacles) - 2
    for path in ("../out.geojson", "own.toml", "none/own.geojson", "own"):
        with pytest.raises(VinefabError, match=r"path|folder"):
            store.save_map({**ask, "path": path})
    with pytest.raises(BadInputError, match=r"map\.source"):
        store.save_map({**ask, "path": "new.geojson", "map": {"source": {"file": "/etc/passwd"}}})
    assert not (folder / "new.geojson").exists()
