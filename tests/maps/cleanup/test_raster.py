import math

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.maps.cleanup.cell_walls import Mask
from vinefab.maps.cleanup.raster import GridPlacement, RasterOptions, raster_map
from vinefab.maps.poses import draw_poses
from vinefab.model.map import Map, Pose


def room() -> Mask:
    """Return a room of 20 x 10 cells with a pillar, and a small closet on its left."""
    free = np.zeros((14, 30), dtype=bool)
    free[2:12, 8:28] = True
    free[6:8, 16:19] = False
    free[3:6, 1:4] = True
    return free


def made(free: Mask, placement: GridPlacement | None = None, **options: object) -> Map:
    return raster_map(
        "room",
        free,
        placement or GridPlacement(cell_mm=10.0),
        RasterOptions(**options),  # type: ignore[arg-type]
        {"source": "test"},
    )


def test_the_largest_region_becomes_bounds_and_its_islands_obstacles() -> None:
    world = made(room())
    assert world.bounds.equals(shapely.box(80, 20, 280, 120))
    (pillar,) = world.obstacles
    assert pillar.equals(shapely.box(160, 60, 190, 80))
    assert world.facts["free_regions_left_out"] == 1
    assert world.facts["free_area_left_out_mm2"] == 900.0
    assert world.facts["source"] == "test"
    assert world.facts["deviation_mm"] == 0.0
    assert world.facts["walls"] == world.wall_count == 8


def test_the_start_chooses_the_region() -> None:
    pose = Pose(x_mm=25, y_mm=45, heading_rad=0)
    world = made(room(), start=pose)
    assert world.bounds.equals(shapely.box(10, 30, 40, 60))
    assert world.starts[0].pose == pose


def test_placement_scales_turns_and_moves() -> None:
    quarter = GridPlacement(cell_mm=10.0, x_mm=1000.0, y_mm=500.0, turn_rad=math.pi / 2)
    world = made(room(), quarter)
    assert world.bounds.equals(shapely.box(880, 580, 980, 780))
    inside = Pose(x_mm=955, y_mm=525, heading_rad=0)
    assert quarter.cell_at(inside) == (4, 2)
    assert made(room(), quarter, start=inside).bounds.equals(shapely.box(940, 510, 970, 540))


def test_the_offered_start_has_the_most_room_and_looks_along_the_longest_way() -> None:
    free = np.zeros((30, 60), dtype=bool)
    free[2:28, 2:28] = True
    free[13:17, 28:58] = True
    world = made(free)
    (start,) = world.starts
    assert math.hypot(start.pose.x_mm - 150, start.pose.y_mm - 150) < 30
    assert start.pose.heading_rad == pytest.approx(0.0, abs=0.18)
    clearance = world.bounds.exterior.distance(shapely.Point(start.pose.x_mm, start.pose.y_mm))
    assert clearance > 0.9 * 130
    assert len(draw_poses(world, 50, 0)) == 50


def test_small_obstacles_are_left_out_only_when_asked_and_then_counted() -> None:
    free = room()
    free[4, 10] = False
    assert len(made(free).obstacles) == 2
    world = made(free, least_obstacle_mm2=150.0)
    assert len(world.obstacles) == 1
    assert world.facts["obstacles_left_out"] == 1
    assert world.facts["largest_obstacle_left_out_mm2"] == 100.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"simplify_mm": 7.0}, r"simplify_mm is 7.0; allowed: at least 7.5 mm"),
        ({"simplify_mm": math.nan}, "simplify_mm"),
        ({"least_obstacle_mm2": -1.0}, "least_obstacle_mm2"),
        (
            {"start": Pose(x_mm=5, y_mm=5, heading_rad=0)},
            r"start is '\(5, 5\) mm'; allowed: a free",
        ),
        ({"start": Pose(x_mm=-5, y_mm=900, heading_rad=0)}, r"start is '\(-5, 900\) mm'"),
    ],
)
def test_bad_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        made(room(), **options)


def test_nothing_free_is_refused() -> None:
    with pytest.raises(BadInputError, match="no free cell"):
        made(np.zeros((4, 4), dtype=bool))


def test_areas_before_and_after_are_recorded() -> None:
    row, column = np.mgrid[:60, :60]
    world = made(np.hypot(row - 30, column - 30) < 25)
    before, after = (world.facts[f"free_area_of_{kind}_mm2"] for kind in ("cells", "walls"))
    assert after == pytest.approx(before, rel=0.02)
    assert world.free_space.area == pytest.approx(after, rel=1e-6)
    assert 0 < world.facts["deviation_mm"] <= 10.0
