"""Reading a LightBurn project of ours again, and comparing it with the job and the recipe."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.jsontext import GENERATOR
from vinefab.core.validation import Floats
from vinefab.fabrication.formats.laser_drawing import (
    DEFAULT,
    DrawnPath,
    Format,
    ReadDrawing,
    StyledPath,
    metadata,
    one_line,
    styled_paths,
)
from vinefab.fabrication.formats.readback import drawing_differences
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile, OperationSettings
from vinefab.model.outline import FLATTEN_MM, Contour

DECIMALS = 4
TOOL_1, TOOL_2 = 30, 31
"""LightBurn's two tool layers, which it shows and never runs."""

PALETTE = (
    *("#000000", "#0000FF", "#FF0000", "#00E000", "#D0D000", "#FF8000", "#00E0E0", "#FF00FF"),
    *("#B4B4B4", "#0000A0", "#A00000", "#00A000", "#A0A000", "#C08000", "#00A0FF", "#A000A0"),
)
"""Colours of LightBurn's layers C00 to C15."""

_NOTES = (
    "Set the focus by hand: this file moves no lens. Keep the order of the layers and switch off "
    "path optimization. Leave kerf at 0: the offsets are in the paths. LightBurn's format is not "
    "published; if anything looks wrong, import outline.dxf or outline.svg instead."
)


def lightburn_text(job: Job, profile: LaserProfile) -> str:
    """Return a job as the text of a LightBurn project, to be encoded as UTF-8."""
    paths = project_paths(job)
    root = ET.Element(
        "LightBurnProject",
        AppVersion="1.0.00",
        FormatVersion="1",
        MaterialHeight="0",
        MirrorX="False",
        MirrorY="False",
    )
    layers = {styled.style.layer: styled for styled in reversed(paths)}
    for priority, styled in enumerate(reversed(layers.values())):
        root.append(_layer(styled, profile, priority))
    for number, styled in enumerate(paths):
        root.append(_shape(number, styled, profile))
    words = [*(f"{key}: {value}" for key, value in metadata(job, DEFAULT).items()), _NOTES]
    ET.SubElement(root, "Notes", ShowOnLoad="1", Notes=" | ".join(words))
    return _document(root)


def library_text(profile: LaserProfile) -> str:
    """Return a recipe as the text of a LightBurn material library, to be encoded as UTF-8."""
    recipe, material = profile.recipe, _name(profile.material.title)
    root = ET.Element(
        "LightBurnLibrary", DisplayName=f"{recipe.name} [{recipe.status}], {GENERATOR}"
    )
    entries = ET.SubElement(root, "Material", name=material)
    for operation, settings in recipe.operations.items():
        if not settings.by_laser:
            continue
        entry = ET.SubElement(
            entries, "Entry", Thickness="-1.0000", Desc=operation, NoThickTitle=operation
        )
        cut = ET.SubElement(entry, "CutSetting", type="Cut")
        linked = [("LinkPath", f"{material}/{operation}/{operation}")]
        _values(cut, [("index", "0"), ("name", ""), *linked, *cut_values(settings)])
    return _document(root)


def project_paths(job: Job) -> tuple[StyledPath, ...]:
    """Return the paths that a project holds, in process order."""
    paths = styled_paths(job, DEFAULT)
    return tuple(styled for styled in paths if styled.path.operation is not Operation.DOC)


def layer_index(styled: StyledPath, profile: LaserProfile) -> int:
    """Return LightBurn's number of a path's layer; its colour follows from it."""
    if not styled.path.operation.is_machined:
        return TOOL_1
    if not styled.path.settings_in(profile).by_laser:
        return TOOL_2
    return PALETTE.index(styled.style.rgb)


def cut_values(settings: OperationSettings) -> list[tuple[str, str]]:
    """Return the names and values by which LightBurn knows an operation's settings.

    The focus offset is not among them: machines do not agree on which way is up.
    """
    return [
        ("minPower", _number(settings.min_power_percent.value)),
        ("maxPower", _number(settings.power_percent.value)),
        ("speed", _number(settings.speed_mm_s.value)),
        ("frequency", _number(settings.frequency_hz.value)),
        ("numPasses", str(settings.passes)),
        ("runBlower", str(int(settings.air_assist))),
    ]


def lightburn_contour(contour: Contour) -> Contour:
    """Return a contour as a project holds it: its chords."""
    return Contour.polyline(contour.flattened_mm(FLATTEN_MM), closed=contour.closed)


def _layer(styled: StyledPath, profile: LaserProfile, priority: int) -> ET.Element:
    index = layer_index(styled, profile)
    tool = index in (TOOL_1, TOOL_2)
    cut = ET.Element("CutSetting", type="Tool" if tool else "Cut")
    values = [] if tool else cut_values(styled.path.settings_in(profile))
    head = [("index", str(index)), ("name", styled.style.layer)]
    _values(cut, [*head, *values, ("priority", str(priority))])
    return cut


def _shape(number: int, styled: StyledPath, profile: LaserProfile) -> ET.Element:
    # The numbers of the lists must differ: shapes with the same number share their lists.
    shape = ET.Element(
        "Shape",
        Type="Path",
        CutIndex=str(layer_index(styled, profile)),
        VertID=str(number),
        PrimID=str(number),
    )
    contour = lightburn_contour(styled.path.contour)
    points: Floats = contour.points_mm
    ET.SubElement(shape, "XForm").text = "1 0 0 1 0 0"
    vertices = (f"V{_number(x)} {_number(y)}c0x1c1x1" for x, y in points.tolist())
    ET.SubElement(shape, "VertList").text = "".join(vertices)
    count = len(points)
    lines = (f"L{at} {(at + 1) % count}" for at in range(len(contour)))
    ET.SubElement(shape, "PrimList").text = "".join(lines)
    return shape


def _values(parent: ET.Element, pairs: Iterable[tuple[str, str]]) -> None:
    for name, value in pairs:
        ET.SubElement(parent, name, Value=value)


def _document(root: ET.Element) -> str:
    ET.indent(root, " ")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _name(text: str) -> str:
    """Return a text without the slash, which parts the names in a library's paths."""
    return one_line(text).replace("/", "-")


def _number(value: float) -> str:
    return f"{round(float(value), DECIMALS) + 0.0:.{DECIMALS}f}".rstrip("0").rstrip(".")


_VERTEX = re.compile(r"V(-?[\d.]+) (-?[\d.]+)c0x1c1x1")
_LINE = re.compile(r"L(\d+) (\d+)")
_COLOURS = {
    **dict(enumerate(PALETTE)),
    TOOL_1: DEFAULT.styles[Operation.REG].rgb,
    TOOL_2: DEFAULT.styles[Operation.WELD].rgb,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Project:
    """A LightBurn project as read."""

    drawing: ReadDrawing  # its paths; it has no sheet
    # names and values of each layer's cut setting, by the layer's name, in order of priority
    settings: dict[str, dict[str, str]]
    tools: frozenset[str]  # layers that are never run


def read_lightburn(text: str) -> Project:
    """Return what a project says."""
    try:
        return _project(_root(text))
    except (ET.ParseError, BadInputError, KeyError, ValueError) as error:
        raise UnreadableFileError("LightBurn text", f"not a project of ours: {error}") from error


def lightburn_problems(text: str, job: Job, profile: LaserProfile) -> tuple[str, ...]:
    """Return everything in which a project differs from a job and its recipe, in words."""
    try:
        project = read_lightburn(text)
    except UnreadableFileError as error:
        return (str(error),)
    machined = tuple(path for path in job.paths if path.operation is not Operation.DOC)
    meant = Job(
        name=job.name,
        sheet_width_mm=job.sheet_width_mm,
        sheet_height_mm=job.sheet_height_mm,
        paths=machined,
    )
    problems = list(drawing_differences(meant, project.drawing, DEFAULT, polyline=True))
    layers = {styled.style.layer: styled.path for styled in reversed(project_paths(job))}
    if list(project.settings) != list(reversed(layers)):
        problems.append(f"the layers run as {', '.join(project.settings)}")
    for layer, path in layers.items():
        runs = path.operation.is_machined and path.settings_in(profile).by_laser
        if runs == (layer in project.tools):
            problems.append(f"layer {layer} is {'not run' if runs else 'run'}")
        if runs:
            found = project.settings.get(layer, {})
            problems.extend(
                f"layer {layer}: {name} is {found.get(name)}, not {value}"
                for name, value in cut_values(path.settings_in(profile))
                if found.get(name) != value
            )
    return tuple(problems)


def library_problems(text: str, profile: LaserProfile) -> tuple[str, ...]:
    """Return everything in which a material library differs from a recipe, in words."""
    try:
        entries = {entry.get("Desc", ""): entry for entry in _root(text).iter("Entry")}
    except (ET.ParseError, BadInputError) as error:
        return (f"not a library of ours: {error}",)
    meant = {op: s for op, s in profile.recipe.operations.items() if s.by_laser}
    if list(entries) != list(meant):
        return (f"the entries are {', '.join(entries)}, not {', '.join(meant)}",)
    found = {op: {value.tag: value.get("Value") for value in e[0]} for op, e in entries.items()}
    return tuple(
        f"entry {operation}: {name} is {found[operation].get(name)}, not {value}"
        for operation, settings in meant.items()
        for name, value in cut_values(settings)
        if found[operation].get(name) != value
    )


def _root(text: str) -> ET.Element:
    if "<!" in text:
        raise BadInputError("<!", text[text.index("<!") :][:40], "no declarations, no comments")
    # Without declarations there are no entities that could expand without end.
    return ET.fromstring(text.encode())  # noqa: S314


def _project(root: ET.Element) -> Project:
    cuts = sorted(root.findall("CutSetting"), key=lambda cut: int(_value(cut, "priority")))
    names = {_value(cut, "index"): _value(cut, "name") for cut in cuts}
    known = {"CutSetting", "Shape", "Notes"}
    odd = [f"element {element.tag}" for element in root if element.tag not in known]
    if len(names) != len(cuts):
        odd.append("two cut settings with one number")
    shapes = root.findall("Shape")
    if len({shape.get("VertID") for shape in shapes}) != len(shapes):
        odd.append("shapes that share their vertices")
    return Project(
        drawing=ReadDrawing(
            format=Format.LIGHTBURN,
            unit="mm",
            sheet=None,
            paths=tuple(_path(shape, names) for shape in shapes),
            layer_colours={},
            oddities=tuple(odd),
        ),
        settings={
            _value(cut, "name"): {child.tag: child.get("Value", "") for child in cut}
            for cut in cuts
        },
        tools=frozenset(_value(cut, "name") for cut in cuts if cut.get("type") == "Tool"),
    )


def _value(cut: ET.Element, name: str) -> str:
    found = cut.find(name)
    if found is None:
        raise BadInputError(name, None, "a cut setting with index, name and priority")
    return found.get("Value", "")


def _path(shape: ET.Element, names: dict[str, str]) -> DrawnPath:
    if shape.get("Type") != "Path" or shape.findtext("XForm") != "1 0 0 1 0 0":
        raise BadInputError("Shape", shape.get("Type"), "a path that is not transformed")
    index = shape.get("CutIndex", "")
    vertices, lines = shape.findtext("VertList") or "", shape.findtext("PrimList") or ""
    points = np.array([(float(x), float(y)) for x, y in _VERTEX.findall(vertices)])
    joins = [(int(a), int(b)) for a, b in _LINE.findall(lines)]
    closed = len(joins) == len(points)
    expected = [(at, (at + 1) % len(points)) for at in range(len(points) - (not closed))]
    rest = _VERTEX.sub("", vertices) + _LINE.sub("", lines)
    if rest or joins != expected:
        raise BadInputError("PrimList", lines[:40], "every vertex joined to the next")
    return DrawnPath(
        layer=names[index],
        colour=_COLOURS[int(index)],
        contour=Contour.polyline(points, closed=closed),
    )
