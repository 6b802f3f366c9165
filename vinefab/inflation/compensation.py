"""Flat angles that deploy as designed: the inverse of one simulated joint."""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter

from vinefab.core.atomic import write_bytes
from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.hashing import fingerprint
from vinefab.core.user_cache import cache_root
from vinefab.core.validation import Floats
from vinefab.inflation import law
from vinefab.inflation.joint import InflatedJoint, JointShape, inflated_joint, turned_joint
from vinefab.inflation.membrane import NotConvergedError
from vinefab.inflation.table import (
    JointFigures,
    fan_table,
    simulation_fingerprint,
    table_file,
)

_MOST_BYTES = 1 << 16


def cache_folder() -> Path:
    """Return the folder of joints simulated as now, whether it exists or not."""
    return cache_root() / "joints" / simulation_fingerprint()


def cached(way: str, joint: JointShape) -> dict[str, Any] | None:
    """Return the record of a joint, if it is there and whole.

    Parameters
    ----------
    way
        What was asked of the joint.
    """
    with suppress(OSError, ValueError, LookupError, TypeError, VinefabError):
        path = _path(way, joint)
        if path.stat().st_size <= _MOST_BYTES:
            record = json.loads(path.read_bytes())
            if record["joint"] == _plain(joint) and record["sum"] == _sum(record["found"]):
                return dict(record["found"])
    return None


def keep(way: str, joint: JointShape, found: dict[str, Any]) -> None:
    """Keep the record of a joint."""
    with suppress(OSError, VinefabError):
        record = {"joint": _plain(joint), "found": found, "sum": _sum(found)}
        data = json.dumps(record).encode()
        write_bytes(_path(way, joint), data, force=True, sealed=False, private=True)


def _path(way: str, joint: JointShape) -> Path:
    return cache_folder() / f"{way}-{fingerprint(_plain(joint))}.json"


def _plain(joint: JointShape) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(json.dumps(asdict(joint)))
    if not joint.is_bend:
        del plain["is_bend"]
    return plain


def _sum(found: dict[str, Any]) -> str:
    return fingerprint(json.loads(json.dumps(found)))


WITHIN_DEG = 0.25
"""A joint is solved when every child deploys within this of the wanted angle."""

MESH_DEG = 0.6
"""Meshes differ by as much: a joint within it that comes no nearer is taken as solved."""

MOST_SIMULATIONS = 12

_FURTHEST_STEP_DEG = 25.0
_FURTHEST_FOLLOWED_DEG = 5.0
"""Up to so far, a step keeps its triangles: new ones move results by 0.2 to 0.9 degrees."""

_WEAK_SLOPE = 0.3

_EVEN_WITHIN = 2e-3
"""Fans that are even within this, in degrees and widths of the trunk, are in the table."""

_LEAST_GAP_DEG = 4.0
"""Flat siblings keep at least this angle from each other and from the trunk while one solves."""


class UnreachableJointError(VinefabError, ValueError):
    """No flat joint deploys with the wanted angles."""

    def __init__(self, wanted: JointShape, nearest: "FlatJoint | None", why: str) -> None:
        super().__init__(wanted, nearest, why)
        self.wanted, self.nearest, self.why = wanted, nearest, why

    def __str__(self) -> str:
        angles = ", ".join(f"{angle:.1f}" for angle in self.wanted.angles_deg)
        return f"no flat joint deploys at {angles} degrees: {self.why}"

    @property
    def mirrored(self) -> "UnreachableJointError":
        """The same of the joint seen from below."""
        nearest = None if self.nearest is None else self.nearest.mirrored
        return UnreachableJointError(self.wanted.mirrored, nearest, self.why)


class UnknownJointError(UnreachableJointError):
    """Neither the user's cache nor table or law know a joint; a simulation would tell."""

    def __init__(self, wanted: JointShape) -> None:
        super().__init__(wanted, None, "not simulated yet")

    @property
    def mirrored(self) -> "UnknownJointError":
        """The same of the joint seen from below."""
        return UnknownJointError(self.wanted.mirrored)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlatJoint(JointFigures):
    """A joint as it must be cut, and its deployed shape (simulated)."""

    flat: JointShape  # as it is cut
    source: str = "simulated"  # or "table", or "law"
    # How far a direct simulation on other triangles may deploy from this.
    within_deg: float = MESH_DEG

    @property
    def mirrored(self) -> "FlatJoint":
        """The joint seen from below."""
        return replace(
            self,
            flat=self.flat.mirrored,
            deployed_deg=tuple(-angle for angle in reversed(self.deployed_deg)),
            pull_backs=tuple(reversed(self.pull_backs)),
            side_offsets=tuple(-offset for offset in reversed(self.side_offsets)),
        )

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


@lru_cache(maxsize=4096)
def flat_joint(wanted: JointShape, *, exact: bool = False) -> FlatJoint:
    """Return the flat joint whose children deploy at given angles.

    From the table that ships where it can be trusted, else from the user's cache, else by Newton's
    method on the simulated joint; its slopes come with every simulation.

    Parameters
    ----------
    wanted
        The joint with its deployed angles in place of flat ones.
    exact
        Whether the table is too coarse, as for joints that are cut.

    Raises
    ------
    UnreachableJointError
        If no flat joint deploys so, or none can be simulated; it knows the nearest one.

    Examples
    --------
    >>> pair = JointShape.fan(2, 80.0, width=0.6, fillet=0.125)
    >>> [round(angle) for angle in flat_joint(pair).flat.angles_deg]
    [-40, 40]
    """
    found = None if exact else _by_table("flat", wanted)
    return found or _by_cache("flat", wanted, simulated_flat_joint)


@lru_cache(maxsize=4096)
def deployed_joint(flat: JointShape, *, exact: bool = False) -> FlatJoint:
    """Return the deployed shape of a flat joint, from the table, the cache or a simulation.

    Parameters
    ----------
    exact
        As of `flat_joint`.

    Raises
    ------
    UnreachableJointError
        If it cannot be simulated.
    """
    found = None if exact else _by_table("deployed", flat)
    return found or _by_cache("deployed", flat, simulated_deployed_joint)


def _by_table(way: str, joint: JointShape) -> FlatJoint | None:
    """Return an even fan by the table, where it can be trusted."""
    count, file = len(joint.angles_deg), table_file()
    fan_deg = joint.angles_deg[-1] - joint.angles_deg[0]
    table = fan_table(count)
    if not _is_even_fan(joint) or table is None or file is None:
        return None
    place = (joint.widths[0], joint.fillets[0], joint.hoop_strain)
    compensated = way == "flat"
    fan = table.compensated(fan_deg, place) if compensated else table.deployed(fan_deg, place)
    if fan is None:
        return None
    bound = file.compensation if compensated else file.deployment
    figures = {one.name: getattr(fan, one.name) for one in fields(JointFigures)}
    if compensated:
        figures["deployed_deg"] = joint.angles_deg
    return FlatJoint(
        **figures,
        flat=joint.with_angles(fan.flat_deg) if compensated else joint,
        source="table",
        within_deg=round(bound.largest_deg, 1),
    )


def _is_even_fan(joint: JointShape) -> bool:
    """Return whether a joint has equal children, evenly apart, with equal fillets."""
    even = JointShape.fan(
        len(joint.angles_deg),
        joint.angles_deg[-1] - joint.angles_deg[0],
        width=joint.widths[0],
        fillet=joint.fillets[0],
        hoop_strain=joint.hoop_strain,
    )
    off = max(
        abs(one - other)
        for one, other in zip(
            (*joint.angles_deg, *joint.widths, *joint.fillets),
            (*even.angles_deg, *even.widths, *even.fillets),
            strict=True,
        )
    )
    return not joint.is_bend and off <= _EVEN_WITHIN


def _rounded(joint: JointShape) -> JointShape:
    """Return a joint with the first gap's fillet in every gap."""
    return replace(joint, fillets=joint.fillets[:1] * len(joint.fillets))


def _by_law(way: Literal["flat", "deployed"], joint: JointShape) -> FlatJoint | None:
    """Return an uneven fan or a bend by the law, within its range."""
    count = len(joint.angles_deg)
    if count > law.MOST_CHILDREN or _is_even_fan(_rounded(joint)):
        return None
    asked = law.Joints.of([joint])
    found = law.law_of(way, asked)
    if found is None or not found.is_within[0]:
        return None
    told = tuple(np.round(found.angles_deg[0, :count], 3).tolist())
    if any(two - one < _LEAST_GAP_DEG for one, two in pairwise((-180.0, *told, 180.0))):
        return None
    flat = joint.with_angles(told) if way == "flat" else joint
    slopes = law.law_slopes(law.Joints.of([flat]))[0]
    return FlatJoint(
        flat=flat,
        deployed_deg=joint.angles_deg if way == "flat" else told,
        pull_backs=tuple(found.pull_backs[0, :count].tolist()),
        side_offsets=tuple(found.side_offsets[0, :count].tolist()),
        sensitivity=float(np.linalg.norm(slopes, 2)),
        crotch_load=float(found.crotch_loads[0]),
        passage=float(found.passages[0]),
        source="law",
        within_deg=round(law.law_within_deg(way), 1),
    )


def known_joint(way: Literal["flat", "deployed"], joint: JointShape) -> FlatJoint:
    """Return a joint without simulating it, from table, law or user's cache.

    Even fans are the table's alone, others and bends the law's. Gaps of even fans too narrow for
    their fillet count as if they had it: flat angles were within 1.8 degrees of simulated ones on
    nine fans.

    Parameters
    ----------
    way
        As `flat_joint` or as `deployed_joint`.

    Raises
    ------
    UnknownJointError
        If none of them knows it.
    UnreachableJointError
        If the cache knows that no flat joint deploys so.
    """
    # The cache last: what follows a pointer must not jump where a joint was once simulated.
    found = _by_table(way, joint) or _by_law(way, joint) or _from_cache(way, joint)
    if found is None:
        if (found := _by_table(way, _rounded(joint))) is None:
            raise UnknownJointError(joint)
        found = replace(found, within_deg=2.0 * found.within_deg)
    return found


def cached_joint(way: Literal["flat", "deployed"], joint: JointShape) -> FlatJoint:
    """Return a joint as it was once simulated; as `known_joint`, without the table."""
    found = _from_cache(way, joint)
    if found is None:
        raise UnknownJointError(joint)
    return found


def _from_cache(way: str, joint: JointShape) -> FlatJoint | None:
    """Return a joint from the user's cache; raise what was raised when it was simulated."""
    record = cached(way, joint)
    nearest: FlatJoint | None = None
    if record is not None:
        with suppress(LookupError, ValueError):
            nearest = _joint_record().validate_python(record["found"])
            if nearest is not None and record.get("why") is None:
                return nearest
        if record.get("why"):
            raise UnreachableJointError(joint, nearest, str(record["why"]))
    return None


def _by_cache(
    way: str, joint: JointShape, simulate: Callable[[JointShape], FlatJoint]
) -> FlatJoint:
    """Return a joint from the user's cache, or simulate it and keep it there."""
    if (known := _from_cache(way, joint)) is not None:
        return known
    try:
        found = simulate(joint)
    except UnreachableJointError as error:
        last = None if error.nearest is None else asdict(error.nearest)
        keep(way, joint, {"found": last, "why": error.why})
        raise
    keep(way, joint, {"found": asdict(found)})
    return found


@cache
def _joint_record() -> "TypeAdapter[FlatJoint | None]":
    return TypeAdapter(FlatJoint | None)


def simulated_deployed_joint(flat: JointShape) -> FlatJoint:
    """Return the deployed shape of a flat joint, by one simulation; as `deployed_joint`."""
    try:
        return FlatJoint.of(inflated_joint(flat))
    except VinefabError as error:
        raise UnreachableJointError(flat, None, str(error)) from error


def simulated_flat_joint(wanted: JointShape) -> FlatJoint:
    """Return the flat joint whose children deploy at given angles, by simulations; as `flat_joint`.

    Newton's method. Small steps keep their triangles, so that it converges; differences between
    meshes are left. It starts from the values of the law, of uneven fans and bends: 2.3 simulations
    in the mean of 48 such joints instead of 3.9. Where children crowd it may stall: then it starts
    again, and once more from the values of the table, if that knows the joint.
    """
    starts = [likely_flat_deg(np.array(wanted.angles_deg))]
    if (told := _by_law("flat", wanted)) is not None:
        starts.insert(0, np.array(told.flat.angles_deg))
    for start_deg in starts[:-1]:
        with suppress(UnreachableJointError):
            return _solved(wanted, start_deg)
    try:
        return _solved(wanted, starts[-1])
    except UnreachableJointError:
        told = _by_table("flat", wanted)
        if told is None:
            raise
        return _solved(wanted, np.array(told.flat.angles_deg))


def _solved(wanted: JointShape, start_deg: Floats) -> FlatJoint:
    """Return the flat joint that Newton's method finds from some flat angles."""
    goal = np.array(wanted.angles_deg)
    even = is_even(wanted)
    best: InflatedJoint | None = None
    flat, best_off, step = start_deg, np.inf, np.zeros_like(goal)
    for _ in range(MOST_SIMULATIONS):
        try:
            aim, found = wanted.with_angles(tuple(flat.tolist())), None
            if best is not None:
                turn_deg = np.abs(np.subtract(aim.angles_deg, best.joint.angles_deg)).max()
                if turn_deg <= _FURTHEST_FOLLOWED_DEG:
                    with suppress(BadInputError, NotConvergedError):
                        found = turned_joint(best, aim.angles_deg)
            found = found or inflated_joint(aim)
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
            slopes = found.sensitivity()
            if even:  # turning as a whole, which may be very soft, takes no part
                fans = (np.eye(len(goal)) - np.eye(len(goal))[::-1]) / 2.0
                slopes = fans @ slopes @ fans
            # Damped: where children crowd, weak slopes are as uncertain as they are small.
            damped = slopes.T @ slopes + _WEAK_SLOPE**2 * np.eye(len(goal))
            step = np.linalg.solve(damped, slopes.T @ off)
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


def is_even(joint: JointShape) -> bool:
    """Return whether a joint is its own mirror image."""
    pairs = zip(
        (*joint.angles_deg, *joint.widths, *joint.fillets),
        (*joint.mirrored.angles_deg, *joint.mirrored.widths, *joint.mirrored.fillets),
        strict=True,
    )
    return all(abs(one - two) < 1e-9 for one, two in pairs)


def likely_flat_deg(wanted_deg: Floats) -> Floats:
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
