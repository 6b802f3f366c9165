"""The branch that is chosen on the page: its values, and where it lies on the map."""

from typing import Any

import shapely
from shapely import LineString

from vinefab.core.errors import BadInputError
from vinefab.core.limits import deg
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import TRUNK, Branch, Design, Trunk
from vinefab.pages.plan import STOP_WORDS
from vinefab.pages.plan_svg import bends_svg
from vinefab.studio.state import PAGE


def labels_of(design: Design) -> tuple[str, ...]:
    """Return what the page calls the branches: names, or ids where the design has levels."""
    return design.names or design.tree.ids


def row_of(design: Design, label: object) -> int:
    """Return the row of a branch in the design's tree.

    Raises
    ------
    BadInputError
        If there is none.
    """
    labels = labels_of(design)
    if label not in labels:
        raise BadInputError("branch", label, "a branch of the design", PAGE)
    return labels.index(str(label))


def chosen_branch(design: Design, deployment: Deployment | None, label: str) -> dict[str, Any]:
    """Return the values of the branch that is chosen, and the handles of its bends.

    Parameters
    ----------
    deployment
        Where it lies; None where nothing grows.
    """
    tree, row = design.tree, row_of(design, label)
    part = part_of(design, label)
    width_mm = float(tree.width_mm[row])
    values = {
        "angle_deg": deg(float(tree.offset_rad[row])),
        "length": float(tree.length_mm[row]),
        "width_mm": width_mm,
        "taper": float(tree.end_width_mm[row]) / width_mm,
        "fillet_mm": float(tree.fillet_mm[row]),
    }
    found = {"label": label, "level": int(tree.level[row]), "values": values, "text": "", "svg": ""}
    if deployment is None or not deployment.deployed[row]:
        return {**found, "text": "not grown" if deployment is None else _stop_text(deployment, row)}
    course, grown_mm = LineString(deployment.chain_mm(row)), float(deployment.grown_mm[row])
    bends = [] if part is None else part.bends or ()
    places = {
        index: place_on(course, at_mm) for index, (at_mm, _) in enumerate(bends) if at_mm < grown_mm
    }
    return {**found, "text": _stop_text(deployment, row), "svg": bends_svg(places)}


def part_of(design: Design, label: str) -> Trunk | Branch | None:
    """Return the table of a branch in the design's file; None where its level has one."""
    if design.branches is None:
        return None
    return design.trunk if label == TRUNK else by_name(design)[label]


def _stop_text(deployment: Deployment, row: int) -> str:
    stop = STOP_WORDS[Stop(deployment.stop[row])]
    grown_mm, planned_mm = deployment.grown_mm[row], deployment.tree.length_mm[row]
    return f"{stop}, {grown_mm:.1f} of {planned_mm:.1f} mm (simulated)"


def place_on(course: LineString, at_mm: float) -> tuple[float, float]:
    """Return the place on a line so far from its beginning."""
    point = shapely.line_interpolate_point(course, at_mm)
    return point.x, point.y


def by_name(design: Design) -> dict[str, Branch]:
    """Return the tables of the branches of a design that is written branch by branch."""
    return {branch.name: branch for branch in design.branches or ()}
