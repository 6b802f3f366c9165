"""Rules about the lay-flat widths of the levels."""

from dataclasses import replace

from vinefab.checks.marks import mark_branches, middle_mm
from vinefab.checks.packing import occupancies
from vinefab.checks.problems import problem_hits
from vinefab.checks.rule import Breach, Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.subject import Subject
from vinefab.geometry.problem import ProblemKind


def look_least_width(subject: Subject, limits: Limits) -> Looked:
    """VF-W01: no level is too narrow to be inflated and turned inside out."""
    build = subject.design.build
    widths_mm = build.end_widths_mm
    hits = [
        level_hit(
            subject,
            level,
            f"level {level} is too narrow: widen it, or widen the trunk and keep the ratios",
            (width_mm, breach),
        )
        for level, width_mm in enumerate(widths_mm, start=1)
        if (breach := limits.least(width_mm))
    ]
    more = problem_hits(subject, frozenset({ProblemKind.VANISHED}), tuple(hits))
    short = _short_pouch(subject, limits)
    return Looked(checked=len(widths_mm), hits=(*hits, *more, *short))


def _short_pouch(subject: Subject, limits: Limits) -> tuple[Hit, ...]:
    """Return a hit if a rectangular pouch is too short along the branch to be a lumen."""
    pouch = subject.design.build.pouch
    breach = limits.least(pouch.length_mm) if pouch and pouch.length_mm else None
    if pouch is None or breach is None:
        return ()
    words = "the pouch is too short along its branch to be inflated: lengthen it"
    hit = level_hit(subject, subject.design.depth, words, (pouch.length_mm or 0.0, breach))
    return (replace(hit, aspect="pouch"),)


def look_width_ratio(subject: Subject, limits: Limits) -> Looked:
    """VF-W02: a parent is much wider than its children."""
    widths_mm = subject.design.build.widths_mm
    ends_mm = subject.design.build.end_widths_mm
    ratios = [wide / narrow for wide, narrow in zip(ends_mm, widths_mm[1:], strict=False)]
    hits = [
        level_hit(
            subject,
            level,
            f"level {level} is too wide for the level before it: narrow it or widen its parent",
            (ratio, breach),
        )
        for level, ratio in enumerate(ratios, start=2)
        if (breach := limits.least(ratio))
    ]
    more = problem_hits(subject, frozenset({ProblemKind.CHILD_WIDTH}), tuple(hits))
    return Looked(checked=len(ratios), hits=(*hits, *more))


def look_packing(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-W03: folded descendants leave room in the lumen that they ride in."""
    if subject.profile is None:
        return NotLooked(reason="needs a recipe, for the film's thickness")
    film_mm = subject.profile.material.ply_mm.value * subject.profile.material.plies
    found = occupancies(subject.design, film_mm, limits["packing"])
    hits = [
        level_hit(
            subject,
            level,
            f"what grows out of level {level} fills too much of it: fewer or narrower children",
            (100.0 * share, breach),
        )
        for level, share in enumerate(found, start=1)
        if (breach := limits.most(100.0 * share))
    ]
    return Looked(checked=len(found), hits=tuple(hits))


def level_hit(subject: Subject, level: int, message: str, found: tuple[float, Breach]) -> Hit:
    """Return a hit about a whole level: named by its first branch, marking all of them.

    Parameters
    ----------
    subject
        What is looked at.
    level
        1 for the trunk.
    message
        As in `Hit`.
    found
        The value measured and the limit that it breaks.
    """
    rows = subject.level_rows(level)
    measured, breach = found
    return Hit(
        message=message,
        severity=breach.severity,
        measured=measured,
        limit=breach.limit,
        branches=subject.ids(rows[0]),
        at_mm=middle_mm(subject.layout, rows[0]),
        marker=mark_branches(subject.layout, rows),
    )


LEAST_WIDTH = Rule(
    id="VF-W01",
    title="least lumen width",
    unit="mm",
    limits={"error": 5.0, "warning": 8.0},
    reason="narrow tubes burst before they grow: 3 mm tubes did, 4 to 7 mm worked (published)",
    look=look_least_width,
)
WIDTH_RATIO = Rule(
    id="VF-W02",
    title="width of the parent over that of the child",
    limits={"error": 1.2, "warning": 1.5},
    reason="each level should be much wider than the next one, or it does not deploy (paper)",
    look=look_width_ratio,
)
PACKING = Rule(
    id="VF-W03",
    title="folded descendants within the parent's lumen",
    unit="%",
    limits={"error": 60.0, "warning": 30.0, "packing": 0.1},
    reason="undeployed film rides inside the body and jams when it is packed (uncalibrated)",
    look=look_packing,
)
