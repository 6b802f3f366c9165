"""What a user may choose about a rig."""

from dataclasses import dataclass

from vinefab.model.checked import number, positive, whole

GRID_MM = 1e-3
"""Plans are snapped to this grid: far below what a printer can do, far above what single
precision (STL) resolves at the size of a bed, so that no two corners melt into one in the file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigOptions:
    """Sizes of a rig, as printed.

    Parameters
    ----------
    plate_mm
        Thickness of the base plate.
    height_mm
        Height of obstacles and border above the plate.
    border_mm
        Thickness of the wall around the bounds; it stands outside the free space.
    entry_width_mm
        Width of the opening for the robot's base; the start's sideways spread comes on top.
        0: no opening.
    entry_reach_mm
        A start at most this far from the bounds, measured backwards along its heading, gets an
        opening in the border; one further away gets a round hole through the plate.
    scale
        Rig millimetres per map millimetre.
    bed_margin_mm
        Rim of the printer's bed that stays free.
    sliver_mm
        Free-standing pieces of obstacle and enclosed gaps thinner than this everywhere are left
        out, and counted.
    most_parts
        A rig that needs more parts is refused.

    Raises
    ------
    BadInputError
        If a value is out of range.
    """

    plate_mm: float = 3.0
    height_mm: float = 30.0
    border_mm: float = 4.0
    entry_width_mm: float = 40.0
    entry_reach_mm: float = 60.0
    scale: float = 1.0
    bed_margin_mm: float = 5.0
    sliver_mm: float = 0.05
    most_parts: int = 100

    def __post_init__(self) -> None:
        number("rig.plate_mm", self.plate_mm, 0.2, 100.0, "mm")
        number("rig.height_mm", self.height_mm, 0.2, 10_000.0, "mm")
        number("rig.border_mm", self.border_mm, 0.2, 1000.0, "mm")
        number("rig.entry_width_mm", self.entry_width_mm, 0.0, 10_000.0, "mm")
        number("rig.entry_reach_mm", self.entry_reach_mm, 0.0, 10_000.0, "mm")
        positive("rig.scale", self.scale, 1e3, "rig mm per map mm")
        number("rig.bed_margin_mm", self.bed_margin_mm, 0.0, 1000.0, "mm")
        number("rig.sliver_mm", self.sliver_mm, 0.0, 1.0, "mm")
        whole("rig.most_parts", self.most_parts, 1, 100_000)
