"""rig.json and parts.csv: written, and a rig's folder read back for the rules."""

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vinefab.core.errors import UnreadableFileError
from vinefab.core.jsontext import GENERATOR, json_text
from vinefab.fabrication.rules.subject import RigFacts, RigPartFacts
from vinefab.model.files.named_file import path_inside
from vinefab.model.files.profile_toml import FileName
from vinefab.model.files.shipped import read_bytes, read_text
from vinefab.model.files.toml import validated
from vinefab.model.finding import CheckReport
from vinefab.model.job import Job, Operation
from vinefab.model.map import Map
from vinefab.rig.comparison_with_map import RigComparison
from vinefab.rig.fixtures import Fixtures
from vinefab.rig.open_shell import shell_words
from vinefab.rig.part import BOX_MM, VOLUME_SHARE, Rig, RigPart, ThinPlace
from vinefab.rig.part_files import bed_name, stl_name
from vinefab.rig.printing import BASIS, PrintEstimate, Printing
from vinefab.rig.rig_options import Printer, RigOptions
from vinefab.rig.stl_format import read_stl

_SCHEMA = "vinefab/rig-1"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigRecord:
    """Content of rig.json and parts.csv."""

    rig: Rig
    world: Map
    printing: Printing
    comparison: RigComparison
    report: CheckReport
    jobs: Mapping[str, Job] = field(default_factory=dict)  # sheets for the laser, by file name
    why_style: str = ""  # which style was chosen and what the other would take
    fixtures: Fixtures = field(default_factory=Fixtures)


def rig_text(record: RigRecord, digests: Mapping[str, str]) -> str:
    """Return rig.json.

    A part's ``transform_to_map`` is a 4 x 4 matrix by rows: applied to a point of its STL file
    (x, y, z, 1) in printed millimetres it gives map coordinates, z = 0 being the floor.
    """
    rig, world, printing = record.rig, record.world, record.printing
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
        "style": rig.style,
        "why_style": record.why_style,
        "shells": {
            "parts": sum(part.hollow for part in rig.parts),
            "solid_parts": sum(not part.hollow for part in rig.parts),
            "words": shell_words(rig),
        },
        "parts": [
            _part_content(index, part, record, digests) for index, part in enumerate(rig.parts)
        ],
        "extras": [
            _part_content(index, part, record, digests)
            for index, part in enumerate(rig.extras, len(rig.parts))
        ],
        "beds": [
            {
                "file": bed_name(bed),
                "sha256": digests[bed_name(bed)],
                "parts": [rig.printed[at.index].name for at in bed.places],
                "estimate": _fields(bed.estimate),
            }
            for bed in printing.beds
        ],
        "laser": [
            {
                "file": name,
                "sha256": digests[name],
                "sheet_mm": [_round(job.sheet_width_mm), _round(job.sheet_height_mm)],
                "cut_mm": _round(job.length_mm(Operation.CUT)),
                "mark_mm": _round(job.length_mm(Operation.MARK)),
            }
            for name, job in record.jobs.items()
        ],
        "markers": _markers_content(record),
        "base_holder": _base_content(record),
        "estimate": {"basis": BASIS, **_fields(printing.total)},
        "volume_mm3": _round(rig.volume_mm3),
        "joint_gap_mm3": _round(rig.joint_gap_mm3),
        "counts": dict(rig.counts),
        "thin_places": [_fields(place) for place in rig.thin_places],
        "against_map": _fields(record.comparison),
        "checks": record.report.content,
        "notes": list(rig.notes),
    }
    return json_text(_SCHEMA, content)


def _markers_content(record: RigRecord) -> list[dict[str, object]]:
    """Return the corner markers: corners from the upper left clockwise, in map coordinates."""
    options = record.rig.options
    return [
        {
            "number": marker.number,
            "corners_mm": marker.corners_mm,
            "z_mm": _round(marker.z_mm),
            "side_printed_mm": options.marker_mm,
            "made": options.marker_kind,
        }
        for marker in record.fixtures.markers
    ]


def _base_content(record: RigRecord) -> dict[str, object] | None:
    """Return the base holder, in printed millimetres; the pose in map coordinates."""
    base = record.fixtures.base
    if base is None:
        return None
    pose = record.world.starts[base.start - 1].pose
    return {
        "start": base.start,
        "pose": {"x_mm": pose.x_mm, "y_mm": pose.y_mm, "heading_deg": _round(pose.heading_deg)},
        "tube_mm": _round(base.tube.diameter_mm),
        "tube_standing": base.tube.standing,
        "bore_mm": _round(base.bore_mm),
        "axis_mm": _round(base.axis_mm),
        "reach_mm": _round(base.reach_mm),
        "headings_deg": list(base.headings_deg),
        "screws": {"thread": "M3", "count": 2, "least_length_mm": _round(base.screw_mm)},
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
        sizes = [f"{size:.2f}" for size in part.size_mm]
        volume = f"{part.volume_mm3 / 1000.0:.2f}"
        bed = bed_name(printing.bed_of(index))
        cells = [part.number or "", stl_name(part), bed, part.row or "", part.column or ""]
        table.writerow([*cells, *sizes, volume, len(part.faces)])
    return text.getvalue()


def _part_content(
    index: int, part: RigPart, record: RigRecord, digests: Mapping[str, str]
) -> dict[str, object]:
    return {
        "name": part.name,
        "number": part.number,
        "file": stl_name(part),
        "sha256": digests[stl_name(part)],
        "bed": bed_name(record.printing.bed_of(index)),
        "row": part.row,
        "column": part.column,
        "volume_mm3": _round(part.volume_mm3),
        "size_mm": [_round(size) for size in part.size_mm],
        "triangles": len(part.faces),
        "hollow": part.hollow,
        "colour_change_mm": _round(part.colour_change_mm),
        "transform_to_map": part.to_map,
    }


def _fields(
    noun: Printer | RigOptions | ThinPlace | RigComparison | PrintEstimate,
) -> dict[str, object]:
    return {name: _round(value) for name, value in asdict(noun).items()}


def _round(value: object) -> object:
    """Round numbers to what they mean, so that files do not differ in a last digit."""
    return round(value, 6) if isinstance(value, float) else value


RIG_NAME = "rig.json"

Size = Annotated[list[float], Field(min_length=3, max_length=3)]


class _Known(BaseModel):
    """Base of forms that ignore fields they do not need."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class RigPartForm(_Known):
    """An entry of ``parts`` or ``extras``."""

    name: str
    file: FileName
    volume_mm3: Annotated[float, Field(gt=0)]
    size_mm: Size


class RigPrinterForm(_Known):
    """The printer that the rig was made for."""

    name: str
    bed_width_mm: float
    bed_depth_mm: float
    height_mm: float


class OptionsForm(_Known):
    """The sizes of the rig."""

    height_mm: Annotated[float, Field(gt=0)]
    bed_margin_mm: float


class MapForm(_Known):
    """The map of the rig."""

    name: str


class RigForm(_Known):
    """``rig.json``, as far as the rules need it."""

    schema_: Literal["vinefab/rig-1"] = Field(alias="schema")
    style: Literal["plate", "board", "sheet"]  # sheet: in layers, of earlier versions
    map: MapForm
    printer: RigPrinterForm
    options: OptionsForm
    parts: list[RigPartForm]
    extras: list[RigPartForm]


def read_rig(folder: Path) -> RigFacts:
    """Return what the rules need of a rig from its folder, every STL file read."""
    path = folder if folder.name == RIG_NAME else folder / RIG_NAME
    try:
        data = json.loads(read_text(path))
    except (json.JSONDecodeError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {error}") from error
    if not isinstance(data, dict):
        raise UnreadableFileError(path, "is not the JSON of a rig")
    form = validated(RigForm, data, path)
    margin_mm = 2.0 * form.options.bed_margin_mm
    printer, printed = form.printer, [*form.parts, *form.extras]
    solids = [part for part in printed if part.file.endswith(".stl")]
    layered = form.style == "sheet" and form.parts
    return RigFacts(
        name=form.map.name,
        printer=printer.name,
        room_mm=(
            printer.bed_width_mm - margin_mm,
            printer.bed_depth_mm - margin_mm,
            printer.height_mm,
        ),
        height_mm=max(part.size_mm[2] for part in form.parts)
        if layered
        else form.options.height_mm,
        parts=tuple(_facts(path.parent, part) for part in solids),
    )


def _facts(folder: Path, part: RigPartForm) -> RigPartFacts:
    wide_mm, deep_mm, high_mm = part.size_mm
    size_mm = wide_mm, deep_mm, high_mm
    path = path_inside("file", part.file, (folder,), folder / RIG_NAME)
    try:
        mesh = read_stl(read_bytes(path))
    except UnreadableFileError as error:
        return RigPartFacts(name=part.name, size_mm=size_mm, problems=(error.problem,))
    problems = mesh.form_problems()
    if abs(mesh.volume_mm3 - part.volume_mm3) > VOLUME_SHARE * part.volume_mm3:
        problems.append(f"has a volume of {mesh.volume_mm3:.6g} mm3, not {part.volume_mm3:.6g}")
    span_mm = np.ptp(mesh.box_mm, axis=0)
    if np.abs(span_mm - size_mm).max() > BOX_MM:
        problems.append(f"measures {span_mm.tolist()} mm, not {list(size_mm)}")
    wide_mm, deep_mm, high_mm = span_mm.tolist()
    return RigPartFacts(
        name=part.name, size_mm=(wide_mm, deep_mm, high_mm), problems=tuple(problems)
    )
