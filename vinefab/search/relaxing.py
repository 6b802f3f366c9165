"""Which single change of a run's settings lets designs pass: found by trying, not guessed."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.model.design import PieceSettings
from vinefab.search.manufacturability import (
    ManufacturabilityPenalty,
    SpaceQuery,
    refuse_infeasible_space,
)
from vinefab.search.settings import RunSettings
from vinefab.search.space import Bounds, Space

MOST_SECONDS, MOST_CHANGES = 4.0, 3
"""Processor time that the changes of a run are tried for, and how many are named."""

_STREAM = 1418
_POINTS, _ROUNDS, _KEPT, _CHECKED = 256, 4, 24, 4
"""Points of the changed space that are tried, rounds of changes of those with the least penalties,
how many of them are changed, and how many without penalty are asked for all rules."""


FREE_GENERATIONS = 10
"""Of the search that tells whether rules keep a robot from its targets."""


def without_rules(settings: RunSettings) -> RunSettings:
    """Return the settings of a short search that no rule stops."""
    generations = min(settings.search.generations, FREE_GENERATIONS)
    return settings.changed(
        evaluation=settings.evaluation.changed(fabricable=False, joint_weight=0.0),
        search=settings.search.changed(generations=generations, evaluations=0, wall_time_s=0.0),
        start_from=(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Settings that differ from those of a run in one key."""

    key: str
    before: float | Bounds
    after: float | Bounds
    settings: RunSettings

    @property
    def text(self) -> str:
        """The change for the user."""
        return f"{self.key} = {_written(self.after)} in place of {_written(self.before)}"


def _written(value: float | Bounds) -> str:
    """Return a value as run files have it."""
    if isinstance(value, Bounds):
        return f"[{value.low:g}, {value.high:g}]"
    return f"{value:g}"


def changes(settings: RunSettings) -> Iterator[list[Change]]:
    """Yield, for each key that may stop all designs, its changes from the least on."""
    build, space = settings.build, settings.space

    def built(key: str, values: Sequence[float]) -> list[Change]:
        before = getattr(build, key)
        return [
            Change(
                key=f"build.{key}",
                before=before,
                after=after,
                settings=settings.changed(build=build.changed(**{key: after})),
            )
            for after in values
            if after != before
        ]

    def ranged(key: str, ends: list[tuple[float, float]]) -> list[Change]:
        bounds = getattr(space, key)
        return [
            Change(
                key=f"space.{key}",
                before=bounds,
                after=Bounds(low=low, high=high),
                settings=settings.changed(space=space.changed(**{key: Bounds(low=low, high=high)})),
            )
            for low, high in ends
            if (low, high) != (bounds.low, bounds.high)
        ]

    width, ratio, kpa = build.trunk_width_mm, build.width_ratio, build.pressure_kpa
    if not build.widths_mm:
        yield built("trunk_width_mm", [float(round(width * by)) for by in (1.15, 1.3, 1.6, 2.0)])
        yield built("trunk_width_mm", [float(round(width * by)) for by in (0.85, 0.7, 0.5)])
    yield built("width_ratio", [round(by, 2) for by in (0.8, 0.7, 0.6, 0.5) if by < ratio])
    yield built("width_ratio", [round(by, 2) for by in (0.65, 0.75, 0.8) if by > ratio])
    yield built("pressure_kpa", [round(kpa * by, 1) for by in (0.8, 0.6, 0.4)])
    yield built("pressure_kpa", [round(kpa * by, 1) for by in (1.25, 1.5, 2.0)])
    pieces = build.pieces or PieceSettings(most=1)
    more = [pieces.changed(most=most) for most in (2, 4, 6, 9) if most > pieces.most]
    yield [
        Change(
            key="build.pieces.most",
            before=pieces.most,
            after=one.most,
            settings=settings.changed(build=build.changed(pieces=one)),
        )
        for one in more
    ]
    few, deep = space.branches, space.levels
    yield ranged("branches", [(float(low), few.high) for low in range(int(few.low) - 1, 0, -1)])
    yield ranged("levels", [(float(low), deep.high) for low in range(int(deep.low) - 1, 0, -1)])
    length, fan = space.length_mm, space.angle_deg
    yield ranged("length_mm", [(length.low, round(length.high * by, 1)) for by in (1.3, 1.6, 2.0)])
    yield ranged("length_mm", [(round(length.low * by, 1), length.high) for by in (0.7, 0.5, 0.3)])
    yield ranged("angle_deg", [(fan.low, min(330.0, fan.high + by)) for by in (30, 60, 120)])
    yield ranged("angle_deg", [(max(0.0, fan.low - by), fan.high) for by in (20, 40, 80)])


def relaxations(
    settings: RunSettings, penalty: ManufacturabilityPenalty, near: Floats | None = None
) -> list[Change]:
    """Return changes of which each lets a design pass, the least of a key; perhaps none.

    Points of the changed space are drawn, those with the least penalties changed, and those without
    penalty asked for all rules. A key that is not returned may help too, with other changes.

    Parameters
    ----------
    near
        Points of the run with small penalties to try too, shape (m, d).
    """
    until_s, found = time.process_time() + MOST_SECONDS, list[Change]()
    for several in changes(settings):
        for change in several:
            if time.process_time() > until_s or len(found) == MOST_CHANGES:
                return found
            if change.key in {one.key for one in found}:
                break
            if has_design(change.settings, penalty, near):
                found.append(change)
                break
    return found


def has_design(
    settings: RunSettings, penalty: ManufacturabilityPenalty, near: Floats | None = None
) -> bool:
    """Return whether a design of a run's space that passes all rules is soon found."""
    try:
        refuse_infeasible_space(SpaceQuery.of(settings, penalty.profile, penalty.sheet_mm))
    except BadInputError:
        return False
    space, rng = Space(settings.space, settings.build), child(0, _STREAM)
    if len(space) == 0:
        return False
    quick, x = penalty.within(space), rng.random((_POINTS, len(space)))
    if near is not None and near.shape[1] == len(space):
        x = np.concatenate([near, x])
    for _ in range(_ROUNDS):
        penalties = np.nan_to_num(quick(space.batch(x)), nan=np.inf)
        order = np.argsort(penalties, kind="stable")
        free = order[penalties[order] == 0.0]
        if any(penalty.broken(space.design(x[row])) == () for row in free[:_CHECKED]):
            return True
        least = x[order[:_KEPT]]
        moved = np.repeat(least, 6, axis=0)
        moved += 0.2 * rng.standard_normal(moved.shape) * (rng.random(moved.shape) < 0.4)
        x = np.concatenate([least, np.clip(moved, 0.0, 1.0)])
    return False
