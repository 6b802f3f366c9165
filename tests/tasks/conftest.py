"""Final states made by hand, so that tasks are tested without the simulator."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from shapely import Polygon, box

from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose
from vinefab.tasks.map_context import MapContext

Chain = Sequence[tuple[float, float]]


@pytest.fixture
def fork() -> Design:
    """A trunk of 100 mm with two children of 50 mm."""
    level = Level(branches=2, length_mm=50.0, fan_rad=1.0)
    return Design(name="fork", trunk_length_mm=100.0, levels=(level,), build=Build.standard(2))


@pytest.fixture
def ended() -> Callable[..., Deployment]:
    """Return ``ended(design, chains, turns)``: chains per branch, None for one not deployed."""

    def make(
        design: Design, chains: Sequence[Chain | None], turns: Sequence[float] | None = None
    ) -> Deployment:
        points = [np.array(chain if chain else np.empty((0, 2)), dtype=float) for chain in chains]
        lengths = [np.hypot(*np.diff(p, axis=0).T).sum() if len(p) else 0.0 for p in points]
        codes = [Stop.FULL_LENGTH if chain else Stop.NOT_DEPLOYED for chain in chains]
        return Deployment(
            tree=design.tree,
            pose=Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0),
            points_mm=np.concatenate(points),
            first_point=np.cumsum([0] + [len(p) for p in points]),
            stop=np.array(codes, dtype=np.int64),
            grown_mm=np.array(lengths),
            contact_turn_rad=np.array(turns if turns is not None else [0.0] * len(chains)),
        )

    return make


@pytest.fixture
def room() -> Map:
    """An empty room of 1000 x 1000 mm."""
    return Map(name="room", bounds=box(0, 0, 1000, 1000))


@pytest.fixture
def pillar_room() -> Map:
    """A room of 400 x 300 mm with a square pillar and one triangle on the wall."""
    triangle = Polygon([(300, 300), (400, 300), (400, 200)])
    return Map(
        name="pillars", bounds=box(0, 0, 400, 300), obstacles=(box(150, 100, 250, 200), triangle)
    )


@pytest.fixture
def room_context(room: Map) -> MapContext:
    return MapContext.of(room)
