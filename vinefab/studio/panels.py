"""The panels of the page: what each asks for, and where its answer is computed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from vinefab.core.errors import BadInputError
from vinefab.studio.edited_map import PAGE
from vinefab.studio.state import StudioState

Tell = Callable[[float, str], None]
"""Takes the share that is done, 0 to 1, and what is being done."""

AnswerFunction = Callable[[StudioState, Mapping[str, Any], Tell], dict[str, Any]]
"""Takes what is open on the page and what the panel asks; returns plain values."""

LIVE, CUT = "live", "cut"
"""Lanes that are threads of the server: what must follow the pointer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """One kind of question."""

    module: str  # in `vinefab.studio`; its function of the same name answers
    lane: str  # where: `LIVE`, or the name of a process

    @property
    def answer(self) -> AnswerFunction:
        """The function that answers, imported when first used."""
        found: AnswerFunction = getattr(import_module(f"vinefab.studio.{self.module}"), self.module)
        return found


PANELS = {
    "live": Question(module="live_answer", lane=LIVE),
    "before": Question(module="live_answer", lane=LIVE),  # of the version that is compared with
    "front": Question(module="front_answer", lane=LIVE),
    "cut": Question(module="cut_answer", lane=CUT),
    "inflated": Question(module="inflated_answer", lane="inflated"),
    "rules": Question(module="rules_answer", lane="rules"),
    "fix": Question(module="fix_answer", lane="fix"),
    "family": Question(module="family_answer", lane="family"),
    "width": Question(module="width_answer", lane="family"),  # simulates as that does
    "export": Question(module="export_answer", lane="export"),
}
"""Every panel; files and searches are the desk's."""


def answer_of(name: str, state: Mapping[str, Any], ask: Mapping[str, Any], tell: Tell) -> Any:  # noqa: ANN401  plain values
    """Return a panel's answer.

    Raises
    ------
    VinefabError
        If something on the page cannot be used.
    """
    if name not in PANELS:
        raise BadInputError("panel", name, f"one of {', '.join(PANELS)}", PAGE)
    return PANELS[name].answer(StudioState.of(state), ask, tell)
