"""What a comparison of optimizers comes to: means, intervals, paired tests, a figure."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.stats import wilcoxon

from vinefab.core.jsontext import json_text
from vinefab.core.rng import child
from vinefab.core.statistics import holm
from vinefab.core.validation import Floats
from vinefab.pages.charts import panels_of_strips
from vinefab.pages.figure import svg_bytes
from vinefab.search.record.result import package_versions
from vinefab.search.settings import plain_settings
from vinefab.studies.contest.optimizer_contest import Contest, ContestRow

RESAMPLES = 10_000
_STREAM = 1702


def comparison_json(contest: Contest, rows: Sequence[ContestRow]) -> str:
    """Return a comparison as JSON: ``vinefab/comparison-1``."""
    content = {
        "seeds": contest.seeds,
        "unseen_maps": contest.unseen,
        "poses_per_unseen_map": contest.poses,
        "reference": contest.contenders[0].label,
        "problems": {problem.name: plain_settings(problem) for problem in contest.problems},
        "table": comparison_table(contest, rows),
        "runs": [asdict(row) for row in rows],
        "versions": package_versions(),
    }
    return json_text("vinefab/comparison-1", content)


def comparison_table(contest: Contest, rows: Sequence[ContestRow]) -> list[dict[str, Any]]:
    """Return one entry per problem and contender, and over all problems together.

    Scores are those of the winners on unseen maps. ``difference`` is to the first contender,
    paired by seed; its p-value is that of Wilcoxon's signed-rank test, and ``p_holm`` the same
    corrected for the number of contenders (Holm). Intervals are 95 % bootstrap intervals over
    seeds.
    """
    names = [problem.name for problem in contest.problems]
    table = []
    for problem in names:
        scores = [_scores(rows, problem, c.label) for c in contest.contenders]
        table += _block(contest, problem, scores, rows)
    if len(names) > 1:
        scores = [
            np.mean([_scores(rows, problem, c.label) for problem in names], axis=0)
            for c in contest.contenders
        ]
        table += _block(contest, "all", scores, rows)
    return table


def _scores(rows: Sequence[ContestRow], problem: str, label: str) -> Floats:
    return np.array([r.unseen for r in rows if (r.problem, r.contender) == (problem, label)])


def _block(
    contest: Contest, problem: str, scores: Sequence[Floats], rows: Sequence[ContestRow]
) -> list[dict[str, Any]]:
    chances = [_chance(values - scores[0]) for values in scores]
    held = holm(chances[1:])
    block = []
    for place, (contender, values) in enumerate(zip(contest.contenders, scores, strict=True)):
        mine = [r for r in rows if r.contender == contender.label and problem in (r.problem, "all")]
        entry: dict[str, Any] = {
            "problem": problem,
            "optimizer": contender.label,
            "unseen": _interval(values),
            "fresh": float(np.mean([r.fresh for r in mine])),
            "lucky": float(np.mean([r.lucky for r in mine])),
            "evaluations": float(np.mean([r.evaluations for r in mine])),
            "optimizer_s": float(np.mean([r.optimizer_s for r in mine])),
            "can_be_made": float(np.mean([r.penalty == 0.0 for r in mine])),
        }
        if place > 0:
            difference = _interval(values - scores[0])
            entry["difference"] = {**difference, "p": chances[place], "p_holm": held[place - 1]}
        block.append(entry)
    return block


def _interval(values: Floats) -> dict[str, float]:
    """Return a mean with its 95 % percentile bootstrap interval."""
    draws = child(0, _STREAM).integers(0, len(values), (RESAMPLES, len(values)))
    low, high = np.percentile(values[draws].mean(axis=1), [2.5, 97.5])
    return {"mean": float(values.mean()), "low": float(low), "high": float(high)}


def _chance(differences: Floats) -> float:
    """Return the two-sided p-value of no difference, 1 when there is none or one pair only."""
    if len(differences) < 2 or not differences.any():
        return 1.0
    return float(wilcoxon(differences).pvalue)


def table_lines(table: Sequence[dict[str, Any]]) -> list[str]:
    """Return a table as lines for the user."""
    lines = []
    for entry in table:
        unseen = entry["unseen"]
        line = (
            f"{entry['problem']:<12} {entry['optimizer']:<28} {unseen['mean']:.4f} "
            f"[{unseen['low']:.4f}, {unseen['high']:.4f}]"
        )
        if difference := entry.get("difference"):
            line += (
                f"  {difference['mean']:+.4f} [{difference['low']:+.4f}, {difference['high']:+.4f}]"
                f" p {difference['p_holm']:.3f}"
            )
        lines.append(line)
    return lines


def comparison_svg(contest: Contest, rows: Sequence[ContestRow]) -> bytes:
    """Return every winner's score on unseen maps as a dot, a panel per problem."""
    panels = {
        problem.name: {c.label: _scores(rows, problem.name, c.label) for c in contest.contenders}
        for problem in contest.problems
    }
    return svg_bytes(panels_of_strips(panels, "score on unseen maps (simulated)"))
