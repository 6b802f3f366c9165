"""Sections on what a design is expected to do: deployments, scores, stops. All simulated."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.report.charts import score_strips
from vinefab.report.content import Picture, Section, Table
from vinefab.report.figure import svg_bytes
from vinefab.report.plans import deployment_plan

MOST_PICTURES = 6


def deployment_section(
    design: Design, deployed: Sequence[tuple[Map, Deployment]], rules: str
) -> Section:
    """Return pictures of deployments, one per map, and how all branches ended.

    Parameters
    ----------
    design
        The robot.
    deployed
        Every deployment with its map.
    rules
        The growth model's choices, in words.
    """
    first_on_map: dict[str, tuple[Map, Deployment]] = {}
    for world, deployment in deployed:
        first_on_map.setdefault(world.name, (world, deployment))
    pictures = tuple(
        Picture(
            svg=svg_bytes(deployment_plan(world, deployment, design.build.widths_mm)),
            caption=f"On {world.name} (simulated). Bodies are drawn as wide as they inflate.",
        )
        for world, deployment in list(first_on_map.values())[:MOST_PICTURES]
    )
    return Section(
        title="Deployments",
        paragraphs=(
            f"Growth model: {rules}. Planar and supported; branches do not push on each other.",
        ),
        pictures=pictures,
        tables=(_stop_table([deployment for _, deployment in deployed]),),
    )


def score_section(scores: Mapping[str, Score]) -> Section:
    """Return the distribution of each task's score over maps and poses.

    Parameters
    ----------
    scores
        By what they are called in the report.
    """
    rows = tuple(_score_row(name, score) for name, score in scores.items())
    headings = ("score", "evaluations", "mean", "standard deviation", "least", "greatest")
    table = Table(caption="Over all maps and poses (simulated)", headings=headings, rows=rows)
    pictures = tuple(
        Picture(
            svg=svg_bytes(score_strips(_by_map(score), f"{name} (simulated)")),
            caption=f"{name}: every evaluation, by map",
        )
        for name, score in scores.items()
    )
    return Section(title="Predictions", tables=(table,), pictures=pictures)


def _by_map(score: Score) -> dict[str, list[float]]:
    groups: dict[str, list[float]] = {}
    for evaluation in score.evaluations:
        groups.setdefault(evaluation.map_name, []).append(evaluation.score)
    return groups


def _score_row(name: str, score: Score) -> tuple[str, ...]:
    values = score.scores
    numbers = (values.mean(), values.std(), values.min(), values.max())
    return (name, str(len(values)), *(f"{number:.4f}" for number in numbers))


def _stop_table(deployments: Sequence[Deployment]) -> Table:
    levels: dict[int, Counter[int]] = {}
    for deployment in deployments:
        for level, stop in zip(
            deployment.tree.level.tolist(), deployment.stop.tolist(), strict=True
        ):
            levels.setdefault(level, Counter())[stop] += 1
    rows = tuple(
        (str(level), *(f"{100 * counts[stop] / counts.total():.1f} %" for stop in Stop))
        for level, counts in sorted(levels.items())
    )
    total = np.sum([len(deployment.tree) for deployment in deployments])
    return Table(
        caption=f"How {total} branches of {len(deployments)} deployments ended (simulated)",
        headings=("level", *(stop.label for stop in Stop)),
        rows=rows,
    )
