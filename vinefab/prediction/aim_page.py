"""The page and the picture of where to put a robot's base."""

from collections.abc import Sequence

from vinefab.core.plain_text import counted
from vinefab.core.units import deg
from vinefab.growth.options import growth_text
from vinefab.model.tree import branch_tree
from vinefab.pages.html import Headline, Picture, Report, Section, Table, page_html
from vinefab.pages.page_svg import page_svg
from vinefab.pages.panel import page_of
from vinefab.pages.plan import page_bytes
from vinefab.prediction.aim_pictures import (
    aim_sheet,
    best_deployments_panel,
    landscape_panel,
    team_panel,
    turned_panel,
    union_panel,
)
from vinefab.prediction.aiming import (
    FRESH_DRAWS,
    PROFILE_DRAWS,
    AimResult,
    paired_gain,
    pose_of,
)
from vinefab.prediction.deploy import pose_text
from vinefab.prediction.provenance import Origin, repeat_section
from vinefab.prediction.robot_set import GREEDY_SHARE, union_curve


def aim_document(found: AimResult, origin: Origin, suffix: str, notes: Sequence[str] = ()) -> bytes:
    """Return the result as a page (``.html``) or as one picture (``.svg``, ``.png``)."""
    kind = suffix.lower()
    if kind == ".html":
        return aim_page(found, origin, notes).encode()
    return page_bytes(aim_sheet(found), kind)


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
        image = page_svg(page_of(landscape_panel(found, robot)))
        caption = (
            f"{robot.name}: expected score of {counted(int(landscape.known.sum()), 'place')}, "
            "each at the "
            f"best of its headings (arrows), {counted(landscape.draws, 'deployment')} at each "
            "pose: a first "
            f"look that favours luck. Ring: the best robust pose, {pose_text(robot.best.pose)} "
            "(simulated)."
        )
        pictures.append(Picture(image=image, caption=caption))
    pictures.append(
        Picture(
            image=page_svg(page_of(turned_panel(found.robots))),
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
        image = page_svg(page_of(best_deployments_panel(found, robot)))
        caption = (
            f"{robot.name} from {pose_text(robot.best.pose)}: "
            f"{counted(len(robot.shown), 'deployment')} with "
            "contacts and placing errors, one of them in full (simulated)."
        )
        pictures.append(Picture(image=image, caption=caption))
    return Section(title="From the best pose", tables=(table,), pictures=tuple(pictures))


def _team_section(found: AimResult) -> Section:
    pictures, rows, words = list[Picture](), list[tuple[str, ...]](), list[str]()
    for robot in found.robots:
        team = robot.team
        if team is None:
            continue
        pictures.append(
            Picture(
                image=page_svg(page_of(team_panel(found, team))),
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
    pictures.append(
        Picture(
            image=page_svg(page_of(union_panel(found.robots))),
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
