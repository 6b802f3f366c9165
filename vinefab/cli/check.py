"""``vinefab check``: the design rules."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    EXIT_FINDINGS,
    CommandOutput,
    DesignIn,
    DesignRecipeIn,
    Force,
    GrowthIn,
    JsonOut,
    Quiet,
    StartIn,
    ensure_apart,
    ensure_kind,
    growth_choice,
    growth_from,
    started_maps,
)
from vinefab.core.atomic import ensure_writable, write_bytes, write_text
from vinefab.core.errors import BadInputError
from vinefab.fabrication.checking import (
    Deployed,
    check_design,
    deployed_lines,
    findings_file,
)
from vinefab.fabrication.rules.catalog import parsed_limits
from vinefab.fabrication.rules.fix import parsed_keeps
from vinefab.fabrication.rules.subject import RigFacts
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_text, read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.model.files.shipped import locate
from vinefab.model.map import Map
from vinefab.prediction.fix_proposal import FixProposal, propose_fix, score_change_lines


def check_command(
    *,
    design: DesignIn,
    recipe: DesignRecipeIn = None,
    maps: Annotated[
        list[Path] | None,
        typer.Option(
            "--map", "--maps", help="Deploy the design on this map first; may be repeated."
        ),
    ] = None,
    start: StartIn = None,
    rig: Annotated[
        Path | None, typer.Option("--rig", help="A folder that vinefab rig wrote.")
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option("--limit", help="Override a limit: VF-C01.warning=6; may be repeated."),
    ] = None,
    svg: Annotated[
        Path | None,
        typer.Option("--svg", help="Draw the robot with the findings in place; not to be cut."),
    ] = None,
    png: Annotated[Path | None, typer.Option("--png", help="The same picture as a PNG.")] = None,
    dxf: Annotated[
        Path | None,
        typer.Option("--dxf", help="The findings on the sheet, on layers that are not cut."),
    ] = None,
    fix: Annotated[
        Path | None,
        typer.Option(
            "--fix",
            help="Write here the design with the smallest change that clears its errors: first "
            "fillets, then widths, tapers, lengths and angles, fewer branches last.",
        ),
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            "--keep",
            metavar="WHAT",
            help="What --fix must not change: branches, length, angle, width, with commas between "
            "them; may be repeated.",
        ),
    ] = None,
    growth: GrowthIn = None,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="List every rule.")] = False,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Check a design against the rules; exit code 1 if an error forbids cutting it.

    Rules about growth paths use deployments on each --map from its starts (simulated); rules about
    corridors, heights and printed parts use the --map and the --rig. With --fix, exit code 0 means
    that the design has no errors or a fixed design was written. With --map, it also says what the
    fix costs in score (simulated).

    Example: vinefab check three_level_tree --map grid.geojson --limit VF-C01.warning=6

    Example: vinefab check mine.toml --fix fixed.toml --keep branches,length --map grid.geojson
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    robot, limits = read_design(design), parsed_limits(limit or [])
    profile = output.recipe_of(robot, recipe).profile
    worlds, given = started_maps([read_map(p) for p in maps or []], start), growth_from(growth)
    _refuse_without_map(worlds, {"--growth": ", ".join(given), "--start": ", ".join(start or [])})
    kept = _kept(keep, fix)
    ensure_kind("--svg", svg, (".svg",), force=force)
    ensure_kind("--png", png, (".png",), force=force)
    ensure_kind("--dxf", dxf, (".dxf",), force=force)
    if fix is not None:
        ensure_apart("--fix", fix, locate("design", design), "the design itself")
        ensure_writable(fix, force=force)
    deployed: Deployed = ()
    grown = list[str]()
    if worlds:  # a check without maps must not wait for the simulator
        from vinefab.growth.options import growth_text  # noqa: PLC0415
        from vinefab.prediction.deploy import deploy_from_starts, growth_on_maps  # noqa: PLC0415

        growth_choice([design], [robot], given)
        choice = growth_on_maps(robot, given)
        grown = [f"growth: {growth_text(choice.options, [robot])}", *choice.notes]
        deployed = deploy_from_starts(robot, worlds, given)
    report = check_design(robot, profile, limits, deployed, worlds, _rig(rig))
    output.give_json(report.json_text())
    told = report.details if verbose else report.summary
    for line in [*grown, *deployed_lines(deployed), *told]:
        output.say(line)
    for path in (svg, png, dxf):
        if path is not None:
            content = findings_file(robot, profile, report, path)
            write_bytes(path, content, force=force)
            output.say(f"wrote {path}")
    if fix is None:
        return EXIT_FINDINGS if report.blocking else 0
    with output.progress("fixing") as progress:
        proposal = propose_fix(
            robot, profile, limits, worlds, lambda share: progress(share, ""),
            growth=given, keep=kept,
        )  # fmt: skip
    scores = partial(score_change_lines, robot, maps=worlds, growth=given)
    return _write_fix(output, proposal, scores, fix)


def _refuse_without_map(worlds: Sequence[Map], options: Mapping[str, str]) -> None:
    for option, given in options.items():
        if given and not worlds:
            raise BadInputError(option, given, "to be given together with --map")


def _kept(texts: list[str] | None, fix: Path | None) -> frozenset[str]:
    """Return what a fix must keep; without a fix there is nothing to keep."""
    kept = parsed_keeps(texts or [])
    if kept and fix is None:
        raise BadInputError("--keep", ",".join(sorted(kept)), "to be given together with --fix")
    return kept


def _write_fix(
    output: CommandOutput,
    proposal: FixProposal,
    scores: Callable[[Design], list[str]],
    fix: Path,
) -> int:
    """Report the proposal, write its design if there is one, and return the exit code."""
    for line in proposal.lines():
        output.say(line)
    if proposal.design is None or proposal.after is None:
        return EXIT_FINDINGS if proposal.failed else 0
    for line in [*scores(proposal.design), proposal.after.verdict]:
        output.say(line)
    write_text(fix, design_text(proposal.design), force=output.force)
    output.say(f"wrote {fix}")
    return 0


def _rig(folder: Path | None) -> RigFacts | None:
    """Return the rig in a folder, if any."""
    if folder is None:
        return None
    # Reading solids loads modules that a check without a rig does not need.
    from vinefab.rig.rig_json import read_rig  # noqa: PLC0415

    return read_rig(folder)
