"""How a rig is printed: its beds, and what each takes."""

from dataclasses import dataclass

from vinefab.rig.beds import Placed, beds_of
from vinefab.rig.estimate import Estimate, estimate, together
from vinefab.rig.part import Rig, RigPart


@dataclass(frozen=True, slots=True, kw_only=True)
class Bed:
    """Parts that are printed together.

    Parameters
    ----------
    number
        From 1.
    places
        Parts, by their index in ``Rig.printed``, and where they lie.
    estimate
        What the bed takes.
    """

    number: int
    places: tuple[Placed, ...]
    estimate: Estimate

    @property
    def name(self) -> str:
        """Name of its files, without suffix."""
        return f"bed_{self.number:02d}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Printing:
    """All beds of a rig.

    Parameters
    ----------
    beds
        In the order of the parts.
    """

    beds: tuple[Bed, ...]

    @property
    def total(self) -> Estimate:
        """What all beds take."""
        return together([bed.estimate for bed in self.beds])

    def bed_of(self, index: int) -> Bed:
        """Return the bed of a part, by its index in ``Rig.printed``."""
        return next(bed for bed in self.beds if any(at.index == index for at in bed.places))


def printing_of(rig: Rig) -> Printing:
    """Return the beds on which a rig is printed."""
    parts = rig.printed
    beds = beds_of(parts, rig.printer, rig.options)
    return Printing(
        beds=tuple(
            Bed(
                number=number,
                places=places,
                estimate=estimate(_on(places, parts), rig.printer),
            )
            for number, places in enumerate(beds, 1)
        )
    )


def _on(places: tuple[Placed, ...], parts: tuple[RigPart, ...]) -> list[RigPart]:
    return [parts[at.index] for at in places]
