"""A printed base for a holder: the tube that the tail goes over, a chamber behind it, and a lid.

Block and cap of `vinefab.rig.holder` clamp the tail onto the tube. Behind the dial the tube widens
into a chamber, which stores the film; a lid with a port for the air closes it. Body and lid are one
solid each. The body is printed standing on its rim, mouth up, and nothing needs supports: its
surfaces are upright or lean by at most 45 degrees, and only holes and seats are bridged.

Seats for cord (O-rings) are grooves, one around the tube in the middle of the clamp, one in the
chamber's rim; a few turns of tape fill them as well.

Lengths are millimetres in the holder's frame: x forward along the heading, y to the left, z up.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from manifold3d import Manifold
from shapely import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import UnfitInputError
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.rig.holder import CLAMP_MM, BaseHolder, flat_prism, solid_part
from vinefab.rig.part import Printer, RigPart
from vinefab.rig.rig_plan import polygon_parts

CORD_MM = 2.0
"""Thickness of the cord (O-ring) that the seats are made for."""

SEAT_DEEP_MM, SEAT_WIDE_MM = 0.75 * CORD_MM, 1.3 * CORD_MM
"""A seat squeezes its cord by a quarter, as is usual for seals that do not move (assumed)."""

FILM_MM = 0.1
"""Both plies of the robot's film, for the size of the chamber (assumed: 0.05 mm a ply)."""

PACKED_SHARE = 0.1
"""Share of the chamber that loosely stored film fills (assumed)."""

STORED_MM = 700.0
"""Length of tube that is stored where no design is known: that of the plain vine."""

_WALL_MM, _LEAST_WALL_MM = 5.0, 1.2  # around the chamber; under and next to a seat
_ROUND_MM, _CORNER_MM = 8.0, 2.0  # radius of the chamber's corners, inside and outside
_LEAST_BORE_MM, _LEAST_SIDE_MM, _LEAST_LONG_MM = 4.0, 24.0, 15.0
_PILOT_MM, _PILOT_DEEP_MM, _HOLE_MM = 2.5, 12.0, 3.4  # for M3 screws that cut their thread
_LID_MM, _BOSS_MM, _BOSS_WALL_MM = 4.0, 6.0, 3.0
_FREE_MM, _STEP_MM = 1.0, 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PrintedBase:
    """Body and lid of a base, where they stand in a holder."""

    tube_mm: float  # outer diameter
    bore_mm: float  # inner diameter
    chamber_mm: tuple[float, float, float]  # inside: along the tube, across it, high
    port_mm: float  # diameter
    ring_mm: float  # inner diameter of the O-ring on the tube, unstretched at most
    lid_cord_mm: float  # length of the cord in the rim
    seat_mm: float  # middle of the tube's seat, x
    neck_mm: float  # where the tube leaves the cone, x
    rear_mm: float  # where the rim is, x
    body: RigPart
    lid: RigPart
    outline: BaseGeometry  # from above, in the plan

    @property
    def parts(self) -> tuple[RigPart, ...]:
        """Body and lid."""
        return self.body, self.lid

    @property
    def screw_mm(self) -> float:
        """Least length of the lid's four M3 screws."""
        return _LID_MM + _PILOT_DEEP_MM

    @property
    def notes(self) -> tuple[str, ...]:
        """What the person who prints it should know."""
        long_mm, wide_mm, high_mm = self.chamber_mm
        return (
            f"printed base: the tail goes over its tube, {self.tube_mm:.4g} mm outside; an O-ring "
            f"of {CORD_MM:g} mm cord, at most {self.ring_mm:.1f} mm inside, or turns of tape fill "
            "the seat under the clamp",
            f"printed base: {self.lid_cord_mm:.0f} mm of {CORD_MM:g} mm cord or tape seal its lid; "
            f"four M3 screws, {self.screw_mm:.0f} mm long, cut their thread in holes of "
            f"{_PILOT_MM:g} mm",
            f"printed base: its port is {self.port_mm:g} mm wide (8.8 mm is tapped G 1/8, 4.2 mm "
            "M5); --port-mm changes it",
            f"printed base: its chamber, {long_mm:.0f} x {wide_mm:.0f} x {high_mm:.0f} mm, holds "
            f"film that fills {100 * PACKED_SHARE:.0f} % of it (assumed)",
            "printed base: not tried under pressure: print it dense, coat it inside, and test it "
            "in water behind a shield before a robot is on it",
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Sizes:
    """The sizes that body and lid share; cross-sections are (y, z)."""

    outer_mm: float  # radius of the tube
    bore_mm: float  # radius inside
    axis_mm: float
    inside: Polygon  # of the chamber
    outside: Polygon
    long_mm: float  # of the chamber
    cone_mm: float  # from the chamber to the tube
    neck_mm: float  # where the cone ends, x
    port_mm: float

    @property
    def rear_mm(self) -> float:
        """Where the rim is, x."""
        return self.neck_mm - self.cone_mm - self.long_mm

    @property
    def low_mm(self) -> Floats:
        """Lower right corner of the outside, by which a part lies at its origin as printed."""
        return np.array(self.outside.bounds[:2])

    @property
    def middle_mm(self) -> tuple[float, float]:
        """The middle of the chamber's cross-section."""
        x_min, y_min, x_max, y_max = self.inside.bounds
        return 0.5 * (x_min + x_max), 0.5 * (y_min + y_max)

    @property
    def seat(self) -> BaseGeometry:
        """The groove in the rim."""
        near = self.inside.buffer(_LEAST_WALL_MM, quad_segs=16)
        return near.buffer(SEAT_WIDE_MM, quad_segs=16).difference(near)

    def screws(self, diameter_mm: float) -> list[Polygon]:
        """Return the holes for the four screws, in the corners outside of the seat."""
        x_min, y_min, x_max, y_max = self.inside.bounds
        seat_mm = _LEAST_WALL_MM + SEAT_WIDE_MM
        away_mm = _ROUND_MM + seat_mm + _LEAST_WALL_MM + 0.5 * _PILOT_MM
        from_mm = _ROUND_MM - away_mm / math.sqrt(2.0)
        places = [
            Point(x, y)
            for x in (x_min + from_mm, x_max - from_mm)
            for y in (y_min + from_mm, y_max - from_mm)
        ]
        return [place.buffer(0.5 * diameter_mm, quad_segs=6) for place in places]


def printed_base(holder: BaseHolder, printer: Printer, design: Design | None) -> PrintedBase:
    """Return the base that a holder clamps.

    Raises
    ------
    UnfitInputError
        If its tube is too narrow for a bore, or it has no room behind the holder's dial.
    """
    sizes = _sizes_of(holder, printer, design)
    stand, seat_mm = holder.stand, -holder.reach_mm - 0.5 * CLAMP_MM
    half_mm = sizes.outside.bounds[2]
    around = shapely.union(
        box(sizes.rear_mm - _LID_MM - _BOSS_MM, -half_mm, sizes.neck_mm, half_mm),
        box(sizes.neck_mm, -sizes.outer_mm, 0.0, sizes.outer_mm),
    )
    y_min, z_min, y_max, z_max = sizes.inside.bounds
    return PrintedBase(
        tube_mm=2.0 * sizes.outer_mm,
        bore_mm=2.0 * sizes.bore_mm,
        chamber_mm=(sizes.long_mm, y_max - y_min, z_max - z_min),
        port_mm=sizes.port_mm,
        ring_mm=2.0 * (sizes.outer_mm - SEAT_DEEP_MM),
        lid_cord_mm=sizes.inside.buffer(_LEAST_WALL_MM + 0.5 * SEAT_WIDE_MM).length,
        seat_mm=seat_mm,
        neck_mm=sizes.neck_mm,
        rear_mm=sizes.rear_mm,
        body=_body_part(sizes, seat_mm, holder),
        lid=_lid_part(sizes, holder),
        outline=stand.on_plan(around),
    )


def stored_mm3(design: Design | None, tube_mm: float) -> float:
    """Return the volume of the film that a base stores, both plies."""
    if design is None:
        return FILM_MM * STORED_MM * 0.5 * math.pi * tube_mm
    tree = design.tree
    flat_mm2 = float((tree.length_mm * 0.5 * (tree.width_mm + tree.end_width_mm)).sum())
    return FILM_MM * flat_mm2


def _sizes_of(holder: BaseHolder, printer: Printer, design: Design | None) -> _Sizes:
    stand, outer_mm = holder.stand, 0.5 * holder.tube.diameter_mm
    lines = math.ceil((SEAT_DEEP_MM + _LEAST_WALL_MM) / printer.nozzle_mm - 1e-6)
    bore_mm = outer_mm - lines * printer.nozzle_mm
    if 2.0 * bore_mm < _LEAST_BORE_MM:
        problem = f"a tube of {2.0 * outer_mm:.4g} mm leaves no bore inside its walls"
        raise UnfitInputError("base", problem, "give a wider one with --collar-mm")
    port_mm, floor_mm = stand.options.port_mm, _WALL_MM
    volume_mm3 = stored_mm3(design, 2.0 * outer_mm) / PACKED_SHARE
    side_mm = max(
        _LEAST_SIDE_MM,
        volume_mm3 ** (1.0 / 3.0),
        stand.axis_mm + bore_mm - floor_mm,
        2.0 * bore_mm,
        port_mm + 2.0 * _BOSS_WALL_MM,
    )
    inside = _rounded(box(-0.5 * side_mm, floor_mm, 0.5 * side_mm, floor_mm + side_mm), _ROUND_MM)
    wide_mm = 0.5 * side_mm + _WALL_MM
    outside = _rounded(box(-wide_mm, 0.0, wide_mm, side_mm + 2.0 * _WALL_MM), _CORNER_MM)
    tubes = [_circle(radius_mm, stand.axis_mm) for radius_mm in (bore_mm, outer_mm)]
    cone_mm = max(_lean_mm(inside, tubes[0]), _lean_mm(outside, tubes[1]))
    long_mm = max(_LEAST_LONG_MM, volume_mm3 / inside.area)
    # Behind the dial at every heading.
    deep_mm = long_mm + cone_mm + _LID_MM + _BOSS_MM
    neck_mm, dial = -holder.reach_mm - CLAMP_MM - _FREE_MM, holder.dial.buffer(_FREE_MM)
    while stand.turned(box(neck_mm - deep_mm, -wide_mm, neck_mm, wide_mm)).intersects(dial):
        neck_mm -= _STEP_MM
    swept = stand.turned(box(neck_mm - deep_mm, -wide_mm, neck_mm, wide_mm))
    if swept.intersects(shapely.union(stand.plate, stand.taken)):
        problem = "rig or a corner marker lies where its chamber would be"
        raise UnfitInputError("base", problem, "give --markers none, or another --base-start")
    return _Sizes(
        outer_mm=outer_mm,
        bore_mm=bore_mm,
        axis_mm=stand.axis_mm,
        inside=inside,
        outside=outside,
        long_mm=long_mm,
        cone_mm=cone_mm,
        neck_mm=neck_mm,
        port_mm=port_mm,
    )


def _rounded(rectangle: Polygon, radius_mm: float) -> Polygon:
    return rectangle.buffer(-radius_mm, join_style="mitre").buffer(radius_mm, quad_segs=16)


def _circle(radius_mm: float, z_mm: float) -> Polygon:
    return Point(0.0, z_mm).buffer(radius_mm, quad_segs=24)


def _lean_mm(wide: Polygon, narrow: Polygon) -> float:
    """Return the height over which one convex outline becomes another at 45 degrees at most."""
    turns = np.radians(np.arange(0.0, 360.0, 1.0))
    ways = np.c_[np.cos(turns), np.sin(turns)]
    reach = [(shapely.get_coordinates(one) @ ways.T).max(axis=0) for one in (wide, narrow)]
    return float(np.abs(reach[0] - reach[1]).max())


Level = tuple[float, Polygon]
"""A height, as printed, and the convex cross-section there."""


def _lofted(levels: Sequence[Level], low_mm: Floats) -> tuple[Manifold, float]:
    """Return the solid between cross-sections, each the hull of two, and its volume.

    The volume is that of prismatoids: the area is quadratic in the height, so that Simpson's rule
    is exact; halfway it is the mean of two convex outlines in Minkowski's sense.
    """
    solid, volume_mm3 = Manifold(), 0.0
    for (below_mm, below), (above_mm, above) in pairwise(levels):
        rings = [shapely.get_coordinates(one)[:-1] - low_mm for one in (below, above)]
        heights = (below_mm, above_mm)
        corners = [
            np.c_[ring, np.full(len(ring), z)] for ring, z in zip(rings, heights, strict=True)
        ]
        solid += Manifold.hull_points(np.vstack(corners))
        halfway = shapely.MultiPoint(0.5 * (rings[0][:, None] + rings[1][None]).reshape(-1, 2))
        areas_mm2 = below.area + 4.0 * halfway.convex_hull.area + above.area
        volume_mm3 += areas_mm2 * (above_mm - below_mm) / 6.0
    return solid, volume_mm3


def _body_part(sizes: _Sizes, seat_mm: float, holder: BaseHolder) -> RigPart:
    """Return chamber, cone and tube as one solid, standing on its rim."""
    long_mm, neck_mm, top_mm = sizes.long_mm, sizes.long_mm + sizes.cone_mm, -sizes.rear_mm
    tube, bore, seat = (
        _circle(radius_mm, sizes.axis_mm)
        for radius_mm in (sizes.outer_mm, sizes.bore_mm, sizes.outer_mm - SEAT_DEEP_MM)
    )
    low_mm = sizes.low_mm
    from_mm = seat_mm - sizes.rear_mm - 0.5 * SEAT_WIDE_MM
    to_mm = from_mm + SEAT_WIDE_MM
    below, below_mm3 = _lofted(
        [(0.0, sizes.outside), (long_mm, sizes.outside), (neck_mm, tube), (from_mm, tube)], low_mm
    )
    # Its upper flank leans, so that it prints without supports.
    above, above_mm3 = _lofted(
        [(from_mm, seat), (to_mm, seat), (to_mm + SEAT_DEEP_MM, tube), (top_mm, tube)], low_mm
    )
    levels = [(0.0, sizes.inside), (long_mm, sizes.inside), (neck_mm, bore), (top_mm, bore)]
    _, empty_mm3 = _lofted(levels, low_mm)
    empty, _ = _lofted([(-1.0, sizes.inside), *levels[1:-1], (top_mm + 1.0, bore)], low_mm)
    pilots = sizes.screws(_PILOT_MM)
    rim = flat_prism(polygon_parts(sizes.seat), (-1.0, SEAT_DEEP_MM), low_mm)
    holes = flat_prism(polygon_parts(*pilots), (-1.0, _PILOT_DEEP_MM), low_mm)
    taken_mm3 = sizes.seat.area * SEAT_DEEP_MM + shapely.area(pilots).sum() * _PILOT_DEEP_MM
    to_frame = np.eye(4)[[2, 0, 1, 3]]
    to_frame[:3, 3] = sizes.rear_mm, *low_mm
    volume_mm3 = below_mm3 + above_mm3 - empty_mm3 - float(taken_mm3)
    body = below + above - empty - rim - holes
    return solid_part("base_body", body, to_frame, volume_mm3, holder.stand)


def _lid_part(sizes: _Sizes, holder: BaseHolder) -> RigPart:
    """Return the lid, its smooth inner face down; the port's boss rises from its outer one."""
    low_mm, holes = sizes.low_mm, sizes.screws(_HOLE_MM)
    middle = Point(*sizes.middle_mm)
    port = middle.buffer(0.5 * sizes.port_mm, quad_segs=16)
    boss = middle.buffer(0.5 * sizes.port_mm + _BOSS_WALL_MM, quad_segs=16)
    top_mm = _LID_MM + _BOSS_MM
    body = flat_prism(polygon_parts(sizes.outside), (0.0, _LID_MM), low_mm)
    body += flat_prism(polygon_parts(boss), (0.5 * _LID_MM, top_mm), low_mm)
    body -= flat_prism(polygon_parts(port, *holes), (-1.0, top_mm + 1.0), low_mm)
    flat_mm2 = sizes.outside.area - port.area - float(shapely.area(holes).sum())
    volume_mm3 = flat_mm2 * _LID_MM + (boss.area - port.area) * _BOSS_MM
    # Its outer face looks backwards; what was left as printed is right.
    to_frame = np.array([[0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float)
    to_frame[:3, 3] = sizes.rear_mm, -low_mm[0], low_mm[1]
    return solid_part("base_lid", body, to_frame, volume_mm3, holder.stand)
