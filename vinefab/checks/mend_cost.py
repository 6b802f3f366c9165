"""How much a changed design differs from the one that it was made of."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from vinefab.core.units import deg
from vinefab.model.design import Build, Design, Level

WEIGHTS = {
    "branches": 2.0,
    "length": 1.0,
    "angle": 1.0,
    "growth": 0.5,
    "width": 0.5,
    "pouch": 0.5,
    "fillet": 0.1,
    "tail": 0.1,
    "pressure": 0.1,
}
"""What a change of each kind costs: a length or width by its relative change (absolute logarithm),
an angle by its change in radians, pruned branches by the logarithm of the planned length left.
Where the robot goes counts most, how it is made least; the numbers are vinefab's own."""

_UNCHANGED = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One value of a design that was changed.

    Parameters
    ----------
    what
        Which value (``level 2 length``).
    before, after
        Its values, in ``unit``.
    unit
        Their unit, empty for numbers of things.
    cost
        Its share of the whole change.
    """

    what: str
    before: float
    after: float
    unit: str
    cost: float

    @property
    def text(self) -> str:
        """Return the change in words."""
        unit = f" {self.unit}" if self.unit else ""
        percent = 100.0 * (self.after / self.before - 1.0) if self.before else 0.0
        relative = f" ({percent:+.1f} %)" if self.unit not in ("", "deg") and percent else ""
        return f"{self.what}: {self.before:.4g} -> {self.after:.4g}{unit}{relative}"


def changes(before: Design, after: Design) -> tuple[Change, ...]:
    """Return every value that differs between two designs, the later one pruned or not.

    Parameters
    ----------
    before
        The design as it was.
    after
        The same design changed; it may have fewer branches and fewer levels.
    """
    found = [*_pruned(before, after), *_sizes(before, after), *_built(before.build, after.build)]
    return tuple(change for change in found if change.cost > _UNCHANGED)


def change_cost(before: Design, after: Design) -> float:
    """Return the weighted sum of all changes, 0 for the same design."""
    return math.fsum(change.cost for change in changes(before, after))


def planned_length_mm(trunk_mm: float, levels: tuple[Level, ...]) -> float:
    """Return the planned length of all branches together."""
    total, count = trunk_mm, 1
    for level in levels:
        count *= level.branches
        mean = (1.0 + level.growth) / 2.0 if level.branches > 1 else 1.0
        total += count * level.length_mm * mean
    return total


def pruning_cost(before: Design, branches: tuple[int, ...]) -> float:
    """Return what it costs to keep only some branches, by the planned length that is left.

    Parameters
    ----------
    before
        The design.
    branches
        Children per parent on each level after the trunk that is kept.
    """
    kept = tuple(
        Level(
            branches=count,
            length_mm=level.length_mm * (1.0 if count > 1 else _mean_share(level)),
            growth=level.growth,
            fan_rad=level.fan_rad,
        )
        for level, count in zip(before.levels, branches, strict=False)
    )
    whole = planned_length_mm(before.trunk_length_mm, before.levels)
    left = planned_length_mm(before.trunk_length_mm, kept)
    return WEIGHTS["branches"] * max(0.0, math.log(whole / left))


def _mean_share(level: Level) -> float:
    """Return the mean length of a level's branches over that of the first."""
    return (1.0 + level.growth) / 2.0 if level.branches > 1 else 1.0


def _pruned(before: Design, after: Design) -> Iterator[Change]:
    counts = tuple(level.branches for level in after.levels)
    if counts != tuple(level.branches for level in before.levels):
        yield Change(
            what="branches",
            before=float(before.branch_count),
            after=float(after.branch_count),
            unit="",
            cost=max(1e-6, pruning_cost(before, counts)),
        )


def _sizes(before: Design, after: Design) -> Iterator[Change]:
    yield _relative("length", "trunk", before.trunk_length_mm, after.trunk_length_mm)
    for number, (old, new) in enumerate(zip(before.levels, after.levels, strict=False), start=2):
        yield _relative("length", f"level {number}", old.length_mm, new.length_mm)
        if new.branches == 1:
            continue
        yield Change(
            what=f"level {number} fan",
            before=deg(old.fan_rad),
            after=deg(new.fan_rad),
            unit="deg",
            cost=WEIGHTS["angle"] * abs(new.fan_rad - old.fan_rad),
        )
        grown = _relative("growth", f"level {number}", old.growth, new.growth, "%", 100.0)
        yield grown


def _built(before: Build, after: Build) -> Iterator[Change]:
    for number, pair in enumerate(zip(before.widths_mm, after.widths_mm, strict=False), start=1):
        yield _relative("width", f"level {number}", *pair)
    for number, pair in enumerate(zip(before.fillet_mm, after.fillet_mm, strict=False), start=2):
        yield _relative("fillet", f"level {number}", *pair)
    yield _relative("tail", "the", before.tail_mm, after.tail_mm)
    yield _relative("pressure", "the", before.pressure_kpa, after.pressure_kpa, "kPa")
    for name in ("radius_mm", "length_mm", "width_mm"):
        old, new = getattr(before.pouch, name, None), getattr(after.pouch, name, None)
        if old is not None and new is not None:
            yield _relative("pouch", name.removesuffix("_mm").join(("", " of the")), old, new)


def _relative(
    kind: str, where: str, before: float, after: float, unit: str = "mm", scale: float = 1.0
) -> Change:
    """Return a change that counts by its logarithm; from or to nothing it counts as doubled."""
    same = before == after
    size = 0.0 if same else math.log(2.0)
    if not same and before > 0.0 and after > 0.0:
        size = abs(math.log(after / before))
    return Change(
        what=f"{where} {kind}",
        before=before * scale,
        after=after * scale,
        unit=unit,
        cost=WEIGHTS[kind] * size,
    )
