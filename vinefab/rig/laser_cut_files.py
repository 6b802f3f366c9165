"""What a laser cuts for a rig: jobs, files read back, and the layers compared with the map."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import ReadBackError, UnreadableFileError
from vinefab.fabrication.formats.dxf_format import dxf_text, read_dxf
from vinefab.fabrication.formats.readback import drawing_differences
from vinefab.model.job import Job, Operation
from vinefab.model.map import Map
from vinefab.rig.clean import pieces_of
from vinefab.rig.comparison_with_map import RigComparison, compare_walls, footprints
from vinefab.rig.laser_cut import Copy, board_jobs, layer_jobs, lid_jobs
from vinefab.rig.loose import Loose
from vinefab.rig.part import Rig


def dxf_files(jobs: Mapping[str, Job]) -> dict[str, bytes]:
    """Return a DXF file per job, by name."""
    return {name: dxf_text(job).encode() for name, job in jobs.items()}


def dxf_problems(files: Mapping[str, bytes], jobs: Mapping[str, Job]) -> dict[str, tuple[str, ...]]:
    """Read the files again and return, by name, what is wrong with each."""
    found = {}
    for name, job in jobs.items():
        try:
            found[name] = drawing_differences(job, read_dxf(files[name].decode()))
        except (UnreadableFileError, UnicodeDecodeError) as error:
            found[name] = (str(error),)
    return found


def material_left(data: bytes, kerf_mm: float) -> BaseGeometry:
    """Return what a sheet's closed straight cuts leave as pieces, the kerf taken off.

    Round holes are left out; they do not reach through to a piece's outline.
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserCutFiles:
    """Everything that a laser cuts for a rig."""

    jobs: dict[str, Job] = field(default_factory=dict)  # by file name
    # the DXF files, read again and found right
    files: dict[str, bytes] = field(default_factory=dict)
    # where each layer of each piece lies, for obstacles cut in layers
    copies: tuple[Copy, ...] = ()


def layers_of(rig: Rig) -> int:
    """Return how many layers of sheet make the obstacles' height, rounded up."""
    return math.ceil(rig.options.height_mm / rig.options.plate_mm - 1e-9)


def standing_mm(rig: Rig) -> float:
    """Return the height of the obstacles as they are made: of whole layers when cut in layers."""
    layered = rig.style == "sheet"
    return layers_of(rig) * rig.options.plate_mm if layered else rig.options.height_mm


def laser_cut_files(rig: Rig, world: Map, pieces: tuple[Loose, ...], *, lid: bool) -> LaserCutFiles:
    """Return what is cut for a rig."""
    options, named = rig.options, list[tuple[str, list[Job]]]()
    plate, copies = _on_plan(rig.plate, rig, world), list[Copy]()
    if rig.style != "plate":
        named.append(("board", board_jobs(rig.name, plate, pieces, options)))
    if rig.style == "sheet":
        jobs, copies = layer_jobs(rig.name, pieces, layers_of(rig), options)
        named.append(("layers", jobs))
    if lid:
        named.append(("lid", lid_jobs(rig.name, plate, options)))
    jobs_by_name = {
        f"{kind}_{number:02d}.dxf": job
        for kind, jobs in named
        for number, job in enumerate(jobs, 1)
    }
    files = dxf_files(jobs_by_name)
    for name, problems in dxf_problems(files, jobs_by_name).items():
        if problems:
            raise ReadBackError(name, "; ".join(problems))
    return LaserCutFiles(jobs=jobs_by_name, files=files, copies=tuple(copies))


def compare_layers(rig: Rig, world: Map, cut: LaserCutFiles) -> RigComparison:
    """Put every layer of every piece back where it belongs and compare each layer with the map.

    Works on the DXF files as read again; the worst layer counts.
    """
    sheets = [
        list(shapely.get_parts(material_left(cut.files[name], rig.options.kerf_mm)))
        for name in cut.jobs
        if name.startswith("layers")
    ]
    trees = [shapely.STRtree(pieces) for pieces in sheets]
    layers: dict[int, list[BaseGeometry]] = {}
    for copy in cut.copies:
        inside = copy.piece.outline.representative_point()
        at = shapely.affinity.translate(inside, *copy.shift_mm)
        for found in trees[copy.sheet].query(at, predicate="intersects"):
            x_mm, y_mm = copy.shift_mm
            back = shapely.affinity.translate(sheets[copy.sheet][int(found)], -x_mm, -y_mm)
            layers.setdefault(copy.layer, []).append(_on_map(back, rig, world))
    compared: list[RigComparison] = [
        compare_walls(rig, world, shapely.union_all(layers.get(layer, [])))
        for layer in range(1, layers_of(rig) + 1)
    ]
    return max(compared, key=_share)


def _share(comparison: RigComparison) -> float:
    return comparison.share


def outlines_of(rig: Rig, world: Map, pieces: tuple[Loose, ...]) -> dict[int, BaseGeometry]:
    """Return what the assembly drawing numbers: outlines by number, in map coordinates."""
    if pieces:
        return {piece.number: _on_map(piece.outline, rig, world) for piece in pieces}
    standing = footprints(rig)
    return {part.number: standing[part.name] for part in rig.parts}


def _on_plan(shape: BaseGeometry, rig: Rig, world: Map) -> BaseGeometry:
    low_mm = world.bounds.bounds[:2]
    return shapely.transform(shape, lambda points: (points - low_mm) * rig.options.scale)


def _on_map(shape: BaseGeometry, rig: Rig, world: Map) -> BaseGeometry:
    low_mm = world.bounds.bounds[:2]
    return shapely.transform(shape, lambda points: points / rig.options.scale + low_mm)
