"""A deployment as an animated GIF, for where a moving SVG cannot go: slides, chats, old viewers."""

import io
from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageChops, ImageColor, ImageDraw, ImageFont

from vinefab.core.file_mark import ROOMY_GENERATOR
from vinefab.core.validation import Floats
from vinefab.model.deployment import Stop
from vinefab.model.map import Map, Pose
from vinefab.pages.animation import (
    FOOT_PX,
    FRAME_S,
    HOLD_S,
    DeploymentFrame,
    Scene,
    frame_text,
    is_live,
    line_px,
)
from vinefab.pages.colours import INK, ROCK, ROCK_EDGE, SOFT, START_SHADE, level_colour
from vinefab.pages.map_view import STOP_WORDS

SHARPNESS = 2
"""Frames are drawn so many times larger and then reduced: smooth edges."""

COLOURS = 96
NEAR_TWIN = 10
BODY_SHADE = 0.35


def gif_animation(
    world: Map, frames: Sequence[DeploymentFrame], widths_mm: tuple[float, ...]
) -> bytes:
    """Return an animated GIF that plays over and over.

    Parameters
    ----------
    frames
        The shapes to show one after the other, at least one; the last one stays for a while.
    """
    scene = Scene.of(world, frames, widths_mm)
    painter = _Painter(scene)
    pictures = [painter.picture(frame) for frame in frames]
    # One table of colours for all frames: what stands still then keeps its very pixels, and only
    # the box around what moves has to be stored.
    table = _colour_table(pictures[-1], scene.levels)
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


def _colour_table(picture: Image.Image, levels: Sequence[int]) -> Image.Image:
    """Return the colours of a picture, with those that mean something exactly as they are."""
    table = picture.quantize(COLOURS, method=Image.Quantize.MEDIANCUT)
    entries = np.array(table.getpalette()).reshape(-1, 3)
    lines = [level_colour(level) for level in levels]
    exact = ["#ffffff", ROCK, ROCK_EDGE, INK, SOFT, START_SHADE, *map(_shade, lines), *lines]
    for colour in (np.array(ImageColor.getrgb(name)) for name in exact):
        away = ((entries - colour) ** 2).sum(axis=1)
        # Near twins go, or plain white ground could be stored as almost white.
        entries[(away == away.min()) | (away < NEAR_TWIN**2)] = colour
    table.putpalette(entries.ravel().tolist())
    return table


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
        chains = self._chains(frame)
        for level, chain in chains:
            shade = _shade(level_colour(level))
            self._line(draw, chain, shade, SHARPNESS * self.scene.body_px(level))
        # Multiplied, so that walls can be seen through the bodies.
        whole = ImageChops.multiply(self.ground, bodies)
        draw = ImageDraw.Draw(whole)
        for level, chain in chains:
            self._line(draw, chain, level_colour(level), SHARPNESS * line_px(level))
        self._tips(draw, frame)
        self._start(draw, frame.deployment.pose)
        return self._sheet(whole, frame_text(frame, self.scene))

    def _sheet(self, whole: Image.Image, text: str) -> Image.Image:
        """Return map and foot on one sheet."""
        stage = self.scene.stage
        small = whole.resize((stage.width_px, stage.height_px), Image.Resampling.BOX)
        sheet = Image.new("RGB", (self.scene.width_px, self.scene.height_px), "white")
        sheet.paste(small, (self.scene.margin_px, 0))
        sheet.paste(self.foot, (0, stage.height_px))
        draw = ImageDraw.Draw(sheet)
        draw.text((10, stage.height_px + 5), text, fill=INK, font=_font(14))
        return sheet

    def _chains(self, frame: DeploymentFrame) -> list[tuple[int, Floats]]:
        """Return every branch's level and chain, the trunk last, so that it lies on top."""
        deployment = frame.deployment
        out = np.flatnonzero(deployment.deployed)[::-1]
        return [
            (int(deployment.tree.level[i]), SHARPNESS * self.scene.chain(deployment, int(i)))
            for i in out
        ]

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

    def _tips(self, draw: ImageDraw.ImageDraw, frame: DeploymentFrame) -> None:
        deployment, live = frame.deployment, is_live(frame)
        for branch in np.flatnonzero(deployment.deployed & ~live):
            tip = SHARPNESS * self.scene.chain(deployment, int(branch))[-1]
            _mark(draw, Stop(int(deployment.stop[branch])), tip, SHARPNESS)

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
    thin = [round(255 - BODY_SHADE * (255 - part)) for part in ImageColor.getrgb(colour)[:3]]
    return "#" + "".join(f"{part:02x}" for part in thin)


def _flat(points: Floats) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in points]
