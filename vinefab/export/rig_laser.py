"""DXF files of what a laser cuts for a rig, read again and compared with what was meant."""

from collections.abc import Mapping

import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import UnreadableFileError
from vinefab.export.dxf import dxf_text
from vinefab.export.readback import compare, read_dxf
from vinefab.model.job import Job, Operation
from vinefab.rig.clean import pieces_of


def dxf_files(jobs: Mapping[str, Job]) -> dict[str, bytes]:
    """Return a DXF file per job, by name."""
    return {name: dxf_text(job).encode() for name, job in jobs.items()}


def dxf_problems(files: Mapping[str, bytes], jobs: Mapping[str, Job]) -> dict[str, tuple[str, ...]]:
    """Read the files again and return, by name, what is wrong with each."""
    found = {}
    for name, job in jobs.items():
        try:
            found[name] = compare(job, read_dxf(files[name].decode()))
        except (UnreadableFileError, UnicodeDecodeError) as error:
            found[name] = (str(error),)
    return found


def material_left(data: bytes, kerf_mm: float) -> BaseGeometry:
    """Return what a sheet's closed straight cuts leave as pieces, the kerf taken off.

    Round holes are left out; they do not reach through to a piece's outline.

    Parameters
    ----------
    data
        A DXF file of layers.
    kerf_mm
        Width that the beam removes.
    """
    layer = Operation.CUT.layer
    rings = [
        shapely.LinearRing(path.contour.points_mm)
        for path in read_dxf(data.decode()).paths
        if path.layer == layer and path.contour.closed and not path.contour.arc_count
    ]
    pieces = shapely.build_area(shapely.GeometryCollection(rings))
    return shapely.union_all(
        pieces_of(shapely.buffer(pieces, -0.5 * kerf_mm, join_style="mitre", mitre_limit=5.0))
    )
