"""README.txt of a fabrication package: the steps of the person at the laser.

The words stand in ``templates/README.txt.j2`` and ``joining.txt.j2``, in a markup that
`plain_document` lays out; here is what they are filled with.
"""

import math
from functools import cache
from itertools import groupby, pairwise
from textwrap import fill
from types import SimpleNamespace

from jinja2 import Environment, PackageLoader, StrictUndefined

from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import counted, one_line
from vinefab.core.view import Rows, Value
from vinefab.fabrication.formats.laser_drawing import (
    Colours,
    metadata,
    operations_by_style,
    operations_left_out,
    styled_paths,
)
from vinefab.fabrication.formats.laser_formats import LASER_FORMATS, sheet_folder
from vinefab.fabrication.job.tile_jobs import TARGET, VERIFICATION, VERIFY
from vinefab.fabrication.package import piece_joining
from vinefab.fabrication.package.bom import film_piece_mm, robot_count
from vinefab.fabrication.package.mounting import face_words
from vinefab.inflation.pattern import Pattern
from vinefab.inflation.pattern_view import pattern_table
from vinefab.model.design import Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.pieces import Partition
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
    laid_out = [*_layers(job, profile, colours, written)]
    sealed = [op for op in written if op in (Operation.WELD, Operation.WELDCUT)]
    marks = {path.label for path in job.along(Operation.MARK)}
    by_laser = [layer for layer in laid_out if layer.settings and layer.settings.by_laser]
    film_mm = [math.ceil(side_mm - 1e-6) for side_mm in film_piece_mm(job, profile)]
    first = job.sheets[0] if job.sheets else job
    boxes = [styled.path.contour.box_mm for styled in styled_paths(first, colours)]
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    foreign = LASER_FORMATS.packages.items()
    shown = ("generator", "name", "units", "sheet_mm", "kerf")
    facts = {key: str(one) for key, one in metadata(job, colours).items() if key not in shown}
    lists = [key for key, value in facts.items() if value.startswith(("[{", "{"))]
    lines = [f"{key}: {value}" for key, value in facts.items() if key not in lists]
    filled = {
        "design": design,
        "build": design.build,
        "job": job,
        "recipe": profile.recipe,
        "machine": profile.machine,
        "film": profile.material,
        "colours": colours,
        "film_mm": film_mm,
        "sheets": len(job.sheets),
        "sheet_mm": (first.sheet_width_mm, first.sheet_height_mm),
        "box_mm": (min(low_x), min(low_y), max(high_x), max(high_y)),
        "folders": [
            (sheet_folder(number), labels)
            for number, sheet in enumerate(job.sheets, start=1)
            if isinstance(labels := sheet.facts["pieces"], list)
        ],
        "written": written,
        "sealed": sealed,
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
        "target": TARGET,
        "marks": marks,
        "least_seam_mm": min(
            (profile.settings(op).seam_width_mm.value for op in sealed), default=math.nan
        ),
        "verify_layer": f"{colours.styles[Operation.MARK].layer}_{VERIFY}"
        if Operation.MARK in colours.styles and VERIFICATION in marks
        else "",
        "layers": laid_out,
        "repeated": [layer for layer in by_laser if layer.settings.passes > 1],
        "focused": by_laser,
        "focus_changes": [
            (one, two) for one, two in pairwise(by_laser) if one.focus_mm != two.focus_mm
        ],
        "shared_styles": [group for group in operations_by_style(job, colours) if len(group) > 1],
        "left_out": operations_left_out(job, colours),
        "face_words": face_words(design.build),
        "facts": ([*lines, f"{', '.join(lists)}: in job.json"] if lists else lines),
        "partition": partition if partition and partition.sleeves else None,
        "standing": "" if pattern is None else pattern.standing,
        "pattern": [] if pattern is None else _branches(pattern_table(pattern)),
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
            "test_share": piece_joining.TEST_SHARE,
        }
    return filled_document("README.txt.j2", **filled)


def _branches(table: Rows) -> list[dict[str, Value]]:
    """Return the rows of a table by the keys that they have in JSON."""
    return [dict(zip(table.keys, row, strict=True)) for row in table.rows]


def _layers(
    job: Job, profile: LaserProfile, colours: Colours, written: list[Operation]
) -> list[SimpleNamespace]:
    """Return the layers of the files in the order in which they run."""
    layers = []
    for operation in written:
        paths = [path for path in job.along(operation) if path.label != VERIFICATION]
        settings = profile.settings(operation) if operation.is_machined else None
        layers.append(
            SimpleNamespace(
                operation=operation,
                style=colours.styles[operation],
                paths=len(paths),
                length_mm=sum(path.contour.length_mm for path in paths),
                verifying=len(job.along(operation)) - len(paths),
                settings=settings,
                focus_mm=settings.focus_offset_mm.value if settings else math.nan,
            )
        )
    return layers


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
    ``!! `` a warning, ``> `` a line of its own. Indented lines continue what they follow.

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
