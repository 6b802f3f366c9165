"""Predictions for a design over maps, on top of what its package says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vinefab.core.units import deg
from vinefab.growth.grow import grow
from vinefab.growth.options import GrowthOptions
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.pipeline.fabricate import Prepared, page_content, prepare
from vinefab.report.content import Section
from vinefab.report.page import page_html
from vinefab.report.predicting import deployment_section, score_section
from vinefab.tasks.evaluate import Site, poses_on, score_design
from vinefab.tasks.registry import make_task

TASK_NAMES = {
    "coverage": "sensor coverage score",
    "reach": "share of free space reached",
    "anchoring": "anchoring amplification",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Predicted:
    """What a design is expected to do, and how it is made.

    Parameters
    ----------
    prepared
        Job and check.
    deployed
        Every deployment with its map.
    scores
        Scores by task.
    options
        The growth model's choices.
    """

    prepared: Prepared
    deployed: tuple[tuple[Map, Deployment], ...]
    scores: Mapping[str, Score]
    options: GrowthOptions

    def sections(self) -> tuple[Section, ...]:
        """Return the predictions as sections of a report."""
        named = {TASK_NAMES[task]: score for task, score in self.scores.items()}
        design = self.prepared.design
        return (
            score_section(named),
            deployment_section(design, self.deployed, rules_text(self.options)),
        )

    def page(self, more: Sequence[Section] = ()) -> str:
        """Return the whole report as HTML.

        Parameters
        ----------
        more
            Sections to put before the predictions.
        """
        return page_html(page_content(self.prepared, (*more, *self.sections())))


def predict(
    design: Design,
    profile: LaserProfile,
    maps: Sequence[Map],
    *,
    poses: int = 3,
    seed: int = 0,
    options: GrowthOptions | None = None,
) -> Predicted:
    """Deploy a design on maps and score it on every task; check it with those deployments.

    Parameters
    ----------
    design, profile
        The robot, and what it is made with.
    maps
        Where to deploy it.
    poses
        Poses per map, drawn from the ranges of the maps' starts.
    seed
        Seed of the poses.
    options
        The growth model's choices; the inflated body when None, for a body has a width.
    """
    options = options or GrowthOptions(body="inflated")
    sites = [Site.of(world) for world in maps]
    places = poses_on(sites, poses, [seed + index for index in range(len(sites))])
    deployed = tuple(
        (site.world, grow(design, site.terrain, pose, options))
        for site, drawn in zip(sites, places, strict=True)
        for pose in drawn
    )
    scores = {
        task: score_design(design, sites, places, make_task(task), options) for task in TASK_NAMES
    }
    prepared = prepare(design, profile, [deployment for _, deployment in deployed])
    return Predicted(prepared=prepared, deployed=deployed, scores=scores, options=options)


def rules_text(options: GrowthOptions) -> str:
    """Return the growth model's choices in words."""
    children = "stay inside" if options.children_of_stuck == "stop" else "grow all the same"
    return (
        f"{options.body} body, head-on half-angle {deg(options.head_on_half_angle_rad):g} degrees "
        f"(assumed), children of a stuck branch {children}"
    )
