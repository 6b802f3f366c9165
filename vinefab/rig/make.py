"""From a map to the files of its rig: built, compared with the map, checked, written, read back."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import shapely

from vinefab.core.errors import BadInputError, ReadBackError
from vinefab.core.hashing import sha256_of
from vinefab.fabrication.checking import corridors_in
from vinefab.fabrication.rules.catalog import run_rig_checks
from vinefab.fabrication.rules.rig_rules import RigSubject
from vinefab.fabrication.rules.subject import MapCorridors, RigFacts, RigPartFacts
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.rig.build import LoosePiece, build_board, build_rig, refuse_early
from vinefab.rig.comparison_with_map import compare_with_map, footprints
from vinefab.rig.fixtures import with_fixtures
from vinefab.rig.laser_cut import laser_jobs, sheet_file
from vinefab.rig.page import RigFiles, rig_pictures, true_scale_files
from vinefab.rig.part import Rig
from vinefab.rig.part_files import part_files, part_problems
from vinefab.rig.printing import printing_of
from vinefab.rig.rig_json import RIG_NAME, parts_text, rig_text
from vinefab.rig.rig_options import Printer, RigOptions
from vinefab.rig.rig_plan import RigPlan, plan_of
from vinefab.rig.split import usable_mm

RIG_MARK = RIG_NAME

MOST_DIFFERENCE = 1e-3
"""Largest share of the walls by which an assembled rig may differ from its map."""

_CONVEX = 1e-9
_STYLE_WORDS = {"plate": "tiles of a plate", "board": "loose pieces on a board"}

ProgressCallback = Callable[[float, str], None]
"""Called with the share of the work that is done, 0 to 1, and the next step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigRequest:
    """Choices about a rig's files, apart from its sizes."""

    design: Design | None = None  # robot for the rules about corridors and heights
    allow_empty: bool = False  # accept a map without obstacles: a bare tray
    pictures: bool = True  # draw the plan and sheets, and write report.html
    lid: bool = False  # add a lid, to be cut from a transparent sheet


def make_rig(
    world: Map,
    printer: Printer,
    options: RigOptions,
    request: RigRequest | None = None,
    *,
    progress: ProgressCallback | None = None,
) -> RigFiles:
    """Make a map's rig and all its files.

    Raises
    ------
    BadInputError
        If the map has no obstacles (unless the request allows it), or the rig does not fit the
        printer, its options or the number of parts.
    ReadBackError
        If a file, read back, or the assembled rig differs from what it has to be.
    """
    request = request or RigRequest()
    tell = progress or (lambda _, __: None)
    bounds = world.bounds
    walled = bounds.area < bounds.convex_hull.area * (1.0 - _CONVEX)
    solid = walled or any(obstacle.intersects(bounds) for obstacle in world.obstacles)
    if not (solid or request.allow_empty):
        allowed = "at least one in the bounds, or bounds with a corner to go around; --allow-empty"
        key = f"map {world.name}: number of obstacles"
        raise BadInputError(key, 0, f"{allowed} makes a bare tray")
    tell(0.0, "building solids")
    rig, pieces, why_style = _built(world, printer, options)
    rig, fixtures = with_fixtures(rig, world, request.design)
    jobs = laser_jobs(rig, pieces, fixtures.board, lid=request.lid)
    sheets = {name: sheet_file(name, job) for name, job in jobs.items()}
    tell(0.25, "comparing with the map")
    comparison = compare_with_map(rig, world)
    if comparison.share > MOST_DIFFERENCE:
        problem = f"assembled, its walls differ from the map by {100 * comparison.share:.3f} %"
        raise ReadBackError(f"rig of {world.name}", problem)
    printing = printing_of(rig)
    tell(0.35, "writing and reading back")
    files = part_files(rig, printing)
    problems = part_problems(files, rig, printing)
    facts = RigFacts(
        name=rig.name,
        printer=rig.printer.name,
        room_mm=(*usable_mm(rig.printer, rig.options), rig.printer.height_mm),
        height_mm=rig.options.height_mm,
        parts=tuple(
            RigPartFacts(name=part.name, size_mm=part.size_mm, problems=problems[part.name])
            for part in rig.printed
        ),
    )
    courses = tuple[MapCorridors, ...]()
    if request.design:  # the corridors as they will be printed, thickened walls included
        free = shapely.difference(shapely.Polygon(bounds.exterior), rig.walls)
        place = f"the rig of {world.name}"
        courses = (corridors_in(world, free, request.design, options.scale, place),)
    report = run_rig_checks(RigSubject(design=request.design, rig=facts, corridors=courses))
    made = RigFiles(
        rig=rig,
        world=world,
        printing=printing,
        comparison=comparison,
        report=report,
        jobs=jobs,
        why_style=why_style,
        fixtures=fixtures,
    )
    if report.blocking:
        return made
    files |= sheets | true_scale_files(rig, world, fixtures, pieces)
    if request.pictures:
        tell(0.5, "drawing the plan")
        outlines = {piece.number: rig.on_map(piece.outline) for piece in pieces} or footprints(rig)
        made = replace(made, pictures=rig_pictures(rig, world, outlines, jobs))
        files |= {**made.pictures, "report.html": made.page().encode()}
    files["parts.csv"] = parts_text(rig, printing).encode()
    digests = {name: sha256_of(data) for name, data in files.items()}
    files[RIG_NAME] = rig_text(made, digests).encode()
    return replace(made, files=files)


def _built(
    world: Map, printer: Printer, options: RigOptions
) -> tuple[Rig, tuple[LoosePiece, ...], str]:
    """Return a rig in the style of its options, its loose pieces, and why it has this style."""
    if options.style != "auto":
        return *_in_style(world, printer, options), f"style {options.style}: as asked for"
    refuse_early(world, printer, options)
    plan = plan_of(world, printer, options)  # the same for both styles
    made: dict[str, tuple[Rig, tuple[LoosePiece, ...]]] = {}
    refused: dict[str, BadInputError] = {}
    for style in ("plate", "board"):
        try:
            made[style] = _in_style(world, printer, options.changed(style=style), plan)
        except BadInputError as error:
            refused[style] = error
    if not made:
        raise refused["plate"]
    takes = {style: printing_of(rig).total for style, (rig, _) in made.items()}
    chosen = min(takes, key=lambda style: takes[style].time_s)
    other = "plate" if chosen == "board" else "board"
    if other in takes:
        why = (
            f"style {chosen}, {_STYLE_WORDS[chosen]}, is the quicker to print: "
            f"{takes[chosen].words()}; style {other}, {_STYLE_WORDS[other]}: "
            f"{takes[other].words()} (estimates, without markers and holder)"
        )
    else:
        why = f"style {chosen}: {_STYLE_WORDS[chosen]}; style {other} was refused: {refused[other]}"
    return *made[chosen], why


def _in_style(
    world: Map, printer: Printer, options: RigOptions, plan: RigPlan | None = None
) -> tuple[Rig, tuple[LoosePiece, ...]]:
    """Return a rig, and its loose pieces if it has any."""
    if options.style == "plate":
        return build_rig(world, printer, options, plan), ()
    return build_board(world, printer, options, plan)
