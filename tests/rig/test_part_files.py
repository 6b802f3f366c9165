import csv
import json
import math
import os
import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from shapely import Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.core.hashing import sha256_of
from vinefab.model.map import Map, Pose, Start
from vinefab.rig.make import RigRequest, make_rig
from vinefab.rig.part import Printer, RigOptions
from vinefab.rig.part_files import (
    PART_FORMATS,
    PartItem,
    part_files,
    part_problems,
    printing_of,
    read_back_problems,
    stl_name,
)


def _make():
    rng = np.random.default_rng(11)
    obstacles = [box(180, 120, 230, 170).difference(box(190, 130, 220, 160)), box(200, 0, 230, 30)]
    for x in (30, 80, 130):
        for y in (50, 100, 150):
            angles = 2 * np.pi * (np.arange(5) + rng.uniform(0, 0.8, 5)) / 5
            obstacles.append(Polygon(np.c_[x + 18 * np.cos(angles), y + 18 * np.sin(angles)]))
    start = Start(pose=Pose(x_mm=100, y_mm=15, heading_rad=math.pi / 2))
    world = Map(
        name="table", bounds=box(0, 0, 250, 180), obstacles=tuple(obstacles), starts=(start,)
    )
    printer = Printer(name="bench", bed_width_mm=150, bed_depth_mm=120, height_mm=100)
    made = make_rig(world, printer, RigOptions(style="plate"), RigRequest(pictures=False))
    return world, made.rig, made.files


@pytest.fixture(scope="module")
def made():
    return _make()


def test_every_part_has_its_file(made):
    _, rig, files = made
    assert len(rig.parts) == 4
    stls = {stl_name(part) for part in rig.printed}
    assert {"scale_cube_20mm.stl", "north_arrow.stl"} < stls
    assert stls == {name for name in files if name.endswith(".stl")}
    beds = {bed["file"] for bed in json.loads(files["rig.json"])["beds"]}
    assert beds == {name for name in files if name.endswith(".3mf")}
    for data in files.values():
        assert b"written by vinefab" in data[:8192] + data[-8192:]


def test_the_files_put_together_by_rig_json_are_the_map(made):
    # Reads nothing but the files: trimesh for the solids, rig.json for their places.
    world, _, files = made
    found = []
    for part in json.loads(files["rig.json"])["parts"]:
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
    assert content["schema"] == "vinefab/rig-1"
    assert content["units"] == "mm"
    assert content["map"]["name"] == "table"
    assert content["map"]["walls"] == world.wall_count
    assert content["printer"]["bed_depth_mm"] == 120
    assert content["options"]["height_mm"] == 30.0
    assert content["counts"]["joints"] == rig.counts["joints"] > 0
    assert content["against_map"]["share"] < 1e-3
    assert content["notes"] == list(rig.notes)
    assert content["volume_mm3"] == pytest.approx(sum(p["volume_mm3"] for p in content["parts"]))
    for part in content["parts"]:
        assert part["sha256"] == sha256_of(files[part["file"]])


def test_the_part_list_is_a_table(made):
    _, rig, files = made
    lines = files["parts.csv"].decode().splitlines()
    rows = list(csv.DictReader(lines[1:]))
    assert [row["file"] for row in rows] == [stl_name(part) for part in rig.printed]
    assert [row["number"] for row in rows] == ["1", "2", "3", "4", *[""] * (len(rows) - 4)]
    assert float(rows[0]["volume_cm3"]) == pytest.approx(rig.parts[0].volume_mm3 / 1e3, abs=0.01)


def test_the_same_map_gives_the_same_bytes(made):
    assert made[2] == _make()[2]


def test_a_rig_that_is_not_closed_is_not_handed_out(made):
    _, rig, _ = made
    broken = replace(rig.parts[1], faces=rig.parts[1].faces[:-1])
    bad = replace(rig, parts=(rig.parts[0], broken))
    printing = printing_of(bad)
    problems = part_problems(part_files(bad, printing), bad, printing)
    assert problems[rig.parts[0].name] == ()
    assert len(problems[broken.name]) > 2  # from the STL and from the 3MF
    assert all("closed" in one or "open" in one or "volume" in one for one in problems[broken.name])


FORMATS = sorted(PART_FORMATS)


def _items(rig):
    return [
        PartItem(part=part, at_mm=(60.0 * index, 0.0)) for index, part in enumerate(rig.parts[:2])
    ]


def _problems(name, written, meant):
    """Return what comparing a file with other parts than it was written from finds."""
    one = PART_FORMATS[name]
    written, meant = (items if one.per_bed else items[:1] for items in (written, meant))
    found = read_back_problems(one, one.write(written, "rig"), meant)
    return "; ".join(problem for problems in found.values() for problem in problems)


def _with(items, **changes):
    return [replace(items[0], part=replace(items[0].part, **changes)), *items[1:]]


@pytest.mark.parametrize("name", FORMATS)
def test_every_registered_format_is_read_back(made, name):
    items = _items(made[1])
    assert _problems(name, items, items) == ""
    assert PART_FORMATS[name].write(items[:1], "a") == PART_FORMATS[name].write(items[:1], "a")


@pytest.mark.parametrize("name", FORMATS)
def test_every_registered_format_shows_a_part_that_differs(made, name):
    items = _items(made[1])
    part = items[0].part
    vertices = part.vertices_mm.copy()
    vertices[vertices[:, 2].argmax()] += (0.0, 0.0, 0.01)
    assert "box" in _problems(name, _with(items, vertices_mm=vertices), items)
    assert "inside out" in _problems(name, _with(items, faces=part.faces[:, ::-1]), items)
    assert "triangles" in _problems(name, _with(items, faces=part.faces[:-1]), items)
    assert _problems(name, items[1:], items)
    for data in (b"", b"solid", PART_FORMATS[name].write(items[:1], "rig")[:-60]):
        assert any(read_back_problems(PART_FORMATS[name], data, items[:1]).values())


def test_a_part_elsewhere_on_its_bed_is_seen(made):
    items = _items(made[1])
    for name in (name for name in FORMATS if PART_FORMATS[name].per_bed):
        moved = [replace(items[0], at_mm=(0.01, 0.0)), *items[1:]]
        assert "0.01 mm off its place" in _problems(name, moved, items)
        assert "other parts than planned" in _problems(name, items[::-1], items)


@pytest.mark.parametrize("missing", ["read", "write"])
def test_a_format_without_reader_or_writer_is_refused(missing):
    with pytest.raises(BadInputError, match=f"part format .stl: {missing}"):
        replace(PART_FORMATS["stl"], **{missing: None})


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


@pytest.fixture
def admesh(program):
    return program("admesh", "admesh")


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


def test_admesh_finds_nothing_to_mend(made, tmp_path, admesh):
    _, rig, files = made
    for part in rig.printed:
        path = tmp_path / stl_name(part)
        path.write_bytes(files[path.name])
        seen = _admesh(admesh, path)
        assert {name: seen[name] for name in ADMESH_ZEROS} == dict.fromkeys(ADMESH_ZEROS, 0.0)
        assert seen["Number of parts"] == 1
        assert seen["Number of facets"] == len(part.faces)
        assert seen["Volume"] == pytest.approx(part.volume_mm3, rel=1e-4)


def test_admesh_would_see_a_flipped_triangle(made, tmp_path, admesh):
    data = bytearray(made[2][stl_name(made[1].parts[0])])
    data[96:108], data[108:120] = data[108:120], data[96:108]
    path = tmp_path / "flipped.stl"
    path.write_bytes(data)
    assert _admesh(admesh, path)["Facets reversed"] == 1
