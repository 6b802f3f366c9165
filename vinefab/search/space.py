"""The search space: ranges of the design variables, designs as points, costs and their limits.

A search evaluates thousands of designs a second. Building each as an object, with its tree, would
take as long as growing it: many designs are arrays (`DesignBatch`). Results equal those of
`Space.design`, `Design.tree` and `vinefab.growth.plan.Plans.of` for single
designs, to the last bit.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, overload

import numpy as np
from annotated_types import Ge, Le, Unit
from pydantic import (
    BeforeValidator,
    Field,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.front_door import imported_later
from vinefab.core.frozen import FrozenMapping
from vinefab.core.table import Table
from vinefab.core.validation import LARGEST_MM, SMALLEST, Floats, Ints, number
from vinefab.growth.arrays import TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Feed, Plan, Plans, Spans
from vinefab.model.design import (
    DEFAULT_COMPENSATION,
    DEFAULT_MOUNTING,
    DEFAULT_PRESSURE_KPA,
    DEFAULT_TAIL_MM,
    DEFAULT_TRUNK_WIDTH_MM,
    DEFAULT_WIDTH_RATIO,
    MOST_BRANCHES,
    MOST_LEVELS,
    Build,
    Compensation,
    Design,
    Level,
    Mounting,
    PieceSettings,
    Pouch,
    check_levels,
    default_fillets_mm,
)
from vinefab.model.tree import BranchTree
from vinefab.outline.ends import Leaf, corner_radii_mm
from vinefab.search.optimizers.optimizer import SearchAxes
from vinefab.search.tree_batch import TreeBatch

if TYPE_CHECKING:
    from vinefab.growth import batch_kernel
else:
    batch_kernel = imported_later("vinefab.growth.batch_kernel")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DesignBatch:
    """Designs, m of them, with at most n levels below the trunk."""

    depth: Ints  # number of levels, the trunk included, shape (m,)
    trunk_mm: Floats  # length of the trunk, shape (m,)
    # as in `vinefab.model.design.Level`, shape (m, n); meaningless beyond a design's depth
    branches: Ints
    length_mm: Floats
    fan_rad: Floats
    growth: Floats
    # branches per level, the trunk first, shape (m, n + 1); capped just above MOST_BRANCHES
    counts: Ints

    def __len__(self) -> int:
        return len(self.depth)

    @classmethod
    def of(cls, *designs: Design) -> "DesignBatch":
        """Return a batch of some designs, all of levels.

        Raises
        ------
        BadInputError
            If one is written branch by branch.
        """
        for design in designs:
            check_levels(design, "a search of levels")
        below = max(design.depth for design in designs) - 1
        depth = np.array([design.depth for design in designs])
        branches, numbers = (
            np.ones((len(designs), below), dtype=np.int64),
            np.ones((3, len(designs), below)),
        )
        for row, design in enumerate(designs):
            for place, level in enumerate(design.levels):
                branches[row, place] = level.branches
                numbers[:, row, place] = level.length_mm, level.fan_rad, level.growth
        length_mm, fan_rad, growth = numbers
        return cls(
            depth=depth,
            trunk_mm=np.array([design.trunk_length_mm for design in designs]),
            branches=branches,
            length_mm=length_mm,
            fan_rad=fan_rad,
            growth=growth,
            counts=branch_counts(depth, branches),
        )

    @property
    def sizes(self) -> Ints:
        """Number of branches of each design, shape (m,)."""
        return np.asarray(self.counts.sum(axis=1))

    def part(self, rows: Ints) -> "DesignBatch":
        """Return some of the designs."""
        return DesignBatch(
            depth=self.depth[rows],
            trunk_mm=self.trunk_mm[rows],
            branches=self.branches[rows],
            length_mm=self.length_mm[rows],
            fan_rad=self.fan_rad[rows],
            growth=self.growth[rows],
            counts=self.counts[rows],
        )


def branch_counts(depth: Ints, branches: Ints) -> Ints:
    """Return the number of branches on each level, as in `DesignBatch.counts`."""
    below = np.arange(branches.shape[1]) < depth[:, None] - 1
    # The product may overflow; a cap just above the limit is enough.
    counts = np.ones((len(depth), 1 + branches.shape[1]))
    np.cumprod(np.where(below, branches, 0.0), axis=1, out=counts[:, 1:])
    return np.minimum(counts, MOST_BRANCHES + 1.0).astype(np.int64)


BuildOf = Callable[[int], Build]
"""Returns the build of the designs with so many levels; shallower ones begin with its widths."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """A cost of designs."""

    of: Callable[[DesignBatch | TreeBatch, BuildOf], Floats]  # one per design, shape (m,)
    unit: str
    limit_key: str  # key of its limit in ``[space]`` of a run file


def film_lengths_mm(designs: DesignBatch | TreeBatch, _: BuildOf) -> Floats:
    """Return the planned length of all branches together, the trunk included."""
    if isinstance(designs, TreeBatch):
        return designs.sums(designs.length_mm)
    return np.asarray(_level_lengths_mm(designs).sum(axis=1))


def film_areas_mm2(designs: DesignBatch | TreeBatch, build_of: BuildOf) -> Floats:
    """Return the lay-flat area of all branches together: length times width."""
    if isinstance(designs, TreeBatch):
        return designs.sums(designs.length_mm * (designs.width_mm + designs.end_width_mm) / 2.0)
    lengths_mm = _level_lengths_mm(designs)
    width_mm = np.array(build_of(lengths_mm.shape[1]).widths_mm)
    return np.asarray(lengths_mm @ width_mm)


def branch_numbers(designs: DesignBatch | TreeBatch, _: BuildOf) -> Floats:
    """Return the number of branches, the trunk included."""
    return np.array(designs.sizes, dtype=np.float64)


def _level_lengths_mm(designs: DesignBatch) -> Floats:
    """Return the planned length of all branches of each level, trunk first, shape (m, n + 1)."""
    # Lengths in a fan rise evenly from the first child to the last; an only child is the first.
    last = np.where(designs.branches == 1, 1.0, designs.growth)
    middle_mm = designs.length_mm * (1.0 + last) / 2.0
    return designs.counts.astype(np.float64) * np.column_stack([designs.trunk_mm, middle_mm])


def sheet_areas_mm2(designs: DesignBatch | TreeBatch, build_of: BuildOf) -> Floats:
    """Return the area of the rectangle along the trunk that holds the flat robot.

    With tail, widths and pouches; without seam, kerf and the machine's free margin.
    """
    if isinstance(designs, TreeBatch):
        corners = [_sheet_box_mm(tree, build_of) for tree in designs.trees]
        return np.array([float((high - low).prod()) for low, high in corners])
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


def _sheet_box_mm(tree: BranchTree, build_of: BuildOf) -> tuple[Floats, Floats]:
    """Return the corners of a flat robot's box, as `_sheet_boxes_mm`."""
    parts, build = tree.straight, build_of(int(tree.level.max()))
    reach_mm = np.repeat(np.maximum(parts.width_mm, parts.end_width_mm)[:, None] / 2.0, 2, axis=1)
    _, end_mm, heading = parts.laid_out()
    tips = parts.is_leaf
    reach_mm[tips] = np.maximum(reach_mm[tips], _tip_reach_mm(heading[tips], build))
    half_mm = parts.width_mm[0] / 2.0
    low = np.minimum((end_mm - reach_mm).min(axis=0), [-build.tail_mm, -half_mm])
    high = np.maximum((end_mm + reach_mm).max(axis=0), [0.0, half_mm])
    return low, high


def _tip_reach_mm(heading: Floats, build: Build) -> Floats:
    """Return the reach of pouches from their tips along x and y, shape (k, 2)."""
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


COSTS: Mapping[str, Cost] = FrozenMapping(
    {
        "film_length": Cost(of=film_lengths_mm, unit="mm", limit_key="most_film_length_mm"),
        "film_area": Cost(of=film_areas_mm2, unit="mm2", limit_key="most_film_area_mm2"),
        "sheet_area": Cost(of=sheet_areas_mm2, unit="mm2", limit_key="most_sheet_area_mm2"),
        "branches": Cost(of=branch_numbers, unit="", limit_key="most_branches"),
    }
)
"""Costs by their names in run files."""


def cost_text(name: str, value: float) -> str:
    """Return a cost with its name and unit.

    Examples
    --------
    >>> cost_text("film_length", 812.3)
    'film length 812 mm'
    """
    unit = COSTS[name].unit
    return f"{name.replace('_', ' ')} {value:.0f}{f' {unit}' if unit else ''}"


LIMITS: Mapping[str, tuple[float, float]] = FrozenMapping(
    {
        "length_mm": (0.1, LARGEST_MM),
        "angle_deg": (0.0, 360.0),
        "branches": (1, 1000),
        "growth_percent": (0.1, 10_000.0),
    }
)
"""Largest ranges of the variables of a level."""

WHOLE_NUMBERS = ("levels", "branches", "bends")

MOST_SPACE_BENDS = 8
"""Preformed bends of a branch that a search may place."""

SYMMETRIC_PERCENT = 100.0
"""Growth of a fan whose children are all as long: its left half mirrors its right one."""

LARGEST_LIMIT = 1e15
"""Largest limit of a cost, in its unit: it limits nothing."""


def _as_given(given: float, check: ValidatorFunctionWrapHandler) -> float:
    check(given)
    return given  # 2 stays 2: the ids of runs tell it from 2.0


_End = Annotated[float, WrapValidator(_as_given)]


class Bounds(Table):
    """The range of one variable, both ends included; fixed when they are the same."""

    low: _End
    high: _End


def _ends(given: object) -> object:
    """Return a range as files have it: ``[low, high]``, or one number where it is fixed."""
    if isinstance(given, Bounds | Mapping):
        return given
    ends: list[Any] = given if isinstance(given, list) else [given, given]
    if len(ends) != 2 or any(isinstance(e, bool) or not isinstance(e, int | float) for e in ends):
        raise ValueError("a number, or a range [low, high]")
    for place, end in enumerate(ends, start=1):
        if not math.isfinite(end):
            raise BadInputError(f"[{place}]", end, "a finite number")
    return {"low": float(ends[0]), "high": float(ends[1])}


Range = Annotated[Bounds, BeforeValidator(_ends)]
"""A range: in files ``[low, high]``, or one number where the variable is fixed."""


class LevelRanges(Table):
    """Table ``[[space.level]]``: other ranges for one level; level 1 is the trunk."""

    number: Annotated[int, Doc("of the level; 1 is the trunk")]
    length_mm: Annotated[Range | None, Unit("mm"), Doc("range of BL")] = None
    angle_deg: Annotated[Range | None, Unit("deg"), Doc("range of theta")] = None
    branches: Annotated[Range | None, Doc("range of SPL")] = None
    growth_percent: Annotated[Range | None, Unit("percent"), Doc("range of LGF")] = None

    @property
    def ranges(self) -> dict[str, Bounds]:
        """The ranges that differ, by variable."""
        given = {name: getattr(self, name) for name in LIMITS}
        return {name: bounds for name, bounds in given.items() if bounds is not None}


_Limit = Annotated[float | None, Ge(SMALLEST), Le(LARGEST_LIMIT)]


class SpaceSettings(Table):
    """Table ``[space]``: ranges of the variables; the defaults are the paper's Table 1, in mm.

    In Python, and in records, ``by_level`` (level to variable to `Bounds`) may stand in place of
    ``level``, and ``most`` (name of a cost to its largest value) in place of the limits.
    """

    levels: Annotated[Range, Doc("range of their number, trunk included")] = Bounds(low=2, high=5)
    length_mm: Annotated[
        Range, Unit("mm"), Doc("range of BL, of the trunk and of each level's first child")
    ] = Bounds(low=10.0, high=205.0)
    angle_deg: Annotated[Range, Unit("deg"), Doc("range of theta, the whole fan")] = Bounds(
        low=20.0, high=160.0
    )
    branches: Annotated[Range, Doc("range of SPL, children per parent")] = Bounds(low=2, high=4)
    growth_percent: Annotated[
        Range, Unit("percent"), Doc("range of LGF, length of the last child over the first's")
    ] = Bounds(low=10.0, high=160.0)
    most_film_length_mm: Annotated[
        _Limit, Unit("mm"), Doc("planned length of all branches together")
    ] = None
    most_film_area_mm2: Annotated[
        _Limit, Unit("mm2"), Doc("lay-flat area of all branches, one layer")
    ] = None
    most_sheet_area_mm2: Annotated[
        _Limit, Unit("mm2"), Doc("of the rectangle that holds the flat robot")
    ] = None
    most_branches: Annotated[_Limit, WrapValidator(_as_given), Doc("trunk included")] = None
    symmetric: Annotated[bool, Doc("left mirrors right: the children of a fan are all as long")] = (
        False
    )
    tree: Annotated[
        Literal["levels", "free"],
        Doc("free: after a search of levels, every branch has its own angle and length"),
    ] = "levels"
    mirrored: Annotated[
        bool,
        Doc("a free tree is its own mirror image: half the variables; its axis stays straight"),
    ] = False
    only: Annotated[
        tuple[str, ...],
        Field(strict=False),
        Doc(
            "branches of the design to begin at, by name, that may change; what hangs on them "
            "moves along; empty: all, and branches come and go"
        ),
    ] = ()
    bends: Annotated[Range, Doc("preformed bends of a branch of a free tree; the most is 8")] = (
        Bounds(low=0, high=0)
    )
    level: Annotated[
        tuple[LevelRanges, ...], Field(strict=False), Doc("other ranges, by level")
    ] = ()

    @model_validator(mode="before")
    @classmethod
    def _as_in_records(cls, given: Any) -> Any:  # noqa: ANN401  what pydantic hands on
        if not isinstance(given, Mapping) or not {"by_level", "most"} & {*given}:
            return given
        values = dict(given)
        if (by_level := values.pop("by_level", None)) is not None:
            values["level"] = [{"number": int(n), **ranges} for n, ranges in by_level.items()]
        if (most := values.pop("most", None)) is not None:
            for name in most:
                if name not in COSTS:
                    raise BadInputError("most", name, f"one of {', '.join(COSTS)}")
            values |= {cost.limit_key: most.get(name) for name, cost in COSTS.items()}
        return values

    @model_validator(mode="after")
    def _ranges_fit(self) -> "SpaceSettings":
        _check_bounds("levels", "levels", self.levels, (1, MOST_LEVELS))
        _check_bounds("bends", "bends", self.bends, (0, MOST_SPACE_BENDS))
        for name, limits in LIMITS.items():
            _check_bounds(name, name, getattr(self, name), limits)
        if self.mirrored and self.tree != "free":
            remedy = "set tree = 'free', or symmetric for levels"
            raise UnfitInputError("mirrored", "is true, and tree is 'levels'", remedy)
        if self.only and (self.tree != "free" or self.mirrored):
            other = "mirrored is true" if self.mirrored else "tree is 'levels'"
            remedy = "set tree = 'free', not mirrored, or leave it out"
            raise UnfitInputError("only", f"is given, and {other}", remedy)
        deepest, numbers = int(self.levels.high), [level.number for level in self.level]
        for place, level in enumerate(self.level):
            if level.number in numbers[:place]:
                raise BadInputError(f"level[{place + 1}].number", level.number, "each level once")
            if not 1 <= level.number <= deepest:
                allowed = f"1 (the trunk) to {deepest}, the most levels of the space"
                raise BadInputError("level.number", level.number, allowed)
            known = tuple(LIMITS) if level.number > 1 else ("length_mm",)
            for name, bounds in level.ranges.items():
                key = f"level {level.number}.{name}"
                if name not in known:
                    ends = [bounds.low, bounds.high]
                    raise BadInputError(key, ends, f"only {', '.join(known)} there")
                _check_bounds(key, name, bounds, LIMITS[name])
        return self

    @property
    def by_level(self) -> dict[int, dict[str, Bounds]]:
        """The ranges that differ for single levels: level number to variable to range."""
        return {level.number: level.ranges for level in self.level}

    @property
    def most(self) -> dict[str, float]:
        """The limits that designs must keep: the name of a cost to its largest value."""
        limits = {name: getattr(self, cost.limit_key) for name, cost in COSTS.items()}
        return {name: limit for name, limit in limits.items() if limit is not None}

    @property
    def longest_mm(self) -> float:
        """Greatest length of a robot from its base to a tip."""
        total_mm = 0.0
        for level in range(1, int(self.levels.high) + 1):
            growth = 1.0 if level == 1 else self.bounds(level, "growth_percent").high / 100.0
            total_mm += self.bounds(level, "length_mm").high * max(1.0, growth)
        return total_mm

    def bounds(self, level: int, name: str) -> Bounds:
        """Return the range of a variable of one level."""
        if (self.symmetric or self.mirrored) and name == "growth_percent":
            return Bounds(low=SYMMETRIC_PERCENT, high=SYMMETRIC_PERCENT)
        given: Bounds = getattr(self, name)
        return self.by_level.get(level, {}).get(name, given)


class BuildSettings(Table):
    """Table ``[build]``: how every design of a run is built."""

    trunk_width_mm: Annotated[
        float,
        Ge(SMALLEST),
        Le(LARGEST_MM),
        Unit("mm"),
        Doc("lay-flat; a run file without it gets a wider one where thick film needs the room"),
    ] = DEFAULT_TRUNK_WIDTH_MM
    width_ratio: Annotated[
        float, Ge(SMALLEST), Le(1), Doc("width of a level over that of the level before")
    ] = DEFAULT_WIDTH_RATIO
    tail_mm: Annotated[
        float, Ge(0), Le(LARGEST_MM), Unit("mm"), Doc("straight length below the trunk's base")
    ] = DEFAULT_TAIL_MM
    pressure_kpa: Annotated[
        float,
        Ge(0),
        Le(10_000),
        Unit("kPa"),
        Doc(
            "working gauge pressure; a run file without it gets the most that its film may take in "
            "the widest part"
        ),
    ] = DEFAULT_PRESSURE_KPA
    pouch: Annotated[Pouch | None, Doc("at the tip of every leaf")] = None
    pieces: Annotated[PieceSettings | None, Doc("robots may be cut in flat pieces")] = None
    widths_mm: Annotated[
        tuple[Annotated[float, Ge(SMALLEST), Le(LARGEST_MM)], ...],
        Field(strict=False, max_length=MOST_LEVELS),
        Unit("mm"),
        Doc("lay-flat, of the first levels, in place of trunk_width_mm; deeper ones by the ratio"),
    ] = ()
    mounting: Annotated[Mounting, Doc("as in a design")] = DEFAULT_MOUNTING
    compensation: Annotated[
        Compensation,
        Doc(
            "as in a design; with inflation the rules about the sheet see the flat angles and "
            "lengths that deploy as designed"
        ),
    ] = DEFAULT_COMPENSATION

    @property
    def widths_key(self) -> str:
        """The key of a run file that says how wide the first levels are."""
        return "build.widths_mm" if self.widths_mm else "build.trunk_width_mm"

    @property
    def widths_value(self) -> float | list[float]:
        """The value of that key."""
        return list(self.widths_mm) or self.trunk_width_mm

    def build(self, depth: int) -> Build:
        """Return the build of a design with so many levels."""
        first_mm = self.widths_mm or (self.trunk_width_mm,)
        last = len(first_mm) - 1
        widths_mm = tuple(
            round(first_mm[min(level, last)] * self.width_ratio ** max(0, level - last), 3)
            for level in range(depth)
        )
        return Build(
            widths_mm=widths_mm,
            fillet_mm=default_fillets_mm(widths_mm),
            tail_mm=self.tail_mm,
            pressure_kpa=self.pressure_kpa,
            pouch=self.pouch,
            pieces=self.pieces,
            mounting=self.mounting,
            compensation=self.compensation,
        )


def _check_bounds(key: str, name: str, bounds: Bounds, limits: tuple[float, float]) -> None:
    for value in (bounds.low, bounds.high):
        number(key, value, *limits)
        if name in WHOLE_NUMBERS and value != int(value):
            raise BadInputError(key, value, "whole numbers")
    if bounds.low > bounds.high:
        raise BadInputError(key, [bounds.low, bounds.high], "a lower and an upper bound, in order")


SPACE_DECIMALS = 2
"""Lengths, angles and growth are rounded to hundredths, so that a design file holds exactly the
design that was evaluated, in few digits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchVariable:
    """One coordinate of the search."""

    name: str  # ``levels``, or a variable of a level
    level: int  # 1 for the trunk; 0 for ``levels``
    bounds: Bounds

    @property
    def choices(self) -> int:
        """Number of integers that it stands for; 0 if continuous."""
        return int(self.bounds.high - self.bounds.low) + 1 if self.name in WHOLE_NUMBERS else 0

    @property
    def is_fixed(self) -> bool:
        """Whether both bounds are the same."""
        return self.bounds.low == self.bounds.high

    def value(self, share: float) -> float:
        """Return the value at a share 0 to 1 of the range; integers have equal intervals."""
        low, high = self.bounds.low, self.bounds.high
        if self.name in WHOLE_NUMBERS:
            return min(high, low + int(share * (high - low + 1)))
        return min(high, max(low, round(low + share * (high - low), SPACE_DECIMALS)))

    def share(self, value: float) -> float:
        """Return the share of the range for a value; the nearest end for one outside."""
        low, high = self.bounds.low, self.bounds.high
        offset, span = value - low, high - low
        if self.name in WHOLE_NUMBERS:
            offset, span = offset + 0.5, span + 1.0
        return min(1.0, max(0.0, offset / span))


@dataclass(frozen=True, slots=True, kw_only=True)
class SpaceValue:
    """The value of one variable of a design, within its range."""

    name: str  # for people: ``angle_deg, level 2``
    value: float
    low: float
    high: float
    is_whole: bool = False


class DesignSpace(ABC):
    """The map between vectors with entries from 0 to 1 and designs, with costs and limits."""

    def __init__(self, settings: SpaceSettings, build: BuildSettings) -> None:
        self.settings = settings
        self.most = settings.most
        self.build = build
        self._builds: dict[int, Build] = {}

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of coordinates."""

    @property
    @abstractmethod
    def axes(self) -> SearchAxes:
        """The coordinates as optimizers see them."""

    @property
    @abstractmethod
    def levels(self) -> "Space":
        """The space of levels, which the run's optimizer searches."""

    @property
    @abstractmethod
    def smallest(self) -> DesignBatch | TreeBatch:
        """The smallest design of the space, alone in a batch."""

    @abstractmethod
    def design(self, x: Floats, name: str = "candidate") -> Design:
        """Return the design at a point."""

    @abstractmethod
    def vector(self, design: Design) -> Floats:
        """Return the point for a design, or the nearest within the bounds."""

    @abstractmethod
    def batch(self, x: Floats) -> DesignBatch | TreeBatch:
        """Return the designs at many points, shape (m, len(self)), equal to those of `design`."""

    @abstractmethod
    def batch_of(self, design: Design) -> DesignBatch | TreeBatch:
        """Return a design alone in a batch."""

    @abstractmethod
    def planned(self, designs: Any, options: GrowthOptions) -> Plans:  # noqa: ANN401  its batches
        """Return the plans of some of its designs, as `batch` gives them."""

    def planned_straight(self, branches: "BatchBranches", options: GrowthOptions) -> Plans:
        """Return the plans of trees without bends, as wide as the space makes each level."""
        builds = {depth: self.build_of(depth) for depth in set(branches.depth.tolist())}
        return planned_batch(branches, builds, self.radii_mm(options), options)

    def radii_mm(self, options: GrowthOptions) -> tuple[float, ...]:
        """Return body radii per level of the deepest designs; one 0 for bare centrelines."""
        if options.body == "centerline":
            return (0.0,)
        deepest = self.build_of(int(self.settings.levels.high))
        return tuple(options.radius_mm(width_mm) for width_mm in deepest.widths_mm)

    @abstractmethod
    def values(self, x: Floats) -> list[SpaceValue]:
        """Return the values of the variables that the design at a point has."""

    def limit_excess(self, designs: DesignBatch | TreeBatch) -> Floats:
        """Return by how much designs exceed the limits, relative to each and added up, shape (m,).

        A design within all of them has an excess of 0.
        """
        excess = np.zeros(len(designs))
        for name, limit in self.most.items():
            value = COSTS[name].of(designs, self.build_of)
            excess += np.maximum(0.0, value / limit - 1.0)
        return excess

    def exceeded_limits(self, design: Design) -> list[str]:
        """Return a phrase for each of the space's limits that a design exceeds."""
        batch, found = self.batch_of(design), list[str]()
        for name, limit in self.most.items():
            cost, value = COSTS[name], float(COSTS[name].of(batch, self.build_of)[0])
            if value > limit:
                words = f"{cost_text(name, value)}, limit {limit:g}"
                found.append(f"space.{cost.limit_key} ({words})")
        return found

    def limits_text(self, design: Design) -> str:
        """Return a design's use of the limits of the space; empty without limits."""
        batch, most = self.batch_of(design), self.most
        return ", ".join(
            f"{cost_text(name, float(COSTS[name].of(batch, self.build_of)[0]))} of {limit:g}"
            for name, limit in most.items()
        )

    def refuse_limits_without_designs(self) -> None:
        """Raise `BadInputError` for a limit that no design of the space keeps."""
        if not self.most:
            return
        # All but the area of sheet rise with every bound; of that the trunk with tail is certain.
        smallest, build = self.smallest, self.build_of(1)
        least = {name: float(cost.of(smallest, self.build_of)[0]) for name, cost in COSTS.items()}
        trunk_mm = self.settings.bounds(1, "length_mm").low
        least["sheet_area"] = (trunk_mm + build.tail_mm) * build.widths_mm[0]
        for name, limit in self.most.items():
            if least[name] > limit:
                unit = f" {COSTS[name].unit}" if COSTS[name].unit else ""
                allowed = (
                    f"at least {least[name]:.10g}{unit}, which every design of the space takes"
                )
                raise BadInputError(f"space.{COSTS[name].limit_key}", limit, allowed)

    def build_of(self, depth: int) -> Build:
        """Return the cached build of designs with so many levels."""
        if depth not in self._builds:
            self._builds[depth] = self.build.build(depth)
        return self._builds[depth]


class Space(DesignSpace):
    """The map between vectors with entries from 0 to 1 and designs of levels.

    Variables with equal bounds are not part of the vector. Variables of levels that a design does
    not have are, without effect: the same design then has many vectors (`SearchAxes.canonical`
    gives the canonical one).

    Examples
    --------
    >>> space = Space(SpaceSettings(), BuildSettings())
    >>> len(space)
    18
    >>> space.design(np.full(18, 0.5)).depth
    4
    """

    def __init__(self, settings: SpaceSettings, build: BuildSettings) -> None:
        super().__init__(settings, build)
        every = [SearchVariable(name="levels", level=0, bounds=settings.levels)]
        for level in range(1, int(settings.levels.high) + 1):
            names = LIMITS if level > 1 else ("length_mm",)
            every += [
                SearchVariable(name=name, level=level, bounds=settings.bounds(level, name))
                for name in names
            ]
        self.variables = tuple(variable for variable in every if not variable.is_fixed)
        self._fixed = {
            (variable.level, variable.name): variable.value(0.0)
            for variable in every
            if variable.is_fixed
        }
        self._row = np.array([variable.bounds.low for variable in every], dtype=np.float64)
        self._free = np.array([index for index, v in enumerate(every) if not v.is_fixed], dtype=int)
        self._low = self._row[self._free]
        self._high = np.array([variable.bounds.high for variable in self.variables])
        self._integer = np.array([v.choices > 0 for v in self.variables], dtype=np.bool_)

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def axes(self) -> SearchAxes:
        """The coordinates as optimizers see them."""
        depths = [index for index, v in enumerate(self.variables) if v.name == "levels"]
        return SearchAxes(
            choices=tuple(variable.choices for variable in self.variables),
            levels=tuple(variable.level for variable in self.variables),
            depth=depths[0] if depths else None,
            least_depth=int(self.settings.levels.low),
        )

    def design(self, x: Floats, name: str = "candidate") -> Design:
        """Return the design at a point."""
        values = dict(self._fixed)
        for variable, share in zip(self.variables, x.tolist(), strict=True):
            # The number of levels comes first; those that a design does not have come last.
            if variable.level and variable.level > values[0, "levels"]:
                break
            values[variable.level, variable.name] = variable.value(share)
        depth = int(values[0, "levels"])
        levels = tuple(
            Level(
                branches=int(values[level, "branches"]),
                length_mm=values[level, "length_mm"],
                angle_deg=values[level, "angle_deg"],
                growth_percent=values[level, "growth_percent"],
            )
            for level in range(2, depth + 1)
        )
        return Design(
            name=name,
            trunk_length_mm=values[1, "length_mm"],
            levels=levels,
            build=self.build_of(depth),
        )

    def batch(self, x: Floats) -> DesignBatch:
        """Return the designs at many points, shape (m, len(self)), equal to those of `design`."""
        table = np.tile(self._row, (len(x), 1))
        # As `SearchVariable.value`, for all variables at many points.
        low, high = self._low, self._high
        numbers = np.minimum(high, low + np.trunc(x * (high - low + 1.0)))
        values = np.minimum(high, np.maximum(low, _rounded(low + x * (high - low))))
        table[:, self._free] = np.where(self._integer, numbers, values)
        level = table[:, 2:].reshape(len(x), int(self.settings.levels.high) - 1, len(LIMITS))
        of = {name: level[:, :, place] for place, name in enumerate(LIMITS)}
        depth, branches = table[:, 0].astype(np.int64), of["branches"].astype(np.int64)
        return DesignBatch(
            depth=depth,
            trunk_mm=table[:, 1],
            branches=branches,
            length_mm=of["length_mm"],
            fan_rad=np.radians(of["angle_deg"]),
            growth=of["growth_percent"] / 100.0,
            counts=branch_counts(depth, branches),
        )

    @property
    def levels(self) -> "Space":
        """The space itself."""
        return self

    def values(self, x: Floats) -> list[SpaceValue]:
        """Return the values of the variables that the design at a point has."""
        depth, found = self.design(x).depth, list[SpaceValue]()
        for variable, share in zip(self.variables, x.tolist(), strict=True):
            if variable.level <= depth:
                of = "" if variable.level == 0 else f", level {variable.level}"
                found.append(
                    SpaceValue(
                        name=f"{variable.name}{of}",
                        value=variable.value(share),
                        low=variable.bounds.low,
                        high=variable.bounds.high,
                        is_whole=variable.choices > 0,
                    )
                )
        return found

    @property
    def smallest(self) -> DesignBatch:
        """The design with everything at its lower bound, alone in a batch."""
        return self.batch(np.zeros((1, len(self))))

    def batch_of(self, design: Design) -> DesignBatch:
        """Return a design of levels alone in a batch."""
        return DesignBatch.of(design)

    def trees(self, designs: DesignBatch) -> list[BranchTree]:
        """Return the trees of designs of levels."""
        rows, builds = batch_branches(designs), map(self.build_of, designs.depth.tolist())
        return [rows.tree(place, build) for place, build in enumerate(builds)]

    def planned(self, designs: DesignBatch, options: GrowthOptions) -> Plans:
        """Return the plans of some of its designs, as `batch` gives them."""
        return self.planned_straight(batch_branches(designs), options)

    def vector(self, design: Design) -> Floats:
        """Return the point for a design, or the nearest within the bounds.

        Entries of levels that the design does not have are 0.5.
        """
        values: dict[tuple[int, str], float] = {
            (0, "levels"): design.depth,
            (1, "length_mm"): design.trunk_length_mm,
        }
        for number_, level in enumerate(design.levels, start=2):
            values[number_, "branches"] = level.branches
            values[number_, "length_mm"] = level.length_mm
            values[number_, "angle_deg"] = level.angle_deg
            values[number_, "growth_percent"] = level.growth_percent
        return np.array(
            [
                variable.share(values[key])
                if (key := (variable.level, variable.name)) in values
                else 0.5
                for variable in self.variables
            ]
        )


def _rounded(values: Floats) -> Floats:
    """Return values rounded as by Python's ``round``, which is exact in decimals."""
    factor = 10.0**SPACE_DECIMALS
    shifted = values * factor
    whole = np.rint(shifted)
    rounded: Floats = whole / factor
    # Multiplication may move a value across the middle between two hundredths.
    for place in np.flatnonzero(np.abs(np.abs(shifted - whole) - 0.5) < 1e-5).tolist():
        rounded.flat[place] = round(float(values.flat[place]), SPACE_DECIMALS)
    return rounded


class BatchBranches(NamedTuple):
    """All branches of a design batch, design by design, each as `Design.tree` has them."""

    first: Ints  # where each design's branches begin, with the total at the end, shape (m + 1,)
    parent: Ints  # places within a design
    level: Ints
    offset_rad: Floats
    length_mm: Floats

    @property
    def depth(self) -> Ints:
        """Number of levels of each design, the trunk included, shape (m,)."""
        return self.level[self.first[1:] - 1]

    def counts(self, levels: int) -> Ints:
        """Return the number of branches of each design on each level, shape (m, levels)."""
        size = np.diff(self.first)
        cell = np.repeat(np.arange(len(size)) * levels, size) + self.level - 1
        return np.bincount(cell, minlength=len(size) * levels).reshape(len(size), levels)

    def tree(self, place: int, build: Build) -> BranchTree:
        """Return the tree of one design, which is built in some way."""
        own = slice(int(self.first[place]), int(self.first[place + 1]))
        return BranchTree.of(
            parent=self.parent[own],
            level=self.level[own],
            offset_rad=self.offset_rad[own],
            length_mm=self.length_mm[own],
            build=build,
        )


def batch_branches(designs: DesignBatch) -> BatchBranches:
    """Return all branches of a design batch."""
    first = np.zeros(len(designs) + 1, dtype=np.int64)
    np.cumsum(designs.sizes, out=first[1:])
    parent, level = np.empty((2, first[-1]), dtype=np.int64)
    offset_rad, length_mm = np.empty((2, first[-1]))
    # Columns of a table are another type to numba, which would compile a second time.
    batch_kernel.plan_trees(
        np.ascontiguousarray(designs.depth),
        np.ascontiguousarray(designs.trunk_mm),
        np.ascontiguousarray(designs.branches),
        np.ascontiguousarray(designs.fan_rad),
        np.ascontiguousarray(designs.length_mm),
        np.ascontiguousarray(designs.growth),
        first,
        parent,
        level,
        offset_rad,
        length_mm,
    )
    return BatchBranches(first, parent, level, offset_rad, length_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PlannedTrees(Sequence[Plan]):
    """The planned trees of a design batch; each plan is created on access."""

    arrays: TreesArrays  # all trees, concatenated
    branches: BatchBranches  # of all trees
    counts: Ints  # number of branches of each tree per level, shape (m, n + 1)
    builds: dict[int, Build]  # by depth
    # body radius per level of the deepest designs; one 0 for bare centrelines
    radii_mm: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.counts)

    @overload
    def __getitem__(self, index: int) -> Plan: ...

    @overload
    def __getitem__(self, index: slice) -> list[Plan]: ...

    def __getitem__(self, index: int | slice) -> Plan | list[Plan]:
        """Return the plan of one tree, or of some."""
        if isinstance(index, slice):
            return [self[row] for row in range(*index.indices(len(self)))]
        one, two = self.arrays.first[index], self.arrays.first[index + 1]
        depth = int(self.branches.level[two - 1])
        build, wide = self.builds[depth], len(self.radii_mm) > 1 or self.radii_mm[0] > 0.0
        edges = np.cumsum(self.counts[index, :depth]).tolist() if wide else [int(two - one)]
        tree = self.branches.tree(index, build)
        return Plan(
            tree=tree,
            parts=tree,
            turn=self.arrays.turn[one:two],
            edges=(0, *edges),
            radii_mm=self.radii_mm[:depth] if wide else self.radii_mm,
            limit_kpa=self.arrays.limit[one:two],
            store_kpa=self.arrays.store[one:two],
            build=build,
        )


def planned_batch(
    branches: BatchBranches,
    builds: dict[int, Build],
    radii_mm: tuple[float, ...],
    options: GrowthOptions,
) -> Plans:
    """Return the plans of a design batch; builds of other depths begin with the same widths."""
    first, parent, level, offset_rad, length_mm = branches
    counts = branches.counts(max(builds) if radii_mm == (0.0,) else len(radii_mm))
    turn = np.column_stack([np.cos(offset_rad), np.sin(offset_rad)])
    deepest = builds[max(builds)]
    width_mm = np.array(deepest.widths_mm)
    feed, riding_mm = Feed.of(deepest, options, width_mm), np.zeros(len(length_mm))
    if np.isfinite(feed.limit_kpa).any():
        batch_kernel.riding_film(first, parent, level, length_mm, width_mm, riding_mm)
    arrays = TreesArrays(
        parent=parent,
        turn=turn,
        length=length_mm,
        limit=feed.limit_kpa[level - 1],
        store=feed.store_kpa(riding_mm),
        first=first,
    )
    for array in arrays:
        array.setflags(write=False)
    each = _PlannedTrees(
        arrays=arrays,
        branches=branches,
        counts=counts,
        builds=builds,
        radii_mm=radii_mm,
    )
    until = np.cumsum(counts, axis=1)
    if radii_mm == (0.0,):  # all branches are grown on the same walls
        zeros = np.zeros((len(until), 1), dtype=np.int64)
        spans = Spans(radii_mm, zeros[:, 0] + 1, zeros, until[:, -1:], zeros > 0)
    else:  # level by level
        rising, levels = tuple(sorted(set(radii_mm))), branches.depth
        there = np.arange(len(radii_mm)) < levels[:, None]
        wider = np.diff(radii_mm, prepend=0.0) > 0.0
        page = np.searchsorted(rising, radii_mm)
        spans = Spans(rising, levels, np.where(there, page, 0), until, there & wider)
    return Plans(each=each, trees=arrays, spans=spans)
