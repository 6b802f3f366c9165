"""Outlines drawn a second time, with Shapely and in an independent way."""

import contextlib
import itertools
import math

import numpy as np
import shapely
from shapely import Point, Polygon, affinity
from shapely.geometry import box

from vinefab.model.design import Design
from vinefab.outline.body_outline import flat_layout
from vinefab.outline.ends import Leaf, corner_radii_mm, level_fillets_mm
from vinefab.outline.joint import LEAST_SEGMENT_MM


class Twin:
    """The same body as a union of plain Shapely shapes; arcs are chords here.

    Capsules, pouches and discs are buffers. A fillet is the space between two shapes and a ball
    that touches both: where the ball rests is solved with linear algebra, not taken from the walk.
    """

    def __init__(self, design: Design, tolerance_mm: float) -> None:
        self.design, self.tolerance_mm = design, tolerance_mm
        self.layout, self.fillets_mm = flat_layout(design), level_fillets_mm(design.build)

    def body(self, beyond_mm: float = 0.0) -> Polygon:
        """The lumen; with ``beyond_mm`` its tail is drawn out so far beyond the mouth."""
        layout = self.layout
        parts = [self.tail(beyond_mm)]
        parts += [self.branch(branch) for branch in range(len(layout.tree))]
        for leaf in np.flatnonzero(layout.is_leaf):
            parts += self.pouch(int(leaf))
        for joint in np.flatnonzero(~layout.is_leaf):
            parts += self.crotches(int(joint))
        parts = [piece for part in parts for piece in shapely.get_parts(part) if piece.area > 0]
        return without_crumbs(union_on_a_grid(parts))

    def tail(self, beyond_mm):
        """A strip from the mouth to the trunk's base, and the collar."""
        back, half = self.layout.tail_mm, self.layout.width_mm[0] / 2
        parts = [box(-back - (0.0 if self.design.build.collar else beyond_mm), -half, 0.0, half)]
        collar = self.design.build.collar
        if collar is None:
            return parts[0]
        # As documented, a straight part that is too short to draw is left out.
        straight = collar.length_mm if collar.length_mm >= LEAST_SEGMENT_MM else 0.0
        wide, x = collar.flat_width_mm / 2, straight - back
        rise = wide - half
        # Circles of one radius, one tangent to each of the two sides, that touch halfway.
        radius = (collar.flare_mm**2 / abs(rise) + abs(rise)) / 4
        turn = math.copysign(2 * math.atan(abs(rise) / collar.flare_mm), rise)
        angles = turn * np.linspace(0, 1, 4 * self.quad_segs(radius))
        out = math.copysign(1.0, rise)
        first = np.column_stack([np.sin(abs(angles)), out * (np.cos(angles) - 1)]) * radius
        first += [x, wide]
        second = [x + collar.flare_mm, half] + (first[0] - first[::-1])
        edge = np.vstack([[-back - beyond_mm, wide], first, second[1:]])
        flare = Polygon(np.vstack([edge, edge[::-1] * [1, -1]]))
        if rise < 0:
            # Narrower than the trunk: it takes the strip's place.
            strip = box(x + collar.flare_mm, -half, 0.0, half)
            return strip.union(flare)
        return parts[0].union(flare)

    def branch(self, branch):
        """The hull of a disc at both ends; at a pouch the second is cut to what it covers."""
        layout = self.layout
        half, end_half = layout.width_mm[branch] / 2, layout.end_width_mm[branch] / 2
        length = layout.tree.length_mm[branch]
        lean = self.lean(branch)
        out = np.array([math.sin(lean), math.cos(lean)])
        low, high = half * out - [length, 0.0], end_half * out
        # Between the points where the sides touch the discs; a hull of chords would be too small.
        sides = Polygon([low, high, high * [1, -1], low * [1, -1]])
        shape = shapely.union_all([sides, self.disc(half, (-length, 0.0)), self.disc(end_half)])
        if self.design.build.pouch is not None and layout.is_leaf[branch]:
            # A pouch takes the round end's place, also where it is shorter than that.
            shape = shape.intersection(box(-1e4, -1e4, 0.0, 1e4))
        if branch == 0:
            # Behind its base lies the tail: as wide, or narrowed by a collar that the disc at the
            # base would stick out of.
            shape = shape.intersection(box(-length, -1e4, 1e4, 1e4))
        return self.at(shape, layout.end_mm[branch], layout.heading_rad[branch])

    def disc(self, radius_mm, place=(0.0, 0.0)):
        return Point(*place).buffer(radius_mm, quad_segs=self.quad_segs(radius_mm))

    def quad_segs(self, radius_mm):
        """Chords per quarter circle so that none is farther than the tolerance from its arc."""
        step = 2 * math.acos(max(0.0, 1 - self.tolerance_mm / max(radius_mm, self.tolerance_mm)))
        return math.ceil(math.pi / 2 / step)

    def at(self, shape, place, heading_rad):
        turned = affinity.rotate(shape, heading_rad, origin=(0, 0), use_radians=True)
        return affinity.translate(turned, *place)

    def between(self, first, second, radius_mm):
        """What a ball leaves free between two things that it touches.

        Each thing is a strip ("strip", direction, half width, side) from the origin or a disc
        ("disc", radius) around it.
        """
        center = resting_place(first, second, radius_mm)
        return self.wedge(center, touching(first, center), touching(second, center))

    def wedge(self, center, start, end):
        """From the origin to a ball's two touching points and round the ball's near side."""
        first, second = (np.subtract(point, center) for point in (start, end))
        turn = math.atan2(np.cross([*first, 0], [*second, 0])[2], np.dot(first, second))
        count = self.quad_segs(math.hypot(*first)) * 2
        angles = math.atan2(first[1], first[0]) + turn * np.linspace(0, 1, count)
        ball = center + math.hypot(*first) * np.column_stack([np.cos(angles), np.sin(angles)])
        return Polygon([(0.0, 0.0), *ball.tolist()])

    def pouch(self, leaf):
        """The pouch with the fillets of its neck."""
        pouch, layout = self.design.build.pouch, self.layout
        if pouch is None:
            return []
        half, radius = layout.end_width_mm[leaf] / 2, self.fillets_mm[layout.tree.level[leaf] - 1]
        lean = self.lean(leaf)
        shapes = []
        if pouch.shape == "round":
            shapes.append(self.disc(pouch.radius_mm))
            for side in (1, -1):
                strip = ("strip", math.pi + side * lean, half, side)
                shapes.append(self.between(strip, ("disc", pouch.radius_mm), radius))
        else:
            length, width = pouch.length_mm, pouch.width_mm
            # Which radii share the shoulder is a rule of its own, and is tested on its own.
            end = Leaf(half_mm=half, lean_rad=lean, fillet_mm=radius)
            radius, corner = corner_radii_mm(pouch, end)
            core = (
                corner - length / 2,
                corner - width / 2,
                length / 2 - corner,
                width / 2 - corner,
            )
            shapes.append(box(*core).buffer(corner, quad_segs=self.quad_segs(corner)))
            for side in (1, -1):
                back = -length / 2
                # A ball that touches the branch's side and stands behind the pouch's edge.
                outer = ("strip", math.pi + side * lean, half, side)
                normal, rise = outward(outer), half + radius
                x = back - radius
                center = np.array([x, (rise - normal[0] * x) / normal[1]])
                shapes.append(self.wedge(center, (back, center[1]), touching(outer, center)))
        if leaf == 0:
            # A pouch may be larger than trunk and tail together: the mouth still cuts it off.
            back = layout.tree.length_mm[0] + layout.tail_mm
            shapes = [shape.intersection(box(-back, -1e4, 1e4, 1e4)) for shape in shapes]
        place, heading = layout.end_mm[leaf], layout.heading_rad[leaf]
        return [self.at(shape, place, heading) for shape in shapes]

    def crotches(self, joint):
        layout = self.layout
        children = np.flatnonzero(layout.tree.parent == joint)
        half, heading = layout.width_mm / 2, layout.heading_rad
        end, tilt = layout.end_width_mm[joint] / 2, self.lean(joint)
        # Direction away from the joint, lean of the sides that way, half width, branch.
        around = [(heading[joint] - math.pi, -tilt, end, joint)]
        around += [(heading[child], self.lean(child), half[child], child) for child in children]
        around += [(heading[joint] + math.pi, -tilt, end, joint)]
        shapes = []
        for one, two in itertools.pairwise(around):
            first = (one[0] - one[1], *one[2:])
            second = (two[0] + two[1], *two[2:])
            shapes += self.crotch(joint, first, second, self.fillets_mm[layout.tree.level[joint]])
        return [affinity.translate(shape, *layout.end_mm[joint]) for shape in shapes]

    def crotch(self, joint, first, second, designed_mm):
        """Fill between any two things around the joint that a ball in the gap can rest on."""
        half, back = self.layout.end_width_mm[joint] / 2, self.layout.heading_rad[joint] + math.pi
        tilt = self.lean(joint)
        one, two = ("strip", *first[:2], 1), ("strip", *second[:2], -1)
        # All parents of a level are treated alike, by the shortest of them.
        shorter = min(self.shortest(first[2], joint), self.shortest(second[2], joint))
        radius = min(designed_mm, largest_radius(one, two, max(shorter / 2, half)))
        if radius <= 0:
            return []
        core = [("disc", half), ("strip", back + tilt, half, 1), ("strip", back - tilt, half, -1)]
        pairs = [(one, two)] if first[2] != joint and second[2] != joint else []
        pairs += [(one, rest) for rest in core if first[2] != joint]
        pairs += [(two, rest) for rest in core if second[2] != joint]
        solids = [whole(thing) for thing in (one, two, *core)]
        return [
            self.between(*pair, radius)
            for pair in pairs
            if comes_to_rest(pair, radius, solids) and between_directions(pair, radius, one, two)
        ]

    def lean(self, branch):
        """By how much a branch's sides lean towards its axis: from the hull of its two discs."""
        layout = self.layout
        narrower = (layout.width_mm[branch] - layout.end_width_mm[branch]) / 2
        return math.asin(narrower / layout.tree.length_mm[branch])

    def shortest(self, branch, joint):
        layout = self.layout
        if branch == joint:
            alike = layout.tree.level == layout.tree.level[joint]
            return float(layout.tree.length_mm[alike].min())
        return float(layout.tree.length_mm[branch])


def whole(thing):
    """The shape of a thing, for distances: a long box or a disc."""
    if thing[0] == "disc":
        return Point(0, 0).buffer(thing[1], quad_segs=512)
    flat = box(0, -thing[2], 1e5, thing[2])
    return affinity.rotate(flat, thing[1], origin=(0, 0), use_radians=True)


def comes_to_rest(pair, radius_mm, solids):
    """Whether the ball that touches both lines really touches both things and nothing more."""
    try:
        center = resting_place(*pair, radius_mm)
    except (np.linalg.LinAlgError, ValueError):
        return False
    gaps = [whole(thing).distance(Point(*center)) - radius_mm for thing in pair]
    free = min(solid.distance(Point(*center)) for solid in solids) - radius_mm
    return max(map(abs, gaps)) < 1e-3 and free > -1e-3


def between_directions(pair, radius_mm, one, two):
    """Whether the ball lies counter-clockwise of the first strip and clockwise of the second."""
    x, y = resting_place(*pair, radius_mm)
    angle = (math.atan2(y, x) - one[1]) % math.tau
    return angle < two[1] - one[1]


def union_on_a_grid(parts):
    """Touching edges differ by rounding and GEOS may trip over them, but not on every grid."""
    for grid_mm in (1e-8, 1e-7, 1e-6):
        with contextlib.suppress(shapely.GEOSException):
            return shapely.union_all(parts, grid_size=grid_mm)
    return shapely.union_all(parts)


def without_crumbs(shape):
    """Without the slivers that rounding leaves beside touching edges."""
    parts = [part for part in shapely.get_parts(shape) if part.area > 1e-5]
    return parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)


def direction(angle_rad):
    return np.array([math.cos(angle_rad), math.sin(angle_rad)])


def outward(strip):
    """Unit vector from a strip's axis to the side in question."""
    _, angle, _, side = strip
    return side * np.array([-math.sin(angle), math.cos(angle)])


def resting_place(first, second, radius_mm):
    """Centre of the ball that touches both things from outside."""
    if second[0] == "strip":
        rows = np.array([outward(first), outward(second)])
        return np.linalg.solve(rows, [first[2] + radius_mm, second[2] + radius_mm])
    away = second[1] + radius_mm
    rise = first[2] + radius_mm
    return rise * outward(first) + math.sqrt(away**2 - rise**2) * direction(first[1])


def touching(thing, center):
    """Where a ball around ``center`` touches a thing."""
    if thing[0] == "disc":
        return thing[1] * center / math.hypot(*center)
    return center - outward(thing) * (np.dot(outward(thing), center) - thing[2])


def largest_radius(first, second, reach_mm):
    """The cap by angle, by bisection on how near to the joint the ball's nearest point is."""
    if second[1] - first[1] >= math.pi - 1e-6:
        return math.inf

    def nearest(radius):
        center = resting_place(first, second, radius)
        ahead = min(np.dot(center, direction(strip[1])) for strip in (first, second)) >= 0.0
        return math.hypot(*center) - radius if ahead else 0.0

    if nearest(0.0) > reach_mm:
        return 0.0
    low, high = 0.0, 1e6
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if nearest(middle) <= reach_mm else (low, middle)
    return low


class FreeTwin(Twin):
    """The same for trees of branches with bends: every joint and pouch is its own.

    An elbow is what lies between two circles, each touching both sides of the tube on its side of
    the turn; the straight parts end where they touch.
    """

    def __init__(self, design: Design, tolerance_mm: float) -> None:
        super().__init__(design, tolerance_mm)
        tree, self.children = self.layout.tree, {}
        for row in range(len(tree)):
            self.children[row] = np.flatnonzero(tree.parent == row).tolist()
        self.elbows = {row: self.elbow(row) for row in self.children if self.continues(row)}

    def body(self, beyond_mm: float = 0.0) -> Polygon:
        """The lumen, in one part: an elbow and a straight part meet in an edge.

        Their union may keep that edge, open by rounding; it is closed here.
        """
        shape = super().body(beyond_mm)
        if len(shapely.get_parts(shape)) == 1:
            return shape
        wide = shape.buffer(1e-6, join_style="mitre")
        return without_crumbs(wide.buffer(-1e-6, join_style="mitre"))

    def continues(self, row):
        below, layout = self.children[row], self.layout
        return len(below) == 1 and layout.width_mm[below[0]] == layout.end_width_mm[row]

    def elbow(self, row):
        """Centre and signed reach of the circle on each side, and where it touches both parts."""
        layout, (child,) = self.layout, self.children[row]
        half, heading = layout.end_width_mm[row] / 2, layout.heading_rad
        back = heading[row] + (math.pi if layout.tree.offset_rad[child] < 0 else -math.pi)
        lean, tilt = self.lean(child), self.lean(row)
        if layout.tree.offset_rad[child] > 0:
            one, two = heading[child] - lean, heading[row] + math.pi - tilt
        else:
            one, two = back - 2 * math.pi + tilt, heading[child] + lean
        strips = ("strip", one, half, 1), ("strip", two, half, -1)
        shorter = min(layout.tree.length_mm[child], self.shortest(row, row))
        most = largest_radius(*strips, max(shorter / 2, half))
        inner = max(0.0, min(layout.tree.fillet_mm[child], most))
        found = {}
        for side in (1, -1):
            normals = np.array(
                [
                    direction(heading[row] + side * (math.pi / 2 - tilt)),
                    direction(heading[child] + side * (math.pi / 2 - lean)),
                ]
            )
            is_inner = side * layout.tree.offset_rad[child] > 0
            reach = inner if is_inner else -(inner + 2 * half)
            center = np.linalg.solve(normals, [half + reach] * 2)
            found[side] = center, [center - reach * normal for normal in normals]
        return found

    def branch(self, branch):
        layout, tree = self.layout, self.layout.tree
        half, end_half = layout.width_mm[branch] / 2, layout.end_width_mm[branch] / 2
        above, lean = int(tree.parent[branch]), self.lean(branch)
        turn, start, end = (
            layout.heading_rad[branch],
            layout.start_mm[branch],
            layout.end_mm[branch],
        )
        corners = {}
        for side in (1, -1):
            normal = direction(turn + side * (math.pi / 2 - lean))
            corners[side] = [start + half * normal, end + end_half * normal]
            if above in self.elbows:
                corners[side][0] = start + self.elbows[above][side][1][1]
            if branch in self.elbows:
                corners[side][1] = end + self.elbows[branch][side][1][0]
        shape = Polygon([*corners[1], *corners[-1][::-1]])
        if branch > 0 and above not in self.elbows:
            shape = shape.union(self.at(self.disc(half), start, turn))
        if branch == 0 and lean:
            shape = shape.union(self.at(self.disc(half), start, turn))
            shape = shape.intersection(box(0.0, -1e4, 1e4, 1e4))
        if branch not in self.elbows and layout.pouches[branch] is None:
            shape = shape.union(self.at(self.disc(end_half), end, turn))
        return shape

    def pouch(self, leaf):
        own, whole_design = self.layout.pouches[leaf], self.design
        build = whole_design.build.model_copy(update={"pouch": own})
        self.design = whole_design.model_copy(update={"build": build})
        try:
            return super().pouch(leaf)
        finally:
            self.design = whole_design

    def crotches(self, joint):
        layout, place = self.layout, self.layout.end_mm[joint]
        if joint in self.elbows:
            edges = []
            for side in (1, -1):
                center, (one, two) = self.elbows[joint][side]
                radius = math.hypot(*(one - center))
                first, last = (math.atan2(*(point - center)[::-1]) for point in (one, two))
                turns = math.remainder(last - first, math.tau)
                angles = first + turns * np.linspace(0, 1, 4 * self.quad_segs(max(radius, 1e-3)))
                arc = center + radius * np.column_stack([np.cos(angles), np.sin(angles)])
                edges.append(arc[:: 1 if side == 1 else -1])
            return [affinity.translate(Polygon(np.vstack(edges)).buffer(0), *place)]
        children, half, heading = self.children[joint], layout.width_mm / 2, layout.heading_rad
        end, tilt = layout.end_width_mm[joint] / 2, self.lean(joint)
        fillets = layout.tree.fillet_mm[children].tolist()
        around = [(heading[joint] - math.pi, -tilt, end, joint)]
        around += [(heading[child], self.lean(child), half[child], child) for child in children]
        around += [(heading[joint] + math.pi, -tilt, end, joint)]
        wanted = [fillets[0], *map(min, itertools.pairwise(fillets)), fillets[-1]]
        shapes = []
        for (one, two), designed in zip(itertools.pairwise(around), wanted, strict=True):
            first, second = (one[0] - one[1], *one[2:]), (two[0] + two[1], *two[2:])
            shapes += self.crotch(joint, first, second, designed)
        return [affinity.translate(shape, *place) for shape in shapes]

    def shortest(self, branch, joint):  # noqa: ARG002  joints that are alike do not occur here
        return float(self.layout.tree.length_mm[branch])
