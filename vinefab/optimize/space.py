"""The designs that a run searches, as points of a unit cube."""

from dataclasses import dataclass

import numpy as np

from vinefab.core.units import deg, rad
from vinefab.model.checked import Floats
from vinefab.model.design import Build, Design, Level
from vinefab.optimize.axes import Axes
from vinefab.optimize.bounds import LIMITS, WHOLE, Bounds, BuildSettings, SpaceSettings
from vinefab.optimize.fleet import Fleet, branch_counts

DECIMALS = 2
"""Lengths, angles and growth are whole hundredths of their units, so that a design file holds
exactly what was evaluated, in digits that a person can read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """One coordinate of the search.

    Parameters
    ----------
    name
        ``levels``, or a variable of a level.
    level
        The level that it belongs to, the trunk being 1; 0 for ``levels``.
    bounds
        Its range.
    """

    name: str
    level: int
    bounds: Bounds

    @property
    def choices(self) -> int:
        """How many whole numbers it stands for; 0 when it is continuous."""
        return int(self.bounds.high - self.bounds.low) + 1 if self.name in WHOLE else 0

    @property
    def is_fixed(self) -> bool:
        """Whether there is nothing to search."""
        return self.bounds.low == self.bounds.high

    def value(self, share: float) -> float:
        """Return the value at a share 0 to 1 of the range; whole numbers have equal shares."""
        low, high = self.bounds.low, self.bounds.high
        if self.name in WHOLE:
            return min(high, low + int(share * (high - low + 1)))
        return min(high, max(low, round(low + share * (high - low), DECIMALS)))

    def share(self, value: float) -> float:
        """Return the share of the range that gives a value; the nearest end if it is outside."""
        low, high = self.bounds.low, self.bounds.high
        offset, span = value - low, high - low
        if self.name in WHOLE:
            offset, span = offset + 0.5, span + 1.0
        return min(1.0, max(0.0, offset / span))


class Space:
    """The map between vectors with entries from 0 to 1 and designs.

    Variables with equal bounds are no part of the vector. Variables of levels that a design does
    not have are, but have no effect: the same design then has many vectors (`Axes.settled` gives
    the one that stands for all of them).

    Parameters
    ----------
    settings
        Ranges.
    build
        How the designs are built.

    Examples
    --------
    >>> space = Space(SpaceSettings(), BuildSettings())
    >>> len(space)
    18
    >>> space.design(np.full(18, 0.5)).depth
    4
    """

    def __init__(self, settings: SpaceSettings, build: BuildSettings) -> None:
        self.settings = settings
        self.build = build
        every = tuple(_variables(settings))
        self.variables = tuple(variable for variable in every if not variable.is_fixed)
        self._fixed = {
            (variable.level, variable.name): variable.value(0.0)
            for variable in every
            if variable.is_fixed
        }
        self._builds: dict[int, Build] = {}
        self._row = np.array([variable.bounds.low for variable in every])
        self._free = np.array([index for index, v in enumerate(every) if not v.is_fixed], dtype=int)
        self._low = self._row[self._free]
        self._high = np.array([variable.bounds.high for variable in self.variables])
        self._whole = np.array([v.choices > 0 for v in self.variables], dtype=np.bool_)

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def axes(self) -> Axes:
        """What an optimizer is told about the coordinates.

        Raises
        ------
        BadInputError
            If every variable is fixed.
        """
        depths = [index for index, v in enumerate(self.variables) if v.name == "levels"]
        return Axes(
            choices=tuple(variable.choices for variable in self.variables),
            levels=tuple(variable.level for variable in self.variables),
            depth=depths[0] if depths else None,
            least_depth=int(self.settings.levels.low),
        )

    def design(self, x: Floats, name: str = "candidate") -> Design:
        """Return the design at a point.

        Parameters
        ----------
        x
            Shares of the ranges, shape (len(self),), each 0 to 1.
        name
            The design's name.

        Raises
        ------
        BadInputError
            If the point stands for more branches than a design may have.
        """
        values = dict(self._fixed)
        for variable, share in zip(self.variables, x.tolist(), strict=True):
            values[variable.level, variable.name] = variable.value(share)
        depth = int(values[0, "levels"])
        levels = tuple(
            Level(
                branches=int(values[level, "branches"]),
                length_mm=values[level, "length_mm"],
                fan_rad=rad(values[level, "angle_deg"]),
                growth=values[level, "growth_percent"] / 100.0,
            )
            for level in range(2, depth + 1)
        )
        return Design(
            name=name,
            trunk_length_mm=values[1, "length_mm"],
            levels=levels,
            build=self.build_of(depth),
        )

    def fleet(self, x: Floats) -> Fleet:
        """Return the designs at many points, as `design` finds them one by one.

        Parameters
        ----------
        x
            Points, shape (m, len(self)).
        """
        table = np.tile(self._row, (len(x), 1))
        table[:, self._free] = self._values(x)
        level = table[:, 2:].reshape(len(x), int(self.settings.levels.high) - 1, len(LIMITS))
        of = {name: level[:, :, place] for place, name in enumerate(LIMITS)}
        depth, branches = table[:, 0].astype(np.int64), of["branches"].astype(np.int64)
        return Fleet(
            depth=depth,
            trunk_mm=table[:, 1],
            branches=branches,
            length_mm=of["length_mm"],
            fan_rad=np.radians(of["angle_deg"]),
            growth=of["growth_percent"] / 100.0,
            counts=branch_counts(depth, branches),
        )

    def _values(self, x: Floats) -> Floats:
        """Return what `Variable.value` does, for all variables at many points."""
        low, high = self._low, self._high
        numbers = np.minimum(high, low + np.trunc(x * (high - low + 1.0)))
        values = np.minimum(high, np.maximum(low, _rounded(low + x * (high - low))))
        found: Floats = np.where(self._whole, numbers, values)
        return found

    def build_of(self, depth: int) -> Build:
        """Return the build of designs with so many levels, made once."""
        if depth not in self._builds:
            self._builds[depth] = self.build.build(depth)
        return self._builds[depth]

    def vector(self, design: Design) -> Floats:
        """Return a point that stands for a design, as nearly as the bounds allow.

        Entries of levels that the design does not have are 0.5.
        """
        values: dict[tuple[int, str], float] = {
            (0, "levels"): design.depth,
            (1, "length_mm"): design.trunk_length_mm,
        }
        for number_, level in enumerate(design.levels, start=2):
            values[number_, "branches"] = level.branches
            values[number_, "length_mm"] = level.length_mm
            values[number_, "angle_deg"] = deg(level.fan_rad)
            values[number_, "growth_percent"] = 100.0 * level.growth
        return np.array(
            [
                variable.share(values[key])
                if (key := (variable.level, variable.name)) in values
                else 0.5
                for variable in self.variables
            ]
        )


def _rounded(values: Floats) -> Floats:
    """Return numbers as Python's ``round`` does, which looks at all their decimals."""
    factor = 10.0**DECIMALS
    shifted = values * factor
    whole = np.rint(shifted)
    rounded: Floats = whole / factor
    # Multiplying may carry a number over the middle between two others.
    for place in np.flatnonzero(np.abs(np.abs(shifted - whole) - 0.5) < 1e-5).tolist():
        rounded.flat[place] = round(float(values.flat[place]), DECIMALS)
    return rounded


def _variables(settings: SpaceSettings) -> list[Variable]:
    found = [Variable(name="levels", level=0, bounds=settings.levels)]
    found.append(Variable(name="length_mm", level=1, bounds=settings.bounds(1, "length_mm")))
    found += [
        Variable(name=name, level=level, bounds=settings.bounds(level, name))
        for level in range(2, int(settings.levels.high) + 1)
        for name in LIMITS
    ]
    return found
