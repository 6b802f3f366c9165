"""Skeletons as drawings, and back: the same tree to a millionth of a millimetre."""

import json
import math

import ezdxf
import numpy as np
import pytest
from pyogrio.raw import read as gdal_read
from shapely import box, from_wkb, get_coordinates

import vinefab as vf
from vinefab.cli.main import main
from vinefab.prediction.skeleton_files import KINDS, Skeleton, free_chains_mm

AT = vf.Pose(x_mm=310.0, y_mm=-40.5, heading_rad=math.radians(37.0))


def random_design(rng):
    """Return a design of up to 40 branches of own widths, half of them with bends."""
    names, branches = ["trunk"], []
    for number in range(int(rng.integers(1, 40))):
        length = float(rng.uniform(60, 200))
        bends = ((float(rng.uniform(10, 25)), 20.0), (length - 15.0, float(rng.uniform(-60, 60))))
        own = bends if rng.random() < 0.5 else None
        of = names[int(rng.integers(min(len(names), 8)))]
        width = float(rng.uniform(4, 9)) if rng.random() < 0.5 else None
        angle = float(rng.uniform(-100, 100))
        name = f"b{number}"
        branches.append(
            vf.Branch(
                name=name, of=of, angle_deg=angle, length_mm=length, bends=own, width_mm=width
            )
        )
        names.append(name)
    return vf.Design.of_branches(
        branches,
        trunk_length_mm=90.0,
        trunk_bends=((40.0, 15.0),),
        build=vf.Build(trunk_width_mm=12.0, width_ratio=0.8),
    )


def lines_of(chains):
    """Return the segments of chains, each from its lower left end, in order."""
    rows = np.concatenate([np.hstack([one[:-1], one[1:]]) for one in chains])
    turned = np.where((rows[:, :1] > rows[:, 2:3]), rows[:, [2, 3, 0, 1]], rows)
    return turned[np.lexsort(np.round(turned, 4).T)]


@pytest.mark.parametrize("suffix", sorted(KINDS))
def test_a_skeleton_that_is_written_is_read_back_as_the_same_tree(suffix, tmp_path):
    rng = np.random.default_rng(11)
    for _ in range(8):
        design = random_design(rng)
        path = tmp_path / f"skeleton{suffix}"
        vf.grow(design, pose=AT, out=path, force=True)
        base = (AT.x_mm, AT.y_mm) if suffix == ".csv" else None
        again = vf.Design.read(
            vf.new("design", tmp_path / "again.toml", skeleton=path, base=base,
                   snap_mm=1e-3, force=True)
        )  # fmt: skip
        x, y, heading_deg = again.origin["drawn_at"]
        assert heading_deg == pytest.approx(37.0, abs=1e-8)
        if suffix != ".svg":  # there the origin is the corner of the page
            assert (x, y) == pytest.approx((AT.x_mm, AT.y_mm), abs=1e-9)
        here = lines_of(free_chains_mm(design.tree.straight, AT))
        there = lines_of(free_chains_mm(again.tree.straight, AT))
        assert here.shape == there.shape
        assert np.abs(here - there).max() < 1e-6
        # A child of equal width that goes on alone is one branch with its parent when it is read.
        widths = sorted({*design.tree.width_mm.tolist()})
        assert sorted({*again.tree.width_mm.tolist()}) == pytest.approx(widths, abs=1e-9)


def test_free_chains_are_where_growth_leads_without_a_wall():
    design = random_design(np.random.default_rng(5))
    world = vf.Map(name="empty", bounds=box(-9e3, -9e3, 9e3, 9e3), environment="empty")
    grown = design.grow(
        world,
        AT,
        body="centerline",
        growth={"pressure_stop": False, "branch_contact": "pass", "emergence": 1.0},
    )
    for row, chain in enumerate(free_chains_mm(design.tree, AT)):
        assert np.abs(chain - grown.chain_mm(row)).max() < 1e-6


def test_other_programs_read_the_drawing_in_millimetres(tmp_path):
    design = vf.Design.read("scout")
    (chain,) = free_chains_mm(design.tree, vf.Pose(x_mm=0, y_mm=0, heading_rad=math.pi / 2))
    vf.grow(design, out=tmp_path / "scout.dxf")
    document = ezdxf.readfile(tmp_path / "scout.dxf")
    assert (document.header["$INSUNITS"], document.header["$MEASUREMENT"]) == (4, 1)
    assert not document.audit().errors
    (line,) = document.modelspace().query("LWPOLYLINE")
    assert np.abs(np.array(list(line.vertices())) - chain).max() < 1e-6
    assert line.dxf.const_width == 20.0
    (point,) = document.modelspace().query("POINT")
    assert (point.dxf.layer, point.dxf.location.xyz) == ("base", (0.0, 0.0, 0.0))
    _, _, shapes, _ = gdal_read(tmp_path / "scout.dxf")
    kinds = {one.geom_type: get_coordinates(one) for one in from_wkb(shapes)}
    assert np.abs(kinds["LineString"] - chain).max() < 1e-6
    vf.grow(design, out=tmp_path / "scout.geojson")
    _, _, shapes, _ = gdal_read(tmp_path / "scout.geojson")
    assert np.abs(get_coordinates(from_wkb(shapes)[0]) - chain).max() < 1e-6
    rows = np.genfromtxt(vf.grow(design, out=tmp_path / "s.csv") and tmp_path / "s.csv",
                         delimiter=",", names=True)  # fmt: skip
    assert rows["x2"] == pytest.approx(chain[1:, 0], abs=1e-6)
    assert rows["width"].tolist() == [20.0] * 4


def test_on_a_map_the_drawing_is_the_deployed_skeleton(tmp_path):
    world = vf.maps.grid(seed=3)
    vf.grow("three_level_tree", world, out=tmp_path / "grown.geojson")
    grown = vf.Design.read("three_level_tree").grow(world)
    features = json.loads((tmp_path / "grown.geojson").read_text())["features"]
    drawn = [one["geometry"]["coordinates"] for one in features if "id" in one["properties"]]
    out = np.flatnonzero(grown.deployed).tolist()
    assert [one["properties"]["id"] for one in features[:-1]] == [grown.tree.ids[k] for k in out]
    assert len(drawn) == len(out) > 1
    for row, line in zip(out, drawn, strict=True):
        assert np.array(line) == pytest.approx(grown.chain_mm(row), abs=1e-8)
    assert any(len(grown.contacts_mm(row)) for row in out)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("", "map is missing; give --map FILE, or --out FILE"),
        ("--body centerline --out s.csv", "--body needs a map"),
        ("--svg s.svg", "--svg needs a map"),
        ("--label --out s.csv", "--label needs a map"),
        ("--frames 3 --out s.csv", "--frames needs a map"),
        ("--start left --out s.csv", "--start needs a map"),
        ("--growth pressure_stop=false --out s.csv", "--growth needs a map"),
        ("--out s.png", "--out is 's.png'; allowed: a file name ending in .csv or .dxf"),
        ("--pose 1,2 --out s.csv", "pose"),
    ],
)
def test_what_needs_a_map_says_so(options, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["grow", "plain_vine", *options.split()]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_skeleton_is_also_json(capsys):
    assert main(["grow", "scout", "--json", "-"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["schema"] == "vinefab/skeleton-1"
    (branch,) = content["branches"]
    assert (branch["id"], branch["parent"], len(branch["points_mm"])) == ("0", None, 5)
    assert isinstance(vf.grow("scout"), Skeleton)
