"""Laser jobs as LightBurn projects (.lbrn2), and recipes as LightBurn material libraries (.clb).

Neither format is published; both were worked out by others from files that LightBurn wrote. What
is written here is the plainest form that all of them agree on: paths of straight lines (arcs as
chords within 0.01 mm), one cut setting per operation, no transforms, nothing that moves the lens.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from vinefab.core.jsontext import GENERATOR
from vinefab.export.colours import DEFAULT
from vinefab.export.drawn import StyledPath, metadata, one_line, styled_paths
from vinefab.model.checked import Floats
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
    """Return a job as the text of a LightBurn project, to be encoded as UTF-8.

    Parameters
    ----------
    job
        The paths; what is only for people to read (``doc``) is left out.
    profile
        Whose recipe gives each layer its power, speed and passes.

    Raises
    ------
    BadInputError
        If the recipe lacks an operation of the job.
    """
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


def drawn_contour(contour: Contour) -> Contour:
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
    contour = drawn_contour(styled.path.contour)
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
