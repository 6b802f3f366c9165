"""Costs of designs, from the design alone: minimized beside a score, or limited in ``[space]``."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.outline.ends import Leaf, corner_radii_mm
from vinefab.model.design import Build, default_fillets_mm
from vinefab.search.design_batch import DesignBatch

BuildOf = Callable[[int], Build]
"""Returns the build of the designs with so many levels; shallower ones begin with its widths."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """A cost of designs."""

    of: Callable[[DesignBatch, BuildOf], Floats]  # one value per design, shape (m,)
    unit: str
    limit_key: str  # key of its limit in ``[space]`` of a run file


def film_lengths_mm(designs: DesignBatch, _: BuildOf) -> Floats:
    """Return the planned length of all branches together, the trunk included."""
    return np.asarray(_level_lengths_mm(designs).sum(axis=1))


def film_areas_mm2(designs: DesignBatch, build_of: BuildOf) -> Floats:
    """Return the lay-flat area of all branches together: length times width."""
    lengths_mm = _level_lengths_mm(designs)
    width_mm = np.array(build_of(lengths_mm.shape[1]).widths_mm)
    return np.asarray(lengths_mm @ width_mm)


def branch_numbers(designs: DesignBatch, _: BuildOf) -> Floats:
    """Return the number of branches, the trunk included."""
    return np.array(designs.sizes, dtype=np.float64)


def _level_lengths_mm(designs: DesignBatch) -> Floats:
    """Return the planned length of all branches of each level, trunk first, shape (m, n + 1)."""
    # Lengths in a fan rise evenly from the first child to the last; an only child is the first.
    last = np.where(designs.branches == 1, 1.0, designs.growth)
    middle_mm = designs.length_mm * (1.0 + last) / 2.0
    return designs.counts.astype(np.float64) * np.column_stack([designs.trunk_mm, middle_mm])


def sheet_areas_mm2(designs: DesignBatch, build_of: BuildOf) -> Floats:
    """Return the area of the rectangle along the trunk that holds the flat robot.

    With tail, widths and pouches; without seam, kerf and what a machine leaves free at the edge.
    """
    # Some at a time, because large trees take much memory.
    ends = np.flatnonzero(np.diff(np.cumsum(designs.sizes) // BRANCHES_AT_ONCE)) + 1
    parts = np.split(np.arange(len(designs)), ends)
    boxes = [_sheet_boxes_mm(designs.part(rows), build_of) for rows in parts if len(rows)]
    return np.concatenate([np.empty(0), *((high - low).prod(axis=1) for low, high in boxes)])


BRANCHES_AT_ONCE = 200_000


def _sheet_boxes_mm(designs: DesignBatch, build_of: BuildOf) -> tuple[Floats, Floats]:
    """Return the corners of the flat robots' boxes, shape (m, 2) each; trunks point along +x."""
    m, most = len(designs), designs.counts.shape[1]
    half_mm, tail_mm = np.array(build_of(most).widths_mm) / 2.0, build_of(most).tail_mm
    low, high = np.full((m, 2), [-tail_mm, -half_mm[0]]), np.full((m, 2), [0.0, half_mm[0]])
    # Joints and tips of one level after the other; `row` is the design of each.
    row, heading = np.arange(m), np.zeros(m)
    end_mm = np.column_stack([designs.trunk_mm, np.zeros(m)])
    for level in range(1, most + 1):
        reach_mm = np.full((len(row), 2), half_mm[level - 1])
        tips = designs.depth[row] == level
        reach_mm[tips] = np.maximum(reach_mm[tips], _tip_reach_mm(heading[tips], build_of(level)))
        np.minimum.at(low, row, end_mm - reach_mm)
        np.maximum.at(high, row, end_mm + reach_mm)
        if level < most:
            row, heading, end_mm = _children(
                designs, level, row[~tips], heading[~tips], end_mm[~tips]
            )
    return low, high


def _children(
    designs: DesignBatch, level: int, row: Ints, heading: Floats, end_mm: Floats
) -> tuple[Ints, Floats, Floats]:
    """Return design, heading and end of the children of some branches of a level."""
    count = designs.branches[row, level - 1]
    parent = np.repeat(np.arange(len(row)), count)
    place = np.arange(len(parent)) - np.repeat(np.cumsum(count) - count, count)
    row, count = row[parent], count[parent]
    # From 0 to 1 over the fan; an only child goes straight on, as long as the first.
    along = place / np.maximum(count - 1, 1)
    fan_rad, last = designs.fan_rad[row, level - 1], designs.growth[row, level - 1]
    heading = heading[parent] + np.where(count == 1, 0.0, fan_rad * (along - 0.5))
    length_mm = designs.length_mm[row, level - 1] * (1.0 + along * (last - 1.0))
    way = np.column_stack([np.cos(heading), np.sin(heading)])
    return row, heading, end_mm[parent] + length_mm[:, None] * way


def _tip_reach_mm(heading: Floats, build: Build) -> Floats:
    """Return how far pouches reach from their tips along x and y, shape (k, 2)."""
    pouch = build.pouch
    if pouch is None:
        return np.zeros((len(heading), 2))
    if pouch.shape == "round":
        return np.full((len(heading), 2), pouch.radius_mm)
    widths_mm = build.widths_mm
    fillets_mm = *default_fillets_mm((0.0, widths_mm[0])), *build.fillet_mm
    leaf = Leaf(half_mm=widths_mm[-1] / 2.0, lean_rad=0.0, fillet_mm=fillets_mm[-1])
    corner_mm = max(0.0, corner_radii_mm(pouch, leaf)[1])
    along_mm = (pouch.length_mm or 0.0) / 2.0 - corner_mm
    across_mm = (pouch.width_mm or 0.0) / 2.0 - corner_mm
    cos, sin = np.abs(np.cos(heading)), np.abs(np.sin(heading))
    reach = (cos * along_mm + sin * across_mm, sin * along_mm + cos * across_mm)
    return np.column_stack(reach) + corner_mm


COSTS: Mapping[str, Cost] = MappingProxyType(
    {
        "film_length": Cost(of=film_lengths_mm, unit="mm", limit_key="most_film_length_mm"),
        "film_area": Cost(of=film_areas_mm2, unit="mm2", limit_key="most_film_area_mm2"),
        "sheet_area": Cost(of=sheet_areas_mm2, unit="mm2", limit_key="most_sheet_area_mm2"),
        "branches": Cost(of=branch_numbers, unit="", limit_key="most_branches"),
    }
)
"""Costs by their names in run files."""


def limit_excess(designs: DesignBatch, build_of: BuildOf, most: Mapping[str, float]) -> Floats:
    """Return by how much designs exceed limits, relative to each and added up, shape (m,).

    Parameters
    ----------
    most
        Name of a cost to its limit. A design within all of them has an excess of 0.
    """
    excess = np.zeros(len(designs))
    for name, limit in most.items():
        excess += np.maximum(0.0, COSTS[name].of(designs, build_of) / limit - 1.0)
    return excess


def least_costs(smallest: DesignBatch, build_of: BuildOf) -> dict[str, float]:
    """Return what no design of a space goes below, given the one at the space's lower bounds.

    All but the area of sheet rise with every bound; of that the trunk with its tail is certain.
    """
    (trunk_mm,), build = smallest.trunk_mm.tolist(), build_of(1)
    least = {"sheet_area": (trunk_mm + build.tail_mm) * build.widths_mm[0]}
    for name in ("film_length", "film_area", "branches"):
        least[name] = float(COSTS[name].of(smallest, build_of)[0])
    return least


def exceeded_limits(
    designs: DesignBatch, build_of: BuildOf, most: Mapping[str, float]
) -> Iterator[str]:
    """Yield each limit that the first design exceeds, in words."""
    for name, limit in most.items():
        cost, value = COSTS[name], float(COSTS[name].of(designs, build_of)[0])
        if value > limit:
            yield f"space.{cost.limit_key} ({cost_text(name, value)}, limit {limit:g})"


def cost_text(name: str, value: float) -> str:
    """Return a cost with its unit, in words.

    Examples
    --------
    >>> cost_text("film_length", 812.3)
    'film length 812 mm'
    """
    unit = COSTS[name].unit
    return f"{name.replace('_', ' ')} {value:.0f}{f' {unit}' if unit else ''}"
