import math

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from vinefab.model.map import Map, Pose, Start
from vinefab.rig.part import Printer
from vinefab.rig.part_files import STL, PartFileSpec, PartItem, read_back_problems


def _up(x_mm, y_mm, spread_x_mm=0.0):
    pose = Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=math.pi / 2)
    return Start(pose=pose, spread_x_mm=spread_x_mm)


@pytest.fixture(scope="session")
def up_start():
    """Makes a start that heads along +y."""
    return _up


@pytest.fixture(scope="session")
def make_map():
    """Makes a map of 180 x 150 mm, lower left at (10, 20), unless told otherwise."""

    def make(*obstacles, bounds=None, starts=None):
        return Map(
            name="table",
            bounds=bounds or box(10, 20, 190, 170),
            obstacles=obstacles,
            starts=(_up(100, 35),) if starts is None else starts,
        )

    return make


@pytest.fixture(scope="session")
def make_printer():
    def make(width_mm=220.0, depth_mm=220.0, height_mm=100.0, **others):
        return Printer(
            name="bench",
            bed_width_mm=width_mm,
            bed_depth_mm=depth_mm,
            height_mm=height_mm,
            **others,
        )

    return make


@pytest.fixture(scope="session")
def crooked_map(make_map):
    """Makes a map of convex polygons, one in each cell of a grid with a pitch of 40 mm."""

    def make(seed, columns, rows):
        rng = np.random.default_rng(seed)
        obstacles = []
        for row in range(rows):
            for column in range(columns):
                angles = 2 * np.pi * (np.arange(6) + rng.uniform(0, 0.8, 6)) / 6
                radius = rng.uniform(9, 17)
                middle = (40 * column + 20, 40 * row + 40)
                corners = middle + radius * np.c_[np.cos(angles), np.sin(angles)]
                obstacles.append(Polygon(corners))
        bounds = box(0, 0, 40 * columns, 40 * rows + 20)
        return make_map(*obstacles, bounds=bounds, starts=(_up(20 * columns, 10),))

    return make


@pytest.fixture(scope="session")
def faces_at():
    """Returns the plan, in map coordinates, of a rig's upward faces at a height of the map.

    It uses nothing but triangles and transforms: an independent way to see what was built.
    """

    def plan(rig, z_mm):
        found = []
        for part in rig.parts:
            points = part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]
            corners = points[part.faces]
            flat = (np.abs(corners[:, :, 2] - z_mm) < 1e-4).all(axis=1)
            normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            found += list(shapely.polygons(corners[flat & (normals[:, 2] > 0.0)][:, :, :2]))
        return shapely.union_all(found)

    return plan


@pytest.fixture(scope="session")
def stl_problems():
    """Returns what is wrong with an STL file of a part, the part's own file unless given."""

    def problems(part, data=None):
        item = PartItem(part=part)
        data = STL.write(PartFileSpec(items=[item], title=part.name)) if data is None else data
        return read_back_problems(STL, data, [item])[part.name]

    return problems
