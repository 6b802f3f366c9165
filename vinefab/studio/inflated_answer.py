"""The inflated body on the sheet's panel: the whole pattern under pressure (simulated)."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely

from vinefab.core.view import plain_blocks
from vinefab.fabrication.outline.body_outline import body_outline
from vinefab.inflation.robot import with_short_tail
from vinefab.pages.plan_svg import area_svg, lines_svg, outline_svg
from vinefab.prediction.inflation_report import inflate_design
from vinefab.studio.panels import Tell
from vinefab.studio.state import StudioState


def inflated_answer(state: StudioState, ask: Mapping[str, Any], tell: Tell) -> dict[str, Any]:  # noqa: ARG001  one form
    """Return flat outline, inflated body and designed branches, as `vinefab inflate` draws them."""
    found = inflate_design(state.design, state.profile, alone=True, progress=tell)
    shape = found.deployed
    contour = body_outline(with_short_tail(shape.pattern.flat)).contour
    axes = np.stack([shape.designed.start_mm, shape.designed.end_mm], axis=1)
    corners = np.concatenate([contour.flattened_mm(), shapely.get_coordinates(shape.seen)])
    return {
        "svg": f'<g class="flat">{outline_svg(contour)}</g>'
        f"{area_svg(shape.seen, 'inflated')}{lines_svg(list(axes), 'designed')}",
        "box": [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()],
        "blocks": plain_blocks(found.view()),
    }
