"""The registered laser formats; every file that they write is read back and compared.

A new format is one module with a `LaserFormat`, and one line in `LASER_FORMATS` or an entry point
of the group ``vinefab.laser_formats``. It is then written with every package and coupon, and its
files pass the same comparison (`vinefab.fabrication.formats.laser_drawing`) as all others. The
package's README.txt, bill and job.json name it by its title and its use.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from vinefab.core.errors import ReadBackError
from vinefab.core.foreign import calling, ensure_type
from vinefab.core.registry import Registry
from vinefab.fabrication.formats.dxf_format import DXF, DXF_POLYLINE, DXF_R12
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, LaserFormat, file_problems
from vinefab.fabrication.formats.lightburn_format import LIGHTBURN
from vinefab.fabrication.formats.svg_format import SVG
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile

R12_FORMAT = "dxf_r12"


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
    }


def laser_files(
    spec: LaserFileSpec,
    *,
    stem: str = "outline",
    requested: Collection[str] = (),
    without: Collection[LaserFormat] = (),
) -> LaserFiles:
    """Write a job in every format and read every file back.

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

    Raises
    ------
    BadInputError
        If the recipe lacks an operation of the job, or the job has too many variants.

    See Also
    --------
    ensure_read_back : Raises for a file that differs from its job.
    """
    some = [one for one in formats_for(spec.profile, requested).values() if one not in without]
    formats = {one.file_name(stem): one for one in some}
    files = {name: _written(one, spec) for name, one in formats.items()}
    return LaserFiles(
        files=files,
        problems={name: file_problems(one, files[name], spec) for name, one in formats.items()},
    )


def _written(one: LaserFormat, spec: LaserFileSpec) -> bytes:
    """Return the content of a file in a format."""
    what = f"laser format {one.title!r}"
    with calling(what, one.write):
        text = one.write(spec)
    ensure_type(what, one.write, "file", text, str)
    with calling(what, one.write):  # half a pair of surrogates has no UTF-8
        return text.encode()


def format_words(name: str, stem: str = "outline") -> str:
    """Return a format's file with its title, its use and, of a plug-in, its package.

    >>> format_words("dxf_polyline")
    'outline_polyline.dxf: DXF with chords for arcs; for programs that lose arcs'
    """
    one, package = LASER_FORMATS[name], LASER_FORMATS.packages.get(name)
    parts = (one.title, one.use, f"from {package}" if package else "")
    return f"{one.file_name(stem)}: {'; '.join(part for part in parts if part)}"


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


def file_stems(job: Job) -> tuple[str, ...]:
    """Return how the names of a job's files begin; its last ones are those of its runs."""
    if job.sheets:
        return tuple(f"{sheet_folder(k)}/outline" for k in range(1, len(job.sheets) + 1))
    return ("outline", *(tile_stem(k) for k in range(1, len(job.tiles) + 1)))


def ensure_read_back(problems: Mapping[str, tuple[str, ...]]) -> None:
    """Raise ReadBackError for the first laser file that differs from its job."""
    for name, found in problems.items():
        if found:
            raise ReadBackError(name, "; ".join(found))
