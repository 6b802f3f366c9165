from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t as student
from scipy.stats import ttest_1samp, ttest_rel

from vinefab.core.errors import BadInputError, ForeignFileError, UnreadableFileError
from vinefab.core.progress import heard_by
from vinefab.core.view import lines
from vinefab.growth.options import GrowthOptions
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import Bounds, SpaceSettings
from vinefab.studies.optimizer_contest import (
    Contender,
    Contest,
    ContestRow,
    comparison_blocks,
    comparison_json,
    comparison_svg,
    comparison_table,
    contest_rows,
)

TINY = RunSettings(
    name="tiny",
    growth=GrowthOptions.published(),
    maps=MapSettings(count=1),
    space=SpaceSettings(levels=Bounds(low=2, high=2), branches=Bounds(low=2, high=2)),
    search=SearchSettings(population=4, generations=2),
    evaluation=EvaluationSettings(fabricable=False, finalists=2, final_poses_per_map=1),
)
CONTENDERS = tuple(
    Contender(label=name, part=PartSettings(name=name)) for name in ("random", "pso")
)
CONTEST = Contest(problems=(TINY,), contenders=CONTENDERS, seeds=2, unseen=1, poses=1)


def timeless(rows: list[ContestRow]) -> list[ContestRow]:
    return [replace(row, optimizer_s=0.0, total_s=0.0) for row in rows]


def test_contenders_meet_the_same_maps_and_every_number_its_own() -> None:
    contest_runs = CONTEST.runs()
    assert [(b.contender, b.number) for b in contest_runs] == [
        ("random", 0), ("pso", 0), ("random", 1), ("pso", 1),
    ]  # fmt: skip
    assert [b.settings.maps.seed for b in contest_runs] == [1, 1, 2, 2]
    assert [b.settings.search.seed for b in contest_runs] == [1, 1, 2, 2]
    assert len({b.key for b in contest_runs}) == 4


def test_a_comparison_goes_on_where_it_was_cut_off(tmp_path: Path) -> None:
    record, seen = tmp_path / "bouts.jsonl", []
    with heard_by(lambda now: seen.append(now.done) if now.phase == "runs" else None):
        whole = contest_rows(CONTEST, record)
    assert seen == [0, 0, 1, 2, 3, 4]
    assert all(row.evaluations == 8 for row in whole)
    text = record.read_text()
    record.write_text(text[: text.rindex("{") + 30])  # killed while writing the last line
    seen.clear()
    with heard_by(lambda now: seen.append(now.done) if now.phase == "runs" else None):
        again = contest_rows(CONTEST, record)
    assert seen == [0, 3, 4]
    assert timeless(again) == timeless(whole)
    assert contest_rows(CONTEST, record) == again


def test_a_foreign_record_is_kept(tmp_path: Path) -> None:
    record = tmp_path / "bouts.jsonl"
    record.write_text("mine")
    with pytest.raises(ForeignFileError):
        contest_rows(CONTEST, record)
    assert record.read_text() == "mine"
    other = tmp_path / "other.jsonl"
    other.write_text('{"generator": "written by vinefab"}\n{"a": 1}\n')
    with pytest.raises(UnreadableFileError, match="not a record of a comparison"):
        contest_rows(CONTEST, other)


def made_up(contest: Contest, worth: dict[str, np.ndarray]) -> list[ContestRow]:
    return [
        ContestRow(
            key=contest_run.key,
            problem=contest_run.settings.name,
            contender=contest_run.contender,
            number=contest_run.number,
            unseen=float(worth[contest_run.contender][contest_run.number]),
            fresh=0.5,
            lucky=0.6,
            penalty=0.0,
            evaluations=8,
            optimizer_s=0.1,
            total_s=1.0,
        )
        for contest_run in contest.runs()
    ]


def test_the_table_says_who_is_better_and_how_sure_that_is() -> None:
    rng = np.random.default_rng(4)
    base = rng.normal(0.5, 0.1, 12)
    names = ("first", "better", "same")
    worth = dict(zip(names, (base, base + 0.02 + 0.01 * rng.random(12), base), strict=True))
    contest = Contest(
        problems=(TINY, TINY.changed(name="other")),
        contenders=tuple(Contender(label=n, part=PartSettings(name="random")) for n in names),
        seeds=12,
    )
    rows = made_up(contest, worth)
    table = comparison_table(contest, rows)
    assert [entry.problem for entry in table] == ["tiny"] * 3 + ["other"] * 3 + ["all"] * 3
    first, better, same = table[:3]
    assert first.difference is None
    assert "difference" not in first.content
    assert first.unseen.mean == pytest.approx(base.mean())
    ends = ttest_1samp(base, 0.0).confidence_interval()
    assert (first.unseen.low, first.unseen.high) == pytest.approx((ends.low, ends.high))
    # Two contenders are tested.
    p = ttest_rel(worth["better"], base).pvalue
    assert better.difference.p == pytest.approx(p)
    assert better.difference.p_adjusted == pytest.approx(2 * p)
    assert 0.02 <= better.difference.low < better.difference.high <= 0.03
    assert same.difference.p == 1.0
    assert "+0.0" in list(lines(comparison_blocks(contest, rows)))[3]
    assert comparison_svg(contest, rows).startswith(b"<?xml")
    assert '"vinefab/comparison-1"' in comparison_json(contest, rows)
    assert rows[0].key in comparison_json(contest, rows)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seeds": 0}, "--seeds is 0"),
        ({"contenders": ()}, "--optimizer"),
        ({"contenders": CONTENDERS * 2}, "each once"),
        ({"problems": (TINY, TINY)}, r"RUN\.toml"),
        ({"problems": (TINY.changed(maps=MapSettings(files=(Path("a"),))),)}, "generated maps"),
    ],
)
def test_comparisons_that_cannot_be_are_refused(change: dict[str, object], words: str) -> None:
    with pytest.raises(BadInputError, match=words):
        replace(CONTEST, **change)


def test_the_table_has_the_means_of_each_contender() -> None:
    worth = {"random": np.array([0.2, 0.4]), "pso": np.array([0.3, 0.7])}
    changes = (
        {"fresh": 0.1, "lucky": 0.2, "evaluations": 8, "optimizer_s": 1.0, "penalty": 0.0},
        {"fresh": 0.3, "lucky": 0.6, "evaluations": 12, "optimizer_s": 2.0, "penalty": 1.0},
    )
    rows = [replace(row, **changes[row.number]) for row in made_up(CONTEST, worth)]
    first, second = comparison_table(CONTEST, rows)
    half = 0.1 * student.ppf(0.975, 1)
    ends = {"low": pytest.approx(0.3 - half), "high": pytest.approx(0.3 + half)}
    assert first.content["unseen"] == {"mean": pytest.approx(0.3), **ends}
    assert (first.fresh, first.lucky) == pytest.approx((0.2, 0.4))
    assert (first.evaluations, first.optimizer_s, first.can_be_made) == (10.0, 1.5, 0.5)
    assert second.difference.mean == pytest.approx(0.2)
    assert second.difference.low == pytest.approx(0.2 - half)
    p = ttest_rel(worth["pso"], worth["random"]).pvalue
    assert second.difference.p == pytest.approx(p)
    line = list(lines(comparison_blocks(CONTEST, rows)))[3]
    assert line.endswith(f"+0.2000 [{0.2 - half:+.4f}, {0.2 + half:+.4f}; 2 seeds]  {p:.3f}")
