"""The final state of a growth: every branch's shape and why it stopped."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from os import PathLike
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from vinefab.core.codec import IF_KNOWN, Record
from vinefab.core.errors import BadInputError
from vinefab.core.front_door import ABOVE, Pictured
from vinefab.core.limits import deg
from vinefab.core.plain_text import counted, json_text
from vinefab.core.validation import Floats, Ints
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.model.tree import BranchTree


class Stop(IntEnum):
    """Why a branch ended where it did."""

    FULL_LENGTH = 0
    HEAD_ON = 1
    CORNER = 2
    NOT_DEPLOYED = 3
    PRESSURE = 4
    BRANCH = 5  # at the body of another branch
    NOT_EVERTED = 6  # at its base: it failed to come out of its parent's tip

    @property
    def label(self) -> str:
        """The name used in files: ``full_length``, ``head_on``, ``corner`` and so on."""
        return self.name.lower()


STUCK_STOPS = (Stop.HEAD_ON, Stop.CORNER, Stop.PRESSURE, Stop.BRANCH, Stop.NOT_EVERTED)
"""Stops before the planned length."""

CUT_STOPS = (Stop.BRANCH, Stop.NOT_EVERTED)
"""Stops that walls have no part in: such a branch is the beginning of one that grew alone."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deployment(Pictured):
    """The final state of one growth, as arrays over the branches of its tree.

    Parameters
    ----------
    tree
        The planned branches, n of them.
    pose
        Where the trunk was launched.
    points_mm
        Chain points of all branches one after the other, shape (p, 2): base, contacts, tip. A
        branch that never emerged has none.
    first_point
        Index of each branch's first chain point, with the total at the end, shape (n + 1,).
    stop
        Codes of `Stop`, shape (n,).
    grown_mm
        Grown length of each branch, the length of its chain, shape (n,).
    contact_turn_rad
        Sum of absolute turns at contacts and at the base hinge, shape (n,).
    bend_points
        Indices of the chain points that are preformed bends, rising, shape (b,).
    design, world, growth
        What `Design.grow` grew, where, and the growth model's choices by name (plain values, angles
        in degrees); None and empty in a deployment that is one of a batch.
    """

    tree: BranchTree
    pose: Pose
    points_mm: Floats
    first_point: Ints
    stop: Ints
    grown_mm: Floats
    contact_turn_rad: Floats
    bend_points: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    design: Design | None = None
    world: Map | None = None
    growth: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(self.tree)
        if self.first_point.shape != (count + 1,) or self.first_point[-1] != len(self.points_mm):
            raise BadInputError("first_point", self.first_point.shape, f"({count + 1},), rising")
        for array in (self.points_mm, self.first_point, self.stop, self.grown_mm):
            array.setflags(write=False)
        self.contact_turn_rad.setflags(write=False)

    def __repr__(self) -> str:
        counts = [(int(np.count_nonzero(self.stop == stop)), stop.label) for stop in Stop]
        stops = ", ".join(f"{count} {label}" for count, label in counts if count)
        grown_mm, planned_mm = float(self.grown_mm.sum()), self.tree.total_length_mm
        return (
            f"<Deployment: {grown_mm:.5g} of {planned_mm:.5g} mm grown, "
            f"{counted(len(self.tree), 'branch')}: {stops}>"
        )

    def chain_mm(self, branch: int) -> Floats:
        """Return base, contacts and tip of one branch, shape (k, 2); (0, 2) if not deployed."""
        return self.points_mm[self.first_point[branch] : self.first_point[branch + 1]]

    def contacts_mm(self, branch: int) -> Floats:
        """Return the obstacle vertices that one branch is wrapped around, shape (k, 2)."""
        inside = np.arange(self.first_point[branch] + 1, self.first_point[branch + 1] - 1)
        return self.points_mm[inside[~np.isin(inside, self.bend_points)]]

    def bends_mm(self, branch: int) -> Floats:
        """Return the preformed bends of one branch that it has grown beyond, shape (k, 2)."""
        one, two = np.searchsorted(self.bend_points, self.first_point[branch : branch + 2])
        return self.points_mm[self.bend_points[one:two]]

    @property
    def deployed(self) -> NDArray[np.bool_]:
        """Whether each branch emerged at all, shape (n,)."""
        return np.not_equal(self.stop, Stop.NOT_DEPLOYED)

    @property
    def tips_mm(self) -> Floats:
        """Tips of the branches that deployed, in the tree's order, shape (m, 2)."""
        return self.points_mm[self.first_point[1:][self.deployed] - 1]

    @property
    def base_mm(self) -> Floats:
        """Front length at which each branch begins to grow, shape (n,).

        The front length is the way along the body from the robot's base to a growing tip, the same
        for all that grow. It is infinite for branches that never emerge: those of a parent that did
        not, and those that a stuck parent holds back.
        """
        begin = [0.0] * len(self.tree)
        end = np.where(self.deployed, self.grown_mm, np.inf).tolist()
        for branch, parent in enumerate(self.tree.parent.tolist()):
            if parent >= 0:  # parents come before children
                begin[branch] = end[parent]
                end[branch] += begin[branch]
        return np.where(self.deployed, begin, np.inf)

    @property
    def full_mm(self) -> float:
        """Front length at which the last branch has stopped; 0 if nothing grew."""
        out = self.deployed
        return float((self.base_mm[out] + self.grown_mm[out]).max(initial=0.0))

    @property
    def stops(self) -> dict[str, int]:
        """How many branches ended for each reason, by the reason's name."""
        counts = np.bincount(self.stop, minlength=len(Stop)).tolist()
        # Reasons that files did not always have stand there where they occur.
        return {stop.label: counts[stop] for stop in Stop if stop <= Stop.PRESSURE or counts[stop]}

    @property
    def summary(self) -> tuple[str, ...]:
        """How each branch ended and why, a line each; only of results of `Design.grow`."""
        lines: tuple[str, ...] = ABOVE.deployment_summary(self)
        return lines

    def write(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write a deployment that `Design.grow` returned, in the form that the name ends in.

        Parameters
        ----------
        path
            ``.json``: every branch with its points (``vinefab/deployment-1``); ``.svg`` or
            ``.png``: a plan; ``.gif``: the growth as a moving picture.
        force
            Overwrite a file that vinefab did not write, or of another kind.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        BadInputError
            If the name ends in something else, or the deployment does not know its design and map.
        CannotWriteError
            If the system refuses.
        ForeignFileError
            If the place is taken.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from vinefab import maps
        >>> grown = Design.read("plain_vine").grow(maps.pegs(seed=1))
        >>> with TemporaryDirectory() as folder:
        ...     grown.write(f"{folder}/grown.json").name
        'grown.json'
        """
        written: Path = ABOVE.write_deployment(self, path, force=force)
        return written


def deployment_text(
    deployment: Deployment,
    design_name: str,
    map_name: str,
    metrics: Mapping[str, object],
    history: Sequence[Mapping[str, object]] | None = None,
    more: Mapping[str, object] | None = None,
) -> str:
    """Return a deployment as JSON: lengths in mm, angles in degrees.

    Parameters
    ----------
    history
        Earlier shapes, plain values; left out when None.
    more
        Further keys with plain values.
    """
    content = {
        "design": design_name,
        "map": map_name,
        "pose": deployment.pose.content,
        "branches": [branch.content for branch in branch_records(deployment)],
        "metrics": dict(metrics),
        **(more or {}),
    }
    if history is not None:
        content["history"] = list(history)
    return json_text("vinefab/deployment-1", content)


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchRecord(Record):
    """A branch of a deployment as our JSON files have it; shapes of points are (k, 2)."""

    id: str
    parent: str | None
    level: int
    points_mm: list[list[float]]  # base, contacts and tip
    planned_mm: Annotated[float | None, IF_KNOWN]
    grown_mm: float
    stop: str | None  # None: it grows on
    contact_turn_deg: float
    joint_deg: float
    contacts_mm: list[list[float]]
    bends_mm: Annotated[list[list[float]] | None, IF_KNOWN]


def branch_records(deployment: Deployment) -> list[BranchRecord]:
    """Return the branches of a deployment as our JSON files have them."""
    tree = deployment.tree
    ids = tree.ids
    return [
        BranchRecord(
            id=name,
            parent=None if tree.parent[index] < 0 else ids[tree.parent[index]],
            level=int(tree.level[index]),
            points_mm=deployment.chain_mm(index).tolist(),
            planned_mm=float(tree.length_mm[index]),
            grown_mm=float(deployment.grown_mm[index]),
            stop=Stop(int(deployment.stop[index])).label,
            contact_turn_deg=deg(float(deployment.contact_turn_rad[index])),
            joint_deg=deg(float(tree.offset_rad[index])),
            contacts_mm=deployment.contacts_mm(index).tolist(),
            bends_mm=deployment.bends_mm(index).tolist() or None,
        )
        for index, name in enumerate(ids)
    ]
