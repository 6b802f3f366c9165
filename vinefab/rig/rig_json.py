"""rig.json and parts.csv: written, and a rig's folder read back for the rules."""

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field

from vinefab.core.errors import UnreadableFileError
from vinefab.core.plain_text import GENERATOR, json_text, rounded
from vinefab.core.table import TablePart, validated
from vinefab.fabrication.rules.rule import RigFacts, RigPartFacts
from vinefab.model.files.shipped import path_inside, read_bytes, read_text
from vinefab.model.finding import CheckReport
from vinefab.model.job import Job, Operation
from vinefab.model.laser import FileName
from vinefab.model.map import Map
from vinefab.rig.build import RigComparison
from vinefab.rig.fixtures import Fixtures
from vinefab.rig.part import BOX_MM, VOLUME_SHARE, Rig
from vinefab.rig.part_files import BASIS, Printing, bed_name, read_stl, stl_name
from vinefab.rig.rig_options import Printer
from vinefab.rig.solid import shell_words

RIG_NAME = "rig.json"
"""The file by which the folder of a rig is known again."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigRecord:
    """Content of rig.json and parts.csv."""

    rig: Rig
    world: Map
    printing: Printing
    comparison: RigComparison  # of the assembled rig with the map
    report: CheckReport  # of the rules about rigs
    jobs: Mapping[str, Job] = field(default_factory=dict)  # sheets for the laser, by file name
    why_style: str = ""  # the chosen style and the needs of the other
    fixtures: Fixtures = field(default_factory=Fixtures)


def rig_text(record: RigRecord, digests: Mapping[str, str]) -> str:
    """Return rig.json.

    A part's ``transform_to_map`` is a 4 x 4 matrix by rows: applied to a point of its STL file
    (x, y, z, 1) in printed millimetres it gives map coordinates, z = 0 being the floor. Corners of
    markers run from the upper left clockwise, in map coordinates; the base holder is in printed
    millimetres, its pose in map coordinates.
    """
    rig, world, printing = record.rig, record.world, record.printing
    # Numbers are rounded to what they mean, so that files do not differ in a last digit; arrays
    # (transforms, corners) and the values of the map and the rules stay.
    parts = [
        {
            "name": part.name,
            "number": part.number,
            "file": stl_name(part),
            "sha256": digests[stl_name(part)],
            "bed": bed_name(printing.bed_of(index)),
            "row": part.row,
            "column": part.column,
            "volume_mm3": part.volume_mm3,
            "size_mm": part.size_mm,
            "triangles": len(part.faces),
            "hollow": part.hollow,
            "colour_change_mm": part.colour_change_mm,
            "transform_to_map": part.to_map,
        }
        for index, part in enumerate(rig.printed)
    ]
    content: dict[str, Any] = {
        "units": "mm",
        "map": {
            "name": world.name,
            "environment": world.environment,
            "seed": world.seed,
            "walls": world.wall_count,
            "lower_left_mm": world.bounds.bounds[:2],
            "size_mm": world.size_mm,
        },
        "printer": rig.printer.model_dump(),
        "options": rig.options.model_dump(),
        "style": rig.style,
        "why_style": record.why_style,
        "shells": {
            "parts": sum(part.hollow for part in rig.parts),
            "solid_parts": sum(not part.hollow for part in rig.parts),
            "words": shell_words(rig),
        },
        "parts": parts[: len(rig.parts)],
        "extras": parts[len(rig.parts) :],
        "beds": [
            {
                "file": bed_name(bed),
                "sha256": digests[bed_name(bed)],
                "parts": [rig.printed[at.index].name for at in bed.places],
                "estimate": asdict(bed.estimate),
            }
            for bed in printing.beds
        ],
        "laser": [
            {
                "file": name,
                "sha256": digests[name],
                "sheet_mm": (job.sheet_width_mm, job.sheet_height_mm),
                "cut_mm": job.length_mm(Operation.CUT),
                "mark_mm": job.length_mm(Operation.MARK),
            }
            for name, job in record.jobs.items()
        ],
        "markers": [
            {
                "number": marker.number,
                "corners_mm": marker.corners_mm,
                "z_mm": marker.z_mm,
                "side_printed_mm": rig.options.marker_mm,
                "made": rig.options.marker_kind,
            }
            for marker in record.fixtures.markers
        ],
        "base_holder": _base_content(record),
        "estimate": {"basis": BASIS, **asdict(printing.total)},
        "volume_mm3": rig.volume_mm3,
        "joint_gap_mm3": rig.joint_gap_mm3,
        "counts": rig.counts,
        "thin_places": [asdict(place) for place in rig.thin_places],
        "against_map": asdict(record.comparison),
        "checks": record.report.content,
        "notes": rig.notes,
    }
    exact = {key: content[key] for key in ("map", "checks")}
    return json_text("vinefab/rig-1", {**rounded(content, 6), **exact})


def _base_content(record: RigRecord) -> dict[str, object] | None:
    base = record.fixtures.base
    if base is None:
        return None
    return {
        "start": base.start,
        "pose": record.world.starts[base.start - 1].pose.content,
        "tube_mm": base.tube.diameter_mm,
        "tube_standing": base.tube.standing,
        "bore_mm": base.bore_mm,
        "axis_mm": base.axis_mm,
        "reach_mm": base.reach_mm,
        "headings_deg": base.headings_deg,
        "screws": {"thread": "M3", "count": 2, "least_length_mm": base.screw_mm},
        "parts": [part.name for part in base.parts],
    }


def parts_text(rig: Rig, printing: Printing) -> str:
    """Return the part list as CSV, our mark in a comment above the column names."""
    text = io.StringIO()
    text.write(f"# {GENERATOR}\n")
    table = csv.writer(text, lineterminator="\n")
    table.writerow(
        [
            "number",
            "file",
            "bed",
            "row",
            "column",
            "x_mm",
            "y_mm",
            "z_mm",
            "volume_cm3",
            "triangles",
        ]
    )
    for index, part in enumerate(rig.printed):
        cells = [part.number or "", stl_name(part), bed_name(printing.bed_of(index))]
        cells += [part.row or "", part.column or "", *(f"{size:.2f}" for size in part.size_mm)]
        table.writerow([*cells, f"{part.volume_mm3 / 1000.0:.2f}", len(part.faces)])
    return text.getvalue()


# --- A folder read back: forms hold no more than the rules need


Above0 = Annotated[float, Field(gt=0)]


class PartForm(TablePart):
    """An entry of ``parts`` or ``extras``."""

    name: str
    file: FileName
    volume_mm3: Above0
    size_mm: Annotated[tuple[float, float, float], Field(strict=False)]


class RigPrinter(Printer):
    """The printer that the rig was made for."""

    model_config = ConfigDict(extra="ignore")


class OptionsForm(TablePart):
    """The sizes of the rig."""

    height_mm: Above0
    bed_margin_mm: float


class MapForm(TablePart):
    """The map of the rig."""

    name: str


class RigForm(TablePart):
    """``rig.json``."""

    schema_: Literal["vinefab/rig-1"] = Field(alias="schema")
    style: Literal["plate", "board", "sheet"]  # sheet: in layers, of earlier versions
    map: MapForm
    printer: RigPrinter
    options: OptionsForm
    parts: list[PartForm]
    extras: list[PartForm]


def read_rig(folder: Path) -> RigFacts:
    """Return the facts that the rules need of a rig from its folder, every STL file read."""
    path = folder if folder.name == RIG_NAME else folder / RIG_NAME
    try:
        data = json.loads(read_text(path))
    except (json.JSONDecodeError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {error}") from error
    if not isinstance(data, dict):
        raise UnreadableFileError(path, "is not the JSON of a rig")
    form = validated(RigForm, data, path)
    printer, margin_mm = form.printer, 2.0 * form.options.bed_margin_mm
    wide_mm, deep_mm = printer.bed_width_mm - margin_mm, printer.bed_depth_mm - margin_mm
    layered = form.style == "sheet" and form.parts
    return RigFacts(
        name=form.map.name,
        printer=printer.name,
        room_mm=(wide_mm, deep_mm, printer.height_mm),
        height_mm=max(part.size_mm[2] for part in form.parts)
        if layered
        else form.options.height_mm,
        parts=tuple(
            _facts(path.parent, part)
            for part in (*form.parts, *form.extras)
            if part.file.endswith(".stl")
        ),
    )


def _facts(folder: Path, part: PartForm) -> RigPartFacts:
    path = path_inside("file", part.file, (folder,), folder / RIG_NAME)
    try:
        mesh = read_stl(read_bytes(path))
    except UnreadableFileError as error:
        return RigPartFacts(name=part.name, size_mm=part.size_mm, problems=(error.problem,))
    problems = mesh.form_problems()
    if abs(mesh.volume_mm3 - part.volume_mm3) > VOLUME_SHARE * part.volume_mm3:
        problems.append(f"has a volume of {mesh.volume_mm3:.6g} mm3, not {part.volume_mm3:.6g}")
    span_mm = np.ptp(mesh.box_mm, axis=0)
    if np.abs(span_mm - part.size_mm).max() > BOX_MM:
        problems.append(f"measures {span_mm.tolist()} mm, not {list(part.size_mm)}")
    return RigPartFacts(name=part.name, size_mm=tuple(span_mm.tolist()), problems=tuple(problems))
