"""What a report says first: the verdict, what stands against it, the numbers to take away."""

from collections.abc import Sequence

from vinefab.fabrication.package.prepare import Prepared
from vinefab.model.finding import CheckReport, Severity
from vinefab.model.laser import RecipeStatus, Standing
from vinefab.pages.html import Headline, Tone
from vinefab.physics.anchoring import ASSUMED_FRICTION
from vinefab.prediction.anchoring_prediction import AnchoringPrediction
from vinefab.prediction.measures import (
    COVERAGE,
    REACH,
    SEEN,
    STUCK,
    UNDEPLOYED,
    Measure,
    MeasureTable,
)
from vinefab.prediction.pressure_window import PressureWindow

MANY_PERCENT = 10.0
"""From so many stuck or missing branches on, the summary says so."""


FEW_MAPS = 10
"""With fewer maps, bootstrap intervals are too narrow to be trusted."""


def verdict_on(report: CheckReport, window: PressureWindow | None) -> tuple[str, Tone]:
    """Return in one sentence whether a robot can be made and deployed, and how good that is."""
    name = report.design
    if report.blocking:
        broken = ", ".join(sorted({finding.rule for finding in report.blocking}))
        return f"{name} cannot be made and deployed as it is: {broken} forbid it.", "bad"
    if window is None:
        return f"{name} can be made, but has no room to emerge from any of the poses.", "bad"
    if not window.is_open:
        return (
            f"{name} can be made, but hardly deployed: growth to the worst tip needs "
            f"{window.needed_kpa:.1f} kPa even with film stored loosely, and its widest part may "
            f"take {window.allowed_kpa:.1f} kPa.",
            "bad",
        )
    room = f"{window.needed_kpa:.1f} to {window.allowed_kpa:.1f} kPa"
    if not window.holds_working:
        return (
            f"{name} can be made, and deployed at {room}; its working pressure of "
            f"{window.working_kpa:g} kPa is not within that.",
            "caution",
        )
    tone: Tone = "good" if window.is_open_tight else "caution"
    return f"{name} can be made, and deployed at {room} with film stored loosely.", tone


def cautions(
    prepared: Prepared, window: PressureWindow | None, outcomes: MeasureTable
) -> tuple[str, ...]:
    """Return what stands between the verdict and blind trust, a sentence each."""
    said = []
    warnings = prepared.report.count(Severity.WARNING)
    skipped = len(prepared.report.skipped)
    if prepared.profile.recipe.status is RecipeStatus.UNVERIFIED:
        said.append("No coupon has confirmed the laser recipe: cut and burst one first.")
    said += _about_pressure(window) if window else []
    for measure in (STUCK, UNDEPLOYED):
        spread = outcomes.spread(measure)
        if spread is not None and spread.mean >= MANY_PERCENT:
            said.append(f"{measure.text(spread.mean)} of its branches: {measure.title}.")
    if outcomes.map_count < FEW_MAPS:
        said.append(
            f"Predictions rest on {outcomes.map_count} maps: intervals are too narrow; "
            "--environment deploys it on many more."
        )
    if warnings or skipped:
        said.append(f"Design rules: {warnings} warnings, {skipped} rules could not look.")
    return tuple(said)


def _about_pressure(window: PressureWindow) -> list[str]:
    said = []
    if window.is_open and not window.is_open_tight:
        said.append(
            f"Store the film loosely: off a tight spool growth needs {window.tight.p95_kpa:.1f} "
            f"kPa, more than the {window.allowed_kpa:.1f} kPa that the widest part may take."
        )
    if window.standing is Standing.ASSUMED:
        said.append(
            "Pressures rest on assumed numbers: the width of the burst test, the diameter of the "
            "tube that growth was fitted to."
        )
    return said


def headlines(
    outcomes: MeasureTable, window: PressureWindow | None, holdings: Sequence[AnchoringPrediction]
) -> tuple[Headline, ...]:
    """Return the numbers to take away."""
    found = [_measured(outcomes, measure) for measure in (SEEN, REACH, COVERAGE)]
    found += [_measured(outcomes, measure, MANY_PERCENT) for measure in (STUCK, UNDEPLOYED)]
    holding = next(h for h in holdings if h.label == outcomes.label)
    found.append(_anchored(holding))
    if window is not None:
        found.append(_pressed(window))
    return tuple(headline for headline in found if headline is not None)


def _measured(
    outcomes: MeasureTable, measure: Measure, most: float | None = None
) -> Headline | None:
    spread = outcomes.spread(measure)
    if spread is None:
        return None
    low, high, p05, p95 = (
        measure.number(value) for value in (spread.low, spread.high, spread.p05, spread.p95)
    )
    return Headline(
        name=measure.title,
        value=measure.text(spread.mean),
        detail=f"mean over {outcomes.label}, 95 % interval {low} to {high}; 90 % of the "
        f"deployments {p05} to {p95} (simulated)",
        tone="caution" if most is not None and spread.mean >= most else "good",
    )


def _anchored(holding: AnchoringPrediction) -> Headline:
    least = min(held.amplification for held in holding.table if held.engaged_percent > 50.0)
    most = max(held.amplification for held in holding.table)
    usual = holding.at(ASSUMED_FRICTION.value, 100.0)
    return Headline(
        name="anchoring amplification",
        value=f"{least:.1f} to {most:.1f} x",
        detail=f"{usual:.1f} x at friction {ASSUMED_FRICTION.value:g} (assumed) with all leaves "
        "engaged; from two thirds of them at low friction to all at high friction (simulated)",
    )


def _pressed(window: PressureWindow) -> Headline:
    room = f"{window.needed_kpa:.1f} to {window.allowed_kpa:.1f} kPa"
    return Headline(
        name="pressure window",
        value=room if window.is_open else "none",
        detail=f"growth of 95 % of the deployments, film stored loosely, to what the widest part "
        f"may take; working pressure {window.working_kpa:g} kPa (computed from assumed numbers)",
        tone="good" if window.is_open and window.holds_working else "bad",
    )
