"""3-D printers that print test rigs, and their profile files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import Field

from vinefab.core.errors import located
from vinefab.core.validation import number, positive
from vinefab.model.files.profile_toml import QuantityForm
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import Form, read_toml, validated


@dataclass(frozen=True, slots=True, kw_only=True)
class Printer:
    """A printer's limits."""

    name: str  # file name of its profile
    # bed_width_mm, bed_depth_mm, height_mm: build volume
    bed_width_mm: float
    bed_depth_mm: float
    height_mm: float
    # nozzle_mm, least_wall_mm, clearance_mm: nozzle diameter, thinnest wall that prints, gap
    # between parts that fit together
    nozzle_mm: float = 0.4
    least_wall_mm: float = 0.8
    clearance_mm: float = 0.2
    # layer_mm, shell_mm, infill: how solids are sliced: height of a layer, thickness of the skin,
    # share of the inside that is filled; for estimates only
    layer_mm: float = 0.2
    shell_mm: float = 0.8
    infill: float = 0.15
    # flow_mm3_s, layer_change_s: how fast plastic is laid down on average, and what each layer
    # takes besides
    flow_mm3_s: float = 6.0
    layer_change_s: float = 4.0
    # filament_mm, density_g_cm3: diameter and density of the filament
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


class PrinterForm(Form):
    """A file in ``laser_profiles/printers``; what is for estimates only may be left out."""

    schema_: Literal["vinefab/printer-1"] = Field(alias="schema")
    title: str
    bed_width_mm: QuantityForm
    bed_depth_mm: QuantityForm
    height_mm: QuantityForm
    nozzle_mm: QuantityForm
    least_wall_mm: QuantityForm
    clearance_mm: QuantityForm
    layer_mm: QuantityForm | None = None
    shell_mm: QuantityForm | None = None
    infill: QuantityForm | None = None
    flow_mm3_s: QuantityForm | None = None
    layer_change_s: QuantityForm | None = None
    filament_mm: QuantityForm | None = None
    density_g_cm3: QuantityForm | None = None


def read_printer(name_or_path: str | Path) -> Printer:
    """Read a printer's profile.

    Every number in the file is a table of ``value``, ``standing`` (measured, paper, published,
    computed or assumed) and ``source``, so that nobody mistakes a guess for a measurement.
    """
    path = locate("printer", name_or_path)
    form = validated(PrinterForm, read_toml(path), path)
    with located(path):
        values = ((name, getattr(form, name)) for name in PrinterForm.model_fields)
        given = {name: held.value for name, held in values if isinstance(held, QuantityForm)}
        return Printer(name=path.stem, **given)
