"""What of an observation stands in JSON; ``contacts`` of several are read again."""

import math
from typing import TYPE_CHECKING

from vinefab.observation.beside_prediction import ComparedBranch
from vinefab.observation.meetings import WallMeeting

if TYPE_CHECKING:
    from vinefab.observation.observe_photo import Observation


def observation_data(seen: "Observation") -> dict[str, object]:
    """Return what of an observation stands in JSON alone: lengths in mm, angles in degrees.

    What comes from the photo is measured; what is called predicted is simulated.
    """
    film, compared = seen.film, seen.compared
    branches = compared.branches
    return {
        "map": seen.map_file,
        "design": seen.design_file,
        "pose": compared.prediction.pose.content,
        "rectified": {
            "by": seen.rectified_by,
            "error_mm": _rounded(seen.error_mm),
            "mm_per_pixel": _rounded(film.view.mm_per_pixel),
            "plane_mm": _rounded(film.sight.plane_mm),
            "heights_corrected": film.sight.camera is not None,
            "obstacle_height_mm": film.sight.obstacle_mm or None,
        },
        "film": {
            "colour": None if film.colour is None else list(film.colour),
            "how": film.how,
            "width_mm": seen.trunk_width_mm,
        },
        "branches": [_branch(branch) for branch in branches],
        "summary.branches": len(branches),
        "summary.not_deployed_observed": [b.id for b in branches if not b.deployed_observed],
        "summary.deployed_otherwise_than_predicted": seen.not_as_predicted,
        "summary.lines_on_film": round(seen.traced.lines_supported, 4),
        "summary.fits": seen.fits,
        "summary.not_told_apart": [b.id for b in branches if b.is_ambiguous],
        "settings": {"growth": dict(compared.options.content), **seen.settings},
    }


def _branch(branch: ComparedBranch) -> dict[str, object]:
    error = None
    if branch.mean_mm is not None:
        error = {
            "mean": _rounded(branch.mean_mm),
            "most": _rounded(branch.most_mm),
            "hausdorff": _rounded(branch.hausdorff_mm),
        }
    return {
        "id": branch.id,
        "level": branch.level,
        "planned_mm": _rounded(branch.planned_mm),
        "observed_mm": _rounded(branch.observed_mm),
        "predicted_mm": _rounded(branch.predicted_mm),
        "deployed_observed": branch.deployed_observed,
        "deployed_predicted": branch.deployed_predicted,
        "stop_observed": branch.stop_observed,
        "stop_predicted": branch.stop_predicted,
        "shape_error_mm": error,
        "shape_error_share": _rounded(branch.share, 5),
        "width_mm": {
            "measured": _rounded(branch.width_mm),
            "nominal": _rounded(branch.nominal_width_mm),
        },
        "share_seen": _rounded(branch.seen),
        "share_told_apart": _rounded(branch.told_apart),
        "points_mm": [[_rounded(x), _rounded(y)] for x, y in branch.points_mm.tolist()],
        "contacts": [_contact(contact, branch) for contact in branch.contacts],
        "contact_order_observed": list(branch.order_observed),
        "contact_order_predicted": list(branch.order_predicted),
    }


def _contact(contact: WallMeeting, branch: ComparedBranch) -> dict[str, object]:
    return {
        "x_mm": _rounded(contact.x_mm),
        "y_mm": _rounded(contact.y_mm),
        "wall": contact.wall,
        "angle_from_normal_deg": _rounded(contact.angle_deg),
        "angle_error_deg": _rounded(contact.angle_error_deg),
        "outcome": contact.outcome,
        "distance_mm": _rounded(contact.distance_mm),
        "width_mm": _rounded(branch.width_mm),
    }


def _rounded(value: float | None, digits: int = 3) -> float | None:
    return None if value is None or not math.isfinite(value) else round(float(value), digits)
