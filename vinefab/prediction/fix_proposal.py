"""Propose the smallest change of a design that clears its errors, and say what it costs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from vinefab.fabrication.checking import Deployed, subject_of
from vinefab.fabrication.job.laser_job import MOST_BRANCHES
from vinefab.fabrication.rules.fix import FixedDesign, fix_design
from vinefab.fabrication.rules.fix_targets import DesignChange, FixTargets, design_changes
from vinefab.fabrication.rules.rule import LimitChanges
from vinefab.fabrication.rules.run_rules import run_checks
from vinefab.model.design import ORIGIN_GROWTH, Design
from vinefab.model.finding import CheckReport
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map

MARGINS = (0.005, 0.02, 0.05)
"""How much stricter than the check the search is, one after the other until the check passes."""

MOST_ROUNDS = 6
TASKS = ("coverage", "reach", "anchoring")
_WINDOW_RULE = "VF-P03"


@dataclass(frozen=True, slots=True, kw_only=True)
class FixProposal:
    """The outcome of a search for the smallest change."""

    before: CheckReport  # the check of the design as it was
    design: Design | None  # the changed design, None where nothing had to or could be fixed
    # its check; where no design is proposed, that of the nearest one found, or None
    after: CheckReport | None
    changes: tuple[DesignChange, ...] = ()  # what was changed

    @property
    def failed(self) -> bool:
        """Whether there are errors that no proposal clears."""
        return bool(self.before.blocking) and self.design is None

    def lines(self) -> list[str]:
        """Return the outcome in words."""
        if not self.before.blocking:
            return ["fix: no errors, nothing to fix"]
        if self.design is None:
            left = (self.after or self.before).blocking
            named = ", ".join(sorted({finding.rule for finding in left}))
            return [f"fix: no change of the design was found that clears {named}; nothing written"]
        cost = sum(change.cost for change in self.changes)
        cleared = f"{len(self.changes)} changes clear {_rules(self.before)}"
        summary = f"fix: {cleared}; weighted size {cost:.2f}"
        return [summary, *(f"  {change.text}" for change in self.changes)]


def propose_fix(
    design: Design,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    maps: Sequence[Map] = (),
    progress: Callable[[float], None] | None = None,
    growth: Mapping[str, object] | None = None,
) -> FixProposal:
    """Return the smallest change found that clears a design's errors.

    Parameters
    ----------
    design, profile, limits
        As for a check. Findings that the design waives do not have to be cleared, but the search
        does not know them apart.
    growth
        Growth options by name for the maps, in place of those that the design was trained with.
    """
    grown = partial(_deployed, maps=maps, growth=growth)

    before = run_checks(subject_of(design, profile, grown(design)), limits)
    if not before.blocking or design.branch_count > MOST_BRANCHES:
        return FixProposal(before=before, design=None, after=None)
    after: CheckReport | None = None
    for found, report in _rounds(design, profile, limits, grown, progress):
        after = report
        if not report.blocking:
            proposed = _named(design, found)
            return FixProposal(
                before=before,
                design=proposed,
                after=replace(report, design=proposed.name),
                changes=design_changes(design, found.design),
            )
    return FixProposal(before=before, design=None, after=after)


def _rounds(
    design: Design,
    profile: LaserProfile,
    limits: LimitChanges | None,
    grown: Callable[[Design], Deployed],
    progress: Callable[[float], None] | None,
) -> Iterator[tuple[FixedDesign, CheckReport]]:
    """Yield designs without trouble and their full checks, the search stricter every time."""
    margins, window_share = iter(MARGINS), 1.0
    margin = next(margins)
    for _ in range(MOST_ROUNDS):
        targets = FixTargets.of(design, profile, limits, margin=margin, window_share=window_share)
        found = fix_design(design, targets, progress)
        if found is None:
            return
        report = run_checks(subject_of(found.design, profile, grown(found.design)), limits)
        yield found, report
        share = _window_share(report)
        if share < 1.0:
            window_share *= 0.98 * share
        else:
            margin = next(margins, 0.0)
            if margin == 0.0:
                return


def _window_share(report: CheckReport) -> float:
    """Return how much of what growth takes on maps is allowed, 1 where that is no error."""
    for finding in report.blocking:
        if finding.rule == _WINDOW_RULE and finding.measured and finding.limit:
            return finding.limit / finding.measured
    return 1.0


def _named(design: Design, found: FixedDesign) -> Design:
    """Return a fixed design with a name and an origin of its own."""
    changes = [change.text for change in design_changes(design, found.design)]
    origin = {"mended_from": design.name, "changes": changes, "change": round(found.cost, 6)}
    trained = {key: design.origin[key] for key in (ORIGIN_GROWTH,) if key in design.origin}
    return replace(found.design, name=f"{design.name[:90]}_mended", origin={**origin, **trained})


def _rules(report: CheckReport) -> str:
    return ", ".join(sorted({finding.rule for finding in report.blocking}))


def score_change_lines(
    before: Design,
    after: Design,
    maps: Sequence[Map],
    growth: Mapping[str, object] | None = None,
) -> list[str]:
    """Return what a change does to the predicted scores, in words; nothing without maps."""
    if not maps:
        return []
    # The simulator and the tasks are loaded only when a map is given.
    from vinefab.growth.options import GrowthChoice, growth_text  # noqa: PLC0415
    from vinefab.prediction.scoring import ScorePlan, score_design_on_task  # noqa: PLC0415

    options = GrowthChoice.of([before], growth).options
    lines = [f"  scores of {growth_text(options, [before])}:"]
    for task in TASKS:
        old, new = (
            score_design_on_task(design, maps, ScorePlan(task=task), options).composite["mean"]
            for design in (before, after)
        )
        lines.append(f"  {task}, mean over {len(maps)} maps: {old:.4f} -> {new:.4f} (simulated)")
    return lines


def _deployed(design: Design, maps: Sequence[Map], growth: Mapping[str, object] | None) -> Deployed:
    """Deploy a design; without maps the simulator is not even imported."""
    if not maps:
        return ()
    from vinefab.prediction.deploy import deploy_from_starts  # noqa: PLC0415

    return deploy_from_starts(design, maps, growth)
