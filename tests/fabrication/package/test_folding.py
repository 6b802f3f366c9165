"""Folds in lay-flat tubing: the strip is folded line by line, and its centre line measured."""

import csv
import io
import json
import math
import re
from dataclasses import replace
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

import vinefab as vf
from vinefab.fabrication.package.folding import FoldedTube, fold_files, fold_text, folded_tube
from vinefab.inflation.joint import JointShape, inflated_joint
from vinefab.inflation.pattern import Pattern
from vinefab.model.design import Branch, Build, Collar, Design


def flat_pattern(design: Design) -> Pattern:
    """Return a pattern that is cut as designed."""
    return Pattern(design=design, flat=design, deployed=design, joints=())


def one_tube(length_mm: float, bends, build: Build) -> Design:
    return Design.of_branches([], trunk_length_mm=length_mm, trunk_bends=bends, build=build)


def tube_of(length_mm: float, bends, width_mm: float) -> FoldedTube | str:
    build = Build(widths_mm=(width_mm,), tail_mm=90.0)
    return folded_tube(flat_pattern(one_tube(length_mm, bends, build)))


def table_rows(text: str) -> tuple[list[dict[str, str]], float, float]:
    """Return the rows of a fold table, the tube's width, and its whole length."""
    *rows, last = csv.DictReader(io.StringIO(text))
    width, long = re.search(r"tube ([\d.]+) mm wide, ([\d.]+) mm long", last["basis"]).groups()
    return rows, float(width), float(long)


def mirrored(points, line):
    """Return points reflected in a line through two points."""
    foot, way = line[0], (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
    away = points - foot
    return foot + 2.0 * np.outer(away @ way, way) - away


def folded_centre_line(text: str, tail_mm: float):
    """Fold a strip as its table says; return its centre line from the base, and the seams' gaps.

    Each fold is two creases: in the middle line, which lays the last line onto the first one, and
    in the first line, which turns what follows forward again.
    """
    rows, width_mm, long_mm = table_rows(text)
    ends = [0.0]
    lines = []
    for row in rows:
        inner = (0.5 if row["inner_edge"] == "left" else -0.5) * width_mm
        middle, first, last = (
            float(row[key])
            for key in (
                "middle_from_base_mm",
                "first_line_from_base_mm",
                "last_line_from_base_mm",
            )
        )
        point = np.array([middle, -inner])
        lines.append([np.array([point, (x, inner)]) for x in (first, middle, last)])
        # Half of the way across, where the lines meet the middle of the strip.
        ends += [0.5 * (first + middle), 0.5 * (last + middle)]
    ends.append(long_mm - tail_mm)
    stretches = [
        np.array([(x, 0.0) for x in pair]) for pair in zip(ends[::2], ends[1::2], strict=True)
    ]
    gaps = []
    for number in range(len(lines)):
        first, middle, last = lines[number]
        gaps.append(np.abs(mirrored(last, middle) - first).max())

        def folded(points, first=first, middle=middle):
            return mirrored(mirrored(points, middle), first)

        stretches[number + 1 :] = [folded(one) for one in stretches[number + 1 :]]
        lines[number + 1 :] = [[folded(one) for one in three] for three in lines[number + 1 :]]
    return stretches, gaps


def turns_deg(stretches):
    headings = [math.atan2(*(one[1] - one[0])[::-1]) for one in stretches]
    return np.degrees(np.angle(np.exp(1j * np.diff(headings))))


CHAINS = [
    (642.0, [(148.0, 65.6), (269.0, -65.6), (479.0, 75.8)], 20.0),
    (400.0, [(100.0, 40.0), (160.0, 40.0), (300.0, 85.0)], 38.0),
    (250.0, [(60.0, -12.0), (90.0, -30.0), (140.0, 3.0)], 9.0),
]


@pytest.mark.parametrize(("length_mm", "bends", "width_mm"), CHAINS)
def test_the_folded_strip_has_the_turns_and_lengths_of_the_design(
    length_mm, bends, width_mm
) -> None:
    tube = tube_of(length_mm, bends, width_mm)
    stretches, gaps = folded_centre_line(fold_text(tube), tube.tail_mm)
    rounding_mm = 0.02
    assert max(gaps) < rounding_mm  # the last line of each fold lies on the first
    joined = [np.abs(one[1] - two[0]).max() for one, two in pairwise(stretches)]
    assert max(joined) < 5.0 * rounding_mm
    assert turns_deg(stretches) == pytest.approx([turn for _, turn in bends], abs=0.1)
    planned_mm = np.diff([0.0, *(at for at, _ in bends), length_mm])
    found_mm = [np.linalg.norm(one[1] - one[0]) for one in stretches]
    assert found_mm == pytest.approx(planned_mm, abs=2.0 * rounding_mm)


def test_a_fold_across_the_tube_takes_twice_the_width_by_the_tangent() -> None:
    tube = tube_of(300.0, [(150.0, -90.0)], 25.0)
    (fold,) = tube.folds
    assert (fold.side, fold.fold_mm) == ("right", pytest.approx(50.0))
    assert fold.middle_mm == pytest.approx(162.5)
    assert tube.length_mm == pytest.approx(325.0)


def test_the_drawing_is_at_true_scale() -> None:
    tube = tube_of(*CHAINS[0])
    root = ElementTree.fromstring(fold_files(tube)["folds.svg"])  # noqa: S314
    wide, high = (float(root.get(side).removesuffix("pt")) for side in ("width", "height"))
    assert (wide / 72.0 * 25.4, high / 72.0 * 25.4) == pytest.approx((297.0, 210.0), abs=0.1)
    texts = ["".join(one.itertext()) for one in root.iter() if one.tag.endswith("text")]
    assert {"fold 1, left: 25.8 mm", "fold 2, right: 25.8 mm", "base line 0"} <= set(texts)


def test_the_pdf_is_a_sheet_of_a4() -> None:
    data = fold_files(tube_of(*CHAINS[0]))["folds.pdf"]
    wide, high = map(float, re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", data).groups())
    assert (wide / 72.0 * 25.4, high / 72.0 * 25.4) == pytest.approx((297.0, 210.0), abs=0.01)


def test_a_sharp_bend_deploys_as_the_rounded_one_that_is_cut() -> None:
    """What the table takes for granted: the fold's corners change next to nothing."""
    shape = JointShape(angles_deg=(53.8,), widths=(1.0,), fillets=(0.25, 0.25), hoop_strain=0.11)
    rounded = inflated_joint(replace(shape, is_bend=True))
    sharp = inflated_joint(replace(shape, fillets=(0.0, 0.0)))
    assert rounded.angles_deg[0] > 60.0
    assert sharp.angles_deg == pytest.approx(rounded.angles_deg, abs=1.0)
    assert sharp.pull_backs == pytest.approx(rounded.pull_backs, abs=0.02)


def with_build(**values) -> Design:
    build = Build(widths_mm=(20.0,), **values)
    return one_tube(300.0, [(100.0, 40.0)], build)


FORK = Design.of_branches(
    [Branch(name=name, angle_deg=turn, length_mm=80.0) for name, turn in (("a", 40), ("b", -40))],
    trunk_length_mm=100.0,
    build=Build(widths_mm=(20.0, 12.0)),
)


@pytest.mark.parametrize(
    ("design", "reason"),
    [
        (FORK, "it branches (3 branches), and folds only bend one tube"),
        (Design.read("plain_vine"), "it has no bends"),
        (with_build(pouch={"shape": "round", "radius_mm": 16.0}), "its pouch has to be sealed"),
        (
            with_build(collar=Collar(clamp_diameter_mm=30.0)),
            "its tail has a collar, and tubing has one width",
        ),
        (with_build(taper=(0.8,)), "its width changes, and tubing has one width"),
    ],
)
def test_designs_that_do_not_fold_say_why(design: Design, reason: str) -> None:
    assert folded_tube(flat_pattern(design)) == reason


def test_folds_that_meet_are_refused() -> None:
    met = tube_of(300.0, [(100.0, 110.0), (122.0, 110.0)], 20.0)
    assert met == "folds 1 and 2 would take the same film"
    assert tube_of(300.0, [(290.0, 110.0)], 20.0) == "a fold would reach over an end of the tube"
    # On opposite edges two wedges fit beside each other where on one edge they would not.
    assert isinstance(tube_of(300.0, [(100.0, 110.0), (122.0, -110.0)], 20.0), FoldedTube)


def test_the_package_has_the_folds_of_what_is_cut(tmp_path) -> None:
    design = one_tube(300.0, [(120.0, 60.0)], Build(widths_mm=(20.0,), tail_mm=200.0))
    made = vf.fabricate(design, out=tmp_path / "bent", allow_uncalibrated=True)
    assert {"folds.csv", "folds.svg", "folds.pdf"} <= set(made.files)
    assert not any("no fold table" in line for line in made.summary)
    stretches, _ = folded_centre_line((tmp_path / "bent/folds.csv").read_text(), 200.0)
    first, last = json.loads((tmp_path / "bent/job.json").read_text())["pattern"]["branches"]
    assert last["cut_deg"] < 60.0  # it opens under pressure
    assert turns_deg(stretches) == pytest.approx([last["cut_deg"]], abs=0.1)
    found_mm = [np.linalg.norm(one[1] - one[0]) for one in stretches]
    assert found_mm == pytest.approx([first["cut_mm"], last["cut_mm"]], abs=0.05)
    content = (tmp_path / "bent/README.txt").read_text()
    assert "Folds instead of seams" in content


def test_designs_without_folds_are_told_so_in_one_line(tmp_path) -> None:
    vine = vf.fabricate("plain_vine", out=tmp_path / "vine", allow_uncalibrated=True)
    assert "folds.csv" not in vine.files
    assert vine.summary[-1] == "note: no fold table for lay-flat tubing: it has no bends"
