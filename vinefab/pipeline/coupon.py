"""The coupons of a recipe: laser files, checks, a picture, instructions and a table to fill in."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from vinefab.checks.run import run_checks
from vinefab.checks.subject import Subject
from vinefab.core.jsontext import json_text
from vinefab.export.checks_json import checks_text
from vinefab.export.colours import DEFAULT, PRESETS, Colours
from vinefab.export.coupon_text import coupon_readme, results_text
from vinefab.export.laser_files import (
    LIBRARY_NAME,
    POLYLINE_NAME,
    laser_file_problems,
    laser_files,
)
from vinefab.export.package import ensure_right
from vinefab.geometry.coupon import Piece, coupon_pieces
from vinefab.geometry.coupon_matrix import Matrix, energy_matrix
from vinefab.geometry.coupon_sheet import coupon_sheets
from vinefab.model.finding import CheckReport, RuleRun
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile
from vinefab.report.figure import png_bytes
from vinefab.report.sheet_plan import job_plan

SCHEMA = "vinefab/coupon-1"
RESULTS_NAME = "results.csv"

SHAPE_RULES = ("VF-T01", "VF-T02", "VF-T03", "VF-T04", "VF-W04", "VF-C03", "VF-C05")
"""Rules that each coupon that is a robot must keep."""

PATH_RULES = ("VF-L01", "VF-L02", "VF-L03", "VF-X01")
"""Rules that every sheet must keep. Length, tail and bed are not a coupon's business."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coupons:
    """The coupons of a recipe, checked, with their laser files.

    Parameters
    ----------
    profile
        Machine, material and recipe.
    sheets
        Jobs with all pieces but the energy matrix.
    matrix
        The energy matrix, or None where the laser makes no seam.
    report
        What the rules say of pieces and sheets.
    laser
        Laser files by name, read again and found right.
    """

    profile: LaserProfile
    sheets: tuple[Job, ...]
    matrix: Matrix | None
    report: CheckReport
    laser: Mapping[str, bytes]

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Every job, sheets first."""
        return (*self.sheets, *(self.matrix.jobs if self.matrix else ()))


def make_coupons(profile: LaserProfile) -> Coupons:
    """Return the coupons for a recipe, laser files written in memory and read again.

    Raises
    ------
        If the recipe makes no seam or a piece is larger than the bed.
    ReadBackError
        If a laser file, read again, is not what its job says.
    """
    pieces = coupon_pieces(profile)
    sheets = coupon_sheets(pieces, profile)
    matrix = _matrix(profile)
    colours = PRESETS[profile.machine.colours]
    laser: dict[str, bytes] = {}
    problems: dict[str, tuple[str, ...]] = {}
    for job, preset in [
        *((job, colours) for job in sheets),
        *((job, DEFAULT) for job in (matrix.jobs if matrix else ())),
    ]:
        files, found = _written(job, preset, profile)
        laser |= files
        problems |= found
    ensure_right(problems)
    report = _checked(pieces, sheets, profile, problems)
    return Coupons(profile=profile, sheets=sheets, matrix=matrix, report=report, laser=laser)


def coupon_files(coupons: Coupons) -> dict[str, bytes]:
    """Return every file of the coupon folder, by name."""
    profile, matrix = coupons.profile, coupons.matrix
    pictures = {
        f"{job.name}.png": png_bytes(job_plan(job, coupons.report.findings)) for job in coupons.jobs
    }
    return {
        "README.txt": coupon_readme(profile, coupons.sheets, matrix).encode(),
        "coupon.json": _settings_text(coupons).encode(),
        **coupons.laser,
        **pictures,
        "checks.json": checks_text(coupons.report).encode(),
        RESULTS_NAME: results_text(profile, matrix).encode(),
    }


def _matrix(profile: LaserProfile) -> Matrix | None:
    if not any(s.by_laser for op, s in profile.recipe.operations.items() if op.startswith("weld")):
        return None
    return energy_matrix(profile)


def _written(
    job: Job, colours: Colours, profile: LaserProfile
) -> tuple[dict[str, bytes], dict[str, tuple[str, ...]]]:
    """Return a job's laser files under its own name, and what was wrong with each."""
    hairline_mm = profile.machine.hairline_mm
    files = laser_files(job, colours, hairline_mm=hairline_mm, profile=profile)
    problems = laser_file_problems(files, job, colours, profile)
    if not any(path.contour.arc_count for path in job.paths):
        del files[POLYLINE_NAME], problems[POLYLINE_NAME]  # the same drawing once more
    named = {name: _named(name, job) for name in files}
    return (
        {named[name]: data for name, data in files.items()},
        {named[name]: found for name, found in problems.items()},
    )


def _named(name: str, job: Job) -> str:
    return name if name == LIBRARY_NAME else name.replace("outline", job.name, 1)


def _checked(
    pieces: Sequence[Piece],
    sheets: Sequence[Job],
    profile: LaserProfile,
    problems: Mapping[str, tuple[str, ...]],
) -> CheckReport:
    subjects = [Subject.of(piece.design, profile) for piece in pieces if piece.design is not None]
    reports = [run_checks(subject, only=SHAPE_RULES) for subject in subjects]
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


def _settings_text(coupons: Coupons) -> str:
    matrix = coupons.matrix
    return json_text(
        SCHEMA,
        {
            "recipe": coupons.profile.recipe.name,
            "jobs": [
                {"name": job.name, "paths": len(job.paths), "facts": dict(job.facts)}
                for job in coupons.jobs
            ],
            "energies_mj_mm": list(matrix.energies_mj_mm) if matrix else [],
            "energies_out_of_reach_mj_mm": list(matrix.out_of_reach_mj_mm) if matrix else [],
        },
    )
