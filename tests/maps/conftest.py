"""Options of all kinds for every environment."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import reject
from hypothesis import strategies as st

from vinefab.core.bounded import bounded
from vinefab.core.errors import BadInputError
from vinefab.core.table import declared_keys
from vinefab.maps.generators.cave import CaveOptions
from vinefab.maps.generators.corridors import CorridorsOptions
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.maps.generators.grid import GridOptions
from vinefab.maps.generators.pegs import PegsOptions
from vinefab.maps.generators.rubble import RubbleOptions
from vinefab.maps.importers import importers

Draw = Callable[[st.SearchStrategy[Any]], Any]
SHARE = st.floats(0.0, 1.0)
MOST_SLABS = 300
"""In a pile of rubble."""


def starts(draw: Draw) -> dict[str, Any]:
    return {
        "start_clearance_mm": draw(st.floats(0.0, 25.0)),
        "start_spread_x_mm": draw(st.floats(0.0, 20.0)),
        "start_spread_y_mm": draw(st.floats(0.0, 10.0)),
        "start_spread_heading_deg": draw(st.floats(0.0, 90.0)),
    }


@st.composite
def grids(draw: Draw) -> GridOptions:
    low = draw(st.floats(0.05, 0.3))
    high = draw(st.floats(low, 0.42))
    corners = draw(st.integers(3, 9))
    return GridOptions(
        columns=draw(st.integers(1, 7)),
        rows=draw(st.integers(2, 7)),
        filled=draw(st.sampled_from([0.3, 0.8, 1.0])),
        corners_min=corners,
        corners_max=draw(st.integers(corners, 12)),
        radius_min=low,
        radius_max=high,
        irregularity=draw(SHARE),
        concavity=draw(st.sampled_from([0.0, 0.4, 1.0])),
        jitter=draw(SHARE),
        gap_mm=draw(st.floats(0.0, 9.0)),
        starts=draw(st.integers(1, 3)),
        **starts(draw),
    )


@st.composite
def caves(draw: Draw) -> CaveOptions:
    radius = draw(st.floats(12.0, 30.0))
    width = draw(st.floats(8.0, 30.0))
    return CaveOptions(
        chambers=draw(st.integers(1, 20)),
        chamber_radius_min_mm=radius,
        chamber_radius_max_mm=radius + draw(st.floats(0.0, 25.0)),
        passage_width_min_mm=width,
        passage_width_max_mm=width + draw(st.floats(0.0, 20.0)),
        loops=draw(SHARE),
        wander=draw(SHARE),
        roughness=draw(SHARE),
        margin_mm=draw(st.floats(2.0, 30.0)),
        **starts(draw),
    )


@st.composite
def floors(draw: Draw) -> CorridorsOptions:
    wall, door = draw(st.floats(2.0, 10.0)), draw(st.floats(8.0, 30.0))
    least = door + 2.0 * wall
    room = 2.0 * least + wall + draw(st.floats(0.0, 30.0))
    start = starts(draw)
    wide = 2.0 * (max(start["start_clearance_mm"], 0.5 * door) + start["start_spread_x_mm"])
    return CorridorsOptions(
        width_mm=draw(st.floats(400.0, 800.0)),
        height_mm=draw(st.floats(400.0, 800.0)),
        halls=draw(st.integers(0, 2)),
        hall_width_mm=max(least, wide) + draw(st.floats(0.0, 20.0)),
        room_min_mm=room,
        room_max_mm=2.0 * room + wall + draw(st.floats(0.0, 100.0)),
        wall_mm=wall,
        door_mm=door,
        loops=draw(SHARE),
        **start,
    )


@st.composite
def boards(draw: Draw) -> PegsOptions:
    pitch = draw(st.floats(20.0, 60.0))
    diameter = pitch * draw(st.floats(0.1, 0.8))
    jitter = 0.4 * (pitch - diameter) * draw(SHARE)
    return PegsOptions(
        lattice=draw(st.sampled_from(["square", "hexagonal"])),
        columns=draw(st.integers(5, 12)),
        rows=draw(st.integers(5, 12)),
        pitch_mm=pitch,
        edge_mm=0.5 * diameter + jitter + draw(st.floats(0.1, 40.0)),
        diameter_mm=diameter,
        sides=draw(st.integers(3, 40)),
        filled=draw(SHARE),
        jitter_mm=jitter,
        **{**starts(draw), "start_clearance_mm": draw(st.floats(0.0, 15.0))},
    )


@st.composite
def piles(draw: Draw) -> RubbleOptions:
    passage, low = draw(st.floats(2.0, 30.0)), draw(st.floats(10.0, 60.0))
    thin = draw(st.floats(0.05, 0.5))
    # Thousands of the smallest slabs take half a minute, and show no more than hundreds do.
    smallest = thin * low**2 / 500.0**2
    return RubbleOptions(
        cover=draw(st.floats(0.0, min(0.3 - 0.009 * passage, MOST_SLABS * smallest))),
        slab_min_mm=low,
        slab_max_mm=low + draw(st.floats(40.0, 150.0)),
        exponent=draw(st.floats(0.0, 3.0)),
        thickness_min=thin,
        thickness_max=thin + draw(st.floats(0.0, 0.3)),
        raggedness=draw(SHARE),
        direction_deg=draw(st.floats(-180.0, 180.0)),
        direction_spread_deg=draw(st.floats(0.0, 90.0)),
        leaning=draw(SHARE),
        passage_mm=passage,
        starts=draw(st.integers(1, 3)),
        **starts(draw),
    )


@pytest.fixture(autouse=True)
def _read_here(monkeypatch):
    """Read foreign files in this process, where patches and coverage reach."""
    monkeypatch.setattr(importers, "bounded", lambda _path, read, *rest: read(*rest))


@pytest.fixture
def limits(_read_here, monkeypatch):
    """Read them as users do, in a child with limits."""
    monkeypatch.setattr(importers, "bounded", bounded)
    return monkeypatch


@st.composite
def nearby(draw: Draw, kind: type[Any]) -> Any:
    """Draw options with up to three numbers near their defaults; some are refused, rightly."""
    numbers = [key for key in declared_keys(kind) if isinstance(key.default, float)]
    chosen = draw(st.lists(st.sampled_from(numbers), max_size=3, unique_by=lambda key: key.field))
    try:
        return kind(**{key.field: key.default * draw(st.floats(0.8, 1.25)) for key in chosen})
    except BadInputError:
        reject()


@pytest.fixture(scope="session")
def any_options() -> dict[str, st.SearchStrategy[Any]]:
    """Return what to draw the options of each environment from: with a registration alone, near."""
    near = {name: nearby(one.options) for name, one in ENVIRONMENTS.items()}
    return near | {
        "grid": grids(),
        "cave": caves(),
        "corridors": floors(),
        "pegs": boards(),
        "rubble": piles(),
    }
