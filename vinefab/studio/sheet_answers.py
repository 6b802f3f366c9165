"""Answers of the sheet's panel: every rule with its findings, and the change that clears them."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.progress import each
from vinefab.fabrication.checking import Deployed, checked_design, map_corridors
from vinefab.fabrication.package.bom import BomLine, bill_of_materials, joint_lines
from vinefab.fabrication.package.sheet_pictures import (
    SEVERITY_SIGNS,
    PlacedFinding,
    beds_svg,
    placed_findings,
    sheet_box_mm,
    sheet_svg,
)
from vinefab.fabrication.rules.catalog import RULES, by_rule, changed_limits
from vinefab.fabrication.rules.pressure_rules import WorstBranch, check_window, pressure_gauge
from vinefab.fabrication.rules.rule import Subject
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.inflation.pattern import pattern_of
from vinefab.model.design import design_content
from vinefab.model.finding import CheckReport, Finding, Severity
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map, Start
from vinefab.model.quantity import Standing
from vinefab.prediction.deploy import growth_on_maps
from vinefab.prediction.family_deployments import ScorePlan, score_design_on_task
from vinefab.prediction.fix_proposal import FIX_TASKS, propose_fix
from vinefab.search.fix_space import KEEPS, parsed_keeps
from vinefab.studio.pattern_answers import cut_notes
from vinefab.studio.state import PAGE, StudioState

_SHOWN = (
    "title", "severity", "message", "measured", "limit", "unit", "branches", "names", "fingerprint",
    "waived"
)  # fmt: skip
"""Values of a finding as they stand in its content."""

MOST_FINDINGS = 200
"""Most findings that are listed and marked, errors first; the others are counted."""


def rules_answer(state: StudioState, _: Mapping[str, Any]) -> dict[str, Any]:
    """Return the full check of the design on the page, with the sheet that it is about."""
    deployed, problem = deployed_on_page(state)
    corridors = () if state.world is None else (map_corridors(state.world, state.design),)
    subject, report = checked_design(
        state.design, state.profile, deployed=deployed, corridors=corridors
    )
    partition, job = subject.partition, subject.job
    count = 1 if partition is None else len(partition.pieces)
    words = counted(count, "piece")
    if partition is not None and partition.unparted:
        words = "1 piece: cannot be cut in pieces that lie flat"
    elif partition is not None and count > 1:
        words += ", no fewer possible" if partition.proven_least else ", fewer may be possible"
    pattern = subject.pattern
    if pattern is None:  # cut as it is: simulated where the table is silent
        pattern = pattern_of(state.design, state.profile, known_only=True)
        if not all(joint.is_known for joint in pattern.joints):
            pattern = pattern_of(state.design, state.profile)
    return {
        **report_content(report),
        **_sheet_content(subject, report),
        "pieces": count,
        "pieces_words": words,
        "sheets": (len(job.sheets) if job else 0) or 1,
        "tiles": len(job.tiles) if job else 0,
        "gauge": ShownGauge.of(subject, state.profile).content,
        "bill": [line.content for line in bill_lines(subject, state.profile)],
        "deployed": [name for name, _ in deployed],
        "deployed_problem": problem,
        "cut": cut_notes(pattern, state.profile),
    }


def deployed_on_page(state: StudioState) -> tuple[Deployed, str]:
    """Return the deployment on the open map from its start, or none and why there is none."""
    if state.world is None:
        return (), "no map is open: growth paths are checked in free space only"
    if state.start is None:
        return (), f"map {state.world.name} has no start: growth is checked in free space only"
    options = growth_on_maps(state.design, state.growth.values).options
    try:
        # One growth is done by the interpreter before the compiled kernel is even loaded.
        grown = grow_on(
            state.grown, terrain_of(state.world), state.start, options, engine="interpreted"
        )
    except BadInputError as error:
        return (), f"not grown on map {state.world.name}: {error}"
    return ((state.world.name, grown),), ""


@lru_cache(maxsize=4)
def terrain_of(world: Map) -> Terrain:
    """Return the terrain of a map, kept while the map is open."""
    return Terrain.of(world)


# --- What the rules say -------------------------------------------------------------------------


def report_content(report: CheckReport) -> dict[str, Any]:
    """Return a report's verdict and which rules it is about."""
    return {
        "verdict": report.verdict,
        "manufacturable": not report.blocking,
        "errors": report.count(Severity.ERROR),
        "warnings": report.count(Severity.WARNING),
        "notes": [{"rule": run.rule, "note": run.note} for run in report.run if run.note],
        "rules_run": len(report.run),
        "rules_skipped": [{"rule": one.rule, "reason": one.reason} for one in report.skipped],
        "stale_waivers": list(report.stale_waivers),
    }


def listed_findings(report: CheckReport) -> list[Finding]:
    """Return the findings to be listed: errors first, waived ones last."""
    ranks = list(Severity)
    order = sorted(report.findings, key=lambda one: (one.waived, ranks.index(one.severity)))
    return order[:MOST_FINDINGS]


def _sheet_content(subject: Subject, report: CheckReport) -> dict[str, Any]:
    """Return the drawing of the sheet and every finding with its place there."""
    findings, job = listed_findings(report), subject.job
    placed: Sequence[PlacedFinding] = [PlacedFinding(at_mm=None, marker="")] * len(findings)
    drawing: dict[str, Any] = {
        "sheet_svg": "",
        "beds_svg": "",
        "sheet_box": None,
        "placement": None,
    }
    if job is not None:
        placed = placed_findings(job, subject.layout, findings)
        x0, y0, x1, y1 = sheet_box_mm(job)
        placement = None
        if (to := job.transform) is not None:  # where pieces lie apart, the layout has no one place
            placement = {
                "rotation_deg": to.rotation_deg,
                "dx_mm": to.shift_x_mm,
                "dy_mm": to.shift_y_mm,
            }
        drawing = {
            "sheet_svg": sheet_svg(job, findings, placed),
            "beds_svg": beds_svg(job),
            "placement": placement,
            "sheet_box": [round(side, 2) for side in (x0, -y1, x1 - x0, y1 - y0)],
        }
    pairs = zip(findings, placed, strict=True)
    return {
        **drawing,
        "findings": [
            {
                **{name: finding.content[name] for name in _SHOWN},
                "rule": finding.rule,
                "reason": RULES[finding.rule].reason,
                "at_mm": None if place.at_mm is None else list(place.at_mm),
                "marker": place.marker,
                "waiver_reason": finding.reason,
            }
            for finding, place in pairs
        ],
        "signs": {str(severity): path for severity, path in SEVERITY_SIGNS.items()},
        "findings_left_out": len(report.findings) - len(findings),
    }


# --- Pressure -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownNeed:
    """The pressure that growth to the worst tip needs."""

    kpa: float
    branch: str
    place: str

    @classmethod
    def of(cls, subject: Subject, worst: WorstBranch) -> "ShownNeed":
        """Return the need of the worst branch."""
        (branch,) = subject.ids(worst.branch)
        return cls(kpa=worst.pressure_kpa, branch=branch, place=worst.place)


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownGauge(Record):
    """The pressure for growth, that of the widest part, and the working pressure."""

    needed_loose: ShownNeed
    needed_tight: ShownNeed
    needed_standing: str
    needed_basis: str
    working_kpa: float
    working_standing: str
    allowed_kpa: float
    allowed_standing: str
    allowed_basis: str
    is_open: bool
    is_open_tight: bool

    @classmethod
    def of(cls, subject: Subject, profile: LaserProfile) -> "ShownGauge":
        """Return the pressures of a subject."""
        changed = by_rule(changed_limits(subject.design, profile))
        limits = check_window.limits_under(changed)
        gauge = pressure_gauge(subject, profile, limits)
        seam = profile.material.seam
        paths = "simulated" if subject.deployments else "computed"
        constants = "measured" if gauge.growth_measured else "assumed"
        return cls(
            needed_loose=ShownNeed.of(subject, gauge.loose),
            needed_tight=ShownNeed.of(subject, gauge.tight),
            needed_standing=f"{paths}, constants {constants}",
            needed_basis=f"worst tip, film stored loosely to tightly; {gauge.source}",
            working_kpa=subject.design.build.pressure_kpa,
            working_standing="set in the design",
            allowed_kpa=gauge.safe_kpa,
            allowed_standing="measured" if gauge.seam_measured else "assumed",
            allowed_basis=f"{gauge.width_mm:.1f} mm of lay-flat width, safety factor "
            f"{limits['safety_factor']:g}; {seam.words()}",
            is_open=gauge.loose.pressure_kpa < gauge.safe_kpa,
            is_open_tight=gauge.tight.pressure_kpa < gauge.safe_kpa,
        )


# --- Film, time ---------------------------------------------------------------------------------


def bill_lines(subject: Subject, profile: LaserProfile) -> list[BomLine]:
    """Return every line of the bill of materials, and the film in the branches."""
    film = BomLine(
        item="film in branches",
        value=subject.layout.tree.total_length_mm,
        unit="mm",
        standing=Standing.COMPUTED,
        basis="planned lengths of all branches",
    )
    lines = [film]
    if subject.job is not None:
        lines += bill_of_materials(subject.job, profile)
        if subject.partition is not None:
            lines += joint_lines(subject.design, subject.partition, profile)
    return lines


_KEPT_BY = (
    (re.compile(r"level\.\d+\.branches"), "branches"),
    (
        re.compile(r"trunk\.length|branch\.\d+\.length|level\.\d+\.(length|growth_percent)"),
        "length",
    ),
    (re.compile(r"(level|branch)\.\d+\.angle_deg"), "angle"),
    (re.compile(r"build\.(widths_mm|taper|pouch|trunk_width_mm|width_ratio)(\..*)?"), "width"),
    (re.compile(r"branch\.\d+\.(width_mm|taper)"), "width"),
)
"""The words of `KEEPS` that keep locked values of a design, by the keys of these."""


def fix_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the smallest change found that clears the errors of the design on the page.

    Parameters
    ----------
    ask
        ``keep``: words of `KEEPS`, besides those that the page's locks ask for.
    """
    keep, words = kept_kinds(state.locks, ask.get("keep") or [])
    maps: tuple[Map, ...] = ()
    if state.world is not None and state.start is not None:  # the page's start is the only one
        maps = (replace(state.world, starts=(Start(pose=state.start),)),)
    proposal = propose_fix(
        state.design,
        state.profile,
        maps=maps,
        growth=state.growth.values,
        keep=keep,
    )
    content: dict[str, Any] = {
        "lines": [line.strip().removeprefix("fix: ") for line in proposal.lines()],
        "changes": [change.text for change in proposal.changes],
        "design": None,
        "keep": sorted(keep),
        "keep_words": words,
        "scores": [],
        "scores_note": "",
    }
    if proposal.design is None:
        return content
    # On the page it is the same design, changed: it keeps its name and its file.
    content["design"] = design_content(proposal.design.changed(name=state.design.name))
    before, after = design_content(state.design), content["design"]
    # Locked values that a proposal changes all the same: no word keeps them.
    locks = sorted(state.locks)
    content["locks_changed"] = [key for key in locks if _at(before, key) != _at(after, key)]
    if not maps:
        content["scores_note"] = "no map is open: what it costs in score is not known"
        return content
    for task in each("scores of the change", FIX_TASKS):
        old, new = (
            score_design_on_task(one, maps, ScorePlan(task=task, poses=1), state.growth)
            for one in (state.design, proposal.design)
        )
        content["scores"].append(
            {
                "task": new.title_of_task,
                "before": old.composite["mean"],
                "after": new.composite["mean"],
            }
        )
    note = f"simulated, on {maps[0].name} from its start: one pose, so no interval"
    content["scores_note"] = note
    return content


def kept_kinds(locks: frozenset[str], asked: object) -> tuple[frozenset[str], list[str]]:
    """Return the names of the values that a fix must keep, and a sentence for each lock.

    A fix keeps values of a kind or none of them: one that is locked keeps all of its kind.
    """
    if not isinstance(asked, list) or not all(isinstance(word, str) for word in asked):
        raise BadInputError("fix.keep", asked, f"a list of words: {', '.join(KEEPS)}", PAGE)
    keep, words = parsed_keeps(asked), list[str]()
    for lock in sorted(locks):
        word = next((word for pattern, word in _KEPT_BY if pattern.fullmatch(lock)), "")
        if word and word not in keep:
            keep |= {word}
            words.append(f"{lock} is locked: every {_ONE[word]} is kept")
    return keep, words


_ONE = {"branches": "number of branches", "length": "length", "angle": "angle", "width": "width"}


def _at(content: Any, key: str) -> Any:  # noqa: ANN401  plain values
    """Return a value by its dotted key; None where there is none."""
    for name in key.split("."):
        if isinstance(content, list):
            content = content[int(name)] if name.isdecimal() and int(name) < len(content) else None
        else:
            content = content.get(name) if isinstance(content, Mapping) else None
    return content
