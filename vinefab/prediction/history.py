"""The shape of a deployment at chosen lengths of its front.

The front is where a robot grows: its length is the way along the body from the base to a growing
tip. All tips are that far from the base, as if film were fed at one speed everywhere: the children
of a branch begin together when it has grown, whatever their cousins do (so levels overlap in time
where the branches of a level differ in length), and at front length s every branch has what is left
of s at its base, at most its own length. Growth to a length passes through the shapes at all
smaller lengths, so the shape at s is the growth of the same tree cut off at s.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, frozen_floats, frozen_ints, positive, whole
from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.files.results_json import branches_content
from vinefab.model.tree import BranchTree
from vinefab.pages.animation import DeploymentFrame

MOST_FRAMES = 1000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class History:
    """A deployment that can be asked how it lay at any time."""

    # design, terrain, options: what was grown, where and by which rules
    design: Design
    terrain: Terrain
    options: GrowthOptions
    final: Deployment  # what became of it

    @property
    def base_mm(self) -> Floats:
        """Front length at which each branch begins to grow, shape (n,).

        It is infinite for what never emerges: branches of a parent that did not, and those that a
        stuck parent holds back.
        """
        tree, final = self.final.tree, self.final
        begin = np.zeros(len(tree))
        end = np.where(final.deployed, final.grown_mm, np.inf)
        for branch in range(1, len(tree)):  # parents come before children
            begin[branch] = end[tree.parent[branch]]
            end[branch] += begin[branch]
        begin[~final.deployed] = np.inf
        return begin

    @property
    def full_mm(self) -> float:
        """Front length at which the last branch has stopped; 0 if nothing grew."""
        out = self.final.deployed
        return float((self.base_mm[out] + self.final.grown_mm[out]).max(initial=0.0))

    def at(self, front_mm: float) -> DeploymentFrame:
        """Return the shape at a front length; beyond the full length, the final one."""
        positive("--history", front_mm)
        if front_mm >= self.full_mm:
            still = np.zeros(len(self.final.tree), dtype=np.bool_)
            return DeploymentFrame(front_mm=self.full_mm, deployment=self.final, is_growing=still)
        tree, is_growing = self._tree_at(front_mm)
        deployment = grow(self.design, self.terrain, self.final.pose, self.options, tree=tree)
        return DeploymentFrame(front_mm=front_mm, deployment=deployment, is_growing=is_growing)

    def frames(self, fronts_mm: Sequence[float]) -> tuple[DeploymentFrame, ...]:
        """Return the shapes at several front lengths, in the order given."""
        return tuple(self.at(front_mm) for front_mm in fronts_mm)

    def even_steps(self, count: int) -> tuple[DeploymentFrame, ...]:
        """Return the shapes after equal steps of the front; the last is the final one."""
        whole("number of steps", count, 1, MOST_FRAMES)
        if self.full_mm <= 0.0:
            still = np.zeros(len(self.final.tree), dtype=np.bool_)
            return (DeploymentFrame(front_mm=0.0, deployment=self.final, is_growing=still),)
        steps = self.full_mm * np.arange(1, count) / count
        return self.frames((*steps.tolist(), self.full_mm))

    def _tree_at(self, front_mm: float) -> tuple[BranchTree, NDArray[np.bool_]]:
        """Return the branches that have emerged, cut off at the front, and which grow on.

        Siblings begin together, so the names of those that are left stay what they were.
        """
        tree, base_mm = self.final.tree, self.base_mm
        out = np.flatnonzero(base_mm < front_mm)
        end_mm = base_mm[out] + self.final.grown_mm[out]
        is_growing = end_mm > front_mm
        # What has stopped keeps its planned length: cut to the length grown, a branch that met a
        # wall just there would count as grown in full.
        length_mm = np.where(is_growing, front_mm - base_mm[out], tree.length_mm[out])
        place = np.full(len(tree), -1)
        place[out] = np.arange(len(out))
        cut = BranchTree(
            parent=frozen_ints(np.where(tree.parent[out] < 0, -1, place[tree.parent[out]])),
            level=frozen_ints(tree.level[out]),
            offset_rad=frozen_floats("offset_rad", tree.offset_rad[out]),
            length_mm=frozen_floats("length_mm", length_mm),
        )
        return cut, is_growing


def fronts_from(text: str) -> int | tuple[float, ...]:
    """Return what ``--history`` asks for: a number of equal steps, or front lengths in mm.

    A whole number alone is a number of steps; with a comma or a decimal point it is a length.

    Examples
    --------
    >>> fronts_from("10"), fronts_from("120,240"), fronts_from("120,")
    (10, (120.0, 240.0), (120.0,))
    """
    if text.strip().isdecimal():
        return whole("--history", int(text), 1, MOST_FRAMES)
    try:
        lengths = tuple(float(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        raise BadInputError("--history", text, "L1,L2,... in mm, or a number of steps") from error
    if not 1 <= len(lengths) <= MOST_FRAMES:
        raise BadInputError("--history", text, f"1 to {MOST_FRAMES} lengths")
    return tuple(positive("--history", length) for length in lengths)


def frames_of(history: History, wanted: int | tuple[float, ...]) -> tuple[DeploymentFrame, ...]:
    """Return the frames that `fronts_from` read."""
    return history.even_steps(wanted) if isinstance(wanted, int) else history.frames(wanted)


def history_content(frames: Sequence[DeploymentFrame]) -> list[dict[str, object]]:
    """Return frames as they stand in ``vinefab/deployment-1``.

    Each has the branches that have emerged, in the form of the final ones; ``stop`` is null for
    those that grow on, and ``planned_mm`` is left out, as it stands with the final ones.
    """
    return [{"front_mm": frame.front_mm, "branches": _branches_at(frame)} for frame in frames]


def _branches_at(frame: DeploymentFrame) -> list[dict[str, object]]:
    branches = branches_content(frame.deployment)
    for branch, is_growing in zip(branches, frame.is_growing.tolist(), strict=True):
        del branch["planned_mm"]
        if is_growing:
            branch["stop"] = None
    return [branch for branch in branches if branch["stop"] != Stop.NOT_DEPLOYED.label]
