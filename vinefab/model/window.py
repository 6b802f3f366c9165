"""The pressure window: between what growth needs and what the seams stand."""

from dataclasses import dataclass

from vinefab.model.laser import Standing


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelPressure:
    """What one width stands.

    Parameters
    ----------
    name
        Which part has the width.
    level
        Its level, for colours.
    width_mm, inflated_mm
        Lay-flat width and inflated diameter.
    burst_kpa
        Pressure at which its seam gives way.
    allowed_kpa
        That, less the safety factor.
    strain_percent
        Hoop strain at the working pressure.
    """

    name: str
    level: int
    width_mm: float
    inflated_mm: float
    burst_kpa: float
    allowed_kpa: float
    strain_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Need:
    """What growth to the worst tip takes, over deployments.

    Parameters
    ----------
    storage
        How the film is stored: ``loosely`` or ``tightly``.
    p05_kpa, median_kpa, p95_kpa, greatest_kpa
        Percentiles over deployments, and the greatest value.
    enough_percent
        Share of the deployments that need no more than is allowed.
    """

    storage: str
    p05_kpa: float
    median_kpa: float
    p95_kpa: float
    greatest_kpa: float
    enough_percent: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureWindow:
    """What growth to the worst tip needs beside what the widest part may take.

    Parameters
    ----------
    loose, tight
        Need with film that nothing holds back in its store, and on a tight spool.
    working_kpa
        The design's working pressure.
    levels
        What each width stands, trunk first, pouches last.
    safety_factor
        Burst over allowed pressure.
    standing
        How far burst pressures may be trusted.
    """

    loose: Need
    tight: Need
    working_kpa: float
    levels: tuple[LevelPressure, ...]
    safety_factor: float
    standing: Standing

    @property
    def allowed_kpa(self) -> float:
        """The pressure that every width may take."""
        return min(level.allowed_kpa for level in self.levels)

    @property
    def needed_kpa(self) -> float:
        """What 95 % of the deployments grow with, if the film is stored loosely."""
        return self.loose.p95_kpa

    @property
    def is_open(self) -> bool:
        """Whether any pressure grows the robot and leaves it whole."""
        return self.needed_kpa < self.allowed_kpa

    @property
    def is_open_tight(self) -> bool:
        """Whether that is so even with film on a tight spool."""
        return self.tight.p95_kpa < self.allowed_kpa

    @property
    def holds_working(self) -> bool:
        """Whether the working pressure lies in the window."""
        return self.needed_kpa <= self.working_kpa <= self.allowed_kpa

    @property
    def highest_kpa(self) -> float:
        """The largest pressure that a picture of it has to show."""
        return max(
            self.tight.p95_kpa, self.working_kpa, *(level.allowed_kpa for level in self.levels)
        )
