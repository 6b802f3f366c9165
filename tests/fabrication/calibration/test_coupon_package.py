import csv
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.fabrication.calibration.coupon_package import (
    CouponSet,
    coupon_files,
    coupon_readme,
    make_coupons,
)
from vinefab.fabrication.calibration.coupons import (
    LADDER_MM,
    coupon_pieces,
    coupon_sheets,
    energies_mj_mm,
    energy_matrix,
    joint_pieces,
    ladder_designs,
    lap_pieces,
)
from vinefab.fabrication.job.passes import weldcut_offset_mm
from vinefab.model.finding import CheckReport
from vinefab.model.job import Operation
from vinefab.model.laser import read_profile
from vinefab.model.outline import Part

RECIPE = "co2_60w__stretchlon_200"
LASERED = [RECIPE, "co2_40w__stretchlon_200", "co2_80w__stretchlon_200"]


@pytest.fixture(scope="module")
def coupons():
    return make_coupons(read_profile(RECIPE))


@pytest.fixture(scope="module")
def files(coupons):
    return coupon_files(coupons)


def area(path):
    return shapely.Polygon(path.contour.flattened_mm(1e-3))


def test_every_coupon_keeps_the_rules_and_every_file_is_read_back(coupons):
    assert coupons.report.findings == ()
    assert {run.rule for run in coupons.report.run} >= {"VF-T02", "VF-W04", "VF-L01", "VF-X01"}
    assert [job.name for job in coupons.jobs] == [
        "coupons",
        "joints",
        "matrix_focus_00",
        "matrix_focus_03",
        "matrix_focus_06",
        "matrix_focus_10",
    ]


@pytest.mark.parametrize("make", [coupon_pieces, joint_pieces])
@pytest.mark.parametrize("name", LASERED)
def test_pieces_lie_on_the_bed_and_clear_of_each_other(name, make):
    profile = read_profile(name)
    pieces = make(profile)
    sheets = coupon_sheets(pieces, profile)
    machine = profile.machine
    bed = shapely.box(0, 0, machine.bed_width_mm.value, machine.bed_height_mm.value)
    count = 0
    for sheet in sheets:
        bodies = [area(path) for path in sheet.along(Operation.WELDCUT) if len(path.contour) > 2]
        tree = shapely.STRtree(bodies)
        pairs = tree.query(bodies, predicate="dwithin", distance=5.0)
        assert (pairs[0] == pairs[1]).all()
        boxes = np.array([path.contour.box_mm for path in sheet.paths])
        assert bed.buffer(-4.9).contains(shapely.union_all(shapely.box(*boxes.T)))
        count += len(sheet.paths)
    assert count == sum(len(piece.paths) for piece in pieces)


def test_balloons_are_20_by_60_mm_within_the_seam(coupons):
    offset = coupons.sheets[0].facts["weldcut_offset_mm"]
    balloons = [
        area(path).buffer(-offset)
        for path in coupons.sheets[0].along(Operation.WELDCUT)
        if "BURST" in path.label
    ]
    assert len(balloons) == 3
    for balloon in balloons:
        x0, y0, x1, y1 = balloon.bounds
        assert y1 - y0 == pytest.approx(20.0, abs=0.01)
        # 60 mm of balloon and 25 mm of port, whose open end the erosion shortens by the offset.
        assert x1 - x0 == pytest.approx(85.0 - offset, abs=0.02)
        # A cut through the port is 6 mm wide, one through the balloon 20 mm.
        for x, width in ((x0 + 5.0, 6.0), (x1 - 30.0, 20.0)):
            line = shapely.LineString([(x, y0 - 1), (x, y1 + 1)])
            assert balloon.intersection(line).length == pytest.approx(width, abs=0.01)


def parts_of_laps(profile):
    """Return the lumens of plug and socket of every lap coupon, by its name, from its paths."""
    found = {}
    for piece in lap_pieces(profile):
        sealed = [path for path in piece.paths if path.operation is Operation.WELDCUT]
        points = np.concatenate([path.contour.flattened_mm(1e-3) for path in sealed])
        outline = shapely.Polygon(points)
        found.setdefault(piece.name[:-1], []).append((piece, outline))
    return found


@pytest.mark.parametrize("name", LASERED)
def test_the_socket_of_a_lap_coupon_goes_over_its_plug_with_the_ease(name):
    profile = read_profile(name)
    offset = weldcut_offset_mm(profile)
    kerf = profile.settings("weldcut").kerf_mm.value
    laps = parts_of_laps(profile)
    assert sorted(laps) == [f"LAP-{w}-{k}" for w in (10, 20) for k in (1, 2, 3)]
    for lap, ((socket, inner), (plug, outer)) in laps.items():
        width = float(lap.split("-")[1])
        assert (socket.name[-1], plug.name[-1]) == ("A", "B")
        # Where the tube is as wide as designed: 30 mm before the socket's rim, 30 mm into B, and at
        # the open end, through which the whole tube is turned.
        rim, x = inner.bounds[2], outer.bounds[0]
        for body, at in ((inner, rim - 30.0), (outer, x + 30.0), (inner, inner.bounds[0] + 1.0)):
            assert across(body, at) == pytest.approx(width + 2 * offset, abs=1e-3)
        # Half a kerf of the path is removed on each side of the plug's film.
        film = across(outer, x + 1.0) - kerf
        lumen = across(inner, rim - 1.0) - 2 * offset
        assert lumen - film == pytest.approx(1.0, abs=1e-3)
        assert across(inner, rim - 14.9) - 2 * offset == pytest.approx(lumen, abs=1e-3)
        # Joined, the plug ends 15 mm inside the socket, as the ticks beside it say.
        ticks = [path for path in plug.paths if path.label.startswith("depth")]
        assert [path.contour.points_mm[0][0] for path in ticks] == pytest.approx([x + 15.0] * 2)


def across(outline, x):
    _, low, _, high = outline.bounds
    return outline.intersection(shapely.LineString([(x, low - 1), (x, high + 1)])).length


def test_a_lap_coupon_is_open_at_tube_plug_and_socket_and_its_film_is_cut_free(coupons):
    for piece in lap_pieces(coupons.profile):
        cuts = [path for path in piece.paths if path.operation is Operation.CUT]
        seals = [path for path in piece.paths if path.operation is Operation.WELDCUT]
        is_tube = piece.name.endswith("A")
        assert (len(cuts), len(seals)) == ((2, 2) if is_tube else (1, 1))


@pytest.mark.thorough
def test_films_that_no_laser_welds_have_lap_coupons_too():
    coupons = make_coupons(read_profile("co2_60w__tpu_nylon_70d"))
    assert coupons.report.findings == ()
    labels = {path.label for job in coupons.sheets for path in job.along(Operation.WELD)}
    assert {"seam of LAP-20-3A", "seam of LAP-20-3B"} <= labels


def test_the_instructions_say_how_laps_are_bonded_and_where_their_pressure_goes(files):
    text = " ".join(files["README.txt"].decode().split())
    assert "a band of 5 mm (assumed), impulse-sealed around the lap" in text
    assert "15 mm deep" in text
    assert text.index("LAP, joining") < text.index("LAP, turning") < text.index("LAP, bursting")
    lines = files["results.csv"].decode().splitlines()
    rows = list(csv.DictReader(line for line in lines if line[0] != "#"))
    bursts = [row["note"] for row in rows if row["measure"] == "lap_burst"]
    bore = [row["note"] for row in rows if row["measure"] == "lap_survived"]
    assert len(bursts) == len(bore) == 6
    assert [note.split()[0] for note in bursts] == [note.split()[0] for note in bore]
    profile = read_profile(RECIPE)
    unbonded = replace(profile, recipe=profile.recipe.changed(lap=None))
    report = CheckReport(design="", recipe="", run=(), skipped=(), findings=())
    none = CouponSet(
        profile=unbonded, sheets=(), matrix=None, grid=None, left_out=(), report=report, laser={}
    )
    words = " ".join(coupon_readme(none).split())
    assert "the recipe has no [lap]" in words


def test_the_ladder_has_every_width(coupons):
    offset = coupons.sheets[0].facts["weldcut_offset_mm"]
    found = sorted(
        round(path.contour.box_mm[3] - path.contour.box_mm[1] - 2 * offset, 6)
        for path in coupons.sheets[0].along(Operation.WELDCUT)
        if re.search(r" W\d", path.label)
    )
    assert found == list(LADDER_MM)
    assert [design.build.widths_mm[0] for design in ladder_designs()] == list(LADDER_MM)


def test_the_ladder_of_lengths_has_every_length_as_a_robot_is_drawn(coupons, files):
    offset = coupons.sheets[0].facts["weldcut_offset_mm"]
    found = sorted(
        round(path.contour.box_mm[2] - path.contour.box_mm[0] - offset, 6)
        for path in coupons.sheets[0].along(Operation.WELDCUT)
        if re.search(r" L\d", path.label)
    )
    assert found == [40.0, 40.0, 160.0, 280.0, 280.0]
    lines = files["results.csv"].decode().splitlines()
    rows = csv.DictReader(line for line in lines if line[0] != "#")
    notes = [row for row in rows if row["measure"] == "length"]
    assert [float(row["setting"]) for row in notes] == found
    for row in notes:
        assert any(row["note"].split()[-1] in p.label for p in coupons.sheets[0].paths)


def test_joint_coupons_are_cut_with_the_flat_angles_of_their_names(coupons):
    (sheet,) = (job for job in coupons.sheets if job.name == "joints")
    bodies = {path.label.split()[-1]: path.contour for path in sheet.along(Operation.WELDCUT)}
    assert len(bodies) == 10
    for name, body in bodies.items():
        kind, angle, width = name.split("-")
        turns = set()
        for segment in body.segments:
            along = np.subtract(segment.end_mm, segment.start_mm)
            is_side = segment.bulge == 0.0 and segment.part is Part.SIDE
            if is_side and np.hypot(*along) > 0.5 * float(width[1:]):
                turns.add(round(math.degrees(math.atan2(along[1], along[0]))) % 180)
        wanted = {60} if kind == "ELBOW" else {int(angle) // 2, 180 - int(angle) // 2}
        assert turns - {0} == wanted, name


def test_crotches_have_three_fillets_and_squares_are_50_mm(coupons):
    paths = coupons.sheets[0].along(Operation.WELDCUT)
    offset = coupons.sheets[0].facts["weldcut_offset_mm"]
    radii = [
        min(s.radius_mm for s in path.contour.segments if s.bulge < 0)
        for path in paths
        if "CROTCH" in path.label
    ]
    # An outline that runs outside the lumen has fillets smaller by the offset.
    assert sorted(radii) == pytest.approx([2.0 - offset, 4.0 - offset, 8.0 - offset])
    squares = [p for p in coupons.sheets[0].paths if p.label.startswith("KERF")]
    assert [path.operation for path in squares] == [Operation.WELDCUT, Operation.CUT]
    for path in squares:
        x0, y0, x1, y1 = path.contour.box_mm
        assert (x1 - x0, y1 - y0) == pytest.approx((50.0, 50.0))


def test_the_matrix_is_even_in_the_logarithm_and_gives_the_energy_it_says():
    steps = np.diff(np.log(energies_mj_mm()))
    assert np.allclose(steps, math.log(50.0) / 7)
    for name in LASERED:
        profile = read_profile(name)
        matrix = energy_matrix(profile)
        machine = profile.machine
        drawn = (*matrix.out_of_reach_mj_mm, *matrix.energies_mj_mm)
        assert drawn == energies_mj_mm()
        assert len(matrix.energies_mj_mm) >= 5
        for job, focus in zip(matrix.jobs, (0.0, 3.0, 6.0, 10.0), strict=True):
            lines = [path for path in job.paths if path.variant]
            assert len(lines) == len(matrix.energies_mj_mm)
            for path, energy in zip(lines, matrix.energies_mj_mm, strict=True):
                used = path.settings
                power_w = machine.power_w.value * used.power_percent.value / 100.0
                assert 1000.0 * power_w / used.speed_mm_s.value == pytest.approx(energy)
                assert used.focus_offset_mm.value == focus
                # Up to speed within the 30 mm before the zone, at the machine's acceleration.
                ramp = used.speed_mm_s.value**2 / (2 * machine.acceleration_mm_s2.value)
                assert ramp <= 30.0
                assert used.speed_mm_s.value <= machine.speed_max_mm_s.value


def test_without_a_least_power_the_matrix_runs_at_the_recipes_power():
    profile = read_profile(RECIPE)
    none = profile.settings(Operation.WELDCUT).min_power_percent.changed(value=0.0)
    operations = profile.recipe.operations
    operations = operations.changed(weldcut=operations.weldcut.changed(min_power_percent=none))
    profile = replace(profile, recipe=profile.recipe.changed(operations=operations))
    settings = profile.settings(Operation.WELDCUT)
    matrix = energy_matrix(profile)
    lines = [path.settings for job in matrix.jobs for path in job.along(Operation.WELDCUT)]
    assert lines
    assert {line.power_percent.value for line in lines} == {settings.power_percent.value}
    assert all(line.speed_mm_s.value > 0.0 for line in lines)
    drawn = {round(line.line_energy_mj_mm(profile.machine), 6) for line in lines}
    assert drawn == {round(energy, 6) for energy in matrix.energies_mj_mm}


def test_matrix_files_have_a_layer_and_settings_per_line(coupons, files):
    root = ET.fromstring(files["matrix_focus_06.lbrn2"])  # noqa: S314
    cuts = {c.find("name").get("Value"): c for c in root.findall("CutSetting")}
    lines = [name for name in cuts if "WELDCUT" in name]
    assert len(lines) == len(coupons.matrix.energies_mj_mm)
    speeds = [float(cuts[name].find("speed").get("Value")) for name in lines]
    assert speeds == sorted(speeds, reverse=True)
    svg = files["matrix_focus_06.svg"].decode()
    assert all(f'label="{name}"' in svg for name in lines)


def test_the_folder_is_complete(files):
    text = files["README.txt"].decode()
    assert "5.0, 8.7 mJ/mm" in text
    assert "vinefab calibrate" in text
    rows = [line for line in files["results.csv"].decode().splitlines() if line[0] != "#"]
    measures = {row["measure"] for row in csv.DictReader(rows)}
    assert measures >= {"kerf_piece", "seam", "width", "burst", "peel", "growth", "matrix"}


def test_a_piece_larger_than_the_bed_is_refused():
    profile = read_profile(RECIPE)
    pieces = coupon_pieces(profile)
    small = profile.machine.bed_width_mm.changed(value=60.0)
    machine = profile.machine.changed(bed_width_mm=small, bed_height_mm=small)
    cramped = replace(profile, machine=machine)
    with pytest.raises(BadInputError, match="and 50 x 50 mm are usable"):
        coupon_sheets(pieces, cramped)
