"""The fabrication package: everything that is needed to cut one design."""

from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.core.errors import ReadBackError
from vinefab.core.hashing import sha256_of
from vinefab.core.manifest import MANIFEST_NAME, manifest_text
from vinefab.export.bom import bom_text
from vinefab.export.colours import DEFAULT, Colours
from vinefab.export.job_json import job_text
from vinefab.export.laser_files import (
    laser_file_problems,
    laser_files,
)
from vinefab.export.readme import readme_text
from vinefab.model.design import Design
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile

ANIMATION_NAME = "animation.svg"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PackageContent:
    """What a package is made of.

    Parameters
    ----------
    design
        What is made.
    profile
        Machine, material and recipe.
    job
        The paths.
    checks
        Text of checks.json (`vinefab.export.checks_json.checks_text`).
    preview
        A picture of the job, PNG.
    report
        The report, HTML.
    animation
        The laser's path in motion, SVG; empty for none.
    colours
        Layers and colours.
    laser
        Laser files that were read again and found right; None to write them here.
    """

    design: Design
    profile: LaserProfile
    job: Job
    checks: str
    preview: bytes
    report: bytes
    animation: bytes = b""
    colours: Colours = DEFAULT
    laser: Mapping[str, bytes] | None = None


def package_files(content: PackageContent) -> dict[str, bytes]:
    """Return the files of a package by name, the laser files read again and found right.

    Parameters
    ----------
    content
        What the package is made of.

    Raises
    ------
    ReadBackError
        If a laser file, read again, is not what the job says.
    BadInputError
        If the recipe lacks an operation of the job.
    """
    job, profile, colours = content.job, content.profile, content.colours
    laser = _laser(content) if content.laser is None else content.laser
    files = {
        "README.txt": readme_text(content.design, job, profile, colours).encode(),
        "job.json": job_text(content.design, job, profile, colours).encode(),
        **laser,
        "preview.png": content.preview,
        **({ANIMATION_NAME: content.animation} if content.animation else {}),
        "checks.json": content.checks.encode(),
        "report.html": content.report,
        "bom.csv": bom_text(job, profile).encode(),
    }
    digests = {name: sha256_of(data) for name, data in files.items()}
    files[MANIFEST_NAME] = manifest_text(digests).encode()
    return files


def _laser(content: PackageContent) -> dict[str, bytes]:
    job, profile, colours = content.job, content.profile, content.colours
    hairline_mm = profile.machine.hairline_mm
    files = laser_files(job, colours, hairline_mm=hairline_mm, profile=profile)
    ensure_right(laser_file_problems(files, job, colours, profile))
    return files


def ensure_right(problems: Mapping[str, tuple[str, ...]]) -> None:
    """Raise ReadBackError if any laser file, read again, is not what the job says."""
    for name, found in problems.items():
        if found:
            raise ReadBackError(name, "; ".join(found))
