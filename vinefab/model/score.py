"""Scores of a design on a task, evaluation by evaluation."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict

from vinefab.core.codec import EXACT
from vinefab.core.front_door import ABOVE
from vinefab.core.plain_text import counted
from vinefab.core.statistics import clopper_pearson, means_by_map, samples_text
from vinefab.core.validation import Floats
from vinefab.core.view import Block, Data, Fact, Facts, Notes, Number, Result, Rows
from vinefab.model.map import Pose
from vinefab.model.target import TargetsResult

MEAN_SHARE = 0.25
"""Share of the mean in ``min_deviation`` [paper]; its form is vinefab's."""

STANDARD_DEVIATION = 0.5
"""The reference deviation: the largest that scores between 0 and 1 can have."""


def composite_text(kind: str, reference_deviation: float = STANDARD_DEVIATION) -> str:
    """Return the formula of a composite, where its name does not say it."""
    if kind != "min_deviation":
        return ""
    rest = 1.0 - MEAN_SHARE
    return f"{MEAN_SHARE:g} mean + {rest:g} (1 - std / {reference_deviation:g})"


NOTHING_STEADY = "nothing earned, so that to be steady is worth nothing"


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluation:
    """One deployment's score.

    Parameters
    ----------
    map_name
        The map that the robot grew on.
    pose
        Where it started.
    score
        The task's score, higher is better.
    terms
        The named numbers that make up the score.
    parts
        What earned and cost how much of the score: they add up to it. Empty where the task does
        not say, and in scores of a search.
    """

    map_name: str
    pose: Pose
    score: float
    terms: Mapping[str, float]
    parts: Mapping[str, float] = field(default_factory=dict)


FAILED_PERCENT = 10.0
"""A robot without targets has failed where it grows a smaller share of its length [assumed]."""

HARDLY_GROWN, NOTHING_TOUCHED = "grows less than a tenth of its length", "touches no target"


@dataclass(frozen=True, slots=True, kw_only=True)
class Failures:
    """Deployments in which a robot fails at all of its task (simulated)."""

    failed: int
    deployments: int
    share: float  # mean of the maps' shares
    samples: int  # independent ones: maps, or poses where there is one map
    over: str  # how many that is, as it is shown
    what: str  # what a failure is

    @classmethod
    def of(cls, failed: ArrayLike, maps: Sequence[str], what: str) -> "Failures":
        """Return the failures among deployments, each on one of some maps."""
        each = np.asarray(failed, dtype=np.float64)
        means = means_by_map(each, maps)
        return cls(
            failed=int(each.sum()), deployments=len(each), share=float(means.mean()),
            samples=len(means), over=samples_text(len(means), maps), what=what,
        )  # fmt: skip

    @property
    def fact(self) -> Fact:
        """The count, and the share with its interval over maps."""
        low, high = clopper_pearson(self.share, self.samples)
        number = Number(self.share, "%", ".1f", (low, high), per=0.01, over=self.over)
        many = 0.1  # from this share of failures on, they are bad news
        return Fact(
            "fails completely",
            f"{self.failed} of {self.deployments}",
            "failed",
            f"{number.text}; {self.what}",
            "bad" if self.share >= many else "caution" if self.failed else "plain",
            {"deployments": self.failed, "percent": round(100.0 * self.share, 1),
             "percent_low": round(100.0 * low, 1), "percent_high": round(100.0 * high, 1)},
            "simulated",
        )  # fmt: skip


IDEAL_CASE = "ideal_case"
"""Term of evaluations whose score is a formula's ideal case where it is not 0."""

MOST_SHOWN = 30
"""Evaluations that are shown."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Score(Result):
    """All evaluations of one design on one task.

    Parameters
    ----------
    task
        Name of the task.
    evaluations
        At least one.
    composite
        Composites of the scores: ``mean``, ``best``, ``min_deviation``.
    parts
        What earned and cost how much of the mean, as in `Evaluation`.
    growth
        The growth options by name.
    notes
        What a user should know about the deployments, a sentence each.
    grown
        By which rules the robot was grown.
    targets
        Which targets it touches; None where there are none, and in scores of a search.
    """

    task: str
    evaluations: tuple[Evaluation, ...]
    composite: Mapping[str, float]
    parts: Mapping[str, float] = field(default_factory=dict)
    growth: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    grown: str = ""
    targets: TargetsResult | None = None
    schema = "vinefab/score-1"
    __pydantic_config__: ClassVar[ConfigDict] = EXACT

    def drawing(self) -> Any:  # noqa: ANN401  a page of a room above
        """Return the chart of the score of every deployment, by map."""
        return ABOVE.score_page(self)

    def view(self) -> Iterator[Block]:
        """Yield the composites, what earned and cost the mean, and the evaluations."""
        composite, parts = self.composite, self.parts
        if self.targets is not None:
            yield self.targets.answer(f"{self.title_of_task} {composite['mean']:.3f}")
            yield from self.targets.below
        task = Fact("task", self.title_of_task, "task", data=self.task)
        yield Facts((task, Fact("growth", self.grown or "as trained")))
        yield Rows(
            caption=f"scores of {counted(len(self.evaluations), 'deployment')} (simulated)",
            headings=("score", "map", "X,Y,DEG"),
            rows=tuple((Number(e.score, form=".4f"), e.map_name, e.pose.text)
                       for e in self.evaluations),
            key="evaluations",
            keys=("score", "map", ""),
            data=tuple(
                {"pose": e.pose.content, "terms": {**e.terms}, "parts": {**e.parts}}
                for e in self.evaluations
            ),
            most=MOST_SHOWN,
        )  # fmt: skip
        yield Rows(
            caption="what the mean is made of (simulated)",
            headings=("part", "of the mean"),
            rows=tuple((name, Number(value, form="+.4f")) for name, value in parts.items()),
        )
        yield Facts(
            tuple(
                composite_fact(
                    self, kind, kind, "; ".join(filter(None, [composite_text(kind), "simulated"]))
                )
                for kind in composite
            ),
            lead=True,
        )
        yield Data({"growth": {**self.growth}, "parts": {**parts}})
        yield Notes(self.notes, "notes")

    @property
    def title_of_task(self) -> str:
        """The task's name, and whether the score is only the ideal case."""
        ideal = any(evaluation.terms.get(IDEAL_CASE) for evaluation in self.evaluations)
        return f"{self.task}, ideal case" if ideal else self.task

    @property
    def scores(self) -> Floats:
        """The scores in order, shape (n,)."""
        return np.array([evaluation.score for evaluation in self.evaluations])


def composite_fact(score: Score, kind: str, name: str, detail: str, standing: str = "") -> Fact:
    """Return a composite as it is shown: where nothing is earned, steadiness has no number.

    Something is earned where a target is touched or a score is above 0.
    """
    value, key = score.composite[kind], f"composite.{kind}"
    earned = (
        any(any(one.touched) for one in score.targets.outcomes)
        if score.targets is not None
        else bool((score.scores > 0.0).any())
    )
    if kind == "min_deviation" and not earned:
        return Fact(name, "-", key, NOTHING_STEADY, data=value)
    return Fact(name, Number(value, form=".4f"), key, detail, standing=standing)
