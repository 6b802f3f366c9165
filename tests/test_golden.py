"""The comparison of recordings notices what it must, and only lists sentences."""

import json
import shutil
from pathlib import Path

import ezdxf
import pytest
import trimesh

HERE = Path(__file__).parent
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="9"'
    ' height="9"><defs><path id="mark" d="M0 0L1 1"/></defs><use xlink:href="#mark" x="3"/>'
    "<text>grown</text>{}</svg>"
)
PLAN = SVG.format('<circle cx="3" cy="3" r="2" stroke="#f00"/>')
LIGHTBURN = (
    '<LightBurnProject><CutSetting><speed Value="60"/></CutSetting><Shape Type="Path" CutIndex="0">'
    "<VertList>V1 2c0x1c1x1V{} 2c0x2.5c0y3c1x1</VertList><PrimList>L0 1B1 0</PrimList>"
    "</Shape></LightBurnProject>"
)


@pytest.fixture
def golden(monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))
    import golden_compare  # noqa: PLC0415  a program's neighbour

    return golden_compare


def dxf(path, end=50.0, layer="CUT", colour=1):
    document = ezdxf.new()
    document.layers.add(layer, color=colour)
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (end, 0, 0, 0, 0.5), (end, 30)], close=True).dxf.layer = layer
    space.add_line((0, 40), (9, 40)).dxf.layer = "0"
    document.saveas(path)


def feature(x=30.0, role="obstacle"):
    ring = [[0, 0], [x, 0], [0, 20], [0, 0]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    one = {"type": "Feature", "properties": {"role": role}, "geometry": shape}
    return json.dumps({"type": "FeatureCollection", "features": [one]})


def solid(size):
    return trimesh.creation.box((size, 2.0, 3.0)).export(file_type="stl")


NUMBERS = {"name": "grid", "seconds": 1.0, "list": [1, 2.5, None], "said": "reach of 51.2 mm"}


@pytest.fixture
def old(tmp_path):
    folder = tmp_path / "old" / "case"
    folder.mkdir(parents=True)
    dxf(folder / "cut.dxf")
    for name, text in {
        "a.json": json.dumps(NUMBERS),
        "a.csv": "item,value\nfilm,928.975\n",
        "a.toml": "length = 2.0 # as cut\n",
        "map.geojson": feature(),
        "plan.svg": PLAN,
        "cut.lbrn2": LIGHTBURN.format(5),
        "said.txt": "grown 51 mm\n",
        "page.html": "<p>grown</p><svg><path d='M0 0'/></svg>",
    }.items():
        (folder / name).write_text(text)
    (folder / "part.stl").write_bytes(solid(1.0))
    return folder


def written(text):
    return lambda path: path.write_text(text)


def numbers(**changed):
    return written(json.dumps(NUMBERS | changed))


FAIL = [
    ("a.json", numbers(list=[1, 2.5 + 1e-11, None])),
    ("a.json", numbers(list=[2, 2.5, None])),
    ("a.json", numbers(list=[2.5, 1, None])),
    ("a.json", numbers(list=[True, 2.5, None])),
    ("a.json", numbers(name="cave")),
    ("a.json", numbers(said="reach of 51.3 mm")),
    ("a.json", numbers(more=0)),
    ("a.csv", written("item,value\nfilm,928.976\n")),
    ("a.toml", written("length = 2.1 # as cut\n")),
    ("cut.dxf", lambda path: dxf(path, end=50.001)),
    ("cut.dxf", lambda path: dxf(path, layer="WELD")),
    ("cut.dxf", lambda path: dxf(path, colour=2)),
    ("map.geojson", written(feature(x=30.001))),
    ("map.geojson", written(feature(role="bounds"))),
    ("plan.svg", written(PLAN.replace('r="2"', 'r="2.1"'))),
    ("plan.svg", written(PLAN.replace("#f00", "#00f"))),
    ("plan.svg", written(PLAN.replace('x="3"', 'x="4"'))),
    ("cut.lbrn2", written(LIGHTBURN.format(5.001))),
    ("cut.lbrn2", written(LIGHTBURN.format(5).replace("60", "61"))),
    ("cut.lbrn2", written(LIGHTBURN.format(5).replace("2.5c0y3", "2.5c0y3.1"))),
    ("part.stl", lambda path: path.write_bytes(solid(1.001))),
    ("said.txt", Path.unlink),
    ("new.bin", written("what is this?")),
]


@pytest.mark.parametrize(("name", "change"), FAIL)
def test_a_changed_number_or_drawing_fails(golden, old, name, change):
    new = shutil.copytree(old.parent, old.parent.with_name("new"))
    change(new / "case" / name)
    found = golden.compare(old.parent, new, ["case"])
    assert found.failures
    assert all(line.startswith(f"case/{name}: ") for line in found.failures)


LISTED = [
    ("a.json", numbers(said="it reaches 51.2 mm")),
    ("a.toml", written("length = 2.0 # as welded\n")),
    ("said.txt", written("has grown by 51 mm\n")),
    ("plan.svg", written(PLAN.replace("grown", "has grown"))),
    ("page.html", written("<p>has grown</p><svg><path d='M0 0'/></svg>")),
    ("page.html", written("<p>grown</p><svg><path d='M0 1'/></svg>")),
]


@pytest.mark.parametrize(("name", "change"), LISTED)
def test_a_changed_sentence_or_chart_is_listed(golden, old, name, change):
    new = shutil.copytree(old.parent, old.parent.with_name("new"))
    change(new / "case" / name)
    found = golden.compare(old.parent, new, ["case"])
    assert not found.failures
    assert list(found.listed) == [f"case/{name}"]


SAME = [
    ("a.json", numbers(seconds=2.0, list=[1.0, 2.5 + 1e-13, None])),
    ("a.csv", written('"item",value\nfilm,928.9750\n')),
    ("cut.dxf", lambda path: dxf(path, end=50.0 + 1e-8)),
    (
        "plan.svg",
        written(SVG.format('<path stroke="#f00" d="M5 3A2 2 0 0 1 1 3A2 2 0 0 1 5 3z"/>')),
    ),
]


@pytest.mark.parametrize(("name", "change"), SAME)
def test_the_same_said_otherwise_is_the_same(golden, old, name, change):
    new = shutil.copytree(old.parent, old.parent.with_name("new"))
    change(new / "case" / name)
    found = golden.compare(old.parent, new, ["case"])
    assert (found.failures, dict(found.listed)) == ([], {})
    assert found.counts["files"] == 10


@pytest.mark.usefixtures("golden")
def test_every_file_that_is_given_is_read_by_a_case():
    import golden_cases  # noqa: PLC0415

    texts = "\n".join(golden_cases.CASES.values())
    assert [name for name in golden_cases.inputs() if name not in texts] == []
