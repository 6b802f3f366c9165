"""The ways in which a design may be changed, as a vector that is zero where nothing is."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from vinefab.core.units import deg, rad
from vinefab.core.validation import Floats
from vinefab.fabrication.rules.fix_targets import FixTargets, change_cost, pruning_cost
from vinefab.model.design import Build, Design, Level, Pouch

Variable = tuple[str, int]
"""What is changed (length, fan, growth, width, pouch), and on which level, from 0."""

_DECIMALS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixSpace:
    """All changes of one design with some of its branches kept."""

    design: Design  # the design as it was
    branches: tuple[int, ...]  # children per parent on each level after the trunk that is kept
    # what each entry of a vector changes: by its logarithm, angles in radians
    variables: tuple[Variable, ...]
    bench: FixTargets  # what settles fillets, tail and pressure

    @classmethod
    def of(cls, design: Design, branches: tuple[int, ...], bench: FixTargets) -> "FixSpace":
        """Return the changes of a design with some of its branches kept."""
        depth = 1 + len(branches)
        wide = [level for level, count in enumerate(branches, start=1) if count > 1]
        variables: list[Variable] = [("length", level) for level in range(depth)]
        variables += [("fan", level) for level in wide]
        variables += [("growth", level) for level in wide if design.levels[level - 1].growth != 1.0]
        variables += [("width", level) for level in range(depth)]
        variables += [("pouch", 0)] if design.build.pouch else []
        return cls(design=design, branches=branches, variables=tuple(variables), bench=bench)

    def __len__(self) -> int:
        return len(self.variables)

    def at(self, x: Floats) -> Design:
        """Return the design at a vector, numbers rounded to 0.001 mm, settled by the bench."""
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
            build=self.bench.settled(build),
        )

    def cost(self, x: Floats) -> float:
        """Return what the change to a vector costs, pruned branches included."""
        return change_cost(self.design, self.at(x))

    def directions(self) -> Floats:
        """Return the ways to go from a vector, shape (k, n): single values and groups of them."""
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
    """Return every way to keep branches of a design, all of them first, by the length lost.

    Whole levels may go from the deepest on; on the others, every parent keeps as many children.
    """
    counts = [level.branches for level in design.levels]
    ways = [
        way
        for depth in range(len(counts), -1, -1)
        for way in product(*(_fewer(count) for count in counts[:depth]))
    ]
    return sorted(ways, key=lambda way: (pruning_cost(design, way), -len(way), way))


def _fewer(count: int) -> Sequence[int]:
    """Return up to six numbers of children from all down to one."""
    steps = np.unique(np.geomspace(1, count, 6).round().astype(int)) if count > 6 else None
    return range(count, 0, -1) if steps is None else steps[::-1].tolist()


def _scaled_mm(value_mm: float, factor: float) -> float:
    """Return a length times a factor, rounded; one that does not change stays as it is."""
    return value_mm if factor == 1.0 else max(10.0**-_DECIMALS, round(value_mm * factor, _DECIMALS))


def _scaled(pouch: Pouch | None, factor: float) -> Pouch | None:
    if pouch is None or factor == 1.0:
        return pouch
    sizes_mm = (pouch.radius_mm, pouch.length_mm, pouch.width_mm)
    radius_mm, length_mm, width_mm = (
        None if size_mm is None else _scaled_mm(size_mm, factor) for size_mm in sizes_mm
    )
    return Pouch(shape=pouch.shape, radius_mm=radius_mm, length_mm=length_mm, width_mm=width_mm)
