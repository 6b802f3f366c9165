"""The registered laser formats; every file that they write is read back and compared.

A new format is one module with a `LaserFormat`, and one line in `LASER_FORMATS` or an entry point
of the group ``vinefab.laser_formats``. It is then written with every package and coupon, and its
files pass the same comparison (`vinefab.fabrication.formats.laser_drawing`) as all others.
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


def formats_for(spec: LaserFileSpec, requested: Collection[str] = ()) -> dict[str, LaserFormat]:
    """Return the formats to write, by name.

    Parameters
    ----------
    requested
        Names of formats that are written on request only.
    """
    LASER_FORMATS.load_plugins()
    return {
        name: one
        for name, one in LASER_FORMATS.items()
        if (spec.profile is not None or not one.needs_profile)
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
    some = [one for one in formats_for(spec, requested).values() if one not in without]
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


def ensure_read_back(problems: Mapping[str, tuple[str, ...]]) -> None:
    """Raise ReadBackError for the first laser file that differs from its job."""
    for name, found in problems.items():
        if found:
            raise ReadBackError(name, "; ".join(found))
