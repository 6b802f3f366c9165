"""Texts of a fabrication package: README.txt, the operator's steps, and job.json, every setting.

The README's words stand in ``templates/README.txt.j2`` and ``joining.txt.j2``, in a markup that
`plain_document` lays out; here is what they are filled with.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from itertools import groupby
from textwrap import fill
from types import SimpleNamespace

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from vinefab.core.plain_text import GENERATOR, counted, json_text, one_line
from vinefab.core.view import Data, document
from vinefab.fabrication.formats.gcode_format import orientation_mm
from vinefab.fabrication.formats.laser_drawing import (
    Colours,
    LaserFileSpec,
    LaserFormat,
    StyledPath,
    metadata,
    operations_by_style,
    operations_left_out,
    styled_paths,
)
from vinefab.fabrication.formats.laser_formats import (
    LASER_FORMATS,
    PlannedFile,
    drawn_jobs,
    files_by_run,
    format_words,
    formats_for,
)
from vinefab.fabrication.formats.pointing_format import POINTING
from vinefab.fabrication.job.bar_strokes import FOLLOW_MM, bar_strokes, seams_name
from vinefab.fabrication.job.passes import WEB_MM, cut_offset_mm, sealed_by_hand, weld_offset_mm
from vinefab.fabrication.job.placement import box_around_mm
from vinefab.fabrication.job.steps import JobStep, process_place, steps_of
from vinefab.fabrication.job.tile_order import BRIDGE_MM, bridge_count
from vinefab.fabrication.job.tiling import PIN_HOLE, TARGET
from vinefab.fabrication.package import piece_joining
from vinefab.fabrication.package.bom import computed_energies, film_piece_mm, robot_count
from vinefab.fabrication.package.folding import FoldedTube, fold_steps, folded_tube
from vinefab.fabrication.package.piece_joining import face_words
from vinefab.fabrication.package.press_mask import TAB_MM, mask_names
from vinefab.inflation.pattern import Pattern, pattern_blocks, pattern_table
from vinefab.model.design import Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import NO_SHRINKAGE, LapBond, LaserProfile, Material
from vinefab.model.machine import Machine, OperationSettings, Sealer, Tool
from vinefab.model.outline import Part
from vinefab.model.quantity import Quantity, quantities
from vinefab.model.tree import Partition
from vinefab.physics.tube import lap_load_n_mm


def readme_text(
    design: Design,
    spec: LaserFileSpec,
    partition: Partition | None = None,
    pattern: Pattern | None = None,
    requested: Collection[str] = (),
) -> str:
    """Return the operator's steps for one job, plain text, every number with its standing.

    Parameters
    ----------
    spec
        The job with its colours and its profile.
    partition
        The pieces of the robots; None for robots in one piece.
    pattern
        How the robot deploys; None where that is left out.
    requested
        Laser formats that are written on request.
    """
    job, profile, colours = spec.job, spec.recipe_profile, spec.colours
    formats = formats_for(profile, requested)
    plan = [file for run in files_by_run(spec, requested).values() for file in run]
    formats = _there(formats, plan)
    written = [op for op in Operation if op in colours.styles and job.along(op)]
    sealed = [op for op in written if op in (Operation.WELD, Operation.WELDCUT)]
    film_mm = [math.ceil(side_mm - 1e-6) for side_mm in film_piece_mm(job, profile)]
    shown = ("generator", "name", "units", "sheet_mm", "kerf")
    facts = {key: str(one) for key, one in metadata(job, colours).items() if key not in shown}
    lists = [key for key, value in facts.items() if value.startswith(("[{", "{"))]
    lines = [f"{key}: {value}" for key, value in facts.items() if key not in lists]
    weld = profile.recipe.by_operation.get(Operation.WELD)
    by_hand = Operation.WELD in sealed and sealed_by_hand(profile, separate=True)
    seals = profile.settings(sealed[0] if sealed else profile.recipe.seals).tool
    tools = {
        seals,
        *(profile.settings(operation).tool for operation in written if operation.is_machined),
    }
    runs = [_run(spec, number, requested) for number in range(len(job.runs))]
    table = None if pattern is None else pattern_table(pattern)
    tube = None if pattern is None else folded_tube(pattern)
    filled = {
        "Operation": Operation,
        "design": design,
        "build": design.build,
        "job": job,
        "recipe": profile.recipe,
        "stale": profile.stale_words,
        "machine": profile.machine,
        "film": profile.material,
        "colours": colours,
        "film_mm": film_mm,
        "runs": runs,
        "written": written,
        "sealed": sealed,
        "by_hand": by_hand,
        "status": profile.status,
        "sealing_template": tool_template(seals),
        "cutting_template": tool_template(profile.settings(Operation.CUT).tool),
        "machine_tools": [
            {"template": tool_template(one.tool), "machine": one}
            for one in profile.machines
            if one.tool in tools
        ],
        "can_mark": Operation.MARK in written,
        "pins": max(sum(path.label == PIN_HOLE for path in run.job.paths) for run in runs),
        "pin_mm": weld.pin_mm if isinstance(weld, Sealer) else None,
        "guide_mm": cut_offset_mm(profile) - weld_offset_mm(profile)
        if Operation.WELD in sealed
        else math.nan,
        "web_mm": WEB_MM,
        "follow_mm": FOLLOW_MM,
        "tab_mm": TAB_MM,
        "recipe_tables": [
            table
            for operation in written
            if operation in (Operation.WELD, Operation.WELDCUT, Operation.CUT)
            for table in profile.recipe.table_of(operation)
        ],
        "formats": [one for one in formats.values() if one.whole],
        "format_lines": [
            format_words(name, _alone(one, plan), _stem(one, plan)) for name, one in formats.items()
        ],
        "orient_mm": max((orientation_mm(one) for one in profile.machines), default=0.0),
        "tiles": job.tiles,
        "bridges": bridge_count(job),
        "bridge_mm": BRIDGE_MM,
        "marks_targets": TARGET in {path.label for path in job.along(Operation.MARK)},
        "least_seam_mm": min(
            (profile.settings(op).seam_width_mm.value for op in sealed), default=math.nan
        ),
        "shared_styles": [group for group in operations_by_style(job, colours) if len(group) > 1],
        "left_out": operations_left_out(job, colours),
        "face_words": face_words(design.build),
        "facts": ([*lines, f"{', '.join(lists)}: in job.json"] if lists else lines),
        "partition": partition if partition and partition.sleeves else None,
        "standing": "" if pattern is None else pattern.standing,
        # rows by the keys that they have in JSON
        "pattern": [dict(zip(table.keys, row, strict=True)) for row in table.rows] if table else [],
        "test_share": piece_joining.TEST_SHARE,
        "fold_steps": fold_steps(tube) if isinstance(tube, FoldedTube) else (),
    }
    if partition and partition.sleeves:
        widest_mm = max(sleeve.width_mm for sleeve in partition.sleeves)
        filled |= {
            "robots": robot_count(job),
            "steps": piece_joining.joining_order(design, partition),
            "strips": piece_joining.needs_strips(profile),
            "pieces_words": piece_joining.pieces_words(partition),
            "order_reasons": piece_joining.order_reasons(profile),
            "widest_socket_mm": piece_joining.widest_socket_mm(partition),
            "lap_load_n_mm": lap_load_n_mm(design.build.pressure_kpa, widest_mm),
            "minutes_per_joint": piece_joining.MINUTES_PER_JOINT,
            "trim_mm": piece_joining.TRIM_MM,
        }
    return filled_document("README.txt.j2", **filled)


_COLOUR_NAMES = {"#000000": "black", "#0000FF": "blue", "#FF00FF": "magenta", "#FF0000": "red"}


def _there(
    formats: Mapping[str, LaserFormat], plan: Sequence[PlannedFile]
) -> dict[str, LaserFormat]:
    """Return the formats of which there are files."""
    kinds = [file.kind for file in plan]
    return {name: one for name, one in formats.items() if one in kinds}


def _stem(one: LaserFormat, plan: Sequence[PlannedFile]) -> str:
    """Return how the name of a format's first file begins, without its folder."""
    first = next(file.name for file in plan if file.kind is one)
    return first.rpartition("/")[2].removesuffix(one.suffix)


def _alone(one: LaserFormat, plan: Sequence[PlannedFile]) -> list[str]:
    """Return the files of a format that hold one operation; those of every sheet have one name."""
    names = (file.name for file in plan if file.kind is one and file.step is not None)
    return list(dict.fromkeys(name.rpartition("/")[2] for name in names))


def _run(spec: LaserFileSpec, number: int, requested: Collection[str]) -> SimpleNamespace:
    """Return one list of steps: a sheet or a tile with its files, its box and its layers."""
    job, profile, colours = spec.job, spec.recipe_profile, spec.colours
    run, count = job.runs[number], len(job.runs)
    stem, plan = list(files_by_run(spec, requested).items())[number - count]
    strokes, tool = bar_strokes(run, profile), _tool_of(run, profile)
    title, is_mouth = "The sheet", False
    if job.tiles:
        made_here = [path for path in run.paths if path.operation.is_machined]
        is_mouth = all(set(path.contour.parts) == {Part.MOUTH} for path in made_here)
        cuts_alone = {path.operation for path in made_here} == {Operation.CUT}
        what = ": the mouth" if is_mouth else ": cut" if cuts_alone else ""
        title = f"Tile {number + 1} of {count}{what}"
    elif job.sheets:
        pieces = ", ".join(job.labels_on(number + 1))
        title = f"Sheet {number + 1} of {count}: pieces {pieces}"
    styled = styled_paths(run, colours)
    boxes = [one.path.contour.box_mm for one in styled]
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    machined = sorted(
        (one for one in styled if one.path.operation.is_machined),
        key=lambda one: process_place(one.path),
    )
    return SimpleNamespace(
        title=title,
        stem=stem,
        patterns=[file.name for file in plan if file.kind.paper],
        strokes=strokes,
        seams_file=seams_name(stem),
        mask_files=mask_names(stem),
        shields=sum(stroke.needs_shield for stroke in strokes),
        presses=sum(stroke.presses for stroke in strokes),
        gap_mm=max((stroke.gap_mm for stroke in strokes), default=math.nan),
        job=run,
        is_first=number == 0,
        is_last=number == count - 1,
        is_mouth=is_mouth,
        pointing=next((file.name for file in plan if file.kind is POINTING), ""),
        machine=profile.machine_of(tool) or profile.machine,
        machine_template=tool_template(tool),
        box=(min(low_x), min(low_y), max(high_x), max(high_y)),
        known=_known_length(run),
        seam_places=_seam_places(run),
        crosses_on=f"{Operation.REG.layer} (never cut)"
        if run.along(Operation.REG)
        else Operation.MARK.layer,
        alone=[file.name for file in plan if file.step is not None and file.kind is plan[0].kind],
        driven=[
            SimpleNamespace(name=file.name, box=box_around_mm(p.contour for p in file.step.paths))
            for file in plan
            if file.kind.tools and file.step is not None
        ],
        layers=[
            _layer(list(group), profile, plan)
            for _, group in groupby(machined, key=lambda one: (one.path.operation, one.style.layer))
        ],
    )


def _tool_of(run: Job, profile: LaserProfile) -> Tool:
    """Return the tool of the machine that the film of a run lies on."""
    tools = [path.settings_in(profile).tool for path in run.paths if path.operation.is_machined]
    return next((tool for tool in tools if not tool.by_hand), tools[0])


def _layer(
    styled: list[StyledPath], profile: LaserProfile, plan: Sequence[PlannedFile]
) -> SimpleNamespace:
    """Return the paths that run at once, with their settings and their file."""
    path, style = styled[0].path, styled[0].style
    settings = path.settings_in(profile)
    name = path.variant or str(path.operation)
    files = [file for file in plan if file.step is not None and file.step.name == name]
    # A file for this very tool goes before one for any program.
    files.sort(key=lambda file: not file.kind.tools)
    return SimpleNamespace(
        operation=path.operation,
        variant=path.variant,
        style=style,
        colour=f"{_COLOUR_NAMES.get(style.rgb, '')} {style.rgb}".strip(),
        paths=len(styled),
        length_mm=sum(one.path.contour.length_mm for one in styled),
        settings=settings,
        template=tool_template(settings.tool),
        file=files[0].name if files else "",
    )


def tool_template(tool: Tool) -> str:
    """Return the template of the words for a tool: macros that every such template has."""
    return f"tools/{tool}.txt.j2"


def _standings(*numbers: Quantity) -> str:
    return ", ".join(dict.fromkeys(number.standing for number in numbers))


def _seam_places(run: Job) -> str:
    """Return two places of the seams, far apart: to align a sheet by that is sealed."""
    welds = run.along(Operation.WELD)
    if not welds:
        return ""
    points = np.concatenate([path.contour.points_mm for path in welds])
    first = points[0]
    far = points[np.argmax(np.hypot(*(points - first).T))]
    return " and ".join(f"({x:.1f}, {y:.1f}) mm" for x, y in (first.tolist(), far.tolist()))


def _known_length(run: Job) -> tuple[str, float] | None:
    """Return a length to measure after import: between pin holes, or of a straight cut."""
    holes = [path.contour.box_mm for path in run.paths if path.label == PIN_HOLE]
    if len(holes) > 1:
        (x0, y0, *_), (x1, y1, *_) = holes[:2]
        return "the two pin holes farthest apart, middle to middle", math.hypot(x1 - x0, y1 - y0)
    straight = [path for path in run.along(Operation.CUT) if len(path.contour) == 1]
    longest = max(straight, key=lambda path: path.contour.length_mm, default=None)
    if longest is None:
        return None
    return f"the straight cut {longest.label!r}", longest.contour.length_mm


def _corner(tile: Job) -> str:
    """Return the place of the film's lower left corner while a tile is cut."""
    x, y = (-float(str(tile.facts[f"window_{axis}_mm"])) for axis in "xy")
    return (
        f"{abs(x):.0f} mm {'left' if x < 0 else 'right'} of the bed's lower left corner and"
        f" {abs(y):.0f} mm {'below' if y < 0 else 'above'} it"
    )


class _Lines(str):
    """What a macro wrote: lines of the markup, in which values have been put on their lines."""

    __slots__ = ()


def _on_its_line(value: object) -> object:
    """Return a value that begins no line of the markup, whatever a user named a thing."""
    if not isinstance(value, str) or isinstance(value, _Lines):
        return value
    return "".join(letter if letter.isprintable() else " " for letter in value)


def filled_document(template: str, **values: object) -> str:
    """Return a template of this folder, filled and laid out as plain text."""
    return plain_document(_environment().get_template(template).render(**values))


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("vinefab.fabrication.package"),
        autoescape=False,  # noqa: S701  plain text
        undefined=StrictUndefined,
        trim_blocks=True,
        finalize=_on_its_line,
    )
    environment.filters |= {
        "in_unit": lambda quantity, unit: f"{quantity.words()} {unit} ({quantity.standing})",
        "number": "{:g}".format,
        "lines": _Lines,
        "corner": _corner,
    }
    environment.globals |= {
        "counted": counted,
        "generator": GENERATOR,
        "standings": _standings,
    }
    return environment


_LEADS = ("- ", "+ ", "* ", "!! ")


def plain_document(markup: str) -> str:
    r"""Lay out paragraphs, titles and lists as plain text, 96 columns wide.

    ``# `` and ``## `` begin titles, ``- `` an item, ``+ `` a numbered and ``* `` a lettered one,
    ``!! `` a warning, ``> `` a separate line. Indented lines continue what they follow.

    >>> print(plain_document("## Do\n+ one\n  thing\n+ two"), end="")
    Do
    --
    1. one thing
    2. two
    """
    blocks = []
    width = 96
    for is_blank, block in groupby(markup.splitlines(), key=lambda line: not line.strip()):
        if is_blank:
            continue
        parts: list[str] = []
        for line in block:
            if not parts or line.startswith((*_LEADS, "# ", "## ", "> ")):
                parts.append(line)
            else:
                parts[-1] += f" {line}"
        laid_out, numbered, lettered = list[str](), 0, 0
        wide = len(str(sum(part.startswith("+ ") for part in parts)))
        for part in parts:
            mark, _, text = part.partition(" ")
            text = one_line(text)
            if mark in ("#", "##"):
                laid_out += [text, ("=" if mark == "#" else "-") * len(text)]
                continue
            lead = {"-": "- ", "!!": "!! ", ">": ""}.get(mark)
            if mark == "+":
                numbered += 1
                lead = f"{numbered:>{wide}}. "
            elif mark == "*":
                lead = f"{chr(ord('a') + lettered)}. "
                lettered += 1
            elif lead is None:
                lead, text = "", one_line(part)
            laid_out.append(
                fill(
                    text,
                    width=width,
                    initial_indent=lead,
                    subsequent_indent=" " * len(lead),
                    break_on_hyphens=False,
                    break_long_words=False,
                )
            )
        blocks.append("\n".join(laid_out))
    return "\n\n".join(blocks) + "\n"


_SCHEMA = "vinefab/job-1"


def job_text(
    design: Design,
    spec: LaserFileSpec,
    pattern: Pattern | None = None,
    requested: Collection[str] = (),
) -> str:
    """Return the paths to be made, with their settings, in their order.

    Every number of the profile keeps its standing and source; line energy and fluence are computed.
    """
    job, profile, colours = spec.job, spec.recipe_profile, spec.colours
    formats, runs = formats_for(profile, requested), drawn_jobs(job)
    files = files_by_run(spec, requested)
    plan = [file for run in files.values() for file in run]
    formats = _there(formats, plan)
    recipe, build = profile.recipe, design.build
    pouch, collar = build.pouch, build.collar
    content: dict[str, object] = {
        "design": {
            "name": design.name,
            **design.written,
            "build": {
                "widths_mm": list(build.widths_mm),
                "end_widths_mm": list(build.end_widths_mm),
                "fillet_mm": list(build.fillet_mm),
                "tail_mm": build.tail_mm,
                "pressure_kpa": build.pressure_kpa,
                "mounting": build.mounting,
                "faces": face_words(build),
                "pouch": pouch and pouch.model_dump(),
                "collar": collar and {**collar.model_dump(), "flat_width_mm": collar.flat_width_mm},
            },
        }
    }
    if pattern:
        content["pattern"] = document([Data({"standing": "simulated"}), *pattern_blocks(pattern)])
    content |= {
        "units": "mm",
        "sheet_mm": [job.sheet_width_mm, job.sheet_height_mm],
        "offsets": "applied to the paths; the machine's own kerf stays at 0",
        "facts": dict(job.facts),
        "formats": [
            {
                "name": name,
                "files": [file.name for file in plan if file.kind is one],
                "title": one.title,
                "use": one.use,
                "package": LASER_FORMATS.packages.get(name),
            }
            for name, one in formats.items()
        ],
        "colours": colours.name,
        "machine": _record(profile.machine),
        "material": _record(profile.material),
        "recipe": {
            "name": recipe.name,
            "title": recipe.title,
            "status": str(recipe.status),
            "source": recipe.source,
            "coupons": {key: one.content for key, one in quantities(recipe.coupons).items()},
            "windows": [window.words() for window in recipe.coupons.windows],
            **({"lap": recipe.lap and _record(recipe.lap)} if job.sheets else {}),
        },
        "operations": _operations(spec, plan),
        "paths": _paths(job, colours),
        "tiles": [
            {
                **_run_record(files[stem]),
                "facts": dict(tile.facts),
                "paths": _paths(tile, colours),
            }
            for stem, tile in runs.items()
            if tile in job.tiles  # the whole is shown, not made
        ],
    }
    if job.sheets:
        content |= job.parts
        content["sheets"] = [
            {
                **_run_record(files[stem]),
                "sheet_mm": [sheet.sheet_width_mm, sheet.sheet_height_mm],
                "facts": dict(sheet.facts),
                "paths": _paths(sheet, colours),
            }
            for stem, sheet in runs.items()
        ]
    return json_text(_SCHEMA, content)


def _operations(spec: LaserFileSpec, plan: Sequence[PlannedFile]) -> list[dict[str, object]]:
    """Return the machine's steps in their order, each with its files; then the lines for people."""
    job, profile = spec.job, spec.recipe_profile
    styles = {id(styled.path): styled.style for styled in spec.paths}
    shown = [op for op in (Operation.REG, Operation.DOC) if job.along(op)]
    lines = (JobStep(operation=op, variant="", paths=job.along(op)) for op in shown)
    content = []
    for step in (*steps_of(job), *lines):
        style = styles.get(id(step.paths[0]))
        record: dict[str, object] = {
            **_step_record(step, plan),
            "operation": str(step.operation),
            "layer": style.layer if style else None,
            "colour": style.rgb if style else None,
            "colour_index": style.aci if style else None,
            "written": style is not None,
        }
        if step.operation.is_machined:
            settings = step.paths[0].settings_in(profile)
            record["settings"] = found = {**_record(settings)}
            energies = computed_energies(profile, settings)
            found |= {name: energy.content for name, energy in energies.items()}
        content.append(record)
    return content


def _step_record(step: JobStep, plan: Sequence[PlannedFile]) -> dict[str, object]:
    """Return a step with the files that hold it alone: the first of them, and all."""
    files = [file.name for file in plan if file.step is not None and file.step.name == step.name]
    return {
        "name": step.name,
        "file": files[0] if files else None,
        "files": files,
        "paths": len(step.paths),
        "length_mm": step.length_mm,
    }


def _run_record(plan: Sequence[PlannedFile]) -> dict[str, object]:
    """Return the files of a sheet or tile: the whole, then by operation in process order."""
    steps = {file.step.name: file.step for file in plan if file.step is not None}
    return {
        "files": [file.name for file in plan if file.step is None],
        "operations": [_step_record(step, plan) for step in steps.values()],
    }


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
