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

from vinefab.cli.main import main
from vinefab.core.atomic import is_ours
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.hashing import sha256_of
from vinefab.model.map import Map, Pose, Start
from vinefab.rig.build import build_rig
from vinefab.rig.make import RigRequest, make_rig
from vinefab.rig.part import Printer, RigOptions, RigPart
from vinefab.rig.part_files import (
    PART_FORMATS,
    STL,
    THREEMF,
    PartFileSpec,
    PartItem,
    packed_on_beds,
    print_estimate,
    printing_of,
    read_back_problems,
    read_rig,
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
        one,
        one.write(PartFileSpec(items=[PartItem(part=written)], title="rig")),
        [PartItem(part=meant or written)],
    )
    assert re.search(words, found) if words else found == ""


@pytest.mark.parametrize("name", PART_FORMATS)
def test_the_same_parts_give_the_same_bytes_that_are_ours(name, tmp_path):
    one = PART_FORMATS[name]
    data = one.write(PartFileSpec(items=ITEMS[:1], title="rig"))
    assert data == one.write(PartFileSpec(items=ITEMS[:1], title="rig"))
    (tmp_path / "part").write_bytes(data)
    assert is_ours(tmp_path / "part")


@pytest.mark.parametrize("name", PART_FORMATS)
@pytest.mark.parametrize("length", [0, 5, 40, 84, 134, -60])
def test_truncated_files_are_seen(name, length):
    one = PART_FORMATS[name]
    assert _found(one, one.write(PartFileSpec(items=ITEMS[:1], title="rig"))[:length], ITEMS[:1])


STL_DATA = STL.write(PartFileSpec(items=ITEMS[:1], title="block"))


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
        data = STL.write(PartFileSpec(items=ITEMS[:1], title=title))
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
    reader.ReadFromBuffer(THREEMF.write(PartFileSpec(items=ITEMS, title="rig <1> & more")))
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
    data = THREEMF.write(PartFileSpec(items=ITEMS, title="rig"))
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
    data, stream = THREEMF.write(PartFileSpec(items=ITEMS, title="rig")), io.BytesIO()
    assert old in data
    with zipfile.ZipFile(io.BytesIO(data)) as source, zipfile.ZipFile(stream, "w") as archive:
        assert {entry.date_time for entry in source.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        for name in source.namelist():
            archive.writestr(name, source.read(name).replace(old, new))
    with pytest.raises(UnreadableFileError, match=words):
        read_threemf(stream.getvalue())


# --- The files of a rig


@pytest.fixture(scope="module")
def made():
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


def test_every_part_lies_on_one_bed(made):
    _, rig, _ = made
    places = [at for bed in printing_of(rig).beds for at in bed.places]
    assert sorted(at.index for at in places) == list(range(len(rig.printed)))
    for at in places:
        wide_mm, deep_mm, _ = rig.printed[at.index].size_mm
        assert 5.0 <= at.x_mm <= 150.0 - 5.0 - wide_mm + 0.01
        assert 5.0 <= at.y_mm <= 120.0 - 5.0 - deep_mm + 0.01


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


# --- A folder read again


@pytest.fixture
def folder(made, tmp_path):
    """The files of a rig, which may be spoilt."""
    for name, data in made[2].items():
        (tmp_path / name).write_bytes(data)
    return tmp_path


def test_a_good_rig_read_again_has_no_problems(folder):
    facts = read_rig(folder)
    assert facts == read_rig(folder / "rig.json")
    assert facts.height_mm == 30.0
    assert facts.room_mm == (140.0, 110.0, 100.0)
    assert len(facts.parts) == 4 + 2 + 4 + 3  # cube and arrow, markers, base holder
    assert [part.problems for part in facts.parts] == [()] * 13


def test_spoilt_parts_are_named(folder):
    parts = json.loads((folder / "rig.json").read_text())["parts"]
    first, second, third = (folder / part["file"] for part in parts[:3])
    first.write_bytes(first.read_bytes()[:-50])
    second.unlink()
    third.write_bytes((folder / parts[3]["file"]).read_bytes())
    problems = [part.problems for part in read_rig(folder).parts]
    assert "truncated" in problems[0][0]
    assert problems[1] == ("there is no such file",)
    assert any("volume" in problem for problem in problems[2])
    assert problems[3:] == [()] * 10


def test_parts_elsewhere_are_not_read(folder, tmp_path_factory):
    file = folder / json.loads((folder / "rig.json").read_text())["parts"][0]["file"]
    elsewhere = tmp_path_factory.mktemp("elsewhere") / file.name
    elsewhere.write_bytes(file.read_bytes())
    file.unlink()
    file.symlink_to(elsewhere)
    with pytest.raises(BadInputError, match="leads out of"):
        read_rig(folder)


def test_folders_that_are_no_rig(folder):
    with pytest.raises(UnreadableFileError, match="no such file"):
        read_rig(folder / "nowhere")
    (folder / "rig.json").write_text("{")
    with pytest.raises(UnreadableFileError, match="not JSON"):
        read_rig(folder)
    (folder / "rig.json").write_text("[]")
    with pytest.raises(UnreadableFileError, match="not a JSON object"):
        read_rig(folder)
    (folder / "rig.json").write_text('{"schema": "vinefab/rig-2"}')
    with pytest.raises(BadInputError, match="schema is 'vinefab/rig-2'"):
        read_rig(folder)


def test_a_rig_cannot_name_files_elsewhere(folder):
    content = json.loads((folder / "rig.json").read_text())
    content["parts"][0]["file"] = "../../secret.stl"
    (folder / "rig.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"parts\[1\].file"):
        read_rig(folder)


def test_check_applies_the_rules_to_it(made, folder, capsys):
    arguments = ["check", "plain_vine", "--json", "-"]
    made[0].write(folder / "table.geojson")
    assert main([*arguments, "--rig", str(folder), "--map", str(folder / "table.geojson")]) == 0
    ran = {run["id"] for run in json.loads(capsys.readouterr().out)["rules_run"]}
    assert {"VF-R01", "VF-R02", "VF-R03", "VF-R04"} <= ran
    (folder / "scale_cube_20mm.stl").write_bytes(b"nothing")
    assert main([*arguments, "--rig", str(folder)]) == 1
    found = json.loads(capsys.readouterr().out)["findings"]
    assert [finding["id"] for finding in found if finding["severity"] == "error"] == ["VF-R01"]


# --- Beds and estimates


@pytest.mark.parametrize("seed", range(2))
def test_boxes_lie_on_the_bed_and_apart(seed):
    sizes = np.random.default_rng(seed).uniform(5, 90, (40, 2)).tolist()
    beds = packed_on_beds(sizes, (200.0, 150.0), 5.0)
    assert sorted(at.index for bed in beds for at in bed) == list(range(40))
    for bed in beds:
        boxes = [
            box(at.x_mm, at.y_mm, at.x_mm + sizes[at.index][0], at.y_mm + sizes[at.index][1])
            for at in bed
        ]
        assert shapely.box(0, 0, 200.001, 150.001).covers(shapely.union_all(boxes))
        grown = [shapely.box(*np.add(one.bounds, (-2.49, -2.49, 2.49, 2.49))) for one in boxes]
        tree = shapely.STRtree(grown)
        assert len(tree.query(grown, predicate="intersects")[0]) == len(grown)
    # Shelves waste some, but not more than about half.
    assert len(beds) <= 2 + 2 * sum(w * h for w, h in sizes) / (200.0 * 150.0)


def test_the_estimate_is_the_formula(make_map, make_printer):
    printer = make_printer(infill=0.2, shell_mm=1.0, flow_mm3_s=5.0, layer_change_s=2.0)
    cube = build_rig(make_map(), printer).extras[0]
    volume_mm3, skin_mm3 = cube.volume_mm3, cube.area_mm2 * 1.0
    plastic_mm3 = skin_mm3 + 0.2 * (volume_mm3 - skin_mm3)
    found = print_estimate([cube], printer)
    assert cube.area_mm2 == pytest.approx(2400.0, rel=0.05)
    assert found.plastic_mm3 == pytest.approx(plastic_mm3)
    assert found.time_s == pytest.approx(plastic_mm3 / 5.0 + 100 * 2.0)
    assert found.mass_g == pytest.approx(1.24e-3 * plastic_mm3)
    assert found.filament_m == pytest.approx(1e-3 * plastic_mm3 / (np.pi * 0.875**2))


def test_thin_parts_are_all_skin(make_map, make_printer):
    printer = make_printer(shell_mm=3.0)
    rig = build_rig(make_map(), printer, RigOptions(mark_depth_mm=0.0, wall_mm=0.0))
    assert print_estimate(rig.parts, printer).plastic_mm3 == pytest.approx(rig.volume_mm3)
