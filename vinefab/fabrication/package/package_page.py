"""Sections on how a design is made: sheet, rules, pressure, bill of materials, assumptions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely

from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.core.view import Picture, Rows, Section
from vinefab.fabrication.package.assembly_drawing import exploded_picture
from vinefab.fabrication.package.bom import BomLine
from vinefab.fabrication.package.piece_joining import (
    MINUTES_PER_JOINT,
    joining_order,
    order_reasons,
    pieces_words,
)
from vinefab.fabrication.package.sheet_pictures import findings_plan, job_plan, pattern_plan
from vinefab.inflation.pattern import Pattern, pattern_blocks
from vinefab.model.design import Design
from vinefab.model.finding import CheckReport, Finding
from vinefab.model.job import Job
from vinefab.model.laser import (
    NO_SHRINKAGE,
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    Standing,
    quantities,
)
from vinefab.model.outline import Contour
from vinefab.model.tree import Partition, branch_tree
from vinefab.pages.page_files import page_svg
from vinefab.physics.seam import burst_pressure_kpa, hoop_strain, seam_load_n_mm
from vinefab.physics.tube import inflated_diameter_mm


def sheet_section(job: Job, findings: Sequence[Finding]) -> Section:
    """Return the sheet for the laser: picture and the changes to the paths."""
    # Pieces and joints have a separate section.
    facts = {name: fact for name, fact in job.facts.items() if name not in ("pieces", "joints")}
    rows = tuple((name.replace("_", " "), _value(value)) for name, value in facts.items())
    picture = Picture(
        image=lambda: page_svg(job_plan(job, tuple(findings))),
        caption="The sheet: seam and kerf offsets are in the paths; leave the machine's kerf at 0.",
    )
    return Section(
        title="The sheets for the laser" if len(job.sheets) > 1 else "The sheet for the laser",
        pictures=(picture,),
        tables=(
            Rows(
                caption="What the paths hold (computed)", headings=("", ""), rows=rows, folded=True
            ),
        ),
    )


def check_section(
    report: CheckReport,
    outline_mm: Callable[[], Floats] | None = None,
    *,
    title: str = "Design rules",
) -> Section:
    """Return every finding, at its place in the outline, and every rule that was run or skipped."""
    found = tuple(
        (str(number), *_finding_row(finding))
        for number, finding in enumerate(report.findings, start=1)
    )
    ran = ", ".join(f"{run.rule} ({run.checked})" for run in report.run)
    skipped = tuple((rule.rule, rule.reason) for rule in report.skipped)
    stale = tuple(f"Stale waiver {name}: it matches no finding." for name in report.stale_waivers)
    findings = Rows(
        caption="Findings",
        headings=(
            "no.",
            "rule",
            "weight",
            "branches",
            "what is wrong",
            "by how much",
            "for a waiver",
        ),
        rows=found,
    )
    tables = (
        *((findings,) if found else ()),
        *(
            (Rows(caption="Rules skipped", headings=("rule", "why"), rows=skipped),)
            if skipped
            else ()
        ),
    )
    nothing = () if found else ("No findings.",)
    return Section(
        title=title,
        paragraphs=(
            *nothing,
            *stale,
            f"Rules run, with the number of items that each checked: {ran}.",
        ),
        pictures=_marked(report, outline_mm),
        tables=tables,
        folded=True,
    )


def _marked(report: CheckReport, outline_mm: Callable[[], Floats] | None) -> tuple[Picture, ...]:
    """Return the picture of findings in the outline, if any finding has a place."""
    if outline_mm is None or not any(finding.marker_wkt for finding in report.findings):
        return ()
    return (
        Picture(
            image=lambda: page_svg(findings_plan(outline_mm(), report.findings)),
            caption="Findings at their places in the flat outline; numbers as in the table. "
            "Findings about the whole robot have no place.",
        ),
    )


def pattern_section(pattern: Pattern) -> Section:
    """Return the flat pattern that is cut and the shape that it deploys as, side by side."""
    blocks = tuple(pattern_blocks(pattern))
    made = "makes up for it: its angles and lengths are those that deploy as designed"
    if pattern.design.build.compensation == "none":
        made = "is cut as designed all the same, and deploys as another shape"
    words = (
        "Two welded sheets do not keep their flat angles when they inflate, and soft film grows "
        f"longer. The pattern {made}. The simulation knows no contact of siblings, no "
        "stiffness of film and weld, and no gravity.",
        *(one.rstrip(".") + "." for one in pattern.problems),
    )
    picture = Picture(
        image=lambda: page_svg(pattern_plan(pattern)),
        caption="The flat outline that is cut, and the shape that it deploys as: joints are "
        f"simulated one by one, tubes straight ({pattern.standing}); vinefab inflate simulates "
        "the whole robot.",
    )
    return Section(
        title="Flat and deployed",
        paragraphs=words,
        pictures=(picture,),
        # Its numbers stand in the JSON of `vinefab inflate`.
        tables=tuple(replace(one, key="") for one in blocks if isinstance(one, Rows)),
        folded=True,
    )


def pressure_section(design: Design, profile: LaserProfile) -> Section:
    """Return the pressure that each level stands, with the standing of its source."""
    film, build = profile.material, design.build
    allowed = seam_load_n_mm(film.seam)
    rows = []
    for level, width_mm in enumerate(build.widths_mm, start=1):
        strain = hoop_strain(
            build.pressure_kpa, width_mm, film.ply_mm.value, film.modulus_mpa.value
        )
        cells = (
            f"{width_mm:.2f}",
            f"{inflated_diameter_mm(width_mm):.2f}",
            f"{burst_pressure_kpa(width_mm, allowed):.1f}",
            f"{100 * strain:.0f} %",
        )
        rows.append((str(level), *cells))
    table = Rows(
        caption=f"At the working pressure of {build.pressure_kpa:g} kPa; what seams stand rests on "
        f"one test: {film.seam.words()}. Strain rests on a modulus of "
        f"{film.modulus_mpa.value:g} MPa ({film.modulus_mpa.standing})",
        headings=(
            "level",
            "lay-flat mm",
            "inflated mm",
            "seam stands kPa",
            "hoop strain",
        ),
        rows=tuple(rows),
    )
    return Section(title="Pressure", tables=(table,), folded=True)


def pieces_section(
    design: Design,
    partition: Partition,
    outlines: Mapping[str, Contour],
    profile: LaserProfile,
    *,
    sheets: Mapping[str, Sequence[int]],
) -> Section:
    """Return the pieces of a robot and its joints, with the exploded view.

    Parameters
    ----------
    outlines
        Outline of every piece, by its label, in the coordinates of the whole robot's flat layout.
    sheets
        Numbers of the sheets that hold each piece, by its label; several for several robots.
    """
    picture = Picture(
        image=lambda: page_svg(exploded_picture(design, partition, outlines, profile)),
        caption="The pieces apart, each as it lies in the robot; numbers give the order of joining "
        "(computed). The package has it as assembly.svg and assembly.pdf, with the robot put "
        "together and one lap.",
    )
    least = "No fewer are possible" if partition.proven_least else "Fewer may be possible"
    minutes = MINUTES_PER_JOINT * len(partition.sleeves)
    rows = tuple(
        (
            str(step.number),
            step.sleeve.label,
            step.branch,
            f"{step.sleeve.plug_on} into {step.sleeve.socket_on}",
            f"{step.sleeve.width_mm:.2f}",
            f"{step.sleeve.lap_mm:g}",
            f"{step.sleeve.outer_from_mm:.1f}",
        )
        for step in joining_order(design, partition)
    )
    return Section(
        title="Pieces",
        paragraphs=(
            f"{pieces_words(partition)}. {least}. Joining takes about {minutes:g} minutes"
            f" ({MINUTES_PER_JOINT:g} a joint, assumed). {order_reasons(profile)}",
        ),
        pictures=(picture,),
        tables=(
            _piece_table(design, partition, outlines, sheets),
            Rows(
                caption="Joints, in the order of joining (widths and places computed, depth "
                "assumed)",
                headings=(
                    "step",
                    "joint",
                    "branch",
                    "plug into socket",
                    "lay-flat width, mm",
                    "depth, mm",
                    "lap begins at, mm",
                ),
                rows=rows,
                folded=True,
            ),
        ),
    )


MOST_BRANCHES_NAMED = 12
"""Branches of a piece that a table names; of more it gives the number."""


def _piece_table(
    design: Design,
    partition: Partition,
    outlines: Mapping[str, Contour],
    sheets: Mapping[str, Sequence[int]],
) -> Rows:
    ids = branch_tree(design).ids
    rows = []
    for piece in partition.pieces:
        names = ", ".join(ids[branch] for branch in piece.branches[:MOST_BRANCHES_NAMED])
        more = len(piece.branches) - MOST_BRANCHES_NAMED
        long_mm, wide_mm = least_rectangle_mm(outlines[piece.label])
        rows.append(
            (
                piece.label,
                f"{names} and {more} more" if more > 0 else names,
                str(len(piece.branches)),
                ", ".join(map(str, sheets[piece.label])),
                f"{long_mm:.0f} x {wide_mm:.0f}",
            )
        )
    return Rows(
        caption="Pieces; the size is that of the least rectangle around the outline (computed)",
        headings=("piece", "branches that end on it", "number", "sheet", "size, mm"),
        rows=tuple(rows),
        folded=True,
    )


def least_rectangle_mm(contour: Contour) -> tuple[float, float]:
    """Return the longer and the shorter side of the least rectangle around a contour, turned."""
    points = contour.flattened_mm(0.05)
    x0, y0, x1, y1 = contour.box_mm
    rectangle = shapely.minimum_rotated_rectangle(shapely.MultiPoint(points))
    corners = shapely.get_coordinates(rectangle)
    if len(corners) != 5:  # all on one line
        return max(x1 - x0, y1 - y0), min(x1 - x0, y1 - y0)
    one, two = np.hypot(*np.diff(corners[:3], axis=0).T).tolist()
    return max(one, two), min(one, two)


def bom_section(lines: Sequence[BomLine], robots: int = 1) -> Section:
    """Return the bill of materials of a sheet with so many robots."""
    rows = tuple(
        (line.item, f"{line.value:.4g}", line.unit, line.standing.value, line.basis)
        for line in lines
    )
    headings = ("item", "amount", "unit", "standing", "basis")
    caption = "One robot" if robots == 1 else f"The whole sheet: {counted(robots, 'robot')}"
    table = Rows(caption=caption, headings=headings, rows=rows)
    return Section(title="Bill of materials", tables=(table,), folded=True)


def assumption_section(
    profile: LaserProfile, models: Sequence[tuple[str, Quantity]] = ()
) -> Section:
    """Return every number behind the report with its standing, the least trusted first."""
    order = [Standing.ASSUMED, Standing.PUBLISHED, Standing.PAPER, Standing.COMPUTED]
    rank = {standing: place for place, standing in enumerate(order)}
    numbers = sorted(
        [*models, *_numbers(profile)], key=lambda row: rank.get(row[1].standing, len(order))
    )
    rows = tuple(
        (name, number.words(), number.standing.value, number.source) for name, number in numbers
    )
    table = Rows(
        caption=f"Recipe {profile.recipe.name}, status {profile.recipe.status.value}",
        headings=("number", "value", "standing", "source"),
        rows=rows,
    )
    return Section(
        title="What this rests on",
        paragraphs=(
            "Assumed numbers are placeholders: measure them with the coupons on your own machine "
            "and film before you trust anything that rests on them. Standings: measured, by you; "
            "paper, in the paper that the robots come from; published, elsewhere; computed, from "
            "such numbers; assumed, by vinefab. Predictions are simulated.",
        ),
        tables=(table,),
        folded=True,
    )


def _numbers(profile: LaserProfile) -> Iterator[tuple[str, Quantity]]:
    owned: list[tuple[str, Machine | Material | OperationSettings]] = [
        ("machine", profile.machine),
        ("material", profile.material),
        *profile.recipe.by_operation.items(),
    ]
    for owner, noun in owned:
        for name, value in quantities(noun).items():
            if value is not NO_SHRINKAGE:
                yield f"{owner}.{name}", value


def _finding_row(finding: Finding) -> tuple[str, ...]:
    weight = f"waived: {finding.reason}" if finding.waived else finding.severity.value
    return (
        finding.rule,
        weight,
        ", ".join(finding.branches),
        f"{finding.title}: {finding.message}" if finding.title else finding.message,
        finding.measures,
        finding.fingerprint,
    )


def _value(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    if isinstance(value, list | tuple):
        return ", ".join(_value(part) for part in value)
    return str(value)
