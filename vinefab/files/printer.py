"""Printer profiles in: TOML to `Printer`."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from vinefab.core.errors import located
from vinefab.files.profile_forms import QuantityForm
from vinefab.files.shipped import locate
from vinefab.files.toml import Form, check, read_toml
from vinefab.model.printer import Printer


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

    Parameters
    ----------
    name_or_path
        A path, or the name of a shipped profile (``generic_220``).

    Raises
    ------
    UnreadableFileError, UnknownNameError
        If there is no such file, or it is not TOML.
    BadInputError
        If a key is unknown or missing, or a value cannot be used.
    """
    path = locate("printer", name_or_path)
    form = check(PrinterForm, read_toml(path), path)
    with located(path):
        values = ((name, getattr(form, name)) for name in PrinterForm.model_fields)
        given = {name: held.value for name, held in values if isinstance(held, QuantityForm)}
        return Printer(name=path.stem, **given)
