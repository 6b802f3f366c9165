"""The anchoring task: how much more than one pouch a branched robot holds, leaf by leaf."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints, number
from vinefab.growth.batch import Block
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build
from vinefab.physics.anchoring import ASSUMED_FRICTION, pouch_contacts_mm2
from vinefab.physics.seam import N_MM2_PER_KPA
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.tasks.exact_areas import TOUCHING_MM
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome, TaskOutcomes

STEP_BACK_MM = 1e-3
"""Gaps are measured this far behind the tip."""


class GrownBatch(NamedTuple):
    """The final states of j growths, concatenated."""

    # parent, tree_first: the planned trees, as in `vinefab.growth.arrays.TreesArrays`
    parent: Ints
    tree_first: Ints
    tree: Ints  # tree of each growth, shape (j,)
    # branch, room: where each growth's branches and chain points begin, shape (j + 1,) each
    branch: Ints
    room: Ints
    # the results, as in `vinefab.growth.arrays.Growth`
    points: Floats
    first_point: Ints
    stop: Ints
    grown: Floats
    turn: Floats

    @classmethod
    def of_block(cls, block: Block) -> "GrownBatch":
        """Return the growths of a block."""
        trees, growth = block.plans.trees, block.growth
        return cls(
            parent=_fixed(trees.parent),
            tree_first=_fixed(trees.first),
            tree=block.plan,
            branch=block.branch,
            room=block.room,
            points=growth.points,
            first_point=growth.first_point,
            stop=growth.stop,
            grown=growth.grown,
            turn=growth.turn,
        )

    @classmethod
    def of(cls, deployment: Deployment) -> "GrownBatch":
        """Return one growth."""
        ends = np.array([0, len(deployment.tree)])
        return cls(
            parent=_fixed(deployment.tree.parent),
            tree_first=_fixed(ends),
            tree=np.zeros(1, dtype=np.int64),
            branch=ends,
            room=np.array([0, len(deployment.points_mm)]),
            points=deployment.points_mm,
            first_point=deployment.first_point,
            stop=deployment.stop,
            grown=deployment.grown_mm,
            turn=deployment.contact_turn_rad,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leaves:
    """The m leaves of j growths that deployed, growth by growth."""

    growths: int  # number of growths
    growth: Ints  # growth of each leaf, rising, shape (m,)
    turn_rad: Floats  # sum of absolute turns from the base to each tip, shape (m,)
    points_mm: Floats  # chain points of all growths, shape (p, 2)
    tip: Ints  # index of each tip among them, shape (m,)

    @classmethod
    def of(cls, grown: GrownBatch, joints_rad: Floats | None, *, whole: bool) -> "Leaves":
        """Return the leaves of some growths.

        Parameters
        ----------
        joints_rad
            Turns that count beside those of the growth, one per branch, or None.
        whole
            Whether only leaves grown to their full length count.
        """
        turn_rad, is_leaf = summed_turns(grown, joints_rad)
        out = is_leaf & np.not_equal(grown.stop, Stop.NOT_DEPLOYED) & (grown.grown > 0.0)
        if whole:
            out &= np.equal(grown.stop, Stop.FULL_LENGTH)
        leaf = np.flatnonzero(out)
        growth = np.searchsorted(grown.branch, leaf, side="right") - 1
        # Every growth has one more entry in `first_point` than it has branches.
        tip = grown.room[growth] + grown.first_point[leaf + growth + 1] - 1
        return cls(
            growths=len(grown.tree),
            growth=growth,
            turn_rad=turn_rad[leaf],
            points_mm=grown.points,
            tip=tip,
        )

    def of_growths(self, one: int, two: int) -> slice:
        """Return which leaves belong to the growths ``one .. two - 1``."""
        first, last = np.searchsorted(self.growth, [one, two]).tolist()
        return slice(first, last)


def summed_turns(grown: GrownBatch, joints_rad: Floats | None) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the sum of absolute turns from the base to each tip, and which branches are leaves.

    Parameters
    ----------
    joints_rad
        Turns that count beside those of the growth, shape (n,), or None.
    """
    from vinefab.tasks.kernels import tips_kernel  # noqa: PLC0415  numba takes a second to import

    total = grown.turn.copy()
    if joints_rad is not None:
        total += joints_rad
    leaf = np.empty(len(total), dtype=np.bool_)
    tips_kernel.turns(grown.parent, grown.tree_first, grown.tree, grown.branch, total, leaf)
    return total, leaf


def path_turn_rad(deployment: Deployment) -> Floats:
    """Return the sum of absolute turns from the base to each tip, without joints, shape (n,)."""
    return summed_turns(GrownBatch.of(deployment), None)[0]


def tip_gaps_mm(deployment: Deployment, branches: Ints, context: MapContext) -> Floats:
    """Return the width of free space at the tips of some branches, across each, shape (m,).

    Parameters
    ----------
    branches
        Branches that have grown, shape (m,).
    """
    return gaps_mm(deployment.points_mm, deployment.first_point[1:][branches] - 1, context)


def gaps_mm(points_mm: Floats, tip: Ints, context: MapContext) -> Floats:
    """Return the width of free space at some tips, across the body there, shape (m,).

    Exact for the map's walls, measured 1e-3 mm behind the tip; a tip that lies on a wall has its
    gap on the free side.

    Parameters
    ----------
    tip
        Index of each tip among them, shape (m,); the point before each is on the same branch.
    """
    from vinefab.tasks.kernels import tips_kernel  # noqa: PLC0415  as above

    tips = points_mm[tip]
    along = tips - points_mm[tip - 1]
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)[:, None]
    along = along / length
    # A little behind the tip: where a branch stopped at a wall, across it is along the wall.
    tips = tips - np.minimum(STEP_BACK_MM, 0.5 * length) * along
    across = np.column_stack([-along[:, 1], along[:, 0]])
    cells, out = context.cells, np.zeros(len(tip))
    tips_kernel.gaps(
        tips, across, cells.walls_mm, cells.grid, cells.first, cells.item, TOUCHING_MM, out
    )
    return out


def _fixed(array: Ints) -> Ints:
    # Arrays that may be written to are another type to the compiler, which would compile twice.
    view = array.view()
    view.setflags(write=False)
    return view


class Pouches(NamedTuple):
    """The pouches of j robots, each of shape (j,)."""

    # length_mm, width_mm: flat size, 0 without a pouch
    length_mm: Floats
    width_mm: Floats
    # force per mm2 of contact on both walls together, 2 P; 0 where the pressure is unknown
    press_n_mm2: Floats
    limit_n: Floats  # largest pull that one leaf stands, infinite where it is unknown


def contacts(
    leaves: Leaves, pouches: Pouches, places: Sequence[tuple[MapContext, int, int]]
) -> tuple[NDArray[np.bool_], Floats]:
    """Return which leaves are engaged, and the area that each pouch presses on a wall.

    ``places`` are the growths ``one .. two - 1`` on each map.
    """
    length_mm, width_mm = pouches.length_mm[leaves.growth], pouches.width_mm[leaves.growth]
    gap_mm, has_pouch = np.zeros(len(width_mm)), width_mm > 0.0
    if not has_pouch.any():
        return ~has_pouch, gap_mm
    for context, one, two in places:
        here = leaves.of_growths(one, two)
        rows = here.start + np.flatnonzero(has_pouch[here])
        gap_mm[rows] = gaps_mm(leaves.points_mm, leaves.tip[rows], context)
    engaged = ~has_pouch | (inflated_diameter_mm(width_mm) > gap_mm)
    return engaged, pouch_contacts_mm2(length_mm, width_mm, gap_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EngagedLeaves:
    """The m engaged leaves of j robots, robot by robot, those that turned least first."""

    growths: int  # number of robots
    growth: Ints  # robot of each leaf, rising, shape (m,)
    turns_rad: Floats  # turn on the way to each tip, shape (m,)
    press_n: Floats  # force of each pouch on both its walls, shape (m,); 0 where it is unknown
    limit_n: Floats  # largest pull that each leaf stands, shape (m,)

    def amplifications(self, friction: float) -> Floats:
        """Return the force of each leaf over that of its pouch alone, shape (m,).

        e^(mu gamma), or less where film or seam fails before.
        """
        tip_n = self.press_n * friction
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.where(tip_n > 0.0, self.limit_n / tip_n, np.inf)
        return np.asarray(np.minimum(np.exp(friction * self.turns_rad), most))

    def summed(self, values: Floats) -> Floats:
        """Return the sum of one number per leaf over the leaves of each robot, shape (j,)."""
        # In the order of the leaves, so that no robot's sum depends on the others.
        sums = np.bincount(self.growth, weights=values, minlength=self.growths)
        return sums.astype(np.float64, copy=False)

    def are_among_first(self, share: float) -> NDArray[np.bool_]:
        """Tell which leaves are among the share that turned least, rounded up, shape (m,)."""
        ends = np.searchsorted(self.growth, np.arange(self.growths + 1))
        count = np.ceil(np.diff(ends) * share - 1e-9)
        rank = np.arange(len(self.growth)) - ends[self.growth]
        return np.asarray(rank < count[self.growth])

    def largest_turns_rad(self) -> Floats:
        """Return the largest turn of each robot's leaves, shape (j,); 0 where it has none."""
        ends = np.searchsorted(self.growth, np.arange(self.growths), side="right")
        there = np.diff(ends, prepend=0) > 0
        largest = np.zeros(self.growths)
        largest[there] = self.turns_rad[ends[there] - 1]
        return largest


IDLE_SHARE = 1.0 / 3.0
"""Share of engaged branches that may hold nothing: two of six in the paper's test."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Anchoring:
    """Anchoring force of all leaf pouches over that of one pouch without any turn.

    ``sum over engaged leaves of exp(mu gamma)``, gamma the absolute turns at contacts and base
    hinges from the base to the leaf's tip (paper, equations 1 and 2; pressure and contact area
    cancel). A leaf is engaged when it deployed and its inflated pouch is wider than the gap that
    its tip ended in: free space across the branch there. The pouch is the one given here, or else
    the design's own; without any, every leaf that deployed counts, as in the paper.
    """

    name: ClassVar[str] = "anchoring"
    lowest: ClassVar[float] = 0.0

    # friction coefficient mu of film on the obstacles; the default is an assumption
    friction: float = ASSUMED_FRICTION.value
    # friction_low, friction_high: its range, for the interval in the terms
    friction_low: float = ASSUMED_FRICTION.low
    friction_high: float = ASSUMED_FRICTION.high
    count_joint_angles: bool = False  # whether the planned angles at joints count as turns too
    # pouch_length_mm, pouch_width_mm: flat size of every leaf's pouch, along and across; 0: the
    # design's own
    pouch_length_mm: float = 0.0
    pouch_width_mm: float = 0.0
    # whether a leaf that stopped early counts as not engaged: its pouch sits at the very end of the
    # film and has not everted
    only_full_length: bool = False
    # film_n_mm, seam_n_mm: pull per mm of circumference at which the film tears (strength times
    # thickness) and the seam opens; 0: not known. Where one is known, as are pressure and pouch, no
    # branch holds more than its weaker one.
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

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the amplification and its terms; the design's own pouch is unknown here."""
        joints_rad = np.abs(deployment.tree.offset_rad) if self.count_joint_angles else None
        leaves = Leaves.of(GrownBatch.of(deployment), joints_rad, whole=self.only_full_length)
        pouches = self._pouches([None], np.zeros(1, dtype=np.int64))
        return self._outcomes(leaves, pouches, [(context, 0, 1)]).one(0)

    def parts(self, score: float, terms: Mapping[str, float]) -> dict[str, float]:
        """Return what the engaged pouches hold alone, and what turns on the way to them add."""
        alone = terms["engaged"]
        return {"engaged pouches, each alone": alone, "turns at contacts": score - alone}

    def evaluate_block(self, block: Block, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return amplification and terms for every growth of a block, with the designs' pouches."""
        used, which = np.unique(block.plan, return_inverse=True)
        plans = [block.plans.each[index] for index in used.tolist()]
        joints_rad = None
        if self.count_joint_angles:
            own = [np.abs(plan.tree.offset_rad) for plan in plans]
            joints_rad = np.concatenate([own[index] for index in which.tolist()])
        leaves = Leaves.of(GrownBatch.of_block(block), joints_rad, whole=self.only_full_length)
        places = [(contexts[terrain], one, two) for terrain, one, two in block.by_terrain()]
        return self._outcomes(leaves, self._pouches([plan.build for plan in plans], which), places)

    def _outcomes(
        self, leaves: Leaves, pouches: Pouches, places: Sequence[tuple[MapContext, int, int]]
    ) -> TaskOutcomes:
        """Return the amplification, its interval over friction and idle branches, and other terms.

        Terms: ``leaves`` that deployed; ``engaged`` of them; ``mean_turn_rad`` and
        ``largest_turn_rad`` of those; ``low``, the amplification at the low friction with a third
        of the engaged leaves idle, those that turned most; ``high``, with all at the high one;
        ``force_n``, their total force, 0 where pouch or pressure is unknown; ``capped``, how many
        are limited by film or seam.
        """
        is_engaged, contact_mm2 = contacts(leaves, pouches, places)
        growth, turn_rad = leaves.growth[is_engaged], leaves.turn_rad[is_engaged]
        order = np.lexsort((turn_rad, growth))
        growth = growth[order]
        engaged = EngagedLeaves(
            growths=leaves.growths,
            growth=growth,
            turns_rad=turn_rad[order],
            press_n=pouches.press_n_mm2[growth] * contact_mm2[is_engaged][order],
            limit_n=pouches.limit_n[growth],
        )
        count, factor = engaged.summed(np.ones(len(growth))), engaged.amplifications(self.friction)
        busy = engaged.are_among_first(1.0 - IDLE_SHARE)
        capstan = np.exp(self.friction * engaged.turns_rad)
        terms = {
            "leaves": np.bincount(leaves.growth, minlength=leaves.growths).astype(np.float64),
            "engaged": count,
            "mean_turn_rad": engaged.summed(engaged.turns_rad) / np.maximum(count, 1.0),
            "largest_turn_rad": engaged.largest_turns_rad(),
            "low": engaged.summed(engaged.amplifications(self.friction_low) * busy),
            "high": engaged.summed(engaged.amplifications(self.friction_high)),
            "force_n": engaged.summed(factor * engaged.press_n) * self.friction,
            "capped": engaged.summed(np.less(factor, capstan).astype(np.float64)),
        }
        return TaskOutcomes(engaged.summed(factor), terms)

    def _pouches(self, builds: Sequence[Build | None], which: Ints) -> Pouches:
        """Return the pouches of growths, shape (j,) each.

        Parameters
        ----------
        which
            Design of each growth, shape (j,).
        """
        rows = [
            (*self._pouch_mm(build), self._press_n_mm2(build), self._limit_n(build))
            for build in builds
        ]
        return Pouches(*np.array(rows, dtype=np.float64)[which].T)

    def _pouch_mm(self, build: Build | None) -> tuple[float, float]:
        """Return flat length and width of the pouches, zeros without any."""
        if self.pouch_width_mm > 0.0:
            return self.pouch_length_mm, self.pouch_width_mm
        pouch = build.pouch if build else None
        if pouch is None:
            return 0.0, 0.0
        # A round pouch is taken for the square of the same area.
        side_mm = math.sqrt(math.pi) * (pouch.radius_mm or 0.0)
        return pouch.length_mm or side_mm, pouch.width_mm or side_mm

    def _press_n_mm2(self, build: Build | None) -> float:
        """Return the force per mm2 of contact on both walls together, 2 P; 0 where unknown."""
        return 2.0 * N_MM2_PER_KPA * build.pressure_kpa if build else 0.0

    def _limit_n(self, build: Build | None) -> float:
        """Return the largest pull that one leaf stands, infinite where it is unknown."""
        known = [load for load in (self.film_n_mm, self.seam_n_mm) if load > 0.0]
        if build is None or not known:
            return math.inf
        return 2.0 * build.widths_mm[-1] * min(known)
