"""``vinefab check`` with maps and limits."""

import json
import subprocess
import sys

import pytest


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
    assert document["notes"] == []
    _, document, words = checks(vinefab, "three_level_tree")
    assert [note["id"] for note in document["notes"]] == ["VF-P03"]
    assert "no map" in words


def test_contacts_on_a_map_count(vinefab, grid):
    free = checks(vinefab, "three_level_tree")[1]
    grown = checks(vinefab, "three_level_tree", "--map", grid, "--body", "centerline")[1]

    def pressure(document):
        return next(f["measured"] for f in document["findings"] if f["id"] == "VF-P03")

    assert pressure(grown) != pytest.approx(pressure(free), rel=1e-3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--limit", "VF-B1.error=3"], "VF-B01"),
        (["--limit", "VF-B01.eror=3"], "error, warning"),
        (["--limit", "VF-B01=3"], "RULE.NAME=NUMBER"),
        (["--limit", "VF-B01.error=nan"], "VF-B01.error"),
        (["--map", "no_such.geojson"], "no_such.geojson"),
    ],
)
def test_bad_limits_and_maps_are_one_line(vinefab, options, words):
    code, _, complaint = vinefab("check", "plain_vine", *options)
    assert code == 2
    assert complaint.count("\n") == 1
    assert words in complaint


def test_a_map_without_a_start_is_refused(vinefab, grid, edited):
    def strip(document):
        document["features"] = [
            f for f in document["features"] if f["properties"].get("role") != "start"
        ]

    code, _, complaint = vinefab("check", "plain_vine", "--map", edited(grid, strip))
    assert code == 2
    assert "start" in complaint


def test_without_a_map_the_simulator_is_not_loaded():
    script = (
        "import sys\nfrom vinefab.cli.main import main\n"
        "main(['check', 'plain_vine', '-q'])\n"
        "print([m for m in sys.modules if m.startswith(('numba', 'vinefab.growth.'))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
