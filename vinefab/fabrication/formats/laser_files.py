"""The laser files of a job, and whether they say what they should."""

from collections.abc import Mapping

from vinefab.core.errors import UnreadableFileError
from vinefab.fabrication.formats.dxf_format import dxf_text, read_dxf
from vinefab.fabrication.formats.laser_drawing import DEFAULT, Colours
from vinefab.fabrication.formats.lightburn_format import (
    library_problems,
    library_text,
    lightburn_problems,
    lightburn_text,
)
from vinefab.fabrication.formats.readback import drawing_differences
from vinefab.fabrication.formats.svg_format import HAIRLINE_MM, read_svg, svg_text
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile

DXF_NAME = "outline.dxf"
POLYLINE_NAME = "outline_polyline.dxf"
R12_NAME = "outline_r12.dxf"
SVG_NAME = "outline.svg"
PROJECT_NAME = "outline.lbrn2"
LIBRARY_NAME = "recipe.clb"


def tile_name(number: int, name: str) -> str:
    """Return the name of a tile's file.

    >>> tile_name(2, "outline.dxf")
    'tile_2_outline.dxf'
    """
    return f"tile_{number}_{name}"


def laser_files(
    job: Job,
    colours: Colours = DEFAULT,
    *,
    hairline_mm: float = HAIRLINE_MM,
    profile: LaserProfile | None = None,
    r12: bool = False,
) -> dict[str, bytes]:
    """Return DXF, flattened DXF and SVG of a job, by file name.

    Parameters
    ----------
    profile
        Add a LightBurn project and material library with this recipe's settings; those have a
        layer for every operation, whatever the preset.
    """
    files = {
        DXF_NAME: dxf_text(job, colours),
        POLYLINE_NAME: dxf_text(job, colours, polyline=True),
        SVG_NAME: svg_text(job, colours, hairline_mm=hairline_mm),
    }
    if r12:
        files[R12_NAME] = dxf_text(job, colours, r12=True)
    if profile is not None:
        files[PROJECT_NAME] = lightburn_text(job, profile)
        files[LIBRARY_NAME] = library_text(profile)
    return {name: text.encode() for name, text in files.items()}


def laser_file_problems(
    files: Mapping[str, bytes],
    job: Job,
    colours: Colours = DEFAULT,
    profile: LaserProfile | None = None,
) -> dict[str, tuple[str, ...]]:
    """Read laser files again and return, by file name, what is wrong with each."""
    names = [DXF_NAME, POLYLINE_NAME, SVG_NAME]
    problems = {name: _problems(name, files.get(name), job, colours) for name in names}
    if R12_NAME in files:
        problems[R12_NAME] = _problems(R12_NAME, files[R12_NAME], job, colours)
    if profile is not None:
        for name in (PROJECT_NAME, LIBRARY_NAME):
            problems[name] = _lightburn_problems(name, files.get(name), job, profile)
    return problems


def _problems(name: str, data: bytes | None, job: Job, colours: Colours) -> tuple[str, ...]:
    if data is None:
        return ("the file is missing",)
    try:
        text = data.decode("utf-8")
        drawing = read_svg(text) if name == SVG_NAME else read_dxf(text)
    except (UnreadableFileError, UnicodeDecodeError) as error:
        return (str(error),)
    return drawing_differences(job, drawing, colours, polyline=name == POLYLINE_NAME)


def _lightburn_problems(
    name: str, data: bytes | None, job: Job, profile: LaserProfile
) -> tuple[str, ...]:
    if data is None:
        return ("the file is missing",)
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        return (str(error),)
    if name == LIBRARY_NAME:
        return library_problems(text, profile)
    return lightburn_problems(text, job, profile)
