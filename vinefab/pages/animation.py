"""What both kinds of animation show: frames of a deployment, and where things lie in them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.model.deployment import STUCK_STOPS, Deployment, Stop
from vinefab.model.map import Map, Pose
from vinefab.pages.map_view import Box, bounds_in, longer_mm, robot_view, rock_in, start_marks
from vinefab.pages.panel import round_length_mm

_LONGEST_PX = 640
"""Longer side of the map in an animation."""

FOOT_PX = 58
"""Height of the text and the legend below it."""

LEAST_WIDTH_PX = 460
"""What the text and the legend need."""

FRAME_S = 0.09
HOLD_S = 1.8
_HALF_BAND = 0.004  # of a line that poses are drawn from, as a share of the longer side
"""How long each frame stays, and how long the last one does before everything begins anew."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DeploymentFrame:
    """A deployment at one length of its front."""

    front_mm: float  # length of the longest way along the body from the base to a growing tip
    deployment: Deployment  # the branches that have emerged by then, as they lie then
    is_growing: NDArray[np.bool_]  # whether each of those branches will grow on, shape (n,)

    def __post_init__(self) -> None:
        if self.is_growing.shape != (len(self.deployment.tree),):
            raise BadInputError("is_growing", self.is_growing.shape, "one entry per branch")
        self.is_growing.setflags(write=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Where the millimetres of a map lie in a picture of pixels."""

    # left_mm, top_mm: map position of the picture's upper left corner
    left_mm: float
    top_mm: float
    px_per_mm: float  # scale
    # width_px, height_px: size of the map's picture, without the text below
    width_px: int
    height_px: int

    @classmethod
    def of(cls, box_mm: Box, longest_px: float = _LONGEST_PX) -> "Stage":
        """Return the stage for a box in the map and a small margin around it."""
        margin_mm = 0.01 * longer_mm(box_mm)
        width_mm = box_mm[2] - box_mm[0] + 2.0 * margin_mm
        height_mm = box_mm[3] - box_mm[1] + 2.0 * margin_mm
        scale = longest_px / max(width_mm, height_mm)
        return cls(
            left_mm=box_mm[0] - margin_mm,
            top_mm=box_mm[3] + margin_mm,
            px_per_mm=scale,
            width_px=math.ceil(width_mm * scale),
            height_px=math.ceil(height_mm * scale),
        )

    def place(self, points_mm: Floats) -> Floats:
        """Return points in pixels, rightwards and downwards, shape (n, 2)."""
        down = np.array([1.0, -1.0])
        moved = (points_mm - np.array([self.left_mm, self.top_mm])) * down
        return np.asarray(moved * self.px_per_mm)

    def rings(self, shapes: Iterable[BaseGeometry]) -> list[list[Floats]]:
        """Return polygons as lists of their rings in pixels, the outer ring first."""
        parts = shapely.get_parts(list(shapes))
        return [
            [self.place(np.asarray(ring.coords)) for ring in (part.exterior, *part.interiors)]
            for part in parts
            if isinstance(part, Polygon) and not part.is_empty
        ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """What all frames of an animation have in common, in pixels."""

    stage: Stage
    width_px: int  # of the whole picture
    # rock, bounds: polygons as lists of their rings, the outer ring first
    rock: list[list[Floats]]
    bounds: list[list[Floats]]
    starts: list[list[Floats]]  # where poses are drawn from, and their headings, likewise
    widths_mm: tuple[float, ...]  # lay-flat width of each level
    bar_mm: float  # length of the scale bar
    levels: tuple[int, ...]  # levels to explain, trunk first
    stops: tuple[Stop, ...]  # reasons for stopping that occur, to explain their markers

    @classmethod
    def of(
        cls, world: Map, frames: Sequence[DeploymentFrame], widths_mm: tuple[float, ...]
    ) -> "Scene":
        """Return the scene that fits all of the frames."""
        last = frames[-1].deployment
        box = robot_view(world, last)
        stage = Stage.of(box)
        seen = last.stop[last.deployed].tolist()
        return cls(
            stage=stage,
            width_px=max(stage.width_px, LEAST_WIDTH_PX),
            rock=stage.rings(rock_in(world, box)),
            bounds=stage.rings([bounds_in(world, box)]),
            starts=stage.rings(_ranges(world, box)),
            widths_mm=widths_mm,
            bar_mm=round_length_mm(0.2 * stage.width_px / stage.px_per_mm),
            levels=tuple(range(1, int(last.tree.level[last.deployed].max(initial=1)) + 1)),
            stops=tuple(stop for stop in Stop if int(stop) in seen),
        )

    @property
    def height_px(self) -> int:
        """Height of the whole picture."""
        return self.stage.height_px + FOOT_PX

    @property
    def level_words(self) -> list[tuple[int, str]]:
        """Levels with what the legend calls them: the first one says what the numbers are."""
        return [(level, f"level {level}" if level == 1 else f"{level}") for level in self.levels]

    @property
    def margin_px(self) -> int:
        """Room to the left of the map, which stands in the middle."""
        return (self.width_px - self.stage.width_px) // 2

    @property
    def bar_px(self) -> tuple[float, int]:
        """Left and right end of the scale bar."""
        right = self.width_px - 10
        return right - self.bar_mm * self.stage.px_per_mm, right

    def body_px(self, level: int) -> float:
        """Return the width of a level's inflated body."""
        return max(2.0 * self.widths_mm[level - 1] / np.pi * self.stage.px_per_mm, 1.0)

    def chain(self, deployment: Deployment, branch: int) -> Floats:
        """Return a branch's course, shape (n, 2)."""
        return self.stage.place(deployment.chain_mm(branch))

    def base(self, pose: Pose) -> Floats:
        """Return where a robot starts, shape (2,)."""
        return np.asarray(self.stage.place(np.array([[pose.x_mm, pose.y_mm]]))[0])


def _ranges(world: Map, box: Box) -> list[BaseGeometry]:
    """Return the ranges of starts as areas: a line becomes a thin band."""
    shapes: list[BaseGeometry] = []
    for mark in start_marks(world, box):
        shapes += [mark.fan] if mark.fan is not None else []
        shapes += [
            piece
            if isinstance(piece, Polygon)
            else piece.buffer(_HALF_BAND * longer_mm(box), cap_style="flat")
            for piece in mark.free
        ]
    window = shapely.box(*box)
    return [shapely.intersection(shape, window) for shape in shapes]


def line_px(level: int) -> float:
    """Return the width of a level's centreline."""
    return max(1.0, 2.4 - 0.35 * level)


def is_live(frame: DeploymentFrame) -> NDArray[np.bool_]:
    """Return for each branch whether it has emerged and still grows, shape (n,)."""
    return np.asarray(frame.is_growing & frame.deployment.deployed)


def frozen_since(frames: Sequence[DeploymentFrame]) -> dict[str, int]:
    """Return from which frame on each branch lies still, by the branch's name."""
    since: dict[str, int] = {}
    for number, frame in enumerate(frames):
        names = frame.deployment.tree.ids
        for branch in np.flatnonzero(~frame.is_growing & frame.deployment.deployed):
            since.setdefault(names[branch], number)
    return since


def frame_text(frame: DeploymentFrame, scene: Scene) -> str:
    """Return what is written under a frame."""
    tips = int(is_live(frame).sum())
    stopped = frame.deployment.stop[~frame.is_growing]
    stuck = int(np.isin(stopped, STUCK_STOPS).sum())
    drawn = "" if any(scene.widths_mm) else "; bodies are lines"
    return f"front {frame.front_mm:.0f} mm, {tips} growing, {stuck} stuck (simulated){drawn}"
