"""Sections of a report: what a design is expected to do, pressure, anchoring, sensitivity."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from vinefab.core.units import deg
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.pages.drawing import deployment_plan
from vinefab.pages.figure import png_bytes, svg_bytes
from vinefab.pages.html import Picture, Section, Table
from vinefab.physics.anchoring import payload_over_mass
from vinefab.prediction.anchoring_prediction import AnchoringPrediction, Forces
from vinefab.prediction.heat_map import HeatMap
from vinefab.prediction.measures import MEASURES, Measure, MeasureTable, Spread
from vinefab.prediction.pressure_window import PressureWindow
from vinefab.prediction.sensitivity import Effect, Tolerance
from vinefab.prediction.spread_charts import effect_panels, heat_plan, spread_chart, window_chart

TOO_FINE = 400
"""Robots of more branches are drawn as pixels: as lines they would take megabytes."""

_NUMBER_HEADINGS = (
    "mean [95 % interval]", "deviation", "5 %", "median", "95 %", "least", "greatest",
)  # fmt: skip


def spread_section(fields: Sequence[MeasureTable]) -> Section:
    """Return how every measure is spread over deployments, as charts and numbers."""
    shown = [measure for measure in MEASURES if any(f.spread(measure) for f in fields)]
    pictures = tuple(
        Picture(
            image=svg_bytes(
                spread_chart(m, {f.label: f.values[m.key] for f in fields if f.spread(m)})
            ),
            caption=f"{_capital(m.title)}: {m.meaning} (simulated).",
        )
        for m in shown
    )
    tables = [_spread_table(outcomes, shown) for outcomes in fields]
    words = (
        "Line: mean. Bar below: from the 5th to the 95th percentile of the deployments. A mean's "
        "95 % interval is a bootstrap over maps, because deployments on one map are alike (over "
        "poses where there is one map); the table has it. With fewer than ten maps it is too "
        "narrow."
    )
    counts = "; ".join(f"{outcomes.label}: {len(outcomes)} deployments" for outcomes in fields)
    return Section(
        title="Predictions",
        paragraphs=(f"{_capital(counts)} (simulated). {words}",),
        pictures=pictures,
        tables=(*tables, *(_every_deployment(outcomes, shown) for outcomes in fields)),
    )


def deployment_section(
    design: Design,
    deployed: Sequence[tuple[str, Map, Deployment]],
    ended: Sequence[tuple[str, Sequence[Deployment]]],
    rules: str,
) -> Section:
    """Return pictures of deployments, and how all branches ended."""
    fine = design.branch_count > TOO_FINE
    pictures = []
    for words, world, deployment in deployed:
        figure = deployment_plan(world, deployment, design.build.widths_mm, longest_in=4.6)
        image = png_bytes(figure, dpi=130) if fine else svg_bytes(figure)
        pictures.append(Picture(image=image, caption=f"{words} (simulated)."))
    return Section(
        title="Deployments",
        paragraphs=(
            f"Growth model: {rules}. Planar and supported; branches do not push on each other. "
            "Bodies are drawn as wide as they inflate.",
        ),
        pictures=tuple(pictures),
        tables=tuple(_stop_table(label, deployments) for label, deployments in ended),
    )


def heat_section(heat: HeatMap) -> Section:
    """Return where robots go on one map, and where they get stuck."""
    often, ever = heat.percent_passed(0.5), heat.percent_passed()
    words = (
        f"{heat.deployments} deployments on {heat.world.name}, poses drawn {heat.spread} (uniform; "
        f"simulated). Some body covers {ever:.1f} % of the free space; more than half of the "
        f"deployments cover {often:.1f} %. The raster's cells are {heat.cell_mm:.2f} mm."
    )
    rows = tuple(
        (str(number), f"{spot.x_mm:.1f}", f"{spot.y_mm:.1f}", f"{spot.percent:.1f}")
        for number, spot in enumerate(heat.spots, start=1)
    )
    table = Table(
        caption="Where branches stop head-on or in a corner most often (simulated)",
        headings=("place", "x mm", "y mm", "% of deployments"),
        rows=rows,
    )
    nowhere = "No branch got stuck on this map." if not rows else ""
    return Section(
        title="Where it goes and where it gets stuck",
        paragraphs=(words, nowhere) if nowhere else (words,),
        pictures=(
            Picture(
                image=svg_bytes(heat_plan(heat)),
                caption=f"{heat.world.name}: share of the deployments whose body passes each "
                "place, and rings where branches get stuck, numbered as in the table (simulated).",
                wide=True,
            ),
        ),
        tables=(table,) if rows else (),
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _spread_table(outcomes: MeasureTable, measures: Sequence[Measure]) -> Table:
    rows = []
    for measure in measures:
        spread = outcomes.spread(measure)
        if spread is not None:
            mean, low, high, *numbers = (
                measure.number(getattr(spread, name)) for name in Spread.NUMBERS
            )
            mean = f"{mean} [{low}, {high}]"
            rows.append((measure.label, mean, *numbers, str(spread.count)))
    return Table(
        caption=f"{_capital(outcomes.label)} (simulated)",
        headings=("measure", *_NUMBER_HEADINGS, "count"),
        rows=tuple(rows),
    )


def _every_deployment(outcomes: MeasureTable, measures: Sequence[Measure]) -> Table:
    rows = tuple(
        (
            name,
            f"{pose.x_mm:.2f}",
            f"{pose.y_mm:.2f}",
            f"{deg(pose.heading_rad):.2f}",
            *(measure.number(outcomes.values[measure.key][index]) for measure in measures),
        )
        for index, (name, pose) in enumerate(zip(outcomes.maps, outcomes.poses, strict=True))
    )
    return Table(
        caption=f"Every deployment on {outcomes.label}",
        headings=("map", "x mm", "y mm", "heading deg", *(m.label for m in measures)),
        rows=rows,
        folded=True,
    )


def _stop_table(label: str, deployments: Sequence[Deployment]) -> Table:
    levels: dict[int, Counter[int]] = {}
    shares: dict[int, list[float]] = {}
    for deployment in deployments:
        tree = deployment.tree
        part = 100.0 * deployment.grown_mm / tree.length_mm
        for level, stop, grown in zip(
            tree.level.tolist(), deployment.stop.tolist(), part.tolist(), strict=True
        ):
            levels.setdefault(level, Counter())[stop] += 1
            if stop in (Stop.HEAD_ON, Stop.CORNER):
                shares.setdefault(level, []).append(grown)
    rows = tuple(
        (
            str(level),
            *(f"{100 * counts[stop] / counts.total():.1f} %" for stop in Stop),
            f"{np.median(shares[level]):.0f} %" if level in shares else "-",
        )
        for level, counts in sorted(levels.items())
    )
    total = sum(len(deployment.tree) for deployment in deployments)
    return Table(
        caption=f"{_capital(label)}: how {total} branches of {len(deployments)} deployments ended "
        "(simulated)",
        headings=(
            "level", "grown in full", "head-on", "in a corner", "never emerged",
            "grown when stuck (median)",
        ),
        rows=rows,
    )  # fmt: skip


WORDS = (
    "Force of all leaf pouches over that of one pouch without any turn: the sum of e^(mu gamma) "
    "over the leaves that hold, gamma the turn at contacts and hinges on the way (equations 1 and "
    "2 of the paper). Which leaves hold is not known beforehand: of six branches in the paper's "
    "test one touched nothing and one hung slack. The friction of film on the obstacles is "
    "assumed, 0.2 to 0.8; measure yours."
)


def anchoring_section(holdings: Sequence[AnchoringPrediction]) -> Section:
    """Return anchoring amplification by friction and engaged leaves, and forces where known."""
    tables = [_table(holding) for holding in holdings]
    tables += [_forces(holding.label, holding.forces) for holding in holdings if holding.forces]
    without = () if holdings[0].forces else (
        "The design has no pouches, so nothing can be said in newtons.",
    )  # fmt: skip
    return Section(title="Anchoring", paragraphs=(WORDS, *without), tables=tuple(tables))


def _table(holding: AnchoringPrediction) -> Table:
    frictions = sorted({held.friction for held in holding.table})
    shares = sorted({held.engaged_percent for held in holding.table}, reverse=True)
    rows = tuple(
        (
            f"{share:g} % of the leaves hold",
            *(f"{holding.at(friction, share):.2f}" for friction in frictions),
        )
        for share in shares
    )
    return Table(
        caption=f"Mean amplification on {holding.label}, {holding.leaves} leaves, those that "
        "turned least hold first (simulated paths, assumed friction)",
        headings=("engaged", *(f"friction {friction:g}" for friction in frictions)),
        rows=rows,
    )


def _forces(label: str, forces: Forces) -> Table:
    rows = []
    for index, friction in enumerate(forces.friction.tolist()):
        cells = (forces.mean_n[index], forces.p05_n[index], forces.p95_n[index])
        over = payload_over_mass(cells[0], forces.mass_g) if forces.mass_g else None
        ratio = "-" if over is None else f"{over:.0f}"
        rows.append((f"{friction:g}", *(f"{value:.2f}" for value in cells), ratio))
    return Table(
        caption=f"Force on {label} at {forces.pressure_kpa:g} kPa: {forces.engaged_percent:.1f} % "
        "of the leaves end in a gap narrower than their inflated pouch, and only those hold; "
        f"{forces.limited_percent:.1f} % of them are limited by film or seam at the highest "
        "friction (simulated paths, computed contact, assumed friction)",
        headings=("friction", "mean N", "5 % N", "95 % N", "times its own mass"),
        rows=tuple(rows),
    )


def window_section(window: PressureWindow, burst_basis: str) -> Section:
    """Return the pressure window as a chart and numbers."""
    words = (
        "A robot can be deployed where the pressure that growth to the worst tip needs lies below "
        "what its widest part may take. Narrow branches after many turns need most; wide tubes "
        "burst first. How the film is stored decides much and is not known: stored loosely, "
        "nothing holds it back; tightly, it is drawn off a spool."
    )
    needs = Table(
        caption="Pressure to grow to the worst tip over deployments (simulated paths; nested "
        "capstan with published constants, scaled by 1/diameter from a tube whose diameter is "
        "assumed)",
        headings=("film stored", "5 % kPa", "median kPa", "95 % kPa", "greatest kPa", "enough for"),
        rows=tuple(
            (
                need.storage,
                f"{need.p05_kpa:.1f}",
                f"{need.median_kpa:.1f}",
                f"{need.p95_kpa:.1f}",
                f"{need.greatest_kpa:.1f}",
                f"{need.enough_percent:.1f} %",
            )
            for need in (window.loose, window.tight)
        ),
    )
    stands = Table(
        caption=f"What each width stands, burst over allowed {window.safety_factor:g} (assumed), "
        f"and how far it stretches at the working pressure of {window.working_kpa:g} kPa; "
        f"{burst_basis}",
        headings=(
            "part", "lay-flat mm", "inflated mm", "bursts at kPa", "may take kPa", "hoop strain",
        ),
        rows=tuple(
            (
                level.name,
                f"{level.width_mm:.2f}",
                f"{level.inflated_mm:.2f}",
                f"{level.burst_kpa:.1f}",
                f"{level.allowed_kpa:.1f}",
                f"{level.strain_percent:.0f} %",
            )
            for level in window.levels
        ),
    )  # fmt: skip
    picture = Picture(
        image=svg_bytes(window_chart(window)),
        caption="Bars of growth: 5 to 95 % of the deployments, line at the median (simulated). "
        "Bars of widths: what they may take; line where they burst "
        f"({window.standing.value}).",
        wide=True,
    )
    note = (
        f"'Enough for' is the share of the deployments that grow in full with the "
        f"{window.allowed_kpa:.1f} kPa that every width may take."
    )
    return Section(
        title="Pressure window",
        paragraphs=(words, note),
        pictures=(picture,),
        tables=(needs, stands),
    )


def sensitivity_section(effects: Sequence[Effect], measures: Sequence[Measure]) -> Section:
    """Return what changes of start, lengths and model do."""
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
