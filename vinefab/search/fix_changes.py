"""The changes that a fix makes to a design, and their costs."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from vinefab.core.limits import deg, rad
from vinefab.core.plain_text import some_of
from vinefab.model.design import Branch, Build, Design, Level

WEIGHTS = {
    "branches": 2.0,
    "length": 1.0,
    "angle": 1.0,
    "growth": 0.5,
    "width": 0.5,
    "taper": 0.25,
    "pouch": 0.5,
    "fillet": 0.1,
    "tail": 0.1,
    "pressure": 0.1,
}
"""Cost of a change by its kind: of a length or width by the absolute logarithm of its ratio, of an
angle by its change in radians, of pruned branches by the logarithm of the planned length left.
Where the robot goes counts most, how it is made least; the numbers are vinefab's own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignChange:
    """One value of a design that was changed."""

    kind: str  # key of `WEIGHTS`
    what: str  # which value (``level 2 length``, ``left angle``)
    before: float  # in `unit`
    after: float  # in `unit`
    unit: str  # empty for counts
    cost: float  # its share of the cost of all changes

    @property
    def text(self) -> str:
        """The change as a line for the user."""
        unit = f" {self.unit}" if self.unit else ""
        percent = 100.0 * (self.after / self.before - 1.0) if self.before else 0.0
        relative = f" ({percent:+.1f} %)" if self.unit not in ("", "deg") and percent else ""
        return f"{self.what}: {self.before:.4g} -> {self.after:.4g}{unit}{relative}"


def design_changes(before: Design, after: Design) -> tuple[DesignChange, ...]:
    """Return every value that differs between a design and its fixed version."""
    unchanged = 1e-9
    return tuple(change for change in _changes(before, after) if change.cost > unchanged)


def change_cost(before: Design, after: Design) -> float:
    """Return the weighted sum of all changes, 0 for the same design."""
    return math.fsum(change.cost for change in design_changes(before, after))


def planned_length_mm(trunk_mm: float, levels: tuple[Level, ...]) -> float:
    """Return the planned length of all branches together."""
    total, count = trunk_mm, 1
    for level in levels:
        count *= level.branches
        mean = (1.0 + level.growth) / 2.0 if level.branches > 1 else 1.0
        total += count * level.length_mm * mean
    return total


def pruning_cost(before: Design, branches: tuple[int, ...]) -> float:
    """Return the cost of keeping only some branches, by the planned length that is left."""
    kept = tuple(
        level.changed(
            branches=count,
            length_mm=level.length_mm
            * (1.0 if count > 1 or level.branches == 1 else (1.0 + level.growth) / 2.0),
        )
        for level, count in zip(before.levels, branches, strict=False)
    )
    whole = planned_length_mm(before.trunk_length_mm, before.levels)
    left = planned_length_mm(before.trunk_length_mm, kept)
    return loss_cost(whole, left)


def loss_cost(whole_mm: float, left_mm: float) -> float:
    """Return the cost of keeping only so much of a planned length."""
    return WEIGHTS["branches"] * max(0.0, math.log(whole_mm / left_mm))


def _changes(before: Design, after: Design) -> Iterator[DesignChange]:
    """Yield the change of every value: where the robot goes, then how it is made."""
    if after.branches is None:
        yield from _level_changes(before, after)
    else:
        yield from _branch_changes(before.by_branches, after)
    yield from build_changes(before.build, after.build)


def _level_changes(before: Design, after: Design) -> Iterator[DesignChange]:
    """Yield the changes of trunk and levels."""
    counts = tuple(level.branches for level in after.levels)
    if counts != tuple(level.branches for level in before.levels):
        yield _fewer(before, after, pruning_cost(before, counts))
    yield _relative("length", "trunk length", before.trunk_length_mm, after.trunk_length_mm)
    for number, (old, new) in enumerate(zip(before.levels, after.levels, strict=False), start=2):
        yield _relative("length", f"level {number} length", old.length_mm, new.length_mm)
        if new.branches == 1:
            continue
        yield _turned(f"level {number} fan", old.fan_rad, new.fan_rad)
        yield _relative("growth", f"level {number} growth", old.growth, new.growth, "%", 100.0)


def _branch_changes(before: Design, after: Design) -> Iterator[DesignChange]:
    """Yield the changes of trunk and branches, by their names."""
    row = {name: number for number, name in enumerate(before.names)}
    if gone := [name for name in before.names if name not in after.names]:
        left_mm = sum(float(before.tree.length_mm[row[name]]) for name in after.names)
        cost = loss_cost(before.tree.total_length_mm, left_mm)
        yield _fewer(before, after, cost, f", without {some_of(gone, 5)}")
    given = {one.name: one for one in before.branches or ()}
    own = {one.name: one for one in after.branches or ()}
    for number, name in enumerate(after.names):
        old_mm = float(before.tree.length_mm[row[name]])
        yield _relative("length", f"{name} length", old_mm, float(after.tree.length_mm[number]))
        if name in own:
            yield _turned(f"{name} angle", rad(given[name].angle_deg), rad(own[name].angle_deg))
        bends = zip(before.tree.bends_of(row[name]), after.tree.bends_of(number), strict=False)
        for bend, (old, new) in enumerate(bends, start=1):
            yield _turned(f"{name} bend {bend} angle", old[1], new[1])
            yield _relative("length", f"{name} bend {bend} place", old[0], new[0])
        if name in own:
            yield from _own_changes(given[name], own[name])


def _own_changes(before: Branch, after: Branch) -> Iterator[DesignChange]:
    """Yield the changes of the sizes that a branch has for itself."""
    for kind, key, unit, scale in (
        ("width", "width_mm", "mm", 1.0),
        ("taper", "taper", "%", 100.0),
        ("fillet", "fillet_mm", "mm", 1.0),
    ):
        old, new = getattr(before, key), getattr(after, key)
        if old is not None and new is not None:
            yield _relative(kind, f"{before.name} {kind}", old, new, unit, scale)


def build_changes(one: Build, two: Build) -> Iterator[DesignChange]:
    """Yield the change of every value of a build, some of its levels being left out."""
    for number, pair in enumerate(zip(one.widths_mm, two.widths_mm, strict=False), start=1):
        yield _relative("width", f"level {number} width", *pair)
    count = len(two.widths_mm)
    old_new = (build.taper[:count] or count * (1.0,) for build in (one, two))
    for number, pair in enumerate(zip(*old_new, strict=True), start=1):
        yield _relative("taper", f"level {number} taper", *pair, "%", 100.0)
    for number, pair in enumerate(zip(one.fillet_mm, two.fillet_mm, strict=False), start=2):
        yield _relative("fillet", f"level {number} fillet", *pair)
    yield _relative("tail", "the tail", one.tail_mm, two.tail_mm)
    yield _relative("pressure", "the pressure", one.pressure_kpa, two.pressure_kpa, "kPa")
    for name in ("radius_mm", "length_mm", "width_mm"):
        old_mm, new_mm = getattr(one.pouch, name, None), getattr(two.pouch, name, None)
        if old_mm is not None and new_mm is not None:
            size = name.removesuffix("_mm")
            yield _relative("pouch", f"{size} of the pouch", old_mm, new_mm)


def _fewer(before: Design, after: Design, cost: float, which: str = "") -> DesignChange:
    """Return the change of the number of branches."""
    return DesignChange(
        kind="branches",
        what=f"branches{which}",
        before=float(before.branch_count),
        after=float(after.branch_count),
        unit="",
        cost=max(1e-6, cost),
    )


def _turned(what: str, before_rad: float, after_rad: float) -> DesignChange:
    """Return the change of an angle."""
    return DesignChange(
        kind="angle",
        what=what,
        before=deg(before_rad),
        after=deg(after_rad),
        unit="deg",
        cost=WEIGHTS["angle"] * abs(after_rad - before_rad),
    )


def _relative(
    kind: str, what: str, before: float, after: float, unit: str = "mm", scale: float = 1.0
) -> DesignChange:
    """Return a change with a logarithmic cost; from or to zero it costs as much as doubling."""
    same = before == after
    size = 0.0 if same else math.log(2.0)
    if not same and before > 0.0 and after > 0.0:
        size = abs(math.log(after / before))
    return DesignChange(
        kind=kind,
        what=what,
        before=before * scale,
        after=after * scale,
        unit=unit,
        cost=WEIGHTS[kind] * size,
    )
