"""One branch grown in exact fractions, among obstacles as they were drawn.

Nothing is united, rounded or held against a tolerance: a tip is stopped by the first edge through
which it would enter an obstacle, and follows an edge until that enters another obstacle. Only
lengths are irrational; they have 60 digits. Rules as in `tests.oracles.growth_reference`, for maps
without exact ties.
"""

from dataclasses import dataclass, field
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import pairwise

DIGITS = 60


@dataclass(frozen=True, slots=True)
class P:
    """A point, or a vector, in exact numbers."""

    x: Fraction
    y: Fraction

    def __add__(self, other: "P") -> "P":
        return P(self.x + other.x, self.y + other.y)

    def __sub__(self, other: "P") -> "P":
        return P(self.x - other.x, self.y - other.y)

    def __mul__(self, factor: Fraction) -> "P":
        return P(self.x * factor, self.y * factor)

    def dot(self, other: "P") -> Fraction:
        return self.x * other.x + self.y * other.y

    def cross(self, other: "P") -> Fraction:
        return self.x * other.y - self.y * other.x


Edge = tuple[P, P]
Place = tuple[int, int]
"""An obstacle's number (0: the bounds), and an edge's."""


def size(vector: P) -> Decimal:
    """Return a vector's length to many digits."""
    square = vector.dot(vector)
    with localcontext() as context:
        context.prec = DIGITS
        return (Decimal(square.numerator) / Decimal(square.denominator)).sqrt()
