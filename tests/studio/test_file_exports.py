"""Exports of the page: byte for byte what the command line shown beside the button writes."""

import asyncio
import math
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from types import MappingProxyType

import pytest

from vinefab.cli.main import main
from vinefab.core.errors import VinefabError
from vinefab.core.plain_text import GENERATOR
from vinefab.core.view import Answer
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import Design, design_content, design_text
from vinefab.model.map import Pose, map_text
from vinefab.studio.executors import ProcessExecutor, Question
from vinefab.studio.file_exports import EXPORTS, _world, export_answer
from vinefab.studio.server import LaunchOptions, StudioWorkspace
from vinefab.studio.state import StudioState


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def opened(name="plain_vine", **more):
    small = {"columns": 2, "rows": 2, "size_mm": 200.0}
    source = {"environment": "grid", "seed": 3, "options": small}
    return {
        "design": design_content(Design.read(name)),
        "map": {"source": source, "edits": []},
        **more,
    }


def export(content, what, out, **ask):
    return export_answer(StudioState.of(content), {"what": what, "out": out, **ask})


def everything():
    """Every file below the current folder, with its bytes."""
    return {p: p.read_bytes() for p in sorted(Path().rglob("*")) if p.is_file()}


def run_again(answer, *inputs):
    """Run the command of an answer where nothing but its inputs lies, and return what is there."""
    kept = {Path(name): Path(name).read_bytes() for name in (*answer["inputs"], *inputs)}
    manifests = {p: p.read_bytes() for p in Path().rglob("*.inputs/MANIFEST.sha256")}
    for path in Path().iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for path, data in {**kept, **manifests}.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    program, *words = shlex.split(answer["command"])
    assert program == "vinefab"
    assert main([*words, "-q"]) == 0
    return everything()


MOVED = {"pose": {"x_mm": 101.3, "y_mm": 12.1, "heading_deg": 97.3}}


def edited(content):
    edits = [["move", 0, 3.3, -1.7], ["add", [[20, 150], [40.1234567891, 150], [30, 180]]]]
    content["map"]["edits"] = [*edits, ["remove", 2]]
    content["design"]["trunk"]["length"] = 133.33333333
    content["design"]["name"] = "own"
    return content


@pytest.mark.parametrize(
    ("what", "out", "options", "more"),
    [
        ("package", "to cut/package", {"allow_uncalibrated": True, "zip": True}, {}),
        ("picture", "grown.svg", {"label": True}, {**MOVED, "growth": {"body": "centerline"}}),
        ("picture", "grown.gif", {"frames": 3}, MOVED),
        ("rig", "rig", {"fit_mm": 120.0, "lid": True, "pictures": False}, MOVED),
    ],
)
def test_the_command_shown_writes_the_same_bytes(what, out, options, more):
    answer = export(edited(opened(**more)), what, out, options=options)
    assert not answer["refused"]
    assert f"{out}.inputs/design.toml" in answer["inputs"]
    assert (f"{out}.zip" in answer["written"]) == ("zip" in options)
    assert ("101.3,12.1,97.3" in answer["command"]) == (what == "picture")
    first = everything()
    assert {Path(name) for name in answer["written"]} <= first.keys()
    assert run_again(answer) == first


def test_a_command_says_what_differs_from_the_design_s_own_growth():
    content = opened(growth={"branch_contact": "pass"})
    content["design"]["origin"] = {"growth": {"branch_contact": "stop"}}
    content["design"]["name"] = "own"
    answer = export(content, "picture", "grown.svg", options={})
    assert "branch_contact=pass" in answer["command"].replace(" ", "").replace('"', "")
    first = everything()
    assert run_again(answer) == first


@dataclass(frozen=True)
class FoundInNoTime:
    """Stands in for a prediction, which takes seconds: its page says what went in."""

    given: tuple
    origin: object = None
    path: object = None
    growth_notes: tuple = ()
    summary = ("found",)
    numbers = MappingProxyType({"schema": "vinefab/prediction-1"})

    @classmethod
    def of(cls, design, profile, families, plan):
        worlds = [map_text(world) for family in families for world in family.worlds]
        return cls((design_text(design), profile.recipe.name, plan, worlds))

    def json_text(self):
        return ""

    def view(self):
        return (Answer("found"),)

    def page(self):
        return f"{GENERATOR} {self.given} {self.origin.command} {self.origin.inputs}"


def test_a_report_is_predicted_from_what_the_command_reads(monkeypatch):
    monkeypatch.setattr("vinefab.prediction.predict.predict", FoundInNoTime.of)
    content = edited(opened(**MOVED, growth={"storage_kpa": 1.25}))
    options = {"poses": 2, "environment": "pegs", "count": 3}
    answer = export(content, "report", "page.html", options=options)
    assert '"coordinates": [101.3, 12.1]' in Path("page.html.inputs/map.geojson").read_text()
    first = everything()
    assert run_again(answer) == first


def test_saved_files_are_called_by_their_names_and_not_written_again(here):
    Design.read("plain_vine").write(here / "mine.toml")
    main(["map", "grid", "--columns", "3", "--rows", "3", "--out", "lab.geojson", "-q"])
    content = opened("mine.toml", map={"source": {"file": "lab.geojson"}, "edits": []})
    files = {"design_file": str(here / "mine.toml"), "map_file": "lab.geojson"}
    answer = export(content, "picture", "grown.svg", **files)
    assert answer["command"] == "vinefab grow mine.toml lab.geojson --svg grown.svg"
    assert answer["inputs"] == []
    first = everything()
    assert run_again(answer, "mine.toml", "lab.geojson") == first
    content["design"]["trunk"]["length"] += 1.0
    answer = export(content, "picture", "other.svg", **files)
    assert answer["inputs"] == ["other.svg.inputs/design.toml"]
    assert " lab.geojson " in answer["command"]


def test_an_error_in_an_input_names_it_as_the_command_does():
    content = edited(opened())
    content["design"]["origin"] = {"targets": [{"place": 1}]}
    with pytest.raises(VinefabError, match=r"^a\.svg\.inputs/design\.toml: origin\.targets"):
        export(content, "picture", "a.svg")
    assert everything() == {}


def test_an_export_that_is_stopped_leaves_nothing_in_the_folder_for_temporary_files(
    here, monkeypatch
):
    monkeypatch.setattr("tempfile.tempdir", str(here / "scratch"))
    (here / "scratch").mkdir()
    begun = Event()
    ask = {"what": "report", "out": "a.html", "roots": [str(here)]}
    ask["options"] = {"environment": "grid", "count": 10_000}

    async def stopped():
        executor = ProcessExecutor("export")
        question = Question(panel="export", state=edited(opened()), ask=ask)
        answer = asyncio.create_task(executor.answer(question, lambda *_: begun.set()))
        assert await asyncio.to_thread(begun.wait, 60.0)
        assert list((here / "scratch").rglob("design.toml"))
        answer.cancel()
        await asyncio.gather(answer, return_exceptions=True)
        assert answer.cancelled()

    asyncio.run(stopped())
    assert everything() == {}
    assert list((here / "scratch").iterdir()) == []


@pytest.mark.parametrize(
    ("what", "options", "last"),
    [
        ("package", {"allow_uncalibrated": True}, "answer"),
        ("rig", {"fit_mm": 120.0, "pictures": False}, "remark"),
    ],
)
def test_findings_of_what_was_written_are_told_once_and_as_findings(what, options, last):
    view = export(opened(), what, what, options=options)["view"]
    assert "warning" in {block.get("weight") for block in view}
    assert view[-1]["kind"] == last
    assert not [block for block in view if block["text"].startswith(("warn ", "skipped ", " "))]
    assert any("parts for" in block["text"] for block in view) == (what == "rig")


def test_rules_and_an_unconfirmed_recipe_refuse_a_package():
    answer = export(opened(), "package", "package")
    assert "--allow-uncalibrated" in answer["refused"]
    content = opened()
    content["design"]["build"]["widths_mm"] = [3.0]
    options = {"allow_uncalibrated": True}
    answer = export(content, "package", "package", options=options)
    assert "VF-W01" in answer["refused"]
    assert "VF-W01" in {finding["id"] for finding in answer["findings"]}
    assert answer["written"] == []
    assert everything() == {}


@pytest.mark.parametrize(
    ("what", "out", "options", "words"),
    [
        ("picture", "../grown.svg", {}, "out: '../grown.svg' leads out of"),
        ("picture", "/etc/grown.svg", {}, "leads out of"),
        ("picture", "link/grown.svg", {}, "leads out of"),
        ("package", ".", {}, "allowed: a path in"),
        ("picture", "grown.txt", {}, "a file name ending in .svg or .png or .gif"),
        ("picture", "grown.png", {"animate": True}, "ending in .svg or .gif, to move"),
        ("picture", "a\nb.svg", {}, "allowed: a path"),
        ("picture", "x" * 5000, {}, "allowed: a path"),
        ("picture", None, {}, "out is missing"),
        (
            "package",
            "p",
            {"copies": 10**6},
            "copies is 1000000; allowed: a whole number",
        ),
        ("report", "p.html", {"poses": 1001}, "poses is 1001; allowed: a whole"),
        ("package", "p", {"force": True}, "package.force: there is no such parameter"),
        ("poster", "p", {}, "no export is called 'poster'"),
        ("picture", "mine.svg", {}, "was not written by vinefab; choose another name"),
        ("package", "own", {}, "was not written by vinefab; choose another name"),
    ],
)
def test_what_cannot_be_written_is_one_line_and_changes_nothing(here, what, out, options, words):
    (here / "link").symlink_to(here.parent)
    (here / "mine.svg").write_text("drawn by hand")
    (here / "own").mkdir()
    (here / "own" / "notes.txt").write_text("by hand")
    before = everything()
    with pytest.raises(VinefabError) as raised:
        export(opened(), what, out, options=options)
    assert words in str(raised.value)
    assert "\n" not in str(raised.value)
    assert "--force" not in str(raised.value)
    assert everything() == before


@pytest.mark.parametrize(
    ("what", "out", "theirs"),
    [
        ("picture", "a.svg", "a.svg"),
        ("picture", "a.svg", "a.svg.inputs/design.toml"),
        ("snapshot", "a.html", "a.html"),
    ],
)
def test_what_somebody_changed_is_not_overwritten(here, what, out, theirs):
    ask = {"options": {}, "state": opened()}
    export(opened(), what, out, **ask)
    changed = (here / theirs).read_bytes() + b"\n"
    (here / theirs).write_bytes(changed)
    with pytest.raises(VinefabError, match="was changed since vinefab wrote it; choose another"):
        export(edited(opened()), what, out, **ask)
    assert (here / theirs).read_bytes() == changed


def test_the_page_does_not_say_where_may_be_written(here):
    state = opened()
    ask = {"out": "p", "roots": ["/"], "state": {"map": {"source": {"file": "/etc/passwd"}}}}
    asked = StudioWorkspace(LaunchOptions(folder=here)).allowed("export", state, ask)
    assert asked == {"out": "p", "roots": [str(here)], "state": state}


def test_commands_are_told_without_writing():
    exports = {
        "package": {"out": "package", "options": {"copies": 2}},
        "picture": {"out": "../grown.svg"},
        "rig": {"out": "rig", "options": {"style": "board"}},
        "snapshot": {"out": "my page.html"},
    }
    found = export(opened(), "command", None, exports=exports, design_file="plain_vine")
    assert everything() == {}
    assert found["unverified"] is True
    commands = found["commands"]
    assert commands["package"]["command"] == (
        "vinefab fabricate plain_vine --out package --copies 2"
    )
    assert commands["package"]["inputs"] == []
    assert "leads out of" in commands["picture"]["error"]
    assert commands["snapshot"]["command"] == "vinefab studio 'my page.html'"
    assert "--out rig --design plain_vine --style board" in commands["rig"]["command"]


def test_a_start_moved_away_from_its_line_stands_where_it_is_shown(here):
    world = grid_map(3).with_start("left side, heading 0+-20")
    world.write(here / "left.geojson")
    for pose, kept in (((15.0, 250.0, 10.0), True), ((250.0, 15.0, 90.0), False)):
        x_mm, y_mm, heading_deg = pose
        shown = {"x_mm": x_mm, "y_mm": y_mm, "heading_deg": heading_deg}
        content = opened(pose=shown)
        content["map"] = {"source": {"file": str(here / "left.geojson")}, "edits": []}
        (start,) = _world(StudioState.of(content), EXPORTS["rig"]).starts
        assert start.pose == Pose.of(pose)
        assert (start.area is not None) == kept
        assert start.spread_heading_rad == pytest.approx(math.radians(20.0))
