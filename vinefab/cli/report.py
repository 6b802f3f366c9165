"""``vinefab report``: predictions as one page."""

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
    DesignIn,
    DesignRecipeIn,
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
from vinefab.prediction.family_deployments import PredictionPlan, map_families, unseen_maps
from vinefab.prediction.predict import part_of, predict
from vinefab.prediction.provenance import origin_of


def report_command(
    *,
    design: DesignIn,
    out: Annotated[Path, typer.Option("--out", help="The page to write (HTML).")],
    maps: MapsOptional = None,
    start: StartIn = None,
    environment: EnvironmentIn = None,
    count: Count = 100,
    parameter: SetIn = None,
    recipe: DesignRecipeIn = None,
    poses: Annotated[int, typer.Option(min=1, help="Poses drawn per map.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Seed of unseen maps and poses.")] = 0,
    growth: GrowthIn = None,
    body: BodyIn = None,
    head_on_half_angle_deg: HalfAngleIn = None,
    contacts: ContactsIn = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Write predictions (simulated), rules and materials of a design as one HTML page.

    Example: vinefab report three_level_tree --environment grid --count 100 --out report.html
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    given_growth = growth_from(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    ensure_text_kind("--out", out, (".html", ".htm"), force=force)
    with output.progress("report") as show:
        show(0.0, "reading and generating maps")
        robot = read_design(design)
        chosen = output.recipe_of(robot, recipe)
        profile = chosen.profile
        given = started_maps([read_map(path) for path in maps or []], start)
        parameters = parameters_from(parameter or [])
        unseen = unseen_maps(environment, count, seed, parameters) if environment else None
        if unseen is not None:
            unseen = replace(unseen, worlds=started_maps(unseen.worlds, start))
        families = map_families(given, unseen)
        options = growth_choice([design], [robot], given_growth).options
        plan = PredictionPlan(poses=poses, seed=seed, options=options)
        found = predict(robot, profile, families, plan, part_of(show, 0.0, 0.6))
        arguments = ["vinefab", "report", design, "--recipe", chosen.recipe]
        arguments += map_arguments(maps, environment, count, parameter, start)
        arguments += ["--poses", str(poses), "--seed", str(seed)]
        arguments += [*contacts_arguments(contacts), *growth_arguments(options), "--out", str(out)]
        origin = origin_of(shlex.join(arguments), [robot], profile, families)
        found = replace(found, origin=origin)
        page = found.page(part_of(show, 0.6, 1.0))
    write_text(out, page, force=force)
    output.give_json(found.json_text())
    for line in found.summary:
        output.say(line)
    output.say(f"wrote {out}")
