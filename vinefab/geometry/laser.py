"""From a design and a recipe to what the laser is to do, placed on the bed."""

import math

import numpy as np

from vinefab.core.units import deg
from vinefab.geometry.outline import BodyOutline, body_outline
from vinefab.geometry.placement import Placement, place
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour, Part


def weldcut_offset_mm(profile: LaserProfile) -> float:
    """Return how far outside the lumen's edge the beam's centre runs when it cuts and seals.

    The seam that extends inward of the kerf plus half the kerf: the beam melts the seam's whole
    width to both sides of the kerf, and the lumen ends where the seam begins.
    """
    settings = profile.settings(Operation.WELDCUT)
    return settings.seam_width_mm.value + settings.kerf_mm.value / 2.0


def laser_job(design: Design, profile: LaserProfile) -> Job:
    """Return the one-pass job for a design: outline cut and sealed at once, then the mouth cut.

    The outline stays open at the mouth, which is only cut: the cut crosses both ends of the
    outline by the recipe's overcut, so that the part comes free. A robot that does not fit the
    bed is placed all the same; ``fits_bed`` in the facts says so.

    Parameters
    ----------
    design
        The design.
    profile
        Machine, material and recipe.

    Raises
    ------
    BadInputError
        If the recipe has no ``weldcut`` or no ``cut``.
    """
    offset = weldcut_offset_mm(profile)
    overcut = profile.settings(Operation.CUT).overcut_mm.value
    outline = body_outline(design, offset)
    mouth = mouth_cut(outline.contour, overcut)
    machine = profile.machine
    placement = place((outline.contour, mouth), machine.usable_mm, machine.margin_mm.value)
    paths = (
        LaserPath(
            operation=Operation.WELDCUT,
            contour=placement.moved(outline.contour),
            label=f"outline of {design.name}",
        ),
        LaserPath(
            operation=Operation.CUT, contour=placement.moved(mouth), label=f"mouth of {design.name}"
        ),
    )
    return Job(
        name=design.name,
        sheet_width_mm=machine.bed_width_mm.value,
        sheet_height_mm=machine.bed_height_mm.value,
        paths=paths,
        facts={
            **_offset_facts(profile),
            **_placement_facts(placement, profile),
            **_body_facts(design, outline),
        },
    )


def mouth_cut(outline: Contour, overcut_mm: float) -> Contour:
    """Return the straight cut across the mouth of an open outline.

    Parameters
    ----------
    outline
        Open; its two ends are the mouth's corners.
    overcut_mm
        How far the cut runs past each of them.
    """
    first, last = outline.points_mm[-1], outline.points_mm[0]
    along = (last - first) / math.dist(first, last)
    return Contour(
        points_mm=np.array([first - overcut_mm * along, last + overcut_mm * along]),
        bulges=np.zeros(1),
        parts=(Part.MOUTH,),
        branches=outline.branches[:1],
        closed=False,
    )


def _offset_facts(profile: LaserProfile) -> dict[str, object]:
    settings = profile.settings(Operation.WELDCUT)
    return {
        "machine": profile.machine.name,
        "material": profile.material.name,
        "recipe": profile.recipe.name,
        "recipe_status": profile.recipe.status.value,
        "weldcut_offset_mm": weldcut_offset_mm(profile),
        "weldcut_seam_mm": settings.seam_width_mm.value,
        "weldcut_kerf_mm": settings.kerf_mm.value,
        "mouth_overcut_mm": profile.settings(Operation.CUT).overcut_mm.value,
    }


def _placement_facts(placement: Placement, profile: LaserProfile) -> dict[str, object]:
    usable = profile.machine.usable_mm
    return {
        "rotation_deg": deg(placement.angle_rad),
        "shift_x_mm": placement.dx_mm,
        "shift_y_mm": placement.dy_mm,
        "box_width_mm": placement.width_mm,
        "box_height_mm": placement.height_mm,
        "usable_width_mm": usable[0],
        "usable_height_mm": usable[1],
        "fits_bed": placement.fits,
    }


def _body_facts(design: Design, outline: BodyOutline) -> dict[str, object]:
    points = outline.contour.points_mm
    return {
        "mouth_lumen_mm": design.build.widths_mm[0],
        "mouth_gap_mm": math.dist(points[0], points[-1]),
        "outline_problems": [problem.words for problem in outline.problems],
    }
