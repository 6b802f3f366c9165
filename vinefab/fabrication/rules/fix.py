"""``check --fix``: the smallest change of a design that clears its errors.

The search is deterministic. Branches may be pruned; for each way to prune, every length, angle and
width is moved in the direction that lowers the penalty most for its cost, in steps that grow and
shrink, until no penalty is left; then every value moves back towards the original as far as the
rules allow. The cheapest result counts. It is the best that this search finds, not proven to be the
smallest there is.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vinefab.core.units import deg, rad
from vinefab.core.validation import Floats
from vinefab.fabrication.rules.fix_targets import FixTargets, change_cost, pruning_cost
from vinefab.model.design import Build, Design, Level, Pouch

Variable = tuple[str, int]
"""What is changed (length, fan, growth, width, pouch), and on which level, from 0."""

_DECIMALS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixSpace:
    """All changes of one design with some of its branches kept, as vectors: 0 for no change."""

    design: Design  # the original
    branches: tuple[int, ...]  # children per parent on each level after the trunk that is kept
    # What each entry of a vector changes: angles in radians, all else by its logarithm.
    variables: tuple[Variable, ...]
    targets: FixTargets  # settle fillets, tail and pressure

    @classmethod
    def of(cls, design: Design, branches: tuple[int, ...], targets: FixTargets) -> "FixSpace":
        """Return the space of a design with some of its branches kept."""
        depth = 1 + len(branches)
        wide = [level for level, count in enumerate(branches, start=1) if count > 1]
        variables: list[Variable] = [("length", level) for level in range(depth)]
        variables += [("fan", level) for level in wide]
        variables += [("growth", level) for level in wide if design.levels[level - 1].growth != 1.0]
        variables += [("width", level) for level in range(depth)]
        variables += [("pouch", 0)] if design.build.pouch else []
        return cls(design=design, branches=branches, variables=tuple(variables), targets=targets)

    def __len__(self) -> int:
        return len(self.variables)

    def at(self, x: Floats) -> Design:
        """Return the design at a vector, settled by the targets, numbers rounded to 0.001 mm."""
        by_kind: dict[str, dict[int, float]] = {}
        for (kind, level), value in zip(self.variables, x.tolist(), strict=True):
            by_kind.setdefault(kind, {})[level] = value
        scale = {
            kind: {level: math.exp(value) for level, value in values.items()}
            for kind, values in by_kind.items()
        }
        depth = 1 + len(self.branches)
        levels = tuple(
            self._level(number, scale, by_kind.get("fan", {})) for number in range(1, depth)
        )
        build = self._build(depth, scale)
        trunk_mm = _scaled_mm(self.design.trunk_length_mm, scale["length"][0])
        return replace(
            self.design,
            trunk_length_mm=trunk_mm,
            levels=levels,
            build=self.targets.settled(build),
        )

    def penalty(self, x: Floats) -> float:
        """Return how far the design at a vector is from its targets; 0 if it meets them."""
        return self.targets.penalty(self.at(x))

    def cost(self, x: Floats) -> float:
        """Return the cost of the change to a vector, pruned branches included."""
        return change_cost(self.design, self.at(x))

    def directions(self) -> Floats:
        """Return the search directions, shape (k, n): single values and groups of them."""
        rows = [*np.eye(len(self))]
        for kind in ("length", "fan", "width"):
            group = np.array([float(name == kind) for name, _ in self.variables])
            below = group * np.array([float(level > 0) for _, level in self.variables])
            rows += [one for one in (group, below) if np.count_nonzero(one) > 1]
        unique = np.unique(np.array(rows), axis=0)[::-1]
        return np.concatenate([unique, -unique])

    def _level(
        self, number: int, scale: dict[str, dict[int, float]], turned: dict[int, float]
    ) -> Level:
        old = self.design.levels[number - 1]
        growth = scale.get("growth", {}).get(number, 1.0)
        turn_rad = turned.get(number, 0.0)
        fan_rad = min(math.tau, max(0.0, rad(round(deg(old.fan_rad + turn_rad), _DECIMALS))))
        grown = min(100.0, max(0.001, round(old.growth * growth, 2 + _DECIMALS)))
        return Level(
            branches=self.branches[number - 1],
            length_mm=_scaled_mm(old.length_mm, scale["length"][number]),
            fan_rad=fan_rad if turn_rad else old.fan_rad,
            growth=old.growth if growth == 1.0 else grown,
        )

    def _build(self, depth: int, scale: dict[str, dict[int, float]]) -> Build:
        old = self.design.build
        widths_mm = tuple(
            _scaled_mm(width, scale["width"][level])
            for level, width in enumerate(old.widths_mm[:depth])
        )
        pouch = _scaled(old.pouch, scale.get("pouch", {}).get(0, 1.0))
        return replace(old, widths_mm=widths_mm, fillet_mm=old.fillet_mm[: depth - 1], pouch=pouch)


def kept_branches(design: Design) -> list[tuple[int, ...]]:
    """Return the ways to prune a design, as children kept per level, by the length lost.

    Whole levels are removed from the deepest on; on the others, all parents keep equally many
    children. The first way keeps all branches.
    """
    counts = [level.branches for level in design.levels]
    prunings = [
        pruning
        for depth in range(len(counts), -1, -1)
        for pruning in product(*(_fewer(count) for count in counts[:depth]))
    ]
    return sorted(
        prunings, key=lambda pruning: (pruning_cost(design, pruning), -len(pruning), pruning)
    )


def _fewer(count: int) -> Sequence[int]:
    """Return up to six numbers of children, from all to one."""
    steps = np.unique(np.geomspace(1, count, 6).round().astype(int)) if count > 6 else None
    return range(count, 0, -1) if steps is None else steps[::-1].tolist()


def _scaled_mm(value_mm: float, factor: float) -> float:
    """Return a length times a factor, rounded; an unchanged one is not rounded."""
    return value_mm if factor == 1.0 else max(10.0**-_DECIMALS, round(value_mm * factor, _DECIMALS))


def _scaled(pouch: Pouch | None, factor: float) -> Pouch | None:
    if pouch is None or factor == 1.0:
        return pouch
    sizes_mm = (pouch.radius_mm, pouch.length_mm, pouch.width_mm)
    radius_mm, length_mm, width_mm = (
        None if size_mm is None else _scaled_mm(size_mm, factor) for size_mm in sizes_mm
    )
    return Pouch(shape=pouch.shape, radius_mm=radius_mm, length_mm=length_mm, width_mm=width_mm)


MOST_PRUNINGS = 12
"""Most ways to prune that are searched in full, the most promising first."""

MOST_STEPS = 60
PENALTY_COST = 0.4
"""Estimated cost of clearing a unit of penalty, to rank the ways to prune."""

_FIRST_STEP, _LARGEST_STEP, _LEAST_STEP = 0.15, 0.4, 0.005
_BACKWARD = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedDesign:
    """A design that meets its targets."""

    design: Design
    cost: float  # weighted sum of its changes


def fix_design(
    design: Design, targets: FixTargets, progress: Callable[[float], None] | None = None
) -> FixedDesign | None:
    """Return the cheapest change found that meets the targets, or None if none was found.

    Parameters
    ----------
    progress
        Called with the share of the search that is done.
    """
    best: FixedDesign | None = None
    prunings = _ranked_prunings(design, targets)
    for number, pruning in enumerate(prunings):
        if progress:
            progress(number / len(prunings))
        if best is not None and pruning_cost(design, pruning) >= best.cost:
            continue
        space = FixSpace.of(design, pruning, targets)
        x = _descended(space, most_cost=best.cost if best else np.inf)
        if x is None:
            continue
        changed = space.at(_retracted(space, x))
        cost = change_cost(design, changed)
        if best is None or cost < best.cost:
            best = FixedDesign(design=changed, cost=cost)
    return best


def _ranked_prunings(design: Design, targets: FixTargets) -> list[tuple[int, ...]]:
    """Return ways to prune, the most promising first: little lost, and little penalty left."""

    def estimated_cost(pruning: tuple[int, ...]) -> float:
        space = FixSpace.of(design, pruning, targets)
        penalty = space.penalty(np.zeros(len(space)))
        return pruning_cost(design, pruning) + PENALTY_COST * penalty

    return sorted(kept_branches(design), key=estimated_cost)[:MOST_PRUNINGS]


def _descended(space: FixSpace, *, most_cost: float) -> Floats | None:
    """Return a vector without penalty, by steps that lower it most for their cost, or None."""
    directions, x = space.directions(), np.zeros(len(space))
    left, cost, step = space.penalty(x), space.cost(x), _FIRST_STEP
    for _ in range(MOST_STEPS):
        if left == 0.0:
            return x
        if cost >= most_cost or step < _LEAST_STEP:
            return None
        found = _best_step(space, x + step * directions, (left, cost))
        if found is None:
            step /= 2.0
            continue
        x, left, cost = found
        step = min(_LARGEST_STEP, 1.3 * step)
    return None


def _best_step(
    space: FixSpace, candidates: Floats, here: tuple[float, float]
) -> tuple[Floats, float, float] | None:
    """Return the candidate that lowers the penalty most for its cost, with penalty and cost."""
    left, cost = here
    best, best_worth = None, 0.0
    for x in candidates:
        design = space.at(x)
        penalty = space.targets.penalty(design)
        if penalty >= left - 1e-4 * left:
            continue
        total = change_cost(space.design, design)
        worth = (left - penalty) / (0.02 + max(0.0, total - cost))
        if worth > best_worth:
            best, best_worth = (x, penalty, total), worth
    return best


def _retracted(space: FixSpace, x: Floats) -> Floats:
    """Return a vector with its values moved back towards zero as far as no penalty arises."""
    x = _shrunk(space, x, np.ones(len(x), dtype=np.bool_))
    for _ in range(3):
        before = space.cost(x)
        for entry in np.argsort(-np.abs(x), kind="stable"):
            only = np.zeros(len(x), dtype=np.bool_)
            only[entry] = True
            x = _shrunk(space, x, only)
        if space.cost(x) > 0.99 * before:
            break
    return x


def _shrunk(space: FixSpace, x: Floats, which: NDArray[np.bool_]) -> Floats:
    """Return a vector with some entries as near to zero as bisection finds without penalty."""
    low, high, good = 0.0, 1.0, x
    if not np.any(x[which]):
        return x
    for turn in range(_BACKWARD):
        share = low if turn == 0 else (low + high) / 2.0
        trial = np.where(which, share * x, x)
        if space.penalty(trial) == 0.0:
            good, high = trial, share
            if turn == 0:
                return good
        else:
            low = share
    return good
