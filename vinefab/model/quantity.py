"""Numbers with a standing and a source, and the ranges that profiles declare for them."""

from enum import StrEnum
from typing import Annotated

from annotated_types import Interval
from pydantic import Field
from typing_extensions import Doc

from vinefab.core.limits import SMALLEST
from vinefab.core.table import Table

LARGEST_QUANTITY = 1e12
"""Limit of every number with a standing, in its unit."""


class Standing(StrEnum):
    """How far a number may be trusted."""

    MEASURED = "measured"
    PAPER = "paper"
    PUBLISHED = "published"
    COMPUTED = "computed"
    ASSUMED = "assumed"


class Quantity(Table):
    """A number with its standing and source; its unit is in the name of the field that holds it.

    In files: the inline table ``{ value, standing, source }``.
    """

    value: Annotated[
        float,
        Interval(ge=-LARGEST_QUANTITY, le=LARGEST_QUANTITY),
        Doc("in the unit that ends the key"),
    ]
    standing: Annotated[Standing, Field(strict=False), Doc("how far it may be trusted")]
    source: Annotated[str, Field(min_length=1), Doc("who says so, or how it was found")]
    uncertainty: Annotated[
        float | None,
        Interval(ge=0, le=LARGEST_QUANTITY),
        Doc("one standard deviation, in the same unit"),
    ] = None
    # It changes nothing that is predicted: no part of a recipe's fingerprint.
    uncertainty_95: Annotated[
        float | None,
        Interval(ge=0, le=LARGEST_QUANTITY),
        Field(repr=False),
        Doc(
            "half of the 95 % interval, in the same unit; wider than two standard deviations where"
            " readings were few"
        ),
    ] = None

    def __float__(self) -> float:
        return self.value

    def __ge__(self, least: float) -> bool:  # fields declare ranges of quantities as of numbers
        return self.value >= least

    def __le__(self, most: float) -> bool:
        return self.value <= most

    def words(self) -> str:
        """Return the number and, if known, its 95 % interval or else its standard uncertainty.

        >>> friction = Quantity(value=0.26, standing=Standing.MEASURED, source="my incline")
        >>> friction.changed(uncertainty=0.013).words()
        '0.26 +- 0.013'
        >>> friction.changed(uncertainty_95=0.056).words()
        '0.26 +- 0.056 (95 %)'
        """
        if self.uncertainty_95 is not None:
            return f"{self.value:g} +- {self.uncertainty_95:.2g} (95 %)"
        spread = "" if self.uncertainty is None else f" +- {self.uncertainty:.2g}"
        return f"{self.value:g}{spread}"


POSITIVE = Interval(ge=SMALLEST, le=1e9)
NOT_NEGATIVE = Interval(ge=0, le=1e9)
LENGTH = Interval(ge=SMALLEST, le=1e5)
BREADTH = Interval(ge=0, le=1e3)
FRICTION = Interval(ge=0, le=10)


def quantities(table: Table) -> dict[str, Quantity]:
    """Return the numbers with a standing that a table holds, by key."""
    return {name: value for name, value in table if isinstance(value, Quantity)}
