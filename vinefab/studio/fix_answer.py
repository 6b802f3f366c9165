"""Answer of the fix: the smallest change that clears the errors, with what it costs in score."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from vinefab.core.errors import BadInputError
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_content
from vinefab.model.map import Map, Start
from vinefab.prediction.fix_proposal import FIX_TASKS, ProposedFix, propose_fix
from vinefab.prediction.scoring import ScorePlan, score_design_on_task
from vinefab.search.fix import KEEPS, parsed_keeps
from vinefab.studio.edited_map import PAGE
from vinefab.studio.panels import Tell
from vinefab.studio.rules_answer import report_content
from vinefab.studio.state import StudioState

_KEPT_BY = (
    (re.compile(r"level\.\d+\.branches"), "branches"),
    (re.compile(r"trunk\.length|level\.\d+\.(length|growth_percent)"), "length"),
    (re.compile(r"level\.\d+\.angle_deg"), "angle"),
    (re.compile(r"build\.(widths_mm|taper|pouch|trunk_width_mm|width_ratio)(\..*)?"), "width"),
)
"""Which locked values of a design a fix keeps by which of the words `KEEPS`."""

_SEARCH_SHARE = 0.85


def fix_answer(state: StudioState, ask: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Return the smallest change found that clears the errors of what is open on the page.

    Parameters
    ----------
    ask
        ``keep``: words of `KEEPS`, besides those that the page's locks ask for.
    """
    keep, words = kept_kinds(state.locks, ask.get("keep") or [])
    maps: tuple[Map, ...] = ()
    if state.world is not None and state.start is not None:  # the page's start is the only one
        maps = (replace(state.world, starts=(Start(pose=state.start),)),)
    tell(0.0, "looking for the smallest change")
    proposal = propose_fix(
        state.design,
        state.profile,
        maps=maps,
        progress=lambda share: tell(_SEARCH_SHARE * share, "looking for the smallest change"),
        growth=state.growth.values,
        keep=keep,
    )
    tell(_SEARCH_SHARE, "scoring")
    return {**_proposal_content(proposal, state), "keep": sorted(keep), "keep_words": words,
            **_score_content(state, proposal.design, maps)}  # fmt: skip


def kept_kinds(locks: frozenset[str], asked: object) -> tuple[frozenset[str], list[str]]:
    """Return what a fix must keep, and why, a sentence each.

    A fix keeps values of a kind or none of them: one that is locked keeps all of its kind.
    """
    if not isinstance(asked, list) or not all(isinstance(word, str) for word in asked):
        raise BadInputError("fix.keep", asked, f"a list of words: {', '.join(KEEPS)}", PAGE)
    keep, words = parsed_keeps(asked), list[str]()
    for lock in sorted(locks):
        word = next((word for pattern, word in _KEPT_BY if pattern.fullmatch(lock)), "")
        if word and word not in keep:
            keep |= {word}
            words.append(f"{lock} is locked: every {_ONE[word]} is kept")
    return keep, words


_ONE = {"branches": "number of branches", "length": "length", "angle": "angle", "width": "width"}


def _proposal_content(proposal: ProposedFix, state: StudioState) -> dict[str, Any]:
    content: dict[str, Any] = {
        "nothing_to_fix": not proposal.before.blocking,
        "failed": proposal.failed,
        "lines": [line.strip().removeprefix("fix: ") for line in proposal.lines()],
        "in_the_way": list(proposal.in_the_way),
        "changes": [
            {name: getattr(change, name) for name in ("what", "before", "after", "unit", "text")}
            for change in proposal.changes
        ],
        "cost": sum(change.cost for change in proposal.changes),
        "design": None,
        "report": None,
    }
    if proposal.after is not None:
        content["report"] = report_content(replace(proposal.after, design=state.design.name))
    if proposal.design is not None:
        # On the page it is the same design, changed: it keeps its name and its file.
        content["design"] = design_content(proposal.design.changed(name=state.design.name))
        before, after = design_content(state.design), content["design"]
        # Locked values that a proposal changes all the same: no word keeps them.
        locks = sorted(state.locks)
        content["locks_changed"] = [key for key in locks if _at(before, key) != _at(after, key)]
    return content


def _at(content: Any, key: str) -> Any:  # noqa: ANN401  plain values
    """Return a value by its dotted key; None where there is none."""
    for name in key.split("."):
        if isinstance(content, list):
            content = content[int(name)] if name.isdecimal() and int(name) < len(content) else None
        else:
            content = content.get(name) if isinstance(content, Mapping) else None
    return content


def _score_content(
    state: StudioState, proposed: Design | None, maps: tuple[Map, ...]
) -> dict[str, Any]:
    """Return the scores of every task before and after on the open map, from its start."""
    if proposed is None:
        return {"scores": [], "scores_note": ""}
    if not maps:
        return {"scores": [], "scores_note": "no map is open: what it costs in score is not known"}
    scores = []
    for task in FIX_TASKS:
        before, after = (
            score_design_on_task(one, maps, ScorePlan(task=task, poses=1), state.growth)
            for one in (state.design, proposed)
        )
        scores.append(
            {
                "task": after.title_of_task,
                "before": before.composite["mean"],
                "after": after.composite["mean"],
            }
        )
    note = f"simulated, on {maps[0].name} from its start: one pose, so no interval"
    return {"scores": scores, "scores_note": note}
