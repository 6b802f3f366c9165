"""One number for a design out of its scores on several maps and poses."""

from collections.abc import Sequence

import numpy as np

from vinefab.core.validation import Floats

MEAN_SHARE = 0.25
"""Share of the mean in ``min_deviation`` [paper]; its form is vinefab's."""

STANDARD_DEVIATION = 0.5
"""The deviation that earns nothing: the largest that scores between 0 and 1 can have."""

COMPOSITES = ("mean", "best", "min_deviation", "single")
"""Ways to weigh scores in a search; ``single`` takes one evaluation for what it is."""


def composite(
    scores: Sequence[float] | Floats, reference_deviation: float = STANDARD_DEVIATION
) -> dict[str, float]:
    """Return every way of weighing scores into one number.

    Returns
    -------
    dict
        ``mean``; ``best``, the largest; ``min_deviation``, a quarter of the mean plus three
        quarters of ``1 - std / reference_deviation`` (not below 0).

    Examples
    --------
    >>> composite([0.2, 0.6])["mean"]
    0.4
    """
    row = np.asarray(scores, dtype=np.float64)[None]
    kinds = ("mean", "best", "min_deviation")
    return {kind: float(composites(row, kind, reference_deviation)[0]) for kind in kinds}


def composites(
    scores: Floats, kind: str, reference_deviation: float = STANDARD_DEVIATION
) -> Floats:
    """Return one of the numbers of `composite` for each of m rows of scores."""
    rows = np.ascontiguousarray(scores)
    if kind == "best":
        return np.asarray(rows.max(axis=1))
    mean = np.asarray(rows.mean(axis=1))
    if kind != "min_deviation":
        return mean
    steadiness = np.maximum(0.0, 1.0 - rows.std(axis=1) / reference_deviation)
    return np.asarray(MEAN_SHARE * mean + (1.0 - MEAN_SHARE) * steadiness)
