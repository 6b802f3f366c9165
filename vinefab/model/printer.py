"""The 3-D printer that prints a test rig."""

from dataclasses import dataclass

from vinefab.model.checked import number, positive


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
    layer_mm, shell_mm, infill
        How solids are sliced: height of a layer, thickness of the skin, share of the inside that
        is filled; for estimates only.
    flow_mm3_s, layer_change_s
        How fast plastic is laid down on average, and what each layer takes besides.
    filament_mm, density_g_cm3
        Diameter and density of the filament.
    """

    name: str
    bed_width_mm: float
    bed_depth_mm: float
    height_mm: float
    nozzle_mm: float = 0.4
    least_wall_mm: float = 0.8
    clearance_mm: float = 0.2
    layer_mm: float = 0.2
    shell_mm: float = 0.8
    infill: float = 0.15
    flow_mm3_s: float = 6.0
    layer_change_s: float = 4.0
    filament_mm: float = 1.75
    density_g_cm3: float = 1.24

    def __post_init__(self) -> None:
        for name in ("bed_width_mm", "bed_depth_mm", "height_mm", "nozzle_mm"):
            positive(f"printer.{name}", getattr(self, name), 10_000.0)
        for name in ("least_wall_mm", "clearance_mm", "layer_mm", "shell_mm", "filament_mm"):
            positive(f"printer.{name}", getattr(self, name), 100.0)
        number("printer.infill", self.infill, 0.0, 1.0)
        positive("printer.flow_mm3_s", self.flow_mm3_s, 1000.0, "mm3/s")
        number("printer.layer_change_s", self.layer_change_s, 0.0, 3600.0, "s")
        positive("printer.density_g_cm3", self.density_g_cm3, 30.0, "g/cm3")
