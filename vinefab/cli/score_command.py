"""``vinefab score``: a design's score on a task."""

from typing import Annotated

import typer

from vinefab.cli.common_options import (
    CommandOutput,
    DesignIn,
    Force,
    JsonOut,
    MapsIn,
    Quiet,
    parameters_from,
)
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.model.files.results_json import score_text
from vinefab.prediction.deploy import growth_options
from vinefab.prediction.scoring import ScorePlan, score_design_on_task, score_lines


def score_command(
    *,
    design: DesignIn,
    maps: MapsIn,
    task: Annotated[str, typer.Option(help="coverage, reach or anchoring.")] = "coverage",
    poses: Annotated[int, typer.Option(min=1, help="Poses drawn per map.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the poses.")] = 0,
    parameter: Annotated[
        list[str] | None, typer.Option("--set", help="A task's parameter: radius_mm=60.")
    ] = None,
    body: Annotated[str, typer.Option(help="centerline or inflated.")] = "centerline",
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Score a design on a task over maps and poses (simulated).

    Example: vinefab score three_level_tree --task coverage --maps a.geojson --maps b.geojson
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    plan = ScorePlan(task=task, parameters=parameters_from(parameter or []), poses=poses, seed=seed)
    worlds = [read_map(path) for path in maps]
    result = score_design_on_task(read_design(design), worlds, plan, growth_options(body))
    output.give_json(score_text(result))
    for line in score_lines(result):
        output.say(line)
