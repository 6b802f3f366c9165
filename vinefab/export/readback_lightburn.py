"""Reading a LightBurn project of ours again, and comparing it with the job and the recipe."""

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.export.colours import DEFAULT
from vinefab.export.drawing import Drawing, DrawnPath, Format
from vinefab.export.lightburn import PALETTE, TOOL_1, TOOL_2, cut_values, project_paths
from vinefab.export.readback import compare
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour

_VERTEX = re.compile(r"V(-?[\d.]+) (-?[\d.]+)c0x1c1x1")
_LINE = re.compile(r"L(\d+) (\d+)")
_COLOURS = {
    **dict(enumerate(PALETTE)),
    TOOL_1: DEFAULT.styles[Operation.REG].rgb,
    TOOL_2: DEFAULT.styles[Operation.WELD].rgb,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Project:
    """A LightBurn project as read.

    Parameters
    ----------
    drawing
        Its paths; it has no sheet.
    settings
        Names and values of each layer's cut setting, by the layer's name, in order of priority.
    tools
        Layers that are never run.
    """

    drawing: Drawing
    settings: dict[str, dict[str, str]]
    tools: frozenset[str]


def read_lightburn(text: str) -> Project:
    """Return what a project says.

    Raises
    ------
    UnreadableFileError
        If it is not well formed or holds anything that vinefab does not write.
    """
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
    problems = list(compare(meant, project.drawing, DEFAULT, polyline=True))
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
        drawing=Drawing(
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
