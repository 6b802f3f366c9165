import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.fabrication.job.timing import move_time_s, segment_times_s
from vinefab.fabrication.package.bom import machine_time
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import Sealer
from vinefab.model.outline import Contour, Segment


def contour_time_s(contour: Contour, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    return math.fsum(segment_times_s(contour, speed_mm_s, acceleration_mm_s2))


def test_a_long_move_is_a_trapezoid_and_a_short_one_a_triangle() -> None:
    assert move_time_s(100.0, 50.0, 1000.0) == pytest.approx(0.05 + 97.5 / 50 + 0.05)
    assert move_time_s(2.5, 50.0, 1000.0) == pytest.approx(0.1)
    assert move_time_s(0.1, 50.0, 1000.0) == pytest.approx(2 * math.sqrt(0.1 / 1000.0))
    assert move_time_s(0.0, 50.0, 1000.0) == 0.0


def test_the_head_stops_at_corners_and_nowhere_else() -> None:
    straight = Contour.polyline(np.array([[0, 0], [60, 0], [100, 0.0]]), closed=False)
    corner = Contour.polyline(np.array([[0, 0], [60, 0], [60, 40.0]]), closed=False)
    assert contour_time_s(straight, 50.0, 1000.0) == pytest.approx(move_time_s(100, 50, 1000))
    expected = move_time_s(60, 50, 1000) + move_time_s(40, 50, 1000)
    assert contour_time_s(corner, 50.0, 1000.0) == pytest.approx(expected)


def test_a_tight_arc_is_slow_and_a_wide_one_is_not(segment_of: Callable[..., Segment]) -> None:
    tight = Contour.from_segments([segment_of((0.0, 0.0), 0.9, 0.0, 180.0)], closed=False)
    wide = Contour.from_segments([segment_of((0.0, 0.0), 90.0, 0.0, 180.0)], closed=False)
    slow = math.sqrt(1000.0 * 0.9)
    expected = move_time_s(math.pi * 0.9, slow, 1000.0)
    assert contour_time_s(tight, 50.0, 1000.0) == pytest.approx(expected)
    expected = move_time_s(math.pi * 90.0, 50.0, 1000.0)
    assert contour_time_s(wide, 50.0, 1000.0) == pytest.approx(expected)


def test_passes_travel_and_order_count(profile: LaserProfile) -> None:
    first = Contour.polyline(np.array([[30.0, 40.0], [130.0, 40.0]]), closed=False)
    second = Contour.polyline(np.array([[130.0, 340.0], [130.0, 40.0]]), closed=False)
    paths = (
        LaserPath(operation=Operation.CUT, contour=second),
        LaserPath(operation=Operation.WELDCUT, contour=first),
        LaserPath(operation=Operation.REG, contour=second),
    )
    time = machine_time(
        Job(name="t", sheet_width_mm=400, sheet_height_mm=400, paths=paths), profile
    )
    assert list(time.work_s) == [Operation.WELDCUT, Operation.CUT]
    assert time.work_s[Operation.WELDCUT] == pytest.approx(2 * move_time_s(100, 100, 1000))
    assert time.work_s[Operation.CUT] == pytest.approx(2 * move_time_s(300, 100, 1000))
    # From the corner, back for the second pass, over to the cut, and back for its second pass.
    hops = (50.0, 100.0, 300.0, 300.0)
    assert time.travel_s == pytest.approx(sum(move_time_s(hop, 500, 1000) for hop in hops))
    assert time.total_s == pytest.approx(sum(time.work_s.values()) + time.travel_s)


def test_an_operation_that_the_recipe_lacks_is_an_error(job: Job, profile: LaserProfile) -> None:
    without = dict(profile.recipe.by_operation)
    del without["weld"]
    poorer = replace(profile, recipe=profile.recipe.changed(operations=without))
    with pytest.raises(BadInputError, match="weld"):
        machine_time(job, poorer)


def test_times_agree_with_a_step_by_step_integration(segment_of: Callable[..., Segment]) -> None:
    # Speeds against path length on a fine grid, by brute force: v dv = a ds both ways.
    arc = segment_of((8.0, 2.0), 2.0, -90.0, 60.0)
    lead = Segment(start_mm=(0.0, 0.0), end_mm=arc.start_mm)
    heading = arc.direction_rad(at_end=True)
    far = arc.end_mm[0] + 5 * math.cos(heading), arc.end_mm[1] + 5 * math.sin(heading)
    path = Contour.from_segments(
        [lead, arc, Segment(start_mm=arc.end_mm, end_mm=far)], closed=False
    )
    step, accel, top = 1e-4, 2000.0, 120.0
    caps = np.concatenate(
        [
            np.full(round(s.length_mm / step), min(top, math.sqrt(accel * s.radius_mm)))
            for s in path.segments
        ]
    )
    for order in (1, -1):
        square, run = 0.0, caps[::order]
        for at, cap in enumerate(run):
            square = min(square + 2 * accel * step, cap**2)
            run[at] = math.sqrt(square)
    assert contour_time_s(path, top, accel) == pytest.approx(step * np.sum(1 / caps), rel=2e-3)


def test_what_a_sealer_does_takes_no_laser_time(job: Job, profile: LaserProfile) -> None:
    cut = profile.settings("cut")
    sealer = Sealer(temperature_c=cut.spot_mm, dwell_s=cut.spot_mm, seam_width_mm=cut.spot_mm)
    operations = profile.recipe.operations.changed(weld=None)
    sealed = replace(profile, recipe=profile.recipe.changed(operations=operations, sealer=sealer))
    assert Operation.WELD in machine_time(job, profile).work_s
    assert Operation.WELD not in machine_time(job, sealed).work_s
