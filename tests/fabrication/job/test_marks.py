"""Marks: the font, labels and fold lines."""

import dataclasses
import string

import numpy as np
import pytest
import shapely

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.marks import region, short_name, text_strokes_mm, text_width_mm
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.package.bom import film_piece_mm
from vinefab.model.job import Operation


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
    points = np.concatenate(text_strokes_mm("HxH", 3.0))
    assert points.max(axis=0) == pytest.approx([text_width_mm("HXH", 3.0), 3.0])
    assert text_strokes_mm("\u00e9 ", 3.0) == []


@pytest.fixture
def marking(profile):
    """The profile with marks."""
    operations = {**profile.recipe.by_operation, "mark": profile.settings("cut")}
    recipe = profile.recipe.changed(operations=operations)
    return dataclasses.replace(profile, recipe=recipe)


def bed_of(profile, width_mm, height_mm):
    """The profile with a bed that has so much room within its margins."""
    width_mm, height_mm = width_mm + 20.0, height_mm + 20.0
    machine = profile.machine.changed(
        bed_width_mm=profile.machine.bed_width_mm.changed(value=width_mm),
        bed_height_mm=profile.machine.bed_height_mm.changed(value=height_mm),
    )
    return dataclasses.replace(profile, machine=machine)


SHORT = {"trunk": 100.0, "tail": 60.0}
WHAT = ("fold line", "label")
FULL_BED = [f"room only for the number in the label of plan, part {n} of 2" for n in (1, 2)]


@pytest.mark.parametrize(
    ("name", "room_mm", "copies", "left_out"),
    [
        ("plan", (580.0, 380.0), 1, []),
        ("caché", (580.0, 380.0), 1, ["no strokes for É in the label of caché"]),
        # 63 mm hold outline and fold line; 10.5 mm more are too little for three lines.
        ("plan", (190.0, 63.0), 1, ["no room for the label of plan"]),
        ("plan", (190.0, 46.0), 1, [f"no room for the {what} of plan" for what in WHAT]),
        ("plan", (190.0, 108.0), 2, FULL_BED),
    ],
)
def test_marks_without_room_are_named(make_plan, marking, name, room_mm, copies, left_out):
    vine = make_plan((40.0,), **SHORT).changed(name=name)
    job = laser_job(vine, bed_of(marking, *room_mm), SheetOptions(copies=copies))
    assert job.facts["fits_bed"] is True
    missed = job.facts.get("marks_left_out", [])
    assert [words for words in missed if copies == 1 or "label" in words] == left_out
    assert bool(labels(job)) != ("no room for the label of plan" in left_out)


def labels(job):
    return {path.label for path in job.paths if path.label.startswith("label")}


def test_a_letter_with_a_two_letter_capital_keeps_its_width(make_plan, marking):
    """A sharp s becomes SS: the box must hold both."""
    name = "ß" * 40
    job = laser_job(make_plan((40.0,)).changed(name=name), marking)
    strokes = [path.contour for path in job.paths if path.label.startswith("label")]
    body = shapely.Polygon(job.paths[-2].contour.flattened_mm())
    assert all(shapely.LineString(s.points_mm).distance(body) >= 3.0 for s in strokes)
    usable = shapely.box(10.0, 10.0, 590.0, 390.0)
    assert all(usable.covers(shapely.LineString(s.points_mm)) for s in strokes)


NESTED = {
    "many plain": ((40.0,), (), 100.0, 60.0, 6),
    "narrow": ((16.0,), (), 140.0, 40.0, 8),
    "trees": ((40.0, 24.0), ((3, 90.0, 1.6),), 100.0, 60.0, 3),
    "thin trees": ((24.0, 14.0, 9.0), ((2, 80.0, 1.4), (2, 60.0, 1.2)), 80.0, 50.0, 3),
}


def nested(make_plan, make_fan, marking, case):
    widths, fans, trunk, tail, copies = NESTED[case]
    levels = tuple(make_fan(count, length, np.degrees(angle)) for count, length, angle in fans)
    design = make_plan(widths, levels=levels, trunk=trunk, tail=tail)
    return laser_job(design, bed_of(marking, 600.0, 300.0), SheetOptions(copies=copies))


def bodies_of(job):
    """The area of each robot, by its number."""
    found = {}
    for path in job.along(Operation.WELDCUT):
        found[int(path.label.split("part ")[1].split()[0])] = region(path.contour)
    return found


def labels_of(job, word):
    """The lines of each label or leader, by the number of its robot."""
    found = {}
    for path in job.along(Operation.MARK):
        if path.label.startswith(word):
            number = int(path.label.split("part ")[1].split()[0])
            found.setdefault(number, []).append(path.contour.points_mm)
    return found


def nearest(shape, bodies):
    return min(bodies, key=lambda number: shape.distance(bodies[number]))


@pytest.mark.parametrize("case", NESTED)
def test_labels_of_nested_robots_lie_beside_their_own(make_plan, make_fan, marking, case):
    job = nested(make_plan, make_fan, marking, case)
    bodies, labels, leaders = bodies_of(job), labels_of(job, "label"), labels_of(job, "leader")
    assert len(bodies) > 1
    boxes = {
        number: shapely.box(*shapely.MultiLineString(lines).bounds)
        for number, lines in labels.items()
    }
    for number, box in boxes.items():
        if number in leaders:
            (line,) = leaders[number]
            assert box.distance(shapely.Point(line[0])) < 1.0
            assert nearest(shapely.Point(line[-1]), bodies) == number
            assert all(shapely.LineString(line).distance(b) > 3.0 for b in bodies.values())
        else:
            assert nearest(box, bodies) == number
            assert box.distance(bodies[number]) <= 41.0
        assert not any(box.intersects(body) for body in bodies.values())
    tree = shapely.STRtree(list(boxes.values()))
    assert len(tree.query(list(boxes.values()), "intersects")[0]) == len(boxes)
    said = " ".join(job.facts.get("marks_left_out", ()))
    for number in bodies.keys() - labels.keys():
        assert f"no room for the label of {job.name}, part {number} of" in said


def test_long_names_take_no_film(make_plan, make_fan, marking):
    def film_of(name):
        design = make_plan((40.0, 24.0), (6.0,), (make_fan(3, 150.0, 120.0),)).changed(name=name)
        recipe = marking.recipe.changed(name=name)
        job = laser_job(design, dataclasses.replace(marking, recipe=recipe))
        assert labels(job) == {f"label of {name}"}
        return film_piece_mm(job, marking)

    short = film_of("a" * 24)
    assert film_of("a" * 100) == short
    assert short_name(f"{'a' * 60}_1") != short_name(f"{'a' * 60}_2")
