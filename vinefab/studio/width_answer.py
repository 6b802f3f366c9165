"""How wide the scores of the open map are, over what is assumed about contacts."""

from collections.abc import Mapping
from typing import Any

from vinefab.core.view import Rows, plain_blocks
from vinefab.prediction.family_deployments import PreparedFamily
from vinefab.prediction.measures import COVERAGE, REACH, SEEN, Measure
from vinefab.prediction.prediction_width import ContactRange, contact_range
from vinefab.studio.live_answer import not_followed
from vinefab.studio.panels import Tell
from vinefab.studio.scene import prepared_map
from vinefab.studio.state import StudioState


def width_answer(state: StudioState, ask: Mapping[str, Any], _: Tell) -> dict[str, Any]:  # noqa: ARG001  one form
    """Return the ends of coverage and reach from the page's start (simulated), as in a report.

    Returns
    -------
    dict
        ``text``: the first measure in one line; ``blocks``: a table of all; both empty where
        nothing grows.
    """
    if state.world is None or state.start is None or not_followed(state.design):
        return {"text": "", "blocks": []}
    family = PreparedFamily(
        label="the open map", maps=(prepared_map(state),), poses=((state.start,),)
    )
    found = contact_range(state.grown, family, state.growth)
    low, high = (f"{angle:g}" for angle in (found.angles_deg[0], found.angles_deg[-1]))
    headings = (
        f"half-angle {low} to {high} deg",
        *(
            f"{rule.option.replace('_', ' ')} {rule.choices[0]} → {rule.choices[-1]}"
            for rule in found.rules
        ),
    )
    table = Rows(
        caption="From this start, over what is not known of contacts (simulated; "
        f"{found.standing.partition(':')[0]})",
        headings=("measure", *headings),
        rows=tuple((m.label, *_ends(found, m)) for m in (COVERAGE, SEEN, REACH)),
    )
    first = ", ".join(
        f"{ends} ({heading})"
        for heading, ends in zip(headings, _ends(found, COVERAGE), strict=True)
    )
    return {"text": f"{COVERAGE.title}: {first}", "blocks": plain_blocks([table])}


def _ends(found: ContactRange, measure: Measure) -> tuple[str, ...]:
    """Return a measure's ends over the half-angle, then over each other choice."""
    low, high = (measure.number(value) for value in found.ends(measure))
    values = (rule.values[measure.key] for rule in found.rules)
    rules = (f"{measure.number(v[0].mean)} → {measure.number(v[-1].mean)}" for v in values)
    return (f"{low} to {high}", *rules)
