"""The contact coupon: its walls, its solid, and growth on it from the printed board to the fit."""

import csv
import json
import math

import numpy as np
import pytest
import shapely
import trimesh

from vinefab.app.making import rig
from vinefab.cli.main import main
from vinefab.core.errors import BadInputError
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.observation.surface_fit import fit_contact_table
from vinefab.rig.contact_test import contact_lanes
from vinefab.rig.part import Printer


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = rig(printer="generic_220", out=tmp_path_factory.mktemp("rig") / "coupon",
               contact_test=True, surface="grey_pla", pictures=False, progress=False)  # fmt: skip
    return made.path


def wall_angle_deg(folder, start):
    """The angle from head-on of the first wall that a printed board has ahead of a start.

    Read from the triangles of the STL, as the board lies in the map.
    """
    record = json.loads((folder / "rig.json").read_text())
    (part,) = record["parts"]
    mesh = trimesh.load_mesh(folder / part["file"])
    mesh.apply_transform(np.array(part["transform_to_map"]))
    origin = np.array([start.x_mm, start.y_mm, 0.5 * mesh.bounds[1][2]])
    ahead = np.array([math.cos(start.heading_rad), math.sin(start.heading_rad), 0.0])
    corner, *edges = np.moveaxis(mesh.triangles, 1, 0)
    # Where the ray meets each triangle's plane, in shares of its edges.
    matrix = np.stack([edges[0] - corner, edges[1] - corner, np.tile(-ahead, (len(corner), 1))], 2)
    crossing = np.abs(np.linalg.det(matrix)) > 1e-9
    one, two, away = np.linalg.solve(matrix[crossing], (origin - corner[crossing])[..., None])[
        ..., 0
    ].T
    hit = (one >= 0.0) & (two >= 0.0) & (one + two <= 1.0) & (away > 0.0)
    first = np.flatnonzero(crossing)[np.flatnonzero(hit)[away[hit].argmin()]]
    return math.degrees(math.acos(-float(mesh.face_normals[first] @ ahead)))


def test_the_printed_walls_are_met_at_their_angles(folder):
    lanes = contact_lanes()
    found = [wall_angle_deg(folder, lane.start) for lane in lanes]
    assert found == pytest.approx(range(5, 45, 5), abs=0.02)
    assert [lane.angle_deg for lane in lanes] == [*range(5, 45, 5)]


def test_the_board_is_one_closed_solid_on_one_bed(folder):
    (part,) = folder.glob("*.stl")
    mesh = trimesh.load_mesh(part)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert (mesh.extents <= [210.0, 210.0, 250.0]).all()
    assert [path.name for path in folder.glob("*.3mf")] == ["bed_01.3mf"]
    assert json.loads((folder / "rig.json").read_text())["options"]["surface"] == "grey_pla"


def test_tubes_have_room_next_to_each_wall(folder):
    world, strip = Map.read(folder / "contact_test.geojson"), Design.read(folder / "strip.toml")
    assert world.surface == ""  # not measured yet: growth would not know it
    diameter_mm = 2.0 * GrowthOptions().radius_mm(strip.build.widths_mm[0])
    walls = shapely.union_all([*world.obstacles, world.bounds.exterior])
    for lane in contact_lanes():
        others = walls - lane.wall.buffer(1e-6)
        assert others.distance(shapely.Point(lane.end_mm)) > diameter_mm


@pytest.mark.parametrize("half_angle_deg", [3.0, 12.0, 33.0])
def test_a_campaign_on_the_board_gives_the_half_angle_back(folder, tmp_path, half_angle_deg):
    world, strip = Map.read(folder / "contact_test.geojson"), Design.read(folder / "strip.toml")
    starts = [start.pose for start in world.starts]
    rows = list(csv.DictReader((folder / "contacts.csv").read_text().splitlines()))
    assert len(rows) == 40
    for row in rows:
        lane = contact_lanes()[int(float(row["angle_from_head_on_deg"]) / 5) - 1]
        assert lane.start in starts
        grown = strip.grow(world, lane.start, head_on_half_angle_deg=half_angle_deg)
        ahead = np.array([math.cos(lane.start.heading_rad), math.sin(lane.start.heading_rad)])
        past = (grown.tips_mm[0] - lane.end_mm) @ ahead
        row["grew_on"] = "yes" if past > 0.0 else "no"
    path = tmp_path / "contacts.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    (found,) = fit_contact_table(path).surfaces
    assert found.surface == "grey_pla"
    assert found.half_angle_deg.low <= half_angle_deg <= found.half_angle_deg.high
    assert found.half_angle_deg.high - found.half_angle_deg.low <= 5.0


def test_a_table_that_was_filled_in_is_kept(folder, capsys):
    table = folder / "contacts.csv"
    before = table.read_text()
    table.write_text(before.replace("5,,", "5,no,", 1))
    call = ["rig", "--contact-test", "--surface", "grey_pla", "--no-pictures", "--out", folder]
    call += ["--printer", "generic_220"]
    assert main([*map(str, call)]) == 0
    assert "contacts.csv, filled in, is kept" in capsys.readouterr().out
    assert table.read_text() != before
    assert main([*map(str, call), "--height-mm", "25"]) == 2
    assert "was filled in; copy it, or name another folder" in capsys.readouterr().err
    table.write_text(before)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"scale": 2.0}, "scale is given for the contact test"),
        ({"style": "board"}, "style is given for the contact test"),
        ({"lid": True}, "lid goes with a map"),
        ({"world": "grid.geojson"}, "world goes with a map"),
        ({"printer": Printer(name="small", bed_width_mm=150, bed_depth_mm=150, height_mm=150)},
         "the bed of small has 140 x 140 mm, and the contact test takes 176 x 198 mm"),
    ],
)  # fmt: skip
def test_what_does_not_go_with_it_is_one_line(tmp_path, more, words):
    with pytest.raises(BadInputError) as raised:
        rig(**{"printer": "generic_220", "contact_test": True, **more}, out=tmp_path / "coupon")
    assert words in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1


def test_without_a_map_or_the_test_nothing_is_made(tmp_path, capsys):
    assert main(["rig", "--out", str(tmp_path / "rig")]) == 2
    assert capsys.readouterr().err == "error: map is missing; give a map file, or --contact-test\n"
