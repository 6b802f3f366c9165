"""Arrays of the growth engines: walls, trees, rules, launches, results, and those of a batch.

`vinefab.growth.kernel.grow_jobs` takes them as they are.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints

Ints32 = NDArray[np.int32]


class WallArrays(NamedTuple):
    """Free space as its walls, with the free side on the left of each wall's tangent.

    Parameters
    ----------
    wall
        Start x, start y, tangent x, tangent y, length; shape (n, 5), mm. A wall ends where the
        following one starts, and data left out of memory need not be fetched from it: on large
        maps, growth waits for that.
    link
        Wall before and wall after in the same wedge of free space, start point and end point
        (numbers of distinct places), and 1 if another wall comes so near that a tip sliding on
        this one could meet it, else 0; shape (n, 5).
    vertex, solid
        Vertices that a body can wrap around, where free space takes more than half the turn, in
        the order of their cells, and unit vectors into the solid there; shape (m, 2), mm.
    vertex_point
        Number of each vertex's place, as in ``link``; shape (m,).
    box
        Lower left corner of the grid index and the side of its cells, mm, then cells per mm;
        shape (4,).
    shape
        Columns and rows of the grid; shape (2,).
    wall_first, wall_item
        Walls that touch each cell, row by row: ``wall_item[wall_first[c]:wall_first[c + 1]]``.
    vertex_first
        First vertex of each cell, with their number at the end.
    """

    wall: Floats
    link: Ints32
    vertex: Floats
    solid: Floats
    vertex_point: Ints32
    box: Floats
    shape: Ints
    wall_first: Ints32
    wall_item: Ints32
    vertex_first: Ints32

    def __reduce__(self) -> tuple[object, ...]:
        return _copied, (WallArrays, *self)

    @property
    def end(self) -> Floats:
        """End x and end y of each wall, shape (n, 2), mm."""
        return np.asarray(self.wall[self.link[:, 1], :2])


class Rules(NamedTuple):
    """The parameters of the growth rules.

    Parameters
    ----------
    head_on_half_angle_rad
        See `GrowthOptions`.
    deploys_stuck
        Whether children of a stuck branch grow.
    tolerance_mm
        Distances up to this count as touching.
    tolerance_rad
        Directions that differ by up to this count as parallel.
    tie
        Angles (rad), and shares of a pressure, that differ by up to this count as equal: a tip that
        meets a wall at the half-angle stops, and one that has just enough pressure continues.
    most_events
        Limit of a branch's events; it then ends as ``corner``. A guard, never reached in tests.
    friction
        Friction of film on film, per radian of turn.
    drag_kpa_mm
        Friction per mm of path.
    """

    head_on_half_angle_rad: float
    deploys_stuck: bool
    tolerance_mm: float
    tolerance_rad: float
    tie: float
    most_events: int
    friction: float
    drag_kpa_mm: float


Launch = tuple[float, float, float, float]
"""The launch of a trunk: x and y of its base (mm), and its heading, a unit vector."""


class Growth(NamedTuple):
    """Results of the engines, for n branches and room for p chain points.

    Parameters
    ----------
    points
        Chains one after the other; shape (p, 2), mm.
    first_point
        Where each branch's chain begins; shape (n + 1,).
    stop
        Codes of `vinefab.model.deployment.Stop`; shape (n,).
    grown, turn
        Length grown (mm) and sum of absolute turns (rad); shape (n,).
    heading
        Final heading, a unit vector; shape (n, 2).
    events
        Number of events of each branch; shape (n,).
    gain, drawn
        Factor by which the turns of the path to the tip multiply a tension at the base, and its
        length with each part times that factor of the turns behind it, mm; shape (n,). Only where
        pressure can stop growth.
    chain_length, chain_sense
        Working room, shape (p,): length up to a chain point; sense in which the body wrapped it.
    chain_gain, chain_drawn
        Working room, shape (p,): as ``gain`` and ``drawn``, up to a chain point.
    """

    points: Floats
    first_point: Ints
    stop: Ints
    grown: Floats
    turn: Floats
    heading: Floats
    events: Ints
    gain: Floats
    drawn: Floats
    chain_length: Floats
    chain_sense: Ints
    chain_gain: Floats
    chain_drawn: Floats

    @classmethod
    def empty(cls, branches: int, room: int) -> "Growth":
        """Return empty arrays for a number of branches, with room for chain points."""
        return cls(
            points=np.zeros((room, 2)),
            first_point=np.zeros(branches + 1, dtype=np.int64),
            stop=np.zeros(branches, dtype=np.int64),
            grown=np.zeros(branches),
            turn=np.zeros(branches),
            heading=np.zeros((branches, 2)),
            events=np.zeros(branches, dtype=np.int64),
            gain=np.zeros(branches),
            drawn=np.zeros(branches),
            chain_length=np.zeros(room),
            chain_sense=np.zeros(room, dtype=np.int64),
            chain_gain=np.zeros(room),
            chain_drawn=np.zeros(room),
        )


T = TypeVar("T", bound=np.generic)


class TerrainSetArrays(NamedTuple):
    """The walls of several maps and body radii: pages one after the other, k of them.

    Parameters
    ----------
    walls
        Those of all pages, whose numbers of walls, points and items count within their page;
        ``box`` and ``shape`` have a row for each page.
    tolerance
        Distances up to this count as touching, mm; shape (k,).
    offset
        Where each page begins in ``wall``, ``vertex``, ``wall_first`` and ``wall_item``, with the
        totals at the end; shape (k + 1, 4).
    """

    walls: WallArrays
    tolerance: Floats
    offset: Ints

    def __reduce__(self) -> tuple[object, ...]:
        return _copied, (TerrainSetArrays, *self)

    @classmethod
    def of(cls, pages: Sequence[WallArrays], tolerances_mm: Sequence[float]) -> "TerrainSetArrays":
        """Return the pages of some maps' walls together. A single page is not copied."""
        sizes = [(len(p.wall), len(p.vertex), len(p.wall_first), len(p.wall_item)) for p in pages]
        offset = np.zeros((len(pages) + 1, 4), dtype=np.int64)
        np.cumsum(sizes, axis=0, out=offset[1:])
        joined = pages[0]
        if len(pages) > 1:
            columns = zip(*pages, strict=True)
            joined = WallArrays(*(_fixed(np.concatenate(column)) for column in columns))
        walls = joined._replace(
            box=_fixed(np.stack([page.box for page in pages])),
            shape=_fixed(np.stack([page.shape for page in pages])),
        )
        tolerance = np.array(tolerances_mm, dtype=np.float64)
        return cls(walls=walls, tolerance=_fixed(tolerance), offset=_fixed(offset))


def _copied(kind: Callable[..., tuple[Any, ...]], *parts: object) -> tuple[Any, ...]:
    """Return arrays that were pickled or copied, which took from each that it is read-only."""
    return kind(*(_fixed(part) if isinstance(part, np.ndarray) else part for part in parts))


def _fixed(array: NDArray[T]) -> NDArray[T]:
    # Arrays that may be written to are another type to the compiler, which would compile twice.
    array.setflags(write=False)
    return array


class TreesArrays(NamedTuple):
    """The planned branches of one design or several, one tree after the other, d of them.

    Parameters
    ----------
    parent
        Index of each branch's parent within its tree, -1 for the trunk; parents come first.
    turn
        Cosine and sine of the angle from the parent's final heading (from the start's heading
        for the trunk); shape (n, 2).
    length
        Planned lengths, mm.
    limit
        Tension, kPa, with which the working pressure can still evert each branch; infinite where
        pressure stops nothing. See `vinefab.growth.plan.Feed`.
    store
        Tension of each branch's film as it leaves its store, with the drag of the film inside,
        kPa.
    first
        Where each tree begins, with the total at the end; shape (d + 1,).
    """

    parent: Ints
    turn: Floats
    length: Floats
    limit: Floats
    store: Floats
    first: Ints

    def __reduce__(self) -> tuple[object, ...]:
        return _copied, (TreesArrays, *self)

    @classmethod
    def of(cls, trees: Sequence["TreesArrays"]) -> "TreesArrays":
        """Return several trees as one set of arrays."""
        columns = [_fixed(np.concatenate(column)) for column in zip(*trees, strict=True)]
        first = np.cumsum([0, *(len(tree.parent) for tree in trees)])
        return cls(*columns)._replace(first=_fixed(first))


class JobArrays(NamedTuple):
    """The jobs of a batch: j pairs of a tree and a launch.

    Parameters
    ----------
    tree, page
        Which tree on which page of the atlas; shape (j,).
    start
        Base and heading of each trunk: x, y (mm), ux, uy; shape (j, 4).
    half_angle
        Head-on half-angle of each, rad; shape (j,).
    fits
        Whether there is room for the base of each branch (inflated bodies), for all branches of
        all jobs; decided by the caller.
    branch
        Where each job's branches begin in the results; shape (j + 1,).
    room
        Where each job's chain points begin in the results; shape (j + 1,).
    done, until
        The branches to grow next are ``done .. until - 1`` of each job; ``done`` is written to,
        and stays behind where there was too little room; shape (j,).
    """

    tree: Ints
    page: Ints
    start: Floats
    half_angle: Floats
    fits: NDArray[np.bool_]
    branch: Ints
    room: Ints
    done: Ints
    until: Ints
