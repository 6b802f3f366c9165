"""What photos of grown robots measured of contacts: numbers with intervals, read by predictions."""

from dataclasses import dataclass, fields
from typing import Literal

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import number, whole

Side = Literal["both", "upper", "lower"]
"""Whether an interval has both ends, or the photos gave only an upper or only a lower bound."""

MOST_COUNTED = 10**6


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredNumber:
    """A number with its 95 % interval and what it was measured from; its unit is in its name."""

    low: float  # least value that the photos allow
    high: float  # greatest value that they allow
    value: float | None = None  # the estimate; None where there is only a bound
    side: Side = "both"
    count: int  # what it comes from: contacts, or photos where it is a number of whole photos
    photos: int
    source: str  # photos and counts, in words

    def __post_init__(self) -> None:
        number("low", self.low, -1e6, 1e6)
        number("high", self.high, self.low, 1e6)
        whole("count", self.count, 1, MOST_COUNTED)
        whole("photos", self.photos, 1, MOST_COUNTED)
        if self.side not in ("both", "upper", "lower"):
            raise BadInputError("side", self.side, "'both', 'upper' or 'lower'")
        if (self.value is None) != (self.side != "both"):
            allowed = "given with side = 'both', and left out with a bound"
            raise BadInputError("value", self.value, allowed)
        if self.value is not None:
            number("value", self.value, self.low, self.high)

    @property
    def content(self) -> dict[str, object]:
        """The number as files have it."""
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        return {**{n: v for n, v in given.items() if v is not None}, "standing": "measured"}

    def text(self, unit: str = "") -> str:
        """Return where it comes from: ``12 contacts on 4 photos, 95 % interval 3 to 7 deg``."""
        ends = {
            "both": f"95 % interval {self.low:g} to {self.high:g}",
            "upper": f"at most {self.high:g}",
            "lower": f"at least {self.low:g}",
        }[self.side]
        return f"{self.counted}, {ends}{f' {unit}' if unit else ''}"

    @property
    def counted(self) -> str:
        """How much it was measured from: ``12 contacts on 4 photos``."""
        photos = counted(self.photos, "photo")
        return f"{counted(self.count, 'contact')} on {photos}"


_RANGES = {
    "head_on_half_angle_deg": (0.0, 90.0),
    "tip_friction": (0.0, 1e6),
    "body_width_ratio": (0.5, 2.0),
    "film_breadth_ratio": (0.1, 10.0),
}
"""Least and greatest value of each number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredContacts:
    """What several photos together say of contacts; a number that they do not give is None."""

    # a tip that meets a wall with its heading within this angle of the wall's normal stops
    head_on_half_angle_deg: MeasuredNumber | None = None
    # tangent of the half-angle: the friction of an everting tip on a wall, not of a body that is
    # pulled around an obstacle (the friction of anchoring)
    tip_friction: MeasuredNumber | None = None
    # how far centre lines stay from walls where bodies touch them, against lay-flat width / pi
    body_width_ratio: MeasuredNumber | None = None
    # breadth of the film as seen from above, against 2 lay-flat width / pi
    film_breadth_ratio: MeasuredNumber | None = None

    def __post_init__(self) -> None:
        for name, (least, most) in _RANGES.items():
            found: MeasuredNumber | None = getattr(self, name)
            if found is not None:
                number(f"{name}.low", found.low, least, most)
                number(f"{name}.high", found.high, least, most)
        if not self.content:
            raise BadInputError("contacts", "no number", f"one of {', '.join(_RANGES)}")

    @property
    def content(self) -> dict[str, object]:
        """The numbers by name, as files and records have them."""
        found = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: one.content for name, one in found.items() if one is not None}
