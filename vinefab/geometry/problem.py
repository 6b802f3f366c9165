"""What stands in the way of an exact outline."""

from dataclasses import dataclass
from enum import StrEnum


class ProblemKind(StrEnum):
    """The ways in which a design has no exact outline."""

    CHILD_WIDTH = "child_width"
    """A child is not narrower than its parent."""

    NARROW_CROTCH = "narrow_crotch"
    """Two neighbours at a joint part only beyond half the shorter of them."""

    NO_ROOM = "no_room"
    """Fillets, joints or a pouch at the two ends of a branch overlap along its side."""

    POUCH_WIDTH = "pouch_width"
    """A pouch is not wider than its branch."""

    VANISHED = "vanished"
    """An inward offset leaves nothing of a branch."""

    COLLAR = "collar"
    """A collar takes the whole tail."""

    COLLAR_FLARE = "collar_flare"
    """A collar goes over into the tail too suddenly."""

    SHORT_SEGMENT = "short_segment"
    """A line or arc would be too short to draw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineProblem:
    """One reason why an outline is not exact.

    Parameters
    ----------
    kind
        What is wrong.
    branches
        Ids of the branches concerned, at the first place where it happens.
    x_mm, y_mm
        That place in the flat layout.
    count
        At how many places it happens: all joints of a level are alike.
    measured_mm, limit_mm
        The length found and the length allowed.
    words
        One sentence that says what is wrong and what would mend it.
    """

    kind: ProblemKind
    branches: tuple[str, ...]
    x_mm: float
    y_mm: float
    count: int = 1
    measured_mm: float
    limit_mm: float
    words: str
