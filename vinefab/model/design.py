"""Designs of branching vine robots: a tree of branches and how it is built.

The tree is written by levels, all branches of one alike, or branch by branch.

Each table of a design file is one class: noun, file form and the studio's form at once.
"""

import math
import re
import reprlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar

import numpy as np
import tomli_w
from annotated_types import Interval, Unit
from numpy.typing import ArrayLike
from pydantic import Field, InstanceOf, model_validator
from pydantic.json_schema import SkipJsonSchema
from typing_extensions import Doc

from vinefab.core.atomic import write_text
from vinefab.core.errors import (
    BadInputError,
    UnfitInputError,
    UnknownNameError,
    inside,
    located,
    nearest,
)
from vinefab.core.front_door import ABOVE, Pictured
from vinefab.core.frozen import FrozenMapping
from vinefab.core.limits import file_number, rad
from vinefab.core.plain_text import GENERATOR, agreeing, counted, some_of
from vinefab.core.table import DeclaredKey, Slider, Table, validated
from vinefab.core.validation import LARGEST_MM, SMALLEST, check_plain, number, whole
from vinefab.model.files.shipped import locate, path_given
from vinefab.model.files.toml import read_toml, table_content
from vinefab.model.skeleton import DrawnBranch, traced_branches
from vinefab.model.tree import (
    DEFAULT_FILLET_RATIO,
    Bend,
    BranchTree,
    default_fillet_mm,
    tree_of_branches,
    tree_of_levels,
)

if TYPE_CHECKING:
    from vinefab.model.deployment import Deployment
    from vinefab.model.map import Map, Pose

MOST_LEVELS = 10
MOST_BRANCHES = 100_000
MOST_PIECES = 676
"""Labels of pieces have at most two letters."""
WIDEST_BODY_MM = 1e4
"""Wider ones are a mixed-up unit, and their outlines would take gigabytes."""

DEFAULT_TRUNK_WIDTH_MM = 40.0
DEFAULT_WIDTH_RATIO = 0.6
DEFAULT_TAIL_MM = 200.0
DEFAULT_PRESSURE_KPA = 20.0

ORIGIN_GROWTH = "growth"
"""Key of a design's origin under which the growth options stand that it was trained with."""

Mounting = Literal["tail_inverted", "turned"]
"""How a robot as cut is put on its base: as it is, its tail inverted over the base, which turns
every face when it grows; or first turned inside out as a whole."""

DEFAULT_MOUNTING: Mounting = "tail_inverted"

Compensation = Literal["inflation", "none"]
"""Whether what is cut is the pattern that deploys as designed, or the design itself."""

DEFAULT_COMPENSATION: Compensation = "inflation"


@dataclass(frozen=True, slots=True)
class PerLevel:
    """Marks a list of the build that has an entry for each level, from level ``first`` on.

    An empty list stands for ``absent`` at every level, or for values that follow from others.
    """

    first: int = 1
    absent: float | None = None


MOST_WRITTEN = 1000
"""Branches that a file may give one by one."""

MOST_BENDS = 1000
"""Of one branch; elbows take more room than that in any."""

TRUNK = "trunk"
"""Name of the trunk among branches."""

LengthMm = Annotated[float, Interval(ge=SMALLEST, le=LARGEST_MM), Unit("mm")]
WidthMm = Annotated[float, Interval(ge=SMALLEST, le=WIDEST_BODY_MM), Unit("mm")]
RadiusMm = Annotated[float, Interval(ge=0, le=LARGEST_MM), Unit("mm")]
Taper = Annotated[float, Interval(ge=0.01, le=1), Unit("×")]  # noqa: RUF001  the sign of multiplication


BendPlace = Annotated[float, Interval(ge=SMALLEST, le=LARGEST_MM)]
BendTurn = Annotated[float, Interval(ge=-175, le=175)]

Bends = Annotated[
    tuple[Annotated[tuple[BendPlace, BendTurn], Field(strict=False)], ...] | None,
    Field(strict=False),
    Doc(
        "preformed turns, `[mm from the base, degrees counter-clockwise]` each: the tube is cut "
        "with them"
    ),
]


def _share(percent: float) -> float:
    return percent / 100.0


_OTHER_UNITS = (
    ("fan_rad", "angle_deg", 180.0 / math.pi, rad),
    ("growth", "growth_percent", 100.0, _share),
)
"""Values of a level that Python may give in other units than a file: factor, and the way back."""


class Trunk(Table):
    """Level 1."""

    length_mm: Annotated[
        LengthMm,
        Field(alias="length", title="Length"),
        Slider(10, 500),
        Doc("of the trunk, times scale_mm_per_unit"),
    ]
    bends: Bends = None


class Level(Table):
    """One level of branches; every branch of the level before sprouts the same fan.

    In Python ``fan_rad`` and ``growth`` may be given in place of ``angle_deg`` and
    ``growth_percent``. The paper does not define LGF; this reading is vinefab's.
    """

    branches: Annotated[
        int, Interval(ge=1, le=1000), Slider(1, 8), Doc("children per parent (SPL of the paper)")
    ]
    length_mm: Annotated[
        LengthMm,
        Field(alias="length", title="Length"),
        Slider(10, 400),
        Doc("of the first child (BL), clockwise-most, times scale_mm_per_unit"),
    ]
    angle_deg: Annotated[
        float,
        Interval(ge=0, le=360),
        Unit("deg"),
        Field(title="Fan"),
        Slider(0, 360),
        Doc("the whole fan (theta), first child to last"),
    ] = 0.0
    growth_percent: Annotated[
        float,
        Interval(ge=0.1, le=10_000),
        Unit("%"),
        Slider(20, 300),
        Doc("last child's length over the first's (LGF)"),
    ] = 100.0
    bends: Bends = None

    @model_validator(mode="before")
    @classmethod
    def _of_python(cls, given: Any) -> Any:  # noqa: ANN401  of any caller
        # Files have other names: they refuse ``length_mm``, and these with it.
        if not isinstance(given, dict) or "length_mm" not in given:
            return given
        for name, key, factor, read in _OTHER_UNITS:
            if name in given:
                given = dict(given)
                value = given.pop(name)
                is_number = isinstance(value, float | int)
                given[key] = file_number(value, factor * value, read) if is_number else value
        return given

    @property
    def fan_rad(self) -> float:
        """Angle of the whole fan, 0 to 2 pi."""
        return rad(self.angle_deg)

    @property
    def growth(self) -> float:
        """Length of the last child over that of the first."""
        return _share(self.growth_percent)

    @classmethod
    def of(
        cls,
        branches: int,
        length_mm: float,
        angle_deg: float = 0.0,
        growth_percent: float = 100.0,
    ) -> Self:
        """Return a level.

        Parameters
        ----------
        branches
            Children per parent, 1 to 1000.
        length_mm
            Length of the first child, clockwise-most in the fan.
        angle_deg
            Angle of the whole fan, 0 to 360.
        growth_percent
            Length of the last child over that of the first.

        Raises
        ------
        BadInputError
            If a value is out of range.

        Examples
        --------
        >>> Level.of(branches=3, length_mm=120, angle_deg=180).growth
        1.0
        """
        return cls(
            branches=branches,
            length_mm=length_mm,
            angle_deg=angle_deg,
            growth_percent=growth_percent,
        )


class Pouch(Table):
    """The wider pocket at every leaf tip that jams in a gap (flat sizes, before inflation)."""

    shape: Annotated[
        Literal["round", "rectangle"], Doc("round: a disc; rectangle: along the branch")
    ]
    radius_mm: Annotated[LengthMm | None, Slider(2, 60, 0.5), Doc("of a round one")] = None
    length_mm: Annotated[
        LengthMm | None, Slider(2, 120, 0.5), Doc("of a rectangle, along the branch")
    ] = None
    width_mm: Annotated[LengthMm | None, Slider(2, 120, 0.5), Doc("of a rectangle, across it")] = (
        None
    )

    @model_validator(mode="after")
    def _has_the_sizes_of_its_shape(self) -> Self:
        needed = ("radius_mm",) if self.shape == "round" else ("length_mm", "width_mm")
        for name in ("radius_mm", "length_mm", "width_mm"):
            value = getattr(self, name)
            if name in needed and value is None:
                raise BadInputError(name, None, f"a length for a {self.shape} pouch")
            if name not in needed and value is not None:
                raise BadInputError(name, value, f"only {', '.join(needed)} for a {self.shape} one")
        return self

    @property
    def flat_width_mm(self) -> float:
        """Flat width across the branch."""
        if self.shape == "round":
            return 2.0 * (self.radius_mm or 0.0)
        return self.width_mm or 0.0


class Branch(Table):
    """One branch of a robot that is written branch by branch."""

    name: Annotated[str, Doc("unique: letters, digits, `-` and `_`")]
    of: Annotated[str, Doc("name of its parent")] = TRUNK
    angle_deg: Annotated[
        float,
        Interval(ge=-360, le=360),
        Unit("deg"),
        Slider(-180, 180),
        Doc("from the parent's heading at its end, counter-clockwise positive"),
    ] = 0.0
    length_mm: Annotated[
        LengthMm,
        Field(alias="length", title="Length"),
        Slider(10, 400),
        Doc("of the branch, times scale_mm_per_unit"),
    ]
    bends: Bends = None
    width_mm: Annotated[
        WidthMm | None,
        Slider(3, 80, 0.1),
        Doc("lay-flat lumen width at its base; left out: that of its level"),
    ] = None
    taper: Annotated[
        Taper | None,
        Slider(0.3, 1, 0.01),
        Doc("width at its end over that at its base; left out: that of its level"),
    ] = None
    fillet_mm: Annotated[
        RadiusMm | None,
        Slider(0, 20, 0.1),
        Doc("radius in the joint at its base; left out: that of its level"),
    ] = None
    pouch: Annotated[
        bool | Pouch | None,
        Doc("at its tip, where it has no children: false for none; left out: that of the build"),
    ] = None

    @model_validator(mode="after")
    def _is_named(self) -> Self:
        if not _BRANCH_NAME.fullmatch(self.name) or len(self.name) > 100:
            raise BadInputError("name", self.name, "at most 100 letters, digits, '-' and '_'")
        return self


_BRANCH_NAME = re.compile(r"[A-Za-z0-9_-]+")


class Collar(Table):
    """The end of the tail, as wide as the clamp of a base needs.

    From the mouth on, the tail is straight and as wide as the clamp for ``length_mm``; then it
    changes to the trunk's width within ``flare_mm``, by two arcs of one radius.
    """

    clamp_diameter_mm: Annotated[
        WidthMm, Slider(5, 100, 0.5), Doc("of the pipe that the mouth is pulled over")
    ]
    length_mm: Annotated[
        float,
        Interval(ge=0, le=WIDEST_BODY_MM),
        Unit("mm"),
        Slider(0, 100),
        Doc("of the straight part at the mouth; 0: the flare ends there"),
    ] = 30.0
    flare_mm: Annotated[
        WidthMm, Slider(5, 100), Doc("over which the width changes to that of the tail")
    ] = 40.0

    @property
    def flat_width_mm(self) -> float:
        """Lay-flat width of a tube around the clamp: half its circumference."""
        return math.pi * self.clamp_diameter_mm / 2.0

    @property
    def reach_mm(self) -> float:
        """Length of the tail that it takes."""
        return self.length_mm + self.flare_mm


class PieceSettings(Table):
    """How a robot may be cut in flat pieces, which sleeves join."""

    most: Annotated[
        int,
        Interval(ge=1, le=MOST_PIECES),
        Unit("pieces"),
        Field(title="At most"),
        Slider(1, 12),
        Doc("pieces that may be cut; the fewest that the tree needs are"),
    ] = 6
    lap_mm: Annotated[
        float,
        Interval(ge=1, le=1000),
        Unit("mm"),
        Slider(5, 40, 0.5),
        Doc("that socket and plug lie on each other, along the branch (assumed)"),
    ] = 15.0
    ease_mm: Annotated[
        float,
        Interval(ge=0, le=100),
        Unit("mm"),
        Slider(0, 5, 0.1),
        Doc("added to the flat width of a socket (assumed)"),
    ] = 1.0


class Build(Table):
    """How a tree of lines becomes a flat tube.

    Widths and fillets that are left out follow from the number of levels: in a `Design`, or with
    `for_levels`.
    """

    widths_mm: Annotated[
        tuple[WidthMm, ...],
        Field(strict=False, title="Width"),
        PerLevel(),
        Slider(3, 80, 0.1),
        Doc("lay-flat lumen width where a level's branches begin, trunk first; inflates to 2 w/pi"),
    ] = ()
    trunk_width_mm: Annotated[
        WidthMm | None, Doc("in place of widths_mm, with width_ratio; 40 if left out")
    ] = None
    width_ratio: Annotated[
        float | None,
        Interval(ge=SMALLEST, le=1),
        Doc("in place of widths_mm: of a level over the one before; 0.6 if left out"),
    ] = None
    taper: Annotated[
        tuple[Taper, ...],
        Field(strict=False),
        PerLevel(absent=1.0),
        Slider(0.3, 1, 0.01),
        Doc("width at the end of each level's branches over that at their beginning"),
    ] = ()
    fillet_mm: Annotated[
        tuple[RadiusMm, ...],
        Field(strict=False),
        PerLevel(first=2),
        Slider(0, 20, 0.1),
        Doc("radius in each level's joints, level 2 first"),
    ] = ()
    fillet_ratio: Annotated[
        float | None,
        Interval(ge=0, le=10),
        Doc("in place of fillet_mm: radius over the child's width; 0.25 if left out"),
    ] = None
    tail_mm: Annotated[
        float,
        Interval(ge=0, le=LARGEST_MM),
        Unit("mm"),
        Slider(0, 400),
        Doc("below the trunk, inverted over the base and clamped"),
    ] = DEFAULT_TAIL_MM
    pressure_kpa: Annotated[
        float,
        Interval(ge=0, le=10_000),
        Unit("kPa"),
        Slider(0, 60, 0.5),
        Doc("working gauge pressure; 0: not known"),
    ] = DEFAULT_PRESSURE_KPA
    pouch: Annotated[
        Pouch | None, Field(title="Pouch"), Doc("at the tip of every leaf; left out: rounded tips")
    ] = None
    collar: Annotated[Collar | None, Doc("fits the tail to a clamp")] = None
    pieces: Annotated[
        PieceSettings | None,
        Doc("may be cut in flat pieces, joined by sleeves; left out: one outline"),
    ] = None
    compensation: Annotated[
        Compensation,
        Doc(
            "inflation: cut with the flat angles and lengths that deploy as designed (simulated); "
            "none: cut as designed, and grown as that deploys"
        ),
    ] = DEFAULT_COMPENSATION
    mounting: Annotated[
        Mounting,
        Doc(
            "tail_inverted: mounted as cut, faces inside end outside; turned: first turned inside "
            "out"
        ),
    ] = DEFAULT_MOUNTING

    @model_validator(mode="after")
    def _fits(self) -> Self:
        given = self.model_fields_set
        if "fillet_mm" in given and self.fillet_ratio is not None:
            problem = "is given together with build.fillet_mm"
            raise UnfitInputError("fillet_ratio", problem, "leave one of them out")
        if "widths_mm" not in given:
            return self
        for name in ("trunk_width_mm", "width_ratio"):
            if getattr(self, name) is not None:
                problem = "is given together with build.widths_mm"
                raise UnfitInputError(name, problem, "leave one of them out")
        if "fillet_mm" not in given:
            ratio = DEFAULT_FILLET_RATIO if self.fillet_ratio is None else self.fillet_ratio
            follows = {
                "fillet_mm": default_fillets_mm(self.widths_mm, ratio),
                "fillet_ratio": None,
            }
            self.__dict__.update(follows)
            self.__pydantic_fields_set__.update(follows)
        levels = len(self.widths_mm)
        if not levels:
            raise BadInputError("widths_mm", [], "at least the trunk's width")
        for name, mark in PER_LEVEL.items():
            entries, wanted = getattr(self, name), levels - mark.first + 1
            if len(entries) != wanted and (entries or mark.absent is None):
                words = f"{counted(wanted, 'number')}, one per level from level {mark.first} on"
                allowed = f"{words}, as widths_mm has {levels}"
                raise BadInputError(name, list(entries), allowed)
        return self

    def for_levels(self, levels: int) -> Self:
        """Return the build with the widths and fillets of so many levels, trunk included.

        Raises
        ------
        BadInputError
            If it has widths of another number of levels.
        """
        if "widths_mm" not in self.model_fields_set:
            first = DEFAULT_TRUNK_WIDTH_MM if self.trunk_width_mm is None else self.trunk_width_mm
            ratio = DEFAULT_WIDTH_RATIO if self.width_ratio is None else self.width_ratio
            widths_mm = tuple(first * ratio**level for level in range(levels))
            return self.changed(widths_mm=widths_mm, trunk_width_mm=None, width_ratio=None)
        if len(self.widths_mm) != levels:
            allowed = f"{counted(levels, 'width')}, one per level, trunk first"
            raise BadInputError("widths_mm", list(self.widths_mm), allowed)
        return self

    @property
    def end_widths_mm(self) -> tuple[float, ...]:
        """Lay-flat lumen width of each level where its branches end."""
        ratios = self.taper or (1.0,) * len(self.widths_mm)
        return tuple(width * ratio for width, ratio in zip(self.widths_mm, ratios, strict=True))

    @property
    def mouth_width_mm(self) -> float:
        """Lay-flat width of the mouth."""
        return self.widths_mm[0] if self.collar is None else self.collar.flat_width_mm

    @property
    def widest_mm(self) -> float:
        """The widest lay-flat width under pressure, pouches included; the collar is clamped."""
        return max(*self.widths_mm, self.pouch.flat_width_mm if self.pouch else 0.0)

    @classmethod
    def standard(
        cls,
        levels: int,
        trunk_width_mm: float = DEFAULT_TRUNK_WIDTH_MM,
        width_ratio: float = DEFAULT_WIDTH_RATIO,
    ) -> Self:
        """Return vinefab's default build: each level 0.6 times as wide as the one before.

        The ratio keeps parent over child above the 1.5 that rule VF-W02 asks for; fillets are a
        quarter of the child's width, at least 2 mm (rule VF-C04).

        Parameters
        ----------
        levels
            Number of levels, the trunk included.
        trunk_width_mm
            Lay-flat width of the trunk.
        width_ratio
            Width of a level over that of the level before.
        """
        return cls(trunk_width_mm=trunk_width_mm, width_ratio=width_ratio).for_levels(levels)


PER_LEVEL = {
    name: mark
    for name, field in Build.model_fields.items()
    for mark in field.metadata
    if isinstance(mark, PerLevel)
}
"""The lists of a build with an entry for each level."""


def default_fillets_mm(
    widths_mm: tuple[float, ...], ratio: float = DEFAULT_FILLET_RATIO
) -> tuple[float, ...]:
    """Return the default fillet radius for every level after the trunk."""
    return tuple(default_fillet_mm(width, ratio) for width in widths_mm[1:])


class Waiver(Table):
    """A finding that the designer accepts."""

    fingerprint: Annotated[str, Doc("of the finding, as `vinefab check` shows it")]
    reason: Annotated[str, Doc("why it is accepted; stands in every report")]

    @model_validator(mode="after")
    def _says_something(self) -> Self:
        for name in ("fingerprint", "reason"):
            if not getattr(self, name).strip():
                raise BadInputError(name, getattr(self, name), "a text that is not blank")
        return self


_NAME = re.compile(r"[\w.-]+")


class Design(Pictured, Table):
    """A branching vine robot, lengths in millimetres.

    In Python ``trunk_length_mm`` is given in place of ``trunk``. Lengths in a file are multiplied
    by its ``scale_mm_per_unit``; a design that was read has scale 1.
    """

    schema_: Annotated[
        Literal["vinefab/design-1"], Field(alias="schema"), Doc("kind of file and its version")
    ] = "vinefab/design-1"
    name: Annotated[str, Doc("in reports, on the sheet and of files: letters, digits, `_-.`")]
    scale_mm_per_unit: Annotated[
        float, Interval(ge=SMALLEST, le=LARGEST_MM), Doc("multiplies lengths of trunk and levels")
    ] = 1.0
    trunk: Annotated[Trunk, Doc("level 1")]
    levels: Annotated[
        tuple[Level, ...],
        Field(alias="level", strict=False),
        Doc("one per level after the trunk; none: a plain vine"),
    ] = ()
    branches: Annotated[
        tuple[Branch, ...] | None,
        Field(alias="branch", strict=False),
        Doc("every branch after the trunk, in any order; in place of levels"),
    ] = None
    build: Annotated[Build, Doc("how it is made")] = Build()
    waivers: Annotated[
        tuple[Waiver, ...], Field(alias="waive", strict=False), Doc("findings that are accepted")
    ] = ()
    limits: Annotated[
        Mapping[str, Mapping[str, float]],
        Doc(
            "limits of rules for this design, in place of the recipe's: "
            "`[limits.VF-C01] warning = 6.0`"
        ),
    ] = Field(default_factory=dict)
    # The keys of `vinefab.model.files.run_context` among it are what commands use.
    origin: Annotated[
        Mapping[str, Any],
        Doc(
            "how the design was made, free-form; written by `vinefab optimize`: commands use the "
            "task, growth options and recipe of its run"
        ),
    ] = Field(default_factory=dict)
    # Of the file that it was read from, in which its origin names files; it makes no difference.
    folder: Annotated[Path | None, Field(exclude=True)] = None
    # Its tree as cut, or as deployed, in place of the one that its levels or branches give.
    shape: Annotated[SkipJsonSchema[InstanceOf[BranchTree] | None], Field(exclude=True)] = None

    @classmethod
    def python_keys(cls) -> Iterator[DeclaredKey]:
        """Yield the parameters of the constructor: the trunk is given by its length."""
        for key in super().python_keys():
            if key.field == "trunk":
                yield replace(
                    key,
                    name="trunk.length_mm",
                    field="trunk_length_mm",
                    annotation=float,
                    unit="mm",
                    meaning="of level 1",
                )
            else:
                yield key

    @model_validator(mode="before")
    @classmethod
    def _of_python(cls, given: Any) -> Any:  # noqa: ANN401  of any caller
        if not isinstance(given, dict) or "trunk_length_mm" not in given or "schema" in given:
            return given
        trunk = {"length_mm": given["trunk_length_mm"]}
        return {key: given[key] for key in given if key != "trunk_length_mm"} | {"trunk": trunk}

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not _NAME.fullmatch(self.name):
            raise BadInputError("name", self.name, "letters, digits, '_', '-' and '.'")
        if self.name.startswith(".") or len(self.name) > 100:
            raise BadInputError("name", self.name, "at most 100 characters, not starting with '.'")
        if self.branches is not None:
            self._check_branches(self.branches)
        if self.depth > MOST_LEVELS:
            given = counted(self.depth - 1, "level")
            raise BadInputError("level", given, f"at most {MOST_LEVELS - 1} below the trunk")
        if (branches := self.branch_count) > MOST_BRANCHES:
            given = counted(branches, "branch")
            raise BadInputError("level", given, f"at most {MOST_BRANCHES} in all")
        settled = self.__dict__
        if (scale := self.scale_mm_per_unit) != 1.0:
            settled["trunk"] = _scaled(self.trunk, scale, "trunk")
            numbered = enumerate(self.levels, start=1)
            settled["levels"] = tuple(_scaled(one, scale, f"level[{n}]") for n, one in numbered)
            if self.branches is not None:
                settled["branches"] = tuple(
                    _scaled(one, scale, f"branch[{n}]")
                    for n, one in enumerate(self.branches, start=1)
                )
                settled.pop("_in_order", None)
            settled["scale_mm_per_unit"] = 1.0
        with inside("build"):
            settled["build"] = self.build.for_levels(self.depth)
        self._check_bends()
        settled["origin"] = FrozenMapping(self.origin)
        frozen = {rule: FrozenMapping(named) for rule, named in self.limits.items()}
        settled["limits"] = FrozenMapping(frozen)
        return self

    def _check_branches(self, branches: "tuple[Branch, ...]") -> None:
        if self.levels:
            problem = "is given together with level"
            raise UnfitInputError("branch", problem, "describe the robot by one of them")
        if len(branches) > MOST_WRITTEN:
            given = counted(len(branches), "branch")
            raise BadInputError("branch", given, f"at most {MOST_WRITTEN}, one by one")
        number: dict[str, int] = {TRUNK: 0}
        for place, branch in enumerate(branches, start=1):
            key = f"branch[{place}].name"
            if branch.name in number:
                taken = "the trunk has it" if branch.name == TRUNK else "another branch has it"
                problem = f"{branch.name!r} names two: {taken}"
                raise UnfitInputError(key, problem, "choose another name")
            number[branch.name] = place
        angles: dict[tuple[str, float], str] = {}
        for place, branch in enumerate(branches, start=1):
            if branch.of not in number:
                hint = nearest(branch.of, number).removeprefix("; ")
                remedy = hint or f"name a branch, or {TRUNK!r}"
                problem = f"there is no branch {branch.of!r}"
                raise UnfitInputError(f"branch[{place}].of", problem, remedy)
            same = angles.setdefault((branch.of, branch.angle_deg), branch.name)
            if same != branch.name:
                problem = f"{branch.angle_deg:g} deg is the angle of {same!r} too, at {branch.of!r}"
                raise UnfitInputError(f"branch[{place}].angle_deg", problem, "turn one of them")
        # What the trunk does not lead to hangs on a branch that is its own ancestor.
        reached = {branch.name for branch in self._in_order}
        for place, branch in enumerate(branches, start=1):
            at = branch
            for _ in range(len(branches) if branch.name not in reached else 0):
                at = branches[number[at.of] - 1]
                if at is branch:
                    problem = f"{branch.name!r} is its own ancestor by {branch.of!r}"
                    remedy = "name a branch that leads to the trunk"
                    raise UnfitInputError(f"branch[{place}].of", problem, remedy)

    def _check_bends(self) -> None:
        widths_mm = self.build.widths_mm
        _check_bends("trunk.bends", self.trunk, widths_mm[0])
        for n, (level, width_mm) in enumerate(zip(self.levels, widths_mm[1:], strict=False), 1):
            _check_bends(f"level[{n}].bends", level, width_mm)
        numbered = {one.name: n for n, one in enumerate(self.branches or (), start=1)}
        for one, of_level in zip(self._in_order, self._levels_in_order, strict=True):
            key = f"branch[{numbered[one.name]}].bends"
            _check_bends(key, one, self._width_of(one, of_level))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Design):
            return NotImplemented
        names = [name for name in Design.model_fields if name not in ("folder", "shape")]
        same = all(getattr(self, name) == getattr(other, name) for name in names)
        if not same or self.shape is other.shape:
            return same
        return self.tree.key == other.tree.key

    # Its origin may hold anything.
    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        if self.branches is None:
            sizes = [level.length_mm for level in self.levels]
            bends = [
                *(self.trunk.bends or ()),
                *(b for one in self.levels for b in one.bends or ()),
            ]
        else:
            sizes, bends = [], list(self.tree.bend_mm)
        lengths_mm = " + ".join(f"{size:.5g}" for size in (self.trunk_length_mm, *sizes[:4]))
        more = " + ..." if len(sizes) > 4 else ""
        bent = f"{counted(len(self.tree.bend_mm), 'bend')}, " if bends else ""
        of = f"{lengths_mm}{more}" if self.branches is None else f"{self.tree.total_length_mm:.5g}"
        return (
            f"<Design {reprlib.repr(self.name)}: {counted(self.depth, 'level')} of {of} mm, "
            f"{counted(self.branch_count, 'branch')}, {bent}"
            f"trunk {self.build.widths_mm[0]:.5g} mm wide>"
        )

    @property
    def trunk_length_mm(self) -> float:
        """Length of the trunk, level 1."""
        return self.trunk.length_mm if self.shape is None else float(self.shape.length_mm[0])

    @property
    def depth(self) -> int:
        """Number of levels, the trunk included."""
        if self.branches is not None:
            return max(self._levels_in_order, default=1)
        return 1 + len(self.levels)

    @property
    def branch_count(self) -> int:
        """Number of branches in the whole tree, the trunk included."""
        if self.branches is not None:
            return 1 + len(self.branches)
        total = count = 1
        for level in self.levels:
            count *= level.branches
            total += count
        return total

    @cached_property
    def _in_order(self) -> tuple[Branch, ...]:
        """The branches as the tree has them: by level, siblings clockwise-most first."""
        below: dict[str, list[Branch]] = {}
        for branch in self.branches or ():
            below.setdefault(branch.of, []).append(branch)
        rows, parents = list[Branch](), [TRUNK]
        while parents:
            row = [
                child
                for parent in parents
                for child in sorted(below.get(parent, ()), key=lambda one: one.angle_deg)
            ]
            rows += row
            parents = [branch.name for branch in row]
        return tuple(rows)

    @cached_property
    def _levels_in_order(self) -> tuple[int, ...]:
        level = {TRUNK: 1}
        for branch in self._in_order:
            level[branch.name] = level[branch.of] + 1
        return tuple(level[branch.name] for branch in self._in_order)

    def _width_of(self, branch: Branch, level: int) -> float:
        """Return the lay-flat width at the base of a branch of some level."""
        return self.build.widths_mm[level - 1] if branch.width_mm is None else branch.width_mm

    @cached_property
    def tree(self) -> BranchTree:
        """Every branch, parents before children: angles, lengths, widths and bends as arrays.

        Examples
        --------
        >>> Design.read("three_level_tree").tree.ids[:3]
        ('0', '0.0', '0.1')
        """
        if self.shape is not None:
            return self.shape
        trunk_bends = self.trunk.bends or ()
        if self.branches is None:
            bends = [trunk_bends, *(level.bends or () for level in self.levels)]
            return tree_of_levels(self.trunk_length_mm, self.levels, self.build, bends)
        return tree_of_branches(
            self.trunk_length_mm, trunk_bends, self._in_order, self._levels_in_order, self.build
        )

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the branches in a file, in the tree's order; empty where it has levels."""
        if self.branches is None:
            return ()
        return (TRUNK, *(branch.name for branch in self._in_order))

    @property
    def names_by_id(self) -> dict[str, str]:
        """The names of the branches in a file by their ids; empty where it has levels."""
        names = self.names
        return dict(zip(self.tree.ids, names, strict=True)) if names else {}

    def called(self, ids: Iterable[str]) -> tuple[str, ...]:
        """Return what people call some branches: their names in the file, or their ids.

        Parameters
        ----------
        ids
            Of branches, or of their straight parts behind bends.

        Examples
        --------
        >>> Design.read("scout").by_branches.called(["0", "0/2"])
        ('trunk', 'trunk after its bend 2')
        """
        names = self.names_by_id
        if not names:
            return tuple(ids)
        parts = (one.partition("/") for one in ids)
        return tuple(
            f"{names[own]} after its bend {part}" if part else names[own] for own, _, part in parts
        )

    def words(self, rows: Sequence[int]) -> str:
        """Return what people call some branches: their level where the design has levels."""
        if self.branches is None:
            return f"level {int(self.tree.level[rows[0]])}"
        names = some_of([self.names[row] for row in rows], 3)
        return f"{agreeing(len(rows), 'branch', 'branches')} {names}"

    def alike(self, *columns: ArrayLike) -> list[list[int]]:
        """Return the rows of the branches by level and values, those that are alike together."""
        found: dict[tuple[float, ...], list[int]] = {}
        values = (np.asarray(one).tolist() for one in columns)
        for row, kind in enumerate(zip(self.tree.level.tolist(), *values, strict=True)):
            found.setdefault(kind, []).append(row)
        return list(found.values())

    @property
    def tubes(self) -> "tuple[Tubes, ...]":
        """The branches of each level and lay-flat width, in the tree's order.

        Examples
        --------
        >>> [(one.name, one.width_mm) for one in Design.read("three_level_tree").tubes]
        [('trunk', 40.0), ('level 2', 24.0), ('level 3', 14.0)]
        """
        tree = self.tree
        return tuple(
            Tubes(
                name=self.words(rows) if rows[0] else TRUNK,
                level=int(tree.level[rows[0]]),
                width_mm=float(tree.width_mm[rows[0]]),
                rows=tuple(rows),
            )
            for rows in self.alike(tree.width_mm)
        )

    @property
    def idle_values(self) -> tuple[str, ...]:
        """Values in its file that change nothing, a clause each."""
        return tuple(
            f"level {number} has one child per branch, which grows straight on: its angle_deg of "
            f"{math.degrees(level.fan_rad):g} changes nothing"
            for number, level in enumerate(self.levels, start=2)
            if level.branches == 1 and level.fan_rad > 0.0
        )

    @property
    def written(self) -> dict[str, Any]:
        """Its skeleton as plain values, by levels or branch by branch, as in its file."""
        keys = ("branches", "length_mm", "angle_deg", "growth_percent")
        levels = [{key: getattr(one, key) for key in keys} for one in self.levels]
        named = (
            {} if self.branches is None else {"branches": [one.content for one in self.branches]}
        )
        return {"trunk_length_mm": self.trunk_length_mm, "levels": levels, **named}

    @cached_property
    def pouches(self) -> tuple[Pouch | None, ...]:
        """The pouch at the tip of each branch, in the tree's order; None where there is none."""
        leaf, usual = self.tree.is_leaf.tolist(), self.build.pouch
        own: list[bool | Pouch | None] = [None, *(one.pouch for one in self._in_order)]
        if self.branches is None:
            return tuple(usual if is_leaf else None for is_leaf in leaf)
        chosen = [usual if one is None or one is True else one or None for one in own]
        return tuple(one if is_leaf else None for one, is_leaf in zip(chosen, leaf, strict=True))

    def shaped(self, tree: BranchTree, build: "Build | None" = None) -> "Design":
        """Return the design with the angles, lengths and bends of a tree of the same branches."""
        return self.changed(shape=tree, build=self.build if build is None else build)

    @property
    def by_branches(self) -> "Design":
        """The same robot written branch by branch: its levels and its shape become branches."""
        if self.branches is not None and self.shape is None:
            return self
        tree, names = self.tree, self.names
        if not names:
            names = _names_of_ids(tree)
        own = {branch.name: branch for branch in self._in_order}
        trunk, rows = _rows_written(tree, names)
        branches = [own[one["name"]].changed(**one) if own else Branch(**one) for one in rows]
        return self.changed(trunk=trunk, levels=(), branches=tuple(branches), shape=None)

    @classmethod
    def of_tree(cls, tree: BranchTree, build: "Build", name: str) -> Self:
        """Return the design of a tree, branch by branch, with the widths of a build's levels."""
        trunk, rows = _rows_written(tree, _names_of_ids(tree))
        branches = tuple(Branch(**one) for one in rows)
        return cls(name=name, trunk=trunk, branches=branches, build=build)

    @classmethod
    def read(cls, name_or_path: str | PathLike[str]) -> "Design":
        """Return the design in a file, or one of the user's own or the shipped ones by name.

        Parameters
        ----------
        name_or_path
            A path, or a name such as ``grid_explorer``: of the user's own folder, of a shipped
            design, or else ``mine`` for the file ``mine.toml`` here.

        Raises
        ------
        BadInputError
            If it is neither, or a value in the file cannot be used.
        UnknownNameError
            If there is no design of that name.
        UnreadableFileError
            If there is no such file, or it is not TOML.

        Examples
        --------
        >>> Design.read("three_level_tree").branch_count
        10
        """
        path = locate("design", name_or_path)
        return design_of(read_toml(path), path).changed(folder=path.parent)

    @classmethod
    def of_branches(
        cls,
        branches: "Sequence[Branch]",
        *,
        trunk_length_mm: float | None = None,
        trunk_bends: Sequence[Bend] = (),
        build: "Build | None" = None,
        name: str = "skeleton",
    ) -> "Design":
        """Return a robot whose branches have angles, lengths and bends of their own.

        Parameters
        ----------
        branches
            Every branch, in any order. One that is named ``trunk`` gives the trunk's length and
            bends.
        trunk_length_mm, trunk_bends
            Of the trunk, where no branch is named so.
        build
            How it is made; the default build if None.
        name
            Of the design.

        Raises
        ------
        BadInputError
            If a value cannot be used, a parent is unknown, or there is no trunk's length.

        Examples
        --------
        >>> left = Branch(name="left", angle_deg=60.0, length_mm=80.0, bends=((40.0, -30.0),))
        >>> right = Branch(name="right", angle_deg=-45.0, length_mm=120.0)
        >>> Design.of_branches([left, right], trunk_length_mm=150.0).branch_count
        3
        """
        others = [branch for branch in branches if branch.name != TRUNK]
        for trunk in branches:
            if trunk.name == TRUNK:
                trunk_length_mm, trunk_bends = trunk.length_mm, trunk.bends or ()
        if trunk_length_mm is None:
            allowed = f"the trunk's length, here or as the branch named {TRUNK!r}"
            raise BadInputError("trunk_length_mm", None, allowed)
        return cls(
            name=name,
            trunk=Trunk(length_mm=trunk_length_mm, bends=tuple(trunk_bends) or None),
            branches=tuple(others),
            build=Build() if build is None else build,
        )

    @classmethod
    def of_segments(
        cls,
        segments: ArrayLike,
        *,
        base: "tuple[float, float] | None" = None,
        snap_mm: float = 1.0,
        widths_mm: ArrayLike | None = None,
        build: "Build | None" = None,
        name: str = "skeleton",
    ) -> "Design":
        """Return the robot whose skeleton is drawn by straight lines.

        Lines are joined end to end. Where one line follows, the branch bends, or stays straight;
        where several do, or the width changes, there is a joint. Branches are named as in
        `by_branches`. The pose of the trunk's base stands in the origin, as ``drawn_at``.

        Parameters
        ----------
        segments
            x and y of both ends of each line, mm, in any order and direction; shape (n, 4).
        base
            The loose end where the trunk begins, x and y, mm; the lowest one if None.
        snap_mm
            Ends no further apart are one joint; all lines are longer.
        widths_mm
            Lay-flat width at the base of each line, shape (n,); NaN where it is that of its level.
        build
            How it is made; the default build if None. Its trunk's width, if it has one, is taken
            in place of that of the lines.
        name
            Of the design.

        Raises
        ------
        BadInputError
            If the lines make no tree, the base lies in the middle, or a branch cannot be made; the
            message names the place.

        Examples
        --------
        >>> lines = [[0, 0, 0, 100], [0, 100, 40, 180], [0, 100, -60, 160], [-60, 160, -60, 220]]
        >>> fork = Design.of_segments(lines)
        >>> fork.names, fork.trunk_length_mm, [len(one.bends or ()) for one in fork.branches]
        (('trunk', '0', '1'), 100.0, [0, 1])
        """
        (x, y, heading), (drawn, *others) = traced_branches(
            segments,
            base_mm=base,
            snap_mm=snap_mm,
            widths_mm=widths_mm,
            most_branches=MOST_WRITTEN,
        )
        build = Build() if build is None else build
        if drawn.width_mm is not None and not build.widths_mm and build.trunk_width_mm is None:
            build = build.changed(trunk_width_mm=drawn.width_mm)
        with _drawn(drawn):
            trunk = Trunk(length_mm=drawn.length_mm, bends=drawn.bends or None)
        branches = []
        for one in others:
            with _drawn(one):
                given = {key: getattr(one, key) for key in ("name", "of", "angle_deg", "length_mm")}
                own = Branch(**given, bends=one.bends or None, width_mm=one.width_mm)
                branches.append(own)
        with _drawn(drawn, *others):
            return cls(
                name=name,
                trunk=trunk,
                branches=tuple(branches),
                build=build,
                origin={"drawn_at": [x, y, heading]},
            )

    def with_branch(self, branch: str, *, name: str | None = None, **changes: Any) -> "Design":  # noqa: ANN401  values of a branch
        """Return the design with other values of one branch; a design of levels becomes branches.

        Parameters
        ----------
        branch
            Its name, or its id such as ``0.2.1``; ``trunk`` or ``0`` is the trunk, which has a
            ``length_mm`` and ``bends`` only.
        name
            The name of the new design; None keeps it.
        **changes
            Values by name, as of `Branch`: ``length_mm``, ``angle_deg``, ``bends``, ``width_mm``,
            ``taper``, ``fillet_mm``, ``pouch``.

        Raises
        ------
        BadInputError
            If a value cannot be used.
        UnknownNameError
            If there is no such branch.

        Examples
        --------
        >>> tree = Design.read("three_level_tree").with_branch("0.2", length_mm=90.0)
        >>> float(tree.tree.length_mm[3])
        90.0
        """
        free = self.by_branches
        called = free.names_by_id
        chosen = called.get(branch, branch)
        if chosen not in free.names:
            raise UnknownNameError("branch", branch, free.names)
        name = self.name if name is None else name
        if chosen == TRUNK:
            for key, value in changes.items():
                if key not in Trunk.model_fields:
                    raise BadInputError(key, value, "length_mm or bends: a trunk has these")
            return free.changed(name=name, trunk=free.trunk.changed(**changes))
        given = free.branches or ()
        branches = [one.changed(**changes) if one.name == chosen else one for one in given]
        return free.changed(name=name, branches=tuple(branches))

    def with_level(  # noqa: PLR0913  what a level has
        self,
        level: int,
        *,
        branches: int | None = None,
        length_mm: float | None = None,
        angle_deg: float | None = None,
        growth_percent: float | None = None,
        width_mm: float | None = None,
        taper: float | None = None,
        fillet_mm: float | None = None,
        name: str | None = None,
    ) -> "Design":
        """Return the design with other values of one level; what is None stays.

        Parameters
        ----------
        level
            1 for the trunk, 2 for its children, and so on; a trunk has a length, a width and a
            taper only.
        branches, length_mm, angle_deg, growth_percent
            As in `Level.of`.
        width_mm, taper, fillet_mm
            Of this level, as in `Build`.
        name
            The name of the new design; None keeps it.

        Raises
        ------
        BadInputError
            If there is no such level, or a value cannot be used.

        Examples
        --------
        >>> narrow = Design.read("three_level_tree").with_level(3, width_mm=7.0, name="narrow")
        >>> narrow.name, narrow.build.widths_mm
        ('narrow', (40.0, 24.0, 7.0))
        """
        if self.branches is not None:
            allowed = "a design of levels; with_branch changes a branch of this one"
            raise BadInputError("level", level, allowed)
        place = whole("level", level, 1, self.depth) - 1
        fan = {"branches": branches, "angle_deg": angle_deg, "growth_percent": growth_percent}
        if not place:
            for key, value in {**fan, "fillet_mm": fillet_mm}.items():
                if value is not None:
                    raise BadInputError(key, value, "nothing at level 1: a trunk has none")
        given = {"length_mm": length_mm, **fan}
        given = {key: value for key, value in given.items() if value is not None}
        levels = list(self.levels)
        if place:
            levels[place - 1] = levels[place - 1].changed(**given)
        trunk = self.trunk.changed(**given) if not place else self.trunk
        build = self.build
        tapers = build.taper or (() if taper is None else (1.0,) * self.depth)
        try:
            build = build.changed(
                widths_mm=_with_one(build.widths_mm, place, width_mm),
                taper=_with_one(tapers, place, taper),
                fillet_mm=_with_one(build.fillet_mm, place - 1, fillet_mm),
            )
        except BadInputError as error:
            # The lists of a build have an entry for each level: only this one's is new.
            name, entry, _ = error.key.partition("[")
            key = name.replace("widths", "width") if entry else error.key
            raise error.under(key) from None
        return self.changed(
            name=self.name if name is None else name,
            trunk=trunk,
            levels=tuple(levels),
            build=build,
        )

    def write(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the design as a file that `read` gives back as the same design.

        Parameters
        ----------
        path
            The file, TOML; missing folders are made.
        force
            Overwrite a file that vinefab did not write, or of another kind.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        BadInputError
            If ``path`` cannot be a path.
        CannotWriteError
            If the system refuses.
        ForeignFileError
            If the place is taken.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> vine = Design.read("plain_vine")
        >>> with TemporaryDirectory() as folder:
        ...     Design.read(vine.write(f"{folder}/copy.toml")) == vine
        True
        """
        return write_text(path_given("path", path), design_text(self), force=force)

    def grow(  # noqa: PLR0913  options by keyword
        self,
        world: "Map | str | PathLike[str]",
        pose: "Pose | tuple[float, float, float] | None" = None,
        *,
        body: str | None = None,
        head_on_half_angle_deg: float | None = None,
        contacts: Mapping[str, object] | str | PathLike[str] | None = None,
        children_of_stuck: str | None = None,
        growth: Mapping[str, object] | None = None,
    ) -> "Deployment":
        """Deploy the robot on a map (simulated).

        Options that are None are those that the design was trained with, which stand in its
        origin, or else the defaults: inflated body, half-angle 1 degree, stopped by its pressure.

        Parameters
        ----------
        world
            A map, or the path of a map file.
        pose
            Where the trunk is launched: ``(x_mm, y_mm, heading_deg)``, the heading
            counter-clockwise from +x; the map's first start if None.
        body
            ``centerline``: the body is a line. ``inflated``: every level sees the free space
            shrunk by its inflated radius.
        head_on_half_angle_deg
            A tip whose heading is within this angle of a wall's inward normal stops there, 0 to
            90 (assumed).
        contacts
            Numbers that photos measured, in place of assumed ones: what `vinefab.fit_observations`
            returned with ``out``, or the path of such a file.
        children_of_stuck
            Whether children of a branch that stopped early stay inside (``stop``) or grow from
            where it stopped (``deploy``).
        growth
            Any growth options by name, such as ``{"pressure_stop": False, "storage_kpa": 8.32}``.

        Returns
        -------
        Deployment
            Shape, grown length and stop reason of every branch; it knows the design and the map.

        Raises
        ------
        BadInputError
            If a value cannot be used, the pose is not in free space, or the map has no start and
            no pose was given.

        Examples
        --------
        >>> from vinefab import maps
        >>> world = maps.pegs(seed=1, columns=5, rows=5)
        >>> Design.read("plain_vine").grow(world, pose=(world.size_mm[0] / 2, 20, 80)).tips_mm.shape
        (1, 2)
        """
        grown: Deployment = ABOVE.grow(
            self,
            world,
            pose,
            body=body,
            head_on_half_angle_deg=head_on_half_angle_deg,
            contacts=contacts,
            children_of_stuck=children_of_stuck,
            growth=growth,
        )
        return grown


def design_of(content: Mapping[str, Any], source: str | Path) -> Design:
    """Return the design in the content of a design file.

    Parameters
    ----------
    content
        Tables and values as `design_content` gives them.
    source
        What messages call the content.

    Raises
    ------
    BadInputError
        If a value cannot be used; its key is dotted, ``level.1.length``.
    """
    design = validated(Design, content, source)
    with located(source):
        check_plain({"origin": dict(design.origin)})
    return design


def _names_of_ids(tree: BranchTree) -> tuple[str, ...]:
    """Return names for the branches of a tree: their ids without the trunk's, ``2-1``."""
    return (TRUNK, *(one[2:].replace(".", "-") for one in tree.ids[1:]))


def _rows_written(tree: BranchTree, names: Sequence[str]) -> tuple[Trunk, list[dict[str, Any]]]:
    """Return the trunk of a tree, and the values of each further branch as files have them."""

    def bends(row: int) -> tuple[Bend, ...] | None:
        own = tree.bends_of(row)
        return tuple((at, file_number(turn, math.degrees(turn), rad)) for at, turn in own) or None

    rows = []
    for row in range(1, len(tree)):
        offset = float(tree.offset_rad[row])
        rows.append(
            {
                "name": names[row],
                "of": names[int(tree.parent[row])],
                "angle_deg": file_number(offset, math.degrees(offset), rad),
                "length_mm": float(tree.length_mm[row]),
                "bends": bends(row),
            }
        )
    return Trunk(length_mm=float(tree.length_mm[0]), bends=bends(0)), rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Tubes:
    """Branches of one level and one lay-flat width."""

    name: str  # for people: `trunk`, `level 2`, or the names of the branches
    level: int
    width_mm: float  # lay-flat, where they begin
    rows: tuple[int, ...]  # of the design's tree


T = TypeVar("T", Trunk, Level, Branch)


def _scaled(part: T, scale: float, key: str) -> T:
    length_mm = number(f"{key}.length", part.length_mm * scale, SMALLEST, LARGEST_MM, "mm")
    bends = part.bends and tuple((at_mm * scale, turn_deg) for at_mm, turn_deg in part.bends)
    return part.changed(length_mm=length_mm, **({"bends": bends} if bends else {}))


def _check_bends(key: str, body: "Trunk | Level | Branch", width_mm: float) -> None:
    """Refuse bends outside of their branch, or closer together than the tube is wide."""
    bends = sorted(body.bends or ())
    if len(bends) > MOST_BENDS:
        raise BadInputError(key, counted(len(bends), "bend"), f"at most {MOST_BENDS} of one branch")
    for at_mm, _ in bends:
        if at_mm >= body.length_mm:
            allowed = f"bends on the branch, which is {body.length_mm:g} mm long"
            raise BadInputError(key, at_mm, allowed)
    for (one_mm, _), (two_mm, _) in pairwise(bends):
        if two_mm - one_mm < width_mm:
            allowed = f"bends as far apart as the tube is wide, {width_mm:g} mm, or more"
            raise BadInputError(key, [one_mm, two_mm], allowed)


@contextmanager
def _drawn(*traced: DrawnBranch) -> Iterator[None]:
    """Name the line that drew a branch in errors about it; the first one is the trunk, or alone."""
    try:
        yield
    except BadInputError as error:
        table, _, key = error.key.partition(".")
        number = re.fullmatch(r"branch\[(\d+)\]", table)
        if number is not None:
            one = traced[int(number[1])]
        elif len(traced) == 1 or table == "trunk":
            one, key = traced[0], error.key.removeprefix("trunk.")
        else:
            raise
        raise error.under(f"{key} of {one.where}") from None


def check_levels(design: "Design", purpose: str) -> None:
    """Refuse a design that is written branch by branch where levels are needed."""
    if design.branches is not None:
        allowed = f"a design of levels: {purpose}, and this one is written branch by branch"
        raise BadInputError("design", design.name, allowed)


def _with_one(values: tuple[float, ...], place: int, value: float | None) -> tuple[float, ...]:
    """Return values with one of them replaced, if it is given."""
    return values if value is None else (*values[:place], value, *values[place + 1 :])


def design_content(design: "Design") -> dict[str, Any]:
    """Return a design as tables and values of a design file; lengths are in millimetres."""
    return table_content(design)


def design_text(design: "Design") -> str:
    """Return a design as the text of a design file; reading it gives the same design."""
    content = table_content(design)
    if not design.build.taper:
        del content["build"]["taper"]
    head = {key: value for key, value in content.items() if not isinstance(value, dict | list)}
    blocks = [f"# {GENERATOR}\n{tomli_w.dumps(head)}"]
    for name, value in content.items():
        if isinstance(value, list):
            for table in value:
                inner = {key: one for key, one in table.items() if isinstance(one, dict)}
                flat = {key: one for key, one in table.items() if key not in inner}
                blocks.append(f"[[{name}]]\n{tomli_w.dumps(flat)}")
                blocks += [f"[{name}.{key}]\n{tomli_w.dumps(one)}" for key, one in inner.items()]
        elif isinstance(value, dict) and value:
            blocks.append(tomli_w.dumps({name: value}))
    return "\n".join(blocks)
