"""Check a design against the rules, and draw the findings."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import ReadBackError
from vinefab.core.front_door import imported_later
from vinefab.core.plain_text import counted
from vinefab.fabrication.findings_picture import annotated_job, findings_picture
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.pieces.partition import in_pieces, pieces_of
from vinefab.fabrication.rules.catalog import (
    RULES,
    concerns,
    flat_rules,
    merged_reports,
    run_checks,
)
from vinefab.fabrication.rules.rule import Corridor, LimitChanges, MapCorridors, RigFacts, Subject
from vinefab.inflation.pattern import Pattern, cut_design, pattern_of
from vinefab.maps.passages import narrow_passages
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.finding import CheckReport, RuleSkipped
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map
from vinefab.pages.plan import page_bytes
from vinefab.physics.tube import inflated_diameter_mm

if TYPE_CHECKING:
    from vinefab.fabrication.formats import dxf_format, laser_drawing
else:  # ezdxf takes long to load
    dxf_format = imported_later("vinefab.fabrication.formats.dxf_format")
    laser_drawing = imported_later("vinefab.fabrication.formats.laser_drawing")

MANY_BRANCHES = 1500
"""The paths of larger designs take long: they are made only where nothing else forbids cutting."""


def map_corridors(world: Map, design: Design) -> MapCorridors:
    """Return the narrowest corridors of a map for a design."""
    return corridors_in(world, world.free_space, design)


def corridors_in(
    world: Map, free: BaseGeometry, design: Design, scale: float = 1.0, name: str = ""
) -> MapCorridors:
    """Return the narrowest corridors of a map's free space, or of its rig's, for a design.

    Parameters
    ----------
    free
        In map coordinates.
    scale
        Millimetres of the rig per millimetre of the map.
    name
        What it is called; the map's name if empty.
    """
    bodies_mm = [inflated_diameter_mm(one.width_mm) / scale for one in design.tubes]
    starts_mm = [(start.pose.x_mm, start.pose.y_mm) for start in world.starts]
    # Most corridors of a map that are checked for the widest branch, narrowest first.
    most_corridors = 50
    return MapCorridors(
        name=name or world.name,
        corridors=tuple(
            Corridor(
                width_mm=scale * passage.width_mm,
                x_mm=passage.middle_mm[0],
                y_mm=passage.middle_mm[1],
                dead_end_mm=scale * passage.dead_end_mm,
            )
            for passage in narrow_passages(free, most_corridors, bodies_mm, starts_mm)
        ),
    )


Deployed = tuple[tuple[str, Deployment], ...]
"""Deployments, each with the name of its map."""


def check_design(
    design: Design,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    deployed: Deployed = (),
    maps: Sequence[Map] = (),
    rig: RigFacts | None = None,
) -> CheckReport:
    """Return the report of all rules on a design.

    Parameters
    ----------
    limits
        Limits that override those of recipe and design.
    deployed
        Simulated deployments, for rules about growth paths.
    maps
        Maps whose corridors the robot must pass.
    rig
        A test rig, for the rules about its parts.
    """
    corridors = tuple(map_corridors(world, design) for world in maps)
    return checked_design(design, profile, limits, deployed, corridors, rig)[1]


def checked_design(
    design: Design,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    deployed: Deployed = (),
    corridors: tuple[MapCorridors, ...] = (),
    rig: RigFacts | None = None,
) -> tuple[Subject, CheckReport]:
    """Return the subject of the rules, its laser job included, and the report of all rules.

    A large design has no job where anything else forbids cutting it.
    """
    if design.branch_count <= MANY_BRANCHES:
        subject = subject_of(design, profile, deployed, limits)
        subject = replace(subject, corridors=corridors, rig=rig)
        return subject, run_checks(subject, limits)
    flat = _flat_subject(design, profile, deployed)
    flat = replace(flat, profile=profile, corridors=corridors, rig=rig)
    report = run_checks(flat, limits, only=flat_rules())
    others = [
        rule
        for rule in (*RULES, *RULES.broken)
        if rule not in flat_rules() and concerns(rule, flat.design)
    ]
    if not report.blocking:
        subject = replace(flat, job=laser_job(flat.design, profile))
        return subject, merged_reports(report, run_checks(subject, limits, only=others))
    reason = (
        f"not looked at: the paths of {counted(flat.design.branch_count, 'branch')} take long, and "
        "what was found forbids cutting them"
    )
    skipped = (*report.skipped, *(RuleSkipped(rule=rule, reason=reason) for rule in others))
    # A waiver may be of a finding that was not looked for.
    return flat, replace(report, skipped=skipped, stale_waivers=())


def subject_of(
    design: Design,
    profile: LaserProfile | None,
    deployed: Deployed = (),
    limits: LimitChanges | None = None,
    pattern: Pattern | None = None,
) -> Subject:
    """Return the subject of the rules: the design in its pieces, deployments with maps' names.

    Designs with more than `MANY_BRANCHES` branches are not looked at in pieces.

    Parameters
    ----------
    pattern
        The design's, where it is known; else its joints are simulated.
    """
    flat = _flat_subject(design, profile, deployed, pattern)
    if profile is None:
        return flat
    design = flat.design
    if flat.pattern is None or design.branch_count > MANY_BRANCHES:
        partition = None
    else:
        partition = pieces_of(flat.pattern, profile, limits)
    made = replace(flat, profile=profile, job=laser_job(design, profile, partition=partition))
    return in_pieces(made, partition) if partition else made


def _flat_subject(
    design: Design,
    profile: LaserProfile | None,
    deployed: Deployed,
    pattern: Pattern | None = None,
) -> Subject:
    """Return the flat tree that a design is cut as, without paths.

    With a recipe it is compensated, if the design asks for it, and its joints are known.
    """
    if pattern is None and profile is not None:
        pattern = pattern_of(design, profile)
    names, deployments = tuple(name for name, _ in deployed), tuple(d for _, d in deployed)
    cut = pattern.flat if pattern else design
    made = Subject.of(cut, deployments=deployments, map_names=names)
    return replace(made, pattern=pattern)


def findings_drawing(design: Design, profile: LaserProfile, report: CheckReport) -> Job:
    """Return a drawing of the outline on the sheet with a marker per finding; not to be cut."""
    return annotated_job(laser_job(cut_design(design, profile), profile), report.findings)


def findings_file(design: Design, profile: LaserProfile, report: CheckReport, path: Path) -> bytes:
    """Return the findings in place, as the DXF, SVG, PNG or PDF that a path's name asks for."""
    if path.suffix.lower() == ".dxf":
        spec = laser_drawing.LaserFileSpec(job=findings_drawing(design, profile, report))
        text = dxf_format.DXF.write(spec)
        problems = laser_drawing.file_problems(dxf_format.DXF, text.encode(), spec)
        if problems:
            raise ReadBackError(path, problems[0])
        return text.encode()
    return page_bytes(findings_picture(cut_design(design, profile), profile, report), path.suffix)


def deployed_lines(deployed: Deployed) -> list[str]:
    """Return one line for each deployment: how far it got."""
    return [
        f"deployed on {name}: {int(found.deployed.sum())} of {counted(len(found.tree), 'branch')}, "
        f"{found.grown_mm.sum() / found.tree.total_length_mm:.0%} of their length (simulated)"
        for name, found in deployed
    ]
