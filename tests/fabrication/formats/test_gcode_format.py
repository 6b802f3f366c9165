"""G-code: read back like every format, and looked at by another reader, written here."""

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely

from vinefab.fabrication.formats.gcode_format import GCODE, driven_paths, run_past_start
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, file_problems
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.model.design import Build, Design, Level, default_fillets_mm
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.outline import Contour

RECIPES = ("hot_tip_220__stretchlon_200", "hot_tip_220_knife__stretchlon_200")


def fork(scale: float = 1.0) -> Design:
    widths = (30.0, 18.0)
    build = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths), tail_mm=40.0 * scale)
    level = Level(branches=2, length_mm=60.0 * scale, angle_deg=70.0)
    return Design(name="fork", trunk_length_mm=50.0 * scale, levels=(level,), build=build)


@cache
def spec_of(recipe: str, operation: Operation) -> LaserFileSpec:
    profile = read_profile(recipe)
    job = laser_job(fork(), profile)
    return LaserFileSpec(job=replace(job, paths=job.along(operation)), profile=profile)


SPECS = [(RECIPES[0], Operation.WELD), (RECIPES[1], Operation.CUT)]


def problems(written: LaserFileSpec, meant: LaserFileSpec) -> str:
    return "; ".join(file_problems(GCODE, GCODE.write(written).encode(), meant))


def moves(text: str) -> list[tuple[str, dict[str, float]]]:
    """Return every command as another reader sees it: comments away, words by letter."""
    found = []
    for line in text.splitlines():
        words = re.findall(r"([A-Z])(-?[\d.]+)", line.split(";")[0])
        if words:
            found.append(("".join(words[0]), {key: float(value) for key, value in words[1:]}))
    return found


def drawn_mm(text: str, over_mm: float) -> list[np.ndarray]:
    """Return the polylines along which the tool is lowered, arcs in chords of 0.002 mm."""
    x = y = math.nan
    z, lines = math.inf, []
    for name, words in moves(text):
        if name not in ("G0", "G1", "G2", "G3"):
            continue
        to_x, to_y, to_z = words.get("X", x), words.get("Y", y), words.get("Z", z)
        if to_z < over_mm <= z:
            lines.append([(x, y)])
        elif to_z < over_mm and (to_x, to_y) != (x, y):
            if name in ("G2", "G3"):
                cx, cy = x + words["I"], y + words["J"]
                radius = math.hypot(words["I"], words["J"])
                assert math.hypot(to_x - cx, to_y - cy) == pytest.approx(radius, abs=1e-3)
                first, last = math.atan2(y - cy, x - cx), math.atan2(to_y - cy, to_x - cx)
                turn = (last - first) % math.tau if name == "G3" else -((first - last) % math.tau)
                count = 1 + int(abs(turn) * math.sqrt(radius / 0.016))
                angles = first + turn * np.arange(1, count + 1) / count
                lines[-1] += [
                    (cx + radius * math.cos(a), cy + radius * math.sin(a)) for a in angles
                ]
            lines[-1].append((to_x, to_y))
        x, y, z = to_x, to_y, to_z
    return [np.array(line) for line in lines]


@pytest.mark.parametrize(("recipe", "operation"), SPECS)
def test_what_is_written_is_read_back(recipe: str, operation: Operation) -> None:
    spec = spec_of(recipe, operation)
    assert problems(spec, spec) == ""
    assert GCODE.write(spec) == GCODE.write(spec)


@pytest.mark.parametrize(("recipe", "operation"), SPECS)
def test_a_path_moved_by_five_tolerances_or_left_out_is_found(
    recipe: str, operation: Operation
) -> None:
    meant = spec_of(recipe, operation)
    (path,) = meant.job.paths
    for shift in ((5.0 * GCODE.tolerance_mm, 0.0), (0.0, -5.0 * GCODE.tolerance_mm)):
        moved = replace(path, contour=path.contour.moved(0.0, *shift))
        written = replace(meant, job=replace(meant.job, paths=(moved,)))
        assert "mm away" in problems(written, meant)
    twice = replace(meant, job=replace(meant.job, paths=(path, path)))
    assert "paths, not 1" in problems(twice, meant)
    assert "1 path, not 2" in problems(meant, twice)


def hotter(profile: LaserProfile, **values: float) -> LaserProfile:
    tip = profile.recipe.hot_tip
    assert tip is not None
    changed = {key: getattr(tip, key).changed(value=value) for key, value in values.items()}
    return replace(profile, recipe=profile.recipe.changed(hot_tip=tip.changed(**changed)))


@pytest.mark.parametrize(
    ("key", "value", "name"),
    [
        ("seal_temperature_c", 190.0, "celsius"),
        ("seal_speed_mm_s", 6.0, "feed_mm_min"),
        ("touch_z_mm", -0.2, "depths_mm"),
        ("dwell_s", 0.4, "dwell_s"),
    ],
)
def test_another_setting_is_found(key: str, value: float, name: str) -> None:
    meant = spec_of(*SPECS[0])
    assert meant.profile is not None
    other = replace(meant, profile=hotter(meant.profile, **{key: value}))
    assert name in problems(other, meant)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("G90 ; absolute", "G91", "no G21 G90"),
        ("F300", "E1 F300", "extrudes"),
        ("G0 X", "G0 X9", "off the bed"),
        ("M109", "M666", "a command M666"),
    ],
)
def test_what_a_machine_must_never_do_is_found(before: str, after: str, words: str) -> None:
    spec = spec_of(*SPECS[0])
    text = GCODE.write(spec).replace(before, after, 1)
    assert words in "; ".join(file_problems(GCODE, text.encode(), spec))


def test_a_hot_tip_heats_before_and_cools_after_and_never_extrudes() -> None:
    spec = spec_of(*SPECS[0])
    text = GCODE.write(spec)
    commands = moves(text)
    names = [name for name, _ in commands]
    assert names[:2] == ["G21", "G90"]
    assert not any("E" in words for _, words in commands)
    lowered = next(at for at, (_, words) in enumerate(commands) if words.get("Z", 1.0) < 0.0)
    assert ("M109", {"S": 180.0}) in commands[:lowered]
    assert ("M190", {"S": 45.0}) in commands[:lowered]
    assert names[lowered + 1] == "G4"
    last = max(at for at, (name, _) in enumerate(commands) if name in ("G1", "G2", "G3"))
    assert commands[last + 1][1]["Z"] > 0.0
    assert ("M104", {"S": 0.0}) in commands[last:]
    assert ("M140", {"S": 0.0}) in commands[last:]
    assert re.search(r"; about \d+\.\d min on the paths", text)
    assert "assumed, nothing here was tried on a machine: coupons first" in text


def test_a_seam_is_one_line_open_at_the_mouth_as_another_reader_sees_it() -> None:
    spec = spec_of(*SPECS[0])
    (line,) = drawn_mm(GCODE.write(spec), 1.0)
    (path,) = spec.job.paths
    wanted = shapely.LineString(path.contour.flattened_mm(0.001))
    assert shapely.hausdorff_distance(shapely.LineString(line), wanted) < 0.005
    mouth_mm = math.dist(line[0], line[-1])
    assert mouth_mm == pytest.approx(31.0, abs=0.01)  # lumen of 30 mm, half a seam on each side
    assert line.min() > 0.0
    assert line.max() < 220.0


def test_firmware_without_arcs_gets_chords_within_0_02_mm() -> None:
    spec = spec_of(*SPECS[0])
    assert spec.profile is not None
    machine = spec.profile.machine.changed(arcs=False)
    chords = replace(spec, profile=replace(spec.profile, machine=machine))
    text = GCODE.write(chords)
    assert problems(chords, chords) == ""
    assert not {"G2", "G3"} & {name for name, _ in moves(text)}
    (line,) = drawn_mm(text, 1.0)
    wanted = shapely.LineString(spec.job.paths[0].contour.flattened_mm(0.0005))
    assert shapely.hausdorff_distance(shapely.LineString(line), wanted) < 0.0205


def test_two_passes_run_twice_over_a_path_and_are_one_path() -> None:
    spec = spec_of(*SPECS[0])
    assert spec.profile is not None
    tip = spec.profile.recipe.hot_tip
    assert tip is not None
    recipe = spec.profile.recipe.changed(hot_tip=tip.changed(passes=2))
    twice = replace(spec, profile=replace(spec.profile, recipe=recipe))
    assert problems(twice, twice) == ""
    assert len(drawn_mm(GCODE.write(twice), 1.0)) == 2
    assert "depths_mm" in problems(spec, twice)


def test_a_closed_path_runs_over_its_start() -> None:
    square = np.array([(0.0, 0.0), (30.0, 0.0), (30.0, 30.0), (0.0, 30.0)])
    closed = Contour.polyline(square, closed=True)
    assert run_past_start(closed, 5.0).length_mm == pytest.approx(125.0)
    assert run_past_start(closed, 40.0).points_mm[-1].tolist() == pytest.approx([30.0, 10.0])
    round_path = replace(closed, bulges=np.full(4, math.tan(math.pi / 8.0)))
    over = run_past_start(round_path, 5.0)
    assert over.length_mm == pytest.approx(round_path.length_mm + 5.0)
    middle = np.array([15.0, 15.0])
    radii = np.hypot(*(over.flattened_mm() - middle).T)
    assert np.ptp(radii) < 1e-9


def test_a_start_of_the_users_own_takes_the_place_of_homing() -> None:
    spec = spec_of(*SPECS[0])
    assert spec.profile is not None
    machine = spec.profile.machine.changed(start_gcode="M141 S35\nG28 X Y", end_gcode="M300 S440")
    own = replace(spec, profile=replace(spec.profile, machine=machine))
    assert problems(own, own) == ""
    assert "M141 S35" in GCODE.write(own)
    priming = spec.profile.machine.changed(start_gcode="G28\nG1 X10 E5")
    primed = replace(spec, profile=replace(spec.profile, machine=priming))
    assert "extrudes" in problems(primed, primed)


def test_only_what_its_tool_runs_is_in_a_file() -> None:
    profile = read_profile(RECIPES[1])
    job = laser_job(fork(), profile)
    assert {path.operation for path in job.paths} == {Operation.WELD, Operation.CUT}
    driven = driven_paths(LaserFileSpec(job=job, profile=profile))
    assert {styled.path.operation for styled in driven} == {Operation.WELD}
