"""The smoke run, as a user runs it: everything at the smallest size."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from vinefab.cli.main import main
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.model.files.design_toml import read_design
from vinefab.model.tree import branch_tree
from vinefab.studies.ablation import VARIANTS
from vinefab.studies.optimizers_compared import evaluations_to, smoothed
from vinefab.studies.redeployment import RedeploymentJob
from vinefab.studies.reproduction import EXPERIMENTS
from vinefab.studies.study_jobs import (
    QUICK,
    JobStore,
    Training,
    design_from,
    plain_design,
    total_length_mm,
)
from vinefab.studies.study_runs import coverage_run, maps_of


def run(*arguments):
    return main(["reproduce", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Everything, done once."""
    out = tmp_path_factory.mktemp("reproduction") / "out"
    assert run("all", "--quick", "--workers", 1, "--out", out, "-q") == 0
    return out


def test_all_experiments_stand_on_the_page_and_in_the_numbers(folder):
    document = json.loads((folder / "reproduction.json").read_text())
    page = (folder / "reproduction.html").read_text()
    assert document["schema"] == "vinefab/reproduction-1"
    assert list(document["experiments"]) == list(EXPERIMENTS)
    assert "Smoke run" in page
    assert page.count("data:image/svg+xml") >= len(EXPERIMENTS)
    for name, found in document["experiments"].items():
        assert f"{name}: {found['title']}" in page
        assert found["numbers"]
        for claim in found["claims"]:
            interval = claim["difference"]
            assert interval["low"] <= interval["value"] <= interval["high"] or claim["kept_designs"]
            assert (claim["verdict"] == "held") == (interval["low"] > 0.0)
            assert 0.0 < interval["p"] <= 1.0
    assert document["claims_held_corrected"] <= document["claims_held"]


def test_fabricable_winners_pass_the_check(folder):
    document = json.loads((folder / "reproduction.json").read_text())
    for found in document["experiments"]["price"]["data"].values():
        assert found["passes"]["fabricable"] == QUICK.seeds
        assert np.shape(found["free"]) == np.shape(found["fabricable"])


def test_every_variant_says_what_it_asks(folder):
    document = json.loads((folder / "reproduction.json").read_text())
    data = document["experiments"]["ablation"]["data"]
    assert list(data) == [variant.name for variant in VARIANTS]
    for variant in VARIANTS:
        assert len(data[variant.name]["differences"]) == 2 * len(variant.asks)
    sight, free = data["sensors see in line of sight"], data["base"]
    lead = "Grid designs lead in the Grid"
    assert sight["differences"][lead] != free["differences"][lead]


def test_the_page_needs_nothing_else(folder):
    page = (folder / "reproduction.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "<script" not in page


def test_lost_parts_are_done_again_with_the_same_numbers(folder, tmp_path, capsys):
    """A copy of the folder without its finals and half of its parts ends as the first one did."""
    again = tmp_path / "again"
    shutil.copytree(folder, again)
    (again / "reproduction.json").unlink()
    kept = sorted((again / "parts").iterdir())
    lost = [path for path in kept if path.name.startswith("test_")][::2]
    for path in lost:
        path.unlink()
    newest = max(path.stat().st_mtime_ns for path in (again / "parts").iterdir())
    assert run("search", "--quick", "--workers", 1, "--out", again) == 0
    for name in ("reproduction.json", "reproduction.html"):
        assert (again / name).read_bytes() == (folder / name).read_bytes()
    written = [p for p in (again / "parts").iterdir() if p.stat().st_mtime_ns > newest]
    assert {path.name for path in written} == {path.name for path in lost}
    assert "claims hold" in capsys.readouterr().out


def test_another_size_is_refused_in_one_line(folder, capsys):
    before = (folder / "reproduction.json").read_bytes()
    assert run("transfer", "--out", folder) == 2
    complaint = capsys.readouterr().err
    assert "settings.json: seeds is 5; allowed: 2, as it was begun" in complaint
    assert complaint.count("\n") == 1
    assert (folder / "reproduction.json").read_bytes() == before


def test_a_foreign_folder_is_left_alone(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("mine")
    assert run("transfer", "--quick", "--out", tmp_path) == 2
    assert "holds other files" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_an_unknown_experiment_is_named(tmp_path, capsys):
    assert run("transfr", "--quick", "--out", tmp_path / "out") == 2
    assert "did you mean 'transfer'?" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_damaged_part_is_named(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    job = Training(settings=coverage_run(QUICK, "grid", 0))
    part = copy / "parts" / f"{job.key}.json"
    part.write_text(part.read_text()[:40])
    with pytest.raises(UnreadableFileError, match="is not JSON"):
        JobStore(copy, QUICK, 1, lambda _, __: None).train([job])


def test_processes_find_what_one_finds(folder, tmp_path):
    """Two processes, another folder: the same parts, byte for byte."""
    jobs = [Training(settings=coverage_run(QUICK, "grid", number)) for number in range(2)]
    with JobStore(tmp_path / "lab", QUICK, 2, lambda _, __: None) as store:
        store.train([*jobs, Training(settings=coverage_run(QUICK, "cave", 0))])
    for job in jobs:
        path = f"parts/{job.key}.json"
        assert (tmp_path / "lab" / path).read_bytes() == (folder / path).read_bytes()


def test_a_lab_of_another_version_is_refused(tmp_path):
    JobStore(tmp_path / "lab", QUICK, 1, lambda _, __: None)
    with pytest.raises(BadInputError, match="poses"):
        JobStore(tmp_path / "lab", replace(QUICK, poses=7), 1, lambda _, __: None)


def test_runs_that_differ_have_other_keys():
    run = coverage_run(QUICK, "grid", 0)
    others = [coverage_run(QUICK, "grid", 1), coverage_run(QUICK, "cave", 0)]
    assert len({Training(settings=r).key for r in (run, *others)}) == 3


def test_a_design_survives_being_plain():
    design = read_design("grid_explorer")
    again = design_from(json.loads(json.dumps(plain_design(design))))
    assert (again.levels, again.build) == (design.levels, design.build)
    assert total_length_mm(again) == pytest.approx(branch_tree(design).total_length_mm)


def test_headings_that_meet_the_same_fate_count_once():
    """One heading has one shape; a straight vine too short to meet a wall has one per heading."""
    short = {**plain_design(read_design("plain_vine")), "trunk_length_mm": 14.0, "levels": []}
    once = RedeploymentJob(design=short, worlds=maps_of("grid", 3, 1), headings=1, buffer_mm=20.0)
    assert once.run()["shapes"] == 1
    # Tips 14 mm from the base, 60 degrees apart, are 14 mm from each other: more than 10.
    three = replace(once, headings=3).run()
    assert three["shapes"] == 3
    assert three["stops"]["full_length"] == 3
    assert replace(once, headings=13).run()["shapes"] == 1


def test_how_many_designs_a_level_takes():
    best = np.array([[0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [0.0] * 8])
    assert smoothed(best)[0].tolist() == pytest.approx([0, 0, 1 / 3, 0.5, 0.6, 0.8, 1.0, 1.0])
    assert evaluations_to(best, 0.75, 10).ravel().tolist() == [60.0, 80.0]
