"""The registered laser formats; every file that they write is read back and compared.

A new format is one module with a `LaserFormat`, and one line in `LASER_FORMATS` or an entry point
of the group ``vinefab.laser_formats``. It is then written with every package and coupon, and its
files pass the same comparison (`vinefab.fabrication.formats.laser_drawing`) as all others. The
package's README.txt, bill and job.json name it by its title and its use.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from vinefab.core.errors import ReadBackError, UnknownNameError
from vinefab.core.foreign import calling, ensure_type
from vinefab.core.registry import Registry
from vinefab.fabrication.formats.dxf_format import DXF, DXF_POLYLINE, DXF_R12
from vinefab.fabrication.formats.gcode_format import GCODE
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, LaserFormat, file_problems
from vinefab.fabrication.formats.lightburn_format import LIGHTBURN
from vinefab.fabrication.formats.pdf_format import PAPER_FORMATS, pdf_format
from vinefab.fabrication.formats.pointing_format import POINTING
from vinefab.fabrication.formats.svg_format import SVG
from vinefab.fabrication.job.passes import draws_by_hand
from vinefab.fabrication.job.steps import JobStep
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import Tool
from vinefab.pages.paper_tiles import PAPERS

R12_FORMAT, AUTO = "dxf_r12", "auto"


def format_problem(name: str, part: object) -> str:
    """Return the reason that a plug-in is not a laser format, or an empty string."""
    if not isinstance(part, LaserFormat):
        return f"is a {type(part).__name__}, not a LaserFormat with writer and reader"
    taken = {one.suffix: other for other, one in LASER_FORMATS.items() if other != name}
    if part.suffix in taken:
        return f"its files end in {part.suffix} like those of {taken[part.suffix]}"
    return ""


LASER_FORMATS: Registry[LaserFormat] = Registry(
    "laser format",
    {
        "dxf": DXF,
        "dxf_polyline": DXF_POLYLINE,
        "svg": SVG,
        R12_FORMAT: DXF_R12,
        "lightburn": LIGHTBURN,
        "gcode": GCODE,
        "gcode_point": POINTING,
        **{PAPER_FORMATS[paper]: pdf_format(paper) for paper in PAPERS},
    },
    group="vinefab.laser_formats",
    problem=format_problem,
)
"""All formats by name, in the order in which a package lists their files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserFiles:
    """Laser files, and the findings of reading them back."""

    files: Mapping[str, bytes]  # by name
    problems: Mapping[str, tuple[str, ...]]  # by name; empty for a file that agrees with its job


def requested_formats(
    profile: LaserProfile, *, paper: str = AUTO, r12: bool = False
) -> tuple[str, ...]:
    """Return the formats to write that are written on request only.

    Parameters
    ----------
    paper
        Of the pattern at 1:1: a name of `PAPERS`, or ``auto``: A4 where people seal along lines
        that no machine marks, else no pattern.
    r12
        Whether a DXF of release 12 is wanted.

    Raises
    ------
    UnknownNameError
        If there is no such paper.
    """
    if paper != AUTO and paper not in PAPERS:
        raise UnknownNameError("paper", paper, {AUTO, *PAPERS})
    if paper == AUTO and draws_by_hand(profile):
        paper = "a4"
    return (*([] if paper == AUTO else [PAPER_FORMATS[paper]]), *([R12_FORMAT] if r12 else []))


def formats_for(
    profile: LaserProfile | None, requested: Collection[str] = ()
) -> dict[str, LaserFormat]:
    """Return the formats to write, by name.

    Parameters
    ----------
    profile
        The machine's settings; None where no format can have them.
    requested
        Names of formats that are written on request only.
    """
    LASER_FORMATS.load_plugins()
    return {
        name: one
        for name, one in LASER_FORMATS.items()
        if (profile is not None or not one.needs_profile)
        and (name in requested or not one.on_request)
        and (profile is None or not one.tools or not one.tools.isdisjoint(profile.tools))
    }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedFile:
    """A laser file to write."""

    name: str  # in its folder
    kind: LaserFormat
    spec: LaserFileSpec  # what it holds
    step: JobStep | None = None  # the only one that it holds; None for a whole sheet


def planned_files(
    spec: LaserFileSpec,
    *,
    stem: str = "outline",
    requested: Collection[str] = (),
    without: Collection[LaserFormat] = (),
    each_operation: bool = True,
) -> tuple[PlannedFile, ...]:
    """Return the files of a job: format by format the whole, then one for each operation.

    What lies on several tiles is shown whole and run tile by tile: it has no file for an operation.

    Parameters
    ----------
    spec
        Job, colour preset and, for formats with machine settings, the profile.
    stem
        How the names of the files begin.
    requested
        Names of formats that are written on request only, such as `R12_FORMAT`.
    without
        Formats that are left out.
    each_operation
        Whether to plan a file for each operation.
    """
    parted = each_operation and not spec.job.tiles
    steps = spec.steps if parted else ()
    found = list[PlannedFile]()
    for one in formats_for(spec.profile, requested).values():
        if one in without or (one.where_needed and not one.paths(spec)):
            continue
        if one.whole:
            found.append(PlannedFile(name=one.file_name(stem), kind=one, spec=spec))
        for step in steps if one.each_operation else ():
            if one.tools and _tool(step, spec) not in one.tools:
                continue
            name, part = (
                one.file_name(f"{stem}_{step.name}"),
                replace(spec, job=step.job_of(spec.job)),
            )
            found.append(PlannedFile(name=name, kind=one, spec=part, step=step))
    return tuple(found)


def _tool(step: JobStep, spec: LaserFileSpec) -> Tool:
    return step.paths[0].settings_in(spec.recipe_profile).tool


def laser_files(
    spec: LaserFileSpec,
    *,
    stem: str = "outline",
    requested: Collection[str] = (),
    without: Collection[LaserFormat] = (),
    each_operation: bool = True,
) -> LaserFiles:
    """Write a job's `planned_files`, which have the same parameters, and read every one back.

    Raises
    ------
    BadInputError
        If the recipe lacks an operation of the job, or the job has too many variants.

    See Also
    --------
    ensure_read_back : Raises for a file that differs from its job.
    """
    plan = planned_files(
        spec, stem=stem, requested=requested, without=without, each_operation=each_operation
    )
    files = {one.name: _written(one.kind, one.spec) for one in plan}
    problems = {one.name: file_problems(one.kind, files[one.name], one.spec) for one in plan}
    return LaserFiles(files=files, problems=problems)


def _written(one: LaserFormat, spec: LaserFileSpec) -> bytes:
    """Return the content of a file in a format."""
    what = f"laser format {one.title!r}"
    with calling(what, one.write):
        text = one.write(spec)
    ensure_type(what, one.write, "file", text, str)
    with calling(what, one.write):  # half a pair of surrogates has no UTF-8
        return text.encode(one.encoding)


def format_words(name: str, alone: Collection[str] = (), stem: str = "outline") -> str:
    """Return a format's files with its title, its use and, of a plug-in, its package.

    Parameters
    ----------
    alone
        Names of its files that hold one operation.

    Examples
    --------
    >>> format_words("dxf_polyline")
    'outline_polyline.dxf: DXF with chords for arcs; for programs that lose arcs'
    """
    one, package = LASER_FORMATS[name], LASER_FORMATS.packages.get(name)
    parts = [one.title, one.use, f"from {package}" if package else ""]
    files = [one.file_name(stem)] if one.whole else alone
    if one.whole and alone:
        parts.append(f"one operation alone: {', '.join(alone)}")
    return f"{', '.join(files)}: {'; '.join(part for part in parts if part)}"


def broken_formats() -> tuple[str, ...]:
    """Return a line for every plug-in format that could not be loaded."""
    broken = LASER_FORMATS.broken.items()
    return tuple(f"note    laser format {name} not loaded: {reason}" for name, reason in broken)


def tile_stem(number: int) -> str:
    """Return the beginning of the names of a tile's files.

    >>> DXF.file_name(tile_stem(2))
    'tile_2_outline.dxf'
    """
    return f"tile_{number}_outline"


def sheet_folder(number: int) -> str:
    """Return the folder of a package in which the files of a sheet are.

    >>> sheet_folder(2)
    'sheet_2'
    """
    return f"sheet_{number}"


def drawn_jobs(job: Job) -> dict[str, Job]:
    """Return the jobs that have files, by how the names of these begin; its runs are the last."""
    if job.sheets:
        return {f"{sheet_folder(k)}/outline": one for k, one in enumerate(job.sheets, start=1)}
    tiles = {tile_stem(k): tile for k, tile in enumerate(job.tiles, start=1)}
    return {"outline": job, **tiles}


def files_by_run(
    spec: LaserFileSpec, requested: Collection[str] = ()
) -> dict[str, tuple[PlannedFile, ...]]:
    """Return the files of each of a job's `drawn_jobs`."""
    return {
        stem: planned_files(replace(spec, job=one), stem=stem, requested=requested)
        for stem, one in drawn_jobs(spec.job).items()
    }


def ensure_read_back(problems: Mapping[str, tuple[str, ...]]) -> None:
    """Raise ReadBackError for the first laser file that differs from its job."""
    for name, found in problems.items():
        if found:
            raise ReadBackError(name, "; ".join(found))
