"""The coupon folder of a recipe: laser files, checks, pictures, instructions, table of results."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from vinefab.core.plain_text import json_text
from vinefab.fabrication.calibration.coupons import (
    JOINT_KPA,
    JOINT_ROW_MM,
    LAP_MM,
    SLACK_KPA,
    SQUARE_MM,
    Coupon,
    Matrix,
    coupon_pieces,
    coupon_sheets,
    cutting_operations,
    energy_matrix,
    joint_pieces,
    joint_tables,
    results_text,
    that_fit,
)
from vinefab.fabrication.calibration.seal_grid import SealGrid, seal_grid
from vinefab.fabrication.formats.dxf_format import DXF_POLYLINE
from vinefab.fabrication.formats.laser_drawing import DEFAULT, package_spec
from vinefab.fabrication.formats.laser_formats import (
    ensure_read_back,
    formats_for,
    laser_files,
    planned_files,
    requested_formats,
)
from vinefab.fabrication.job.bar_strokes import bar_strokes, seams_name, seams_text
from vinefab.fabrication.job.passes import sealed_by_hand
from vinefab.fabrication.package.package_texts import filled_document, tool_template
from vinefab.fabrication.package.sheet_pictures import job_plan
from vinefab.fabrication.rules.catalog import checks_text, run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.finding import CheckReport, RuleRun
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile
from vinefab.outline.body_outline import body_outline
from vinefab.pages.page_files import page_png

_SCHEMA = "vinefab/coupon-1"
COUPON_MARK = "coupon.json"
"""The file by which a folder of coupons is recognized."""

RESULTS_NAME = "results.csv"

SHAPE_RULES = ("VF-T01", "VF-T02", "VF-T03", "VF-T04", "VF-W04", "VF-C03", "VF-C05")
"""Rules for each coupon that is a robot."""

PART_RULES = ("VF-T01", "VF-T02", "VF-T04")
"""Rules for each part of a coupon that is joined by a sleeve."""

PATH_RULES = ("VF-L01", "VF-L02", "VF-L03", "VF-X01")
"""Rules for every sheet; those about length, tail and bed do not apply to coupons."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CouponSet:
    """The coupons of a recipe, checked, with their laser files."""

    profile: LaserProfile
    sheets: tuple[Job, ...]  # all pieces but the energy matrix
    matrix: Matrix | None  # None where the laser makes no seam
    grid: SealGrid | None  # None where no hot tip makes the seam
    left_out: tuple[str, ...]  # pieces that are larger than the bed
    report: CheckReport  # of pieces and sheets
    laser: Mapping[str, bytes]  # laser files by name, read back without a problem

    @property
    def seam_lists(self) -> dict[str, bytes]:
        """What a straight bar does of each sheet's seams, by file name."""
        lists = {job.name: bar_strokes(job, self.profile) for job in self.sheets}
        return {seams_name(name): seams_text(one).encode() for name, one in lists.items() if one}

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Every job, sheets first."""
        grid = (self.grid.job,) if self.grid else ()
        return (*self.sheets, *(self.matrix.jobs if self.matrix else ()), *grid)


def coupon_readme(coupons: CouponSet) -> str:
    """Return the pieces to cut, their order, and the measurements to take on each piece."""
    profile = coupons.profile
    return filled_document(
        "COUPONS.txt.j2",
        recipe=profile.recipe,
        machine=profile.machine,
        sealing_template=tool_template(profile.settings(profile.recipe.seals).tool),
        by_hand=sealed_by_hand(profile),
        kerfs=cutting_operations(profile),
        can_mark=Operation.MARK in profile.recipe.by_operation,
        lap=profile.recipe.lap,
        jobs=coupons.sheets,
        matrix=coupons.matrix,
        grid=coupons.grid,
        left_out=coupons.left_out,
        patterns=[name for name in coupons.laser if name.endswith(".pdf")],
        seam_lists=list(coupons.seam_lists),
        with_settings=[one.suffix for one in formats_for(profile).values() if one.needs_profile],
        energies=lambda values: ", ".join(f"{energy:.1f}" for energy in values),
        square_mm=SQUARE_MM,
        lap_mm=LAP_MM,
        joint_kpa=JOINT_KPA,
        slack_kpa=SLACK_KPA,
    )


def make_coupons(profile: LaserProfile) -> CouponSet:
    """Make the coupons for a recipe, laser files written in memory and read back.

    Raises
    ------
    BadInputError
        If a coupon is larger than the machine's bed.
    ReadBackError
        If a laser file, read back, differs from its job.
    """
    pieces, large = that_fit(coupon_pieces(profile), profile)
    joints, larger = that_fit(joint_pieces(profile), profile)
    sheets = coupon_sheets(pieces, profile)
    sheets += coupon_sheets(joints, profile, "joints", JOINT_ROW_MM)
    makes_seams = any(name.startswith("weld") for name, *_ in profile.beams)
    matrix = energy_matrix(profile) if makes_seams else None
    lines, grid = matrix.jobs if matrix else (), seal_grid(profile)
    laser: dict[str, bytes] = {}
    problems: dict[str, tuple[str, ...]] = {}
    for job in (*sheets, *lines, *((grid.job,) if grid else ())):
        spec = package_spec(job, profile)
        if job in lines:
            spec = replace(spec, colours=DEFAULT)
        # Without arcs the drawing of chords is the same as the DXF.
        is_straight = not any(path.contour.arc_count for path in spec.job.paths)
        without = (DXF_POLYLINE,) if is_straight else ()
        written = laser_files(
            spec,
            stem=job.name,
            requested=requested_formats(profile),
            without=without,
            each_operation=job not in lines,
        )
        laser |= written.files
        problems |= written.problems
    ensure_read_back(problems)
    report = _checked((*pieces, *joints), sheets, profile, problems)
    return CouponSet(
        profile=profile,
        sheets=sheets,
        matrix=matrix,
        grid=grid,
        left_out=(*large, *larger),
        report=report,
        laser=laser,
    )


def coupon_files(coupons: CouponSet) -> dict[str, bytes]:
    """Return every file of the coupon folder, by name."""
    profile, matrix, grid = coupons.profile, coupons.matrix, coupons.grid
    can_mark = Operation.MARK in profile.recipe.by_operation
    pictures = {
        f"{job.name}.png": page_png(job_plan(job, coupons.report.findings, named=not can_mark))
        for job in coupons.jobs
    }
    settings = {
        "recipe": profile.recipe.name,
        "jobs": [
            {
                "name": job.name,
                "files": [
                    one.name
                    for one in planned_files(
                        package_spec(job, profile),
                        stem=job.name,
                        requested=requested_formats(profile),
                    )
                    if one.name in coupons.laser
                ],
                "paths": len(job.paths),
                "facts": dict(job.facts),
            }
            for job in coupons.jobs
        ],
        "left_out": list(coupons.left_out),
        "grid": list(grid.settings) if grid else [],
        "energies_mj_mm": list(matrix.energies_mj_mm) if matrix else [],
        "energies_out_of_reach_mj_mm": list(matrix.out_of_reach_mj_mm) if matrix else [],
    }
    return {
        "README.txt": coupon_readme(coupons).encode(),
        COUPON_MARK: json_text(_SCHEMA, settings).encode(),
        **coupons.laser,
        **coupons.seam_lists,
        **pictures,
        "checks.json": checks_text(coupons.report).encode(),
        RESULTS_NAME: results_text(profile, matrix, grid.settings if grid else ()).encode(),
        **{f"{name}.geojson": table.json_text().encode() for name, table in joint_tables().items()},
    }


def _checked(
    pieces: Sequence[Coupon],
    sheets: Sequence[Job],
    profile: LaserProfile,
    problems: Mapping[str, tuple[str, ...]],
) -> CheckReport:
    subjects, reports = [], []
    for piece in pieces:
        if piece.design is None:
            continue
        if piece.job is not None:
            subjects.append(Subject.on_sheet(piece.design, profile, piece.job))
            reports.append(run_checks(subjects[-1], only=SHAPE_RULES))
        else:
            outline = body_outline(piece.design, ends=piece.ends)
            part = replace(Subject.of(piece.design), outline=outline)
            reports.append(run_checks(part, only=PART_RULES))
    reports += [
        run_checks(replace(subjects[0], job=sheet, readback=problems), only=PATH_RULES)
        for sheet in sheets
    ]
    run: dict[str, RuleRun] = {}
    for one in (one for report in reports for one in report.run):
        before = run.get(one.rule, RuleRun(rule=one.rule, checked=0, findings=0))
        checked, found = before.checked + one.checked, before.findings + one.findings
        run[one.rule] = replace(one, checked=checked, findings=found)
    skipped = {skip.rule: skip for report in reports for skip in report.skipped}
    findings = [
        replace(finding, message=f"{report.design}: {finding.message}")
        for report in reports
        for finding in report.findings
    ]
    return CheckReport(
        design="coupons",
        recipe=profile.recipe.name,
        run=tuple(run.values()),
        skipped=tuple(skipped.values()),
        findings=tuple(findings),
        stale_waivers=(),
    )
