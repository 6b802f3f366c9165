"""The files of a rig's printed parts: one STL per part, one 3MF per bed; and both read again."""

import zipfile
from collections.abc import Mapping

import numpy as np

from vinefab.rig.part import Rig, RigPart
from vinefab.rig.printing import Bed, Printing
from vinefab.rig.stl_format import check_stl, mesh_problems, stl_bytes
from vinefab.rig.threemf_format import ThreeMfItem, read_threemf, threemf_bytes

_PLACE_MM = 1e-3


def solid_files(rig: Rig, printing: Printing) -> dict[str, bytes]:
    """Return the STL and 3MF files of a rig by name."""
    files = {
        stl_name(part): stl_bytes(part.vertices_mm, part.faces, part.name) for part in rig.printed
    }
    for bed in printing.beds:
        files[bed_name(bed)] = threemf_bytes(_items(bed, rig), f"{rig.name}, {bed.name}")
    return files


def solid_problems(
    files: Mapping[str, bytes], rig: Rig, printing: Printing
) -> dict[str, tuple[str, ...]]:
    """Read STL and 3MF files again and return, by part, what is wrong with them."""
    problems = {part.name: list(check_stl(files[stl_name(part)], part)) for part in rig.printed}
    for bed in printing.beds:
        for name, found in _bed_problems(files[bed_name(bed)], bed, rig).items():
            problems[name] += [f"({bed_name(bed)}) {problem}" for problem in found]
    return {name: tuple(found) for name, found in problems.items()}


def stl_name(part: RigPart) -> str:
    """Return the name of a part's file."""
    return f"{part.name}.stl"


def bed_name(bed: Bed) -> str:
    """Return the name of a bed's file."""
    return f"{bed.name}.3mf"


def _items(bed: Bed, rig: Rig) -> list[ThreeMfItem]:
    parts = rig.printed
    return [ThreeMfItem(part=parts[at.index], at_mm=(at.x_mm, at.y_mm)) for at in bed.places]


def _bed_problems(data: bytes, bed: Bed, rig: Rig) -> dict[str, tuple[str, ...]]:
    items = _items(bed, rig)
    try:
        read = read_threemf(data)
    except (ValueError, KeyError, SyntaxError, zipfile.BadZipFile) as error:
        return {item.part.name: (f"cannot be read: {error}",) for item in items}
    if [item.part.name for item in items] != [item.name for item in read]:
        return {items[0].part.name: ("lies among other parts than it should",)}
    found = {}
    for item, got in zip(items, read, strict=True):
        away_mm = np.abs(np.subtract((*item.at_mm, 0.0), got.shift_mm)).max()
        astray = ("does not lie where it should",) if away_mm > _PLACE_MM else ()
        found[item.part.name] = (*mesh_problems(got.mesh, item.part), *astray)
    return found
