"""The methods of nouns that need rooms above them: growing, writing results, pictures.

`vinefab.core.front_door` brings a noun here when such a method is called.
"""
# ruff: noqa: PLC0415  a picture of a design must not wait for the simulator

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.files.shipped import path_given
from vinefab.model.inputs import MapLike, PoseLike, as_growth, as_map
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour

if TYPE_CHECKING:
    from vinefab.prediction.deploy import DeployedDesign
    from vinefab.prediction.map_info import MapInfo

START_SIZE = 0.055
"""Length of the arrow of a start in a picture, as a share of its longer side."""


def grow_design(
    design: Design,
    world: MapLike,
    pose: PoseLike | None = None,
    *,
    growth: Mapping[str, object] | None = None,
    **shortcuts: object,
) -> Deployment:
    """Deploy a design on a map; see `vinefab.model.design.Design.grow`."""
    from vinefab.prediction.deploy import deploy

    given = as_growth(growth, **shortcuts)
    place = as_map(world, "world")
    if pose is None and not place.starts:
        allowed = f"(x_mm, y_mm, heading_deg), as map {place.name} has no start of its own"
        raise BadInputError("pose", None, allowed)
    start = None if pose is None else Pose.of(pose)
    grown = deploy(design, place, start, given)
    choices = grown.options.content
    return replace(grown.deployment, design=design, world=place, growth=choices)


def _deployed(deployment: Deployment) -> DeployedDesign:
    """Return a deployment with what its numbers and files need."""
    from vinefab.growth.options import GrowthOptions
    from vinefab.growth.terrain import Terrain
    from vinefab.prediction.deploy import DeployedDesign

    design, world = deployment.design, deployment.world
    if design is None or world is None:
        raise BadInputError("deployment", deployment, "one that Design.grow returned")
    return DeployedDesign(
        design=design,
        world=world,
        terrain=Terrain.of(world),
        options=GrowthOptions.of(deployment.growth),
        deployment=deployment,
    )


def deployment_summary(deployment: Deployment) -> tuple[str, ...]:
    """Return what became of the branches, a line each, as ``vinefab grow`` prints it."""
    return tuple(_deployed(deployment).summary())


def write_deployment(
    deployment: Deployment, path: str | PathLike[str], *, force: bool = False
) -> Path:
    """Write a deployment; see `vinefab.model.deployment.Deployment.write`."""
    target = path_given("path", path)
    suffix = target.suffix.lower()
    if suffix not in (".json", ".svg", ".png", ".gif"):
        raise BadInputError("path", str(target), "a name ending in .json, .svg, .png or .gif")
    whole_deployment = _deployed(deployment)
    if suffix == ".json":
        return write_text(target, whole_deployment.text(), force=force)
    drawn = whole_deployment.animation if suffix == ".gif" else whole_deployment.picture
    return write_bytes(target, drawn(suffix), force=force)


def map_summary(world: Map) -> tuple[str, ...]:
    """Return the size of a map, its starts and what is odd about it."""
    from vinefab.model.start_place import area_notes, start_words
    from vinefab.prediction.map_info import size_notes

    sides = [f"{one:.0f}" if one >= 100.0 else f"{one:.3g}" for one in world.size_mm]
    lines = [
        f"{world.name}: {' x '.join(sides)} mm, {counted(len(world.obstacles), 'obstacle')}, "
        f"{counted(world.wall_count, 'wall')}, free area {world.free_space.area / 1e6:.4g} m2"
    ]
    starts = world.starts if any(one.area for one in world.starts) else world.starts[:1]
    lines += [f"start: {start_words(start)}" for start in starts]
    lines += [f"note: {note}" for note in [*size_notes(world), *area_notes([world])]]
    return tuple(lines)


def info_of(world: Map, *, width_mm: float | None, passages: int) -> MapInfo:
    """Return figures of a map; see `vinefab.model.map.Map.info`."""
    from vinefab.prediction.map_info import map_info

    return map_info(world, width_mm=width_mm, passages=passages)


def svg_of(noun: Design | Map | Deployment | Contour) -> str | None:
    """Return a noun as an SVG document for notebooks; None for what cannot be drawn."""
    if isinstance(noun, Map):
        return _map_document(noun)
    if isinstance(noun, Design):
        return _design_document(noun)
    if isinstance(noun, Contour):
        return _contour_document(noun, "", filled=noun.closed)
    return _deployment_document(noun)


def _map_document(world: Map) -> str:
    from vinefab.pages.plan_document import START_ENTRY, plan_document
    from vinefab.pages.plan_svg import ground_svg, pose_svg

    size_mm = START_SIZE * max(world.size_mm)
    starts = [pose_svg(start.pose, size_mm) for start in world.starts]
    size = " x ".join(f"{side:g}" for side in world.size_mm)
    return plan_document(
        [ground_svg(world, box_mm=world.bounds.bounds), *starts],
        world.bounds.bounds,
        title=f"{world.name}: {size} mm",
        legend=[*([START_ENTRY] if starts else []), *_range_entry(world)],
    )


def _range_entry(world: Map) -> list[tuple[str, str]]:
    """Return what explains the ranges of a map's starts, if it has some."""
    from vinefab.pages.plan_document import RANGE

    return [RANGE] if any(start.has_spread for start in world.starts) else []


def _contour_document(contour: Contour, title: str, *, filled: bool) -> str:
    from vinefab.pages.map_view import at_least_wide
    from vinefab.pages.plan_document import plan_document
    from vinefab.pages.plan_svg import outline_svg

    box_mm = at_least_wide(contour.box_mm)
    return plan_document([outline_svg(contour, filled=filled)], box_mm, title=title)


def _design_document(design: Design) -> str | None:
    from vinefab.fabrication.outline.body_outline import body_outline

    try:
        outline = body_outline(design).contour
    except BadInputError:  # a tree that no sheet could hold is shown as text
        return None
    x0, y0, x1, y1 = outline.box_mm
    branches = f"{design.branch_count} branch{'' if design.branch_count == 1 else 'es'}"
    title = f"{design.name}: {branches}, {x1 - x0:.0f} x {y1 - y0:.0f} mm flat"
    return _contour_document(outline, title, filled=True)


def _deployment_document(deployment: Deployment) -> str:
    from vinefab.pages.map_view import longer_mm, robot_box, robot_view
    from vinefab.pages.plan_document import START_ENTRY, plan_document, robot_legend
    from vinefab.pages.plan_svg import ground_svg, pose_svg, robot_svg

    world, design = deployment.world, deployment.design
    box_mm = robot_view(world, deployment) if world else robot_box(deployment)
    # Without a design the widths are not known, and the published model has none.
    thin = (0.0,) * int(deployment.tree.level.max())
    has_width = design is not None and deployment.growth.get("body") != "centerline"
    parts = [ground_svg(world, box_mm=box_mm)] if world else []
    parts.append(robot_svg(deployment, design.build.widths_mm if design and has_width else thin))
    parts.append(pose_svg(deployment.pose, START_SIZE * longer_mm(box_mm)))
    names = [design.name if design else "robot", f"on {world.name}" if world else "", "(simulated)"]
    if world and box_mm != world.bounds.bounds:
        names[1] = f"on a part of {world.name}, {world.size_mm[0]:g} x {world.size_mm[1]:g} mm"
    title = " ".join(filter(None, names))
    legend = [*robot_legend(deployment), START_ENTRY, *(_range_entry(world) if world else ())]
    return plan_document(parts, box_mm, title=title, legend=legend)
