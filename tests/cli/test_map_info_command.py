import json

import pytest

from vinefab import maps
from vinefab.prediction.map_info import size_notes


def test_info_of_a_map(vinefab, grid, tmp_path):
    numbers, picture = tmp_path / "info.json", tmp_path / "info.svg"
    code, words, complaint = vinefab(
        "map", "info", grid, "--width-mm", 20, "--json", numbers, "--svg", picture
    )
    document = json.loads(numbers.read_text())
    assert (code, complaint) == (0, "")
    assert document["schema"] == "vinefab/map-info-1"
    assert f"walls: {document['walls']}\n" in words
    assert f"{document['passages'][0]['width_mm']:.2f} mm " in words
    assert "body asked about: 20 mm" in words
    assert str(picture) in words
    assert picture.read_bytes().startswith(b"<?xml")


def test_json_on_standard_output_stands_alone(vinefab, grid):
    code, output, words = vinefab("map", "info", grid, "--json", "-", "--passages", 2)
    assert code == 0
    assert len(json.loads(output)["passages"]) == 2
    assert "narrowest passages" in words


def write_room(path, width, height):
    rectangle = [[0, 0], [width, 0], [width, height], [0, height], [0, 0]]
    shape = {"type": "Polygon", "coordinates": [rectangle]}
    feature = {"type": "Feature", "properties": {}, "geometry": shape}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


@pytest.mark.parametrize(
    ("size", "options", "note"),
    [
        ((0.5, 0.4), (), "0.5 x 0.4 mm: vinefab map import --scale-mm-per-unit 1000 if its "),
        ((24, 16), (), "25.4 if its unit is inches (609.6 x 406.4 mm), 10 if its unit is cent"),
        ((50_000, 9), (), "50000 x 9 mm: vinefab map import --scale-mm-per-unit 0.1 if its "),
        (
            (0.5, 0.4),
            (10,),
            "5 x 4 mm, drawn as 0.5 x 0.4: vinefab map import --scale-mm-per-unit 1000 if its ",
        ),
        ((0.01, 0.02), (), "0.01 x 0.02 mm: is that its unit? vinefab map import has "),
        ((60, 9), (), ""),
        ((20_000, 9_000), (), ""),
    ],
)
def test_a_map_of_another_unit_is_noted_once_and_taken(vinefab, tmp_path, size, options, note):
    room, out = write_room(tmp_path / "room.geojson", *size), tmp_path / "out.geojson"
    scale = ("--scale-mm-per-unit", *options) if options else ()
    told = [vinefab("map", "import", room, *scale, "--out", out)]
    if not options:
        told.append(vinefab("map", "info", room, "--passages", 1))
    for code, output, complaint in told:
        assert (code, complaint) == (0, "")
        notes = [line for line in output.splitlines() if line.startswith("note: this map")]
        assert len(notes) == bool(note)
        assert note in output


def test_a_small_map_of_a_generator_is_no_mistake():
    assert size_notes(maps.pegs(columns=1, rows=1, pitch_mm=8.0, diameter_mm=2.0)) == []
