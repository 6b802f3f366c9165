"""A run in a folder that a person can open: record, live page, prediction of its winner, page."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from vinefab.search.live_page import LivePage
from vinefab.search.loop import Search
from vinefab.search.parallel.point_evaluator import PointEvaluator
from vinefab.search.record.generations import Progress
from vinefab.search.record.result import RunResult, resumed_limits
from vinefab.search.run import run_search
from vinefab.search.settings import RunLimits, RunSettings
from vinefab.tasks.task import Task


def run_in_folder(  # noqa: PLR0913  options by keyword
    settings: RunSettings,
    folder: Path,
    *,
    again: str,
    page: bool = True,
    resume: bool = False,
    limits: RunLimits | None = None,
    workers: int | PointEvaluator = 1,
    progress: Callable[[Progress], None] | None = None,
    source: Path | None = None,
    task: Task | None = None,
) -> RunResult:
    """Run the optimizer with its record, and predict what its winner does elsewhere.

    Parameters
    ----------
    again
        The command that resumes the run.
    page
        Whether to keep a page of the run current while it is going on.
    resume, limits, workers, progress, source, task
        As in `vinefab.search.run.run_search`.
    """

    def search(report: Callable[[Progress], None] | None) -> RunResult:
        return run_search(
            settings,
            folder,
            resume=resume,
            limits=limits,
            workers=workers,
            progress=report,
            predict=_predict,
            source=source,
            task=task,
        )

    if not page:
        return search(progress)
    with LivePage(folder, _shown(settings, folder, resume=resume), again) as live:

        def report(done: Progress) -> None:
            live.update(done)
            if progress is not None:
                progress(done)

        return search(report)


def _shown(settings: RunSettings, folder: Path, *, resume: bool) -> RunSettings:
    return resumed_limits(folder, settings) if resume else settings


def _predict(search: Search, result: RunResult) -> dict[str, Any]:
    # What predicts can draw too, and takes long to load.
    from vinefab.prediction.run_winner import predict_winner  # noqa: PLC0415

    return predict_winner(search, result)
