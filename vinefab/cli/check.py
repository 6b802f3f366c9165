"""``vinefab check``: the design rules."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.checks.limits import parsed_limits
from vinefab.cli.options import EXIT_FINDINGS, DesignIn, Force, JsonOut, Quiet, RecipeIn, Voice
from vinefab.export.checks_json import checks_text
from vinefab.files.design import read_design
from vinefab.files.map import read_map
from vinefab.files.profile import read_profile
from vinefab.files.shipped import DEFAULT_RECIPE
from vinefab.model.rigfacts import RigFacts
from vinefab.pipeline.check import check, check_lines, deploy_from_starts, deployed_lines


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("check")(check_command)


def check_command(
    *,
    design: DesignIn,
    recipe: RecipeIn = DEFAULT_RECIPE,
    maps: Annotated[
        list[Path] | None,
        typer.Option("--map", "--maps", help="Deploy it on this map first; may be repeated."),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option("--rig", help="A folder that vinefab rig wrote.")
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option("--limit", help="Another limit: VF-C01.warning=6; may be repeated."),
    ] = None,
    body: Annotated[str, typer.Option(help="On maps: centerline or inflated.")] = "inflated",
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="List every rule.")] = False,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Check a design against the rules; exit code 1 when an error stands in the way of cutting.

    Rules about paths take the way through each --map from its starts (simulated); those about
    corridors, heights and printed parts look at the --map and the --rig.

    Example: vinefab check three_level_tree --map cave.geojson --limit VF-C01.warning=6
    """
    voice = Voice(quiet=quiet, json_out=json_out, force=force)
    robot, profile, limits = read_design(design), read_profile(recipe), parsed_limits(limit or [])
    worlds = [read_map(path) for path in maps or []]
    deployed = deploy_from_starts(robot, worlds, body)
    report = check(robot, profile, limits, deployed, worlds, _rig(rig))
    voice.give_json(checks_text(report))
    for line in [*deployed_lines(deployed), *check_lines(report, verbose=verbose)]:
        voice.say(line)
    return EXIT_FINDINGS if report.blocking else 0


def _rig(folder: Path | None) -> RigFacts | None:
    """Return the rig in a folder, if one was named."""
    if folder is None:
        return None
    # Reading solids loads more than a check without a rig needs.
    from vinefab.files.rig import read_rig  # noqa: PLC0415

    return read_rig(folder)
