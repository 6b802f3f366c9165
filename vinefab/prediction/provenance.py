"""The section on how to get the same report again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vinefab.core.hashing import sha256_of
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_text
from vinefab.model.laser import LaserProfile
from vinefab.pages.html import Section, Table
from vinefab.prediction.map_families import MapFamily
from vinefab.search.record.result import map_fingerprint, package_versions

MOST_NAMED = 12
"""Maps of a field are listed one by one up to so many."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """What it takes to get a result again."""

    command: str  # what to type
    inputs: Mapping[str, str]  # fingerprints of the contents that went in, by name
    versions: Mapping[str, str]  # versions of what computed it


def origin_of(
    command: str,
    designs: Sequence[Design],
    profile: LaserProfile | None,
    fields: Sequence[MapFamily],
) -> Origin:
    """Return where a result comes from."""
    inputs = {f"design {d.name}": sha256_of(design_text(d).encode())[:12] for d in designs}
    if profile is not None:
        inputs[f"recipe {profile.recipe.name}"] = sha256_of(repr(profile).encode())[:12]
    for field in fields:
        prints = [map_fingerprint(world) for world in field.worlds]
        if len(prints) <= MOST_NAMED:
            inputs |= {
                f"map {index}: {world.name}": found
                for index, (world, found) in enumerate(zip(field.worlds, prints, strict=True), 1)
            }
        else:
            inputs[field.label] = sha256_of("".join(prints).encode())[:12]
    return Origin(command=command, inputs=inputs, versions=package_versions())


def repeat_section(command: str, inputs: Mapping[str, str], versions: Mapping[str, str]) -> Section:
    """Return the command, the inputs' fingerprints and the versions behind a report."""
    return Section(
        title="How to reproduce",
        paragraphs=(
            "The same command with the same inputs and versions gives the same file, byte for "
            "byte; results do not depend on the computer beyond rounding.",
        ),
        code=command,
        tables=(
            Table(
                caption="Fingerprints of what went in (SHA-256, shortened)",
                headings=("input", "fingerprint"),
                rows=tuple(inputs.items()),
            ),
            Table(
                caption="Versions",
                headings=("program", "version"),
                rows=tuple(versions.items()),
            ),
        ),
    )
