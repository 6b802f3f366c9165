"""An observation as a page: the photo from straight above, lines seen and predicted, tables."""

import numpy as np
from numpy.typing import NDArray

from vinefab.core.units import deg
from vinefab.core.validation import Floats
from vinefab.growth.options import growth_text
from vinefab.observation.beside_prediction import ComparedBranch
from vinefab.observation.observe_photo import Observation
from vinefab.pages.colours import ALERT, level_colour
from vinefab.pages.html import Headline, Picture, Report, Section, Table, Tone, page_html
from vinefab.pages.page_png import page_png
from vinefab.pages.panel import Ink, Panel, page_of, photo, plan_panel

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


def _photo_panel(seen: Observation, pixels: NDArray[np.uint8], longest_pt: float) -> Panel:
    """Return a panel with pixels where the photo lies on the map."""
    view = seen.film.view
    rows, columns = view.pixels.shape[:2]
    right = view.left_mm + columns * view.mm_per_pixel
    box = (view.left_mm, view.top_mm - rows * view.mm_per_pixel, right, view.top_mm)
    panel = plan_panel(box, longest_pt)
    panel.add(photo(pixels, box), 0.0)
    return panel


def _overlay(seen: Observation) -> bytes:
    panel = _photo_panel(seen, seen.film.view.pixels, 576.0)
    for branch in seen.compared.branches:
        _draw_branch(panel, seen, branch)
    return page_png(page_of(panel), dpi=130)


def _draw_branch(panel: Panel, seen: Observation, branch: ComparedBranch) -> None:
    z_mm = branch.nominal_width_mm / 2.0

    def shown(points: Floats) -> Floats:
        return seen.film.moved(points, z_mm, seen.film.sight.plane_mm)

    if len(branch.predicted_points_mm) > 1:
        dashed = Ink(line=PREDICTED, width_pt=1.3, dash_pt=(5.2, 3.9))
        panel.line(shown(branch.predicted_points_mm), dashed, rank=4.0)
    if not branch.deployed_observed:
        return
    places = shown(branch.points_mm)
    panel.line(places, Ink(line=level_colour(branch.level), width_pt=2.6), rank=3.0)
    panel.line(places, Ink(line=SEEN, width_pt=1.1), rank=3.0)
    x, y = places[len(places) // 2].tolist()
    panel.words((x, y), branch.id, 6.5, shift_pt=(3.0, 5.5), halo=True)
    contacts = [(c.x_mm, c.y_mm) for c in branch.contacts if c.outcome != "unclear"]
    if contacts:
        panel.marks(shown(np.array(contacts)), "x", 5.0, Ink(line=ALERT, width_pt=1.4), rank=5.0)


def _film_picture(seen: Observation) -> bytes:
    grey = np.clip(np.rint(255.0 * seen.film.share), 0, 255).astype(np.uint8)
    return page_png(page_of(_photo_panel(seen, grey, 324.0)), dpi=100)


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
