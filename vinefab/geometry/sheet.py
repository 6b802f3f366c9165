"""What a sheet is to hold, and how."""

from dataclasses import dataclass

from vinefab.core.errors import BadInputError
from vinefab.model.checked import whole
from vinefab.model.design import Design

PROCESSES = ("auto", "weldcut", "weld+cut")


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetOptions:
    """What a sheet is to hold, beside the design itself.

    Parameters
    ----------
    copies
        How many of the design.
    beside
        Further designs, one of each.
    process
        ``weldcut`` seals and cuts in one pass, ``weld+cut`` does it apart; ``auto`` takes what the
        recipe has, one pass if it has both.
    pass_through
        Whether the film may be fed through the machine along the bed's width, and may be longer
        than the bed.
    """

    copies: int = 1
    beside: tuple[Design, ...] = ()
    process: str = "auto"
    pass_through: bool = False

    def __post_init__(self) -> None:
        whole("copies", self.copies, 1, 200)
        if self.process not in PROCESSES:
            raise BadInputError("process", self.process, " or ".join(PROCESSES))


ONE = SheetOptions()
"""One robot, as the recipe makes it."""
