"""``vinefab compare``: designs side by side."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    BodyIn,
    CommandOutput,
    ContactsIn,
    Count,
    EnvironmentIn,
    Force,
    GrowthIn,
    HalfAngleIn,
    JsonOut,
    MapsOptional,
    Quiet,
    SetIn,
    StartIn,
    contacts_arguments,
    ensure_text_kind,
    growth_choice,
    growth_from,
    map_arguments,
    parameters_from,
    started_maps,
)
from vinefab.core.atomic import write_text
from vinefab.growth.options import growth_arguments
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.prediction.comparison import compare_designs, measure_named
from vinefab.prediction.family_deployments import PredictionPlan, map_families, unseen_maps
from vinefab.prediction.provenance import origin_of


def compare_command(
    *,
    designs: Annotated[
        list[str], typer.Argument(metavar="DESIGN...", help="Design files or shipped names.")
    ],
    maps: MapsOptional = None,
    start: StartIn = None,
    environment: EnvironmentIn = None,
    count: Count = 100,
    parameter: SetIn = None,
    measure: Annotated[
        str, typer.Option(help="What counts most, such as reach_percent.")
    ] = "coverage_score",
    poses: Annotated[int, typer.Option(min=1, help="Poses drawn per map.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Seed of unseen maps and poses.")] = 0,
    growth: GrowthIn = None,
    body: BodyIn = None,
    head_on_half_angle_deg: HalfAngleIn = None,
    contacts: ContactsIn = None,
    out: Annotated[Path | None, typer.Option("--out", help="A page to write (HTML).")] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Compare designs on the same maps and poses, with paired statistics (simulated).

    Example: vinefab compare grid_explorer three_level_tree --environment grid --count 50
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    given_growth = growth_from(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    main = measure_named(measure)
    if out is not None:
        ensure_text_kind("--out", out, (".html", ".htm"), force=force)
    with output.progress("compare") as show:
        robots = [read_design(design) for design in designs]
        parameters = parameters_from(parameter or [])
        unseen = unseen_maps(environment, count, seed, parameters) if environment else None
        if unseen is not None:
            unseen = replace(unseen, worlds=started_maps(unseen.worlds, start))
        given = started_maps([read_map(path) for path in maps or []], start)
        families = map_families(given, unseen)
        choice = growth_choice(designs, robots, given_growth)
        plan = PredictionPlan(poses=poses, seed=seed, options=choice.options)
        found = compare_designs(
            robots, families, plan, show, measure=main, growth_notes=choice.notes
        )
        arguments = [
            "vinefab",
            "compare",
            *designs,
            *map_arguments(maps, environment, count, parameter, start),
        ]
        arguments += [
            "--measure",
            measure,
            "--poses",
            str(poses),
            "--seed",
            str(seed),
            *contacts_arguments(contacts),
            *growth_arguments(choice.options),
        ]
        origin = origin_of(shlex.join(arguments), robots, None, families)
        found = replace(found, origin=origin)
        page = found.page() if out else ""
    if out is not None:
        write_text(out, page, force=force)
        output.say(f"wrote {out}")
    output.give_json(found.json_text())
    for line in found.summary:
        output.say(line)
