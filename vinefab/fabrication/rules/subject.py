"""What the rules check: a design, its profile, and all that is derived from them."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import shapely

from vinefab.fabrication.job.laser_job import check_size, laser_job
from vinefab.fabrication.job.passes import taken_mm
from vinefab.fabrication.job.placement import ONE, SheetOptions, piece_name
from vinefab.fabrication.outline.body_outline import BodyOutline, body_outline
from vinefab.fabrication.outline.layout import FlatLayout, flat_layout
from vinefab.fabrication.rules.spacing import Capsules, capsules_of
from vinefab.inflation.pattern import Pattern
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import BranchTree, Partition, Piece, branch_tree


@dataclass(frozen=True, slots=True, kw_only=True)
class RigPartFacts:
    """What the rules need to know of a part of a rig."""

    name: str
    size_mm: tuple[float, float, float]  # width, depth and height of its box as it is made
    # Why its file, read back, does not hold the closed, oriented solid that it should.
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFacts:
    """What the rules need to know of a rig."""

    name: str
    printer: str  # name of the machine that makes the parts
    room_mm: tuple[float, float, float]  # width, depth and height that a part may have on it
    height_mm: float  # of the obstacles above the floor
    parts: tuple[RigPartFacts, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """A narrow place between walls."""

    width_mm: float  # where robots run; of a rig, in millimetres of the rig
    x_mm: float  # of its middle, in map coordinates
    y_mm: float
    # diameter of the circle with the area of the dead end that it leads to, likewise; infinite
    # where it leads on. It is a mere notch for bodies whose cross-section is larger
    dead_end_mm: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class MapCorridors:
    """A map or rig with its narrowest corridors."""

    name: str  # of the map or rig
    corridors: tuple[Corridor, ...]  # narrowest first


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Subject:
    """A design with everything that rules need.

    A rule whose input is None or empty here is skipped or notes it (`RuleNotApplicable`).
    """

    design: Design
    profile: LaserProfile | None  # machine, material and recipe
    layout: FlatLayout  # straight branches on the sheet
    names: tuple[str, ...]  # ids of the branches, in the tree's order
    capsules: Capsules  # the branches and pouches
    outline: BodyOutline  # of the lumen, with the reasons why it may not be exact
    job: Job | None  # the paths of the laser; None without a profile
    # Problems found when each written file was read back; None if none was written.
    readback: Mapping[str, tuple[str, ...]] | None = None
    deployments: Collection[Deployment] = ()  # simulated, for rules about growth paths
    map_names: tuple[str, ...] = ()  # of each deployment's map; empty to number them
    rig: RigFacts | None = None
    corridors: tuple[MapCorridors, ...] = ()  # of maps or rigs
    # The pieces that the design is cut in; None where its build asks for one flat outline.
    partition: Partition | None = None
    # The pieces as subjects of their own, each with its capsules and outline; none for a whole one.
    pieces: "tuple[Subject, ...]" = ()
    piece: Piece | None = None  # the piece that this is
    # How the design deploys; None where it is cut as designed. ``design`` is what is cut.
    pattern: Pattern | None = None
    separate: bool = False  # welded and cut in two passes, whatever else the recipe has

    @classmethod
    def of(
        cls,
        design: Design,
        profile: LaserProfile | None = None,
        *,
        readback: Mapping[str, tuple[str, ...]] | None = None,
        deployments: Collection[Deployment] = (),
        map_names: tuple[str, ...] = (),
        sheet: SheetOptions = ONE,
    ) -> "Subject":
        """Return a design with all that is derived from it."""
        check_size(design)
        layout = flat_layout(design)
        return cls(
            design=design,
            profile=profile,
            layout=layout,
            names=layout.tree.ids,
            capsules=capsules_of(layout, design.build),
            outline=body_outline(design),
            job=laser_job(design, profile, sheet) if profile else None,
            separate=sheet.process == "weld+cut",
            readback=readback,
            deployments=deployments,
            map_names=map_names,
        )

    @classmethod
    def on_sheet(
        cls, design: Design, profile: LaserProfile, job: Job, *, separate: bool = False
    ) -> "Subject":
        """Return a design with the job of its sheet, which may hold other designs too."""
        return replace(cls.of(design), profile=profile, job=job, separate=separate)

    @property
    def grown_tree(self) -> BranchTree:
        """The tree that deploys: as designed, where flat angles are compensated."""
        return self.layout.tree if self.pattern is None else branch_tree(self.pattern.design)

    @property
    def taken_mm(self) -> float:
        """How far outside the lumen's edge the beams take film; 0 without a recipe."""
        return taken_mm(self.profile, separate=self.separate) if self.profile else 0.0

    @property
    def body(self) -> shapely.Polygon:
        """The body as a polygon, which may be invalid; arcs are chords within 0.01 mm."""
        return shapely.Polygon(self.outline.contour.flattened_mm())

    @property
    def deployment_names(self) -> tuple[str, ...]:
        """The name of each deployment's map, or its number."""
        numbered = (f"deployment {number}" for number in range(1, 1 + len(self.deployments)))
        return self.map_names or tuple(numbered)

    def own(self, operation: Operation) -> tuple[LaserPath, ...]:
        """Return the paths of one operation that belong to this design or piece."""
        paths = self.job.along(operation) if self.job else ()
        name = piece_name(self.design.name, self.piece.label if self.piece else "")
        return tuple(path for path in paths if path.of in ("", name))

    def ids(self, *branches: int) -> tuple[str, ...]:
        """Return the ids of branches, by index."""
        return tuple(self.names[branch] for branch in branches)
