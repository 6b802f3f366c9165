"""Whole random robots under pressure: what is cut deploys as designed (simulated)."""

import numpy as np
import pytest

from vinefab.fabrication.checking import check_design
from vinefab.inflation.pattern import pattern_of, strain_of
from vinefab.inflation.robot import inflated_robot
from vinefab.model.design import Branch, Build, Design, Level
from vinefab.model.laser import read_profile
from vinefab.outline.body_outline import flat_layout
from vinefab.search.manufacturability import ManufacturabilityPenalty


def drawn_robot(number, large):
    """Return a random tree of 10 to 29 branches, or of 30 to 60; None where it has others."""
    rng = np.random.default_rng((31, int(large), number))
    depth = 3 if large else int(rng.integers(2, 4))
    spans = ((120, 260), (70, 150), (40, 80)) if large else ((60, 140),) * 3
    levels = []
    for place in range(depth):
        branches = int(rng.integers(2 if large else 1, 5))
        gap = rng.uniform(45, 80) if large else rng.uniform(20, 80)
        length, growth = float(rng.uniform(*spans[place])), float(rng.uniform(60, 140))
        levels.append(Level.of(branches, length, float(gap * (branches - 1)), growth))
    width = float(rng.uniform(26, 48) if large else rng.uniform(18, 36))
    ratio = float(rng.uniform(0.45, 0.65) if large else rng.uniform(0.5, 0.8))
    widths = tuple(width * ratio**k for k in range(depth + 1))
    count = sum(int(np.prod([level.branches for level in levels[:k]])) for k in range(depth + 1))
    low, high = (30, 60) if large else (10, 29)
    if widths[-1] < 5.0 or not low <= count <= high:
        return None
    build = Build(widths_mm=widths, pressure_kpa=float(rng.uniform(8, 20)), tail_mm=150.0)
    trunk_mm = float(rng.uniform(60, 250))
    return Design(name="random", trunk_length_mm=trunk_mm, levels=tuple(levels), build=build)


def free_robot(number):
    """Return a random tree of 6 to 20 branches of their own, some with a bend; often unfit."""
    rng = np.random.default_rng((47, number))
    depth, branches = {"trunk": 1}, []
    for parent in (waiting := ["trunk"]):
        gaps = rng.uniform(32.0, 60.0, int(rng.integers(1, 4)) if parent != "trunk" else 3)
        if depth[parent] == 4 or len(branches) >= 19:
            break
        angles = np.cumsum(gaps) - gaps.sum() / 2.0 + rng.uniform(-15.0, 15.0)
        for place, angle_deg in enumerate(angles.tolist()):
            name, length_mm = f"b{len(branches)}", round(float(rng.uniform(70, 190)), 1)
            bend = (round(length_mm / 2.0, 1), round(float(rng.uniform(-35, 35)), 1))
            branches.append(
                Branch(
                    name=name,
                    of=parent,
                    angle_deg=round(angle_deg, 1),
                    length_mm=length_mm,
                    bends=(bend,) if rng.random() < 0.25 else None,
                )
            )
            depth[name] = depth[parent] + 1
            if place % 2 == 0 or rng.random() < 0.5:
                waiting.append(name)
    levels = max(depth.values())
    build = Build.standard(levels, float(rng.uniform(20, 34))).changed(tail_mm=150.0)
    return Design.of_branches(branches, trunk_length_mm=150.0, build=build, name="random")


def free_robots(wanted):
    """Yield random trees of branches of their own that pass the full check, with their numbers."""
    profile, done = read_profile("co2_60w__stretchlon_200"), 0
    penalty = ManufacturabilityPenalty(profile=profile)
    for number in range(20_000):
        design = free_robot(number)
        if penalty(design) == 0.0 and not check_design(design, profile).blocking:
            yield number, design
            done += 1
        if done == wanted:
            return
    pytest.fail(f"{done} robots of {wanted} could be made")


def misses(design):
    """Return how far each tip ends from its place, mm, and each joint from its angle, deg."""
    profile = read_profile("co2_60w__stretchlon_200")
    strain = strain_of(design, profile.material, design.build.widths_mm[0])
    robot = inflated_robot(pattern_of(design, profile).flat, hoop_strain=strain)
    aim = flat_layout(design)
    turn = np.degrees(robot.deployed_offsets_rad - aim.tree.offset_rad)
    return robot.tip_errors_mm(aim), np.abs(np.remainder(turn + 180.0, 360.0) - 180.0)


@pytest.mark.thorough
def test_free_trees_deploy_as_designed():
    for number, design in free_robots(3):
        off_mm, turn_deg = misses(design)
        assert off_mm.mean() < 3.0, number
        assert off_mm.max() < 8.0, number
        assert turn_deg.max() < 2.0, number


@pytest.mark.thorough
@pytest.mark.parametrize(("large", "wanted"), [(False, 6), (True, 4)])
def test_tips_and_angles_of_random_manufacturable_robots_are_those_designed(large, wanted):
    profile = read_profile("co2_60w__stretchlon_200")
    done = 0
    for number in range(600):
        design = drawn_robot(number, large)
        if design is None or check_design(design, profile).blocking:
            continue
        strain = strain_of(design, profile.material, design.build.widths_mm[0])
        robot = inflated_robot(pattern_of(design, profile).flat, hoop_strain=strain)
        aim = flat_layout(design)
        off_mm = robot.tip_errors_mm(aim)
        turn = np.degrees(robot.deployed_offsets_rad - aim.tree.offset_rad)
        assert off_mm.mean() < 5.0, number
        assert off_mm.max() < 10.0, number
        assert np.abs(np.remainder(turn + 180.0, 360.0) - 180.0).max() < 1.5, number
        # As cut without compensation it is another robot.
        flat = inflated_robot(design, hoop_strain=strain).tip_errors_mm(aim)
        assert flat.mean() > 2.0 * off_mm.mean(), number
        done += 1
        if done == wanted:
            return
    pytest.fail(f"{done} robots of {wanted} could be made")
