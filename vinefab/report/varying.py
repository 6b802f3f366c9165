"""Sections on what predictions are sensitive to, and on robots that are not made exactly."""

from collections.abc import Sequence

from vinefab.model.effect import Effect, Tolerance
from vinefab.model.measure import Measure
from vinefab.report.content import Picture, Section, Table
from vinefab.report.figure import svg_bytes
from vinefab.report.spread_charts import effect_panels


def sensitivity_section(effects: Sequence[Effect], measures: Sequence[Measure]) -> Section:
    """Return what changes of start, lengths and model do.

    Parameters
    ----------
    effects
        In the order of their steps.
    measures
        What was measured; the first and the last are drawn.
    """
    drawn = (measures[0], measures[-1])
    count = max(effect.count for effect in effects)
    words = (
        f"Every change is tried from the same {count} poses as without it, and each deployment is "
        "compared with itself (simulated). Position: sideways to the heading, left is positive. "
        "Lengths: all branches alike. Head-on half-angle: on top of the angle assumed; the real "
        "one is not known, at most about 15 degrees."
    )
    rows = tuple(
        (effect.knob, effect.text, *_changes(effect, measures), str(effect.count))
        for effect in effects
    )
    table = Table(
        caption="Mean change, in square brackets its 95 % bootstrap interval over maps (poses "
        "where there is one map); an "
        "asterisk where the interval leaves out 0 (simulated)",
        headings=("changed", "by", *(m.label for m in measures), "poses"),
        rows=rows,
    )
    picture = Picture(
        image=svg_bytes(effect_panels(effects, drawn)),
        caption="Mean change with its 95 % interval (simulated).",
        wide=True,
    )
    return Section(title="Sensitivity", paragraphs=(words,), pictures=(picture,), tables=(table,))


def tolerance_section(tolerance: Tolerance) -> Section:
    """Return how robots of one design differ."""
    words = (
        f"{tolerance.robots} robots were drawn, every branch's length off by up to "
        f"{tolerance.length_percent:g} % and its angle by up to {tolerance.angle_deg:g} degrees, "
        f"uniformly and each on its own (assumed), and deployed from {tolerance.launches} poses "
        "each (simulated)."
    )
    rows = tuple(
        (
            scatter.measure.title,
            scatter.measure.unit,
            scatter.measure.number(scatter.exact),
            scatter.measure.number(scatter.p05),
            scatter.measure.number(scatter.p95),
            scatter.measure.number(scatter.typical),
        )
        for scatter in tolerance.scatter
    )
    table = Table(
        caption="Means over poses of the robot as designed and of robots as made (simulated)",
        headings=(
            "measure", "unit", "as designed", "5 % of robots", "95 % of robots",
            "one deployment, typically",
        ),
        rows=rows,
    )  # fmt: skip
    return Section(title="Tolerances of making", paragraphs=(words,), tables=(table,))


def _changes(effect: Effect, measures: Sequence[Measure]) -> list[str]:
    cells = []
    for measure in measures:
        change = effect.changes.get(measure.key)
        if change is None:
            cells.append("-")
            continue
        mean, low, high = (measure.number(v) for v in (change.mean, change.low, change.high))
        cells.append(f"{mean} [{low}, {high}]{'*' if change.is_clear else ''}")
    return cells
