"""One version of a design that is being worked on: its numbers, and what changed since the last."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vinefab.core.plain_text import counted
from vinefab.fabrication.checking import (
    around_findings,
    checked_design,
    finding_line,
    findings_file,
    map_corridors,
    verdict,
)
from vinefab.fabrication.rules.catalog import by_rule, changed_limits
from vinefab.fabrication.rules.pressure_limits import WINDOW, PressureGauge, pressure_gauge
from vinefab.growth.options import GrowthChoice
from vinefab.model.design import Design
from vinefab.model.finding import CheckReport, Finding
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.prediction.deploy import DeployedDesign, deploy, deploy_from_starts
from vinefab.prediction.scoring import ScorePlan, score_design_on_task

GROWN_NAME = "grown.svg"
SHEET_NAME = "sheet.svg"


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignVersion:
    """What `grow`, `score` and `check` say of one version of a design on one map."""

    profile: LaserProfile
    deployed: DeployedDesign  # from the map's first start
    score: Score
    report: CheckReport
    gauge: PressureGauge

    @classmethod
    def of(
        cls,
        design: Design,
        world: Map,
        profile: LaserProfile,
        plan: ScorePlan,
        given: Mapping[str, object] | None = None,
    ) -> "DesignVersion":
        """Grow, score and check a design.

        Parameters
        ----------
        given
            Growth options by name, in place of those that the design was trained with.
        """
        options = GrowthChoice.of([design], given).options
        on_map = deploy_from_starts(design, [world], given)
        subject, report = checked_design(
            design, profile, deployed=on_map, corridors=(map_corridors(world, design),)
        )
        changed = by_rule(changed_limits(design, profile)).get(WINDOW.id, {})
        return cls(
            profile=profile,
            deployed=deploy(design, world, None, given),
            score=score_design_on_task(design, [world], plan, options),
            report=report,
            gauge=pressure_gauge(subject, profile, WINDOW.limits_with(changed)),
        )

    @property
    def design(self) -> Design:
        """The design of this version."""
        return self.deployed.design

    def lines(self, before: "DesignVersion | None" = None) -> list[str]:
        """Return the version for the user; beside another one, what differs from that."""
        rows = []
        others = self._rows() if before is None else before._rows()
        for (title, words), (_, other) in zip(self._rows(), others, strict=True):
            rows.append(f"  {title:9} {words}")
            if words != other:
                rows.append(f"  {'was':>9} {other}{self._change(title, before)}")
        return [*rows, *self._notes(before), *self._findings(before)]

    def pictures(self) -> dict[str, Callable[[], bytes]]:
        """Return what draws the pictures of this version, by the names of their files."""
        sheet = Path(SHEET_NAME)
        return {
            GROWN_NAME: lambda: self.deployed.picture(".svg"),
            SHEET_NAME: lambda: findings_file(self.design, self.profile, self.report, sheet),
        }

    def _rows(self) -> list[tuple[str, str]]:
        tree, grown_mm = self.deployed.deployment.tree, self.deployed.deployment.grown_mm
        stops = ", ".join(f"{count} {name}" for name, count in self.deployed.stops.items() if count)
        mean = self.score.composite["mean"]
        count = len(self.score.evaluations)
        evaluations = counted(count, "evaluation")
        return [
            (
                "grown",
                f"{grown_mm.sum():.1f} of {tree.total_length_mm:.1f} mm, "
                f"{counted(len(tree), 'branch')}: "
                f"{stops} (simulated)",
            ),
            (self.score.task, f"{mean:.4f} mean of {evaluations} (simulated)"),
            ("pressure", self._pressure()),
            ("rules", verdict(self.report).partition(": ")[2]),
        ]

    def _pressure(self) -> str:
        gauge = self.gauge
        constants = "measured" if gauge.growth_measured else "assumed"
        seam = "measured" if gauge.seam_measured else "assumed"
        return (
            f"growth takes {gauge.loose.pressure_kpa:.1f} to {gauge.tight.pressure_kpa:.1f} kPa "
            f"(simulated, constants {constants}), the seam bears {gauge.safe_kpa:.1f} kPa "
            f"({seam}), set are {self.design.build.pressure_kpa:g} kPa"
        )

    def _notes(self, before: "DesignVersion | None") -> list[str]:
        known = () if before is None else before._all_notes()
        return [f"  note      {note}" for note in self._all_notes() if note not in known]

    def _all_notes(self) -> tuple[str, ...]:
        return (*self.deployed.notes, *self.score.notes)

    def _change(self, title: str, before: "DesignVersion | None") -> str:
        """Return the difference of scores; nothing for what is no score, or of another task."""
        if before is None or title != self.score.task or title != before.score.task:
            return ""
        return f": {self.score.composite['mean'] - before.score.composite['mean']:+.4f}"

    def _findings(self, before: "DesignVersion | None") -> list[str]:
        here, about = self.report.findings, _about_rules(self.report)
        if before is None:
            return [f"    {line}" for line in (*map(finding_line, here), *about)]
        there, other = before.report.findings, _about_rules(before.report)
        came = [finding_line(finding) for finding in _others(here, there)]
        went = [finding_line(finding) for finding in _others(there, here)]
        came += [line for line in about if line not in other]
        went += [line for line in other if line not in about]
        return [*(f"  + {line}" for line in came), *(f"  - {line}" for line in went)]


def _about_rules(report: CheckReport) -> list[str]:
    """Return what a check says beside its findings: notes, limits, and what was skipped and why."""
    return around_findings(report)


def _others(findings: Sequence[Finding], known: Sequence[Finding]) -> list[Finding]:
    """Return the findings that are not among others; one that is waived now is another."""
    names = {(finding.fingerprint, finding.severity, finding.waived) for finding in known}
    return [f for f in findings if (f.fingerprint, f.severity, f.waived) not in names]
