"""Designs as points of a space, their costs, and limits of them."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.fabrication.rules.spacing import capsules_of
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import Build, Design, Level, Pouch
from vinefab.model.map import Pose
from vinefab.outline.body_outline import body_outline, flat_layout
from vinefab.search import space as space_module
from vinefab.search.record.generations import RunIdentity
from vinefab.search.run import Search, violations_of
from vinefab.search.settings import PartSettings
from vinefab.search.space import (
    COSTS,
    Bounds,
    BuildSettings,
    DesignBatch,
    Space,
    SpaceSettings,
    cost_text,
)

TABLE_1 = Space(SpaceSettings(), BuildSettings())
POINTS = st.lists(st.floats(0.0, 1.0), min_size=18, max_size=18).map(np.array)


@given(POINTS)
def test_a_design_leads_back_to_itself(x):
    design = TABLE_1.design(x)
    assert TABLE_1.design(TABLE_1.vector(design)) == design
    assert design.trunk_length_mm == round(design.trunk_length_mm, 2)


def test_the_ends_of_the_cube_are_the_ends_of_the_ranges():
    least, most = TABLE_1.design(np.zeros(18)), TABLE_1.design(np.ones(18))
    assert (least.depth, least.trunk_length_mm, least.levels[0].branches) == (2, 10.0, 2)
    assert (most.depth, most.trunk_length_mm, most.levels[3].branches) == (5, 205.0, 4)


def test_fixed_values_and_single_levels_leave_the_vector():
    settings = SpaceSettings(
        levels=Bounds(low=3, high=3),
        branches=Bounds(low=2, high=2),
        by_level={1: {"length_mm": Bounds(low=80.0, high=80.0)}},
    )
    space = Space(settings, BuildSettings(trunk_width_mm=30.0, width_ratio=0.5))
    assert [(v.level, v.name) for v in space.variables] == [
        (level, name) for level in (2, 3) for name in ("length_mm", "angle_deg", "growth_percent")
    ]
    design = space.design(np.full(6, 0.3))
    assert design.trunk_length_mm == 80.0
    assert design.depth == 3
    assert design.build.widths_mm == (30.0, 15.0, 7.5)


def test_a_design_outside_the_bounds_gives_the_nearest_point():
    far = Design(name="far", trunk_length_mm=900.0, build=BuildSettings().build(1))
    assert TABLE_1.design(TABLE_1.vector(far)).trunk_length_mm == 205.0


POUCHES = (
    None,
    Pouch(shape="round", radius_mm=30.0),
    Pouch(shape="rectangle", length_mm=50.0, width_mm=70.0),
)


def twin(design):
    """The costs of one design, as one would compute them by hand."""
    tree = design.tree
    capsules = capsules_of(flat_layout(design), design.build)
    ends = np.concatenate([capsules.end_mm, capsules.start_mm[1:]])
    halves = np.concatenate([capsules.end_half_mm, capsules.half_mm[1:]])[:, None]
    mouth = capsules.start_mm[0] + [[0.0, capsules.half_mm[0]], [0.0, -capsules.half_mm[0]]]
    corners = np.concatenate([ends + halves, ends - halves, mouth])
    return {
        "film_length": tree.total_length_mm,
        "film_area": float(tree.length_mm @ np.array(design.build.widths_mm)[tree.level - 1]),
        "sheet_area": float(np.ptp(corners, axis=0).prod()),
        "branches": len(tree),
    }


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), pouch=st.sampled_from(POUCHES), symmetric=st.booleans())
def test_costs_of_a_batch_are_those_of_its_designs(seed, pouch, *, symmetric):
    ranges = SpaceSettings(
        levels=Bounds(low=1, high=4), branches=Bounds(low=1, high=4), symmetric=symmetric
    )
    space = Space(ranges, BuildSettings(pouch=pouch))
    x = np.random.default_rng(seed).random((6, len(space)))
    batch = space.batch(x)
    for name, cost in COSTS.items():
        values = cost.of(batch, space.build_of)
        for row, value in enumerate(values.tolist()):
            design = space.design(x[row])
            assert value == pytest.approx(twin(design)[name], rel=1e-9)
            alone = cost.of(DesignBatch.of(design), space.build_of)
            assert alone.tolist() == pytest.approx([value], rel=1e-12)


def test_large_batches_are_measured_some_at_a_time(monkeypatch):
    space = Space(SpaceSettings(), BuildSettings())
    batch = space.batch(np.random.default_rng(2).random((30, len(space))))
    whole = COSTS["sheet_area"].of(batch, space.build_of)
    for most in (1, 50, 700):
        monkeypatch.setattr(space_module, "BRANCHES_AT_ONCE", most)
        assert COSTS["sheet_area"].of(batch, space.build_of).tolist() == whole.tolist()
    assert len(COSTS["sheet_area"].of(batch.part(np.arange(0)), space.build_of)) == 0


def test_costs_of_a_design_done_by_hand():
    fork = Level(branches=2, length_mm=50.0, fan_rad=np.pi, growth=1.5)
    build = Build(widths_mm=(20.0, 10.0), fillet_mm=(2.0,), tail_mm=30.0)
    design = Design(name="fork", trunk_length_mm=100.0, levels=(fork,), build=build)
    one = DesignBatch.of(design)
    values = {name: cost.of(one, lambda _: build).tolist() for name, cost in COSTS.items()}
    assert values["film_length"] == [100.0 + 50.0 + 75.0]
    assert values["film_area"] == [100.0 * 20.0 + 125.0 * 10.0]
    assert values["branches"] == [3.0]
    # From the mouth to the trunk's round end, and from one tip to the other.
    assert values["sheet_area"] == pytest.approx([(30.0 + 100.0 + 10.0) * (50.0 + 75.0 + 10.0)])


def test_the_sheet_holds_the_outline():
    space = Space(SpaceSettings(levels=Bounds(low=3, high=3)), BuildSettings(trunk_width_mm=24.0))
    design = space.design(np.full(len(space), 0.4))
    x_min, y_min, x_max, y_max = body_outline(design).contour.box_mm
    (area,) = COSTS["sheet_area"].of(DesignBatch.of(design), space.build_of).tolist()
    assert area == pytest.approx((x_max - x_min) * (y_max - y_min), rel=1e-6)


def limited(small, most):
    return small.changed(space=small.space.changed(most=most))


MOST = {"film_length": 900.0, "film_area": 25_000.0, "sheet_area": 120_000.0, "branches": 12.0}


@pytest.mark.parametrize("name", MOST)
def test_winners_keep_limits_that_the_search_would_exceed(small, maps, name):
    def cost(design):
        return twin(design)[name]

    free = Search.of(small, maps).run()
    assert cost(free.best) > MOST[name]
    settings_ = limited(small, {name: MOST[name]})
    search = Search.of(settings_, maps)
    result = search.run(workers=2)
    assert all(cost(finalist.design) <= MOST[name] for finalist in result.finalists)
    assert result.fabricable
    assert violations_of(result, settings_) == ""
    value = cost_text(name, cost(result.best))
    assert f"limits: {value} of {MOST[name]:g} (planned)" in result.summary
    space = Space(settings_.space, settings_.build)
    for generation in result.history:
        for x, penalty, fitness in zip(
            generation.x, generation.penalty, generation.fitness, strict=True
        ):
            excess = max(0.0, cost(space.design(x)) / MOST[name] - 1.0)
            assert penalty == pytest.approx(excess, abs=1e-9)
            assert (fitness < search.evaluator.lowest) == (excess > 0.0)


@pytest.mark.parametrize("most", [{"branches": 9.0}, {"film_length": 700.0, "sheet_area": 9e4}])
def test_islands_evaluate_only_designs_within_the_limits(small, maps, most):
    islands = limited(small, most).changed(optimizer=PartSettings(name="islands"))
    result = Search.of(islands, maps).run()
    assert sum(len(generation.x) for generation in result.history) >= 20
    assert all((generation.penalty == 0.0).all() for generation in result.history)
    assert all(twin(result.best)[name] <= limit for name, limit in most.items())


def test_limits_add_to_the_penalty_of_rules(fabricable, maps, film_penalty):
    settings_ = limited(fabricable, {"branches": 2.0})
    result = Search.of(settings_, maps, film_penalty).run()
    space = Space(settings_.space, settings_.build)
    for generation in result.history:
        for x, penalty in zip(generation.x, generation.penalty, strict=True):
            design = space.design(x)
            excess = max(0.0, design.branch_count / 2.0 - 1.0)
            assert penalty == pytest.approx(film_penalty(design) + excess)
    assert result.best.branch_count <= 2


def test_a_winner_beyond_a_limit_is_named(small, maps):
    result = Search.of(small, maps).run()
    worst = replace(result.finalists[0], penalty=0.5)
    beyond = replace(result, finalists=(worst,))
    words = violations_of(beyond, limited(small, {"branches": 2.0}))
    assert words == f"space.most_branches (branches {result.best.branch_count}, limit 2)"


@pytest.mark.parametrize(
    ("most", "key", "words"),
    [
        ({"film_length": 14.0}, "space.most_film_length_mm", "at least 15 mm"),
        ({"film_area": 10.0}, "space.most_film_area_mm2", "every design of the space takes"),
        ({"sheet_area": 100.0}, "space.most_sheet_area_mm2", "at least 8600 mm2"),
        ({"branches": 0.5}, "space.most_branches", "at least 1,"),
        ({"branches": -1}, "most_branches", "equal to 0.000001"),
        ({"film_length": float("nan")}, "most_film_length_mm", "a finite number"),
        ({"paint": 3.0}, "most", "film_length"),
    ],
)
def test_limits_that_no_design_keeps_are_refused(small, maps, most, key, words):
    def search():
        trunk = {1: {"length_mm": Bounds(low=15.0, high=90.0)}}
        space = small.space.changed(by_level=trunk, most=most)
        Search.of(small.changed(space=space), maps)

    with pytest.raises(BadInputError, match=words) as caught:
        search()
    assert caught.value.key == key


def test_a_changed_limit_is_another_run(small, maps):
    ids = {
        RunIdentity.of(run, maps).run_id
        for run in (
            small,
            limited(small, {"branches": 9.0}),
            limited(small, {"branches": 8.0}),
            small.changed(space=small.space.changed(symmetric=True)),
        )
    }
    assert len(ids) == 4
    began = RunIdentity.of(limited(small, {"branches": 9.0}), maps)
    other = RunIdentity.of(limited(small, {"branches": 8.0}), maps)
    complaint = other.differs_from(began)
    assert complaint.key == "space.most_branches"
    assert "the run began with 9.0" in str(complaint)


def test_designs_of_a_symmetric_space_are_their_own_mirror_images():
    lopsided = Space(SpaceSettings(levels=Bounds(low=3, high=3)), BuildSettings())
    even = Space(
        SpaceSettings(levels=Bounds(low=3, high=3), symmetric=True),
        BuildSettings(trunk_width_mm=24.0),
    )
    assert len(even) == len(lopsided) - 2
    rng = np.random.default_rng(1)
    for _ in range(3):
        design = even.design(rng.random(len(even)))
        outline = shapely.make_valid(Polygon(body_outline(design).contour.flattened_mm(1e-3)))
        mirrored = shapely.transform(outline, lambda points: points * [1.0, -1.0])
        assert outline.symmetric_difference(mirrored).area < 1e-6 * outline.area
    layout = flat_layout(lopsided.design(np.full(len(lopsided), 0.3)))
    assert not np.allclose(layout.end_mm[:, 1].sum(), 0.0)


def test_a_symmetric_robot_grows_alike_on_both_sides():
    space = Space(SpaceSettings(symmetric=True), BuildSettings())
    design = space.design(np.full(len(space), 0.4))
    box = shapely.box(-4000.0, -4000.0, 4000.0, 4000.0)
    world = replace(grid_map(1), bounds=box, obstacles=(), starts=())
    tips = grow_on(design, Terrain.of(world), Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0)).tips_mm
    mirrored = tips * [1.0, -1.0]
    assert sorted(tips.round(6).tolist()) == sorted((mirrored + 0.0).round(6).tolist())
