"""``vinefab score``: a design's score on a task."""

from typing import Annotated

import typer

from vinefab.cli.common_options import (
    BodyIn,
    CommandOutput,
    ContactsIn,
    DesignIn,
    Force,
    GrowthIn,
    HalfAngleIn,
    JsonOut,
    MapsIn,
    Quiet,
    StartIn,
    growth_choice,
    growth_from,
    parameters_from,
    started_maps,
)
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.prediction.scoring import ScorePlan, score_design_on_task


def score_command(
    *,
    design: DesignIn,
    maps: MapsIn,
    start: StartIn = None,
    task: Annotated[str, typer.Option(help="coverage, reach or anchoring.")] = "coverage",
    poses: Annotated[int, typer.Option(min=1, help="Poses drawn per map.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the poses.")] = 0,
    parameter: Annotated[
        list[str] | None, typer.Option("--set", help="A task's parameter: radius_mm=60.")
    ] = None,
    growth: GrowthIn = None,
    body: BodyIn = None,
    head_on_half_angle_deg: HalfAngleIn = None,
    contacts: ContactsIn = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Score a design on a task over maps and poses (simulated).

    Example: vinefab score three_level_tree --task coverage --maps grid.geojson pegs.geojson
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    plan = ScorePlan(task=task, parameters=parameters_from(parameter or []), poses=poses, seed=seed)
    given = growth_from(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    robot = read_design(design)
    worlds = started_maps([read_map(path) for path in maps], start)
    options = growth_choice([design], [robot], given).options
    result = score_design_on_task(robot, worlds, plan, options)
    output.give_json(result.json_text())
    for line in result.summary:
        output.say(line)
