"""What of a job goes into a laser file, whatever the file's format."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.core.errors import BadInputError
from vinefab.core.jsontext import GENERATOR, plain
from vinefab.export.colours import VARIANT_COLOURS, Colours, Style
from vinefab.model.job import Job, LaserPath, Operation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StyledPath:
    """One path with the layer and colour that it is drawn in.

    Parameters
    ----------
    path
        The path.
    style
        Its layer and colour.
    """

    path: LaserPath
    style: Style


def styled_paths(job: Job, colours: Colours) -> tuple[StyledPath, ...]:
    """Return the paths that a preset writes, in process order.

    Paths of one operation keep the job's order, which puts inner contours before outer ones.
    Every variant of an operation has a layer and a colour of its own, whatever the preset.
    """
    names = dict.fromkeys(path.variant for path in job.paths if path.variant)
    variants = dict(zip(names, VARIANT_COLOURS, strict=False))
    if len(variants) < len(names):
        raise BadInputError("variants", len(names), f"at most {len(VARIANT_COLOURS)} in one file")
    return tuple(
        StyledPath(path=path, style=_style(path, colours, variants))
        for operation in Operation
        if operation in colours.styles
        for path in job.along(operation)
    )


def _style(path: LaserPath, colours: Colours, variants: Mapping[str, tuple[str, int]]) -> Style:
    style = colours.styles[path.operation]
    if not path.variant:
        return style
    rgb, aci = variants[path.variant]
    return Style(layer=f"{path.operation.layer}_{path.variant}", rgb=rgb, aci=aci)


def left_out(job: Job, colours: Colours) -> tuple[Operation, ...]:
    """Return the operations of a job that a preset does not write."""
    return tuple(op for op in Operation if job.along(op) and op not in colours.styles)


def told_apart(job: Job, colours: Colours) -> tuple[tuple[Operation, ...], ...]:
    """Return a job's operations in groups that share a layer and a colour, in process order.

    A group with more than one operation cannot be given different settings by the operator.
    """
    groups: dict[tuple[str, str], list[Operation]] = {}
    for operation in Operation:
        if operation in colours.styles and job.along(operation):
            style = colours.styles[operation]
            groups.setdefault((style.layer, style.rgb), []).append(operation)
    return tuple(tuple(group) for group in groups.values())


def metadata(job: Job, colours: Colours) -> dict[str, str]:
    """Return what a file says about itself: one line of text per key.

    The facts of the job (offsets applied, recipe, rotation) are among it, so that a file that was
    parted from its folder still tells how it was made.
    """
    own = {
        "generator": GENERATOR,
        "name": one_line(job.name),
        "units": "mm",
        "sheet_mm": f"{job.sheet_width_mm:g} x {job.sheet_height_mm:g}",
        "colours": colours.name,
        "kerf": "seam and kerf offsets are in these paths: leave the machine's kerf at 0",
    }
    facts = {one_line(key): _as_line(value) for key, value in job.facts.items()}
    # What vinefab says of the file comes first and is not overridden: it is known by it.
    return {**own, **{key: value for key, value in facts.items() if key not in own}}


def one_line(text: str) -> str:
    """Return a text without line breaks and control characters, which end a DXF or XML string."""
    kept = (char if char.isprintable() else " " for char in text)
    return " ".join("".join(kept).split())


def _as_line(value: object) -> str:
    if isinstance(value, str):
        return one_line(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return one_line(json.dumps(value, default=plain, ensure_ascii=False))
