"""Designs of branching vine robots: a tree of levels and how it is built."""

import math
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, get_args

from vinefab.core.atomic import write_text
from vinefab.core.errors import BadInputError
from vinefab.core.front_door import front_door
from vinefab.core.plain_text import counted
from vinefab.core.units import rad
from vinefab.core.validation import LARGEST_MM, number, plain_number, positive, whole

if TYPE_CHECKING:
    from vinefab.model.deployment import Deployment
    from vinefab.model.map import Map, Pose

MOST_LEVELS = 10
MOST_BRANCHES = 100_000

DEFAULT_TRUNK_WIDTH_MM = 40.0
DEFAULT_WIDTH_RATIO = 0.6
DEFAULT_FILLET_RATIO = 0.25
DEFAULT_LEAST_FILLET_MM = 2.0
DEFAULT_TAIL_MM = 200.0
DEFAULT_PRESSURE_KPA = 20.0

ORIGIN_GROWTH = "growth"
"""Key of a design's origin under which the growth options stand that it was trained with."""

ORIGIN_RECIPE = "recipe"
"""Key under which the recipe of the design's run stands."""


def _make_plain(noun: object, *names: str) -> None:
    """Turn the numbers of numpy in some fields into Python's, which every file form takes."""
    for name in names:
        given = getattr(noun, name)
        plain = plain_number(given)
        if plain is not given:
            object.__setattr__(noun, name, plain)


def _number_row(key: str, given: object) -> tuple[float, ...]:
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise BadInputError(key, given, "numbers, one for each level")
    return tuple(plain_number(value) for value in given)


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """One level of branches; every branch of the level before sprouts the same fan.

    Parameters
    ----------
    branches
        Children per parent (SPL of the paper's Table 1).
    length_mm
        Length of the first child (BL), clockwise-most in the fan.
    fan_rad
        Angle of the whole fan (theta), 0 to 2 pi.
    growth
        Length of the last child over that of the first (LGF / 100). The paper does not define
        LGF; this reading is vinefab's.
    """

    branches: int
    length_mm: float
    fan_rad: float
    growth: float = 1.0

    def __post_init__(self) -> None:
        _make_plain(self, "branches", "length_mm", "fan_rad", "growth")
        whole("branches", self.branches, 1, 1000)
        positive("length", self.length_mm)
        number("angle_deg", math.degrees(self.fan_rad), 0.0, 360.0, "deg")
        number("growth_percent", 100.0 * self.growth, 0.1, 10_000.0, "%")

    @classmethod
    def of(
        cls,
        branches: int,
        length_mm: float,
        angle_deg: float = 0.0,
        growth_percent: float = 100.0,
    ) -> "Level":
        """Return a level in the units of design files.

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
        fan_rad = rad(number("angle_deg", angle_deg, 0.0, 360.0, "deg"))
        growth = number("growth_percent", growth_percent, 0.1, 10_000.0, "%") / 100.0
        return cls(branches=branches, length_mm=length_mm, fan_rad=fan_rad, growth=growth)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pouch:
    """The wider pocket at every leaf tip that jams in a gap (flat sizes, before inflation).

    Parameters
    ----------
    shape
        ``round`` or ``rectangle``.
    radius_mm
        Flat radius of a round pouch.
    length_mm, width_mm
        Flat size of a rectangular pouch, along and across the branch.
    """

    shape: Literal["round", "rectangle"]
    radius_mm: float | None = None
    length_mm: float | None = None
    width_mm: float | None = None

    def __post_init__(self) -> None:
        if self.shape not in ("round", "rectangle"):
            raise BadInputError("pouch.shape", self.shape, "'round' or 'rectangle'")
        needed = ("radius_mm",) if self.shape == "round" else ("length_mm", "width_mm")
        for name in ("radius_mm", "length_mm", "width_mm"):
            value = getattr(self, name)
            if name in needed and value is None:
                raise BadInputError(f"pouch.{name}", None, f"a length for a {self.shape} pouch")
            if name not in needed and value is not None:
                raise BadInputError(
                    f"pouch.{name}", value, f"only {', '.join(needed)} for a {self.shape} pouch"
                )
            if value is not None:
                positive(f"pouch.{name}", value)

    @property
    def flat_width_mm(self) -> float:
        """Flat width across the branch."""
        if self.shape == "round":
            return 2.0 * (self.radius_mm or 0.0)
        return self.width_mm or 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Collar:
    """The end of the tail, as wide as the clamp of a base needs.

    From the mouth on, the tail is straight and as wide as the clamp for ``length_mm``; then it
    changes to the trunk's width within ``flare_mm``, by two arcs of one radius.

    Parameters
    ----------
    clamp_diameter_mm
        Outer diameter of the tube that the tail is slipped over.
    length_mm
        Straight length from the mouth on; 0 for a flare that ends at the mouth.
    flare_mm
        Length of the transition, along the tail.
    """

    clamp_diameter_mm: float
    length_mm: float = 30.0
    flare_mm: float = 40.0

    def __post_init__(self) -> None:
        positive("build.collar.clamp_diameter_mm", self.clamp_diameter_mm)
        number("build.collar.length_mm", self.length_mm, 0.0, LARGEST_MM, "mm")
        positive("build.collar.flare_mm", self.flare_mm)

    @property
    def flat_width_mm(self) -> float:
        """Lay-flat width of a tube around the clamp: half its circumference."""
        return math.pi * self.clamp_diameter_mm / 2.0

    @property
    def reach_mm(self) -> float:
        """Length of the tail that it takes."""
        return self.length_mm + self.flare_mm


Mounting = Literal["tail_inverted", "turned"]
"""How a robot as cut is put on its base: as it is, its tail inverted over the base, which turns
every face when it grows; or first turned inside out as a whole."""

DEFAULT_MOUNTING: Mounting = "tail_inverted"


def check_mounting(given: object) -> None:
    """Refuse what is no `Mounting`."""
    if given not in get_args(Mounting):
        raise BadInputError("build.mounting", given, " or ".join(map(repr, get_args(Mounting))))


MOST_PIECES = 676
"""Labels of pieces have at most two letters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PieceSettings:
    """How a robot may be cut in flat pieces, which sleeves join.

    Parameters
    ----------
    most
        Most pieces; the fewest that the tree needs are cut.
    lap_mm
        Length along which socket and plug of two pieces lie on each other [assumed].
    ease_mm
        How much wider than the plug's outside a socket is, flat [assumed].
    """

    most: int = 6
    lap_mm: float = 15.0
    ease_mm: float = 1.0

    def __post_init__(self) -> None:
        whole("build.pieces.most", self.most, 1, MOST_PIECES)
        number("build.pieces.lap_mm", self.lap_mm, 1.0, 1000.0, "mm")
        number("build.pieces.ease_mm", self.ease_mm, 0.0, 100.0, "mm")


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """How a tree of lines becomes a flat tube; one entry per level, trunk first.

    Parameters
    ----------
    widths_mm
        Lay-flat lumen width of each level, where its branches begin.
    taper
        Width at the end of each level's branches over that at their beginning, at most 1; empty
        for branches of even width. A tapered branch is the hull of a disc at each of its ends.
    fillet_mm
        Fillet radius at the joints of each level after the trunk; one entry fewer than
        ``widths_mm``.
    tail_mm
        Straight length below the trunk's base that is inverted over the base and clamped.
    pressure_kpa
        Working gauge pressure.
    pouch
        Pouch at every leaf tip, or None for rounded tips.
    collar
        Transition from the tail to the clamp of a base, or None for a tail of the trunk's width.
    pieces
        How the robot may be cut in pieces, or None for one flat outline.
    mounting
        ``tail_inverted``: the faces that lie inside as cut end outside, and the outer part of a
        sleeve goes into the stub; ``turned``: as cut, and over the stub.
    """

    widths_mm: tuple[float, ...]
    fillet_mm: tuple[float, ...]
    taper: tuple[float, ...] = ()
    tail_mm: float = DEFAULT_TAIL_MM
    pressure_kpa: float = DEFAULT_PRESSURE_KPA
    pouch: Pouch | None = None
    collar: Collar | None = None
    pieces: PieceSettings | None = None
    mounting: Mounting = DEFAULT_MOUNTING

    def __post_init__(self) -> None:
        for name in ("widths_mm", "fillet_mm", "taper"):
            object.__setattr__(self, name, _number_row(f"build.{name}", getattr(self, name)))
        _make_plain(self, "tail_mm", "pressure_kpa")
        for ratio in self.taper:
            number("build.taper", ratio, 0.01, 1.0)
        if len(self.taper) not in (0, len(self.widths_mm)):
            raise BadInputError(
                "build.taper", list(self.taper), counted(len(self.widths_mm), "ratio")
            )
        for width in self.widths_mm:
            positive("build.widths_mm", width)
        for radius in self.fillet_mm:
            number("build.fillet_mm", radius, 0.0, LARGEST_MM, "mm")
        if len(self.fillet_mm) != len(self.widths_mm) - 1:
            raise BadInputError(
                "build.fillet_mm", list(self.fillet_mm), f"{len(self.widths_mm) - 1} radii"
            )
        number("build.tail_mm", self.tail_mm, 0.0, LARGEST_MM, "mm")
        number("build.pressure_kpa", self.pressure_kpa, 0.0, 10_000.0, "kPa")
        check_mounting(self.mounting)

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
    ) -> "Build":
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
        widths = tuple(trunk_width_mm * width_ratio**level for level in range(levels))
        return cls(widths_mm=widths, fillet_mm=default_fillets_mm(widths))


def default_fillets_mm(
    widths_mm: tuple[float, ...], ratio: float = DEFAULT_FILLET_RATIO
) -> tuple[float, ...]:
    """Return the default fillet radius for every level after the trunk."""
    return tuple(max(DEFAULT_LEAST_FILLET_MM, ratio * width) for width in widths_mm[1:])


@dataclass(frozen=True, slots=True, kw_only=True)
class Waiver:
    """A finding that the designer accepts.

    Parameters
    ----------
    fingerprint
        The finding's stable id, as ``check`` prints it.
    reason
        Why it is accepted.
    """

    fingerprint: str
    reason: str

    def __post_init__(self) -> None:
        if not self.fingerprint.strip():
            raise BadInputError("waive.fingerprint", self.fingerprint, "a finding's fingerprint")
        if not self.reason.strip():
            raise BadInputError("waive.reason", self.reason, "a reason, in words")


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """A branching vine robot, lengths in millimetres.

    Parameters
    ----------
    name
        Letters, digits, ``_``, ``-`` and ``.``; it becomes part of file names.
    trunk_length_mm
        Length of the trunk, level 1.
    levels
        Levels 2, 3, ...; empty for a plain vine.
    build
        Widths, fillets, tail, pressure and pouch; one width per level, the trunk included.
    waivers
        Findings that the designer accepts.
    origin
        How the design was made: run id, seed, scores; free-form plain values. Under ``growth`` are
        the growth options that it was trained with: commands grow it with them. Under ``recipe``
        is the recipe of its run: commands check and make it with that one.
    limits
        Limits of design rules that differ for this design: rule id to name to value. They override
        the recipe's.
    folder
        Folder of the file that it was read from, in which its origin names files; None for none.
    """

    name: str
    trunk_length_mm: float
    levels: tuple[Level, ...] = ()
    build: Build
    waivers: tuple[Waiver, ...] = ()
    origin: Mapping[str, object] = field(default_factory=dict)
    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    folder: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if (
            not isinstance(self.name, str)
            or not self.name
            or not all(c.isalnum() or c in "_-." for c in self.name)
        ):
            raise BadInputError("name", self.name, "letters, digits, '_', '-' and '.'")
        if self.name.startswith(".") or len(self.name) > 100:
            raise BadInputError("name", self.name, "at most 100 characters, not starting with '.'")
        _make_plain(self, "trunk_length_mm")
        positive("trunk.length", self.trunk_length_mm)
        if not isinstance(self.levels, Sequence) or not all(
            isinstance(level, Level) for level in self.levels
        ):
            raise BadInputError("levels", self.levels, "a Level for each level beyond the trunk")
        if not isinstance(self.build, Build):
            raise BadInputError("build", self.build, "a Build, such as Build.standard(levels=3)")
        object.__setattr__(self, "levels", tuple(self.levels))
        if self.depth > MOST_LEVELS:
            raise BadInputError(
                "level", counted(len(self.levels), "level"), f"at most {MOST_LEVELS - 1}"
            )
        if self.branch_count > MOST_BRANCHES:
            raise BadInputError(
                "level", counted(self.branch_count, "branch"), f"at most {MOST_BRANCHES} in all"
            )
        if len(self.build.widths_mm) != self.depth:
            raise BadInputError(
                "build.widths_mm",
                list(self.build.widths_mm),
                f"{counted(self.depth, 'width')}, one per level with the trunk first",
            )
        object.__setattr__(self, "origin", MappingProxyType(dict(self.origin)))
        frozen = {rule: MappingProxyType(dict(named)) for rule, named in self.limits.items()}
        object.__setattr__(self, "limits", MappingProxyType(frozen))

    def __repr__(self) -> str:
        lengths_mm = " + ".join(
            [
                f"{self.trunk_length_mm:.5g}",
                *(f"{level.length_mm:.5g}" for level in self.levels[:4]),
            ]
        )
        more = " + ..." if len(self.levels) > 4 else ""
        return (
            f"<Design {reprlib.repr(self.name)}: {counted(self.depth, 'level')} of "
            f"{lengths_mm}{more} mm, "
            f"{counted(self.branch_count, 'branch')}, trunk {self.build.widths_mm[0]:.5g} mm wide>"
        )

    @property
    def depth(self) -> int:
        """Number of levels, the trunk included."""
        return 1 + len(self.levels)

    @property
    def branch_count(self) -> int:
        """Number of branches in the whole tree, the trunk included."""
        total = count = 1
        for level in self.levels:
            count *= level.branches
            total += count
        return total

    @classmethod
    def read(cls, name_or_path: str | PathLike[str]) -> "Design":
        """Return the design in a file, or one of the user's own or the shipped ones by name.

        Parameters
        ----------
        name_or_path
            A path, or a name such as ``grid_explorer``; a bare name is a file here, in the user's
            own folder, or a shipped design.

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
        # The file form of designs is built on this module.
        from vinefab.model.files.design_toml import read_design  # noqa: PLC0415

        return read_design(name_or_path)

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
        place = whole("level", level, 1, self.depth) - 1
        for key, length in (("length_mm", length_mm), ("width_mm", width_mm)):
            if length is not None:
                positive(key, length)
        fan = {"branches": branches, "angle_deg": angle_deg, "growth_percent": growth_percent}
        levels, trunk_length_mm = list(self.levels), self.trunk_length_mm
        if place:
            levels[place - 1] = _changed_level(levels[place - 1], {"length_mm": length_mm, **fan})
        else:
            for key, value in {**fan, "fillet_mm": fillet_mm}.items():
                if value is not None:
                    raise BadInputError(key, value, "nothing at level 1: a trunk has none")
            trunk_length_mm = trunk_length_mm if length_mm is None else length_mm
        build = self.build
        tapers = build.taper or (() if taper is None else (1.0,) * self.depth)
        return replace(
            self,
            name=self.name if name is None else name,
            trunk_length_mm=trunk_length_mm,
            levels=tuple(levels),
            build=replace(
                build,
                widths_mm=_with_one(build.widths_mm, place, width_mm),
                taper=_with_one(tapers, place, taper),
                fillet_mm=_with_one(build.fillet_mm, place - 1, fillet_mm),
            ),
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
            If ``path`` is no path.
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
        from vinefab.model.files.design_toml import design_text  # noqa: PLC0415  as above
        from vinefab.model.files.shipped import path_given  # noqa: PLC0415

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
        grown: Deployment = front_door().grow_design(
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

    def _repr_svg_(self) -> str | None:
        """Show the flat outline in a notebook."""
        drawn: str | None = front_door().svg_of(self)
        return drawn


def _changed_level(old: Level, given: Mapping[str, float | None]) -> Level:
    """Return a level with the values given that are not None, each as in `Level.of`."""
    new = Level.of(
        branches=old.branches if given["branches"] is None else given["branches"],  # type: ignore[arg-type]
        length_mm=old.length_mm if given["length_mm"] is None else given["length_mm"],
        angle_deg=given["angle_deg"] or 0.0,
        growth_percent=100.0 if given["growth_percent"] is None else given["growth_percent"],
    )
    # What is not given stays to the last bit.
    fan_rad = old.fan_rad if given["angle_deg"] is None else new.fan_rad
    growth = old.growth if given["growth_percent"] is None else new.growth
    return replace(new, fan_rad=fan_rad, growth=growth)


def _with_one(values: tuple[float, ...], place: int, value: float | None) -> tuple[float, ...]:
    """Return values with one of them replaced, if it is given."""
    return values if value is None else (*values[:place], value, *values[place + 1 :])
