"""One deployment: a design on a map from a pose."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.units import deg, rad
from vinefab.export.deployment_json import deployment_text
from vinefab.growth.grow import grow
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.pipeline.fit import MOST_NAMED, Place, places_text, wedged, without_room
from vinefab.pipeline.history import History, history_content
from vinefab.report.animation import Frame

FRAMES = 40
"""Frames of an animation unless told otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grown:
    """A deployment with what it was made of.

    Parameters
    ----------
    design, world, options
        What was grown, where and by which rules.
    terrain
        The map made ready for growth.
    deployment
        What became of it.
    """

    design: Design
    world: Map
    terrain: Terrain
    options: GrowthOptions
    deployment: Deployment

    @property
    def stops(self) -> dict[str, int]:
        """How many branches ended for each reason."""
        counts = Counter(self.deployment.stop.tolist())
        return {stop.label: counts[stop] for stop in Stop}

    @property
    def metrics(self) -> dict[str, object]:
        """Numbers about the whole robot (simulated) and the rules that they depend on."""
        tree = self.deployment.tree
        return {
            "standing": "simulated",
            "branches": len(tree),
            "planned_mm": tree.total_length_mm,
            "grown_mm": float(self.deployment.grown_mm.sum()),
            "stops": self.stops,
            "head_on_half_angle_deg": deg(self.options.head_on_half_angle_rad),
            "body": self.options.body,
            "children_of_stuck": self.options.children_of_stuck,
            "tight_exits": int(np.count_nonzero(self.deployment.tight_exit)),
            "without_room": [place.content() for place in self.without_room],
            "wedged": [place.content() for place in wedged(self.design, self.deployment)],
        }

    def summary(self) -> list[str]:
        """Return the result in a few lines for the user."""
        tree, grown_mm = self.deployment.tree, float(self.deployment.grown_mm.sum())
        stops = ", ".join(f"{count} {name}" for name, count in self.stops.items() if count)
        return [
            f"{self.design.name} on {self.world.name} from {pose_text(self.deployment.pose)}",
            f"{len(tree)} branches: {stops} (simulated, {self.options.body} body, "
            f"head-on half-angle {deg(self.options.head_on_half_angle_rad):g} deg, assumed)",
            f"grown {grown_mm:.1f} of {tree.total_length_mm:.1f} mm",
            *places_text("no room to start for branch", self.without_room),
            *places_text("wedged: branch", wedged(self.design, self.deployment)),
            *self._tight_exits(),
        ]

    @property
    def without_room(self) -> tuple[Place, ...]:
        """The branches that were too wide for the place where they should have started."""
        return without_room(self.design, self.deployment, self.options)

    def _tight_exits(self) -> list[str]:
        """Say which branches may bow in reality, if any do."""
        tight = np.flatnonzero(self.deployment.tight_exit)
        if len(tight) == 0:
            return []
        names = ", ".join(self.deployment.tree.ids[branch] for branch in tight[:MOST_NAMED])
        return [
            f"{len(tight)} branches slid steeply with a long straight body behind the tip, where a "
            f"real one may bow: {names}{', ...' if len(tight) > MOST_NAMED else ''}"
        ]

    @property
    def history(self) -> History:
        """The deployment at any length of its front."""
        return History(
            design=self.design, terrain=self.terrain, options=self.options, final=self.deployment
        )

    def text(self, frames: Sequence[Frame] | None = None) -> str:
        """Return the deployment as JSON, ``vinefab/deployment-1``.

        Parameters
        ----------
        frames
            Earlier shapes to put in as ``history``.
        """
        names = (self.design.name, self.world.name)
        history = None if frames is None else history_content(frames)
        return deployment_text(self.deployment, *names, self.metrics, history)

    def picture(self, suffix: str, *, named: bool = False) -> bytes:
        """Return a plan of the deployment.

        Parameters
        ----------
        suffix
            ``.svg`` or ``.png``.
        named
            Whether to write every branch's id beside it.
        """
        # matplotlib takes longer to load than the growth to simulate.
        from vinefab.report.figure import png_bytes, svg_bytes  # noqa: PLC0415
        from vinefab.report.plans import deployment_plan  # noqa: PLC0415

        widths_mm = self.design.build.widths_mm
        figure = deployment_plan(self.world, self.deployment, widths_mm, named=named)
        return png_bytes(figure) if suffix.lower() == ".png" else svg_bytes(figure)

    def animation(self, suffix: str, frames: int = FRAMES) -> bytes:
        """Return the deployment as a moving picture.

        Parameters
        ----------
        suffix
            ``.svg`` or ``.gif``.
        frames
            Number of steps, equal in length of the front.

        Raises
        ------
        BadInputError
            If the suffix is another one.
        """
        kind = suffix.lower()
        if kind not in (".svg", ".gif"):
            raise BadInputError("suffix", suffix, ".svg or .gif")
        shapes, widths_mm = self.history.even_steps(frames), self.design.build.widths_mm
        if kind == ".svg":
            from vinefab.report.animation_svg import svg_animation  # noqa: PLC0415  as below

            return svg_animation(self.world, shapes, widths_mm)
        # Pillow is not needed for anything else here.
        from vinefab.report.animation_gif import gif_animation  # noqa: PLC0415

        return gif_animation(self.world, shapes, widths_mm)


def growth_options(
    body: str = "centerline",
    head_on_half_angle_deg: float = 1.0,
    children_of_stuck: str = "stop",
) -> GrowthOptions:
    """Return growth options from what a user typed; what cannot be used is named by the options."""
    return GrowthOptions(
        head_on_half_angle_rad=rad(head_on_half_angle_deg),
        body=cast("Any", body),  # the class says what is allowed
        children_of_stuck=cast("Any", children_of_stuck),
    )


def deploy(design: Design, world: Map, pose: Pose | None, options: GrowthOptions) -> Grown:
    """Grow a design on a map.

    Parameters
    ----------
    design, world, options
        What to grow, where and by which rules.
    pose
        Where the trunk is launched; None for the map's first start.

    Raises
    ------
    BadInputError
        If there is no pose, or it is not in free space.
    """
    pose = pose or first_start(world)
    terrain = Terrain.of(world)
    deployment = grow(design, terrain, pose, options)
    return Grown(
        design=design, world=world, options=options, terrain=terrain, deployment=deployment
    )


def first_start(world: Map) -> Pose:
    """Return the pose of a map's first start, or raise BadInputError if it has none."""
    if not world.starts:
        raise BadInputError("--pose", None, f"X,Y,DEG, as map {world.name} has no start of its own")
    return world.starts[0].pose


def pose_text(pose: Pose) -> str:
    """Return a pose as a user would type it: ``X,Y,DEG``."""
    return f"{pose.x_mm:.2f},{pose.y_mm:.2f},{deg(pose.heading_rad):.2f}"
