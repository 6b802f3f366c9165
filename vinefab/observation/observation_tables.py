"""The branches of an observation as tables."""

from collections.abc import Sequence

from vinefab.core.view import Rows, Section
from vinefab.observation.beside_prediction import ComparedBranch


def branch_section(branches: Sequence[ComparedBranch]) -> Section:
    """Return lengths, stops, distances and contacts of every branch."""
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
            Rows(
                caption="Branches: lengths in mm; distances at equal arc lengths, in mm "
                "and in percent of the length seen",
                headings=(
                    "branch", "planned", "observed", "predicted", "stop observed",
                    "stop predicted", "mean mm", "Hausdorff mm", "mean %", "diameter mm",
                ),
                rows=rows,
            ),
            Rows(
                caption="Walls that tips met, in their order: seen (measured) and predicted "
                "(simulated)",
                headings=("branch", "seen", "predicted", "same"),
                rows=orders,
                folded=len(orders) > 12,
            ),
            Rows(
                caption="Contacts: angle between the tip's heading and the wall's normal "
                "(measured, with an assumed standard error)",
                headings=("branch", "wall", "x mm", "y mm", "angle deg", "error deg", "tip"),
                rows=contacts,
                folded=len(contacts) > 12,
            ),
        ),
    )  # fmt: skip


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
