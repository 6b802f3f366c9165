"""The files of a rig's printed parts; every file is read back and compared with its parts.

A new format is one module with a `PartFormat` and one line in `PART_FORMATS`; the comparison here
is the same for all.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from vinefab.core.errors import UnreadableFileError
from vinefab.core.registry import Registry
from vinefab.rig.part import PartFormat, PartItem, Rig, RigPart, mesh_problems
from vinefab.rig.printing import Bed, Printing
from vinefab.rig.stl_format import STL
from vinefab.rig.threemf_format import THREEMF

PART_FORMATS: Registry[PartFormat] = Registry("part format", {"stl": STL, "3mf": THREEMF})
"""All formats by name."""

_PLACE_MM = 1e-3


def part_files(rig: Rig, printing: Printing) -> dict[str, bytes]:
    """Return the files of a rig's printed parts by name, in every format."""
    return {
        name: one.write(items, f"{rig.name}, {bed.name}" if bed else items[0].part.name)
        for one in PART_FORMATS.values()
        for name, bed, items in _contents(one, rig, printing)
    }


def part_problems(
    files: Mapping[str, bytes], rig: Rig, printing: Printing
) -> dict[str, tuple[str, ...]]:
    """Read every file back and return, by part, what is wrong with it."""
    problems: dict[str, list[str]] = {part.name: [] for part in rig.printed}
    for one in PART_FORMATS.values():
        for name, bed, items in _contents(one, rig, printing):
            prefix = f"({name}) " if bed else ""
            for part, found in read_back_problems(one, files[name], items).items():
                problems[part] += [f"{prefix}{problem}" for problem in found]
    return {name: tuple(found) for name, found in problems.items()}


def read_back_problems(
    part_format: PartFormat, data: bytes, items: Sequence[PartItem]
) -> dict[str, tuple[str, ...]]:
    """Read one file back and return, by part, what is wrong with it."""
    try:
        read = part_format.read(data)
    except UnreadableFileError as error:
        return {item.part.name: (error.problem,) for item in items}
    names = [item.part.name for item in items]
    if len(read) != len(items) or any(
        one.name not in (None, name) for one, name in zip(read, names, strict=True)
    ):
        return {names[0]: ("is in a file with other parts than planned",)}
    found = {}
    for item, one in zip(items, read, strict=True):
        away_mm = float(np.abs(np.subtract((*item.at_mm, 0.0), one.shift_mm)).max())
        place = (f"lies {away_mm:.4g} mm off its place",) if away_mm > _PLACE_MM else ()
        found[item.part.name] = (*mesh_problems(one.mesh, item.part), *place)
    return found


def stl_name(part: RigPart) -> str:
    """Return the name of a part's STL file."""
    return f"{part.name}{STL.suffix}"


def bed_name(bed: Bed) -> str:
    """Return the name of a bed's 3MF file."""
    return f"{bed.name}{THREEMF.suffix}"


def _contents(
    part_format: PartFormat, rig: Rig, printing: Printing
) -> list[tuple[str, Bed | None, list[PartItem]]]:
    """Return the files of a format: name, bed if it is the file of one, and parts."""
    suffix, parts = part_format.suffix, rig.printed
    if not part_format.per_bed:
        return [(f"{part.name}{suffix}", None, [PartItem(part=part)]) for part in parts]
    return [
        (
            f"{bed.name}{suffix}",
            bed,
            [PartItem(part=parts[at.index], at_mm=(at.x_mm, at.y_mm)) for at in bed.places],
        )
        for bed in printing.beds
    ]
