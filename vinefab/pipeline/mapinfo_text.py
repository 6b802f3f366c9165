"""What is said of a map, as lines for the user and as JSON: ``vinefab/map-info-1``."""

from collections.abc import Iterator

import numpy as np
import shapely

from vinefab.core.jsontext import json_text
from vinefab.export.deployment_json import pose_content
from vinefab.model.map import Map
from vinefab.pipeline.grow import pose_text
from vinefab.pipeline.mapinfo import Gate, MapInfo
from vinefab.pipeline.mapinfo_room import StartRoom

SCHEMA = "vinefab/map-info-1"


def info_text(info: MapInfo) -> str:
    """Return everything as JSON."""
    return json_text(SCHEMA, _content(info))


def _content(info: MapInfo) -> dict[str, object]:
    world = info.world
    body = info.body
    return {
        "map": world.name,
        "environment": world.environment,
        "seed": world.seed,
        "standing": "computed",
        "size_mm": list(world.size_mm),
        "obstacles": len(world.obstacles),
        "walls": world.wall_count,
        "vertices": _vertices(world),
        "free_area_mm2": info.free.area,
        "free_share": info.free_share,
        "regions_mm2": list(info.regions_mm2),
        "passages": [_gate_content(gate) for gate in info.gates],
        "starts": [_start_content(room) for room in info.starts],
        "widest_body": [
            {"free_share": share, "width_mm": width} for share, width in info.widest_mm.items()
        ],
        "body": None
        if body is None
        else {"width_mm": body.width_mm, "fits": body.share > 0.0, "free_share": body.share},
    }


def _vertices(world: Map) -> int:
    points = shapely.get_coordinates([world.bounds, *world.obstacles])
    return len(np.unique(points, axis=0))


def _gate_content(gate: Gate) -> dict[str, object]:
    x_mm, y_mm = gate.passage.middle_mm
    return {
        "width_mm": gate.passage.width_mm,
        "x_mm": x_mm,
        "y_mm": y_mm,
        "ends_mm": [list(end) for end in gate.passage.ends_mm],
        "between": list(gate.between),
        "widest_body_mm": gate.body_mm,
    }


def _start_content(room: StartRoom) -> dict[str, object]:
    space = {"clearance_mm": room.clearance_mm, "widest_body_mm": room.body_mm}
    return {**pose_content(room.pose), **space}


def info_lines(info: MapInfo) -> Iterator[str]:
    """Yield everything in a few lines for the user."""
    world, (width_mm, height_mm) = info.world, info.world.size_mm
    regions = info.regions_mm2
    yield (
        f"{world.name}: {width_mm:g} x {height_mm:g} mm, {len(world.obstacles)} obstacles, "
        f"{world.wall_count} walls, {_vertices(world)} vertices"
    )
    yield (
        f"free area {info.free.area / 1e6:.4g} m2, {100 * info.free_share:.1f} % of the bounds, "
        f"in {len(regions)} {'region' if len(regions) == 1 else 'regions'} (computed)"
    )
    yield "narrowest passages (computed; lay-flat width of the widest body that fits through):"
    for number, gate in enumerate(info.gates, start=1):
        x_mm, y_mm = gate.passage.middle_mm
        yield (
            f"  {number}: {gate.passage.width_mm:.2f} mm at {x_mm:.1f},{y_mm:.1f} between "
            f"{' and '.join(gate.between)} (body {gate.body_mm:.2f} mm)"
        )
    if not info.gates:
        yield "  none"
    yield from _start_lines(info)


def _start_lines(info: MapInfo) -> Iterator[str]:
    for number, room in enumerate(info.starts, start=1):
        pose = room.pose
        yield (
            f"start {number} at {pose_text(pose)}: {room.clearance_mm:.2f} mm to the nearest wall, "
            f"widest body that fits {room.body_mm:.2f} mm (computed)"
        )
    if not info.starts:
        yield "the map has no start, so nothing can be said of robots"
        return
    for share, width in info.widest_mm.items():
        found = "none" if width is None else f"about {width:.1f} mm"
        yield f"widest body with room in {100 * share:.0f} % of the free area: {found} (computed)"
    if info.body is not None:
        narrow = sum(gate.body_mm < info.body.width_mm for gate in info.gates)
        yield (
            f"a body of {info.body.width_mm:g} mm has room in {100 * info.body.share:.1f} % of the "
            f"free area; {narrow} of these {len(info.gates)} passages are too narrow (computed)"
        )
