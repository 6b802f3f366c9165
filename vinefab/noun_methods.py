"""The methods of nouns that need rooms above them: growing, writing results, pictures.

`vinefab.core.front_door` brings a noun here when such a method is called.
"""
# ruff: noqa: PLC0415  a picture of a design must not wait for the simulator

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError
from vinefab.inputs import MapLike, PoseLike, growth_given, map_given
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.files.shipped import path_given
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour


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

    given = growth_given(growth, **shortcuts)
    place = map_given(world)
    if pose is None and not place.starts:
        allowed = f"(x_mm, y_mm, heading_deg), as map {place.name} has no start of its own"
        raise BadInputError("pose", None, allowed)
    start = None if pose is None else Pose.of(pose)
    grown = deploy(design, place, start, given)
    choices = grown.options.content
    return replace(grown.deployment, design=design, world=place, growth=choices)


def write_deployment(
    deployment: Deployment, path: str | PathLike[str], *, force: bool = False
) -> Path:
    """Write a deployment; see `vinefab.model.deployment.Deployment.write`."""
    from vinefab.growth.options import GrowthOptions
    from vinefab.growth.terrain import Terrain
    from vinefab.prediction.deploy import DeployedDesign

    target, design, world = path_given("path", path), deployment.design, deployment.world
    suffix = target.suffix.lower()
    if suffix not in (".json", ".svg", ".png", ".gif"):
        raise BadInputError("path", str(target), "a name ending in .json, .svg, .png or .gif")
    if design is None or world is None:
        raise BadInputError("deployment", deployment, "one that Design.grow returned")
    whole_deployment = DeployedDesign(
        design=design,
        world=world,
        terrain=Terrain.of(world),
        options=GrowthOptions.of(deployment.growth),
        deployment=deployment,
    )
    if suffix == ".json":
        return write_text(target, whole_deployment.text(), force=force)
    drawn = whole_deployment.animation if suffix == ".gif" else whole_deployment.picture
    return write_bytes(target, drawn(suffix), force=force)


def svg_of(noun: Design | Map | Deployment | Contour) -> str | None:
    """Return a noun as an SVG document for notebooks; None for what cannot be drawn."""
    from vinefab.pages.drawing import (
        bare_deployment_plan,
        contour_plan,
        deployment_plan,
        map_plan,
    )
    from vinefab.pages.figure import svg_bytes

    if isinstance(noun, Map):
        figure = map_plan(noun)
    elif isinstance(noun, Contour):
        figure = contour_plan(noun)
    elif isinstance(noun, Design):
        from vinefab.fabrication.outline.body_outline import body_outline

        try:
            outline = body_outline(noun).contour
        except BadInputError:  # a tree that no sheet could hold is shown as text
            return None
        x0, y0, x1, y1 = outline.box_mm
        branches = f"{noun.branch_count} branch{'' if noun.branch_count == 1 else 'es'}"
        size = f"{branches}, {x1 - x0:.0f} x {y1 - y0:.0f} mm flat"
        figure = contour_plan(outline, f"{noun.name}: {size}", filled=True)
    else:
        # Without a design the widths are not known: centrelines only.
        thin = (0.0,) * int(noun.tree.level.max())
        widths_mm = noun.design.build.widths_mm if noun.design else thin
        if noun.world is None:
            figure = bare_deployment_plan(noun, widths_mm)
        else:
            figure = deployment_plan(noun.world, noun, widths_mm)
    return svg_bytes(figure).decode()
