"""What a design rule is, what checking with it yields, and the markers of violations."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.validation import LARGEST_MM, number
from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.outline.layout import FlatLayout
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.finding import Severity

ROUNDING = 1e-9
"""Relative slack, so that a value set exactly to a limit keeps it after unit conversions."""

LimitChanges = Mapping[str, Mapping[str, float]]
"""Limits to be changed, by rule id and by name: ``{"VF-C01": {"warning": 6.0}}``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokenLimit:
    """A limit that a value breaks."""

    severity: Severity  # the most severe limit that is broken
    limit: float  # its value


@dataclass(frozen=True, slots=True)
class Limits:
    """The named limits of one rule."""

    # ``error`` and ``warning``, with a name before them where a rule has several
    # (``joint_warning``), and further numbers that a rule works with
    values: Mapping[str, float]

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def least(self, value: float, name: str = "") -> BrokenLimit | None:
        """Return the breach of a value that should be at least the limits, or None."""
        return self._worst(lambda limit: value < limit - ROUNDING * abs(limit), name)

    def most(self, value: float, name: str = "") -> BrokenLimit | None:
        """Return the breach of a value that should be at most the limits, or None."""
        return self._worst(lambda limit: value > limit + ROUNDING * abs(limit), name)

    def _worst(self, breaks: Callable[[float], bool], name: str) -> BrokenLimit | None:
        prefix = f"{name}_" if name else ""
        for severity in (Severity.ERROR, Severity.WARNING):
            limit = self.values.get(f"{prefix}{severity}")
            if limit is not None and breaks(limit):
                return BrokenLimit(severity=severity, limit=limit)
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """One place where a rule is broken; the run turns it into a Finding."""

    message: str  # one sentence: what is wrong, and what would mend it
    severity: Severity = Severity.ERROR  # how much it matters
    # measured, limit: in the rule's unit; None where there is no number
    measured: float | None = None
    limit: float | None = None
    # ids of the branches concerned; with the rule they make the fingerprint
    branches: tuple[str, ...] = ()
    at_mm: tuple[float, float] | None = None  # the place in the flat layout, or None
    marker: str = ""  # well-known text that marks the place, or empty
    aspect: str = ""  # tells findings of one rule at one place apart; part of the fingerprint


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleApplied:
    """A rule was applied."""

    checked: int  # how many things were looked at
    hits: tuple[Violation, ...] = ()  # what was found
    # what the rule could not take into account, or empty: the report shows it, so that no finding
    # does not look like more than it is
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleNotApplicable:
    """A rule could not be applied."""

    reason: str  # what was missing


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """A design rule: pure, and complete without the code around it."""

    id: str  # fixed name, ``VF-`` and a letter with two digits
    title: str  # what must hold
    unit: str = ""  # unit of what is measured; empty for ratios and yes-or-no rules
    limits: Mapping[str, float] = field(default_factory=dict)  # default limits; see `Limits`
    reason: str  # why the rule is there and where its limits come from
    # looks at a subject under limits
    look: Callable[[Subject, Limits], RuleApplied | RuleNotApplicable]

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", MappingProxyType(dict(self.limits)))

    def limits_with(self, changed: Mapping[str, float]) -> Limits:
        """Return the default limits with some of them changed."""
        for name, value in changed.items():
            if name not in self.limits:
                allowed = ", ".join(self.limits) or "nothing: the rule has no limits"
                raise BadInputError(f"limits.{self.id}.{name}", value, allowed)
            number(f"limits.{self.id}.{name}", value, -LARGEST_MM, LARGEST_MM)
        return Limits({**self.limits, **changed})


Point = tuple[float, float]
_DECIMALS = 3


def mark_point(at_mm: Point) -> str:
    """Return a point.

    >>> mark_point((1.0, 2.00004))
    'POINT (1 2)'
    """
    return _text(shapely.Point(at_mm))


def mark_line(start_mm: Point, end_mm: Point) -> str:
    """Return a line between two places, such as the ends of a gap; a point where they coincide."""
    if np.allclose(start_mm, end_mm, rtol=0.0, atol=10.0**-_DECIMALS):
        return mark_point(start_mm)
    return _text(shapely.LineString([start_mm, end_mm]))


def mark_branches(layout: FlatLayout, branches: Iterable[int]) -> str:
    """Return the centre lines of some branches, by index."""
    rows = list(branches)
    ends = np.stack([layout.start_mm[rows], layout.end_mm[rows]], axis=1)
    return _text(shapely.MultiLineString(ends.tolist()))


def middle_mm(layout: FlatLayout, branch: int) -> Point:
    """Return the middle of a branch."""
    x, y = (layout.start_mm[branch] + layout.end_mm[branch]) / 2.0
    return float(x), float(y)


def place_mm(layout: FlatLayout, branch: int, *, at_tip: bool = False) -> Point:
    """Return where a branch begins, or its tip."""
    x, y = layout.end_mm[branch] if at_tip else layout.start_mm[branch]
    return float(x), float(y)


def _text(geometry: shapely.Geometry) -> str:
    return str(shapely.to_wkt(geometry, rounding_precision=_DECIMALS))


def outline_violations(
    subject: Subject, kinds: frozenset[ProblemKind], known: tuple[Violation, ...] = ()
) -> tuple[Violation, ...]:
    """Return an error for each of the outline's problems of some kinds."""
    named = [set(hit.branches) for hit in known]
    return tuple(
        Violation(
            message=problem.words,
            measured=problem.measured_mm,
            limit=problem.limit_mm,
            branches=problem.branches,
            at_mm=(problem.x_mm, problem.y_mm),
            marker=mark_point((problem.x_mm, problem.y_mm)),
            aspect=problem.kind.value,
        )
        for problem in subject.outline.problems
        if problem.kind in kinds and not any(names <= set(problem.branches) for names in named)
    )
