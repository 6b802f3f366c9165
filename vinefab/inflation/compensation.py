"""Flat angles that deploy as designed: the inverse of one simulated joint."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.validation import Floats
from vinefab.inflation.joint import InflatedJoint, Joint, inflated_joint

WITHIN_DEG = 0.25
"""A joint is solved when every child deploys within this of what is wanted."""

MESH_DEG = 0.6
"""Meshes differ by as much: a joint within it that comes no nearer is taken as solved."""

MOST_SIMULATIONS = 12

_FURTHEST_STEP_DEG = 25.0
_LEAST_GAP_DEG = 4.0
"""Flat siblings keep at least this angle from each other and from the trunk while one solves."""


class UnreachableJointError(VinefabError, ValueError):
    """No flat joint deploys with the wanted angles."""

    def __init__(self, wanted: Joint, nearest: "FlatJoint | None", why: str) -> None:
        super().__init__(wanted, nearest, why)
        self.wanted, self.nearest, self.why = wanted, nearest, why

    def __str__(self) -> str:
        angles = ", ".join(f"{angle:.1f}" for angle in self.wanted.angles_deg)
        return f"no flat joint deploys at {angles} degrees: {self.why}"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlatJoint:
    """A joint as it must be cut, and what becomes of it (simulated).

    Lengths are in widths of the joint's trunk; tuples have an entry for each child.
    """

    flat: Joint  # as it is cut
    deployed_deg: tuple[float, ...]  # angles under pressure
    # Flat length that each child needs beyond its deployed length.
    pull_backs: tuple[float, ...]
    side_offsets: tuple[float, ...]  # of each child's deployed axis, to its left
    sensitivity: float  # largest change of a deployed angle over that of all flat ones
    crotch_load: float  # largest load of the weld over that of the trunk's straight seam
    passage: float  # largest ball from the trunk into any child, over the child's tube

    @classmethod
    def of(cls, found: InflatedJoint) -> "FlatJoint":
        """Return the figures of a simulated joint; those of an even fan are made even."""
        joint = found.joint
        angles, backs, offsets = found.angles_deg, found.pull_backs, found.side_offsets
        slopes = found.sensitivity()
        if is_even(joint):
            angles = (angles - angles[::-1]) / 2.0
            backs, offsets = (backs + backs[::-1]) / 2.0, (offsets - offsets[::-1]) / 2.0
        return cls(
            flat=joint,
            deployed_deg=tuple(angles.tolist()),
            pull_backs=tuple(backs.tolist()),
            side_offsets=tuple(offsets.tolist()),
            sensitivity=float(np.linalg.norm(slopes, 2)),
            crotch_load=found.crotch_load,
            passage=float(found.passages.min()),
        )


Simulate = Callable[[Joint], InflatedJoint]


@lru_cache(maxsize=512)
def flat_joint(wanted: Joint) -> FlatJoint:
    """Return the flat joint whose children deploy at given angles.

    Newton's method on the simulated joint; its slopes come with every simulation.

    Parameters
    ----------
    wanted
        The joint with its deployed angles in place of flat ones.

    Raises
    ------
    UnreachableJointError
        If no flat joint deploys so, or none can be simulated; it knows the nearest one.

    Examples
    --------
    >>> pair = Joint.fan(2, 80.0, width=0.6, fillet=0.125)
    >>> [round(angle) for angle in flat_joint(pair).flat.angles_deg]
    [-40, 40]
    """
    return _solved(wanted, inflated_joint)


def deployed_joint(flat: Joint) -> FlatJoint:
    """Return what becomes of a flat joint.

    Raises
    ------
    UnreachableJointError
        If it cannot be simulated.
    """
    return _deployed(flat)


@lru_cache(maxsize=512)
def _deployed(flat: Joint) -> FlatJoint:
    try:
        return FlatJoint.of(inflated_joint(flat))
    except (BadInputError, VinefabError) as error:
        raise UnreachableJointError(flat, None, str(error)) from error


def _solved(wanted: Joint, simulate: Simulate) -> FlatJoint:
    goal = np.array(wanted.angles_deg)
    even = is_even(wanted)
    flat, best, best_off = _guess(goal), None, np.inf
    step = np.zeros_like(goal)
    for _ in range(MOST_SIMULATIONS):
        try:
            found = simulate(wanted.with_angles(tuple(flat.tolist())))
        except VinefabError as error:
            nearest = None if best is None else FlatJoint.of(best)
            raise UnreachableJointError(wanted, nearest, str(error)) from error
        off = goal - found.angles_deg
        off -= 360.0 * np.round(off / 360.0)
        if even:
            off = (off - off[::-1]) / 2.0
        worst = float(np.abs(off).max())
        if worst <= WITHIN_DEG:
            return FlatJoint.of(found)
        if worst < best_off:
            best, best_off = found, worst
            step = np.linalg.lstsq(found.sensitivity(), off, rcond=1e-3)[0]
            step *= min(1.0, _FURTHEST_STEP_DEG / np.abs(step).max())
        else:  # the last step went too far, or meshes differ by more than is left
            step = step / 2.0
        flat = _apart(np.array(best.joint.angles_deg) + step if best else flat)
        if even:
            flat = (flat - flat[::-1]) / 2.0
    assert best is not None  # noqa: S101  the first is the best so far
    nearest = FlatJoint.of(best)
    if best_off <= MESH_DEG:
        return nearest
    angles = ", ".join(f"{angle:.1f}" for angle in nearest.deployed_deg)
    raise UnreachableJointError(wanted, nearest, f"the nearest are {angles} degrees")


def is_even(joint: Joint) -> bool:
    """Return whether a joint is its own mirror image."""
    pairs = zip(
        (*joint.angles_deg, *joint.widths, *joint.fillets),
        (*joint.mirrored.angles_deg, *joint.mirrored.widths, *joint.mirrored.fillets),
        strict=True,
    )
    return all(abs(one - two) < 1e-9 for one, two in pairs)


def _guess(wanted_deg: Floats) -> Floats:
    """Return flat angles near the solution: narrow gaps wider, and all turned less far back."""
    gaps = np.diff(wanted_deg)
    middle = (wanted_deg[0] + wanted_deg[-1]) / 2.0
    wider = np.concatenate(
        [[0.0], np.cumsum(gaps + np.maximum(0.0, 30.0 - 0.45 * gaps) / max(1, len(gaps)))]
    )
    flat = middle + wider - wider[-1] / 2.0
    return _apart(np.sign(flat) * (np.abs(flat) - 0.14 * np.maximum(0.0, np.abs(flat) - 50.0)))


def _apart(flat_deg: Floats) -> Floats:
    """Return flat angles pushed apart and away from the trunk where they come too near."""
    away = 180.0 - _LEAST_GAP_DEG
    flat = np.clip(flat_deg, -away, away)
    for _ in range(len(flat)):
        for one, two in pairwise(range(len(flat))):
            short = _LEAST_GAP_DEG - (flat[two] - flat[one])
            if short > 0.0:
                flat[one], flat[two] = flat[one] - short / 2.0, flat[two] + short / 2.0
    return flat


def softer(joint: Joint, times: float) -> Joint:
    """Return a joint of film that stretches so many times as far."""
    return replace(joint, hoop_strain=joint.hoop_strain * times)
