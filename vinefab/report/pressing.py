"""The section on pressure: what growth needs, what seams stand, and how film stretches."""

from vinefab.model.window import PressureWindow
from vinefab.report.content import Picture, Section, Table
from vinefab.report.figure import svg_bytes
from vinefab.report.window_chart import window_chart


def window_section(window: PressureWindow, burst_basis: str) -> Section:
    """Return the pressure window as a chart and numbers.

    Parameters
    ----------
    window
        The window.
    burst_basis
        What burst pressures rest on, in words, with standings.
    """
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
