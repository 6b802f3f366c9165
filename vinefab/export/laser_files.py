"""The laser files of a job, and whether they say what they should."""

from collections.abc import Mapping

from vinefab.core.errors import UnreadableFileError
from vinefab.export.colours import DEFAULT, Colours
from vinefab.export.dxf import dxf_text
from vinefab.export.readback import compare, read_dxf, read_svg
from vinefab.export.svg import HAIRLINE_MM, svg_text
from vinefab.model.job import Job

DXF_NAME = "outline.dxf"
POLYLINE_NAME = "outline_polyline.dxf"
SVG_NAME = "outline.svg"


def laser_files(
    job: Job, colours: Colours = DEFAULT, *, hairline_mm: float = HAIRLINE_MM
) -> dict[str, bytes]:
    """Return DXF, flattened DXF and SVG of a job, by file name.

    Parameters
    ----------
    job
        The paths.
    colours
        Layers and colours.
    hairline_mm
        Stroke width in the SVG.
    """
    return {
        DXF_NAME: dxf_text(job, colours).encode(),
        POLYLINE_NAME: dxf_text(job, colours, polyline=True).encode(),
        SVG_NAME: svg_text(job, colours, hairline_mm=hairline_mm).encode(),
    }


def laser_file_problems(
    files: Mapping[str, bytes], job: Job, colours: Colours = DEFAULT
) -> dict[str, tuple[str, ...]]:
    """Read laser files again and return, by file name, what is wrong with each.

    Parameters
    ----------
    files
        As `laser_files` returns them, or as found in a folder.
    job, colours
        What they were written from.

    Returns
    -------
    dict
        One entry per laser file, missing ones included; empty tuples when all is right.
    """
    names = DXF_NAME, POLYLINE_NAME, SVG_NAME
    return {name: _problems(name, files.get(name), job, colours) for name in names}


def _problems(name: str, data: bytes | None, job: Job, colours: Colours) -> tuple[str, ...]:
    if data is None:
        return ("the file is missing",)
    try:
        text = data.decode("utf-8")
        drawing = read_svg(text) if name == SVG_NAME else read_dxf(text)
    except (UnreadableFileError, UnicodeDecodeError) as error:
        return (str(error),)
    return compare(job, drawing, colours, polyline=name == POLYLINE_NAME)
