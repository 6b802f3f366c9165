"""The fitness of a search that is going on, as SVG; drawn again and again, so without plotting."""

import numpy as np
from numpy.typing import ArrayLike

from vinefab.core.jsontext import GENERATOR
from vinefab.core.validation import Floats
from vinefab.pages.colours import LEVEL_COLOURS, SOFT

_WIDE, _HIGH = 720, 300
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 12, 12, 34
_TICKS = 5
MOST_POINTS = 400
"""Longer curves are thinned out."""


def live_curve(best: ArrayLike, mean: ArrayLike, spread: ArrayLike) -> bytes:
    """Return the fitness per generation as SVG, as `vinefab.pages.charts.fitness_curve` has it.

    The axis shows the scores; a best fitness below them, of designs with a penalty, lies on its
    lower end.
    """
    rows = np.array([np.asarray(values, dtype=float) for values in (best, mean, spread)])
    count = rows.shape[1]
    kept = np.unique(np.linspace(0, max(0, count - 1), min(count, MOST_POINTS)).astype(int))
    top, middle, wide = rows[:, kept]
    known = np.concatenate([middle - wide, middle + wide, top[top >= np.nanmin(_or_zero(middle))]])
    low, high = _limits(known)
    x = _LEFT + (_WIDE - _LEFT - _RIGHT) * (kept / max(1, count - 1))

    def y(values: Floats) -> Floats:
        share = (np.clip(values, low, high) - low) / (high - low)
        return np.asarray(_HIGH - _BOTTOM - (_HIGH - _BOTTOM - _TOP) * share)

    band = _band(x, y(middle - wide), y(middle + wide))
    blue, red = LEVEL_COLOURS[0], LEVEL_COLOURS[1]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDE} {_HIGH}" width="{_WIDE}" '
        f'height="{_HIGH}" font-family="sans-serif" font-size="12" fill="{SOFT}">',
        f"<desc>{GENERATOR}</desc>",
        *_grid(low, high, y),
        f'<polygon points="{band}" fill="{blue}" fill-opacity="0.15"/>' if band else "",
        *_lines(x, y(middle), blue),
        *_lines(x, y(top), red),
        f'<text x="{_LEFT}" y="{_HIGH - 18}">1</text>',
        f'<text x="{_WIDE - _RIGHT}" y="{_HIGH - 18}" text-anchor="end">{count}</text>',
        f'<text x="{_WIDE / 2:.0f}" y="{_HIGH - 18}" text-anchor="middle">generation</text>',
        f'<text x="{_LEFT}" y="{_HIGH - 3}"><tspan fill="{red}">best so far</tspan>, '
        f'<tspan fill="{blue}">mean of the generation with its deviation</tspan>; '
        "fitness (simulated)</text>",
        "</svg>\n",
    ]
    return "\n".join(parts).encode()


def _or_zero(values: Floats) -> Floats:
    return values if np.isfinite(values).any() else np.zeros(1)


def _limits(known: Floats) -> tuple[float, float]:
    """Return the ends of the axis for some values."""
    values = known[np.isfinite(known)]
    if not len(values):
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    room = 0.06 * (high - low) or 0.5 * max(abs(high), 1e-6)
    return low - room, high + room


def _grid(low: float, high: float, y) -> list[str]:  # type: ignore[no-untyped-def]  # noqa: ANN001
    step = _round_step((high - low) / _TICKS)
    ticks = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0)
    digits = max(0, -int(np.floor(np.log10(step))))
    return [
        f'<path d="M{_LEFT} {place:.1f}H{_WIDE - _RIGHT}" stroke="{SOFT}" stroke-opacity="0.2"/>'
        f'<text x="{_LEFT - 6}" y="{place + 4:.1f}" text-anchor="end">{tick:.{digits}f}</text>'
        for tick, place in zip(ticks.tolist(), y(ticks).tolist(), strict=True)
    ]


def _round_step(least: float) -> float:
    """Return the smallest of 1, 2, 5, 10, ... times a power of ten that is not below a number."""
    power = 10.0 ** np.floor(np.log10(max(least, 1e-12)))
    return float(next(power * n for n in (1.0, 2.0, 5.0, 10.0) if power * n >= least))


def _band(x: Floats, lower: Floats, upper: Floats) -> str:
    known = np.isfinite(lower) & np.isfinite(upper)
    across = np.concatenate([x[known], x[known][::-1]])
    return _points(across, np.concatenate([upper[known], lower[known][::-1]]))


def _lines(x: Floats, y: Floats, colour: str) -> list[str]:
    known = np.isfinite(y)
    points = _points(x[known], y[known])
    if known.sum() == 1:
        return [f'<circle cx="{x[known][0]:.1f}" cy="{y[known][0]:.1f}" r="3" fill="{colour}"/>']
    line = f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.8"/>'
    return [line] if points else []


def _points(x: Floats, y: Floats) -> str:
    return " ".join(
        f"{one:.1f},{other:.1f}" for one, other in zip(x.tolist(), y.tolist(), strict=True)
    )
