import shlex

from vinefab.search.record.store import RunStore


def test_an_interrupted_run_says_how_to_go_on_and_does(monkeypatch, vinefab, run_file, tmp_path):
    out = tmp_path / "a run"
    add = RunStore.add

    def interrupted(*given):
        add(*given)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(RunStore, "add", interrupted)
        code, words, complaint = vinefab("optimize", run_file, "--out", out, "--workers", 2)
    assert (code, words) == (130, "")
    assert complaint.count("\n") == 1
    told = complaint.split("to resume: ")[1]
    assert "--workers 2" in told
    code, words, complaint = vinefab(*shlex.split(told)[1:])
    assert (code, complaint) == (0, "")
    assert "2 generations" in words
