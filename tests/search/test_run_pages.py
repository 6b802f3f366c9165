"""The page of a run that goes on."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.search.conftest import followed, made_generation, progress_of
from vinefab.core.errors import CannotWriteError, InterruptedRunError
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import Shape
from vinefab.prediction.run_winner import run_in_folder
from vinefab.search import run_pages
from vinefab.search.run_pages import (
    MOST_POINTS,
    PAGE_NAME,
    LivePage,
    fitness_curve,
)
from vinefab.search.settings import (
    MapSettings,
)

SMALL_MAP = {"size_mm": 250.0, "columns": 3, "rows": 3}
"""The winner is tried on seventy maps: most of the time of such a short run."""


@pytest.fixture
def settings(small, monkeypatch):
    """A run on one map whose page is written after every generation."""
    monkeypatch.setattr(run_pages, "LEAST_PAUSE_S", 0.0)
    monkeypatch.setattr(run_pages, "_OF_PROCESSOR", 1e9)
    monkeypatch.setattr(run_pages, "_OF_TIME", 1e9)
    return small.changed(maps=MapSettings(count=1, options=SMALL_MAP))


def stopped_in(generation, seen, folder):
    def look(progress):
        seen.append((folder / PAGE_NAME).read_text())
        if progress.done == generation:
            raise KeyboardInterrupt

    return look


def test_the_page_shows_the_run_while_it_goes_on_and_says_how_to_go_on(settings, tmp_path):
    seen: list[str] = []
    with pytest.raises(KeyboardInterrupt), followed(stopped_in(3, seen, tmp_path)):
        run_in_folder(settings, tmp_path, again="do & it again")
    for number, page in enumerate(seen, start=1):
        assert f"Running: generations {number} of 5" in page
        assert '<meta http-equiv="refresh" content="5">' in page
        assert page.count('<img src="data:image/svg+xml;base64,') == 2
        assert "branches on" in page
    ended = (tmp_path / PAGE_NAME).read_text()
    assert "Interrupted after 3 of 5 generations." in ended
    assert "To go on: do &amp; it again" in ended
    assert 'http-equiv="refresh"' in ended  # a resumed run is seen by who left it open
    assert "http" not in re.sub(r"data:[^\"]*|http-equiv", "", ended)


def test_no_result_depends_on_the_page(settings, tmp_path):
    one = run_in_folder(settings, tmp_path / "one", again="", page=True).result
    two = run_in_folder(settings, tmp_path / "two", again="", page=False).result
    assert (one.best, one.prediction) == (two.best, two.prediction)
    assert not (tmp_path / "two" / PAGE_NAME).exists()


def test_a_page_that_cannot_be_written_stops_no_run(settings, tmp_path, monkeypatch):
    calls: list[Path] = []

    def full(path, _):
        calls.append(path)
        raise CannotWriteError(path, "disk full")

    monkeypatch.setattr(run_pages, "write_text", full)
    result = run_in_folder(settings, tmp_path, again="").result
    assert len(result.history) == 5
    assert len(calls) == 1


def test_a_refused_run_leaves_the_page_of_another_one(settings, tmp_path):
    (tmp_path / PAGE_NAME).write_text("written by vinefab: of another run")
    with pytest.raises(InterruptedRunError), LivePage(tmp_path, settings, ""):
        raise InterruptedRunError("before the first generation", "")
    assert (tmp_path / PAGE_NAME).read_text() == "written by vinefab: of another run"


def test_pages_are_written_no_oftener_than_their_cost_allows(settings, tmp_path, monkeypatch):
    now_s, written = [0.0], [0]
    monkeypatch.setattr(run_pages, "LEAST_PAUSE_S", 3.0)
    monkeypatch.setattr(run_pages, "_OF_TIME", 0.05)
    monkeypatch.setattr(run_pages.time, "monotonic", lambda: now_s[0])

    def slow(path, _):
        now_s[0] += 2.0
        written[0] += 1
        return path

    monkeypatch.setattr(run_pages, "write_text", slow)
    page = LivePage(tmp_path, settings, "")
    for _ in range(600):
        now_s[0] += 0.5
        page.update(progress(1))
    spent_s = 2.0 * written[0]
    assert written[0] > 3
    assert spent_s / now_s[0] < 0.07


def progress(count):
    """Return the progress after a generation in which one point is no design."""
    values = np.array([0.1, 0.3, -1e6])
    scores = np.array([0.1, 0.3, np.nan])
    first = made_generation(0, values, x=np.full((3, 10), 0.5), composite=scores)
    return progress_of(count, 10, [first])


def test_a_killed_session_leaves_no_half_written_page(settings, tmp_path):
    (tmp_path / f".{PAGE_NAME}.k1ll3d").write_text("half")
    LivePage(tmp_path, settings, "").update(progress(1))
    assert sorted(path.name for path in tmp_path.iterdir()) == [PAGE_NAME]


@pytest.mark.parametrize("count", [1, 2, 5 * MOST_POINTS])
def test_the_curve_is_drawn_at_any_length_within_its_frame(count):
    best = np.linspace(-5.0, 0.4, count)
    mean, spread = np.linspace(0.1, 0.3, count), np.full(count, 0.05)
    mean[0] = np.nan if count > 2 else mean[0]
    page = fitness_curve(best, mean, spread)
    assert b"nan" not in page_svg(page)
    (panel,) = page.panels
    lines = [one for one in panel.primitives if isinstance(one, Shape)]
    places = np.concatenate([chain for one in lines for chain in one.chains])
    x0, y0, x1, y1 = panel.box
    assert ((places >= (x0, y0)) & (places <= (x1, y1))).all()
    assert len(places) <= 4 * MOST_POINTS


def test_the_curve_of_designs_that_all_fail_is_empty():
    gap = np.full(3, np.nan)
    (panel,) = fitness_curve(gap, gap, gap).panels
    assert all(isinstance(one, Shape) and not one.chains for one in panel.primitives)
    assert page_svg(fitness_curve(gap, gap, gap)).startswith(b"<?xml")
