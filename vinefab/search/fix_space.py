"""What a fix may change, and all changes of a design of levels as vectors."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Protocol

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.frozen import FrozenMapping
from vinefab.core.limits import deg
from vinefab.core.validation import Floats
from vinefab.model.design import Build, Design, Level
from vinefab.search.fix_changes import change_cost, pruning_cost
from vinefab.search.fix_targets import FixTargets

Variable = tuple[str, int]
"""What is changed, one of `FIX_KINDS`, and where: a level from 0, or a branch or bend of a tree."""

FILLET_KINDS = frozenset({"fillet", "own fillet"})

BRANCHES = "branches"
KEEPS: Mapping[str, frozenset[str]] = FrozenMapping(
    {
        BRANCHES: frozenset(),
        "length": frozenset({"length", "growth", "place"}),
        "angle": frozenset({"fan", "angle", "bend"}),
        "width": frozenset({"width", "taper", "pouch", "own width", "own taper"}),
    }
)
"""What a user may tell a fix to keep, and the kinds of changes that this rules out.

Levels have fans and growth; trees have angles of branches, angles and places of bends, and widths,
tapers and fillets that a branch has for itself.
"""

FIX_KINDS = FILLET_KINDS.union(*KEEPS.values())
"""What a fix can change, besides the number of branches."""

FIX_DECIMALS, LEAST_TAPER = 3, 0.05

PENALTY_COST = 0.4
"""Estimated cost of clearing a unit of penalty, to rank the ways to prune."""


def parsed_keeps(texts: Iterable[str]) -> frozenset[str]:
    """Return the names of values to keep, from texts like ``branches,length``.

    >>> sorted(parsed_keeps(["branches, length", "angle"]))
    ['angle', 'branches', 'length']
    """
    words = [word.strip() for text in texts for word in text.split(",")]
    for word in words:
        if word not in KEEPS:
            allowed = f"{', '.join(KEEPS)}, one or more with commas between them"
            raise BadInputError("--keep", word, allowed)
    return frozenset(words)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixStage:
    """One step of a fix: what may change in it."""

    kinds: frozenset[str]  # of `FIX_KINDS`
    prunes: bool = False  # whether branches may be removed

    @property
    def groups(self) -> tuple[str, ...]:
        """Words of `KEEPS` whose values may change."""
        return tuple(word for word, kinds in KEEPS.items() if kinds and kinds <= self.kinds)


FILLETS = FixStage(kinds=FILLET_KINDS)


def fix_stages(keep: frozenset[str] = frozenset()) -> tuple[tuple[FixStage, ...], ...]:
    """Return the stages of a fix: those of one step compete, a later step is a last resort.

    A step has a stage for all kinds that may change, and one for every choice of them. So what is
    found while more is kept is found while less is kept, too.
    """
    free = [kinds for word, kinds in KEEPS.items() if kinds and word not in keep]
    chosen = [
        FILLETS.kinds.union(*some)
        for size in range(1 + len(free))
        for some in combinations(free, size)
    ]
    steps = [(FILLETS,), tuple(FixStage(kinds=kinds) for kinds in chosen[1:])]
    if BRANCHES not in keep:
        steps.append(tuple(FixStage(kinds=kinds, prunes=True) for kinds in chosen))
    return tuple(filter(None, steps))


class ChangeSpace(Protocol):
    """All changes of a design with some of its branches kept, as vectors: 0 for no change."""

    @property
    def design(self) -> Design:
        """The original."""
        ...

    @property
    def least_cost(self) -> float:
        """Cost of the branches that are left out."""
        ...

    @property
    def first_steps(self) -> int:
        """Steps of single values and groups before all values move together."""
        ...

    @property
    def distances(self) -> tuple[float, ...]:
        """Distances along the directions that are tried before steps; none where that is slow."""
        ...

    @property
    def steps_ahead(self) -> int:
        """Steps of a bisection whose trials are assessed at once: several where that is fast."""
        ...

    def __len__(self) -> int: ...

    def at(self, x: Floats) -> Design:
        """Return the design at a vector."""
        ...

    def penalty(self, x: Floats) -> float:
        """Return the distance of the design at a vector from its targets; 0 if it meets them."""
        ...

    def assessed(self, points: Iterable[Floats]) -> list[tuple[Floats, float, float]]:
        """Return vectors with their penalties, all evaluated at once, and costs."""
        ...

    def cost(self, x: Floats) -> float:
        """Return the cost of the change to a vector, pruned branches included."""
        ...

    def directions(self) -> Floats:
        """Return the search directions, shape (k, n): single values and groups of them."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixSpace:
    """All changes of one design with some of its branches kept, as vectors: 0 for no change."""

    design: Design  # the original
    branches: tuple[int, ...]  # children per parent on each level after the trunk that is kept
    # What each entry of a vector changes: angles in radians, all else by its logarithm.
    variables: tuple[Variable, ...]
    targets: FixTargets  # settle fillets, tail and pressure

    @classmethod
    def of(
        cls,
        design: Design,
        branches: tuple[int, ...],
        targets: FixTargets,
        kinds: frozenset[str] = FIX_KINDS,
    ) -> "FixSpace":
        """Return the space of some kinds of changes of a design with some of its branches kept."""
        depth = 1 + len(branches)
        wide = [level for level, count in enumerate(branches, start=1) if count > 1]
        variables: list[Variable] = [("length", level) for level in range(depth)]
        variables += [("fan", level) for level in wide]
        variables += [("growth", level) for level in wide if design.levels[level - 1].growth != 1.0]
        variables += [("width", level) for level in range(depth)]
        variables += [("taper", level) for level in range(depth - 1)]
        variables += [("fillet", level) for level in range(1, depth)]
        variables += [("pouch", 0)] if design.build.pouch else []
        used = tuple(variable for variable in variables if variable[0] in kinds)
        return cls(design=design, branches=branches, variables=used, targets=targets)

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def least_cost(self) -> float:
        """Cost of the branches that are left out."""
        return pruning_cost(self.design, self.branches)

    @property
    def first_steps(self) -> int:
        """Steps of single values and groups before all values move together."""
        return 20

    @property
    def distances(self) -> tuple[float, ...]:
        """Distances along the directions that are tried before steps: none, as that is slow."""
        return ()

    @property
    def steps_ahead(self) -> int:
        """Steps of a bisection whose trials are assessed at once."""
        return 1

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
        build = scaled_build(self.design.build, depth, scale)
        trunk_mm = scaled_mm(self.design.trunk_length_mm, scale.get("length", {}).get(0, 1.0))
        changed = self.design.changed(trunk_length_mm=trunk_mm, levels=levels, build=build)
        return self.targets.settled(changed)

    def penalty(self, x: Floats) -> float:
        """Return the distance of the design at a vector from its targets; 0 if it meets them."""
        return float(self.targets.penalties([self.at(x)])[0])

    def assessed(self, points: Iterable[Floats]) -> list[tuple[Floats, float, float]]:
        """Return vectors with their penalties, all evaluated at once, and costs."""
        designs = [(x, self.at(x)) for x in points]
        penalties = self.targets.penalties([design for _, design in designs]).tolist()
        return [
            (x, penalty, change_cost(self.design, design))
            for (x, design), penalty in zip(designs, penalties, strict=True)
        ]

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
        # All that narrows at one joint: the parent's end and the children's beginnings.
        for level in range(len(self.branches)):
            around = {("taper", level), ("width", level + 1)}
            row = np.array([float(variable in around) for variable in self.variables])
            rows += [row] if np.count_nonzero(row) > 1 else []
        return both_ways(rows)

    def _level(
        self, number: int, scale: dict[str, dict[int, float]], turned: dict[int, float]
    ) -> Level:
        old = self.design.levels[number - 1]
        growth = scale.get("growth", {}).get(number, 1.0)
        turn_rad = turned.get(number, 0.0)
        angle_deg = min(360.0, max(0.0, round(deg(old.fan_rad + turn_rad), FIX_DECIMALS)))
        percent = min(10_000.0, max(0.1, round(old.growth_percent * growth, FIX_DECIMALS)))
        return old.changed(
            branches=self.branches[number - 1],
            length_mm=scaled_mm(old.length_mm, scale.get("length", {}).get(number, 1.0)),
            angle_deg=angle_deg if turn_rad else old.angle_deg,
            growth_percent=old.growth_percent if growth == 1.0 else percent,
        )


def both_ways(rows: Iterable[Floats]) -> Floats:
    """Return different directions, at least one, and their opposites."""
    unique = np.unique(np.array([*rows]), axis=0)[::-1]
    return np.concatenate([unique, -unique])


def scaled_build(old: Build, depth: int, scale: Mapping[str, Mapping[int, float]]) -> Build:
    """Return the build of the first levels with some values times factors, by kind and level."""

    def scaled(kind: str, values_mm: tuple[float, ...], first: int = 0) -> tuple[float, ...]:
        factors = scale.get(kind, {})
        numbered = enumerate(values_mm, start=first)
        return tuple(scaled_mm(value, factors.get(level, 1.0)) for level, value in numbered)

    factors, tapers = scale.get("taper", {}), old.taper[:depth] or depth * (1.0,)
    changed = tuple(
        scaled_taper(ratio, factors.get(level, 1.0)) for level, ratio in enumerate(tapers)
    )
    pouch, factor = old.pouch, scale.get("pouch", {}).get(0, 1.0)
    if pouch and factor != 1.0:
        sizes_mm = {name: mm for name, mm in pouch if name != "shape" and mm is not None}
        pouch = pouch.changed(**{name: scaled_mm(mm, factor) for name, mm in sizes_mm.items()})
    return old.changed(
        widths_mm=scaled("width", old.widths_mm[:depth]),
        fillet_mm=scaled("fillet", old.fillet_mm[: depth - 1], first=1),
        taper=changed if old.taper[:depth] or min(changed) < 1.0 else (),
        pouch=pouch,
    )


def scaled_taper(ratio: float, factor: float) -> float:
    """Return a taper times a factor, rounded; an unchanged one is not rounded."""
    changed = min(1.0, max(LEAST_TAPER, round(ratio * factor, FIX_DECIMALS)))
    return ratio if factor == 1.0 else changed


def kept_branches(design: Design) -> list[tuple[int, ...]]:
    """Return the ways to prune a design, as children kept per level, by the length lost.

    Whole levels are removed from the deepest on; on the others, all parents keep equally many
    children. The first way keeps all branches.
    """
    fewer: list[Sequence[int]] = []  # up to six numbers of children on each level, from all to one
    for count in (level.branches for level in design.levels):
        some = np.geomspace(1, count, 6).round().astype(int)
        fewer.append(np.unique(some)[::-1].tolist() if count > 6 else range(count, 0, -1))
    prunings = [
        pruning for depth in range(len(fewer), -1, -1) for pruning in product(*fewer[:depth])
    ]
    return sorted(
        prunings, key=lambda pruning: (pruning_cost(design, pruning), -len(pruning), pruning)
    )


def scaled_mm(value_mm: float, factor: float) -> float:
    """Return a length times a factor, rounded; an unchanged one is not rounded."""
    least_mm = 10.0**-FIX_DECIMALS
    return value_mm if factor == 1.0 else max(least_mm, round(value_mm * factor, FIX_DECIMALS))
