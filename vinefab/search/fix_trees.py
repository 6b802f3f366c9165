"""All changes of single branches of a tree, as vectors; and ways to leave some of them out.

Many vectors are evaluated at once, as arrays: no design is made for any of them. All have the same
branches in the same order, so that siblings never change places.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vinefab.core.limits import deg
from vinefab.core.validation import LARGEST_MM, Floats, Ints, frozen_floats
from vinefab.fabrication.rules.clearance_rules import check_fillet
from vinefab.model.design import Branch, Build, Design
from vinefab.model.tree import DEFAULT_FILLET_RATIO, BranchTree, default_fillet_mm
from vinefab.search.fix_changes import WEIGHTS, build_changes, loss_cost
from vinefab.search.fix_space import (
    FIX_DECIMALS,
    FIX_KINDS,
    LEAST_TAPER,
    PENALTY_COST,
    Variable,
    both_ways,
    scaled_build,
)
from vinefab.search.fix_targets import FixTargets
from vinefab.search.tree_batch import SomeOf, TreeBatch

MOST_FIXED_BRANCHES = 150
"""Of a tree that is fixed branch by branch: larger ones would take many minutes."""

NOT_ALLOWED = 1000.0
"""Penalty of vectors that no design has, such as those that pass one sibling through another."""

_OWN = {"own width": "width_mm", "own taper": "taper", "own fillet": "fillet_mm"}
"""Kinds of values that a branch may have for itself, and their keys."""

_SHAPED = ("width", "taper", "fillet", "pouch", "own width")
"""Kinds of changes that builds, or what fits them, depend on."""

_LEAST = 10.0**-FIX_DECIMALS

_MOST_KNOWN = 4096
"""Builds of one space that are remembered."""


class _Values(NamedTuple):
    """Values of m trees of n branches with b bends."""

    length_mm: Floats  # shape (m, n)
    angle_deg: Floats
    width_mm: Floats
    taper: Floats
    fillet_mm: Floats
    place_mm: Floats  # of each bend from the base of its branch, shape (m, b)
    turn_deg: Floats
    builds: tuple[Build, ...]  # settled by the targets
    build: Ints  # row of each tree's build, shape (m,)


@dataclass(frozen=True, kw_only=True, eq=False)
class TreeSpace:
    """All changes of single branches of a design with some of its branches kept, as vectors."""

    design: Design  # the original, written branch by branch
    kept: Design  # the same with the branches that are kept
    # What each entry of a vector changes: angles in radians, all else by its logarithm.
    variables: tuple[Variable, ...]
    targets: FixTargets

    @classmethod
    def of(
        cls,
        design: Design,
        kept: Design,
        targets: FixTargets,
        kinds: frozenset[str] = FIX_KINDS,
    ) -> "TreeSpace":
        """Return the space of some kinds of changes of a design with some of its branches kept."""
        tree, build = kept.tree, kept.build
        rows, bends = range(len(tree)), range(len(tree.bend_mm))
        variables: list[Variable] = [("length", row) for row in rows]
        variables += [("place", bend) for bend in bends]
        variables += [("angle", row) for row in rows[1:]]
        variables += [("bend", bend) for bend in bends]
        for kind, key in _OWN.items():
            own = _own(kept, key)
            usual = tree.level[np.isnan(own)] - 1  # levels of branches with the build's value
            shared = kind.removeprefix("own ")
            first, last = int(shared == "fillet"), len(build.widths_mm) - int(shared == "taper")
            variables += [(shared, level) for level in range(first, last) if level in usual]
            variables += [(kind, row) for row in np.flatnonzero(own > 0.0).tolist()]
        variables += [("pouch", 0)] if build.pouch else []
        used = tuple(variable for variable in variables if variable[0] in kinds)
        return cls(design=design, kept=kept, variables=used, targets=targets)

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def first_steps(self) -> int:
        """Steps of single values and groups before all values move together."""
        return min(60, 20 + self.kept.branch_count)

    @property
    def distances(self) -> tuple[float, ...]:
        """Distances along the directions that are tried before steps."""
        return (0.1, 0.2, 0.35, 0.5, 0.7, 0.9, 1.2, 1.6, 2.2)

    @property
    def steps_ahead(self) -> int:
        """Steps of a bisection whose trials are assessed at once."""
        return 3

    @cached_property
    def least_cost(self) -> float:
        """Cost of the branches that are left out."""
        if self.kept.branch_count == self.design.branch_count:
            return 0.0
        left_mm = self.kept.tree.total_length_mm
        return max(1e-6, loss_cost(self.design.tree.total_length_mm, left_mm))

    def at(self, x: Floats) -> Design:
        """Return the design at a vector, settled by the targets, numbers rounded to 0.001 mm."""
        values = self._values(x[None])
        row = {name: number for number, name in enumerate(self.kept.names)}
        branches = (self._branch(one, row[one.name], values) for one in self.kept.branches or ())
        trunk = self.kept.trunk.changed(
            length_mm=float(values.length_mm[0, 0]), **self._new_bends(0, values)
        )
        return self.kept.changed(trunk=trunk, branches=tuple(branches), build=values.builds[0])

    def _branch(self, old: Branch, row: int, values: _Values) -> Branch:
        """Return a branch with its values at a vector."""
        new: dict[str, object] = {**self._new_bends(row, values)}
        for key in ("length_mm", "angle_deg", *_OWN.values()):
            value = float(getattr(values, key)[0, row])
            if getattr(old, key) not in (None, value):
                new[key] = value
        return old.changed(**new) if new else old

    def _new_bends(self, row: int, values: _Values) -> Mapping[str, object]:
        """Return the bends of a branch by their key, where they change."""
        own = np.flatnonzero(self._tree.bend_branch == row)
        place_mm, turn_deg = values.place_mm[0, own], values.turn_deg[0, own]
        if (place_mm == self._tree.bend_mm[own]).all() and (turn_deg == self._turn_deg[own]).all():
            return {}
        return {"bends": tuple(zip(place_mm.tolist(), turn_deg.tolist(), strict=True))}

    # --- Many vectors at once -------------------------------------------------------------------

    def penalty(self, x: Floats) -> float:
        """Return the distance of the design at a vector from its targets; 0 if it meets them."""
        return self.assessed([x])[0][1]

    def cost(self, x: Floats) -> float:
        """Return the cost of the change to a vector, pruned branches included."""
        return float(self._cost(self._values(x[None]))[0])

    def assessed(self, points: Iterable[Floats]) -> list[tuple[Floats, float, float]]:
        """Return vectors with their penalties, all evaluated at once, and costs."""
        given = np.array([*points])
        values = self._values(given)
        allowed = self._allowed(values)
        if not allowed.all():
            values = self._values(np.where(allowed[:, None], given, 0.0))
        penalty = np.where(allowed, self._penalties(values), NOT_ALLOWED)
        return list(zip(given, penalty.tolist(), self._cost(values).tolist(), strict=True))

    def _allowed(self, values: _Values) -> NDArray[np.bool_]:
        """Return which trees a design may have, shape (m,): siblings and bends stay in order."""
        tree, bends = self._tree, self._tree.bend_branch
        children = np.flatnonzero(tree.parent[1:] == tree.parent[:-1])
        bent = np.flatnonzero(bends[1:] == bends[:-1])
        most_deg, most_bent_deg = 360.0, 175.0  # as files allow
        between_mm = values.place_mm[:, bent + 1] - values.place_mm[:, bent]
        between_deg = values.angle_deg[:, children + 1] - values.angle_deg[:, children]
        allowed: NDArray[np.bool_] = np.all(between_deg > 0.0, axis=1)
        allowed &= np.all(np.abs(values.angle_deg) <= most_deg, axis=1)
        allowed &= np.all(np.abs(values.turn_deg) <= most_bent_deg, axis=1)
        allowed &= np.all(values.length_mm <= LARGEST_MM, axis=1)
        allowed &= np.all(values.place_mm < values.length_mm[:, bends], axis=1)
        allowed &= np.all(between_mm >= values.width_mm[:, bends[bent]], axis=1)
        return allowed

    def _penalties(self, values: _Values) -> Floats:
        """Return the distances of trees from the targets, 0 if they keep them; shape (m,)."""
        trees = self._batch(values)
        tapered = bool((trees.width_mm != trees.end_width_mm).any())
        if tapered and self.targets.rules.limits.most_cuts:  # where sides lie, outlines tell
            builds = [values.builds[number] for number in values.build.tolist()]
            pairs = zip(trees.trees, builds, strict=True)
            return self.targets.penalties([self.kept.changed(shape=t, build=b) for t, b in pairs])
        at_once = self.targets.rules.of_trees(trees, values.builds, values.build)
        return self.targets.of_trees(at_once, trees, values.build)

    def _cost(self, values: _Values) -> Floats:
        """Return the costs of changes to trees, as `change_cost` of their designs; shape (m,)."""
        tree = self._tree
        of_builds = [self._build_cost(build) for build in values.builds]
        total = self.least_cost + np.array(of_builds)[values.build]
        for was, value in ((tree.length_mm, values.length_mm), (tree.bend_mm, values.place_mm)):
            total += WEIGHTS["length"] * _ratios(was, value)
        for was, value in ((self._angle_deg, values.angle_deg), (self._turn_deg, values.turn_deg)):
            total += WEIGHTS["angle"] * np.abs(np.radians(value) - np.radians(was)).sum(axis=1)
        for kind, key in _OWN.items():
            own = self._own[kind]
            has, value = ~np.isnan(own), getattr(values, key)
            total += WEIGHTS[kind.removeprefix("own ")] * _ratios(own[has], value[:, has])
        return total

    def _build_cost(self, build: Build) -> float:
        """Return the cost of the changes to the build."""
        if build not in self._build_costs:
            if len(self._build_costs) >= _MOST_KNOWN:
                self._build_costs.clear()
            changes = build_changes(self.design.build, build)
            self._build_costs[build] = math.fsum(change.cost for change in changes)
        return self._build_costs[build]

    @cached_property
    def _build_costs(self) -> dict[Build, float]:
        return {}

    # --- Vectors to values ----------------------------------------------------------------------

    @cached_property
    def _tree(self) -> BranchTree:
        return self.kept.tree

    @cached_property
    def _angle_deg(self) -> Floats:
        """Angles of the branches as they are written, 0 for the trunk; shape (n,)."""
        angle = {one.name: one.angle_deg for one in self.kept.branches or ()}
        return np.array([angle.get(name, 0.0) for name in self.kept.names])

    @cached_property
    def _turn_deg(self) -> Floats:
        """Turns of the bends, shape (b,)."""
        return np.array([deg(turn_rad) for turn_rad in self._tree.bend_rad.tolist()])

    @cached_property
    def _own(self) -> Mapping[str, Floats]:
        """What branches have for themselves, NaN where a level's value holds; shape (n,) each."""
        return {kind: _own(self.kept, key) for kind, key in _OWN.items()}

    @cached_property
    def _entries(self) -> Mapping[str, tuple[Ints, Ints]]:
        """Of each kind, the entries of a vector, and the branches, bends or levels of these."""
        numbered: dict[str, list[tuple[int, int]]] = {}
        for entry, (kind, place) in enumerate(self.variables):
            numbered.setdefault(kind, []).append((entry, place))
        return {
            kind: (np.array([entry for entry, _ in pairs]), np.array([place for _, place in pairs]))
            for kind, pairs in numbered.items()
        }

    def _scaled(self, kind: str, usual: Floats, x: Floats) -> Floats:
        """Return values times the factors of their kind, rounded where they change; (m, k)."""
        values = np.repeat(usual[None], len(x), axis=0)
        if kind in self._entries:
            entries, places = self._entries[kind]
            scaled = np.round(usual[places] * np.exp(x[:, entries]), FIX_DECIMALS)
            values[:, places] = np.where(
                x[:, entries] == 0.0, usual[places], np.maximum(_LEAST, scaled)
            )
        return values

    def _turned(self, kind: str, usual_deg: Floats, x: Floats) -> Floats:
        """Return angles with the turns of their kind, rounded where they change; (m, k)."""
        values = np.repeat(usual_deg[None], len(x), axis=0)
        if kind in self._entries:
            entries, places = self._entries[kind]
            turned = np.round(usual_deg[places] + np.degrees(x[:, entries]), FIX_DECIMALS)
            values[:, places] = np.where(x[:, entries] == 0.0, usual_deg[places], turned)
        return values

    def _values(self, x: Floats) -> _Values:
        """Return the trees at vectors, shape (m, v)."""
        tree = self._tree
        turn_deg = self._turned("bend", self._turn_deg, x)
        turn_deg[turn_deg == 0.0] = _LEAST  # a bend of 0 degrees would be none
        sized, build, width_mm = self._sized(x)
        level = tree.level - 1
        tapers = np.array([one.taper or (1.0,) * len(one.widths_mm) for one in sized])
        fillets_mm = np.array([(0.0, *one.fillet_mm) for one in sized])
        taper = self._with_own("own taper", tapers[build][:, level], x)
        own_taper = ~np.isnan(self._own["own taper"])
        taper[:, own_taper] = np.clip(taper[:, own_taper], LEAST_TAPER, 1.0)
        fillet_mm = self._with_own("own fillet", fillets_mm[build][:, level], x)
        own = np.flatnonzero(~np.isnan(self._own["own fillet"]))
        share = self.targets.of_rule(check_fillet)["most_error_share"]
        most_mm = np.minimum(fillet_mm[:, own], share * width_mm[:, own])
        fillet_mm[:, own] = np.maximum(self.targets.least_fillet_mm(), most_mm)
        values = _Values(
            length_mm=self._scaled("length", tree.length_mm, x),
            angle_deg=self._turned("angle", self._angle_deg, x),
            width_mm=width_mm,
            taper=taper,
            fillet_mm=fillet_mm,
            place_mm=self._scaled("place", tree.bend_mm, x),
            turn_deg=turn_deg,
            builds=sized,
            build=build,
        )
        return self._pressed(values)

    def _with_own(self, kind: str, usual: Floats, x: Floats) -> Floats:
        """Return the values of branches: their levels', or what they have for themselves."""
        own = self._own[kind]
        return np.where(np.isnan(own), usual, self._scaled(kind, own, x))

    def _sized(self, x: Floats) -> tuple[tuple[Build, ...], Ints, Floats]:
        """Return builds with fitting fillets, each once, which is whose, and widths; (m,), (m, n).

        Pressures are as designed.
        """
        shaped = x[:, self._shaped_entries]
        first: dict[bytes, int] = {}
        keys = [row.tobytes() for row in shaped]
        for row, key in enumerate(keys):
            first.setdefault(key, row)
        place = {key: number for number, key in enumerate(first)}
        built = [self._build(key, x[row]) for key, row in first.items()]
        build = np.array([place[key] for key in keys])
        widths_mm = np.array([width_mm for _, width_mm in built])
        return tuple(one for one, _ in built), build, widths_mm[build]

    @cached_property
    def _shaped_entries(self) -> Ints:
        """The entries of a vector that builds, or what fits them, depend on."""
        shaped = [entry for entry, (kind, _) in enumerate(self.variables) if kind in _SHAPED]
        return np.array(shaped, dtype=np.int64)

    def _build(self, key: bytes, x: Floats) -> tuple[Build, Floats]:
        """Return the build at a vector with fitting fillets, and the widths of all branches; (n,).

        Parameters
        ----------
        key
            What it depends on.
        """
        if key not in self._built:
            if len(self._built) >= _MOST_KNOWN:
                self._built.clear()
            tree, depth = self._tree, len(self.kept.build.widths_mm)
            scaled = scaled_build(self.kept.build, depth, self._factors(x))
            widths_mm = np.array(scaled.widths_mm)[tree.level - 1]
            widths_mm = self._with_own("own width", widths_mm[None], x[None])[0]
            fits_mm = np.where(np.isnan(self._own["own fillet"]), widths_mm, np.inf)
            levels = range(2, depth + 1)
            narrowest_mm = [float(fits_mm[tree.level == level].min()) for level in levels]
            fitting = self.targets.with_fitting_fillets(scaled, narrowest_mm)
            self._built[key] = fitting, widths_mm
        return self._built[key]

    @cached_property
    def _built(self) -> dict[bytes, tuple[Build, Floats]]:
        return {}

    def _factors(self, x: Floats) -> dict[str, dict[int, float]]:
        """Return the factors of the values of the build, by kind and level."""
        factors: dict[str, dict[int, float]] = {}
        for (kind, place), value in zip(self.variables, x.tolist(), strict=True):
            if kind in _SHAPED and value:
                factors.setdefault(kind, {})[place] = math.exp(value)
        return factors

    def _pressed(self, values: _Values) -> _Values:
        """Return values with the pressures that growth takes and seams stand, each build once."""
        takes_kpa = [0.0] * len(values.build)
        if self.targets.fit.measured:
            takes_kpa = self.targets.growth_kpa(self._batch(values)).tolist()
        wide_mm = values.width_mm.max(axis=1).tolist()
        place: dict[tuple[int, float, float], int] = {}
        builds: dict[Build, int] = {}
        rows = []
        for kind in zip(values.build.tolist(), wide_mm, takes_kpa, strict=True):
            if kind not in place:
                number, widest_mm, takes = kind
                build = values.builds[number]
                pouch_mm = build.pouch.flat_width_mm if build.pouch else 0.0
                pressed = self.targets.with_pressure(build, max(widest_mm, pouch_mm), takes)
                place[kind] = builds.setdefault(pressed, len(builds))
            rows.append(place[kind])
        return values._replace(builds=tuple(builds), build=np.array(rows))

    # --- Values to trees ------------------------------------------------------------------------

    def _batch(self, values: _Values) -> TreeBatch:
        """Return the straight parts of trees, as `BranchTree.straight` has them."""
        parts, count = self._tree.straight, len(values.build)
        branch, is_first = parts.branch, ~parts.is_bent
        before, behind = self._bends_beside
        begin_mm = np.where(before < 0, 0.0, _taken(values.place_mm, before))
        length_mm = values.length_mm[:, branch]
        end_mm = np.where(behind < 0, length_mm, _taken(values.place_mm, behind))
        angle_deg = np.where(is_first, values.angle_deg[:, branch], _taken(values.turn_deg, before))
        base_mm = values.width_mm[:, branch]
        tip_mm = base_mm * values.taper[:, branch]
        width_mm = base_mm + begin_mm / length_mm * (tip_mm - base_mm)
        end_width_mm = base_mm + end_mm / length_mm * (tip_mm - base_mm)
        elbow_mm = np.maximum(default_fillet_mm(0.0), DEFAULT_FILLET_RATIO * width_mm)
        fillet_mm = np.where(is_first, values.fillet_mm[:, branch], elbow_mm)
        return TreeBatch(
            trees=SomeOf(lambda row: self._branch_tree(values, row), np.arange(count)),
            first=np.arange(count + 1) * len(parts),
            parent=np.tile(parts.parent, count),
            level=np.tile(parts.level, count),
            branch=np.tile(branch, count),
            offset_rad=np.radians(angle_deg).ravel(),
            length_mm=(end_mm - begin_mm).ravel(),
            width_mm=width_mm.ravel(),
            end_width_mm=np.where(behind < 0, tip_mm, end_width_mm).ravel(),
            fillet_mm=fillet_mm.ravel(),
        )

    def _branch_tree(self, values: _Values, row: int) -> BranchTree:
        """Return one of some trees."""
        return replace(
            self._tree,
            offset_rad=frozen_floats("angle", np.radians(values.angle_deg[row])),
            length_mm=frozen_floats("length", values.length_mm[row]),
            width_mm=frozen_floats("width", values.width_mm[row]),
            end_width_mm=frozen_floats("taper", values.width_mm[row] * values.taper[row]),
            fillet_mm=frozen_floats("fillet", values.fillet_mm[row]),
            bend_mm=frozen_floats("bend", values.place_mm[row]),
            bend_rad=frozen_floats("bend", np.radians(values.turn_deg[row])),
        )

    @cached_property
    def _bends_beside(self) -> tuple[Ints, Ints]:
        """The bends before and behind each straight part, -1 where there is none; (p,) each."""
        tree, parts = self._tree, self._tree.straight
        before, number = np.full(len(parts), -1), np.zeros(len(parts), dtype=np.int64)
        first = np.searchsorted(tree.bend_branch, parts.branch)
        for row in np.flatnonzero(parts.is_bent).tolist():
            number[row] = number[parts.parent[row]] + 1
            before[row] = first[row] + number[row] - 1
        count = np.bincount(tree.bend_branch, minlength=len(tree))[parts.branch]
        return before, np.where(number < count, first + number, -1)

    # --- Directions -----------------------------------------------------------------------------

    def directions(self) -> Floats:
        """Return the search directions, shape (k, n): single values and groups of them."""
        groups = (*self._of_joints(), *self._of_subtrees(), *self._of_levels())
        rows = [*np.eye(len(self)), *(row for row in groups if np.count_nonzero(row) > 1)]
        return both_ways(rows)

    def _row(self, amounts: Mapping[Variable, float]) -> Floats:
        """Return a direction by the amounts of some variables; those that do not change are out."""
        return np.array([amounts.get(variable, 0.0) for variable in self.variables])

    @cached_property
    def _children(self) -> list[Ints]:
        """The children at each joint."""
        parent = self._tree.parent
        return [np.flatnonzero(parent == row) for row in np.unique(parent[1:])]

    @staticmethod
    def _spread(children: Ints) -> dict[Variable, float]:
        """Return what spreads the children of a joint evenly."""
        turns = np.linspace(-1.0, 1.0, len(children)) if len(children) > 1 else [0.0]
        return {("angle", row): turn for row, turn in zip(children.tolist(), turns, strict=True)}

    def _of_joints(self) -> Iterator[Floats]:
        """Yield directions of single joints: its gaps, all of them, its children together."""
        for children in self._children:
            rows = children.tolist()
            yield self._row(self._spread(children))
            yield self._row({("angle", row): 1.0 for row in rows})
            yield self._row({("length", row): 1.0 for row in rows})
            for number, _ in enumerate(pairwise(rows), start=1):
                sides = [-1.0] * number + [1.0] * (len(rows) - number)
                turned = zip(rows, sides, strict=True)
                yield self._row({("angle", row): side for row, side in turned})

    def _of_subtrees(self) -> Iterator[Floats]:
        """Yield the lengths of every branch with all that hangs on it, places of bends included."""
        tree = self._tree
        inside = np.eye(len(tree), dtype=np.bool_)  # whether each branch has each other below it
        for row in range(len(tree) - 1, 0, -1):
            inside[tree.parent[row]] |= inside[row]
        for below in inside:
            places = np.flatnonzero(below[tree.bend_branch]).tolist()
            lengths = {("length", row): 1.0 for row in np.flatnonzero(below).tolist()}
            yield self._row(lengths | {("place", bend): 1.0 for bend in places})

    def _of_levels(self) -> Iterator[Floats]:
        """Yield lengths and fans of every level and of all, and widths of all or at one joint."""
        tree, deepest = self._tree, int(self._tree.level.max())
        for least in range(2, deepest + 1):
            for most in {least, deepest}:
                rows = np.flatnonzero((tree.level >= least) & (tree.level <= most))
                yield self._row({("length", row): 1.0 for row in rows.tolist()})
                fans = [one for one in self._children if least <= tree.level[one[0]] <= most]
                spread = {key: turn for fan in fans for key, turn in self._spread(fan).items()}
                yield self._row(spread)
        widths = [variable for variable in self.variables if variable[0] in ("width", "own width")]
        yield self._row(dict.fromkeys(widths, 1.0))
        yield self._row({key: 1.0 for key in widths if key != ("width", 0)})
        # All that narrows at the joints of a level.
        for level in range(deepest - 1):
            yield self._row({("taper", level): 1.0, ("width", level + 1): 1.0})


def _own(design: Design, key: str) -> Floats:
    """Return what each branch has for itself, NaN where it has nothing; shape (n,)."""
    found = {one.name: getattr(one, key) for one in design.branches or ()}
    return np.array([found.get(name) for name in design.names], dtype=np.float64)


def _taken(values: Floats, places: Ints) -> Floats:
    """Return columns of values, shape (m, k); zeros where there are none."""
    return values[:, places] if values.shape[1] else np.zeros((len(values), len(places)))


def _ratios(was: Floats, value: Floats) -> Floats:
    """Return the summed absolute logarithms of ratios, as `DesignChange` counts them; (m,)."""
    usable = (was > 0.0) & (value > 0.0)
    ratio = np.where(usable, value / np.where(usable, was, 1.0), np.where(was == value, 1.0, 2.0))
    total: Floats = np.abs(np.log(ratio)).sum(axis=1)
    return total


# --- Fewer branches -------------------------------------------------------------------------------


def kept_trees(design: Design, targets: FixTargets, most: int) -> list[Design]:
    """Return ways to leave branches out with all that hangs on them, the most promising first.

    One branch after the other is left out: the one without which the estimated cost of the rest is
    least. All that are tried on the way compete.
    """
    space = TreeSpace.of(design, design, targets)
    tree = space.at(np.zeros(len(space))).tree  # with fillets that fit
    found: dict[bytes, tuple[float, Ints]] = {}
    rows, best_penalty = np.arange(len(tree)), math.inf
    while len(rows) > 1 and best_penalty > 0.0:
        ways = [_without(tree, rows, row) for row in rows[1:].tolist()]
        costs, penalties = _estimates(design, tree, targets, ways)
        for way, cost in zip(ways, costs.tolist(), strict=True):
            found.setdefault(way.tobytes(), (cost, way))
        best = int(np.argmin(costs))
        rows, best_penalty = ways[best], float(penalties[best])
    ranked = sorted(found.values(), key=lambda one: one[0])[:most]
    return [_with_some(design, way) for _, way in ranked]


def _without(tree: BranchTree, rows: Ints, gone: int) -> Ints:
    """Return some rows of a tree without one, and without all that hangs on it."""
    kept = np.zeros(len(tree), dtype=np.bool_)
    kept[rows] = True
    kept[gone] = False
    for row in range(gone + 1, len(tree)):
        kept[row] &= kept[tree.parent[row]]
    return np.flatnonzero(kept)


def _estimates(
    design: Design, tree: BranchTree, targets: FixTargets, ways: list[Ints]
) -> tuple[Floats, Floats]:
    """Return estimated costs of fixing parts of a tree, and their penalties; (m,) each."""
    trees = [tree.taken(way, tree.length_mm[way]) for way in ways]
    depths = np.array([int(one.level.max()) for one in trees])
    builds = [scaled_build(design.build, depth, {}) for depth in range(1, depths.max() + 1)]
    batch = TreeBatch.of(trees)
    at_once = targets.rules.of_trees(batch, builds, depths - 1)
    penalties = targets.of_trees(at_once, batch, depths - 1)
    whole_mm = tree.total_length_mm
    lost = np.array([loss_cost(whole_mm, one.total_length_mm) for one in trees])
    return lost + PENALTY_COST * penalties, penalties


def _with_some(design: Design, rows: Ints) -> Design:
    """Return a design with some of its branches."""
    names = {design.names[row] for row in rows.tolist()}
    depth = int(design.tree.level[rows].max())
    return design.changed(
        branches=tuple(one for one in design.branches or () if one.name in names),
        build=scaled_build(design.build, depth, {}),
    )
