"""One deployment: a design on a map from a pose, where it did not fit, its shapes on the way.

The front is where a robot grows: its length is the way along the body from the base to a growing
tip. All tips are that far from the base, as if film were fed at one speed everywhere: the children
of a branch begin together when it has grown, whatever their cousins do (so levels overlap in time
where the branches of a level differ in length), and at front length s every branch has what is left
of s at its base, at most its own length. Growth to a length passes through the shapes at all
smaller lengths, so the shape at s is the growth of the same tree cut off at s.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import agreeing, counted, some_of
from vinefab.core.validation import Floats, positive, whole
from vinefab.core.view import (
    Answer,
    Block,
    Fact,
    Facts,
    Notes,
    Number,
    Picture,
    Result,
    document,
)
from vinefab.growth.batch import Engine, grow_on
from vinefab.growth.options import GrowthChoice, GrowthOptions, growth_text, on_surface
from vinefab.growth.plan import Plan
from vinefab.growth.terrain import Terrain
from vinefab.inflation.pattern import as_grown
from vinefab.model.deployment import (
    CUT_STOPS,
    BranchRecord,
    Deployment,
    Stop,
    branch_records,
    deployment_text,
)
from vinefab.model.design import Design
from vinefab.model.files.run_context import RunContext
from vinefab.model.files.shipped import path_given
from vinefab.model.inputs import PICTURE_ENDS, MapLike, PoseLike, as_growth, as_map
from vinefab.model.map import Map, Pose
from vinefab.model.target import TargetsResult, out_of_reach
from vinefab.pages.animation import DeploymentFrame, gif_animation, svg_animation
from vinefab.pages.panel import Page
from vinefab.pages.plan import deployment_plan, page_bytes
from vinefab.tasks.reach import touched_targets

if TYPE_CHECKING:
    from typing import Unpack

    from vinefab.model.inputs import GrowthShortcuts

MOST_FRAMES = 1000


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """A deployment at any length of its front."""

    grown: "DeployedDesign"  # the finished deployment, and by which rules it grew

    @property
    def final(self) -> Deployment:
        """The finished deployment."""
        return self.grown.deployment

    @property
    def base_mm(self) -> Floats:
        """Front length at which each branch begins to grow, shape (n,); see `Deployment`."""
        return self.final.base_mm

    @property
    def full_mm(self) -> float:
        """Front length at which the last branch has stopped; 0 if nothing grew."""
        return self.final.full_mm

    def at(self, front_mm: float, *, engine: Engine = "auto") -> DeploymentFrame:
        """Return the shape at a front length; beyond the full length, the final one."""
        positive("--history", front_mm)
        if front_mm >= self.full_mm:
            still = np.zeros(len(self.final.tree), dtype=np.bool_)
            return DeploymentFrame(front_mm=self.full_mm, deployment=self.final, is_growing=still)
        # The branches that have emerged, cut off at the front. Siblings begin together, so that the
        # names of those that are left stay what they were.
        of, base_mm = self.grown, self.base_mm
        out = np.flatnonzero(base_mm < front_mm)
        is_growing = base_mm[out] + self.final.grown_mm[out] > front_mm
        # What has stopped keeps its planned length: cut to the length grown, a branch that met a
        # wall just there would count as grown in full.
        length_mm = np.where(is_growing, front_mm - base_mm[out], self.final.tree.length_mm[out])
        plan = Plan.of(of.design, of.options).cut(out, length_mm, of.options)
        alone = of.options.changed(branch_contact="pass", emergence=1.0)
        deployment = grow_on(of.design, of.terrain, self.final.pose, alone, engine, plan)
        deployment = self._with_cuts(deployment, front_mm)
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

    def _with_cuts(self, grown: Deployment, front_mm: float) -> Deployment:
        """Return a shape on the way where branches that others stopped follow their final paths."""
        out = np.flatnonzero(self.base_mm < front_mm)
        cut = np.isin(self.final.stop[out], CUT_STOPS)
        if not cut.any():
            return grown
        chains = [grown.chain_mm(place) for place in range(len(out))]
        length_mm, stop = grown.grown_mm.copy(), grown.stop.copy()
        for place in np.flatnonzero(cut).tolist():
            branch = int(out[place])
            chain_mm, whole_mm = self.final.chain_mm(branch), self.final.grown_mm[branch]
            left_mm = min(front_mm - self.base_mm[branch], whole_mm)
            if left_mm < whole_mm:
                at_mm = np.cumsum([0.0, *np.hypot(*np.diff(chain_mm, axis=0).T)])
                inside = max(int(np.searchsorted(at_mm, left_mm)), 1)
                tip_mm = [np.interp(left_mm, at_mm, column) for column in chain_mm.T]
                chain_mm = np.array([*chain_mm[:inside], tip_mm])
            chains[place] = chain_mm
            length_mm[place], stop[place] = left_mm, self.final.stop[branch]
        return replace(
            grown,
            points_mm=np.concatenate(chains),
            first_point=np.cumsum([0, *(len(chain) for chain in chains)]),
            stop=stop,
            grown_mm=length_mm,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRecord(Record):
    """A shape on the way as it stands in ``vinefab/deployment-1``.

    It has the branches that have emerged, in the form of the final ones; ``stop`` is null for
    those that grow on, and ``planned_mm`` is left out, as it stands with the final ones.
    """

    front_mm: float
    branches: list[BranchRecord]

    @classmethod
    def of(cls, frame: DeploymentFrame) -> "FrameRecord":
        """Return the record of a frame."""
        every = zip(branch_records(frame.deployment), frame.is_growing.tolist(), strict=True)
        branches = [
            replace(branch, planned_mm=None, stop=None if is_growing else branch.stop)
            for branch, is_growing in every
        ]
        out = [one for one in branches if one.stop != Stop.NOT_DEPLOYED.label]
        return cls(front_mm=frame.front_mm, branches=out)


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchPlace(Record):
    """A branch and a place on the map."""

    branch: str  # its id
    # x_mm, y_mm: where
    x_mm: float
    y_mm: float
    radius_mm: float  # its inflated radius


def without_room(deployment: Deployment, options: GrowthOptions) -> tuple[BranchPlace, ...]:
    """Return the branches that had no room where they should have started, and where that is.

    Only inflated bodies can lack room. Branches further out, whose parents never emerged, are not
    named.
    """
    if options.body == "centerline":
        return ()
    parent = deployment.tree.parent
    can_emerge = (parent < 0) | (deployment.stop[parent] == Stop.FULL_LENGTH)
    if options.deploys_stuck:
        can_emerge |= deployment.deployed[parent]
    can_emerge &= (parent < 0) | ~np.isin(deployment.stop[parent], CUT_STOPS)
    lost = np.flatnonzero(~deployment.deployed & can_emerge).tolist()
    return tuple(_place(options, deployment, branch, int(parent[branch])) for branch in lost)


def stayed_text(left: Sequence[bool], design: Design, options: GrowthOptions) -> list[str]:
    """Return in how many deployments the trunk never left its start; nothing if it always did.

    Parameters
    ----------
    left
        For each deployment, whether the trunk left its start.
    """
    count = len(left)
    stayed = count - sum(left)
    if not stayed:
        return []
    diameter_mm = 2.0 * options.radius_mm(design.build.widths_mm[0])
    where = "" if count == 1 else f" in {stayed} of {counted(count, 'deployment')}"
    return [
        f"the trunk never leaves its start{where}: no room for its inflated body of "
        f"{diameter_mm:.0f} mm"
    ]


def wedged(deployment: Deployment, options: GrowthOptions) -> tuple[BranchPlace, ...]:
    """Return the branches that ended in a corner or a gap that closes, and where."""
    stuck = np.flatnonzero(deployment.stop == Stop.CORNER).tolist()
    inflated = options.changed(body="inflated")
    return tuple(_place(inflated, deployment, branch, branch) for branch in stuck)


def places_text(title: str, places: tuple[BranchPlace, ...]) -> list[str]:
    """Return places as a line for the user; nothing if there are none."""
    if not places:
        return []
    named = [f"{place.branch} at ({place.x_mm:.1f}, {place.y_mm:.1f})" for place in places]
    branch = agreeing(len(named), "branch", "branches")
    most_named = 8
    return [f"{title}: {branch} {some_of(named, most_named)} mm"]


def _place(options: GrowthOptions, deployment: Deployment, branch: int, ended: int) -> BranchPlace:
    """Return a branch with the tip of the branch ``ended``, or the pose if that is none."""
    x_mm, y_mm = deployment.pose.x_mm, deployment.pose.y_mm
    if ended >= 0:
        x_mm, y_mm = deployment.chain_mm(ended)[-1].tolist()
    return BranchPlace(
        branch=deployment.tree.ids[branch],
        x_mm=x_mm,
        y_mm=y_mm,
        radius_mm=options.radius_mm(float(deployment.tree.width_mm[branch])),
    )


FRAMES = 40
"""Default number of frames of an animation."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class DeployedDesign(Result):
    """A deployment with its design, map and growth options.

    Parameters
    ----------
    design, world, options
        What was grown, where and by which rules.
    terrain
        The map made ready for growth.
    deployment
        Where every branch ended.
    notes
        What its user should know about the options, a sentence each.
    fronts
        At which lengths of the growing front, mm, or in how many equal steps JSON has its shape.
    """

    design: Design
    world: Map
    terrain: Terrain
    options: GrowthOptions
    deployment: Deployment
    notes: tuple[str, ...] = ()
    fronts: int | tuple[float, ...] | None = None

    @property
    def stops(self) -> dict[str, int]:
        """How many branches ended for each reason."""
        return self.deployment.stops

    @property
    def targets(self) -> TargetsResult | None:
        """Which targets of the map it touches; None where there are none."""
        return touched_targets([(self.deployment, self.world)])

    @property
    def metrics(self) -> dict[str, object]:
        """Numbers about the whole robot (simulated) and the rules that they depend on."""
        tree = self.deployment.tree
        return {
            "standing": "simulated",
            "branches": len(tree),
            "planned_mm": tree.total_length_mm,
            "grown_mm": float(self.deployment.grown_mm.sum()),
            "stops": self.stops,
            **self.options.content,
            "without_room": [place.content for place in self.without_room],
            "wedged": [place.content for place in wedged(self.deployment, self.options)],
        }

    def view(self) -> Iterator[Block]:
        """Yield where the branches ended, a plan, by which rules they grew, and oddities."""
        tree = self.deployment.tree
        stops = ", ".join(f"{count} {name}" for name, count in self.stops.items() if count)
        yield Answer(
            f"{self.design.name} on {self.world.name} from {pose_text(self.deployment.pose)}: "
            f"{counted(len(tree), 'branch')}, {stops} (simulated)"
        )
        if (targets := self.targets) is not None:
            yield from targets.view()
        yield Picture(image=lambda: self.picture(".svg"), caption="Where it ended (simulated).")
        grown = Number(float(self.deployment.grown_mm.sum()), "mm", ".1f")
        planned = f"of {tree.total_length_mm:.1f} mm planned"
        growth = growth_text(self.options, [self.design])
        yield Facts((Fact("grown", grown, detail=planned), Fact("growth", growth)))
        yield Notes(self.notes)
        yield Notes(
            (
                *self._out_of_reach,
                *stayed_text([bool(self.deployment.deployed[0])], self.design, self.options),
                *places_text("no room to start", self.without_room),
                *places_text("stopped in a corner", wedged(self.deployment, self.options)),
            )
        )

    @property
    def _out_of_reach(self) -> list[str]:
        """Targets that no deployment from here can touch, a sentence each."""
        tree, base = self.deployment.tree, self.deployment.pose
        ends_mm = tree.length_mm.tolist()
        for branch, parent in enumerate(tree.parent.tolist()):
            ends_mm[branch] += ends_mm[parent] if parent >= 0 else 0.0
        starts = [shapely.Point(base.x_mm, base.y_mm)]
        beyond = out_of_reach(self.world.targets, starts, max(ends_mm))
        return [f"out of reach: {far}; at most {most}" for _, far, most in beyond]

    @property
    def without_room(self) -> tuple[BranchPlace, ...]:
        """The branches that were too wide for the place where they should have started."""
        return without_room(self.deployment, self.options)

    @property
    def history(self) -> History:
        """The deployment at any length of its front."""
        return History(self)

    def json_text(self) -> str:
        """Return every branch with its points as JSON: ``vinefab/deployment-1``."""
        names = (self.design.name, self.world.name)
        fronts = self.fronts
        shapes = None
        if fronts is not None:
            grown = self.history
            frames = grown.even_steps(fronts) if isinstance(fronts, int) else grown.frames(fronts)
            shapes = [FrameRecord.of(frame).content for frame in frames]
        targets = self.targets
        more = {} if targets is None else document(targets.view())
        return deployment_text(self.deployment, *names, self.metrics, shapes, more)

    @property
    def _widths_mm(self) -> Floats:
        """Lay-flat width to draw of each branch."""
        return self.options.drawn_widths_mm(self.deployment.tree)

    def picture(self, suffix: str, *, named: bool = False) -> bytes:
        """Return a plan of the deployment."""
        return page_bytes(self.drawing(named=named), suffix)

    def drawing(self, *, named: bool = False) -> Page:
        """Return the same as a page."""
        return deployment_plan(self.world, self.deployment, self._widths_mm, named=named)

    def animation(self, suffix: str, frames: int = FRAMES) -> bytes:
        """Return the deployment as a moving picture."""
        kind = suffix.lower()
        if kind not in (".svg", ".gif"):
            raise BadInputError("suffix", suffix, ".svg or .gif")
        shapes, widths_mm = self.history.even_steps(frames), self._widths_mm
        if kind == ".svg":
            return svg_animation(self.world, shapes, widths_mm)
        return gif_animation(self.world, shapes, widths_mm)


def deploy(
    design: Design,
    world: Map,
    pose: Pose | None = None,
    given: Mapping[str, object] | None = None,
) -> DeployedDesign:
    """Grow a design on a map.

    Parameters
    ----------
    given
        Growth options by name, in place of those that the design was trained with.
    """
    choice = GrowthChoice.of([design], on_surface(given, [world])).single
    pose = pose or first_start(world)
    terrain = Terrain.of(world)
    deployment = grow_on(design, terrain, pose, choice.options)
    return DeployedDesign(
        design=design,
        world=world,
        options=choice.options,
        terrain=terrain,
        deployment=deployment,
        notes=choice.notes,
    )


def first_start(world: Map) -> Pose:
    """Return the pose of a map's first start, or raise BadInputError if it has none."""
    if not world.starts:
        raise UnfitInputError("--pose", f"map {world.name!r} has no start", "give X,Y,DEG")
    return world.starts[0].pose


def pose_text(pose: Pose) -> str:
    """Return a pose as a user would type it: ``X,Y,DEG``."""
    return pose.text


def growth_on_maps(design: Design, given: Mapping[str, object] | None = None) -> GrowthChoice:
    """Return how a design is grown where rules are checked on maps."""
    choice = GrowthChoice.of([design], given).single
    # The rules ask what growth to every tip would take (VF-P03): no pressure may stop it before.
    return replace(choice, options=choice.options.changed(pressure_stop=False))


def deploy_from_starts(
    design: Design, maps: Sequence[Map], given: Mapping[str, object] | None = None
) -> tuple[tuple[str, Deployment], ...]:
    """Return a design's deployments from every start of every map, each with a name.

    Parameters
    ----------
    design
        As it deploys: see `vinefab.inflation.pattern.as_grown`.
    given
        As in `deploy`.
    """
    for world in maps:
        if not world.starts:
            raise UnfitInputError(
                "--map", f"map {world.name!r} has no start", "give it one (--start)"
            )
    options = growth_on_maps(design, given).options
    terrains = [(world, Terrain.of(world)) for world in maps]
    return tuple(
        (
            world.name if len(world.starts) == 1 else f"{world.name} from start {number}",
            grow_on(design, terrain, start.pose, options),
        )
        for world, terrain in terrains
        for number, start in enumerate(world.starts, start=1)
    )


# --- Methods of `Design` and `Deployment`: `vinefab.bindings` leads here --------------------------


def grow_design(
    design: Design,
    world: MapLike,
    pose: PoseLike | None = None,
    *,
    growth: Mapping[str, object] | None = None,
    **shortcuts: "Unpack[GrowthShortcuts]",
) -> Deployment:
    """Deploy a design on a map; see `vinefab.model.design.Design.grow`."""
    given = as_growth(growth, **shortcuts)
    (place,) = RunContext.of(design).with_places([as_map(world, "world")])
    if pose is None and not place.starts:
        problem = f"map {place.name!r} has no start"
        raise UnfitInputError("pose", problem, "give (x_mm, y_mm, heading_deg)")
    start = None if pose is None else Pose.of(pose)
    deploys = as_grown(design) if design.build.compensation == "none" else design
    grown = deploy(deploys, place, start, given)
    choices = grown.options.content
    return replace(grown.deployment, design=grown.design, world=place, growth=choices)


def _deployed(deployment: Deployment) -> DeployedDesign:
    """Return a deployment with the values that its numbers and files need."""
    design, world = deployment.design, deployment.world
    if design is None or world is None:
        raise BadInputError("deployment", deployment, "one that Design.grow returned")
    return DeployedDesign(
        design=design,
        world=world,
        terrain=Terrain.of(world),
        options=GrowthOptions.of(deployment.growth),
        deployment=deployment,
    )


def deployment_summary(deployment: Deployment) -> tuple[str, ...]:
    """Return the fates of the branches, a line each, as ``vinefab grow`` prints it."""
    return _deployed(deployment).summary


def write_deployment(
    deployment: Deployment, path: str | PathLike[str], *, force: bool = False
) -> Path:
    """Write a deployment; see `vinefab.model.deployment.Deployment.write`."""
    target = path_given("path", path)
    suffix = target.suffix.lower()
    if suffix not in (".json", *PICTURE_ENDS, ".gif"):
        allowed = "a name ending in .json, .svg, .png, .pdf or .gif"
        raise BadInputError("path", str(target), allowed)
    whole_deployment = _deployed(deployment)
    if suffix == ".json":
        return write_text(target, whole_deployment.json_text(), force=force)
    drawn = whole_deployment.animation if suffix == ".gif" else whole_deployment.picture
    return write_bytes(target, drawn(suffix), force=force)
