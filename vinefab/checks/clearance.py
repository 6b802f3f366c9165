"""Rules about branches that come too near each other on the flat sheet."""

import numpy as np
from numpy.typing import NDArray

from vinefab.checks.pairs import near_branches, rest_hits
from vinefab.checks.rule import Hit, Limits, Looked, Rule
from vinefab.checks.spacing import Spacing, spacing
from vinefab.checks.subject import Subject


def look_overlap(subject: Subject, _: Limits) -> Looked:
    """VF-T03: branches that share no joint do not overlap."""
    found = spacing(subject.shapes, 0.0)
    nears, pairs = near_branches(subject, found, ~found.joined & (found.gap_mm < 0.0))
    hits = [
        Hit(
            message="the branches overlap when flat: widen the fan, or shorten one of them",
            measured=near.gap_mm,
            limit=0.0,
            branches=near.branches,
            at_mm=near.at_mm,
            marker=near.marker,
        )
        for near in nears
    ]
    return Looked(
        checked=len(subject.layout.tree), hits=(*hits, *rest_hits(pairs, "overlap when flat"))
    )


def look_clearance(subject: Subject, limits: Limits) -> Looked:
    """VF-C01: film is left between branches that share no joint.

    Branches that share one converge there by design. Their notch ends in a fillet (VF-C04) within
    half of the shorter one (VF-C03), and from there on two straight sides only part: at the end of
    the shorter one they are a branch's width apart. Pouches can close a notch again: VF-C07.
    """
    found = spacing(subject.shapes, max(limits["error"], limits["warning"]))
    apart = ~found.joined & (found.gap_mm >= 0.0)
    return Looked(checked=len(subject.layout.tree), hits=gap_hits(subject, limits, found, apart))


def gap_hits(
    subject: Subject, limits: Limits, found: Spacing, chosen: NDArray[np.bool_]
) -> tuple[Hit, ...]:
    """Return a hit for each pair of branches whose gap is below the limits.

    Parameters
    ----------
    subject, limits
        As for a rule; ``error`` and ``warning`` are the least gaps.
    found
        Pairs of capsules.
    chosen
        Which of them count, shape (k,).
    """
    low = chosen & (found.gap_mm < max(limits["error"], limits["warning"]))
    nears, pairs = near_branches(subject, found, low)
    hits = []
    for near in nears:
        breach = limits.least(near.gap_mm)
        if breach:
            hits.append(
                Hit(
                    message="too little film is left between the branches: move them apart",
                    severity=breach.severity,
                    measured=near.gap_mm,
                    limit=breach.limit,
                    branches=near.branches,
                    at_mm=near.at_mm,
                    marker=near.marker,
                )
            )
    return (*hits, *rest_hits(pairs, "come too near each other"))


OVERLAP = Rule(
    id="VF-T03",
    title="branches that are not joined do not overlap when flat",
    unit="mm",
    reason="a flat sheet has no room for two branches at one place",
    look=look_overlap,
)
CLEARANCE = Rule(
    id="VF-C01",
    title="clearance between branches",
    unit="mm",
    limits={"error": 3.0, "warning": 5.0},
    reason="seam, kerf and heat of two outlines need room between them, or they melt into one",
    look=look_clearance,
)
