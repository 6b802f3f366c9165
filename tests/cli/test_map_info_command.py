import json


def test_info_of_a_map(vinefab, grid, tmp_path):
    numbers, picture = tmp_path / "info.json", tmp_path / "info.svg"
    code, words, complaint = vinefab(
        "map", "info", grid, "--width-mm", 20, "--json", numbers, "--svg", picture
    )
    document = json.loads(numbers.read_text())
    assert (code, complaint) == (0, "")
    assert document["schema"] == "vinefab/map-info-1"
    assert f"{document['walls']} walls" in words
    assert f"{document['passages'][0]['width_mm']:.2f} mm at" in words
    assert "a body of 20 mm" in words
    assert str(picture) in words
    assert picture.read_bytes().startswith(b"<?xml")


def test_info_has_help_with_an_example_and_refuses_what_is_wrong(vinefab, grid):
    code, words, _ = vinefab("map", "info", "--help")
    assert code == 0
    assert "vinefab map info " in words.split("Example:")[1]
    code, _, complaint = vinefab("map", "info", grid, "--width-mm", -3)
    assert code == 2
    assert "--width-mm" in complaint
    assert vinefab("map", "info", "no.geojson")[0] == 2


def test_json_on_standard_output_stands_alone(vinefab, grid):
    code, output, words = vinefab("map", "info", grid, "--json", "-", "--passages", 2)
    assert code == 0
    assert len(json.loads(output)["passages"]) == 2
    assert "narrowest passages" in words
