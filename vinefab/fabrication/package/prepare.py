"""From a design to its fabrication package: job, checks, laser files read back, folder and zip."""

import io
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import shapely

from vinefab.core.hashing import MANIFEST_NAME, ROOMY_GENERATOR, manifest_text, sha256_of
from vinefab.core.plain_text import counted, some_of
from vinefab.core.progress import each, phase
from vinefab.core.validation import Floats
from vinefab.core.view import Answer, Block, Fact, Facts, Notes, Picture, Rows, Section, Text, Tone
from vinefab.fabrication.formats.laser_drawing import package_spec
from vinefab.fabrication.formats.laser_formats import (
    AUTO,
    LASER_FORMATS,
    drawn_jobs,
    ensure_read_back,
    laser_files,
    requested_formats,
)
from vinefab.fabrication.job.bar_strokes import bar_strokes, seams_name, seams_text
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import ONE, SheetOptions
from vinefab.fabrication.package.assembly_drawing import assembly_files, exploded_picture
from vinefab.fabrication.package.bom import (
    BomLine,
    bill_of_materials,
    bom_text,
    joint_lines,
    robot_count,
)
from vinefab.fabrication.package.folding import (
    FoldedTube,
    fold_files,
    fold_section,
    folded_tube,
)
from vinefab.fabrication.package.package_texts import job_text, readme_text
from vinefab.fabrication.package.piece_joining import (
    MINUTES_PER_JOINT,
    joining_order,
    order_reasons,
    pieces_words,
)
from vinefab.fabrication.package.press_mask import mask_files
from vinefab.fabrication.package.sheet_pictures import (
    findings_plan,
    job_animation,
    job_plan,
    pattern_plan,
)
from vinefab.fabrication.pieces.exploded import piece_lumens
from vinefab.fabrication.pieces.partition import in_pieces, pieces_of
from vinefab.fabrication.processes import WORDS, ProcessWords
from vinefab.fabrication.rules.as_built import check_readback
from vinefab.fabrication.rules.catalog import (
    RULES,
    checks_text,
    concerns,
    merged_reports,
    rules_on,
    run_checks,
)
from vinefab.fabrication.rules.rule import Scope, Subject
from vinefab.inflation.pattern import Pattern, pattern_blocks, pattern_of
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design, design_text
from vinefab.model.finding import CheckReport, Finding, RuleSkipped, Severity
from vinefab.model.job import Job
from vinefab.model.laser import NO_SHRINKAGE, LaserProfile, RecipeStatus
from vinefab.model.outline import Contour
from vinefab.model.quantity import Quantity, Standing, quantities
from vinefab.model.tree import Partition
from vinefab.outline.body_outline import body_outline
from vinefab.pages.html import page
from vinefab.pages.page_files import page_png, page_svg
from vinefab.physics.tube import (
    burst_pressure_kpa,
    hoop_strain,
    inflated_diameter_mm,
    seam_load_n_mm,
)

ANIMATION_NAME = "animation.svg"

PACKAGE_MARK = "job.json"
"""The file by which the folder of a package is recognized."""

_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
_PLAIN_FILE = 0o100644 << 16


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """A design with its job and a full check, laser files read back included."""

    design: Design
    profile: LaserProfile
    job: Job
    report: CheckReport
    # laser files by name; empty when a rule forbids the design
    laser: Mapping[str, bytes] = field(default_factory=dict)
    requested: tuple[str, ...] = ()  # formats that are written on request
    # problems that reading them back found, by file name
    readback: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    others: tuple[Design, ...] = ()  # the other designs on the sheet
    beside: tuple[CheckReport, ...] = ()  # reports of these
    partition: Partition | None = None  # the pieces that it is cut in; None for one flat outline
    patterns: Mapping[str, Pattern]  # how each design on the sheet deploys, by name

    @property
    def pattern(self) -> Pattern:
        """How the design deploys."""
        return self.patterns[self.design.name]

    @property
    def folded(self) -> FoldedTube | str:
        """The lay-flat tube that folds into the design, or why there is none."""
        return folded_tube(self.pattern)

    @property
    def paper(self) -> str:
        """The paper that drawings at true scale are for."""
        papers = (one.paper for name, one in LASER_FORMATS.items() if name in self.requested)
        return next(filter(None, papers), "a4")

    @property
    def cut(self) -> Design:
        """The flat tree that is cut."""
        return self.pattern.flat

    def refusal(self, *, allow_uncalibrated: bool) -> str:
        """Return the reason that no files may be written, or an empty string."""
        blocking = [f for report in (self.report, *self.beside) for f in report.blocking]
        if blocking:
            broken = ", ".join(sorted({finding.rule for finding in blocking}))
            return f"{broken} forbid it: fix the design, or waive them in it with a reason"
        recipe = self.profile.recipe
        if self.profile.status is RecipeStatus.UNVERIFIED and not allow_uncalibrated:
            return (
                f"recipe {recipe.name} is not confirmed by coupons; --allow-uncalibrated writes "
                "the files anyway, for coupons and first trials"
            )
        return ""


def prepare(
    design: Design,
    profile: LaserProfile,
    deployments: Collection[Deployment] = (),
    *,
    sheet: SheetOptions = ONE,
    r12: bool = False,
    paper: str = AUTO,
) -> Prepared:
    """Return a design's job and the report of every rule.

    When no rule forbids the design, the laser files are written in memory and read back, and the
    rule about the read-back is applied too.

    Parameters
    ----------
    deployments
        Simulated deployments, for rules that need them.
    sheet
        Number of copies, other designs on the sheet, process.
    r12
        Whether to write a DXF of release 12 as well.
    paper
        Of the pattern at 1:1, as of `requested_formats`.

    Raises
    ------
    BadInputError
        If the sheet cannot hold the designs, or the recipe lacks an operation.
    UnknownNameError
        If there is no such paper.
    """
    separate, requested = sheet.separate, requested_formats(profile, paper=paper, r12=r12)
    named = {one.name: one for one in (*sheet.beside, design)}
    patterns = {name: pattern_of(one, profile) for name, one in named.items()}
    pattern = patterns[design.name]
    cut = pattern.flat
    flat_sheet = replace(sheet, beside=tuple(patterns[one.name].flat for one in sheet.beside))
    with phase("flat pieces"):
        partition = pieces_of(pattern, profile, separate=separate)
    with phase("paths on the sheet"):
        job = laser_job(cut, profile, flat_sheet, partition)
    flat = Subject.on_sheet(cut, profile, job, separate=separate)
    flat = replace(flat, pattern=pattern, deployments=deployments)
    subject = in_pieces(flat, partition)
    report = run_checks(subject)
    others = tuple(other for name, other in named.items() if name != design.name)
    beside = tuple(
        _beside(patterns[other.name].flat, profile, job, separate=separate) for other in others
    )
    files: dict[str, bytes] = {}
    problems: dict[str, tuple[str, ...]] = {}
    if not any(one.blocking for one in (report, *beside)):
        drawn = drawn_jobs(job)
        for stem in each("laser files written and read back", drawn):
            spec = package_spec(drawn[stem], profile)
            written = laser_files(spec, stem=stem, requested=requested)
            files |= written.files
            problems |= written.problems
        reread = run_checks(replace(subject, readback=problems), only=(check_readback.id,))
        report = merged_reports(report, reread)
    return Prepared(
        design=design,
        profile=profile,
        job=job,
        report=report,
        laser=files,
        readback=problems,
        requested=requested,
        others=others,
        beside=beside,
        partition=partition if len(partition.pieces) > 1 else None,
        patterns=patterns,
    )


def _beside(cut: Design, profile: LaserProfile, job: Job, *, separate: bool) -> CheckReport:
    """Return the report on another robot of a sheet, measured in the sheet's own paths.

    Rules about the sheet as a whole are applied with the first robot only.
    """
    subject = Subject.on_sheet(cut, profile, job, separate=separate)
    report = run_checks(subject, only=RULES.keys() - rules_on(Scope.SHEET))
    reason = f"checked once for the whole sheet, with {job.name}"
    rules = [rule for rule in sorted(rules_on(Scope.SHEET)) if concerns(rule, cut)]
    skipped = tuple(RuleSkipped(rule=rule, reason=reason) for rule in rules)
    once = replace(report, run=(), skipped=skipped, findings=())
    return replace(merged_reports(report, once), stale_waivers=())


def package(prepared: Prepared) -> dict[str, bytes]:
    """Return every file of the fabrication package, by name; a forbidden design has no laser files.

    Raises
    ------
    ReadBackError
        If a laser file, read back, differs from the job.
    """
    ensure_read_back(prepared.readback)
    design, profile, job = prepared.design, prepared.profile, prepared.job
    spec, requested = package_spec(job, profile), prepared.requested
    pattern, partition, cut = prepared.pattern, prepared.partition, prepared.cut
    tube = prepared.folded
    joints, outlines = tuple[BomLine, ...](), dict[str, Contour]()
    if partition is not None:
        joints = joint_lines(cut, partition, profile, robots=robot_count(job))
        outlines = piece_lumens(cut, partition)
    more = {f"design_{k}.toml": one for k, one in enumerate(prepared.others, start=2)}
    designs = {"design.toml": design, **more}
    files = {
        "README.txt": readme_text(design, spec, partition, pattern, requested).encode(),
        **{name: design_text(one).encode() for name, one in designs.items()},
        PACKAGE_MARK: job_text(design, spec, pattern, requested).encode(),
        **prepared.laser,
        "preview.png": page_png(job_plan(job, prepared.report.findings)),
        ANIMATION_NAME: job_animation(job, profile),
        "checks.json": checks_text(prepared.report, prepared.beside).encode(),
        "report.html": page(f"{design.name}: fabrication", page_blocks(prepared)).encode(),
        "bom.csv": bom_text(job, profile, joints, requested).encode(),
        **assembly_files(cut, partition, outlines, profile),
        **_seam_lists(job, profile),
        **mask_files(job, profile, prepared.paper),
        **(fold_files(tube, prepared.paper) if isinstance(tube, FoldedTube) else {}),
    }
    digests = {name: sha256_of(data) for name, data in files.items()}
    return {**files, MANIFEST_NAME: manifest_text(digests).encode()}


def _seam_lists(job: Job, profile: LaserProfile) -> dict[str, bytes]:
    """Return what a straight bar does of each sheet's seams, by file name."""
    lists = {stem: bar_strokes(one, profile) for stem, one in drawn_jobs(job).items()}
    return {
        seams_name(stem): seams_text(strokes).encode() for stem, strokes in lists.items() if strokes
    }


def zip_bytes(files: Mapping[str, bytes], folder: str) -> bytes:
    """Return files as a zip whose bytes depend on nothing but them.

    The files are stored, not compressed: compressors differ from one build to the next.
    """
    stream = io.BytesIO()
    unix = 3
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(f"{folder}/{name}", _FIRST_DATE)
            entry.create_system = unix
            entry.external_attr = _PLAIN_FILE
            archive.writestr(entry, data)
        archive.comment = ROOMY_GENERATOR.encode()
    return stream.getvalue()


def page_blocks(prepared: Prepared) -> Iterator[Block]:
    """Yield the page of a design without predictions."""
    design, profile = prepared.design, prepared.profile
    words, cautions = prepared.report.verdict, recipe_cautions(profile)
    tone: Tone = "caution" if cautions else "good"
    if any(report.blocking for report in (prepared.report, *prepared.beside)):
        tone = "bad"
    yield Answer("; ".join(filter(None, (words, recipe_verdict(profile)))), tone)
    yield Notes(cautions)
    sheet, *sections = making_sections(prepared)
    yield from sheet.pictures
    yield Facts((*making_facts(prepared), *design_facts(prepared)))
    yield Text("This page does not predict where the robot will grow: vinefab report does.")
    yield from sections
    tables = tuple(replace(one, folded=False) for one in sheet.tables)
    yield replace(sheet, pictures=(), tables=tables, folded=True)
    yield pressure_section(design, profile)
    yield assumption_section(profile)


def recipe_cautions(profile: LaserProfile) -> tuple[str, ...]:
    """Return the reservations about a recipe, a sentence each."""
    found = list[str]()
    if profile.status is RecipeStatus.UNVERIFIED:
        found.append(
            f"No coupon has confirmed the {_words(profile).recipe}: cut and burst one first."
        )
    if stale := profile.stale_words:
        found.append(f"{stale[0].upper()}{stale[1:]}.")
    return tuple(found)


def recipe_verdict(profile: LaserProfile) -> str:
    """Return the reservations about a recipe in a few words; empty if there are none."""
    unverified = profile.status is RecipeStatus.UNVERIFIED
    words = ["unverified"] * unverified + ["stale"] * bool(profile.stale_words)
    return f"{_words(profile).recipe} {' and '.join(words)}" if words else ""


def _words(profile: LaserProfile) -> ProcessWords:
    return WORDS[profile.settings(profile.recipe.seals).tool]


def making_sections(prepared: Prepared) -> tuple[Section, ...]:
    """Return the sections on manufacturing: sheet, pieces, rules, flat and deployed, materials."""
    job, profile, cut = prepared.job, prepared.profile, prepared.cut
    designs = (prepared.design, *prepared.others)
    reports = (prepared.report, *prepared.beside)
    joints, pieces = tuple[BomLine, ...](), tuple[Section, ...]()
    if (partition := prepared.partition) is not None:
        joints = joint_lines(cut, partition, profile, robots=robot_count(job))
        outlines = piece_lumens(cut, partition)
        sheets: dict[str, list[int]] = {}
        for number in range(1, len(job.sheets) + 1):
            for label in dict.fromkeys(job.labels_on(number)):
                sheets.setdefault(label, []).append(number)
        pieces = (pieces_section(cut, partition, outlines, profile, sheets=sheets),)

    def outline_mm(design: Design) -> Floats:
        return body_outline(prepared.patterns[design.name].flat).contour.flattened_mm()

    robots = robot_count(job)
    bill = Rows(
        caption="One robot" if robots == 1 else f"The whole sheet: {counted(robots, 'robot')}",
        headings=("item", "amount", "unit", "standing", "basis"),
        rows=tuple(
            (line.item, f"{line.value:.4g}", line.unit, line.standing.value, line.basis)
            for line in (*bill_of_materials(job, profile), *joints)
        ),
    )
    return (
        _sheet_section(
            job,
            [finding for report in reports for finding in report.findings],
            _words(profile).sheet,
        ),
        *pieces,
        *(
            _check_section(
                report,
                partial(outline_mm, design),
                f"Design rules: {design.name}" if prepared.others else "Design rules",
            )
            for design, report in zip(designs, reports, strict=True)
        ),
        pattern_section(prepared.pattern),
        *([fold_section(tube)] if isinstance(tube := prepared.folded, FoldedTube) else ()),
        Section(title="Bill of materials", tables=(bill,), folded=True),
    )


def making_facts(prepared: Prepared) -> tuple[Fact, ...]:
    """Return the number of a robot's pieces, the film that they take, and the rules' result."""
    job, film, report = prepared.job, prepared.profile.material, prepared.report
    joints = 0 if prepared.partition is None else len(prepared.partition.sleeves)
    lines = {one.item: one for one in bill_of_materials(job, prepared.profile)}
    sheets = counted(max(1, len(job.sheets)), "sheet")
    size = " x ".join(f"{lines[f'film {side}'].value:.0f}" for side in ("width", "height"))
    errors, warnings = report.count(Severity.ERROR), report.count(Severity.WARNING)
    return (
        Fact(
            "pieces",
            counted(joints + 1, "flat piece"),
            detail=f"{counted(joints, 'joint')}; {sheets} of {size} mm",
            standing="computed",
        ),
        Fact(
            "film",
            f"{counted(film.plies, 'ply')}, {lines['robot film mass'].value:.3g} g",
            detail=film.title,
            standing="computed",
        ),
        Fact(
            "rules",
            f"{counted(errors, 'error')}, {counted(warnings, 'warning')}",
            detail=f"{counted(len(report.skipped), 'rule')} not checked",
            tone="bad" if report.blocking else "plain",
            standing="computed",
        ),
    )


def design_facts(prepared: Prepared) -> tuple[Fact, ...]:
    """Return name and value of a design's key facts."""
    design, profile = prepared.design, prepared.profile
    tree, most_widths = design.tree, 8
    widths = [one.width_mm for one in design.tubes]
    return (
        Fact("branches", f"{len(tree)} on {counted(design.depth, 'level')}"),
        Fact("film in branches", f"{tree.total_length_mm / 1000:.3f} m (planned)"),
        Fact(
            "widths, lay-flat",
            some_of([f"{width:.1f}" for width in widths], most_widths) + " mm",
        ),
        Fact("working pressure", f"{design.build.pressure_kpa:g} kPa (design)"),
        Fact("machine", profile.machine.title),
        Fact("recipe", f"{profile.recipe.name}: {profile.recipe.status.value}"),
    )


def _sheet_section(job: Job, findings: Sequence[Finding], purpose: str) -> Section:
    """Return the sheet for the machine: picture and the changes to the paths."""

    def words(value: object) -> str:
        if isinstance(value, list | tuple):
            return ", ".join(map(words, value))
        return f"{value:.3f}" if isinstance(value, float) else str(value)

    rows = tuple((name.replace("_", " "), words(value)) for name, value in job.facts.items())
    picture = Picture(
        image=lambda: page_svg(job_plan(job, tuple(findings))),
        caption="The sheet: seam and kerf offsets are in the paths; leave the machine's kerf at 0.",
    )
    caption = "What the paths hold (computed)"
    return Section(
        title=f"The {'sheets' if len(job.sheets) > 1 else 'sheet'} for {purpose}",
        pictures=(picture,),
        tables=(Rows(caption=caption, headings=("", ""), rows=rows, folded=True),),
    )


def _check_section(report: CheckReport, outline_mm: Callable[[], Floats], title: str) -> Section:
    """Return every finding, at its place in the outline, and every rule that was run or skipped."""
    ran = ", ".join(f"{run.rule} ({run.checked})" for run in report.run)
    paragraphs = [
        *(() if report.findings else ("No findings.",)),
        *(f"Stale waiver {name}: it matches no finding." for name in report.stale_waivers),
        f"Rules run, with the number of items that each checked: {ran}.",
    ]
    tables, pictures = list[Rows](), list[Picture]()
    if report.findings:
        what = "what is wrong", "by how much", "for a waiver"
        headings = ("no.", "rule", "weight", "branches", *what)
        rows = tuple(
            (
                str(number),
                finding.rule,
                f"waived: {finding.reason}" if finding.waived else finding.severity.value,
                ", ".join(finding.branches),
                f"{finding.title}: {finding.message}" if finding.title else finding.message,
                finding.measures,
                finding.fingerprint,
            )
            for number, finding in enumerate(report.findings, start=1)
        )
        tables.append(Rows(caption="Findings", headings=headings, rows=rows))
    if skipped := tuple((rule.rule, rule.reason) for rule in report.skipped):
        tables.append(Rows(caption="Rules skipped", headings=("rule", "why"), rows=skipped))
    if any(finding.marker_wkt for finding in report.findings):
        caption = (
            "Findings at their places in the flat outline; numbers as in the table. "
            "Findings about the whole robot have no place."
        )
        picture = Picture(
            image=lambda: page_svg(findings_plan(outline_mm(), report.findings)), caption=caption
        )
        pictures.append(picture)
    return Section(
        title=title,
        paragraphs=tuple(paragraphs),
        pictures=tuple(pictures),
        tables=tuple(tables),
        folded=True,
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
    """Return the pressure that each width stands, with the standing of its source."""
    film, build = profile.material, design.build
    allowed = seam_load_n_mm(film.seam)
    rows = []
    by_level = design.branches is None
    for one in design.tubes:
        width_mm = one.width_mm
        strain = hoop_strain(
            build.pressure_kpa, width_mm, film.ply_mm.value, film.modulus_mpa.value
        )
        cells = (
            f"{width_mm:.2f}",
            f"{inflated_diameter_mm(width_mm):.2f}",
            f"{burst_pressure_kpa(width_mm, allowed):.1f}",
            f"{100 * strain:.0f} %",
        )
        rows.append((str(one.level) if by_level else one.name, *cells))
    table = Rows(
        caption=f"At the working pressure of {build.pressure_kpa:g} kPa; what seams stand rests on "
        f"one test: {film.seam.words()}. Strain rests on a modulus of "
        f"{film.modulus_mpa.value:g} MPa ({film.modulus_mpa.standing})",
        headings=(
            "level" if by_level else "branches",
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
    ids, pieces = design.tree.straight.ids, []
    most_branches_named = 12  # branches of a piece that a table names; of more it gives the number
    for piece in partition.pieces:
        long_mm, wide_mm = least_rectangle_mm(outlines[piece.label])
        pieces.append(
            (
                piece.label,
                some_of([ids[branch] for branch in piece.branches], most_branches_named),
                str(len(piece.branches)),
                ", ".join(map(str, sheets[piece.label])),
                f"{long_mm:.0f} x {wide_mm:.0f}",
            )
        )
    piece_table = Rows(
        caption="Pieces; the size is that of the least rectangle around the outline (computed)",
        headings=("piece", "branches that end on it", "number", "sheet", "size, mm"),
        rows=tuple(pieces),
        folded=True,
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
            piece_table,
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


def assumption_section(
    profile: LaserProfile, models: Sequence[tuple[str, Quantity]] = ()
) -> Section:
    """Return every number behind the report with its standing, the least trusted first."""
    owned = {"machine": profile.machine, "material": profile.material}
    numbers = [
        *models,
        *(
            (f"{owner}.{name}", value)
            for owner, noun in (owned | dict(profile.recipe.by_operation)).items()
            for name, value in quantities(noun).items()
            if value is not NO_SHRINKAGE
        ),
    ]
    order = [Standing.ASSUMED, Standing.PUBLISHED, Standing.PAPER, Standing.COMPUTED]
    rank = {standing: place for place, standing in enumerate(order)}
    numbers.sort(key=lambda row: rank.get(row[1].standing, len(order)))
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
