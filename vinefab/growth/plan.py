"""Plans: designs prepared for growth, once for all maps and poses."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints
from vinefab.growth.arrays import TreesArrays
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Build, Design
from vinefab.model.tree import BranchTree
from vinefab.physics.growth_pressure import FITTED, riding_mm
from vinefab.physics.tube import inflated_diameter_mm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Feed:
    """How film comes to the tips of tubes: film taken by growth, film available.

    All is in terms of the tube that the constants were fitted to: a tube of another diameter
    needs pressures inverse to it (assumed), so its working pressure counts in proportion.
    """

    limit_kpa: Floats  # tension at which each tip stops, infinite without, shape (k,)
    tension_kpa: float  # of the film as it leaves its store
    drag_kpa_mm: float  # friction per mm of film

    @classmethod
    def of(cls, build: Build, options: GrowthOptions, width_mm: Floats) -> "Feed":
        """Return the feed of tubes of some lay-flat widths, shape (k,).

        Without pressure, or with it left out, nothing stops.
        """
        limit_kpa = np.full(len(width_mm), np.inf)
        if options.pressure_stop and build.pressure_kpa > 0.0:
            share = inflated_diameter_mm(1.0) * width_mm / options.fitted_diameter_mm
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

    tree: BranchTree  # the planned branches, n of them
    parts: BranchTree  # their straight parts, m of them: what grows; without bends the tree itself
    turn: Floats  # cosine and sine of each part's angle from the part before, shape (m, 2)
    # span k, the parts that grow on the same walls, is ``edges[k] .. edges[k + 1] - 1``: the whole
    # tree for bare centrelines, parts of one level and width for inflated bodies
    edges: tuple[int, ...]
    radii_mm: tuple[float, ...]  # body radius on each span
    limit_kpa: Floats  # tension at which each branch's tip stops, infinite if none does, shape (n,)
    store_kpa: Floats  # tension of each branch's film as it leaves its store, shape (n,)
    build: Build  # how the design is built

    @classmethod
    def of(cls, design: Design, options: GrowthOptions, tree: BranchTree | None = None) -> "Plan":
        """Return the plan of a design, or of a tree that came out a little different."""
        return cls.of_tree(design.tree if tree is None else tree, options, design.build)

    @classmethod
    def of_tree(cls, tree: BranchTree, options: GrowthOptions, build: Build) -> "Plan":
        """Return the plan of a tree that is built in some way."""
        feed = Feed.of(build, options, tree.width_mm)
        return cls.of_parts(tree, options, feed.limit_kpa, feed.store_kpa(riding_mm(tree)), build)

    @classmethod
    def of_parts(
        cls,
        tree: BranchTree,
        options: GrowthOptions,
        limit_kpa: Floats,
        store_kpa: Floats,
        build: Build,
    ) -> "Plan":
        """Return the plan of a tree whose feed is known."""
        parts = tree.straight
        if parts is not tree and options.deploys_stuck:
            allowed = "stop for a robot with bends: a branch that stopped never makes its next one"
            raise BadInputError("children_of_stuck", "deploy", allowed)
        if options.body == "centerline":
            edges, radii_mm = [0, len(parts)], [0.0]
        else:
            # Elbows of a tapered tube grow on the walls of its base, as its straight parts do.
            wide_mm = tree.width_mm[parts.branch]
            differs = (np.diff(parts.level) != 0) | (np.diff(wide_mm) != 0.0)
            edges = [0, *(np.flatnonzero(differs) + 1).tolist(), len(parts)]
            radii_mm = [options.radius_mm(wide_mm[one]) for one in edges[:-1]]
        return cls(
            tree=tree,
            parts=parts,
            turn=np.column_stack([np.cos(parts.offset_rad), np.sin(parts.offset_rad)]),
            edges=tuple(edges),
            radii_mm=tuple(radii_mm),
            limit_kpa=limit_kpa,
            store_kpa=store_kpa,
            build=build,
        )

    def cut(self, branches: Ints, length_mm: Floats, options: GrowthOptions) -> "Plan":
        """Return the plan of some branches, whole families of siblings, with other lengths.

        What rides inside them, and so their tension, stays that of the whole tree.
        """
        return Plan.of_parts(
            self.tree.taken(branches, length_mm),
            options,
            self.limit_kpa[branches],
            self.store_kpa[branches],
            self.build,
        )

    @property
    def radius_mm(self) -> Floats:
        """Radius of each part's body, mm, shape (m,)."""
        return np.repeat(self.radii_mm, np.diff(self.edges))

    @property
    def without_pressure(self) -> "Plan":
        """The same plan where no pressure stops growth."""
        return replace(self, limit_kpa=np.full(len(self.tree), np.inf))

    def __len__(self) -> int:
        return len(self.parts)

    def arrays(self) -> TreesArrays:
        """Return the straight parts as the engines take them."""
        parts = self.parts
        return TreesArrays(
            parent=parts.parent,
            turn=self.turn,
            length=parts.length_mm,
            limit=self.limit_kpa[parts.branch],
            store=self.store_kpa[parts.branch],
            first=np.array([0, len(self)]),
        )

    @property
    def is_wider(self) -> list[bool]:
        """Whether each span's bodies are wider than those that reached its base, the trunk is."""
        if len(self.radii_mm) == 1:
            return [self.radii_mm[0] > 0.0]
        radius_mm, parent = self.radius_mm, self.parts.parent
        grows = np.where(parent < 0, radius_mm > 0.0, radius_mm > radius_mm[parent])
        wider: list[bool] = np.logical_or.reduceat(grows, self.edges[:-1]).tolist()
        return wider


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
            spans.is_wider[row, : number[row]] = plan.is_wider
        return spans


class BranchParts(NamedTuple):
    """The branches of all plans, and the straight parts that each is grown as.

    Parameters
    ----------
    first
        Where the branches of each tree begin, with the total at the end; shape (d + 1,).
    part_first, part
        The parts of branch k, numbered within their tree, from the base outward:
        ``part[part_first[k]:part_first[k + 1]]``.
    """

    first: Ints
    part_first: Ints
    part: Ints

    @classmethod
    def of(cls, plans: Sequence[Plan]) -> "BranchParts":
        """Return the branches of some plans."""
        count = [np.bincount(plan.parts.branch, minlength=len(plan.tree)) for plan in plans]
        part = [np.lexsort((np.arange(len(plan)), plan.parts.branch)) for plan in plans]
        return cls(
            first=np.cumsum([0, *(len(plan.tree) for plan in plans)]),
            part_first=np.concatenate([[0], np.cumsum(np.concatenate(count))]),
            part=np.concatenate(part),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plans:
    """Several designs prepared for growth."""

    each: Sequence[Plan]  # the plans one by one
    trees: TreesArrays  # their straight parts, one tree after the other
    spans: Spans  # parts that grow on the same walls
    parts: BranchParts | None = None  # the branches of the parts; None where no branch has a bend
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
        """Radius of the body of each part, in the order of the trees, mm."""
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
            parts=BranchParts.of(plans) if any(p.parts is not p.tree for p in plans) else None,
        )

    def emergence(self, share: float) -> Floats:
        """Return the probability that each part comes out: certain behind a bend."""
        if self.parts is None:
            return np.full(len(self.trees.parent), share)
        bent = np.concatenate([plan.parts.is_bent for plan in self.each])
        return np.where(bent, 1.0, share)
