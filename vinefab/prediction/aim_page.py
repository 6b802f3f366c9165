"""The pictures of where to put a robot's base."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from vinefab.model.map import Map
from vinefab.pages.charts import frame
from vinefab.pages.colours import ALERT, HEAT_COLOURS, INK, LEVEL_COLOURS, SOFT
from vinefab.pages.drawing import draw_deployment, draw_legend, draw_map, draw_pose, draw_targets
from vinefab.pages.figure import blank, house_style, plan_axes, png_bytes, svg_bytes
from vinefab.prediction.aiming import (
    SHOWN_DEPLOYMENTS,
    AimedRobot,
    AimResult,
)
from vinefab.prediction.deploy import pose_text
from vinefab.prediction.robot_set import RobotSet, union_curve
from vinefab.tasks.covered_cells import BodyCover, TargetCover, TipCover
from vinefab.tasks.reach import Reach

_HEAT = LinearSegmentedColormap.from_list("expected score", HEAT_COLOURS)

PLAN_IN = 5.0
"""Longer side of a plan, inches."""

MOST_ARROWS = 150

ARROWS_APART = 0.035
"""Arrows stand this far apart, as a share of the map's longer side."""


def sheet_picture(found: AimResult, suffix: str) -> bytes:
    """Return `aim_sheet` as an SVG document, or as a PNG for the suffix ``.png``."""
    figure = aim_sheet(found)
    return png_bytes(figure) if suffix.lower() == ".png" else svg_bytes(figure)


# --- Drawings -----------------------------------------------------------------------------------


def score_scale(found: AimResult) -> Normalize:
    """Return the scale of expected scores that all maps of a result share."""
    values = [robot.search.landscape.best_scores for robot in found.robots]
    some = np.concatenate(values)
    some = some[np.isfinite(some)]
    low, high = float(some.min()), float(some.max())
    return Normalize(low, high if high > low else low + 1e-9)


def draw_landscape(axes: Axes, found: AimResult, robot: AimedRobot) -> None:
    """Draw expected scores over places, each at its best heading, with arrows along some."""
    landscape, world = robot.search.landscape, found.world
    known = landscape.known
    places, scores = landscape.places_mm[known], landscape.best_scores[known]
    order = np.argsort(scores, kind="stable")  # the best on top
    most_pt = 14.0 if found.plan.where == "anywhere" else 7.0
    side_pt = landscape.spacing_mm * 72.0 * PLAN_IN / max(world.size_mm)
    side_pt = float(np.clip(side_pt, 3.0, most_pt))
    draw_map(axes, world)
    axes.scatter(
        places[order, 0],
        places[order, 1],
        c=scores[order],
        cmap=_HEAT,
        norm=score_scale(found),
        s=side_pt**2,
        marker="s",
        linewidths=0,
        zorder=1.5,
        rasterized=len(places) > 4000,
    )
    _draw_arrows(axes, places, landscape.best_headings_rad[known], scores, max(world.size_mm))
    _draw_best(axes, found, robot)


def _draw_arrows(
    axes: Axes, places: np.ndarray, headings: np.ndarray, scores: np.ndarray, size_mm: float
) -> None:
    """Draw the best headings at some places, the best places first."""
    taken = list[int]()
    for index in np.argsort(-scores, kind="stable").tolist():
        if len(taken) == MOST_ARROWS:
            break
        away = np.hypot(*(places[taken] - places[index]).T)
        if not (away < ARROWS_APART * size_mm).any():
            taken.append(index)
    heading = headings[taken]
    axes.quiver(
        *places[taken].T,
        np.cos(heading),
        np.sin(heading),
        color=INK,
        scale=38,
        width=0.0035,
        headwidth=4.5,
        alpha=0.8,
        zorder=4,
    )


def _draw_best(axes: Axes, found: AimResult, robot: AimedRobot) -> None:
    size_mm, pose = max(found.world.size_mm), robot.best.pose
    draw_pose(axes, pose, size_mm)
    axes.plot(pose.x_mm, pose.y_mm, "o", ms=13, mfc="none", mec=ALERT, mew=1.8, zorder=8)
    if isinstance(found.task, Reach) and found.task.target_mm:
        draw_targets(axes, np.array(found.task.target_mm))


def draw_best_deployments(axes: Axes, found: AimResult, robot: AimedRobot) -> None:
    """Draw the deployments from the best pose: one in full, the others as thin lines."""
    draw_map(axes, found.world)
    for deployment in robot.shown[1:]:
        chains = [deployment.chain_mm(int(b)) for b in np.flatnonzero(deployment.deployed)]
        axes.add_collection(
            LineCollection(chains, colors=SOFT, linewidths=0.6, alpha=0.35, zorder=2)
        )
    widths_mm = found.plan.options.drawn_widths_mm(robot.design.build.widths_mm)
    draw_deployment(axes, robot.shown[0], widths_mm)
    _draw_best(axes, found, robot)


def draw_turned(axes: PolarAxes, robots: Sequence[AimedRobot]) -> None:
    """Draw scores over the heading at each robot's best place, mean and worst to best tenth."""
    for index, robot in enumerate(robots):
        angle = np.append(robot.turned.headings_rad, 2.0 * np.pi)
        scores = robot.turned.scores
        low, high = np.percentile(scores, [10.0, 90.0], axis=1)
        colour = LEVEL_COLOURS[index % len(LEVEL_COLOURS)]
        closed = [np.append(row, row[0]) for row in (scores.mean(axis=1), low, high)]
        axes.fill_between(angle, closed[1], closed[2], color=colour, alpha=0.18, linewidth=0)
        axes.plot(angle, closed[0], color=colour, linewidth=1.6, label=robot.name)
        at = robot.best.pose.heading_rad
        axes.plot([at, at], [axes.get_rmin(), robot.best.mean], color=colour, ls=":", lw=1.2)
    axes.tick_params(labelsize=7)
    axes.set_rlabel_position(22.5)
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.08))


def draw_team(axes: Axes, found: AimResult, team: RobotSet) -> None:
    """Draw what several robots cover together, each in a colour, and their bases by number."""
    colours = [LEVEL_COLOURS[index % len(LEVEL_COLOURS)] for index in range(len(team.poses))]
    cover = team.cover
    if isinstance(cover, BodyCover | TipCover):
        # Which robot covers a cell first; none where nobody does.
        owner = np.where(team.covered.any(axis=0), team.covered.argmax(axis=0) + 1.0, np.nan)
        rows, columns = cover.grid.free_mm2.shape
        shown = np.full(rows * columns, np.nan)
        shown[cover.grid.is_free] = owner
        x, y, side = cover.grid.box.tolist()
        axes.imshow(
            shown.reshape(rows, columns),
            origin="lower",
            extent=(x, x + columns * side, y, y + rows * side),
            cmap=ListedColormap(colours),
            vmin=0.5,
            vmax=len(colours) + 0.5,
            alpha=0.35,
            zorder=0.5,
            interpolation="nearest",
        )
    elif isinstance(cover, TargetCover):
        draw_targets(axes, cover.targets_mm)
        for index, colour in enumerate(colours):
            axes.plot(*cover.targets_mm[team.covered[index]].T, "o", ms=5, color=colour, zorder=5)
    draw_map(axes, found.world)
    for number, (deployment, colour) in enumerate(zip(team.shown, colours, strict=True), start=1):
        chains = [deployment.chain_mm(int(b)) for b in np.flatnonzero(deployment.deployed)]
        axes.add_collection(LineCollection(chains, colors=colour, linewidths=1.3, zorder=4))
        pose = deployment.pose
        axes.plot(pose.x_mm, pose.y_mm, "o", ms=11, color=colour, mec="white", zorder=8)
        axes.annotate(
            f"{number}", (pose.x_mm, pose.y_mm), color="white", fontsize=7, ha="center",
            va="center", zorder=9,
        )  # fmt: skip


def draw_union_curve(axes: Axes, robots: Sequence[AimedRobot]) -> None:
    """Draw the covered share over the number of robots, with intervals and bounds."""
    for index, robot in enumerate(robots):
        if robot.team is None:
            continue
        count, mean, low, high, bound = np.array(union_curve(robot.team)).T
        colour = LEVEL_COLOURS[index % len(LEVEL_COLOURS)]
        axes.fill_between(count, 100 * low, 100 * high, color=colour, alpha=0.2, linewidth=0)
        axes.plot(count, 100 * mean, "o-", color=colour, label=robot.name)
        axes.plot(
            count, 100 * bound, "--", color=colour, lw=1.0, label=f"no {robot.name} set beats this"
        )
    axes.set_xticks(count)
    axes.set_xlabel("robots")
    axes.set_ylabel("covered together (%, simulated)")
    axes.set_ylim(0.0, 103.0)
    axes.legend(fontsize=7)
    frame(axes)


# --- One picture ----------------------------------------------------------------------------------


ROW_TITLES = (
    "",
    f"{SHOWN_DEPLOYMENTS} deployments from there, one in full (simulated)",
    "robots that together cover most, at one draw (simulated)",
)


def aim_sheet(found: AimResult) -> Figure:
    """Return the maps, the best deployments and the headings of all designs in one picture."""
    robots = found.robots
    has_team = robots[0].team is not None
    width, height = found.world.size_mm
    plan_in = PLAN_IN * height / max(width, height)
    heights = [plan_in, plan_in, *([plan_in] if has_team else []), 3.2]
    with house_style():
        figure = Figure(figsize=(5.2 * len(robots) + 0.6, sum(heights) + 1.2), layout="constrained")
        grid = figure.add_gridspec(len(heights), len(robots), height_ratios=heights)
        rows: list[Callable[[Axes, AimResult, AimedRobot], None]] = [
            draw_landscape,
            draw_best_deployments,
        ]
        if has_team:
            rows.append(_draw_own_team)
        shown = None
        for column, robot in enumerate(robots):
            for row, draw in enumerate(rows):
                axes = figure.add_subplot(grid[row, column])
                _as_plan(axes, found.world)
                draw(axes, found, robot)
                title = _title(robot) if row == 0 else ROW_TITLES[row]
                axes.set_title(title, fontsize=8)
                shown = axes if row == 0 else shown
        bar = figure.colorbar(
            ScalarMappable(norm=score_scale(found), cmap=_HEAT), ax=shown, shrink=0.8
        )
        bar.set_label(_score_words(found))
        bar.outline.set_visible(False)
        if has_team and len(robots) > 1:
            draw_turned(figure.add_subplot(grid[-1, 0], projection="polar"), robots)  # type: ignore[arg-type]
            draw_union_curve(figure.add_subplot(grid[-1, 1]), robots)
        else:
            draw_turned(figure.add_subplot(grid[-1, :], projection="polar"), robots)  # type: ignore[arg-type]
    return figure


def _draw_own_team(axes: Axes, found: AimResult, robot: AimedRobot) -> None:
    if robot.team is not None:
        draw_team(axes, found, robot.team)


def _as_plan(axes: Axes, world: Map) -> None:
    x_min, y_min, x_max, y_max = world.bounds.bounds
    margin = 0.02 * max(world.size_mm)
    axes.set_aspect("equal")
    axes.set_xlim(x_min - margin, x_max + margin)
    axes.set_ylim(y_min - margin, y_max + margin)
    axes.spines[:].set_visible(False)
    axes.tick_params(labelsize=7)


def _title(robot: AimedRobot) -> str:
    best = robot.best
    low, high = best.interval
    return (
        f"{robot.name} from {pose_text(best.pose)}\n"
        f"{best.mean:.3f} [{low:.3f}, {high:.3f}], worst tenth {best.worst_tenth:.3f} (simulated)"
    )


def _score_words(found: AimResult) -> str:
    return f"expected {found.task.name} score (simulated)"


# --- Pictures of the page -------------------------------------------------------------------------


def landscape_picture(found: AimResult, robot: AimedRobot) -> bytes:
    """Return the expected scores of a design's places."""
    with house_style():
        figure, axes = plan_axes(found.world.bounds.bounds, PLAN_IN)
        draw_landscape(axes, found, robot)
        bar = figure.colorbar(
            ScalarMappable(norm=score_scale(found), cmap=_HEAT), ax=axes, shrink=0.8, pad=0.02
        )
        bar.set_label(_score_words(found))
        bar.outline.set_visible(False)
    return svg_bytes(figure)


def headings_picture(found: AimResult) -> bytes:
    """Return the scores over the heading at each best place."""
    with house_style():
        figure = Figure(figsize=(4.6, 4.6), layout="constrained")
        draw_turned(figure.add_subplot(projection="polar"), found.robots)  # type: ignore[arg-type]
    return svg_bytes(figure)


def best_picture(found: AimResult, robot: AimedRobot) -> bytes:
    """Return deployments of a design from its best pose."""
    with house_style():
        figure, axes = plan_axes(found.world.bounds.bounds, PLAN_IN)
        draw_best_deployments(axes, found, robot)
        draw_legend(axes)
    return svg_bytes(figure)


def team_picture(found: AimResult, robot: AimedRobot) -> bytes:
    """Return the robots of a design that together cover most."""
    with house_style():
        figure, axes = plan_axes(found.world.bounds.bounds, PLAN_IN)
        _draw_own_team(axes, found, robot)
    return svg_bytes(figure)


def union_picture(found: AimResult) -> bytes:
    """Return the covered share over the number of robots."""
    with house_style():
        figure, axes = blank(6.0, 3.2)
        draw_union_curve(axes, found.robots)
    return svg_bytes(figure)
