"""The law of single joints: what uneven fans and bends turn to, without a simulation.

Fitted to simulated joints drawn at random (``law.npz``, made by ``tests/inflation/make_law.py``):
two small networks, one that tells flat angles from deployed ones, one that tells deployed from flat
ones. Each child is told from its own angle and width, and from its two neighbours on either side
with the gaps to them, where the parent is a neighbour too. Mirrored joints are mirrored exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.inflation.joint import JointShape
from vinefab.inflation.membrane import Bools
from vinefab.inflation.table import FILLET, simulation_fingerprint

PATH = Path(__file__).with_name("law.npz")

MOST_CHILDREN = 4

RATIO, STRAIN = (0.4, 1.0), (0.002, 0.3)
"""Ranges of the law: child over parent width, hoop strain; the fillets are the table's."""

LEAST_GAP_DEG = 15.0
"""Deployed siblings that are nearer to each other are beyond the law."""

MOST_ANGLE_DEG = 110.0
"""Children that turn further are beyond the law."""

ABOUT = 8
"""Numbers that tell of the neighbours on one side."""

INPUTS = 5 + 2 * ABOUT
OUTPUTS = 5  # turn, side offset, pull-back, passage, logarithm of the crotch load

STRAIGHT = (0.0, 0.0, 0.0, 1.0, 0.0)
"""Outputs of a bend of 0 degrees, which is none."""

Way = Literal["flat", "deployed"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Joints:
    """Joints as arrays, a row each; what lies beyond a joint's children counts nothing."""

    angles_deg: Floats  # of each child, rising: deployed or flat ones, shape (m, 4)
    count: Ints  # children, shape (m,)
    ratios: Floats  # width of each child over the parent's, shape (m, 4)
    # Fillet radius of each gap over the parent's width: from the parent's right side to the first
    # child, between children, from the last to the parent's left side, shape (m, 5).
    fillets: Floats
    strain: Floats  # hoop strain of the parent, shape (m,)
    is_bend: Bools  # shape (m,)

    @classmethod
    def of(cls, joints: Sequence[JointShape]) -> "Joints":
        """Return joints of at most `MOST_CHILDREN` children as arrays."""

        def padded(rows: Sequence[tuple[float, ...]], most: int, rest: float) -> Floats:
            return np.array([[*row, *(rest,) * (most - len(row))] for row in rows])

        fillets = [
            (min(one.fillets),) * len(one.fillets) if one.is_bend else one.fillets for one in joints
        ]
        return cls(
            angles_deg=padded([one.angles_deg for one in joints], MOST_CHILDREN, 0.0),
            count=np.array([len(one.angles_deg) for one in joints]),
            ratios=padded([one.widths for one in joints], MOST_CHILDREN, 0.0),
            fillets=padded(fillets, MOST_CHILDREN + 1, 0.0),
            strain=np.array([one.hoop_strain for one in joints]),
            is_bend=np.array([one.is_bend for one in joints]),
        )

    def taken(self, rows: Ints) -> "Joints":
        """Return the joints in some rows, in arrays of their own."""
        return Joints(**{one.name: getattr(self, one.name)[rows] for one in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LawJoints:
    """Joints by the law; lengths in widths of the parent. NaN beyond a joint's children."""

    angles_deg: Floats  # flat ones, or deployed ones, of each child, shape (m, 4)
    pull_backs: Floats  # shape (m, 4)
    side_offsets: Floats  # shape (m, 4)
    passages: Floats  # into the child where least passes, shape (m,)
    crotch_loads: Floats  # over the load of the parent's straight seam, shape (m,)
    is_within: Bools  # whether the joint is within the law's range, shape (m,)
    # By how much gaps are narrower than the law knows, or turns wider, relative to that; (m,).
    beyond: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Network:
    """What tells one way: two layers of units x / sqrt(1 + x^2), and a linear one."""

    first: Floats  # shape (INPUTS + 1, k); the last row stands alone, here and in the others
    second: Floats  # shape (k + 1, k)
    last: Floats  # shape (k + 1, OUTPUTS): degrees, and widths of the parent

    def __call__(self, x: Floats) -> Floats:
        """Return the outputs of children, shape (k, OUTPUTS)."""
        odd = np.arange(OUTPUTS) < 2
        here, there = self._at(x), self._at(mirrored(x))
        return np.where(odd, here - there, here + there) / 2.0

    def _at(self, x: Floats) -> Floats:
        for weights in (self.first, self.second):
            z = x @ weights[:-1] + weights[-1]
            x = z / np.sqrt(1.0 + z * z)
        found: Floats = x @ self.last[:-1] + self.last[-1]
        return found


@cache
def law_within_deg(way: Way) -> float:
    """Return within how many degrees 19 of 20 simulated joints are of the law; their worst child.

    Joints that it was not fitted to, drawn at random from its range.
    """
    with np.load(PATH, allow_pickle=False) as file:
        return float(file[f"{way}_within_deg"])


def gap_fillets(own: Floats, count: Ints) -> Floats:
    """Return the fillets of gaps, shape (m, 5), of joints whose children have such, shape (m, 4).

    Between two children the smaller one; next to the parent the child's own.
    """
    m, gaps = len(own), np.zeros((len(own), MOST_CHILDREN + 1))
    gaps[:, 0] = own[:, 0]
    gaps[:, 1:-1] = np.minimum(own[:, :-1], own[:, 1:])
    gaps[np.arange(m), count] = own[np.arange(m), count - 1]
    return gaps


def inputs(joints: Joints) -> tuple[Floats, Ints, Ints]:
    """Return what tells of each child, shape (k, INPUTS), and the joint and place of each.

    A child's neighbours are those that follow around the joint, the parent among them.
    """
    row, child = np.nonzero(np.arange(MOST_CHILDREN) < joints.count[:, None])
    around = joints.count[row] + 1
    own_deg = joints.angles_deg[row, child]
    x = np.zeros((len(row), INPUTS))
    x[:, 0] = own_deg / 60.0
    x[:, 1] = 2.0 * joints.ratios[row, child] - 1.4
    x[:, 2] = np.log(joints.strain[row]) / 2.0 + 1.8
    x[:, 3] = joints.is_bend[row]
    x[:, 4] = joints.count[row] / 2.0 - 1.25
    for side, way in enumerate((1, -1)):
        base, before_deg = 5 + side * ABOUT, own_deg
        for step in (0, 1):
            # Around the joint: 0 the parent, then the children.
            place = (child + 1 + way * (step + 1)) % around
            is_parent = place == 0
            there_deg = np.where(is_parent, 180.0, joints.angles_deg[row, np.maximum(place - 1, 0)])
            gap = (way * (there_deg - before_deg)) % 360.0
            gap = np.where(gap == 0.0, 360.0, gap)
            width = np.where(is_parent, 1.0, joints.ratios[row, np.maximum(place - 1, 0)])
            between = child + 1 + step if way > 0 else child - step
            fillet = np.log(joints.fillets[row, between % around]) + 2.0
            near = [gap / 60.0 - 1.5, np.exp(-gap / 25.0) * 2.0, fillet, 2.0 * width - 1.4]
            x[:, base + 4 * step : base + 4 * step + 4] = np.column_stack(near)
            before_deg = there_deg
    return x, row, child


def mirrored(x: Floats) -> Floats:
    """Return the inputs of children seen from below."""
    there = x.copy()
    there[:, 0] = -x[:, 0]
    there[:, 5 : 5 + ABOUT], there[:, 5 + ABOUT :] = x[:, 5 + ABOUT :], x[:, 5 : 5 + ABOUT]
    return there


@cache
def network(way: Way) -> Network | None:
    """Return what tells flat angles of deployed ones, or the reverse; None of another simulation.

    Parameters
    ----------
    way
        Which angles are told.
    """
    try:
        with np.load(PATH, allow_pickle=False) as file:
            if str(file["fingerprint"]) != simulation_fingerprint():
                return None
            arrays = {name: file[f"{way}_{name}"].astype(np.float64) for name in ARRAYS}
    except (OSError, ValueError, KeyError):
        return None
    return Network(**arrays)


ARRAYS = ("first", "second", "last")


def law_of(way: Way, joints: Joints) -> LawJoints | None:
    """Return the flat angles of joints that shall deploy so, or the deployed ones of flat joints.

    Joints beyond the law's range are told as if they were at its end.

    Parameters
    ----------
    way
        ``flat`` for flat angles from deployed ones, ``deployed`` for the reverse.

    Returns
    -------
    LawJoints or None
        None where the law that ships is of another simulation.
    """
    net = network(way)
    if net is None:
        return None
    there = joints.count[:, None] > np.arange(MOST_CHILDREN)
    near = Joints(
        angles_deg=joints.angles_deg,
        count=joints.count,
        ratios=np.clip(joints.ratios, *RATIO),
        fillets=np.clip(joints.fillets, *FILLET),
        strain=np.clip(joints.strain, *STRAIN),
        is_bend=joints.is_bend,
    )
    x, row, child = inputs(near)
    found = net(x)
    found[:, 0] *= 1.0 if way == "deployed" else -1.0
    values = np.full((OUTPUTS, len(joints.count), MOST_CHILDREN), np.nan)
    straight = near.is_bend[row] & (near.angles_deg[row, child] == 0.0)
    found[straight] = STRAIGHT
    values[:, row, child] = found.T
    ratios = (joints.ratios >= RATIO[0]) & (joints.ratios <= RATIO[1])
    within = (ratios & (np.abs(joints.angles_deg) <= MOST_ANGLE_DEG)) | ~there
    gaps = np.diff(joints.angles_deg, axis=1)
    within[:, 1:] &= (gaps >= LEAST_GAP_DEG) | ~there[:, 1:]
    unused = np.arange(MOST_CHILDREN + 1) > joints.count[:, None]
    fillets = (near.fillets == joints.fillets) | unused
    strains = near.strain == joints.strain
    return LawJoints(
        angles_deg=joints.angles_deg + values[0],
        side_offsets=values[1],
        pull_backs=values[2],
        passages=np.clip(np.nanmin(values[3], axis=1), 0.1, 1.0),
        crotch_loads=np.exp(np.nanmax(values[4], axis=1)),
        is_within=np.asarray(within.all(axis=1) & fillets.all(axis=1) & strains, dtype=np.bool_),
        beyond=np.maximum(
            np.where(there, np.abs(joints.angles_deg) / MOST_ANGLE_DEG - 1.0, 0.0).max(axis=1),
            np.where(there[:, 1:], 1.0 - gaps / LEAST_GAP_DEG, 0.0).max(axis=1),
        ).clip(0.0),
    )


def flat_by_law(joints: Joints, gain: float = 1.0) -> LawJoints | None:
    """Return the flat joints whose children deploy as wanted, where film turns by so many times.

    Parameters
    ----------
    gain
        How far joints turn over the simulated, as measured; 1 without a measurement.
    """
    found, aim = law_of("flat", joints), joints
    if gain == 1.0 or found is None:
        return found
    for _ in range(_GAIN_STEPS):
        turned_deg = found.angles_deg + gain * (aim.angles_deg - found.angles_deg)
        off_deg = np.nan_to_num(joints.angles_deg - turned_deg)
        aim = replace(aim, angles_deg=aim.angles_deg + off_deg)
        again = law_of("flat", aim)
        assert again is not None  # noqa: S101  as before
        found = replace(again, is_within=found.is_within, beyond=found.beyond)
    return found


_GAIN_STEPS = 8


def law_slopes(joints: Joints) -> Floats:
    """Return d deployed / d flat of flat joints, shape (m, 4, 4); nothing beyond their children."""
    # Each child of each joint a degree further, and a degree less far: all of them together.
    m, further = len(joints.count), np.repeat(np.eye(MOST_CHILDREN), 2, axis=0)
    further[1::2] *= -1.0
    rows = np.repeat(np.arange(m), len(further))
    turned = joints.taken(rows)
    turned.angles_deg[:] += np.tile(further, (m, 1))
    found = law_of("deployed", turned)
    assert found is not None  # noqa: S101  asked for where there is a law
    there = np.nan_to_num(found.angles_deg).reshape(m, MOST_CHILDREN, 2, MOST_CHILDREN)
    slopes: Floats = ((there[:, :, 0] - there[:, :, 1]) / 2.0).swapaxes(1, 2)
    return slopes
