"""What rules need to know of a test rig and of the corridors of a map."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import shapely

from vinefab.fabrication.job.laser_job import check_size, laser_job
from vinefab.fabrication.job.placement import ONE, SheetOptions
from vinefab.fabrication.outline.body_outline import BodyOutline, body_outline
from vinefab.fabrication.outline.layout import FlatLayout, flat_layout
from vinefab.fabrication.rules.spacing import Shapes, shapes_of
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile


@dataclass(frozen=True, slots=True, kw_only=True)
class RigPartFacts:
    """A part of a rig."""

    name: str  # its name
    size_mm: tuple[float, float, float]  # width, depth and height of its box as it is made
    # why its file, read again, does not hold the closed, oriented solid that it should
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFacts:
    """A rig, as rules see it."""

    name: str  # its name
    printer: str  # name of the machine that makes the parts
    room_mm: tuple[float, float, float]  # width, depth and height that a part may have on it
    height_mm: float  # height of the obstacles above the floor
    parts: tuple[RigPartFacts, ...]  # all parts


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """A narrow place between walls."""

    width_mm: float  # how wide it is where robots run: of a rig, in millimetres of the rig
    # x_mm, y_mm: its middle, in map coordinates
    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MapCorridors:
    """A map or rig with its narrowest corridors."""

    name: str  # of the map or rig
    corridors: tuple[Corridor, ...]  # the narrowest first


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Subject:
    """A design with everything that rules need."""

    design: Design  # the design
    # machine, material and recipe, or None: rules that need them are skipped then
    profile: LaserProfile | None
    layout: FlatLayout  # straight branches on the sheet
    names: tuple[str, ...]  # ids of the branches, in the tree's order
    shapes: Shapes  # the branches and pouches as capsules
    outline: BodyOutline  # the outline of the body (lumen), and why it may not be exact
    job: Job | None  # the paths for the laser, or None without a profile
    # for each file that was written, what was wrong with it when it was read again; None when no
    # file was written
    readback: Mapping[str, tuple[str, ...]] | None = None
    deployments: tuple[Deployment, ...] = ()  # simulated deployments, for rules about paths
    places: tuple[str, ...] = ()  # what each deployment's map is called; empty if nobody said
    rig: RigFacts | None = None  # A test rig, for the rules about its parts
    # maps or rigs with their narrow corridors, for the rule about them
    courses: tuple[MapCorridors, ...] = ()

    @classmethod
    def of(
        cls,
        design: Design,
        profile: LaserProfile | None = None,
        *,
        readback: Mapping[str, tuple[str, ...]] | None = None,
        deployments: tuple[Deployment, ...] = (),
        places: tuple[str, ...] = (),
        sheet: SheetOptions = ONE,
    ) -> "Subject":
        """Return the subject of a design, with all that follows from it worked out."""
        check_size(design)
        layout = flat_layout(design)
        return cls(
            design=design,
            profile=profile,
            layout=layout,
            names=layout.tree.ids,
            shapes=shapes_of(layout, design.build),
            outline=body_outline(design),
            job=laser_job(design, profile, sheet) if profile else None,
            readback=readback,
            deployments=deployments,
            places=places,
        )

    @classmethod
    def on_sheet(cls, design: Design, profile: LaserProfile, job: Job) -> "Subject":
        """Return the subject of a design that lies on a sheet, alone or beside others."""
        return replace(cls.of(design), profile=profile, job=job)

    @property
    def body(self) -> shapely.Polygon:
        """The body as a polygon, arcs as chords within 0.01 mm; not always a valid one."""
        return shapely.Polygon(self.outline.contour.flattened_mm())

    @property
    def place_names(self) -> tuple[str, ...]:
        """What to call the map of each deployment."""
        numbered = (f"deployment {number}" for number in range(1, 1 + len(self.deployments)))
        return self.places or tuple(numbered)

    def own(self, operation: Operation) -> tuple[LaserPath, ...]:
        """Return the paths of one operation that belong to this design."""
        paths = self.job.along(operation) if self.job else ()
        return tuple(path for path in paths if path.of in ("", self.design.name))

    def ids(self, *branches: int) -> tuple[str, ...]:
        """Return the names of branches, by index."""
        return tuple(self.names[branch] for branch in branches)

    def level_rows(self, level: int) -> list[int]:
        """Return the indices of one level's branches, the first one first."""
        return [row for row, found in enumerate(self.layout.tree.level.tolist()) if found == level]
