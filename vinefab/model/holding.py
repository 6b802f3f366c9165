"""What a deployed robot is expected to hold."""

from dataclasses import dataclass

from vinefab.model.checked import Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Held:
    """What robots hold if so many of their leaves do, at one coefficient of friction.

    Parameters
    ----------
    friction
        The coefficient.
    engaged_percent
        Share of the deployed leaves that hold, those that turned least first.
    amplification
        Mean over deployments of the force over that of one pouch without any turn.
    """

    friction: float
    engaged_percent: float
    amplification: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forces:
    """Forces of a design that has pouches, over deployments.

    Parameters
    ----------
    friction
        Coefficients, rising, shape (k,).
    mean_n, p05_n, p95_n
        For each coefficient, over deployments, shape (k,).
    engaged_percent
        Share of the leaves whose inflated pouch is wider than the gap that it ended in.
    limited_percent
        Share of the engaged leaves that film or seam limit at the greatest coefficient.
    pressure_kpa
        Working pressure that they are for.
    mass_g
        Film of the robot; 0 when it is not known.
    """

    friction: Floats
    mean_n: Floats
    p05_n: Floats
    p95_n: Floats
    engaged_percent: float
    limited_percent: float
    pressure_kpa: float
    mass_g: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Holding:
    """Anchoring as an interval over friction and over which leaves are engaged.

    Parameters
    ----------
    label
        The field.
    leaves
        Leaves of the design.
    table
        Every combination that was looked at.
    forces
        In newtons, where the design has pouches.
    """

    label: str
    leaves: int
    table: tuple[Held, ...]
    forces: Forces | None = None

    def at(self, friction: float, engaged_percent: float) -> float:
        """Return the amplification of one combination."""
        return next(
            held.amplification
            for held in self.table
            if held.friction == friction and held.engaged_percent == engaged_percent
        )
