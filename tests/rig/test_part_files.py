"""The files of a rig: every format of printed parts by one table, then the files of a whole rig."""

import csv
import io
import json
import os
import re
import subprocess
import zipfile
from dataclasses import replace

import lib3mf
import numpy as np
import pytest
import shapely
import trimesh
from shapely import Polygon, box

from vinefab.core.atomic import is_ours
from vinefab.core.errors import UnreadableFileError
from vinefab.core.hashing import sha256_of
from vinefab.model.map import Map, Pose, Start
from vinefab.rig.make import RigRequest, make_rig
from vinefab.rig.part import Printer, RigOptions, RigPart
from vinefab.rig.part_files import (
    PART_FORMATS,
    STL,
    THREEMF,
    PartItem,
    read_back_problems,
    read_threemf,
    stl_name,
)
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import stacked

# --- Every format


def _part(name, corners_mm, faces, volume_mm3):
    return RigPart(
        name=name, vertices_mm=corners_mm, faces=faces, to_map=np.eye(4), volume_mm3=volume_mm3
    )


def _stack(plate, solid, heights_mm):
    return stacked(polygon_parts(plate), polygon_parts(solid), *heights_mm)


PLATE = box(0, 0, 20, 10)
BLOCK = _part('a "b" & <c>', *_stack(PLATE, box(3, 3, 8, 8), (2.0, 8.0)), 600.0)
FLAT = _part("flat", *_stack(PLATE, Polygon(), (2.0, 0.0)), 400.0)
ITEMS = [PartItem(part=BLOCK, at_mm=(5.0, 5.0)), PartItem(part=FLAT, at_mm=(30.25, 5.5))]
CUBE = _stack(box(0, 0, 1, 1), Polygon(), (1.0, 0.0))


def _two(shift_mm):
    """Return a part of two unit cubes, one moved."""
    one, faces = CUBE
    both = np.concatenate([one, one + np.array(shift_mm)])
    return _part("two", both, np.concatenate([faces, faces + len(one)]), 2.0)


def _flipped(faces):
    faces = faces.copy()
    faces[3] = faces[3, ::-1]
    return faces


def _grown(corners):
    corners = corners.copy()
    corners[corners[:, 2].argmax(), 2] += 0.01
    return corners


DIFFERENT = {  # written, meant (None: the same), what is found
    "the same": (BLOCK, None, ""),
    "within the volume's tolerance": (BLOCK, replace(BLOCK, volume_mm3=600.05), ""),
    "another volume": (BLOCK, replace(BLOCK, volume_mm3=600.1), "volume of 600"),
    "a corner off": (replace(BLOCK, vertices_mm=_grown(BLOCK.vertices_mm)), BLOCK, "fills the box"),
    "inside out": (replace(BLOCK, faces=BLOCK.faces[:, ::-1]), BLOCK, "inside out.*of -600"),
    "a triangle flipped": (replace(BLOCK, faces=_flipped(BLOCK.faces)), None, "different ways"),
    "a triangle missing": (replace(BLOCK, faces=BLOCK.faces[1:]), None, "not closed.*volume"),
    "fewer triangles": (replace(BLOCK, faces=BLOCK.faces[1:]), BLOCK, "holds .* triangles, not"),
    "two blocks that share an edge": (_two((1.0, 1.0, 0.0)), None, "not closed"),
    "two blocks apart": (_two((3.0, 0.0, 0.0)), None, "more than one piece"),
    "two blocks that share a corner": (_two((1.0, 1.0, 1.0)), None, "more than one piece"),
}


def _found(one, data, items):
    return "; ".join(p for some in read_back_problems(one, data, items).values() for p in some)


@pytest.mark.parametrize("name", PART_FORMATS)
@pytest.mark.parametrize("case", DIFFERENT)
def test_what_a_file_holds_is_compared_with_the_part(name, case):
    (written, meant, words), one = DIFFERENT[case], PART_FORMATS[name]
    found = _found(
        one, one.write([PartItem(part=written)], "rig"), [PartItem(part=meant or written)]
    )
    assert re.search(words, found) if words else found == ""


@pytest.mark.parametrize("name", PART_FORMATS)
def test_the_same_parts_give_the_same_bytes_that_are_ours(name, tmp_path):
    one = PART_FORMATS[name]
    data = one.write(ITEMS[:1], "rig")
    assert data == one.write(ITEMS[:1], "rig")
    (tmp_path / "part").write_bytes(data)
    assert is_ours(tmp_path / "part")


@pytest.mark.parametrize("name", PART_FORMATS)
@pytest.mark.parametrize("length", [0, 5, 40, 84, 134, -60])
def test_truncated_files_are_seen(name, length):
    one = PART_FORMATS[name]
    assert _found(one, one.write(ITEMS[:1], "rig")[:length], ITEMS[:1])


STL_DATA = STL.write(ITEMS[:1], "block")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (STL_DATA + b"x", "too long"),
        (STL_DATA[:80] + bytes(4), "no triangles"),
        (STL_DATA[:96] + np.float32(np.nan).tobytes() + STL_DATA[100:], "no finite ones"),
        (b"solid " + STL_DATA[6:], "read as text"),
    ],
)
def test_bytes_that_are_no_stl_file_are_seen(data, words):
    assert words in _found(STL, data, ITEMS[:1])


def test_the_file_is_binary_stl_with_normals_outward():
    record = np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    for title in ("block", "ä" * 200):  # a long name is cut off
        data = STL.write(ITEMS[:1], title)
        assert data[:80].decode("ascii").startswith("written by vinefab")
        assert int.from_bytes(data[80:84], "little") == len(BLOCK.faces)
        facets = np.frombuffer(data, record, offset=84)
        assert np.linalg.norm(facets["n"], axis=1) == pytest.approx(1.0)
        for z_mm, normal in ((0.0, -1.0), (10.0, 1.0)):
            level = (facets["v"][:, :, 2] == z_mm).all(axis=1)
            assert level.any()
            assert (facets["n"][level] == (0.0, 0.0, normal)).all()


def test_lib3mf_reads_parts_and_places_strictly():
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)  # noqa: FBT003  its signature
    reader.ReadFromBuffer(THREEMF.write(ITEMS, "rig <1> & more"))
    assert reader.GetWarningCount() == 0
    objects, seen = model.GetMeshObjects(), {}
    while objects.MoveNext():
        one = objects.GetCurrentMeshObject()
        assert one.IsManifoldAndOriented()
        seen[one.GetName()] = one.GetTriangleCount()
    assert seen == {item.part.name: len(item.part.faces) for item in ITEMS}
    builds, places = model.GetBuildItems(), []
    while builds.MoveNext():
        places.append(tuple(builds.GetCurrent().GetObjectTransform().Fields[3]))
    assert places == [(5.0, 5.0, 0.0), (30.25, 5.5, 0.0)]
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter


def test_parts_elsewhere_on_a_bed_are_seen():
    data = THREEMF.write(ITEMS, "rig")
    assert _found(THREEMF, data, ITEMS) == ""
    assert "0.01 mm off" in _found(THREEMF, data, [replace(ITEMS[0], at_mm=(5.01, 5.0)), ITEMS[1]])
    assert "other parts than planned" in _found(THREEMF, data, ITEMS[::-1])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"millimeter", b"inch", "the unit is inch"),
        (b'transform="1 0', b'transform="2 0', "an item is turned"),
        (b'v1="0"', b'v1="999"', "cannot be read"),
    ],
)
def test_a_3mf_file_that_says_something_else_is_refused(old, new, words):
    data, stream = THREEMF.write(ITEMS, "rig"), io.BytesIO()
    assert old in data
    with zipfile.ZipFile(io.BytesIO(data)) as source, zipfile.ZipFile(stream, "w") as archive:
        assert {entry.date_time for entry in source.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        for name in source.namelist():
            archive.writestr(name, source.read(name).replace(old, new))
    with pytest.raises(UnreadableFileError, match=words):
        read_threemf(stream.getvalue())


# --- The files of a rig


def _make():
    rng = np.random.default_rng(11)
    obstacles = [box(180, 120, 230, 170).difference(box(190, 130, 220, 160)), box(200, 0, 230, 30)]
    for x in (30, 80, 130):
        for y in (50, 100, 150):
            angles = 2 * np.pi * (np.arange(5) + rng.uniform(0, 0.8, 5)) / 5
            obstacles.append(Polygon(np.c_[x + 18 * np.cos(angles), y + 18 * np.sin(angles)]))
    start = Start(pose=Pose(x_mm=100, y_mm=15, heading_rad=np.pi / 2))
    world = Map(
        name="table", bounds=box(0, 0, 250, 180), obstacles=tuple(obstacles), starts=(start,)
    )
    printer = Printer(name="bench", bed_width_mm=150, bed_depth_mm=120, height_mm=100)
    made = make_rig(world, printer, RigOptions(style="plate"), RigRequest(pictures=False))
    return world, made.rig, made.files


@pytest.fixture(scope="module")
def made():
    return _make()


def test_every_part_has_its_file_and_its_line(made):
    _, rig, files = made
    assert len(rig.parts) == 4
    names = [stl_name(part) for part in rig.printed]
    assert {"scale_cube_20mm.stl", "north_arrow.stl"} < set(names)
    assert set(names) == {name for name in files if name.endswith(".stl")}
    beds = {bed["file"] for bed in json.loads(files["rig.json"])["beds"]}
    assert beds == {name for name in files if name.endswith(".3mf")}
    for data in files.values():
        assert b"written by vinefab" in data[:8192] + data[-8192:]
    rows = list(csv.DictReader(files["parts.csv"].decode().splitlines()[1:]))
    assert [row["file"] for row in rows] == names
    assert [row["number"] for row in rows] == ["1", "2", "3", "4", *[""] * (len(rows) - 4)]
    assert float(rows[0]["volume_cm3"]) == pytest.approx(rig.parts[0].volume_mm3 / 1e3, abs=0.01)


def test_the_files_put_together_by_rig_json_are_the_map(made):
    # Reads nothing but the files: trimesh for the solids, rig.json for their places.
    world, _, files = made
    found = []
    for part in json.loads(files["rig.json"])["parts"]:
        assert part["sha256"] == sha256_of(files[part["file"]])
        mesh = trimesh.load_mesh(trimesh.util.wrap_as_stream(files[part["file"]]), file_type="stl")
        assert mesh.is_volume
        assert mesh.volume == pytest.approx(part["volume_mm3"], rel=1e-4)
        assert mesh.extents == pytest.approx(part["size_mm"], abs=1e-3)
        assert len(mesh.faces) == part["triangles"]
        mesh.apply_transform(part["transform_to_map"])
        upward = (mesh.face_normals[:, 2] > 0.9) & (mesh.triangles[:, :, 2].min(axis=1) > 29.9)
        found += list(shapely.polygons(mesh.triangles[upward][:, :, :2]))
    walls = shapely.union_all(world.obstacles)
    printed = shapely.union_all(found)
    # Shells: a hole that no free space reaches counts as filled.
    rings = [Polygon(ring) for one in shapely.get_parts(printed) for ring in one.interiors]
    hollow = [ring for ring in rings if not ring.intersects(world.free_space.buffer(-0.01))]
    assert len(hollow) >= len(world.obstacles)
    printed = shapely.union_all([printed, *hollow]).intersection(world.bounds)
    assert shapely.symmetric_difference(printed, walls).area < 1e-3 * walls.area


def test_rig_json_says_what_was_made(made):
    world, rig, files = made
    content = json.loads(files["rig.json"])
    assert (content["schema"], content["units"]) == ("vinefab/rig-1", "mm")
    assert (content["map"]["name"], content["map"]["walls"]) == ("table", world.wall_count)
    assert content["printer"]["bed_depth_mm"] == 120
    assert content["options"]["height_mm"] == 30.0
    assert content["counts"]["joints"] == rig.counts["joints"] > 0
    assert content["against_map"]["share"] < 1e-3
    assert content["notes"] == list(rig.notes)
    assert content["volume_mm3"] == pytest.approx(sum(p["volume_mm3"] for p in content["parts"]))


def test_the_same_map_gives_the_same_bytes(made):
    assert made[2] == _make()[2]


ADMESH_ZEROS = (
    "Total disconnected facets",
    "Degenerate facets",
    "Edges fixed",
    "Facets removed",
    "Facets added",
    "Facets reversed",
    "Backwards edges",
    "Normals fixed",
)


def _admesh(admesh, path):
    """Return what admesh prints, by name; its exit code says nothing about the mesh."""
    # It prints bytes of the file's header, which are text in no encoding; numbers with a point.
    done = subprocess.run(
        [admesh, path],
        env=os.environ | {"LC_ALL": "C"},
        capture_output=True,
        timeout=30,
        check=True,
    )
    printed = done.stdout.decode("ascii", "replace")
    numbers = re.findall(r"([A-Z][A-Za-z ]+?)\s*:\s+(-?[\d.]+)", printed)
    return {name: float(number) for name, number in numbers}


def test_admesh_finds_nothing_to_mend(made, tmp_path, program):
    admesh, (_, rig, files) = program("admesh", "admesh"), made
    for part in rig.printed:
        path = tmp_path / stl_name(part)
        path.write_bytes(files[path.name])
        seen = _admesh(admesh, path)
        assert {name: seen[name] for name in ADMESH_ZEROS} == dict.fromkeys(ADMESH_ZEROS, 0.0)
        assert seen["Number of parts"] == 1
        assert seen["Number of facets"] == len(part.faces)
        assert seen["Volume"] == pytest.approx(part.volume_mm3, rel=1e-4)
