"""The full check of the best designs while a search runs.

The penalty knows the rules that thousands of designs a second can be asked for. The few that would
be the best so far are asked for all rules before the optimizer learns of them, with joints from the
table: a design that fails is never the best.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.finding import Finding
from vinefab.search.evaluator import Evaluator
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.outset import said_before
from vinefab.search.record.generations import Finalist, Generation, Progress
from vinefab.search.relaxing import relaxations

FAILED = 1.0
"""Penalty of a design that fails the full check alone."""

MOST_OF_GENERATION, MOST_FAILURES = 8, 200
"""Full checks of one generation, and failures of a run after which no more are asked for: counts,
not times, so that results are the same on every computer."""


ADVICE_AT = 0.1
"""Share of a run without a manufacturable design after which its rules and their relaxations are
looked for."""

NEAREST, MOST_NEAR = 5, 64
"""Designs with the least penalties whose broken rules are named, and that changes are tried on."""


class BestCheck:
    """What is known of the best design of a run so far.

    Attributes
    ----------
    passes
        Whether it passes all rules; None where that is not asked, or only a simulation tells.
    """

    def __init__(self, evaluator: Evaluator, history: Sequence[Generation]) -> None:
        self._evaluator = evaluator
        self._best = max((generation.best for generation in history), default=-np.inf)
        self._failures = sum(int((g.penalty == FAILED).sum()) for g in history)
        self.passes: bool | None = None
        if evaluator.penalty is not None:
            self.passes = self._best >= evaluator.lowest
        self._advice, self._outset = "", said_before(evaluator)

    def penalties(self, x: Floats, composite: Floats, penalty: Floats, costs: Floats) -> Floats:
        """Return penalties in which designs count that would be the best and fail the check.

        Parameters
        ----------
        x, composite, penalty, costs
            The points of a generation, their scores, penalties by the quick rules, and joint costs.
        """
        fitness = self._evaluator.fitness(composite, penalty, costs)
        if self._evaluator.penalty is None:
            return penalty
        found, failures = penalty.copy(), self._failures
        for row in np.argsort(-fitness, kind="stable")[:MOST_OF_GENERATION].tolist():
            is_free = penalty[row] == 0.0 and np.isfinite(composite[row])
            if not is_free or fitness[row] <= self._best:
                break
            broken: tuple[Finding, ...] | None = None
            if failures < MOST_FAILURES:
                broken = self._evaluator.broken(self._evaluator.space.design(x[row]))
            if not broken:
                self.passes = None if broken is None else True
                break
            found[row] = FAILED
            failures += 1
        # From what is recorded alone, so that a resumed run goes on alike.
        self._failures += int((found == FAILED).sum())
        self._best = max(self._best, float(self._evaluator.fitness(composite, found, costs).max()))
        return found

    def judged(self, progress: Progress) -> Progress:
        """Return the progress of the run with what is known of its best design."""
        if self.passes is False and progress.share >= ADVICE_AT:
            self._advice = self._advice or advice(self._evaluator, progress.history)
        shown = self._advice if self.passes is False else ""
        return replace(progress, passes=self.passes, advice=shown or self._outset)

    def notes(self, finalists: Sequence[Finalist]) -> tuple[str, ...]:
        """Return what was advised, where no finalist may win or the winner misses targets."""
        beaten = all(finalist.penalty > 0.0 for finalist in finalists)
        targets = finalists[0].score.targets
        misses = targets is not None and not targets.all_touched
        asked = [(self._outset, beaten or misses), (self._advice, beaten)]
        return tuple(text for text, holds in asked if text and holds)


def rules_broken(evaluator: Evaluator, x: Iterable[Floats]) -> str:
    """Return the two rules that most of some designs break."""
    rules = Counter[str]()
    for point in x:
        found = evaluator.broken(evaluator.space.design(point)) or ()
        rules.update(sorted({f"{finding.rule} ({finding.title})" for finding in found}))
    named = ", ".join(rule for rule, _ in rules.most_common(2))
    return named or "the rules of the quick penalty"


def advice(evaluator: Evaluator, history: Sequence[Generation]) -> str:
    """Return which rules stop the designs of a run, and which single changes let some pass."""
    penalty, settings = evaluator.penalty, evaluator.spec.settings
    if not isinstance(penalty, ManufacturabilityPenalty):
        return ""
    x = np.concatenate([generation.x for generation in history])
    penalties = np.concatenate([generation.penalty for generation in history])
    valid = np.isfinite(np.concatenate([generation.composite for generation in history]))
    rows = np.flatnonzero(valid)[np.argsort(penalties[valid], kind="stable")]
    stops = rules_broken(evaluator, x[rows[:NEAREST]])
    helps = relaxations(settings, penalty, x[rows[:MOST_NEAR]])
    named = " or ".join(change.text for change in helps)
    helped = f"tried, and lets designs pass: {named}" if helps else "no single change tried helps"
    return f"no design passes all rules yet; the nearest break {stops}; {helped}"
