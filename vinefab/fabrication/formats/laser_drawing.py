"""What all laser formats share: layers, colours, `LaserFormat`, and the comparison with the job.

A colour preset never changes the geometry of a path. It may leave an operation out, for programs
that cut whatever a file holds.

The default colours are the only ones that are exact in DXF's primaries, in the six colours of
Epilog's driver and in LightBurn's palette at once; ``reg`` and ``doc`` have the colours of
LightBurn's two tool layers, which it never cuts.
"""

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from vinefab.core.errors import BadInputError, BrokenPluginError, VinefabError
from vinefab.core.foreign import calling, ensure_type
from vinefab.core.frozen import FrozenMapping
from vinefab.core.plain_text import GENERATOR, counted, one_line, plain
from vinefab.core.registry import Registry
from vinefab.core.validation import Floats
from vinefab.fabrication.job.steps import JobStep, steps_of
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import Tool
from vinefab.model.outline import FLATTEN_MM, Contour, following

HAIRLINE_MM = 0.01


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
        object.__setattr__(self, "styles", FrozenMapping(self.styles))


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
    recorded = {**job.facts, **job.parts}
    facts = {one_line(key): _as_line(value) for key, value in recorded.items()}
    # vinefab's own entries come first and are not overridden: the file is recognized by them.
    return {**own, **{key: value for key, value in facts.items() if key not in own}}


def _as_line(value: object) -> str:
    if isinstance(value, str):
        return one_line(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return one_line(json.dumps(value, default=plain, ensure_ascii=False))


@lru_cache(maxsize=4096)
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
    def steps(self) -> tuple[JobStep, ...]:
        """The machine's steps that the preset writes, in process order."""
        return steps_of(self.job, lambda path: path.operation in self.colours.styles)

    @property
    def recipe_profile(self) -> LaserProfile:
        """The profile, for formats that need one."""
        if self.profile is None:
            raise BadInputError("profile", None, "a profile, for a file with machine settings")
        return self.profile


def package_spec(job: Job, profile: LaserProfile) -> LaserFileSpec:
    """Return the content of a sheet's laser files, in the machine's colours."""
    return LaserFileSpec(
        job=job,
        colours=PRESETS[profile.machine.colours],
        profile=profile,
        hairline_mm=profile.machine.hairline_mm,
    )


Content = TypeVar("Content")
Data = TypeVar("Data", str, bytes)
Read = TypeVar("Read")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FileFormat(Generic[Content, Data, Read]):
    """A kind of file: written, read back, and compared with its content."""

    suffix: str  # end of its file names, such as ``.dxf`` or ``_r12.dxf``; unique
    write: Callable[[Content], Data]  # the same data each time; text is encoded as UTF-8
    read: Callable[[Data], Read]  # raises `UnreadableFileError` for any other data


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserFormat(FileFormat[LaserFileSpec, str, ReadDrawing]):
    """A kind of laser file: written, read back and compared with its job.

    `drawing_differences` compares what `read` returns with the job, the same way for every format;
    the other fields say how the format represents a job.

    Raises
    ------
    BadInputError
        If a format has no writer, no reader, no usable suffix or too large a tolerance.
    """

    title: str
    use: str = ""  # for the operator: programs that take it, or how to read it
    tolerance_mm: float  # largest error of a point, by the rounding of numbers
    # paths that the format holds
    paths: Callable[[LaserFileSpec], tuple[StyledPath, ...]] = lambda spec: spec.paths
    # a contour as the format represents it
    contour: Callable[[Contour], Contour] = lambda contour: contour
    encoding: str = "utf-8"  # of its text; ``latin-1`` for bytes, a letter each
    sagitta_mm: float = 0.0  # largest distance of its chords from the job's arcs
    # a style's colour as the format gives it
    colour: Callable[[Style], str] = lambda style: style.rgb
    # machine settings by layer
    settings: Callable[[LaserFileSpec], Mapping[str, Mapping[str, str]]] = lambda _: {}
    needs_profile: bool = False  # written only where the spec has a profile
    on_request: bool = False  # written only when it is asked for by name
    where_needed: bool = False  # written only for jobs that have paths for it
    whole: bool = True  # whether a file holds all operations of a sheet
    each_operation: bool = True  # whether a file for each operation is written, too
    paper: str = ""  # paper that it is printed on at 1:1; empty: none
    tools: frozenset[Tool] = frozenset()  # whose paths it is for; empty: for all

    def __post_init__(self) -> None:
        for name in ("write", "read"):
            if not callable(getattr(self, name)):
                key = f"laser format {self.title}: {name}"
                raise BadInputError(key, getattr(self, name), "a function")
        if "." not in self.suffix or not set(self.suffix).isdisjoint("/\\"):
            raise BadInputError("suffix", self.suffix, "the end of a file name, such as .dxf")
        largest_tolerance_mm = 0.01  # no format may hold a path with less accuracy than this
        if not 0.0 < self.tolerance_mm <= largest_tolerance_mm:
            allowed = f"above 0, at most {largest_tolerance_mm:g} mm"
            raise BadInputError("tolerance_mm", self.tolerance_mm, allowed)

    def file_name(self, stem: str = "outline") -> str:
        """Return the name of a sheet's file."""
        return f"{stem}{self.suffix}"


def file_problems(
    laser_format: LaserFormat, data: bytes | None, spec: LaserFileSpec
) -> tuple[str, ...]:
    """Read a file back and return a sentence for every difference from its spec.

    Parameters
    ----------
    data
        Content of the file; None for a file that is missing.
    """
    if data is None:
        return ("the file is missing",)
    what = f"laser format {laser_format.title!r}"
    try:
        text = data.decode(laser_format.encoding)
        with calling(what, laser_format.read, VinefabError):
            drawing = laser_format.read(text)
    except BrokenPluginError:
        raise
    except (VinefabError, UnicodeDecodeError) as error:
        return (str(error),)
    ensure_type(what, laser_format.read, "drawing", drawing, ReadDrawing)
    with calling(what, laser_format.read, VinefabError):
        return drawing_differences(laser_format, drawing, spec)


def drawing_differences(
    laser_format: LaserFormat, drawing: ReadDrawing, spec: LaserFileSpec
) -> tuple[str, ...]:
    """Return every difference between a file as read and its spec.

    Compared are the unit, the sheet, the layers and their order, colours, machine settings, and
    path by path: closed or open, number of vertices and arcs, every vertex and the middle of every
    segment against the form that the format can hold; box, area and length against the job itself.
    """
    problems = [f"the file holds {oddity}" for oddity in drawing.oddities]
    settings = laser_format.settings(spec)
    if list(drawing.settings) != list(settings):
        layers = ", ".join(drawing.settings), ", ".join(settings)
        problems.append("the settings are for {}, not {}".format(*layers))
    for layer, values in settings.items():
        read = drawing.settings.get(layer, {})
        problems += [
            f"layer {layer}: {name} is {read.get(name)}, not {value}"
            for name, value in values.items()
            if read.get(name) != value
        ]
    expected: dict[str, list[StyledPath]] = {}
    for styled in laser_format.paths(spec):
        expected.setdefault(styled.style.layer, []).append(styled)
    problems += _frame_problems(laser_format, drawing, spec, expected)
    for layer, in_job in expected.items():
        in_file = [path for path in drawing.paths if path.layer == layer]
        if len(in_job) != len(in_file):
            problems.append(f"layer {layer}: {counted(len(in_file), 'path')}, not {len(in_job)}")
            continue
        for number, words in enumerate(_path_problems(laser_format, in_job, in_file), start=1):
            problems += [f"layer {layer}, path {number}: {one}" for one in words]
    return tuple(problems)


def _frame_problems(
    laser_format: LaserFormat,
    drawing: ReadDrawing,
    spec: LaserFileSpec,
    expected: Mapping[str, list[StyledPath]],
) -> Iterator[str]:
    """Yield the differences of unit, sheet, layers, and of the colours of layers."""
    if drawing.unit != "mm":
        yield f"the unit is {drawing.unit}, not mm"
    sheet, near_mm = (spec.job.sheet_width_mm, spec.job.sheet_height_mm), laser_format.tolerance_mm
    if drawing.sheet and not np.allclose(drawing.sheet, sheet, rtol=0.0, atol=near_mm):
        yield f"the sheet is {_listed(drawing.sheet)}, not {_listed(sheet)}"
    if not expected:
        yield "there is nothing to draw: the job has no path that this preset writes"
    in_file = [layer for layer, _ in groupby(path.layer for path in drawing.paths) if layer]
    if in_file != list(expected):
        yield f"the layers are {', '.join(in_file)}, not {', '.join(expected)}"
    if drawing.layer_colours is None:
        return
    for layer, paths in expected.items():
        found, colour = drawing.layer_colours.get(layer), laser_format.colour(paths[-1].style)
        if found != colour:
            yield f"layer {layer} has colour {found}, not {colour}"


def _path_problems(
    laser_format: LaserFormat, in_job: Sequence[StyledPath], in_file: Sequence[DrawnPath]
) -> list[list[str]]:
    """Return the differences of each path of a layer; sizes are compared with the job's.

    A point that is off by the tolerance moves an area by at most the tolerance along the whole
    path, and a segment's length by at most twice the tolerance (vertices that split a long arc
    count too). Chords are shorter than their arc by a third of the sagitta per radian.
    """
    problems: list[list[str]] = [[] for _ in in_job]
    models, drawn = [one.path.contour for one in in_job], [path.contour for path in in_file]
    meant = [laser_format.contour(model) for model in models]
    alike = []
    for number, (words, styled, path) in enumerate(zip(problems, in_job, in_file, strict=True)):
        read, expected, colour = drawn[number], meant[number], laser_format.colour(styled.style)
        if path.colour != colour:
            words.append(f"colour {path.colour}, not {colour}")
        if read.closed != models[number].closed:
            ends = ("closed", "open") if read.closed else ("open", "closed")
            words.append("{}, not {}".format(*ends))
        if read.arc_count != expected.arc_count:
            words.append(f"{counted(read.arc_count, 'arc')}, not {expected.arc_count}")
        if len(read.points_mm) != len(expected.points_mm):
            words.append(f"{len(read.points_mm)} vertices, not {len(expected.points_mm)}")
        elif read.closed == expected.closed:
            alike.append(number)
    near_mm = laser_format.tolerance_mm
    if alike:
        one, two = (_Segments([many[number] for number in alike]) for many in (drawn, meant))
        apart = np.hstack([one.start - two.start, one.middle - two.middle])
        away_mm = np.maximum.reduceat(np.abs(apart).max(axis=1), one.first)
        for at in np.flatnonzero(away_mm > near_mm):
            problems[alike[at]].append(
                f"a point is {away_mm[at]:.4g} mm away from where it should be"
            )
    found, wanted = _Segments(drawn).sizes(), _Segments(models).sizes()
    slack_mm = 2.0 * near_mm * (np.array(list(map(len, models))) + wanted.turn_rad)
    slack_mm += 0.5 * laser_format.sagitta_mm * wanted.turn_rad
    near_mm += laser_format.sagitta_mm
    for at in np.flatnonzero((np.abs(found.box_mm - wanted.box_mm) > near_mm).any(axis=1)):
        boxes = _listed(found.box_mm[at]), _listed(wanted.box_mm[at])
        problems[at].append("the box is {}, not {}".format(*boxes))
    areas = found.area_mm2, wanted.area_mm2
    for at in np.flatnonzero(np.abs(np.subtract(*areas)) > near_mm * wanted.length_mm):
        problems[at].append(
            "the area is {:.3f} mm2, not {:.3f} mm2".format(*(a[at] for a in areas))
        )
    lengths = found.length_mm, wanted.length_mm
    for at in np.flatnonzero(np.abs(np.subtract(*lengths)) > slack_mm):
        off = (length[at] for length in lengths)
        problems[at].append("the length is {:.4f} mm, not {:.4f} mm".format(*off))
    return problems


class _Sizes(NamedTuple):
    """Exact sizes of several contours, one row each."""

    box_mm: Floats
    area_mm2: Floats
    length_mm: Floats
    turn_rad: Floats  # of all arcs of a contour together


class _Segments:
    """All segments of several contours as arrays, one row for each vertex.

    The last row of an open contour leads back to its start: it bounds the area alone.
    """

    def __init__(self, contours: Sequence[Contour]) -> None:
        counts = np.array([len(contour.points_mm) for contour in contours])
        self.first = np.cumsum(counts) - counts
        self.start = np.concatenate([contour.points_mm for contour in contours])
        self.end, last = following(self.start), self.first + counts - 1
        self.end[last] = self.start[self.first]
        ends = (np.zeros(0 if contour.closed else 1) for contour in contours)
        bulges = [contour.bulges for contour in contours]
        self.bulge = np.concatenate(
            [part for pair in zip(bulges, ends, strict=True) for part in pair]
        )
        self._back = last[[not contour.closed for contour in contours]]
        self._owner = np.repeat(np.arange(len(counts)), counts)

    @property
    def middle(self) -> Floats:
        """The middle of every segment, on the arc where it is one."""
        (x, y), half = (self.end - self.start).T, self.bulge / 2.0
        middle: Floats = (self.start + self.end) / 2.0 + np.column_stack([y * half, -x * half])
        return middle

    def sizes(self) -> _Sizes:
        """Return the sizes of the contours, as `Contour` has them."""
        turn = 4.0 * np.arctan(self.bulge)
        (x, y), (to_x, to_y) = self.start.T, self.end.T
        length, area = np.hypot(to_x - x, to_y - y), (x * to_y - to_x * y) / 2.0
        low, high = (ufunc.reduceat(self.start, self.first) for ufunc in (np.minimum, np.maximum))
        arc = np.flatnonzero(self.bulge)
        chord, bent, bulge = length[arc], turn[arc], self.bulge[arc]
        with np.errstate(divide="ignore", invalid="ignore"):
            cap = chord**2 * (bent - np.sin(bent)) / (8.0 * np.sin(bent / 2.0) ** 2)
        # The closed form subtracts nearly equal numbers where an arc hardly turns: its series.
        series = chord**2 * bent / 12.0 * (1.0 + bent**2 / 30.0)
        area[arc] += np.where(np.abs(bent) < 1e-3, series, cap)
        radius = chord * (1.0 + bulge**2) / (4.0 * np.abs(bulge))
        length[arc], length[self._back] = radius * np.abs(bent), 0.0
        # An arc may be farthest along an axis between its ends.
        along = (1.0 - bulge**2) / (4.0 * bulge)
        center = (self.start[arc] + self.end[arc]) / 2.0
        center += along[:, None] * np.column_stack([(y - to_y)[arc], (to_x - x)[arc]])
        begin = np.arctan2(*(self.start[arc] - center).T[::-1])
        for quarter in range(4):
            angle = quarter * math.pi / 2.0
            gone = np.remainder(np.where(bent > 0.0, angle - begin, begin - angle), math.tau)
            on = np.flatnonzero(gone < np.abs(bent))
            way = np.array([math.cos(angle), math.sin(angle)])
            farthest = center[on] + radius[on, None] * way
            np.minimum.at(low, self._owner[arc[on]], farthest)
            np.maximum.at(high, self._owner[arc[on]], farthest)
        area, length, turns = (
            np.add.reduceat(one, self.first) for one in (area, length, np.abs(turn))
        )
        return _Sizes(np.hstack([low, high]), area, length, turns)


def _listed(values: Iterable[float]) -> str:
    return " x ".join(f"{value:.4f}" for value in values)
