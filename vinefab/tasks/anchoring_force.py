"""The anchoring task: how much more than one pouch a branched robot holds, leaf by leaf."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple, TypeVar

import numpy as np
from annotated_types import Ge, Le, Unit
from numpy.typing import NDArray
from pydantic import model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import imported_later
from vinefab.core.table import Table
from vinefab.core.validation import Floats, Ints, number
from vinefab.growth.batch import GrowthBlock
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build
from vinefab.model.score import IDEAL_CASE
from vinefab.model.tree import BranchTree
from vinefab.physics.anchoring import (
    ASSUMED_FRICTION,
    FILM_N_MM,
    SEAM_N_MM,
    branch_limit_n,
    pouch_contacts_mm2,
)
from vinefab.physics.tube import N_MM2_PER_KPA, inflated_diameter_mm
from vinefab.tasks.areas import TOUCHING_MM, Chains
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome, TaskOutcomes

if TYPE_CHECKING:
    from vinefab.tasks import tips_kernel
else:
    tips_kernel = imported_later("vinefab.tasks.tips_kernel")

T = TypeVar("T", bound=np.generic)

STEP_BACK_MM = 1e-3
"""Gaps are measured this far behind the tip."""


class GrownBatch(NamedTuple):
    """The final states of j growths, concatenated."""

    # parent, tree_first: the planned trees, as in `vinefab.growth.arrays.TreesArrays`
    parent: Ints
    tree_first: Ints
    tree: Ints  # tree of each growth, shape (j,)
    chains: Chains  # the bodies
    # the results, as in `vinefab.growth.arrays.Growth`
    stop: Ints
    grown: Floats

    @classmethod
    def of_block(cls, block: GrowthBlock) -> "GrownBatch":
        """Return the growths of a block."""
        trees, growth, chains = block.plans.trees, block.growth, Chains.of_block(block)
        parent, first = _fixed(trees.parent), _fixed(trees.first)
        return cls(parent, first, block.plan, _unwritten(chains), growth.stop, growth.grown)

    @classmethod
    def of(cls, deployment: Deployment) -> "GrownBatch":
        """Return one growth."""
        chains, tree = Chains.of(deployment), deployment.tree
        parent, first = _fixed(tree.parent), _fixed(chains.branch)
        one = np.zeros(1, dtype=np.int64)
        return cls(parent, first, one, _unwritten(chains), deployment.stop, deployment.grown_mm)


def _unwritten(chains: Chains) -> Chains:
    names = ("points_mm", "first_point", "at_bend")
    return chains._replace(**{name: _fixed(getattr(chains, name)) for name in names})


class Turns(NamedTuple):
    """The turns of n branches, and which of them are leaves."""

    # own_rad, path_rad: sums of absolute turns at contacts, of each branch and from the base to
    # each tip, shape (n,); neither joints nor hinges at bases: no wall need be touched there
    own_rad: Floats
    path_rad: Floats
    is_leaf: NDArray[np.bool_]

    @classmethod
    def of(cls, grown: GrownBatch, joints_rad: Floats | None = None) -> "Turns":
        """Return the turns of some growths; ``joints_rad``, one per branch, count too."""
        count = len(grown.stop)
        own = np.zeros(count) if joints_rad is None else joints_rad.copy()
        found = cls(own, np.empty(count), np.empty(count, dtype=np.bool_))
        tips_kernel.turns(
            grown.parent,
            grown.tree_first,
            grown.tree,
            grown.chains.branch,
            grown.chains.room,
            grown.chains.points_mm,
            grown.chains.first_point,
            grown.chains.at_bend,
            *found,
        )
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Leaves:
    """The m leaves of j growths that deployed, growth by growth, those that turned least first."""

    growths: int  # number of growths
    growth: Ints  # growth of each leaf, rising, shape (m,)
    branch: Ints  # index of each leaf among the branches of all growths, shape (m,)
    turn_rad: Floats  # sum of absolute turns at contacts from the base to each tip, shape (m,)
    points_mm: Floats  # chain points of all growths, shape (p, 2)
    tip: Ints  # index of each tip among them, shape (m,)

    @classmethod
    def of(cls, grown: GrownBatch, turns: Turns) -> "Leaves":
        """Return the leaves of some growths."""
        out = turns.is_leaf & np.not_equal(grown.stop, Stop.NOT_DEPLOYED) & (grown.grown > 0.0)
        leaf = np.flatnonzero(out)
        growth = np.searchsorted(grown.chains.branch, leaf, side="right") - 1
        order = np.lexsort((turns.path_rad[leaf], growth))
        leaf, growth = leaf[order], growth[order]
        # Every growth has one more entry in `first_point` than it has branches.
        tip = grown.chains.room[growth] + grown.chains.first_point[leaf + growth + 1] - 1
        return cls(
            growths=len(grown.tree),
            growth=growth,
            branch=leaf,
            turn_rad=turns.path_rad[leaf],
            points_mm=grown.chains.points_mm,
            tip=tip,
        )

    def of_growths(self, one: int, two: int) -> slice:
        """Return the slice of the leaves of the growths ``one .. two - 1``."""
        first, last = np.searchsorted(self.growth, [one, two]).tolist()
        return slice(first, last)


def gaps_mm(points_mm: Floats, tip: Ints, context: MapContext) -> Floats:
    """Return the width of free space at some tips, across the body there, shape (m,).

    Exact for the map's walls, measured 1e-3 mm behind the tip; a tip that lies on a wall has its
    gap on the free side.

    Parameters
    ----------
    tip
        Index of each tip among them, shape (m,); the point before each is on the same branch.
    """
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


def _fixed(array: NDArray[T]) -> NDArray[T]:
    # Arrays that may be written to are another type to the compiler, which would compile twice.
    view = array.view()
    view.setflags(write=False)
    return view


Robot = tuple[BranchTree, Build | None]
"""A planned tree, and how it is built if that is known."""

Place = tuple[MapContext, int, int]
"""A map, and which growths are on it: ``one .. two - 1``."""


class Pouches(NamedTuple):
    """The pouches of j robots, each of shape (j,)."""

    # length_mm, width_mm: flat size, 0 without a pouch
    length_mm: Floats
    width_mm: Floats
    # force per mm2 of contact on both walls together, 2 P; 0 where the pressure is unknown
    press_n_mm2: Floats


def contacts(
    leaves: Leaves, pouches: Pouches, places: Sequence[Place]
) -> tuple[NDArray[np.bool_], Floats]:
    """Return the mask of engaged leaves, and the area that each pouch presses on a wall.

    Without a pouch, every leaf is.
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
class AnchoredRobots:
    """Grown robots, j of them, that are pulled at their bases."""

    grown: GrownBatch
    turns: Turns
    leaves: Leaves  # the leaves that deployed, m of them
    engaged: NDArray[np.bool_]  # which of them hold, shape (m,); without pouches all
    has_pouches: NDArray[np.bool_]  # which robots have pouches, shape (j,)
    press_n: Floats  # force of each leaf's pouch on both its walls, shape (m,); 0 where unknown
    limit_n: Floats | None  # largest pull that each branch stands, shape (n,); None where unknown

    def ideal(self, friction: float) -> Floats:
        """Return the sum of e^(mu gamma) over all leaves that deployed, shape (j,).

        The formula of the paper: every leaf holds, and nothing ever fails.
        """
        return self.summed(np.exp(friction * self.leaves.turn_rad))

    def amplification(self, friction: float, share: float = 1.0) -> Floats:
        """Return the force of each robot over that of one of its pouches alone, shape (j,).

        The sum of e^(mu gamma) over the leaves that hold, times the part of their force that film
        and seam let through.

        Parameters
        ----------
        share
            Share of the engaged leaves that hold, those that turned least, rounded up.
        """
        holds = self.engaged & self.are_among_first(share)
        found = self.summed(np.exp(friction * self.leaves.turn_rad) * holds)
        if self.limit_n is None:
            return found
        free_n, held_n, _ = self.pulls_n(friction, share)
        kept = np.divide(held_n, free_n, out=np.ones_like(found), where=free_n > 0.0)
        return np.asarray(found * kept)

    def amplification_range(self, frictions: Sequence[float]) -> tuple[Floats, Floats]:
        """Return least and greatest amplification over friction and idle leaves, shape (j,) each.

        With friction one pouch alone holds more, but no branch more than its film and seam stand:
        where they limit, the amplification falls with friction, and its ends lie anywhere.
        """
        some_idle = [self.amplification(mu, 1.0 - IDLE_SHARE) for mu in frictions]
        every = [self.amplification(mu) for mu in frictions]
        return np.min([*some_idle, *every], axis=0), np.max([*some_idle, *every], axis=0)

    def pulls_n(self, friction: float, share: float = 1.0) -> tuple[Floats, Floats, Floats]:
        """Return each robot's pull without failures, its pull, and its number of limited branches.

        Each of shape (j,); the last is how many branches pull as much as film or seam stands.
        From the tips to the base, every branch carries what those beyond it hold, times its own
        e^(mu gamma), at most its limit.
        """
        free_n = np.zeros(len(self.turns.own_rad))
        holds = self.engaged & self.are_among_first(share)
        free_n[self.leaves.branch] = friction * self.press_n * holds
        held_n, capped = free_n.copy(), np.zeros(self.leaves.growths)
        limit_n = np.full(len(free_n), np.inf) if self.limit_n is None else self.limit_n
        factor = np.exp(friction * self.turns.own_rad)
        grown = self.grown
        tips_kernel.tensions(
            grown.parent,
            grown.tree_first,
            grown.tree,
            grown.chains.branch,
            factor,
            limit_n,
            free_n,
            held_n,
            capped,
        )
        trunk = grown.chains.branch[:-1]
        return free_n[trunk], held_n[trunk], capped

    def summed(self, values: Floats | NDArray[np.bool_]) -> Floats:
        """Return the sum of one number per leaf over the leaves of each robot, shape (j,)."""
        # In the order of the leaves, so that no robot's sum depends on the others.
        sums = np.bincount(self.leaves.growth, weights=values, minlength=self.leaves.growths)
        return sums.astype(np.float64, copy=False)

    def are_among_first(self, share: float) -> NDArray[np.bool_]:
        """Return the mask of the leaves in the share of the engaged that turned least, (m,)."""
        rank = np.cumsum(self.engaged)
        count = self.summed(self.engaged)
        before = np.cumsum(count) - count
        growth = self.leaves.growth
        return np.asarray(rank - before[growth] <= np.ceil(count * share - 1e-9)[growth])

    def largest_turn_rad(self) -> Floats:
        """Return the largest turn of each robot's engaged leaves, shape (j,); 0 without any."""
        largest = np.zeros(self.leaves.growths)
        np.maximum.at(largest, self.leaves.growth, self.leaves.turn_rad * self.engaged)
        return largest


FRICTION_STEPS = 7
"""From the least to the greatest friction, where film or seam may limit in between."""

IDLE_SHARE = 1.0 / 3.0
"""Share of engaged branches that may hold nothing: two of six in the paper's test."""


Friction = Annotated[float, Ge(0), Le(3)]
PouchSide = Annotated[float, Ge(0), Le(1e4), Unit("mm")]
Pull = Annotated[float, Ge(0), Le(1e6), Unit("N/mm")]


class Anchoring(Table):
    """Anchoring force of all leaf pouches over that of one pouch without any turn.

    ``sum over engaged leaves of exp(mu gamma)``, gamma the absolute turns at contacts from the
    base to the leaf's tip (paper, equations 1 and 2; pressure and contact area cancel). A leaf is
    engaged when it grew in full, so that its pouch is out, and its inflated pouch is wider than
    the gap that its tip ended in: free space across the branch there. The pouch is the one given
    here, or else the design's own; without any, every leaf that deployed counts, as in the paper.
    No branch, the trunk included, holds more than its film and its seam stand.

    By default the limits are those of the shipped film; they limit what is held where pressure and
    pouch are known.
    """

    name: ClassVar[str] = "anchoring"
    lowest: ClassVar[float] = 0.0

    friction: Annotated[
        Friction, Doc("coefficient mu of film on the obstacles; the default is an assumption")
    ] = ASSUMED_FRICTION.value
    friction_low: Annotated[
        Friction, Doc("lower end of its range, for the interval in the terms")
    ] = ASSUMED_FRICTION.low
    friction_high: Annotated[Friction, Doc("upper end of that range")] = ASSUMED_FRICTION.high
    count_joint_angles: Annotated[
        bool,
        Doc(
            "whether the planned angles at joints count as turns too: nothing need be wrapped there"
        ),
    ] = False
    pouch_length_mm: Annotated[
        PouchSide, Doc("flat size of every leaf's pouch, along; 0: the design's own")
    ] = 0.0
    pouch_width_mm: Annotated[PouchSide, Doc("the same, across")] = 0.0
    only_full_length: Annotated[
        bool,
        Doc(
            "whether the pouch of a leaf that stopped early holds nothing: it sits at the very end "
            "of the film and has not everted"
        ),
    ] = True
    film_n_mm: Annotated[
        Pull,
        Doc(
            "pull per mm of circumference at which the film tears (strength times thickness); 0: "
            "no limit"
        ),
    ] = FILM_N_MM
    seam_n_mm: Annotated[Pull, Doc("pull that the seam is known to stand; 0: no limit")] = SEAM_N_MM

    @model_validator(mode="after")
    def _ranges(self) -> "Anchoring":
        number("friction_low", self.friction_low, 0.0, self.friction)
        number("friction_high", self.friction_high, self.friction, 3.0)
        if (self.pouch_length_mm > 0.0) != (self.pouch_width_mm > 0.0):
            missing = "pouch_width_mm" if self.pouch_length_mm > 0.0 else "pouch_length_mm"
            raise BadInputError(missing, 0.0, "above 0: a pouch has a length and a width")
        return self

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the amplification and its terms, with the pouches that are given here.

        Those of a design are known only in a deployment that knows its design.
        """
        design = deployment.design
        found = self.anchored(deployment, design.build if design else None, context)
        return self.outcomes(found).one(0)

    def anchored(
        self, deployment: Deployment, build: Build | None, context: MapContext
    ) -> AnchoredRobots:
        """Return one grown robot, to be pulled."""
        first = np.zeros(1, dtype=np.int64)
        robots = [(deployment.tree, build)]
        return self._anchored(GrownBatch.of(deployment), robots, first, [(context, 0, 1)])

    def parts(self, score: float, terms: Mapping[str, float]) -> dict[str, float]:
        """Return the force of the engaged pouches alone, and the part added by turns before."""
        name, alone = "engaged pouches, each alone", terms["engaged"]
        if terms[IDEAL_CASE]:
            name, alone = "leaves that came out, each alone (ideal case)", terms["leaves"]
        return {name: alone, "turns at contacts": score - alone}

    def evaluate_block(self, block: GrowthBlock, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return amplification and terms for every growth of a block, with the designs' pouches."""
        used, which = np.unique(block.plan, return_inverse=True)
        plans = [block.plans.each[index] for index in used.tolist()]
        places = [(contexts[terrain], one, two) for terrain, one, two in block.by_terrain()]
        robots = [(plan.tree, plan.build) for plan in plans]
        return self.outcomes(self._anchored(GrownBatch.of_block(block), robots, which, places))

    def _anchored(
        self, grown: GrownBatch, robots: Sequence[Robot], which: Ints, places: Sequence[Place]
    ) -> AnchoredRobots:
        """Return grown robots, to be pulled; ``which`` is the robot of each growth."""
        joints_rad = None
        if self.count_joint_angles:
            joints_rad = _by_branch([np.abs(tree.offset_rad) for tree, _ in robots], which)
        turns = Turns.of(grown, joints_rad)
        leaves = Leaves.of(grown, turns)
        rows = [
            (*self._pouch_mm(build), 2.0 * N_MM2_PER_KPA * build.pressure_kpa if build else 0.0)
            for _, build in robots
        ]
        pouches = Pouches(*np.array(rows, dtype=np.float64)[which].T)
        engaged, contact_mm2 = contacts(leaves, pouches, places)
        if self.only_full_length:
            is_whole = np.equal(grown.stop[leaves.branch], Stop.FULL_LENGTH)
            engaged &= is_whole | (pouches.width_mm[leaves.growth] == 0.0)
        press_n = pouches.press_n_mm2[leaves.growth] * contact_mm2 * engaged
        limit_n = None
        if press_n.any():
            limit_n = _by_branch([self._limits_n(*robot) for robot in robots], which)
        return AnchoredRobots(
            grown=grown,
            turns=turns,
            leaves=leaves,
            engaged=engaged,
            has_pouches=pouches.width_mm > 0.0,
            press_n=press_n,
            limit_n=limit_n,
        )

    def outcomes(self, found: AnchoredRobots) -> TaskOutcomes:
        """Return the amplification, its interval over friction and idle branches, and other terms.

        Terms: ``leaves`` that deployed; ``engaged``, pouches of them that jam, none without any;
        ``mean_turn_rad`` and ``largest_turn_rad`` of the leaves that count; ``low`` and ``high``,
        least and greatest amplification over the range of friction, with all engaged leaves and
        with a third of them idle, those that turned most; ``ideal``, with every leaf that deployed
        engaged and nothing limited; ``ideal_case``, 1 where that is the score, since the robot has
        no pouches; ``force_n``, their total force, 0 where pouch or pressure is unknown;
        ``capped``, how many branches film or seam limit.
        """
        leaves, engaged = found.leaves, found.engaged
        count = found.summed(engaged)
        _, force_n, capped = found.pulls_n(self.friction)
        frictions = {self.friction_low, self.friction, self.friction_high}
        if found.limit_n is not None:  # between the ends film may give way
            steps = np.linspace(self.friction_low, self.friction_high, FRICTION_STEPS)
            frictions.update(steps.tolist())
        low, high = found.amplification_range(sorted(frictions))
        terms = {
            "leaves": np.bincount(leaves.growth, minlength=leaves.growths).astype(np.float64),
            "engaged": count * found.has_pouches,
            "mean_turn_rad": found.summed(leaves.turn_rad * engaged) / np.maximum(count, 1.0),
            "largest_turn_rad": found.largest_turn_rad(),
            "low": low,
            "high": high,
            "ideal": found.ideal(self.friction),
            IDEAL_CASE: (~found.has_pouches).astype(np.float64),
            "force_n": force_n,
            "capped": capped,
        }
        return TaskOutcomes(found.amplification(self.friction), terms)

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

    def _limits_n(self, tree: BranchTree, build: Build | None) -> Floats:
        """Return the largest pull that each branch stands at its narrower end, shape (n,)."""
        known = [load for load in (self.film_n_mm, self.seam_n_mm) if load > 0.0]
        if build is None or not known:
            return np.full(len(tree), np.inf)
        narrow_mm = np.minimum(tree.width_mm, tree.end_width_mm)
        return np.array([branch_limit_n(width, min(known)) for width in narrow_mm.tolist()])


def _by_branch(each: Sequence[Floats], which: Ints) -> Floats:
    """Return numbers of robots' branches for every growth, one after the other."""
    return np.concatenate([each[index] for index in which.tolist()])
