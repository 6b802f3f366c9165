"""The size of a sleeve joint: the plug of one piece in the socket of another."""

from dataclasses import dataclass

from vinefab.fabrication.job.passes import WEB_MM, in_one_pass
from vinefab.fabrication.outline.body_outline import PieceEnds
from vinefab.fabrication.outline.ends import OpenEnd
from vinefab.model.design import Build, PieceSettings
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.pieces import Partition, Piece, Sleeve

STRAIGHT_BEFORE_MM = 3.0
"""Straight stub between its last fillet and the sleeve (assumed)."""

STRAIGHT_AFTER_MM = 5.0
"""Straight branch between the sleeve and the branch's own end (assumed)."""

BESIDE_MM = 1.0
"""Film left on each side between the cuts of two sockets whose stubs share a joint (assumed)."""

BLEND_RATIO = 4.0
"""Length of the blend over how far the socket's edge lies outside the branch's (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SleeveSize:
    """What all sleeves of a robot share."""

    lap_mm: float  # that socket and plug lie on each other, along the branch
    rise_mm: float  # how far a socket's lumen edge lies outside an even branch's, on each side
    socket_on_stub: bool  # whether outer pieces go into stubs, not over them

    @property
    def blend_mm(self) -> float:
        """Length along the branch from the socket's width to the branch's own."""
        return BLEND_RATIO * self.rise_mm

    @property
    def room_mm(self) -> float:
        """Straight side of a branch that a sleeve takes."""
        return STRAIGHT_BEFORE_MM + self.lap_mm + self.blend_mm + STRAIGHT_AFTER_MM


def sleeve_size(build: Build, profile: LaserProfile, *, separate: bool = False) -> SleeveSize:
    """Return the size of a robot's sleeves.

    A plug is wider than its lumen by the film outside it: the seam on both sides, and the web where
    seam and cut are made apart. A socket is wider by as much and the ease.

    While a robot grows, film that is still inside runs away from the base on the inner faces: there
    the rim of a stub trails, that of an outer part would catch. So deployed, the outer part lies
    outside. Mounted as cut, every face turns: as cut the outer part lies inside the stub.

    Parameters
    ----------
    separate
        Whether the robot is welded and cut in two passes although the recipe has one for both.
    """
    if in_one_pass(profile) and not separate:
        film_mm = profile.settings(Operation.WELDCUT).seam_width_mm.value
    else:
        film_mm = profile.settings(Operation.WELD).seam_width_mm.value + WEB_MM
    settings = build.pieces or PieceSettings()
    return SleeveSize(
        lap_mm=settings.lap_mm,
        rise_mm=film_mm + settings.ease_mm / 2.0,
        socket_on_stub=build.mounting == "tail_inverted",
    )


def piece_ends(partition: Partition, piece: Piece) -> PieceEnds:
    """Return where the outline of a piece begins and ends."""
    return PieceEnds(
        root=piece.root,
        base=outer_end(partition.sleeve(piece.root)) if piece.root else None,
        stubs={row: stub_end(partition.sleeve(row)) for row in piece.stubs},
    )


def outer_end(sleeve: Sleeve) -> OpenEnd:
    """Return the base of a sleeve's outer piece."""
    return OpenEnd(rim_mm=sleeve.plug_mm) if sleeve.socket_on_stub else _socket(sleeve)


def stub_end(sleeve: Sleeve) -> OpenEnd:
    """Return the end of a sleeve's stub."""
    return _socket(sleeve) if sleeve.socket_on_stub else OpenEnd(rim_mm=sleeve.plug_mm)


def _socket(sleeve: Sleeve) -> OpenEnd:
    return OpenEnd(
        rim_mm=sleeve.socket_mm,
        blend_mm=(sleeve.plug_mm, sleeve.blend_end_mm),
        rise_mm=sleeve.rise_mm,
    )
