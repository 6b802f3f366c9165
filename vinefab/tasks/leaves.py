"""Leaves of grown robots: the turns on their way, and how wide free space is at their tips."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.growth.batch import Block
from vinefab.model.deployment import Deployment, Stop
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.wall_cells import TOUCHING_MM

STEP_BACK_MM = 1e-3


class GrownBatch(NamedTuple):
    """The final states of j growths, one after the other."""

    # parent, tree_first: planned trees, as in `vinefab.growth.arrays.TreesArrays`
    parent: Ints
    tree_first: Ints
    tree: Ints  # tree of each growth, shape (j,)
    # branch, room: where each growth's branches and chain points begin, shape (j + 1,) each
    branch: Ints
    room: Ints
    # as in `vinefab.growth.arrays.Growth`
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
    """The leaves of j growths whose tips came out, growth by growth, m of them."""

    growths: int  # number of growths
    growth: Ints  # growth of each leaf, rising, shape (m,)
    turn_rad: Floats  # sum of absolute turns from the base to each tip, shape (m,)
    points_mm: Floats  # chain points of all growths, shape (p, 2)
    tip: Ints  # which of them each tip is, shape (m,)

    @classmethod
    def of(cls, grown: GrownBatch, joints_rad: Floats | None, *, whole: bool) -> "Leaves":
        """Return the leaves of some growths.

        Parameters
        ----------
        joints_rad
            Turns that count beside those of the growth, one per branch, or None.
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
    from vinefab.tasks.kernels import tips_kernel as holding_kernel  # noqa: PLC0415  numba takes a second to import

    total = grown.turn.copy()
    if joints_rad is not None:
        total += joints_rad
    leaf = np.empty(len(total), dtype=np.bool_)
    holding_kernel.turns(grown.parent, grown.tree_first, grown.tree, grown.branch, total, leaf)
    return total, leaf


def path_turn_rad(deployment: Deployment, *, joints: bool = False) -> Floats:
    """Return the sum of absolute turns from the base to each tip, shape (n,)."""
    joints_rad = np.abs(deployment.tree.offset_rad) if joints else None
    return summed_turns(GrownBatch.of(deployment), joints_rad)[0]


def tip_gaps_mm(deployment: Deployment, branches: Ints, ground: MapContext) -> Floats:
    """Return how wide free space is at the tips of some branches, across each, shape (m,).

    Parameters
    ----------
    branches
        Branches that have grown, shape (m,).
    """
    return gaps_mm(deployment.points_mm, deployment.first_point[1:][branches] - 1, ground)


def gaps_mm(points_mm: Floats, tip: Ints, ground: MapContext) -> Floats:
    """Return how wide free space is at some tips, across the body there, shape (m,).

    Exact for the map's walls, measured 1e-3 mm behind the tip; a tip that lies on a wall has its
    gap on the free side.

    Parameters
    ----------
    tip
        Which of them are tips, shape (m,); the point before each belongs to the same branch.
    """
    from vinefab.tasks.kernels import tips_kernel as holding_kernel  # noqa: PLC0415  as above

    tips = points_mm[tip]
    along = tips - points_mm[tip - 1]
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-12)[:, None]
    along = along / length
    # A little behind the tip: where a branch stopped at a wall, across it is along the wall.
    tips = tips - np.minimum(STEP_BACK_MM, 0.5 * length) * along
    across = np.column_stack([-along[:, 1], along[:, 0]])
    cells, out = ground.cells, np.zeros(len(tip))
    holding_kernel.gaps(
        tips, across, cells.walls_mm, cells.grid, cells.first, cells.item, TOUCHING_MM, out
    )
    return out


def _fixed(array: Ints) -> Ints:
    # Arrays that may be written to are another type to the compiler, which would compile twice.
    view = array.view()
    view.setflags(write=False)
    return view
