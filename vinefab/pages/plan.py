"""Plans: maps, starts and robots drawn into panels, without detail too fine to be seen."""

import math
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
from PIL import Image, ImageDraw
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import imported_later
from vinefab.core.plain_text import counted, one_line
from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour
from vinefab.model.start import pieces_on, start_range
from vinefab.model.target import Target, TargetOutcome, TargetsResult
from vinefab.pages.page_files import page_png, page_svg
from vinefab.pages.panel import (
    ALERT,
    INK,
    ROCK,
    ROCK_EDGE,
    SOFT,
    START,
    TICK_PT,
    Ink,
    Marks,
    Page,
    Panel,
    Shape,
    level_colour,
    page_of,
    photo,
    plan_panel,
    round_length_mm,
)
from vinefab.physics.tube import inflated_diameter_mm, inflated_radius_mm

if TYPE_CHECKING:
    from vinefab.maps.importers.photo_map import PhotoMap
    from vinefab.pages import page_pdf
else:
    page_pdf = imported_later("vinefab.pages.page_pdf")  # PDF takes a library


# --- What is seen of a map in a picture -----------------------------------------------------------

Box = tuple[float, float, float, float]
"""Least x, least y, greatest x, greatest y, mm."""

SMALL = 0.4
"""A robot that takes up less than this share of the map's longer side is drawn enlarged."""

UNSEEN_DETAIL = 4e-4
"""Detail below this share of a picture's longer side is left out: a fifth of a point on paper."""

FAN = 0.1
"""Reach of the sector of headings at a start, as a share of a picture's longer side."""


def robot_view(world: Map, deployment: Deployment) -> Box:
    """Return the box to draw: the whole map, or the robot's surroundings on a much larger map."""
    whole = world.bounds.bounds
    if not len(deployment.points_mm):
        return whole
    low, high = deployment.points_mm.min(axis=0), deployment.points_mm.max(axis=0)
    side_mm = max(*(high - low).tolist(), 0.02 * max(world.size_mm))
    if side_mm >= SMALL * max(world.size_mm):
        return whole
    middle, half = (low + high) / 2.0, (high - low) / 2.0 + 0.25 * side_mm
    planned_mm = float((deployment.base_mm + deployment.tree.length_mm).max())
    # Share of the map's longer side that is shown at least, if the robot was planned that long:
    # walls show the cause of a stub.
    least_seen = 0.3
    least_mm = min(least_seen * max(world.size_mm), planned_mm)
    half = np.maximum(half, 0.5 * least_mm)
    x_min, y_min = np.maximum(middle - half, whole[:2]).tolist()
    x_max, y_max = np.minimum(middle + half, whole[2:]).tolist()
    return x_min, y_min, x_max, y_max


def robot_box(deployment: Deployment) -> Box:
    """Return a box around a robot whose map is not known."""
    pose = deployment.pose
    points = np.vstack([deployment.points_mm, [(pose.x_mm, pose.y_mm)]])
    (x_min, y_min), (x_max, y_max) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    rim_mm = max(0.05 * (x_max - x_min), 0.05 * (y_max - y_min), 10.0)
    return x_min - rim_mm, y_min - rim_mm, x_max + rim_mm, y_max + rim_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class LostPlace:
    """An end of a body at which branches should have emerged and never did."""

    at_mm: tuple[float, float]
    front_mm: float  # front length at which the body ended there
    count: int  # of the branches, descendants included


def lost_places(deployment: Deployment) -> list[LostPlace]:
    """Return the places where branches never emerged: ends of the body, the base for a trunk."""
    tree, pose, counts = deployment.tree, deployment.pose, Counter[int]()
    for branch in np.flatnonzero(~deployment.deployed).tolist():
        end = branch
        while end >= 0 and not deployment.deployed[end]:
            end = int(tree.parent[end])
        counts[end] += 1
    fronts_mm = deployment.base_mm + deployment.grown_mm
    return [
        LostPlace(
            at_mm=(pose.x_mm, pose.y_mm) if end < 0 else tuple(deployment.chain_mm(end)[-1]),
            front_mm=0.0 if end < 0 else float(fronts_mm[end]),
            count=count,
        )
        for end, count in counts.items()
    ]


def at_least_wide(box: Box) -> Box:
    """Return a box, no side of it shorter than a tenth of the other: a straight line has none."""
    least_mm = max(0.1 * longer_mm(box), 1e-3)
    dx, dy = (max(0.0, least_mm - box[axis + 2] + box[axis]) / 2.0 for axis in (0, 1))
    return box[0] - dx, box[1] - dy, box[2] + dx, box[3] + dy


def longer_mm(box: Box) -> float:
    """Return the longer side of a box."""
    return max(box[2] - box[0], box[3] - box[1])


def rock_in(world: Map, box: Box) -> list[BaseGeometry]:
    """Return the solids in and around a box, without detail too fine to be seen there."""
    outside = shapely.box(*world.bounds.bounds) - world.bounds
    return _seen([*shapely.get_parts(outside), *world.obstacles], box)


def bounds_in(world: Map, box: Box) -> BaseGeometry:
    """Return the bounds in and around a box, likewise; they end well outside of the box."""
    return _seen([world.bounds], box)[0]


def _seen(polygons: list[Polygon], box: Box) -> list[BaseGeometry]:
    longest_mm = longer_mm(box)
    # The cut lies outside of the shown part, margin included.
    window = shapely.buffer(shapely.box(*box), 0.2 * longest_mm, join_style="mitre")
    near = [polygon for polygon in polygons if window.intersects(polygon)]
    inside = [p if window.covers(p) else shapely.intersection(p, window) for p in near]
    return list(shapely.simplify(inside, UNSEEN_DETAIL * longest_mm))


@dataclass(frozen=True, slots=True, kw_only=True)
class StartMark:
    """The drawing of the range that poses are drawn from, without the pose."""

    whole: BaseGeometry | None  # line, polygon or box of positions; None for a single one
    free: tuple[BaseGeometry, ...]  # the pieces of it that positions are drawn from
    fan: BaseGeometry | None  # the headings, as a sector around the pose; None for a single one


def start_marks(world: Map, box: Box) -> list[StartMark]:
    """Return the ranges of a map's starts, as they are drawn in a box of it."""
    reach_mm, marks = FAN * longer_mm(box), []
    fan_points = 33
    for start in world.starts:
        whole, fan = start_range(start), None
        free: tuple[BaseGeometry, ...] = () if whole is None else (whole,)
        if start.area is not None:
            free = ()
            with suppress(BadInputError):  # obstacles may have been moved over it
                free = tuple(pieces_on(world, start))
        if start.spread_heading_rad:  # the sector of its headings; a circle for all of them
            pose, spread_rad = start.pose, min(start.spread_heading_rad, math.pi)
            angles = pose.heading_rad + spread_rad * np.linspace(-1.0, 1.0, fan_points)
            x = pose.x_mm + reach_mm * np.cos(angles)
            y = pose.y_mm + reach_mm * np.sin(angles)
            base = [] if spread_rad == math.pi else [(pose.x_mm, pose.y_mm)]
            fan = Polygon([*base, *zip(x.tolist(), y.tolist(), strict=True)])
        marks.append(StartMark(whole=whole, free=free, fan=fan))
    return marks


STOP_WORDS = {
    Stop.FULL_LENGTH: "grown in full",
    Stop.HEAD_ON: "stopped head-on",
    Stop.CORNER: "stopped in a corner",
    Stop.PRESSURE: "out of pressure",
    Stop.BRANCH: "stopped at another branch",
    Stop.NOT_EVERTED: "did not come out",
    Stop.NOT_DEPLOYED: "never emerged",
}


# --- Plans ----------------------------------------------------------------------------------------


def body_cells(
    deployment: Deployment,
    widths_mm: Floats,
    low_mm: tuple[float, float],
    cell_mm: float,
    shape: tuple[int, int],
) -> Floats:
    """Return 1 where a deployed body covers a cell's middle, else 0, within about a cell."""
    picture = Image.new("1", (shape[1], shape[0]))
    draw = ImageDraw.Draw(picture)
    for branch in np.flatnonzero(deployment.deployed).tolist():
        across = inflated_diameter_mm(float(widths_mm[branch])) / cell_mm
        chain = (deployment.chain_mm(branch) - np.array(low_mm)) / cell_mm - 0.5
        draw.line([(x, y) for x, y in chain.tolist()], fill=1, width=max(1, round(across)))
        for x, y in chain.tolist():
            half = across / 2.0
            draw.ellipse((x - half, y - half, x + half, y + half), fill=1)
    return np.asarray(picture, dtype=np.float64)


TIP_SIGNS = {
    Stop.FULL_LENGTH: "o",
    Stop.HEAD_ON: "X",
    Stop.CORNER: "^",
    Stop.PRESSURE: "s",
    Stop.BRANCH: "D",
    Stop.NOT_EVERTED: "x",
}

RANGE_LABEL = "range of starts"

BODY_IS_LINE = "Bodies are lines: this growth model gives them no width"

MANY_TIPS = 100
"""From so many branches on, markers and lines are drawn finer."""

_START_AREA = Ink(fill=START, fill_alpha=0.28)
_START_EDGE = Ink(line=START, width_pt=0.9, dash_pt=(4.0, 3.0))


def page_bytes(page: Page, suffix: str, dpi: int = 150) -> bytes:
    """Return a page as ``.png``, ``.pdf`` or, for every other suffix, as SVG."""
    match suffix.lower():
        case ".png":
            return page_png(page, dpi)
        case ".pdf":
            return page_pdf.page_pdf(page)
        case _:
            return page_svg(page)


def draw_map(panel: Panel, world: Map, box: Box | None = None) -> None:
    """Draw the bounds and the obstacles of a map, or those in and around a box of it.

    So are the ranges of its starts.
    """
    box = box or world.bounds.bounds
    panel.polygons(rock_in(world, box), Ink(fill=ROCK, line=ROCK_EDGE))
    panel.polygons([bounds_in(world, box)], Ink(line=INK))
    for mark in start_marks(world, box):
        draw_start_range(panel, mark)


def draw_start_range(panel: Panel, mark: StartMark) -> None:
    """Draw the range of poses: all dashed, the free part filled, headings as a fan.

    The pose itself is `draw_pose`.
    """
    if mark.fan is not None:
        panel.polygons([mark.fan], _START_AREA, rank=2.6)
    if mark.whole is not None:
        free = [piece for piece in mark.free if isinstance(piece, Polygon)]
        panel.polygons(free, _START_AREA, rank=2.5)
        for piece in mark.free:
            if not isinstance(piece, Polygon):
                wide = Ink(line=START, width_pt=4.0, line_alpha=0.55)
                panel.line(shapely.get_coordinates(piece), wide, rank=2.5)
        whole = mark.whole
        rings = shapely.get_rings(whole) if isinstance(whole, Polygon) else [whole]
        panel.lines([shapely.get_coordinates(ring) for ring in rings], _START_EDGE, rank=2.7)
    if mark.fan is not None or mark.whole is not None:
        ink = Ink(fill=START, fill_alpha=0.28, line=START, width_pt=0.9, dash_pt=(4.0, 3.0))
        panel.explain(RANGE_LABEL, Shape([], ink, closed=True))


def draw_deployment(panel: Panel, deployment: Deployment, widths_mm: Floats) -> None:
    """Draw body, centreline, contacts and tips of a deployment, coloured by level.

    Parameters
    ----------
    widths_mm
        Lay-flat width of each branch, shape (n,); 0 where the body is a line.
    """
    levels = deployment.tree.level
    size = 0.5 if len(levels) > MANY_TIPS else 1.0
    # Leaves first, so that the trunk lies on top; the legend says the trunk first.
    for level in range(int(levels.max()), 0, -1):
        members = np.flatnonzero((levels == level) & deployment.deployed)
        chains = [deployment.chain_mm(int(branch)) for branch in members]
        colour = level_colour(level)
        if np.any(widths_mm):
            drawn = [number for number, chain in enumerate(chains) if len(chain) > 1]
            lines = [shapely.LineString(chains[number]) for number in drawn]
            radii_mm = [inflated_radius_mm(float(widths_mm[members[number]])) for number in drawn]
            body = shapely.union_all(shapely.buffer(lines, radii_mm, quad_segs=8))
            edge = Ink(fill=colour, fill_alpha=0.3, line=colour)
            panel.polygons([body], edge, rank=3.0)
        width_pt = size * max(1.0, 2.2 - 0.3 * level)
        panel.lines(chains, Ink(line=colour, width_pt=width_pt), rank=4.2 - level / 100)
        count = f"{len(members)} of {np.count_nonzero(levels == level)}"
        swatch = Shape([], Ink(line=colour, width_pt=2.4))
        panel.explain(f"level {level} ({count})", swatch)
    if not np.any(widths_mm):
        panel.explain("body: a line without width", Shape([], Ink(line=SOFT, width_pt=1.2)))
    contacts = [deployment.contacts_mm(branch) for branch in range(len(deployment.tree))]
    points = np.concatenate(contacts) if contacts else np.empty((0, 2))
    if len(points):
        label = f"contact ({len(points)})"
        panel.marks(points, "D", 3.0 * size, Ink(fill=INK), rank=5.0, label=label)
    tips, stops = deployment.tips_mm, deployment.stop[deployment.deployed]
    for stop, sign in TIP_SIGNS.items():
        here = tips[stops == stop]
        if len(here):
            # Open for tips that grew as planned, solid for stopped ones: seen before it is read.
            full = stop == Stop.FULL_LENGTH
            ink = Ink(
                fill="#ffffff" if full else INK,
                line=INK if full else "#ffffff",
                width_pt=0.8 * size,
            )
            panel.marks(
                here,
                sign,
                4.5 * size if full else 4.0 + 2.5 * size,
                ink,
                rank=6.0 if full else 6.5,
                label=f"{STOP_WORDS[stop]} ({len(here)})",
            )
    lost = int(np.count_nonzero(~deployment.deployed))
    if lost:
        places = np.array([place.at_mm for place in lost_places(deployment)])
        ring = Ink(line=INK, width_pt=0.9 * size)
        words = f"{STOP_WORDS[Stop.NOT_DEPLOYED]} ({lost})"
        panel.marks(places, "o", 9.0 * size, ring, rank=6.2, label=words)


def draw_names(panel: Panel, deployment: Deployment) -> None:
    """Write every branch's id next to the middle of its last stretch."""
    tree, out = deployment.tree, np.flatnonzero(deployment.deployed).tolist()
    # Branches that share their fate lie on each other: one label has the ids of all of them.
    together: dict[tuple[float, ...], list[int]] = {}
    for branch in out:
        ends = tuple(np.round(deployment.chain_mm(branch)[-2:].ravel(), 2).tolist())
        together.setdefault(ends, []).append(branch)
    shared = list(together.values())
    panel.write_labels(
        np.array([deployment.chain_mm(some[0])[-2:].mean(axis=0) for some in shared]),
        [", ".join(tree.ids[branch] for branch in some) for some in shared],
        [level_colour(int(tree.level[some[0]])) for some in shared],
        size_pt=6.5 if len(tree) <= MANY_TIPS else 4.5,
        mark_pt=1.5,
        lines=[deployment.chain_mm(branch) for branch in out],
    )


def draw_targets(panel: Panel, targets: Sequence[Target | TargetOutcome]) -> None:
    """Draw targets with their tolerance: touched ones full, missed ones dashed."""
    for one in targets:
        target = one if isinstance(one, Target) else one.target
        words, colour, dash_pt = "target", INK, tuple[float, ...]()
        if isinstance(one, TargetOutcome):
            words, colour, dash_pt = (
                ("target touched", START, ())
                if one.is_touched
                else ("target missed", ALERT, (4.0, 2.5))
            )
        around = shapely.get_coordinates(target.shape.buffer(max(target.tolerance_mm, 1e-3)))
        ring = Ink(fill=colour, fill_alpha=0.14, line=colour, width_pt=1.3, dash_pt=dash_pt)
        panel.add(Shape([around], ring, closed=True), 5.9, words)
        panel.marks([target.middle_mm], "+", 7.0, Ink(line=colour, width_pt=1.1), rank=6.0)
    panel.write_labels(
        [(one if isinstance(one, Target) else one.target).middle_mm for one in targets],
        [(one if isinstance(one, Target) else one.target).name for one in targets],
        [INK] * len(targets),
        size_pt=TICK_PT,
        mark_pt=4.0,
    )


def draw_pose(panel: Panel, pose: Pose, view_mm: float) -> None:
    """Draw a start in a plan of some size: a dot, and an arrow where the trunk is launched."""
    base = np.array([pose.x_mm, pose.y_mm])
    towards = np.array([np.cos(pose.heading_rad), np.sin(pose.heading_rad)])
    arrow = Ink(line=INK, width_pt=1.8)
    panel.arrow(base, base + 0.055 * view_mm * towards, arrow, head_pt=7.0, rank=7.0)
    dot = Marks(base[None, :], "o", 5.0, Ink(fill=INK, line="#ffffff", width_pt=0.8))
    panel.add(dot, 7.0, "start")


def map_plan(
    world: Map,
    *,
    targets: Sequence[Target] | None = None,
    longest_pt: float = 468.0,
    title: str = "",
) -> Page:
    """Return a plan of a map with its starts and its targets, or others in place of them."""
    panel = plan_panel(world.bounds.bounds, longest_pt)
    panel.title = title
    draw_map(panel, world)
    for start in world.starts:
        draw_pose(panel, start.pose, max(world.size_mm))
    draw_targets(panel, world.targets if targets is None else targets)
    return page_of(panel)


def deployment_plan(  # noqa: PLR0913  options by keyword
    world: Map | None,
    deployment: Deployment,
    widths_mm: Floats,
    *,
    longest_pt: float = 468.0,
    named: bool = False,
    whole: bool = False,
    touched: TargetsResult | None = None,
    title: str = "",
) -> Page:
    """Return a plan of a robot deployed on a map; without a map the robot is drawn alone.

    Parameters
    ----------
    widths_mm
        As in `draw_deployment`.
    touched
        The targets to draw; None: those of the map, as the body touches them.
    """
    if world is None:
        box = robot_box(deployment)
    else:
        box = world.bounds.bounds if whole else robot_view(world, deployment)
    panel = plan_panel(box, longest_pt)
    panel.title = title
    if world is not None:
        draw_map(panel, world, box)
    draw_deployment(panel, deployment, widths_mm)
    draw_pose(panel, deployment.pose, longer_mm(box))
    if touched is None and world is not None:
        touched = TargetsResult.touched([(deployment, world.targets)])
    if touched is not None:
        draw_targets(panel, touched.outcomes)
    if world is not None and box != world.bounds.bounds:
        size = " x ".join(f"{side:g}" for side in world.size_mm)
        part = f"part of {world.name}, {size} mm"
        panel.title, panel.title_colour = f"{title}\n{part}" if title else part, SOFT
    if named:
        draw_names(panel, deployment)
    return page_of(panel)


def outline_plan(
    contour: Contour, *, filled: bool = True, title: str = "", longest_pt: float = 468.0
) -> Page:
    """Return a plan of a flat outline; film fills it."""
    box = at_least_wide(contour.box_mm)
    panel = plan_panel(box, longest_pt)
    panel.title = title
    # Arcs become chords that lie this close to them, as a share of a picture's longer side.
    fine = 1e-4
    points = contour.flattened_mm(fine * longer_mm(box))
    if filled:
        panel.add(Shape([points], Ink(fill=ROCK, fill_alpha=0.5), closed=True))
    panel.add(Shape([points], Ink(line=INK), closed=contour.closed))
    return page_of(panel)


def draw_thin(panel: Panel, deployments: Sequence[Deployment], ink: Ink, rank: float) -> None:
    """Draw the centrelines of several deployments in one way."""
    for deployment in deployments:
        out = np.flatnonzero(deployment.deployed).tolist()
        panel.lines([deployment.chain_mm(branch) for branch in out], ink, rank=rank)


def photo_preview(imported: "PhotoMap") -> Page:
    """Return a picture by which a person sees whether walls lie where the photo has them."""
    view, world = imported.view, imported.world
    rows, columns = view.pixels.shape[:2]
    right, low = view.to_map(np.array([(columns, rows)]))[0].tolist()
    box = (view.left_mm, low, right, view.top_mm)
    panel = plan_panel(box, 648.0)
    panel.add(photo(view.pixels, box), 0.0)
    panel.polygons([world.bounds, *world.obstacles], Ink(line=ALERT), rank=3.0)
    squares = [Polygon(corners) for corners in imported.markers_mm]
    panel.polygons(squares, Ink(line="#0a7d32"), rank=4.0)
    for start in world.starts[:1]:
        dot = Ink(fill=ALERT, line="#ffffff", width_pt=1.0)
        panel.marks([(start.pose.x_mm, start.pose.y_mm)], "o", 6.0, dot, rank=5.0)
    bar = round_length_mm((box[2] - box[0]) / 5.0)
    x, y = (box[0] + box[2] - bar) / 2.0, box[1] + 0.04 * (box[3] - box[1])
    for colour, width_pt in (("#ffffff", 6.0), (INK, 3.0)):
        panel.line([(x, y), (x + bar, y)], Ink(line=colour, width_pt=width_pt, butt=True), rank=6.0)
    height = f", as seen {imported.height_mm:g} mm up" if imported.height_mm else ""
    markers = ", markers green" if squares else ""
    panel.title = (
        f"{one_line(world.name)}: {counted(len(world.obstacles), 'obstacle')}{height};\n"
        f"walls red{markers}, start a dot; the bar is {bar:g} mm"
    )
    return page_of(panel)
