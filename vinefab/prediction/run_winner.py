"""A run in a folder, and what its winner is expected to do elsewhere.

A winner is tried on unseen maps, over what contacts may be like, and placed off.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.jsontext import rounded
from vinefab.core.plain_text import counted
from vinefab.core.units import rad
from vinefab.core.validation import Floats
from vinefab.fabrication.pieces.partition import pieces_of
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import BRANCH_CONTACTS, GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.inflation.pattern import pattern_of
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.files.run_context import ChosenRecipe
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map, Pose
from vinefab.model.score import FAILED_PERCENT, HARDLY_GROWN, NOTHING_TOUCHED, Failures
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
from vinefab.prediction.sensitivity import moved_poses, placings
from vinefab.search.evaluator import final_seed, with_pose_range
from vinefab.search.manufacturability import run_profile
from vinefab.search.record.generations import Progress
from vinefab.search.record.result import (
    RECORD_FILE,
    RunArchive,
    RunResult,
    placed_off_range,
    resumed_limits,
)
from vinefab.search.run import Search, run_search, violations_of
from vinefab.search.run_pages import LivePage
from vinefab.search.settings import RunLimits, RunSettings, has_own_targets
from vinefab.search.workers import PointEvaluator
from vinefab.tasks.evaluate import PreparedMap, score_designs, trunks_with_room
from vinefab.tasks.targets import design_touches
from vinefab.tasks.task import Task


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EndedRun:
    """A run that has ended, with what its page needs."""

    result: RunResult
    settings: RunSettings
    maps: tuple[Map, ...]  # the training maps
    # the winner's families, where they were prepared in this session: training maps and elsewhere
    prepared: tuple[PreparedFamily, PreparedFamily] | None = None

    @classmethod
    def read(cls, folder: Path, result: RunResult | None = None) -> "EndedRun":
        """Return a run from the record in its folder.

        Parameters
        ----------
        result
            Its result, where it is known with the times and notes of this session.
        """
        archive = RunArchive.read(folder / RECORD_FILE)
        settings = archive.settings
        run = cls(result=result or archive.result(), settings=settings, maps=archive.maps)
        if result is None and not run.result.fabricable:
            profile = run.profile() if run.result.checked else None
            broken = violations_of(run.result, settings, profile)
            run = replace(run, result=replace(run.result, violations=broken))
        return run

    @property
    def design(self) -> Design:
        """The winner."""
        return self.result.best

    @property
    def growth(self) -> GrowthOptions:
        """How it is grown to be drawn: as in the run, at the low end of a range of contacts."""
        return self.settings.growth.at_one_angle

    def families(self) -> tuple[PreparedFamily, PreparedFamily]:
        """Return the training maps with their first starts, and the maps of the prediction."""
        if self.prepared is not None:
            return self.prepared
        share = self.settings.evaluation.pose_range
        maps = tuple(PreparedMap.of(with_pose_range(world, share)) for world in self.maps)
        training = first_starts(maps)
        return training, unseen_family(self.settings, training)[0]

    def grown(self, family: PreparedFamily) -> Sequence[Deployment]:
        """Return the winner deployed from every pose of a family."""
        plans = Plans.of([self.design], self.growth)
        return Batch(plans, family.launches(), self.growth).regrown()

    def profile(self) -> LaserProfile:
        """Return the recipe that the winner is checked with."""
        if self.result.recipe:
            return ChosenRecipe.of(self.design).profile
        return run_profile(self.settings.evaluation)


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
) -> EndedRun:
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
    ended: EndedRun | None = None

    def predict(run: Search, result: RunResult) -> dict[str, Any]:
        nonlocal ended
        content, elsewhere = predicted(run, result)
        prepared = first_starts(run.evaluator.maps), elsewhere
        ended = EndedRun(result=result, settings=run.settings, maps=run.maps, prepared=prepared)
        return content

    def search(report: Callable[[Progress], None] | None) -> EndedRun:
        result = run_search(
            settings,
            folder,
            resume=resume,
            limits=limits,
            workers=workers,
            progress=report,
            predict=predict,
            source=source,
            task=task,
        )
        return EndedRun.read(folder, result) if ended is None else replace(ended, result=result)

    if not page:
        return search(progress)
    shown = resumed_limits(folder, settings) if resume else settings
    with LivePage(folder, shown, again) as live:

        def report(done: Progress) -> None:
            live.update(done)
            if progress is not None:
                progress(done)

        return search(report)


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

    def failures(self, family: PreparedFamily) -> Failures:
        """Return in how many deployments it touches no target, or hardly leaves its base."""
        launches, names = family.launches(), family.launch_names
        worlds = [place.world for place in family.maps]
        touched = design_touches(self.design, worlds, launches, self.growth, self.task)
        if touched is not None and all(len(one.touched) == len(names) for one in touched.outcomes):
            nothing = np.sum([one.touched for one in touched.outcomes], axis=0) == 0.0
            return Failures.of(nothing, names, NOTHING_TOUCHED)
        batch = Batch(Plans.of([self.design], self.growth), launches, self.growth)
        grown = batch.each(
            lambda one: np.add.reduceat(one.growth.grown, one.branch[:-1]) / one.planned_mm()
        )
        hardly = 100.0 * np.concatenate(list(grown)) < FAILED_PERCENT
        return Failures.of(hardly, names, HARDLY_GROWN)

    def over_contacts(self, family: PreparedFamily) -> tuple[ContactValue, ...]:
        """Return the mean score at every half-angle that predictions are shown for."""
        names = family.launch_names
        at_angles = [
            self.growth.changed(head_on_half_angle_rad=rad(angle))
            for angle in self.growth.contact_angles_deg
        ]
        return tuple(contact_value(self.scores(family, growth), names) for growth in at_angles)

    def over_rules(self, families: Mapping[str, PreparedFamily]) -> list[dict[str, Any]]:
        """Return the mean score under each choice of what else is assumed of contacts."""
        if not self.design.levels:
            return []
        found = []
        for option, choices, standing in (
            ("branch_contact", BRANCH_CONTACTS, "assumed"),
            ("emergence", self.growth.emergences, self.growth.emergences_standing),
        ):
            variants = [self.growth.changed(**{option: choice}) for choice in choices]
            means = {
                key: [
                    _value(contact_value(self.scores(family, growth), family.launch_names))
                    for growth in variants
                ]
                for key, family in families.items()
            }
            found.append({"option": option, "choices": [*choices], "standing": standing, **means})
        return found

    def placed_off(self, family: PreparedFamily) -> tuple[dict[str, Any], ...]:
        """Return what placing the body elsewhere does, a step each, from the same poses."""
        exact = self.scores(family)
        return tuple(
            {"knob": knob, "step": step, "unit": unit, **self._change(family, move, exact)}
            for knob, step, unit, move in placings()
        )

    def _change(
        self, family: PreparedFamily, move: Callable[[Pose], Pose], exact: Floats
    ) -> dict[str, Any]:
        # Not where the trunk has no room there, or had none before.
        poses = [
            [
                pose is not None
                and all(trunks_with_room(self.design, [place], ((before, pose),), self.growth))
                and pose
                for before, pose in zip(places, row, strict=True)
            ]
            for place, places, row in zip(
                family.maps, family.poses, moved_poses(family, move), strict=True
            )
        ]
        free = np.array([bool(pose) for row in poses for pose in row])
        if not free.any():
            return {"deployments": 0, "change": None, "low": None, "high": None, "over": ""}
        kept = tuple(tuple(pose for pose in row if pose) for row in poses)
        values = np.full(len(exact), np.nan)
        values[free] = self.scores(replace(family, poses=kept))
        change = contact_value(values - exact, family.launch_names)
        return {
            "deployments": int(free.sum()),
            "change": change.mean,
            **_ends(change.low, change.high),
            "over": change.over,
        }


def predict_winner(search: Search, result: RunResult) -> dict[str, Any]:
    """Return what a run's winner is expected to do elsewhere, in plain values (simulated)."""
    return predicted(search, result)[0]


def predicted(search: Search, result: RunResult) -> tuple[dict[str, Any], PreparedFamily]:
    """Return the prediction of `predict_winner`, and the maps elsewhere with their poses."""
    settings, evaluator = search.settings, search.evaluator
    trial = WinnerTrial(
        design=result.finalists[0].design,
        task=evaluator.spec.search_task,
        growth=settings.growth.at_one_angle.changed(emergence=settings.growth.emergence),
    )
    fresh = PreparedFamily(
        label=counted(len(evaluator.maps), "training map"),
        maps=evaluator.maps,
        poses=evaluator.final_conditions(settings.search.seed).poses,
    ).distinct
    unseen, note = unseen_family(settings, fresh)
    standing = settings.growth.contact_angles_standing
    # As records always were: nothing where the half-angles are assumed.
    angles = {} if standing == "assumed" else {"head_on_half_angles_standing": standing}
    content = {
        "task": settings.task.name,
        "title": result.score.title_of_task,
        "head_on_half_angles_deg": list(settings.growth.contact_angles_deg),
        **angles,
        "trained_half_angle_deg": settings.growth.half_angle_deg,
        "unseen": _family_content(trial, unseen),
        "training": _family_content(trial, fresh),
        "rules": trial.over_rules({"unseen": unseen, "training": fresh}),
        "placed_off": list(trial.placed_off(unseen)),
        "note": note,
    }
    if trial.design.build.pieces is not None:  # how many it is cut in (computed)
        profile = run_profile(settings.evaluation)
        cut = pieces_of(pattern_of(trial.design, profile), profile)
        count = None if cut.unparted else len(cut.pieces)
        proven = cut.proven_least and not cut.unparted
        content["pieces"] = {"count": count, "proven_least": proven}
    return {**content, "origin": _origin(content)}, unseen


def first_starts(maps: tuple[PreparedMap, ...]) -> PreparedFamily:
    """Return training maps with their first starts."""
    poses = tuple((prepared.world.starts[0].pose,) for prepared in maps)
    return PreparedFamily(label="training maps", maps=maps, poses=poses)


def _family_content(trial: WinnerTrial, family: PreparedFamily) -> dict[str, Any]:
    scores = trial.scores(family)
    return {
        "label": family.label,
        "maps": len(family.maps),
        "deployments": len(scores),
        "score": _value(contact_value(scores, family.launch_names)),
        "scores": [round(score, 4) for score in scores.tolist()],
        "failed": asdict(trial.failures(family)),
        "over_contacts": [_value(value) for value in trial.over_contacts(family)],
    }


def _value(value: ContactValue) -> dict[str, float | str | None]:
    return {"mean": value.mean, **_ends(value.low, value.high), "over": value.over}


def _ends(low: float, high: float) -> dict[str, float | None]:
    ends = {"low": low, "high": high}
    return {name: end if math.isfinite(end) else None for name, end in ends.items()}


def unseen_family(settings: RunSettings, fresh: PreparedFamily) -> tuple[PreparedFamily, str]:
    """Return unseen maps of a run's environment, or other poses on its own maps and why.

    Parameters
    ----------
    fresh
        The training maps.
    """
    start, note = settings.maps.start, ""
    if has_own_targets(settings):
        note = "on no unseen maps, because the run's targets are points of its own"
    elif start is not None and not (isinstance(start, StartPlace) and start.side):
        note = "on no unseen maps, because the run's start is a place on its own"
    share = settings.evaluation.pose_range
    if not settings.maps.files and not note:
        environment, options = settings.maps.environment, settings.maps.options
        try:
            family = unseen_maps(environment, UNSEEN_DEPLOYMENTS, 0, options)
            if start is not None:  # from the side that the run starts from
                worlds = tuple(with_starts(one, (start,), "maps.start") for one in family.worlds)
                label = f"{family.label} from the {start_text(start)}"
                family = MapFamily(label=label, worlds=worlds)
            worlds = tuple(with_pose_range(world, share) for world in family.worlds)
            return _prepared(replace(family, worlds=worlds), settings, 1, 0), note
        except BadInputError as error:
            note = f"on no unseen maps, because one of them cannot be used: {error}"
    worlds = tuple(prepared.world for prepared in fresh.maps)
    count = math.ceil(UNSEEN_DEPLOYMENTS / len(worlds))
    label = f"other poses on the {counted(len(worlds), 'training map')}"
    family = MapFamily(label=label, worlds=worlds)
    # Poses by which the winner was not chosen.
    seed = final_seed(settings.search.seed) + len(worlds)
    return _prepared(family, settings, count, seed), note


def _prepared(family: MapFamily, settings: RunSettings, poses: int, seed: int) -> PreparedFamily:
    plan = PredictionPlan(poses=poses, seed=seed, options=settings.growth.at_one_angle)
    return PreparedFamily.of(family, plan).distinct


def _origin(content: Mapping[str, Any]) -> dict[str, object]:
    """Return what of a prediction stands in the winner's design file."""
    unseen = content["unseen"]
    score = unseen["score"]
    interval = [score["low"], score["high"]]
    over_contacts = [value["mean"] for value in unseen["over_contacts"]]
    return {
        "unseen": f"{unseen['label']}, {counted(unseen['deployments'], 'deployment')} (simulated)",
        "unseen_score": round(score["mean"], 4),
        **({} if None in interval else {"unseen_score_interval": rounded(interval, 4)}),
        "unseen_half_angles_deg": content["head_on_half_angles_deg"],
        "unseen_score_over_contacts": rounded(over_contacts, 4),
        "unseen_score_placed_off": rounded(placed_off_range(content), 4),
        **({"pieces": count} if (count := content.get("pieces", {}).get("count")) else {}),
    }
