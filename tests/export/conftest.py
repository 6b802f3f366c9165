"""Jobs made by hand, and programs that read laser files independently of vinefab."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from vinefab.export.package import PackageContent
from vinefab.model.design import Build, Design
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
        status=RecipeStatus.UNVERIFIED,
        source="a test",
        operations=dict.fromkeys(("mark", "weld", "weldcut", "cut"), settings),
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
