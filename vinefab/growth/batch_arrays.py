"""The arrays of a batch: several maps, several trees, and which tree grows where.

`vinefab.growth.kernel.grow_jobs` takes them as they are.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from vinefab.growth.arrays import Ints32, Start, TreeArrays, WallArrays
from vinefab.model.checked import Floats, Ints

T = TypeVar("T", bound=np.generic)


class AtlasArrays(NamedTuple):
    """The walls of several maps and body radii: pages one after the other, k of them.

    Parameters
    ----------
    wall, link, vertex, vertex_point, wall_first, wall_item, vertex_first
        As in `WallArrays`; numbers of walls, points and items count within their page.
    box, shape
        One row per page; shapes (k, 4) and (k, 2).
    tolerance
        Distances up to this count as touching, mm; shape (k,).
    offset
        Where each page begins in ``wall``, ``vertex``, ``wall_first`` and ``wall_item``, with the
        totals at the end; shape (k + 1, 4).
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
    tolerance: Floats
    offset: Ints

    @classmethod
    def of(cls, pages: Sequence[WallArrays], tolerances_mm: Sequence[float]) -> "AtlasArrays":
        """Return the atlas of some maps' walls. A single page is not copied."""
        sizes = [(len(p.wall), len(p.vertex), len(p.wall_first), len(p.wall_item)) for p in pages]
        offset = np.zeros((len(pages) + 1, 4), dtype=np.int64)
        np.cumsum(sizes, axis=0, out=offset[1:])
        return cls(
            wall=_joined([p.wall for p in pages]),
            link=_joined([p.link for p in pages]),
            vertex=_joined([p.vertex for p in pages]),
            vertex_point=_joined([p.vertex_point for p in pages]),
            box=_fixed(np.stack([p.box for p in pages])),
            shape=_fixed(np.stack([p.shape for p in pages])),
            wall_first=_joined([p.wall_first for p in pages]),
            wall_item=_joined([p.wall_item for p in pages]),
            vertex_first=_joined([p.vertex_first for p in pages]),
            tolerance=_fixed(np.array(tolerances_mm, dtype=np.float64)),
            offset=_fixed(offset),
        )


def _joined(arrays: list[NDArray[T]]) -> NDArray[T]:
    return arrays[0] if len(arrays) == 1 else _fixed(np.concatenate(arrays))


def _fixed(array: NDArray[T]) -> NDArray[T]:
    # Arrays that may be written to are another type to the compiler, which would compile twice.
    array.setflags(write=False)
    return array


class TreesArrays(NamedTuple):
    """The planned branches of several designs, one after the other, d of them.

    Parameters
    ----------
    parent, turn, length
        As in `TreeArrays`; parents count within their tree.
    first
        Where each tree begins, with the total at the end; shape (d + 1,).
    """

    parent: Ints
    turn: Floats
    length: Floats
    first: Ints

    @classmethod
    def of(cls, trees: Sequence[TreeArrays]) -> "TreesArrays":
        """Return several trees as one set of arrays."""
        return cls(
            parent=_fixed(np.concatenate([tree.parent for tree in trees])),
            turn=_fixed(np.concatenate([tree.turn for tree in trees])),
            length=_fixed(np.concatenate([tree.length for tree in trees])),
            first=_fixed(np.cumsum([0, *(len(tree.parent) for tree in trees)])),
        )


class JobArrays(NamedTuple):
    """What a batch is to grow: j pairs of a tree and a launch.

    Parameters
    ----------
    tree, page
        Which tree on which page of the atlas; shape (j,).
    start
        Base and heading of each trunk: x, y (mm), ux, uy; shape (j, 4).
    fits
        As in `TreeArrays`, for all branches of all jobs.
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
    fits: NDArray[np.bool_]
    branch: Ints
    room: Ints
    done: Ints
    until: Ints

    @classmethod
    def alone(
        cls, start: Start, fits: NDArray[np.bool_], room: int, done: int, until: int
    ) -> "JobArrays":
        """Return the branches ``done .. until - 1`` of the only tree, on the only page."""
        return cls(
            tree=np.zeros(1, dtype=np.int64),
            page=np.zeros(1, dtype=np.int64),
            start=np.array([start], dtype=np.float64),
            fits=fits,
            branch=np.array([0, len(fits)]),
            room=np.array([0, room]),
            done=np.array([done]),
            until=np.array([until]),
        )
