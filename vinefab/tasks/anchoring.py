"""Anchoring: how much more than one pouch the branched robot holds."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.growth.batch import Block
from vinefab.model.checked import Floats, Ints, number
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build
from vinefab.physics.anchoring import ASSUMED_FRICTION, pouch_contact_mm2
from vinefab.physics.lumen import inflated_diameter_mm
from vinefab.physics.pressure import N_MM2_PER_KPA
from vinefab.tasks.ground import Ground
from vinefab.tasks.task import Outcome, Outcomes, together

IDLE_SHARE = 1.0 / 3.0
"""Share of engaged branches that may hold nothing: two of six in the paper's test."""

TOUCHING_MM = 1e-6
"""A wall so near to a tip is one that it lies on; tips are right to about 1e-9 mm."""

STEP_BACK_MM = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Anchoring:
    """Anchoring force of all leaf pouches over that of one pouch without any turn.

    ``sum over engaged leaves of exp(mu gamma)``, gamma the absolute turns at contacts and base
    hinges from the base to the leaf's tip (paper, equations 1 and 2; pressure and contact area
    cancel). A leaf is engaged when it deployed and its inflated pouch is wider than the gap that
    its tip ended in: free space across the branch there. The pouch is the one given here, or else
    the design's own; without any, every leaf that deployed counts, as in the paper.

    Parameters
    ----------
    friction
        Friction coefficient mu of film on the obstacles; the default is an assumption.
    friction_low, friction_high
        Its range, for the interval in the terms.
    count_joint_angles
        Whether the planned angles at joints count as turns too.
    pouch_length_mm, pouch_width_mm
        Flat size of every leaf's pouch, along and across; 0: the design's own.
    only_full_length
        Whether a leaf that was stopped early counts as not engaged: its pouch sits at the very
        end of the film and has not come out.
    film_n_mm, seam_n_mm
        Pull per mm of circumference at which the film tears (strength times thickness) and the
        seam opens; 0: not known. Where one is known, as are pressure and pouch, no branch holds
        more than its weaker one.
    """

    name: ClassVar[str] = "anchoring"
    lowest: ClassVar[float] = 0.0

    friction: float = ASSUMED_FRICTION.value
    friction_low: float = ASSUMED_FRICTION.low
    friction_high: float = ASSUMED_FRICTION.high
    count_joint_angles: bool = False
    pouch_length_mm: float = 0.0
    pouch_width_mm: float = 0.0
    only_full_length: bool = False
    film_n_mm: float = 0.0
    seam_n_mm: float = 0.0

    def __post_init__(self) -> None:
        number("task.friction", self.friction, 0.0, 3.0)
        number("task.friction_low", self.friction_low, 0.0, self.friction)
        number("task.friction_high", self.friction_high, self.friction, 3.0)
        for name in ("pouch_length_mm", "pouch_width_mm"):
            number(f"task.{name}", getattr(self, name), 0.0, 1e4, "mm")
        if (self.pouch_length_mm > 0.0) != (self.pouch_width_mm > 0.0):
            missing = "pouch_width_mm" if self.pouch_length_mm > 0.0 else "pouch_length_mm"
            allowed = "above 0: a pouch has a length and a width"
            raise BadInputError(f"task.{missing}", 0.0, allowed)
        for name in ("film_n_mm", "seam_n_mm"):
            number(f"task.{name}", getattr(self, name), 0.0, 1e6, "N/mm")

    def evaluate(self, deployment: Deployment, ground: Ground) -> Outcome:
        """Return the amplification and its terms; the design's own pouch is not known here."""
        return self._outcome(deployment, ground, None)

    def evaluate_block(self, block: Block, grounds: Sequence[Ground]) -> Outcomes:
        """Return amplification and terms for every growth of a block, with the designs' pouches.

        Parameters
        ----------
        block
            Growths, map by map.
        grounds
            The maps.
        """
        terrain, plan = block.terrain.tolist(), block.plan.tolist()
        return together(
            [
                self._outcome(
                    block.deployment(index),
                    grounds[terrain[index]],
                    block.plans.each[plan[index]].build,
                )
                for index in range(len(block))
            ]
        )

    def _outcome(self, deployment: Deployment, ground: Ground, build: Build | None) -> Outcome:
        """Return the amplification, its interval over friction and idle branches, and the rest.

        Terms: ``leaves`` that deployed; ``engaged`` of them; ``mean_turn_rad`` and
        ``largest_turn_rad`` of those; ``low``, the amplification at the low friction with a third
        of the engaged leaves idle, those that turned most; ``high``, with all at the high one;
        ``force_n``, what they hold together, 0 where pouch or pressure are not known; ``capped``,
        how many are held back by film or seam.
        """
        leaves = self._leaves(deployment)
        engaged, contact_mm2 = self._contacts(deployment, ground, leaves, self._pouch_mm(build))
        turns_rad = path_turn_rad(deployment, joints=self.count_joint_angles)[leaves[engaged]]
        order = np.argsort(turns_rad, kind="stable")
        pull = Pull(
            turns_rad=turns_rad[order],
            press_n=self._press_n(build) * contact_mm2[engaged][order],
            limit_n=self._limit_n(build),
        )
        held = pull.amplifications(self.friction)
        sure = math.ceil(len(held) * (1.0 - IDLE_SHARE) - 1e-9)
        return float(held.sum()), {
            "leaves": float(len(leaves)),
            "engaged": float(len(held)),
            "mean_turn_rad": float(turns_rad.mean()) if len(held) else 0.0,
            "largest_turn_rad": float(turns_rad.max(initial=0.0)),
            "low": float(pull.amplifications(self.friction_low)[:sure].sum()),
            "high": float(pull.amplifications(self.friction_high).sum()),
            "force_n": float((held * pull.press_n).sum() * self.friction),
            "capped": float(np.count_nonzero(held < np.exp(self.friction * pull.turns_rad))),
        }

    def _leaves(self, deployment: Deployment) -> Ints:
        """Return the leaves whose tips came out, shape (m,)."""
        out = deployment.tree.is_leaf & deployment.deployed & (deployment.grown_mm > 0.0)
        if self.only_full_length:
            out &= np.equal(deployment.stop, Stop.FULL_LENGTH)
        return np.flatnonzero(out)

    def _contacts(
        self, deployment: Deployment, ground: Ground, leaves: Ints, size_mm: tuple[float, float]
    ) -> tuple[NDArray[np.bool_], Floats]:
        """Return which leaves are engaged, and the area that each pouch presses on a wall."""
        length_mm, width_mm = size_mm
        if width_mm == 0.0:
            return np.ones(len(leaves), dtype=np.bool_), np.zeros(len(leaves))
        gap_mm = tip_gaps_mm(deployment, leaves, ground)
        contact_mm2 = [pouch_contact_mm2(length_mm, width_mm, gap) for gap in gap_mm.tolist()]
        return inflated_diameter_mm(width_mm) > gap_mm, np.array(contact_mm2, dtype=np.float64)

    def _pouch_mm(self, build: Build | None) -> tuple[float, float]:
        """Return flat length and width of the pouches, zeros where there are none."""
        if self.pouch_width_mm > 0.0:
            return self.pouch_length_mm, self.pouch_width_mm
        pouch = build.pouch if build else None
        if pouch is None:
            return 0.0, 0.0
        # A round pouch is taken for the square of the same area.
        side_mm = math.sqrt(math.pi) * (pouch.radius_mm or 0.0)
        return pouch.length_mm or side_mm, pouch.width_mm or side_mm

    def _press_n(self, build: Build | None) -> float:
        """Return the force per mm2 of contact on both walls together, 2 P; 0 where unknown."""
        return 2.0 * N_MM2_PER_KPA * build.pressure_kpa if build else 0.0

    def _limit_n(self, build: Build | None) -> float:
        """Return the most that one leaf can be pulled with, infinite where that is not known."""
        known = [load for load in (self.film_n_mm, self.seam_n_mm) if load > 0.0]
        if build is None or not known:
            return math.inf
        return 2.0 * build.widths_mm[-1] * min(known)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pull:
    """The engaged leaves of one robot, those that turned least first.

    Parameters
    ----------
    turns_rad
        Turn on the way to each tip, shape (m,).
    press_n
        Force of each pouch on both its walls, shape (m,); 0 where it is not known.
    limit_n
        The most that one leaf can be pulled with.
    """

    turns_rad: Floats
    press_n: Floats
    limit_n: float

    def amplifications(self, friction: float) -> Floats:
        """Return what each leaf holds over what its pouch alone holds, shape (m,).

        e^(mu gamma), or less where the film would tear or the seam open before that.
        """
        tip_n = self.press_n * friction
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.where(tip_n > 0.0, self.limit_n / tip_n, np.inf)
        return np.asarray(np.minimum(np.exp(friction * self.turns_rad), most))


def path_turn_rad(deployment: Deployment, *, joints: bool = False) -> Floats:
    """Return the sum of absolute turns from the base to each tip, shape (n,).

    Parameters
    ----------
    deployment
        Where the robot ended.
    joints
        Whether planned angles at joints count beside those at contacts and base hinges.
    """
    tree = deployment.tree
    total = deployment.contact_turn_rad.copy()
    if joints:
        total += np.abs(tree.offset_rad)
    for level in range(2, int(tree.level.max()) + 1):
        members = tree.level == level
        total[members] += total[tree.parent[members]]
    return total


def tip_gaps_mm(deployment: Deployment, branches: Ints, ground: Ground) -> Floats:
    """Return how wide free space is at the tips of some branches, across each, shape (m,).

    Exact for the map's walls, measured 1e-3 mm behind the tip; a tip that lies on a wall has its
    gap on the free side.

    Parameters
    ----------
    deployment
        Where the robot ended.
    branches
        Branches that have grown, shape (m,).
    ground
        The map.
    """
    from vinefab.tasks import area_kernel  # noqa: PLC0415  numba takes a second to import

    last = deployment.first_point[1:][branches] - 1
    tips = deployment.points_mm[last]
    along = tips - deployment.points_mm[last - 1]
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)[:, None]
    along = along / length
    # A little behind the tip: where a branch stopped at a wall, across it is along the wall.
    tips = tips - np.minimum(STEP_BACK_MM, 0.5 * length) * along
    across = np.column_stack([-along[:, 1], along[:, 0]])
    out = np.zeros(len(branches))
    area_kernel.gaps(tips, across, ground.edges_mm, TOUCHING_MM, out)
    return out
