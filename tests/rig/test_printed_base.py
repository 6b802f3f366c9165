"""The printed base as made: sizes, walls and fits measured on the triangles of its STL files."""

import io
import json
import math
import shutil
import subprocess
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
import trimesh
from shapely import box

from vinefab.core.errors import BadInputError
from vinefab.model.design import Collar, Design
from vinefab.model.map import Pose, Start
from vinefab.rig.make import RigRequest, make_rig
from vinefab.rig.part import RigOptions, manifold_of

WALLS = (box(40, 90, 80, 130), box(120, 90, 160, 130))
HOLDER = ("base_block", "base_cap", "base_dial")
CORD_MM, LEAST_WALL_MM = 2.0, 1.2


def made_of(world, printer, design=None, *, base=True, **sizes):
    options = RigOptions(**{"style": "plate", "markers": "none", "entry_width_mm": 60.0} | sizes)
    return make_rig(world, printer, options, RigRequest(design=design, pictures=False, base=base))


def start_at(y_mm=35.0, spread_deg=20.0):
    pose = Pose(x_mm=100.0, y_mm=y_mm, heading_rad=math.pi / 2)
    return Start(pose=pose, spread_heading_rad=math.radians(spread_deg))


@pytest.fixture(scope="module")
def made(make_map, make_printer):
    """Bases of a narrow, a plain and a large robot, the last with a collar."""
    world, printer = make_map(*WALLS, starts=(start_at(),)), make_printer(height_mm=250.0)
    vine = Design.read("plain_vine")
    tree = Design.read("three_level_tree")
    collared = tree.build.changed(collar=Collar(clamp_diameter_mm=30.0))
    designs = {"scout": Design.read("scout"), "vine": vine, "tree": tree.changed(build=collared)}
    return {name: made_of(world, printer, one) for name, one in designs.items()}


NAMES = ("scout", "vine", "tree")


def mesh_of(rig, name):
    return trimesh.load(io.BytesIO(rig.files[f"{name}.stl"]), file_type="stl")


def placed(rig, name):
    """Return a part where it stands in the rig: corners in mm of the rig, and faces."""
    content = json.loads(rig.files["rig.json"])
    (part,) = (one for one in content["extras"] if one["name"] == name)
    mesh, to_map = mesh_of(rig, name), np.array(part["transform_to_map"])
    scale = content["options"]["scale"]
    return scale * trimesh.transform_points(mesh.vertices, to_map), mesh.faces


def level(mesh, z_mm):
    """Return the section of a part as printed, from the lines in which it cuts the triangles."""
    lines = trimesh.intersections.mesh_plane(mesh, [0, 0, 1], [0, 0, z_mm])
    flat = shapely.set_precision(shapely.linestrings(lines[:, :, :2]), 1e-5)
    return shapely.build_area(shapely.union_all(flat))


@pytest.mark.parametrize("name", NAMES)
def test_body_and_lid_are_closed_solids_of_their_stated_volume(made, name):
    for part in made[name].fixtures.printed.parts:
        mesh = mesh_of(made[name], part.name)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.body_count == 1
        assert mesh.volume == pytest.approx(part.volume_mm3, rel=1e-4)


@pytest.mark.parametrize("name", NAMES)
def test_tube_bore_and_walls_have_their_sizes(made, name):
    content = json.loads(made[name].files["rig.json"])
    base, holder = content["printed_base"], content["base_holder"]
    body = mesh_of(made[name], "base_body")
    assert base["tube_mm"] == pytest.approx(holder["tube_mm"])
    if name == "tree":
        assert base["tube_mm"] == 30.0
    high_mm = body.extents[2]
    seat_mm = high_mm - holder["reach_mm"] - 15.0  # the middle of the clamp, 30 mm long
    for z_mm in (high_mm - 1.0, seat_mm):
        ring = level(body, z_mm)
        (inner,) = ring.interiors
        outer_mm, inner_mm = (
            2.0 * math.sqrt(shapely.Polygon(one).area / math.pi) for one in (ring.exterior, inner)
        )
        wanted = base["tube_mm"] - (1.5 * CORD_MM if z_mm == seat_mm else 0.0)
        assert outer_mm == pytest.approx(wanted, rel=2e-3)
        assert inner_mm == pytest.approx(base["bore_mm"], rel=2e-3)
    walls = []
    for z_mm in np.linspace(0.3, high_mm - 0.3, 60).tolist():
        for piece in shapely.get_parts(level(body, z_mm)):
            rings = [piece.exterior, *piece.interiors]
            walls += [one.distance(other) for one, other in combinations(rings, 2)]
    assert min(walls) > LEAST_WALL_MM - 0.01


@pytest.mark.parametrize("name", NAMES)
def test_the_chamber_stores_the_film(made, name):
    """Its room, measured as what a plug of the outside has more, against the film's volume."""
    rig, body = made[name], mesh_of(made[name], "base_body")
    long_mm, wide_mm, high_mm = json.loads(rig.files["rig.json"])["printed_base"]["chamber_mm"]
    room_mm2 = max(shapely.Polygon(one).area for one in level(body, 0.5 * long_mm).interiors)
    assert room_mm2 < wide_mm * high_mm
    tree = Design.read({"vine": "plain_vine", "tree": "three_level_tree"}.get(name, name)).tree
    film_mm3 = 2 * 0.05 * float((tree.length_mm * tree.width_mm).sum())
    assert film_mm3 <= 0.1 * 1.001 * room_mm2 * long_mm


@pytest.mark.parametrize("name", NAMES)
def test_it_fits_the_holder_at_every_heading_and_touches_nothing(made, name):
    rig = made[name]
    holder = json.loads(rig.files["rig.json"])["base_holder"]
    body, lid = (manifold_of(*placed(rig, part)) for part in ("base_body", "base_lid"))
    block, cap, dial = (manifold_of(*placed(rig, part)) for part in HOLDER)
    for part in (block, cap):
        assert (body ^ part).volume() == 0.0
        # The tube fills the bore but for the clearance: a little wider, and it would not pass.
        assert body.min_gap(part, 1.0) == pytest.approx(
            0.5 * (holder["bore_mm"] - holder["tube_mm"]), abs=0.02
        )
    assert (body ^ lid).volume() < 1e-3
    assert body.min_gap(lid, 1.0) == pytest.approx(0.0, abs=1e-3)
    parts = [manifold_of(*_in_rig(one)) for one in rig.rig.parts]
    assert len(holder["headings_deg"]) > 1
    for angle in holder["headings_deg"]:
        for one in (body, lid):
            turned = one.translate((-100, -35, 0)).rotate((0, 0, angle)).translate((100, 35, 0))
            for other in (dial, *parts):
                assert (turned ^ other).volume() < 1e-6
    # It stands on the table: the plate's thickness below the floor.
    assert placed(rig, "base_body")[0][:, 2].min() == pytest.approx(-3.0, abs=1e-3)


def _in_rig(part):
    return trimesh.transform_points(part.vertices_mm, part.to_map), part.faces


def test_the_lids_holes_meet_those_of_the_body(made):
    rig = made["scout"]
    body, lid = placed(rig, "base_body"), placed(rig, "base_lid")
    # Heading up the map, the rim is at the least y: cut both there, across the tube.
    rear_mm = body[0][:, 1].min()
    assert lid[0][:, 1].max() == pytest.approx(rear_mm, abs=1e-3)
    places = []
    for points, faces, y_mm in ((*body, rear_mm + 5.0), (*lid, rear_mm - 1.0)):
        mesh = trimesh.Trimesh(points[:, [0, 2, 1]] * (1, 1, -1), faces)
        holes = [shapely.Polygon(one) for one in level(mesh, -y_mm).interiors]
        small = [one for one in holes if one.area < 12.0]
        places.append(sorted(tuple(np.round(one.centroid.coords[0], 2)) for one in small))
        assert len(small) == 4
    assert np.abs(np.array(places[0]) - places[1]).max() < 0.02


def test_it_prints_without_supports(made):
    """Downward faces lean by 45 degrees at most; others are roofs of the seats and screw holes."""
    for name in NAMES:
        for part in ("base_body", "base_lid"):
            mesh = mesh_of(made[name], part)
            steep = mesh.face_normals[:, 2] < -math.sqrt(0.5) - 2e-3
            heights = mesh.triangles_center[steep][:, 2]
            assert set(np.round(heights[heights > 1e-3], 2)) <= {1.5, 12.0}


def test_a_rig_has_none_unless_asked(make_map, make_printer):
    rig = made_of(make_map(*WALLS), make_printer(), base=False)
    assert json.loads(rig.files["rig.json"])["printed_base"] is None
    assert not {"base_body.stl", "base.svg"} & set(rig.files)


@pytest.mark.parametrize(
    ("start", "sizes", "problem"),
    [
        (start_at(y_mm=140.0), {"entry_reach_mm": 40.0}, "comes up through the plate"),
        (start_at(), {"base_start": 0}, "base_start is 0"),
        (start_at(), {"collar_mm": 9.0}, "a tube of 9 mm leaves no bore.*--collar-mm"),
    ],
)
def test_where_it_cannot_be_made_it_is_refused(make_map, make_printer, start, sizes, problem):
    world = make_map(box(60, 100, 90, 130), starts=(start,))
    with pytest.raises(BadInputError, match=rf"^base: .*{problem}"):
        made_of(world, make_printer(), **sizes)


def test_a_printer_that_is_too_low_is_named(make_map, make_printer):
    rig = made_of(make_map(*WALLS), make_printer(), Design.read("plain_vine"))
    assert [finding.rule for finding in rig.report.blocking] == ["VF-R02"]
    assert "base_body is too high for bench" in rig.report.blocking[0].message


def test_its_drawing_is_the_section_of_the_solids(made):
    rig = made["scout"]
    root = ElementTree.fromstring(rig.files["base.svg"])  # noqa: S314
    texts = " ".join("".join(one.itertext()) for one in root.iter() if one.tag.endswith("text"))
    base = json.loads(rig.files["rig.json"])["printed_base"]
    assert f"Tube {base['tube_mm']:.2f} mm outside" in texts
    assert f"at most {base['seats']['ring_inside_mm']:.1f} mm inside" in texts
    body = mesh_of(rig, "base_body")
    holder = json.loads(rig.files["rig.json"])["base_holder"]
    lengths = [f"{holder['reach_mm']:.1f}", "30.0", f"{base['chamber_mm'][0]:.1f}"]
    assert set(lengths) <= set(texts.split())
    stops = [
        float(one)
        for one in texts.split("lid from behind")[0].split()
        if one.replace(".", "").isdigit()
    ]
    assert sum(stops[-5:]) == pytest.approx(body.extents[2], abs=0.3)


@pytest.mark.skipif(not shutil.which("admesh"), reason="no admesh")
def test_admesh_finds_closed_solids(made, tmp_path):
    for name in NAMES:
        for part in ("base_body.stl", "base_lid.stl"):
            (tmp_path / part).write_bytes(made[name].files[part])
            said = subprocess.run(
                ["admesh", "--exact", str(tmp_path / part)], check=True, capture_output=True
            ).stdout.decode(errors="replace")
            counts = [
                one.split(":")[1].split() for one in said.splitlines() if "disconnected" in one
            ]
            assert counts
            assert all(set(count) == {"0"} for count in counts), said
