"""LightBurn project: paths and settings, with a layer for every operation in every preset."""

import re
import xml.etree.ElementTree as ET

import numpy as np

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.validation import Floats
from vinefab.fabrication.formats.laser_drawing import (
    DEFAULT,
    DrawnPath,
    LaserFileSpec,
    LaserFormat,
    ReadDrawing,
    StyledPath,
    flattened_contour,
    metadata,
    styled_paths,
    xml_root,
)
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import LaserSettings, Tool
from vinefab.model.outline import FLATTEN_MM, Contour

_DECIMALS = 4
_TOLERANCE_MM = 1e-4

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
    "published; if anything looks wrong, import the DXF or the SVG next to it instead."
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
    for priority, styled in enumerate(_layers(paths).values()):
        index = layer_index(styled, profile)
        tool = index in (TOOL_1, TOOL_2)
        cut = ET.SubElement(root, "CutSetting", type="Tool" if tool else "Cut")
        values = _run_values(styled, profile)
        head = [("index", str(index)), ("name", styled.style.layer)]
        for name, value in [*head, *values, ("priority", str(priority))]:
            ET.SubElement(cut, name, Value=value)
    for number, styled in enumerate(paths):
        # The numbers of the lists must differ: shapes with the same number share their lists.
        shape = ET.SubElement(
            root,
            "Shape",
            Type="Path",
            CutIndex=str(layer_index(styled, profile)),
            VertID=str(number),
            PrimID=str(number),
        )
        contour = flattened_contour(styled.path.contour)
        points: Floats = contour.points_mm
        ET.SubElement(shape, "XForm").text = "1 0 0 1 0 0"
        vertices = (f"V{_number(x)} {_number(y)}c0x1c1x1" for x, y in points.tolist())
        ET.SubElement(shape, "VertList").text = "".join(vertices)
        count = len(points)
        lines = (f"L{at} {(at + 1) % count}" for at in range(len(contour)))
        ET.SubElement(shape, "PrimList").text = "".join(lines)
    notes = [*(f"{key}: {value}" for key, value in metadata(job, DEFAULT).items()), _NOTES]
    ET.SubElement(root, "Notes", ShowOnLoad="1", Notes=" | ".join(notes))
    ET.indent(root, " ")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def project_paths(job: Job) -> tuple[StyledPath, ...]:
    """Return the paths that a project holds, in process order."""
    paths = styled_paths(job, DEFAULT)
    return tuple(styled for styled in paths if styled.path.operation is not Operation.DOC)


def _layers(paths: tuple[StyledPath, ...]) -> dict[str, StyledPath]:
    """Return a path of each layer, in the order in which the layers run."""
    found = {styled.style.layer: styled for styled in reversed(paths)}
    return dict(reversed(found.items()))


def layer_index(styled: StyledPath, profile: LaserProfile) -> int:
    """Return LightBurn's number of a path's layer; its colour follows from it."""
    if not styled.path.operation.is_machined:
        return TOOL_1
    if not isinstance(styled.path.settings_in(profile), LaserSettings):
        return TOOL_2
    return PALETTE.index(styled.style.rgb)


def _run_values(styled: StyledPath, profile: LaserProfile) -> list[tuple[str, str]]:
    """Return the settings with which a layer runs; none for one that is never run."""
    if not styled.path.operation.is_machined:
        return []
    settings = styled.path.settings_in(profile)
    return cut_values(settings) if isinstance(settings, LaserSettings) else []


def cut_values(settings: LaserSettings) -> list[tuple[str, str]]:
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


def _number(value: float) -> str:
    return f"{round(float(value), _DECIMALS) + 0.0:.{_DECIMALS}f}".rstrip("0").rstrip(".")


_VERTEX = re.compile(r"V(-?[\d.]+) (-?[\d.]+)c0x1c1x1")
_LINE = re.compile(r"L(\d+) (\d+)")
_COLOURS = {
    **dict(enumerate(PALETTE)),
    TOOL_1: DEFAULT.styles[Operation.REG].rgb,
    TOOL_2: DEFAULT.styles[Operation.WELD].rgb,
}


def read_lightburn(text: str) -> ReadDrawing:
    """Read a project of ours; it has no sheet."""
    try:
        root = xml_root(text)
        cuts = sorted(root.findall("CutSetting"), key=lambda cut: int(_value(cut, "priority")))
        names = {_value(cut, "index"): _value(cut, "name") for cut in cuts}
        known = {"CutSetting", "Shape", "Notes"}
        odd = [f"element {element.tag}" for element in root if element.tag not in known]
        if len(names) != len(cuts):
            odd.append("two cut settings with one number")
        shapes = root.findall("Shape")
        if len({shape.get("VertID") for shape in shapes}) != len(shapes):
            odd.append("shapes that share their vertices")
        return ReadDrawing(
            paths=tuple(_path(shape, names) for shape in shapes),
            settings={
                _value(cut, "name"): {
                    "type": cut.get("type", ""),
                    **{child.tag: child.get("Value", "") for child in cut},
                }
                for cut in cuts
            },
            oddities=tuple(odd),
        )
    except (ET.ParseError, BadInputError, KeyError, ValueError) as error:
        raise UnreadableFileError("LightBurn text", f"not a project of ours: {error}") from None


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


def _project_settings(spec: LaserFileSpec) -> dict[str, dict[str, str]]:
    """Return the settings that each layer of a project must run with; a tool layer is never run."""
    found = {}
    for layer, styled in _layers(project_paths(spec.job)).items():
        runs = layer_index(styled, spec.recipe_profile) not in (TOOL_1, TOOL_2)
        values = _run_values(styled, spec.recipe_profile)
        found[layer] = {"type": "Cut" if runs else "Tool", **dict(values)}
    return found


LIGHTBURN = LaserFormat(
    title="LightBurn project",
    use="holds the settings",
    suffix=".lbrn2",
    write=lambda spec: lightburn_text(spec.job, spec.recipe_profile),
    read=read_lightburn,
    tolerance_mm=_TOLERANCE_MM,
    paths=lambda spec: project_paths(spec.job),
    contour=flattened_contour,
    sagitta_mm=FLATTEN_MM,
    settings=_project_settings,
    needs_profile=True,
    tools=frozenset({Tool.LASER}),
    each_operation=False,  # its layers are switched on and off by themselves
)
