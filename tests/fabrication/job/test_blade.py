"""Trailing blades, simulated: a rigid link, drawn by its axis, which slides along itself alone.

The simulation knows nothing of `fabrication.job.blade`: it reads G-code and drags the point.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy
import shapely

from tests.fabrication.formats.test_gcode_format import drawn_mm, moves
from tests.fabrication.rules.conftest import random_tree
from vinefab.fabrication.formats.gcode_format import GCODE
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec
from vinefab.fabrication.job.passes import body_paths
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.outline import Contour

STEP_MM = 0.1


def blade_profile(offset_mm: float) -> LaserProfile:
    profile = read_profile("hot_tip_220_knife__stretchlon_200")
    assert profile.cutter is not None
    offset = profile.cutter.blade_offset_mm.changed(value=offset_mm)
    return replace(profile, cutter=profile.cutter.changed(blade_offset_mm=offset))


def dragged_mm(text: str, offset_mm: float, over_mm: float) -> list[np.ndarray]:
    """Return where the point of a blade goes while it is in the film, one line per plunge.

    It starts across the way that it is drawn first, the worst that it can.
    """
    lines = drawn_mm(text, over_mm)
    angle = math.pi / 2.0
    found = []
    for line in lines:
        x, y = line[0]
        px, py = x - offset_mm * math.cos(angle), y - offset_mm * math.sin(angle)
        track = [(px, py)]
        for (ax, ay), (bx, by) in zip(line[:-1].tolist(), line[1:].tolist(), strict=True):
            count = max(1, math.ceil(math.dist((ax, ay), (bx, by)) / STEP_MM))
            for k in range(1, count + 1):
                cx, cy = ax + (bx - ax) * k / count, ay + (by - ay) * k / count
                away = math.hypot(cx - px, cy - py)
                px, py = cx - offset_mm * (cx - px) / away, cy - offset_mm * (cy - py) / away
                track.append((px, py))
        angle = math.atan2(cy - py, cx - px)
        found.append(np.array(track))
    return found


def worst_mm(paths: list[LaserPath], profile: LaserProfile) -> float:
    """Return the largest distance between the blade's point and the wanted paths, both ways."""
    spec = LaserFileSpec(job=job_of(*paths), profile=profile)
    assert profile.cutter is not None
    text = GCODE.write(spec)
    offset = profile.cutter.blade_offset_mm.value
    _orientation, *tracks = dragged_mm(text, offset, profile.cutter.travel_z_mm.value)
    assert len(tracks) == len(paths)
    return max(
        apart_mm(track, path.contour.flattened_mm(0.001))
        for track, path in zip(tracks, paths, strict=True)
    )


def apart_mm(one: np.ndarray, two: np.ndarray) -> float:
    """Return the largest distance of two lines from each other, both ways, within 0.025 mm."""
    dense = [shapely.segmentize(shapely.linestrings(line), 0.05) for line in (one, two)]
    points = [shapely.get_coordinates(line) for line in dense]
    trees = [scipy.spatial.KDTree(line) for line in points]
    return max(float(trees[k].query(points[1 - k])[0].max()) for k in (0, 1))


def worst_of_outlines(numbers: range) -> float:
    """Return the worst of cuts around random robots, for blades that trail by 0.25 to 1 mm."""
    worst = 0.0
    for seed in numbers:
        rng = np.random.default_rng([47, seed])
        profile = blade_profile(float(rng.choice([0.25, 0.5, 1.0])))
        assert profile.cutter is not None
        large = profile.cutter.bed_width_mm.changed(value=20000.0)
        cutter = profile.cutter.changed(bed_width_mm=large, bed_height_mm=large)
        profile = replace(profile, cutter=cutter)
        cuts = [
            replace(path, contour=path.contour.moved(rng.uniform(0.0, math.tau), 9e3, 9e3))
            for path in body_paths(random_tree(rng), profile).paths
            if path.operation is Operation.CUT
        ]
        assert cuts
        off = worst_mm(cuts, profile)
        assert off < 0.1, f"outline {seed}: {off:.3f} mm"
        worst = max(worst, off)
    return worst


def test_the_point_follows_outlines() -> None:
    assert worst_of_outlines(range(6)) < 0.1


@pytest.mark.thorough
def test_the_point_follows_two_hundred_outlines() -> None:
    assert worst_of_outlines(range(6, 200)) < 0.1


def test_the_point_turns_in_every_corner() -> None:
    profile = blade_profile(0.5)
    for turn_deg in (10, 45, 90, 135, 170, -30, -90, -179):
        turn = math.radians(turn_deg)
        points = [(50.0, 50.0), (80.0, 50.0)]
        points.append((80.0 + 30.0 * math.cos(turn), 50.0 + 30.0 * math.sin(turn)))
        path = cut(Contour.polyline(np.array(points), closed=False))
        assert worst_mm([path], profile) < 0.03, turn_deg


def test_arcs_much_tighter_than_the_blade_trails_are_followed() -> None:
    profile = blade_profile(1.0)
    for radius in (0.5, 2.0, 20.0):
        line = Contour.polyline(
            np.array([(50.0, 50.0), (60.0, 50.0), (60.0 + radius, 50.0 + radius)]), closed=False
        )
        bent = replace(line, bulges=np.array([0.0, math.tan(math.pi / 8.0)]))
        assert worst_mm([cut(bent)], profile) < 0.03, radius


def test_without_compensation_the_point_would_miss() -> None:
    """The check can fail: a blade that trails, in a file for one that does not, is off by more."""
    profile, points = blade_profile(0.0), [(50.0, 50.0), (80.0, 50.0), (80.0, 80.0)]
    path = cut(Contour.polyline(np.array(points), closed=False))
    spec = LaserFileSpec(job=job_of(path), profile=profile)
    (track,) = dragged_mm(GCODE.write(spec), 0.5, 3.0)
    wanted = shapely.LineString(points)
    assert shapely.hausdorff_distance(shapely.LineString(track), wanted) > 0.3


def test_the_blade_is_lifted_where_it_swivels_far_alone() -> None:
    profile = blade_profile(0.25)
    points = [(50.0, 50.0), (80.0, 50.0), (110.0, 52.0), (110.0, 90.0)]
    path = cut(Contour.polyline(np.array(points), closed=False))
    spec = LaserFileSpec(job=job_of(path), profile=profile)
    body = GCODE.write(spec).partition(";PATH")[2]
    heights = [words["Z"] for name, words in moves(body) if "Z" in words and name == "G1"]
    # Down (no swivel: it comes along x), lifted for the corner of 86 degrees alone, down again.
    assert heights == [-0.3, -0.05, -0.3]


def job_of(*paths: LaserPath) -> Job:
    return Job(name="cuts", sheet_width_mm=220.0, sheet_height_mm=220.0, paths=paths)


def cut(contour: Contour) -> LaserPath:
    return LaserPath(operation=Operation.CUT, contour=contour, label="cut")
