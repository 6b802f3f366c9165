"""What the points of a search are worth, evaluation by evaluation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.tasks.task import TaskOutcomes

INVALID_FITNESS = -1e6
"""Fitness of a point that is no design, or whose worth cannot be told: below everything."""


def objective(composite: Floats, penalty: Floats, lowest: float, weight: float) -> Floats:
    """Return the fitness of designs.

    A design without penalty is worth its composite score. One with a penalty is worth less than
    any without: its score is squeezed into the unit below the lowest possible score, so that it
    still counts among designs that cannot be made, and the penalty is taken off.

    Parameters
    ----------
    composite
        Composite scores, shape (m,).
    penalty
        0 for a design that can be made, else above 0; shape (m,).

    Examples
    --------
    >>> objective(np.array([0.4, 0.4]), np.array([0.0, 1e-9]), lowest=-1.0, weight=1.0) < -1.0
    array([False,  True])
    """
    known = np.isfinite(composite) & np.isfinite(penalty)
    worth, lack = np.where(known, composite, 0.0), np.where(known, penalty, 0.0)
    below = lowest - 1.0 / (1.0 + np.maximum(0.0, worth - lowest)) - weight * lack
    fitness = np.where(lack <= 0.0, worth, np.maximum(INVALID_FITNESS, below))
    return np.where(known, fitness, INVALID_FITNESS)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluations:
    """What m points are worth, for each of k evaluations; NaN where there is no design."""

    # how far each design is from one that can be made, shape (m,); 0 where there is no design
    penalty: Floats
    score: Floats  # the task's scores, shape (m, k)
    terms: Mapping[str, Floats]  # the numbers that scores are made of, each of shape (m, k)

    @classmethod
    def of(
        cls, points: int, launches: int, rows: Ints, grown: TaskOutcomes | None
    ) -> "Evaluations":
        """Return what was found of points, some of which are designs, without penalties."""
        if grown is None:
            gap = np.full((points, launches), np.nan)
            return cls(penalty=np.zeros(points), score=gap, terms={})
        # All at once: a table of its own for every term would take four times as long.
        columns = (grown.score, *grown.terms.values())
        tables = np.full((len(columns), points, launches), np.nan)
        tables[:, rows] = np.reshape(columns, (len(columns), launches, -1)).swapaxes(1, 2)
        terms = dict(zip(grown.terms, tables[1:], strict=True))
        return cls(penalty=np.zeros(points), score=tables[0], terms=terms)

    @classmethod
    def joined(cls, parts: Sequence["Evaluations"]) -> "Evaluations":
        """Return several parts, at least one, as one."""
        # A part without any design does not know the terms.
        names = max((tuple(part.terms) for part in parts), key=len)
        gaps = [np.full(part.score.shape, np.nan) for part in parts]
        return cls(
            penalty=np.concatenate([part.penalty for part in parts]),
            score=np.concatenate([part.score for part in parts]),
            terms={
                name: np.concatenate(
                    [part.terms.get(name, gap) for part, gap in zip(parts, gaps, strict=True)]
                )
                for name in names
            },
        )

    def with_penalties(self, penalty: Floats) -> "Evaluations":
        """Return the same with penalties; a point whose penalty is NaN is no design."""
        gone = np.isnan(penalty)
        if not gone.any():
            return replace(self, penalty=penalty)
        tables = {name: np.where(gone[:, None], np.nan, v) for name, v in self.terms.items()}
        return Evaluations(
            penalty=np.where(gone, 0.0, penalty),
            score=np.where(gone[:, None], np.nan, self.score),
            terms=tables,
        )
