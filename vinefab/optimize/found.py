"""What points of a search turned out to be worth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vinefab.model.checked import Floats, Ints
from vinefab.tasks.task import Outcomes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """What m points are worth, evaluation by evaluation, k of them; NaN where there is no design.

    Parameters
    ----------
    penalty
        How far each design is from one that can be made, shape (m,); 0 where there is no design.
    score
        The task's scores, shape (m, k).
    terms
        The numbers that scores are made of, each of shape (m, k).
    """

    penalty: Floats
    score: Floats
    terms: Mapping[str, Floats]

    @classmethod
    def of(cls, points: int, launches: int, rows: Ints, grown: Outcomes | None) -> "Found":
        """Return what was found of points, some of which are designs, without penalties.

        Parameters
        ----------
        points, launches
            Number of points and of evaluations of each.
        rows
            The points that are designs, in the order of their batch.
        grown
            What the batch's growths are worth; None if there was none.
        """
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
    def joined(cls, parts: Sequence["Found"]) -> "Found":
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

    def with_penalties(self, penalty: Floats) -> "Found":
        """Return the same with penalties; a point whose penalty is NaN is no design."""
        gone = np.isnan(penalty)
        if not gone.any():
            return replace(self, penalty=penalty)
        tables = {name: np.where(gone[:, None], np.nan, v) for name, v in self.terms.items()}
        return Found(
            penalty=np.where(gone, 0.0, penalty),
            score=np.where(gone[:, None], np.nan, self.score),
            terms=tables,
        )
