"""A folder that ``vinefab rig`` wrote, read again: what its files hold, part by part."""

import json
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vinefab.core.errors import UnreadableFileError
from vinefab.export.stl import read_stl, stl_problem
from vinefab.files.profile_forms import FileName
from vinefab.files.shipped import read_bytes, read_text
from vinefab.files.toml import check
from vinefab.model.rigfacts import PartFacts, RigFacts

RIG_NAME = "rig.json"

_VOLUME_SHARE = 1e-4
_BOX_MM = 1e-3

Size = Annotated[list[float], Field(min_length=3, max_length=3)]


class _Known(BaseModel):
    """Base of forms that take what they need and leave the rest."""

    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class PartForm(_Known):
    """An entry of ``parts`` or ``extras``."""

    name: str
    file: FileName
    volume_mm3: Annotated[float, Field(gt=0)]
    size_mm: Size


class PrinterForm(_Known):
    """The printer that the rig was made for."""

    name: str
    bed_width_mm: float
    bed_depth_mm: float
    height_mm: float


class OptionsForm(_Known):
    """The sizes of the rig."""

    height_mm: Annotated[float, Field(gt=0)]
    bed_margin_mm: float


class MapForm(_Known):
    """The map of the rig."""

    name: str


class RigForm(_Known):
    """``rig.json``, as far as the rules need it."""

    schema_: Literal["vinefab/rig-1"] = Field(alias="schema")
    style: Literal["plate", "board", "sheet"]
    map: MapForm
    printer: PrinterForm
    options: OptionsForm
    parts: list[PartForm]
    extras: list[PartForm]


def read_rig(folder: Path) -> RigFacts:
    """Return what is to be known of a rig from its folder, every STL file read.

    Parameters
    ----------
    folder
        The folder, or its ``rig.json``.

    Raises
    ------
    UnreadableFileError, BadInputError
        If there is no ``rig.json`` that can be read. A part whose file is missing or wrong is no
        error but a problem of that part.
    """
    path = folder if folder.name == RIG_NAME else folder / RIG_NAME
    try:
        data = json.loads(read_text(path))
    except (json.JSONDecodeError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {error}") from error
    if not isinstance(data, dict):
        raise UnreadableFileError(path, "is not the JSON of a rig")
    form = check(RigForm, data, path)
    margin_mm = 2.0 * form.options.bed_margin_mm
    printer, printed = form.printer, [*form.parts, *form.extras]
    solids = [part for part in printed if part.file.endswith(".stl")]
    layered = form.style == "sheet" and form.parts
    return RigFacts(
        name=form.map.name,
        printer=printer.name,
        room_mm=(
            printer.bed_width_mm - margin_mm,
            printer.bed_depth_mm - margin_mm,
            printer.height_mm,
        ),
        height_mm=max(part.size_mm[2] for part in form.parts)
        if layered
        else form.options.height_mm,
        parts=tuple(_facts(path.parent, part) for part in solids),
    )


def _facts(folder: Path, part: PartForm) -> PartFacts:
    wide_mm, deep_mm, high_mm = part.size_mm
    size_mm = wide_mm, deep_mm, high_mm
    try:
        data = read_bytes(folder / part.file)
    except UnreadableFileError as error:
        return PartFacts(name=part.name, size_mm=size_mm, problems=(error.problem,))
    problem = stl_problem(data)
    if problem:
        return PartFacts(name=part.name, size_mm=size_mm, problems=(problem,))
    mesh = read_stl(data)
    problems = mesh.form_problems()
    if abs(mesh.volume_mm3 - part.volume_mm3) > _VOLUME_SHARE * part.volume_mm3:
        problems.append(f"has a volume of {mesh.volume_mm3:.6g} mm3, not {part.volume_mm3:.6g}")
    span_mm = np.ptp(mesh.box_mm, axis=0)
    if np.abs(span_mm - size_mm).max() > _BOX_MM:
        problems.append(f"measures {span_mm.tolist()} mm, not {list(size_mm)}")
    wide_mm, deep_mm, high_mm = span_mm.tolist()
    return PartFacts(name=part.name, size_mm=(wide_mm, deep_mm, high_mm), problems=tuple(problems))
