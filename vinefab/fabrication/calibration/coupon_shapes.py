"""Coupons: test pieces that tell kerf, seam, widths, burst pressure and which fillets hold.

Every piece that is inflated is a small robot: a design, drawn by the walk that draws robots, with
the recipe's offsets. What is measured on it is labelled beside it.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.validation import Floats
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.marks import lettered
from vinefab.model.design import Build, Design, Level, Pouch
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour

LADDER_MM = (5.0, 8.0, 10.0, 16.0, 20.0, 30.0, 40.0)
FILLETS_MM = (2.0, 4.0, 8.0)
BALLOON_MM = (60.0, 20.0)
BALLOONS = 3
SQUARE_MM = 50.0
STRIP_MM = (80.0, 25.0)
STRIPS = 2
PORT_MM = 6.0
LETTER_MM = 4.0
LABEL_GAP_MM = 5.0
_LADDER_LENGTH_MM, _LADDER_TAIL_MM = 40.0, 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coupon:
    """One coupon."""

    name: str  # what is written beside it
    paths: tuple[LaserPath, ...]  # its paths, label included, in process order
    design: Design | None = None  # the robot that it is, or None for a piece that is no robot

    @property
    def box_mm(self) -> tuple[float, float, float, float]:
        """Least x, least y, greatest x, greatest y of all paths."""
        boxes = np.array([path.contour.box_mm for path in self.paths])
        low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def shifted(self, dx_mm: float, dy_mm: float) -> "Coupon":
        """Return the piece elsewhere."""
        paths = tuple(
            replace(path, contour=path.contour.moved(0.0, dx_mm, dy_mm)) for path in self.paths
        )
        return replace(self, paths=paths)


def coupon_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return every coupon for a recipe but the energy matrix, each at a place of its own."""
    robots = [*balloon_designs(), *crotch_designs(), *ladder_designs()]
    return (
        *(robot_piece(design, profile) for design in robots),
        *square_pieces(profile),
        *strip_pieces(profile),
    )


def balloon_designs() -> tuple[Design, ...]:
    """Return the burst balloons: a pouch of 20 x 60 mm with a narrow port for a needle."""
    length, width = BALLOON_MM
    pouch = Pouch(shape="rectangle", length_mm=length, width_mm=width)
    build = Build(widths_mm=(PORT_MM,), fillet_mm=(), tail_mm=20.0, pouch=pouch)
    # The pouch is centred on the end of the branch: 5 mm of port stand between it and the base.
    return tuple(
        Design(name=f"BURST-{number}", trunk_length_mm=length / 2 + 5.0, build=build)
        for number in range(1, BALLOONS + 1)
    )


def ladder_designs() -> tuple[Design, ...]:
    """Return the width ladder: plain fingers from 5 to 40 mm."""
    return tuple(
        Design(
            name=f"W{width:g}",
            trunk_length_mm=_LADDER_LENGTH_MM,
            build=Build(widths_mm=(width,), fillet_mm=(), tail_mm=_LADDER_TAIL_MM),
        )
        for width in LADDER_MM
    )


def crotch_designs() -> tuple[Design, ...]:
    """Return the crotch coupons: a trunk with two branches, each with another fillet."""
    fork = Level(branches=2, length_mm=50.0, fan_rad=math.radians(60.0))
    return tuple(
        Design(
            name=f"CROTCH-R{radius:g}",
            trunk_length_mm=30.0,
            levels=(fork,),
            build=Build(widths_mm=(20.0, 12.0), fillet_mm=(radius,), tail_mm=10.0),
        )
        for radius in FILLETS_MM
    )


def robot_piece(design: Design, profile: LaserProfile) -> Coupon:
    """Return a design as a coupon: what the laser does for a robot, and its name below it."""
    kept = (Operation.WELD, Operation.WELDCUT, Operation.CUT)
    job = laser_job(design, profile)
    paths = tuple(path for path in job.paths if path.operation in kept)
    return _labelled(Coupon(name=design.name, paths=paths, design=design), profile)


def square_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return a 50 mm square for every operation that cuts; the beam runs on the square itself."""
    pieces = []
    for operation in (Operation.WELDCUT, Operation.CUT):
        if operation not in profile.recipe.operations:
            continue
        over = profile.settings(operation).overcut_mm.value
        half, side = SQUARE_MM / 2, SQUARE_MM
        corners = [(half, 0.0), (side, 0.0), (side, side), (0.0, side), (0.0, 0.0)]
        # It starts in the middle of a side and runs on past its start.
        points = np.array([*corners, (half + over, 0.0)])
        name = f"KERF-{operation}"
        path = LaserPath(
            operation=operation, contour=Contour.polyline(points, closed=False), label=name
        )
        pieces.append(_labelled(Coupon(name=name, paths=(path,)), profile))
    return tuple(pieces)


def strip_pieces(profile: LaserProfile) -> tuple[Coupon, ...]:
    """Return the peel strips: two plies joined by one seam at an end, cut apart elsewhere.

    Without an operation that cuts and seals at once there are none.
    """
    if Operation.WELDCUT not in profile.recipe.operations:
        return ()
    length, width = STRIP_MM
    over = profile.settings(Operation.WELDCUT).overcut_mm.value
    half = profile.settings(Operation.CUT).kerf_mm.value / 2
    seam = np.array([(0.0, -half - over), (0.0, width + half + over)])
    # The sides end on the seam; the beam of the cut stays half a kerf outside the strip.
    sides = np.array([(0.0, -half), (length, -half), (length, width + half), (0.0, width + half)])
    pieces = []
    for number in range(1, STRIPS + 1):
        name = f"PEEL-{number}"
        paths = (
            _line(Operation.WELDCUT, seam, f"seam of {name}"),
            _line(Operation.CUT, sides, f"sides of {name}"),
        )
        pieces.append(_labelled(Coupon(name=name, paths=paths), profile))
    return tuple(pieces)


def _line(operation: Operation, points: Floats, label: str) -> LaserPath:
    contour = Contour.polyline(points, closed=False)
    return LaserPath(operation=operation, contour=contour, label=label)


def marks(text: str, corner_mm: tuple[float, float], profile: LaserProfile) -> list[LaserPath]:
    """Return a line of text as marks; none where the recipe cannot mark."""
    if Operation.MARK not in profile.recipe.operations:
        return []
    strokes = lettered(text, corner_mm, LETTER_MM)
    return [LaserPath(operation=Operation.MARK, contour=s, label=f"text {text}") for s in strokes]


def _labelled(piece: Coupon, profile: LaserProfile) -> Coupon:
    x0, y0, _, _ = piece.box_mm
    label = marks(piece.name, (x0, y0 - LABEL_GAP_MM - LETTER_MM), profile)
    return replace(piece, paths=(*label, *piece.paths))
