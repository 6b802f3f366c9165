"""Size, passages and room of a map, ``vinefab/map-info-1``."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, partial
from os import PathLike
from pathlib import Path
from typing import cast

import numpy as np
import shapely
from shapely import Point, STRtree
from shapely.geometry.base import BaseGeometry

from vinefab.core.atomic import write_bytes
from vinefab.core.errors import BadInputError
from vinefab.core.validation import positive, whole
from vinefab.core.view import (
    Block,
    Data,
    Fact,
    Facts,
    Notes,
    Number,
    Picture,
    Result,
    Rows,
    Text,
    Value,
)
from vinefab.growth.terrain import MANY_NOTCHES, NOTCH_SHARE, Terrain, shrunk_piecewise
from vinefab.maps.passages import Passage, narrow_passages, without_notches
from vinefab.maps.summary import import_notes
from vinefab.model.files.shipped import path_given
from vinefab.model.inputs import PICTURE_ENDS
from vinefab.model.map import Map, Pose
from vinefab.pages.panel import (
    ALERT,
    INK,
    Ink,
    Page,
    level_colour,
    page_of,
    plan_panel,
)
from vinefab.pages.plan import UNSEEN_DETAIL, draw_map, draw_pose, page_bytes
from vinefab.physics.tube import inflated_radius_mm
from vinefab.prediction.deploy import pose_text

COARSE = 0.01
"""The widest bodies are known to about 1 % of the one that just fits at the start: walls are
smoothed by so much, and the range is halved so often."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StartRoom:
    """A start of a map and the room there."""

    pose: Pose  # the start
    clearance_mm: float  # distance to the nearest wall; 0 on a wall, or outside the free space

    @property
    def body_mm(self) -> float:
        """Lay-flat width of the widest body that fits there."""
        return math.pi * self.clearance_mm

    @property
    def cells(self) -> tuple[Value, ...]:
        """The start as a row: pose, clearance, widest body."""
        room = Number(self.clearance_mm, "mm", ".2f"), Number(self.body_mm, "mm", ".2f")
        return pose_text(self.pose), *room


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """How far a body of one width could get from the first start."""

    width_mm: float  # lay-flat width
    region: BaseGeometry  # the part of the free space that it can sweep without leaving it
    share: float  # area of that part over the free area


def start_room(free: BaseGeometry, pose: Pose) -> StartRoom:
    """Return how much room a start has in the free space."""
    point = Point(pose.x_mm, pose.y_mm)
    inside = shapely.contains_xy(free, pose.x_mm, pose.y_mm)
    clearance_mm = float(shapely.distance(free.boundary, point)) if inside else 0.0
    return StartRoom(pose=pose, clearance_mm=clearance_mm)


def widest_bodies(free: BaseGeometry, starts: tuple[StartRoom, ...]) -> dict[float, float | None]:
    """Return the lay-flat width of the widest body that sweeps each share of the free area."""
    passage_shares = (0.9, 0.5)  # shares of the free area for which the widest body is computed
    if not starts or starts[0].clearance_mm <= 0.0:
        return dict.fromkeys(passage_shares)
    start = starts[0]
    home = shapely.simplify(_home(free, start), COARSE * start.clearance_mm)

    @cache
    def share_of(radius_mm: float) -> float:
        return float(_swept(home, start, radius_mm).area / free.area)

    found = dict[float, float | None]()
    halvings = 7  # leave `COARSE` of the range
    for share in passage_shares:
        low_mm, high_mm = 0.0, start.clearance_mm
        if share_of(high_mm) >= share:
            low_mm = high_mm
        for _ in range(halvings if low_mm < high_mm else 0):
            middle_mm = 0.5 * (low_mm + high_mm)
            if share_of(middle_mm) >= share:
                low_mm = middle_mm
            else:
                high_mm = middle_mm
        found[share] = math.pi * low_mm if low_mm > 0.0 else None
    return found


def body_room(free: BaseGeometry, starts: tuple[StartRoom, ...], width_mm: float) -> Body:
    """Return how far a body of a lay-flat width could get from the first start."""
    radius_mm = inflated_radius_mm(width_mm)
    region: BaseGeometry = Point()
    if starts and radius_mm <= starts[0].clearance_mm:
        home = _home(free, starts[0])
        region = shapely.intersection(_swept(home, starts[0], radius_mm), home)
    return Body(width_mm=width_mm, region=region, share=float(region.area / max(free.area, 1e-300)))


def _swept(home: BaseGeometry, start: StartRoom, radius_mm: float) -> BaseGeometry:
    """Return the part of a region with its start that a body can sweep.

    The middle of the body stays a radius away from all walls, in one piece with the start; the
    body fills a radius around that. The area falls as the radius grows.
    """
    arc_segments_per_quarter = 8  # rounded corners of swept areas: within 0.5 % of a radius
    arcs = arc_segments_per_quarter
    point = Point(start.pose.x_mm, start.pose.y_mm)
    home = without_notches(home, NOTCH_SHARE * radius_mm, MANY_NOTCHES)
    grid_share = 1e-6  # of a radius: what is shrunk piece by piece is rounded to it
    # More corners are shrunk piece by piece: at once, each meets all that are near it.
    most_at_once = 2_000
    if shapely.get_num_coordinates(home) > most_at_once:
        middles = shrunk_piecewise(home, radius_mm, grid_share * radius_mm, arcs)
    else:
        middles = shapely.buffer(home, -radius_mm, quad_segs=arcs)
    parts = shapely.get_parts(middles)
    away_mm = shapely.distance(parts, point)
    if not np.any(away_mm <= COARSE * start.clearance_mm):
        return Point()
    return cast(
        "BaseGeometry", shapely.buffer(parts[np.argmin(away_mm)], radius_mm, quad_segs=arcs)
    )


def _home(free: BaseGeometry, start: StartRoom) -> BaseGeometry:
    """Return the part of the free space that a start is in."""
    point = Point(start.pose.x_mm, start.pose.y_mm)
    return next((part for part in shapely.get_parts(free) if part.intersects(point)), Point())


@dataclass(frozen=True, slots=True, kw_only=True)
class NarrowPassage:
    """A narrow passage of a map."""

    passage: Passage  # where it is and how wide
    # what stands on either side: ``bounds`` or ``obstacle N``, counted from 1 as in the file
    between: tuple[str, str]

    @property
    def body_mm(self) -> float:
        """Lay-flat width of the widest body that fits through, pi/2 times the passage's width."""
        return 0.5 * math.pi * self.passage.width_mm

    @property
    def cells(self) -> tuple[Value, ...]:
        """The passage as a row: width, place, what it is between, widest body, dead end."""
        x_mm, y_mm = self.passage.middle_mm
        return (
            Number(self.passage.width_mm, "mm", ".2f"),
            Number(x_mm, form=".1f"),
            Number(y_mm, form=".1f"),
            " and ".join(self.between),
            Number(self.body_mm, "mm", ".2f"),
            Number(self.passage.dead_end_mm, "mm", ".1f"),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class MapInfo(Result):
    """Numbers about a map, all computed.

    Parameters
    ----------
    world
        The map.
    free
        Its free space, as growth sees it.
    passages
        The narrowest passages, the narrowest first.
    starts
        Its starts and the room there.
    widest_mm
        Lay-flat width of the widest body that can sweep each share of the free area from the first
        start, to about 1 %; None where no body can.
    body
        How far a body of the width asked for could get; None when none was asked for.
    outside
        Share of the area outside the bounds, of obstacles that reach over them, by number from 1.
    """

    world: Map
    free: BaseGeometry
    passages: tuple[NarrowPassage, ...]
    starts: tuple[StartRoom, ...]
    widest_mm: dict[float, float | None]
    body: Body | None
    outside: dict[int, float]
    schema = "vinefab/map-info-1"

    @property
    def title(self) -> str:
        """Which map it is about."""
        return f"Map {self.world.name}"

    def view(self) -> Iterator[Block]:
        """Yield the plan with the passages, the figures and the tables."""
        world, body, regions = self.world, self.body, self.regions_mm2
        (width_mm, height_mm), share = world.size_mm, partial(Number, unit="%", per=0.01)
        yield Picture(
            image=lambda: self.picture(".svg"),
            caption=f"{world.name} with its narrowest passages (computed).",
        )
        vertices = len(np.unique(shapely.get_coordinates([world.bounds, *world.obstacles]), axis=0))
        yield Facts(
            (
                Fact("map", world.name, "map"),
                *([Fact("unit", str(unit), "unit")] if (unit := world.facts.get("unit")) else ()),
                Fact("size", f"{width_mm:g} x {height_mm:g} mm", "size_mm", data=[*world.size_mm]),
                Fact("obstacles", len(world.obstacles), "obstacles"),
                Fact("walls", world.wall_count, "walls"),
                Fact("vertices", vertices, "vertices"),
                Fact(
                    "free area",
                    Number(self.free.area, "m2", per=1e6, standing="computed"),
                    "free_area_mm2",
                ),
                Fact("of the bounds", share(self.free_share, form=".1f"), "free_share"),
                Fact("regions", len(regions), "regions_mm2", data=[*regions]),
            )
        )
        yield Data({"environment": world.environment, "seed": world.seed, "standing": "computed"})
        yield Notes(tuple(f"note: {note}" for note in import_notes(world)))
        most_named = 5  # obstacles that reach over the bounds, by number in one line
        yield Rows(
            caption="reach over the bounds, and do nothing there (computed)",
            headings=("obstacle", "of it"),
            rows=tuple((n, share(part, form=".3g")) for n, part in self.outside.items()),
            key="obstacles_outside",
            keys=("obstacle", "share"),
            most=most_named,
        )
        yield Rows(
            caption="narrowest passages (computed); body: lay-flat width of the widest that fits",
            headings=("width", "x", "y", "between", "body", "dead end as large as a circle of"),
            rows=tuple(gate.cells for gate in self.passages),
            key="passages",
            keys=("width_mm", "x_mm", "y_mm", "", "widest_body_mm", "dead_end_mm"),
            data=tuple(
                {"ends_mm": [[*end] for end in gate.passage.ends_mm], "between": [*gate.between]}
                for gate in self.passages
            ),
        )
        yield Rows(
            caption="starts (computed)",
            headings=("X,Y,DEG", "to the nearest wall", "widest body that fits"),
            rows=tuple(room.cells for room in self.starts),
            key="starts",
            keys=("", "clearance_mm", "widest_body_mm"),
            data=tuple(room.pose.content for room in self.starts),
        )
        if not self.starts:
            yield Text("the map has no start: the room for robots is not computed")
        yield Rows(
            caption="targets (places computed; tolerances assumed)",
            headings=("target", "X,Y", "within", "to the nearest wall"),
            rows=tuple(
                (one.name, "{:g},{:g}".format(*one.middle_mm), Number(one.tolerance_mm, "mm", "g"),
                 Number(shapely.distance(self.free.boundary, one.shape), "mm", ".2f"))
                for one in world.targets
            ),
            key="targets",
            keys=("", "", "", "clearance_mm"),
            data=tuple(one.content for one in world.targets),
        )  # fmt: skip
        yield Rows(
            caption="widest body with room in a share of the free area (computed, within 1 %)",
            headings=("of the free area", "lay-flat width"),
            rows=tuple(
                (share(part, form=".0f"), Number(width, "mm", ".1f"))
                for part, width in self.widest_mm.items()
            ),
            key="widest_body",
            keys=("free_share", "width_mm"),
        )
        if body is None:
            yield Data({"body": None})
            return
        narrow = sum(gate.body_mm < body.width_mm for gate in self.passages)
        yield Facts(
            (
                Fact("body asked about", Number(body.width_mm, "mm", "g"), "body.width_mm"),
                Fact("fits", "yes" if body.share else "no", "body.fits", data=body.share > 0.0),
                Fact("has room in", share(body.share, form=".1f"), "body.free_share"),
                Fact("passages too narrow for it", f"{narrow} of {len(self.passages)} above"),
            )
        )

    @property
    def regions_mm2(self) -> tuple[float, ...]:
        """Areas of the parts of the free space, the largest first."""
        areas = (part.area for part in shapely.get_parts(self.free) if not part.is_empty)
        return tuple(sorted(areas, reverse=True))

    @property
    def free_share(self) -> float:
        """Free area over that of the bounds."""
        return float(self.free.area / self.world.bounds.area)

    def write(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the plan with the passages (``.svg``, ``.png``) or the figures (``.json``).

        Parameters
        ----------
        path
            The file; missing folders are made.
        force
            Overwrite a file that vinefab did not write, or of another kind.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        BadInputError
            If the name ends in something else.
        ForeignFileError
            If the place is taken.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from vinefab import maps
        >>> with TemporaryDirectory() as folder:
        ...     maps.pegs(seed=1).info().write(f"{folder}/pegs.json").name
        'pegs.json'
        """
        target = path_given("path", path)
        suffix = target.suffix.lower()
        if suffix not in (*PICTURE_ENDS, ".json"):
            allowed = "a name ending in .svg, .png, .pdf or .json"
            raise BadInputError("path", str(target), allowed)
        data = self.json_text().encode() if suffix == ".json" else self.picture(suffix)
        return write_bytes(target, data, force=force)

    def picture(self, suffix: str) -> bytes:
        """Return a plan with the passages, as SVG, PNG or PDF by the suffix."""
        return page_bytes(self.drawing(), suffix)

    def drawing(self) -> Page:
        """Return a plan with the passages."""
        return passage_plan(
            self.world,
            [gate.passage for gate in self.passages],
            [room.clearance_mm for room in self.starts],
            None if self.body is None else (self.body.width_mm, self.body.region),
        )


def map_info(world: Map, *, width_mm: float | None = None, passages: int = 5) -> MapInfo:
    """Return numbers about a map."""
    width_mm = None if width_mm is None else positive("width_mm", width_mm)
    whole("passages", passages, 0, 1000)
    free = Terrain.of(world).free_space()
    starts = tuple(start_room(free, start.pose) for start in world.starts)
    walls = STRtree([world.bounds.boundary, *world.obstacles])
    names = ["bounds", *(f"obstacle {number + 1}" for number in range(len(world.obstacles)))]
    gates = []
    for passage in narrow_passages(free, passages):
        # Where obstacles touch, the one that stands first in the file is named.
        first, last = (min(walls.query_nearest(Point(end))) for end in passage.ends_mm)
        gates.append(NarrowPassage(passage=passage, between=(names[first], names[last])))
    shapely.prepare(world.bounds)
    obstacles = np.array(world.obstacles, dtype=np.object_)
    over = np.flatnonzero(~shapely.covers(world.bounds, obstacles))
    beyond_mm2 = shapely.area(shapely.difference(obstacles[over], world.bounds))
    shares = beyond_mm2 / shapely.area(obstacles[over])
    # Of an obstacle's area: less is rounding of an obstacle that ends at the bounds.
    least_outside_share = 1e-6
    return MapInfo(
        world=world,
        free=free,
        passages=tuple(gates),
        starts=starts,
        widest_mm=widest_bodies(free, starts),
        body=None if width_mm is None else body_room(free, starts, width_mm),
        outside={
            int(index) + 1: float(share)
            for index, share in zip(over, shares, strict=True)
            if share > least_outside_share
        },
    )


_ROOM = level_colour(3)


def passage_plan(
    world: Map,
    passages: Sequence[Passage],
    clearances_mm: Sequence[float],
    body: tuple[float, BaseGeometry] | None = None,
) -> Page:
    """Return a plan of a map with its narrow passages, numbered from the narrowest."""
    panel = plan_panel(world.bounds.bounds)
    if body is not None:
        region = shapely.simplify(body[1], UNSEEN_DETAIL * max(world.size_mm))
        words = f"room for a body of {body[0]:g} mm lay-flat width"
        panel.polygons([region], Ink(fill=_ROOM, fill_alpha=0.25), rank=0.5, label=words)
    draw_map(panel, world)
    clear = Ink(line=INK, width_pt=1.0, dash_pt=(1.0, 2.0))
    turns = np.linspace(0.0, 2.0 * np.pi, 97)
    around = np.column_stack([np.cos(turns), np.sin(turns)])
    for start, clearance_mm in zip(world.starts, clearances_mm, strict=True):
        draw_pose(panel, start.pose, max(world.size_mm))
        ring = around * clearance_mm + (start.pose.x_mm, start.pose.y_mm)
        panel.line(ring, clear, label="clearance of the start")
    ends = [np.array(passage.ends_mm) for passage in passages]
    if passages:
        panel.lines(ends, Ink(line=ALERT, width_pt=2.0, butt=True), rank=6.0)
        # Many a passage is too short to be seen on paper: the ring shows where it is.
        middles = np.array([passage.middle_mm for passage in passages])
        label = "narrow passage (computed)"
        panel.marks(middles, "o", 11.0, Ink(line=ALERT, width_pt=1.0), rank=6.0, label=label)
    most_labelled = 30
    named = passages[:most_labelled]
    words_of = [f"{number}: {one.width_mm:.1f} mm" for number, one in enumerate(named, start=1)]
    starts = world.starts if 1 < len(world.starts) <= most_labelled else ()
    places = [one.middle_mm for one in named] + [(s.pose.x_mm, s.pose.y_mm) for s in starts]
    colours = [ALERT] * len(named) + [INK] * len(starts)
    words_of += [f"start {number}" for number in range(1, len(starts) + 1)]
    panel.write_labels(np.array(places), words_of, colours, size_pt=8.0, mark_pt=5.5, lines=ends)
    return page_of(panel)
