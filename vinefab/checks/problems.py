"""What stood in the way of an exact outline, as hits of the rules that it belongs to."""

from vinefab.checks.marks import mark_point
from vinefab.checks.rule import Hit
from vinefab.checks.subject import Subject
from vinefab.geometry.problem import ProblemKind


def problem_hits(
    subject: Subject, kinds: frozenset[ProblemKind], known: tuple[Hit, ...] = ()
) -> tuple[Hit, ...]:
    """Return an error for each of the outline's problems of some kinds.

    Parameters
    ----------
    subject
        What is looked at.
    kinds
        The kinds of problems that belong to the rule.
    known
        What the rule found by itself; a problem of the same branches is not told twice.
    """
    named = [set(hit.branches) for hit in known]
    return tuple(
        Hit(
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
