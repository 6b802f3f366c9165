"""How much predictions change when something else changes."""

from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.model.measure import Measure

ENOUGH_GROUPS = 6
"""With fewer maps a bootstrap interval says too little: 2^-5 is the least p-value of five."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A mean paired difference.

    Parameters
    ----------
    mean
        Mean over deployments of value with the change less value without.
    low, high
        Its 95 % bootstrap interval over maps, or over poses where there is one map.
    groups
        How many maps (or poses) that is.
    """

    mean: float
    low: float
    high: float
    groups: int

    @property
    def is_clear(self) -> bool:
        """Whether the interval leaves out 0; never with fewer than `ENOUGH_GROUPS`."""
        return self.groups >= ENOUGH_GROUPS and (self.low > 0.0 or self.high < 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """What one change of a design, a start or the model does to the measures.

    Parameters
    ----------
    knob
        What is turned (``heading``).
    step
        How far, in ``unit``.
    unit
        Its unit.
    count
        Deployments compared, each with itself without the change.
    changes
        By measure key.
    """

    knob: str
    step: float
    unit: str
    count: int
    changes: Mapping[str, Change]

    @property
    def text(self) -> str:
        """The step as it is shown."""
        return f"{self.step:+g} {self.unit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """How robots of one design differ because none is made exactly.

    Parameters
    ----------
    measure
        What is looked at.
    exact
        Mean over deployments of the robot as designed.
    p05, p95
        Percentiles over robots of that mean.
    typical
        Median absolute change of a single deployment.
    """

    measure: Measure
    exact: float
    p05: float
    p95: float
    typical: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """Scatter from making: every branch's length and angle off by a little, each on its own.

    Parameters
    ----------
    length_percent, angle_deg
        Half-widths of the uniform ranges of the errors.
    robots
        How many robots were drawn.
    launches
        From how many poses each was deployed.
    scatter
        One per measure.
    """

    length_percent: float
    angle_deg: float
    robots: int
    launches: int
    scatter: tuple[Scatter, ...]
