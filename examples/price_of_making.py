"""What it costs to ask for a robot that can be made.

Runs the same search with and without `fabricable = true`, several seeds of it in two environments
and for three tasks, tests every winner on maps that no run trained on, and checks every winner as
`vinefab check` would. Prints a table and writes it as JSON:

    python examples/price_of_making.py --seeds 10 --out price.json
    python examples/price_of_making.py --seeds 2 --tasks coverage --environments grid
"""

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import bootstrap

from vinefab.files.profile import read_profile
from vinefab.files.shipped import DEFAULT_RECIPE
from vinefab.model.design import Pouch
from vinefab.model.laser import LaserProfile
from vinefab.optimize.bounds import Bounds, BuildSettings, SpaceSettings
from vinefab.optimize.loop import optimize
from vinefab.optimize.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.optimize.training import generated_maps
from vinefab.pipeline.check import check
from vinefab.pipeline.optimize import penalty_of, training_maps
from vinefab.tasks.evaluate import Site, poses_on, score_design
from vinefab.tasks.registry import make_task

ENVIRONMENTS = ("grid", "cave")
TASKS = ("coverage", "reach", "anchoring")
UNSEEN_SEED = 10_001
"""Far from the training maps, which begin at 1."""


def settings_for(
    environment: str, task: str, seed: int, arguments: argparse.Namespace
) -> RunSettings:
    """Return the run: Table 1's space; anchoring with few levels and pouches, as in the paper."""
    settings = RunSettings(
        name=f"{environment}_{task}_{seed}",
        maps=MapSettings(environment=environment, count=4, seed=1),
        task=PartSettings(name=task),
        search=SearchSettings(
            population=arguments.population, generations=arguments.generations, seed=seed
        ),
        evaluation=EvaluationSettings(fabricable=True),
    )
    if task != "anchoring":
        return settings
    return replace(
        settings,
        space=SpaceSettings(levels=Bounds(low=2, high=3), branches=Bounds(low=2, high=3)),
        build=BuildSettings(pouch=Pouch(shape="rectangle", length_mm=25.0, width_mm=40.0)),
    )


def one(settings: RunSettings, unseen: list[Site], profile: LaserProfile) -> dict[str, object]:
    """Run one search; return what its winner is worth and whether it can be made."""
    result = optimize(settings, training_maps(settings), penalty=penalty_of(settings))
    poses = poses_on(unseen, 3, range(len(unseen)))
    task = make_task(settings.task.name, settings.task.parameters)
    if settings.task.name == "reach":
        task = replace(task, area="fast")  # within 0.2 % of the exact area
    score = score_design(result.best, unseen, poses, task, settings.growth)
    report = check(result.best, profile)
    return {
        "seed": settings.search.seed,
        "training": result.score.composite["mean"],
        "unseen": score.composite["mean"],
        "passes": not report.blocking,
        "rules_broken": sorted({finding.rule for finding in report.blocking}),
        "branches": result.best.branch_count,
    }


def interval(values: list[float]) -> str:
    """Return a mean with its 95 % bootstrap interval over seeds."""
    mean = float(np.mean(values))
    if len(values) < 3 or np.ptp(values) == 0.0:
        return f"{mean:.3f}"
    found = bootstrap((values,), np.mean, method="percentile", random_state=1, n_resamples=2000)
    low, high = found.confidence_interval
    return f"{mean:.3f} [{low:.3f}, {high:.3f}]"


def compared(environment: str, task: str, arguments: argparse.Namespace) -> dict[str, object]:
    """Return all seeds of one environment and task, both ways."""
    profile = read_profile(DEFAULT_RECIPE)
    maps = MapSettings(environment=environment, count=arguments.unseen, seed=UNSEEN_SEED)
    unseen = [Site.of(world) for world in generated_maps(maps)]
    found: dict[str, list[dict[str, object]]] = {"free": [], "fabricable": []}
    for seed in range(1, arguments.seeds + 1):
        asked = settings_for(environment, task, seed, arguments)
        free = replace(asked, evaluation=replace(asked.evaluation, fabricable=False))
        found["free"].append(one(free, unseen, profile))
        found["fabricable"].append(one(asked, unseen, profile))
        show(f"  {environment} {task} seed {seed} done")
    return {"environment": environment, "task": task, **found}


def row(cell: dict[str, object]) -> str:
    """Return one environment and task as a line of the table."""
    free, made = cell["free"], cell["fabricable"]
    prices = [one["unseen"] - other["unseen"] for one, other in zip(free, made, strict=True)]
    columns = [cell["environment"], cell["task"]]
    for runs in (free, made):
        columns += [interval([run["training"] for run in runs])]
        columns += [interval([run["unseen"] for run in runs])]
        columns += [f"{sum(run['passes'] for run in runs)}/{len(runs)}"]
    return "| " + " | ".join([*columns, interval(prices)]) + " |"


def show(text: str) -> None:
    """Print a line at once."""
    print(text, flush=True)


def main() -> None:
    """Run everything and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--unseen", type=int, default=25, help="unseen maps, three poses on each")
    parser.add_argument("--population", type=int, default=24)
    parser.add_argument("--generations", type=int, default=20)
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=TASKS)
    parser.add_argument("--environments", nargs="+", choices=ENVIRONMENTS, default=ENVIRONMENTS)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    cells = [
        compared(environment, task, arguments)
        for task in arguments.tasks
        for environment in arguments.environments
    ]
    show("mean over seeds [95 % bootstrap interval]; all scores simulated")
    names = ("training", "unseen", "pass the check")
    head = [f"{way}: {name}" for way in ("free", "fabricable") for name in names]
    show("| " + " | ".join(["map", "task", *head, "price, unseen"]) + " |")
    show("|" + "---|" * 9)
    for cell in cells:
        show(row(cell))
    if arguments.out:
        arguments.out.write_text(json.dumps(cells, indent=1) + "\n")
        show(f"wrote {arguments.out}")
    failed = [run for cell in cells for run in cell["fabricable"] if not run["passes"]]
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
