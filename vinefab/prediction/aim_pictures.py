"""Pictures of where to put a robot's base: landscapes, deployments, headings, several robots."""

from collections.abc import Callable, Sequence

import numpy as np

from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    ALERT,
    COLUMN_PT,
    HEAT_COLOURS,
    INK,
    SOFT,
    TICK_PT,
    Ink,
    Marks,
    Page,
    Panel,
    Raster,
    Shape,
    Words,
    blended,
    curve,
    ends_of,
    page_of,
    page_of_rows,
    plan_panel,
    rgb,
    round_ticks,
    series_colour,
)
from vinefab.pages.plan import draw_deployment, draw_map, draw_pose, draw_targets, draw_thin
from vinefab.prediction.aimed_robot import AimedRobot, Aims
from vinefab.prediction.deploy import pose_text
from vinefab.prediction.robot_set import RobotSet, union_curve
from vinefab.tasks.areas import BodyCover, TargetCover, TipCover
from vinefab.tasks.reach import task_targets


def aim_svg(panel: Callable[..., Panel], *args: object) -> bytes:
    """Return one of these panels as an SVG document."""
    return page_svg(page_of(panel(*args)))


def score_ends(found: Aims) -> tuple[float, float]:
    """Return the ends of the scale of expected scores that all maps of a result share."""
    some = np.concatenate([robot.search.landscape.best_scores for robot in found.robots])
    some = some[np.isfinite(some)]
    low, high = float(some.min()), float(some.max())
    return low, high if high > low else low + 1e-9


def landscape_panel(
    found: Aims, robot: AimedRobot, *, bar: bool = True, longest_pt: float = COLUMN_PT - 15.0
) -> Panel:
    """Return expected scores over places, each at its best heading, with arrows along some."""
    landscape, world = robot.search.landscape, found.world
    known = landscape.known
    places, scores = landscape.places_mm[known], landscape.best_scores[known]
    most_pt = 14.0 if found.plan.where == "anywhere" else 7.0
    size_mm = max(world.size_mm)
    panel = plan_panel(world.bounds.bounds, longest_pt)
    side_pt = float(np.clip(landscape.spacing_mm * longest_pt / size_mm, 3.0, most_pt))
    low, high = score_ends(found)
    draw_map(panel, world)
    levels = np.rint(63.0 * (scores - low) / (high - low)).astype(int)
    # A few shades, the best on top: one group of marks for each.
    shades = blended(np.linspace(0.0, 1.0, 64), HEAT_COLOURS)[:, :3].tolist()
    for level in np.unique(levels).tolist():
        colour = "#{:02x}{:02x}{:02x}".format(*shades[level])
        panel.marks(places[levels == level], "s", side_pt, Ink(fill=colour), rank=1.5)
    if bar:
        words = f"expected {found.task.name} score (simulated)"
        panel.bar = (words, low, high, HEAT_COLOURS)
    # The best headings at some places, the best places first.
    headings, taken = landscape.best_headings_rad[known], list[int]()
    arrows_apart = 0.035  # arrows stand this far apart, as a share of the map's longer side
    most_arrows = 150
    for index in np.argsort(-scores, kind="stable").tolist():
        if len(taken) == most_arrows:
            break
        away = np.hypot(*(places[taken] - places[index]).T)
        if not (away < arrows_apart * size_mm).any():
            taken.append(index)
    arrow_pt = 9.0
    reach_mm = arrow_pt * (panel.box[2] - panel.box[0]) / panel.width_pt
    ink = Ink(line=INK, width_pt=1.1, line_alpha=0.8)
    for index in taken:
        towards = np.array([np.cos(headings[index]), np.sin(headings[index])])
        panel.arrow(places[index], places[index] + reach_mm * towards, ink, 4.0, 4.0)
    _draw_best(panel, found, robot)
    return panel


def _draw_best(panel: Panel, found: Aims, robot: AimedRobot) -> None:
    pose = robot.best.pose
    draw_pose(panel, pose, max(found.world.size_mm))
    panel.marks([(pose.x_mm, pose.y_mm)], "o", 13.0, Ink(line=ALERT, width_pt=1.8), rank=8.0)
    draw_targets(panel, robot.targets.outcomes if robot.targets else ())


def best_deployments_panel(found: Aims, robot: AimedRobot, longest_pt: float = COLUMN_PT) -> Panel:
    """Return the deployments from the best pose: one in full, the others as thin lines."""
    panel = plan_panel(found.world.bounds.bounds, longest_pt)
    draw_map(panel, found.world)
    draw_thin(panel, robot.shown[1:], Ink(line=SOFT, width_pt=0.6, line_alpha=0.35), 2.0)
    widths_mm = found.plan.options.drawn_widths_mm(robot.shown[0].tree)
    draw_deployment(panel, robot.shown[0], widths_mm)
    _draw_best(panel, found, robot)
    return panel


def turned_panel(robots: Sequence[AimedRobot]) -> Panel:
    """Return scores over the heading at each robot's best place, mean and worst to best tenth."""
    curves = []
    for robot in robots:
        scores = robot.turned.scores
        low, high = np.percentile(scores, [10.0, 90.0], axis=1)
        curves.append((robot.turned.headings_rad, scores.mean(axis=1), low, high))
    inner, outer = ends_of(*(values for one in curves for values in one[1:]))
    if min(float(one[2].min()) for one in curves) >= 0.0:
        inner = max(0.0, inner)
    reach = 1.22
    panel = Panel(
        box=(-reach, -reach, reach, reach), width_pt=COLUMN_PT + 24.0, height_pt=COLUMN_PT + 24.0,
        x_ticks=(), y_ticks=(),
    )  # fmt: skip

    def placed(angle: Floats, score: Floats) -> Floats:
        away = (np.asarray(score) - inner) / (outer - inner)
        return np.column_stack([away * np.cos(angle), away * np.sin(angle)])

    turns = np.linspace(0.0, 2.0 * np.pi, 121)
    faint = Ink(line=SOFT, width_pt=0.6, line_alpha=0.3)
    rim = np.column_stack([np.cos(turns), np.sin(turns)])
    panel.lines([rim], Ink(line=SOFT, width_pt=0.8), rank=0.0)
    for degrees in range(0, 360, 45):
        along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        panel.lines([np.array([(0.0, 0.0), along])], faint, rank=0.0)
        x, y = (1.12 * along).tolist()
        panel.words((x, y), f"{degrees}°", TICK_PT, colour=SOFT, anchor="middle")
    for value, words in round_ticks(inner, outer, 5):
        if value > inner:
            panel.lines([placed(turns, np.full(len(turns), value))], faint, rank=0.0)
            x, y = placed(np.array([np.radians(22.5)]), np.array([value]))[0].tolist()
            panel.words((x, y), words, TICK_PT, colour=SOFT, anchor="middle", halo=True)
    for index, (robot, (headings, mean, low, high)) in enumerate(zip(robots, curves, strict=True)):
        colour, around = series_colour(index), np.append(headings, headings[0])
        inside, outside, middle = (placed(around, np.append(v, v[0])) for v in (low, high, mean))
        # Even-odd: what lies between two closed curves.
        between = Shape([outside, inside], Ink(fill=colour, fill_alpha=0.18), closed=True)
        panel.add(between, 1.0)
        panel.line(middle, Ink(line=colour, width_pt=1.6), label=robot.name)
        best = robot.best
        at = np.array([best.pose.heading_rad] * 2)
        dotted = Ink(line=colour, width_pt=1.2, dash_pt=(1.2, 2.0))
        panel.line(placed(at, np.array([inner, best.mean])), dotted)
    return panel


def team_panel(found: Aims, team: RobotSet, longest_pt: float = COLUMN_PT) -> Panel:
    """Return the cover of several robots together, each in a colour, and their bases by number."""
    panel = plan_panel(found.world.bounds.bounds, longest_pt)
    colours = [series_colour(index) for index in range(len(team.poses))]
    cover = team.cover
    if isinstance(cover, BodyCover | TipCover):
        # Which robot covers a cell first; none where no robot does.
        first = np.where(team.covered.any(axis=0), team.covered.argmax(axis=0), len(colours))
        rows, columns = cover.grid.free_mm2.shape
        shown = np.full(rows * columns, len(colours))
        shown[cover.grid.is_free] = first
        shades = [(*rgb(colour), 90) for colour in colours] + [(0, 0, 0, 0)]
        pixels = np.array(shades, dtype=np.uint8)[shown.reshape(rows, columns)[::-1]]
        x, y, side = cover.grid.box.tolist()
        panel.add(Raster((x, y, x + columns * side, y + rows * side), pixels), 0.5)
    elif isinstance(cover, TargetCover):
        draw_targets(panel, task_targets(found.task, found.world))
        for index, colour in enumerate(colours):
            reached = cover.targets_mm[team.covered[index]]
            panel.marks(reached, "o", 5.0, Ink(fill=colour), rank=6.5)
    draw_map(panel, found.world)
    for place, (deployment, colour) in enumerate(zip(team.shown, colours, strict=True), start=1):
        draw_thin(panel, [deployment], Ink(line=colour, width_pt=1.3), 4.0)
        base = (deployment.pose.x_mm, deployment.pose.y_mm)
        dot = Ink(fill=colour, line="#ffffff", width_pt=1.0)
        panel.add(Marks(np.array([base]), "o", 11.0, dot), 8.0)
        panel.add(Words(base, f"{place}", TICK_PT, "#ffffff", "middle"), 9.0)
    return panel


def union_panel(robots: Sequence[AimedRobot]) -> Panel:
    """Return the covered share over the number of robots, with intervals and bounds."""
    curves = {
        robot.name: np.array(union_curve(robot.team)).T
        for robot in robots
        if robot.team is not None
    }
    counts = max((rows[0] for rows in curves.values()), key=len)
    low, high = ends_of(counts)
    panel = Panel(
        box=(low, 0.0, high, 103.0),
        width_pt=COLUMN_PT,
        height_pt=COLUMN_PT,
        x_name="robots",
        y_name="covered together (%, simulated)",
        x_ticks=[(count, f"{count:g}") for count in counts.tolist()],
        frame=True,
    )
    for index, (name, (count, mean, low, high, bound)) in enumerate(curves.items()):
        colour = series_colour(index)
        panel.band(count, 100 * low, 100 * high, colour, 0.2)
        curve(panel, count, 100 * mean, colour, name)
        dashed = Ink(line=colour, width_pt=1.0, dash_pt=(4.0, 2.0))
        points = np.column_stack([count, 100 * bound])
        panel.line(points, dashed, label=f"no {name} set beats this")
    return panel


# --- One picture ----------------------------------------------------------------------------------


def aim_sheet(found: Aims) -> Page:
    """Return the maps, the best deployments and the headings of all designs in one picture."""
    robots = found.robots
    plans = list[list[Panel]]([[], []])
    plan_pt = 360.0  # longer side of a plan in the picture that has all
    for robot in robots:
        first = landscape_panel(found, robot, bar=robot is robots[-1], longest_pt=plan_pt)
        best, (low, high) = robot.best, robot.best.interval
        first.title = (
            f"{robot.name} from {pose_text(best.pose)}\n"
            f"{best.mean:.3f} [{low:.3f}, {high:.3f}; {best.over}], "
            f"worst tenth {best.worst_tenth:.3f} (simulated)"
        )
        second = best_deployments_panel(found, robot, plan_pt)
        tried = counted(len(robot.shown), "deployment")
        second.title = f"{tried} from there, one in full (simulated)"
        plans[0].append(first)
        plans[1].append(second)
    teams = [robot.team for robot in robots if robot.team is not None]
    if teams:
        third = [team_panel(found, team, plan_pt) for team in teams]
        for panel in third:
            panel.title = "robots that together cover most, at one draw (simulated)"
        plans.append(third)
    for row in plans:
        for panel in row:
            panel.x_name = panel.y_name = ""
            panel.legend_shown = False
    last = [turned_panel(robots)]
    if teams and len(robots) > 1:
        last.append(union_panel(robots))
    return page_of_rows([*plans, last])
