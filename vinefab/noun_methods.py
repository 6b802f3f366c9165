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
from vinefab.model.files.run_context import RunContext
from vinefab.model.files.shipped import path_given
from vinefab.model.inputs import MapLike, PoseLike, as_growth, as_map
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour

if TYPE_CHECKING:
    from vinefab.prediction.deploy import DeployedDesign
    from vinefab.prediction.map_info import MapInfo


def grow_design(
    design: Design,
    world: MapLike,
    pose: PoseLike | None = None,
    *,
    growth: Mapping[str, object] | None = None,
    **shortcuts: object,
) -> Deployment:
    """Deploy a design on a map; see `vinefab.model.design.Design.grow`."""
    from vinefab.prediction.deploy import as_grown, deploy

    given = as_growth(growth, **shortcuts)
    (place,) = RunContext.of(design).with_places([as_map(world, "world")])
    if pose is None and not place.starts:
        allowed = f"(x_mm, y_mm, heading_deg), as map {place.name} has no start"
        raise BadInputError("pose", None, allowed)
    start = None if pose is None else Pose.of(pose)
    grown = deploy(as_grown(design), place, start, given)
    choices = grown.options.content
    return replace(grown.deployment, design=grown.design, world=place, growth=choices)


def _deployed(deployment: Deployment) -> DeployedDesign:
    """Return a deployment with the values that its numbers and files need."""
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
    """Return the fates of the branches, a line each, as ``vinefab grow`` prints it."""
    return _deployed(deployment).summary


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
        return write_text(target, whole_deployment.json_text(), force=force)
    drawn = whole_deployment.animation if suffix == ".gif" else whole_deployment.picture
    return write_bytes(target, drawn(suffix), force=force)


_MOST_TARGETS = 10
"""Of a map, that its summary names."""


def map_summary(world: Map) -> tuple[str, ...]:
    """Return the size of a map, its starts and its oddities."""
    from vinefab.model.start import area_notes, start_words
    from vinefab.prediction.map_info import size_notes

    sides = [f"{one:.0f}" if one >= 100.0 else f"{one:.3g}" for one in world.size_mm]
    lines = [
        f"{world.name}: {' x '.join(sides)} mm, {counted(len(world.obstacles), 'obstacle')}, "
        f"{counted(world.wall_count, 'wall')}, free area {world.free_space.area / 1e6:.4g} m2"
    ]
    starts = world.starts if any(one.area for one in world.starts) else world.starts[:1]
    lines += [f"start: {start_words(start)}" for start in starts]
    lines += [f"target: {one.name} at {one.place_text}" for one in world.targets[:_MOST_TARGETS]]
    lines += [f"note: {note}" for note in [*size_notes(world), *area_notes([world])]]
    return tuple(lines)


def info_of(world: Map, *, width_mm: float | None, passages: int) -> MapInfo:
    """Return figures of a map; see `vinefab.model.map.Map.info`."""
    from vinefab.prediction.map_info import map_info

    return map_info(world, width_mm=width_mm, passages=passages)


def svg_of(noun: Design | Map | Deployment | Contour, *, longest_pt: float = 468.0) -> str | None:
    """Return a noun as an SVG document for notebooks; None for a noun that cannot be drawn.

    Parameters
    ----------
    longest_pt
        Longer side of the plan, without the parts around it.
    """
    from vinefab.fabrication.outline.body_outline import body_outline
    from vinefab.pages.page_files import page_svg
    from vinefab.pages.plan import deployment_plan, map_plan, outline_plan

    if isinstance(noun, Map):
        size = " x ".join(f"{side:g}" for side in noun.size_mm)
        page = map_plan(noun, title=f"{noun.name}: {size} mm", longest_pt=longest_pt)
    elif isinstance(noun, Contour):
        page = outline_plan(noun, filled=noun.closed, longest_pt=longest_pt)
    elif isinstance(noun, Design):
        try:
            outline = body_outline(noun).contour
        except BadInputError:  # a tree that no sheet could hold is shown as text
            return None
        x0, y0, x1, y1 = outline.box_mm
        size = f"{x1 - x0:.0f} x {y1 - y0:.0f} mm flat"
        title = f"{noun.name}: {counted(noun.branch_count, 'branch')}, {size}"
        page = outline_plan(outline, title=title, longest_pt=longest_pt)
    else:
        world, design = noun.world, noun.design
        # Without a design the widths are not known, and the published model has none.
        widths_mm = (0.0,) * int(noun.tree.level.max())
        if design is not None and noun.growth.get("body") != "centerline":
            widths_mm = design.build.widths_mm
        names = [design.name if design else "robot", f"on {world.name}" if world else ""]
        title = " ".join(filter(None, [*names, "(simulated)"]))
        page = deployment_plan(world, noun, widths_mm, title=title, longest_pt=longest_pt)
    # A notebook puts the picture into its page, where no XML declaration may stand.
    return page_svg(page).decode().partition("\n")[2]
