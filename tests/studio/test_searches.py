"""Searches of the page are runs of the command, and stop, resume and load as these do."""

import asyncio
import copy
import functools
import json
import sqlite3
import time
from contextlib import closing

import numpy as np
import pytest

from vinefab.cli.main import main
from vinefab.core.errors import BadInputError, UnreadableFileError, VinefabError
from vinefab.model.design import Branch, Design, design_content, design_of, design_text
from vinefab.model.files.shipped import locate
from vinefab.search.free_space import space_of
from vinefab.search.front import FrontFile, front_of
from vinefab.search.record.generations import Generation
from vinefab.search.record.result import RunArchive
from vinefab.search.run import run_search
from vinefab.search.settings import MapSettings, RunSettings, SearchSettings, read_run
from vinefab.search.space import COSTS, Bounds, Space, SpaceSettings
from vinefab.studio.run_request import RUN_FILE, run_files, run_proposal
from vinefab.studio.searches import SEARCH_REQUESTS, FollowedRecord, LiveFront, SearchManager
from vinefab.studio.state import StudioState

SMALL = {"columns": 2, "rows": 2, "size_mm": 300.0}


def page(name="plain_vine", **changes):
    """What the page sends: a shipped design on a small map."""
    design = json.loads(json.dumps(design_content(Design.read(name))))
    source = {"environment": "grid", "seed": 3, "options": SMALL}
    return copy.deepcopy({"design": design, "map": {"source": source, "edits": []}, **changes})


def ask(**changes):
    """What the page asks of a search that takes a moment."""
    few = {"population": 4, "generations": 3, "fabricable": False, "maps": {"shown": True}}
    return {**few, **changes}


@pytest.fixture
def searches(tmp_path):
    made = SearchManager((tmp_path,), tmp_path)
    yield made
    made.close()


def followed(searches, until, patience_s=90.0):
    """Return the events of a search up to the first that is wanted."""
    events, end_s = [], time.monotonic() + patience_s
    while time.monotonic() < end_s:
        event = searches.poll()
        if event is not None:
            json.dumps(event, allow_nan=False)  # plain values
            events.append(event)
            if until(event):
                return events
        time.sleep(0.05)
    raise AssertionError(f"not seen: {events[-1:]}")


def read_archive(folder):
    return RunArchive.read(folder / "run.sqlite").result()


def is_over(event):
    return event["state"] != "running"


def generations(folder):
    with closing(sqlite3.connect(folder / "run.sqlite")) as connection:
        query = "SELECT number, x, fitness, composite, penalty FROM generation ORDER BY 1"
        return connection.execute(query).fetchall()


@pytest.fixture
def front_run(tmp_path):
    """A run for a front that has ended, without its pictures."""
    settings = RunSettings(
        name="two",
        maps=MapSettings(count=1, options=SMALL),
        space=SpaceSettings(levels=Bounds(low=1, high=2)),
        search=SearchSettings(population=8, generations=3, seed=3),
        optimizer=RunSettings().optimizer.changed(name="nsga2"),
        objectives=("coverage", "film_length"),
    )
    few = {"finalists": 6, "final_poses_per_map": 1, "finalists_by": "training"}
    settings = settings.changed(evaluation=settings.evaluation.changed(fabricable=False, **few))
    folder = tmp_path / "two"
    result = run_search(settings, folder)
    (folder / "front").mkdir()
    members = front_of(result, settings)
    (folder / "front.json").write_text(FrontFile.of(members, result, settings).json_text())
    for member in members:
        (folder / "front" / f"{member.design.name}.toml").write_text(design_text(member.design))
    return folder, members


@pytest.mark.thorough
def test_a_search_that_was_stopped_and_resumed_ends_as_the_command_does(
    searches, tmp_path, monkeypatch
):
    # Its page takes seconds to draw, and no more room in the suite.
    plain = SearchManager._arguments
    monkeypatch.setattr(SearchManager, "_arguments", lambda *given: [*plain(*given), "--no-page"])
    begun = searches.start(ask(generations=400), StudioState.of(page()))
    words = "vinefab optimize search_1/run.toml --out search_1 --workers 1 --quiet --no-page"
    assert (begun["folder"], begun["command"]) == ("search_1", words)
    with pytest.raises(BadInputError, match="one at a time"):
        searches.start(ask(), StudioState.of(page()))
    followed(searches, lambda event: event["generations"] > 0)
    searches.stop()
    stopped = followed(searches, is_over)[-1]
    assert stopped["state"] == "stopped"
    assert 0 < stopped["generations"] < 400
    assert searches.runs()["runs"][0]["state"] == "unfinished"

    assert searches.resume({"folder": "search_1"})["command"] == f"{words} --resume"
    events = followed(searches, is_over)
    assert events[-1]["state"] == "ended", events[-1]["line"]
    assert events[-1]["share"] == 1.0
    assert 0 < len(events[-1]["curve"]) <= 240
    assert [e["evaluations"] for e in events] == sorted(e["evaluations"] for e in events)
    assert searches.runs()["runs"][0]["state"] == "ended"

    page_run, same = tmp_path / "search_1", tmp_path / "same"
    command = ["optimize", str(page_run / RUN_FILE), "--out", str(same), "--no-page", "-q"]
    assert main(command) == 0
    assert (page_run / "best.toml").read_bytes() == (same / "best.toml").read_bytes()
    assert generations(page_run) == generations(same)
    best = design_of(searches.load({"folder": "search_1", "point": "best"})["design"], "page")
    assert best == Design.read(same / "best.toml")
    assert design_of(events[-1]["best"], "page") == best


def test_what_the_command_refuses_is_its_line_and_leaves_no_folder(searches, tmp_path):
    given = page("six_branch_anchor")
    # No start of the map has room for such a trunk: the run file is right, the run cannot be.
    given["design"]["build"]["widths_mm"] = [400.0, 20.0]
    searches.start(ask(), StudioState.of(given))
    event = followed(searches, is_over)[-1]
    assert event["state"] == "failed"
    assert (
        "a trunk of 400 mm needs 127.3 mm; move it to a place with room, or set build.widths_mm"
        in event["line"]
    )
    assert not (tmp_path / "search_1").exists()


def test_a_target_beyond_the_longest_robot_is_refused_by_the_form_as_by_the_command(
    searches, tmp_path
):
    given = page()
    given["map"]["targets"] = [{"name": "far", "point_mm": [280, 280]}]
    asked = ask(task="reach", ranges={"trunk.length": [20, 60]}, levels=[1, 1])
    with pytest.raises(BadInputError) as caught:
        searches.start(asked, StudioState.of(given))
    words = str(caught.value)
    assert words.startswith("the page: targets[1] is ")
    assert "within 60 mm" in words
    assert "(space.length_mm)" in words
    assert list(tmp_path.iterdir()) == []
    asked["ranges"] = {"trunk.length": [20, 600]}
    searches.start(asked, StudioState.of(given))
    assert followed(searches, is_over)[-1]["state"] == "ended"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ranges": {"trunk.length": [200, 100]}}, "^the page: space.*in order"),
        ({"ranges": {"level.9.length": [1, 2]}}, "ranges of trunk.length"),
        ({"levels": [3, 2]}, "3 to 10"),
        ({"levels": "all"}, r"\[fewest, most\]"),
        ({"task": "swim"}, "swim"),
        ({"task": None}, "texts, numbers and lists"),
        (
            {"ranges": {"trunk.length": functools.reduce(lambda one, _: [one], range(99), 1)}},
            "32 levels",
        ),
        ({"seed": 10**400}, "64 bits"),
        ({"folder": "x" * 5000}, "."),
        ({"population": 1}, "optimizer.population"),
        ({"population": "many"}, "optimizer.population"),
        ({"optimizer": "guess"}, "guess"),
        ({"objectives": ["cost"]}, "task.objectives"),
        ({"maps": {"files": ["../elsewhere.geojson"]}}, "leads out of"),
        ({"maps": {"files": ["none.geojson"]}}, "none.geojson"),
        ({"folder": "../elsewhere"}, "leads out of"),
        ({"folder": "taken"}, "an empty one"),
        ({"folder": "."}, "an empty one"),
        ({"folder": "a b/\n"}, "letters that can be shown"),
        ({"folder": "a b"}, "name is 'a b'"),
    ],
)
def test_what_cannot_be_asked_is_one_line_and_leaves_nothing(searches, tmp_path, changes, words):
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "notes.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(VinefabError, match=words) as caught:
        searches.start(ask(**changes), StudioState.of(page()))
    assert "\n" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before


def test_locked_values_are_fixed_and_others_have_ranges_around_them(tmp_path):
    locks = ["level.0.angle_deg", "level.0.branches", "build.tail_mm"]
    state = StudioState.of(page("six_branch_anchor", locks=locks))
    for name, text in run_files(state, {}, tmp_path).items():
        (tmp_path / name).write_text(text)
    settings = read_run(tmp_path / RUN_FILE)
    design, space = state.design, Space(settings.space, settings.build)
    (level,) = design.levels
    assert settings.space.bounds(2, "branches") == Bounds(low=level.branches, high=level.branches)
    assert [variable.name for variable in space.variables] == [
        "length_mm", "length_mm", "growth_percent",
    ]  # fmt: skip
    # The design itself lies in the space, built as it is; a search begins at it.
    found = space.design(space.vector(design))
    assert found.trunk_length_mm == pytest.approx(design.trunk_length_mm, abs=0.01)
    assert found.levels[0].fan_rad == pytest.approx(level.fan_rad, abs=1e-9)
    for name in ("widths_mm", "tail_mm", "pressure_kpa", "pouch", "pieces"):
        assert getattr(found.build, name) == getattr(design.build, name)
    assert len(settings.start_from) == 1
    assert settings.growth == state.growth


def test_a_level_with_locked_values_cannot_be_left_out(tmp_path):
    state = StudioState.of(page("three_level_tree", locks=["level.1.length"]))
    with pytest.raises(BadInputError, match="level 3 has locked values"):
        run_files(state, {"levels": [2, 3]}, tmp_path)


@pytest.mark.parametrize("targets", [None, [{"name": "A", "point_mm": [150, 150]}]])
def test_a_search_is_proposed_on_what_is_open(targets):
    """A generated map that is not edited, too; with targets the task is to reach them."""
    given = page(task="anchoring")
    given["map"]["targets"] = targets
    state = StudioState.of(given)
    proposed = run_proposal(state)["settings"]
    assert proposed["maps"]["shown"]
    assert proposed["task"] == ("reach" if targets else "anchoring")
    assert state.family.environment == "grid"
    given["map"]["source"] = {"environment": "cave", "seed": 1}
    assert StudioState.of(given).family.environment == "cave", "many maps are of its kind"
    assert not run_proposal(StudioState.of({**given, "map": None}))["settings"]["maps"]["shown"]


def test_a_proposal_says_what_a_search_leaves_out():
    given = page("six_branch_anchor")
    given["design"]["build"]["taper"] = [1.0, 0.9]
    assert any("taper" in note for note in run_proposal(StudioState.of(given))["notes"])
    for value in run_proposal(StudioState.of(given))["values"]:
        assert value["range"][0] <= value["value"] <= value["range"][1]


def test_points_of_a_front_are_loaded_as_they_are_in_its_files(searches, front_run):
    folder, members = front_run
    (run,) = searches.runs()["runs"]
    front = searches.front({"folder": "two"})["front"]
    assert front["is_final"]
    assert run["best_score"] == read_archive(folder).score.composite["mean"]
    assert "fresh pose (simulated)" in run["best_words"]
    assert [one["name"] for one in front["objectives"]] == ["coverage score", "film length"]
    assert [point["point"] for point in front["points"]] == [m.design.name for m in members]
    assert front["points"][0]["values"] == [members[0].fitness, members[0].further[0]]
    name = members[-1].design.name
    found = searches.load({"folder": "two", "point": name})
    assert design_of(found["design"], "page") == Design.read(folder / "front" / f"{name}.toml")
    assert "simulated" in found["words"]
    file = folder / "front" / f"{name}.toml"
    file.unlink()
    file.symlink_to(locate("design", "plain_vine"))
    with pytest.raises(BadInputError, match="leads out of"):
        searches.load({"folder": "two", "point": name})


def test_the_front_so_far_is_that_of_all_designs_and_its_points_are_loaded(searches, front_run):
    folder, _ = front_run
    record = FollowedRecord(folder / "run.sqlite")
    record.look()
    points = record.front.shown.points
    values = [point.values for point in points]
    for fitness, film_mm in values:  # none dominates another
        assert not any(f >= fitness and mm < film_mm for f, mm in values)
    best = max(points, key=lambda point: point.values[0])
    assert best.values[0] == record.best
    found = searches.load({"folder": "two", "point": best.point})["design"]
    assert found["trunk"] == record.best_content()["trunk"]
    (folder / "front.json").unlink()
    assert searches.front({"folder": "two"})["front"] == record.front.shown.content


def test_a_front_of_three_aims_stays_bounded():
    # Scores that rise with both costs: no design dominates another.
    settings = RunSettings(objectives=("coverage", "film_length", "reach"))
    front, rng, count = LiveFront(settings), np.random.default_rng(2), 60
    space = Space(settings.space, settings.build)
    for number in range(40):
        x = rng.random((count, len(space)))
        film_mm = COSTS["film_length"].of(space.batch(x), space.build_of)
        front.take(
            Generation(
                number=number,
                x=x,
                fitness=film_mm / 1e6,
                composite=film_mm / 1e6,
                penalty=np.zeros(count),
                terms={"reach": rng.random(count)},
                seconds=0.1,
            )
        )
        assert len(front.shown.points) <= 120
    values = [point.values[1] for point in front.shown.points]
    assert values == sorted(values)
    assert len(values) > 60


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"folder": "two", "point": "9:0"}, "G:R"),
        ({"folder": "two", "point": "0:99"}, "G:R"),
        ({"folder": "two", "point": "²:1"}, "G:R"),
        ({"folder": "two", "point": "../two"}, "one of two_01"),
        ({"folder": "two", "point": 3}, "point"),
        ({"folder": "..", "point": "best"}, "leads out of"),
        ({"folder": "none", "point": "best"}, "a run with a valid design"),
    ],
)
@pytest.mark.usefixtures("front_run")
def test_what_cannot_be_loaded_is_one_line(searches, given, words):
    with pytest.raises(VinefabError, match=words):
        searches.load(given)


@pytest.mark.usefixtures("front_run")
def test_a_run_of_the_command_line_is_resumed_with_its_own_file_and_seed(
    searches, tmp_path, monkeypatch
):
    monkeypatch.setattr(SearchManager, "_begin", lambda _self, arguments, *_: arguments)
    with pytest.raises(BadInputError, match="its run file"):
        searches.resume({"folder": "two"})
    (tmp_path / "other.toml").write_text('schema = "vinefab/run-1"\nname = "two"\n')
    (tmp_path / "runs.toml").write_text(
        """schema = "vinefab/run-1"
name = "two"
maps = { count = 1, options = { columns = 2, rows = 2, size_mm = 300.0 } }
task = { name = "coverage", objectives = ["coverage", "film_length"] }
space = { levels = [1, 2] }
optimizer = { population = 8, generations = 9, seed = 4 }
[evaluation]
fabricable = false
finalists = 6
final_poses_per_map = 1
finalists_by = "training"
"""
    )
    command = ["optimize", "runs.toml", "--out", "two", "--workers", "1", "--quiet"]
    assert searches.resume({"folder": "two"}) == [*command, "--seed", "3", "--resume"]
    with pytest.raises(UnreadableFileError, match=r"run\.sqlite"):
        searches.resume({"folder": "."})


@pytest.mark.usefixtures("front_run")
def test_the_page_takes_what_searches_answer(searches, page_types, monkeypatch):
    plain = SearchManager._arguments
    monkeypatch.setattr(SearchManager, "_arguments", lambda *given: [*plain(*given), "--no-page"])
    asks = {
        "search_runs": {},
        "search_front": {"folder": "two"},
        "search_load": {"folder": "two", "point": "best"},
        "search_start": ask(generations=1),
        "search_stop": {},
    }
    found = [
        (f'RequestAnswers["{name}"]', SEARCH_REQUESTS[name](searches, page(), asks[name]))
        for name in asks
    ]
    events = [("SearchEvent", event) for event in followed(searches, is_over)]
    page_types([*found, *events, ('RequestAnswers["search_runs"]', searches.runs())])


def test_what_is_new_is_told_once(searches):
    told, news = [], iter([{"event": "search", "share": 0.5}, None])
    searches.poll = lambda: next(news, None)

    async def watched():
        task = asyncio.create_task(searches.watch(told.append))
        await asyncio.sleep(0.05)
        task.cancel()

    asyncio.run(watched())
    assert told == [{"event": "search", "share": 0.5}]


def test_the_page_reaches_every_function_by_name(searches):
    proposed = SEARCH_REQUESTS["search_propose"](searches, page(), {})
    assert proposed["folder"] == "search_1"
    assert SEARCH_REQUESTS["search_runs"](searches, None, {})["runs"] == []
    with pytest.raises(BadInputError, match="one that is running"):
        SEARCH_REQUESTS["search_stop"](searches, None, {})
    with pytest.raises(BadInputError, match="design is missing"):
        SEARCH_REQUESTS["search_start"](searches, {}, {})


def free_page(design):
    return page() | {"design": json.loads(json.dumps(design_content(design)))}


def test_a_search_from_a_design_of_branches_is_one_of_free_trees_that_begins_there(tmp_path):
    branches = [
        Branch(name="left", angle_deg=55.0, length_mm=120.0, bends=((60.0, 20.0),)),
        Branch(name="right", angle_deg=-40.0, length_mm=90.0, width_mm=13.0),
        Branch(name="tip", of="left", angle_deg=10.0, length_mm=70.0),
    ]
    state = StudioState.of(free_page(Design.of_branches(branches, trunk_length_mm=100.0)))
    proposed = run_proposal(state)
    assert proposed["must_be_free"]
    assert proposed["settings"]["free"]
    assert proposed["notes"] == ["own widths of branches: a search takes those of their levels"]
    for name, text in run_files(state, {}, tmp_path).items():
        (tmp_path / name).write_text(text)
    settings = read_run(tmp_path / RUN_FILE)
    assert settings.space.tree == "free"
    assert settings.space.bends == Bounds(low=0, high=1)
    space = space_of(settings.space, settings.build)
    begun = space.design(np.array(settings.start_from[0])).tree
    drawn = state.design.tree
    assert np.abs(np.degrees(begun.offset_rad - drawn.offset_rad)).max() < 0.01
    assert np.abs(begun.length_mm - drawn.length_mm).max() < 0.01


def test_a_design_of_levels_may_be_searched_branch_by_branch(tmp_path):
    files = run_files(StudioState.of(page()), {"free": True, "optimizer": "cmaes"}, tmp_path)
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    settings = read_run(tmp_path / RUN_FILE)
    assert settings.space.tree == "free"
    assert len(settings.start_from) == 1


def test_a_search_may_change_one_branch_alone(tmp_path):
    state = StudioState.of(free_page(Design.read("grid_explorer")))
    for name, text in run_files(state, {"only": "1-1"}, tmp_path).items():
        (tmp_path / name).write_text(text)
    assert 'only = ["1-1"]' in (tmp_path / RUN_FILE).read_text()
    settings, design = read_run(tmp_path / RUN_FILE), state.design
    assert settings.space.only == (design.tree.ids[design.names.index("1-1")],)
    for ask in ({"only": "up"}, {"only": "1-1", "start_here": False}, {"only": ["1-1"]}):
        with pytest.raises(BadInputError, match="a branch of a design of branches"):
            run_files(state, ask, tmp_path)
    with pytest.raises(BadInputError, match="a branch of a design of branches"):
        run_files(StudioState.of(page()), {"only": "0.1", "free": True}, tmp_path)
    text = (tmp_path / RUN_FILE).read_text()
    for wrong, words in (("1-l", "did you mean '1-"), ("zzz", "branches of grid_explorer")):
        (tmp_path / RUN_FILE).write_text(text.replace('["1-1"]', f'["{wrong}"]'))
        with pytest.raises(BadInputError, match=words):
            read_run(tmp_path / RUN_FILE)
    (tmp_path / RUN_FILE).write_text(text.replace("start_from", "# start_from"))
    with pytest.raises(BadInputError, match=r"give one in optimizer\.start_from"):
        read_run(tmp_path / RUN_FILE)
