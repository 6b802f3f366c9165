"""The frozen benchmark: problems that stay, rows that repeat, ranks that anybody can compute."""

import json
from functools import partial

import numpy as np
import pytest
from scipy.stats import ttest_rel

import vinefab as vf
from vinefab.core.errors import BadInputError, UnfitInputError, UnreadableFileError
from vinefab.search.optimizers.optimizer import make_optimizer_config
from vinefab.studies import frozen_problems as frozen
from vinefab.studies.frozen_problems import BenchmarkResults, BenchmarkRow

GRIDS = [name for name in frozen.DIGESTS if not name.startswith("cave")]


@pytest.mark.parametrize(
    "names",
    [GRIDS, pytest.param(sorted(set(frozen.DIGESTS) - set(GRIDS)), marks=pytest.mark.thorough)],
)
def test_problems_are_those_of_their_version(names):
    assert list(frozen.posed(names)) == names


def test_a_problem_that_would_be_another_is_refused(monkeypatch):
    monkeypatch.setattr(frozen, "VERSION", 2)
    frozen.digest_of.cache_clear()
    with pytest.raises(UnfitInputError, match=r"targets-free-pass.*makes another problem of it"):
        frozen.posed(["targets-free-pass"])
    frozen.digest_of.cache_clear()


@pytest.fixture
def small(monkeypatch):
    """Problems of two maps and two generations in place of the shipped ones."""
    names = ["grid-coverage-levels-pass", "targets-levels-pass"]
    made = {
        name: one.changed(
            maps=one.maps.changed(count=min(2, one.maps.count)),
            search=one.search.changed(population=6, generations=2),
            evaluation=one.evaluation.changed(fabricable=False, finalists_by="training"),
        )
        for name, one in frozen.frozen_problems().items()
        if name in names
    }
    monkeypatch.setattr(frozen, "UNSEEN", 3)
    monkeypatch.setattr(frozen, "frozen_problems", lambda: made)
    frozen.digest_of.cache_clear()
    monkeypatch.setattr(frozen, "DIGESTS", {name: frozen.digest_of(name) for name in made})
    yield made
    frozen.digest_of.cache_clear()


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.thorough)])
def test_searches_give_the_same_file_however_they_are_done(tmp_path, workers):
    do = partial(vf.benchmark, seeds=2, progress=False, designs="plain_vine")
    found = do(optimizers=("islands", "random"), out=tmp_path / "one")
    again = do(optimizers=("islands", "random"), out=tmp_path / "two", workers=workers)
    assert again.json_text() == found.json_text()
    kept = BenchmarkResults.read(tmp_path / "one" / "benchmark.json")
    assert kept == found
    # An object that asks and tells as `islands` does, under its own name.
    own = vf.benchmark(
        "targets-levels-pass",
        optimizers=make_optimizer_config("islands"),
        out=tmp_path / "own",
        seeds=2,
        progress=False,
    )
    theirs = [
        r.score
        for r in found.rows
        if (r.problem, r.contender) == ("targets-levels-pass", "islands")
    ]
    assert [row.score for row in own.rows] == theirs
    both = vf.compare([tmp_path / "one" / "benchmark.json", tmp_path / "own" / "benchmark.json"])
    assert len(both.rows) == len(found.rows) + 2


def row(contender, number, score, **changed):
    facts = {"problem": GRIDS[0], "can_be_made": True, "searched": True, **changed}
    return BenchmarkRow(contender=contender, number=number, score=score, **facts)


def test_ranks_are_by_means_and_differences_by_pairs():
    scores = {"good": [0.61, 0.55, 0.58, 0.60], "bad": [0.50, 0.47, 0.46, 0.53]}
    rows = [
        row(name, n, value) for name, values in scores.items() for n, value in enumerate(values)
    ]
    rows += [row("brought", 0, 0.57, searched=False, can_be_made=False)]
    places = BenchmarkResults(rows=tuple(rows)).ranking(GRIDS[0])
    assert [place.contender for place in places] == ["good", "brought", "bad"]
    assert (places[0].to_best, places[1].to_best, places[1].can_be_made) == (None, None, 0.0)
    test = ttest_rel(scores["bad"], scores["good"])
    assert places[2].to_best.mean == pytest.approx(np.mean(scores["bad"]) - np.mean(scores["good"]))
    assert places[2].to_best.p == pytest.approx(test.pvalue)
    interval = test.confidence_interval(0.975)  # two others
    assert (places[2].to_best.low, places[2].to_best.high) == pytest.approx(tuple(interval))


def test_files_that_are_none_are_refused(tmp_path):
    written = json.loads(BenchmarkResults(rows=(row("a", 0, 0.5),)).json_text())
    path, other = tmp_path / "a.json", tmp_path / "b.json"
    other.write_text(json.dumps(written))
    for change, words in (
        ({"schema": "vinefab/map-1"}, "is 'vinefab/map-1'"),
        ({"rows": [{}]}, "is not a result of the benchmark"),
        ({"problems": {GRIDS[0]: "0" * 12}}, "has another problem grid-coverage-levels-pass"),
    ):
        path.write_text(json.dumps(written | change))
        with pytest.raises(UnreadableFileError, match=words):
            vf.compare([path, other])
    path.write_text(json.dumps(written | {"rows": [written["rows"][0] | {"score": 0.6}]}))
    with pytest.raises(BadInputError, match="a of grid-coverage-levels-pass, seed 0"):
        vf.compare([path, other])
    with pytest.raises(UnfitInputError, match="plain_vine is among results of the benchmark"):
        vf.compare([other, "plain_vine"])
    with pytest.raises(BadInputError, match="optimizer is missing; give an optimizer, or designs"):
        vf.benchmark(out=tmp_path / "none")
