"""Propose the smallest change of a design that clears its errors, and state its cost."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.progress import each
from vinefab.core.statistics import PAIRED_TAILS, group_means, mean_interval
from vinefab.core.view import NO_INTERVAL, Block, Notes, Picture, Result
from vinefab.fabrication.checking import Deployed, subject_of
from vinefab.fabrication.job.laser_job import MOST_CUT_BRANCHES
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import LimitChanges
from vinefab.growth.options import GrowthChoice, growth_text
from vinefab.inflation.pattern import as_grown
from vinefab.model.design import Design
from vinefab.model.files.run_context import RunContext
from vinefab.model.finding import CheckReport, Finding
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map
from vinefab.prediction.deploy import deploy_from_starts
from vinefab.prediction.family_deployments import ScorePlan, score_design_on_task
from vinefab.search.fix import FixedDesign, fix_design, fix_in_step
from vinefab.search.fix_changes import DesignChange, design_changes
from vinefab.search.fix_space import BRANCHES, FixStage, fix_stages
from vinefab.search.fix_targets import FixTargets
from vinefab.search.fix_trees import MOST_FIXED_BRANCHES

MARGINS = (0.005, 0.02, 0.05, 0.15)
"""How much stricter than the check the search is, one after the other until the check passes. The
last outweighs the law of uneven joints, which is a degree or two off."""

LARGE_CHANGE = 1.0
"""Weighted size of a change from which on removing branches is worth a thought."""

FIX_TASKS = ("coverage", "reach", "anchoring")
_WINDOW_RULE, _FILM_RULE = "VF-P03", "VF-C01"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ProposedFix(Result):
    """The outcome of a search for the smallest change."""

    before: CheckReport  # the check of the design as it was
    design: Design | None  # the changed design, None where nothing had to or could be fixed
    # its check; where no design is proposed, that of the nearest one found, or None
    after: CheckReport | None
    changes: tuple[DesignChange, ...] = ()  # what was changed
    keep: frozenset[str] = frozenset()  # what was not to change, words of `KEEPS`
    # What of it stands in the way: a change was found without any one of these, or, where that is
    # not enough, without all of them.
    in_the_way: tuple[str, ...] = ()
    is_enough: bool = True  # whether any one of these is enough
    cost: tuple[str, ...] = ()  # what it costs in score, a line each

    @property
    def failed(self) -> bool:
        """Whether there are errors that no proposal clears."""
        return bool(self.before.blocking) and self.design is None

    @property
    def report(self) -> CheckReport:
        """The check of the changed design, of the nearest one found, or of the design itself."""
        return self.after or self.before

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 1 where errors are left."""
        return int(self.failed)

    def view(self) -> Iterator[Block]:
        """Yield the changed design, its changes and their cost."""
        if self.design is not None and (drawn := self.design._repr_svg_()):
            yield Picture(image=drawn.encode(), caption="The changed design, flat (computed).")
        verdict = [self.report.verdict] if self.design is not None else []
        before = self.before.summary if self.before.blocking else ()
        changes = (line.strip() for line in (*self.lines(), *self.cost))
        yield Notes((*before, *changes, *verdict))

    def json_text(self) -> str:
        """Return the check of the design as it was, as JSON: ``vinefab/checks-1``."""
        return self.before.json_text()

    def lines(self) -> list[str]:
        """Return the outcome as lines."""
        if not self.before.blocking:
            return ["fix: no errors, nothing to fix"]
        if self.design is None:
            named, words = _rules(self.report), _listed(sorted(self.keep), "and")
            kept = f" and keeps {words}" if words else ""
            lines = [
                f"fix: no change of the design was found that clears {named}{kept}; nothing written"
            ]
            if self.in_the_way:
                joint = "or" if self.is_enough else "and"
                without = _listed([f"--keep {word}" for word in self.in_the_way], joint)
                lines.append(f"  in the way: a change was found without {without}")
            return lines
        prunes = any(change.kind == BRANCHES for change in self.changes)
        branches = "nothing was found that keeps every branch" if prunes else "every branch stays"
        cost = sum(change.cost for change in self.changes)
        count = len(self.changes)
        what = "1 change clears" if count == 1 else f"{count} changes clear"
        cleared = f"{what} {_rules(self.before)}"
        summary = f"fix: {cleared}; weighted size {cost:.2f}; {branches}"
        lines = [summary, *(f"  {change.text}" for change in self.changes)]
        if cost > LARGE_CHANGE and not prunes and BRANCHES not in self.keep:
            lines.append("  that is a large change; fewer branches instead: --keep length,angle")
        return lines


def propose_fix(
    design: Design,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    maps: Sequence[Map] = (),
    *,
    growth: Mapping[str, object] | None = None,
    keep: frozenset[str] = frozenset(),
) -> ProposedFix:
    """Return the smallest change found that clears a design's errors.

    Fillets alone are tried first, then widths, tapers, lengths and angles, and fewer branches only
    if nothing else is found.

    Parameters
    ----------
    design, profile, limits
        As for a check. Findings that the design waives do not have to be cleared, but the search
        does not know them apart.
    growth
        Growth options by name for the maps, in place of those that the design was trained with.
    keep
        What must not change, words of `KEEPS`.
    """

    def grown(changed: Design) -> Deployed:
        return deploy_from_starts(as_grown(changed), maps, growth) if maps else ()

    before = run_checks(subject_of(design, profile, grown(design), limits), limits)
    if not before.blocking or design.branch_count > MOST_CUT_BRANCHES:
        return ProposedFix(before=before, design=None, after=None)
    if len(design.tree.bend_mm):  # bends are changed one by one, on levels too
        design = design.by_branches
    if design.branches is not None and design.branch_count > MOST_FIXED_BRANCHES:
        allowed = f"at most {MOST_FIXED_BRANCHES} where branches are changed one by one"
        raise BadInputError("design", counted(design.branch_count, "branch"), allowed)
    after: CheckReport | None = None

    def check(changed: Design) -> CheckReport:
        return run_checks(subject_of(changed, profile, grown(changed), limits), limits)

    rounds = _Rounds(design=design, profile=profile, limits=limits, check=check)
    for step in each("kinds of change", list(fix_stages(keep))):
        for found, report in rounds.of_step(step):
            after = report
            if not report.blocking:
                changes = design_changes(design, found.design)
                origin = {
                    "mended_from": design.name,
                    "changes": [change.text for change in changes],
                    "change": round(found.cost, 6),
                    **RunContext.of(design).kept,
                }
                name = f"{design.name[:90]}_mended"
                proposed = found.design.changed(name=name, origin=origin)
                return ProposedFix(
                    before=before,
                    design=proposed,
                    after=replace(report, design=proposed.name),
                    changes=changes,
                    keep=keep,
                )
    targets = FixTargets.of(design, profile, limits, margin=MARGINS[0])
    words, is_enough = _in_the_way(design, targets, keep)
    return ProposedFix(
        before=before, design=None, after=after,
        keep=keep, in_the_way=words, is_enough=is_enough,
    )  # fmt: skip


def _in_the_way(
    design: Design, targets: FixTargets, keep: frozenset[str]
) -> tuple[tuple[str, ...], bool]:
    """Return which words stand in the way of any change, and whether one less is enough."""
    words = sorted(keep)

    def found_without(word: str) -> bool:
        return fix_design(design, targets, keep=keep - {word}) is not None

    alone = tuple(word for word in words if found_without(word))
    if alone or len(words) < 2:
        return alone, True
    return (tuple(words) if fix_design(design, targets) is not None else ()), False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Rounds:
    """Searches for changes of one design, stricter where the full check does not pass."""

    design: Design
    profile: LaserProfile
    limits: LimitChanges | None
    check: Callable[[Design], CheckReport]  # of all rules
    _checked: list[tuple[Design, CheckReport]] = field(default_factory=list)

    def targets(self, margin: float, window_share: float = 1.0, film_mm: float = 0.0) -> FixTargets:
        """Return the targets of one round, as `FixTargets.of`."""
        return FixTargets.of(
            self.design, self.profile, self.limits,
            margin=margin, window_share=window_share, film_mm=film_mm,
        )  # fmt: skip

    def report(self, changed: Design) -> CheckReport:
        """Return the full check of a design; several stages may find the same one."""
        for known, report in self._checked:
            if known == changed:
                return report
        self._checked.append((changed, self.check(changed)))
        return self._checked[-1][1]

    def of_step(self, step: Sequence[FixStage]) -> Iterator[tuple[FixedDesign, CheckReport]]:
        """Yield designs without trouble and their full checks, over all stages by rising cost.

        A stage whose design does not pass is searched again, under stricter targets.
        """
        first = fix_in_step(self.design, self.targets(MARGINS[0]), step)
        again = {stage: self.of_stage(stage, found) for stage, found in first.items()}
        waiting = {stage: next(one) for stage, one in again.items()}
        while waiting:
            stage = min(waiting, key=lambda one: waiting[one].cost)
            found = waiting.pop(stage)
            yield found, self.report(found.design)
            if stricter := next(again[stage], None):
                waiting[stage] = stricter

    def of_stage(self, stage: FixStage, found: FixedDesign | None) -> Iterator[FixedDesign]:
        """Yield the designs of a stage, from the first one found, each for stricter targets."""
        margins, window_share, film_mm = iter(MARGINS), 1.0, 0.0
        margin = next(margins)
        most_rounds = 6
        for number in range(most_rounds):
            if number:
                targets = self.targets(margin, window_share, film_mm)
                found = fix_in_step(self.design, targets, (stage,)).get(stage)
            if found is None:
                return
            yield found
            # The share of the need of growth on maps that is allowed, 1 where that is not an error.
            blocking = self.report(found.design).blocking
            shares = (
                finding.limit / finding.measured
                for finding in blocking
                if finding.rule == _WINDOW_RULE and finding.measured and finding.limit
            )
            share = next(shares, 1.0)
            lacks_mm = _lacking_mm(blocking) if self.design.branches is not None else 0.0
            if share < 1.0:
                window_share *= 0.98 * share
            elif lacks_mm > 0.0:
                # The law of uneven joints is a degree off: at a far tip that is millimetres.
                film_mm += 1.1 * lacks_mm
            else:
                margin = next(margins, 0.0)
                if margin == 0.0:
                    return


def _lacking_mm(blocking: Sequence[Finding]) -> float:
    """Return how much film lacks between branches, mm."""
    return max(
        (
            finding.limit - finding.measured
            for finding in blocking
            if finding.rule == _FILM_RULE
            and finding.limit is not None
            and finding.measured is not None
        ),
        default=0.0,
    )


def _rules(report: CheckReport) -> str:
    return ", ".join(sorted({finding.rule for finding in report.blocking}))


def _listed(words: Sequence[str], joint: str) -> str:
    """Return words with commas between them, and another word before the last."""
    return f" {joint} ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def score_change_lines(
    before: Design,
    after: Design,
    maps: Sequence[Map],
    growth: Mapping[str, object] | None = None,
) -> list[str]:
    """Return the effect of a change on predicted scores as text; without maps, how to get it."""
    if not maps:
        return ["  what it costs in score: give maps with --map (vinefab map grid makes one)"]
    options = GrowthChoice.of([before], growth).options
    lines = [f"  scores of {growth_text(options, [before])}:"]
    for task in FIX_TASKS:
        old, new = (
            score_design_on_task(as_grown(design), maps, ScorePlan(task=task), options)
            for design in (before, after)
        )
        # The difference of two scores from the same poses.
        names = [evaluation.map_name for evaluation in old.evaluations]
        several = len(set(names)) > 1
        means = group_means(new.scores - old.scores, names if several else range(len(names)))
        low, high = mean_interval(means, tails=PAIRED_TAILS)
        pairs = counted(len(means), "map" if several else "pose")
        interval = f"95 % interval {low:+.4f} to {high:+.4f} over {pairs}"
        interval = f"{pairs}: {NO_INTERVAL}" if math.isnan(low) else interval
        scores = f"{old.composite['mean']:.4f} -> {new.composite['mean']:.4f}"
        where = f"mean over {counted(len(maps), 'map')}"
        known = f"(simulated; {means.mean():+.4f}, {interval})"
        lines.append(f"  {new.title_of_task}, {where}: {scores} {known}")
    return lines
