"""The penalty of trees whose branches have angles, lengths and bends of their own."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vinefab.inflation.pattern import quick_pattern
from vinefab.model.design import Branch, Build, Design
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.quantity import Quantity, Standing
from vinefab.search import penalty_batch, penalty_kernel
from vinefab.search.manufacturability import ManufacturabilityPenalty

PENALTY = ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))


def with_gain(gain):
    measured = Quantity(value=gain, standing=Standing.MEASURED, source="coupon")
    material = PENALTY.profile.material.changed(closing_gain=measured)
    return replace(PENALTY, profile=replace(PENALTY.profile, material=material))


def random_tree(rng, compensation):
    """A tree of 3 to 13 branches on four levels; siblings may be near each other, or five."""
    names, turns, depth, branches = ["trunk"], {"trunk": []}, {"trunk": 1}, []
    for number in range(int(rng.integers(2, 13))):
        open_ = [name for name in names if depth[name] < 4 and len(turns[name]) < 5]
        of, name = str(rng.choice(open_)), f"b{number}"
        free = [deg for deg in rng.uniform(-115.0, 115.0, 20)
                if all(abs(deg - other) > 6.0 for other in turns[of])]  # fmt: skip
        turns[of].append(free[0])
        length_mm = float(rng.uniform(60.0, 150.0))
        bends = [(length_mm / 2.0, float(rng.uniform(-50.0, 50.0)))]
        branches.append(
            Branch(
                name=name,
                of=of,
                angle_deg=free[0] if rng.random() < 0.9 else 0.5 * round(free[0]),
                length_mm=length_mm,
                bends=bends if rng.random() < 0.3 else None,
                width_mm=float(rng.uniform(8.0, 13.0)) if rng.random() < 0.2 else None,
            )
        )
        names.append(name)
        turns[name], depth[name] = [], depth[of] + 1
    build = Build.standard(max(depth.values()), 24.0).changed(compensation=compensation)
    return Design.of_branches(branches, trunk_length_mm=120.0, build=build)


@pytest.mark.parametrize("compensation", ["inflation", "none"])
@pytest.mark.parametrize("gain", [1.0, 0.8])
def test_the_kernel_cuts_joints_as_the_quick_pattern(compensation, gain):
    penalty, rng = with_gain(gain), np.random.default_rng(3)
    seen, beyond = set(), 0
    for _ in range(60):
        design = random_tree(rng, compensation)
        at_once, trees = penalty._rules(design).at_once([design])
        rows, found = at_once._rows(trees, np.zeros(1, dtype=np.int64)), np.empty(1)
        count = len(rows.parent)
        scratch = penalty_batch._scratch(count, 10 * count)
        penalty_kernel.penalize(rows, at_once.tables, at_once.limits, scratch, found)
        quick = quick_pattern(design, penalty.profile.material)
        parts = quick.flat.tree.straight
        assert np.abs(scratch.angle[1:count] - parts.offset_rad[1:]).max() < 1e-9
        assert np.abs(scratch.run[:count] - parts.length_mm).max() < 1e-9
        assert {round(one, 9) for one in scratch.passage[:count]} - {1.0} == {
            round(one, 9) for one in quick.passages
        } - {1.0}
        seen |= set(np.bincount(parts.parent[1:]).tolist())
        beyond += quick.beyond > 0.0
        assert quick.beyond == 0.0 or found[0] > 0.0
    assert seen >= {1, 2, 3, 4}
    assert beyond > 10


def moved(design, rng, share):
    """A design whose branches are turned and stretched at random."""
    branches = [
        one.changed(
            angle_deg=one.angle_deg + float(rng.normal(0.0, 60.0 * share)),
            length_mm=max(40.0, one.length_mm * float(np.exp(rng.normal(0.0, 2.0 * share)))),
        )
        for one in design.branches
    ]
    return Design.of_branches(branches, trunk_length_mm=design.trunk_length_mm, build=design.build)


@pytest.mark.parametrize(
    "count", [12, pytest.param(500, marks=pytest.mark.thorough)], ids=["few", "many"]
)
def test_trees_without_a_penalty_break_no_rule(count):
    """The full check sees outlines, seams and laser paths; the penalty none of them."""
    rng, told = np.random.default_rng(5), {(one, two): 0 for one in (0, 1) for two in (0, 1)}
    bases = [Design.read(name) for name in ("grid_explorer", "cave_explorer")]
    for number in range(count):
        design = moved(bases[number % 2], rng, (0.01, 0.04, 0.08, 0.12)[number // 2 % 4])
        penalty, broken = PENALTY(design), PENALTY.broken(design)
        if broken is None:
            continue  # a joint that only a simulation tells of
        told[penalty > 0.0, bool(broken)] += 1
    assert sum(told.values()) > count / 2
    assert min(told[0, 0], told[1, 1]) > 0
    assert told[0, 1] == 0
    # Joints judged a little too hard.
    assert told[1, 0] <= math.ceil(0.08 * sum(told.values()))
