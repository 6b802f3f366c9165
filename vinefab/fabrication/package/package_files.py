"""The fabrication package: all that is needed to cut one design, as a folder and a zip."""

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.core.errors import ReadBackError
from vinefab.core.hashing import MANIFEST_NAME, manifest_text, sha256_of
from vinefab.core.jsontext import GENERATOR
from vinefab.fabrication.formats.laser_drawing import DEFAULT, Colours
from vinefab.fabrication.formats.laser_files import laser_file_problems, laser_files
from vinefab.fabrication.package.bom import bom_text
from vinefab.fabrication.package.job_json import job_text
from vinefab.fabrication.package.readme_text import readme_text
from vinefab.model.design import Design
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile

_FIRST_DATE = (1980, 1, 1, 0, 0, 0)
_UNIX = 3
_PLAIN_FILE = 0o100644 << 16


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
        archive.comment = GENERATOR.encode()
    return stream.getvalue()


ANIMATION_NAME = "animation.svg"


PACKAGE_MARK = "job.json"
"""The file by which the folder of a package is known again."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PackageContent:
    """What a package is made of."""

    design: Design  # what is made
    profile: LaserProfile  # machine, material and recipe
    job: Job  # the paths
    checks: str  # text of checks.json (`vinefab.fabrication.rules.run_rules.checks_text`)
    preview: bytes  # A picture of the job, PNG
    report: bytes  # the report, HTML
    animation: bytes = b""  # the laser's path in motion, SVG; empty for none
    colours: Colours = DEFAULT  # layers and colours
    # laser files that were read again and found right; None to write them here
    laser: Mapping[str, bytes] | None = None


def package_files(content: PackageContent) -> dict[str, bytes]:
    """Return the files of a package by name, the laser files read again and found right."""
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
