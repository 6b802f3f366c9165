"""Shaded pictures of solids with upright sides, seen from above at a slant.

Everything that stands on a table without overhangs is a height over the plane. Along a line of
sight what is higher is nearer, so painting slices from the lowest to the highest hides exactly
what is hidden. The picture is made from the triangles themselves: it shows what is in the files.
"""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from vinefab.core.jsontext import GENERATOR
from vinefab.core.validation import Floats, Ints

Colour = tuple[int, int, int]

RELIEF_PAPER: Colour = (255, 255, 255)
RELIEF_INK: Colour = (29, 42, 48)
_EDGE = 0.55
_LIGHT = np.array([-0.45, -0.75])
_SUPERSAMPLING = 2
_LEVEL_MM = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prism:
    """A solid to draw."""

    vertices_mm: Floats  # corners where they stand, shape (n, 3), z upwards
    faces: Ints  # triangles, shape (m, 3), counter-clockwise seen from outside
    colour: Colour  # of its top; sides are darker, floors (below ``light_from_mm``) lighter
    light_from_mm: float = -math.inf  # upward faces below this height are drawn pale
    below: Colour | None = None  # colour of those faces, if another


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """A text at a point of the scene."""

    text: str
    at_mm: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """Direction and scale of the view."""

    turn_rad: float  # how far the scene is turned counter-clockwise
    rise_rad: float  # angle of sight above the plane
    px_per_mm: float  # scale
    # point at the picture's upper left corner, in the turned and slanted plane
    left_mm: float
    top_mm: float
    size_px: tuple[int, int]  # width and height

    def flat(self, points_mm: Floats) -> Floats:
        """Return where points, shape (..., 3), would be seen if their height were 0."""
        cos, sin = math.cos(self.turn_rad), math.sin(self.turn_rad)
        x_mm = points_mm[..., 0] * cos - points_mm[..., 1] * sin
        y_mm = (points_mm[..., 0] * sin + points_mm[..., 1] * cos) * math.sin(self.rise_rad)
        seen = np.stack([x_mm - self.left_mm, self.top_mm - y_mm], axis=-1)
        return np.asarray(seen * self.px_per_mm)

    def lift_px(self, z_mm: float) -> int:
        """Return by how many pixels a height moves things up."""
        return round(z_mm * math.cos(self.rise_rad) * self.px_per_mm)


def relief_png(
    solids: Sequence[Prism],
    labels: Sequence[Label] = (),
    *,
    width_px: int = 1400,
    turn_deg: float = 20.0,
    rise_deg: float = 52.0,
) -> bytes:
    """Return a shaded picture of solids as PNG."""
    camera = _camera(
        solids, width_px * _SUPERSAMPLING, math.radians(turn_deg), math.radians(rise_deg)
    )
    picture = Image.new("RGB", camera.size_px, RELIEF_PAPER)
    tops = [_tops(solid) for solid in solids]
    rims = [_rims(solid) for solid in solids]
    sides = [_sides(camera, solid.colour, *rim) for solid, rim in zip(solids, rims, strict=True)]
    levels = sorted({level for found in tops for level in found})
    base_mm = min(float(solid.vertices_mm[:, 2].min()) for solid in solids)
    low_px = camera.lift_px(base_mm)
    for index, level in enumerate(levels):
        mask, side = _standing(camera, solids, tops, sides, levels[index:])
        for lift_px in range(low_px, camera.lift_px(level), _SUPERSAMPLING):
            picture.paste(side, (0, -lift_px), mask)
        low_px = camera.lift_px(level)
        mask, top = _roof(camera, solids, tops, [edges for edges, _ in rims], level)
        picture.paste(top, (0, -low_px), mask)
    size = camera.size_px[0] // _SUPERSAMPLING, camera.size_px[1] // _SUPERSAMPLING
    picture = picture.resize(size, Image.Resampling.BOX)
    _write(picture, camera, labels)
    return _png(picture)


def _camera(solids: Sequence[Prism], width_px: int, turn: float, rise: float) -> Camera:
    whole = Camera(
        turn_rad=turn, rise_rad=rise, px_per_mm=1.0, left_mm=0.0, top_mm=0.0, size_px=(1, 1)
    )
    points = np.concatenate([solid.vertices_mm for solid in solids])
    seen = whole.flat(points)
    seen[:, 1] -= points[:, 2] * math.cos(rise)
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin_mm = 0.03 * float((high - low).max())
    scale = width_px / (high[0] - low[0] + 2.0 * margin_mm)
    return Camera(
        turn_rad=turn,
        rise_rad=rise,
        px_per_mm=scale,
        left_mm=float(low[0]) - margin_mm,
        top_mm=margin_mm - float(low[1]),
        size_px=(width_px, int(scale * (high[1] - low[1] + 2.0 * margin_mm))),
    )


def _tops(solid: Prism) -> dict[float, Floats]:
    """Return the upward triangles by height, each shape (k, 3, 3)."""
    corners = solid.vertices_mm[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = np.ptp(corners[:, :, 2], axis=1) < _LEVEL_MM
    up = corners[flat & (normal[:, 2] > 0.0)]
    heights = np.round(up[:, 0, 2] / _LEVEL_MM).astype(np.int64)
    return {float(one * _LEVEL_MM): up[heights == one] for one in np.unique(heights).tolist()}


def _rims(solid: Prism) -> tuple[Floats, Floats]:
    """Return the upper edges of upright faces, (k, 2, 3), and the faces' directions, (k, 2)."""
    corners = solid.vertices_mm[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.hypot(normal[:, 0], normal[:, 1])
    upright = length > 10.0 * np.abs(normal[:, 2])
    corners, normal, length = corners[upright], normal[upright], length[upright]
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)
    level = np.abs(edges[:, :, 0, 2] - edges[:, :, 1, 2]) < _LEVEL_MM
    one = level.any(axis=1)
    edge = edges[one, level[one].argmax(axis=1)]
    return edge, normal[one, :2] / length[one, None]


def _sides(
    camera: Camera, colour: Colour, edges: Floats, outward: Floats
) -> list[tuple[list[tuple[float, ...]], Colour]]:
    """Return the lines that upper edges are seen as, with the colours of the faces below them."""
    cos, sin = math.cos(camera.turn_rad), math.sin(camera.turn_rad)
    facing = outward @ np.array([[cos, sin], [-sin, cos]])
    light = 0.62 + 0.3 * (facing @ _LIGHT)
    shades = {share: _shaded(colour, share) for share in np.unique(light).tolist()}
    return [
        ([tuple(end) for end in edge], shades[share])
        for edge, share in zip(camera.flat(edges).tolist(), light.tolist(), strict=True)
    ]


def _standing(
    camera: Camera,
    solids: Sequence[Prism],
    tops: list[dict[float, Floats]],
    sides: list[list[tuple[list[tuple[float, ...]], Colour]]],
    levels: list[float],
) -> tuple[Image.Image, Image.Image]:
    """Return where anything reaches one of some heights, and the colours of its sides there."""
    mask, side = Image.new("1", camera.size_px), Image.new("RGB", camera.size_px, RELIEF_PAPER)
    on_mask, on_side = ImageDraw.Draw(mask), ImageDraw.Draw(side)
    for solid, found in zip(solids, tops, strict=True):
        colour = _shaded(solid.colour, _EDGE)
        for level in levels:
            for triangle in camera.flat(found.get(level, np.zeros((0, 3, 3)))).tolist():
                corners = [tuple(corner) for corner in triangle]
                on_mask.polygon(corners, fill=1)
                on_side.polygon(corners, fill=colour)
    for lines, found in zip(sides, tops, strict=True):
        if max(found, default=-math.inf) < levels[0]:
            continue  # lower than the others here: its sides must not colour theirs
        for ends, colour in lines:
            on_side.line(ends, fill=colour, width=5)
    return mask, side


def _roof(
    camera: Camera,
    solids: Sequence[Prism],
    tops: list[dict[float, Floats]],
    rims: list[Floats],
    level: float,
) -> tuple[Image.Image, Image.Image]:
    """Return the upward faces at one height and their colours, rims drawn darker."""
    mask, top = Image.new("1", camera.size_px), Image.new("RGB", camera.size_px, RELIEF_PAPER)
    on_mask, on_top = ImageDraw.Draw(mask), ImageDraw.Draw(top)
    for solid, found in zip(solids, tops, strict=True):
        colour = solid.colour
        if level < solid.light_from_mm:
            colour = solid.below or _pale(solid.colour)
        for triangle in camera.flat(found.get(level, np.zeros((0, 3, 3)))):
            corners = [tuple(corner) for corner in triangle]
            on_mask.polygon(corners, fill=1)
            on_top.polygon(corners, fill=colour)
    for solid, edges in zip(solids, rims, strict=True):
        here = np.abs(edges[:, 0, 2] - level) < _LEVEL_MM
        dark = _shaded(solid.colour, _EDGE)
        for edge in camera.flat(edges[here]).tolist():
            on_top.line([tuple(end) for end in edge], fill=dark, width=2)
    return mask, top


def _write(picture: Image.Image, camera: Camera, labels: Sequence[Label]) -> None:
    font = ImageFont.load_default(size=max(11, picture.width // 55))
    draw = ImageDraw.Draw(picture)
    for label in labels:
        x, y = camera.flat(np.array(label.at_mm)) / _SUPERSAMPLING
        place = float(x), float(y) - camera.lift_px(label.at_mm[2]) / _SUPERSAMPLING
        draw.text(
            place,
            label.text,
            fill=RELIEF_INK,
            font=font,
            anchor="mm",
            stroke_width=2,
            stroke_fill=RELIEF_PAPER,
        )


def _png(picture: Image.Image) -> bytes:
    stream, facts = io.BytesIO(), PngInfo()
    facts.add_text("Software", GENERATOR)
    picture.save(stream, format="PNG", pnginfo=facts, optimize=True)
    return stream.getvalue()


def _shaded(colour: Colour, share: float) -> Colour:
    red, green, blue = (min(255, max(0, round(part * share))) for part in colour)
    return red, green, blue


def _pale(colour: Colour) -> Colour:
    red, green, blue = (round(255 - 0.35 * (255 - part)) for part in colour)
    return red, green, blue
