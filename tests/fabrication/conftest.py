"""Designs, jobs and robots in pieces that the tests of several rooms share."""

import math

import numpy as np
import pytest
import shapely
from shapely import Point

from tests.outline.conftest import fan, make_fan, make_plan, plan, sound_body, sound_design
from vinefab.fabrication.formats.laser_drawing import package_spec
from vinefab.fabrication.formats.laser_formats import laser_files
from vinefab.fabrication.package.prepare import Prepared
from vinefab.inflation.pattern import pattern_of
from vinefab.model.design import Build, Design
from vinefab.model.finding import CheckReport
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, Material, Recipe, RecipeStatus
from vinefab.model.machine import LaserMachine, LaserSettings
from vinefab.model.outline import Contour, Part, Segment
from vinefab.model.quantity import Quantity, Standing
from vinefab.model.tree import Partition, Piece, Sleeve, piece_label
from vinefab.outline.body_outline import flat_layout

__all__ = ["fan", "make_fan", "make_plan", "plan", "sound_body", "sound_design"]


def _contour(points, bulges, *, closed):
    return Contour(
        points_mm=np.array(points),
        bulges=np.array(bulges),
        parts=(Part.OTHER,) * len(bulges),
        branches=("",) * len(bulges),
        closed=closed,
    )


@pytest.fixture(scope="session")
def finger():
    """An open finger, 40 wide and 100 long with a round tip, counter-clockwise; mouth at x = 10."""
    half = math.tan(math.pi / 8)
    points = [(10.0, 20.0), (110.0, 20.0), (130.0, 40.0), (110.0, 60.0), (10.0, 60.0)]
    return _contour(points, [0.0, half, half, 0.0], closed=False)


@pytest.fixture(scope="session")
def job(finger):
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


@pytest.fixture(scope="session")
def one_path():
    """Return a function that makes a job of one contour on a large sheet."""

    def make(contour):
        path = LaserPath(operation=Operation.WELDCUT, contour=contour)
        return Job(name="one", sheet_width_mm=1000.0, sheet_height_mm=777.125, paths=(path,))

    return make


@pytest.fixture(scope="session")
def segment_of():
    """Return a function that makes an arc from centre, radius and two angles in degrees."""

    def make(center, radius, first, last):
        ends = [
            (center[0] + radius * math.cos(a), center[1] + radius * math.sin(a))
            for a in (math.radians(first), math.radians(last))
        ]
        turn = math.radians(last - first)
        return Segment(start_mm=ends[0], end_mm=ends[1], bulge=math.tan(turn / 4))

    return make


def _quantity(value, standing=Standing.MEASURED):
    return Quantity(value=value, standing=standing, source="a test")


@pytest.fixture(scope="session")
def settings():
    """Settings with round numbers: 100 mm/s, two passes, all measured but the kerf."""
    return LaserSettings(
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


@pytest.fixture(scope="session")
def profile(settings):
    """A 60 W machine with 1000 mm/s2, two plies of 0.05 mm at 1000 kg/m3, an untried recipe."""
    machine = LaserMachine(
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


@pytest.fixture(scope="session")
def design():
    """A plain vine."""
    return Design(name="plain", trunk_length_mm=100.0, build=Build.standard(1))


@pytest.fixture(scope="session")
def prepared(design, profile, job):
    """A plain vine with a job drawn by hand: one path of every operation, laser files included."""
    written = laser_files(package_spec(job, profile))
    assert not any(written.problems.values())
    return Prepared(
        design=design,
        profile=profile,
        job=job,
        report=CheckReport(
            design=design.name, recipe=profile.recipe.name, run=(), skipped=(), findings=()
        ),
        laser=written.files,
        patterns={design.name: pattern_of(design, profile)},
    )


def _ends(begin_mm, lap_mm, *, on_stub):
    """Return where a joint's rims are, and where its socket's blend ends."""
    end_mm = begin_mm + lap_mm
    if on_stub:
        return {"plug_mm": begin_mm, "socket_mm": end_mm, "blend_end_mm": begin_mm - 5.0}
    return {"socket_mm": begin_mm, "plug_mm": end_mm, "blend_end_mm": end_mm + 5.0}


def cut_robot(design, cuts, lap_mm=15.0):
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
