"""Plans: designs prepared for growth, once for all maps and poses."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints, frozen_floats, frozen_ints
from vinefab.growth.arrays import TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Build, Design
from vinefab.model.tree import BranchTree, branch_tree
from vinefab.physics.growth_pressure import FITTED, riding_mm
from vinefab.physics.tube import inflated_diameter_mm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feed:
    """How film comes to the tips of a design's levels: film taken by growth, film available.

    All is in terms of the tube that the constants were fitted to: a level of another diameter
    needs pressures inverse to it (assumed), so its working pressure counts in proportion.
    """

    limit_kpa: Floats  # tension at which a tip of each level stops, infinite without, shape (k,)
    tension_kpa: float  # of the film as it leaves its store
    drag_kpa_mm: float  # friction per mm of film

    @classmethod
    def of(cls, build: Build, options: GrowthOptions) -> "Feed":
        """Return the feed of a design; without pressure, or with it left out, nothing stops."""
        limit_kpa = np.full(len(build.widths_mm), np.inf)
        if options.pressure_stop and build.pressure_kpa > 0.0:
            diameter_mm = inflated_diameter_mm(1.0) * np.array(build.widths_mm)
            share = diameter_mm / options.fitted_diameter_mm
            limit_kpa = build.pressure_kpa * share - FITTED.yield_kpa.value
        return cls(
            limit_kpa=limit_kpa,
            tension_kpa=options.storage_kpa,
            drag_kpa_mm=FITTED.drag_kpa_m.value / 1000.0,
        )

    def store_kpa(self, riding_mm: Floats) -> Floats:
        """Return the tension in the store, with the drag of film that rides inside branches."""
        return np.asarray(self.tension_kpa + self.drag_kpa_mm * riding_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A design prepared for growth."""

    tree: BranchTree  # the planned branches
    turn: Floats  # cosine and sine of each branch's angle from its parent, shape (n, 2)
    # span k, the branches that grow on the same walls, is ``edges[k] .. edges[k + 1] - 1``: the
    # whole tree for bare centrelines, one level for inflated bodies
    edges: tuple[int, ...]
    radii_mm: tuple[float, ...]  # body radius on each span
    limit_kpa: Floats  # tension at which each branch's tip stops, infinite if none does, shape (n,)
    store_kpa: Floats  # tension of each branch's film as it leaves its store, shape (n,)
    build: Build  # how the design is built

    @classmethod
    def of(cls, design: Design, options: GrowthOptions, tree: BranchTree | None = None) -> "Plan":
        """Return the plan of a design, or of a tree that came out a little different."""
        tree = branch_tree(design) if tree is None else tree
        turn = np.column_stack([np.cos(tree.offset_rad), np.sin(tree.offset_rad)])
        if options.body == "centerline":
            edges, radii_mm = [0, len(tree)], [0.0]
        else:
            edges = np.searchsorted(tree.level, np.arange(1, design.depth + 2)).tolist()
            radii_mm = [options.radius_mm(width_mm) for width_mm in design.build.widths_mm]
        feed = Feed.of(design.build, options)
        return cls(
            tree=tree,
            turn=turn,
            edges=tuple(edges),
            radii_mm=tuple(radii_mm),
            limit_kpa=feed.limit_kpa[tree.level - 1],
            store_kpa=feed.store_kpa(riding_mm(tree, design.build.widths_mm)),
            build=design.build,
        )

    def cut(self, branches: Ints, length_mm: Floats) -> "Plan":
        """Return the plan of some branches, whole families of siblings, with other lengths.

        What rides inside them, and so their tension, stays that of the whole tree.
        """
        tree, place = self.tree, np.full(len(self.tree), -1)
        place[branches] = np.arange(len(branches))
        parent = tree.parent[branches]
        cut = BranchTree(
            parent=frozen_ints(np.where(parent < 0, -1, place[parent])),
            level=frozen_ints(tree.level[branches]),
            offset_rad=frozen_floats("offset_rad", tree.offset_rad[branches]),
            length_mm=frozen_floats("length_mm", length_mm),
        )
        edges = np.searchsorted(branches, self.edges).tolist()
        return replace(
            self,
            tree=cut,
            turn=self.turn[branches],
            edges=tuple(edges),
            limit_kpa=self.limit_kpa[branches],
            store_kpa=self.store_kpa[branches],
        )

    @property
    def radius_mm(self) -> Floats:
        """Radius of each branch's body, mm, shape (n,)."""
        return np.repeat(self.radii_mm, np.diff(self.edges))

    @property
    def without_pressure(self) -> "Plan":
        """The same plan where no pressure stops growth."""
        return replace(self, limit_kpa=np.full(len(self), np.inf))

    def __len__(self) -> int:
        return len(self.tree)

    def arrays(self) -> TreesArrays:
        """Return the tree as the engines take it."""
        return TreesArrays(
            parent=self.tree.parent,
            turn=self.turn,
            length=self.tree.length_mm,
            limit=self.limit_kpa,
            store=self.store_kpa,
            first=np.array([0, len(self)]),
        )


class Spans(NamedTuple):
    """The spans of all plans as tables, one row per plan and one column per span."""

    radii_mm: tuple[float, ...]  # all body radii, rising
    number: Ints  # number of spans of each plan; columns beyond it have no meaning
    radius: Ints  # index of the radius
    until: Ints  # first branch that is not in the span
    # whether the body is wider than the body that reached its base, and so may lack room there
    is_wider: NDArray[np.bool_]

    @classmethod
    def of(cls, plans: Sequence[Plan]) -> "Spans":
        """Return the spans of plans as tables."""
        radii_mm = tuple(sorted({radius for plan in plans for radius in plan.radii_mm}))
        number = np.array([len(plan.radii_mm) for plan in plans])
        spans = cls(
            radii_mm,
            number,
            radius=np.zeros((len(plans), number.max()), dtype=np.int64),
            until=np.zeros((len(plans), number.max()), dtype=np.int64),
            is_wider=np.zeros((len(plans), number.max()), dtype=np.bool_),
        )
        for row, plan in enumerate(plans):
            spans.until[row] = len(plan)
            spans.until[row, : number[row]] = plan.edges[1:]
            spans.radius[row, : number[row]] = np.searchsorted(radii_mm, plan.radii_mm)
            # Only a body wider than the one that reached the place can lack room there.
            spans.is_wider[row, : number[row]] = np.diff(plan.radii_mm, prepend=0.0) > 0.0
        return spans


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plans:
    """Several designs prepared for growth."""

    each: Sequence[Plan]  # the plans one by one
    trees: TreesArrays  # their branches, one tree after the other
    spans: Spans  # branches that grow on the same walls
    _lengths: list[Floats] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.each)

    @property
    def lengths_mm(self) -> Floats:
        """Planned length of each tree, shape (n,); computed once."""
        if not self._lengths:
            # Tree by tree: other orders of summation differ in the last digit.
            edges = itertools.pairwise(self.trees.first.tolist())
            total = [np.add.reduce(self.trees.length[one:two]) for one, two in edges]
            self._lengths.append(np.array(total))
        return self._lengths[0]

    @property
    def radius_mm(self) -> Floats:
        """Radius of the body of each branch, in the order of the trees, mm."""
        spans = self.spans
        there = np.arange(spans.radius.shape[1]) < spans.number[:, None]
        count = np.diff(spans.until, axis=1, prepend=0)[there]
        return np.repeat(np.array(spans.radii_mm)[spans.radius[there]], count)

    @classmethod
    def of(cls, designs: Sequence[Design], options: GrowthOptions) -> "Plans":
        """Return the plans of some designs, at least one, for one set of growth options."""
        return cls.joined([Plan.of(design, options) for design in designs])

    @classmethod
    def joined(cls, plans: Sequence[Plan]) -> "Plans":
        """Return some plans, at least one, together."""
        return cls(
            each=tuple(plans),
            trees=TreesArrays.of([plan.arrays() for plan in plans]),
            spans=Spans.of(plans),
        )
