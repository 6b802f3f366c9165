"""Marks: the font, labels and fold lines."""

import dataclasses
import string

import numpy as np
import pytest
import shapely

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.marks import text_strokes_mm, text_width_mm
from vinefab.fabrication.job.placement import SheetOptions


def test_every_letter_and_digit_has_strokes_of_its_own_inside_its_cell():
    seen = set()
    for letter in string.ascii_uppercase + string.digits + "-_.+/:=":
        strokes = text_strokes_mm(letter, 6.0)
        points = np.concatenate(strokes)
        assert points.min() >= 0.0
        assert points[:, 0].max() <= 4.0
        assert points[:, 1].max() <= 6.0
        for stroke in strokes:
            assert np.hypot(*np.diff(stroke, axis=0).T).min() >= 1.0
        seen.add(tuple(map(bytes, strokes)))
    assert len(seen) == 26 + 10 + 7


def test_text_is_as_wide_as_its_letters():
    points = np.concatenate(text_strokes_mm("HxH", 3.0))
    assert points.max(axis=0) == pytest.approx([text_width_mm("HXH", 3.0), 3.0])
    assert text_strokes_mm("\u00e9 ", 3.0) == []


@pytest.fixture
def marking(profile):
    """The profile with marks."""
    operations = {**profile.recipe.operations, "mark": profile.settings("cut")}
    recipe = dataclasses.replace(profile.recipe, operations=operations)
    return dataclasses.replace(profile, recipe=recipe)


def bed_of(profile, width_mm, height_mm):
    """The profile with a bed that has so much room within its margins."""
    width_mm, height_mm = width_mm + 20.0, height_mm + 20.0
    machine = dataclasses.replace(
        profile.machine,
        bed_width_mm=dataclasses.replace(profile.machine.bed_width_mm, value=width_mm),
        bed_height_mm=dataclasses.replace(profile.machine.bed_height_mm, value=height_mm),
    )
    return dataclasses.replace(profile, machine=machine)


def labels(job):
    return {path.label for path in job.paths if path.label.startswith("label")}


def test_where_all_has_room_nothing_is_said(make_plan, marking):
    job = laser_job(make_plan((40.0,)), marking)
    assert labels(job) == {"label of plan"}
    assert "marks_left_out" not in job.facts


def test_a_label_without_room_is_named(make_plan, marking):
    # 63 mm hold outline and fold line; beside that, 10.5 mm are too little for three lines.
    job = laser_job(make_plan((40.0,), trunk=100.0, tail=60.0), bed_of(marking, 190.0, 63.0))
    assert labels(job) == set()
    assert job.facts["marks_left_out"] == ["no room for the label of plan"]


def test_a_fold_line_without_room_is_named_too(make_plan, marking):
    job = laser_job(make_plan((40.0,), trunk=100.0, tail=60.0), bed_of(marking, 190.0, 46.0))
    assert job.facts["fits_bed"] is True
    assert job.facts["marks_left_out"][0] == "no room for the fold line of plan"


def test_robots_of_a_full_bed_are_named_by_their_numbers(make_plan, marking):
    vine = make_plan((40.0,), trunk=100.0, tail=60.0)
    job = laser_job(vine, bed_of(marking, 190.0, 108.0), SheetOptions(copies=2))
    assert job.facts["robots_placed"] == 2
    left_out = job.facts["marks_left_out"]
    assert [words for words in left_out if "label" in words] == [
        f"no room for the label of plan, part {number} of 2" for number in (1, 2)
    ]


def test_letters_that_the_font_lacks_are_named(make_plan, marking):
    job = laser_job(dataclasses.replace(make_plan((40.0,)), name="caché"), marking)
    assert job.facts["marks_left_out"] == ["no strokes for É in the label of caché"]


def test_a_letter_with_a_two_letter_capital_keeps_its_width(make_plan, marking):
    """A sharp s becomes SS: the box must hold both."""
    name = "ß" * 40
    job = laser_job(dataclasses.replace(make_plan((40.0,)), name=name), marking)
    strokes = [path.contour for path in job.paths if path.label.startswith("label")]
    body = shapely.Polygon(job.paths[-2].contour.flattened_mm())
    assert all(shapely.LineString(s.points_mm).distance(body) >= 3.0 for s in strokes)
    usable = shapely.box(10.0, 10.0, 590.0, 390.0)
    assert all(usable.covers(shapely.LineString(s.points_mm)) for s in strokes)
