"""The base holder as made: bore, place and holes measured on the triangles of its STL files."""

import json
import math
import shutil
import subprocess

import numpy as np
import pytest
import shapely
from shapely import box

from vinefab.core.errors import BadInputError
from vinefab.model.design import Collar, Design
from vinefab.model.map import Pose, Start
from vinefab.rig import holder as module
from vinefab.rig.holder import ASSUMED_COLLAR_MM, CLAMP_MM
from vinefab.rig.make import RigRequest, make_rig
from vinefab.rig.part import RigOptions, manifold_of
from vinefab.rig.part_files import read_stl
from vinefab.rig.solid import outlines_at

WALLS = (box(40, 90, 80, 130), box(120, 90, 160, 130))


def spread(degrees, x_mm=100.0, y_mm=35.0, heading_deg=90.0):
    pose = Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=math.radians(heading_deg))
    return Start(pose=pose, spread_heading_rad=math.radians(degrees))


def made_of(world, printer, design=None, **sizes):
    options = RigOptions(**{"style": "plate", "markers": "none", **sizes})
    return make_rig(world, printer, options, RigRequest(design=design, pictures=False))


def standing(made):
    """Return the corners of each part of the holder where it stands, in mm of the rig, and faces.

    z = 0 is the floor; x and y count from the map's own origin, times the scale.
    """
    content = json.loads(made.files["rig.json"])
    scale, parts = content["options"]["scale"], {}
    for part in content["extras"]:
        if part["name"].startswith("base_"):
            mesh, to_map = read_stl(made.files[part["file"]]), np.array(part["transform_to_map"])
            points = mesh.vertices_mm @ to_map[:3, :3].T + to_map[:3, 3]
            parts[part["name"]] = scale * points, mesh.faces
    return parts, content["base_holder"]


def bore_of(points, faces, start, heading_rad, axis_mm):
    """Return the distances from the tube's axis of the triangles that face it."""
    forward = np.array([math.cos(heading_rad), math.sin(heading_rad), 0.0])
    left = np.array([-forward[1], forward[0], 0.0])
    away = points - (*start, axis_mm)
    across = np.stack([away @ left, away[:, 2]], axis=1)[faces]
    corners = points[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.stack([normal @ left, normal[:, 2]], axis=1)
    middle = across.mean(axis=1)
    radial = -(normal * middle).sum(axis=1) / np.linalg.norm(middle, axis=1)
    curved = (radial > 0.99) & (np.ptp(np.linalg.norm(across, axis=2), axis=1) < 0.05)
    return -(normal * across[:, 0]).sum(axis=1)[curved]


@pytest.mark.parametrize(("scale", "heading_deg"), [(1.0, 90.0), (1.25, 70.0)])
def test_the_bore_has_the_collars_diameter_at_the_trunks_height(
    make_map, make_printer, scale, heading_deg
):
    design = Design.read("plain_vine")
    build = design.build.changed(collar=Collar(clamp_diameter_mm=22.0))
    design = design.changed(build=build)
    world = make_map(*WALLS, starts=(spread(0.0, heading_deg=heading_deg),))
    printer = make_printer()
    made = made_of(world, printer, design, scale=scale, entry_width_mm=60.0)
    parts, content = standing(made)
    assert content["tube_mm"] == 22.0
    assert content["tube_standing"] == "the design's collar"
    assert content["axis_mm"] == pytest.approx(40.0 / math.pi)  # the trunk's inflated radius
    for name in ("base_block", "base_cap"):
        distance = bore_of(
            *parts[name],
            (scale * 100.0, scale * 35.0),
            math.radians(heading_deg),
            content["axis_mm"],
        )
        assert len(distance) > 40
        assert distance == pytest.approx(11.0 + printer.clearance_mm, abs=2e-3)
    # In front of the block, up to the mouth, stands nothing but the tube.
    forward = np.array([math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))])
    along = (parts["base_block"][0][:, :2] - scale * np.array([100.0, 35.0])) @ forward
    assert along.max() == pytest.approx(-content["reach_mm"], abs=1e-3)
    assert np.ptp(along) == pytest.approx(CLAMP_MM, abs=1e-3)


def outline_of(points, faces):
    triangles = shapely.polygons(points[faces][:, :, :2])
    return shapely.union_all(triangles[shapely.area(triangles) > 1e-9])


def test_nothing_of_it_stands_in_the_rig_or_in_the_robots_way(make_map, make_printer):
    made = made_of(make_map(*WALLS, starts=(spread(20.0),)), make_printer(), entry_width_mm=60.0)
    parts, content = standing(made)
    walls, plate = made.rig.walls, made.rig.plate
    block = outline_of(*parts["base_block"])
    dial = manifold_of(*parts["base_dial"])
    for angle in content["headings_deg"]:
        turned = shapely.affinity.rotate(block, angle, origin=(100.0, 35.0))
        assert turned.intersection(plate).area == 0.0
        tube = shapely.affinity.rotate(
            box(100 - 12.75, 0, 100 + 12.75, 35), angle, origin=(100.0, 35.0)
        )
        assert tube.intersection(walls).area == 0.0
        for z_mm in (1.0, 5.0):
            assert outlines_at(dial, z_mm).intersection(tube).area < 1e-6
            assert outlines_at(dial, z_mm).intersection(turned).area < 1e-6
    # Below the floor's level the dial keeps off the plate, above it off the walls by the clearance.
    assert outlines_at(dial, -1.5).intersection(plate).area < 1e-3
    hooks = outlines_at(dial, 5.0)
    assert len(shapely.get_parts(hooks)) == 2
    assert hooks.distance(walls) == pytest.approx(0.2, abs=5e-3)
    assert hooks.intersection(plate).area > 20.0


def test_its_dial_makes_room_for_a_corner_marker(make_map, make_printer):
    world = make_map(*WALLS, starts=(spread(0.0, x_mm=65.0),))
    made = made_of(world, make_printer(), markers="print")
    dial = outline_of(*standing(made)[0]["base_dial"])
    content = json.loads(made.files["rig.json"])
    for part in content["extras"]:
        if part["name"].startswith("marker_"):
            mesh, to_map = read_stl(made.files[part["file"]]), np.array(part["transform_to_map"])
            tile = outline_of(mesh.vertices_mm @ to_map[:3, :3].T + to_map[:3, 3], mesh.faces)
            assert dial.intersection(tile).area == 0.0
            if part["name"] == "marker_0":
                assert dial.distance(tile) == pytest.approx(0.2, abs=0.01)


def test_its_pins_fit_the_holes_of_every_heading(make_map, make_printer):
    made = made_of(make_map(*WALLS, starts=(spread(20.0),)), make_printer(), entry_width_mm=60.0)
    parts, content = standing(made)
    headings = content["headings_deg"]
    assert headings == [-20.0, -10.0, 0.0, 10.0, 20.0]
    dial, block = (manifold_of(*parts[name]) for name in ("base_dial", "base_block"))
    plate = outlines_at(dial, -2.5)
    pins = outlines_at(block, -2.5)
    assert len(shapely.get_parts(pins)) == 2
    for angle in headings:
        turned = shapely.affinity.rotate(pins, angle, origin=(100.0, 35.0))
        assert plate.intersection(turned).area == 0.0
        assert plate.intersection(turned.buffer(0.3)).area > 0.0
    between = shapely.affinity.rotate(pins, headings[-1] + 4.0, origin=(100.0, 35.0))
    assert plate.intersection(between).area > 1.0


def test_a_tube_nobody_gave_is_said_to_be_assumed(make_map, make_printer):
    made = made_of(make_map(*WALLS), make_printer())
    _, content = standing(made)
    assert content["tube_mm"] == ASSUMED_COLLAR_MM
    assert "assumed" in content["tube_standing"]
    assert any("assumed" in note for note in made.rig.notes)
    made = made_of(make_map(*WALLS), make_printer(), collar_mm=18.0)
    assert (standing(made)[1]["tube_mm"], standing(made)[1]["tube_standing"]) == (18.0, "given")


def test_a_wide_tube_lies_higher_and_says_so(make_map, make_printer):
    design = Design.read("plain_vine")
    made = made_of(
        make_map(*WALLS), make_printer(), design, collar_mm=50.0, entry_width_mm=70.0, scale=1.5
    )
    assert standing(made)[1]["axis_mm"] > 20.0
    assert any("not at the trunk's radius 12.7 mm" in note for note in made.rig.notes)


@pytest.mark.parametrize(
    ("start", "sizes", "reason"),
    [
        (spread(0.0, y_mm=140.0), {"entry_reach_mm": 40.0}, "comes up through the plate"),
        (spread(0.0), {"entry_width_mm": 20.0}, "widen --entry-mm"),
        (spread(0.0, x_mm=30.0, y_mm=25.0), {"markers": "print"}, "--markers none"),
    ],
)
def test_where_no_holder_can_stand_it_is_said_or_refused(
    make_map, make_printer, start, sizes, reason
):
    world = make_map(box(60, 100, 90, 130), starts=(start,))
    made = made_of(world, make_printer(), **sizes)
    assert json.loads(made.files["rig.json"])["base_holder"] is None
    assert any("no base holder" in note and reason in note for note in made.rig.notes)
    with pytest.raises(
        BadInputError, match=rf"^base_start: no holder can stand at start 1: .*{reason}"
    ):
        made_of(world, make_printer(), base_start=1, **sizes)


def test_a_holder_that_is_no_closed_solid_never_forbids_the_rig(
    make_map, make_printer, monkeypatch
):
    monkeypatch.setattr(module, "mesh_problems", lambda *_: ("is not closed",))
    made = made_of(make_map(*WALLS), make_printer())
    assert made.files
    assert any("no base holder: its dial comes out as no" in note for note in made.rig.notes)


def test_a_start_that_is_not_there_is_refused(make_map, make_printer):
    with pytest.raises(BadInputError, match=r"^base_start is 2; allowed: 0 to 1"):
        made_of(make_map(*WALLS), make_printer(), base_start=2)
    with pytest.raises(BadInputError, match=r"^collar_mm is 1"):
        RigOptions(collar_mm=1.0)


@pytest.mark.skipif(not shutil.which("admesh"), reason="no admesh")
def test_admesh_finds_closed_solids(make_map, make_printer, tmp_path):
    world = make_map(*WALLS, starts=(spread(15.0, heading_deg=80.0),))
    made = made_of(world, make_printer(), markers="print", entry_width_mm=60.0)
    names = [name for name in made.files if name.startswith(("base_", "marker_"))]
    assert len(names) == 7
    for name in names:
        (tmp_path / name).write_bytes(made.files[name])
        said = subprocess.run(
            ["admesh", "--exact", str(tmp_path / name)], check=True, capture_output=True
        ).stdout.decode(errors="replace")  # it prints the header of the file as it is
        counts = [
            line.split(":")[1].split() for line in said.splitlines() if "disconnected" in line
        ]
        assert counts
        assert all(set(count) == {"0"} for count in counts), said
        assert "Degenerate facets     :     0" in said
