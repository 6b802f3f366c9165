import math
from collections.abc import Callable

import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.tasks.ground import Ground
from vinefab.tasks.reach import Reach


def test_a_straight_body_reaches_a_stadium(
    fork: Design, ended: Callable[..., Deployment], room_ground: Ground
) -> None:
    end = ended(fork, [[(300, 500), (700, 500)], None, None])
    share, terms = Reach(buffer_mm=40.0).evaluate(end, room_ground)
    stadium = 400.0 * 80.0 + math.pi * 40.0**2
    assert share * 1e6 == pytest.approx(stadium, rel=2e-3)
    assert terms["grown_mm"] == 400.0


def test_solid_ground_is_not_reached(
    fork: Design, ended: Callable[..., Deployment], pillar_room: Map
) -> None:
    ground = Ground.of(pillar_room)
    end = ended(fork, [[(0, 50), (400, 50)], None, None])
    # A band from y = 0 to 110 over the whole width, less the pillar's lower 10 mm.
    share, terms = Reach(buffer_mm=60.0).evaluate(end, ground)
    assert terms["reached_mm2"] == pytest.approx(400 * 110 - 100 * 10)
    assert share == pytest.approx(terms["reached_mm2"] / (400 * 300 - 100**2 - 5000))


def test_a_buffer_without_width_is_refused() -> None:
    with pytest.raises(BadInputError, match="buffer_mm"):
        Reach(buffer_mm=0.0)
