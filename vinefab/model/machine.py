"""Machines of every process, and how each process runs an operation: a table for each.

What all machines share stands in `Machine`, what all operations share in `OperationSettings`. A
process is a kind of machine with its table in recipes: a laser has ``[operations.NAME]``, a hot tip
``[hot_tip]``, a knife ``[knife]``, a sealer ``[sealer]``. Scissors need no table.
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Interval, Le, Unit
from pydantic import Field, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.limits import SMALLEST
from vinefab.core.table import Table
from vinefab.model.quantity import (
    BREADTH,
    LENGTH,
    NOT_NEGATIVE,
    POSITIVE,
    Quantity,
    Standing,
)

FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100)]
ProfileName = Annotated[FileName, Doc("as the file, without its suffix")]
ProfileTitle = Annotated[str, Doc("for people")]


class Tool(StrEnum):
    """What runs an operation."""

    LASER = "laser"
    HOT_TIP = "hot_tip"
    KNIFE = "knife"
    IMPULSE_SEALER = "impulse_sealer"
    SCISSORS = "scissors"

    @property
    def by_hand(self) -> bool:
        """Whether people run it, along lines on the film."""
        return self in (Tool.IMPULSE_SEALER, Tool.SCISSORS)


class Machine(Table):
    """What machines of every process have: a file in ``laser_profiles/machines``."""

    tool: ClassVar[Tool]

    schema_: Annotated[
        Literal["vinefab/machine-1"],
        Field(alias="schema", repr=False),
        Doc("kind of file and its version"),
    ] = "vinefab/machine-1"
    kind: Annotated[str, Field(repr=False), Doc("its process")]
    name: ProfileName
    title: ProfileTitle
    bed_width_mm: Annotated[Quantity, LENGTH, Unit("mm"), Doc("along x")]
    bed_height_mm: Annotated[Quantity, LENGTH, Unit("mm"), Doc("along y")]
    margin_mm: Annotated[Quantity, BREADTH, Unit("mm"), Doc("rim of the bed that stays free")]
    colours: Annotated[str, Doc("preset of its software")] = "default"
    hairline_mm: Annotated[
        float, Ge(SMALLEST), Le(10), Unit("mm"), Doc("line width that its driver takes for a cut")
    ] = 0.01

    @model_validator(mode="after")
    def _has_room(self) -> "Machine":
        least_mm = min(self.bed_width_mm.value, self.bed_height_mm.value)
        if 2.0 * self.margin_mm.value >= least_mm:
            allowed = f"less than half of the bed ({least_mm:g} mm)"
            raise BadInputError("margin_mm", self.margin_mm.value, allowed)
        return self

    @property
    def usable_mm(self) -> tuple[float, float]:
        """Width and height of the bed inside its margins."""
        margin = 2.0 * self.margin_mm.value
        return self.bed_width_mm.value - margin, self.bed_height_mm.value - margin

    @property
    def usable_box_mm(self) -> tuple[float, float, float, float]:
        """The bed inside its margins: least x, least y, greatest x, greatest y."""
        margin, (width, height) = self.margin_mm.value, self.usable_mm
        return margin, margin, margin + width, margin + height


class HeadMachine(Machine):
    """What machines have whose head runs along paths."""

    speed_max_mm_s: Annotated[Quantity, POSITIVE, Unit("mm/s"), Doc("of the head")]
    acceleration_mm_s2: Annotated[Quantity, POSITIVE, Unit("mm/s2"), Doc("of the head")]


class LaserMachine(HeadMachine):
    """A laser cutter."""

    tool = Tool.LASER

    kind: Annotated[Literal["laser"], Field(repr=False), Doc("its process")] = "laser"
    power_w: Annotated[Quantity, POSITIVE, Unit("W"), Doc("of the laser")]
    spot_mm: Annotated[Quantity, POSITIVE, Unit("mm"), Doc("diameter in focus")]
    rayleigh_mm: Annotated[
        Quantity, POSITIVE, Unit("mm"), Doc("depth over which the spot grows by the root of 2")
    ]

    def __repr_name__(self) -> str:
        return "Machine"

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        """Yield the values in the order that fingerprints of recipes have."""
        values = dict(super().__repr_args__())
        last = ("speed_max_mm_s", "acceleration_mm_s2", "colours", "hairline_mm")
        yield from ((name, value) for name, value in values.items() if name not in last)
        yield from ((name, values[name]) for name in last)


_Code = Annotated[
    str, Field(max_length=4000), Doc("lines of G-code for your machine; empty: vinefab's own")
]


class LiftingMachine(HeadMachine):
    """What machines have whose tool is lifted between paths and lowered onto them."""

    travel_z_mm: Annotated[
        Quantity, Interval(ge=0.1, le=200), Unit("mm"), Doc("height between paths, over the film")
    ]
    plunge_mm_s: Annotated[Quantity, POSITIVE, Unit("mm/s"), Doc("up and down")]
    arcs: Annotated[
        bool, Doc("whether its firmware takes arcs (G2, G3); else chords within 0.02 mm")
    ] = True
    start_gcode: _Code = ""
    end_gcode: _Code = ""


class HotTipMachine(LiftingMachine):
    """A printer or router whose heated tip seals; nothing is extruded."""

    tool = Tool.HOT_TIP

    kind: Annotated[Literal["hot_tip"], Field(repr=False), Doc("its process")]
    tip_mm: Annotated[
        Quantity, Interval(ge=0.1, le=20), Unit("mm"), Doc("width that touches the film")
    ]


class KnifeMachine(LiftingMachine):
    """A drag knife or an oscillating blade, such as a vinyl cutter's."""

    tool = Tool.KNIFE

    kind: Annotated[Literal["knife"], Field(repr=False), Doc("its process")]
    blade_offset_mm: Annotated[
        Quantity,
        Interval(ge=0, le=10),
        Unit("mm"),
        Doc("by which the cutting point trails the spindle's axis"),
    ]
    corner_swivel_deg: Annotated[
        Quantity,
        Interval(ge=1, le=90),
        Unit("deg"),
        Doc("turn of a path above which the blade is lifted before it swivels round"),
    ]


class SealerMachine(Machine):
    """An impulse sealer with straight bars; its bed is the table that the film lies on."""

    tool = Tool.IMPULSE_SEALER

    kind: Annotated[Literal["sealer"], Field(repr=False), Doc("its process")]
    bar_mm: Annotated[Quantity, LENGTH, Unit("mm"), Doc("length of the bars")]


MACHINES: dict[str, type[Machine]] = {
    "laser": LaserMachine,
    "hot_tip": HotTipMachine,
    "knife": KnifeMachine,
    "sealer": SealerMachine,
}
"""The table of a machine's file by its kind."""


_Speed = Annotated[Quantity, POSITIVE, Unit("mm/s"), Doc("of the head")]
_Passes = Annotated[int, Ge(1), Le(100), Doc("over the same path")]
_Kerf = Annotated[Quantity, BREADTH, Unit("mm"), Doc("width that is removed")]
_Overcut = Annotated[Quantity, BREADTH, Unit("mm"), Doc("that a closed path runs past its start")]


def _nothing(source: str) -> Quantity:
    return Quantity(value=0.0, standing=Standing.COMPUTED, source=source)


def _height_s(machine: Machine, z_mm: float) -> float:
    """Return the time from the height of travel to another one."""
    if not isinstance(machine, LiftingMachine):
        return 0.0
    return abs(machine.travel_z_mm.value - z_mm) / machine.plunge_mm_s.value


class OperationSettings(Table):
    """How one operation is run, whatever runs it."""

    tool: ClassVar[Tool]

    if TYPE_CHECKING:
        # Declared by each process: a field where recipes give it, else a constant.
        @property
        def passes(self) -> int:
            """How often it runs over the same path."""

        @property
        def kerf_mm(self) -> Quantity:
            """Width that is removed."""

        @property
        def seam_width_mm(self) -> Quantity:
            """Width that is fused."""

        @property
        def overcut_mm(self) -> Quantity:
            """By how much a closed path runs past its start."""

    @property
    def head_speed(self) -> Quantity | None:
        """Speed of the machine's head in mm/s; None where people run it."""
        return None

    def lowered_s(self, machine: Machine) -> tuple[float, float]:  # noqa: ARG002  of its machine
        """Return the time to come down on the start of a path, and to leave its end."""
        return 0.0, 0.0

    def scaled_words(self, name: str, share: float) -> str:  # noqa: ARG002  of processes that scale
        """Return what to run in place of the settings; empty where thickness changes nothing.

        Parameters
        ----------
        name
            The operation.
        share
            Thickness of the film over that of the film that the settings are for.
        """
        return ""

    def record(self) -> dict[str, object]:
        """Return the settings and their tool as reports have them (and fingerprint them)."""
        return {**dict(self), "tool": self.tool}


class LaserSettings(OperationSettings):
    """How the laser runs one operation: a table ``[operations.NAME]`` of a recipe."""

    tool = Tool.LASER

    power_percent: Annotated[Quantity, Interval(ge=1e-6, le=100), Unit("%"), Doc("of the laser")]
    min_power_percent: Annotated[Quantity, Interval(ge=0, le=100), Unit("%"), Doc("in corners")]
    speed_mm_s: _Speed
    passes: _Passes
    focus_offset_mm: Annotated[
        Quantity,
        Interval(ge=-1000, le=1000),
        Unit("mm"),
        Doc("above the focus; widens the spot"),
    ]
    frequency_hz: Annotated[Quantity, NOT_NEGATIVE, Unit("Hz"), Doc("of pulses")]
    air_assist: Annotated[bool, Doc("whether air blows on the cut")]
    spot_mm: Annotated[Quantity, POSITIVE, Unit("mm"), Doc("diameter at this offset")]
    kerf_mm: _Kerf
    seam_width_mm: Annotated[
        Quantity, BREADTH, Unit("mm"), Doc("width that is fused inward of the kerf")
    ]
    overcut_mm: _Overcut

    @model_validator(mode="after")
    def _corners_have_less(self) -> "LaserSettings":
        power, least = self.power_percent.value, self.min_power_percent.value
        if least > power:
            raise BadInputError("min_power_percent", least, f"at most power_percent, {power:g}")
        return self

    @property
    def head_speed(self) -> Quantity:
        """Speed of the head in mm/s."""
        return self.speed_mm_s

    def scaled_words(self, name: str, share: float) -> str:
        """Return the speed that gives as much energy per volume."""
        speed = self.speed_mm_s.value
        return f"run {name} at about {speed / share:.0f} mm/s in place of {speed:g} (scaled)"

    def line_energy_mj_mm(self, machine: LaserMachine) -> float:
        """Return the energy per length of path, all passes: power over speed."""
        power_w = machine.power_w.value * self.power_percent.value / 100.0
        return 1000.0 * self.passes * power_w / self.speed_mm_s.value

    def fluence_j_cm2(self, machine: LaserMachine) -> float:
        """Return the energy per area of the beam's track: line energy over the spot."""
        return 0.1 * self.line_energy_mj_mm(machine) / self.spot_mm.value

    def __repr_name__(self) -> str:
        return "OperationSettings"

    def __repr_args__(self) -> Iterable[tuple[str, Any]]:
        return self.record().items()

    def record(self) -> dict[str, object]:
        """Return the settings and their tool as reports have them (and fingerprint them)."""
        return {**super().record(), "temperature_c": None, "dwell_s": None}


class HotTip(OperationSettings):
    """How a hot tip seals: the table ``[hot_tip]`` of a recipe."""

    tool = Tool.HOT_TIP

    seal_temperature_c: Annotated[
        Quantity, Interval(ge=20, le=500), Unit("C"), Doc("of the tip while it seals")
    ]
    seal_speed_mm_s: _Speed
    touch_z_mm: Annotated[
        Quantity,
        Interval(ge=-5, le=50),
        Unit("mm"),
        Doc("height at which the tip presses, over the film on its sheet; below 0: into it"),
    ]
    bed_temperature_c: Annotated[
        Quantity, Interval(ge=0, le=150), Unit("C"), Doc("of the bed; 0: not heated")
    ]
    preheat_s: Annotated[
        Quantity, Interval(ge=0, le=3600), Unit("s"), Doc("wait once tip and bed are warm")
    ]
    dwell_s: Annotated[
        Quantity, Interval(ge=0, le=60), Unit("s"), Doc("on the start of a seam before it moves")
    ]
    passes: _Passes
    overlap_mm: Annotated[
        Quantity, BREADTH, Unit("mm"), Doc("that a closed seam runs over its start")
    ]
    seam_width_mm: Annotated[
        Quantity, POSITIVE, Unit("mm"), Doc("of the seam, centred on the path: the tip's width")
    ]
    sheet: Annotated[
        str,
        Field(min_length=1, max_length=200),
        Doc("what lies below the film and between film and tip"),
    ]

    @property
    def head_speed(self) -> Quantity:
        """Speed of the tip along a seam in mm/s."""
        return self.seal_speed_mm_s

    def lowered_s(self, machine: Machine) -> tuple[float, float]:
        """Return the time to come down and dwell on a seam, and to lift off."""
        height_s = _height_s(machine, self.touch_z_mm.value)
        return height_s + self.dwell_s.value, height_s

    def scaled_words(self, name: str, share: float) -> str:  # noqa: ARG002  as its base
        """Return the speed at which heat reaches the same depth: time goes with its square."""
        speed = self.seal_speed_mm_s.value
        return (
            f"seal at about {speed / share**2:.1f} mm/s in place of {speed:g} (scaled: heat takes "
            "time with the square of the thickness, assumed)"
        )

    @property
    def kerf_mm(self) -> Quantity:
        """Nothing is removed."""
        return _nothing("a tip removes nothing")

    @property
    def overcut_mm(self) -> Quantity:
        """By how much a closed seam runs over its start."""
        return self.overlap_mm


class Knife(OperationSettings):
    """How a blade cuts: the table ``[knife]`` of a recipe."""

    tool = Tool.KNIFE

    cut_speed_mm_s: _Speed
    depth_mm: Annotated[
        Quantity,
        Interval(ge=0.001, le=20),
        Unit("mm"),
        Doc("of the whole cut, below the top of the film"),
    ]
    depth_passes: Annotated[int, Ge(1), Le(100), Doc("over the same path, each deeper")]
    swivel_depth_mm: Annotated[
        Quantity,
        Interval(ge=0, le=20),
        Unit("mm"),
        Doc("at which its point stays in the film while the blade swivels"),
    ]
    overcut_mm: _Overcut
    kerf_mm: _Kerf = _nothing("a blade parts film and removes nothing")

    @property
    def passes(self) -> int:
        """Passes over the same path, each deeper."""
        return self.depth_passes

    @property
    def head_speed(self) -> Quantity:
        """Speed of the blade along a cut in mm/s."""
        return self.cut_speed_mm_s

    def lowered_s(self, machine: Machine) -> tuple[float, float]:
        """Return the time to come down into the film, and to lift out."""
        height_s = _height_s(machine, -self.depth_mm.value)
        return height_s, height_s

    @property
    def seam_width_mm(self) -> Quantity:
        """Nothing is fused."""
        return _nothing("a blade fuses nothing")


class Sealer(OperationSettings):
    """How an impulse sealer seals by hand along the lines: the table ``[sealer]`` of a recipe."""

    tool = Tool.IMPULSE_SEALER

    temperature_c: Annotated[Quantity, POSITIVE, Unit("C"), Doc("of the bar")]
    dwell_s: Annotated[Quantity, POSITIVE, Unit("s"), Doc("for which it stays shut")]
    seam_width_mm: Annotated[Quantity, POSITIVE, Unit("mm"), Doc("of the bar")]
    pin_mm: Annotated[
        Quantity,
        Interval(ge=1, le=20),
        Field(repr=False),
        Unit("mm"),
        Doc("diameter of the pins that a sheet is put back by"),
    ] = Quantity(value=4.0, standing=Standing.ASSUMED, source="common locating pin")

    def scaled_words(self, name: str, share: float) -> str:  # noqa: ARG002  as its base
        """Return the dwell in which heat reaches the same depth: it goes with its square."""
        dwell = self.dwell_s.value
        return (
            f"hold the seam for about {dwell * share**2:.1f} s in place of {dwell:g} (scaled: heat "
            "takes time with the square of the thickness, assumed)"
        )

    @property
    def passes(self) -> int:
        """Once along every line."""
        return 1

    @property
    def kerf_mm(self) -> Quantity:
        """Nothing is removed."""
        return _nothing("a sealer removes nothing")

    @property
    def overcut_mm(self) -> Quantity:
        """Lines are sealed from end to end."""
        return _nothing("sealed by hand along the line")


class Scissors(OperationSettings):
    """How people cut along the lines, with scissors or a scalpel; no table of a recipe."""

    tool = Tool.SCISSORS

    @property
    def passes(self) -> int:
        """Once along every line."""
        return 1

    @property
    def kerf_mm(self) -> Quantity:
        """Nothing is removed."""
        return _nothing("scissors remove nothing")

    @property
    def seam_width_mm(self) -> Quantity:
        """Nothing is fused."""
        return _nothing("scissors fuse nothing")

    @property
    def overcut_mm(self) -> Quantity:
        """Lines are cut from end to end."""
        return _nothing("cut by hand along the line")
