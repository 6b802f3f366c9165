"""``vinefab inflate`` on the command line, and what it says of the shape."""

import json

import lib3mf
import numpy as np
import pytest
import trimesh

import vinefab as vf
from vinefab.model.design import design_text

COARSE = ("--across", 6, "-q")


def with_compensation(name, choice):
    design = vf.Design.read(name)
    return design.changed(build=design.build.changed(compensation=choice))


@pytest.fixture(scope="module")
def tree():
    return with_compensation("three_level_tree", "inflation")


@pytest.fixture(scope="module")
def inflated(tree):
    """The tree under pressure, once for all tests."""
    return vf.inflate(tree, across=6, progress=False)


def test_compensation_brings_tips_to_where_they_are_designed(inflated):
    assert inflated.deployed.mean_mm < 4.0
    assert inflated.other.mean_mm > 15.0
    content = inflated.numbers
    assert content["schema"] == "vinefab/inflation-1"
    assert content["tips"]["mean_mm"] == pytest.approx(inflated.deployed.mean_mm, abs=1e-3)
    assert content["other"]["compensation"] == "none"
    assert content["standing"] == {"shape": "simulated", "modulus": "assumed"}
    assert len(content["tips"]["each"]) == 6
    for row in content["branches"][1:]:
        assert row["expected_deg"] == pytest.approx(row["designed_deg"], abs=1.5)
        assert row["in_robot_deg"] == pytest.approx(row["expected_deg"], abs=1.5)
    assert [row["count"] for row in content["joints"]] == [1, 3]
    assert all(row["crotch_load"] > 1.0 and row["passage"] <= 1.0 for row in content["joints"])


def test_joints_free_in_space_bow_where_film_is_stiff():
    level = vf.Level.of(branches=2, length_mm=60.0, angle_deg=80.0)
    build = vf.Build.standard(2).changed(pressure_kpa=0.9)
    design = vf.Design(name="pair", trunk_length_mm=60.0, levels=(level,), build=build)
    found = vf.inflate(design, alone=True, free=True, across=6, progress=False)
    (row,) = found.numbers["free"]
    assert row["level"] == 2
    assert 12.0 < row["bow_deg"] < 31.0
    # p W^3 is 12 mJ, of which bowing frees some ten thousandths.
    assert 1e-4 < row["freed_mj"] < 0.1
    assert "Joints free in space" in "\n".join(found.summary)


def test_picture_and_page_show_pattern_shape_and_design(inflated):
    picture = inflated.picture(".svg").decode()
    page = inflated.page()
    assert inflated.picture(".png").startswith(b"\x89PNG")
    for word in ("deployed", "designed", "flat, as cut", "tip: from designed to deployed"):
        assert word in picture
    assert "Seen from above" in page
    assert "Not simulated: contact of branches" in page


def read(path):
    """Return a mesh as another program reads it."""
    if path.suffix != ".3mf":
        return trimesh.load(path, force="mesh")
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)  # noqa: FBT003  its own way
    reader.ReadFromFile(str(path))
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter
    parts = model.GetMeshObjects()
    parts.MoveNext()
    part = parts.GetCurrentMeshObject()
    points = [list(one.Coordinates) for one in part.GetVertices()]
    faces = [list(one.Indices) for one in part.GetTriangleIndices()]
    return trimesh.Trimesh(points, faces)


@pytest.mark.parametrize("ending", ["stl", "obj", "3mf", "ply"])
def test_the_mesh_is_closed_and_holds_the_simulated_gas(inflated, tmp_path, ending):
    path = tmp_path / f"tree.{ending}"
    path.write_bytes(inflated.mesh(f".{ending}"))
    solid = read(path)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    robot = inflated.robot
    unit_mm = float(robot.layout.width_mm[0])
    half = robot.sheet.membrane.volume(robot.equilibrium.positions) * unit_mm**3
    assert solid.volume == pytest.approx(2.0 * half, rel=1e-5)
    assert np.abs(solid.bounds[:, 2]).max() < unit_mm / 2.0


def test_a_vine_cut_as_designed_grows_longer(vinefab, tmp_path):
    path = tmp_path / "vine.toml"
    path.write_text(design_text(with_compensation("plain_vine", "none")))
    page, mesh, numbers = (tmp_path / f"vine.{end}" for end in ("html", "stl", "json"))
    code, out, errors = vinefab(
        "inflate", path, *COARSE, "--out", page, "--mesh", mesh, "--json", numbers
    )
    assert (code, out, errors) == (0, "", "")
    assert page.is_file()
    assert mesh.is_file()
    content = json.loads(numbers.read_text())
    assert content["compensation"] == "none"
    assert content["tips"]["mean_mm"] > 10.0 * content["other"]["mean_mm"]
    assert content["reproduce"]["command"].startswith("vinefab inflate ")


def test_branches_that_cross_on_the_sheet_are_named(vinefab, tmp_path):
    path = tmp_path / "cave.toml"
    below = [
        vf.Level.of(branches=n, length_mm=length, angle_deg=angle, growth_percent=growth)
        for n, length, angle, growth in (
            (4, 86.0, 160.0, 137.0), (2, 98.0, 44.0, 155.0), (2, 87.0, 70.0, 125.0),
        )
    ]  # fmt: skip
    build = vf.Build.standard(4, 24.0, 0.65).changed(compensation="inflation")
    cave = vf.Design(name="cave", trunk_length_mm=40.0, levels=tuple(below), build=build)
    path.write_text(design_text(cave))
    picture = tmp_path / "cave.svg"
    code, _, errors = vinefab("inflate", path, "--alone", "--out", picture, "-q")
    assert code == 2
    (line,) = errors.splitlines()
    assert "branches 0.0.1.1 and 0.1.0.0" in line
    assert "change the angle of level 2" in line
    assert not picture.exists()


def test_a_joint_that_cannot_be_cut_is_named():
    narrow = vf.Level.of(branches=4, length_mm=80.0, angle_deg=20.0)
    design = vf.Design(name="narrow", trunk_length_mm=100.0, levels=(narrow,),
                       build=vf.Build.standard(2).changed(compensation="inflation"))  # fmt: skip
    with pytest.raises(vf.BadInputError, match=r"level 2.*change the angle or the number"):
        vf.inflate(design, alone=True, progress=False)
