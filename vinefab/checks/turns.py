"""The rule about turns: at one joint, and gathered along a whole path."""

import math

import numpy as np

from vinefab.checks.marks import mark_branches, place_mm
from vinefab.checks.rule import Breach, Hit, Limits, Looked, Rule
from vinefab.checks.subject import Subject
from vinefab.model.checked import Floats
from vinefab.model.tree import BranchTree
from vinefab.physics.capstan import capstan_factor
from vinefab.physics.growth_pressure import FITTED


def look_turn(subject: Subject, limits: Limits) -> Looked:
    """VF-C06: joints turn little, and so does the whole path to every tip.

    Without deployments a path's turn is that of its joints; with them, the largest turn at
    contacts and base hinges on the way is added.
    """
    tree = subject.layout.tree
    turns_rad = np.abs(tree.offset_rad)
    hits = []
    for level in range(2, subject.design.depth + 1):
        rows = np.flatnonzero(tree.level == level)
        worst = int(rows[np.argmax(turns_rad[rows])])
        turn_deg = math.degrees(turns_rad[worst])
        breach = limits.most(turn_deg, "joint")
        if breach:
            words = "the branch turns back at its joint: narrow the fan"
            hits.append(_hit(subject, worst, words, (turn_deg, breach)))
    gathered_rad = gathered_turn_rad(tree, subject)
    worst = int(np.argmax(gathered_rad))
    friction = FITTED.friction.value
    factor = capstan_factor(friction, float(gathered_rad[worst]))
    breach = limits.most(factor, "capstan")
    if breach:
        words = f"turns on the way to this tip multiply the film's tension by {factor:.1f}"
        at_limit = math.degrees(math.log(breach.limit) / friction)
        as_turn = Breach(severity=breach.severity, limit=at_limit)
        found = (math.degrees(gathered_rad[worst]), as_turn)
        hits.append(_hit(subject, worst, f"{words}: straighten the path", found, "capstan"))
    return Looked(checked=len(tree), hits=tuple(hits))


def gathered_turn_rad(tree: BranchTree, subject: Subject) -> Floats:
    """Return the sum of absolute turns from the base to each branch's tip, shape (n,)."""
    contacts = [_summed_along(tree, d.contact_turn_rad) for d in subject.deployments]
    worst = np.max(contacts, axis=0) if contacts else np.zeros(len(tree))
    return np.asarray(_summed_along(tree, np.abs(tree.offset_rad)) + worst)


def _summed_along(tree: BranchTree, values: Floats) -> Floats:
    """Return the sum of a value over each branch and all its ancestors, shape (n,)."""
    total = np.array(values, dtype=np.float64)
    for level in range(2, int(tree.level[-1]) + 1):
        rows = np.flatnonzero(tree.level == level)
        total[rows] += total[tree.parent[rows]]
    return total


def _hit(
    subject: Subject, branch: int, message: str, found: tuple[float, Breach], aspect: str = ""
) -> Hit:
    measured_deg, breach = found
    return Hit(
        message=message,
        severity=breach.severity,
        measured=measured_deg,
        limit=breach.limit,
        branches=subject.ids(branch),
        at_mm=place_mm(subject.layout, branch),
        marker=mark_branches(subject.layout, [branch]),
        aspect=aspect,
    )


TURN = Rule(
    id="VF-C06",
    title="turn at a joint, and capstan factor e^(mu gamma) along a path",
    unit="deg",
    limits={"joint_warning": 90.0, "capstan_warning": 10.0},
    reason="friction at turns multiplies the pressure that growth takes (mu 0.234, published)",
    look=look_turn,
)
