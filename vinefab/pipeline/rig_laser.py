"""What a laser cuts for a rig: jobs, files read back, and the layers compared with the map."""

import math
from dataclasses import dataclass, field

import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import ReadBackError
from vinefab.export.rig_laser import dxf_files, dxf_problems, material_left
from vinefab.model.job import Job
from vinefab.model.map import Map
from vinefab.rig.assembled import Comparison, compare_walls, footprints
from vinefab.rig.lasered import Copy, board_jobs, layer_jobs, lid_jobs
from vinefab.rig.loose import Loose
from vinefab.rig.part import Rig


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lasered:
    """Everything that a laser cuts for a rig.

    Parameters
    ----------
    jobs
        By file name.
    files
        The DXF files, read again and found right.
    copies
        Where each layer of each piece lies, for obstacles cut in layers.
    """

    jobs: dict[str, Job] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    copies: tuple[Copy, ...] = ()


def layers_of(rig: Rig) -> int:
    """Return how many layers of sheet make the obstacles' height, rounded up."""
    return math.ceil(rig.options.height_mm / rig.options.plate_mm - 1e-9)


def standing_mm(rig: Rig) -> float:
    """Return the height of the obstacles as they are made: of whole layers when cut in layers."""
    layered = rig.style == "sheet"
    return layers_of(rig) * rig.options.plate_mm if layered else rig.options.height_mm


def lasered(rig: Rig, world: Map, pieces: tuple[Loose, ...], *, lid: bool) -> Lasered:
    """Return what is cut for a rig.

    Parameters
    ----------
    rig, world
        The rig and its map.
    pieces
        Its loose pieces; none when the obstacles are printed on their plate.
    lid
        Whether a lid is wanted.

    Raises
    ------
    ReadBackError
        If a file, read again, does not hold what was meant.
    """
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
    return Lasered(jobs=jobs_by_name, files=files, copies=tuple(copies))


def compare_layers(rig: Rig, world: Map, cut: Lasered) -> Comparison:
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
    compared: list[Comparison] = [
        compare_walls(rig, world, shapely.union_all(layers.get(layer, [])))
        for layer in range(1, layers_of(rig) + 1)
    ]
    return max(compared, key=_share)


def _share(comparison: Comparison) -> float:
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
