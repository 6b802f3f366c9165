"""An observation as a page: the photo from straight above, lines seen and predicted, tables."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import Normal, Stroke

from vinefab.core.units import deg
from vinefab.core.validation import Floats
from vinefab.growth.options import growth_text
from vinefab.observation.beside_prediction import ComparedBranch
from vinefab.observation.observe_photo import Observation
from vinefab.pages.colours import ALERT, level_colour
from vinefab.pages.figure import house_style, plan_axes, png_bytes
from vinefab.pages.html import Headline, Picture, Report, Section, Table, Tone, page_html

SEEN, PREDICTED = "#ffe600", "#00e5ff"


def observation_html(seen: Observation) -> str:
    """Return the page, complete in itself."""
    return page_html(observation_report(seen))


def observation_report(seen: Observation) -> Report:
    """Return the page's content."""
    good = seen.fits and not seen.not_as_predicted
    tone: Tone = "good" if good else ("caution" if seen.fits else "bad")
    return Report(
        title=f"{seen.design.name} on {seen.world.name}: seen and predicted",
        verdict=_verdict(seen),
        tone=tone,
        facts=(
            ("photo", seen.photo),
            ("rectified by", f"{seen.rectified_by}, {seen.error_text}"),
            ("film", seen.film.how),
            ("growth", growth_text(seen.compared.options, [seen.design])),
        ),
        sections=(_picture_section(seen), _branch_section(seen), _angle_section(seen)),
        cautions=(*seen.cautions, *seen.compared.notes),
        headlines=_headlines(seen),
    )


def _verdict(seen: Observation) -> str:
    if not seen.fits:
        return "The photo hardly shows this design from this pose; check both before reading on."
    return (
        f"{seen.verdict[0].upper()}{seen.verdict[1:]}. "
        f"The robot lies {seen.mean_error_mm:.1f} mm from its prediction in the mean, "
        f"{100 * seen.error_share:.1f} % of the way to its farthest tip."
    )


def _headlines(seen: Observation) -> tuple[Headline, ...]:
    found, count = seen.summary, len(seen.compared.branches)
    angles = ", ".join(f"{angle:g}" for angle in seen.compared.best_half_angles_deg)
    return (
        Headline(
            name="distance from the prediction",
            value=f"{seen.mean_error_mm:.1f} mm",
            detail="mean at equal arc lengths, measured against simulated",
        ),
        Headline(
            name="branches out",
            value=f"{found['deployed_observed']} of {count}",
            detail=f"measured; {found['deployed_predicted']} predicted (simulated)",
            tone="caution" if seen.not_as_predicted else "good",
        ),
        Headline(
            name="same stop",
            value=f"{found['same_stop']} of {count}",
            detail="measured against simulated",
        ),
        Headline(
            name="half-angle with this shape",
            value=f"{angles} deg",
            detail="by the shape's likelihood (errors assumed)",
        ),
    )


def _picture_section(seen: Observation) -> Section:
    words = (
        "The photo as a camera straight above would have taken it, true for the height of the "
        "trunk's middle. Yellow: centre lines traced on the film (measured). Blue, dashed: the "
        "prediction from the pose given (simulated). Both are drawn where the camera sees them at "
        "their tubes' height. Crosses: where tips met walls, by replay from the lines seen."
    )
    pictures = (
        Picture(image=_overlay(seen), caption="Seen and predicted on the photo.", wide=True),
        Picture(image=_film_picture(seen), caption="Where film was found (white: film)."),
    )
    return Section(title="Photo", paragraphs=(words,), pictures=pictures)


def _overlay(seen: Observation) -> bytes:
    view = seen.film.view
    with house_style():
        figure, axes = plan_axes(seen.world.bounds.bounds, 8.0)
        rows, columns = view.pixels.shape[:2]
        right = view.left_mm + columns * view.mm_per_pixel
        low = view.top_mm - rows * view.mm_per_pixel
        axes.imshow(view.pixels, extent=(view.left_mm, right, low, view.top_mm), zorder=0)
        for branch in seen.compared.branches:
            _draw_branch(axes, seen, branch)
        axes.set_xlim(view.left_mm, right)
        axes.set_ylim(low, view.top_mm)
    return png_bytes(figure, dpi=130)


def _draw_branch(axes: Axes, seen: Observation, branch: ComparedBranch) -> None:
    z_mm = branch.nominal_width_mm / 2.0

    def shown(points: Floats) -> Floats:
        return seen.film.moved(points, z_mm, seen.film.sight.plane_mm)

    if len(branch.predicted_points_mm) > 1:
        places = shown(branch.predicted_points_mm)
        axes.plot(*places.T, "--", color=PREDICTED, lw=1.3, dashes=(4, 3), zorder=4)
    if not branch.deployed_observed:
        return
    places = shown(branch.points_mm)
    dark = [Stroke(linewidth=2.6, foreground=level_colour(branch.level)), Normal()]
    axes.plot(*places.T, "-", color=SEEN, lw=1.1, zorder=3, path_effects=dark)
    name = [Stroke(linewidth=2.0, foreground="white"), Normal()]
    middle = places[len(places) // 2]
    axes.annotate(
        branch.id, middle, xytext=(3, 3), textcoords="offset points", fontsize=6.5, zorder=6,
        path_effects=name,
    )  # fmt: skip
    contacts = [(c.x_mm, c.y_mm) for c in branch.contacts if c.outcome != "unclear"]
    if contacts:
        axes.plot(*shown(np.array(contacts)).T, "x", color=ALERT, ms=5, mew=1.4, zorder=5)


def _film_picture(seen: Observation) -> bytes:
    view = seen.film.view
    with house_style():
        figure, axes = plan_axes(seen.world.bounds.bounds, 4.5)
        rows, columns = view.pixels.shape[:2]
        extent = (
            view.left_mm,
            view.left_mm + columns * view.mm_per_pixel,
            view.top_mm - rows * view.mm_per_pixel,
            view.top_mm,
        )
        axes.imshow(seen.film.share, extent=extent, cmap="gray", vmin=0.0, vmax=1.0)
    return png_bytes(figure, dpi=100)


def _branch_section(seen: Observation) -> Section:
    branches = seen.compared.branches
    rows = tuple(
        (
            branch.id,
            f"{branch.planned_mm:.1f}",
            f"{branch.observed_mm:.1f}" if branch.deployed_observed else "-",
            f"{branch.predicted_mm:.1f}" if branch.deployed_predicted else "-",
            branch.stop_observed.replace("_", " "),
            branch.stop_predicted.replace("_", " "),
            _number(branch.mean_mm, 1),
            _number(branch.hausdorff_mm, 1),
            _number(None if branch.share is None else 100.0 * branch.share, 1),
            _number(branch.width_mm, 1),
        )
        for branch in branches
    )
    orders = tuple(
        (
            branch.id,
            ", ".join(branch.order_observed) or "-",
            ", ".join(branch.order_predicted) or "-",
            "yes" if branch.order_observed == branch.order_predicted else "no",
        )
        for branch in branches
        if branch.order_observed or branch.order_predicted
    )
    contacts = tuple(
        (
            branch.id,
            contact.wall,
            f"{contact.x_mm:.1f}",
            f"{contact.y_mm:.1f}",
            f"{contact.angle_deg:.1f}",
            f"{contact.angle_error_deg:.1f}",
            contact.outcome,
        )
        for branch in branches
        for contact in branch.contacts
    )
    return Section(
        title="Branch by branch",
        paragraphs=(
            "Observed lengths, stops, distances and widths are measured on the photo; predicted "
            "ones are simulated.",
        ),
        tables=(
            Table(
                caption="Branches: lengths in mm; distances at equal arc lengths, in mm "
                "and in percent of the length seen",
                headings=(
                    "branch", "planned", "observed", "predicted", "stop observed",
                    "stop predicted", "mean mm", "Hausdorff mm", "mean %", "diameter mm",
                ),
                rows=rows,
            ),
            Table(
                caption="Walls that tips met, in their order: seen (measured) and predicted "
                "(simulated)",
                headings=("branch", "seen", "predicted", "same"),
                rows=orders,
                folded=len(orders) > 12,
            ),
            Table(
                caption="Contacts: angle between the tip's heading and the wall's normal "
                "(measured, with an assumed standard error)",
                headings=("branch", "wall", "x mm", "y mm", "angle deg", "error deg", "tip"),
                rows=contacts,
                folded=len(contacts) > 12,
            ),
        ),
    )  # fmt: skip


def _angle_section(seen: Observation) -> Section:
    rows = tuple(
        (
            f"{fit.half_angle_deg:g}",
            f"{fit.mean_mm:.2f}",
            f"{fit.same_stops}",
            f"{fit.log_likelihood:.1f}",
        )
        for fit in seen.compared.fits
    )
    own = deg(seen.compared.options.only_half_angle_rad)
    return Section(
        title="Which half-angle explains it",
        paragraphs=(
            f"The prediction shown has a head-on half-angle of {own:g} degrees (assumed). These "
            "are predictions over the contact range. Likelihoods count a branch's distance against "
            "2 mm and 3 % of the way to it (assumed); within 2 of the best, values explain the "
            "shape about as well. One photo says little: fit several together.",
        ),
        tables=(
            Table(
                caption="Predictions over the contact range, against the shape seen",
                headings=("half-angle deg", "mean distance mm", "same stops", "log likelihood"),
                rows=rows,
            ),
        ),
    )


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
