"""The one check behind every importer: whether a map may be its source turned inside out."""

from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from vinefab.maps.cleanup.drawn_shapes import FREE_APART
from vinefab.model.map import Map


def with_doubts(world: Map) -> Map:
    """Return an imported map; what speaks for another reading of its source is noted in it.

    That is: most of the free area is left out or out of reach; or the free space is a frame
    around one solid that holds the rest.
    """
    apart: Any = world.facts.get(FREE_APART)
    if not isinstance(apart, dict):
        return world
    apart_mm2, in_map = float(apart["mm2"]), bool(apart["in_map"])
    kept_mm2 = float(world.free_space.area) - (apart_mm2 if in_map else 0.0)
    place = "{:.6g},{:.6g}".format(*apart["place_mm"])
    start = f"--start {place},0 takes the largest of it, around {place} mm"
    if apart_mm2 > kept_mm2:
        share = 100.0 * apart_mm2 / (apart_mm2 + kept_mm2)
        what = "cannot be reached from the start" if in_map else "is left out"
        doubt = f"{share:.0f} % of the free area {what}: {start}; {apart['other']}"
    elif _is_frame(world, apart["place_mm"], apart_mm2, kept_mm2):
        option = "--bounds wall takes what is drawn in it" if in_map else start
        doubt = (
            "this map may be inside out: its free space is a frame around one solid that holds "
            f"other free areas, the largest around {place} mm; {option}"
        )
    else:
        return world
    return with_notes(world, doubt)


def with_notes(world: Map, *notes: str) -> Map:
    """Return a map with further notes for its user."""
    before: Any = world.facts.get("notes", ())
    return replace(world, facts={**world.facts, "notes": [*before, *notes]}) if notes else world


def _is_frame(world: Map, place_mm: list[float], apart_mm2: float, kept_mm2: float) -> bool:
    """Return whether the kept free space lies around one solid with nearly all of the rest."""
    if not world.obstacles:
        return False
    shells = np.array([Polygon(one.exterior) for one in world.obstacles], dtype=np.object_)
    areas = shapely.area(shells)
    largest = int(areas.argmax())
    shell, start = shells[largest], world.starts[0].pose
    holds_rest = shapely.contains_xy(shell, *place_mm)
    if not holds_rest or shapely.contains_xy(shell, start.x_mm, start.y_mm):
        return False
    # A robot cannot tell specks outside of it from noise.
    most_outside_share, least_bounds_share, least_free_share = 0.1, 0.5, 0.2
    outside = areas[~shapely.covered_by(shells, shell)]
    if float(outside.sum()) > most_outside_share * float(areas[largest]):
        return False
    fills = float(areas[largest]) > least_bounds_share * float(world.bounds.area)
    return fills or apart_mm2 > least_free_share * kept_mm2
