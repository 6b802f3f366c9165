"""``vinefab check`` with maps and limits."""

import json
import subprocess
import sys

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


def test_without_a_map_the_simulator_is_not_loaded():
    script = (
        "import sys\nfrom vinefab.cli.main import main\n"
        "main(['check', 'plain_vine', '-q'])\n"
        "print([m for m in sys.modules if m.startswith(('numba', 'vinefab.growth.'))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, errors="replace", check=True
    )
    assert done.stdout.strip() == "[]"


def test_fix_writes_a_new_design_that_passes(vinefab, plain, tmp_path):
    out = tmp_path / "mended.toml"
    plain.write_text(plain.read_text() + "[build]\ntail_mm = 100.0\npressure_kpa = 30.0\n")
    before = plain.read_bytes()
    code, words, _ = vinefab("check", plain, "--fix", out)
    assert code == 0
    assert "the tail: 100 -> 150 mm" in words
    assert vinefab("check", out, "-q")[0] == 0
    assert plain.read_bytes() == before
    # What vinefab wrote may be written again, also from itself to another name.
    assert vinefab("check", plain, "--fix", out, "-q")[0] == 0


def test_fix_shows_what_it_costs_on_maps(vinefab, plain, grid, tmp_path):
    plain.write_text(plain.read_text() + "[build]\ntail_mm = 100.0\n")
    code, words, _ = vinefab("check", plain, "--fix", tmp_path / "out.toml", "--map", grid)
    assert code == 0
    assert "coverage, mean over 1 map:" in words


def test_fix_of_a_sound_design_writes_nothing(vinefab, tmp_path):
    out = tmp_path / "out.toml"
    code, words, _ = vinefab("check", "three_level_tree", "--fix", out)
    assert (code, out.exists()) == (0, False)
    assert "nothing to fix" in words


def test_fix_that_finds_nothing_says_so(vinefab, plain, tmp_path):
    out = tmp_path / "out.toml"
    code, words, _ = vinefab("check", plain, "--fix", out, "--limit", "VF-L04.error=0.01")
    assert (code, out.exists()) == (1, False)
    assert "clears VF-L04; nothing written" in words


def test_fix_keeps_what_it_is_told_to(vinefab, plain, tmp_path):
    plain.write_text(
        plain.read_text() + "[[level]]\nbranches = 2\nlength = 36.0\nangle_deg = 80.0\n"
    )
    out = tmp_path / "out.toml"
    keeps = ("--keep", "branches,length", "--keep", "angle")
    code, words, _ = vinefab("check", plain, "--fix", out, *keeps)
    assert code == 0
    assert "every branch stays" in words
    assert "what it costs in score: give maps with --map" in words
    assert "length = 36.0" in out.read_text()


def test_findings_are_drawn_on_layers_that_are_not_cut(vinefab, plain, tmp_path):
    plain.write_text(plain.read_text() + "[build]\ntail_mm = 100.0\n")
    picture = tmp_path / "findings.dxf"
    code, words, _ = vinefab("check", plain, "--dxf", picture)
    assert code == 1
    assert f"wrote {picture}" in words
    drawing = read_dxf(picture.read_text(encoding="utf-8"))
    assert {path.layer for path in drawing.paths} == {"VF_90_REG", "VF_91_DOC"}
    assert drawing.oddities == ()


def test_findings_are_drawn_as_a_picture_and_not_as_a_job(vinefab, plain, tmp_path):
    plain.write_text(plain.read_text() + "[build]\ntail_mm = 100.0\n")
    svg, png = tmp_path / "findings.svg", tmp_path / "findings.png"
    code, words, _ = vinefab("check", plain, "--svg", svg, "--png", png)
    assert code == 1
    assert f"wrote {svg}" in words
    assert f"wrote {png}" in words
    assert "VF_" not in svg.read_text()
    assert png.read_bytes().startswith(b"\x89PNG")
