"""Settings of the search space: the range of every variable, and how designs are built."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from vinefab.core.errors import BadInputError
from vinefab.model.checked import LARGEST_MM, number, positive
from vinefab.model.design import (
    DEFAULT_PRESSURE_KPA,
    DEFAULT_TAIL_MM,
    DEFAULT_TRUNK_WIDTH_MM,
    DEFAULT_WIDTH_RATIO,
    MOST_LEVELS,
    Build,
    Pouch,
    default_fillets_mm,
)

LIMITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "length_mm": (0.1, LARGEST_MM),
        "angle_deg": (0.0, 360.0),
        "branches": (1, 1000),
        "growth_percent": (0.1, 10_000.0),
    }
)
"""What a design may hold at all, per variable of a level."""

WHOLE = ("levels", "branches")


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """The range of one variable; fixed when both ends are the same.

    Parameters
    ----------
    low, high
        Both allowed.
    """

    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SpaceSettings:
    """Ranges of the variables; the defaults are the paper's Table 1, lengths read as mm.

    Parameters
    ----------
    levels
        Number of levels n, the trunk included.
    length_mm
        Length of the trunk and of each level's first child (BL).
    angle_deg
        Angle of the whole fan (theta).
    branches
        Children per parent (SPL).
    growth_percent
        Length of the last child over that of the first (LGF).
    by_level
        Ranges that differ for single levels: level number (1 is the trunk) to variable to range.
    """

    levels: Bounds = Bounds(low=2, high=5)
    length_mm: Bounds = Bounds(low=10.0, high=205.0)
    angle_deg: Bounds = Bounds(low=20.0, high=160.0)
    branches: Bounds = Bounds(low=2, high=4)
    growth_percent: Bounds = Bounds(low=10.0, high=160.0)
    by_level: Mapping[int, Mapping[str, Bounds]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check_bounds("space.levels", "levels", self.levels, (1, MOST_LEVELS))
        for name, limits in LIMITS.items():
            _check_bounds(f"space.{name}", name, getattr(self, name), limits)
        for number_, table in self.by_level.items():
            _check_level(number_, table, int(self.levels.high))

    def bounds(self, level: int, name: str) -> Bounds:
        """Return the range of a variable of one level."""
        given: Bounds = getattr(self, name)
        return self.by_level.get(level, {}).get(name, given)


@dataclass(frozen=True, slots=True, kw_only=True)
class BuildSettings:
    """How every design of a run is built.

    Parameters
    ----------
    trunk_width_mm
        Lay-flat width of the trunk.
    width_ratio
        Width of a level over that of the level before.
    tail_mm
        Straight length below the base.
    pressure_kpa
        Working gauge pressure.
    pouch
        Pouch at every leaf tip, or None.
    """

    trunk_width_mm: float = DEFAULT_TRUNK_WIDTH_MM
    width_ratio: float = DEFAULT_WIDTH_RATIO
    tail_mm: float = DEFAULT_TAIL_MM
    pressure_kpa: float = DEFAULT_PRESSURE_KPA
    pouch: Pouch | None = None

    def __post_init__(self) -> None:
        positive("build.trunk_width_mm", self.trunk_width_mm)
        positive("build.width_ratio", self.width_ratio, 1.0, "")
        number("build.tail_mm", self.tail_mm, 0.0, LARGEST_MM, "mm")
        number("build.pressure_kpa", self.pressure_kpa, 0.0, 10_000.0, "kPa")

    def build(self, depth: int) -> Build:
        """Return the build of a design with so many levels."""
        widths_mm = tuple(
            round(self.trunk_width_mm * self.width_ratio**level, 3) for level in range(depth)
        )
        return Build(
            widths_mm=widths_mm,
            fillet_mm=default_fillets_mm(widths_mm),
            tail_mm=self.tail_mm,
            pressure_kpa=self.pressure_kpa,
            pouch=self.pouch,
        )


def _check_bounds(key: str, name: str, bounds: Bounds, limits: tuple[float, float]) -> None:
    for value in (bounds.low, bounds.high):
        number(key, value, *limits)
        if name in WHOLE and value != int(value):
            raise BadInputError(key, value, "whole numbers")
    if bounds.low > bounds.high:
        raise BadInputError(key, [bounds.low, bounds.high], "a lower and an upper end, in order")


def _check_level(level: int, table: Mapping[str, Bounds], deepest: int) -> None:
    key = f"space.level {level}"
    if not 1 <= level <= deepest:
        allowed = f"1 (the trunk) to {deepest}, the most levels of the space"
        raise BadInputError("space.level.number", level, allowed)
    known = tuple(LIMITS) if level > 1 else ("length_mm",)
    for name, bounds in table.items():
        if name not in known:
            given = [bounds.low, bounds.high]
            raise BadInputError(f"{key}.{name}", given, f"only {', '.join(known)} there")
        _check_bounds(f"{key}.{name}", name, bounds, LIMITS[name])
