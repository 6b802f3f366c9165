"""The page and the picture of where to put a robot's base."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes

from vinefab.core.plain_text import counted
from vinefab.core.units import deg
from vinefab.growth.options import growth_text
from vinefab.model.map import Map
from vinefab.model.tree import branch_tree
from vinefab.pages.charts import frame
from vinefab.pages.colours import ALERT, HEAT_COLOURS, INK, LEVEL_COLOURS, SOFT
from vinefab.pages.drawing import draw_deployment, draw_legend, draw_map, draw_pose, draw_targets
from vinefab.pages.figure import blank, house_style, plan_axes, png_bytes, svg_bytes
from vinefab.pages.html import Headline, Picture, Report, Section, Table, page_html
from vinefab.prediction.aiming import (
    FRESH_DRAWS,
    PROFILE_DRAWS,
    SHOWN_DEPLOYMENTS,
    AimedRobot,
    AimResult,
    paired_gain,
    pose_of,
)
from vinefab.prediction.deploy import pose_text
from vinefab.prediction.provenance import Origin, repeat_section
from vinefab.prediction.robot_set import GREEDY_SHARE, RobotSet, union_curve
from vinefab.tasks.covered_cells import BodyCover, TargetCover, TipCover
from vinefab.tasks.reach import Reach

_HEAT = LinearSegmentedColormap.from_list("expected score", HEAT_COLOURS)

PLAN_IN = 5.0
"""Longer side of a plan, inches."""

MOST_ARROWS = 150

ARROWS_APART = 0.035
"""Arrows stand this far apart, as a share of the map's longer side."""


def aim_document(found: AimResult, origin: Origin, suffix: str, notes: Sequence[str] = ()) -> bytes:
    """Return the result as a page (``.html``) or as one picture (``.svg``, ``.png``)."""
    kind = suffix.lower()
    if kind == ".html":
        return aim_page(found, origin, notes).encode()
    figure = aim_sheet(found)
    return png_bytes(figure) if kind == ".png" else svg_bytes(figure)


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


# --- The page -------------------------------------------------------------------------------------


def aim_page(found: AimResult, origin: Origin, notes: Sequence[str] = ()) -> str:
    """Return the result as a page."""
    first = found.first
    low, high = first.best.interval
    verdict = (
        f"Put the base of {first.name} at {pose_text(found.pose)}: expected {found.task.name} "
        f"score {first.best.mean:.3f} [{low:.3f}, {high:.3f}] (simulated)."
    )
    sections = [_landscape_section(found), _best_section(found)]
    if first.team is not None:
        sections.append(_team_section(found))
    sections += [
        _method_section(found),
        repeat_section(origin.command, origin.inputs, origin.versions),
    ]
    return page_html(
        Report(
            title=f"Where to put {first.name} on {found.world.name}",
            verdict=verdict,
            tone="good",
            cautions=tuple(f"{n[:1].upper()}{n[1:]}." for n in (*notes, *found.notes)),
            facts=_facts(found),
            headlines=_headlines(found),
            sections=tuple(sections),
        )
    )


def _facts(found: AimResult) -> tuple[tuple[str, str], ...]:
    plan = found.plan
    return (
        *(
            (
                robot.name,
                f"{robot.design.branch_count} "
                f"branch{'' if robot.design.branch_count == 1 else 'es'}, "
                f"{branch_tree(robot.design).total_length_mm:.0f} mm in all",
            )
            for robot in found.robots
        ),
        ("bases", found.first.search.words),
        ("placing", f"within {plan.placing_mm:g} mm and {plan.placing_deg:g} deg (assumed)"),
        ("growth model", growth_text(plan.options, [robot.design for robot in found.robots])),
    )


def _headlines(found: AimResult) -> tuple[Headline, ...]:
    first = found.first
    shown = [
        Headline(
            name="expected score",
            value=f"{first.best.mean:.3f}",
            detail=f"95 % interval {_range(first.best.interval)}, {FRESH_DRAWS} fresh deployments "
            "(simulated)",
        ),
        Headline(
            name="worst tenth",
            value=f"{first.best.worst_tenth:.3f}",
            detail="mean of the worst tenth of these (simulated)",
        ),
    ]
    if first.gain is not None and first.start is not None:
        shown.append(_gain_headline(f"over the map's start ({first.start.mean:.3f})", first.gain))
    for other in found.robots[1:]:
        gain = paired_gain(first.best, other.best)
        shown.append(_gain_headline(f"over {other.name} ({other.best.mean:.3f})", gain))
    return tuple(shown)


def _gain_headline(name: str, gain: tuple[float, float, float]) -> Headline:
    mean, low, high = gain
    return Headline(
        name=name,
        value=f"{mean:+.3f}",
        detail=f"95 % interval {_range((low, high), '+.3f')}, paired (simulated)",
        tone="good" if low > 0.0 else "caution",
    )


def _range(ends: tuple[float, float], form: str = ".3f") -> str:
    return f"[{ends[0]:{form}}, {ends[1]:{form}}]"


def _landscape_section(found: AimResult) -> Section:
    pictures = []
    for robot in found.robots:
        landscape = robot.search.landscape
        with house_style():
            figure, axes = plan_axes(found.world.bounds.bounds, PLAN_IN)
            draw_landscape(axes, found, robot)
            bar = figure.colorbar(
                ScalarMappable(norm=score_scale(found), cmap=_HEAT), ax=axes, shrink=0.8, pad=0.02
            )
            bar.set_label(_score_words(found))
            bar.outline.set_visible(False)
        caption = (
            f"{robot.name}: expected score of {counted(int(landscape.known.sum()), 'place')}, "
            "each at the "
            f"best of its headings (arrows), {counted(landscape.draws, 'deployment')} at each "
            "pose: a first "
            f"look that favours luck. Ring: the best robust pose, {pose_text(robot.best.pose)} "
            "(simulated)."
        )
        pictures.append(Picture(image=svg_bytes(figure), caption=caption))
    with house_style():
        figure = Figure(figsize=(4.6, 4.6), layout="constrained")
        draw_turned(figure.add_subplot(projection="polar"), found.robots)  # type: ignore[arg-type]
    pictures.append(
        Picture(
            image=svg_bytes(figure),
            caption=f"Score over the heading at each best place: mean of {PROFILE_DRAWS} "
            "deployments, and from the worst to the best tenth; dotted: the best heading "
            "(simulated).",
        )
    )
    return Section(title="Where to put the base", pictures=tuple(pictures))


def _best_section(found: AimResult) -> Section:
    rows = list[tuple[str, ...]]()
    for robot in found.robots:
        estimates = [("best robust pose", robot.best)]
        if robot.start is not None:
            estimates.append(("the map's start", robot.start))
        rows += [
            (
                robot.name,
                name,
                pose_text(estimate.pose),
                f"{estimate.mean:.4f}",
                _range(estimate.interval, ".4f"),
                f"{estimate.worst_tenth:.4f}",
            )
            for name, estimate in estimates
        ]
    table = Table(
        caption=f"Expected {found.task.name} score, {FRESH_DRAWS} fresh deployments at each pose, "
        "the same contacts and placing errors for all (simulated)",
        headings=("design", "from", "X,Y,DEG", "mean", "95 % interval", "worst tenth"),
        rows=tuple(rows),
    )
    pictures = []
    for robot in found.robots:
        with house_style():
            figure, axes = plan_axes(found.world.bounds.bounds, PLAN_IN)
            draw_best_deployments(axes, found, robot)
            draw_legend(axes)
        caption = (
            f"{robot.name} from {pose_text(robot.best.pose)}: "
            f"{counted(len(robot.shown), 'deployment')} with "
            "contacts and placing errors, one of them in full (simulated)."
        )
        pictures.append(Picture(image=svg_bytes(figure), caption=caption))
    return Section(title="From the best pose", tables=(table,), pictures=tuple(pictures))


def _team_section(found: AimResult) -> Section:
    pictures, rows, words = list[Picture](), list[tuple[str, ...]](), list[str]()
    for robot in found.robots:
        team = robot.team
        if team is None:
            continue
        with house_style():
            figure, axes = plan_axes(found.world.bounds.bounds, PLAN_IN)
            draw_team(axes, found, team)
        pictures.append(
            Picture(
                image=svg_bytes(figure),
                caption=f"{robot.name}: {team.cover.words}; each robot's colour where it is the "
                "first to cover, at one fresh draw (simulated).",
            )
        )
        for count, mean, low, high, bound in union_curve(team):
            rows.append(
                (
                    robot.name,
                    f"{count}",
                    pose_text(pose_of(team.poses[count - 1])),
                    f"{100 * mean:.1f} %",
                    _range((100 * low, 100 * high), ".1f"),
                    f"{100 * team.choice.covered[count - 1]:.1f} %",
                    f"{100 * bound:.1f} %",
                )
            )
        words.append(
            f"The {len(team.poses)} poses of {robot.name} were chosen one after the other among "
            f"{team.candidates:,}, each for what it adds. Whatever the map, such a choice covers "
            f"at least {100 * GREEDY_SHARE:.0f} % (1 - 1/e) of what the best "
            f"{len(team.poses)} of these poses cover; by this case's own bound (the covered share "
            f"plus the largest gains that are left) at least {team.least_percent:.1f} %."
        )
    with house_style():
        figure, axes = blank(6.0, 3.2)
        draw_union_curve(axes, found.robots)
    pictures.append(
        Picture(
            image=svg_bytes(figure),
            caption="Covered share over the number of robots: mean and 95 % interval at fresh "
            "draws; dashed: what no set of as many candidates can exceed at the draws of the "
            "search (simulated).",
        )
    )
    table = Table(
        caption="Robots that together cover most (simulated)",
        headings=(
            "design", "robots", "the last at X,Y,DEG", "covered together", "95 % interval",
            "in the search", "no set beats",
        ),
        rows=tuple(rows),
    )  # fmt: skip
    return Section(
        title="Several robots",
        paragraphs=tuple(words),
        tables=(table,),
        pictures=tuple(pictures),
    )


def _method_section(found: AimResult) -> Section:
    plan, first = found.plan, found.first
    low, high = (f"{deg(angle):g}" for angle in plan.options.half_angle_range_rad)
    words = (
        f"{first.search.deployments:,} deployments of {first.name} were simulated for the search: "
        "all over the region at first, then at the best poses there, then around the best of "
        "these, with the same contacts and placing errors at every pose, so that poses are "
        f"compared pair by pair. Head-on half-angles are even from {low} to {high} deg "
        f"({plan.options.contact_angles_standing}), bases are even within "
        f"{plan.placing_mm:g} mm of their place and {plan.placing_deg:g} deg of their heading "
        "(assumed).",
        "The best of many estimates looks better than it is. So the scores that are reported come "
        f"from {FRESH_DRAWS} draws that the search has not seen: it had estimated "
        f"{first.search.estimate:.4f} for the best pose of {first.name}, fresh draws give "
        f"{first.best.mean:.4f}.",
    )
    return Section(title="How it was found", paragraphs=words)
