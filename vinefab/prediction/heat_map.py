"""Where a design goes on one map: many deployments from varied poses, laid on each other."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import shapely
from shapely import LineString

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.units import deg, rad
from vinefab.core.validation import Floats
from vinefab.core.view import Data, Number, Picture, Rows, Section
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.plan import Plans
from vinefab.maps.poses import draw_poses
from vinefab.model.deployment import STUCK_STOPS, Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.pages.page_files import page_svg
from vinefab.pages.plan import body_cells
from vinefab.prediction.family_deployments import PredictionPlan
from vinefab.prediction.pictures import heat_plan
from vinefab.tasks.evaluate import PreparedMap


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckSpot:
    """A place where branches get stuck repeatedly."""

    # x_mm, y_mm: mean position of the stuck tips
    x_mm: float
    y_mm: float
    percent: float  # share of the deployments that had a branch stuck there


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeatMap:
    """How often deployed bodies pass each place of a map."""

    world: Map  # the map
    low_mm: tuple[float, float]  # lower left corner of the raster
    cell_mm: float  # side of its cells
    # share of the deployments whose body covers each cell, shape (rows, columns), row 0 at the
    # bottom, 0 to 1
    share: Floats
    deployments: int  # how many there were
    spots: tuple[StuckSpot, ...]  # where branches got stuck, the most frequent first
    spread: str  # how far the poses differ, in words

    def __post_init__(self) -> None:
        if self.share.ndim != 2 or not ((self.share >= 0.0) & (self.share <= 1.0)).all():
            raise BadInputError("share", self.share.shape, "shares from 0 to 1 in rows and columns")
        self.share.setflags(write=False)

    def percent_passed(self, least: float = 0.0) -> float:
        """Return the share of the free space that more than a share of the deployments cover.

        Bodies lie in free space, so that covered cells are free ones up to a cell's width.
        """
        passed_mm2 = float((self.share > least).sum()) * self.cell_mm**2
        return min(100.0, 100.0 * passed_mm2 / self.world.free_space.area)


POSES = 200

_CELLS = 320
"""Cells along the longer side of the map."""

LEAST_SPREAD_MM, LEAST_SPREAD_DEG = 10.0, 15.0
"""Poses vary by so much where a map gives its starts no range [assumed]."""

SPOT_SHARE = 0.03
"""Tips within cells of this share of the map's longer side count as one place."""

MOST_SPOTS = 8


def heat_map_of(
    design: Design, prepared_map: PreparedMap, trials: PredictionPlan, poses: int = POSES
) -> HeatMap:
    """Return where a design goes on a map from varied poses."""
    world = prepared_map.world
    # The default range of poses where the map gives none.
    spread: dict[str, Any] = {
        "spread_x_mm": LEAST_SPREAD_MM,
        "spread_y_mm": LEAST_SPREAD_MM,
        "spread_heading_rad": rad(LEAST_SPREAD_DEG),
    }
    starts = tuple(one if one.has_spread else replace(one, **spread) for one in world.starts)
    varied = replace(world, starts=starts)
    drawn = draw_poses(varied, poses, trials.seed)
    launches = Launches.of(TerrainSet([prepared_map.terrain]), [drawn])
    batch = Batch(Plans.of([design], trials.options), launches, trials.options)
    deployments = batch.deployments()
    x_min, y_min, x_max, y_max = world.bounds.bounds
    low_mm, cell_mm = (x_min, y_min), max(world.size_mm) / _CELLS
    shape = math.ceil((y_max - y_min) / cell_mm), math.ceil((x_max - x_min) / cell_mm)
    passed = np.zeros(shape)
    for deployment in deployments:
        passed += body_cells(deployment, design.build.widths_mm, low_mm, cell_mm, shape)
    start = varied.starts[0]
    where = f"{start.spread_x_mm:g} mm across, {start.spread_y_mm:g} mm along the map"
    if start.area is not None:
        kind = "line" if isinstance(start.area, LineString) else "area"
        where = f"from the free part of the start's {kind}"
    return HeatMap(
        world=world,
        low_mm=low_mm,
        cell_mm=cell_mm,
        share=passed / len(deployments),
        deployments=len(deployments),
        spots=stuck_spots(deployments, SPOT_SHARE * max(world.size_mm)),
        spread=f"{where} and {deg(start.spread_heading_rad):g} degrees either way",
    )


def stuck_spots(deployments: Sequence[Deployment], apart_mm: float) -> tuple[StuckSpot, ...]:
    """Return the places where branches are stuck in most deployments.

    The tip with most other deployments' tips around it makes the first place, and takes those
    with it; then the next.
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
    spots: list[StuckSpot] = []
    while left.any() and len(spots) < MOST_SPOTS:
        counts = [len(np.unique(owner[a[left[a]]])) if left[i] else 0 for i, a in enumerate(around)]
        place = around[int(np.argmax(counts))]
        members = place[left[place]]
        x_mm, y_mm = tips[members].mean(axis=0).tolist()
        share = 100.0 * len(np.unique(owner[members])) / len(deployments)
        spots.append(StuckSpot(x_mm=x_mm, y_mm=y_mm, percent=share))
        left[members] = False
    return tuple(spots)


def heat_blocks(heat: HeatMap) -> Iterator[Data | Section]:
    """Yield where robots go on one map, and where they get stuck."""
    often, ever = heat.percent_passed(0.5), heat.percent_passed()
    yield Data(
        {
            "heat": {
                "map": heat.world.name,
                "deployments": heat.deployments,
                "cell_mm": round(heat.cell_mm, 2),
                "ever_passed_percent": round(ever, 1),
                "mostly_passed_percent": round(often, 1),
            }
        }
    )
    number = partial(Number, form=".1f", decimals=1)
    words = (
        f"{counted(heat.deployments, 'deployment')} on {heat.world.name}, poses drawn "
        f"{heat.spread} (uniform; "
        f"simulated). Some body covers {ever:.1f} % of the free space; more than half of the "
        f"deployments cover {often:.1f} %. The raster's cells are {heat.cell_mm:.2f} mm."
    )
    yield Section(
        title="Where it goes and where it gets stuck",
        paragraphs=(words, *([] if heat.spots else ["No branch got stuck on this map."])),
        pictures=(
            Picture(
                image=lambda: page_svg(heat_plan(heat)),
                caption=f"{heat.world.name}: share of the deployments whose body passes each "
                "place, and rings where branches get stuck, numbered as in the table (simulated).",
            ),
        ),
        tables=(
            Rows(
                caption="Where branches stop head-on or in a corner most often (simulated)",
                headings=("place", "x mm", "y mm", "% of deployments"),
                rows=tuple(
                    (place, number(spot.x_mm), number(spot.y_mm), number(spot.percent))
                    for place, spot in enumerate(heat.spots, start=1)
                ),
                key="heat.stuck",
                keys=("", "x_mm", "y_mm", "percent"),
            ),
        ),
        folded=True,
    )
