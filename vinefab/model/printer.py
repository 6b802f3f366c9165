"""The 3-D printer that prints a test rig."""

from dataclasses import dataclass

from vinefab.model.checked import positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Printer:
    """A printer's limits.

    Parameters
    ----------
    name
        File name of its profile.
    bed_width_mm, bed_depth_mm, height_mm
        Build volume.
    nozzle_mm, least_wall_mm, clearance_mm
        Nozzle diameter, thinnest wall that prints, gap between parts that fit together.
    """

    name: str
    bed_width_mm: float
    bed_depth_mm: float
    height_mm: float
    nozzle_mm: float = 0.4
    least_wall_mm: float = 0.8
    clearance_mm: float = 0.2

    def __post_init__(self) -> None:
        for name in ("bed_width_mm", "bed_depth_mm", "height_mm", "nozzle_mm"):
            positive(f"printer.{name}", getattr(self, name), 10_000.0)
        for name in ("least_wall_mm", "clearance_mm"):
            positive(f"printer.{name}", getattr(self, name), 100.0)
