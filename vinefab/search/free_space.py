"""The space of free trees: every branch has its own parent, angle, length and bends.

A point has the same coordinates for each of a number of slots: the parent (or none: the slot is
empty), the angle, the length, and turn and place of each bend that a branch may have. Slot 0 is
the trunk; parents stand before their children.

In a mirrored space the slots are those of one half: every branch off the axis has a twin on the
other side. The axis is the trunk with the branches that go straight on from it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.limits import rad
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, Ints, frozen_floats, frozen_ints
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plan, Plans
from vinefab.model.design import Design
from vinefab.model.tree import Bend, BranchTree
from vinefab.search.optimizers.optimizer import SearchAxes
from vinefab.search.space import (
    SPACE_DECIMALS,
    BatchBranches,
    BuildSettings,
    DesignSpace,
    Space,
    SpaceSettings,
    SpaceValue,
)
from vinefab.search.tree_batch import SomeOf, TreeBatch

SLOTS = 64
"""Most branches of a free tree, where the space sets no smaller limit."""

LEAST_TURN_DEG = 2.0
"""Smaller turns of a bend are none."""

END_SHARE = 0.02
"""Share of a branch at each end that holds no bend."""

PARENT, ANGLE, LENGTH, BENDS = range(4)
"""Columns of a slot; of each bend, two from the last on: its turn and its place."""

SAME_SHARE = 1e-9
"""Coordinates that differ by less are one."""

_Number = int | Ints

EMPTY = -1
"""In place of the parent of a slot without a branch."""


def space_of(settings: SpaceSettings, build: BuildSettings) -> DesignSpace:
    """Return the space of some settings: of levels, or of free trees."""
    kind = FreeSpace if settings.tree == "free" else Space
    return kind(settings, build)


class FreeSpace(DesignSpace):
    """The map between vectors with entries from 0 to 1 and free trees.

    Angles and lengths are those that the same settings allow branches of levels: a branch lies
    within half of the widest fan, and is as long as any child of its level.
    """

    def __init__(self, settings: SpaceSettings, build: BuildSettings) -> None:
        super().__init__(settings, build)
        self._levels = Space(settings, build)
        self.deepest = int(settings.levels.high)
        children = [int(settings.bounds(n, "branches").high) for n in range(2, self.deepest + 1)]
        whole = sum(math.prod(children[:n]) for n in range(self.deepest))
        self.most_branches = min(whole, int(min(SLOTS, self.most.get("branches", SLOTS))))
        self.mirrored = settings.mirrored
        # Of a mirrored tree one branch of each level may lie on the axis, without a twin.
        alone = min(self.deepest, self.most_branches) if self.mirrored else self.most_branches
        self.slots = alone + (self.most_branches - alone) // 2
        self.bends = int(settings.bends.high)
        self.columns = 3 + 2 * self.bends
        ranges = [self._ranges(level) for level in range(1, self.deepest + 1)]
        # by level, the trunk first: smallest and largest length, mm, and angle, deg
        self._low_mm, self._high_mm, self._most_deg = np.array(ranges).T
        self._shapes: dict[bytes, _Shape] = {}

    def _ranges(self, level: int) -> tuple[float, float, float]:
        length = self.settings.bounds(level, "length_mm")
        if level == 1:
            return length.low, length.high, 0.0
        growth = self.settings.bounds(level, "growth_percent")
        low_mm = length.low * min(1.0, growth.low / 100.0)
        high_mm = length.high * max(1.0, growth.high / 100.0)
        most_deg = min(180.0, self.settings.bounds(level, "angle_deg").high / 2.0)
        return low_mm, high_mm, most_deg

    def __len__(self) -> int:
        return self.slots * self.columns

    @property
    def axes(self) -> SearchAxes:
        """The coordinates as optimizers see them."""
        choices = np.zeros((self.slots, self.columns), dtype=np.int64)
        choices[1:, PARENT] = np.arange(2, self.slots + 1)
        return SearchAxes(choices=tuple(choices.ravel().tolist()), levels=(0,) * len(self))

    @property
    def levels(self) -> Space:
        """The space of levels, which is searched first."""
        return self._levels

    @property
    def smallest(self) -> TreeBatch:
        """The shortest trunk with the fewest children, alone in a batch."""
        return self.batch_of(self.levels.design(np.zeros(len(self.levels))))

    # --- Trees to points, and back ----------------------------------------------------------------

    def point(self, tree: BranchTree) -> Floats:
        """Return the point of a tree, or the nearest within the bounds, shape (len(self),).

        Raises
        ------
        BadInputError
            If it has more branches than there are slots, or more levels, or in a mirrored space is
            not its own mirror image.
        """
        count = len(tree)
        if count > self.most_branches or int(tree.level.max()) > self.deepest:
            most = counted(self.most_branches, "branch")
            allowed = f"at most {most} on {counted(self.deepest, 'level')}"
            raise BadInputError("space", f"a design with {counted(count, 'branch')}", allowed)
        rows = _half_of(tree) if self.mirrored else np.arange(count)
        slot = np.full(count, EMPTY)
        slot[rows] = np.arange(len(rows))
        x = np.full((self.slots, self.columns), 0.5)
        x[1:, PARENT] = self._share_of_parent(np.arange(1, self.slots), EMPTY)
        low_mm, high_mm, most_deg = self._ranges_at(tree.level[rows])
        angle = np.degrees(tree.offset_rad[rows])
        x[: len(rows), LENGTH] = _share(tree.length_mm[rows], low_mm, high_mm)
        x[: len(rows), ANGLE] = _share(angle, -most_deg, most_deg)
        below = np.arange(1, len(rows))
        x[below, PARENT] = self._share_of_parent(below, slot[tree.parent[rows[1:]]])
        widest_deg = float(self._most_deg.max())
        for branch, at_mm, turn in zip(
            tree.bend_branch.tolist(), tree.bend_mm.tolist(), tree.bend_rad.tolist(), strict=True
        ):
            if not self.bends:
                break  # the nearest tree is straight
            if slot[branch] == EMPTY:
                continue  # its twin has it
            along = (at_mm / float(tree.length_mm[branch]) - END_SHARE) / (1.0 - 2.0 * END_SHARE)
            along = min(max(along, 0.0), 1.0) * self.bends
            # At the border of two stretches it is in the one before.
            number = max(0, math.ceil(along) - 1)
            column = BENDS + 2 * number
            share = (math.degrees(turn) / widest_deg + 1.0) / 2.0
            x[slot[branch], column] = min(1.0, max(0.0, share))
            x[slot[branch], column + 1] = along - number
        return x.ravel()

    def _ranges_at(self, level: Ints) -> tuple[Floats, Floats, Floats]:
        """Return smallest and largest lengths, mm, and largest angles, deg, of branches."""
        place = level - 1
        return self._low_mm[place], self._high_mm[place], self._most_deg[place]

    def vector(self, design: Design) -> Floats:
        """Return the point for a design, or the nearest within the bounds."""
        return self.point(design.tree)

    def batch(self, x: Floats) -> TreeBatch:
        """Return the trees at many points, equal to those of `design`.

        Points around one tree, without bends, are taken together: twenty times as fast.
        """
        cells = x.reshape(-1, self.slots, self.columns)
        alike = not self.bends and bool((cells[:, :, PARENT] == cells[0, :, PARENT]).all())
        if not alike:
            return TreeBatch.of([self.tree(row) for row in x])
        shape = self._shape(cells[0, :, PARENT])
        length_mm, angle_deg = self._sizes(shape, cells)
        if self.mirrored:
            ahead = angle_deg == 0.0
            if (ahead != ahead[0]).any():  # one has gone to the axis
                return TreeBatch.of([self.tree(row) for row in x])
            shape = self._both_halves(shape, self._on_axis(shape, ahead[0]))
            length_mm = np.tile(length_mm, 2)
            angle_deg = np.concatenate([angle_deg, -angle_deg], axis=1)
        slots, parent = shape.sorted_by(angle_deg)
        count, size = slots.shape
        level = np.tile(shape.level, count)
        build = self.build_of(int(shape.level[-1]))
        width_mm = np.array(build.widths_mm)
        return TreeBatch(
            trees=SomeOf(lambda row: self.tree(x[row]), np.arange(count)),
            first=np.arange(count + 1) * size,
            parent=parent.ravel(),
            level=level,
            branch=np.tile(np.arange(size), count),
            offset_rad=np.radians(np.take_along_axis(angle_deg, slots, axis=1)).ravel(),
            length_mm=np.take_along_axis(length_mm, slots, axis=1).ravel(),
            width_mm=width_mm[level - 1],
            end_width_mm=np.array(build.end_widths_mm)[level - 1],
            fillet_mm=np.array([0.0, *build.fillet_mm])[level - 1],
        )

    def batch_of(self, design: Design) -> TreeBatch:
        """Return a design alone in a batch."""
        return TreeBatch.of([design.tree])

    def tree(self, x: Floats) -> BranchTree:
        """Return the tree at a point."""
        cells = x.reshape(self.slots, self.columns)
        shape = self._shape(cells[:, PARENT])
        length_mm, angle_deg = self._sizes(shape, cells)
        straight = self._on_axis(shape, angle_deg == 0.0)
        if self.mirrored:
            shape = self._both_halves(shape, straight)
            length_mm = np.tile(length_mm, 2)
            angle_deg = np.concatenate([angle_deg, -angle_deg])
        (rows,), (parent,) = shape.sorted_by(angle_deg[None])
        length_mm, angle_deg = length_mm[rows], angle_deg[rows]
        build, bends = self.build_of(int(shape.level[-1])), list[Sequence[Bend]]()
        if self.bends:
            for row, mm, level in zip(rows, length_mm.tolist(), shape.level.tolist(), strict=True):
                slot, side = row % self.slots, 1.0 if row < self.slots else -1.0
                own = self._bends(cells[slot], mm, build.widths_mm[level - 1])
                own = [] if straight[slot] else own
                bends.append([(at_mm, side * turn_deg) for at_mm, turn_deg in own])
        return BranchTree.of(
            parent=frozen_ints(parent),
            level=shape.level,
            offset_rad=frozen_floats("angle", [rad(one) for one in angle_deg.tolist()]),
            length_mm=frozen_floats("length", length_mm),
            build=build,
            bends=bends,
        )

    def _sizes(self, shape: "_Shape", cells: Floats) -> tuple[Floats, Floats]:
        """Return lengths, mm, and angles, deg, of the slots of cells, shape (..., slots) each."""
        low_mm, high_mm, most_deg = self._ranges_at(shape.slot_level)
        length_mm = _values(cells[..., LENGTH], low_mm, high_mm)
        angle_deg = _values(cells[..., ANGLE], -most_deg, most_deg)
        angle_deg[..., 0] = 0.0
        return length_mm, angle_deg

    def _on_axis(self, shape: "_Shape", ahead: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which slots lie on the axis, those ahead of one that does; (slots,).

        None does where the space is not mirrored.
        """
        found = np.zeros(self.slots, dtype=np.bool_)
        found[0] = self.mirrored
        for slot, above in enumerate(shape.index.tolist()):
            found[slot] |= above >= 0 and bool(found[above] and ahead[slot])
        return found

    def _both_halves(self, half: "_Shape", on_axis: NDArray[np.bool_]) -> "_Shape":
        """Return the shape with a twin of every slot off the axis, so many slots behind it."""
        above = half.index
        twins = np.where((above >= 0) & ~on_axis[above], above + self.slots, above)
        return self._shape_of(np.concatenate([above, np.where(on_axis, EMPTY, twins)]))

    def _bends(self, cells: Floats, length_mm: float, width_mm: float) -> list[Bend]:
        """Return the bends of a slot's branch; one nearer to another than it is wide is none."""
        most, found = float(self._most_deg.max()), list[Bend]()
        for number in range(self.bends):
            turn, place = cells[BENDS + 2 * number : BENDS + 2 * number + 2].tolist()
            turn_deg = round(most * (2.0 * turn - 1.0), SPACE_DECIMALS)
            if abs(turn_deg) >= LEAST_TURN_DEG:
                along = END_SHARE + (1.0 - 2.0 * END_SHARE) * (number + place) / self.bends
                at_mm = round(along * length_mm, SPACE_DECIMALS)
                if not found or at_mm - found[-1][0] >= width_mm:
                    found.append((at_mm, turn_deg))
        return found

    def design(self, x: Floats, name: str = "candidate") -> Design:
        """Return the design at a point."""
        tree = self.tree(x)
        return Design.of_tree(tree, self.build_of(int(tree.level.max())), name)

    def values(self, x: Floats) -> list[SpaceValue]:
        """Return lengths and angles of the branches of the tree at a point, by their ids."""
        tree, found = self.tree(x), list[SpaceValue]()
        low_mm, high_mm, most_deg = (one.tolist() for one in self._ranges_at(tree.level))
        for row, name in enumerate(tree.ids):
            found.append(
                SpaceValue(
                    name=f"length_mm of {name}",
                    value=float(tree.length_mm[row]),
                    low=low_mm[row],
                    high=high_mm[row],
                )
            )
            if row:
                angle_deg = round(math.degrees(tree.offset_rad[row]), SPACE_DECIMALS)
                found.append(
                    SpaceValue(
                        name=f"angle_deg of {name}",
                        value=angle_deg,
                        low=-most_deg[row],
                        high=most_deg[row],
                    )
                )
        return found

    def planned(self, designs: TreeBatch, options: GrowthOptions) -> Plans:
        """Return the plans of some of its trees, as `batch` gives them."""
        if not self.bends:
            branches = BatchBranches(*(getattr(designs, name) for name in BatchBranches._fields))
            return self.planned_straight(branches, options)
        builds = map(self.build_of, designs.depth.tolist())
        return Plans.joined(
            [
                Plan.of_tree(tree, options, build)
                for tree, build in zip(designs.trees, builds, strict=True)
            ]
        )

    # --- Single slots -----------------------------------------------------------------------------

    def cells(self, x: Floats) -> Floats:
        """Return a point as a table of slots by columns."""
        return x.reshape(self.slots, self.columns)

    def parents(self, x: Floats) -> Ints:
        """Return the parent slot of each slot: `EMPTY` for the trunk, and where there is none."""
        return self._shape(self.cells(x)[:, PARENT]).index

    def leaves(self, x: Floats) -> list[int]:
        """Return the slots of branches without children, without the trunk."""
        shape = self._shape(self.cells(x)[:, PARENT])
        return [int(slot) for slot in shape.slots[1:] if not (shape.index == slot).any()]

    def active(self, x: Floats) -> Ints:
        """Return the coordinates that the tree at a point has, without those of its structure."""
        shape = self._shape(self.cells(x)[:, PARENT])
        has = np.zeros((self.slots, self.columns), dtype=np.bool_)
        has[shape.slots] = True
        has[:, PARENT] = False
        has[0, ANGLE] = False
        low_mm, high_mm, most_deg = self._ranges_at(shape.slot_level)
        has[low_mm == high_mm, LENGTH] = False
        has[most_deg == 0.0, ANGLE] = False
        on_axis = self._on_axis(shape, self._sizes(shape, self.cells(x))[1] == 0.0)
        has[on_axis, ANGLE] = False
        has[on_axis, BENDS:] = False
        return np.flatnonzero(has)

    def coordinates_of(self, x: Floats, ids: Sequence[str]) -> Ints:
        """Return the coordinates that some branches of the tree at a point have.

        Raises
        ------
        UnfitInputError
            If there is no such branch, or nothing of them can change.
        """
        cells = self.cells(x)
        shape = self._shape(cells[:, PARENT])
        (slots,), _ = shape.sorted_by(self._sizes(shape, cells)[1][None])
        rows = dict(zip(self.tree(x).ids, slots.tolist(), strict=True))
        own = [rows.get(one, EMPTY) for one in ids]
        active = self.active(x)
        found = active[np.isin(active // self.columns, own)]
        if EMPTY in own or not len(found):
            problem = f"nothing of {', '.join(ids)} can change"
            raise UnfitInputError("space.only", problem, "widen its ranges, or name other branches")
        return found

    def gaps(self, x: Floats) -> list[tuple[int, float]]:
        """Return where a child may be added: the slot of its parent, and its angle's coordinate.

        Angles are those in the middle between two neighbours, and of the ends and the outer ones.
        """
        cells, found = self.cells(x), list[tuple[int, float]]()
        shape = self._shape(cells[:, PARENT])
        on_axis = self._on_axis(shape, self._sizes(shape, cells)[1] == 0.0)
        twins = int((~on_axis[shape.slots]).sum()) if self.mirrored else 0
        room = self.most_branches - len(shape.slots) - twins
        for slot, level in zip(shape.slots.tolist(), shape.level.tolist(), strict=True):
            if level == self.deepest:
                continue
            children = np.flatnonzero(shape.index == slot)
            shares = cells[children, ANGLE]
            if on_axis[slot]:  # the twins of its children stand there too
                shares = np.concatenate([shares, 1.0 - shares[~on_axis[children]]])
            most = min(room, int(self.settings.bounds(level + 1, "branches").high) - len(shares))
            ends = np.array([0.0, *np.sort(shares), 1.0])
            for share in ((ends[1:] + ends[:-1]) / 2.0).tolist():
                is_ahead = bool(on_axis[slot]) and abs(share - 0.5) < SAME_SHARE
                if on_axis[slot] and share < 0.5 and not is_ahead:
                    continue  # its twin is found as well
                branches = 2 if self.mirrored and not is_ahead else 1
                if branches <= room and (branches if on_axis[slot] else 1) <= most:
                    found.append((slot, 0.5 if is_ahead else share))
        return found

    def free_slot(self, x: Floats, parent: int, taken: Sequence[int] = ()) -> int | None:
        """Return the first empty slot that may hold a child of a slot; None without one.

        Slots that are ``taken`` are left out.
        """
        empty = np.flatnonzero(self.parents(x) == EMPTY).tolist()
        free = [slot for slot in empty if slot > parent and slot not in taken]
        return free[0] if free else None

    def with_child(self, x: Floats, parent: int, slot: int, angle: float, length: float) -> Floats:
        """Return a tree with one more branch in an empty slot; angle and length are shares."""
        longer = x.copy()
        cells = self.cells(longer)
        cells[slot] = 0.5
        cells[slot, :BENDS] = self._share_of_parent(slot, parent), angle, length
        return longer

    def without(self, x: Floats, slot: int) -> Floats:
        """Return a tree without a leaf."""
        shorter = x.copy()
        self.cells(shorter)[slot] = 0.5
        self.cells(shorter)[slot, PARENT] = self._share_of_parent(slot, EMPTY)
        return shorter

    def changed_slot(self, x: Floats, other: Floats) -> int | None:
        """Return the slot in which another tree has one branch more or less; None without any."""
        slots = np.flatnonzero(self.parents(x) != self.parents(other))
        return int(slots[0]) if len(slots) else None

    def with_slot_of(self, x: Floats, other: Floats, slot: int) -> Floats | None:
        """Return a tree with a slot as another has it; None where that does not fit it."""
        parents, above = self.parents(x), int(self.parents(other)[slot])
        if above == EMPTY:
            return None if (parents == slot).any() else self.without(x, slot)
        if parents[slot] != EMPTY or (above > 0 and parents[above] == EMPTY):
            return None
        changed = x.copy()
        self.cells(changed)[slot] = self.cells(other)[slot]
        return changed

    @staticmethod
    def _share_of_parent(slot: _Number, parent: _Number) -> Any:  # noqa: ANN401  as the slots
        """Return the coordinate of a slot that stands for a parent slot, or for `EMPTY`."""
        return (parent + 1.5) / (slot + 1)

    def _shape(self, parents: Floats) -> "_Shape":
        """Return the structure that the parents of a point stand for."""
        index = (parents * np.arange(1, self.slots + 1)).astype(np.int64)
        index = np.minimum(index, np.arange(self.slots)) - 1
        index[0] = -1
        return self._shape_of(index)

    def _shape_of(self, index: Ints) -> "_Shape":
        """Return the shape for the parent slot of each slot."""
        key = index.tobytes()
        if key not in self._shapes:
            if len(self._shapes) > 1000:
                self._shapes.clear()
            self._shapes[key] = _Shape.of(index, self.deepest)
        return self._shapes[key]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Shape:
    """Which slots a tree has, level by level, and how they hang together."""

    index: Ints  # parent slot of each slot, -1 for the trunk and empty slots
    slot_level: Ints  # level of each slot, 1 for the trunk and empty slots
    slots: Ints  # of each branch, shape (n,)
    level: Ints  # of each branch, shape (n,)

    @classmethod
    def of(cls, index: Ints, deepest: int) -> "_Shape":
        """Return the shape for the parent slot of each slot, -1 for none and for the trunk.

        Branches beyond the deepest level are left out.
        """
        level = np.zeros(len(index), dtype=np.int64)
        level[0] = 1
        for slot, above in enumerate(index.tolist()):
            if slot and above >= 0 and 0 < level[above] < deepest:
                level[slot] = level[above] + 1
        slots = np.argsort(level, kind="stable")[np.count_nonzero(level == 0) :]
        shape = cls(
            index=index,
            slot_level=np.maximum(level, 1),
            slots=slots,
            level=frozen_ints(level[slots]),
        )
        (by_parents,), _ = shape.sorted_by(np.zeros((1, len(index))))
        return replace(shape, slots=by_parents)

    def sorted_by(self, angle: Floats) -> tuple[Ints, Ints]:
        """Return the slot of each branch, and the branch before it, -1 for trunks.

        Each level is in the order of its parents, and siblings by the angles of their slots.

        Parameters
        ----------
        angle
            Of each slot of m trees of this shape, shape (m, slots).

        Returns
        -------
        arrays
            Of shape (m, n).
        """
        place = np.full(angle.shape, -1)
        slots = np.empty((len(angle), len(self.slots)), dtype=np.int64)
        parent = np.empty_like(slots)
        for level in range(1, int(self.level[-1]) + 1):
            one, two = np.searchsorted(self.level, (level, level + 1))
            rows = self.slots[one:two]
            above = place[:, self.index[rows]] if level > 1 else np.full((len(angle), 1), -1)
            order = np.lexsort((angle[:, rows], above))
            slots[:, one:two] = rows[order]
            parent[:, one:two] = np.take_along_axis(above, order, axis=1)
            np.put_along_axis(place, slots[:, one:two], np.arange(one, two)[None], axis=1)
        return slots, parent


def _half_of(tree: BranchTree) -> Ints:
    """Return the rows of the axis of a tree and of all that lies left of it.

    Raises
    ------
    UnfitInputError
        If the tree is not its own mirror image, within a hundredth of a millimetre or degree.
    """
    near, angle_deg = 1.001 * 10.0**-SPACE_DECIMALS, np.degrees(tree.offset_rad)
    children = [np.flatnonzero(tree.parent == row).tolist() for row in range(len(tree))]

    def values(row: int, side: float) -> Floats:
        bends = [(at_mm, side * math.degrees(turn)) for at_mm, turn in tree.bends_of(row)]
        return np.array([tree.length_mm[row], side * angle_deg[row], *np.ravel(bends)])

    def are_twins(one: int, two: int) -> bool:
        own, other = values(one, 1.0), values(two, -1.0)
        if own.shape != other.shape or len(children[one]) != len(children[two]):
            return False
        pairs = zip(children[one], reversed(children[two]), strict=True)
        is_near = bool((np.abs(own - other) <= near).all())
        return is_near and all(are_twins(*pair) for pair in pairs)

    if not are_twins(0, 0):
        problem = "is true, and a design to begin at is not its own mirror image"
        raise UnfitInputError("space.mirrored", problem, "leave it out, or begin at one that is")
    on_axis, kept = {0}, [0]
    for row, above in enumerate(tree.parent.tolist()[1:], start=1):
        if above in on_axis and abs(angle_deg[row]) <= near:
            on_axis.add(row)
        elif above not in kept or (above in on_axis and angle_deg[row] < 0.0):
            continue
        kept.append(row)
    return np.array(kept)


def _share(values: Floats, low: Floats, high: Floats) -> Floats:
    """Return the share of each range; the nearest end for values outside."""
    span = np.where(high > low, high - low, 1.0)
    return np.clip(np.where(high > low, (values - low) / span, 0.5), 0.0, 1.0)


def _values(shares: Floats, low: Floats, high: Floats) -> Floats:
    """Return the values at shares of ranges, in hundredths."""
    return np.clip(np.round(low + shares * (high - low), SPACE_DECIMALS), low, high)
