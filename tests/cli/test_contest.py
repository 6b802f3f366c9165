import json


def test_a_comparison_makes_a_table_and_a_figure(vinefab, run_file, tmp_path):
    out = tmp_path / "contest"
    arguments = (
        "contest", run_file, "--optimizer", "random", "--optimizer", "pso:inertia=0.5",
        "--seeds", 1, "--unseen", 1, "--poses", 1, "--out", out,
    )  # fmt: skip
    code, words, complaint = vinefab(*arguments)
    assert (code, complaint) == (0, "")
    document = json.loads((out / "comparison.json").read_text())
    assert document["schema"] == "vinefab/comparison-1"
    assert [entry["optimizer"] for entry in document["table"]] == ["random", "pso:inertia=0.5"]
    assert (out / "comparison.svg").exists()
    assert "pso:inertia=0.5" in words
    assert "difference to random" in words
    assert "paired by seed" in words
    assert "1 seed: no interval" in words
