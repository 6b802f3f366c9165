from typing import Any

import numpy as np
import pytest
import shapely

from vinefab.maps.generators.pegs import PegsOptions, pegs_map


def middles(**values: Any) -> np.ndarray:
    world = pegs_map(3, PegsOptions(**values))
    return shapely.get_coordinates(shapely.centroid(list(world.obstacles)))


def test_pegs_stand_in_holes_of_the_lattice() -> None:
    places = (middles() - 30.0) / 40.0
    assert places == pytest.approx(np.round(places), abs=1e-5)
    assert len({tuple(place) for place in np.round(places).tolist()}) == len(places)


def test_the_hexagonal_lattice_has_all_neighbours_a_pitch_away() -> None:
    places = middles(lattice="hexagonal", columns=5, rows=5, filled=1.0, start_clearance_mm=0.0)
    assert len(places) == 3 * 5 + 2 * 4
    away = np.hypot(*(places[:, None] - places).T)
    inner = np.argmin(np.hypot(*(places - places.mean(axis=0)).T))
    assert np.sort(away[inner])[1:7] == pytest.approx(40.0, abs=1e-3)


@pytest.mark.parametrize(("filled", "share"), [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0)])
def test_the_share_of_holes_is_exact(filled: float, share: float) -> None:
    count = len(pegs_map(0, PegsOptions(filled=1.0)).obstacles)
    assert count < 144
    assert len(pegs_map(0, PegsOptions(filled=filled)).obstacles) == round(share * count)


def test_a_fuller_board_keeps_its_pegs() -> None:
    few, many = (
        {polygon.wkb for polygon in pegs_map(5, PegsOptions(filled=filled)).obstacles}
        for filled in (0.3, 0.6)
    )
    assert few < many


def test_jitter_moves_pegs_by_at_most_its_value() -> None:
    still = middles(filled=1.0, start_clearance_mm=0.0, start_spread_x_mm=0.0)
    moved = middles(filled=1.0, start_clearance_mm=0.0, start_spread_x_mm=0.0, jitter_mm=5.0)
    off = np.hypot(*(moved - still).T)
    assert 4.0 < off.max() <= 5.0 + 1e-3
    assert off.mean() == pytest.approx(5.0 * 2 / 3, rel=0.1)


def test_pegs_are_regular_polygons_of_their_diameter() -> None:
    peg = pegs_map(0, PegsOptions(diameter_mm=20.0, sides=6)).obstacles[0]
    corners = np.array(peg.exterior.coords)[:-1]
    assert np.hypot(*(corners - corners.mean(axis=0)).T) == pytest.approx(10.0, abs=1e-3)
    assert peg.area == pytest.approx(1.5 * np.sqrt(3) * 100, rel=1e-4)
