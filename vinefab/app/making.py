"""Verbs that make things: checks, fixes, laser files, coupons, recipes, rigs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from vinefab.app.common import (
    OutFolder,
    WrittenFolder,
    context_of,
    ensure_apart,
    file_of,
    folder_to_write,
    page_path,
    with_origin,
    write_page,
    write_shown,
)
from vinefab.core.atomic import ensure_writable, is_filled_in, write_bytes, write_folder
from vinefab.core.errors import BadInputError, ExportRefusedError, UnfitInputError, located
from vinefab.core.plain_text import counted
from vinefab.core.progress import phase
from vinefab.core.verbs import (
    IN_PLACE,
    FieldsOf,
    Force,
    Kind,
    ProgressLike,
    Within,
    also,
    this_call,
    told,
    verb,
    wrote,
)
from vinefab.model.files.shipped import DEFAULT_PRINTER, DEFAULT_RECIPE
from vinefab.model.inputs import (
    DESIGNS,
    FOLDER,
    PICTURE_ENDS,
    ContactsLike,
    DesignLike,
    DesignsLike,
    GrowthLike,
    LimitsLike,
    MapLike,
    MapsLike,
    PathText,
    RecipeLike,
    StartsLike,
    WordsLike,
    all_names,
    as_design,
    as_designs,
    as_growth,
    as_limits,
    as_map,
    as_maps,
    as_path,
    as_recipe,
    as_several,
    as_starts,
    name_or_path,
    several_numbers,
    written,
)

if TYPE_CHECKING:
    from vinefab.prediction.inflation_report import InflatedDesign

if TYPE_CHECKING:
    from collections.abc import Iterable

    from vinefab.fabrication.calibration.fit_recipe import Calibration
    from vinefab.model.finding import CheckReport
    from vinefab.prediction.fix_proposal import ProposedFix
    from vinefab.rig.part import Printer, RigOptions

    PrinterLike = Printer | str | PathLike[str]
    PicturesLike = str | PathLike[str] | Iterable[str | PathLike[str]]
else:
    PrinterLike = Annotated[object, Kind(metavar="PRINTER", files=partial(all_names, "printer"))]
    PicturesLike = Annotated[
        object, Kind(metavar="FILE", writes="file", ends=(*PICTURE_ENDS, ".dxf"), several=True)
    ]


def _refuse_without_maps(maps: MapsLike, **given: object) -> None:
    """Raise BadInputError for options that mean nothing without maps."""
    for name, value in given.items():
        if value and not as_several(maps):
            raise UnfitInputError(name, "means nothing without maps", "give maps too (--map)")


@verb
def check(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    maps: MapsLike = (),
    start: StartsLike = (),
    rig: Annotated[PathText | None, Kind(metavar="DIR")] = None,
    limits: LimitsLike | None = None,
    growth: GrowthLike | None = None,
    out: Annotated[PicturesLike | None, also("--svg", "--png", "--dxf")] = None,
    progress: ProgressLike = True,
    force: Force = False,
) -> CheckReport:
    """Check a design against the rules of making and deploying it.

    Rules about growth paths use deployments on each map from its starts (simulated); rules about
    corridors, heights and printed parts use the maps and the rig. The exit code of the command is 1
    if an error forbids cutting the design.

    Parameters
    ----------
    maps
        Maps or paths of map files; the design is deployed from their starts first (simulated).
    rig
        A folder that `rig` wrote.
    growth
        Growth options by name for the maps: body=centerline; there no pressure stops it.
    out
        The robot with the findings in place, to write: .svg or .png, or .dxf on layers that are not
        cut; one or several.

    Returns
    -------
    CheckReport
        All findings; ``blocking`` are those that stand in the way of cutting.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    UnknownNameError
        If there is no such design, recipe or rule.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab check three_level_tree --map grid.geojson --limit VF-C01.warning=6
    $ vinefab check grid_explorer --map grid.geojson --out findings.svg

    >>> check("plain_vine").blocking
    ()
    """
    from dataclasses import replace

    from vinefab.fabrication.checking import Deployed, check_design, deployed_lines, findings_file

    pictures = [as_path("out", one) for one in as_several(out)] if out is not None else []
    for path in pictures:
        ensure_writable(path, force=force)
    _refuse_without_maps(maps, growth=growth, start=as_starts(start))
    worlds = as_maps(maps, start)
    context = context_of(design, recipe=recipe, growth=growth if worlds else ...)
    (robot,), profile, changed = context.robots, context.recipe, as_limits(limits)
    facts = None
    if rig is not None:
        from vinefab.rig.part_files import read_rig

        facts = read_rig(as_path("rig", rig, "a folder that vinefab rig wrote"))
    with told(progress):
        deployed: Deployed = ()
        notes = list[str]()
        if worlds:
            from vinefab.growth.options import growth_text
            from vinefab.inflation.pattern import as_grown
            from vinefab.prediction.deploy import deploy_from_starts, growth_on_maps

            choice = growth_on_maps(robot, context.given)
            notes = [f"growth: {growth_text(choice.options, [robot])}", *choice.notes]
            deployed = deploy_from_starts(as_grown(robot), worlds, context.given)
            notes += deployed_lines(deployed)
        report = check_design(robot, profile, changed, deployed, worlds, facts)
        for path in pictures:
            write_page(path, findings_file(robot, profile, report, path), force=force)
    return replace(report, notes=tuple(notes))


@verb
def fix(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    maps: MapsLike = (),
    start: StartsLike = (),
    keep: WordsLike = (),
    limits: LimitsLike | None = None,
    growth: GrowthLike | None = None,
    out: Annotated[PathText | None, written(".toml")] = None,
    progress: ProgressLike = True,
    force: Force = False,
) -> ProposedFix:
    """Propose the smallest change of a design that clears its errors.

    Fillets are tried first, then widths, tapers, lengths and angles, fewer branches last. Where the
    design is written branch by branch, single branches are changed. The exit code of the command
    is 1 where errors are left.

    Parameters
    ----------
    maps
        As in `check`; with maps the ``summary`` gives the cost of the fix in score, too.
    keep
        What must not change: branches, length, angle, width, one or several.
    growth
        As in `check`.
    out
        Write the changed design here, if one was found.

    Returns
    -------
    ProposedFix
        The changed ``design``, None where nothing had to or could be changed, and its ``report``.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    UnknownNameError
        If there is no such design, recipe or rule.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab fix mine.toml --keep branches,length --map grid.geojson --out fixed.toml

    >>> fix("plain_vine").summary[-1]
    'fix: no errors, nothing to fix'
    """
    from dataclasses import replace

    from vinefab.model.design import design_text
    from vinefab.prediction.fix_proposal import propose_fix, score_change_lines
    from vinefab.search.fix_space import parsed_keeps

    file = page_path("out", out, force=force)
    if file is not None:
        ensure_apart("out", file, file_of("design", design), "the design itself")
    _refuse_without_maps(maps, growth=growth, start=as_starts(start))
    worlds = as_maps(maps, start)
    context = context_of(design, recipe=recipe, growth=growth if worlds else ...)
    (robot,), profile, given = context.robots, context.recipe, context.given
    changed, words = as_limits(limits), as_several(keep)
    for word in words:
        if not isinstance(word, str):
            raise BadInputError("keep", word, "a name")
    with told(progress):
        found = propose_fix(
            robot, profile, changed, worlds,
            growth=given, keep=parsed_keeps(words),
        )  # fmt: skip
        if found.design is not None:
            found = replace(
                found, cost=tuple(score_change_lines(robot, found.design, worlds, given))
            )
    if file is not None and found.design is not None:
        write_page(file, design_text(found.design), force=force)
    return found


@verb
def fabricate(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    out: OutFolder,
    allow_uncalibrated: bool = False,
    copies: Annotated[int, Within(1, 200)] = 1,
    beside: Annotated[DesignsLike, DESIGNS, also("--with")] = (),
    process: str = "auto",
    pass_through: bool = False,
    r12: bool = False,
    paper: str = "auto",
    make_zip: Annotated[bool, also("--zip")] = False,
    progress: ProgressLike = True,
    force: Force = False,
) -> WrittenFolder:
    """Write the fabrication package of a design: laser files, checks, report, instructions.

    The exit code of the command is 1 where a rule forbids the design.

    Parameters
    ----------
    allow_uncalibrated
        Write files for a recipe that no coupon has confirmed.
    copies
        How many robots to nest on one bed.
    beside
        Further designs for the same sheet.
    process
        weldcut (one pass), weld+cut, or auto: what the recipe has.
    pass_through
        Whether the film may be fed along the bed's width, and be longer than the bed.
    r12
        Also write a DXF of release 12, which knows no unit.
    paper
        a4 or letter: also write the pattern at 1:1 as PDF, on sheets of that paper. auto: on A4
        where people seal along lines that no machine marks, else not.
    make_zip
        Also write the folder as ``OUT.zip``.

    Returns
    -------
    WrittenFolder
        Its ``path``, its ``files`` and the ``report`` of the check.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    ExportRefusedError
        If a rule forbids the design, or the recipe is not calibrated; it carries the report.
    ForeignFileError
        If ``out`` holds something else.
    UnknownNameError
        If there is no such design or recipe.

    Examples
    --------
    $ vinefab fabricate three_level_tree --out package --allow-uncalibrated

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     made = fabricate("plain_vine", out=f"{folder}/vine", allow_uncalibrated=True)
    >>> "outline.dxf" in made.files
    True
    """
    from vinefab.fabrication.formats.laser_formats import broken_formats
    from vinefab.fabrication.job.placement import SheetOptions
    from vinefab.fabrication.package.prepare import PACKAGE_MARK, package, prepare, zip_bytes

    folder = folder_to_write("out", out, PACKAGE_MARK, force=force)
    archive = folder.with_name(f"{folder.name}.zip")
    if make_zip:
        ensure_writable(archive, force=force)
    others = tuple(as_designs(beside, "beside"))
    sheet = SheetOptions(copies=copies, beside=others, process=process, pass_through=pass_through)
    context = context_of(design, recipe=recipe)
    with told(progress):
        prepared = prepare(context.robots[0], context.recipe, sheet=sheet, r12=r12, paper=paper)
        reports = (prepared.report, *prepared.beside)
        lines = [line for report in reports for line in report.summary]
        lines += broken_formats()
        if why := prepared.refusal(allow_uncalibrated=allow_uncalibrated):
            holds = f"; {folder} still holds an earlier package, not this design"
            older = holds if (folder / PACKAGE_MARK).is_file() else ""
            raise ExportRefusedError(
                prepared.design.name, why + older, prepared.report, summary=tuple(lines)
            )
        files = package(prepared)
    if isinstance(prepared.folded, str):
        lines.append(f"note: no fold table for lay-flat tubing: {prepared.folded}")
    write_folder(folder, files, PACKAGE_MARK, force=force)
    if make_zip:
        write_bytes(archive, zip_bytes(files, prepared.design.name), force=force)
        wrote(archive)
    elif archive.exists():
        lines.append(f"note: {archive} is from an earlier run; --zip replaces it")
    wrote(folder, f"/ ({counted(len(files), 'file')}; begin with README.txt)")
    return WrittenFolder(
        path=folder, files=tuple(files), report=prepared.report, summary=tuple(lines)
    )


def _refused(name: str, report: CheckReport) -> ExportRefusedError:
    """Return the error that says which rules forbid what was checked."""
    rules = ", ".join(sorted({finding.rule for finding in report.blocking}))
    return ExportRefusedError(name, f"{rules} forbid it", report, summary=report.summary)


@verb
def coupon(
    recipe: RecipeLike = DEFAULT_RECIPE,
    *,
    out: Annotated[PathText, FOLDER],
    progress: ProgressLike = True,
    force: Force = False,
) -> WrittenFolder:
    """Write test pieces for a recipe: laser files, what to measure, and a table to fill in.

    Parameters
    ----------
    recipe
        A recipe's name or path, in Python also a laser profile.
    out
        The folder to write; ``README.txt`` in it lists the steps, ``results.csv`` is the table.
    force
        Overwrite what vinefab did not write, and a table that was filled in.

    Returns
    -------
    WrittenFolder
        Its ``path``, its ``files`` and the ``report`` of the check.

    Raises
    ------
    BadInputError
        If a value cannot be used, or a coupon is larger than the machine's bed.
    ExportRefusedError
        If a rule forbids the coupons; it carries the report.
    ForeignFileError
        If ``out`` holds something else, or its table was filled in.
    UnknownNameError
        If there is no such recipe.

    Examples
    --------
    $ vinefab coupon --recipe co2_60w__stretchlon_200 --out coupons

    >>> coupon("co2_60w__stretchlon_200", out="coupons")  # doctest: +SKIP
    """
    from vinefab.fabrication.calibration.coupon_package import (
        COUPON_MARK,
        RESULTS_NAME,
        coupon_files,
        make_coupons,
    )
    from vinefab.fabrication.formats.laser_formats import broken_formats

    folder = folder_to_write("out", out, COUPON_MARK, force=force)
    with told(progress):
        made = make_coupons(as_recipe(recipe))
        if made.report.blocking:
            raise _refused("coupons", made.report)
        files = coupon_files(made)
    kept = list[str]()
    if is_filled_in(folder / RESULTS_NAME, files, force=force):
        kept = [f"{folder} is as this call writes it; {RESULTS_NAME}, filled in, is kept"]
    else:
        write_folder(folder, files, COUPON_MARK, force=force)
        wrote(folder, f"/ ({counted(len(files), 'file')}; begin with README.txt)")
    return WrittenFolder(
        path=folder,
        files=tuple(files),
        report=made.report,
        summary=(*made.report.summary, *broken_formats(), *kept),
    )


@verb
def calibrate(
    results: Annotated[PathText, Kind(metavar="RESULTS")],
    recipe: Annotated[
        PathText, Kind(metavar="RECIPE", files=partial(all_names, "recipe"))
    ] = DEFAULT_RECIPE,
    *,
    out: PathText,
    contacts: PathText | None = None,
    progress: ProgressLike = True,
    force: Force = False,
) -> Calibration:
    """Fit kerf, seam, shrinkage, burst loads, friction, growth pressure; write a recipe with them.

    Parameters
    ----------
    results
        The table that `coupon` wrote, filled in.
    recipe
        The recipe that the coupons were cut with, its name or path.
    out
        The recipe to write, ``NAME.toml``: what is returned can be passed as ``recipe``.
    contacts
        The file of measured contacts that gets the share of children that came out of their
        parent's tip; its other numbers stay.

    Returns
    -------
    Calibration
        The recipe's ``path``, the fitted numbers (measured) as ``summary`` and as ``numbers``.

    Raises
    ------
    BadInputError
        If the table or a value in it cannot be used.
    ForeignFileError
        If ``out`` is something else.
    UnknownNameError
        If there is no such recipe.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab calibrate coupons/results.csv --recipe co2_60w__stretchlon_200 --out my_recipe.toml

    >>> mine = calibrate("coupons/results.csv", out="mine.toml")  # doctest: +SKIP
    >>> fabricate("plain_vine", mine, out="package")  # doctest: +SKIP
    """
    from vinefab.fabrication.calibration.coupons import read_results
    from vinefab.fabrication.calibration.fit_recipe import calibrated_recipe, fitted_recipe
    from vinefab.model.contacts import contacts_with
    from vinefab.model.laser import read_profile

    path, table = as_path("out", out), as_path("results", results)
    ensure_writable(path, force=force)
    shares = None if contacts is None else as_path("contacts", contacts)
    if shares is not None:
        ensure_writable(shares, force=force)
    before = name_or_path("recipe", recipe, "a recipe's path or name", "recipe")
    profile = read_profile(before)
    with told(progress), phase("recipe fitted to the coupons"), located(table):
        found = fitted_recipe(read_results(table), profile)
        if shares is not None and found.emergence is None:
            problem = "the table has no row children_out with a value"
            raise UnfitInputError("contacts", problem, "count the children that came out")
    write_page(path, calibrated_recipe(found, before, path, table), force=force)
    if shares is not None and found.emergence is not None:
        write_page(shares, contacts_with(shares, found.emergence), force=force)
    return replace(found, path=path)


@verb
def rig(
    world: Annotated[MapLike | None, also("--map"), IN_PLACE] = None,
    printer: PrinterLike = DEFAULT_PRINTER,
    *,
    out: OutFolder,
    start: StartsLike = (),
    design: DesignLike | None = None,
    fit_mm: float | None = None,
    sheet_mm: Annotated[tuple[float, float] | None, several_numbers("WIDTH,DEPTH")] = None,
    lid: bool = False,
    base: bool = False,
    contact_test: bool = False,
    contacts: ContactsLike | None = None,
    allow_empty: bool = False,
    pictures: bool = True,
    progress: ProgressLike = True,
    force: Force = False,
    **sizes: Annotated[
        Any,
        FieldsOf(("vinefab.rig.part:RigOptions",), also={"entry_width_mm": ("--entry-mm",)}),
    ],
) -> WrittenFolder:
    """Write a map as a test rig: printable solids, sheets for the laser, pictures, ``rig.json``.

    Parameters
    ----------
    world
        A map, or the path of a map file; none with ``contact_test``.
    printer
        A printer's name or path, in Python also a printer.
    design
        The robot that will be tried on it: its corridors and heights are checked too.
    fit_mm
        Length of the rig's longer side; sets the scale.
    sheet_mm
        Width and depth of the laser's sheets; short for two sizes.
    lid
        Add a transparent lid (DXF).
    base
        Add a printed base for the robot: tube, chamber and lid, clamped by the holder.
    contact_test
        In place of a map, walls that are met at 5 to 40 degrees from head-on, on one bed, with a
        table to fill in for `fit_observations`.
    contacts
        Measured contacts, whose surfaces the rig may name.
    allow_empty
        Make a bare tray of a map without anything to steer around.
    pictures
        Draw the rig and its beds, and write a page about them.
    **sizes
        Such as ``style="board"``, ``height_mm``, ``plate_mm``, ``scale``; all of them:
        `vinefab.rig.part.RigOptions`.

    Returns
    -------
    WrittenFolder
        Its ``path``, its ``files`` and the ``report`` of the rules about rigs.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    ExportRefusedError
        If a rule forbids the rig; it carries the report.
    ForeignFileError
        If ``out`` holds something else.
    UnknownNameError
        If there is no such printer or design.

    Examples
    --------
    $ vinefab rig grid.geojson --printer generic_220 --fit-mm 400 --out rig
    $ vinefab rig --contact-test --surface grey_pla --printer generic_220 --out coupon

    >>> from vinefab import maps
    >>> made = rig(maps.pegs(seed=4), "generic_220", out="rig", fit_mm=300)  # doctest: +SKIP
    """
    from vinefab.core.limits import number
    from vinefab.model.contacts import surface_known
    from vinefab.rig.make import RIG_MARK, RigRequest, make_rig
    from vinefab.rig.part import RigOptions
    from vinefab.rig.rig_plan import refuse_fine

    if sheet_mm is not None:
        sizes |= {"sheet_width_mm": sheet_mm[0], "sheet_depth_mm": sheet_mm[1]}
    options = RigOptions(**sizes)
    if contact_test:
        return _contact_test(_printer_of(printer), out, options, pictures, progress, force=force)
    if world is None:
        raise UnfitInputError("map", "is missing", "give a map file, or --contact-test")
    folder = folder_to_write("out", out, RIG_MARK, force=force)
    place, machine = as_map(world, "world", start), _printer_of(printer)
    if isinstance(world, str | PathLike):
        refuse_fine(place, Path(world))
    named = options.surface or place.surface
    if named:
        given = as_growth(None, contacts=contacts).get("contacts")
        options = options.changed(surface=surface_known(named, given).surface)
    request = RigRequest(
        design=None if design is None else as_design(design),
        allow_empty=allow_empty,
        pictures=pictures,
        lid=lid,
        base=base,
    )
    with told(progress):
        if fit_mm is not None:
            options = options.fitted(place, number("fit_mm", fit_mm, 0.0, 1e6, "mm"))
        made = make_rig(place, machine, options, request)
    if made.report.blocking:
        raise _refused(f"rig of {place.name}", made.report)
    write_folder(folder, made.files, RIG_MARK, force=force)
    wrote(folder, f"/ ({counted(len(made.files), 'file')})")
    return WrittenFolder(
        path=folder, files=tuple(made.files), report=made.report, summary=made.summary
    )


def _printer_of(printer: PrinterLike) -> Printer:
    """Return a printer, passed as such, or by its name or path."""
    from vinefab.rig.part import Printer, read_printer

    if isinstance(printer, Printer):
        return printer
    allowed = f"a Printer, a path, or one of {', '.join(all_names('printer'))}"
    return read_printer(name_or_path("printer", printer, allowed, "printer"))


_OF_CONTACT_TESTS = {"contact_test", "printer", "out", "pictures", "progress", "force"}
"""Parameters of `rig` that mean something without a map, with the sizes of a rig."""


def _contact_test(
    printer: Printer,
    out: PathText,
    options: RigOptions,
    pictures: bool,  # noqa: FBT001  as the verb was given them
    progress: ProgressLike,
    *,
    force: bool,
) -> WrittenFolder:
    """Write the contact coupon: its rig, a table to fill in, instructions."""
    from vinefab.observation.surface_fit import UNNAMED
    from vinefab.rig.contact_test import (
        CONTACTS_NAME,
        contact_files,
        contact_map,
        contact_options,
        strip_design,
    )
    from vinefab.rig.make import RIG_MARK, RigRequest, make_rig

    for name, value in this_call().changed.items():
        if name not in _OF_CONTACT_TESTS and name not in type(options).model_fields and value:
            raise UnfitInputError(name, "goes with a map", "leave it out of the contact test")
    folder = folder_to_write("out", out, RIG_MARK, force=force)
    surface = options.surface or UNNAMED
    options = contact_options(printer, options.changed(surface=surface))
    world = contact_map()  # its surface is not measured yet: a map cannot name it
    with told(progress):
        request = RigRequest(design=strip_design(), pictures=pictures, extras=False)
        made = make_rig(world, printer, options, request)
        if made.report.blocking:
            raise _refused("contact test", made.report)
        files = {**made.files, **contact_files(surface, world)}
    kept = f"{folder} is as this call writes it; {CONTACTS_NAME}, filled in, is kept"
    if is_filled_in(folder / CONTACTS_NAME, files, force=force):
        return WrittenFolder(
            path=folder, files=tuple(files), report=made.report, summary=(*made.summary, kept)
        )
    write_folder(folder, files, RIG_MARK, force=force)
    wrote(folder, f"/ ({counted(len(files), 'file')}; begin with README.txt)")
    return WrittenFolder(path=folder, files=tuple(files), report=made.report, summary=made.summary)


# --- The verb that puts a design's pattern under pressure -----------------------------------------


@verb
def inflate(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    alone: bool = False,
    free: bool = False,
    across: Annotated[int, Within(4, 32)] = 8,
    out: Annotated[PathText | None, written(".html", ".htm", *PICTURE_ENDS)] = None,
    mesh: Annotated[PathText | None, written(".stl", ".obj", ".3mf", ".ply")] = None,
    progress: ProgressLike = True,
    force: Force = False,
) -> InflatedDesign:
    """Show the shape that a design's flat pattern takes under pressure (simulated).

    The pattern is the one that is cut: with ``[build] compensation = "inflation"`` its angles and
    lengths are those that deploy as designed, with "none" they are the designed ones.

    Parameters
    ----------
    alone
        Leave out the other choice of compensation, which takes as long again.
    free
        Simulate each joint without floor and lid too: joints of stiff film bow. For studies.
    across
        Triangles across a tube, an even number; more are slower and finer.
    out
        A page or a picture to write.
    mesh
        The deployed body to write for 3-D viewers, a closed surface in mm.

    Returns
    -------
    InflatedDesign
        The ``robot`` under pressure, the ``pattern``, ``tip_errors_mm``, the ``surface``, and a
        ``summary`` in lines.

    Raises
    ------
    BadInputError
        If a value cannot be used, a joint cannot be solved, or the pattern crosses itself.
    ForeignFileError
        If a file to write is something else.
    UnknownNameError
        If there is no such design or recipe.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab inflate three_level_tree --out inflated.html --mesh inflated.stl

    >>> found = inflate("plain_vine", alone=True)
    >>> found.robot.ends_mm.shape
    (1, 2)
    """
    from vinefab.prediction.inflation_report import inflate_design

    page = page_path("out", out, force=force)
    solid = page_path("mesh", mesh, force=force)
    if across % 2:
        raise BadInputError("across", across, "an even number")
    context = context_of(design, recipe=recipe)
    (robot,), profile = context.robots, context.recipe
    with told(progress):
        found = inflate_design(robot, profile, alone=alone, free=free, across=across)
    found = with_origin(found, [robot], [], profile)
    write_shown(page, found, force=force)
    if solid is not None:
        write_page(solid, found.mesh(solid.suffix), force=force)
    return found
