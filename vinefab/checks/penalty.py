"""How far a design is from being cuttable, as one number for an optimizer."""

import math
from collections.abc import Iterable

import numpy as np

from vinefab.checks.clearance import CLEARANCE
from vinefab.checks.crotches import ANGLE, CROTCH
from vinefab.checks.extent import excess_mm
from vinefab.checks.joints import bare_gaps
from vinefab.checks.packing import occupancies
from vinefab.checks.rooms import rooms_mm
from vinefab.checks.rule import LimitChanges, Rule
from vinefab.checks.shapes import Shapes, shapes_of
from vinefab.checks.spacing import spacing
from vinefab.checks.widths import LEAST_WIDTH, PACKING, WIDTH_RATIO
from vinefab.geometry.layout import flat_layout
from vinefab.geometry.stroke import LEAST_SEGMENT_MM
from vinefab.model.design import Design

DEFAULT_FILM_MM = 0.075
"""Two plies of 0.0375 mm."""

MOST_BRANCHES = 2000
"""Larger trees are not looked at branch by branch: they are penalized for their size instead."""


def fabrication_penalty(
    design: Design,
    limits: LimitChanges | None = None,
    *,
    film_mm: float = DEFAULT_FILM_MM,
    sheet_mm: tuple[float, float] | None = None,
) -> float:
    """Return how far a design is from passing the cheap geometric rules; 0 when it does.

    Looked at are the error limits of VF-W01, VF-W02, VF-W03, VF-C01, VF-C02, VF-C03 and, as
    negative clearance, VF-T03; with pouches also their clearance (VF-C07), and VF-S01 where a
    sheet is given. A design without penalty has no error from these rules; fillets count with
    their designed radius, so that a few designs whose fillets the outline would cut down are
    penalized without need.

    Parameters
    ----------
    design
        The design.
    limits
        Limits that replace the defaults, as for `vinefab.checks.run.run_checks`. Raise the error
        limits to keep a margin.
    film_mm
        Thickness of all plies together, for the packing.
    sheet_mm
        Width and height that the flat robot must fit into after a turn, or None if any size
        will do. Take off a few millimetres for seam, kerf and the overcut at the mouth.

    Returns
    -------
    float
        Sum over the kinds of rules of ``log(1 + sum of violation depths)``, each depth relative
        to its limit. It falls steadily as branches part, also while they still cross, so that a
        search can follow it; the logarithm keeps a hopeless tree below about 100.
    """
    changed = limits or {}
    kinds = (
        _widths(design, changed),
        _joints(design, changed),
        _packing(design, changed, film_mm),
        _on_sheet(design, changed, sheet_mm),
    )
    return math.fsum(math.log1p(depth) for depth in kinds)


def _limit(rule: Rule, changed: LimitChanges, name: str = "error") -> float:
    return rule.limits_with(changed.get(rule.id, {}))[name]


def _short_of(values: Iterable[float], limit: float) -> float:
    """Return the summed depths of values, none negative, that should be at least a limit."""
    return math.fsum((limit - value) / limit for value in values if value < limit)


def _over(values: Iterable[float], limit: float) -> float:
    """Return the summed depths of values that should be at most a limit; each at most 10."""
    scale = max(abs(limit), 1e-9)
    return math.fsum(min(10.0, (value - limit) / scale) for value in values if value > limit)


def _widths(design: Design, changed: LimitChanges) -> float:
    widths_mm, ends_mm = design.build.widths_mm, design.build.end_widths_mm
    ratios = (wide / narrow for wide, narrow in zip(ends_mm, widths_mm[1:], strict=False))
    narrow = _short_of(ends_mm, _limit(LEAST_WIDTH, changed))
    return narrow + _short_of(ratios, _limit(WIDTH_RATIO, changed))


def _joints(design: Design, changed: LimitChanges) -> float:
    gaps = bare_gaps(design)
    angles_deg = (math.degrees(angle_rad) for angle_rad, _ in gaps)
    narrow = _short_of(angles_deg, _limit(ANGLE, changed))
    webbed = _over((share for _, share in gaps), _limit(CROTCH, changed))
    return narrow + webbed + sum(_crowded(*room) for room in rooms_mm(design))


def _crowded(room_mm: float, length_mm: float) -> float:
    """Return how much of a branch is missing for its two ends to fit on it, at most 10."""
    return min(10.0, max(0.0, (LEAST_SEGMENT_MM - room_mm) / length_mm))


def _packing(design: Design, changed: LimitChanges, film_mm: float) -> float:
    shares = occupancies(design, film_mm, _limit(PACKING, changed, "packing"))
    return _over((100.0 * share for share in shares), _limit(PACKING, changed))


def _on_sheet(design: Design, changed: LimitChanges, sheet_mm: tuple[float, float] | None) -> float:
    if design.branch_count > MOST_BRANCHES:
        return float(design.branch_count) ** 2
    shapes = shapes_of(flat_layout(design), design.build)
    near = _too_near(shapes, _limit(CLEARANCE, changed))
    if sheet_mm is None:
        return near
    return near + max(0.0, excess_mm(shapes, sheet_mm) / min(sheet_mm))


def _too_near(shapes: Shapes, clearance_mm: float) -> float:
    """Return the summed depths of all pairs that are nearer than a clearance.

    A pair counts from 0 (just clear) to 1 (centre lines touch), and where centre lines cross from
    1 to 2, by how far the nearer end would have to be drawn back.
    """
    found = spacing(shapes, clearance_mm)
    room_mm = clearance_mm + shapes.most_half_mm[found.first] + shapes.most_half_mm[found.second]
    near = np.maximum(0.0, (clearance_mm - found.gap_mm) / room_mm)
    crossing = found.crossing_mm / (found.crossing_mm + room_mm)
    return float(near.sum() + crossing.sum())
