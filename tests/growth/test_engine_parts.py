"""Parts of the engines that whole growths do not show: release, the event guard, compiling."""

import math
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose
from shapely import Polygon, box

from vinefab.core import compiling
from vinefab.core.errors import NotCachedWarning
from vinefab.growth import batch
from vinefab.growth.arrays import Growth, Rules
from vinefab.growth.batch import KERNEL, MOST_EVENTS, TIE, TOLERANCE_RAD
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.map import Map

kernel = compiling.interpreted(KERNEL)

ROOM = Terrain.of(Map(name="room", bounds=box(-1000.0, -1000.0, 150.0, 1000.0)))
RULES = Rules(
    head_on_half_angle_rad=0.0,
    deploys_stuck=False,
    tolerance_mm=ROOM.tolerance_mm,
    tolerance_rad=TOLERANCE_RAD,
    tie=TIE,
    most_events=MOST_EVENTS,
    friction=0.0,
    drag_kpa_mm=0.0,
)
FITS = np.array([True])
RIGHT_WALL = int(np.flatnonzero(ROOM.walls().wall[:, 3] == 1.0)[0])

# A body from (0, 0) over a contact in (50, 60), wrapped while turning right, to a tip on the wall
# x = 150 that slides up: the body turns left and straightens over the contact at y = 180.
BASE, CONTACT, TIP = 0j, 50.0 + 60.0j, 150.0 + 100.0j


def test_release_in_the_kernel():
    growth = Growth.empty(1, 5)
    growth.points[1] = CONTACT.real, CONTACT.imag
    growth.chain_length[1] = abs(CONTACT)
    growth.chain_sense[1] = -1
    u = (TIP - CONTACT) / abs(TIP - CONTACT)
    tip = kernel.TipState(
        150.0, 100.0, u.real, u.imag, 1, RIGHT_WALL, 1100.0, 1.0, -1, kernel.GROWING
    )
    after = kernel._slide(ROOM.walls(), RULES, growth, tip, 0, 1000.0)
    assert after.pivot == 0
    assert_allclose([after.x, after.y], [150.0, 180.0], atol=1e-9)
    # Without the base to fall back to, or turning on in the same sense, nothing is released.
    assert kernel._slide(ROOM.walls(), RULES, growth, tip, 1, 1000.0).pivot == 1
    growth.chain_sense[1] = 1
    assert kernel._slide(ROOM.walls(), RULES, growth, tip, 0, 1000.0).pivot == 1


def test_rays_and_turning_bodies_meet_what_geometry_says():
    """The sums that the benchmark times: rays against a wall, a body turning over three corners."""
    rays = np.array([(0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.6, 0.8), (0.0, 0.0, -1.0, 0.0)])
    met = kernel.meet_all(ROOM.walls(), RULES, rays, np.full(3, RIGHT_WALL))
    assert met == pytest.approx(150.0 + 250.0)  # the third one goes away from it
    corners = [(50.0, 20.0), (60.0, 60.0), (40.0, 60.0)]
    world = Map(name="one", bounds=box(-200, -200, 400, 400), obstacles=(Polygon(corners),))
    walls = Terrain.of(world).walls()
    places = walls.vertex.tolist()
    vertex = np.array([places.index([*corner]) for corner in corners])
    # From (0, 0) to a tip at (100, 0) that slides up: over (x, y) when it is at 100 y / x.
    sweep = [0.0, 0.0, 100.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0, -1.0, -1.0, 1000.0]
    sweeps = np.tile(sweep, (3, 1))
    assert kernel.sweep_all(walls, RULES, sweeps, vertex) == pytest.approx(40.0 + 100.0 + 150.0)
    sweeps[:, -1] = 120.0
    assert kernel.sweep_all(walls, RULES, sweeps, vertex) == pytest.approx(40.0 + 100.0)


def _one_branch(engine, trunk_arrays, most_events, room=50):
    growth = Growth.empty(1, room)
    plan = trunk_arrays(1e5)
    start = (0.0, 0.0, math.cos(0.5), math.sin(0.5))
    rules = RULES._replace(most_events=most_events)
    done = engine.branches(ROOM.walls(), plan, FITS, rules, start, growth, 0, 1)
    return growth, done


def test_the_event_guard_ends_a_branch_as_corner(engine, trunk_arrays):
    growth, done = _one_branch(engine, trunk_arrays, 1)
    assert done == 1
    assert growth.stop[0] == Stop.CORNER
    assert_allclose(growth.points[1], [150.0, 150.0 * math.tan(0.5)], atol=1e-9)


def test_the_event_guard_is_far_away(engine, random_map, random_pose, trunk_arrays):
    most = 0
    for number in range(60):
        rng = np.random.default_rng([8, number])
        ground = Terrain.of(random_map(rng, ("convex", "star", "needles", "lattice")[number % 4]))
        pose = random_pose(rng, ground)
        growth = Growth.empty(1, 200)
        plan = trunk_arrays(5e3)
        start = (*ground.start_mm(pose), math.cos(pose.heading_rad), math.sin(pose.heading_rad))
        rules = RULES._replace(tolerance_mm=ground.tolerance_mm)
        engine.branches(ground.walls(), plan, FITS, rules, start, growth, 0, 1)
        most = max(most, int(growth.events[0]))
    assert 5 < most < MOST_EVENTS / 100


def test_too_little_room_is_reported_not_overrun(engine, trunk_arrays):
    growth, done = _one_branch(engine, trunk_arrays, MOST_EVENTS, room=1)
    assert done == 0
    assert growth.first_point[1] == 0


@pytest.mark.compiler
def test_code_is_compiled_without_a_cache_where_none_can_be_written(monkeypatch, tmp_path):
    file = tmp_path / "no folder"
    file.touch()
    monkeypatch.setenv("VINEFAB_CACHE_DIR", str(file))
    doubled = compiling.compiled(lambda x: 2 * x)
    with pytest.warns(NotCachedWarning, match="each command compiles anew; VINEFAB_CACHE_DIR"):
        assert doubled(21) == 42
    assert doubled(21.0) == 42.0  # once is enough: warnings are errors here


def test_compiler_is_not_imported_before_it_is_needed():
    code = "import sys, vinefab.growth.batch; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_interpreter_grows_a_bounded_number_of_branches_then_code_is_compiled(monkeypatch):
    assert batch.INTERPRETED_BRANCHES == 4000
    monkeypatch.delitem(sys.modules, batch.KERNEL, raising=False)
    monkeypatch.setattr(batch, "_ALLOWANCE", batch._Allowance())
    ordinary = 100
    assert batch.chosen_engine("auto", 1, batch.INTERPRETED_CORNERS + 1) == "kernel"
    chosen = [batch.chosen_engine("auto", n, ordinary) for n in (3000, 2000, 1000, 1)]
    assert chosen == ["interpreted", "kernel", "interpreted", "kernel"]
    # Once it is loaded, compiled code is the first to be done.
    monkeypatch.setattr(batch, "_ALLOWANCE", batch._Allowance())
    monkeypatch.setitem(sys.modules, batch.KERNEL, kernel)
    assert batch.chosen_engine("auto", 1, ordinary) == "kernel"
