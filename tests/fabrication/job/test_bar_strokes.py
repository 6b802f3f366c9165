"""Seams in straight stretches: bands rebuilt from the seam list alone, against the exact seam."""

import csv
import io
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon

from tests.outline.conftest import NAMED_DESIGNS, fan, plan
from vinefab.fabrication.job.bar_strokes import bar_strokes, seams_text
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.pieces.partition import pieces_of
from vinefab.inflation.pattern import Pattern, pattern_of
from vinefab.model.design import Design
from vinefab.model.files.shipped import names
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile, read_profile

SEAM_MM = 2.0
ROUNDING_MM = 0.02


@cache
def profile_of(bar_mm: float = 300.0) -> LaserProfile:
    profile = read_profile("impulse_sealer_300__stretchlon_800")
    bar = profile.machine.bar_mm.changed(value=bar_mm)
    return replace(profile, machine=profile.machine.changed(bar_mm=bar))


def random_trees():
    rng = np.random.default_rng(11)
    for number in range(5):
        width = rng.uniform(24.0, 44.0)
        share, turn = rng.uniform(0.5, 0.75), rng.uniform(40.0, 130.0)
        levels = [fan(int(rng.integers(1, 4)), rng.uniform(110, 190), turn)]
        yield f"random {number}", plan((width, width * share), levels=levels, trunk=150.0)


KINDS = (
    *("no_fillets", "round_pouches", "slight_pouches", "tapered_tree", "wide_collar"),
    *("tapered_with_rectangular_pouches", "backward_pair"),
)
IN_PIECES = [name for name in names("design") if "pieces" in name]
# The others do not lie flat in one piece: their seams would cross.
FLAT = [name for name in names("design") if "explorer" not in name or name.endswith("r_levels")]
DESIGNS = {
    **{name: Design.read(name) for name in (*FLAT, *IN_PIECES)},
    **{name: NAMED_DESIGNS[name] for name in KINDS},
    **dict(random_trees()),
}
EACH = [
    pytest.param(name, marks=pytest.mark.thorough if name in IN_PIECES[1:] else ())
    for name in DESIGNS
]


class SeamList:
    """A seam list as a technician reads it: lines between points, with what is said of each."""

    def __init__(self, text: str) -> None:
        *self.rows, self.total = csv.DictReader(io.StringIO(text))
        keys = ("from_x_mm", "from_y_mm", "to_x_mm", "to_y_mm")
        ends = np.array([[float(row[key]) for key in keys] for row in self.rows]).reshape(-1, 2, 2)
        self.ends, self.lines = ends, [LineString(two) for two in ends]
        angle = np.radians(self.numbers("angle_deg"))
        along = np.column_stack([np.cos(angle), np.sin(angle)])
        # A bar laid along the angle: the ends of a short stretch say it less exactly.
        self.along = along * np.sign(np.sum(along * (ends[:, 1] - ends[:, 0]), axis=1))[:, None]

    def numbers(self, key: str) -> list[float]:
        return [float(row[key]) for row in self.rows]

    def bars(self, before_mm, after_mm):
        """Return what a bar seals that reaches beyond both ends of each stretch."""
        moved = [
            LineString([one - way * first, two + way * last])
            for (one, two), way, first, last in zip(
                self.ends, self.along, before_mm, after_mm, strict=True
            )
        ]
        return shapely.buffer(moved, SEAM_MM / 2.0, cap_style="flat")


class Sheet:
    """The seams of a job, its lumens and their mouths, drawn anew."""

    def __init__(self, job: Job) -> None:
        runs: dict[str, list] = {}
        for path in job.along(Operation.WELD):
            runs.setdefault(path.label, []).append(path.contour.flattened_mm(0.002))
        every = [run for body in runs.values() for run in body]
        self.seams = shapely.union_all([LineString(run) for run in every])
        self.lumens = [
            Polygon(np.concatenate(body)).buffer(-SEAM_MM / 2.0) for body in runs.values()
        ]
        self.mouths = [
            LineString([one[-1], two[0]])
            for body in runs.values()
            for one, two in zip(body, [*body[1:], body[0]], strict=True)
        ]
        self.lumen = shapely.union_all(self.lumens)


@cache
def drawn(name: str) -> tuple[Sheet, SeamList]:
    design, profile = DESIGNS[name], profile_of()
    if name in IN_PIECES[1:]:
        pattern = pattern_of(design, profile)
    else:  # cut as designed: quicker
        pattern = Pattern(design=design, flat=design, deployed=design, joints=())
    job = laser_job(pattern.flat, profile, partition=pieces_of(pattern, profile))
    (sheet,) = job.runs
    return Sheet(sheet), SeamList(seams_text(bar_strokes(sheet, profile)))


@pytest.mark.parametrize("name", EACH)
def test_chords_stay_within_the_seam_and_follow_all_of_it(name: str) -> None:
    sheet, seams = drawn(name)
    gaps = np.array(seams.numbers("gap_mm"))
    assert gaps.max() <= SEAM_MM / 4.0 + ROUNDING_MM
    assert float(seams.total["gap_mm"]) == gaps.max()
    shapely.prepare(sheet.seams)
    for line, gap in zip(seams.lines, gaps, strict=True):
        points = shapely.points(
            shapely.get_coordinates(line.segmentize(min(1.0, line.length / 8.0)))
        )
        away = shapely.distance(sheet.seams, points)
        assert away.max() <= gap + ROUNDING_MM
        # The gap is what it says: half of it is exceeded somewhere, unless the rounding hides it.
        assert away.max() >= 0.5 * gap - ROUNDING_MM
    along = shapely.points(shapely.get_coordinates(shapely.segmentize(sheet.seams, 2.0)))
    away = shapely.distance(shapely.union_all(seams.lines), along)
    assert away.max() <= gaps.max() + ROUNDING_MM


@pytest.mark.parametrize("name", EACH)
def test_nothing_of_the_lumen_is_sealed_and_nothing_across_the_mouth(name: str) -> None:
    sheet, seams = drawn(name)
    bands = shapely.union_all(seams.bars(*np.zeros((2, len(seams.rows)))))
    assert bands.intersection(sheet.lumen.buffer(-ROUNDING_MM)).area == pytest.approx(0.0, abs=1e-6)
    for mouth in sheet.mouths:
        middle = mouth.interpolate(0.5, normalized=True)
        assert bands.distance(middle) >= 0.5 * mouth.length - SEAM_MM / 2.0 - ROUNDING_MM
    # The seam is shut all around: with lids on its mouths, each lumen is a room by itself.
    shut = [bands.buffer(ROUNDING_MM), *(mouth.buffer(0.01) for mouth in sheet.mouths)]
    rooms = shapely.get_parts(shapely.box(*bands.buffer(50.0).bounds) - shapely.union_all(shut))
    for lumen in sheet.lumens:
        (room,) = rooms[shapely.covers(rooms, shapely.point_on_surface(lumen))]
        assert room.area == pytest.approx(lumen.area, rel=0.02)


@pytest.mark.parametrize("name", EACH)
def test_the_bar_reaches_as_far_as_the_list_says_and_no_farther(name: str) -> None:
    sheet, seams = drawn(name)
    safe, bar_mm = sheet.lumen.buffer(-0.2), 300.0
    keys = "bar_beyond_first_mm", "bar_beyond_last_mm"
    ways = np.array([seams.numbers(key) for key in keys])
    assert not shapely.intersects(seams.bars(*np.maximum(ways - 0.1, 0.0)), safe).any()
    for side in (0, 1):
        more = np.zeros_like(ways)
        more[side] = ways[side] + 3.0
        reaches = shapely.intersects(seams.bars(*more), sheet.lumen.buffer(2.0 * SEAM_MM))
        assert reaches[ways[side] < bar_mm].all()
    room = ways.sum(axis=0) + np.array(seams.numbers("length_mm"))
    shields = np.array([row["shield"] for row in seams.rows])
    assert shields.tolist() == sorted(shields.tolist(), reverse=True)  # these come first
    clear = np.abs(room - bar_mm) > 0.2
    assert np.array_equal((room < bar_mm)[clear], (shields == "yes")[clear])


def test_a_straight_tube_needs_no_shield_and_a_short_bar_only_in_crotches() -> None:
    _, seams = drawn("plain_vine")
    assert {row["shield"] for row in seams.rows} == {"no"}
    tree = laser_job(DESIGNS["three_level_tree"], profile_of(30.0))
    shielded = [one for one in bar_strokes(tree, profile_of(30.0)) if one.needs_shield]
    assert {one.segment.part for one in shielded} <= {"fillet", "joint"}
    assert max(one.length_mm for one in shielded) < 30.0


def test_a_stretch_longer_than_the_bar_is_pressed_several_times() -> None:
    job = laser_job(DESIGNS["plain_vine"], profile_of())
    for stroke in bar_strokes(job, profile_of()):
        reach_mm = stroke.presses * (300.0 - 5.0) + 5.0
        assert reach_mm >= stroke.length_mm
        assert stroke.presses == 1 or reach_mm - 295.0 < stroke.length_mm


def test_what_no_bar_seals_has_no_seam_list() -> None:
    profile = read_profile("co2_60w__stretchlon_200")
    assert bar_strokes(laser_job(DESIGNS["plain_vine"], profile), profile) == ()
