import numpy as np
import pytest
import trimesh
from shapely import Polygon, box

from vinefab.core.atomic import is_ours
from vinefab.rig.part import RigPart
from vinefab.rig.part_files import STL, PartItem, read_back_problems, stl_bytes
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import stacked


def check_stl(data, part):
    return read_back_problems(STL, data, [PartItem(part=part)])[part.name]


@pytest.fixture
def block():
    """A plate of 20 x 10 x 2 mm with a block of 5 x 5 x 8 mm on it."""
    vertices, faces = stacked(
        polygon_parts(box(0, 0, 20, 10)), polygon_parts(box(3, 3, 8, 8)), 2.0, 8.0
    )
    return _part(vertices, faces, 600.0)


def _part(vertices, faces, volume_mm3):
    return RigPart(
        name="block",
        row=1,
        column=1,
        vertices_mm=vertices,
        faces=faces,
        to_map=np.eye(4),
        volume_mm3=volume_mm3,
    )


def _bytes(part, faces=None):
    return stl_bytes(part.vertices_mm, part.faces if faces is None else faces, part.name)


def test_a_good_file_has_no_problems(block, tmp_path):
    path = tmp_path / "block.stl"
    path.write_bytes(_bytes(block))
    assert check_stl(_bytes(block), block) == ()
    assert is_ours(path)


def test_the_file_is_binary_stl(block):
    data = _bytes(block)
    assert not data.startswith(b"solid")
    assert data[:80].decode("ascii").startswith("written by vinefab")
    assert int.from_bytes(data[80:84], "little") == len(block.faces)
    assert len(data) == 84 + 50 * len(block.faces)


def test_normals_point_outward_and_have_length_one(block):
    record = np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    facets = np.frombuffer(_bytes(block), record, offset=84)
    assert np.linalg.norm(facets["n"], axis=1) == pytest.approx(1.0)
    bottom = (facets["v"][:, :, 2] == 0.0).all(axis=1)
    assert bottom.any()
    assert (facets["n"][bottom] == (0.0, 0.0, -1.0)).all()
    top = (facets["v"][:, :, 2] == 10.0).all(axis=1)
    assert (facets["n"][top] == (0.0, 0.0, 1.0)).all()


def test_same_input_same_bytes(block):
    assert _bytes(block) == _bytes(block)


@pytest.mark.parametrize("length", [0, 40, 84, 134, -1, -50])
def test_truncated_files_are_seen(block, length):
    (problem,) = check_stl(_bytes(block)[:length], block)
    assert "truncated" in problem


def test_a_file_with_more_after_its_end_is_seen(block):
    assert "too long" in check_stl(_bytes(block) + b"x", block)[0]


def test_a_flipped_triangle_is_seen_although_watertight(block):
    faces = block.faces.copy()
    faces[3] = faces[3, ::-1]
    data = _bytes(block, faces)
    mesh = trimesh.Trimesh(block.vertices_mm, faces)
    assert mesh.is_watertight
    assert any("face different ways" in problem for problem in check_stl(data, block))


def test_a_solid_inside_out_is_seen(block):
    problems = check_stl(_bytes(block, block.faces[:, ::-1]), block)
    assert any("inside out" in problem for problem in problems)
    assert any("volume of -600" in problem for problem in problems)


def test_a_missing_triangle_is_seen(block):
    open_block = _part(block.vertices_mm, block.faces[1:], 600.0)
    assert any("not closed" in problem for problem in check_stl(_bytes(open_block), open_block))
    assert "triangles" in check_stl(_bytes(open_block), block)[0]


def test_two_bodies_that_share_an_edge_are_seen():
    # Two blocks that touch along an upright edge: four triangles meet there.
    one, faces = stacked(polygon_parts(box(0, 0, 1, 1)), polygon_parts(Polygon()), 1.0, 1.0)
    other = one + np.array([1.0, 1.0, 0.0])
    part = _part(np.concatenate([one, other]), np.concatenate([faces, faces + len(one)]), 2.0)
    assert any("not closed" in problem for problem in check_stl(_bytes(part), part))


def test_two_bodies_apart_are_seen():
    one, faces = stacked(polygon_parts(box(0, 0, 1, 1)), polygon_parts(Polygon()), 1.0, 1.0)
    other = one + np.array([3.0, 0.0, 0.0])
    part = _part(np.concatenate([one, other]), np.concatenate([faces, faces + len(one)]), 2.0)
    assert check_stl(_bytes(part), part) == ("is more than one piece",)


def test_a_wrong_volume_or_box_is_seen(block):
    heavier = _part(block.vertices_mm, block.faces, 600.1)
    assert "volume" in check_stl(_bytes(block), heavier)[0]
    assert check_stl(_bytes(block), _part(block.vertices_mm, block.faces, 600.05)) == ()
    moved = _part(block.vertices_mm + np.array([0.01, 0.0, 0.0]), block.faces, 600.0)
    assert any("box" in problem for problem in check_stl(_bytes(block), moved))


def test_no_triangles_and_no_numbers_are_seen(block):
    assert "no triangles" in check_stl(_bytes(block)[:80] + bytes(4), block)[0]
    data = bytearray(_bytes(block))
    data[96:100] = np.float32(np.nan).tobytes()
    assert "no finite ones" in check_stl(bytes(data), block)[0]


def test_text_stl_is_refused(block):
    data = b"solid " + _bytes(block)[6:]
    assert "read as text" in check_stl(data, block)[0]


def test_a_long_name_is_cut_off(block):
    data = stl_bytes(block.vertices_mm, block.faces, "ä" * 200)
    assert len(data) == 84 + 50 * len(block.faces)
    assert check_stl(data, block) == ()
