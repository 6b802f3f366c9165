"""Coupons laid out on as many sheets as they need, each a job of its own."""

from collections.abc import Mapping, Sequence

from vinefab.core.errors import BadInputError
from vinefab.geometry.coupon import Piece
from vinefab.geometry.passes import weldcut_offset_mm
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile

GAP_MM = 8.0
"""Between pieces: more than rule VF-L01 asks for between a mark and a body."""

ROW_MM = 300.0
"""Rows are no longer than this where the bed allows more: a piece of film of a handy shape."""

_ORDER = tuple(Operation)


def coupon_sheets(pieces: Sequence[Piece], profile: LaserProfile) -> tuple[Job, ...]:
    """Return the jobs that hold all pieces, in rows from the lower left, highest pieces first.

    Parameters
    ----------
    pieces
        What to lay out.
    profile
        Machine and recipe.

    Raises
    ------
    BadInputError
        If a piece is larger than the bed.
    """
    (bed_x, bed_y), margin = profile.machine.usable_mm, profile.machine.margin_mm.value
    room = min(bed_x, ROW_MM), bed_y
    sheets: list[list[Piece]] = [[]]
    x, y, row = 0.0, 0.0, 0.0
    for piece in sorted(pieces, key=lambda piece: -_size(piece)[1]):
        width, height = _size(piece)
        if width > room[0] or height > room[1]:
            words = f"a bed of at least {width:.0f} x {height:.0f} mm for coupon {piece.name}"
            raise BadInputError("machine bed", f"{bed_x:g} x {bed_y:g} mm usable", words)
        if x > 0.0 and x + width > room[0]:
            x, y, row = 0.0, y + row + GAP_MM, 0.0
        if y > 0.0 and y + height > room[1]:
            sheets.append([])
            x, y, row = 0.0, 0.0, 0.0
        low_x, low_y, _, _ = piece.box_mm
        sheets[-1].append(piece.shifted(margin + x - low_x, margin + y - low_y))
        x, row = x + width + GAP_MM, max(row, height)
    names = ["coupons"] if len(sheets) == 1 else [f"coupons_{k + 1}" for k in range(len(sheets))]
    facts = recipe_facts(profile)
    return tuple(
        sheet_job(name, [path for piece in sheet for path in piece.paths], profile, facts)
        for name, sheet in zip(names, sheets, strict=True)
    )


def sheet_job(
    name: str, paths: Sequence[LaserPath], profile: LaserProfile, facts: Mapping[str, object]
) -> Job:
    """Return paths as one job on the machine's bed, in process order."""
    return Job(
        name=name,
        sheet_width_mm=profile.machine.bed_width_mm.value,
        sheet_height_mm=profile.machine.bed_height_mm.value,
        paths=tuple(sorted(paths, key=lambda path: _ORDER.index(path.operation))),
        facts=facts,
    )


def recipe_facts(profile: LaserProfile) -> dict[str, object]:
    """Return what every coupon file says about how it was made."""
    facts: dict[str, object] = {
        "machine": profile.machine.name,
        "material": profile.material.name,
        "recipe": profile.recipe.name,
        "recipe_status": profile.recipe.status.value,
    }
    if Operation.WELDCUT in profile.recipe.operations:
        facts["weldcut_offset_mm"] = weldcut_offset_mm(profile)
    return facts


def _size(piece: Piece) -> tuple[float, float]:
    x0, y0, x1, y1 = piece.box_mm
    return x1 - x0, y1 - y0
