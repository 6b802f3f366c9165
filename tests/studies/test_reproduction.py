"""The smoke run, as a user runs it: everything at the smallest size."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from vinefab.cli.main import main
from vinefab.core.errors import BadInputError, ForeignFileError, UnreadableFileError
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import Design, PieceSettings
from vinefab.search.run import generated_maps
from vinefab.search.settings import RunSettings, read_run
from vinefab.studies.assumption_studies import VARIANTS
from vinefab.studies.deployment_studies import (
    BEYOND,
    RedeploymentJob,
    reach_run,
    redeployments,
    shape_count,
    tip_groups,
)
from vinefab.studies.study_runs import (
    EXPERIMENTS,
    PAPER_GROWTH,
    QUICK_SIZE,
    JobStore,
    Trained,
    Training,
    as_tested,
    coverage_run,
    maps_of,
    total_length_mm,
)
from vinefab.studies.training_studies import (
    evaluations_to,
    known_map_shares,
    smoothed,
    variety_runs,
    weighted,
)
from vinefab.tasks.evaluate import composites


def run(*arguments):
    return main(["reproduce", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Everything, done once."""
    out = tmp_path_factory.mktemp("reproduction") / "out"
    assert run("all", "--quick", "--workers", 1, "--out", out, "-q") == 0
    return out


@pytest.mark.thorough
def test_all_experiments_stand_on_the_page_and_in_the_numbers(folder):
    document = json.loads((folder / "reproduction.json").read_text())
    page = (folder / "reproduction.html").read_text()
    assert document["schema"] == "vinefab/reproduction-2"
    assert list(document["experiments"]) == list(EXPERIMENTS)
    assert "Smoke run" in page
    assert page.count("data:image/svg+xml") >= len(EXPERIMENTS)
    for name, found in document["experiments"].items():
        assert f"{name}: {found['title']}" in page
        assert found["numbers"]
        for claim in found["claims"]:
            interval = claim["difference"]
            assert interval["low"] <= interval["value"] <= interval["high"]
            assert (claim["verdict"] == "held") == (interval["low"] > 0.0)
            assert 0.0 <= interval["p"] <= 1.0
    assert document["claims_held_corrected"] <= document["claims_held"]
    kinds = [c["kind"] for f in document["experiments"].values() for c in f["claims"]]
    assert set(kinds) == {"of the paper", "our threshold", "calibrated"}
    assert document["claims"] == kinds.count("of the paper")


@pytest.mark.thorough
def test_fabricable_winners_pass_the_check(folder):
    document = json.loads((folder / "reproduction.json").read_text())
    for found in document["experiments"]["price"]["data"].values():
        assert found["passes"]["fabricable"] == found["passes"]["pieces"] == QUICK_SIZE.making_seeds
        assert np.shape(found["free"]) == np.shape(found["fabricable"]) == np.shape(found["pieces"])


@pytest.mark.thorough
def test_every_variant_says_what_it_asks(folder):
    document = json.loads((folder / "reproduction.json").read_text())
    data = document["experiments"]["ablation"]["data"]
    assert list(data) == [variant.name for variant in VARIANTS]
    for variant in VARIANTS:
        assert len(data[variant.name]["differences"]) == 2 * len(variant.asks)
    sight, free = data["sensors see in line of sight"], data["base"]
    lead = "Grid designs lead in the Grid"
    assert sight["differences"][lead] != free["differences"][lead]


@pytest.mark.thorough
def test_the_page_needs_nothing_else(folder):
    page = (folder / "reproduction.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "<script src" not in page


@pytest.mark.thorough
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
    assert "claims of the paper hold" in capsys.readouterr().out


@pytest.mark.thorough
def test_another_size_is_refused_in_one_line(folder, capsys):
    before = (folder / "reproduction.json").read_bytes()
    assert run("transfer", "--out", folder) == 2
    complaint = capsys.readouterr().err
    assert "settings.json: seeds is 10; allowed: 2, as it was begun" in complaint
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


@pytest.mark.thorough
def test_a_damaged_part_is_named(folder, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    job = Training(settings=coverage_run(QUICK_SIZE, "grid", 0))
    part = copy / "parts" / f"{job.key}.json"
    part.write_text(part.read_text()[:40])
    with pytest.raises(UnreadableFileError, match="is damaged"):
        JobStore(copy, QUICK_SIZE, 1).train([job])


@pytest.mark.thorough
def test_processes_find_what_one_finds(folder, tmp_path):
    """Two processes, another folder: the same parts, byte for byte."""
    jobs = [Training(settings=coverage_run(QUICK_SIZE, "grid", number)) for number in range(2)]
    with JobStore(tmp_path / "lab", QUICK_SIZE, 2) as store:
        store.train([*jobs, Training(settings=coverage_run(QUICK_SIZE, "cave", 0))])
    for job in jobs:
        path = f"parts/{job.key}.json"
        assert (tmp_path / "lab" / path).read_bytes() == (folder / path).read_bytes()


def test_a_lab_of_another_version_is_refused(tmp_path):
    with JobStore(tmp_path / "lab", QUICK_SIZE, 1) as store:
        store.finish("reach")
        assert store.finished() == ["reach"]
    finished = tmp_path / "lab" / "finished.json"
    finished.write_text(finished.read_text().replace('"names"', '"name"'))
    with pytest.raises(UnreadableFileError, match="is damaged"):
        store.finished()
    with pytest.raises(BadInputError, match="poses"):
        JobStore(tmp_path / "lab", replace(QUICK_SIZE, poses=7), 1)


def test_runs_that_differ_have_other_keys():
    run = coverage_run(QUICK_SIZE, "grid", 0)
    others = [coverage_run(QUICK_SIZE, "grid", 1), coverage_run(QUICK_SIZE, "cave", 0)]
    assert len({Training(settings=r).key for r in (run, *others)}) == 3


def test_a_design_is_kept_to_the_bit_without_its_origin():
    design = Design.read("grid_explorer_levels")
    cut = design.changed(build=design.build.changed(pieces=PieceSettings(most=3, lap_mm=12.0)))
    result = Trained(
        key="k", design=as_tested(cut), fitness=0.1, best=(), mean=(), evaluations=1, penalty=0.0
    )
    again = Trained.of_json(result.as_json)
    assert again == result
    assert (again.design.levels, again.design.build) == (cut.levels, cut.build)
    assert not again.design.origin
    assert total_length_mm(again.design) == pytest.approx(design.tree.total_length_mm)


@pytest.fixture
def once():
    """A straight vine too short to meet a wall, launched once."""
    short = Design.read("plain_vine").changed(trunk={"length_mm": 14.0})
    return RedeploymentJob(
        design=short, worlds=maps_of(QUICK_SIZE, "grid", 3, 1), headings=1, buffer_mm=20.0
    )


def test_headings_that_meet_the_same_fate_count_once(once):
    """One heading has one shape; a straight vine too short to meet a wall has one per heading."""
    assert once.run().shapes == 1
    # Tips 14 mm from the base, 60 degrees apart, are 14 mm from each other, and 12 mm from the
    # other body: more than 10.
    three = replace(once, headings=3).run()
    assert (three.shapes, three.tips) == (3, 3)
    assert three.ends["full_length"] == 3
    assert sum(three.ends.values()) == 3
    thirteen = replace(once, headings=13).run()
    assert (thirteen.shapes, thirteen.tips) == (1, 1)


def test_two_ways_to_one_place_are_two_shapes():
    """Trunks around either side of an obstacle whose tips meet are one group of tips."""
    around = [[(250.0, 15.0), (250.0 + side, 100.0), (250.0, 200.0)] for side in (-40.0, 40.0)]
    grown = [SimpleNamespace(chain_mm=lambda _, chain=chain: np.array(chain)) for chain in around]
    world = grid_map(3)
    assert tip_groups(np.array([chain[-1] for chain in around])) == 1
    assert shape_count(world, grown) == 2
    assert shape_count(world, [grown[0], grown[0]]) == 1


def test_open_bounds_let_robots_through(once):
    """A vine heading out of the map ends at its bounds, or beyond them if they are open."""
    away = replace(once, design=once.design.changed(trunk={"length_mm": 3000.0}), headings=24)
    closed, opened = away.run(), replace(away, open_bounds=True).run()
    assert closed.ends[BEYOND] == 0
    assert closed.ends["corner at the bounds"] > 12
    assert opened.ends[BEYOND] > 12
    assert opened.ends["corner at the bounds"] == 0
    assert opened.share < closed.share


@pytest.mark.thorough
def test_no_study_depends_on_the_default_growth(folder, tmp_path, monkeypatch):
    """With other defaults, as users have them, every run and test is the same job as before."""
    shipped = GrowthOptions.__init__

    def other(self, **given):
        defaults = {"head_on_half_angle_rad": 0.2, "children_of_stuck": "deploy"}
        shipped(self, **{**defaults, "body": "inflated", "pressure_stop": True, **given})

    monkeypatch.setattr(GrowthOptions, "__init__", other)
    assert RunSettings().growth.body == "inflated"
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    before = {path.name: path.stat().st_mtime_ns for path in (copy / "parts").iterdir()}
    assert run("all", "--quick", "--workers", 1, "--out", copy, "-q") == 0
    assert {p.name: p.stat().st_mtime_ns for p in (copy / "parts").iterdir()} == before
    assert (copy / "reproduction.json").read_bytes() == (folder / "reproduction.json").read_bytes()
    asked = PAPER_GROWTH.body, PAPER_GROWTH.pressure_stop, PAPER_GROWTH.children_of_stuck
    assert asked == ("centerline", False, "stop")
    assert PAPER_GROWTH.half_angle_deg == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["grid", "cave"])
def test_the_contest_s_free_problems_ask_for_the_published_model(name):
    run = read_run(Path(f"examples/contest/{name}.toml"))
    text = Path(f"examples/contest/{name}.toml").read_text()
    assert (run.growth.body, run.growth.pressure_stop) == ("centerline", False)
    assert 'body = "centerline"' in text
    assert "pressure_stop = false" in text


def test_every_run_trains_on_maps_of_its_own():
    size = replace(QUICK_SIZE, single_seeds=3)
    runs = [coverage_run(size, "grid", number) for number in range(size.single_seeds)]
    taken = [set(range(r.maps.seed, r.maps.seed + r.maps.count)) for r in runs]
    assert all(len(maps) == size.training_maps for maps in taken)
    assert len(set.union(*taken)) == sum(map(len, taken))
    ways = variety_runs(size)
    assert [[run.maps.seed for run in group] for group in ways.values()] == [[1, 4, 7]] * 4
    assert [group[0].maps.count for group in ways.values()] == [1, 1, 2, 3]


@pytest.mark.parametrize(
    ("home", "size_mm", "radius_mm", "buffer_mm", "vine_mm"),
    [("grid", 1250.0, 125.0, 100.0, 3750.0), ("cave", 900.0, 90.0, 72.0, 2700.0)],
)
def test_large_maps_enlarge_what_the_paper_does_not_publish(
    home, size_mm, radius_mm, buffer_mm, vine_mm
):
    """Table 1 stays."""
    large = replace(QUICK_SIZE, large_maps=True)
    usual, run = coverage_run(QUICK_SIZE, home, 0), coverage_run(large, home, 0)
    assert run.space == usual.space
    (world,) = generated_maps(run.maps.changed(count=1))
    assert world.bounds.bounds == (0.0, 0.0, size_mm, size_mm)
    assert run.task.parameters == {"radius_mm": radius_mm}
    assert usual.task.parameters == {"radius_mm": 50.0}
    assert reach_run(large, home, 0).task.parameters == {"buffer_mm": buffer_mm}
    job = redeployments(large, home)[0]
    assert (job.design.trunk_length_mm, job.buffer_mm) == (vine_mm, buffer_mm)
    named = {variant.name: variant for variant in VARIANTS}
    at_scale = named["maps of the scale of Fig. 4"]
    assert at_scale.run(QUICK_SIZE, home, 0) == named["base"].run(large, home, 0)
    assert at_scale.redeployments(QUICK_SIZE, home) == named["base"].redeployments(large, home)
    other = named["the same, sensors of 50 mm"].run(QUICK_SIZE, home, 0)
    assert other.maps == run.maps
    assert other.task.parameters["radius_mm"] == 50.0


def test_trade_offs_of_small_deviation_cost_what_they_are_called():
    """Fitness per unit of deviation, by fitness per unit of the mean."""
    base = coverage_run(QUICK_SIZE, "grid", 0)
    for name, cost in {
        "min deviation 6": 6.0,
        "min deviation 3": 3.0,
        "min deviation 1": 1.0,
    }.items():
        settings = weighted(base, name).evaluation

        def worth(*scores, settings=settings):
            return composites(np.array([scores]), settings.composite, settings.reference_deviation)[
                0
            ]

        by_mean = worth(0.31, 0.31) - worth(0.30, 0.30)
        by_deviation = worth(0.30, 0.30) - worth(0.29, 0.31)
        assert by_deviation / by_mean == pytest.approx(cost)
    assert (
        weighted(base, "mean").evaluation.reference_deviation == base.evaluation.reference_deviation
    )


def test_unseen_maps_cost_what_designs_gain_on_their_own_training_maps():
    """Designs and maps of any difficulty; own maps bring 0.1 of a mean score of 1."""
    rng = np.random.default_rng(3)
    worth, ease = rng.normal(0.0, 0.2, 4), rng.normal(0.0, 0.3, 4 * 6)
    own = 0.1 * np.kron(np.eye(4), np.ones((1, 6)))
    known = (1.0 + worth[:, None] + ease + own)[:, :, None]
    unseen = (1.0 + worth)[:, None, None] + rng.normal(0.0, 1e-9, (4, 9, 2))
    expected = -0.1 / (1.0 + worth.mean())
    assert known_map_shares(known, unseen) == pytest.approx([expected] * 4, abs=1e-6)
    assert known_map_shares(known - own[:, :, None], unseen) == pytest.approx([0.0] * 4, abs=1e-6)


def test_how_many_designs_a_level_takes():
    best = np.array([[0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [0.0] * 8])
    assert smoothed(best)[0].tolist() == pytest.approx([0, 0, 1 / 3, 0.5, 0.6, 0.8, 1.0, 1.0])
    assert evaluations_to(best, 0.75, 10).ravel().tolist() == [60.0, 80.0]


def test_a_run_that_was_killed_as_it_began_goes_on(tmp_path):
    """SIGKILL while the settings are written leaves them under a temporary name."""
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / ".settings.json.k1ll3d").write_text("{")
    with JobStore(folder, QUICK_SIZE, 1) as store:
        assert store.finished() == []
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(ForeignFileError, match="holds other files"):
        JobStore(other, QUICK_SIZE, 1)
