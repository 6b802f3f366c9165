import json
import re

from vinefab.cli.main import main

SMALL = ("--set", "columns=3", "--set", "rows=3", "--set", "size_mm=300")


def test_report_over_an_environment_repeats_itself(vinefab, tmp_path):
    pages = []
    for name in ("one", "two"):
        out, numbers = tmp_path / f"{name}.html", tmp_path / f"{name}.json"
        code, words, complaint = vinefab(
            "report", "plain_vine", "--environment", "grid", "--count", 3, *SMALL, "--poses", 2,
            "--out", out, "--json", numbers,
        )  # fmt: skip
        assert (code, complaint) == (0, "")
        assert "; 3 maps]" in words
        document = json.loads(numbers.read_text())
        assert len(document["fields"][0]["deployments"]) == 6
        # the digest in its mark is that of the page with its path
        pages.append(re.sub(r" \[[0-9a-f]{16}\]", "", out.read_text().replace(str(out), "OUT")))
    assert pages[0] == pages[1]


def test_an_interrupted_report_leaves_nothing(monkeypatch, grid, tmp_path):
    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("vinefab.prediction.predict.tolerance", interrupted)
    before = sorted(tmp_path.iterdir())
    out = tmp_path / "report.html"
    code = main(
        ["report", "plain_vine", "--maps", str(grid), "--out", str(out), "--json", "x.json"]
    )
    assert code == 130
    assert sorted(tmp_path.iterdir()) == before


def test_compare_says_who_is_better(vinefab, tmp_path):
    page, numbers = tmp_path / "compare.html", tmp_path / "compare.json"
    arguments = (
        "compare", "three_level_tree", "plain_vine", "--environment", "grid", "--count", 2,
        *SMALL, "--poses", 1, "--out", page, "--json", numbers,
    )  # fmt: skip
    code, words, complaint = vinefab(*arguments, "--measure", "seen")
    assert (code, complaint) == (0, "")
    assert "three_level_tree minus plain_vine" in words
    assert json.loads(numbers.read_text())["measure"] == "seen_percent"
    assert "Paired differences" in page.read_text()
    code, _, complaint = vinefab(*arguments, "--measure", "growth_pressure")
    assert code == 2
    assert "growth_pressure_loose_kpa" in complaint
    assert vinefab("compare", "plain_vine", "--environment", "grid")[0] == 2
