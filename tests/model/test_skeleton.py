"""Designs whose skeleton is drawn by line segments."""

import math

import numpy as np
import pytest

import vinefab as vf

FORK = [[0, 0, 0, 100], [0, 100, 40, 180], [-60, 160, 0, 100], [-60, 160, -60, 220]]


def lines_of(design):
    """Return the segments of a design where nothing is in the way, and their widths."""
    tree = design.tree.straight
    x, y, heading_deg = design.origin.get("drawn_at", (0.0, 0.0, 90.0))
    ends, headings, lines = [], [], []
    for row, parent in enumerate(tree.parent.tolist()):
        begin = ends[parent] if parent >= 0 else np.array([x, y])
        heading = headings[parent] if parent >= 0 else math.radians(heading_deg)
        headings.append(heading + tree.offset_rad[row])
        along = np.array([math.cos(headings[-1]), math.sin(headings[-1])])
        ends.append(begin + tree.length_mm[row] * along)
        lines.append([*begin, *ends[-1]])
    return np.array(lines), tree.width_mm


def random_tree(rng):
    """Return a design of branches with bends."""
    names, branches = ["trunk"], []
    for number in range(int(rng.integers(2, 30))):
        angle, length = float(rng.uniform(-80, 80)), float(rng.uniform(60, 200))
        bends = ((float(rng.uniform(10, 25)), 20.0), (length - 15.0, float(rng.uniform(-60, 60))))
        name = f"b{number}"
        own = bends if rng.random() < 0.5 else None
        of = names[int(rng.integers(min(len(names), 8)))]
        branches.append(vf.Branch(name=name, of=of, angle_deg=angle, length_mm=length, bends=own))
        names.append(name)
    return vf.Design.of_branches(
        branches,
        trunk_length_mm=90.0,
        trunk_bends=((40.0, 15.0),),
        build=vf.Build(trunk_width_mm=12.0, width_ratio=0.8),
    )


def test_lines_become_branches_and_bends_in_any_order_and_direction():
    fork = vf.Design.of_segments(FORK)
    assert fork.names == ("trunk", "0", "1")
    right, left = fork.branches
    assert right.angle_deg == pytest.approx(-math.degrees(math.atan2(40, 80)))
    assert (left.angle_deg, len(left.bends)) == (45.0, 1)
    assert left.bends[0] == pytest.approx((60.0 * math.sqrt(2.0), -45.0))
    assert fork.origin["drawn_at"] == [0.0, 0.0, 90.0]
    other = vf.Design.of_segments([FORK[2], FORK[3], [40, 180, 0, 100], FORK[0]])
    assert other == fork
    tip = vf.Design.of_segments(FORK, base=(-60, 220.5))
    assert (len(tip.trunk.bends), tip.branch_count) == (1, 3)


def test_drawn_lines_of_random_trees_are_traced_back_to_a_millionth_of_a_millimetre():
    rng = np.random.default_rng(3)
    for _ in range(40):
        design = random_tree(rng)
        lines, widths = lines_of(design)
        order = rng.permutation(len(lines))
        shuffled = lines[order]
        back = rng.random(len(lines)) < 0.5
        shuffled[back] = shuffled[back][:, [2, 3, 0, 1]]
        traced = vf.Design.of_segments(shuffled, base=(0, 0), widths_mm=widths[order], snap_mm=1e-3)
        again, again_widths = lines_of(traced)
        near = np.abs(again[:, None] - lines[None]).max(axis=2)
        assert near.min(axis=0).max() < 1e-6
        assert near.min(axis=1).max() < 1e-6
        assert again_widths == pytest.approx(widths[near.argmin(axis=1)])


def test_what_goes_straight_on_is_one_branch_unless_its_width_changes():
    lines = [[0, 0, 0, 50], [0, 50, 1e-12, 90], [0, 90, 0, 200]]
    assert vf.Design.of_segments(lines).tree.length_mm.tolist() == [200.0]
    assert not len(vf.Design.of_segments(lines).tree.bend_mm)
    stepped = vf.Design.of_segments(lines, widths_mm=[30.0, 30.0, 18.0])
    assert stepped.tree.length_mm.tolist() == [90.0, 110.0]
    assert stepped.tree.width_mm.tolist() == [30.0, 18.0]
    assert vf.Design.of_segments(lines, widths_mm=[30.0, math.nan, 30.0]).branch_count == 1


LOOP = [[0, 0, 0, 100], [0, 100, 50, 150], [50, 150, 0, 160], [0, 160, 0, 100]]
CLOSE = [[0, 0, 0, 100], [0, 100, 20, 110], [20, 110, 30, 140]]
WRONG = [
    (LOOP, {}, "lines close a loop at (0, 100)"),
    (LOOP[1:], {}, "at (0, 100) are a loop without a loose end"),
    ([FORK[0], [0, 102, 50, 150]], {}, "at (0, 102) are joined to no others"),
    ([FORK[0], [0, 102, 50, 150]], {}, "2 mm away at (0, 100)"),
    (FORK, {"base": (0, 100)}, "(0, 100) lies in the middle: 3 lines meet there"),
    (FORK, {"base": (3, 100)}, "no line ends within 1 mm of (3, 100)"),
    (FORK, {"base": 5}, "base is 5"),
    (FORK, {"snap_mm": 0.0}, "snap_mm is 0"),
    (FORK, {"widths_mm": [1.0]}, "one width per segment"),
    ([FORK[0], [0, 100, 0.5, 100]], {}, "a line at (0, 100) is 0.5 mm long"),
    (CLOSE, {}, "bends of the line from (0, 0) to (30, 140)"),
    ([FORK[0], [0, 100, 1, 0]], {"snap_mm": 0.1}, "bends[1][2] of the line from (0, 0) to (1, 0)"),
    ([FORK[0], FORK[1], [0, 100, 20, 140]], {}, "angle_deg of the line from (0, 100) to"),
    ([], {}, "shape (n, 4)"),
    ([[0, 0, 0, math.nan]], {}, "segments[1]"),
    ([[0, n, 0, n + 2] for n in range(0, 202_000, 2)], {}, "1 to 100000"),
    ([FORK[0], *([0, 100, 2 * n - 1200, 180] for n in range(1200))], {}, "at most 1000 branches"),
]


@pytest.mark.parametrize(("lines", "options", "message"), WRONG)
def test_lines_that_are_no_tree_are_refused_by_their_place(lines, options, message):
    with pytest.raises(vf.BadInputError) as caught:
        vf.Design.of_segments(lines, **options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
