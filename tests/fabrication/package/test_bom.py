import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.plain_text import OWN_MARK
from vinefab.fabrication.job.timing import move_time_s
from vinefab.fabrication.package.bom import bill_of_materials, body_area_mm2, bom_text
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour
from vinefab.model.quantity import Quantity, Standing

FINGER_MM2 = 100.0 * 40.0 + math.pi * 20.0**2 / 2


def value(job: Job, profile: LaserProfile, item: str) -> float:
    return {line.item: line.value for line in bill_of_materials(job, profile)}[item]


def test_area_and_mass_are_those_of_the_robot_and_not_of_the_sheet(
    job: Job, profile: LaserProfile
) -> None:
    assert body_area_mm2(job) == pytest.approx(FINGER_MM2)
    assert value(job, profile, "robot area") == pytest.approx(FINGER_MM2 / 100.0)
    # 2 plies of 0.05 mm at 1000 kg/m3 weigh 0.1 kg/m2.
    assert value(job, profile, "robot film mass") == pytest.approx(FINGER_MM2 * 1e-6 * 0.1 * 1000)


def test_a_robot_sealed_and_cut_apart_is_measured_along_its_seam(job: Job) -> None:
    paths = tuple(path for path in job.paths if path.operation is not Operation.WELDCUT)
    apart = Job(name="apart", sheet_width_mm=150, sheet_height_mm=80, paths=paths)
    circle, nearly = apart.along(Operation.WELD)
    expected = math.pi * 25.0 + abs(nearly.contour.signed_area_mm2)
    assert circle.contour.arc_count == 2
    assert body_area_mm2(apart) == pytest.approx(expected)


def test_lengths_are_by_what_the_path_does(job: Job, profile: LaserProfile) -> None:
    weld, weldcut, cut = (
        job.length_mm(op) for op in (Operation.WELD, Operation.WELDCUT, Operation.CUT)
    )
    assert value(job, profile, "weld length") == pytest.approx(weld + weldcut)
    assert value(job, profile, "cut length") == pytest.approx(weldcut + cut)


def test_the_film_is_what_the_paths_take_and_not_the_bed(job: Job, profile: LaserProfile) -> None:
    large = Job(name="large", sheet_width_mm=600, sheet_height_mm=400, paths=job.paths)
    # The paths take 140 x 70 mm; the machine leaves a rim of 5 mm.
    assert value(large, profile, "film width") == pytest.approx(150.0)
    assert value(large, profile, "film height") == pytest.approx(80.0)
    assert value(large, profile, "film area, all plies") == pytest.approx(2 * 15.0 * 8.0)


def test_film_off_the_roll_is_the_shorter_way(job: Job, profile: LaserProfile) -> None:
    # Two pieces of 150 x 80 mm lie side by side on a roll of 1000 mm, the long way across.
    assert value(job, profile, "film off the roll") == pytest.approx(80.0)
    for width, length in ((200.0, 150.0), (149.0, 2 * 150.0), (79.0, 2 * 150.0)):
        roll = profile.material.roll_width_mm.changed(value=width)
        narrow = replace(profile, material=profile.material.changed(roll_width_mm=roll))
        assert value(job, narrow, "film off the roll") == pytest.approx(length)


def test_standing_falls_to_assumed_with_one_assumed_input(job: Job, profile: LaserProfile) -> None:
    before = {line.item: line.standing for line in bill_of_materials(job, profile)}
    assert set(before.values()) == {Standing.COMPUTED}
    guess = Quantity(value=1000.0, standing=Standing.ASSUMED, source="guess")
    material = profile.material.changed(density_kg_m3=guess)
    guessed = replace(profile, material=material)
    after = {line.item: line.standing for line in bill_of_materials(job, guessed)}
    assert after.pop("robot film mass") is Standing.ASSUMED
    assert set(after.values()) == {Standing.COMPUTED}
    machine = profile.machine.changed(acceleration_mm_s2=guess)
    slow = {line.item: line for line in bill_of_materials(job, replace(profile, machine=machine))}
    assert slow["machine time, total"].standing is Standing.ASSUMED


def test_the_csv_holds_every_line_with_unit_and_standing(job: Job, profile: LaserProfile) -> None:
    text = bom_text(job, profile)
    assert OWN_MARK in text.encode()[-8192:]
    rows = list(csv.DictReader(io.StringIO(text)))
    lines = bill_of_materials(job, profile)
    assert [row["item"] for row in rows[:-2]] == [line.item for line in lines]
    assert (rows[-2]["item"], rows[-2]["value"], rows[-2]["unit"]) == (
        "files with paths",
        str(4 + 3 * 4),  # whole, and in three formats one for each operation
        "1",
    )
    for row, line in zip(rows, lines, strict=False):
        assert float(row["value"]) == pytest.approx(line.value, rel=1e-5)
        assert row["unit"] == line.unit
        assert row["standing"] in {"computed", "assumed"}
        assert row["basis"]


def straight(operation: Operation, x0: float, x1: float, y: float) -> LaserPath:
    contour = Contour.polyline(np.array([[x0, y], [x1, y]]), closed=False)
    return LaserPath(operation=operation, contour=contour)


def test_tiles_are_what_is_run_and_the_whole_is_what_is_made(profile: LaserProfile) -> None:
    """A seam of 400 mm in two tiles that overlap by 12 mm, and two marks: summed by hand."""
    whole = Job(
        name="whole",
        sheet_width_mm=420.0,
        sheet_height_mm=60.0,
        paths=(
            straight(Operation.MARK, 200.0, 208.0, 10.0),
            straight(Operation.WELDCUT, 10.0, 410.0, 30.0),
        ),
    )
    one = replace(
        whole,
        sheet_width_mm=250.0,
        paths=(
            straight(Operation.MARK, 200.0, 208.0, 10.0),
            straight(Operation.WELDCUT, 10.0, 216.0, 30.0),
        ),
    )
    two = replace(
        whole,
        sheet_width_mm=250.0,
        paths=(
            straight(Operation.WELDCUT, 34.0, 240.0, 30.0),
            straight(Operation.REG, 30.0, 38.0, 10.0),
        ),
    )
    tiled = replace(whole, tiles=(one, two))
    found = {line.item: line for line in bill_of_materials(tiled, profile)}
    assert found["tiles"].value == 2
    assert (found["film width"].value, found["film height"].value) == (420.0, 60.0)
    assert found["weld length"].value == pytest.approx(206.0 + 206.0)
    assert found["mark length"].value == pytest.approx(8.0)
    # The fixture's recipe runs everything at 100 mm/s in two passes, travels at 500 mm/s.
    work_s = 2 * 2 * move_time_s(206.0, 100.0, 1000.0)
    assert found["machine time, weldcut"].value == pytest.approx(work_s)
    hops = (
        *(math.hypot(200.0, 10.0), 8.0, math.hypot(198.0, 20.0), 206.0),
        *(math.hypot(34.0, 30.0), 206.0),
    )
    travel_s = sum(move_time_s(hop, 500.0, 1000.0) for hop in hops)
    assert found["machine time, travel"].value == pytest.approx(travel_s)
    mark_s = 2 * move_time_s(8.0, 100.0, 1000.0)
    assert found["machine time, total"].value == pytest.approx(work_s + travel_s + mark_s)
    assert "without the time to move and align" in found["machine time, total"].basis
