"""The joints of a pattern, solved: each for the flat angles that deploy as designed.

Joints that the user's cache lacks are simulated side by side, by as many processes as the computer
has processors: the simulation holds the interpreter's lock most of the time.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Literal

import numpy as np

from vinefab.core.errors import VinefabError
from vinefab.core.helpers import helped, processors
from vinefab.core.progress import phase
from vinefab.core.user_cache import KeptFiles
from vinefab.inflation.compensation import (
    MESH_DEG,
    WITHIN_DEG,
    FlatJoint,
    UnknownJointError,
    UnreachableJointError,
    cache_folder,
    cached_joint,
    deployed_joint,
    flat_joint,
    known_joint,
    likely_flat_deg,
)
from vinefab.inflation.joint import JointShape
from vinefab.outline.joint import JointPlan, joint_of

How = Literal["known", "cached", "simulated"]
"""Who tells of a joint: the table and the user's cache, the cache alone, or a simulation, which is
then in the cache."""

_MOST_TARGETS = 8
_MOST_TURN_DEG = 0.8
"""Most by which children are turned so that their tips come near. With the differences of meshes,
they stay within 1.5 degrees of the design."""

_WORTH = 3
"""Fewer joints are simulated by one process before a second one has begun."""

_MOST_PROCESSES = 8  # each takes 0.15 GB


@dataclass(frozen=True, slots=True, kw_only=True)
class JointTask:
    """A joint that is to be solved."""

    plan: JointPlan
    away_mm: tuple[float, ...]  # mean way from the joint to the tips behind it, through each child
    strain: float  # hoop strain of the parent
    gain: float  # how far joints turn over the simulated, as measured
    compensated: bool  # whether children shall deploy as designed; else they are cut so


@dataclass(frozen=True, slots=True, kw_only=True)
class SolvedJoint:
    """What became of a joint that was to be solved."""

    # Angles that it is solved for: the designed ones, turned so that tips come near.
    aimed_deg: tuple[float, ...]
    found: FlatJoint | None  # None where there is none
    error: VinefabError | None = None  # why it does not deploy as designed


def solved_joints(tasks: Sequence[JointTask], *, known_only: bool = False) -> list[SolvedJoint]:
    """Return the solution of each joint.

    Parameters
    ----------
    known_only
        Simulate nothing; what is not known has an `UnknownJointError`.
    """
    if not tasks:
        return []
    if known_only:
        return [solved_joint(task, "known") for task in tasks]
    with phase("joints", len(tasks)) as count:
        found = [solved_joint(task, "cached") for task in tasks]
        missing = [k for k, one in enumerate(found) if isinstance(one.error, UnknownJointError)]
        waiting = deque(tasks[k] for k in missing)
        helpers = min(processors(), len(waiting), _MOST_PROCESSES) - 1
        if len(waiting) < _WORTH or not KeptFiles(cache_folder(), ".json", 0).is_writable():
            helpers = 0
        known = len(tasks) - len(waiting)
        with helped(solve_for_cache, waiting, helpers) as others:
            while waiting or others.wait():
                # Those in work are not done.
                count.at(max(known, len(tasks) - len(waiting) - helpers - 1))
                if waiting:
                    solve_for_cache(waiting.popleft())
        for k in missing:
            found[k] = solved_joint(tasks[k], "simulated")
    return found


def solve_for_cache(task: JointTask) -> None:
    """Solve a joint, so that its solution is in the user's cache."""
    solved_joint(task, "simulated")


def solved_joint(task: JointTask, how: How) -> SolvedJoint:
    """Return the solution of one joint.

    Fillets are those that its flat angles leave room for.
    """
    try:
        aimed, found = _solved(task, how)
    except UnreachableJointError as error:
        return SolvedJoint(aimed_deg=error.wanted.angles_deg, found=error.nearest, error=error)
    except VinefabError as error:
        wanted = tuple(math.degrees(one.angle_rad) for one in task.plan.children)
        return SolvedJoint(aimed_deg=wanted, found=None, error=error)
    return SolvedJoint(aimed_deg=aimed, found=found)


def _solved(task: JointTask, how: How) -> tuple[tuple[float, ...], FlatJoint]:
    """Return the angles that a joint is solved for, and the joint."""
    plan = task.plan
    width_mm = 2.0 * plan.parent.half_mm
    wanted_deg = tuple(round(math.degrees(one.angle_rad), 3) for one in plan.children)
    # Children stand off their designed axes: turned a little, their tips come nearer. An even fan
    # is turned as a whole.
    is_fan = all(abs(a + b) < 1e-9 for a, b in zip(wanted_deg, wanted_deg[::-1], strict=True))
    designed_deg = np.array(wanted_deg)
    most_deg = np.minimum(_MOST_TURN_DEG, np.abs(designed_deg) / 5.0)
    turn_deg, fillets, flat = np.zeros(len(wanted_deg)), tuple[float, ...](), plan
    if task.compensated:
        # Crotches are wider flat than deployed: narrow fans have room for fillets there only.
        flat = plan.turned(likely_flat_deg(np.array(wanted_deg)).tolist())
    for step in range(4):
        drawn = joint_of(flat, 0.0)
        before, fillets = fillets, tuple(round(gap.radius_mm / width_mm, 3) for gap in drawn.gaps)
        if plan.is_bend:  # the outer edge is concentric
            fillets = (max(fillets),) * len(fillets)
        same = before and max(abs(a - b) for a, b in zip(before, fillets, strict=True)) <= 0.01
        if same and step > 1:
            break
        aimed_deg = designed_deg - turn_deg
        if is_fan:
            share = 1.0 - turn_deg[-1] / wanted_deg[-1] if wanted_deg[-1] else 1.0
            aimed_deg = share * designed_deg
        wanted = JointShape(
            angles_deg=tuple(round(angle, 3) for angle in aimed_deg.tolist()),
            widths=tuple(round(2.0 * one.half_mm / width_mm, 4) for one in plan.children),
            fillets=fillets,
            hoop_strain=task.strain,
            is_bend=plan.is_bend,
        )
        found = _joint(wanted, task.compensated, task.gain, how)
        if not task.compensated:
            break
        away_mm = np.array(task.away_mm)
        if is_fan:
            away_mm = np.full(len(away_mm), math.fsum(task.away_mm) / len(away_mm))
        turn_deg = np.degrees(np.array(found.side_offsets) * width_mm / away_mm)
        turn_deg = np.clip(turn_deg, -most_deg, most_deg)
        flat = plan.turned(found.flat.angles_deg)
    return wanted.angles_deg, found


@lru_cache(maxsize=256)
def _joint(wanted: JointShape, compensated: bool, gain: float, how: How) -> FlatJoint:  # noqa: FBT001  a key of the cache
    """Return a joint whose children turn so many times as far as simulated, as measured.

    The simulated angles aimed at are moved until those with the gain are the wanted ones. One of a
    joint and its mirror image is solved, so that mirrored robots mirror.
    """
    seen = wanted.mirrored
    if (wanted.angles_deg, wanted.widths, wanted.fillets) > (
        seen.angles_deg, seen.widths, seen.fillets,
    ):  # fmt: skip
        try:
            return _joint(seen, compensated, gain, how).mirrored
        except UnreachableJointError as error:
            raise error.mirrored from error
    if how == "simulated":
        flat_of, deployed_of = partial(flat_joint, exact=True), partial(deployed_joint, exact=True)
    else:
        look_up = known_joint if how == "known" else cached_joint
        flat_of, deployed_of = partial(look_up, "flat"), partial(look_up, "deployed")
    if not compensated:
        return _gained(deployed_of(wanted), gain)
    if gain == 1.0:
        return flat_of(wanted)
    goal = np.array(wanted.angles_deg)
    target = goal
    for _ in range(_MOST_TARGETS):
        try:
            aim = wanted.with_angles(tuple(np.round(target, 3).tolist()))
            simulated = flat_of(aim)
        except UnreachableJointError as error:
            if error.nearest is None:
                raise
            simulated = error.nearest
        found = _gained(simulated, gain)
        off = goal - np.array(found.deployed_deg)
        if np.abs(off).max() <= WITHIN_DEG:
            return found
        target = target + off
    if np.abs(off).max() <= MESH_DEG:
        return found
    angles = ", ".join(f"{angle:.1f}" for angle in found.deployed_deg)
    raise UnreachableJointError(wanted, found, f"the nearest with gain {gain:g}: {angles} degrees")


def _gained(found: FlatJoint, gain: float) -> FlatJoint:
    """Return a simulated joint with the turns that film was measured to make."""
    flat = np.array(found.flat.angles_deg)
    turned = flat + gain * (np.array(found.deployed_deg) - flat)
    sensitivity = abs(1.0 - gain) + gain * found.sensitivity
    return replace(found, deployed_deg=tuple(turned.tolist()), sensitivity=sensitivity)
