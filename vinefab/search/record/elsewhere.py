"""What a run's winner does elsewhere, as the record has it.

That is on unseen maps, over contacts and placed off. `vinefab.prediction.run_winner` finds it.
"""

import collections
import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from vinefab.core.plain_text import counted
from vinefab.core.view import Fact, Facts, Number, Rows, lines
from vinefab.model.score import Failures

PLACED_OFF = 10.0
"""A body is placed this well [assumed]: mm to either side, and degrees of its heading."""


def read_prediction(text: str) -> dict[str, Any]:
    """Return what was recorded of a winner elsewhere, where all of it can be shown.

    Text that was damaged raises what decoding and showing it raise, such as KeyError.
    """
    content = dict(json.loads(text))
    if content:
        tables = (contacts_table(content), *rule_tables(content))
        collections.deque(
            lines((Facts((*elsewhere_facts(content), *lead_facts(content))), *tables)), maxlen=0
        )
    return content


def placed_off_range(content: Mapping[str, Any]) -> tuple[float, float]:
    """Return the least and the greatest mean score of a body placed off by up to `PLACED_OFF`."""
    score = content["unseen"]["score"]["mean"]
    changes = [
        row["change"]
        for row in content["placed_off"]
        if abs(row["step"]) <= PLACED_OFF and row["change"] is not None
    ]
    return score + min([0.0, *changes]), score + max([0.0, *changes])


def contact_ends(content: Mapping[str, Any], family: str = "unseen") -> tuple[float, float]:
    """Return the least and the greatest mean score over contacts."""
    means = [value["mean"] for value in content[family]["over_contacts"]]
    return min(means), max(means)


def mean_score(score: Mapping[str, Any]) -> Number:
    """Return a mean score with its 95 % interval, where it has one."""
    low, high = score["low"], score["high"]
    interval = None if low is None or high is None else (low, high)
    return Number(score["mean"], form=".3f", interval=interval, over=score.get("over", ""))


def lead_facts(content: Mapping[str, Any]) -> tuple[Fact, ...]:
    """Return what leads a page: the score elsewhere, failures, and placed off."""
    score, *_, placed = elsewhere_facts(content)
    number = mean_score(content["unseen"]["score"])
    score = replace(
        score,
        value=replace(number, interval=None),
        detail=f"{number.bracket}, {score.detail}".removeprefix(", "),
    )
    failed = content["unseen"].get("failed")  # unknown in records of an earlier vinefab
    return score, *([] if failed is None else [Failures(**failed).fact]), placed


def elsewhere_facts(content: Mapping[str, Any]) -> tuple[Fact, ...]:
    """Return what a winner is expected to score elsewhere, and how sure that is."""
    task, unseen = content.get("title", content["task"]), content["unseen"]
    angles, standing = content["head_on_half_angles_deg"], angles_standing(content)
    (least, most), (low, high) = contact_ends(content), placed_off_range(content)
    return (
        Fact(
            f"{task} on {unseen['label']}",
            mean_score(unseen["score"]),
            detail=f"mean over {counted(unseen['deployments'], 'deployment')}",
            standing="simulated",
        ),
        Fact(
            f"{task} over contacts",
            f"{least:.3f} to {most:.3f}",
            detail=f"mean at head-on half-angles of {angles[0]:g} to {angles[-1]:g} deg",
            standing=f"simulated, {standing.partition(':')[0]}",
        ),
        *(_rule_fact(task, rule) for rule in content.get("rules", ())),
        Fact(
            f"{task} placed off",
            f"{low:.3f} to {high:.3f}",
            detail=f"mean with the body up to {PLACED_OFF:g} mm or {PLACED_OFF:g} deg off",
            standing="simulated, assumed",
        ),
    )


_RULES = {
    "branch_contact": ("at branches", "at the body of another branch a tip passes or stops"),
    "emergence": ("over emergence", "a child comes out with a probability of"),
}
"""What facts and tables call a rule of growth that is not known."""


def _choices(rule: Mapping[str, Any]) -> list[str]:
    return [one if isinstance(one, str) else f"{one:.3g}" for one in rule["choices"]]


def _rule_fact(task: str, rule: Mapping[str, Any]) -> Fact:
    """Return the mean scores under each choice of a rule."""
    name, meaning = _RULES[rule["option"]]
    means = (f"{value['mean']:.3f}" for value in rule["unseen"])
    return Fact(
        f"{task} {name}",
        ", ".join(f"{choice}: {mean}" for choice, mean in zip(_choices(rule), means, strict=True)),
        detail=f"mean where {meaning} (growth.{rule['option']})",
        standing=f"simulated, {rule['standing'].partition(':')[0]}",
    )


def rule_tables(content: Mapping[str, Any]) -> tuple[Rows, ...]:
    """Return the mean scores under each choice of the rules, on unseen and on training maps."""
    return tuple(
        Rows(
            caption=f"mean {content.get('title', content['task'])} score where "
            f"{_RULES[rule['option']][1]} ({rule['standing'].partition(':')[0]}), with 95 % "
            "intervals over maps, from the same poses (simulated)",
            headings=("where", *_choices(rule)),
            rows=tuple(
                (content[key]["label"], *map(mean_score, rule[key]))
                for key in ("unseen", "training")
            ),
            folded=True,
        )
        for rule in content.get("rules", ())
    )


def angles_standing(content: Mapping[str, Any]) -> str:
    """Return where the half-angles come from that a winner was tried with."""
    standing: str = content.get("head_on_half_angles_standing", "assumed")
    return standing


def contacts_table(content: Mapping[str, Any]) -> Rows:
    """Return the mean scores over the head-on half-angle, on unseen and on training maps."""
    return Rows(
        caption=f"mean {content.get('title', content['task'])} score over the head-on half-angle "
        f"({angles_standing(content)}), with 95 % intervals over maps, from the same poses "
        "(simulated)",
        headings=("where", *(f"{angle:g} deg" for angle in content["head_on_half_angles_deg"])),
        rows=tuple(
            (content[key]["label"], *map(mean_score, content[key]["over_contacts"]))
            for key in ("unseen", "training")
        ),
        folded=True,
    )
