"""What the paper leaves open, changed one thing at a time."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from vinefab.core.units import rad
from vinefab.experiments.reach import BUFFER_MM
from vinefab.experiments.setups import coverage_run
from vinefab.experiments.size import Size
from vinefab.growth.options import GrowthOptions
from vinefab.optimize.bounds import Bounds, BuildSettings, SpaceSettings
from vinefab.optimize.settings import PartSettings, RunSettings

SLIM = BuildSettings(trunk_width_mm=24.0, width_ratio=0.65)
"""A robot whose inflated trunk, 15 mm, has room in passages of 22 mm."""

SPECIALIZATION, REACHABILITY = "specialization", "reachability"


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One assumption, changed.

    Parameters
    ----------
    name
        What it is called.
    asks
        Which conclusions it may touch.
    growth
        How robots grow.
    clip
        What the sensors see.
    space
        The design space.
    loops
        Share of the Cave's short cuts that are open.
    buffer_mm
        Distance from the body that counts as reached.
    """

    name: str
    asks: tuple[str, ...] = (SPECIALIZATION, REACHABILITY)
    growth: GrowthOptions = field(default_factory=GrowthOptions)
    clip: str = "free"
    space: SpaceSettings = field(default_factory=SpaceSettings)
    loops: float = 1.0
    buffer_mm: float = BUFFER_MM

    def run(self, size: Size, environment: str, number: int) -> RunSettings:
        """Return a run of half the usual length, under this assumption."""
        run = coverage_run(size, environment, number)
        return replace(
            run,
            maps=replace(run.maps, options=self.options(environment)),
            space=self.space,
            build=SLIM,
            growth=self.growth,
            task=self.seen,
            search=replace(run.search, generations=max(1, size.generations // 2)),
        )

    @property
    def seen(self) -> PartSettings:
        """What counts in training, and in the tests of specialization."""
        return PartSettings(name="coverage", parameters={"area": "fast", "clip": self.clip})

    @property
    def reached(self) -> PartSettings:
        """What counts in the tests of reach."""
        return PartSettings(name="reach", parameters={"buffer_mm": self.buffer_mm})

    def options(self, environment: str) -> Mapping[str, object]:
        """Return what the maps of an environment have in common."""
        return {"loops": self.loops} if environment == "cave" else {}


BASE = Variant(name="base")
VARIANTS = (
    BASE,
    Variant(
        name="head-on half-angle 5 degrees", growth=GrowthOptions(head_on_half_angle_rad=rad(5.0))
    ),
    Variant(
        name="head-on half-angle 15 degrees",
        growth=GrowthOptions(head_on_half_angle_rad=rad(15.0)),
    ),
    Variant(name="stuck children deploy", growth=GrowthOptions(children_of_stuck="deploy")),
    Variant(name="inflated body, 24 mm trunk", growth=GrowthOptions(body="inflated")),
    Variant(
        name="fan: theta to either side",
        asks=(SPECIALIZATION,),
        space=SpaceSettings(angle_deg=Bounds(low=40.0, high=320.0)),
    ),
    Variant(name="sensors see through walls", asks=(SPECIALIZATION,), clip="none"),
    Variant(
        name="sensors see in line of sight",
        asks=(SPECIALIZATION,),
        clip="sight",
    ),
    Variant(name="Cave with 0.4 of its short cuts", loops=0.4),
    Variant(name="buffer 25 mm", asks=(REACHABILITY,), buffer_mm=25.0),
    Variant(name="buffer 55 mm", asks=(REACHABILITY,), buffer_mm=55.0),
)
