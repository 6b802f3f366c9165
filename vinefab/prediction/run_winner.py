"""What a run's winner is expected to do elsewhere: on unseen maps, over contacts, placed off."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.statistics import group_means, mean_interval
from vinefab.core.units import rad
from vinefab.core.validation import Floats
from vinefab.fabrication.pieces.partition import partition_of
from vinefab.growth.batch import Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.model.start_place import StartPlace, start_text, with_starts
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    unseen_maps,
)
from vinefab.prediction.prediction_width import (
    ContactValue,
    contact_value,
)
from vinefab.prediction.sensitivity import (
    HEADING_STEPS_DEG,
    SIDEWAYS_STEPS_MM,
    moved_poses,
    shifted_pose,
    turned_pose,
)
from vinefab.search.evaluator import final_seed, with_pose_range
from vinefab.search.loop import Search
from vinefab.search.record.elsewhere import placed_off_range
from vinefab.search.record.result import RunResult
from vinefab.search.run import run_profile
from vinefab.search.settings import RunSettings, targets_mm
from vinefab.tasks.evaluate import PreparedMap, score_designs, trunks_with_room
from vinefab.tasks.task import Task

UNSEEN_DEPLOYMENTS = 50
"""Deployments that a winner is tried in elsewhere, each on a map of its own where maps are
generated: the same maps for every run of an environment, so that runs can be compared."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WinnerTrial:
    """How a winner is scored: by the task of its run, areas as in the search (within 0.001)."""

    design: Design
    task: Task
    growth: GrowthOptions  # the run's, at one half-angle
    # walls of the maps that it is tried on, by their names; they take longer than growth
    terrains: dict[tuple[str, ...], TerrainSet] = field(default_factory=dict)

    def scores(self, family: PreparedFamily, growth: GrowthOptions | None = None) -> Floats:
        """Return the score from every pose of a family, shape (n,)."""
        options = growth or self.growth
        terrains = self.terrains.setdefault(
            (family.label, *family.names), TerrainSet([place.terrain for place in family.maps])
        )
        launches = Launches.of(terrains, family.poses)
        (score,) = score_designs([self.design], family.maps, launches, self.task, options)
        return score.scores

    def over_contacts(self, family: PreparedFamily) -> tuple[ContactValue, ...]:
        """Return the mean score at every half-angle that predictions are shown for."""
        names = names_of(family)
        at_angles = [
            self.growth.changed(head_on_half_angle_rad=rad(angle))
            for angle in self.growth.contact_angles_deg
        ]
        return tuple(contact_value(self.scores(family, growth), names) for growth in at_angles)

    def placed_off(self, family: PreparedFamily) -> tuple[dict[str, Any], ...]:
        """Return what placing the body elsewhere does, a step each, from the same poses."""
        exact = self.scores(family)
        moves = [
            *(
                ("heading", d, "deg", partial(turned_pose, turn_rad=rad(d)))
                for d in HEADING_STEPS_DEG
            ),
            *(("position", d, "mm", partial(shifted_pose, step_mm=d)) for d in SIDEWAYS_STEPS_MM),
        ]
        return tuple(
            {"knob": knob, "step": step, "unit": unit, **self._change(family, move, exact)}
            for knob, step, unit, move in moves
        )

    def _change(
        self, family: PreparedFamily, move: Callable[[Pose], Pose], exact: Floats
    ) -> dict[str, Any]:
        poses = self._with_room(family, moved_poses(family, move))
        free = np.array([pose is not None for row in poses for pose in row])
        if not free.any():
            return {"deployments": 0, "change": None, "low": None, "high": None}
        kept = tuple(tuple(pose for pose in row if pose is not None) for row in poses)
        values = np.full(len(exact), np.nan)
        values[free] = self.scores(replace(family, poses=kept))
        means = group_means(values - exact, names_of(family))
        low, high = mean_interval(means)
        return {
            "deployments": int(free.sum()),
            "change": float(means.mean()),
            "low": _plain(low),
            "high": _plain(high),
        }

    def _with_room(
        self, family: PreparedFamily, moved: tuple[tuple[Pose | None, ...], ...]
    ) -> tuple[tuple[Pose | None, ...], ...]:
        """Return moved poses, None where the trunk has no room there, or had none before."""
        return tuple(
            tuple(
                pose if pose is not None and self._has_room(place, (before, pose)) else None
                for before, pose in zip(family.poses[index], row, strict=True)
            )
            for index, (place, row) in enumerate(zip(family.maps, moved, strict=True))
        )

    def _has_room(self, place: PreparedMap, poses: tuple[Pose, ...]) -> bool:
        return all(trunks_with_room(self.design, [place], (poses,), self.growth))


def names_of(family: PreparedFamily) -> list[str]:
    """Return by what deployments are alike: their maps, or nothing where there is one map."""
    indices = family.launches().terrain.tolist()
    if len(family.maps) == 1:
        return [str(index) for index in range(len(indices))]
    return [family.names[index] for index in indices]


def predict_winner(search: Search, result: RunResult) -> dict[str, Any]:
    """Return what a run's winner is expected to do elsewhere, in plain values (simulated)."""
    settings, evaluator = search.settings, search.evaluator
    trial = WinnerTrial(
        design=result.finalists[0].design,
        task=evaluator.spec.search_task,
        growth=settings.growth.at_one_angle,
    )
    fresh = PreparedFamily(
        label=_maps_text(len(evaluator.maps), "training map"),
        maps=evaluator.maps,
        poses=evaluator.final_conditions(settings.search.seed).poses,
    ).distinct
    unseen, note = unseen_family(settings, fresh)
    content = {
        "task": settings.task.name,
        "head_on_half_angles_deg": list(settings.growth.contact_angles_deg),
        **_angles_standing(settings.growth),
        "trained_half_angle_deg": settings.growth.half_angle_deg,
        "unseen": _family_content(trial, unseen),
        "training": _family_content(trial, fresh),
        "placed_off": list(trial.placed_off(unseen)),
        "note": note,
    }
    pieces = _pieces_content(trial.design, settings)
    content = {**content, **({"pieces": pieces} if pieces else {})}
    return {**content, "origin": _origin(content)}


def _angles_standing(growth: GrowthOptions) -> dict[str, str]:
    """Return where the half-angles come from; nothing where they are assumed, as they were."""
    standing = growth.contact_angles_standing
    return {} if standing == "assumed" else {"head_on_half_angles_standing": standing}


def _pieces_content(design: Design, settings: RunSettings) -> dict[str, Any]:
    """Return how many pieces a winner is cut in (computed); nothing where it must be one."""
    if design.build.pieces is None:
        return {}
    partition = partition_of(design, run_profile(settings.evaluation))
    if partition.unparted:
        return {"count": None, "proven_least": False}
    return {"count": len(partition.pieces), "proven_least": partition.proven_least}


def _family_content(trial: WinnerTrial, family: PreparedFamily) -> dict[str, Any]:
    scores = trial.scores(family)
    return {
        "label": family.label,
        "maps": len(family.maps),
        "deployments": len(scores),
        "score": _value(contact_value(scores, names_of(family))),
        "scores": [round(score, 4) for score in scores.tolist()],
        "over_contacts": [_value(value) for value in trial.over_contacts(family)],
    }


def _value(value: ContactValue) -> dict[str, float | None]:
    return {"mean": value.mean, "low": _plain(value.low), "high": _plain(value.high)}


def _plain(number: float) -> float | None:
    return float(number) if math.isfinite(number) else None


def unseen_family(settings: RunSettings, fresh: PreparedFamily) -> tuple[PreparedFamily, str]:
    """Return unseen maps of a run's environment, or other poses on its own maps and why.

    Parameters
    ----------
    fresh
        The training maps.
    """
    note = _own_places(settings)
    if not settings.maps.files and not note:
        environment, options = settings.maps.environment, settings.maps.options
        try:
            family = _started(unseen_maps(environment, UNSEEN_DEPLOYMENTS, 0, options), settings)
            return _prepared(family, settings, 1, 0), note
        except BadInputError as error:
            note = f"on no unseen maps, because one of them cannot be used: {error}"
    worlds = tuple(prepared.world for prepared in fresh.maps)
    count = math.ceil(UNSEEN_DEPLOYMENTS / len(worlds))
    label = f"other poses on the {_maps_text(len(worlds), 'training map')}"
    family = MapFamily(label=label, worlds=worlds)
    # Poses by which the winner was not chosen.
    seed = final_seed(settings.search.seed) + len(worlds)
    return _prepared(family, _with_whole_range(settings), count, seed), note


def _own_places(settings: RunSettings) -> str:
    """Return why a run that names places has no unseen maps; empty if it names none."""
    if len(targets_mm(settings)):
        return "on no unseen maps, because the run's targets are points of its own"
    start = settings.maps.start
    if start is not None and not (isinstance(start, StartPlace) and start.side):
        return "on no unseen maps, because the run's start is a place on its own"
    return ""


def _started(family: MapFamily, settings: RunSettings) -> MapFamily:
    """Return unseen maps with the side that a run starts from."""
    start = settings.maps.start
    if start is None:
        return family
    worlds = tuple(with_starts(world, (start,), "maps.start") for world in family.worlds)
    return replace(family, label=f"{family.label} from the {start_text(start)}", worlds=worlds)


def _with_whole_range(settings: RunSettings) -> RunSettings:
    # The run's pose range was applied to these maps already.
    return settings.changed(evaluation=settings.evaluation.changed(pose_range=1.0))


def _prepared(family: MapFamily, settings: RunSettings, poses: int, seed: int) -> PreparedFamily:
    share = settings.evaluation.pose_range
    worlds = tuple(with_pose_range(world, share) for world in family.worlds)
    plan = PredictionPlan(poses=poses, seed=seed, options=settings.growth.at_one_angle)
    return PreparedFamily.of(replace(family, worlds=worlds), plan).distinct


def _maps_text(count: int, name: str) -> str:
    return f"{count} {name}{'' if count == 1 else 's'}"


def _origin(content: Mapping[str, Any]) -> dict[str, object]:
    """Return what of a prediction stands in the winner's design file."""
    unseen = content["unseen"]
    score = unseen["score"]
    low, high = placed_off_range(content)
    interval = [score["low"], score["high"]]
    return {
        "unseen": f"{unseen['label']}, {counted(unseen['deployments'], 'deployment')} (simulated)",
        "unseen_score": round(score["mean"], 4),
        **({} if None in interval else {"unseen_score_interval": _rounded(interval)}),
        "unseen_half_angles_deg": content["head_on_half_angles_deg"],
        "unseen_score_over_contacts": _rounded([v["mean"] for v in unseen["over_contacts"]]),
        "unseen_score_placed_off": _rounded([low, high]),
        **({"pieces": count} if (count := content.get("pieces", {}).get("count")) else {}),
    }


def _rounded(values: list[float]) -> list[float]:
    return [round(value, 4) for value in values]
