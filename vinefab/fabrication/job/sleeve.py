"""The size of a sleeve joint: the socket of one piece over the plug of another."""

from dataclasses import dataclass

from vinefab.fabrication.job.passes import WEB_MM, in_one_pass
from vinefab.fabrication.outline.body_outline import PieceEnds
from vinefab.fabrication.outline.ends import Socket
from vinefab.model.design import PieceSettings
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.pieces import Partition, Piece

STRAIGHT_BEFORE_MM = 3.0
"""Straight stub between its last fillet and the socket's rim (assumed)."""

STRAIGHT_AFTER_MM = 5.0
"""Straight branch between the socket's blend and the branch's own end (assumed)."""

BLEND_RATIO = 4.0
"""Length of the blend over how far the socket's edge lies outside the branch's (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SleeveSize:
    """What all sleeves of a robot share."""

    lap_mm: float  # socket over plug, along the branch
    rise_mm: float  # how far the socket's lumen edge lies outside the branch's, on each side

    @property
    def blend_mm(self) -> float:
        """Length along the branch from the socket's width to the branch's own."""
        return BLEND_RATIO * self.rise_mm

    @property
    def room_mm(self) -> float:
        """Straight side of a branch that a sleeve takes."""
        return STRAIGHT_BEFORE_MM + self.lap_mm + self.blend_mm + STRAIGHT_AFTER_MM


def sleeve_size(
    settings: PieceSettings, profile: LaserProfile, *, separate: bool = False
) -> SleeveSize:
    """Return the size of a robot's sleeves.

    A plug is wider than its lumen by the film outside it: the seam on both sides, and the web where
    seam and cut are made apart. A socket is wider by as much and the ease.

    Parameters
    ----------
    separate
        Whether the robot is welded and cut in two passes although the recipe has one for both.
    """
    if in_one_pass(profile) and not separate:
        film_mm = profile.settings(Operation.WELDCUT).seam_width_mm.value
    else:
        film_mm = profile.settings(Operation.WELD).seam_width_mm.value + WEB_MM
    return SleeveSize(lap_mm=settings.lap_mm, rise_mm=film_mm + settings.ease_mm / 2.0)


def piece_ends(partition: Partition, piece: Piece, size: SleeveSize) -> PieceEnds:
    """Return where the outline of a piece begins and ends."""
    socket = None
    if piece.root:
        sleeve = partition.sleeve(piece.root)
        socket = Socket(
            start_mm=sleeve.socket_mm,
            blend_start_mm=sleeve.plug_mm,
            blend_end_mm=sleeve.blend_end_mm,
            rise_mm=size.rise_mm,
        )
    plugs = {row: partition.sleeve(row).plug_mm for row in piece.stubs}
    return PieceEnds(root=piece.root, socket=socket, plugs=plugs)
