"""Comparison of observation and prediction: shapes, contacts, stops, and which half-angle fits.

A photo of the final shape does not show the headings that its tips had. They follow from the
launch heading, which the parent's line shows, and from the walls: each branch is replayed, sliding
along every wall, and the replay is believed as far as its shape is the one seen.

A line is the best explanation of the film, and it may be wrong. So every branch is looked at again,
at its base, at its tip and along its line; `branch_sights` lists the doubts that remain.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
import scipy  # its parts load at their first use
import shapely
from annotated_types import Ge, Le, Unit
from numpy.typing import NDArray
from pydantic import Field
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.compiling import rebindable
from vinefab.core.limits import deg, rad
from vinefab.core.plain_text import rounded
from vinefab.core.table import TablePart
from vinefab.core.validation import Floats
from vinefab.growth.arrays import Growth, Launch, Rules, TreesArrays, WallArrays
from vinefab.growth.batch import KERNEL, grow_on, rules_of
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.observation.centre_lines import BLUR_MM, TracedBranch, TracedTree
from vinefab.observation.film import SeenFilm
from vinefab.physics.tube import inflated_radius_mm

MeetingOutcome = Literal["slid", "stopped", "unclear"]


SAME_PLACE_MM = 1.0
"""Places nearer to each other along a branch are one on a photo."""

_TURNS_DEG = (0.0, -0.5, 0.5, -1.0, 1.0, -2.0, 2.0, -3.0, 3.0, -5.0, 5.0, -8.0, 8.0, -12.0, 12.0)

HEADING_ERROR_DEG = 0.7
"""Standard error of a line's heading over 40 mm [assumed, above what rendered photos show]."""


BEND_PER_MM, BEND_OVER_MM = 1.0 / 600.0, 60.0
"""Standard deviation of the curvature of real branches, and the length over which it lasts
[assumed]: so far a tip's heading strays from that of its joint."""


SHORT_OF_LENGTH_MM, SHORT_OF_LENGTH_SHARE = 6.0, 0.05
"""A stop is told from a full length by so much at least: where a joint lies is known by its
parent's planned length alone."""


_Degrees = Annotated[float, Ge(0), Le(180), Unit("deg")]
_Mm = Annotated[float, Ge(0), Le(1e7), Unit("mm")]


class WallContact(TablePart):
    """A tip at a wall, as observations have it."""

    wall: Annotated[str | int | None, Doc("number of the obstacle, or bounds")] = None
    angle_from_normal_deg: Annotated[
        _Degrees | None, Doc("of the tip's heading, when it met the wall")
    ] = None
    outcome: Annotated[MeetingOutcome, Doc("what the tip did there")]
    angle_error_deg: Annotated[
        Annotated[_Degrees, Le(90)] | None, Doc("standard error of the angle [assumed]")
    ] = None
    distance_mm: Annotated[_Mm | None, Doc("from the line seen to the wall that it touches")] = None


class WallMeeting(WallContact):
    """A tip at a wall, as it is found: all but the distance is known."""

    wall: str
    angle_from_normal_deg: float
    x_mm: Annotated[float, Unit("mm"), Doc("where the tip was")]
    y_mm: Annotated[float, Unit("mm"), Doc("where the tip was")]
    # length of the branch when its tip met the wall
    front_mm: Annotated[float, Field(exclude=True)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Replay:
    """A branch replayed from a base and a launch heading.

    ``chain_mm`` has base, contacts and tip at its end, ``chains_mm`` the same when its tip met each
    of the walls of ``meetings``, which are in order.
    """

    chain_mm: Floats
    meetings: tuple[WallMeeting, ...]
    chains_mm: tuple[Floats, ...]


class _Met(NamedTuple):
    """A tip that meets a wall."""

    chain_mm: Floats  # base, contacts and tip
    angle_rad: float
    front_mm: float


def _grown_alone(
    walls: WallArrays,
    rules: Rules,
    start: Launch,
    length_mm: float,
    bends: Sequence[tuple[float, float]],
) -> tuple[Growth, list[_Met]]:
    """Return the growth of one branch that no pressure stops, and where its tip met walls.

    Each straight part between bends is a branch of the growth.
    """
    kernel = rebindable(KERNEL)
    meet, room = kernel["_meet"], 64
    bends = [bend for bend in bends if bend[0] < length_mm]
    count = len(bends) + 1
    turn_rad = np.array([0.0, *(turn for _, turn in bends)])
    tree = TreesArrays(
        parent=np.arange(-1, count - 1),
        turn=np.column_stack([np.cos(turn_rad), np.sin(turn_rad)]),
        length=np.diff([0.0, *(at_mm for at_mm, _ in bends), length_mm]),
        first=np.array([0, count]),
        limit=np.full(count, np.inf),
        store=np.zeros(count),
    )
    fits = np.ones(count, dtype=np.bool_)
    while True:
        growth, met = Growth.empty(count, room), list[_Met]()

        def note(walls: Any, rules: Any, tip: Any, wall: int, place: float) -> Any:  # noqa: ANN401  as the kernel
            x, y, tangent_x, tangent_y, _ = walls.wall[wall].tolist()
            spot = np.array([x + place * tangent_x, y + place * tangent_y])
            chain = np.vstack([_without_repeats(growth.points[: tip.pivot + 1]), spot])  # noqa: B023  called at once
            along = abs(tip.ux * tangent_x + tip.uy * tangent_y)
            against = tip.ux * tangent_y - tip.uy * tangent_x
            front = np.hypot(*np.diff(chain, axis=0).T).sum()
            met.append(_Met(chain, math.atan2(along, against), float(front)))  # noqa: B023
            return meet(walls, rules, tip, wall, place)

        kernel["_meet"] = note
        with np.errstate(all="ignore"):
            if kernel["grow_branches"](walls, tree, fits, rules, start, growth, 0, count) == count:
                return growth, met
        room *= 2


def _without_repeats(chain_mm: Floats) -> Floats:
    """Return a chain in which a bend, the end of one part and the base of the next, is once."""
    new = (np.diff(chain_mm, axis=0) != 0.0).any(axis=1)
    return chain_mm[np.append(True, new)] if len(chain_mm) > 2 else chain_mm


@dataclass(slots=True, eq=False)
class Replays:
    """Replays of branches on one map."""

    world: Map
    walls: dict[str, BaseGeometry] = field(init=False)  # obstacles and the bounds' edge, by name

    def __post_init__(self) -> None:
        obstacles = {f"obstacle {index}": one for index, one in enumerate(self.world.obstacles)}
        self.walls = {**obstacles, "bounds": self.world.bounds.boundary}

    def grown(
        self,
        base_mm: Floats,
        heading_rad: float,
        length_mm: float,
        radius_mm: float,
        half_angle_rad: float = 0.0,
        bends: Sequence[tuple[float, float]] = (),
    ) -> Replay | None:
        """Return a branch grown alone; None where it has no room.

        Parameters
        ----------
        bends
            Its preformed bends: mm from its base, rising, and turns in radians.
        """
        around = shapely.Point(base_mm).buffer(length_mm + 3.0 * radius_mm)
        kept = tuple(shape for shape in self.world.obstacles if shape.intersects(around))
        terrain = Terrain.of(Map(name="near", bounds=self.world.bounds, obstacles=kept))
        free = terrain.free_space(radius_mm)
        if free.is_empty:
            return None
        if not shapely.contains_xy(free, *base_mm):
            line = shapely.shortest_line(free, shapely.Point(base_mm))
            if line.length > radius_mm:
                return None
            base_mm = shapely.get_coordinates(line)[0]
        options = GrowthOptions(head_on_half_angle_rad=half_angle_rad, pressure_stop=False)
        rules = rules_of(options, terrain.tolerance_mm)
        x_mm, y_mm = base_mm.tolist()
        start = (x_mm, y_mm, math.cos(heading_rad), math.sin(heading_rad))
        growth, met = _grown_alone(terrain.walls(radius_mm), rules, start, length_mm, bends)
        names, shapes = list(self.walls), np.array(list(self.walls.values()), dtype=np.object_)
        tips = [shapely.Point(one.chain_mm[-1]) for one in met]
        meetings = tuple(
            WallMeeting(
                x_mm=tip.x,
                y_mm=tip.y,
                wall=names[int(np.argmin(shapely.distance(shapes, tip)))],
                angle_from_normal_deg=deg(one.angle_rad),
                angle_error_deg=0.0,
                front_mm=one.front_mm,
                outcome="slid",
            )
            for one, tip in zip(met, tips, strict=True)
        )
        out = int(np.flatnonzero(growth.stop != Stop.NOT_DEPLOYED)[-1])  # the last part that grew
        if growth.stop[out] in (Stop.CORNER, Stop.HEAD_ON) and meetings:
            meetings = (*meetings[:-1], meetings[-1].changed(outcome="stopped"))
        return Replay(
            chain_mm=_without_repeats(growth.points[: growth.first_point[out + 1]]),
            meetings=meetings,
            chains_mm=tuple(one.chain_mm for one in met),
        )


def wall_order(meetings: Sequence[WallMeeting]) -> list[str]:
    """Return the walls of meetings in their order, without repetitions one after the other."""
    names = [meeting.wall for meeting in meetings]
    return [name for place, name in enumerate(names) if place == 0 or names[place - 1] != name]


def apart_mm(one: Floats, other: Floats) -> float:
    """Return the largest distance from a point of one line to the other (Hausdorff)."""
    if len(one) < 2 or len(other) < 2:
        return float("inf")
    lines = LineString(one), LineString(other)
    if min(line.length for line in lines) == 0.0:
        return float(shapely.hausdorff_distance(*lines))
    dense = [shapely.segmentize(line, 2.0) for line in lines]
    return float(shapely.hausdorff_distance(dense[0], dense[1]))


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenBranch:
    """What was seen of a branch, for its meetings."""

    points_mm: Floats
    length_mm: float
    planned_mm: float
    ends_early: bool
    radius_mm: float
    heading_rad: float  # launch heading by the parent's line
    heading_error_deg: float
    bends: tuple[tuple[float, float], ...] = ()  # preformed: mm from its base, radians

    @property
    def straight_mm(self) -> float:
        """Length of its end beyond its last preformed bend; infinite without one."""
        before = [at_mm for at_mm, _ in self.bends if at_mm < self.length_mm]
        return self.length_mm - max(before, default=-math.inf)


def seen_meetings(replays: Replays, seen: SeenBranch) -> tuple[tuple[WallMeeting, ...], str]:
    """Return the meetings of a branch's tip with walls, and the reason why it stopped.

    The stop is ``full_length``, ``head_on``, ``corner``, or ``unclear`` where it is short of its
    length without a wall at its end. A tip that stopped has the heading that it came with, so that
    its angle is seen; where it slid, the angle is that of the replay.
    """
    meetings = list[WallMeeting]()
    best = _best_replay(replays, seen)
    # A replay has the shape seen if no point of one is farther from the other than both together.
    agrees_share = 0.02
    agrees_mm = 2.5
    if best is not None:
        replay, end, turn_deg, away_mm = best
        fits = away_mm <= agrees_mm + agrees_share * seen.length_mm
        for meeting in replay.meetings[:end]:
            distance_mm = _touching_mm(replays, seen, meeting.wall)
            # What is met within the error of the length may not have been met at all.
            is_met = meeting.front_mm <= seen.length_mm - SAME_PLACE_MM
            bend_rad = BEND_PER_MM * math.sqrt(BEND_OVER_MM * min(meeting.front_mm, seen.length_mm))
            error = math.hypot(seen.heading_error_deg, 0.5 * turn_deg, deg(bend_rad))
            slid = fits and distance_mm is not None and is_met
            meetings.append(
                meeting.changed(
                    outcome="slid" if slid else "unclear",
                    angle_error_deg=min(error, 30.0),
                    distance_mm=distance_mm,
                )
            )
    if not seen.ends_early:
        return tuple(meetings), "full_length"
    stop = _stop_at_wall(replays, seen)
    if stop is None:
        return tuple(meetings), "unclear"
    meeting, is_corner = stop
    before = [m for m in meetings if m.front_mm < seen.length_mm - seen.radius_mm]
    return (*before, meeting), "corner" if is_corner else "head_on"


def _touching_mm(replays: Replays, seen: SeenBranch, wall: str) -> float | None:
    """Return the distance at which a line passes a wall; None where the body does not touch it."""
    away = float(shapely.distance(replays.walls[wall], LineString(seen.points_mm)))
    return away if abs(away - seen.radius_mm) <= max(1.5, 0.3 * seen.radius_mm) else None


def _stop_at_wall(replays: Replays, seen: SeenBranch) -> tuple[WallMeeting, bool] | None:
    """Return the wall at which a tip lies, head-on or in a corner; None where none is."""
    short_mm = seen.planned_mm - seen.length_mm
    if short_mm <= max(SHORT_OF_LENGTH_MM, SHORT_OF_LENGTH_SHARE * seen.planned_mm):
        return None
    tip = seen.points_mm[-1]
    heading, error = _tip_heading(seen.points_mm, seen.straight_mm)
    near = list[tuple[float, float, float, str]]()  # angle, distance, direction, wall
    tip_at_wall_mm = 2.5  # A tip that stopped at a wall lies so near to it [assumed]
    for name, shape in replays.walls.items():
        edge = shape.boundary if isinstance(shape, Polygon) else shape
        line = shapely.shortest_line(shapely.Point(tip), edge)
        if line.length > seen.radius_mm + tip_at_wall_mm or line.length < 0.3 * seen.radius_mm:
            continue
        way = shapely.get_coordinates(line)[1] - tip
        normal = math.atan2(way[1], way[0])
        angle = abs(deg(math.remainder(heading - normal, math.tau)))
        if angle < 90.0:
            near.append((angle, float(line.length), normal, name))
    if not near:
        return None
    angle, away, normal, name = min(near)
    others = [abs(deg(math.remainder(one[2] - normal, math.tau))) for one in near]
    # Walls whose normals differ by more make a corner for a tip that touches both.
    corner_deg = 30.0
    is_corner = max(others) > corner_deg
    # Whatever ends a body that lies flatter at its wall, it is not the contact's angle [assumed].
    steepest_stop_deg = 45.0
    if angle > steepest_stop_deg and not is_corner:
        return None
    place = tip + away * np.array([math.cos(normal), math.sin(normal)])
    meeting = WallMeeting(
        x_mm=float(tip[0]),
        y_mm=float(tip[1]),
        wall=name if shapely.Point(place).distance(replays.walls[name]) < 1.0 else "bounds",
        angle_from_normal_deg=angle,
        angle_error_deg=error,
        front_mm=seen.length_mm,
        outcome="stopped",
        distance_mm=_touching_mm(replays, seen, name),
    )
    return meeting, is_corner


def _tip_heading(line_mm: Floats, straight_mm: float) -> tuple[float, float]:
    """Return the heading of a tip by the bend of its line's end, and its error in degrees.

    Parameters
    ----------
    straight_mm
        Length of the end beyond the last preformed bend.
    """
    line = LineString(line_mm)
    headings = []
    # Of the line by whose bend the heading of a tip is found; shorter ones tell nothing.
    tip_length_mm = min(40.0, max(straight_mm, 10.0))
    for length in (tip_length_mm, tip_length_mm / 2.0):
        over = min(length, line.length)
        along = np.linspace(0.0, over, 25)
        points = shapely.get_coordinates(shapely.line_interpolate_point(line, line.length - along))
        slopes = [np.polyfit(along, points[:, axis], 2)[1] for axis in (0, 1)]
        headings.append(math.atan2(-slopes[1], -slopes[0]))
    # A kink near the end bends the longer stretch otherwise than the shorter one.
    apart = deg(math.remainder(headings[0] - headings[1], math.tau))
    short = max(1.0, 40.0 / max(1.0, min(straight_mm, line.length)))
    # Standard error of the heading of a tip by its film [assumed, above what rendered photos show].
    tip_error_deg = 2.5
    return headings[0], min(30.0, math.hypot(tip_error_deg * short, 0.5 * apart))


def _best_replay(
    replays: Replays, seen: SeenBranch
) -> tuple[Replay, int | None, float, float] | None:
    """Return the replay most like what was seen, of launch headings near the planned one.

    With it: the meeting at which it ends as seen (None where it ends elsewhere), the turn of its
    heading in degrees, and the largest distance between both shapes. Near head-on a tip slides
    centimetres while its body grows by a millimetre, so that a branch that stopped is compared with
    the replay at each meeting, not at its length.
    """
    best, least = None, float("inf")
    slack_mm = max(3.0, 0.6 * seen.radius_mm)
    # A little longer than seen, so that the wall where it stopped is met.
    length = seen.length_mm + slack_mm * seen.ends_early
    for turn in _TURNS_DEG:
        heading = seen.heading_rad + rad(turn)
        replay = replays.grown(seen.points_mm[0], heading, length, seen.radius_mm, bends=seen.bends)
        if replay is None:
            continue
        near = [
            (apart_mm(chain, seen.points_mm), place)
            for place, (chain, one) in enumerate(
                zip(replay.chains_mm, replay.meetings, strict=True)
            )
            if seen.ends_early and abs(one.front_mm - seen.length_mm) <= slack_mm
        ]
        end: int | None = None
        away = min(near)[0] if near else apart_mm(replay.chain_mm, seen.points_mm)
        if near:  # of places that the photo cannot tell apart, the one met most head-on
            same = [place for apart, place in near if apart <= away + SAME_PLACE_MM]
            end = min(same, key=lambda place: replay.meetings[place].angle_from_normal_deg)
        if away + 0.1 * abs(turn) < least:
            best, least = (replay, end, turn, away), away + 0.1 * abs(turn)
        if turn == 0.0 and away <= 1.0:
            break
    return best


GOES_ON: Final = "film continues beyond its tip"
AT_OTHERS: Final = "its tip lies at other film"
TIP_UNSEEN: Final = "its tip is not seen"
BASE_UNSEEN: Final = "its base is not seen"
UNEXPLAINED: Final = "film near its tip that no line explains"
OFF_FILM: Final = "its line leaves the film"
ON_OTHERS: Final = "lies on or along other branches"
OTHER_WAY: Final = "leaves its parent in another direction than planned"
SIBLING: Final = "may be its sibling"
MAY_BE_OUT: Final = "film where it would begin"
PARENT: Final = "its parent is uncertain"
NO_WALL: Final = "ends early without a wall at its end"

NO_VERDICT: Final = "the photo gives no verdict"


NEAR_MM, NEAR_RADII = 15.0, 4.0
"""Film so near to a tip should belong to a line."""

MOST_NEAR = 0.25
"""Unexplained film near a tip, over the square of the tube's diameter."""


MOST_TURN_DEG, MOST_HINGE_DEG = 20.0, 60.0
"""Joints of real robots were up to 7 degrees off; three times that is another branch, unless a wall
that the body touches has turned it about its joint."""

TOUCHING_MM = 3.0
"""A body so near to a wall may lean on it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BranchSight:
    """How well one branch was seen."""

    tip_and_base: bool  # both on film
    doubts: tuple[str, ...]


def branch_sights(film: SeenFilm, traced: TracedTree) -> tuple[BranchSight, ...]:
    """Return the visibility of each branch of a tree, parents before their children."""
    looks = _Looks.of(film, traced)
    sights = list[BranchSight]()
    for index, parent in enumerate(traced.tree.parent.tolist()):
        doubts = looks.doubts(index)
        if parent >= 0 and sights[parent].doubts:
            doubts = [*doubts, PARENT]
        branch = traced.branches[index]
        both = branch.deployed and not {TIP_UNSEEN, BASE_UNSEEN} & set(doubts)
        sights.append(BranchSight(tip_and_base=both, doubts=tuple(dict.fromkeys(doubts))))
    return tuple(sights)


@dataclass(slots=True, eq=False)
class _Looks:
    """Film and lines, with the area that each line explains."""

    film: SeenFilm
    traced: TracedTree
    radius_mm: list[float]  # of each branch, as wide as its film is seen
    areas: Sequence[shapely.Geometry]  # of each branch on the plan; empty where none
    unexplained: NDArray[np.bool_]  # thick film that no line explains

    @classmethod
    def of(cls, film: SeenFilm, traced: TracedTree) -> "_Looks":
        radii, areas = [], []
        for branch, width_mm in zip(traced.branches, traced.tree.width_mm.tolist(), strict=True):
            nominal = inflated_radius_mm(width_mm)
            seen = 0.5 * branch.width_mm if np.isfinite(branch.width_mm) else nominal
            radii.append(max(nominal, seen))
            line = film.moved(branch.points_mm, nominal, film.sight.plane_mm)
            area = LineString(line) if len(line) > 1 else shapely.Polygon()
            areas.append(shapely.buffer(area, radii[-1] + BLUR_MM))
        left, explained = (film.share > 0.5) & ~film.solid, shapely.union_all(areas)
        if not explained.is_empty:
            shapely.prepare(explained)
            rows, columns = np.nonzero(left)
            places = film.view.to_map(np.column_stack([columns, rows]).astype(np.float64) + 0.5)
            left[rows, columns] = ~shapely.contains_xy(explained, places)
        thick_mm = 3.0  # thinner unexplained film is an edge's: seams, gloss and shadows make it
        thick = max(1, round(thick_mm / film.view.mm_per_pixel))
        left = scipy.ndimage.binary_opening(left, np.ones((thick, thick), dtype=np.bool_))
        return cls(film, traced, radii, areas, np.asarray(left))

    def doubts(self, index: int) -> list[str]:
        """Return the doubts about one branch."""
        branch = self.traced.branches[index]
        if not branch.deployed:
            return self._absent(index)
        found = []
        children = np.flatnonzero(self.traced.tree.parent == index)
        if not self._on_film(branch.points_mm[0], index):
            found.append(BASE_UNSEEN)
        if not self._on_film(branch.points_mm[-1], index):
            found.append(TIP_UNSEEN)
        if not any(self.traced.branches[child].deployed for child in children):
            found += self._beyond(index)
        line, radius = _dense(branch.points_mm), self.radius_mm[index]
        there = (self.film.at(line, radius) > 0.5) | self.film.hidden(line, radius)
        most_gap_mm = 6.0  # longer stretches of a line without film are no crossing or gloss
        if _longest(~there) * branch.length_mm / max(1, len(line)) > most_gap_mm:
            found.append(OFF_FILM)
        least_alone = 0.5  # of a branch of which less lies alone it is not known which film is its
        if branch.told_apart < least_alone:
            found.append(ON_OTHERS)
        tree, parent = self.traced.tree, int(self.traced.tree.parent[index])
        if parent >= 0 and self.traced.branches[parent].deployed:
            planned = self._end_heading(parent) + float(tree.offset_rad[index])
            off = abs(_turn_deg(_launch_heading(branch, radius), planned))
            most = MOST_HINGE_DEG if self._touches_wall(index) else MOST_TURN_DEG
            found += [OTHER_WAY] if off > most else []
            found += [SIBLING] if self._fits_absent_sibling(index, off) else []
        return found

    def _on_film(self, point_mm: Floats, index: int) -> bool:
        """Tell whether the middle of a tube is seen as film at a point."""
        radius = self.radius_mm[index]
        angle = np.arange(0.0, 2.0 * np.pi, np.pi / 4.0)
        around = 0.4 * radius * np.column_stack([np.cos(angle), np.sin(angle)])
        points = point_mm + np.vstack([np.zeros(2), around])
        if self.film.hidden(points, radius).mean() > 0.5:
            return False
        on_film = 0.6  # least share of film over the middle of a tube, of 1, where it is on film
        return float(self.film.at(points, radius).mean()) >= on_film

    def _beyond(self, index: int) -> list[str]:
        """Return whether the film ends at the tip, all around the way ahead."""
        film, radius = self.film, self.radius_mm[index]
        line = self.traced.branches[index].points_mm
        tip, heading = line[-1], _heading(line[::-1], max(3.0, radius)) + np.pi
        step = max(2.0, deg(0.7 / radius))
        ahead_deg = 60.0  # to both sides of a tip's heading film would go on
        angle = heading + np.radians(np.arange(-ahead_deg, ahead_deg + 0.1, step))
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        # From a tip's edge: there lies neither its blur nor its seam, but film that continues
        # would.
        beyond_mm = 2.0, 4.5
        rings = [tip + (radius + out) * way for out in beyond_mm]
        is_film = np.logical_and.reduce(
            [(film.at(ring, radius) > 0.5) & ~film.is_solid(ring) for ring in rings]
        )
        other = shapely.union_all([a for i, a in enumerate(self.areas) if i != index])
        seen = film.moved(rings[0], radius, film.sight.plane_mm)
        in_other = shapely.contains_xy(other, seen)
        hidden = film.hidden(rings[0], radius) & ~film.is_solid(rings[0])
        arc = (radius + beyond_mm[0]) * np.radians(step)
        found = []
        wide_enough = 0.5  # film that continues is at least this share of the tube wide
        if _longest(is_film & ~in_other) * arc >= wide_enough * 2.0 * radius:
            found.append(GOES_ON)
        if _longest(is_film) * arc >= wide_enough * 2.0 * radius and not found:
            found.append(AT_OTHERS)
        middle = np.abs(np.arange(len(angle)) - len(angle) // 2) <= len(angle) // 4
        if hidden[middle].mean() > 0.5:
            found.append(TIP_UNSEEN)
        view = film.view
        reach = (NEAR_MM + NEAR_RADII * radius) / view.mm_per_pixel
        at = view.to_pixels(film.moved(tip[None], radius, film.sight.plane_mm))[0]
        row, column = (np.arange(size) + 0.5 for size in self.unexplained.shape)
        high, wide = np.abs(row - at[1]) <= reach, np.abs(column - at[0]) <= reach
        away = np.hypot(row[high][:, None] - at[1], column[wide][None] - at[0])
        near = self.unexplained[high][:, wide] & (away <= reach)
        near_mm2 = float(near.sum()) * view.mm_per_pixel**2
        if near_mm2 > MOST_NEAR * (2.0 * radius) ** 2:
            found.append(UNEXPLAINED)
        return found

    def _end_heading(self, index: int) -> float:
        line = self.traced.branches[index].points_mm
        return _heading(line[::-1], max(10.0, 2.0 * self.radius_mm[index])) + np.pi

    def _touches_wall(self, index: int) -> bool:
        """Tell whether a body lies at a wall, away from its joint."""
        radius, line = self.radius_mm[index], _dense(self.traced.branches[index].points_mm)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        line = line[along > 2.0 * radius]
        angle = np.arange(0.0, 2.0 * np.pi, np.pi / 8.0)
        around = (radius + TOUCHING_MM) * np.column_stack([np.cos(angle), np.sin(angle)])
        spots = (line[:, None] + around[None]).reshape(-1, 2)
        return bool(len(line) and self.film.is_solid(spots).any())

    def _fits_absent_sibling(self, index: int, own_deg: float) -> bool:
        """Tell whether the film leaves as an absent sibling would, as nearly as its own plan."""
        tree, branch = self.traced.tree, self.traced.branches[index]
        for other in np.flatnonzero(tree.parent == tree.parent[index]).tolist():
            if other == index or self.traced.branches[other].deployed:
                continue
            planned = self._end_heading(int(tree.parent[index])) + float(tree.offset_rad[other])
            theirs = abs(_turn_deg(_launch_heading(branch, self.radius_mm[index]), planned))
            if theirs <= MOST_TURN_DEG and theirs < own_deg + 0.5 * MOST_TURN_DEG:
                return True
        return False

    def _absent(self, index: int) -> list[str]:
        """Return whether a branch that no line follows may be there all the same."""
        tree = self.traced.tree
        parent = int(tree.parent[index])
        before = self.traced.branches[parent]
        if parent < 0 or not before.deployed:
            return []
        if before.ends_early:  # its children stay in, if that is true: its own doubts say
            return []
        radius = self.radius_mm[index]
        tip, planned = before.points_mm[-1], self._end_heading(parent)
        planned += float(tree.offset_rad[index])
        reach = 1.1 * self.radius_mm[parent] + radius + 4.0
        angle = planned + np.radians(np.arange(-MOST_TURN_DEG, MOST_TURN_DEG + 0.1, 4.0))
        out = np.arange(reach, reach + 8.1, 2.0)
        way = np.column_stack([np.cos(angle), np.sin(angle)])
        points = tip + out[None, :, None] * way[:, None, :]
        flat = points.reshape(-1, 2)
        is_film = (self.film.at(flat, radius) > 0.5) & ~self.film.is_solid(flat)
        unseen = self.film.hidden(flat, radius) & ~self.film.is_solid(flat)
        along = (is_film | unseen).reshape(len(angle), len(out)).all(axis=1)
        return [MAY_BE_OUT] if along.any() else []


def _dense(line_mm: Floats) -> Floats:
    return shapely.get_coordinates(shapely.segmentize(LineString(line_mm), 1.0))


def _heading(line_mm: Floats, over_mm: float) -> float:
    """Return the direction in which a line begins, over a length of it."""
    line = LineString(line_mm)
    there = shapely.get_coordinates(line.interpolate(min(over_mm, line.length)))[0]
    way = there - line_mm[0]
    return float(np.arctan2(way[1], way[0]))


def _launch_heading(branch: TracedBranch, radius: float) -> float:
    """Return the direction in which a branch leaves its joint, where its film is its own."""
    line = LineString(branch.points_mm)
    directions_mm = 40.0
    ends = np.array([min(1.5 * radius, 0.3 * line.length), min(directions_mm, line.length)])
    one, two = shapely.get_coordinates(shapely.line_interpolate_point(line, ends))
    return float(np.arctan2(two[1] - one[1], two[0] - one[0]))


def _turn_deg(one_rad: float, other_rad: float) -> float:
    return deg(float(np.remainder(one_rad - other_rad + np.pi, 2.0 * np.pi) - np.pi))


def _longest(there: NDArray[np.bool_]) -> int:
    """Return the length of the longest run of True."""
    runs, count = scipy.ndimage.label(there)
    return int(np.bincount(runs)[1:].max()) if count else 0


HALF_ANGLES_DEG = (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 12.0, 15.0)
"""Head-on half-angles that predictions are made with: the contact range, which is assumed."""


POINTS = 60
"""Points at equal arc lengths at which two lines are compared."""

UNCLEAR = "unclear"
"""A stop of which it is not known how it came about."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedBranch:
    """One branch, seen and predicted."""

    id: str
    level: int
    planned_mm: float
    predicted_mm: float
    predicted_points_mm: Floats
    traced: TracedBranch
    stop_observed: str  # ``full_length``, ``head_on``, ``corner``, ``not_deployed`` or ``unclear``
    stop_predicted: str
    # distance of both lines at equal arc lengths, up to the shorter one's end; None unless
    # both are there
    mean_mm: float | None
    most_mm: float | None
    hausdorff_mm: float | None  # the largest distance from a point of one line to the other
    nominal_width_mm: float
    contacts: tuple[WallMeeting, ...]
    order_observed: tuple[str, ...]
    order_predicted: tuple[str, ...]
    # with any doubts, nothing is claimed of its stop and contacts
    sight: BranchSight = BranchSight(tip_and_base=False, doubts=())

    @property
    def deployed_observed(self) -> bool:
        """Whether it was seen."""
        return self.traced.deployed

    @property
    def width_mm(self) -> float | None:
        """Its diameter where two edges of it were seen."""
        return self.traced.width_mm if np.isfinite(self.traced.width_mm) else None

    @property
    def deployed_predicted(self) -> bool:
        """Whether it was predicted to emerge."""
        return self.stop_predicted != Stop.NOT_DEPLOYED.label

    @property
    def came_out(self) -> bool:
        """Whether it was seen or predicted to come out; only such branches can agree."""
        return self.deployed_observed or self.deployed_predicted

    @property
    def same_stop(self) -> bool:
        """Whether it came out and stopped as predicted."""
        return self.came_out and self.stop_observed == self.stop_predicted

    @property
    def same_walls(self) -> bool:
        """Whether it came out, as predicted, and met the predicted walls in their order."""
        both = self.deployed_observed and self.deployed_predicted
        return both and self.order_observed == self.order_predicted

    @property
    def share(self) -> float | None:
        """Mean distance as a share of the length seen."""
        if self.mean_mm is None or self.traced.length_mm == 0.0:
            return None
        return self.mean_mm / self.traced.length_mm

    @property
    def content(self) -> dict[str, object]:
        """The branch as it stands in JSON; ``contacts`` are read again."""
        error = {"mean": self.mean_mm, "most": self.most_mm, "hausdorff": self.hausdorff_mm}
        plain = {
            "id": self.id,
            "level": self.level,
            "planned_mm": self.planned_mm,
            "observed_mm": self.traced.length_mm,
            "predicted_mm": self.predicted_mm,
            "deployed_observed": self.deployed_observed,
            "deployed_predicted": self.deployed_predicted,
            "stop_observed": self.stop_observed,
            "stop_predicted": self.stop_predicted,
            "shape_error_mm": None if self.mean_mm is None else error,
            "shape_error_share": None,
            "width_mm": {"measured": self.width_mm, "nominal": self.nominal_width_mm},
            "share_seen": self.traced.seen,
            "share_told_apart": self.traced.told_apart,
            "tip_and_base_seen": self.sight.tip_and_base,
            "doubts": self.sight.doubts,
            "points_mm": self.traced.points_mm.tolist(),
            "contacts": [
                {**contact.model_dump(), "width_mm": self.width_mm} for contact in self.contacts
            ],
            "contact_order_observed": self.order_observed,
            "contact_order_predicted": self.order_predicted,
        }
        return {**rounded(plain, 3), "shape_error_share": rounded(self.share, 5)}

    def in_doubt(self, *doubts: str) -> "ComparedBranch":
        """Return the branch with further doubts; with any, walls are not said to have met it."""
        sight = replace(self.sight, doubts=(*self.sight.doubts, *doubts))
        if not sight.doubts:
            return self
        at_wall = self.stop_observed in (Stop.HEAD_ON.label, Stop.CORNER.label)
        return replace(
            self,
            sight=sight,
            contacts=tuple(contact.changed(outcome="unclear") for contact in self.contacts),
            stop_observed=UNCLEAR if at_wall else self.stop_observed,
        )

    @property
    def is_ambiguous(self) -> bool:
        """Whether it could not be told from other branches."""
        # A branch of which less than this share lies alone could not be told from others.
        told_apart_share = 0.5
        return self.deployed_observed and self.traced.told_apart < told_apart_share


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfAngleFit:
    """How well the prediction with one head-on half-angle has the shape seen."""

    half_angle_deg: float
    # mean distance at equal arc lengths over the length of all branches that are in both
    mean_mm: float
    same_stops: int  # branches that came out and end as predicted
    log_likelihood: float  # of the shape [assumed errors], less that of the best half-angle


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """A photo's robot with its prediction."""

    is_read: bool  # whether this design from this pose can be what the photo shows
    prediction: Deployment
    options: GrowthOptions
    branches: tuple[ComparedBranch, ...]
    fits: tuple[HalfAngleFit, ...]
    notes: tuple[str, ...]

    @property
    def best_half_angles_deg(self) -> tuple[float, ...]:
        """Half-angles that explain the shape about as well as the best: within 2 of its log."""
        return tuple(fit.half_angle_deg for fit in self.fits if fit.log_likelihood > -2.0)


def compare_with_prediction(
    traced: TracedTree,
    design: Design,
    world: Map,
    pose: Pose,
    given: Mapping[str, object] | None,
    sights: Sequence[BranchSight],
) -> Compared:
    """Return a traced robot with the prediction of the growth model.

    Parameters
    ----------
    given
        Growth options by name that replace those of the design.
    sights
        How well each branch was seen.
    """
    choice = GrowthChoice.of([design], given).single
    terrain, replays = Terrain.of(world), Replays(world)
    prediction = grow_on(design, terrain, pose, choice.options)
    branches = list[ComparedBranch]()
    for index, sight in enumerate(sights):
        seen = _compared(index, traced, prediction, choice.options, replays)
        no_wall = [NO_WALL] * (seen.stop_observed == UNCLEAR)
        branches.append(replace(seen, sight=sight).in_doubt(*no_wall))
    # With less of the film in the lines, or of the lines on film, design and photo do not fit.
    least_explained = 0.8
    # Lines explain the film, film supports the lines, and joints explain the branches.
    explained = min(traced.film_explained, traced.lines_supported) >= least_explained
    doubtful = sum(bool(branch.sight.doubts) for branch in branches)
    most_doubtful = 0.5  # with more of the branches in doubt, they do not either
    is_read = explained and doubtful <= most_doubtful * len(branches)
    if not is_read:
        branches = [branch.in_doubt(NO_VERDICT) for branch in branches]
    return Compared(
        is_read=is_read,
        prediction=prediction,
        options=choice.options,
        branches=tuple(branches),
        fits=_half_angle_fits(traced, branches, design, terrain, pose, choice.options),
        notes=choice.notes,
    )


def _compared(
    index: int,
    traced: TracedTree,
    prediction: Deployment,
    options: GrowthOptions,
    replays: Replays,
) -> ComparedBranch:
    seen, tree = traced.branches[index], traced.tree
    bends = tree.bends_of(index)
    radius = inflated_radius_mm(float(tree.width_mm[index]))
    parent, length_mm = int(tree.parent[index]), float(tree.length_mm[index])
    contacts: tuple[WallMeeting, ...] = ()
    stop = Stop.NOT_DEPLOYED.label
    # Standard error of a joint's angle [assumed: real joints are 4 to 7 degrees off].
    joint_error_deg = 5.5
    if seen.deployed:
        heading, error = prediction.pose.heading_rad, 1.5
        if parent >= 0:
            corners = traced.branches[parent].corners_mm
            heading = _last_heading(corners) + float(tree.offset_rad[index])
            # The shorter the last straight stretch, the less its heading is known.
            last_mm = float(np.hypot(*(corners[-1] - corners[-2])))
            line_error = HEADING_ERROR_DEG * max(1.0, 40.0 / max(1.0, last_mm))
            error = float(np.hypot(line_error, joint_error_deg))
        known = SeenBranch(
            points_mm=seen.points_mm,
            length_mm=seen.length_mm,
            planned_mm=length_mm,
            ends_early=seen.ends_early,
            radius_mm=radius,
            heading_rad=heading,
            heading_error_deg=min(error, 30.0),
            bends=tuple(bends),
        )
        contacts, stop = seen_meetings(replays, known)
    chain = prediction.chain_mm(index)
    mean, most = distance_mm(seen.points_mm, chain)
    hausdorff = apart_mm(seen.points_mm, chain)
    predicted = list[WallMeeting]()
    if len(chain) > 1:
        heading = prediction.pose.heading_rad
        if parent >= 0:
            heading = _last_heading(prediction.chain_mm(parent)) + float(tree.offset_rad[index])
        angle_rad = options.only_half_angle_rad
        replay = replays.grown(chain[0], heading, length_mm, radius, angle_rad, bends)
        grown_mm = float(prediction.grown_mm[index]) + 1e-6
        predicted = [one for one in replay.meetings if one.front_mm <= grown_mm] if replay else []
    return ComparedBranch(
        id=tree.ids[index],
        level=int(tree.level[index]),
        planned_mm=length_mm,
        predicted_mm=float(prediction.grown_mm[index]),
        predicted_points_mm=chain,
        traced=seen,
        stop_observed=stop,
        stop_predicted=Stop(int(prediction.stop[index])).label,
        mean_mm=mean,
        most_mm=most,
        hausdorff_mm=hausdorff if np.isfinite(hausdorff) else None,
        nominal_width_mm=2.0 * radius,
        contacts=contacts,
        order_observed=tuple(
            wall_order([c for c in contacts if c.front_mm <= seen.length_mm + radius])
        ),
        order_predicted=tuple(wall_order(predicted)),
    )


def _last_heading(chain_mm: Floats) -> float:
    """Return the direction in which a chain ends."""
    last = chain_mm[-1] - chain_mm[-2]
    return float(np.arctan2(last[1], last[0]))


def distance_mm(one: Floats, other: Floats) -> tuple[float | None, float | None]:
    """Return mean and largest distance of two lines at equal arc lengths; None without both."""
    if len(one) < 2 or len(other) < 2:
        return None, None
    lines = LineString(one), LineString(other)
    at = np.linspace(0.0, min(line.length for line in lines), POINTS)
    places = [shapely.get_coordinates(shapely.line_interpolate_point(line, at)) for line in lines]
    away = np.hypot(*(places[0] - places[1]).T)
    return float(away.mean()), float(away.max())


# --- Which half-angle fits ------------------------------------------------------------------------


def _half_angle_fits(
    traced: TracedTree,
    branches: Sequence[ComparedBranch],
    design: Design,
    terrain: Terrain,
    pose: Pose,
    options: GrowthOptions,
) -> tuple[HalfAngleFit, ...]:
    """Return the fits of predictions over the contact range to the shape seen."""
    begins = [0.0] * len(traced.tree)  # the planned way along the body to each branch's base
    for index, parent in enumerate(traced.tree.parent.tolist()):
        if parent >= 0:
            begins[index] = begins[parent] + float(traced.tree.length_mm[parent])
    fits = []
    # A branch is never counted as farther off than so many standard errors, so that one that went
    # another way, or did not deploy, does not decide alone.
    worst_errors = 4.0
    # Standard error of a predicted branch, plus this share of the way to it [assumed]: real robots
    # were 0.3 to 3.5 % of their length off predictions of the model.
    shape_error_share = 0.03
    shape_error_mm = 2.0
    for angle in sorted({*HALF_ANGLES_DEG, deg(options.only_half_angle_rad)}):
        changed = GrowthOptions.of({"head_on_half_angle_deg": angle}, options)
        predicted = grow_on(design, terrain, pose, changed)
        total = weight = log = 0.0
        for index, branch in enumerate(branches):
            chain, grown_mm = predicted.chain_mm(index), float(predicted.grown_mm[index])
            mean, _ = distance_mm(branch.traced.points_mm, chain)
            if mean is None:
                missed = (len(branch.traced.points_mm) > 1) != (len(chain) > 1)
                log -= 0.5 * worst_errors**2 * missed
                continue
            length = min(branch.traced.length_mm, grown_mm)
            total, weight = total + mean * length, weight + length
            error = shape_error_mm + shape_error_share * (begins[index] + branch.planned_mm)
            away = max(mean, abs(branch.traced.length_mm - grown_mm))
            log -= 0.5 * min(away / error, worst_errors) ** 2
        stops = [Stop(int(stop)).label for stop in predicted.stop]
        same = sum(
            b.stop_observed == stop != Stop.NOT_DEPLOYED.label
            for b, stop in zip(branches, stops, strict=True)
        )
        fits.append(
            HalfAngleFit(
                half_angle_deg=round(angle, 6),
                mean_mm=total / weight if weight else 0.0,
                same_stops=same,
                log_likelihood=log,
            )
        )
    top = max(fit.log_likelihood for fit in fits)
    return tuple(replace(fit, log_likelihood=fit.log_likelihood - top) for fit in fits)
