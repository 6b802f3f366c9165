"""The page of a run that has ended."""

import re
import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import vinefab as vf
from tests.search.conftest import followed
from vinefab.core.atomic import is_ours
from vinefab.core.errors import UnreadableFileError, VinefabError
from vinefab.core.view import Section
from vinefab.fabrication.pieces.partition import pieces_of
from vinefab.inflation.pattern import pattern_of
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design, PieceSettings
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.finding import CheckReport
from vinefab.model.laser import read_profile
from vinefab.model.target import Target, TargetsResult
from vinefab.prediction import run_winner
from vinefab.prediction.run_winner import EndedRun, run_blocks, run_in_folder, write_run_page
from vinefab.search.record.generations import Extension, SearchProgress
from vinefab.search.record.result import RECORD_FILE, RunArchive
from vinefab.search.run import run_search
from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings, SearchSettings
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

RUN = RunSettings(
    name="few",
    maps=MapSettings(count=1),
    space=SpaceSettings(levels=Bounds(low=2, high=2), branches=Bounds(low=2, high=3)),
    build=BuildSettings(trunk_width_mm=20.0),
    search=SearchSettings(population=4, generations=3),
    evaluation=EvaluationSettings(finalists=2, final_poses_per_map=2),
)


pytestmark = pytest.mark.usefixtures("on_few_maps")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a run and its page."""
    out = tmp_path_factory.mktemp("run")
    result = run_in_folder(RUN, out, again="").result
    write_run_page(out, EndedRun.read(out, result))
    return out


def test_the_folder_holds_a_page_and_its_pictures(folder: Path, few_unseen: int) -> None:
    page = (folder / "index.html").read_text()
    for heading in (
        "The winner on its training maps",
        "How branches end on unseen maps",
        "How wide the score is",
        "The flat sheet and the findings of the rules",
        "What limits it",
        "How it was found",
    ):
        assert f"<h2>{heading}</h2>" in page
    assert f"on {few_unseen} unseen grid maps (simulated)" in page
    assert 'src="http' not in page
    assert 'http-equiv="refresh"' not in page
    names = {path.name for path in (folder / "pictures").iterdir()}
    assert {"curve.svg", "sheet.svg", "training_1.svg", "unseen_median.svg"} <= names
    assert {"unseen_worst.svg", "unseen_best.svg", "contacts.svg"} <= names
    assert "fails completely" in page
    assert page.count("<img ") == len(names)
    assert all(is_ours(path) for path in (folder / "pictures").iterdir())


CHECKED = CheckReport(design="plain_vine", recipe="r", run=(), skipped=(), findings=())


@pytest.mark.parametrize(("bed_mm", "said"), [(1000.0, True), (3000.0, False)])
def test_a_bed_that_is_nearly_full_is_named(bed_mm: float, *, said: bool) -> None:
    profile = read_profile("co2_60w__stretchlon_200")
    bed = profile.machine.bed_width_mm.changed(value=bed_mm)
    machine = profile.machine.changed(bed_width_mm=bed)
    run = SimpleNamespace(
        design=Design.read("plain_vine"), profile=lambda: replace(profile, machine=machine)
    )
    words = run_winner._bed_words(cast("EndedRun", run), CHECKED)
    assert bool(words) == said
    assert all("mm of its 990 x 590 mm (computed)" in line for line in words)


def test_a_winner_in_pieces_says_how_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pieces = PieceSettings(most=3)
    run = RUN.changed(
        space=SpaceSettings(levels=Bounds(low=3, high=3), length_mm=Bounds(low=60, high=140)),
        build=BuildSettings(trunk_width_mm=24.0, width_ratio=0.65, pieces=pieces),
        evaluation=RUN.evaluation.changed(joint_weight=0.01, finalists=1),
    )
    seen: list[str] = []

    def look(_: SearchProgress) -> None:
        seen.append((tmp_path / "index.html").read_text())

    with followed(look):
        result = run_in_folder(run, tmp_path, again="").result
    assert "at most 3, joined by sleeves, every joint costs 0.01 of the fitness" in seen[0]
    assert re.search(r"levels, (\d pieces? by the quick rules|not yet in 3 pieces)", seen[0])
    profile = read_profile(DEFAULT_RECIPE)
    partition = pieces_of(pattern_of(result.best, profile), profile)
    count = len(partition.pieces)
    words = f"{count} piece{'s' * (count > 1)}, no fewer possible"
    assert (result.pieces_words, result.best.origin["pieces"]) == (words, count)
    made = f"levels; {words}; manufacturable, and deployable at "
    assert made in EndedRun.read(tmp_path).result.answer.text
    assert f"cut in: {words} (computed)" in result.summary
    # The rest of the page is tried elsewhere, and takes long.
    monkeypatch.setattr(run_winner, "_shown", lambda *_: ((), ()))

    def refused(*_: object) -> None:
        raise VinefabError("in a test")

    monkeypatch.setattr(run_winner, "check_design", refused)
    again = write_run_page(tmp_path, EndedRun.read(tmp_path))
    assert words in again.read_text()


def test_the_record_alone_gives_the_page_again(folder: Path, tmp_path: Path) -> None:
    run = EndedRun.read(folder)
    write_run_page(tmp_path, run)
    session = re.compile(r"The last session: [^<]*| \[[0-9a-f]{16}\]")
    one, two = ((place / "index.html").read_text() for place in (folder, tmp_path))
    assert session.sub("", one) == session.sub("", two)
    assert RunArchive.read(folder / RECORD_FILE).prediction == run.result.prediction


@pytest.mark.parametrize(
    ("found", "put", "words"),
    [
        ('"mean": 0', '"mean": "0', "is damaged or no record"),
        ('"note":', '"remark":', "(note: Field required)"),
        ('"option": "emergence"', '"option": "weather"', "(rules[2].option: Input should be"),
        ('"choices": ["pass", "stop"]', '"choices": ["pass"]', "1 choices, but [2, 2] means"),
    ],
)
def test_a_record_with_another_prediction_is_damaged(
    folder: Path, tmp_path: Path, found: str, put: str, words: str
) -> None:
    path = shutil.copy(folder / RECORD_FILE, tmp_path)
    with closing(sqlite3.connect(path)) as connection, connection:
        query = "SELECT value FROM run WHERE key = 'prediction'"
        (text,) = connection.execute(query).fetchone()
        assert found in text
        changed = text.replace(found, put, 1)
        connection.execute("UPDATE run SET value = ? WHERE key = 'prediction'", (changed,))
    with pytest.raises(UnreadableFileError, match=re.escape(words)):
        vf.RunResult.read(tmp_path)


@pytest.mark.parametrize(
    ("tolerance_mm", "checked", "tone"),
    [(1e6, True, "good"), (0.0, True, "bad"), (1e6, False, "caution")],
)
def test_the_answer_has_the_worse_tone_of_targets_and_rules(
    folder: Path, tolerance_mm: float, *, checked: bool, tone: str
) -> None:
    target = Target(name="A", point_mm=(-1e3, -1e3), tolerance_mm=tolerance_mm)
    deployment = SimpleNamespace(
        points_mm=np.zeros((2, 2)), first_point=np.array([0, 2]), tree=SimpleNamespace(ids=["0"])
    )
    targets = TargetsResult.touched([(cast("Deployment", deployment), [target])])
    result = EndedRun.read(folder).result
    first, *others = result.finalists
    winner = replace(first, score=replace(first.score, targets=targets))
    aimed = replace(result, finalists=(winner, *others), checked=checked)
    assert aimed.answer.tone == tone


def test_the_outcome_in_one_line(folder: Path, few_unseen: int) -> None:
    result = EndedRun.read(folder).result
    assert re.match(
        rf"found few: coverage \d\.\d{{3}} \[\d\.\d{{3}}, \d\.\d{{3}}; {few_unseen} maps\] "
        rf"on {few_unseen} unseen grid maps "
        r"\(simulated\); \d+ branches on 2 levels; manufacturable, and deployable at "
        r"\d+\.\d to \d+\.\d kPa with film stored loosely$",
        result.answer.text,
    )
    assert f"{result.answer.text}" in (folder / "index.html").read_text()
    bare = replace(result, prediction=None, checked=False).answer
    assert "on fresh poses on the training maps (simulated); " in bare.text
    assert (bare.tone, bare.text[-46:]) == (
        "caution", "branches on 2 levels; not checked whether it is manufacturable"[-46:]
    )  # fmt: skip


def table(run: EndedRun, caption: str) -> list[tuple[str, ...]]:
    sections = [one for one in run_blocks(run) if isinstance(one, Section)]
    (section,) = [one for one in sections if one.title == "What limits it"]
    return [row for one in section.tables if caption in one.caption for row in one.rows]


def test_bounds_that_the_winner_touches_are_named(folder: Path) -> None:
    run = EndedRun.read(folder)
    space = Space(run.settings.space, run.settings.build)
    x = np.full(len(space), 0.5)
    x[[variable.name for variable in space.variables].index("angle_deg")] = 1.0
    winner = run.result.finalists[0]
    moved = replace(run, result=replace(run.result, finalists=(replace(winner, x=x),)))
    rows = table(moved, "at an end of its range")
    assert ("angle_deg, level 2", "160", "most, 160") in rows
    assert not [row for row in rows if row[0].startswith("length_mm")]


def test_rules_close_to_their_limits_are_told_from_broken_ones(folder: Path) -> None:
    run = EndedRun.read(folder)
    rows = table(run, "stricter (computed)")
    kinds = {row[1].split(" ")[0] for row in rows}
    assert kinds <= {"broken", "close"}
    broken = {row[0] for row in rows if row[1].startswith("broken")}
    close = {row[0] for row in rows if row[1].startswith("close")}
    assert "VF-L06" in broken  # the recipe is not calibrated
    assert "VF-B01" in close  # the default tail is as short as it may be
    assert not broken & close


def test_a_run_without_prediction_or_with_extensions_has_a_page_too(tmp_path: Path) -> None:
    unchecked = RUN.changed(evaluation=RUN.evaluation.changed(fabricable=False))
    result = run_search(unchecked, tmp_path)
    extension = Extension(
        utc="2026-01-01T00:00:00", generations_done=2, stopped="", before={"generations": 2},
        after={"generations": 3},
    )  # fmt: skip
    run = EndedRun.read(tmp_path, replace(result, extensions=(extension,)))
    text = write_run_page(tmp_path, run).read_text()
    assert "How wide the score is" not in text
    assert "The search did not ask for it." in text
    assert "generations 2 -&gt; 3" in text
