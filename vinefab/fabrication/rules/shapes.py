"""How far a flat robot hangs over a sheet, over all the ways it may be turned."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.outline.ends import Leaf, corner_radii_mm
from vinefab.fabrication.outline.layout import FlatLayout
from vinefab.model.design import Build

Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shapes:
    """Capsules of a flat robot, m of them."""

    # start_mm, end_mm: ends of their segments, shape (m, 2). The trunk's includes the tail.
    start_mm: Floats
    end_mm: Floats
    # half_mm, end_half_mm: half widths at the start and at the end, shape (m,)
    half_mm: Floats
    end_half_mm: Floats
    branch: Ints  # index of the branch that each belongs to, shape (m,)
    pouch: NDArray[np.bool_]  # whether each belongs to a pouch, shape (m,)
    parent: Ints  # parent of each branch (not of each capsule), shape (n,)

    def __len__(self) -> int:
        return len(self.branch)

    @property
    def most_half_mm(self) -> Floats:
        """The larger half width of each, shape (m,)."""
        return np.maximum(self.half_mm, self.end_half_mm)


def shapes_of(layout: FlatLayout, build: Build) -> Shapes:
    """Return the capsules of a flat layout with its pouches.

    A round pouch is a disc around the leaf's tip. A rectangular one, centred on the tip, is the
    capsules around its four sides with the corners' radius as half width, and one along its
    middle: exact for everything outside it.
    """
    start = layout.start_mm.copy()
    start[0, 0] -= layout.tail_mm
    rows = np.arange(len(layout.tree), dtype=np.int64)
    end_half = layout.end_width_mm / 2.0
    starts, ends = [start], [layout.end_mm]
    halves, end_halves, branches = [layout.width_mm / 2.0], [end_half], [rows]
    for low_mm, high_mm, half_mm in _tail_capsules(layout, build):
        starts.append(np.array([low_mm]))
        ends.append(np.array([high_mm]))
        halves.append(np.array([half_mm]))
        end_halves.append(halves[-1])
        branches.append(rows[:1])
    tails = sum(map(len, branches))
    leaves = rows[layout.is_leaf]
    for low_mm, high_mm, half_mm in _pouch_capsules(layout, build):
        starts.append(_at_tips(layout, leaves, low_mm))
        ends.append(_at_tips(layout, leaves, high_mm))
        halves.append(np.full(len(leaves), half_mm))
        end_halves.append(halves[-1])
        branches.append(leaves)
    branch = np.concatenate(branches)
    return Shapes(
        start_mm=np.concatenate(starts),
        end_mm=np.concatenate(ends),
        half_mm=np.concatenate(halves),
        end_half_mm=np.concatenate(end_halves),
        branch=branch,
        pouch=np.arange(len(branch)) >= tails,
        parent=layout.tree.parent,
    )


def _tail_capsules(layout: FlatLayout, build: Build) -> list[tuple[Point, Point, float]]:
    """Return ends and half widths of what the trunk's own capsule leaves out of tail and collar.

    They begin so far from the mouth that their round ends do not reach beyond it. A collar's
    transition counts as if it were as wide as the mouth.
    """
    half, wide = build.widths_mm[0] / 2.0, build.mouth_width_mm / 2.0
    found = []
    if build.taper and build.taper[0] < 1.0:
        found.append(((min(0.0, half - layout.tail_mm), 0.0), (0.0, 0.0), half))
    if build.collar is not None and wide > half:
        end_mm = min(0.0, build.collar.reach_mm - layout.tail_mm)
        found.append(((min(end_mm, wide - layout.tail_mm), 0.0), (end_mm, 0.0), wide))
    return found


def _pouch_capsules(layout: FlatLayout, build: Build) -> list[tuple[Point, Point, float]]:
    """Return ends and half widths of a pouch's capsules in the frame of the tip."""
    pouch = build.pouch
    if pouch is None:
        return []
    if pouch.shape == "round":
        return [((0.0, 0.0), (0.0, 0.0), pouch.radius_mm or 0.0)]
    leaf = Leaf(
        half_mm=build.end_widths_mm[-1] / 2.0, lean_rad=0.0, fillet_mm=float(layout.fillet_mm[-1])
    )
    _, corner_mm = corner_radii_mm(pouch, leaf)
    corner_mm = max(0.0, corner_mm)
    x, y = (pouch.length_mm or 0.0) / 2.0 - corner_mm, (pouch.width_mm or 0.0) / 2.0 - corner_mm
    corners = [(x, y), (-x, y), (-x, -y), (x, -y)]
    sides = [(a, b, corner_mm) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    # A disc that touches the long sides, slid along the middle between the short ones.
    along_mm, across_mm = max(0.0, x - y), max(0.0, y - x)
    middle = ((-along_mm, -across_mm), (along_mm, across_mm), min(x, y) + corner_mm)
    return [*sides, middle]


def _at_tips(layout: FlatLayout, leaves: Ints, point_mm: Point) -> Floats:
    """Return where a point of the tip's frame lies on the sheet, for each leaf, shape (k, 2)."""
    cos, sin = np.cos(layout.heading_rad[leaves]), np.sin(layout.heading_rad[leaves])
    x, y = point_mm
    return layout.end_mm[leaves] + np.column_stack([cos * x - sin * y, sin * x + cos * y])


_TURNS = 180


def excess_mm(shapes: Shapes, sheet_mm: tuple[float, float]) -> float:
    """Return by how much the robot overshoots a sheet in its best turn; 0 or less where it fits.

    Notes
    -----
    Whole degrees are tried; placing the finished outline tries more turns, so that it never fits
    worse but for the width of seam and kerf and the overcut at the mouth.
    """
    turns = np.arange(_TURNS) * np.pi / _TURNS
    across = np.stack([np.cos(turns), np.sin(turns)])
    half, end_half = shapes.half_mm[:, None], shapes.end_half_mm[:, None]
    corners = shapes.start_mm[0] + np.array([[0.0, 1.0], [0.0, -1.0]]) * shapes.half_mm[0]
    ends, starts = shapes.end_mm @ across, shapes.start_mm[1:] @ across
    high = np.concatenate([ends + end_half, starts + half[1:], corners @ across]).max(axis=0)
    low = np.concatenate([ends - end_half, starts - half[1:], corners @ across]).min(axis=0)
    wide = high - low
    # Turning by a right angle swaps width and height.
    tall = np.roll(wide, -_TURNS // 2)
    over = np.maximum(wide - sheet_mm[0], tall - sheet_mm[1])
    return float(over.min())
