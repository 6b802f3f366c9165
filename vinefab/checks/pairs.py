"""From near capsules to pairs of branches, each named once at its tightest place."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.checks.marks import Point, mark_line
from vinefab.checks.rule import Hit
from vinefab.checks.shapes import Shapes
from vinefab.checks.spacing import Spacing
from vinefab.checks.subject import Subject
from vinefab.model.finding import Severity

MOST_FINDINGS = 100
"""A rule names so many pairs, the tightest ones; the rest are counted in one more finding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Near:
    """Two branches and where they are nearest.

    Parameters
    ----------
    branches
        Ids of both.
    gap_mm
        Free distance, negative where they overlap.
    at_mm
        Middle of the gap.
    marker
        Line across the gap, from centre line to centre line.
    """

    branches: tuple[str, ...]
    gap_mm: float
    at_mm: Point
    marker: str


def near_branches(
    subject: Subject, found: Spacing, chosen: NDArray[np.bool_]
) -> tuple[list[Near], int]:
    """Return pairs of branches by their smallest gap, tightest first, and how many there are.

    Parameters
    ----------
    subject
        Gives the names.
    found
        Pairs of capsules.
    chosen
        Which of them count, shape (k,).

    Returns
    -------
    list of Near, int
        At most `MOST_FINDINGS` pairs, and the number of all.
    """
    rows = _tightest_of_each(subject.shapes, found, np.flatnonzero(chosen))
    return [_near(subject, found, row) for row in rows[:MOST_FINDINGS].tolist()], len(rows)


def rest_hits(pairs: int, words: str) -> tuple[Hit, ...]:
    """Return one more hit for the pairs beyond `MOST_FINDINGS`, if there are any.

    Parameters
    ----------
    pairs
        How many pairs break the rule.
    words
        What they do (``overlap``).
    """
    if pairs <= MOST_FINDINGS:
        return ()
    rest = f"{pairs - MOST_FINDINGS} more pairs of branches {words}"
    return (Hit(message=rest, severity=Severity.INFO, aspect="rest"),)


def _tightest_of_each(shapes: Shapes, found: Spacing, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    rows = rows[np.argsort(found.gap_mm[rows] - found.crossing_mm[rows], kind="stable")]
    pair = np.sort(
        np.column_stack([shapes.branch[found.first[rows]], shapes.branch[found.second[rows]]])
    )
    _, first = np.unique(pair, axis=0, return_index=True)
    return np.asarray(rows[np.sort(first)])


def _near(subject: Subject, found: Spacing, row: int) -> Near:
    capsules = (int(found.first[row]), int(found.second[row]))
    branches = sorted(int(subject.shapes.branch[capsule]) for capsule in capsules)
    (x0, y0), (x1, y1) = found.first_mm[row].tolist(), found.second_mm[row].tolist()
    return Near(
        branches=subject.ids(*branches),
        gap_mm=float(found.gap_mm[row]),
        at_mm=((x0 + x1) / 2.0, (y0 + y1) / 2.0),
        marker=mark_line((x0, y0), (x1, y1)),
    )
