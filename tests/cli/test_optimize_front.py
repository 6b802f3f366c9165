import json


def test_optimize_writes_a_front_for_two_objectives(vinefab, run_file, tmp_path):
    text = run_file.read_text().replace(
        "[space]", '[task]\nname = "coverage"\nobjectives = ["coverage", "film_length"]\n[space]'
    )
    run_file.write_text(text)
    out = tmp_path / "front_run"
    out.mkdir()
    (out / "front.svg").write_text("mine")
    code, _, complaint = vinefab("optimize", run_file, "--out", out)
    assert code == 2
    assert "front.svg" in complaint
    assert not (out / "run.sqlite").exists()
    (out / "front.svg").unlink()
    code, words, _ = vinefab("optimize", run_file, "--out", out)
    assert code == 0
    assert "front of" in words
    document = json.loads((out / "front.json").read_text())
    for entry in document["designs"]:
        path = out / "front" / f"{entry['design']}.toml"
        assert vinefab("check", path)[0] == 0
    assert (out / "front.png").read_bytes().startswith(b"\x89PNG")
