"""The arrays that both growth engines read and write: one interface, two implementations.

Plain named tuples, so that compiled code takes them as they are.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.model.checked import Floats, Ints

Ints32 = NDArray[np.int32]


class WallArrays(NamedTuple):
    """Free space as its walls, with the free side on the left of each wall's tangent.

    Parameters
    ----------
    wall
        Start x, start y, tangent x, tangent y, length, end x, end y; shape (n, 7), mm.
    link
        Wall before and wall after in the same wedge of free space, start point and end point
        (numbers of distinct places), and 1 if another wall comes so near that a tip sliding on
        this one could meet it, else 0; shape (n, 5).
    vertex
        Vertices that a body can wrap around, where free space takes more than half the turn:
        x, y and a unit vector into the solid; shape (m, 4); in the order of their cells.
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
    link: Ints
    vertex: Floats
    vertex_point: Ints
    box: Floats
    shape: Ints
    wall_first: Ints32
    wall_item: Ints32
    vertex_first: Ints32


class TreeArrays(NamedTuple):
    """The planned branches, parents before children, n of them.

    Parameters
    ----------
    parent
        Index of each branch's parent, -1 for the trunk.
    turn
        Cosine and sine of the angle from the parent's final heading (from the start's heading
        for the trunk); shape (n, 2).
    length
        Planned lengths, mm.
    fits
        Whether there is room for each branch's base (inflated bodies); decided by the caller.
    """

    parent: Ints
    turn: Floats
    length: Floats
    fits: NDArray[np.bool_]


class Rules(NamedTuple):
    """What decides the growth beside the geometry.

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
    most_events
        A branch with so many events is ended as ``corner``: a guard, never reached in tests.
    """

    head_on_half_angle_rad: float
    deploys_stuck: bool
    tolerance_mm: float
    tolerance_rad: float
    most_events: int


class Start(NamedTuple):
    """Where the trunk is launched.

    Parameters
    ----------
    x, y
        Its base, mm.
    ux, uy
        Its heading, a unit vector.
    """

    x: float
    y: float
    ux: float
    uy: float


class Growth(NamedTuple):
    """What the engines write, for n branches and room for p chain points.

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
    steep
        Longest straight body, from pivot to tip, with which each branch began to slide at more
        than 60 degrees to the wall's tangent, mm; shape (n,).
    chain_length, chain_sense
        Working room, shape (p,): length up to a chain point; sense in which the body wrapped it.
    """

    points: Floats
    first_point: Ints
    stop: Ints
    grown: Floats
    turn: Floats
    heading: Floats
    events: Ints
    steep: Floats
    chain_length: Floats
    chain_sense: Ints

    @classmethod
    def empty(cls, branches: int, room: int) -> "Growth":
        """Return arrays for so many branches with room for so many chain points."""
        return cls(
            points=np.zeros((room, 2)),
            first_point=np.zeros(branches + 1, dtype=np.int64),
            stop=np.zeros(branches, dtype=np.int64),
            grown=np.zeros(branches),
            turn=np.zeros(branches),
            heading=np.zeros((branches, 2)),
            events=np.zeros(branches, dtype=np.int64),
            steep=np.zeros(branches),
            chain_length=np.zeros(room),
            chain_sense=np.zeros(room, dtype=np.int64),
        )

    def with_room(self, room: int) -> "Growth":
        """Return the same growth so far, with room for more chain points."""
        more = Growth.empty(len(self.stop), room)
        points = more.points
        points[: len(self.points)] = self.points
        return self._replace(
            points=points, chain_length=more.chain_length, chain_sense=more.chain_sense
        )
