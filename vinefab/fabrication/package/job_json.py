"""Every setting of a job as JSON: ``vinefab/job-1``."""

from collections.abc import Iterator, Mapping

from vinefab.core.plain_text import json_text
from vinefab.core.view import Block, Data, document
from vinefab.fabrication.formats.dxf_format import DXF
from vinefab.fabrication.formats.laser_drawing import Colours, styled_paths
from vinefab.fabrication.formats.laser_formats import sheet_folder, tile_stem
from vinefab.fabrication.formats.svg_format import SVG
from vinefab.fabrication.package.bom import weakest
from vinefab.fabrication.package.piece_joining import face_words
from vinefab.inflation.pattern import Pattern, pattern_blocks
from vinefab.model.design import Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import (
    NO_SHRINKAGE,
    LapBond,
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    quantities,
)

_SCHEMA = "vinefab/job-1"


def job_text(
    design: Design,
    job: Job,
    profile: LaserProfile,
    colours: Colours,
    pattern: Pattern | None = None,
) -> str:
    """Return the paths to be made, with their settings, in their order.

    Every number of the profile keeps its standing and source; line energy and fluence are computed.
    """
    recipe = profile.recipe
    levels = [
        {
            "branches": level.branches,
            "length_mm": level.length_mm,
            "angle_deg": level.angle_deg,
            "growth_percent": level.growth_percent,
        }
        for level in design.levels
    ]
    pouch, collar = design.build.pouch, design.build.collar
    return json_text(
        _SCHEMA,
        {
            "design": {
                "name": design.name,
                "trunk_length_mm": design.trunk_length_mm,
                "levels": levels,
                "build": {
                    "widths_mm": list(design.build.widths_mm),
                    "end_widths_mm": list(design.build.end_widths_mm),
                    "fillet_mm": list(design.build.fillet_mm),
                    "tail_mm": design.build.tail_mm,
                    "pressure_kpa": design.build.pressure_kpa,
                    "mounting": design.build.mounting,
                    "faces": face_words(design.build),
                    "pouch": None if pouch is None else pouch.model_dump(),
                    "collar": None
                    if collar is None
                    else {
                        **collar.model_dump(),
                        "flat_width_mm": collar.flat_width_mm,
                    },
                },
            },
            **({"pattern": document(_pattern_blocks(pattern))} if pattern else {}),
            "units": "mm",
            "sheet_mm": [job.sheet_width_mm, job.sheet_height_mm],
            "offsets": "applied to the paths; the machine's own kerf stays at 0",
            "facts": {k: v for k, v in job.facts.items() if k not in ("pieces", "joints")},
            "colours": colours.name,
            "machine": _record(profile.machine),
            "material": _record(profile.material),
            "recipe": {
                "name": recipe.name,
                "title": recipe.title,
                "status": str(recipe.status),
                "source": recipe.source,
                "coupons": {k: q.content for k, q in quantities(recipe.coupons).items()},
                "windows": [window.words() for window in recipe.coupons.windows],
                **({"lap": recipe.lap and _record(recipe.lap)} if job.sheets else {}),
            },
            "operations": [
                _operation(operation, job, profile, colours)
                for operation in Operation
                if job.along(operation)
            ],
            "paths": _paths(job, colours),
            "tiles": [
                {
                    "files": [one.file_name(tile_stem(number)) for one in (DXF, SVG)],
                    "facts": dict(tile.facts),
                    "paths": _paths(tile, colours),
                }
                for number, tile in enumerate(job.tiles, start=1)
            ],
            **_sheets(job, colours),
        },
    )


def _pattern_blocks(pattern: Pattern) -> Iterator[Block]:
    yield Data({"standing": "simulated"})
    yield from pattern_blocks(pattern)


def _sheets(job: Job, colours: Colours) -> dict[str, object]:
    """Return the further entries of a robot in pieces: its pieces, joints and sheets."""
    if not job.sheets:
        return {}
    return {
        "pieces": job.facts["pieces"],
        "joints": job.facts["joints"],
        "sheets": [
            {
                "files": [f"{sheet_folder(number)}/{one.file_name()}" for one in (DXF, SVG)],
                "sheet_mm": [sheet.sheet_width_mm, sheet.sheet_height_mm],
                "facts": dict(sheet.facts),
                "paths": _paths(sheet, colours),
            }
            for number, sheet in enumerate(job.sheets, start=1)
        ],
    }


def operation_energy_mj_mm(machine: Machine, settings: OperationSettings) -> Quantity:
    """Return the energy per length of path, all passes: power over speed."""
    used = machine.power_w, settings.power_percent, settings.speed_mm_s
    return Quantity(
        value=settings.line_energy_mj_mm(machine),
        standing=weakest(used),
        source="power / speed x passes",
    )


def fluence_mj_mm2(machine: Machine, settings: OperationSettings) -> Quantity:
    """Return the energy per area under the beam: line energy over spot diameter."""
    line = operation_energy_mj_mm(machine, settings)
    return Quantity(
        value=line.value / settings.spot_mm.value,
        standing=weakest((line, settings.spot_mm)),
        source="line energy / spot",
    )


def _operation(
    operation: Operation, job: Job, profile: LaserProfile, colours: Colours
) -> dict[str, object]:
    style = colours.styles.get(operation)
    content: dict[str, object] = {
        "operation": str(operation),
        "layer": style.layer if style else None,
        "colour": style.rgb if style else None,
        "colour_index": style.aci if style else None,
        "written": style is not None,
        "paths": len(job.along(operation)),
        "length_mm": job.length_mm(operation),
    }
    if operation.is_machined:
        settings = profile.settings(operation)
        content["settings"] = record = {**_record(settings)}
        if settings.by_laser:
            energy = operation_energy_mj_mm(profile.machine, settings)
            record["line_energy_mj_mm"] = energy.content
            record["fluence_mj_mm2"] = fluence_mj_mm2(profile.machine, settings).content
    return content


def _paths(job: Job, colours: Colours) -> list[dict[str, object]]:
    return [
        {
            "order": order,
            "operation": str(styled.path.operation),
            "layer": styled.style.layer,
            "label": styled.path.label,
            "closed": styled.path.contour.closed,
            "segments": len(styled.path.contour),
            "arcs": styled.path.contour.arc_count,
            "length_mm": styled.path.contour.length_mm,
            "box_mm": list(styled.path.contour.box_mm),
        }
        for order, styled in enumerate(styled_paths(job, colours), start=1)
    ]


def _record(noun: Machine | Material | OperationSettings | LapBond) -> Mapping[str, object]:
    values = noun.record() if isinstance(noun, OperationSettings) else dict(noun)
    return {
        name: value.content if isinstance(value, Quantity) else value
        for name, value in values.items()
        if name != "schema_" and value is not NO_SHRINKAGE
    }
