import math
from collections.abc import Callable

import pytest

from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.map_context import MapContext

Ended = Callable[..., Deployment]
TASK = Coverage(
    radius_mm=50.0,
    most_branches=10,
    most_diagonals=2.0,
    weight_count=0.2,
    weight_length=0.3,
    weight_film=0.1,
)
DISC_MM2 = math.pi * 50.0**2


def film(context: MapContext) -> float:
    return 200.0 / (2.0 * context.diagonal_mm)


def test_discs_apart_pay_only_for_film(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    tips = [[(0, 0), (200, 200)], [(0, 0), (500, 500)], [(0, 0), (800, 800)]]
    score, terms = TASK.evaluate(ended(fork, tips), room_context)
    assert terms["area"] == pytest.approx(3 * DISC_MM2 / 1e6)
    assert terms["eta"] == 1.0
    assert terms["count"] == terms["length"] == 0.0
    assert score == pytest.approx(terms["area"] - 0.1 * film(room_context))


def test_discs_on_one_spot_have_an_efficiency_of_one_over_their_number(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    score, terms = TASK.evaluate(ended(fork, [[(0, 0), (500, 500)]] * 3), room_context)
    assert terms["eta"] == pytest.approx(1 / 3)
    assert terms["area"] == pytest.approx(DISC_MM2 / 1e6)
    assert terms["count"] == pytest.approx(3 / 10 * 2 / 3)
    assert terms["length"] == pytest.approx(film(room_context) * 2 / 3)
    expected = (
        terms["area"] - 0.2 * terms["count"] - 0.3 * terms["length"] - 0.1 * film(room_context)
    )
    assert score == pytest.approx(expected)


def test_two_discs_overlap_as_the_lens_formula_says(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    distance = 60.0
    chains = [[(0, 0), (500, 500)], [(0, 0), (500 + distance, 500)], None]
    _, terms = TASK.evaluate(ended(fork, chains), room_context)
    half = distance / 2
    lens = 2 * 50.0**2 * math.acos(half / 50.0) - distance * math.sqrt(50.0**2 - half**2)
    assert terms["area"] * 1e6 == pytest.approx(2 * DISC_MM2 - lens, rel=1e-3)
    assert terms["eta"] == pytest.approx(1 - lens / (2 * DISC_MM2), abs=1e-3)


def test_only_deployed_branches_see_and_all_planned_film_costs(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    score, terms = TASK.evaluate(ended(fork, [[(0, 0), (500, 500)], None, None]), room_context)
    assert terms["area"] == pytest.approx(DISC_MM2 / 1e6)
    assert terms["film"] == pytest.approx(film(room_context))
    assert score == pytest.approx(terms["area"] - 0.1 * terms["film"])


def test_nothing_is_seen_through_walls_and_efficiency_counts_free_area_alone(
    fork: Design, ended: Ended, pillar_room: Map
) -> None:
    context = MapContext.of(pillar_room)
    # On the middle of the pillar's lower side: half of the disc is solid.
    chains = [[(0, 0), (200, 100)], None, None]
    _, terms = TASK.evaluate(ended(fork, chains), context)
    assert terms["area"] * context.area_mm2 == pytest.approx(DISC_MM2 / 2, rel=1e-3)
    assert terms["eta"] == pytest.approx(1.0, abs=1e-3)
    _, raw = Coverage(clip="none").evaluate(ended(fork, chains), context)
    assert raw["area"] * context.area_mm2 == pytest.approx(DISC_MM2)


def test_terms_and_score_stay_in_their_ranges(
    fork: Design, ended: Ended, room_context: MapContext
) -> None:
    tiny = Coverage(radius_mm=2000.0, most_branches=1, most_diagonals=0.01)
    score, terms = tiny.evaluate(ended(fork, [[(0, 0), (500, 500)]] * 3), room_context)
    assert all(0.0 <= value <= 1.0 for value in terms.values())
    assert terms["area"] == pytest.approx(1.0)
    assert tiny.lowest <= score <= 1.0
