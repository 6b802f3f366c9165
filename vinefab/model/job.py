"""Laser jobs: contours with an operation each, on one sheet."""

import reprlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from vinefab.core.codec import Record
from vinefab.core.frozen import FrozenMapping
from vinefab.core.plain_text import counted
from vinefab.core.validation import positive
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import OperationSettings
from vinefab.model.outline import Contour


class Operation(StrEnum):
    """What a path is for; the members stand in process order."""

    MARK = "mark"
    WELD = "weld"
    WELDCUT = "weldcut"
    CUT = "cut"
    REG = "reg"
    DOC = "doc"

    @property
    def layer(self) -> str:
        """Name of the layer in laser files."""
        return _LAYERS[self]

    @property
    def is_machined(self) -> bool:
        """Whether the laser runs it; ``reg`` and ``doc`` are for people."""
        return self not in (Operation.REG, Operation.DOC)


_LAYERS = {
    Operation.MARK: "VF_10_MARK",
    Operation.WELD: "VF_20_WELD",
    Operation.WELDCUT: "VF_30_WELDCUT",
    Operation.CUT: "VF_40_CUT",
    Operation.REG: "VF_90_REG",
    Operation.DOC: "VF_91_DOC",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserPath:
    """One contour with its operation.

    Parameters
    ----------
    operation
        What the laser does along it.
    contour
        Where the beam's centre goes: seam and kerf offsets are already applied.
    label
        Description for the operator (``outline of six_branch_anchor``).
    of
        Name of its design; empty for none.
    variant
        A short name of other settings; empty for those of the recipe. Paths of one
        operation and variant share a layer.
    settings
        Settings of the variant, if any.
    """

    operation: Operation
    contour: Contour
    label: str = ""
    of: str = ""
    variant: str = ""
    settings: OperationSettings | None = None

    def __repr__(self) -> str:
        return f"<LaserPath {self.operation} {reprlib.repr(self.label)}: {self.contour!r}>"

    def settings_in(self, profile: LaserProfile) -> OperationSettings:
        """Return the settings of the path: its own, or else the recipe's.

        Raises
        ------
        BadInputError
            If the path has none and the recipe lacks its operation.
        """
        return profile.settings(self.operation) if self.settings is None else self.settings


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetTransform(Record):
    """How a flat layout is put on its sheet: a rotation about the origin, then a shift."""

    rotation_deg: float  # counter-clockwise
    shift_x_mm: float
    shift_y_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedPiece(Record):
    """A piece of a robot, and where it lies.

    Parameters
    ----------
    label, copy
        The piece, and of which of the robots it is one.
    sheet
        Number of its sheet.
    root, branches, stubs
        Names of the branches: that at its mouth, those that it holds, those that are cut off.
    transform
        From the flat layout to the sheet.
    fits_bed
        Whether the sheet holds it.
    """

    label: str
    copy: int
    sheet: int
    root: str
    branches: tuple[str, ...]
    stubs: tuple[str, ...]
    transform: SheetTransform
    fits_bed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class PieceJoint(Record):
    """A sleeve between two pieces.

    Parameters
    ----------
    label, inner
        The outer and the inner piece.
    socket_on, plug_on
        Which piece has which end.
    branch
        The branch that is cut.
    lumen_width_mm, socket_wider_mm
        Width of the branch there, and by how much the socket is wider.
    socket_rim_mm, plug_rim_mm, blend_to_mm
        Where the rims lie and where the wider part ends, along the branch.
    """

    label: str
    inner: str
    socket_on: str
    plug_on: str
    branch: str
    lumen_width_mm: float
    socket_wider_mm: float
    socket_rim_mm: float
    plug_rim_mm: float
    blend_to_mm: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """All paths of one sheet, in the order in which they are run.

    Coordinates have +x right and +y up from the sheet's lower left corner.

    Parameters
    ----------
    name
        Name of the design or coupon.
    sheet_width_mm, sheet_height_mm
        Size of the sheet.
    paths
        In process order: mark, weld, weldcut, cut; then what is not machined.
    facts
        Facts recorded with the paths: offsets applied, recipe, rotation; plain values.
    transform
        From the flat layout to the sheet, of a single robot in one piece.
    pieces, joints
        Of a robot in pieces.
    tiles
        For a sheet larger than the machine's bed: the jobs to run instead, one after the other on
        the same film.
    sheets
        For a robot in pieces: the jobs to run instead, each on its film; the job itself
        shows them side by side.
    """

    name: str
    sheet_width_mm: float
    sheet_height_mm: float
    paths: tuple[LaserPath, ...]
    facts: Mapping[str, object] = field(default_factory=dict)
    transform: SheetTransform | None = None
    pieces: tuple[PlacedPiece, ...] = ()
    joints: tuple[PieceJoint, ...] = ()
    tiles: "tuple[Job, ...]" = ()
    sheets: "tuple[Job, ...]" = ()

    def __post_init__(self) -> None:
        positive("sheet_width_mm", self.sheet_width_mm)
        positive("sheet_height_mm", self.sheet_height_mm)
        object.__setattr__(self, "facts", FrozenMapping(self.facts))

    def __repr__(self) -> str:
        counts = Counter(path.operation for path in self.paths)
        paths = ", ".join(f"{count} {operation}" for operation, count in counts.items())
        tiles = f", {counted(len(self.tiles), 'tile')}" if self.tiles else ""
        tiles += f", {counted(len(self.sheets), 'sheet')}" if self.sheets else ""
        return (
            f"<Job {reprlib.repr(self.name)}: {self.sheet_width_mm:.5g} x "
            f"{self.sheet_height_mm:.5g} mm sheet, paths: {paths or 'none'}{tiles}>"
        )

    @property
    def runs(self) -> "tuple[Job, ...]":
        """The jobs that the machine runs, one after the other: tiles, sheets, or the job itself."""
        return self.tiles or self.sheets or (self,)

    def labels_on(self, sheet: int) -> list[str]:
        """Return the labels of the pieces on one of the sheets, whose numbers begin at 1."""
        return [piece.label for piece in self.pieces if piece.sheet == sheet]

    @property
    def parts(self) -> dict[str, list[dict[str, Any]]]:
        """Pieces and joints as JSON has them; empty for a robot in one piece."""
        if not self.sheets:
            return {}
        named = {"pieces": self.pieces, "joints": self.joints}
        return {name: [part.content for part in parts] for name, parts in named.items()}

    def along(self, operation: Operation) -> tuple[LaserPath, ...]:
        """Return the paths of one operation, in order."""
        return tuple(path for path in self.paths if path.operation is operation)

    def length_mm(self, operation: Operation) -> float:
        """Return the total length of one operation's paths."""
        return sum(path.contour.length_mm for path in self.along(operation))
