"""README.txt of a fabrication package: the steps of the person at the laser.

The words stand in ``templates/README.txt.j2`` and ``joining.txt.j2``, in a markup that
`plain_document` lays out; here is what they are filled with.
"""

import math
from functools import cache
from itertools import groupby
from textwrap import fill
from types import SimpleNamespace

from jinja2 import Environment, PackageLoader, StrictUndefined

from vinefab.core.plain_text import GENERATOR, counted, one_line
from vinefab.core.view import Rows, Value
from vinefab.fabrication.formats.laser_drawing import (
    Colours,
    StyledPath,
    metadata,
    operations_by_style,
    operations_left_out,
    styled_paths,
)
from vinefab.fabrication.formats.laser_formats import LASER_FORMATS, sheet_folder, tile_stem
from vinefab.fabrication.job.passes import WEB_MM, cut_offset_mm, weld_offset_mm
from vinefab.fabrication.job.tiling import HOLES, PIN_HOLE, TARGET, VERIFY
from vinefab.fabrication.package import piece_joining
from vinefab.fabrication.package.bom import film_piece_mm, robot_count
from vinefab.fabrication.package.piece_joining import face_words
from vinefab.inflation.pattern import Pattern, pattern_table
from vinefab.model.design import Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile, SealerSettings
from vinefab.model.tree import Partition
from vinefab.physics.seam import lap_load_n_mm

_WIDTH = 96


def readme_text(
    design: Design,
    job: Job,
    profile: LaserProfile,
    colours: Colours,
    partition: Partition | None = None,
    pattern: Pattern | None = None,
) -> str:
    """Return the operator's steps for one job, plain text, every number with its standing.

    Parameters
    ----------
    partition
        The pieces of the robots; None for robots in one piece.
    pattern
        How the robot deploys; None where that is left out.
    """
    written = [op for op in Operation if op in colours.styles and job.along(op)]
    sealed = [op for op in written if op in (Operation.WELD, Operation.WELDCUT)]
    film_mm = [math.ceil(side_mm - 1e-6) for side_mm in film_piece_mm(job, profile)]
    foreign = LASER_FORMATS.packages.items()
    shown = ("generator", "name", "units", "sheet_mm", "kerf")
    facts = {key: str(one) for key, one in metadata(job, colours).items() if key not in shown}
    lists = [key for key, value in facts.items() if value.startswith(("[{", "{"))]
    lines = [f"{key}: {value}" for key, value in facts.items() if key not in lists]
    weld = profile.recipe.by_operation.get(Operation.WELD)
    by_hand = Operation.WELD in sealed and weld is not None and not weld.by_laser
    runs = [_run(job, number, profile, colours) for number in range(len(job.runs))]
    filled = {
        "Operation": Operation,
        "design": design,
        "build": design.build,
        "job": job,
        "recipe": profile.recipe,
        "machine": profile.machine,
        "film": profile.material,
        "colours": colours,
        "film_mm": film_mm,
        "runs": runs,
        "written": written,
        "sealed": sealed,
        "sealed_by_hand": by_hand,
        "can_mark": Operation.MARK in written,
        "pins": max(sum(path.label == PIN_HOLE for path in run.job.paths) for run in runs),
        "pin_mm": weld.pin_mm if isinstance(weld, SealerSettings) else None,
        "guide_mm": cut_offset_mm(profile) - weld_offset_mm(profile) if by_hand else math.nan,
        "web_mm": WEB_MM,
        "recipe_tables": [
            f"[operations.{operation}]" if profile.settings(operation).by_laser else "[sealer]"
            for operation in written
            if operation in (Operation.WELD, Operation.WELDCUT, Operation.CUT)
        ],
        "foreign_formats": [
            (LASER_FORMATS[name], package)
            for name, package in foreign
            if not LASER_FORMATS[name].on_request
        ],
        "tiles": job.tiles,
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
        "pattern": [] if pattern is None else _branches(pattern_table(pattern)),
        "test_share": piece_joining.TEST_SHARE,
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


def _branches(table: Rows) -> list[dict[str, Value]]:
    """Return the rows of a table by the keys that they have in JSON."""
    return [dict(zip(table.keys, row, strict=True)) for row in table.rows]


_COLOUR_NAMES = {"#000000": "black", "#0000FF": "blue", "#FF00FF": "magenta", "#FF0000": "red"}


def _run(job: Job, number: int, profile: LaserProfile, colours: Colours) -> SimpleNamespace:
    """Return one list of steps: a sheet or a tile with its files, its box and its layers."""
    run, count = job.runs[number], len(job.runs)
    title, stem = "The sheet", "outline"
    if job.tiles:
        title, stem = f"Tile {number + 1} of {count}", tile_stem(number + 1)
    elif job.sheets:
        folder, labels = sheet_folder(number + 1), run.facts["pieces"]
        pieces = ", ".join(map(str, labels)) if isinstance(labels, list) else ""
        title, stem = f"Sheet {number + 1} of {count}: pieces {pieces}", f"{folder}/outline"
    styled = styled_paths(run, colours)
    boxes = [one.path.contour.box_mm for one in styled]
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    machined = [one for one in styled if one.path.operation.is_machined]
    return SimpleNamespace(
        title=title,
        stem=stem,
        job=run,
        box=(min(low_x), min(low_y), max(high_x), max(high_y)),
        known=_known_length(run),
        layers=[
            _layer(list(group), profile)
            for _, group in groupby(
                sorted(machined, key=_rank), key=lambda one: (one.path.operation, one.style.layer)
            )
        ],
    )


def _rank(one: StyledPath) -> tuple[int, int]:
    """Return the place of a path's layer: a tile is verified first, holes come after marks."""
    first = {VERIFY: 0, "": 1, HOLES: 2}
    return list(Operation).index(one.path.operation), first.get(one.path.variant, 1)


def _layer(styled: list[StyledPath], profile: LaserProfile) -> SimpleNamespace:
    """Return the paths that run at once, with their settings as words."""
    path, style = styled[0].path, styled[0].style
    settings = path.settings_in(profile)
    words = ""
    if settings.by_laser:
        numbers = [settings.power_percent, settings.min_power_percent]
        numbers += [settings.speed_mm_s, settings.frequency_hz]
        power, least, speed, frequency = (number.words() for number in numbers)
        standings = ", ".join(dict.fromkeys(number.standing for number in numbers))
        words = (
            f"power {power} %, in corners {least} %, {speed} mm/s, {frequency} Hz, "
            f"{counted(settings.passes, 'pass')}, air {'on' if settings.air_assist else 'off'}: "
            f"{standings}"
        )
    return SimpleNamespace(
        operation=path.operation,
        variant=path.variant,
        style=style,
        colour=f"{_COLOUR_NAMES.get(style.rgb, '')} {style.rgb}".strip(),
        paths=len(styled),
        length_mm=sum(one.path.contour.length_mm for one in styled),
        settings=settings,
        words=words,
        by_laser=settings.by_laser,
        focus_mm=settings.focus_offset_mm.value,
    )


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


def _on_its_line(value: object) -> object:
    """Return a value that begins no line of the markup, whatever a user named a thing."""
    if not isinstance(value, str):
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
        "corner": _corner,
    }
    environment.globals |= {"counted": counted, "generator": GENERATOR}
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
    blocks: list[list[str]] = []
    for is_blank, lines in groupby(markup.splitlines(), key=lambda line: not line.strip()):
        if not is_blank:
            blocks.append(_block(list(lines)))
    return "\n\n".join("\n".join(block) for block in blocks) + "\n"


def _block(lines: list[str]) -> list[str]:
    """Lay out lines without a blank one between them."""
    parts: list[str] = []
    for line in lines:
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
                width=_WIDTH,
                initial_indent=lead,
                subsequent_indent=" " * len(lead),
                break_on_hyphens=False,
                break_long_words=False,
            )
        )
    return laid_out
