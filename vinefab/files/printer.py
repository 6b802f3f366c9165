"""Printer profiles in: TOML to `Printer`."""

from pathlib import Path
from typing import Literal

from pydantic import Field

from vinefab.core.errors import BadInputError
from vinefab.files.shipped import locate
from vinefab.files.toml import Form, check, read_toml
from vinefab.model.laser import Standing
from vinefab.model.printer import Printer


class _Number(Form):
    """A number of a profile with where it comes from; its unit is in its key."""

    value: float
    standing: Standing = Field(strict=False)
    source: str


class _PrinterFile(Form):
    """The printer file as it stands."""

    # The key is `schema`; the attribute is not, because pydantic's base class has one.
    schema_: Literal["vinefab/printer-1"] = Field(alias="schema")
    title: str
    bed_width_mm: _Number
    bed_depth_mm: _Number
    height_mm: _Number
    nozzle_mm: _Number
    least_wall_mm: _Number
    clearance_mm: _Number


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
    form = check(_PrinterFile, read_toml(path), path)
    try:
        return Printer(
            name=path.stem,
            bed_width_mm=form.bed_width_mm.value,
            bed_depth_mm=form.bed_depth_mm.value,
            height_mm=form.height_mm.value,
            nozzle_mm=form.nozzle_mm.value,
            least_wall_mm=form.least_wall_mm.value,
            clearance_mm=form.clearance_mm.value,
        )
    except BadInputError as error:
        raise error.at(path) from error
