"""A design rule with its limits, what it checks, and the violations that it finds."""

import inspect
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from math import isfinite
from numbers import Real
from typing import Any, TypeVar

import numpy as np
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.foreign import broken, calling, is_own
from vinefab.core.frozen import FrozenMapping
from vinefab.core.validation import LARGEST_MM, Floats, number
from vinefab.core.view import Answer, Block, Data, Fact, Facts, Notes, Result
from vinefab.fabrication.job.laser_job import check_size, laser_job
from vinefab.fabrication.job.passes import taken_mm
from vinefab.fabrication.job.placement import ONE, SheetOptions, piece_name
from vinefab.fabrication.rules.spacing import Capsules, capsules_of
from vinefab.inflation.pattern import Pattern, PatternJoint
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.finding import Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import BranchTree, Partition, Piece
from vinefab.outline.body_outline import (
    BodyOutline,
    FlatLayout,
    ProblemKind,
    body_outline,
    flat_layout,
)
from vinefab.outline.joint import Point


@dataclass(frozen=True, slots=True, kw_only=True)
class RigPartFacts:
    """What the rules need to know of a part of a rig."""

    name: str
    size_mm: tuple[float, float, float]  # width, depth and height of its box as it is made
    # Why its file, read back, does not hold the closed, oriented solid that it should.
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFacts:
    """What the rules need to know of a rig."""

    name: str
    printer: str  # name of the machine that makes the parts
    room_mm: tuple[float, float, float]  # width, depth and height that a part may have on it
    height_mm: float  # of the obstacles above the floor
    parts: tuple[RigPartFacts, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """A narrow place between walls."""

    width_mm: float  # where robots run; of a rig, in millimetres of the rig
    x_mm: float  # of its middle, in map coordinates
    y_mm: float
    # diameter of the circle with the area of the dead end that it leads to, likewise; infinite
    # where it leads on. It is a mere notch for bodies whose cross-section is larger
    dead_end_mm: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class MapCorridors:
    """A map or rig with its narrowest corridors."""

    name: str  # of the map or rig
    corridors: tuple[Corridor, ...]  # narrowest first


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigSubject:
    """What the rules about rigs and corridors check; all of it may be missing."""

    design: Design | None = None
    rig: RigFacts | None = None
    corridors: tuple[MapCorridors, ...] = ()  # of maps or rigs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Subject(RigSubject):
    """A design with everything that rules need.

    A rule whose input is None or empty here is skipped or notes it (`RuleNotApplicable`).
    """

    design: Design
    profile: LaserProfile | None  # machine, material and recipe
    layout: FlatLayout  # straight branches on the sheet
    names: tuple[str, ...]  # ids of the branches, in the tree's order
    capsules: Capsules  # the branches and pouches
    outline: BodyOutline  # of the lumen, with the reasons why it may not be exact
    job: Job | None  # the paths of the laser; None without a profile
    # Problems found when each written file was read back; None if none was written.
    readback: Mapping[str, tuple[str, ...]] | None = None
    deployments: Collection[Deployment] = ()  # simulated, for rules about growth paths
    map_names: tuple[str, ...] = ()  # of each deployment's map; empty to number them
    # The pieces that the design is cut in; None where its build asks for one flat outline.
    partition: Partition | None = None
    # The pieces as subjects of their own, each with its capsules and outline; none for a whole one.
    pieces: "tuple[Subject, ...]" = ()
    piece: Piece | None = None  # the piece that this is
    # How the design deploys; None where it is cut as designed. ``design`` is what is cut.
    pattern: Pattern | None = None
    separate: bool = False  # welded and cut in two passes, whatever else the recipe has

    @classmethod
    def of(
        cls,
        design: Design,
        profile: LaserProfile | None = None,
        *,
        readback: Mapping[str, tuple[str, ...]] | None = None,
        deployments: Collection[Deployment] = (),
        map_names: tuple[str, ...] = (),
        sheet: SheetOptions = ONE,
    ) -> "Subject":
        """Return a design with all that is derived from it."""
        check_size(design)
        layout = flat_layout(design)
        return cls(
            design=design,
            profile=profile,
            layout=layout,
            names=layout.tree.ids,
            capsules=capsules_of(layout, design.build),
            outline=body_outline(design),
            job=laser_job(design, profile, sheet) if profile else None,
            separate=sheet.separate,
            readback=readback,
            deployments=deployments,
            map_names=map_names,
        )

    @classmethod
    def on_sheet(
        cls, design: Design, profile: LaserProfile, job: Job, *, separate: bool = False
    ) -> "Subject":
        """Return a design with the job of its sheet, which may hold other designs too."""
        return replace(cls.of(design), profile=profile, job=job, separate=separate)

    @property
    def grown_tree(self) -> BranchTree:
        """The tree that deploys: as designed, where flat angles are compensated."""
        return self.design.tree if self.pattern is None else self.pattern.design.tree

    def last_parts(self, branches: Sequence[int]) -> list[int]:
        """Return the last straight part of each of some branches: rows of the layout."""
        last = self.layout.tree.last_parts.tolist()
        return [last[branch] for branch in branches]

    def words(self, branches: Sequence[int]) -> str:
        """Return what people call some branches: their level where the design has levels."""
        return self.design.words(branches)

    def alike(self, *columns: Floats) -> list[list[int]]:
        """Return the branches by level and values, those that are alike together."""
        return self.design.alike(*columns)

    @property
    def taken_mm(self) -> float:
        """How far outside the lumen's edge the beams take film; 0 without a recipe."""
        return taken_mm(self.profile, separate=self.separate) if self.profile else 0.0

    @property
    def body(self) -> shapely.Polygon:
        """The body as a polygon, which may be invalid; arcs are chords within 0.01 mm."""
        return shapely.Polygon(self.outline.contour.flattened_mm())

    @property
    def deployment_names(self) -> tuple[str, ...]:
        """The name of each deployment's map, or its number."""
        numbered = (f"deployment {number}" for number in range(1, 1 + len(self.deployments)))
        return self.map_names or tuple(numbered)

    def own(self, operation: Operation) -> tuple[LaserPath, ...]:
        """Return the paths of one operation that belong to this design or piece."""
        paths = self.job.along(operation) if self.job else ()
        name = piece_name(self.design.name, self.piece.label if self.piece else "")
        return tuple(path for path in paths if path.of in ("", name))

    def ids(self, *branches: int) -> tuple[str, ...]:
        """Return the ids of branches, by index."""
        return tuple(self.names[branch] for branch in branches)

    def called(self, *branches: int) -> tuple[str, ...]:
        """Return what people call branches, by index: their names in a file, or their ids."""
        return self.design.called(self.ids(*branches))


ROUNDING = 1e-9
"""Relative slack, so that a value set exactly to a limit keeps it after unit conversions."""

MOST_OF_ONE = 10.0
"""Most that a single broken limit adds to a penalty, so that none outweighs all others."""

PICTURES_PAGE = "docs/reference/rules.md in vinefab's source (not in the installed package)"
"""Where every rule stands with its picture."""

_Input = TypeVar("_Input")

LimitChanges = Mapping[str, Mapping[str, float]]
"""Limits to be changed, by rule id and by name: ``{"VF-C01": {"warning": 6.0}}``."""


def relative_excess(value: float, limit: float) -> float:
    """Return the relative excess of a value over a limit, at most 10; 0 below it."""
    return 0.0 if value <= limit else min(MOST_OF_ONE, (value - limit) / max(abs(limit), 1e-9))


@dataclass(frozen=True, slots=True)
class Limits:
    """The named limits of one rule."""

    # ``error`` and ``warning``, with a name before them where a rule has several
    # (``joint_warning``), and further numbers that a rule works with
    values: Mapping[str, float]

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def least(self, value: float, name: str = "") -> "BrokenLimit | None":
        """Return the violation by a value below a limit, the most severe one, or None."""
        return self._worst(value, lambda limit: value < limit - ROUNDING * abs(limit), name)

    def most(self, value: float, name: str = "") -> "BrokenLimit | None":
        """Return the violation by a value above a limit, the most severe one, or None."""
        return self._worst(value, lambda limit: value > limit + ROUNDING * abs(limit), name)

    def _worst(
        self, value: float, breaks: Callable[[float], bool], name: str
    ) -> "BrokenLimit | None":
        prefix = f"{name}_" if name else ""
        for severity in (Severity.ERROR, Severity.WARNING):
            limit = self.values.get(f"{prefix}{severity}")
            if limit is not None and breaks(limit):
                return BrokenLimit(severity=severity, limit=limit, measured=value)
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """One place where a design breaks a rule; `run_checks` turns it into a `Finding`.

    Limits yield it without message and place; `on`, `on_level` and ``replace`` add them.
    """

    message: str = ""  # one sentence: the problem, and its remedy
    severity: Severity = Severity.ERROR
    measured: float | None = None  # in the rule's unit; None if nothing was measured
    limit: float | None = None  # in the rule's unit; None if there is no limit
    branches: tuple[str, ...] = ()  # ids of the branches concerned; part of the fingerprint
    at_mm: tuple[float, float] | None = None  # the place in the flat layout
    marker: str = ""  # geometry that marks the place, as well-known text
    aspect: str = ""  # separates findings of one rule at one place; part of the fingerprint
    title: str = ""  # what is wrong, where that differs from the rule's ``broken``

    def on(
        self,
        subject: Subject,
        branches: Sequence[int],
        message: str,
        *,
        at: float | Point = 0.5,
        marked: Iterable[int] | None = None,
        aspect: str = "",
    ) -> "Violation":
        """Return this violation by branches.

        Parameters
        ----------
        branches
            Indices of the branches named.
        at
            The place: coordinates (mm), or a share of the length of the first branch named.
        marked
            Indices of the branches marked; those named by default.
        """
        layout = subject.layout
        return replace(
            self,
            message=message,
            branches=subject.ids(*branches),
            at_mm=at if isinstance(at, tuple) else branch_point_mm(layout, branches[0], at),
            marker=mark_branches(layout, branches if marked is None else marked),
            aspect=aspect,
        )

    def on_alike(
        self,
        subject: Subject,
        branches: Sequence[int],
        message: str,
        *,
        at: float = 0.5,
        aspect: str = "",
    ) -> "Violation":
        """Return this violation by branches: the first is named, all of them are marked."""
        rows = subject.last_parts(branches)
        return self.on(subject, rows[:1], message, at=at, marked=rows, aspect=aspect)

    def on_joint(
        self, subject: Subject, joint: PatternJoint, message: str, aspect: str = ""
    ) -> "Violation":
        """Return this violation by a kind of joint: the first child is named, all are marked."""
        rows = np.flatnonzero(np.isin(subject.layout.tree.parent, joint.rows)).tolist()
        return self.on(subject, rows[:1], message, at=0.0, marked=rows, aspect=aspect)


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokenLimit(Violation):
    """The violation of a limit by a measured value."""

    measured: float
    limit: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleApplied:
    """The outcome of a check."""

    checked: int  # how many items were checked
    violations: tuple[Violation, ...] = ()
    # What the check could not take into account, so that an empty report does not promise more than
    # was checked; also facts without a finding, such as a robot that is cut in tiles.
    note: str = ""

    @classmethod
    def of_one(cls, violation: Violation | None) -> "RuleApplied":
        """Return the outcome of a check of one thing, with the violation if it has one."""
        return cls(checked=1, violations=() if violation is None else (violation,))


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleNotApplicable:
    """The outcome of a check whose input is missing."""

    reason: str  # what is missing


class MissingInputError(Exception):
    """An input of a check is missing, for the reason given; `Rule.apply` catches it."""


def needed(value: _Input | None, reason: str) -> _Input:
    """Return an input of a check; without it the rule is not applicable, for a reason."""
    if value is None:
        raise MissingInputError(reason)
    return value


def made(
    subject: Subject, reason: str = "needs a recipe, which the paths follow from"
) -> tuple[Job, LaserProfile]:
    """Return the job and recipe of a subject; without them the rule is not applicable."""
    return needed(subject.job, reason), needed(subject.profile, reason)


class Scope(StrEnum):
    """What a rule is about, and so where it runs."""

    SHEET = "sheet"  # the sheet, its recipe and its files: once on a sheet of several robots
    PATHS = "paths"  # the paths of the laser
    PIECES = "pieces"  # every piece of a robot passes it by itself
    ROOM = "room"  # what lies side by side on a sheet: a robot that breaks it may go in pieces
    RIG = "rig"  # a test rig or corridors: it can be applied to a `RigSubject` without a layout


Check = Callable[[Subject, Limits], RuleApplied | RuleNotApplicable]
"""Checks a subject against the limits of a rule."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule(Result):
    """A design rule: a pure check with its limits and its justification; see `design_rule`.

    Parameters
    ----------
    id
        Permanent name; of vinefab's own rules ``VF-``, a letter and two digits.
    title
        What holds where it is kept.
    broken
        What is wrong where it is broken: the title of its findings.
    unit
        Unit of the measured values; empty for ratios and yes-or-no rules.
    limits_in
        What limits are in, where that is another unit: ``times the inflated diameter``.
    limits
        Default limits by name; see `Limits`.
    reason
        Why the rule exists and where its limits come from.
    remedy
        What a designer changes where it fires.
    on
        What it is about.
    check
        Checks a subject against limits.
    """

    id: str
    title: str
    broken: str = ""
    unit: str = ""
    limits_in: str = ""
    limits: Mapping[str, float] = field(default_factory=dict)
    reason: str
    remedy: str = ""
    on: frozenset[Scope] = frozenset()
    check: Check
    schema = "vinefab/rules-1"

    def __post_init__(self) -> None:
        object.__setattr__(self, "limits", FrozenMapping(self.limits))
        object.__setattr__(self, "broken", self.broken or f"not kept: {self.title}")

    def __repr__(self) -> str:
        limits = ", ".join(f"{name} {value:g}" for name, value in self.limits.items())
        behind = f" ({f'{limits} {self.limit_unit}'.rstrip()})" if limits else ""
        return f"<Rule {self.id}: {self.title}{behind}>"

    @property
    def limit_unit(self) -> str:
        """What its error and warning are in."""
        return self.limits_in or self.unit

    @property
    def is_own(self) -> bool:
        """Whether it is one of vinefab's own."""
        return self.id.startswith("VF-")

    @property
    def cells(self) -> tuple[str, str, str]:
        """The rule as a row: id, what must hold, error and warning limits."""
        parts = [f"{n} {self.limits[n]:g}" for n in ("error", "warning") if n in self.limits]
        return self.id, self.title, f"{', '.join(parts)} {self.limit_unit}".strip() if parts else ""

    def limit_text(self, name: str) -> str:
        """Return a limit with its unit; those of another kind have theirs in the name."""
        unit = self.limit_unit if name.endswith(("error", "warning")) else ""
        return f"{name}: {self.limits[name]:g} {unit}".rstrip()

    def view(self) -> Iterator[Block]:
        """Yield the condition, limits, reason, remedy, and how to change it."""
        yield Answer(f"{self.id}: {self.title}")
        facts = Fact("broken", self.broken), Fact("why", self.reason), Fact("remedy", self.remedy)
        yield Facts(facts if self.remedy else facts[:2])
        yield Notes(tuple(f"limit {self.limit_text(name)}" for name in self.limits))
        if self.limits:
            first = next(iter(self.limits))
            change = f"[limits.{self.id}] {first} = ..., or check --limit {self.id}.{first}=..."
            yield Facts((Fact("to change a limit for one design", change),))
        yield Facts((Fact("to accept one finding", "[[waive]] with its fingerprint and a reason"),))
        if self.is_own:
            yield Facts((Fact("picture", PICTURES_PAGE),))
        yield Data({"rules": [self.content]})

    @property
    def content(self) -> dict[str, object]:
        """The rule as it stands in JSON."""
        return {
            "id": self.id,
            "title": self.title,
            "broken": self.broken,
            "unit": self.unit,
            "limits_in": self.limit_unit,
            "limits": dict(self.limits),
            "reason": self.reason,
            "remedy": self.remedy,
        }

    def apply(self, subject: Any, limits: Limits) -> RuleApplied | RuleNotApplicable:  # noqa: ANN401  or a `RigSubject`
        """Check a subject; the outcome says if an input is missing."""
        what = f"rule {self.id!r}"
        try:
            with calling(what, self.check, MissingInputError):
                outcome = self.check(subject, limits)
        except MissingInputError as missing:
            return RuleNotApplicable(reason=str(missing))
        if not is_own(self.check):
            problem = _outcome_problem(outcome)
            if problem:
                raise broken(what, self.check, problem)
        return outcome

    def limits_under(self, changed: LimitChanges | None) -> Limits:
        """Return the limits under changes of several rules."""
        return self.limits_with((changed or {}).get(self.id, {}))

    def limits_with(self, changed: Mapping[str, float]) -> Limits:
        """Return the default limits with some of them changed.

        Raises
        ------
        BadInputError
            If a limit is unknown or its value is out of range.
        """
        for name, value in changed.items():
            if name not in self.limits:
                allowed = ", ".join(self.limits) or "nothing: the rule has no limits"
                raise BadInputError(f"limits.{self.id}.{name}", value, allowed)
            number(f"limits.{self.id}.{name}", value, -LARGEST_MM, LARGEST_MM)
        return Limits({**self.limits, **changed})


def design_rule(  # noqa: PLR0913  the fields of a rule
    id: str,
    *,
    reason: str,
    broken: str = "",
    unit: str = "",
    limits_in: str = "",
    remedy: str = "",
    on: Collection[Scope] = (),
    **limits: float,
) -> Callable[[Check], Rule]:
    """Declare a design rule on its check, which becomes the `Rule`.

    The first sentence of the check's docstring is the title: what holds where the rule is kept.
    Further keywords are its limits.

    Examples
    --------
    >>> @design_rule("MY-B01", unit="mm", warning=300.0, reason="our clamp is deep")
    ... def check_long_tail(subject, limits):
    ...     '''The tail is long.'''
    ...     broken = limits.least(subject.design.build.tail_mm)
    ...     return RuleApplied.of_one(broken and replace(broken, message="lengthen build.tail_mm"))
    >>> check_long_tail
    <Rule MY-B01: the tail is long (warning 300 mm)>
    """

    def declared(check: Check) -> Rule:
        title = (inspect.getdoc(check) or check.__name__).partition("\n")[0].rstrip(".")
        # Where the function is found from now on, as pickles look for it.
        check.__qualname__ += ".check"
        return Rule(
            id=id,
            title=title[:1].lower() + title[1:],
            broken=broken,
            unit=unit,
            limits_in=limits_in,
            limits=limits,
            reason=reason,
            remedy=remedy,
            on=frozenset(on),
            check=check,
        )

    return declared


def _outcome_problem(outcome: object) -> str:
    """Return the reason that a check of another package must not return an outcome, or nothing."""
    if isinstance(outcome, RuleNotApplicable):
        return "" if isinstance(outcome.reason, str) else "its reason is not a text"
    if not isinstance(outcome, RuleApplied):
        return f"its check returns {type(outcome).__name__}, not RuleApplied"
    if not isinstance(outcome.checked, int) or not isinstance(outcome.note, str):
        return "checked is not a whole number, or note not a text"
    for one in outcome.violations:
        if not isinstance(one, Violation):
            return f"a violation is of type {type(one).__name__}, not Violation"
        numbers = [one.measured, one.limit, *(one.at_mm or ())]
        if not all(n is None or (isinstance(n, Real) and isfinite(n)) for n in numbers):
            return "measured, limit or at_mm of a violation is not a finite number"
        texts = [one.message, one.aspect, one.title, one.marker, *one.branches]
        if not all(isinstance(text, str) for text in texts):
            return "message, aspect, title, marker or a branch of a violation is not a text"
        if not isinstance(one.severity, Severity):
            return "the severity of a violation is not a Severity"
    return ""


_DECIMALS = 3


def mark_point(at_mm: Point) -> str:
    """Return a point as well-known text.

    >>> mark_point((1.0, 2.00004))
    'POINT (1 2)'
    """
    return _well_known(shapely.Point(at_mm))


def mark_line(start_mm: Point, end_mm: Point) -> str:
    """Return the line between two points as well-known text; a point where they coincide."""
    if np.allclose(start_mm, end_mm, rtol=0.0, atol=10.0**-_DECIMALS):
        return mark_point(start_mm)
    return _well_known(shapely.LineString([start_mm, end_mm]))


def mark_branches(layout: FlatLayout, branches: Iterable[int]) -> str:
    """Return the centre lines of branches, by index, as well-known text."""
    rows = list(branches)
    ends = np.stack([layout.start_mm[rows], layout.end_mm[rows]], axis=1)
    return _well_known(shapely.MultiLineString(ends.tolist()))


def branch_point_mm(layout: FlatLayout, branch: int, share: float) -> Point:
    """Return a point of a branch's centre line, at a share of its length."""
    x, y = (1.0 - share) * layout.start_mm[branch] + share * layout.end_mm[branch]
    return float(x), float(y)


def _well_known(geometry: shapely.Geometry) -> str:
    return str(shapely.to_wkt(geometry, rounding_precision=_DECIMALS))


def outline_violations(
    subject: Subject, *kinds: ProblemKind, known: tuple[Violation, ...] = ()
) -> tuple[Violation, ...]:
    """Return an error for each outline problem of some kinds that no known violation names."""
    named = [set(violation.branches) for violation in known]
    return tuple(
        Violation(
            message=problem.words(subject.design.called(problem.branches)),
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
