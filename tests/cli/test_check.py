"""``vinefab check`` with maps and limits."""

import json

from vinefab.fabrication.formats.dxf_format import read_dxf


def checks(vinefab, *arguments):
    code, output, words = vinefab("check", *arguments, "--json", "-")
    return code, json.loads(output), words


def test_limits_of_the_command_line_are_told(vinefab):
    code, document, words = checks(
        vinefab, "three_level_tree", "--limit", "VF-B01.error=201", "--limit", "VF-P03.tight_kpa=6"
    )
    assert code == 1
    assert [f["id"] for f in document["findings"] if f["severity"] == "error"] == ["VF-B01"]
    assert document["limits_changed"] == [
        {"id": "VF-B01", "name": "error", "value": 201.0, "default": 150.0, "source": "--limit"},
        {"id": "VF-P03", "name": "tight_kpa", "value": 6.0, "default": 8.32, "source": "--limit"},
    ]
    assert "VF-B01.error is 201 (else 150), from --limit" in words


def test_limits_of_a_design_file_are_told(vinefab, plain):
    plain.write_text(plain.read_text() + "[limits.VF-B03]\nshort_warning = 100\n")
    code, document, words = checks(vinefab, plain)
    assert code == 0
    assert [limit["source"] for limit in document["limits_changed"]] == ["design plain"]
    assert "VF-B03" not in [finding["id"] for finding in document["findings"]]
    assert "from design plain" in words


def test_a_map_is_grown_on_and_paths_are_looked_at(vinefab, grid):
    code, document, words = checks(vinefab, "three_level_tree", "--map", grid, "--map", grid)
    assert code == 0
    assert words.count("deployed on grid") == 2
    (window,) = [run for run in document["rules_run"] if run["id"] == "VF-P03"]
    assert window["checked"] == 2
    assert "no map" not in words
    _, document, words = checks(vinefab, "three_level_tree")
    assert [note["id"] for note in document["notes"]] == ["VF-P03"]
    assert "no map" in words


def test_contacts_on_a_map_count(vinefab, plain, grid):
    text = plain.read_text().replace("120.0", "600.0")
    plain.write_text(text + "[build]\ntrunk_width_mm = 8.0\n")
    limit = ("--limit", "VF-P03.loose_kpa=30")
    free, grown = (
        next(f for f in checks(vinefab, plain, *limit, *more)[1]["findings"] if f["id"] == "VF-P03")
        for more in ((), ("--map", grid))
    )
    assert "in free space" in free["message"]
    assert "on grid" in grown["message"]
    assert grown["measured"] > 1.05 * free["measured"]


def test_findings_are_drawn_on_layers_that_are_not_cut(vinefab, plain, tmp_path):
    plain.write_text(plain.read_text() + "[build]\ntail_mm = 100.0\n")
    picture = tmp_path / "findings.dxf"
    code, words, _ = vinefab("check", plain, "--dxf", picture)
    assert code == 1
    assert f"wrote {picture}" in words
    drawing = read_dxf(picture.read_text(encoding="utf-8"))
    assert {path.layer for path in drawing.paths} == {"VF_90_REG", "VF_91_DOC"}
    assert drawing.oddities == ()
