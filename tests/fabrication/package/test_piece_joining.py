import re
from dataclasses import replace

import numpy as np
import pytest

from vinefab.fabrication.formats.laser_drawing import package_spec
from vinefab.fabrication.package.bom import bom_text, joint_lines
from vinefab.fabrication.package.package_texts import readme_text
from vinefab.fabrication.package.piece_joining import (
    MINUTES_PER_JOINT,
    STRIP_HANDLE_MM,
    joining_order,
    open_ends,
)
from vinefab.model.design import PieceSettings
from vinefab.model.laser import LapBond, LapMethod, read_profile
from vinefab.model.quantity import Quantity, Standing
from vinefab.model.tree import Partition, Piece


@pytest.fixture(scope="module")
def recipe():
    return read_profile("co2_60w__stretchlon_200")


@pytest.fixture(scope="module")
def glued(recipe):
    """The recipe with laps of adhesive film."""
    guess = {"standing": Standing.ASSUMED, "source": "a test"}
    lap = LapBond(
        method=LapMethod.ADHESIVE_FILM,
        band_mm=Quantity(value=10.0, **guess),
        survived_n_per_mm=Quantity(value=0.2, **guess),
    )
    return replace(recipe, recipe=recipe.recipe.changed(lap=lap))


@pytest.fixture(scope="module")
def robot(make_plan, make_fan):
    """A trunk of 120 mm and a tail of 60 mm, two children of 150 mm, four grandchildren of 90."""
    fans = [make_fan(2, 150.0, 90.0), make_fan(2, 90.0, 80.0)]
    return make_plan((30.0, 20.0, 10.0), levels=fans, pieces=PieceSettings(most=9))


def test_each_joint_comes_once_and_after_all_joints_of_its_outer_piece(cut_at, robot) -> None:
    rng = np.random.default_rng(4)
    for _ in range(40):
        cuts = 1 + rng.choice(robot.branch_count - 1, int(rng.integers(1, 7)), replace=False)
        partition, _ = cut_at(robot, tuple(cuts.tolist()))
        steps = joining_order(robot, partition)
        assert [step.number for step in steps] == list(range(1, len(cuts) + 1))
        assert {step.sleeve for step in steps} == set(partition.sleeves)
        made: set[str] = set()
        for step in steps:
            on_outer = {s.label for s in partition.sleeves if s.inner == step.sleeve.label}
            assert on_outer <= made
            made.add(step.sleeve.label)
            on_inner = {s.label for s in partition.sleeves if s.inner == step.sleeve.inner}
            assert step.is_last_of_inner == (on_inner <= made)
        assert set(steps[-1].joined) == {piece.label for piece in partition.pieces}


def test_the_way_of_a_strip_summed_by_hand(cut_at, robot) -> None:
    """Cut on a child, a third along it, and on a grandchild of each."""
    partition, _ = cut_at(robot, (1, 3, 5))
    ways = {step.branch: step.way_mm for step in joining_order(robot, partition)}
    assert ways["0.0"] == pytest.approx(50.0 + 15.0 + 120.0 + 60.0)  # out through the mouth
    assert ways["0.0.0"] == pytest.approx(30.0 + 15.0 + 100.0)  # out through the base of its stub
    assert ways["0.1.0"] == pytest.approx(30.0 + 15.0 + 150.0 + 120.0 + 60.0)


@pytest.mark.parametrize("mounting", ["tail_inverted", "turned"])
def test_no_strip_of_a_printed_order_is_trapped(cut_at, robot, recipe, job, mounting) -> None:
    """Played through: what is sealed is closed, and a strip passes no joint that is made."""
    built = robot.changed(build=robot.build.changed(mounting=mounting))
    rng = np.random.default_rng(5)
    for _ in range(60):
        cuts = 1 + rng.choice(robot.branch_count - 1, int(rng.integers(1, 7)), replace=False)
        partition, _ = cut_at(built, tuple(cuts.tolist()))
        steps = joining_order(built, partition)
        # Every end that is open: the mouth, and of each joint not made its stub and its base.
        ends = {("A", "mouth")}
        for sleeve in partition.sleeves:
            ends |= {(sleeve.inner, sleeve.label), (sleeve.label, sleeve.label)}
        for step in steps:
            ends -= {(step.sleeve.inner, step.sleeve.label), (step.sleeve.label, step.sleeve.label)}
            inner = step.sleeve.inner
            assert (inner, "mouth" if inner == "A" else inner) in ends
            assert step.strip_leaves
        words = joining_items(built, job, recipe, partition)
        through = [
            re.search(r"in and out through (?:the base of )?(.+)\.$", text) for text in words
        ]
        told = [match[1] for match in through if match]
        first = {"A": "the mouth"}
        assert told == [first.get(step.sleeve.inner, step.sleeve.inner) for step in steps]


def test_a_strip_is_trapped_where_joints_are_made_from_the_base_outward(cut_at, robot) -> None:
    partition, _ = cut_at(robot, (1, 3))
    first, second = partition.sleeves
    assert (second.inner, second.label) == ("B", "C")
    assert open_ends(partition, second, ()) == {"B"}
    # Through the plug's own piece nothing leaves, and once B is joined nothing through its base.
    assert open_ends(partition, second, {"B"}) == set()
    assert open_ends(partition, first, ()) == {"A", "C"}
    assert open_ends(partition, first, {"C"}) == {"A"}


def joining_items(robot, job, profile, partition) -> list[str]:
    """Return the items of the section of the README on joining, each on one line, unnumbered."""
    text = readme_text(robot, package_spec(job, profile), partition)
    section = text.split("\nJoin the pieces\n")[1].split("\nMount\n")[0]
    items = re.split(r"^(?:- | ?\d+\. |[a-z]\. )", section, flags=re.MULTILINE)
    return [" ".join(item.split()) for item in items]


def test_the_words_name_every_joint_in_its_order(cut_at, robot, recipe, job) -> None:
    partition, _ = cut_at(robot, (1, 2, 3, 5))
    words = joining_items(robot, job, recipe, partition)
    told = [text for text in words if text.startswith("Joint ")]
    order = joining_order(robot, partition)
    assert len(told) == len(order)
    for number, (text, step) in enumerate(zip(told, order, strict=True), start=1):
        assert text.startswith(f"Joint {number} of 4: plug {step.sleeve.label} into socket")
        assert f"piece {step.sleeve.label} into piece {step.sleeve.inner}" in text
        assert f"branch {step.branch}," in text
        assert "15 mm deep" in text
        assert f"Strip: {step.way_mm + STRIP_HANDLE_MM:.0f} mm long" in text
    tests = [text for text in words if text.startswith("Test what hangs together now")]
    # Each of the two children holds one grandchild.
    assert [re.findall(r"\((\w, \w)\)", text)[0] for text in tests] == ["B, D", "C, E"]
    assert words[-2].startswith("Test the whole robot")
    everything = " ".join(words)
    assert recipe.recipe.lap.words() in everything
    assert "0.064 N per mm of rim (computed)" in everything  # P w / (2 pi): 20 kPa, 20 mm
    assert f"{MINUTES_PER_JOINT:g} minutes a joint (assumed)" in everything


def test_adhesive_film_needs_no_strip(cut_at, robot, glued, job) -> None:
    partition, _ = cut_at(robot, (1, 3))
    words = joining_items(robot, job, glued, partition)
    everything = " ".join(words)
    assert "strip" not in everything.lower()
    assert "a band 10 mm wide (assumed) of adhesive film" in everything
    lines = {line.item: line for line in joint_lines(robot, partition, glued)}
    assert lines["adhesive film"].value == pytest.approx(10.0 * 2.0 * (20.0 + 10.0) / 100.0)
    assert lines["adhesive film"].standing is Standing.ASSUMED
    assert not any("strip" in item for item in lines)


def test_a_recipe_without_laps_says_that_nothing_is_known(cut_at, robot, recipe, job) -> None:
    unknown = replace(recipe, recipe=recipe.recipe.changed(lap=None))
    words = joining_items(robot, job, unknown, cut_at(robot, (1,))[0])
    assert any("has no [lap]: nothing is known of the bond" in text for text in words)
    assert not any("None" in text for text in words)


def test_the_bill_of_materials_counts_joints_by_hand(cut_at, robot, profile) -> None:
    """Two joints, 20 and 10 mm wide; a seam of 0.4 mm and an ease of 1 mm: sockets 1.8 mm wider."""
    partition, _ = cut_at(robot, (1, 3))
    lines = {line.item: line for line in joint_lines(robot, partition, profile)}
    by_hand = {
        "pieces": 3,
        "sleeve joints": 2,
        "film in laps, all plies": 2 * 15.0 * (21.8 + 11.8) / 100.0,
        "bands around laps": 2,
        "band length": 2.0 * (20.0 + 10.0),
        "release strips": 2,
        "release strip length": (245.0 + 50.0) + (145.0 + 50.0),
        "assembly time": 16.0,
    }
    assert {item: line.value for item, line in lines.items()} == pytest.approx(by_hand)
    assumed = {item for item, line in lines.items() if line.standing is Standing.ASSUMED}
    assert assumed == {"film in laps, all plies", "release strip length", "assembly time"}
    assert all("assumed" in lines[item].basis for item in assumed)
    twice = {line.item: line for line in joint_lines(robot, partition, profile, robots=2)}
    assert {item: line.value / 2 for item, line in twice.items()} == pytest.approx(by_hand)


def test_a_robot_in_one_piece_has_no_lines(robot, profile, job) -> None:
    whole = Partition(pieces=(Piece(label="A", root=0, branches=tuple(range(7))),))
    assert joint_lines(robot, whole, profile) == ()
    assert "Join the pieces" not in readme_text(robot, package_spec(job, profile), whole)
    assert bom_text(job, profile) == bom_text(job, profile, joint_lines(robot, whole, profile))
