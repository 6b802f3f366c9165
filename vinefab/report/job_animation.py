"""The laser's way over the sheet, as an SVG that moves by itself in any browser."""

from collections.abc import Sequence
from xml.sax.saxutils import escape

import numpy as np

from vinefab.core.jsontext import GENERATOR
from vinefab.export.schedule import Run, schedule
from vinefab.model.checked import Floats
from vinefab.model.job import Job
from vinefab.model.laser import LaserProfile
from vinefab.report.sheet_plan import OPERATION_COLOURS

LONGEST_S = 20.0
"""A job that takes longer is shown faster, so that the film is no longer than this."""

_FLATTEN_MM = 0.1
_PAUSE = 0.06


def job_animation(job: Job, profile: LaserProfile) -> bytes:
    """Return a film of a job: every path is drawn as the beam runs along it, in real proportion.

    Where SVG does not move, the finished sheet is seen.

    Parameters
    ----------
    job
        The paths.
    profile
        Whose speeds and acceleration give the times (`vinefab.export.machine_time`).

    Raises
    ------
    BadInputError
        If the recipe lacks an operation of the job.
    """
    runs = schedule(job, profile)
    total_s = runs[-1].ends_s if runs else 1.0
    film_s = min(LONGEST_S, max(total_s, 1.0))
    scale = (1.0 - _PAUSE) / total_s
    width, height = job.sheet_width_mm, job.sheet_height_mm
    size = max(width, height)
    words = (
        f"{job.name}: {total_s:.0f} s on the machine, shown {total_s / film_s:.1f} times as fast"
        f"{', as if all tiles lay on one bed' if job.tiles else ''}; {GENERATOR}"
    )
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}"'
        f' width="{1000 * width / size:.0f}" height="{1000 * height / size:.0f}">',
        f"<title>{escape(words)}</title>",
        f'<rect width="{width:g}" height="{height:g}" fill="#fbfcfd" stroke="#5c6b73"'
        f' stroke-width="{size / 800:.3g}"/>',
        *(_path(run, height, film_s, scale) for run in runs),
        _head(runs, height, film_s, scale),
        "</svg>",
    ]
    return "\n".join(lines).encode() + b"\n"


def _path(run: Run, height_mm: float, film_s: float, scale: float) -> str:
    points, seconds = _samples(run)
    steps = np.hypot(*np.diff(points, axis=0).T)
    length = float(steps.sum())
    left = length - np.concatenate([[0.0], np.cumsum(steps)])
    # Hidden until its time, then drawn as fast as the head goes, then there until the end.
    times = np.concatenate([[0.0], scale * (run.begins_s + seconds), [1.0]])
    values = np.concatenate([[length], left, [0.0]])
    corners = " ".join(f"{x:.2f},{height_mm - y:.2f}" for x, y in points.tolist())
    colour = OPERATION_COLOURS[run.path.operation]
    return (
        f'<polyline points="{corners}" fill="none" stroke="{colour}" stroke-width="1.2"'
        f' stroke-dasharray="{length:.2f} {length + 1:.2f}">'
        f'<animate attributeName="stroke-dashoffset" dur="{film_s:.2f}s" repeatCount="indefinite"'
        f' keyTimes="{_times(times)}" values="{_listed(values)}"/></polyline>'
    )


def _head(runs: Sequence[Run], height_mm: float, film_s: float, scale: float) -> str:
    if not runs:
        return ""
    sampled = [
        (points, run.begins_s + seconds) for run in runs for points, seconds in [_samples(run)]
    ]
    points = np.concatenate([[[0.0, 0.0]], *(points for points, _ in sampled)])
    times = scale * np.concatenate([[0.0], *(seconds for _, seconds in sampled)])
    points, times = np.vstack([points, points[-1]]), np.append(times, 1.0)
    moves = "".join(
        f'<animate attributeName="{name}" dur="{film_s:.2f}s" repeatCount="indefinite"'
        f' keyTimes="{_times(times)}" values="{_listed(values)}"/>'
        for name, values in (("cx", points[:, 0]), ("cy", height_mm - points[:, 1]))
    )
    x, y = points[-1]
    return f'<circle cx="{x:.2f}" cy="{height_mm - y:.2f}" r="4" fill="#1d2a30">{moves}</circle>'


def _samples(run: Run) -> tuple[Floats, Floats]:
    """Return points along a path and when the head is there, from the path's start."""
    places, seconds, now = [], [], 0.0
    for segment, time_s in zip(run.path.contour.segments, run.times_s, strict=True):
        points = segment.flattened_mm(_FLATTEN_MM)[:-1]
        places.append(points)
        seconds.append(now + time_s * np.arange(len(points)) / len(points))
        now += time_s
    places.append(np.array([segment.end_mm]))
    seconds.append(np.array([now]))
    return np.concatenate(places), np.concatenate(seconds)


def _times(values: Floats) -> str:
    """Return key times: rising from 0 to 1, none lower than the one before after rounding."""
    return ";".join(f"{value:.5f}" for value in np.maximum.accumulate(values).tolist())


def _listed(values: Floats) -> str:
    return ";".join(f"{value:.2f}" for value in values.tolist())
