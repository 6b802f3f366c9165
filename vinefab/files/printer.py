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
    """A file in ``laser_profiles/printers``."""

    schema_: Literal["vinefab/printer-1"] = Field(alias="schema")
    title: str
    bed_width_mm: QuantityForm
    bed_depth_mm: QuantityForm
    height_mm: QuantityForm
    nozzle_mm: QuantityForm
    least_wall_mm: QuantityForm
    clearance_mm: QuantityForm


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
        return Printer(
            name=path.stem,
            bed_width_mm=form.bed_width_mm.value,
            bed_depth_mm=form.bed_depth_mm.value,
            height_mm=form.height_mm.value,
            nozzle_mm=form.nozzle_mm.value,
            least_wall_mm=form.least_wall_mm.value,
            clearance_mm=form.clearance_mm.value,
        )
