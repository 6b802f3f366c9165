"""The page of a run that goes on, and the front as designs, JSON and a picture."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.search.conftest import followed, made_generation, optimize, progress_of
from vinefab.core.errors import CannotWriteError, InterruptedRunError
from vinefab.growth.options import GrowthOptions, trained_growth
from vinefab.maps.generators.grid import grid_map
from vinefab.model.tree import branch_tree
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import Shape, Words
from vinefab.prediction.run_winner import run_in_folder
from vinefab.search import run_pages
from vinefab.search.run_pages import (
    MOST_POINTS,
    PAGE_NAME,
    LivePage,
    fitness_curve,
    front_json,
    front_of,
    front_picture,
    front_table,
)
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import Bounds, SpaceSettings

SMALL_MAP = {"size_mm": 250.0, "columns": 3, "rows": 3}
"""The winner is tried on seventy maps: most of the time of such a short run."""


@pytest.fixture
def settings(small, monkeypatch):
    """A run on one map whose page is written after every generation."""
    monkeypatch.setattr(run_pages, "LEAST_PAUSE_S", 0.0)
    monkeypatch.setattr(run_pages, "_OF_PROCESSOR", 1e9)
    monkeypatch.setattr(run_pages, "_OF_TIME", 1e9)
    return small.changed(maps=MapSettings(count=1, options=SMALL_MAP))


def stopped_in(generation, seen, folder):
    def look(progress):
        seen.append((folder / PAGE_NAME).read_text())
        if progress.done == generation:
            raise KeyboardInterrupt

    return look


def test_the_page_shows_the_run_while_it_goes_on_and_says_how_to_go_on(settings, tmp_path):
    seen: list[str] = []
    with pytest.raises(KeyboardInterrupt), followed(stopped_in(3, seen, tmp_path)):
        run_in_folder(settings, tmp_path, again="do & it again")
    for number, page in enumerate(seen, start=1):
        assert f"Running: generations {number} of 5" in page
        assert '<meta http-equiv="refresh" content="5">' in page
        assert page.count('<img src="data:image/svg+xml;base64,') == 2
        assert "branches on" in page
    ended = (tmp_path / PAGE_NAME).read_text()
    assert "Interrupted after 3 of 5 generations." in ended
    assert "To go on: do &amp; it again" in ended
    assert 'http-equiv="refresh"' in ended  # a resumed run is seen by who left it open
    assert "http" not in re.sub(r"data:[^\"]*|http-equiv", "", ended)


def test_no_result_depends_on_the_page(settings, tmp_path):
    one = run_in_folder(settings, tmp_path / "one", again="", page=True).result
    two = run_in_folder(settings, tmp_path / "two", again="", page=False).result
    assert (one.best, one.prediction) == (two.best, two.prediction)
    assert not (tmp_path / "two" / PAGE_NAME).exists()


def test_a_page_that_cannot_be_written_stops_no_run(settings, tmp_path, monkeypatch):
    calls: list[Path] = []

    def full(path, _):
        calls.append(path)
        raise CannotWriteError(path, "disk full")

    monkeypatch.setattr(run_pages, "write_text", full)
    result = run_in_folder(settings, tmp_path, again="").result
    assert len(result.history) == 5
    assert len(calls) == 1


def test_a_refused_run_leaves_the_page_of_another_one(settings, tmp_path):
    (tmp_path / PAGE_NAME).write_text("written by vinefab: of another run")
    with pytest.raises(InterruptedRunError), LivePage(tmp_path, settings, ""):
        raise InterruptedRunError("before the first generation", "")
    assert (tmp_path / PAGE_NAME).read_text() == "written by vinefab: of another run"


def test_pages_are_written_no_oftener_than_their_cost_allows(settings, tmp_path, monkeypatch):
    now_s, written = [0.0], [0]
    monkeypatch.setattr(run_pages, "LEAST_PAUSE_S", 3.0)
    monkeypatch.setattr(run_pages, "_OF_TIME", 0.05)
    monkeypatch.setattr(run_pages.time, "monotonic", lambda: now_s[0])

    def slow(path, _):
        now_s[0] += 2.0
        written[0] += 1
        return path

    monkeypatch.setattr(run_pages, "write_text", slow)
    page = LivePage(tmp_path, settings, "")
    for _ in range(600):
        now_s[0] += 0.5
        page.update(progress(1))
    spent_s = 2.0 * written[0]
    assert written[0] > 3
    assert spent_s / now_s[0] < 0.07


def progress(count):
    """Return the progress after a generation in which one point is no design."""
    values = np.array([0.1, 0.3, -1e6])
    scores = np.array([0.1, 0.3, np.nan])
    first = made_generation(0, values, x=np.full((3, 10), 0.5), composite=scores)
    return progress_of(count, 10, [first])


def test_a_killed_session_leaves_no_half_written_page(settings, tmp_path):
    (tmp_path / f".{PAGE_NAME}.k1ll3d").write_text("half")
    LivePage(tmp_path, settings, "").update(progress(1))
    assert sorted(path.name for path in tmp_path.iterdir()) == [PAGE_NAME]


@pytest.mark.parametrize("count", [1, 2, 5 * MOST_POINTS])
def test_the_curve_is_drawn_at_any_length_within_its_frame(count):
    best = np.linspace(-5.0, 0.4, count)
    mean, spread = np.linspace(0.1, 0.3, count), np.full(count, 0.05)
    mean[0] = np.nan if count > 2 else mean[0]
    page = fitness_curve(best, mean, spread)
    assert b"nan" not in page_svg(page)
    (panel,) = page.panels
    lines = [one for one in panel.primitives if isinstance(one, Shape)]
    places = np.concatenate([chain for one in lines for chain in one.chains])
    x0, y0, x1, y1 = panel.box
    assert ((places >= (x0, y0)) & (places <= (x1, y1))).all()
    assert len(places) <= 4 * MOST_POINTS


def test_the_curve_of_designs_that_all_fail_is_empty():
    gap = np.full(3, np.nan)
    (panel,) = fitness_curve(gap, gap, gap).panels
    assert all(isinstance(one, Shape) and not one.chains for one in panel.primitives)
    assert page_svg(fitness_curve(gap, gap, gap)).startswith(b"<?xml")


SETTINGS = RunSettings(
    name="two",
    growth=GrowthOptions.published(),
    space=SpaceSettings(levels=Bounds(low=1, high=3)),
    optimizer=PartSettings(name="nsga2"),
    search=SearchSettings(population=10, generations=3, seed=2),
    evaluation=EvaluationSettings(fabricable=False, finalists=6, final_poses_per_map=1),
    objectives=("coverage", "film_length", "branches"),
)
WORLD = grid_map(1)


@pytest.fixture(scope="module")
def result():
    return optimize(SETTINGS, (WORLD,))


def test_a_front_rises_with_its_cost_and_no_member_dominates_another(result):
    members = front_of(result, SETTINGS)
    costs = [member.further for member in members]
    assert len(members) >= 2
    assert [cost[0] for cost in costs] == sorted(cost[0] for cost in costs)
    assert sum(member.is_knee for member in members) <= 1
    assert len({member.design.name for member in members}) == len(members)
    assert all(trained_growth(member.design) == SETTINGS.growth for member in members)
    for one in members:
        for other in members:
            as_cheap = all(a <= b for a, b in zip(one.further, other.further, strict=True))
            assert one is other or not (as_cheap and one.fitness >= other.fitness)


def test_a_front_of_two_tasks_goes_from_one_to_the_other():
    straight = {"targets": [[260.0, 488.0]], "falloff_mm": 480.0, "reached_by": "tip"}
    settings = SETTINGS.changed(
        objectives=("coverage", "reach"), other_parameters={"reach": straight}
    )
    run = optimize(settings, (WORLD,))
    members = front_of(run, settings)
    assert len(members) >= 2
    assert [m.further[0] for m in members] == sorted((m.further[0] for m in members), reverse=True)
    assert [m.fitness for m in members] == sorted(m.fitness for m in members)
    content = json.loads(front_json(members, run, settings))
    assert [entry["better"] for entry in content["objectives"]] == ["larger", "larger"]
    for entry, member in zip(content["designs"], members, strict=True):
        assert entry["reach"] == member.score.composite["reach"] == member.further[0]
    assert str(front_table(members, settings).rows[0][2]) == f"{members[0].further[0]:.4f}"
    assert b"reach score (simulated)" in page_svg(front_picture(members, run, settings, WORLD))


def test_json_and_text_describe_the_front(result):
    members = front_of(result, SETTINGS)
    content = json.loads(front_json(members, result, SETTINGS))
    assert content["schema"] == "vinefab/front-1"
    assert [entry["better"] for entry in content["objectives"]] == ["larger", "smaller", "smaller"]
    for entry, member in zip(content["designs"], members, strict=True):
        assert entry["design"] == member.design.name
        assert entry["film_length"] == member.further[0]
        assert entry["coverage"] == member.score.composite["mean"]
    names = [member.design.name for member in members if member.is_knee]
    assert content["knee"] == (names[0] if names else None)
    table = front_table(members, SETTINGS)
    assert [row[0] for row in table.rows] == [member.design.name for member in members]
    assert ("no knee" in table.caption) == (not names)


def test_a_knee_is_named_where_there_is_one(result):
    """The same finalists with fitness that rises early, and with fitness that rises late."""
    settings = SETTINGS.changed(objectives=("coverage", "film_length"))
    by_cost = sorted(result.finalists, key=lambda f: branch_tree(f.design).total_length_mm)
    assert len(by_cost) >= 4

    def with_fitness(power, count):
        shares = (index / (count - 1 or 1) for index in range(count))
        finalists = (
            replace(f, fitness=share**power) for f, share in zip(by_cost, shares, strict=False)
        )
        return replace(result, finalists=tuple(finalists))

    members = front_of(with_fitness(0.1, 4), settings)
    assert [member.is_knee for member in members] == [False, True, False, False]
    assert [row[-1] for row in front_table(members, settings).rows] == ["", "knee", "", ""]
    for power, count, why in (
        (9.0, 4, "no point lies 5% above"),
        (1.0, 2, "fewer than three designs"),
        (1.0, 1, "fewer than three designs"),
    ):
        flat = with_fitness(power, count)
        members = front_of(flat, settings)
        assert len(members) == count
        assert not any(member.is_knee for member in members)
        assert why in front_table(members, settings).caption
        assert json.loads(front_json(members, flat, settings))["knee"] is None
        assert page_svg(front_picture(members, flat, settings, WORLD))


def test_scores_of_the_search_and_fresh_ones_have_their_own_marker_and_words(result):
    page = front_picture(front_of(result, SETTINGS), result, SETTINGS, WORLD)
    chart = page.panels[0]
    assert {words: signs.sign for words, signs in chart.legend.items()} == {
        "in the search, on training poses": "x",
        "the front, scored again on fresh poses": "o",
    }
    assert "of one kind" in chart.title
    words = [one.text for one in page.layers[-1].primitives if isinstance(one, Words)]
    assert {"level 1", "body: a line without width"} <= set(words)
    assert "target" not in words
