import itertools
import os
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.pages.drawn import placed_texts, primitives_of, texts_of
from vinefab.fabrication.package import assembly_drawing as drawing
from vinefab.fabrication.package.assembly_drawing import (
    assembly_drawing,
    assembly_files,
    exploded_picture,
    mounting_drawing,
    piece_colours,
)
from vinefab.fabrication.package.piece_joining import joining_order
from vinefab.fabrication.package.prepare import least_rectangle_mm, pieces_section
from vinefab.model.design import PieceSettings
from vinefab.model.laser import read_profile
from vinefab.model.outline import Contour
from vinefab.outline.body_outline import flat_layout
from vinefab.pages.panel import ALERT, INK, Shape


@pytest.fixture(scope="module")
def recipe():
    return read_profile("co2_60w__stretchlon_200")


@pytest.fixture(scope="module")
def robot(make_plan, make_fan):
    fans = [make_fan(3, 220.0, 200.0), make_fan(3, 160.0, 140.0)]
    settings = PieceSettings(most=9, lap_mm=12.0)
    return make_plan((30.0, 20.0, 13.0), levels=fans, pieces=settings)


@pytest.fixture(scope="module")
def parts(cut_at, robot):
    return cut_at(robot, (1, 2, 3, 5, 8, 10), 12.0)


def test_every_piece_joint_and_step_is_on_the_page(robot, parts, recipe) -> None:
    partition, outlines = parts
    words = texts_of(assembly_drawing(robot, partition, outlines, recipe))
    joints = {sleeve.label for sleeve in partition.sleeves}
    for piece in partition.pieces:
        # Twice as a piece, apart and put together; beside plug and socket as a joint.
        assert words.count(piece.label) == (4 if piece.label in joints else 2)
    listed = [text for text in words if re.match(r"\d+\.  ", text)]
    for step, text in zip(joining_order(robot, partition), listed, strict=True):
        assert words.count(str(step.number)) >= 1
        assert text.startswith(f"{step.number}.  {step.sleeve.label} into {step.sleeve.inner}:")
        assert text.endswith("12 mm deep")
    page = " ".join(words)
    assert "millimetres" in page
    assert "lap 12 mm (assumed)" in page
    assert "band, all around, 5 mm (assumed)" in page
    assert "48 minutes (8 a joint, assumed)" in page
    assert "socket: inner piece" in page
    assert "the face that lies inside as cut is outside" in page


def test_turned_first_the_outer_piece_goes_over_and_the_faces_end_as_cut(
    cut_at, robot, recipe
) -> None:
    turned = robot.changed(build=robot.build.changed(mounting="turned"))
    partition, outlines = cut_at(turned, (1, 2), 12.0)
    page = " ".join(texts_of(assembly_drawing(turned, partition, outlines, recipe)))
    assert "B over A: plug and socket B" in page
    assert "socket: outer piece" in page
    assert "the face that lies outside as cut is outside again" in page
    assert "turned inside out" in page


def test_a_robot_in_one_piece_has_the_drawing_of_its_faces(robot, recipe) -> None:
    """Which face is which is told from the drawn lines: the outer line as deployed, by colour."""
    for mounting, outside in (("tail_inverted", ALERT), ("turned", INK)):
        turned = robot.changed(build=robot.build.changed(mounting=mounting))
        drawn = primitives_of(mounting_drawing(turned))
        shapes = [one for one in drawn if isinstance(one, Shape) and not one.closed]
        lines = [one for one in shapes if len(one.chains[0]) > 8]
        growing = sorted(lines, key=lambda line: line.chains[0][:, 0].max())[-2:]
        highest = min(growing, key=lambda line: line.chains[0][:, 1].min())
        assert highest.ink.line == outside
    assert list(assembly_files(turned, None, {}, recipe)) == ["assembly.svg", "assembly.pdf"]


def test_every_branch_has_its_length_and_width_beside_it(robot, parts, recipe) -> None:
    layout = flat_layout(robot)
    tail = f"tail {layout.tail_mm:g}"
    sizes = zip(layout.tree.length_mm.tolist(), layout.width_mm.tolist(), strict=True)
    wanted = sorted([*(f"{length:.1f} x {wide:.3g}" for length, wide in sizes), tail])
    for page in (mounting_drawing(robot), exploded_picture(robot, *parts, recipe)):
        found = [
            (text, box)
            for text, box in placed_texts(page)
            if re.fullmatch(r"[\d.]+ x [\d.]+|tail \d+", text)
        ]
        assert sorted(text for text, _ in found) == wanted
        for (_, one), (_, two) in itertools.combinations(found, 2):
            assert not one.intersects(two)


def test_labels_lie_on_no_other_label(robot, parts, recipe) -> None:
    texts = placed_texts(exploded_picture(robot, *parts, recipe))
    boxes = [box for text, box in texts if re.fullmatch("[A-G]|[1-7]", text)]
    assert len(boxes) == 7 + 2 * 6 + 6 + 1  # pieces, ends of joints, steps, the key
    for one, two in itertools.combinations(boxes, 2):
        assert not one.intersects(two)


def test_many_joints_are_left_to_the_readme(robot, parts, recipe, monkeypatch) -> None:
    monkeypatch.setattr(drawing, "MOST_JOINTS_LISTED", 2)
    words = texts_of(assembly_drawing(robot, *parts, recipe))
    assert "and 4 more: README.txt lists them all." in words
    assert sum(bool(re.match(r"\d+\.  ", text)) for text in words) == 2


def test_pieces_that_are_joined_differ_in_colour(cut_at, make_plan, make_fan) -> None:
    fans = [make_fan(4, 100.0, 300.0), make_fan(4, 100.0, 300.0)]
    design = make_plan((30.0, 20.0, 10.0), levels=fans)
    for cuts in (tuple(range(1, 21)), (1, 2, 3, 4, 5, 6, 17), (4, 9, 12, 17, 18, 19, 20)):
        partition, _ = cut_at(design, cuts)
        colours = piece_colours(partition)
        assert all(colours[s.label] != colours[s.inner] for s in partition.sleeves)


def test_files_are_a_picture_and_a_page_without_the_date_of_today(robot, parts, recipe) -> None:
    files = assembly_files(robot, *parts, recipe)
    assert list(files) == ["assembly.svg", "assembly.pdf"]
    ElementTree.fromstring(files["assembly.svg"])  # noqa: S314
    assert b"<dc:date>" not in files["assembly.svg"]
    assert files["assembly.pdf"].startswith(b"%PDF")
    dates = re.findall(rb"Date \(D:(\d{8})", files["assembly.pdf"])
    assert set(dates) == {b"20000101"}, "the fixed date of files that are the same each time"


PROGRAM = """
from hashlib import sha256
from vinefab.fabrication.package.assembly_drawing import assembly_files
from vinefab.fabrication.pieces.exploded import piece_lumens
from vinefab.fabrication.pieces.partition import partition_of
from vinefab.model.design import Build, Design, Level, PieceSettings
from vinefab.model.laser import (read_profile)

profile = read_profile("co2_60w__stretchlon_200")
widths, settings = (24.0, 15.0, 9.0), PieceSettings()
build = Build(widths_mm=widths, fillet_mm=(4.0, 3.0), pieces=settings)
fans = (Level.of(4, 260.0, 260.0), Level.of(4, 220.0, 260.0))
design = Design(name="crossing", trunk_length_mm=220.0, levels=fans, build=build)
partition = partition_of(design, profile)
outlines = piece_lumens(design, partition)
print(len(partition.pieces))
for data in assembly_files(design, partition, outlines, profile).values():
    print(sha256(data).hexdigest())
"""


@pytest.mark.thorough
def test_the_drawing_has_the_same_bytes_in_another_process(tmp_path: Path, capsys) -> None:
    exec(PROGRAM, {})  # noqa: S102
    here = capsys.readouterr().out
    there = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "PYTHONHASHSEED": "1"},
        capture_output=True,
        check=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
    ).stdout
    assert here == there
    count, *digests = here.split()
    assert int(count) > 1
    assert len(digests) == 2


def test_the_report_lists_pieces_and_joints(robot, parts, recipe) -> None:
    partition, outlines = parts
    sheets = {label: (1,) if label in "ABCD" else (2, 3) for label in outlines}
    section = pieces_section(robot, partition, outlines, recipe, sheets=sheets)
    pieces, joints = section.tables
    assert [row[0] for row in pieces.rows] == list("ABCDEFG")
    assert [row[3] for row in pieces.rows] == ["1"] * 4 + ["2, 3"] * 3
    counts = [int(row[2]) for row in pieces.rows]
    assert counts == [len(piece.branches) for piece in partition.pieces]
    assert sum(counts) == robot.branch_count
    order = joining_order(robot, partition)
    assert [row[1] for row in joints.rows] == [step.sleeve.label for step in order]
    assert {row[5] for row in joints.rows} == {"12"}
    (picture,) = section.pictures
    ElementTree.fromstring(picture.drawn)  # noqa: S314


def test_the_size_of_a_piece_is_that_of_the_least_rectangle(finger: Contour) -> None:
    for angle in (0.0, 0.4, 1.9):
        sides = least_rectangle_mm(finger.moved(angle, 7.0, -3.0))
        assert sides == pytest.approx((120.0, 40.0), abs=0.1)
    line = Contour.polyline(finger.points_mm[:2], closed=False)
    assert least_rectangle_mm(line) == pytest.approx((100.0, 0.0))
