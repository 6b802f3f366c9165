"""Two designs against each other on the same maps from the same poses."""

from dataclasses import dataclass

from vinefab.model.measure import Measure

LEVEL = 0.05
"""A difference is called clear when its adjusted p-value is below this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Duel:
    """The paired difference of two designs in one measure, first less second.

    Parameters
    ----------
    measure
        What is compared.
    first, second
        Names of the designs.
    mean, low, high
        Mean difference and its 95 % bootstrap interval over maps.
    p, p_adjusted
        Two-sided p-value of no difference by flipping signs of maps' differences, and the same
        adjusted for the number of pairs of designs (Holm).
    won_percent
        Share of the maps on which the first is better, ties as half.
    pairs
        Independent differences: maps, or poses where there is one map.
    """

    measure: Measure
    first: str
    second: str
    mean: float
    low: float
    high: float
    p: float
    p_adjusted: float
    won_percent: float
    pairs: int

    @property
    def is_clear(self) -> bool:
        """Whether the difference can hardly be chance."""
        return self.p_adjusted < LEVEL

    @property
    def winner(self) -> str:
        """The design that is better in the mean."""
        more = self.measure.better == "more"
        return self.first if (self.mean > 0.0) == more else self.second

    @property
    def words(self) -> str:
        """The outcome in one sentence."""
        mean, low, high = (self.measure.number(value) for value in (self.mean, self.low, self.high))
        by = f"{mean} [{low}, {high}] {self.measure.unit}".rstrip()
        chance = f"p = {self.p_adjusted:.5f}, {self.pairs} pairs"
        pair = f"{self.first} less {self.second}: {by}, {chance}"
        if self.is_clear:
            return f"{self.measure.title}: {self.winner} is better; {pair}"
        return f"{self.measure.title}: no clear difference; {pair}"
