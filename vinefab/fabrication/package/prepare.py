"""From a design to its fabrication package: job, checks, laser files read back, folder and zip."""

import io
import zipfile
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from vinefab.core.hashing import MANIFEST_NAME, ROOMY_GENERATOR, manifest_text, sha256_of
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.core.view import Answer, Block, Fact, Facts, Notes, Section, Text, Tone
from vinefab.fabrication.formats.laser_drawing import DEFAULT, PRESETS, Colours, LaserFileSpec
from vinefab.fabrication.formats.laser_formats import (
    R12_FORMAT,
    ensure_read_back,
    laser_files,
    sheet_folder,
    tile_stem,
)
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import ONE, SheetOptions
from vinefab.fabrication.outline.body_outline import body_outline
from vinefab.fabrication.package.assembly_drawing import assembly_files
from vinefab.fabrication.package.bom import (
    BomLine,
    bill_of_materials,
    bom_text,
    joint_lines,
    robot_count,
)
from vinefab.fabrication.package.job_json import job_text
from vinefab.fabrication.package.package_page import (
    assumption_section,
    bom_section,
    check_section,
    pattern_section,
    pieces_section,
    pressure_section,
    sheet_section,
)
from vinefab.fabrication.package.readme_text import readme_text
from vinefab.fabrication.package.sheet_pictures import job_animation, job_plan
from vinefab.fabrication.pieces.exploded import piece_lumens
from vinefab.fabrication.pieces.partition import in_pieces, pieces_of
from vinefab.fabrication.rules.as_built import READBACK
from vinefab.fabrication.rules.catalog import (
    RULES,
    SHEET_RULES,
    checks_text,
    concerns,
    merged_reports,
    run_checks,
)
from vinefab.fabrication.rules.rule import Subject
from vinefab.inflation.pattern import Pattern, cut_design, pattern_of
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design, design_text
from vinefab.model.finding import CheckReport, RuleSkipped, Severity
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile, RecipeStatus
from vinefab.model.outline import Contour
from vinefab.model.tree import Partition, branch_tree
from vinefab.pages.html import page
from vinefab.pages.page_files import page_png

ANIMATION_NAME = "animation.svg"

PACKAGE_MARK = "job.json"
"""The file by which the folder of a package is recognized."""

_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
_UNIX = 3
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
    # problems that reading them back found, by file name
    readback: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    others: tuple[Design, ...] = ()  # the other designs on the sheet
    beside: tuple[CheckReport, ...] = ()  # reports of these
    partition: Partition | None = None  # the pieces that it is cut in; None for one flat outline
    pattern: Pattern | None = None  # how it deploys; None if not simulated, cut as designed

    @property
    def cut(self) -> Design:
        """The flat tree that is cut."""
        return self.pattern.flat if self.pattern else self.design

    def refusal(self, *, allow_uncalibrated: bool) -> str:
        """Return the reason that no files may be written, or an empty string."""
        blocking = [f for report in (self.report, *self.beside) for f in report.blocking]
        if blocking:
            broken = ", ".join(sorted({finding.rule for finding in blocking}))
            return f"{broken} forbid it: fix the design, or waive them in it with a reason"
        recipe = self.profile.recipe
        if recipe.status is RecipeStatus.UNVERIFIED and not allow_uncalibrated:
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

    Raises
    ------
    BadInputError
        If the sheet cannot hold the designs, or the recipe lacks an operation.
    """
    separate = sheet.separate
    pattern = pattern_of(design, profile)
    cut = pattern.flat
    flat_sheet = replace(sheet, beside=tuple(cut_design(one, profile) for one in sheet.beside))
    partition = pieces_of(pattern, profile, separate=separate)
    job = laser_job(cut, profile, flat_sheet, partition)
    flat = Subject.on_sheet(cut, profile, job, separate=separate)
    flat = replace(flat, pattern=pattern, deployments=deployments)
    subject = in_pieces(flat, partition)
    report = run_checks(subject)
    named = {other.name: other for other in sheet.beside}
    others = tuple(other for name, other in named.items() if name != design.name)
    beside = tuple(_beside(other, profile, job, separate=separate) for other in others)
    files: dict[str, bytes] = {}
    problems: dict[str, tuple[str, ...]] = {}
    if not any(one.blocking for one in (report, *beside)):
        sheets = {"outline": job}
        sheets |= {tile_stem(number): tile for number, tile in enumerate(job.tiles, start=1)}
        if job.sheets:
            sheets = {
                f"{sheet_folder(number)}/outline": one
                for number, one in enumerate(job.sheets, start=1)
            }
        for stem, one in sheets.items():
            spec = package_spec(one, profile)
            folder, slash, name = stem.rpartition("/")
            written = laser_files(spec, stem=name, requested=(R12_FORMAT,) if r12 else ())
            files |= {f"{folder}{slash}{name}": data for name, data in written.files.items()}
            problems |= {f"{folder}{slash}{name}": w for name, w in written.problems.items()}
        reread = run_checks(replace(subject, readback=problems), only=(READBACK.id,))
        report = merged_reports(report, reread)
    return Prepared(
        design=design,
        profile=profile,
        job=job,
        report=report,
        laser=files,
        readback=problems,
        others=others,
        beside=beside,
        partition=partition if len(partition.pieces) > 1 else None,
        pattern=pattern,
    )


def _beside(design: Design, profile: LaserProfile, job: Job, *, separate: bool) -> CheckReport:
    """Return the report on another robot of a sheet, measured in the sheet's own paths.

    Rules about the sheet as a whole are applied with the first robot only.
    """
    subject = Subject.on_sheet(cut_design(design, profile), profile, job, separate=separate)
    report = run_checks(subject, only=RULES.keys() - SHEET_RULES)
    reason = f"checked once for the whole sheet, with {job.name}"
    rules = [rule for rule in sorted(SHEET_RULES) if concerns(rule, design)]
    skipped = tuple(RuleSkipped(rule=rule, reason=reason) for rule in rules)
    once = replace(report, run=(), skipped=skipped, findings=())
    return replace(merged_reports(report, once), stale_waivers=())


def package_spec(job: Job, profile: LaserProfile) -> LaserFileSpec:
    """Return the content of a sheet's laser files, in the machine's colours."""
    return LaserFileSpec(
        job=job,
        colours=PRESETS[profile.machine.colours],
        profile=profile,
        hairline_mm=profile.machine.hairline_mm,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PackageContent:
    """The parts of a package that differ from design to design."""

    design: Design
    profile: LaserProfile
    job: Job
    checks: str  # text of checks.json (`vinefab.fabrication.rules.catalog.checks_text`)
    preview: bytes  # the sheet, PNG
    report: bytes  # the report, HTML
    animation: bytes = b""  # the laser's path in motion, SVG; empty for none
    colours: Colours = DEFAULT
    # laser files that were read back without a problem; None to write them here
    laser: Mapping[str, bytes] | None = None
    partition: Partition | None = None  # the pieces that it is cut in; None for one flat outline
    others: tuple[Design, ...] = ()  # the other designs on the sheet
    pattern: Pattern | None = None  # how it deploys; None if not simulated, cut as designed


def package(prepared: Prepared) -> dict[str, bytes]:
    """Return every file of the fabrication package, by name.

    Raises
    ------
    ReadBackError
        If a laser file, read back, differs from the job.
    """
    ensure_read_back(prepared.readback)
    content = PackageContent(
        design=prepared.design,
        profile=prepared.profile,
        job=prepared.job,
        checks=checks_text(prepared.report, prepared.beside),
        preview=page_png(job_plan(prepared.job, prepared.report.findings)),
        report=page(f"{prepared.design.name}: fabrication", page_blocks(prepared)).encode(),
        animation=job_animation(prepared.job, prepared.profile),
        colours=PRESETS[prepared.profile.machine.colours],
        laser=prepared.laser or None,
        partition=prepared.partition,
        others=prepared.others,
        pattern=prepared.pattern,
    )
    return package_files(content)


def package_files(content: PackageContent) -> dict[str, bytes]:
    """Return the files of a package by name, every laser file read back."""
    job, profile, colours = content.job, content.profile, content.colours
    design, partition, pattern = content.design, content.partition, content.pattern
    cut, shape = pattern.flat if pattern else design, pattern or pattern_of(design, profile)
    joints, outlines = tuple[BomLine, ...](), dict[str, Contour]()
    if partition is not None:
        joints = joint_lines(cut, partition, profile, robots=robot_count(job))
        outlines = piece_lumens(cut, partition)
    more = {f"design_{number}.toml": one for number, one in enumerate(content.others, start=2)}
    files = {
        "README.txt": readme_text(design, job, profile, colours, partition, shape).encode(),
        **{
            name: design_text(one).encode() for name, one in {"design.toml": design, **more}.items()
        },
        "job.json": job_text(design, job, profile, colours, shape).encode(),
        **(_laser(content) if content.laser is None else content.laser),
        "preview.png": content.preview,
        **({ANIMATION_NAME: content.animation} if content.animation else {}),
        "checks.json": content.checks.encode(),
        "report.html": content.report,
        "bom.csv": bom_text(job, profile, joints).encode(),
        **assembly_files(cut, partition, outlines, profile),
    }
    digests = {name: sha256_of(data) for name, data in files.items()}
    files[MANIFEST_NAME] = manifest_text(digests).encode()
    return files


def _laser(content: PackageContent) -> Mapping[str, bytes]:
    spec = replace(package_spec(content.job, content.profile), colours=content.colours)
    written = laser_files(spec)
    ensure_read_back(written.problems)
    return written.files


def zip_bytes(files: Mapping[str, bytes], folder: str) -> bytes:
    """Return files as a zip whose bytes depend on nothing but them.

    The files are stored, not compressed: compressors differ from one build to the next.
    """
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(f"{folder}/{name}", _FIRST_DATE)
            entry.create_system = _UNIX
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
    yield Answer(f"{words}; laser recipe unverified" if cautions else words, tone)
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
    if profile.recipe.status is RecipeStatus.UNVERIFIED:
        return ("No coupon has confirmed the laser recipe: cut and burst one first.",)
    return ()


def making_sections(prepared: Prepared) -> tuple[Section, ...]:
    """Return the sections on manufacturing: sheet, pieces, rules, flat and deployed, materials."""
    job, joints = prepared.job, tuple[BomLine, ...]()
    if prepared.partition is not None:
        joints = joint_lines(
            prepared.cut, prepared.partition, prepared.profile, robots=robot_count(job)
        )
    designs = (prepared.design, *prepared.others)
    reports = (prepared.report, *prepared.beside)

    def outline_mm(design: Design) -> Floats:
        return body_outline(cut_design(design, prepared.profile)).contour.flattened_mm()

    return (
        sheet_section(job, [finding for report in reports for finding in report.findings]),
        *_piece_sections(prepared),
        *(
            check_section(
                report,
                partial(outline_mm, design),
                title=f"Design rules: {design.name}" if prepared.others else "Design rules",
            )
            for design, report in zip(designs, reports, strict=True)
        ),
        pattern_section(prepared.pattern or pattern_of(prepared.design, prepared.profile)),
        bom_section((*bill_of_materials(job, prepared.profile), *joints), robot_count(job)),
    )


def _piece_sections(prepared: Prepared) -> tuple[Section, ...]:
    """Return the section on the pieces of a robot, if it is cut in any."""
    design, partition, job = prepared.cut, prepared.partition, prepared.job
    if partition is None:
        return ()
    outlines = piece_lumens(design, partition)
    sheets: dict[str, list[int]] = {}
    for number, sheet in enumerate(job.sheets, start=1):
        labels = sheet.facts["pieces"]
        for label in dict.fromkeys(labels) if isinstance(labels, list) else ():
            sheets.setdefault(label, []).append(number)
    return (pieces_section(design, partition, outlines, prepared.profile, sheets=sheets),)


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
    tree = branch_tree(design)
    return (
        Fact("branches", f"{len(tree)} on {counted(design.depth, 'level')}"),
        Fact("film in branches", f"{tree.total_length_mm / 1000:.3f} m (planned)"),
        Fact(
            "widths, lay-flat",
            ", ".join(f"{width:.1f}" for width in design.build.widths_mm) + " mm",
        ),
        Fact("working pressure", f"{design.build.pressure_kpa:g} kPa (design)"),
        Fact("machine", profile.machine.title),
        Fact("recipe", f"{profile.recipe.name}: {profile.recipe.status.value}"),
    )
