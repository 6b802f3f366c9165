"""Forms of one robot agree in every room: mirrored, branch by branch, with bends of 0 degrees."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from shapely import affinity

import vinefab as vf
from tests.growth.test_bends import random_bent_tree
from tests.outline.free_trees import random_free_tree
from vinefab.fabrication.package.prepare import pressure_section
from vinefab.inflation.pattern import pattern_of
from vinefab.model.laser import read_profile
from vinefab.outline.body_outline import body_outline
from vinefab.prediction.pressure_window import window_over

RECIPE = "co2_60w__stretchlon_200"
ROUNDING_MM = 1e-9
"""Mirrored robots differ by the order of sums alone, in outline and growth."""


def mirrored(design):
    """The design with every turn the other way."""

    def turned(bends):
        return tuple((at_mm, -turn_deg) for at_mm, turn_deg in bends or ()) or None

    branches = [
        one.changed(angle_deg=-one.angle_deg, bends=turned(one.bends))
        for one in design.by_branches.branches
    ]
    free = design.by_branches
    return free.changed(
        trunk=free.trunk.changed(bends=turned(free.trunk.bends)), branches=tuple(branches)
    )


def images_of(design):
    """Return the row in the mirrored design of every branch of a design: names stay."""
    row = {name: n for n, name in enumerate(mirrored(design).names)}
    return [row[name] for name in design.by_branches.names]


def free_trees(count):
    return [random_free_tree(np.random.default_rng([12, seed]), 20) for seed in range(count)]


# --- Mirrored ------------------------------------------------------------------------------------


def test_mirrored_designs_have_mirrored_outlines():
    drawn = 0
    for design in free_trees(30):
        one, two = body_outline(design), body_outline(mirrored(design))
        assert len(one.problems) == len(two.problems)
        here, there = one.contour.points_mm * [1.0, -1.0], two.contour.points_mm
        assert len(here) == len(there)
        assert KDTree(there).query(here)[0].max() < ROUNDING_MM
        assert KDTree(here).query(there)[0].max() < ROUNDING_MM
        bulges = np.sort(np.abs(one.contour.bulges)), np.sort(np.abs(two.contour.bulges))
        assert np.abs(bulges[0] - bulges[1]).max() < 1e-9
        drawn += not one.problems
    assert drawn > 10


@pytest.mark.parametrize("body", ["centerline", "inflated"])
def test_mirrored_designs_grow_mirrored_on_mirrored_maps(body):
    contacts, flip = 0, [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    for number in range(30):
        design = random_bent_tree(np.random.default_rng([13, number]))
        world = vf.maps.grid(seed=number)
        other = vf.Map(
            name="mirrored",
            bounds=affinity.affine_transform(world.bounds, flip),
            obstacles=tuple(affinity.affine_transform(one, flip) for one in world.obstacles),
        )
        start = world.starts[0].pose
        options = {"body": body, "growth": {"pressure_stop": False}}
        here = design.grow(world, start, **options)
        flipped = (-start.x_mm, start.y_mm, 180.0 - start.heading_deg)
        there = mirrored(design).grow(other, flipped, **options)
        for row, image in enumerate(images_of(design)):
            assert here.stop[row] == there.stop[image], number
            chain = here.chain_mm(row) * [-1.0, 1.0]
            assert chain.shape == there.chain_mm(image).shape
            assert np.abs(chain - there.chain_mm(image)).max(initial=0.0) < ROUNDING_MM
            contacts += len(here.contacts_mm(row))
    assert contacts > 20


def test_mirrored_designs_have_mirrored_patterns():
    """Of a joint and its mirror image one is simulated, so that the images are exact."""
    design = vf.Design.of_branches(
        [
            vf.Branch(name="a", angle_deg=-70.0, length_mm=120.0, bends=((60.0, 25.0),)),
            vf.Branch(name="b", angle_deg=-5.0, length_mm=90.0),
            vf.Branch(name="c", angle_deg=48.0, length_mm=150.0),
        ],
        trunk_length_mm=150.0,
        trunk_bends=((80.0, 40.0),),
        build=vf.Build(trunk_width_mm=30.0),
    )
    profile = read_profile(RECIPE)
    one, two = (pattern_of(form, profile).flat.tree for form in (design, mirrored(design)))
    images = images_of(design)
    assert np.degrees(one.offset_rad + two.offset_rad[images]) == pytest.approx(0.0, abs=1e-6)
    assert one.length_mm == pytest.approx(two.length_mm[images], abs=1e-6)
    turns = [
        {int(branch): turn for branch, turn in zip(tree.bend_branch, tree.bend_rad, strict=True)}
        for tree in (one, two)
    ]
    for row, image in enumerate(images):
        if row in turns[0]:
            assert np.degrees(turns[0][row] + turns[1][image]) == pytest.approx(0.0, abs=0.01)
    assert len(turns[0]) == 2


# --- Branch by branch ----------------------------------------------------------------------------

OF_FORM = ("MANIFEST.sha256", "design.toml", "job.json")
"""Files of a package that say how the design is written."""


def pouched():
    return vf.Design(
        name="pouched",
        trunk_length_mm=160.0,
        levels=(
            vf.Level(branches=2, length_mm=120.0, angle_deg=90.0, bends=((70.0, 20.0),)),
            vf.Level(branches=2, length_mm=80.0, angle_deg=100.0, growth_percent=75.0),
        ),
        build=vf.Build(
            trunk_width_mm=50.0,
            taper=(1.0, 0.9, 0.9),
            pouch=vf.Pouch(shape="round", radius_mm=12.0),
            collar=vf.Collar(clamp_diameter_mm=40.0),
        ),
    )


@pytest.mark.parametrize(
    "name", [pytest.param("three_level_tree", marks=pytest.mark.thorough), "plain_vine", "pouched"]
)
def test_a_design_of_levels_is_made_of_the_same_bytes_branch_by_branch(name, tmp_path):
    levels = pouched() if name == "pouched" else vf.Design.read(name)
    free = levels.by_branches
    assert (levels.branches, free.levels) == (None, ())
    for form, robot in (("levels", levels), ("branches", free)):
        vf.fabricate(robot, RECIPE, out=tmp_path / form, allow_uncalibrated=True)
    one, two = (
        {str(path.relative_to(tmp_path / form)): path.read_bytes()
         for path in (tmp_path / form).rglob("*") if path.is_file()}
        for form in ("levels", "branches")
    )  # fmt: skip
    assert {"outline.dxf", "outline.svg", "outline.lbrn2", "report.html"} <= one.keys()
    assert one.keys() == two.keys()
    different = {file for file in one if one[file] != two[file]}
    assert different - {"checks.json", "report.html"} <= set(OF_FORM)
    found, again = (without_names(files["checks.json"]) for files in (one, two))
    assert found == again


def without_names(checks):
    """Return a report of checks without the sentences, which name levels or branches."""
    content = json.loads(checks)
    return [{**one, "message": "", "names": []} for one in content["findings"]]


@pytest.mark.parametrize("name", ["three_level_tree", "grid_explorer_levels"])
def test_a_design_of_levels_deploys_as_the_same_bytes_branch_by_branch(name):
    levels, world = vf.Design.read(name), vf.maps.grid(seed=3)
    grown = [vf.grow(one, world, history=4).json_text() for one in (levels, levels.by_branches)]
    assert grown[0] == grown[1]
    assert json.loads(grown[0])["history"]


# --- Bends of nothing ----------------------------------------------------------------------------


def test_bends_of_0_degrees_change_no_bit_of_an_outline():
    for design in free_trees(20):
        bent = with_bends_of_nothing(design)
        assert sum(len(one.bends or ()) for one in bent.branches) > len(bent.branches) / 2
        one, two = body_outline(design).contour, body_outline(bent).contour
        assert one.points_mm.tobytes() == two.points_mm.tobytes()
        assert one.bulges.tobytes() == two.bulges.tobytes()
        assert (one.parts, one.branches) == (two.parts, two.branches)


def with_bends_of_nothing(design):
    """Return the design with a bend of 0 degrees near the end of every branch."""
    branches, wide = [], dict(zip(design.names, design.tree.width_mm.tolist(), strict=True))
    for one in design.branches:
        width_mm = wide[one.name]
        last = max((at_mm for at_mm, _ in one.bends or ()), default=0.0)
        room = one.length_mm - last > 1.2 * width_mm
        more = ((last + 1.1 * width_mm, 0.0),) if room else ()
        branches.append(one.changed(bends=(*(one.bends or ()), *more) or None))
    return design.changed(branches=tuple(branches))


def test_bends_of_0_degrees_change_no_byte_of_a_package(tmp_path):
    design = vf.Design.read("three_level_tree").by_branches
    for form, robot in (("straight", design), ("bent", with_bends_of_nothing(design))):
        vf.fabricate(robot, RECIPE, out=tmp_path / form, allow_uncalibrated=True)
    files = sorted(path.name for path in (tmp_path / "straight").iterdir())
    assert len(files) > 10
    for name in files:
        if name not in OF_FORM:
            one, two = (Path(tmp_path / form / name) for form in ("straight", "bent"))
            assert one.read_bytes() == two.read_bytes(), name


# --- Own widths and pouches ----------------------------------------------------------------------


def own_widths(pouch_mm=18.0):
    """A robot whose branches have widths and a pouch that no level has."""
    disc = vf.Pouch(shape="round", radius_mm=pouch_mm / 2.0)
    return vf.Design.of_branches(
        [
            vf.Branch(name="left", angle_deg=60.0, length_mm=600.0, width_mm=22.0),
            vf.Branch(name="right", angle_deg=-50.0, length_mm=150.0),
            vf.Branch(name="tip", of="left", angle_deg=30.0, length_mm=300.0, width_mm=10.0),
            vf.Branch(name="end", of="left", angle_deg=-30.0, length_mm=300.0, width_mm=8.0,
                      pouch=disc),
        ],
        trunk_length_mm=200.0,
        build=vf.Build(trunk_width_mm=40.0),
    )  # fmt: skip


@pytest.mark.thorough
def test_tables_of_widths_have_those_of_the_branches():
    design, profile = own_widths(), read_profile(RECIPE)
    widths = [40.0, 24.0, 22.0, 8.0, 10.0]
    assert [one.width_mm for one in design.tubes] == widths
    names = ["trunk", "branch right", "branch left", "branch end", "branch tip"]
    assert [one.name for one in design.tubes] == names
    inflated = vf.inflate(design, RECIPE).numbers["tubes"]
    assert [one["branches"] for one in inflated] == names
    assert [one["flat_mm"] for one in inflated] == widths
    window = window_over(design, profile, np.array([5.0]), np.array([9.0]))
    found = [(one.name, one.width_mm) for one in window.levels]
    assert found == [*zip(names, widths, strict=True), ("pouch", 18.0)]
    (table,) = pressure_section(design, profile).tables
    assert [row[:2] for row in table.rows] == [
        (name, f"{width:.2f}") for name, width in zip(names, widths, strict=True)
    ]
    levels = vf.Design.read("three_level_tree")
    assert [row[0] for row in pressure_section(levels, profile).tables[0].rows] == ["1", "2", "3"]


def test_a_pressure_window_of_many_widths_has_the_widest():
    branches = [
        vf.Branch(name=f"b{n}", angle_deg=4.0 * n - 80, length_mm=90.0, width_mm=5.0 + 0.1 * n)
        for n in range(40)
    ]
    many = vf.Design.of_branches(branches, trunk_length_mm=100.0)
    window = window_over(many, read_profile(RECIPE), np.array([5.0]), np.array([9.0]))
    widths = [one.width_mm for one in window.levels]
    assert len(widths) == 12
    assert widths == pytest.approx([40.0, *(5.0 + 0.1 * n for n in range(29, 40))])


def test_a_pouch_of_one_branch_is_checked_as_those_of_all_are():
    found = vf.check(own_widths(7.0), RECIPE).findings
    (small,) = [one for one in found if "no wider than its branch" in one.message]
    assert (small.measured, small.limit, small.branches) == (7.0, 8.0, ("0.1.0",))
