"""Designs, and outlines drawn a second time with Shapely in an independent way."""

import contextlib
import itertools
import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import shapely
from shapely import Point, Polygon, affinity
from shapely.geometry import box

from vinefab.fabrication.outline.ends import Leaf, corner_radii_mm
from vinefab.fabrication.outline.layout import flat_layout
from vinefab.fabrication.outline.stroke import LEAST_SEGMENT_MM
from vinefab.fabrication.package.prepare import PackageContent
from vinefab.model.design import Build, Collar, Design, Level, Pouch
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import (
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    Recipe,
    RecipeStatus,
    Standing,
)
from vinefab.model.outline import Contour, Part, Segment
from vinefab.model.pieces import Partition, Piece, Sleeve, piece_label


def fan(branches, length_mm, angle_deg, growth=1.0):
    return Level(
        branches=branches, length_mm=length_mm, fan_rad=math.radians(angle_deg), growth=growth
    )


def plan(widths, fillets=None, levels=(), *, trunk=120.0, tail=60.0, **build):
    if fillets is None:
        fillets = tuple(max(2.0, width / 4) for width in widths[1:])
    build = Build(widths_mm=widths, fillet_mm=fillets, tail_mm=tail, **build)
    return Design(name="plan", trunk_length_mm=trunk, levels=tuple(levels), build=build)


NAMED_DESIGNS = {
    "plain_vine": plan((40.0,)),
    "plain_vine_with_pouch": plan((30.0,), pouch=Pouch(shape="round", radius_mm=25.0)),
    "one_straight_child": plan((40.0, 24.0), levels=[fan(1, 110, 0)]),
    "three_levels": plan((40.0, 24.0, 14.0), levels=[fan(3, 120, 110), fan(2, 70, 70, 0.7)]),
    "wide_fan": plan((40.0, 20.0), levels=[fan(4, 110, 285)]),
    "backward_pair": plan((40.0, 16.0), levels=[fan(2, 150, 270)], trunk=200.0),
    "narrow_pair": plan((40.0, 24.0), (5.0,), levels=[fan(2, 160, 50)]),
    "large_fillets": plan((40.0, 20.0), (25.0,), levels=[fan(2, 150, 90)]),
    "capped_fillets": plan((40.0, 24.0), (30.0,), levels=[fan(2, 150, 45)]),
    "no_fillets": plan((40.0, 12.0), (0.0,), levels=[fan(3, 110, 150)]),
    "round_pouches": plan(
        (40.0, 20.0), levels=[fan(3, 110, 120, 0.6)], pouch=Pouch(shape="round", radius_mm=18.0)
    ),
    "rectangular_pouches": plan(
        (40.0, 20.0),
        levels=[fan(2, 110, 90)],
        pouch=Pouch(shape="rectangle", length_mm=50.0, width_mm=44.0),
    ),
    "slight_pouches": plan(
        (40.0, 20.0),
        levels=[fan(2, 110, 90)],
        pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=26.0),
    ),
    "tapered_tree": plan(
        (40.0, 22.0, 12.0),
        levels=[fan(3, 120, 110), fan(2, 70, 70, 0.7)],
        taper=(0.9, 0.8, 0.6),
    ),
    "tapered_backward_pair": plan(
        (40.0, 16.0), levels=[fan(2, 150, 270)], trunk=200.0, taper=(0.8, 0.7)
    ),
    "tapered_with_round_pouches": plan(
        (40.0, 20.0),
        levels=[fan(3, 110, 120, 0.6)],
        pouch=Pouch(shape="round", radius_mm=18.0),
        taper=(1.0, 0.7),
    ),
    "tapered_with_rectangular_pouches": plan(
        (40.0, 20.0),
        levels=[fan(2, 110, 90, 0.8)],
        pouch=Pouch(shape="rectangle", length_mm=40.0, width_mm=34.0),
        taper=(0.95, 0.7),
    ),
    "wide_collar": plan(
        (30.0, 16.0),
        levels=[fan(2, 110, 90)],
        tail=100.0,
        collar=Collar(clamp_diameter_mm=30.0, length_mm=25.0, flare_mm=30.0),
    ),
    "narrow_collar_without_a_straight_part": plan(
        (40.0,), tail=100.0, collar=Collar(clamp_diameter_mm=20.0, length_mm=0.0, flare_mm=40.0)
    ),
    "narrow_collar_that_reaches_the_trunk": plan(
        (44.0,),
        trunk=25.0,
        tail=60.0,
        pouch=Pouch(shape="round", radius_mm=31.0),
        collar=Collar(clamp_diameter_mm=12.0, length_mm=30.0, flare_mm=28.0),
    ),
    "tapered_trunk_with_a_collar": plan(
        (40.0,), tail=100.0, taper=(0.5,), collar=Collar(clamp_diameter_mm=32.0)
    ),
}


class Twin:
    """The same body as a union of plain Shapely shapes; arcs are chords here.

    Capsules, pouches and discs are buffers. A fillet is the space between two shapes and a ball
    that touches both: where the ball rests is solved with linear algebra, not taken from the walk.
    """

    def __init__(self, design: Design, tolerance_mm: float) -> None:
        self.design, self.tolerance_mm = design, tolerance_mm
        self.layout = flat_layout(design)

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
        half, radius = layout.end_width_mm[leaf] / 2, layout.fillet_mm[leaf]
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
            shapes += self.crotch(joint, first, second, layout.fillet_mm[children[0]])
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


@pytest.fixture(scope="session")
def twin():
    """Return how to draw a design with Shapely."""
    return Twin


@pytest.fixture(scope="session")
def make_plan():
    """Return how to make a small design: widths, fillets, levels."""
    return plan


@pytest.fixture(scope="session")
def make_fan():
    """Return how to make a level: branches, length in mm, fan in degrees, growth."""
    return fan


@pytest.fixture(params=NAMED_DESIGNS.values(), ids=NAMED_DESIGNS.keys())
def sound_design(request):
    """Each kind of joint and tip in a design that has an exact outline."""
    return request.param


@cache
def _drawn_twice(name: str, beyond_mm: float) -> Polygon:
    return Twin(NAMED_DESIGNS[name], 1e-4).body(beyond_mm)


@pytest.fixture
def sound_body(sound_design):
    """Return a function that draws a sound design with Shapely, once for all tests."""
    (name,) = (name for name, one in NAMED_DESIGNS.items() if one is sound_design)
    return lambda beyond_mm=0.0: _drawn_twice(name, beyond_mm)


def _contour(points: list[tuple[float, float]], bulges: list[float], *, closed: bool) -> Contour:
    return Contour(
        points_mm=np.array(points),
        bulges=np.array(bulges),
        parts=(Part.OTHER,) * len(bulges),
        branches=("",) * len(bulges),
        closed=closed,
    )


@pytest.fixture
def finger() -> Contour:
    """An open finger, 40 wide and 100 long with a round tip, counter-clockwise; mouth at x = 10."""
    half = math.tan(math.pi / 8)
    points = [(10.0, 20.0), (110.0, 20.0), (130.0, 40.0), (110.0, 60.0), (10.0, 60.0)]
    return _contour(points, [0.0, half, half, 0.0], closed=False)


@pytest.fixture
def job(finger: Contour) -> Job:
    """One path per operation: closed and open, lines, arcs both ways, from 5 to 300 degrees."""
    square = Contour.polyline(np.array([[5.0, 5], [145, 5], [145, 75], [5, 75]]), closed=True)
    circle = _contour([(30.0, 40.0), (40.0, 40.0)], [1.0, 1.0], closed=True)
    pacman = _contour([(70.0, 40.0), (77.5, 40.0)], [-math.tan(math.radians(75)), 0.0], closed=True)
    shallow = _contour([(10.0, 8.0), (60.0, 8.0)], [math.tan(math.radians(1.25))], closed=False)
    nearly = _contour([(100.0, 30.0), (100.0, 50.0)], [math.tan(math.radians(43.75))], closed=False)
    label = _contour([(20.0, 10.0), (24.0, 14.0), (28.0, 10.0)], [0.0, -0.5], closed=False)
    paths = [
        LaserPath(operation=Operation.MARK, contour=label, label="arrow"),
        LaserPath(operation=Operation.WELD, contour=circle),
        LaserPath(operation=Operation.WELD, contour=nearly),
        LaserPath(operation=Operation.WELDCUT, contour=finger, label="outline of <one> & 'two'"),
        LaserPath(operation=Operation.CUT, contour=pacman),
        LaserPath(operation=Operation.CUT, contour=square, label="sheet"),
        LaserPath(operation=Operation.REG, contour=shallow),
        LaserPath(operation=Operation.DOC, contour=shallow),
    ]
    facts = {"offset_mm": np.float64(0.65), "recipe": "co2__film", "two\nlines": ["ä", 1]}
    return Job(
        name="hand_made", sheet_width_mm=150, sheet_height_mm=80, paths=tuple(paths), facts=facts
    )


@pytest.fixture
def one_path() -> Callable[[Contour], Job]:
    """Return a function that makes a job of one contour on a large sheet."""

    def make(contour: Contour) -> Job:
        path = LaserPath(operation=Operation.WELDCUT, contour=contour)
        return Job(name="one", sheet_width_mm=1000.0, sheet_height_mm=777.125, paths=(path,))

    return make


@pytest.fixture
def segment_of() -> Callable[..., Segment]:
    """Return a function that makes an arc from centre, radius and two angles in degrees."""

    def make(center: tuple[float, float], radius: float, first: float, last: float) -> Segment:
        ends = [
            (center[0] + radius * math.cos(a), center[1] + radius * math.sin(a))
            for a in (math.radians(first), math.radians(last))
        ]
        turn = math.radians(last - first)
        return Segment(start_mm=ends[0], end_mm=ends[1], bulge=math.tan(turn / 4))

    return make


def _quantity(value: float, standing: Standing = Standing.MEASURED) -> Quantity:
    return Quantity(value=value, standing=standing, source="a test")


@pytest.fixture
def settings() -> OperationSettings:
    """Settings with round numbers: 100 mm/s, two passes, all measured but the kerf."""
    return OperationSettings(
        power_percent=_quantity(50.0),
        min_power_percent=_quantity(10.0),
        speed_mm_s=_quantity(100.0),
        passes=2,
        focus_offset_mm=_quantity(6.0),
        frequency_hz=_quantity(5000.0),
        air_assist=False,
        spot_mm=_quantity(0.5),
        kerf_mm=_quantity(0.3, Standing.ASSUMED),
        seam_width_mm=_quantity(0.4),
        overcut_mm=_quantity(3.0),
    )


@pytest.fixture
def profile(settings: OperationSettings) -> LaserProfile:
    """A 60 W machine with 1000 mm/s2, two plies of 0.05 mm at 1000 kg/m3, an untried recipe."""
    machine = Machine(
        name="tester",
        title="Tester's laser",
        bed_width_mm=_quantity(600.0),
        bed_height_mm=_quantity(400.0),
        margin_mm=_quantity(5.0),
        power_w=_quantity(60.0),
        spot_mm=_quantity(0.2),
        rayleigh_mm=_quantity(3.0),
        speed_max_mm_s=_quantity(500.0),
        acceleration_mm_s2=_quantity(1000.0),
    )
    material = Material(
        name="film",
        title="Test film",
        ply_mm=_quantity(0.05),
        plies=2,
        roll_width_mm=_quantity(1000.0),
        density_kg_m3=_quantity(1000.0, Standing.PUBLISHED),
        modulus_mpa=_quantity(30.0),
        strength_mpa=_quantity(27.0),
        friction=_quantity(0.3),
        burst_kpa=_quantity(70.0, Standing.PAPER),
        burst_width_mm=_quantity(20.0, Standing.ASSUMED),
        weldable=True,
    )
    recipe = Recipe(
        name="tester__film",
        title="Test recipe",
        machine="tester",
        material="film",
        status=RecipeStatus.UNVERIFIED,
        source="a test",
        operations=dict.fromkeys(("mark", "weldcut", "cut"), settings)
        | {"weld": settings.changed(kerf_mm=_quantity(0.0, Standing.ASSUMED))},
    )
    return LaserProfile(machine=machine, material=material, recipe=recipe)


@pytest.fixture
def design() -> Design:
    """A plain vine."""
    return Design(name="plain", trunk_length_mm=100.0, build=Build.standard(1))


@pytest.fixture
def content(design: Design, profile: LaserProfile, job: Job) -> PackageContent:
    """A whole package's content."""
    return PackageContent(
        design=design,
        profile=profile,
        job=job,
        checks='{"schema": "vinefab/checks-1"}\n',
        preview=b"picture",
        report=b"<html></html>",
    )


def _ends(begin_mm: float, lap_mm: float, *, on_stub: bool) -> dict[str, float]:
    """Return where a joint's rims are, and where its socket's blend ends."""
    end_mm = begin_mm + lap_mm
    if on_stub:
        return {"plug_mm": begin_mm, "socket_mm": end_mm, "blend_end_mm": begin_mm - 5.0}
    return {"socket_mm": begin_mm, "plug_mm": end_mm, "blend_end_mm": end_mm + 5.0}


def cut_robot(design: Design, cuts: tuple[int, ...], lap_mm: float = 15.0):
    """Return a design cut on some branches a third along them, and simple outlines of its pieces.

    An outline is the union of the branches' rectangles without its holes: pieces that cross
    themselves have one too.
    """
    layout = flat_layout(design)
    parent, length = layout.tree.parent.tolist(), layout.tree.length_mm.tolist()
    roots = (0, *sorted(cuts))
    home: list[int] = []
    for row, above in enumerate(parent):
        home.append(row if row in roots else home[above])
    label = {root: piece_label(number) for number, root in enumerate(roots)}
    sleeves = tuple(
        Sleeve(
            label=label[row],
            inner=label[home[parent[row]]],
            branch=row,
            **_ends(length[row] / 3.0, lap_mm, on_stub=design.build.mounting != "turned"),
            rise_mm=0.9,
            width_mm=float(layout.width_mm[row]),
        )
        for row in roots[1:]
    )
    at = {sleeve.branch: sleeve for sleeve in sleeves}
    pieces, outlines = [], {}
    for root in roots:
        branches = tuple(row for row, on in enumerate(home) if on == root)
        stubs = tuple(sleeve.branch for sleeve in sleeves if sleeve.inner == label[root])
        pieces.append(Piece(label=label[root], root=root, branches=branches, stubs=stubs))
        begins = {root: at[root].outer_from_mm if root else -design.build.tail_mm}
        ends = {row: at[row].stub_to_mm for row in stubs}
        shapes = []
        for row in (*branches, *stubs):
            along = np.array([math.cos(layout.heading_rad[row]), math.sin(layout.heading_rad[row])])
            ways = begins.get(row, 0.0), ends.get(row, length[row] + layout.width_mm[row] / 2.0)
            line = shapely.LineString([layout.start_mm[row] + way * along for way in ways])
            shapes.append(line.buffer(layout.width_mm[row] / 2.0, cap_style="flat"))
            if row != root:
                shapes.append(Point(layout.start_mm[row]).buffer(layout.width_mm[row] / 2.0))
        ring = shapely.get_coordinates(shapely.union_all(shapes).exterior)
        outlines[label[root]] = Contour.polyline(ring[:-1], closed=False)
    return Partition(pieces=tuple(pieces), sleeves=sleeves), outlines


@pytest.fixture(scope="session")
def cut_at():
    """Return how to cut a design on branches: a partition, and simple outlines of its pieces."""
    return cut_robot
