"""What a laser file holds, whatever its format: layers, colours, paths written and read again.

A preset changes nothing else: the geometry of a path is the same in every one. A preset may leave
an operation out, where the programs that it is made for would cut whatever they meet.

The default colours are the only ones that are exact in DXF's primaries, in the six colours of
Epilog's driver and in LightBurn's palette at once; ``reg`` and ``doc`` have the colours of
LightBurn's two tool layers, which it never cuts.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from vinefab.core.errors import BadInputError
from vinefab.core.jsontext import GENERATOR, plain
from vinefab.core.registry import Registry
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.outline import Contour


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """How one operation is drawn."""

    layer: str  # name of its layer
    rgb: str  # colour in SVG, ``#RRGGBB``
    aci: int  # colour in DXF: AutoCAD colour index, 1 to 255

    def __post_init__(self) -> None:
        if not 1 <= self.aci <= 255:
            raise BadInputError("aci", self.aci, "1 to 255")
        if len(self.rgb) != 7 or not self.rgb.startswith("#"):
            raise BadInputError("rgb", self.rgb, "#RRGGBB")


@dataclass(frozen=True, slots=True, kw_only=True)
class Colours:
    """A preset: one style per operation."""

    name: str  # what machines and users call it
    title: str  # whom it is for, in words
    # style by operation; an operation that is missing is not written
    styles: Mapping[Operation, Style]

    def __post_init__(self) -> None:
        object.__setattr__(self, "styles", MappingProxyType(dict(self.styles)))


BLACK, BLUE, MAGENTA, RED = ("#000000", 7), ("#0000FF", 5), ("#FF00FF", 6), ("#FF0000", 1)
ORANGE, SKY = ("#F36926", 30), ("#0C96D9", 140)

VARIANT_COLOURS = (
    *(("#00E000", 3), ("#FF8000", 30), ("#00E0E0", 4), ("#A00000", 12)),
    *(("#0000A0", 172), ("#D0D000", 2), ("#A000A0", 212), ("#00A000", 92)),
    *(("#00A0FF", 150), ("#C08000", 42), ("#A0A000", 52), ("#B4B4B4", 9)),
)
"""Colours of LightBurn's palette for settings that differ from the recipe's, with near indices."""


def _styles(colours: Mapping[Operation, tuple[str, int]]) -> dict[Operation, Style]:
    return {op: Style(layer=op.layer, rgb=rgb, aci=aci) for op, (rgb, aci) in colours.items()}


DEFAULT = Colours(
    name="default",
    title="one layer and one colour per operation",
    styles=_styles(
        {
            Operation.MARK: BLACK,
            Operation.WELD: BLUE,
            Operation.WELDCUT: MAGENTA,
            Operation.CUT: RED,
            Operation.REG: ORANGE,
            Operation.DOC: SKY,
        }
    ),
)

# The one-pass outline gets the labs' second vector colour and not their red: a mouth that is cut
# with the outline's settings would be welded shut. Nothing that must not be cut is in the file,
# for a printer driver cuts every hairline whatever its colour.
RED_CUT = Colours(
    name="red_cut",
    title="labs that cut red, score blue and engrave black",
    styles=_styles(
        {
            Operation.MARK: BLACK,
            Operation.WELD: BLUE,
            Operation.WELDCUT: BLUE,
            Operation.CUT: RED,
        }
    ),
)

SHOP_SINGLE = Colours(
    name="shop_single",
    title="shops that want one layer and one colour, and cut all of it",
    styles={
        operation: Style(layer="0", rgb="#000000", aci=7)
        for operation in (Operation.WELDCUT, Operation.CUT)
    },
)

PRESETS: Registry[Colours] = Registry(
    "colour preset", {preset.name: preset for preset in (DEFAULT, RED_CUT, SHOP_SINGLE)}
)
"""All presets by name."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StyledPath:
    """One path with the layer and colour that it is drawn in."""

    path: LaserPath  # the path
    style: Style  # its layer and colour


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


class Format(StrEnum):
    """The formats that are read back."""

    DXF = "dxf"
    SVG = "svg"
    LIGHTBURN = "lightburn"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnPath:
    """One path of a file."""

    layer: str  # the layer it is on
    # ``#RRGGBB`` from an SVG or a LightBurn project, a colour index in digits from a DXF
    colour: str
    contour: Contour  # its lines and arcs, y up, in the file's unit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadDrawing:
    """A file as read."""

    format: Format  # which kind of file it was
    unit: str  # ``mm``, or in words what the file says instead
    # width and height in the file's unit; None where the format has no sheet
    sheet: tuple[float, float] | None
    paths: tuple[DrawnPath, ...]  # in the order of the file
    # colour of each layer that has one of its own (DXF), in the form of `DrawnPath.colour`
    layer_colours: dict[str, str]
    oddities: tuple[str, ...] = ()  # whatever was found that vinefab never writes, in words
