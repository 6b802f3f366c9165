"""Contacts of tips with walls: replayed from a photo's lines, and read again for a fit.

A photo of the final shape does not show the headings that its tips had. They follow from the
launch heading, which the parent's line shows, and from the walls: the replay slides along every
wall, and is believed as far as its shape is the one seen. Observations are files of the kind
``vinefab/observation-1``.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from pydantic import Field
from shapely import LineString, Polygon
from typing_extensions import Doc

from vinefab.core.compiling import rebindable
from vinefab.core.errors import BadInputError, UnreadableFileError, VinefabError, values_hidden
from vinefab.core.limits import deg, rad
from vinefab.core.table import TablePart, validated
from vinefab.core.validation import Floats, frozen_floats
from vinefab.growth.arrays import Growth, Launch, Rules, TreesArrays, WallArrays
from vinefab.growth.batch import KERNEL, rules_of
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Design
from vinefab.model.files.shipped import read_text
from vinefab.model.map import Map, Pose
from vinefab.physics.tube import inflated_diameter_mm

MeetingOutcome = Literal["slid", "stopped", "unclear"]

AGREES_MM = 2.5
AGREES_SHARE = 0.02
"""A replay has the shape seen if no point of one is farther from the other than both together."""

SAME_PLACE_MM = 1.0
"""Places nearer to each other along a branch are one on a photo."""

_TURNS_DEG = (0.0, -0.5, 0.5, -1.0, 1.0, -2.0, 2.0, -3.0, 3.0, -5.0, 5.0, -8.0, 8.0, -12.0, 12.0)

HEADING_ERROR_DEG = 0.7
"""Standard error of a line's heading over 40 mm [assumed, above what rendered photos show]."""

TIP_ERROR_DEG = 2.5
"""Standard error of the heading of a tip by its film [assumed, above what rendered photos show]."""

JOINT_ERROR_DEG = 5.5
"""Standard error of a joint's angle [assumed: real joints are 4 to 7 degrees off]."""

BEND_PER_MM, BEND_OVER_MM = 1.0 / 600.0, 60.0
"""Standard deviation of the curvature of real branches, and the length over which it lasts
[assumed]: so far a tip's heading strays from that of its joint."""

TIP_LENGTH_MM = 40.0
"""Of the line by whose bend the heading of a tip is found."""

TIP_AT_WALL_MM = 2.5
"""A tip that stopped at a wall lies so near to it [assumed]."""

STEEPEST_STOP_DEG = 45.0
"""Whatever ends a body that lies flatter at its wall, it is not the contact's angle [assumed]."""

CORNER_DEG = 30.0
"""Walls whose normals differ by more make a corner for a tip that touches both."""

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

    Parameters
    ----------
    chain_mm
        Base, contacts and tip at its end.
    meetings
        Where its tip met walls, in order.
    chains_mm
        Base, contacts and tip when it met each of them.
    stop
        Why it ended.
    """

    chain_mm: Floats
    meetings: tuple[WallMeeting, ...]
    chains_mm: tuple[Floats, ...]
    stop: Stop


class _Met(NamedTuple):
    """A tip that meets a wall."""

    chain_mm: Floats  # base, contacts and tip
    angle_rad: float
    front_mm: float


def _grown_alone(
    walls: WallArrays, rules: Rules, start: Launch, length_mm: float
) -> tuple[Growth, list[_Met]]:
    """Return the growth of one branch that no pressure stops, and where its tip met walls."""
    kernel = rebindable(KERNEL)
    meet, room = kernel["_meet"], 64
    tree = TreesArrays(
        parent=np.array([-1]),
        turn=np.array([[1.0, 0.0]]),
        length=np.array([length_mm]),
        limit=np.array([np.inf]),
        store=np.zeros(1),
        first=np.array([0, 1]),
    )
    fits = np.array([True])
    while True:
        growth, met = Growth.empty(1, room), list[_Met]()

        def note(walls: Any, rules: Any, tip: Any, wall: int, place: float) -> Any:  # noqa: ANN401  as the kernel
            x, y, tangent_x, tangent_y, _ = walls.wall[wall].tolist()
            spot = np.array([x + place * tangent_x, y + place * tangent_y])
            chain = np.vstack([growth.points[: tip.pivot + 1], spot])  # noqa: B023  called at once
            along = abs(tip.ux * tangent_x + tip.uy * tangent_y)
            against = tip.ux * tangent_y - tip.uy * tangent_x
            front = growth.chain_length[tip.pivot] + math.dist(*chain[-2:])  # noqa: B023
            met.append(_Met(chain, math.atan2(along, against), float(front)))  # noqa: B023
            return meet(walls, rules, tip, wall, place)

        kernel["_meet"] = note
        with np.errstate(all="ignore"):
            if kernel["grow_branches"](walls, tree, fits, rules, start, growth, 0, 1) == 1:
                return growth, met
        room *= 2


@dataclass(slots=True, eq=False)
class Replays:
    """Replays of branches on one map."""

    world: Map
    shapes: list[Polygon] = field(init=False)

    def __post_init__(self) -> None:
        self.shapes = list(self.world.obstacles)

    def grown(
        self,
        base_mm: Floats,
        heading_rad: float,
        length_mm: float,
        radius_mm: float,
        half_angle_rad: float = 0.0,
    ) -> Replay | None:
        """Return a branch grown alone; None where it has no room."""
        around = shapely.Point(base_mm).buffer(length_mm + 3.0 * radius_mm)
        kept = tuple(shape for shape in self.shapes if shape.intersects(around))
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
        start = Launch(x_mm, y_mm, math.cos(heading_rad), math.sin(heading_rad))
        growth, met = _grown_alone(terrain.walls(radius_mm), rules, start, length_mm)
        meetings = tuple(
            WallMeeting(
                x_mm=float(one.chain_mm[-1, 0]),
                y_mm=float(one.chain_mm[-1, 1]),
                wall=self._wall(one.chain_mm[-1]),
                angle_from_normal_deg=deg(one.angle_rad),
                angle_error_deg=0.0,
                front_mm=one.front_mm,
                outcome="slid",
            )
            for one in met
        )
        stop = Stop(int(growth.stop[0]))
        if stop in (Stop.CORNER, Stop.HEAD_ON) and meetings:
            meetings = (*meetings[:-1], meetings[-1].changed(outcome="stopped"))
        return Replay(
            chain_mm=growth.points[: growth.first_point[1]],
            meetings=meetings,
            chains_mm=tuple(one.chain_mm for one in met),
            stop=stop,
        )

    def _wall(self, tip_mm: Floats) -> str:
        """Return the name of the object that a tip touches."""
        point = shapely.Point(tip_mm)
        edge = float(self.world.bounds.boundary.distance(point))
        if not self.shapes:
            return "bounds"
        away = shapely.distance(np.array(self.shapes, dtype=np.object_), point)
        nearest = int(np.argmin(away))
        return f"obstacle {nearest}" if float(away[nearest]) <= edge else "bounds"

    def wall_shape(self, name: str) -> shapely.Geometry:
        """Return the obstacle of a name, or the bounds' edge."""
        if name == "bounds":
            return self.world.bounds.boundary
        return self.shapes[int(name.split()[1])]


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


def seen_meetings(replays: Replays, seen: SeenBranch) -> tuple[tuple[WallMeeting, ...], str]:
    """Return the meetings of a branch's tip with walls, and the reason why it stopped.

    The stop is ``full_length``, ``head_on``, ``corner``, or ``unclear`` where it is short of its
    length without a wall at its end. A tip that stopped has the heading that it came with, so that
    its angle is seen; where it slid, the angle is that of the replay.
    """
    stop = _stop_at_wall(replays, seen) if seen.ends_early else None
    best = _best_replay(replays, seen)
    meetings = list[WallMeeting]()
    if best is not None:
        replay, end, turn, away = best
        passed = replay.meetings if end is None else replay.meetings[:end]
        fits = away <= AGREES_MM + AGREES_SHARE * seen.length_mm
        meetings = [_passed(replays, seen, meeting, turn, fits=fits) for meeting in passed]
    if not seen.ends_early:
        return tuple(meetings), "full_length"
    if stop is None:
        return tuple(meetings), "unclear"
    meeting, is_corner = stop
    before = [m for m in meetings if m.front_mm < seen.length_mm - seen.radius_mm]
    return (*before, meeting), "corner" if is_corner else "head_on"


def _passed(
    replays: Replays, seen: SeenBranch, meeting: WallMeeting, turn_deg: float, *, fits: bool
) -> WallMeeting:
    """Return a meeting of a replay, with the tip's behaviour there on the photo."""
    away = _touching_mm(replays, seen, meeting.wall)
    # What is met within the error of the length may not have been met at all.
    is_met = meeting.front_mm <= seen.length_mm - SAME_PLACE_MM
    bend_rad = BEND_PER_MM * math.sqrt(BEND_OVER_MM * min(meeting.front_mm, seen.length_mm))
    error = math.hypot(seen.heading_error_deg, 0.5 * turn_deg, deg(bend_rad))
    return meeting.changed(
        outcome="slid" if fits and away is not None and is_met else "unclear",
        angle_error_deg=min(error, 30.0),
        distance_mm=away,
    )


def _touching_mm(replays: Replays, seen: SeenBranch, wall: str) -> float | None:
    """Return the distance at which a line passes a wall; None where the body does not touch it."""
    away = float(shapely.distance(replays.wall_shape(wall), LineString(seen.points_mm)))
    return away if abs(away - seen.radius_mm) <= max(1.5, 0.3 * seen.radius_mm) else None


def _stop_at_wall(replays: Replays, seen: SeenBranch) -> tuple[WallMeeting, bool] | None:
    """Return the wall at which a tip lies, head-on or in a corner; None where none is."""
    short_mm = seen.planned_mm - seen.length_mm
    if short_mm <= max(SHORT_OF_LENGTH_MM, SHORT_OF_LENGTH_SHARE * seen.planned_mm):
        return None
    tip = seen.points_mm[-1]
    heading, error = _tip_heading(seen.points_mm)
    near = list[tuple[float, float, float, str]]()  # angle, distance, direction, wall
    names = ["bounds", *(f"obstacle {index}" for index in range(len(replays.shapes)))]
    for name in names:
        line = shapely.shortest_line(shapely.Point(tip), _outline(replays.wall_shape(name)))
        if line.length > seen.radius_mm + TIP_AT_WALL_MM or line.length < 0.3 * seen.radius_mm:
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
    is_corner = max(others) > CORNER_DEG
    if angle > STEEPEST_STOP_DEG and not is_corner:
        return None
    place = tip + away * np.array([math.cos(normal), math.sin(normal)])
    meeting = WallMeeting(
        x_mm=float(tip[0]),
        y_mm=float(tip[1]),
        wall=name if shapely.Point(place).distance(replays.wall_shape(name)) < 1.0 else "bounds",
        angle_from_normal_deg=angle,
        angle_error_deg=error,
        front_mm=seen.length_mm,
        outcome="stopped",
        distance_mm=_touching_mm(replays, seen, name),
    )
    return meeting, is_corner


def _outline(shape: shapely.Geometry) -> shapely.Geometry:
    return shape.boundary if isinstance(shape, Polygon) else shape


def _tip_heading(line_mm: Floats) -> tuple[float, float]:
    """Return the heading of a tip by the bend of its line's end, and its error in degrees."""
    line = LineString(line_mm)
    headings = []
    for length in (TIP_LENGTH_MM, TIP_LENGTH_MM / 2.0):
        over = min(length, line.length)
        along = np.linspace(0.0, over, 25)
        points = shapely.get_coordinates(shapely.line_interpolate_point(line, line.length - along))
        slopes = [np.polyfit(along, points[:, axis], 2)[1] for axis in (0, 1)]
        headings.append(math.atan2(-slopes[1], -slopes[0]))
    # A kink near the end bends the longer stretch otherwise than the shorter one.
    apart = deg(math.remainder(headings[0] - headings[1], math.tau))
    short = max(1.0, TIP_LENGTH_MM / max(1.0, line.length))
    return headings[0], min(30.0, math.hypot(TIP_ERROR_DEG * short, 0.5 * apart))


def _best_replay(
    replays: Replays, seen: SeenBranch
) -> tuple[Replay, int | None, float, float] | None:
    """Return the replay most like what was seen, of launch headings near the planned one.

    With it: the meeting at which it ends as seen (None where it ends elsewhere), the turn of its
    heading in degrees, and the largest distance between both shapes.
    """
    best, least = None, float("inf")
    # A little longer than seen, so that the wall where it stopped is met.
    length = seen.length_mm + _slack_mm(seen) * seen.ends_early
    for turn in _TURNS_DEG:
        heading = seen.heading_rad + rad(turn)
        replay = replays.grown(seen.points_mm[0], heading, length, seen.radius_mm)
        if replay is None:
            continue
        end, away = _ends_as_seen(replay, seen)
        if away + 0.1 * abs(turn) < least:
            best, least = (replay, end, turn, away), away + 0.1 * abs(turn)
        if turn == 0.0 and away <= 1.0:
            break
    return best


def _slack_mm(seen: SeenBranch) -> float:
    return max(3.0, 0.6 * seen.radius_mm)


def _ends_as_seen(replay: Replay, seen: SeenBranch) -> tuple[int | None, float]:
    """Return at which meeting a replay has the shape seen, and the distance between both.

    Near head-on a tip slides centimetres while its body grows by a millimetre, so that a branch
    that stopped is compared with the replay at each meeting, not at its length.
    """
    if not seen.ends_early:
        return None, apart_mm(replay.chain_mm, seen.points_mm)
    near = [
        (apart_mm(chain, seen.points_mm), place)
        for place, (chain, meeting) in enumerate(
            zip(replay.chains_mm, replay.meetings, strict=True)
        )
        if abs(meeting.front_mm - seen.length_mm) <= _slack_mm(seen)
    ]
    if not near:
        return None, apart_mm(replay.chain_mm, seen.points_mm)
    least = min(away for away, _ in near)
    # Of places that the photo cannot tell apart, the one met most head-on.
    same = [place for away, place in near if away <= least + SAME_PLACE_MM]
    end = min(same, key=lambda place: replay.meetings[place].angle_from_normal_deg)
    return end, least


LARGEST_OBSERVATION_BYTES = 1 << 26
MOST_CONTACTS = 10_000
MOST_TRACED = 200_000
"""Points of one traced branch."""

OTHER_STOPS = ("corner", "pressure", "full_length")
"""Reasons of stops at a wall that are not the contact's angle."""


Coordinate = Annotated[float, Field(ge=-1e7, le=1e7)]
Point = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]


class BranchWidthForm(TablePart):
    """How broad a branch should look from above."""

    nominal: Annotated[float, Field(gt=0, le=1e5)]


class TracedBranchForm(TablePart):
    """A branch as planned, seen and predicted."""

    id: str
    width_mm: BranchWidthForm | None = None
    level: Annotated[int, Field(ge=1, le=1000)]
    points_mm: Annotated[list[Point], Field(max_length=MOST_TRACED)] = Field(default_factory=list)
    stop_observed: str | None = None
    contacts: Annotated[list[WallContact], Field(max_length=MOST_CONTACTS)] = Field(
        default_factory=list
    )
    doubts: list[str] = Field(default_factory=list)


class BreadthForm(TablePart):
    """How broad the film is as seen from above."""

    measured: Annotated[float, Field(gt=0, le=1e5)]
    low: Annotated[float, Field(ge=0, le=1e5)]
    high: Annotated[float, Field(gt=0, le=1e5)]


class FilmForm(TablePart):
    """The film of a photo."""

    width_mm: BreadthForm | None = None


class PoseForm(TablePart):
    """Where the robot was launched."""

    x_mm: Coordinate
    y_mm: Coordinate
    heading_deg: float


class SummaryForm(TablePart):
    """What an observation says of the whole photo."""

    fits: bool = True


class ObservationForm(TablePart):
    """One observation."""

    schema_: Literal["vinefab/observation-1"] = Field(alias="schema")
    photo: str
    map: str
    design: str
    pose: PoseForm
    film: FilmForm | None = None
    summary: SummaryForm = Field(default_factory=SummaryForm)
    branches: list[TracedBranchForm]


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenContact:
    """A contact of a photo whose tip slid or stopped for its angle."""

    angle_deg: float  # from the wall's normal
    stopped: bool
    error_deg: float | None  # standard error of the angle, if the observation says


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObservedPhoto:
    """What one photo says, with its design and map where they were found."""

    file: Path
    photo: str
    contacts: tuple[SeenContact, ...]
    unclear: int  # contacts left out because it could not be seen what the tip did there
    has_verdict: bool  # whether the photo shows its design; without, no contact counts
    elsewise: int  # contacts left out because the tip stopped for another reason than the angle
    chains_mm: dict[str, Floats]  # traced centre lines by branch, shape (k, 2) each
    pose: Pose
    design: Design | None
    world: Map | None
    # distance of centre lines from each wall that they touch, against the nominal radius
    width_ratios: tuple[float, ...]
    # breadth of the film against the trunk's nominal diameter: value, low, high
    breadth_ratio: tuple[float, float, float] | None
    notes: tuple[str, ...] = ()


_NO_OBSERVATIONS = (".jpg", ".jpeg", ".png", ".html")
"""Of photos and pages, which are not what is fitted."""


def read_observations(paths: Sequence[Path]) -> tuple[ObservedPhoto, ...]:
    """Return observations, each once."""
    if not paths:
        raise BadInputError("observations", "none", "at least one JSON file of vinefab observe")
    texts: dict[str, Path] = {}
    for path in paths:
        if path.suffix.lower() in _NO_OBSERVATIONS:
            allowed = "the JSON of an observation: vinefab observe PHOTO ... --json one.json"
            raise BadInputError("observation", path.name, allowed)
        text = read_text(path, LARGEST_OBSERVATION_BYTES)
        if text in texts:
            raise BadInputError(str(path), f"the same as {texts[text]}", "each observation once")
        texts[text] = path
    return tuple(_observation(text, path) for text, path in texts.items())


def json_object(text: str, path: Path) -> dict[str, Any]:
    """Return the content of a JSON file, which has to be an object."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {str(error)[:100]}") from error
    if not isinstance(content, dict):
        raise UnreadableFileError(path, "is not a JSON object")
    return content


def _observation(text: str, path: Path) -> ObservedPhoto:
    form = validated(ObservationForm, json_object(text, path), path)
    design, world, notes = _found(form, path)
    contacts, unclear, elsewise = _contacts(form)
    return ObservedPhoto(
        file=path,
        photo=form.photo,
        contacts=contacts,
        unclear=unclear,
        has_verdict=form.summary.fits,
        elsewise=elsewise,
        chains_mm={
            branch.id: frozen_floats("points_mm", branch.points_mm, 2)
            for branch in form.branches
            if form.summary.fits and not branch.doubts
        },
        pose=Pose(x_mm=form.pose.x_mm, y_mm=form.pose.y_mm, heading_rad=rad(form.pose.heading_deg)),
        design=design,
        world=world,
        width_ratios=_width_ratios(form, design),
        breadth_ratio=_breadth_ratio(form, design) if form.summary.fits else None,
        notes=notes,
    )


def _contacts(form: ObservationForm) -> tuple[tuple[SeenContact, ...], int, int]:
    """Return contacts that a threshold can be fitted to, and how many are not among them and why.

    A branch ends once: of its contacts at most the last is the one that it stopped at. Nothing is
    known of contacts on a photo without a verdict, nor of those of a branch in doubt.
    """
    kept, unclear, elsewise = list[SeenContact](), 0, 0
    for branch in form.branches:
        for contact in branch.contacts:
            stopped, angle_deg = contact.outcome == "stopped", contact.angle_from_normal_deg
            is_seen = form.summary.fits and not branch.doubts
            if not is_seen or contact.outcome == "unclear" or angle_deg is None:
                unclear += 1
            elif angle_deg > 90.0 or (stopped and branch.stop_observed in OTHER_STOPS):
                elsewise += 1
            else:
                kept.append(
                    SeenContact(
                        angle_deg=angle_deg, stopped=stopped, error_deg=contact.angle_error_deg
                    )
                )
    return tuple(kept), unclear, elsewise


def _found(form: ObservationForm, path: Path) -> tuple[Design | None, Map | None, tuple[str, ...]]:
    """Return design and map of an observation if still readable, and notes on the rest."""
    notes = list[str]()
    design: Design | None = None
    world: Map | None = None
    try:
        with values_hidden():
            design = Design.read(_beside(form.design, path))
    except VinefabError as error:
        notes.append(f"{path.name}: its design is not read ({error})")
    try:
        with values_hidden():
            world = Map.read(Path(_beside(form.map, path)))
    except VinefabError as error:
        notes.append(f"{path.name}: its map is not read ({error})")
    return design, world, tuple(notes)


def _beside(name: str, path: Path) -> str:
    """Return a file named in an observation: as it stands, else next to the observation."""
    if "\0" in name or Path(name).is_file():
        return name
    for near in (path.parent / name, path.parent / Path(name).name):
        if near.is_file():
            return str(near)
    return name


def _width_ratios(form: ObservationForm, design: Design | None) -> tuple[float, ...]:
    """Return distances from walls against nominal radii, one for each branch and wall."""
    ratios: dict[tuple[str, object], float] = {}
    for branch in form.branches if form.summary.fits else ():
        nominal_mm = _nominal_mm(branch, design)
        if branch.doubts:
            continue
        for contact in branch.contacts:
            if nominal_mm and contact.distance_mm is not None and contact.outcome != "unclear":
                ratios[branch.id, contact.wall] = 2.0 * contact.distance_mm / nominal_mm
    return tuple(ratios.values())


def _nominal_mm(branch: TracedBranchForm, design: Design | None) -> float | None:
    """Return the nominal inflated diameter of a branch, by the observation or by the design."""
    if branch.width_mm is not None:
        return branch.width_mm.nominal
    if design is None or branch.level > len(design.build.widths_mm):
        return None
    return inflated_diameter_mm(design.build.widths_mm[branch.level - 1])


def _breadth_ratio(
    form: ObservationForm, design: Design | None
) -> tuple[float, float, float] | None:
    found = None if form.film is None else form.film.width_mm
    trunk = next((branch for branch in form.branches if branch.level == 1), None)
    nominal_mm = None if trunk is None else _nominal_mm(trunk, design)
    if found is None or nominal_mm is None:
        return None
    value, low, high = np.array([found.measured, found.low, found.high]) / nominal_mm
    return float(value), float(low), float(high)
