"""Where a design goes on one map: many deployments from varied poses, laid on each other."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from PIL import Image, ImageDraw

from vinefab.core.units import deg, rad
from vinefab.environments.poses import draw_poses
from vinefab.growth.atlas import Atlas
from vinefab.growth.batch import Batch, Launches
from vinefab.growth.plans import Plans
from vinefab.model.checked import Floats
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.heat import Heat, Spot
from vinefab.model.map import Map, Start
from vinefab.physics.lumen import inflated_diameter_mm
from vinefab.pipeline.predict import Trials
from vinefab.pipeline.predict_measures import STUCK_STOPS
from vinefab.tasks.evaluate import Site

POSES = 200
CELLS = 320
"""Cells along the longer side of the map."""

LEAST_SPREAD_MM, LEAST_SPREAD_DEG = 10.0, 15.0
"""Poses vary by so much where a map gives its starts no range [assumed]."""

SPOT_SHARE = 0.03
"""Tips within cells of this share of the map's longer side count as one place."""

MOST_SPOTS = 8


def heat_of(design: Design, site: Site, trials: Trials, poses: int = POSES) -> Heat:
    """Return where a design goes on a map from varied poses.

    Parameters
    ----------
    design
        The robot.
    site
        The map.
    trials
        Seed and growth model.
    poses
        How many poses are drawn.
    """
    world = site.world
    varied = replace(world, starts=tuple(_varied(start) for start in world.starts))
    drawn = draw_poses(varied, poses, trials.seed)
    launches = Launches.of(Atlas([site.terrain]), [drawn])
    batch = Batch(Plans.of([design], trials.options), launches, trials.options)
    deployments = batch.deployments()
    low_mm, cell_mm, shape = _raster(world)
    passed = np.zeros(shape)
    for deployment in deployments:
        passed += body_cells(deployment, design.build.widths_mm, low_mm, cell_mm, shape)
    start = varied.starts[0]
    return Heat(
        world=world,
        low_mm=low_mm,
        cell_mm=cell_mm,
        share=passed / len(deployments),
        deployments=len(deployments),
        spots=stuck_spots(deployments, SPOT_SHARE * max(world.size_mm)),
        spread=f"{start.spread_x_mm:g} mm across, {start.spread_y_mm:g} mm along the map and "
        f"{deg(start.spread_heading_rad):g} degrees either way",
    )


def body_cells(
    deployment: Deployment,
    widths_mm: Sequence[float],
    low_mm: tuple[float, float],
    cell_mm: float,
    shape: tuple[int, int],
) -> Floats:
    """Return 1 where a deployed body covers a cell's middle, else 0, within about a cell.

    Parameters
    ----------
    deployment
        The robot as it lies.
    widths_mm
        Lay-flat width of each level.
    low_mm, cell_mm, shape
        Corner, cell side, and rows and columns of the raster; row 0 is at the bottom.
    """
    picture = Image.new("1", (shape[1], shape[0]))
    draw = ImageDraw.Draw(picture)
    for branch in np.flatnonzero(deployment.deployed).tolist():
        across = inflated_diameter_mm(widths_mm[int(deployment.tree.level[branch]) - 1]) / cell_mm
        chain = (deployment.chain_mm(branch) - np.array(low_mm)) / cell_mm - 0.5
        draw.line([(x, y) for x, y in chain.tolist()], fill=1, width=max(1, round(across)))
        for x, y in chain.tolist():
            half = across / 2.0
            draw.ellipse((x - half, y - half, x + half, y + half), fill=1)
    return np.asarray(picture, dtype=np.float64)


def stuck_spots(deployments: Sequence[Deployment], apart_mm: float) -> tuple[Spot, ...]:
    """Return the places where branches are stuck in most deployments.

    The tip with most other deployments' tips around it makes the first place, and takes those
    with it; then the next.

    Parameters
    ----------
    deployments
        On one map.
    apart_mm
        Tips nearer than this count as one place.
    """
    found = [
        (tip, number)
        for number, deployment in enumerate(deployments)
        for tip in deployment.tips_mm[np.isin(deployment.stop[deployment.deployed], STUCK_STOPS)]
    ]
    tips = np.array([tip for tip, _ in found]).reshape(-1, 2)
    owner = np.array([number for _, number in found], dtype=np.int64)
    points = np.asarray(shapely.points(tips))
    near = shapely.STRtree(points).query(points, "dwithin", apart_mm)
    around = [near[1][near[0] == index] for index in range(len(tips))]
    left = np.ones(len(tips), dtype=np.bool_)
    spots: list[Spot] = []
    while left.any() and len(spots) < MOST_SPOTS:
        counts = [len(np.unique(owner[a[left[a]]])) if left[i] else 0 for i, a in enumerate(around)]
        place = around[int(np.argmax(counts))]
        members = place[left[place]]
        x_mm, y_mm = tips[members].mean(axis=0).tolist()
        share = 100.0 * len(np.unique(owner[members])) / len(deployments)
        spots.append(Spot(x_mm=x_mm, y_mm=y_mm, percent=share))
        left[members] = False
    return tuple(spots)


def _varied(start: Start) -> Start:
    """Return a start with a range of poses, whether the map gives one or not."""
    if start.spread_x_mm or start.spread_y_mm or start.spread_heading_rad:
        return start
    return replace(
        start,
        spread_x_mm=LEAST_SPREAD_MM,
        spread_y_mm=LEAST_SPREAD_MM,
        spread_heading_rad=rad(LEAST_SPREAD_DEG),
    )


def _raster(world: Map) -> tuple[tuple[float, float], float, tuple[int, int]]:
    x_min, y_min, x_max, y_max = world.bounds.bounds
    cell_mm = max(world.size_mm) / CELLS
    rows, columns = math.ceil((y_max - y_min) / cell_mm), math.ceil((x_max - x_min) / cell_mm)
    return (x_min, y_min), cell_mm, (rows, columns)
