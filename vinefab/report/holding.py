"""The section on anchoring: an interval over friction and over which branches hold."""

from collections.abc import Sequence

from vinefab.model.holding import Forces, Holding
from vinefab.physics.anchoring import payload_over_mass
from vinefab.report.content import Section, Table

WORDS = (
    "Force of all leaf pouches over that of one pouch without any turn: the sum of e^(mu gamma) "
    "over the leaves that hold, gamma the turn at contacts and hinges on the way (equations 1 and "
    "2 of the paper). Which leaves hold is not known beforehand: of six branches in the paper's "
    "test one touched nothing and one hung slack. The friction of film on the obstacles is "
    "assumed, 0.2 to 0.8; measure yours."
)


def holding_section(holdings: Sequence[Holding]) -> Section:
    """Return anchoring amplification by friction and engaged leaves, and forces where known."""
    tables = [_table(holding) for holding in holdings]
    tables += [_forces(holding.label, holding.forces) for holding in holdings if holding.forces]
    without = () if holdings[0].forces else (
        "The design has no pouches, so nothing can be said in newtons.",
    )  # fmt: skip
    return Section(title="Anchoring", paragraphs=(WORDS, *without), tables=tuple(tables))


def _table(holding: Holding) -> Table:
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
