import numpy as np
import pytest
import shapely

from vinefab.maps.generators.grid import grid_map
from vinefab.tasks import wall_cells as cells
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.wall_cells import WallCells


def listed(index: WallCells, place: np.ndarray) -> set[int]:
    """The walls of a place's cell, counted out by hand."""
    low, side, (columns, rows) = index.grid[:2], index.grid[2], index.grid[3:]
    column, row = np.clip(np.floor((place - low) / side), 0, (columns - 1, rows - 1))
    cell = int(row * columns + column)
    return set(index.item[index.first[cell] : index.first[cell + 1]].tolist())


@pytest.mark.parametrize(("side", "reach"), [(7.0, 0.0), (30.0, 12.0), (5.0, 40.0), (500.0, 1.0)])
def test_no_wall_near_a_place_is_missing_and_few_far_ones_are_listed(
    side: float, reach: float
) -> None:
    rng = np.random.default_rng(6)
    walls = rng.uniform(0.0, 200.0, (60, 4))
    walls[:10, 3], walls[10:20, 2] = walls[:10, 1], walls[10:20, 0]
    index = WallCells.of(walls, side, reach)
    lines = shapely.linestrings(walls.reshape(-1, 2, 2))
    places = rng.uniform(0.0, 200.0, (200, 2))
    numbers = index.numbers_at(places)
    for place, number in zip(places, numbers.tolist(), strict=True):
        away = shapely.distance(lines, shapely.Point(place))
        here = listed(index, place)
        assert len(here) == number
        assert set(np.flatnonzero(away <= reach).tolist()) <= here
        # A cell is so wide across, and its rows and columns are looked at one after the other.
        assert away[list(here)].max(initial=0.0) < 2.0 * (side + reach) + reach


def test_places_outside_count_to_the_nearest_cell() -> None:
    index = WallCells.of(np.array([[0.0, 0.0, 10.0, 0.0], [90.0, 100.0, 100.0, 100.0]]), 10.0, 1.0)
    numbers = index.numbers_at(np.array([[-5.0, -5.0], [105.0, 101.0], [50.0, 50.0]]))
    assert numbers.tolist() == [1, 1, 0]


def test_an_index_that_would_be_too_large_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    walls = np.array([[0.0, 0.0, 100.0, 100.0], [0.0, 100.0, 40.0, 60.0]])
    assert WallCells.of(walls, 0.01, 0.0) is None
    monkeypatch.setattr(cells, "MOST_ENTRIES", 5)
    assert WallCells.of(walls, 10.0, 0.0) is None
    # A ground takes larger cells then, at last one with everything.
    ground = MapContext.of(grid_map(1))
    assert len(ground.cells.item) == len(ground.edges_mm)


def test_a_grounds_cells_hold_every_edge_and_not_all_of_them_everywhere() -> None:
    ground = MapContext.of(grid_map(1))
    assert ground.cells is ground.cells
    assert set(ground.cells.item.tolist()) == set(range(len(ground.edges_mm)))
    assert np.diff(ground.cells.first).max() < 0.1 * len(ground.edges_mm)
