"""A deployment as a moving SVG: one file, no script, plays wherever SVG does.

Every frame holds only what moves; a branch that has stopped is drawn once and stays. A program that
shows SVG without its animation shows the last frame.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from vinefab.core.jsontext import GENERATOR
from vinefab.core.validation import Floats
from vinefab.model.deployment import Stop
from vinefab.model.map import Map, Pose
from vinefab.pages.animation import (
    FRAME_S,
    HOLD_S,
    DeploymentFrame,
    Scene,
    frame_text,
    frozen_since,
    is_live,
    line_px,
)
from vinefab.pages.colours import INK, ROCK, ROCK_EDGE, SOFT, START, level_colour
from vinefab.pages.map_view import STOP_WORDS

_MARKS = {
    Stop.FULL_LENGTH: '<circle id="m0" r="2.6" fill="#fff"/>',
    Stop.HEAD_ON: '<path id="m1" d="M-3.2-3.2L3.2 3.2M-3.2 3.2L3.2-3.2" stroke-width="2"/>',
    Stop.CORNER: f'<path id="m2" d="M0-4L3.8 3H-3.8Z" style="fill:{INK}"/>',
    Stop.PRESSURE: f'<path id="m4" d="M-3-3H3V3H-3Z" style="fill:{INK}"/>',
    Stop.BRANCH: f'<path id="m5" d="M0-4.2L4.2 0 0 4.2-4.2 0Z" style="fill:{INK}"/>',
    Stop.NOT_EVERTED: '<circle id="m6" r="4"/>',
}
"""Markers of tips, as in the plans: open if grown in full, else a cross, triangle or square."""


def svg_animation(
    world: Map, frames: Sequence[DeploymentFrame], widths_mm: tuple[float, ...]
) -> bytes:
    """Return an animated SVG; the same frames give the same bytes.

    Parameters
    ----------
    frames
        The shapes to show one after the other, at least one; the last one stays for a while.
    """
    scene = Scene.of(world, frames, widths_mm)
    width, height, stage = scene.width_px, scene.height_px, scene.stage
    clock = _Clock(len(frames))
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" font-family="sans-serif" font-size="13">',
        f"<desc>{GENERATOR}; plays {clock.length_s:g} s, over and over</desc>",
        f"<style>{_style(scene)}</style>",
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


def _style(scene: Scene) -> str:
    rules = ["path{fill:none;stroke-linejoin:round;stroke-linecap:round}"]
    for level in scene.levels:
        colour = level_colour(level)
        rules.append(f".b{level}{{stroke:{colour};stroke-width:{scene.body_px(level):.2f}}}")
        rules.append(f".c{level}{{stroke:{colour};stroke-width:{line_px(level):.2f}}}")
    return "".join(rules)


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
        shapes: list[tuple[str, str]] = []
        for number, frame in enumerate(frames):
            still, moving = _chains(frame, scene, level, number, since)
            shapes += [(clock.since(number, "{}"), _paths(still))] if still else []
            shapes += [(clock.during(number, "{}"), _paths(moving))] if moving else []
        # One opacity for the whole level: where bodies cross they do not get darker.
        parts.append('<g opacity=".35">')
        parts += [around.format(f'<path class="b{level}" d="{d}"/>') for around, d in shapes]
        parts.append("</g>")
        parts += [around.format(f'<path class="c{level}" d="{d}"/>') for around, d in shapes]
    return parts + _tips(frames, scene, since, clock)


def _chains(
    frame: DeploymentFrame, scene: Scene, level: int, number: int, since: dict[str, int]
) -> tuple[list[Floats], list[Floats]]:
    """Return the chains of a level that came to rest in this frame, and those that still grow."""
    deployment, live = frame.deployment, is_live(frame)
    names = deployment.tree.ids
    still, moving = [], []
    for branch in np.flatnonzero((deployment.tree.level == level) & deployment.deployed):
        if live[branch]:
            moving.append(scene.chain(deployment, int(branch)))
        elif since[names[branch]] == number:
            still.append(scene.chain(deployment, int(branch)))
    return still, moving


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
