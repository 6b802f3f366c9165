"""What all laser formats share: layers and colours, paths as drawn and as read, `LaserFormat`.

A colour preset never changes the geometry of a path. It may leave an operation out, for programs
that cut whatever a file holds.

The default colours are the only ones that are exact in DXF's primaries, in the six colours of
Epilog's driver and in LightBurn's palette at once; ``reg`` and ``doc`` have the colours of
LightBurn's two tool layers, which it never cuts.
"""

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import GENERATOR, one_line, plain
from vinefab.core.registry import Registry
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import FLATTEN_MM, Contour

HAIRLINE_MM = 0.01
LARGEST_TOLERANCE_MM = 0.01
"""No format may hold a path with less accuracy than this."""


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

    name: str
    title: str  # which programs and shops it is for
    styles: Mapping[Operation, Style]  # an operation without a style is not written

    def __post_init__(self) -> None:
        object.__setattr__(self, "styles", MappingProxyType(dict(self.styles)))


BLACK, BLUE, MAGENTA, RED = ("#000000", 7), ("#0000FF", 5), ("#FF00FF", 6), ("#FF0000", 1)
ORANGE, SKY = ("#F36926", 30), ("#0C96D9", 140)

VARIANT_COLOURS = (
    *(("#00E000", 3), ("#FF8000", 30), ("#00E0E0", 4), ("#A00000", 12)),
    *(("#0000A0", 172), ("#D0D000", 2), ("#A000A0", 212), ("#00A000", 92)),
    *(("#00A0FF", 150), ("#C08000", 42), ("#A0A000", 52), ("#B4B4B4", 9)),
)
"""Colours of LightBurn's palette, with the nearest colour indices, for settings of a path's own."""


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

    path: LaserPath
    style: Style


def styled_paths(job: Job, colours: Colours) -> tuple[StyledPath, ...]:
    """Return the paths that a preset writes, in process order.

    Paths of one operation keep the job's order, which puts inner contours before outer ones.
    Every variant of an operation has a separate layer and colour, whatever the preset.
    """
    names = dict.fromkeys(path.variant for path in job.paths if path.variant)
    variants = dict(zip(names, VARIANT_COLOURS, strict=False))
    if len(variants) < len(names):
        raise BadInputError("variants", len(names), f"at most {len(VARIANT_COLOURS)} in one file")
    found = []
    for path in (path for op in Operation if op in colours.styles for path in job.along(op)):
        style = colours.styles[path.operation]
        if path.variant:
            rgb, aci = variants[path.variant]
            style = Style(layer=f"{path.operation.layer}_{path.variant}", rgb=rgb, aci=aci)
        found.append(StyledPath(path=path, style=style))
    return tuple(found)


def operations_left_out(job: Job, colours: Colours) -> tuple[Operation, ...]:
    """Return the operations of a job that a preset does not write."""
    return tuple(op for op in Operation if job.along(op) and op not in colours.styles)


def operations_by_style(job: Job, colours: Colours) -> tuple[tuple[Operation, ...], ...]:
    """Return a job's operations in groups that share a layer and a colour, in process order.

    The operator cannot give different settings to the operations of one group.
    """
    groups: dict[tuple[str, str], list[Operation]] = {}
    for operation in Operation:
        if operation in colours.styles and job.along(operation):
            style = colours.styles[operation]
            groups.setdefault((style.layer, style.rgb), []).append(operation)
    return tuple(tuple(group) for group in groups.values())


def metadata(job: Job, colours: Colours) -> dict[str, str]:
    """Return the metadata of a file: one line of text per key.

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
    # vinefab's own entries come first and are not overridden: the file is recognized by them.
    return {**own, **{key: value for key, value in facts.items() if key not in own}}


def _as_line(value: object) -> str:
    if isinstance(value, str):
        return one_line(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return one_line(json.dumps(value, default=plain, ensure_ascii=False))


def flattened_contour(contour: Contour) -> Contour:
    """Return a contour with chords for arcs, within `FLATTEN_MM` of them."""
    return Contour.polyline(contour.flattened_mm(FLATTEN_MM), closed=contour.closed)


def xml_root(text: str) -> ET.Element:
    """Return the root of an XML file that has neither declarations nor comments."""
    if "<!" in text:
        raise BadInputError("<!", text[text.index("<!") :][:40], "no declarations, no comments")
    # Without declarations there are no entities that could expand without end.
    return ET.fromstring(text.encode())  # noqa: S314


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnPath:
    """One path of a file."""

    layer: str
    colour: str  # ``#RRGGBB``, or a colour index in digits (DXF)
    contour: Contour  # y up, in the file's unit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReadDrawing:
    """A laser file as read back."""

    unit: str = "mm"  # ``mm``, or the file's other unit
    sheet: tuple[float, float] | None = None  # width and height; None: the format has no sheet
    paths: tuple[DrawnPath, ...] = ()  # in the order of the file
    # colour by layer, in the form of `DrawnPath.colour`; None: layers have no colour of their own
    layer_colours: Mapping[str, str] | None = None
    # names and values of machine settings by layer, in the order in which the layers run
    settings: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    oddities: tuple[str, ...] = ()  # content that vinefab never writes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserFileSpec:
    """The content of a laser file."""

    job: Job
    colours: Colours = DEFAULT
    profile: LaserProfile | None = None  # None: no file with machine settings is written
    hairline_mm: float = HAIRLINE_MM  # stroke width where the format has one

    @property
    def paths(self) -> tuple[StyledPath, ...]:
        """Every path that the preset writes, in process order."""
        return styled_paths(self.job, self.colours)

    @property
    def recipe_profile(self) -> LaserProfile:
        """The profile, for formats that need one."""
        if self.profile is None:
            raise BadInputError("profile", None, "a profile, for a file with machine settings")
        return self.profile


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserFormat:
    """A kind of laser file: written, read back and compared with its job.

    `vinefab.fabrication.formats.readback` compares what `read` returns with the job, the same way
    for every format; the other fields say how the format represents a job.

    Raises
    ------
    BadInputError
        If a format has no writer, no reader, no usable suffix or too large a tolerance.
    """

    title: str
    suffix: str  # end of its file names, such as ``.dxf`` or ``_r12.dxf``; unique
    write: Callable[[LaserFileSpec], str]  # returns text, encoded as UTF-8
    read: Callable[[str], ReadDrawing]  # raises `UnreadableFileError` for any other text
    tolerance_mm: float  # largest error of a point, by the rounding of numbers
    # paths that the format holds
    paths: Callable[[LaserFileSpec], tuple[StyledPath, ...]] = lambda spec: spec.paths
    # a contour as the format represents it
    contour: Callable[[Contour], Contour] = lambda contour: contour
    sagitta_mm: float = 0.0  # largest distance of its chords from the job's arcs
    # a style's colour as the format gives it
    colour: Callable[[Style], str] = lambda style: style.rgb
    # machine settings by layer
    settings: Callable[[LaserFileSpec], Mapping[str, Mapping[str, str]]] = lambda _: {}
    needs_profile: bool = False  # written only where the spec has a profile
    on_request: bool = False  # written only when it is asked for by name

    def __post_init__(self) -> None:
        for name in ("write", "read"):
            if not callable(getattr(self, name)):
                key = f"laser format {self.title}: {name}"
                raise BadInputError(key, getattr(self, name), "a function")
        if "." not in self.suffix or not set(self.suffix).isdisjoint("/\\"):
            raise BadInputError("suffix", self.suffix, "the end of a file name, such as .dxf")
        if not 0.0 < self.tolerance_mm <= LARGEST_TOLERANCE_MM:
            allowed = f"above 0, at most {LARGEST_TOLERANCE_MM:g} mm"
            raise BadInputError("tolerance_mm", self.tolerance_mm, allowed)

    def file_name(self, stem: str = "outline") -> str:
        """Return the name of a sheet's file."""
        return f"{stem}{self.suffix}"
