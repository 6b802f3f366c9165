"""The files of a rig: one STL per part, rig.json and a part list."""

import csv
import io
from dataclasses import asdict

from vinefab.core.errors import ReadBackError
from vinefab.core.hashing import sha256_of
from vinefab.core.jsontext import GENERATOR, json_text
from vinefab.export.stl import check_stl, stl_bytes
from vinefab.model.map import Map
from vinefab.model.printer import Printer
from vinefab.rig.assembled import Comparison
from vinefab.rig.options import RigOptions
from vinefab.rig.part import Rig, RigPart, ThinPlace

SCHEMA = "vinefab/rig-1"


def rig_files(rig: Rig, world: Map, comparison: Comparison) -> dict[str, bytes]:
    """Return every file of a rig by name, the STL files already read again and found right.

    Parameters
    ----------
    rig
        What is printed.
    world
        The map that it was made from.
    comparison
        How the assembled rig compares with the map (`vinefab.rig.assembled.compare_with_map`).

    Raises
    ------
    ReadBackError
        If an STL file, read again, is not the closed solid that it should be.
    """
    files = {}
    for part in rig.parts:
        data = stl_bytes(part.vertices_mm, part.faces, part.name)
        problems = check_stl(data, part)
        if problems:
            raise ReadBackError(stl_name(part), "; ".join(problems))
        files[stl_name(part)] = data
    digests = {name: sha256_of(data) for name, data in files.items()}
    files["parts.csv"] = parts_text(rig).encode()
    files["rig.json"] = rig_text(rig, world, comparison, digests).encode()
    return files


def stl_name(part: RigPart) -> str:
    """Return the name of a part's file."""
    return f"{part.name}.stl"


def rig_text(rig: Rig, world: Map, comparison: Comparison, digests: dict[str, str]) -> str:
    """Return rig.json.

    A part's ``transform_to_map`` is a 4 x 4 matrix by rows: applied to a point of its STL file
    (x, y, z, 1) in printed millimetres it gives map coordinates, z = 0 being the floor.

    Parameters
    ----------
    rig, world, comparison
        As in `rig_files`.
    digests
        SHA-256 by file name.
    """
    x_mm, y_mm = world.bounds.bounds[:2]
    content = {
        "units": "mm",
        "map": {
            "name": world.name,
            "environment": world.environment,
            "seed": world.seed,
            "walls": world.wall_count,
            "lower_left_mm": [x_mm, y_mm],
            "size_mm": world.size_mm,
        },
        "printer": _fields(rig.printer),
        "options": _fields(rig.options),
        "parts": [_part_content(part, digests[stl_name(part)]) for part in rig.parts],
        "volume_mm3": _round(rig.volume_mm3),
        "joint_gap_mm3": _round(rig.joint_gap_mm3),
        "counts": dict(rig.counts),
        "thin_places": [_fields(place) for place in rig.thin_places],
        "against_map": _fields(comparison),
        "notes": list(rig.notes),
    }
    return json_text(SCHEMA, content)


def parts_text(rig: Rig) -> str:
    """Return the part list as CSV, our mark in a comment above the column names."""
    text = io.StringIO()
    text.write(f"# {GENERATOR}\n")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        ["number", "file", "row", "column", "x_mm", "y_mm", "z_mm", "volume_cm3", "triangles"]
    )
    for number, part in enumerate(rig.parts, 1):
        sizes = [f"{size:.2f}" for size in part.size_mm]
        volume = f"{part.volume_mm3 / 1000.0:.2f}"
        table.writerow(
            [number, stl_name(part), part.row, part.column, *sizes, volume, len(part.faces)]
        )
    return text.getvalue()


def _part_content(part: RigPart, digest: str) -> dict[str, object]:
    return {
        "name": part.name,
        "file": stl_name(part),
        "sha256": digest,
        "row": part.row,
        "column": part.column,
        "volume_mm3": _round(part.volume_mm3),
        "size_mm": [_round(size) for size in part.size_mm],
        "triangles": len(part.faces),
        "transform_to_map": part.to_map,
    }


def _fields(noun: Printer | RigOptions | ThinPlace | Comparison) -> dict[str, object]:
    return {name: _round(value) for name, value in asdict(noun).items()}


def _round(value: object) -> object:
    """Round numbers to what they mean, so that files do not differ in a last digit."""
    return round(value, 6) if isinstance(value, float) else value
