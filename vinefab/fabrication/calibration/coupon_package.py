"""The coupon folder of a recipe: laser files, checks, pictures, instructions, table of results."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vinefab.core.atomic import ensure_unchanged
from vinefab.core.jsontext import GENERATOR, json_text
from vinefab.fabrication.calibration.coupon_results import results_text
from vinefab.fabrication.calibration.coupons import (
    LAP_MM,
    SQUARE_MM,
    Coupon,
    Matrix,
    coupon_pieces,
    coupon_sheets,
    energy_matrix,
)
from vinefab.fabrication.formats.dxf_format import DXF_POLYLINE
from vinefab.fabrication.formats.laser_drawing import DEFAULT, LaserFileSpec
from vinefab.fabrication.formats.laser_formats import LaserFiles, ensure_read_back, laser_files
from vinefab.fabrication.outline.body_outline import WHOLE_ROBOT, body_outline
from vinefab.fabrication.package.prepare import package_spec
from vinefab.fabrication.package.readme_text import readme_section
from vinefab.fabrication.package.sheet_pictures import job_plan
from vinefab.fabrication.rules.run_rules import checks_text, run_checks
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.finding import CheckReport, RuleRun
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LapBond, LapMethod, LaserProfile
from vinefab.pages.figure import png_bytes


def coupon_readme(profile: LaserProfile, jobs: Sequence[Job], matrix: Matrix | None) -> str:
    """Return what to cut, in which order, and what to measure on each piece."""
    title = f"Coupons for recipe {profile.recipe.name}"
    parts = [f"{title}\n{'=' * len(title)}", readme_section("1. Cut", _cutting(jobs, matrix))]
    parts.append(readme_section("2. Measure", _measuring(profile)))
    parts.append(readme_section("3. Give the results back", _giving_back(profile)))
    parts.append(GENERATOR)
    return "\n\n".join(parts) + "\n"


def _cutting(jobs: Sequence[Job], matrix: Matrix | None) -> list[str]:
    steps = ["Prepare the film as for a robot: clean, laminated flat, without bubbles."]
    if matrix is not None and matrix.jobs:
        energies = ", ".join(f"{energy:.1f}" for energy in matrix.energies_mj_mm)
        names = ", ".join(job.name for job in matrix.jobs)
        steps.append(
            f"First the energy matrix: {names}. Each file is for one focus offset (its name says"
            f" it, in mm): set the lens by hand. Every line has a layer of its own with the speed"
            f" for its energy: {energies} mJ/mm. The .lbrn2 files have these settings inside."
        )
        steps.append("Judge each line between its ticks only, where the head runs at full speed.")
    if matrix is not None and matrix.out_of_reach_mj_mm:
        lost = ", ".join(f"{energy:.1f}" for energy in matrix.out_of_reach_mj_mm)
        steps.append(
            f"Not drawn, because this machine cannot give so little on so short a line: {lost}"
            " mJ/mm."
        )
    sheets = ", ".join(job.name for job in jobs)
    steps.append(f"Then {sheets}, with the recipe's settings, exactly as a robot is cut.")
    return steps


def _measuring(profile: LaserProfile) -> list[str]:
    steps = [
        f"KERF: side of the piece that fell out of the {SQUARE_MM:g} mm square, to 0.02 mm, mean of"
        " both directions.",
    ]
    if Operation.WELDCUT in profile.recipe.by_operation:
        steps.append(
            "Seam: width of the fused rim inward of the cut edge, under a loupe, at 3"
            " places of a straight."
        )
    steps += [
        "W5 to W40: lay-flat width of the open lumen, between the seams, in the middle of the"
        " finger.",
        "L40 to L280: length of the finger, flat, along its middle, from the cut of its mouth to"
        " the outer edge of its tip, to 0.2 mm: all in the same way. They say by how much film"
        " shrinks where it is welded.",
        "BURST: blunt needle through the port, clamp it, raise the pressure slowly behind a shield;"
        " write down the pressure at which it bursts and where. Three balloons at least: one alone"
        " says nothing of the spread.",
        *_lap_steps(profile.recipe.lap),
        "PEEL: pull the two free plies apart, 90 degrees each; the largest force.",
        "CROTCH: inflate until it fails; the fillet that fails last is the one to use.",
        "friction_incline: a strip of film on the obstacle's material; tilt until it slides.",
        "growth: one tube of one width, more than 2 m long, stored as your robots are, grown along"
        " a course of straight pieces and a turn around a post; the pressure at which it just grows"
        " at the course's end. Setting: lengths in mm and turns in degrees, in turn, base first:"
        " 50 270 950.",
        "growth_free: the same once the end of the film has left the store, so that nothing holds"
        " it back: setting is the path from there to the tip that film still lies along. 50: a"
        " straight tube all but grown, 50 mm of film still inside. 900 270 100: a tube of 2 m on a"
        " course of 900, 270 and 100.",
        "Pack the tube again for every reading. Stay below two thirds of what it bursts at: a cell"
        " may stay empty. What the readings do not say, calibrate takes from the published tube.",
    ]
    return steps


def _lap_steps(bond: LapBond | None) -> list[str]:
    if bond is None:
        how = "as you bond sleeves (the recipe has no [lap]: name it as setting of lap_band)"
    elif bond.method is LapMethod.IMPULSE_SEAL:
        band = f"a band of {bond.band_mm.value:g} mm ({bond.band_mm.standing})"
        how = f"with {band}, impulse-sealed around the lap over a release strip inside the plug"
    else:
        how = f"with adhesive film, {bond.band_mm.value:g} mm ({bond.band_mm.standing}) all around"
    return [
        f"LAP, joining: the open end of B, the plug, goes into the widened end of A, {LAP_MM:g} mm"
        f" deep: carry the ticks beside B over to the plug before you lift it out."
        f" Bond {how}; write the width of the band down (lap_band). The side seams of A and B lie"
        f" on each other, as on a robot: seal their corners with care, there it leaks first.",
        "LAP, turning: push the closed end of B with a blunt rod through A and out of its open end,"
        " until the whole tube is inside out. So does a robot that is mounted as cut when it grows;"
        ' one with mounting = "turned" grows as it was sealed: for that, leave this step out.',
        "LAP, bursting: close A's open end around an air tube and go on as with BURST. If the lap"
        " opened or leaked, write the pressure"
        " down as lap_burst; if anything else gave way, or nothing, as lap_survived: such a lap"
        " bears more, nobody knows how much. One of the two rows of each coupon stays empty.",
    ]


def _giving_back(profile: LaserProfile) -> list[str]:
    name = profile.recipe.name
    return [
        "Fill in the column value of results.csv. Units: mm, cm, um, in; kPa, Pa, MPa, bar, mbar,"
        " psi; N, gf, kgf; deg, rad.",
        f"vinefab calibrate --recipe {name} results.csv --out {name}_mine.toml",
        "The result is a recipe: kerf and seam are measured then, and fabricate takes it without"
        " --allow-uncalibrated.",
    ]


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
class Coupons:
    """The coupons of a recipe, checked, with their laser files."""

    profile: LaserProfile
    sheets: tuple[Job, ...]  # all pieces but the energy matrix
    matrix: Matrix | None  # None where the laser makes no seam
    report: CheckReport  # of pieces and sheets
    laser: Mapping[str, bytes]  # laser files by name, read back without a problem

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Every job, sheets first."""
        return (*self.sheets, *(self.matrix.jobs if self.matrix else ()))


def make_coupons(profile: LaserProfile) -> Coupons:
    """Make the coupons for a recipe, laser files written in memory and read back.

    Raises
    ------
    BadInputError
        If a coupon is larger than the machine's bed.
    ReadBackError
        If a laser file, read back, differs from its job.
    """
    pieces = coupon_pieces(profile)
    sheets = coupon_sheets(pieces, profile)
    matrix = _matrix(profile)
    specs = [package_spec(sheet, profile) for sheet in sheets]
    specs += [
        replace(package_spec(job, profile), colours=DEFAULT)
        for job in (matrix.jobs if matrix else ())
    ]
    laser: dict[str, bytes] = {}
    problems: dict[str, tuple[str, ...]] = {}
    for spec in specs:
        written = _written(spec)
        laser |= written.files
        problems |= written.problems
    ensure_read_back(problems)
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
        COUPON_MARK: _settings_text(coupons).encode(),
        **coupons.laser,
        **pictures,
        "checks.json": checks_text(coupons.report).encode(),
        RESULTS_NAME: results_text(profile, matrix).encode(),
    }


def _matrix(profile: LaserProfile) -> Matrix | None:
    operations = profile.recipe.by_operation.items()
    if not any(settings.by_laser for name, settings in operations if name.startswith("weld")):
        return None
    return energy_matrix(profile)


def _written(spec: LaserFileSpec) -> LaserFiles:
    """Return a job's laser files under its own name, read back."""
    written = laser_files(spec, stem=spec.job.name)
    if any(path.contour.arc_count for path in spec.job.paths):
        return written
    same = DXF_POLYLINE.file_name(spec.job.name)  # without arcs the same drawing as the DXF
    return LaserFiles(
        files={name: data for name, data in written.files.items() if name != same},
        problems={name: found for name, found in written.problems.items() if name != same},
    )


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
        if piece.ends is WHOLE_ROBOT:
            subjects.append(Subject.of(piece.design, profile))
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


def _settings_text(coupons: Coupons) -> str:
    matrix = coupons.matrix
    return json_text(
        _SCHEMA,
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


def ensure_results_not_filled_in(path: Path, *, force: bool = False) -> None:
    """Check that nobody filled in the results in a folder of coupons."""
    ensure_unchanged(path / RESULTS_NAME, force=force)
