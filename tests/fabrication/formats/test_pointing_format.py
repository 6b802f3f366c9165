"""G-code that shows crosses: where the tip goes and waits, as another reader sees it."""

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from vinefab.core.errors import UnfitInputError, UnreadableFileError
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, file_problems, package_spec
from vinefab.fabrication.formats.laser_formats import LASER_FORMATS, planned_files
from vinefab.fabrication.formats.pointing_format import POINTING, read_pointing
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.model.design import Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import read_profile

RECIPES = ("hot_tip_220__stretchlon_200", "hot_tip_220_knife__stretchlon_200")


@cache
def specs(recipe: str) -> list[LaserFileSpec]:
    profile = read_profile(recipe)
    job = laser_job(Design.read("three_level_tree"), profile)
    return [package_spec(tile, profile) for tile in job.tiles]


def waits(text: str):
    """Return every wait: its words, where the tip stands, and the lowest place before it."""
    at, low, found = {"Z": math.inf}, math.inf, []
    for line in text.splitlines():
        code = line.partition(";")[0]
        at |= {letter: float(value) for letter, value in re.findall(r"([XYZ])(-?[\d.]+)", code)}
        if code.startswith(("G0", "G1")):
            low = min(low, at["Z"])
        if code.startswith("M0 "):
            found.append((code.removeprefix("M0 ").split(), (at["X"], at["Y"]), at["Z"]))
    return found, low


@pytest.mark.parametrize("recipe", RECIPES)
def test_the_tip_waits_over_every_cross_in_turn_and_never_touches_the_film(recipe: str) -> None:
    shown = 0
    for spec in specs(recipe):
        facts = spec.job.facts
        there = facts["targets_found_mm"] + facts["robot_targets_found_mm"]
        new = facts["targets_made_mm"] + facts["robot_targets_made_mm"]
        text = POINTING.write(spec)
        found, low = waits(text)
        kinds = [words[0] for words, *_ in found]
        assert kinds == ["align"] * len(there) + ["check"] * len(there) + ["draw"] * len(new)
        places = [*sorted(there), *sorted(there), *sorted(new)]
        stands = [
            *sorted(p for words, p, _ in found if words[0] == "align"),
            *sorted(p for words, p, _ in found if words[0] == "check"),
            *sorted(p for words, p, _ in found if words[0] == "draw"),
        ]
        assert np.array(stands) == pytest.approx(np.array(places), abs=1e-4)
        assert low == 1.0
        assert {height for *_, height in found} <= {1.0}
        # Nothing heats, extrudes or seals.
        codes = {line.split()[0] for line in text.splitlines() if line and line[0] != ";"}
        assert codes == {"G21", "G90", "G28", "M104", "G0", "G1", "M0", "M84"}
        assert "M104 S0" in text
        assert not re.search(r"\bE-?[\d.]", re.sub(";.*", "", text))
        shown += len(found)
    assert shown > 50


@pytest.mark.parametrize("recipe", RECIPES)
def test_what_is_written_is_read_back(recipe: str) -> None:
    for spec in specs(recipe):
        assert file_problems(POINTING, POINTING.write(spec).encode(), spec) == ()


def test_a_cross_that_is_moved_left_out_or_touched_is_found() -> None:
    spec = specs(RECIPES[0])[1]
    moved = [
        replace(path, contour=path.contour.moved(0.0, 0.005, 0.0))
        if path.operation is Operation.REG
        else path
        for path in spec.job.paths
    ]
    other = replace(spec, job=replace(spec.job, paths=tuple(moved)))
    assert "mm away" in "; ".join(file_problems(POINTING, POINTING.write(other).encode(), spec))
    text = POINTING.write(spec)
    fewer = re.sub(r";PATH 1 .*?;PATH END\n", "", text, flags=re.DOTALL)
    assert "not" in "; ".join(file_problems(POINTING, fewer.encode(), spec))
    pressed = text.replace("G0 Z1 ", "G0 Z-0.1 ", 1)
    assert "a move in the film" in "; ".join(file_problems(POINTING, pressed.encode(), spec))
    off = text.replace("G1 X", "G1 X9", 1)
    assert "off the bed" in "; ".join(file_problems(POINTING, off.encode(), spec))
    hot = text.replace("M104 S0", "M109 S180")
    assert "a command M109" in "; ".join(file_problems(POINTING, hot.encode(), spec))


def test_jobs_without_crosses_have_no_such_file() -> None:
    profile = read_profile(RECIPES[0])
    vine = Design.read("plain_vine").changed(trunk_length_mm=20.0)
    job = laser_job(vine.changed(build=vine.build.changed(tail_mm=100.0)), profile)
    assert job.tiles == ()
    spec = package_spec(job, profile)
    assert POINTING not in [file.kind for file in planned_files(spec)]
    assert LASER_FORMATS["gcode_point"] is POINTING
    with pytest.raises(UnfitInputError, match="no cross"):
        POINTING.write(spec)
    tile: Job = specs(RECIPES[0])[0].job
    laser = package_spec(tile, read_profile("co2_60w__stretchlon_200"))
    assert POINTING not in [file.kind for file in planned_files(laser)]


@pytest.mark.parametrize("text", ["", "G28", "; something else\nG28"])
def test_what_is_no_file_of_ours_is_refused(text: str) -> None:
    with pytest.raises(UnreadableFileError, match="not G-code of ours"):
        read_pointing(text)
