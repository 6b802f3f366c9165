"""The front of a run as designs, file, table and picture."""

from dataclasses import replace

import pytest

from tests.search.conftest import optimize
from vinefab.core.errors import UnreadableFileError
from vinefab.growth.options import GrowthOptions, trained_growth
from vinefab.maps.generators.grid import grid_map
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import Words
from vinefab.search.front import FrontFile, front_of, front_picture, front_table
from vinefab.search.settings import (
    EvaluationSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import Bounds, SpaceSettings

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
    content = FrontFile.of(members, run, settings)
    assert [one.better for one in content.objectives] == ["larger", "larger"]
    for entry, member in zip(content.designs, members, strict=True):
        assert entry.values["reach"] == member.score.composite["reach"] == member.further[0]
    assert str(front_table(members, settings).rows[0][2]) == f"{members[0].further[0]:.4f}"
    assert b"reach score (simulated)" in page_svg(front_picture(members, run, settings, WORLD))


def test_file_and_table_describe_the_front(result, tmp_path):
    members = front_of(result, SETTINGS)
    content = FrontFile.of(members, result, SETTINGS)
    path = tmp_path / "front.json"
    path.write_text(content.json_text())
    assert FrontFile.read(path) == content
    path.write_text(content.json_text().replace('"film_length": ', '"film": '))
    with pytest.raises(UnreadableFileError, match="has other objectives than the front"):
        FrontFile.read(path)
    path.write_text(content.json_text().replace("front-2", "front-1"))
    with pytest.raises(UnreadableFileError, match="is not a file of schema vinefab/front-2"):
        FrontFile.read(path)
    assert [one.better for one in content.objectives] == ["larger", "smaller", "smaller"]
    for entry, member in zip(content.designs, members, strict=True):
        assert entry.design == member.design.name
        assert entry.values["film_length"] == member.further[0]
        assert entry.values["coverage"] == member.score.composite["mean"]
    names = [member.design.name for member in members if member.is_knee]
    assert content.knee == (names[0] if names else None)
    table = front_table(members, SETTINGS)
    assert [row[0] for row in table.rows] == [member.design.name for member in members]
    assert ("no knee" in table.caption) == (not names)


def test_a_knee_is_named_where_there_is_one(result):
    """The same finalists with fitness that rises early, and with fitness that rises late."""
    settings = SETTINGS.changed(objectives=("coverage", "film_length"))
    by_cost = sorted(result.finalists, key=lambda f: f.design.tree.total_length_mm)
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
        assert FrontFile.of(members, flat, settings).knee is None
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
