"""A deployment as a moving SVG, or as a GIF for where that cannot go: slides, chats, old viewers.

An SVG is one file without script, and plays wherever SVG does. Each of its frames holds only what
moves; a branch that has stopped is drawn once and stays. A program that shows SVG without its
animation shows the last frame.
"""

import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageChops, ImageColor, ImageDraw, ImageFont
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.hashing import ROOMY_GENERATOR
from vinefab.core.plain_text import GENERATOR
from vinefab.core.validation import Floats
from vinefab.model.deployment import STUCK_STOPS, Deployment, Stop
from vinefab.model.map import Map, Pose
from vinefab.pages.panel import (
    INK,
    ROCK,
    ROCK_EDGE,
    SOFT,
    START,
    START_SHADE,
    level_colour,
    round_length_mm,
)
from vinefab.pages.plan import (
    STOP_WORDS,
    Box,
    bounds_in,
    longer_mm,
    robot_view,
    rock_in,
    start_marks,
)

_LONGEST_PX = 640
"""Longer side of the map in an animation."""

FOOT_PX = 58
"""Height of the text and the legend below it."""


FRAME_S = 0.09
HOLD_S = 1.8
"""Duration of each frame, and of the last one before the animation begins anew."""


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
    """The mapping from millimetres of a map to pixels of a picture."""

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
    """The common content of all frames of an animation, in pixels."""

    stage: Stage
    width_px: int  # of the whole picture
    # rock, bounds: polygons as lists of their rings, the outer ring first
    rock: list[list[Floats]]
    bounds: list[list[Floats]]
    starts: list[list[Floats]]  # where poses are drawn from, and their headings, likewise
    widths_mm: Mapping[str, float]  # lay-flat width of each branch of the last frame, by its id
    usual_mm: Mapping[int, float]  # that of the widest branch of each level
    bar_mm: float  # length of the scale bar
    levels: tuple[int, ...]  # levels to explain, trunk first
    stops: tuple[Stop, ...]  # reasons for stopping that occur, to explain their markers

    @classmethod
    def of(cls, world: Map, frames: Sequence[DeploymentFrame], widths_mm: Floats) -> "Scene":
        """Return the scene that fits all of the frames."""
        last = frames[-1].deployment
        box = robot_view(world, last)
        stage = Stage.of(box)
        seen = last.stop[last.deployed].tolist()
        # The ranges of starts as areas: a line becomes a thin band.
        shapes: list[BaseGeometry] = []
        half_band = 0.004  # of a line that poses are drawn from, as a share of the longer side
        for mark in start_marks(world, box):
            shapes += [mark.fan] if mark.fan is not None else []
            shapes += [
                piece
                if isinstance(piece, Polygon)
                else piece.buffer(half_band * longer_mm(box), cap_style="flat")
                for piece in mark.free
            ]
        window = shapely.box(*box)
        least_width_px = 460  # width of the text and the legend
        return cls(
            stage=stage,
            width_px=max(stage.width_px, least_width_px),
            rock=stage.rings(rock_in(world, box)),
            bounds=stage.rings([bounds_in(world, box)]),
            starts=stage.rings(shapely.intersection(shape, window) for shape in shapes),
            widths_mm=dict(zip(last.tree.ids, widths_mm.tolist(), strict=True)),
            usual_mm={
                int(level): float(widths_mm[last.tree.level == level].max())
                for level in np.unique(last.tree.level)
            },
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
        """Levels with their names in the legend: the first one explains the numbers."""
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

    def body_px(self, width_mm: float) -> float:
        """Return the width of an inflated body of some lay-flat width."""
        return max(2.0 * width_mm / np.pi * self.stage.px_per_mm, 1.0)

    def chain(self, deployment: Deployment, branch: int) -> Floats:
        """Return a branch's course, shape (n, 2)."""
        return self.stage.place(deployment.chain_mm(branch))

    def base(self, pose: Pose) -> Floats:
        """Return the start of a robot, shape (2,)."""
        return np.asarray(self.stage.place(np.array([[pose.x_mm, pose.y_mm]]))[0])


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
    """Return the text under a frame."""
    tips = int(is_live(frame).sum())
    stopped = frame.deployment.stop[~frame.is_growing]
    stuck = int(np.isin(stopped, STUCK_STOPS).sum())
    drawn = "" if any(scene.widths_mm.values()) else "; bodies are lines"
    return f"front {frame.front_mm:.0f} mm, {tips} growing, {stuck} stuck (simulated){drawn}"


_MARKS = {
    Stop.FULL_LENGTH: '<circle id="m0" r="2.6" fill="#fff"/>',
    Stop.HEAD_ON: '<path id="m1" d="M-3.2-3.2L3.2 3.2M-3.2 3.2L3.2-3.2" stroke-width="2"/>',
    Stop.CORNER: f'<path id="m2" d="M0-4L3.8 3H-3.8Z" style="fill:{INK}"/>',
    Stop.PRESSURE: f'<path id="m4" d="M-3-3H3V3H-3Z" style="fill:{INK}"/>',
    Stop.BRANCH: f'<path id="m5" d="M0-4.2L4.2 0 0 4.2-4.2 0Z" style="fill:{INK}"/>',
    Stop.NOT_EVERTED: '<circle id="m6" r="4"/>',
}
"""Markers of tips, as in the plans: open if grown in full, else a cross, triangle or square."""


def svg_animation(world: Map, frames: Sequence[DeploymentFrame], widths_mm: Floats) -> bytes:
    """Return an animated SVG; the same frames give the same bytes.

    Parameters
    ----------
    frames
        The shapes to show one after the other, at least one; the last one stays for a while.
    """
    scene = Scene.of(world, frames, widths_mm)
    width, height, stage = scene.width_px, scene.height_px, scene.stage
    clock = _Clock(len(frames))
    rules = ["path{fill:none;stroke-linejoin:round;stroke-linecap:round}"]
    for level in scene.levels:
        colour = level_colour(level)
        rules.append(
            f".b{level}{{stroke:{colour};stroke-width:{scene.body_px(scene.usual_mm[level]):.2f}}}"
        )
        rules.append(f".c{level}{{stroke:{colour};stroke-width:{line_px(level):.2f}}}")
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" font-family="sans-serif" font-size="13">',
        f"<desc>{GENERATOR}; plays {clock.length_s:g} s, over and over</desc>",
        f"<style>{''.join(rules)}</style>",
        f'<defs><g id="m" stroke="{INK}">{"".join(_MARKS.values())}</g></defs>',
        '<rect width="100%" height="100%" fill="#fff"/>',
        f'<svg x="{scene.margin_px}" width="{stage.width_px}" height="{stage.height_px}">',
        *_ground(scene),
        *_bodies(frames, scene, clock),
        _start(frames[-1].deployment.pose, scene),
        "</svg>",
        *_foot(frames, scene, clock),
        "</svg>\n",
    ]
    return "\n".join(parts).encode("utf-8")


class _Clock:
    """When things are seen: frames are counted from 0, the last one is held."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.length_s = round(count * FRAME_S + HOLD_S, 3)

    def during(self, frame: int, content: str) -> str:
        """Return content that is seen in one frame only."""
        if frame == self.count - 1:
            return self.since(frame, content)
        begin, end = self._share(frame), self._share(frame + 1)
        moves = self._animate(f"0;{begin};{end}", "hidden;visible;hidden")
        if frame == 0:
            moves = self._animate(f"0;{end}", "visible;hidden")
        return f'<g visibility="hidden">{moves}{content}</g>'

    def since(self, frame: int, content: str) -> str:
        """Return content that is seen from one frame on, and in a picture that stands still."""
        if frame == 0:
            return f"<g>{content}</g>"
        return f"<g>{self._animate(f'0;{self._share(frame)}', 'hidden;visible')}{content}</g>"

    def _share(self, frame: int) -> str:
        return f"{frame * FRAME_S / self.length_s:.5f}"

    def _animate(self, times: str, values: str) -> str:
        return (
            f'<animate attributeName="visibility" calcMode="discrete" dur="{self.length_s}s" '
            f'repeatCount="indefinite" keyTimes="{times}" values="{values}"/>'
        )


def _ground(scene: Scene) -> list[str]:
    rock, bounds = (
        "".join(f"{_path(ring[:-1])}Z" for rings in polygons for ring in rings)
        for polygons in (scene.rock, scene.bounds)
    )
    ranges = ["".join(f"{_path(ring[:-1])}Z" for ring in rings) for rings in scene.starts]
    return [
        f'<path d="{rock}" style="fill:{ROCK};fill-rule:evenodd" stroke="{ROCK_EDGE}"/>',
        *(f'<path d="{path}" style="fill:{START};fill-opacity:0.28"/>' for path in ranges),
        f'<path d="{bounds}" stroke="{INK}"/>',
    ]


def _bodies(frames: Sequence[DeploymentFrame], scene: Scene, clock: _Clock) -> list[str]:
    """Return all branches, the trunk last, so that it lies on top."""
    since = frozen_since(frames)
    parts: list[str] = []
    for level in reversed(scene.levels):
        shapes: list[tuple[str, str, str]] = []
        usual_px = scene.body_px(scene.usual_mm[level])
        for number, frame in enumerate(frames):
            # Chains that came to rest in this frame, and those that still grow.
            deployment, live = frame.deployment, is_live(frame)
            names = deployment.tree.ids
            still, moving = dict[float, list[Floats]](), dict[float, list[Floats]]()
            for branch in np.flatnonzero((deployment.tree.level == level) & deployment.deployed):
                body_px = scene.body_px(scene.widths_mm[names[branch]])
                if live[branch]:
                    moving.setdefault(body_px, []).append(scene.chain(deployment, int(branch)))
                elif since[names[branch]] == number:
                    still.setdefault(body_px, []).append(scene.chain(deployment, int(branch)))
            for seen, chains in ((clock.since, still), (clock.during, moving)):
                for body_px, alike in chains.items():
                    own = "" if body_px == usual_px else f' style="stroke-width:{body_px:.2f}"'
                    shapes.append((seen(number, "{}"), own, _paths(alike)))
        # One opacity for the whole level: where bodies cross they do not get darker.
        parts.append('<g opacity=".35">')
        parts += [
            around.format(f'<path class="b{level}"{own} d="{d}"/>') for around, own, d in shapes
        ]
        parts.append("</g>")
        parts += [around.format(f'<path class="c{level}" d="{d}"/>') for around, _, d in shapes]
    return parts + _tips(frames, scene, since, clock)


def _tips(
    frames: Sequence[DeploymentFrame], scene: Scene, since: dict[str, int], clock: _Clock
) -> list[str]:
    last = frames[-1].deployment
    marks: dict[int, str] = {}
    for branch, name in enumerate(last.tree.ids):
        if name in since:
            x, y = scene.chain(last, branch)[-1]
            mark = f'<use href="#m{last.stop[branch]}" x="{x:.1f}" y="{y:.1f}"/>'
            marks[since[name]] = marks.get(since[name], "") + mark
    drawn = [clock.since(number, text) for number, text in sorted(marks.items())]
    return [f'<g stroke="{INK}">', *drawn, "</g>"]


def _start(pose: Pose, scene: Scene) -> str:
    base = scene.base(pose)
    turn_deg = -np.degrees(pose.heading_rad)
    return (
        f'<g transform="translate({base[0]:.1f} {base[1]:.1f}) rotate({turn_deg:.2f})">'
        f'<path d="M0 0H18" stroke="{INK}" stroke-width="2"/>'
        f'<path d="M26 0L16-4.5V4.5Z" style="fill:{INK}"/><circle r="3.5" fill="{INK}"/></g>'
    )


def _foot(frames: Sequence[DeploymentFrame], scene: Scene, clock: _Clock) -> list[str]:
    """Return text, scale bar and legend below the map."""
    top, (left, right) = scene.stage.height_px, scene.bar_px
    parts = [
        clock.during(number, f'<text x="10" y="{top + 19}">{frame_text(frame, scene)}</text>')
        for number, frame in enumerate(frames)
    ]
    parts.append(
        f'<path d="M{left:.1f} {top + 24}v4H{right}v-4" stroke="{INK}"/>'
        f'<text x="{right}" y="{top + 18}" text-anchor="end">{scene.bar_mm:g} mm</text>'
    )
    x, y = 10, top + 46
    for level, words in scene.level_words:
        parts.append(
            f'<path d="M{x} {y - 4}h16" stroke="{level_colour(level)}" stroke-width="4"/>'
            f'<text x="{x + 21}" y="{y}" font-size="11" fill="{SOFT}">{words}</text>'
        )
        x += 27 + 6 * len(words)
    for stop in scene.stops:
        parts.append(
            f'<use href="#m{int(stop)}" x="{x + 8}" y="{y - 4}" stroke="{INK}"/>'
            f'<text x="{x + 17}" y="{y}" font-size="11" fill="{SOFT}">{STOP_WORDS[stop]}</text>'
        )
        x += 26 + 6 * len(STOP_WORDS[stop])
    return parts


def _paths(chains: Iterable[Floats]) -> str:
    return "".join(_path(chain) for chain in chains)


def _path(points: Floats) -> str:
    pairs = [f"{x:.1f} {y:.1f}" for x, y in points.tolist()]
    return f"M{pairs[0]}L{' '.join(pairs[1:])}" if len(pairs) > 1 else f"M{pairs[0]}h0"


SHARPNESS = 2
"""Frames are drawn so many times larger and then reduced: smooth edges."""


def gif_animation(world: Map, frames: Sequence[DeploymentFrame], widths_mm: Floats) -> bytes:
    """Return an animated GIF that plays over and over.

    Parameters
    ----------
    frames
        The shapes to show one after the other, at least one; the last one stays for a while.
    """
    scene = Scene.of(world, frames, widths_mm)
    painter = _Painter(scene)
    pictures = [painter.picture(frame) for frame in frames]
    colours = 96
    # One table of colours for all frames: what stands still then keeps its very pixels, and only
    # the box around what moves has to be stored. Colours that mean something stay as they are.
    table = pictures[-1].quantize(colours, method=Image.Quantize.MEDIANCUT)
    entries = np.array(table.getpalette()).reshape(-1, 3)
    lines = [level_colour(level) for level in scene.levels]
    exact = ["#ffffff", ROCK, ROCK_EDGE, INK, SOFT, START_SHADE, *map(_shade, lines), *lines]
    near_twin = 10
    for colour in (np.array(ImageColor.getrgb(name)) for name in exact):
        away = ((entries - colour) ** 2).sum(axis=1)
        # Near twins go, or plain white ground could be stored as almost white.
        entries[(away == away.min()) | (away < near_twin**2)] = colour
    table.putpalette(entries.ravel().tolist())
    flat = [picture.quantize(palette=table, dither=Image.Dither.NONE) for picture in pictures]
    stream = io.BytesIO()
    flat[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=flat[1:],
        duration=[round(1000 * FRAME_S)] * (len(flat) - 1) + [round(1000 * HOLD_S)],
        loop=0,
        comment=ROOMY_GENERATOR.encode(),
    )
    return stream.getvalue()


class _Painter:
    """Draws frames on the same background, larger than they will be."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.ground = self._ground()
        self.foot = self._foot()

    def picture(self, frame: DeploymentFrame) -> Image.Image:
        """Return one frame."""
        bodies = Image.new("RGB", self.ground.size, "white")
        draw = ImageDraw.Draw(bodies)
        deployment = frame.deployment
        names, widths_mm = deployment.tree.ids, self.scene.widths_mm
        out = np.flatnonzero(deployment.deployed)[::-1].tolist()  # the trunk last, it lies on top
        chains = [
            (int(deployment.tree.level[branch]), SHARPNESS * self.scene.chain(deployment, branch))
            for branch in out
        ]
        for branch, (level, chain) in zip(out, chains, strict=True):
            shade = _shade(level_colour(level))
            self._line(draw, chain, shade, SHARPNESS * self.scene.body_px(widths_mm[names[branch]]))
        # Multiplied, so that walls can be seen through the bodies.
        whole = ImageChops.multiply(self.ground, bodies)
        draw = ImageDraw.Draw(whole)
        for level, chain in chains:
            self._line(draw, chain, level_colour(level), SHARPNESS * line_px(level))
        for branch in np.flatnonzero(deployment.deployed & ~is_live(frame)):
            tip = SHARPNESS * self.scene.chain(deployment, int(branch))[-1]
            _mark(draw, Stop(int(deployment.stop[branch])), tip, SHARPNESS)
        self._start(draw, deployment.pose)
        # Map and foot on one sheet.
        stage = self.scene.stage
        small = whole.resize((stage.width_px, stage.height_px), Image.Resampling.BOX)
        sheet = Image.new("RGB", (self.scene.width_px, self.scene.height_px), "white")
        sheet.paste(small, (self.scene.margin_px, 0))
        sheet.paste(self.foot, (0, stage.height_px))
        text, at = frame_text(frame, self.scene), (10, stage.height_px + 5)
        ImageDraw.Draw(sheet).text(at, text, fill=INK, font=_font(14))
        return sheet

    def _ground(self) -> Image.Image:
        stage = self.scene.stage
        size = (SHARPNESS * stage.width_px, SHARPNESS * stage.height_px)
        picture = Image.new("RGB", size, "white")
        draw = ImageDraw.Draw(picture)
        rock, bounds = (
            [[SHARPNESS * ring for ring in rings] for rings in polygons]
            for polygons in (self.scene.rock, self.scene.bounds)
        )
        for rings in rock:
            self._fill(picture, rings, ROCK)
        for rings in self.scene.starts:
            self._fill(picture, [SHARPNESS * ring for ring in rings], START_SHADE)
        for polygons, colour in ((rock, ROCK_EDGE), (bounds, INK)):
            for ring in (ring for rings in polygons for ring in rings):
                draw.line(_flat(ring), fill=colour, width=SHARPNESS)
        return picture

    @staticmethod
    def _fill(picture: Image.Image, rings: list[Floats], colour: str) -> None:
        """Fill a polygon and leave its holes open."""
        if len(rings) == 1:
            ImageDraw.Draw(picture).polygon(_flat(rings[0]), fill=colour)
            return
        mask = Image.new("1", picture.size)
        draw = ImageDraw.Draw(mask)
        for number, ring in enumerate(rings):
            draw.polygon(_flat(ring), fill=int(number == 0))
        picture.paste(colour, mask=mask)

    @staticmethod
    def _line(draw: ImageDraw.ImageDraw, chain: Floats, colour: str, width_px: float) -> None:
        """Draw a chain with round joints and ends."""
        draw.line(_flat(chain), fill=colour, width=round(width_px))
        half = width_px / 2.0
        for x, y in chain.tolist():
            draw.ellipse((x - half, y - half, x + half, y + half), fill=colour)

    def _start(self, draw: ImageDraw.ImageDraw, pose: Pose) -> None:
        base = SHARPNESS * self.scene.base(pose)
        along = SHARPNESS * np.array([np.cos(pose.heading_rad), -np.sin(pose.heading_rad)])
        side = np.array([-along[1], along[0]])
        draw.line(_flat(np.array([base, base + 18 * along])), fill=INK, width=2 * SHARPNESS)
        head = [base + 26 * along, base + 16 * along + 4.5 * side, base + 16 * along - 4.5 * side]
        draw.polygon(_flat(np.array(head)), fill=INK)
        radius = 3.5 * SHARPNESS
        draw.ellipse((*(base - radius), *(base + radius)), fill=INK)

    def _foot(self) -> Image.Image:
        """Return scale bar and legend."""
        picture = Image.new("RGB", (self.scene.width_px, FOOT_PX), "white")
        draw = ImageDraw.Draw(picture)
        left, right = self.scene.bar_px
        draw.line([(left, 24), (left, 28), (right, 28), (right, 24)], fill=INK, width=1)
        label = f"{self.scene.bar_mm:g} mm"
        draw.text((right, 5), label, fill=INK, font=_font(14), anchor="ra")
        x = 10.0
        for level, words in self.scene.level_words:
            draw.line([(x, 43), (x + 16, 43)], fill=level_colour(level), width=4)
            x = _word(draw, x + 21, words) + 10
        for stop in self.scene.stops:
            _mark(draw, stop, np.array([x + 4, 43.0]), 1)
            x = _word(draw, x + 13, STOP_WORDS[stop]) + 12
        return picture


def _word(draw: ImageDraw.ImageDraw, x: float, text: str) -> float:
    """Write a word of the legend and return where it ends."""
    draw.text((x, 36), text, fill=SOFT, font=_font(12))
    return x + float(draw.textlength(text, font=_font(12)))


def _font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size_px)


def _mark(draw: ImageDraw.ImageDraw, stop: Stop, tip: Floats, scale: int) -> None:
    """Draw a tip's marker as in the plans: open if in full, else a cross, triangle, square."""
    if stop == Stop.FULL_LENGTH:
        radius = 2.8 * scale
        draw.ellipse((*(tip - radius), *(tip + radius)), fill="white", outline=INK, width=scale)
    elif stop == Stop.HEAD_ON:
        for turn in (1.0, -1.0):
            arm = scale * np.array([3.4, 3.4 * turn])
            draw.line(_flat(np.array([tip - arm, tip + arm])), fill=INK, width=2 * scale)
    elif stop == Stop.PRESSURE:
        draw.rectangle((*(tip - 3.2 * scale), *(tip + 3.2 * scale)), fill=INK)
    elif stop == Stop.NOT_EVERTED:
        draw.ellipse((*(tip - 4 * scale), *(tip + 4 * scale)), outline=INK, width=scale)
    elif stop == Stop.BRANCH:
        corners = scale * np.array([[0.0, -4.4], [4.4, 0.0], [0.0, 4.4], [-4.4, 0.0]])
        draw.polygon(_flat(tip + corners), fill=INK)
    else:
        corners = scale * np.array([[0.0, -4.2], [4.0, 3.2], [-4.0, 3.2]])
        draw.polygon(_flat(tip + corners), fill=INK)


def _shade(colour: str) -> str:
    """Return a colour thinned with white."""
    body_shade = 0.35
    thin = [round(255 - body_shade * (255 - part)) for part in ImageColor.getrgb(colour)[:3]]
    return "#" + "".join(f"{part:02x}" for part in thin)


def _flat(points: Floats) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in points]
