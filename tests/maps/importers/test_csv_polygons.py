import pytest

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map

WITH_HEADER = """# a room with a pillar
polygon,x_mm,y_mm
room,0,0
room,100,0
room,100,50
room,0,50
pillar,20,20
pillar,30,20
pillar,30,30
"""
BLANK_LINES = "0 ,0\n100,0\n100,50\n0,50\n0,0\n\n\n20,20\n30,20\n30,30\n"
OTHER_ORDER = "y;x;role;id\n" + "".join(
    f"{y};{x};{role};{name}\n"
    for name, role, points in (
        ("a", "obstacle", [(20, 20), (30, 20), (30, 30)]),
        ("b", "bounds", [(0, 0), (100, 0), (100, 50), (0, 50)]),
    )
    for x, y in points
)


@pytest.fixture
def reading(tmp_path):
    def read(text, options=None):
        path = tmp_path / "room.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return import_map(path, options or ImportOptions())

    return read


@pytest.mark.parametrize(
    "text",
    [
        WITH_HEADER,
        WITH_HEADER.replace("polygon,x_mm,y_mm\n", ""),
        WITH_HEADER.replace(",", "\t").replace("\n", "\r\n"),
        "\ufeff" + WITH_HEADER,
        BLANK_LINES,
        "x,y\n" + BLANK_LINES,
        OTHER_ORDER,
    ],
)
def test_the_forms_of_one_room(reading, text):
    world = reading(text)
    assert world.bounds.bounds == (0, 0, 100, 50)
    assert [p.area for p in world.obstacles] == [50]
    assert len(world.starts) == 1


def test_a_role_wins_over_size(reading):
    rows = "p,x_mm,y_mm,role\n".replace("p,", "polygon,")
    rows += "".join(f"a,{x},{y},bounds\n" for x, y in ((0, 0), (50, 0), (50, 50), (0, 50)))
    rows += "".join(
        f"b,{x},{y},obstacle\n" for x, y in ((40, -50), (200, -50), (200, 90), (40, 90))
    )
    rows += "".join(f"c,{x},{y},\n" for x, y in ((300, 0), (310, 0), (310, 10)))
    world = reading(rows)
    assert world.bounds.bounds == (0, 0, 50, 50)
    assert [p.bounds for p in world.obstacles] == [(40, 0, 50, 50)]
    assert world.facts["obstacles_cut_at_bounds"] == 1
    assert world.facts["outlines_outside_left_out"] == 1


def test_scale_simplify_and_start(reading):
    ring = "".join(f"{x},{1e-3 * (x % 2)}\n" for x in range(101)) + "100,50\n0,50\n"
    options = ImportOptions(scale_mm_per_unit=2.0, simplify_mm=0.01)
    world = reading(ring, options)
    assert world.size_mm == (200, 100)
    assert world.wall_count == 4
    assert world.facts["corners_left_out"] == 99


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no outlines"),
        ("polygon,x_mm,y_mm\n", "has no outlines"),
        ("hello\nworld\n", "line 1 is 'hello'; allowed: polygon,x_mm,y_mm"),
        (BLANK_LINES + "1,2,3\n", "line 11 is '1,2,3'; allowed: the columns x, y"),
        (WITH_HEADER + "pillar,nan,4\n", "line 10 is 'nan'; allowed: a finite number"),
        (WITH_HEADER + "room,1,4\n", "line 10: polygon is 'room'; allowed: points of one polygon"),
        ("a,0,0,wall\n", "line 1: role is 'wall'"),
        ("0,0\n0,1e15\n1,0\n", "the drawing is 1e[+]15 mm wide"),
        ("0,0\n1e-5,0\n0,1e-5\n", "set its unit \\(--scale-mm-per-unit\\)"),
        ("0,0\n9,0\n9,9\n\n50,0\n60,0\n60,9\n", r"outside of the largest outline"),
        ("1,1\n2,2\n", "has no area"),
    ],
)
def test_bad_lines_are_named(reading, text, message):
    with pytest.raises(BadInputError, match=message):
        reading(text)


def test_binary_is_no_text(reading):
    with pytest.raises(UnreadableFileError, match="not UTF-8"):
        reading(b"\xff\xfe\0\0")
