"""Robots, films, jobs and rigs that keep a design rule or break it, for its picture."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import shapely

from vinefab.fabrication.checking import subject_of
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import ONE
from vinefab.fabrication.pieces.partition import in_pieces, partition_of
from vinefab.fabrication.rules.rule import (
    Corridor,
    MapCorridors,
    RigFacts,
    RigPartFacts,
    Subject,
)
from vinefab.model.design import (
    Build,
    Design,
    Level,
    PieceSettings,
    default_fillets_mm,
)
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.outline import Contour
from vinefab.model.quantity import Quantity, Standing
from vinefab.rig.part import Mesh, read_printer
from vinefab.rig.solid import Course, built_of

Fan = tuple[int, float, float]
"""Branches, length in mm, whole angle in degrees."""


@cache
def profile() -> LaserProfile:
    return read_profile(DEFAULT_RECIPE)


def design(
    *fans: Fan, trunk_mm: float = 300.0, widths_mm: tuple[float, ...] = (), **build: object
) -> Design:
    widths = widths_mm or Build.standard(1 + len(fans)).widths_mm
    plain = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths))
    return Design(
        name="robot",
        trunk_length_mm=trunk_mm,
        levels=tuple(Level.of(*fan) for fan in fans),
        build=plain.changed(**build),
    )


def of(*fans: Fan, **build: object) -> Callable[[], Subject]:
    """Return a maker of a robot on the shipped recipe."""
    sheet = build.pop("sheet", ONE)
    return lambda: Subject.of(design(*fans, **build), profile(), sheet=sheet)


def inflated(*fans: Fan, **build: object) -> Callable[[], Subject]:
    """Return a maker of a robot that is cut to deploy as designed, unless told (simulated)."""
    given = {"compensation": "inflation", **build}
    return lambda: subject_of(design(*fans, **given), profile())


def quantity(value: float) -> Quantity:
    return Quantity(value=value, standing=Standing.ASSUMED, source="a test")


def seamed(extra_mm: float) -> Callable[[], Subject]:
    """Return a maker of a tube whose paths were drawn for another seam than the recipe's."""

    def made() -> Subject:
        operations = dict(profile().recipe.by_operation)
        weldcut = operations["weldcut"]
        seam = quantity(max(1e-6, weldcut.seam_width_mm.value + extra_mm))  # no recipe has 0
        operations["weldcut"] = weldcut.changed(seam_width_mm=seam)
        other = replace(profile(), recipe=profile().recipe.changed(operations=operations))
        tube = design(widths_mm=(10.0,))
        return replace(Subject.of(tube, profile()), job=laser_job(tube, other))

    return made


def material(**changes: object) -> Callable[[], Subject]:
    """Return a maker of a tree on another film."""

    def made() -> Subject:
        film = profile().material.changed(**changes)
        return Subject.of(design((2, 200.0, 90.0)), replace(profile(), material=film))

    return made


def recipe(**changes: object) -> Callable[[], Subject]:
    """Return a maker of a tree on another recipe."""

    def made() -> Subject:
        other = replace(profile(), recipe=profile().recipe.changed(**changes))
        return Subject.of(design((2, 200.0, 90.0)), other)

    return made


def mark_speed(mm_s: float) -> Callable[[], Subject]:
    operations = dict(profile().recipe.by_operation)
    operations["mark"] = operations["mark"].changed(speed_mm_s=quantity(mm_s))
    return recipe(operations=operations)


def with_paths(*extra: LaserPath, away_mm: float | None = None) -> Callable[[], Subject]:
    """Return a maker of a tube with more paths, or with a mark at a distance above its rim."""

    def made() -> Subject:
        subject = Subject.of(design(), profile())
        job, paths = subject.job, list(extra)
        if away_mm is not None:
            top = max(one.contour.box_mm[3] for one in job.along(Operation.WELDCUT)) + away_mm
            marked = path(Operation.MARK, [[300.0, top], [314.0, top]])
            return replace(subject, job=replace(job, paths=(marked, *job.paths)))
        return replace(subject, job=replace(job, paths=(*job.paths, *paths)))

    return made


def tipped(radius_mm: float) -> Callable[[], Subject]:
    """Return a maker of a seam that a hot tip makes around a bend."""

    def made() -> Subject:
        subject = Subject.of(design(), read_profile("hot_tip_220__stretchlon_200"))
        corners = [[90.0, 100.0], [100.0, 100.0], [100.0 + radius_mm, 100.0 + radius_mm]]
        line = Contour.polyline(np.array([*corners, [corners[2][0], 110.0]]), closed=False)
        bulges = np.array([0.0, np.tan(np.pi / 8.0), 0.0])
        seam = LaserPath(
            operation=Operation.WELD, contour=replace(line, bulges=bulges), label="seam", of="bend"
        )
        return replace(subject, job=replace(subject.job, paths=(seam,)))

    return made


def sealed_across() -> Subject:
    """Return a tube whose seam goes on across its mouth."""
    subject = Subject.of(design(), profile())
    sealed = subject.job.along(Operation.WELDCUT)[0]
    across = Contour.polyline(sealed.contour.points_mm[[-1, 0]], closed=False)
    paths = (replace(sealed, contour=across), *subject.job.paths)
    return replace(subject, job=replace(subject.job, paths=paths))


def path(operation: Operation, points: list[list[float]], *, closed: bool = False) -> LaserPath:
    contour = Contour.polyline(np.array(points), closed=closed)
    return LaserPath(operation=operation, contour=contour, label="extra")


def square(low: float, high: float) -> LaserPath:
    corners = [[low, low], [high, low], [high, high], [low, high]]
    return path(Operation.CUT, corners, closed=True)


def pieced(
    *fans: Fan, unmarked: str = "", cut: PieceSettings | None = None, **build: object
) -> Callable[[], Subject]:
    """Return a maker of a robot in the fewest pieces; labels named are missing on the film."""

    def made() -> Subject:
        robot = design(*fans, pieces=cut or PieceSettings(), **build)
        partition = partition_of(robot, profile())
        job = laser_job(robot, profile(), partition=partition)
        paths = tuple(one for one in job.paths if not unmarked or unmarked not in one.label)
        flat = replace(Subject.of(robot), profile=profile(), job=replace(job, paths=paths))
        return in_pieces(flat, partition)

    return made


def rigged(
    height_mm: float = 60.0,
    size_mm: tuple[float, float, float] = (180.0, 120.0, 63.0),
    problems: tuple[str, ...] = (),
) -> Callable[[], Subject]:
    """Return a maker of a tube with a rig of one part, for the shipped printer."""

    def made() -> Subject:
        printer = read_printer("generic_220")
        room = printer.bed_width_mm, printer.bed_depth_mm, printer.height_mm
        part = RigPartFacts(name="part_01", size_mm=size_mm, problems=problems)
        rig = RigFacts(
            name="table", printer=printer.name, room_mm=room, height_mm=height_mm, parts=(part,)
        )
        return replace(Subject.of(design(), profile()), rig=rig)

    return made


def corridor(width_mm: float) -> Callable[[], Subject]:
    """Return a maker of a tube and a map with one corridor."""

    def made() -> Subject:
        narrow = Corridor(width_mm=width_mm, x_mm=0.0, y_mm=0.0)
        return replace(
            Subject.of(design(), profile()),
            corridors=(MapCorridors(name="hall", corridors=(narrow,)),),
        )

    return made


CROSSING: tuple[Fan, ...] = ((2, 100.0, 60.0), (2, 100.0, 120.0))


def near(fan_deg: float) -> Callable[[], Subject]:
    return of((2, 150.0, 60.0), (2, 120.0, fan_deg))


def block() -> tuple[np.ndarray, np.ndarray]:
    """Return corners and triangles of a small rig part: a plate with an obstacle on it."""
    plate = np.array([shapely.box(0.0, 0.0, 60.0, 40.0)])
    peak = np.array([shapely.Polygon([(15.0, 8.0), (46.0, 12.0), (40.0, 32.0), (18.0, 30.0)])])
    courses = [
        Course(pieces=plate, low_mm=0.0, high_mm=6.0),
        Course(pieces=peak, low_mm=3.0, high_mm=30.0),
    ]
    return built_of(courses)


def open_block() -> Mesh:
    """Return the mesh of that part without what closes the obstacle's top."""
    corners, faces = block()
    top = (corners[faces][:, :, 2] > 29.0).all(axis=1)
    return Mesh(vertices_mm=corners, faces=faces[~top])
