"""Packages of robots in pieces, read back from their files and put together again."""

import csv
import io
import json
import math
import re

import ezdxf
import numpy as np
import pytest
import shapely
from ezdxf import path as ezpath

from tests.fabrication.pieces.test_partition import CROSSED, PROFILE, design, fan
from vinefab.fabrication.job.passes import weldcut_offset_mm
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.package.prepare import package, prepare
from vinefab.fabrication.pieces.partition import partition_of
from vinefab.model.design import Branch, Build, Design, PieceSettings, Pouch
from vinefab.outline.body_outline import body_outline, flat_layout

TREE = design(fan(3, 90.0, 110.0), fan(2, 140.0, 126.0), fan(2, 80.0, 84.0), pressure_kpa=12.0)
POUCHED = design(
    fan(2, 100.0, 60.0),
    fan(2, 150.0, 130.0),
    taper=(0.95, 0.9, 0.85),
    pouch=Pouch(shape="round", radius_mm=8.0),
)
LONG = design(fan(2, 500.0, 40.0), fan(2, 420.0, 40.0), trunk=400.0)
# Two bent branches that cross, one of them with children: cut behind its second bend.
BENT = Design.of_branches(
    [
        Branch(name="left", angle_deg=62.0, length_mm=260.0, bends=((60.0, -50.0), (130.0, -65.0)),
               width_mm=16.0, taper=0.8),
        Branch(name="right", angle_deg=-50.0, length_mm=270.0,
               bends=((70.0, 55.0), (140.0, 50.0))),
        Branch(name="one", of="left", angle_deg=-40.0, length_mm=80.0, width_mm=8.0),
        Branch(name="two", of="left", angle_deg=45.0, length_mm=70.0, width_mm=8.0,
               bends=((30.0, 40.0),)),
    ],
    trunk_length_mm=140.0,
    trunk_bends=((60.0, 25.0),),
    build=Build(trunk_width_mm=40.0, pieces=PieceSettings(most=6)),
    name="bent",
)  # fmt: skip


POUCHED_TURNED = POUCHED.changed(build=POUCHED.build.changed(mounting="turned"))
ROBOTS = {"TREE": TREE, "LONG": LONG, "POUCHED_TURNED": POUCHED_TURNED, "BENT": BENT}


@pytest.fixture(
    scope="module", params=[pytest.param("TREE", marks=pytest.mark.thorough), *list(ROBOTS)[1:]]
)
def made(request):
    one = ROBOTS[request.param]
    waived = prepare(one, PROFILE)
    return one, waived, package(waived)


def lines_of(data):
    """The centre lines of all cutting paths in a DXF, by another program's reader."""
    drawing = ezdxf.read(io.StringIO(data.decode()))
    found = []
    for entity in drawing.modelspace():
        if entity.dxf.layer in ("VF_30_WELDCUT", "VF_40_CUT"):
            points = [(p.x, p.y) for p in ezpath.make_path(entity).flattening(0.001)]
            found.append(shapely.LineString(points))
    return found


def bodies_of(files, sheet):
    """The areas that the paths of a sheet enclose: the holes between strokes as thin as nothing."""
    strokes = shapely.union_all(lines_of(files[f"sheet_{sheet}/outline.dxf"])).buffer(0.001)
    parts = shapely.get_parts(strokes).tolist()
    return [shapely.Polygon(hole).buffer(0.001) for part in parts for hole in part.interiors]


def back(body, transform):
    turn, dx, dy = (transform[key] for key in ("rotation_deg", "shift_x_mm", "shift_y_mm"))
    moved = shapely.affinity.translate(body, -dx, -dy)
    return shapely.affinity.rotate(moved, -turn, origin=(0, 0))


def filled(contour):
    """The area around which a contour runs at least once, and its area counted as often."""
    points = contour.flattened_mm(0.001)
    ring = shapely.LineString([*points.tolist(), points[0].tolist()])
    faces = shapely.get_parts(shapely.polygonize([shapely.node(ring)]))
    inside = []
    for face in faces.tolist():
        x, y = face.representative_point().coords[0]
        angles = np.unwrap(np.arctan2(*(np.vstack([points, points[:1]]) - (x, y)).T[::-1]))
        if abs(angles[-1] - angles[0]) > math.pi:
            inside.append(face)
    return shapely.union_all(inside)


def test_the_pieces_put_together_are_the_whole_robot(made):
    _, prepared, files = made
    one = prepared.cut
    job = json.loads(files["job.json"])
    layout = flat_layout(one)
    rows = {name: row for row, name in enumerate(layout.tree.ids)}
    sheets = {sheet: bodies_of(files, sheet) for sheet in {p["sheet"] for p in job["pieces"]}}
    assert sum(map(len, sheets.values())) == len(job["pieces"]) == len(prepared.partition.pieces)
    together = []
    for piece in job["pieces"]:
        # The end of the piece's root lies on it, whatever else does.
        root = shapely.Point(layout.end_mm[rows[piece["root"]]])
        mine = [
            body
            for body in (back(body, piece["transform"]) for body in sheets[piece["sheet"]])
            if body.contains(root)
        ]
        assert len(mine) == 1
        together += mine
    whole = filled(body_outline(one, weldcut_offset_mm(PROFILE)).contour)
    laps = []
    for joint in job["joints"]:
        row = rows[joint["branch"]]
        along = np.array([math.cos(layout.heading_rad[row]), math.sin(layout.heading_rad[row])])
        ends = [
            layout.start_mm[row] + along * at
            for at in sorted((joint["socket_rim_mm"], joint["blend_to_mm"]))
        ]
        ends = [ends[0] - 0.1 * along, ends[1] + 0.1 * along]
        wide = joint["lumen_width_mm"] / 2 + joint["socket_wider_mm"] / 2 + 1.0
        laps.append(shapely.LineString(ends).buffer(wide, cap_style="flat"))
    lap = shapely.union_all(laps)
    difference = shapely.union_all(together).symmetric_difference(whole).difference(lap)
    assert difference.area / whole.area < 1e-4
    # Within the laps the pieces cover the whole robot.
    assert whole.difference(shapely.union_all(together)).area / whole.area < 1e-4


def test_every_sheet_has_its_files_and_the_pieces_their_labels(made):
    _, prepared, files = made
    job = json.loads(files["job.json"])
    for number in range(1, len(prepared.job.sheets) + 1):
        assert {
            f"sheet_{number}/outline{end}" for end in (".dxf", "_polyline.dxf", ".svg", ".lbrn2")
        } <= set(files)
    assert not any(name.startswith("outline") for name in files)
    labels = [piece["label"] for piece in job["pieces"]]
    assert labels == [piece.label for piece in prepared.partition.pieces]
    assert [joint["label"] for joint in job["joints"]] == labels[1:]
    assert sorted(name for piece in job["pieces"] for name in piece["branches"]) == sorted(
        flat_layout(prepared.design).tree.ids
    )
    findings = {finding.rule for finding in prepared.report.findings}
    assert "VF-J05" not in findings


def test_a_package_says_how_its_own_pieces_are_joined(made):
    one, _, files = made
    job, readme = json.loads(files["job.json"]), files["README.txt"].decode()
    assert files["assembly.svg"].startswith(b"<?xml")
    assert files["assembly.pdf"].startswith(b"%PDF")
    assert "transform" not in readme
    assert "pieces, joints: in job.json" in readme
    section = " ".join(readme.split("\nJoin the pieces\n")[1].split("\nMount\n")[0].split())
    told = re.findall(
        r"Joint (\d+) of (\d+): plug (\w+) into socket (\w+) \(piece (\w+) (into|over) piece"
        r" (\w+), branch ([\d./]+), ([\d.]+) mm wide\), ([\d.]+) mm deep",
        section,
    )
    assert [int(step[0]) for step in told] == list(range(1, len(job["joints"]) + 1))
    joints = {joint["label"]: joint for joint in job["joints"]}
    assert {step[2] for step in told} == joints.keys()
    made_already: set[str] = set()
    for _, count, plug, socket, outer, way, inner, branch, wide, deep in told:
        joint = joints[socket]
        assert (count, plug, outer) == (str(len(joints)), socket, socket)
        goes_over = one.build.mounting == "turned"
        assert way == ("over" if goes_over else "into")
        ends = (inner, outer) if goes_over else (outer, inner)
        assert (*ends, branch) == (joint["plug_on"], joint["socket_on"], joint["branch"])
        assert float(wide) == pytest.approx(joint["lumen_width_mm"], abs=0.05)
        assert float(deep) == pytest.approx(abs(joint["plug_rim_mm"] - joint["socket_rim_mm"]))
        on_outer = {label for label, other in joints.items() if other["inner"] == outer}
        assert on_outer <= made_already
        made_already.add(socket)
    bill = {row["item"]: row for row in csv.DictReader(io.StringIO(files["bom.csv"].decode()))}
    assert float(bill["pieces"]["value"]) == len(job["pieces"])
    rims = math.fsum(2.0 * joint["lumen_width_mm"] for joint in job["joints"])
    assert float(bill["band length"]["value"]) == pytest.approx(rims, rel=1e-5)
    page = files["report.html"].decode()
    assert page.count("<h2>Pieces</h2>") == 1
    assert one.name in page


def test_a_robot_that_needs_one_piece_gives_the_files_it_gave():
    flat = design(fan(3, 120.0, 150.0))
    plain = flat.changed(build=flat.build.changed(pieces=None))
    assert len(partition_of(flat, PROFILE).pieces) == 1
    one, other = (package(prepare(each, PROFILE)) for each in (flat, plain))
    # The rules about pieces are run on the one and skipped on the other; its design asks for them.
    differ = {name for name in one if one[name] != other[name]}
    assert {"assembly.svg", "assembly.pdf"} <= one.keys()
    assert one.keys() == other.keys()
    assert differ <= {"design.toml", "checks.json", "report.html", "MANIFEST.sha256"}


@pytest.mark.parametrize(
    ("mounting", "face", "pieces"),
    [("tail_inverted", "inside", True), ("turned", "outside", False)],
)
def test_every_package_says_which_face_ends_outside(mounting, face, pieces):
    one = CROSSED if pieces else design(fan(3, 120.0, 150.0))
    files = package(prepare(one.changed(build=one.build.changed(mounting=mounting)), PROFILE))
    readme = " ".join(files["README.txt"].decode().split())
    job = json.loads(files["job.json"])
    told = f"the face that lies {face} as cut is outside"
    assert told in readme.split("Mount -")[1]
    assert told in job["design"]["build"]["faces"]
    assert job["design"]["build"]["mounting"] == mounting
    assert ("Turn the whole robot inside out" in readme) == (mounting == "turned")
    assert (b"mounting" in files["design.toml"]) == (mounting == "turned")
    if pieces:
        assert "Open plug and socket with a blunt tool" in readme


def test_copies_share_sheets_and_keep_their_pieces_apart():
    prepared = prepare(CROSSED, PROFILE, sheet=SheetOptions(copies=2))
    files = package(prepared)
    job = json.loads(files["job.json"])
    assert b"The sheets hold 2 robots: the steps are for each" in files["README.txt"]
    assert b"sleeve joints,2," in files["bom.csv"]
    assert [(piece["label"], piece["copy"]) for piece in job["pieces"]] == [
        ("A", 1),
        ("B", 1),
        ("A", 2),
        ("B", 2),
    ]
    assert not prepared.report.blocking


def test_sealed_and_cut_apart_the_socket_goes_over_the_web_too():
    prepared = prepare(CROSSED, PROFILE, sheet=SheetOptions(process="weld+cut"))
    assert not prepared.report.blocking
    facts = prepared.job.facts
    weld = PROFILE.recipe.by_operation["weld"].seam_width_mm.value
    assert facts["socket_wider_mm"] == pytest.approx(2.0 * (weld + 2.0) + 1.0)
    assert prepared.job.joints[0].socket_wider_mm == facts["socket_wider_mm"]
