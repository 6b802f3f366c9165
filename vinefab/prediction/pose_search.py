"""Searching a map for the pose from which a robot scores best, over contacts and placing errors.

Every pose is tried at the same draws of contacts and placing errors, so that poses are compared
pair by pair. Whatever is best among many estimates looks better than it is: what is reported of a
pose comes from draws that no choice has seen (`vinefab.prediction.aiming`).
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.limits import deg, rad
from vinefab.core.validation import Floats, Ints
from vinefab.growth.batch import Batch, BlockMapper, GrowthBlock, Launches, TerrainSet, Workspace
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import beside_walls
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.model.start import start_from, start_pieces, with_starts
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.tasks.evaluate import PreparedMap
from vinefab.tasks.task import Task, outcomes

PLACING_MM, PLACING_DEG = 5.0, 3.0
"""A base is placed this well [assumed]: within so many mm, and so many degrees of its heading."""

WHERE = ("border", "anywhere", "starts")
"""Where a base may stand: along the border of the free space and where the map's starts are,
wherever the trunk has room, or only where the map's starts are."""

MOST_PLACING_MM, MOST_PLACING_DEG = 1000.0, 180.0


# --- What differs from deployment to deployment -------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseDraws:
    """Contacts and placing errors of k deployments from one pose."""

    offset_mm: Floats  # how far the base is off, shape (k, 2)
    turn_rad: Floats  # how far the heading is off, shape (k,)
    half_angle_rad: Floats  # head-on half-angle of the contacts, shape (k,)
    seed: Ints  # of the children that come out, shape (k,)

    def __len__(self) -> int:
        return len(self.turn_rad)

    def part(self, first: int, last: int) -> "PoseDraws":
        """Return the draws ``first .. last - 1``."""
        return PoseDraws(
            offset_mm=self.offset_mm[first:last],
            turn_rad=self.turn_rad[first:last],
            half_angle_rad=self.half_angle_rad[first:last],
            seed=self.seed[first:last],
        )

    def with_contacts_of(self, other: "PoseDraws") -> "PoseDraws":
        """Return the same placing errors with the contacts of other draws."""
        return replace(self, half_angle_rad=other.half_angle_rad, seed=other.seed)


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseErrors:
    """How far off a base is placed, and the possible properties of its contacts."""

    placing_mm: float  # the base is anywhere within so far
    placing_deg: float  # the heading is anywhere within so much to either side
    half_angle_range_rad: tuple[float, float]

    def even(self, count: int) -> PoseDraws:
        """Return draws that fill the ranges evenly; a longer row begins with the shorter one.

        The steps are powers of the plastic number's kin for four dimensions (an additive
        recurrence of low discrepancy).
        """
        base = 1.1673039782614187  # the root of x^5 = x + 1
        steps = base ** -np.arange(1.0, 5.0)
        return self._of(np.mod(0.5 + np.arange(count)[:, None] * steps, 1.0))

    def drawn(self, count: int, rng: np.random.Generator) -> PoseDraws:
        """Return independent draws."""
        return self._of(rng.random((count, 4)))

    def _of(self, shares: Floats) -> PoseDraws:
        away_mm = self.placing_mm * np.sqrt(shares[:, 0])  # evenly over the disc
        direction = 2.0 * math.pi * shares[:, 1]
        low, high = self.half_angle_range_rad
        return PoseDraws(
            offset_mm=away_mm[:, None] * np.column_stack([np.cos(direction), np.sin(direction)]),
            turn_rad=rad(self.placing_deg) * (2.0 * shares[:, 2] - 1.0),
            half_angle_rad=low + (high - low) * shares[:, 3],
            seed=(shares[:, 2:].sum(axis=1) * 2.0**52).astype(np.int64),
        )


# --- Deploying from many poses ------------------------------------------------------------------


DeploymentCounter = Callable[[int], None]
"""Called with the number of deployments that have just been done."""


def _count_nothing(_done: int) -> None:
    """Take no notice."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseTrial:
    """A design on a map, to be deployed from many poses."""

    design: Design
    prepared: PreparedMap
    options: GrowthOptions
    terrains: TerrainSet
    plans: Plans
    over: BlockMapper = map  # how blocks of growths are processed: `map`, or that of some threads
    workspaces: list[Workspace] = field(default_factory=list)

    @classmethod
    def of(
        cls, design: Design, prepared: PreparedMap, options: GrowthOptions, over: BlockMapper = map
    ) -> "PoseTrial":
        """Return a design on a map."""
        return cls(
            design=design,
            prepared=prepared,
            options=options,
            terrains=TerrainSet([prepared.terrain]),
            plans=Plans.of([design], options),
            over=over,
        )

    @property
    def radius_mm(self) -> float:
        """Radius of the trunk as it grows; 0 for bare centrelines."""
        return self.options.radius_mm(self.design.build.widths_mm[0])

    @property
    def room(self) -> BaseGeometry:
        """Where the trunk's base has room.

        Raises
        ------
        BadInputError
            If that is nowhere.
        """
        room = self.prepared.terrain.free_space(self.radius_mm)
        if room.is_empty:
            diameter_mm = inflated_diameter_mm(self.design.build.widths_mm[0])
            problem = f"it has no room for the trunk, {diameter_mm:.1f} mm wide when inflated"
            remedy = "narrow the trunk, or widen the map"
            raise UnfitInputError(f"map {self.prepared.world.name!r}", problem, remedy)
        return room

    def placed(self, poses: Floats, draws: PoseDraws) -> Floats:
        """Return where bases come to lie, shape (n * k, 3): pose by pose, draw by draw.

        A base that is pushed against a wall stays next to it: at the nearest place with room.

        Parameters
        ----------
        poses
            x and y (mm) and heading (rad) of each, shape (n, 3).
        """
        moved = np.repeat(poses, len(draws), axis=0)
        moved[:, :2] += np.tile(draws.offset_mm, (len(poses), 1))
        moved[:, 2] += np.tile(draws.turn_rad, len(poses))
        outside = np.flatnonzero(~shapely.contains_xy(self.room, moved[:, :2]))
        moved[outside, :2] = nearest_places(self.room, moved[outside, :2])
        return moved

    def launches(self, poses: Floats, draws: PoseDraws) -> Launches:
        """Return every pose at every draw as launches of a batch, pose by pose."""
        placed = [pose_of(row) for row in self.placed(poses, draws).tolist()]
        angles = np.tile(draws.half_angle_rad, len(poses))
        seeds = np.tile(draws.seed, len(poses))
        return Launches.of(self.terrains, [placed], angles, seeds)  # type: ignore[arg-type]

    def each(
        self,
        poses: Floats,
        draws: PoseDraws,
        work: Callable[[GrowthBlock], NDArray[Any]],
        count: DeploymentCounter = _count_nothing,
    ) -> NDArray[Any]:
        """Return the results of ``work`` for every growth, shape (n, k) or (n, k, ...)."""
        # So many launches are prepared at a time: memory does not grow with their number.
        most_together = 8192
        together, parts = max(1, most_together // len(draws)), list[NDArray[Any]]()
        for first in range(0, len(poses), together):
            some = poses[first : first + together]
            batch = Batch(self.plans, self.launches(some, draws), self.options, self.workspaces)
            found = np.concatenate(list(batch.each(work, self.over)))
            parts.append(found.reshape(len(some), len(draws), *found.shape[1:]))
            count(found.shape[0])
        return np.concatenate(parts)

    def scores(
        self,
        task: Task,
        poses: Floats,
        draws: PoseDraws,
        count: DeploymentCounter = _count_nothing,
    ) -> Floats:
        """Return a task's score of every pose at every draw, shape (n, k)."""
        contexts = [self.prepared.context]

        def scored(block: GrowthBlock) -> Floats:
            return outcomes(task, block, contexts).score

        return self.each(poses, draws, scored, count)

    def deployments(self, pose: Floats, draws: PoseDraws) -> list[Deployment]:
        """Return the deployments from one pose."""
        launches = self.launches(pose[None], draws)
        return Batch(self.plans, launches, self.options, self.workspaces).deployments()


def nearest_places(region: BaseGeometry, points_mm: Floats) -> Floats:
    """Return the place of a region that is nearest to each point, shape (n, 2)."""
    if len(points_mm) == 0:
        return points_mm
    lines = shapely.shortest_line(region, shapely.points(points_mm))
    return np.asarray(shapely.get_coordinates(lines)[::2])


_PRINTED_STEPS = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3)], dtype=np.float64)


def printed_pose(trial: PoseTrial, row: Floats) -> Floats:
    """Return a pose as it is printed, shape (3,), its place rounded to where the trunk has room.

    Bases stand where the trunk just touches a wall; rounded to the nearest, half would stand in it.
    """
    printed_decimals = 2  # of millimetres and degrees of a pose, as it is printed
    places = np.round(np.round(row[:2], printed_decimals) + 0.01 * _PRINTED_STEPS, printed_decimals)
    order = np.argsort(np.hypot(*(places - row[:2]).T), kind="stable")
    has_room = trial.prepared.terrain.have_room(places[order], trial.radius_mm)
    place = places[order[np.argmax(has_room)]]
    heading_deg = round(deg(float(row[2])) % 360.0, printed_decimals) % 360.0
    return np.array([*place, rad(heading_deg)])


def pose_of(row: Iterable[float]) -> Pose:
    """Return the pose of a row of `printed_pose`: what is printed is what was tried."""
    x_mm, y_mm, heading_rad = map(float, row)
    return Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=heading_rad)


# --- Where a base may stand ---------------------------------------------------------------------

LEAST_LOOK_MM = 1.0
"""A heading points into the room if a step of half the trunk's radius, at least this, does."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaseRegion:
    """Where a base may stand on a map."""

    room: BaseGeometry  # where the trunk has room
    # border: lines next to the outer walls; there the base stands outside, and the trunk grows in
    border: BaseGeometry
    # starts, areas: lines and points, and polygons, where every heading is allowed
    starts: BaseGeometry
    areas: BaseGeometry
    step_mm: float  # a heading points into the room if a step of this length does
    turns_rad: tuple[float, float] | None  # middle and half-width of the headings; None: all
    words: str  # what it is, for people

    @classmethod
    def of(cls, trial: PoseTrial, where: str) -> "BaseRegion":
        """Return where a base may stand.

        Parameters
        ----------
        where
            One of `WHERE`, or a start as text, see `vinefab.model.start`.

        Raises
        ------
        BadInputError
            If there is no such place with room for the trunk.
        """
        room, world, turns = trial.room, trial.prepared.world, None
        border: BaseGeometry = shapely.GeometryCollection()
        starts, areas = border, border
        if where == "border":
            border = _border(trial)
            starts, areas = _start_places(trial, world)
            words = "along the border of the free space, and where the map's starts are"
        elif where == "anywhere":
            areas, words = room, "wherever the trunk has room"
        elif where == "starts":
            starts, areas = _start_places(trial, world)
            words = "where the map's starts are"
        else:
            try:
                place = start_from(where, "--where")
            except BadInputError as error:
                allowed = f"{', '.join(WHERE)}, or {error.allowed}"
                raise BadInputError("--where", where, allowed) from None
            there = with_starts(world, [place], "--where")
            starts, areas = _start_places(trial, there)
            words, start = f"at {where}", there.starts[0]
            if start.spread_heading_rad > 0.0:
                turns = (start.pose.heading_rad, start.spread_heading_rad)
        if border.is_empty and starts.is_empty and areas.is_empty:
            problem = f"{where} has no room for the trunk on map {world.name!r}"
            raise UnfitInputError("--where", problem, "name another part, such as anywhere")
        return cls(
            room=room,
            border=border,
            starts=starts,
            areas=areas,
            step_mm=max(0.5 * trial.radius_mm, LEAST_LOOK_MM),
            turns_rad=turns,
            words=words,
        )

    @property
    def headings_rad(self) -> Floats:
        """Headings that are tried first, shape (h,)."""
        if self.turns_rad is None:
            return 2.0 * math.pi * np.arange(HEADINGS) / HEADINGS
        middle, half = self.turns_rad
        return np.asarray(middle + half * np.linspace(-1.0, 1.0, HEADINGS))

    def spacing_mm(self, count: int) -> float:
        """Return how far apart about so many places of it lie."""
        length_mm, area_mm2 = self.border.length + self.starts.length, self.areas.area
        root = math.sqrt(length_mm**2 + 4.0 * count * area_mm2)
        return max((length_mm + root) / (2.0 * count), 1e-3)

    def places_mm(self, spacing_mm: float, phase: float = 0.0) -> Floats:
        """Return places all over it, shape (n, 2); ``phase`` shifts them, in steps."""
        lines = [[line] for line in shapely.get_parts(self.starts)]
        along = [
            _places_along(some, spacing_mm, phase)
            for some in (list(shapely.get_parts(self.border)), *lines)
        ]
        return np.concatenate([*along, _places_in(self.areas, spacing_mm, phase)])

    def allow(self, poses: Floats) -> NDArray[np.bool_]:
        """Tell which poses of places in it may be: all, but on the border those that point in."""
        allowed = np.ones(len(poses), dtype=np.bool_)
        if self.turns_rad is not None:
            middle, half = self.turns_rad
            off = np.angle(np.exp(1j * (poses[:, 2] - middle)))
            allowed = np.abs(off) <= half + 1e-9
        if self.border.is_empty:
            return allowed
        points = shapely.points(poses[:, :2])
        on_border = np.ones(len(poses), dtype=np.bool_)
        for part in (self.starts, self.areas):
            if not part.is_empty:
                on_border &= shapely.distance(part, points) > 1e-6
        heading = poses[on_border, 2]
        step = self.step_mm * np.column_stack([np.cos(heading), np.sin(heading)])
        allowed[on_border] = shapely.contains_xy(self.room, poses[on_border, :2] + step)
        return allowed

    def nearest_mm(self, points_mm: Floats) -> Floats:
        """Return the nearest place of it to each point, shape (n, 2)."""
        found, away_mm = points_mm.copy(), np.full(len(points_mm), np.inf)
        if not self.areas.is_empty:
            away_mm[shapely.contains_xy(self.areas, points_mm)] = 0.0
        for part in (self.border, self.starts, self.areas):
            if part.is_empty:
                continue
            near = nearest_places(part, points_mm)
            gap_mm = np.hypot(*(near - points_mm).T)
            closer = gap_mm < away_mm
            found[closer], away_mm[closer] = near[closer], gap_mm[closer]
        return found


def _places_along(lines: Sequence[BaseGeometry], spacing_mm: float, phase: float) -> Floats:
    """Return places along some lines, one after the other, or points themselves."""
    spots = [line for line in lines if line.geom_type == "Point"]
    lines = [line for line in lines if line.length > 0.0]
    if not lines:
        return np.asarray(shapely.get_coordinates(spots))
    ends = np.cumsum([line.length for line in lines])
    count = max(1, round(float(ends[-1]) / spacing_mm))
    along_mm = (np.arange(count) + (0.5 + phase) % 1.0) * ends[-1] / count
    which = np.minimum(np.searchsorted(ends, along_mm, side="right"), len(lines) - 1)
    on_line = along_mm - np.concatenate([[0.0], ends])[which]
    found = shapely.line_interpolate_point(np.array(lines, dtype=np.object_)[which], on_line)
    return np.asarray(shapely.get_coordinates(found))


def _places_in(areas: BaseGeometry, spacing_mm: float, phase: float) -> Floats:
    """Return the points of a square grid, laid evenly over the areas' box, that are in them."""
    found = [np.empty((0, 2))]
    if areas.is_empty:
        return found[0]
    x_min, y_min, x_max, y_max = areas.bounds
    axes = []
    for low, high in ((x_min, x_max), (y_min, y_max)):  # as far from the ends at both
        count = max(1, round((high - low) / spacing_mm))
        half = np.arange(count) - 0.5 * (count - 1) + phase
        axes.append(0.5 * (low + high) + (high - low) / count * half)
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    for part in shapely.get_parts(areas):
        inside = grid[shapely.contains_xy(part, grid)]
        if not len(inside):
            inside = shapely.get_coordinates(shapely.point_on_surface(part))
        found.append(inside)
    return np.concatenate(found)


def _parts(shape: BaseGeometry, *kinds: str) -> BaseGeometry:
    """Return the parts of a shape that are of some kinds."""
    flat = shapely.get_parts(shapely.get_parts(shape))
    return shapely.GeometryCollection([part for part in flat if part.geom_type in kinds])


def _border(trial: PoseTrial) -> BaseGeometry:
    """Return where a trunk that comes in from outside has its base: next to the outer walls."""
    free, room = trial.prepared.terrain.free_space(), trial.room
    outer = shapely.get_exterior_ring(shapely.get_parts(free))
    # Arcs around corners are polygons, a little nearer to the wall or farther from it.
    reach_mm = trial.radius_mm + 5e-3 * max(trial.radius_mm, LEAST_LOOK_MM)
    beside = beside_walls(outer, reach_mm)
    along = _parts(shapely.intersection(shapely.boundary(room), beside), "LineString")
    merged = shapely.line_merge(shapely.MultiLineString(list(shapely.get_parts(along))))
    return shapely.GeometryCollection(list(shapely.get_parts(merged)))


def _start_places(trial: PoseTrial, world: Map) -> tuple[BaseGeometry, BaseGeometry]:
    """Return where a map's starts are: lines and points, and areas, where there is room."""
    shapes = list[BaseGeometry]()
    for start in world.starts:
        x, y, across, up = start.pose.x_mm, start.pose.y_mm, start.spread_x_mm, start.spread_y_mm
        if start.area is not None:
            # Where the trunk has no room in it, that start is left out, not refused.
            shapes += start_pieces(start, trial.prepared.terrain.free_space())
        elif across and up:
            shapes.append(shapely.box(x - across, y - up, x + across, y + up))
        elif across or up:
            shapes.append(shapely.LineString([(x - across, y - up), (x + across, y + up)]))
        else:
            shapes.append(shapely.Point(x, y))
    flat = [part for shape in shapes for part in shapely.get_parts(trial.room & shape)]
    both = shapely.GeometryCollection(flat)
    areas = shapely.union_all(shapely.get_parts(_parts(both, "Polygon")))
    return _parts(both, "Point", "LineString"), _parts(areas, "Polygon")


# --- The search ---------------------------------------------------------------------------------

HEADINGS = 36
"""Headings that are tried first at every place."""

OVERALL, NARROWED, REFINED = 0.6, 0.2, 0.17
"""Shares of the deployments: all over the map, of the best there, around the best of these."""

FEWEST_DRAWS, MOST_DRAWS = 4, 64
"""Draws at every pose of the first round: more where there are few poses."""


LAST_POSES, ROUNDS = 5, 3

FIRST_SEARCH = 5_000
"""Deployments of the first search, and of the second."""

JUDGED_DRAWS = 1_024
"""Draws at which the poses of several searches are held against each other."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseLandscape:
    """Expected scores all over a region: the first round of a search."""

    places_mm: Floats  # shape (p, 2)
    spacing_mm: float  # how far apart they lie
    headings_rad: Floats  # shape (h,)
    scores: Floats  # mean score, NaN where a pose is not allowed, shape (p, h)
    draws: int  # deployments behind each

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which places have an allowed heading, shape (p,)."""
        return np.asarray(np.isfinite(self.scores).any(axis=1))

    @property
    def best_scores(self) -> Floats:
        """Mean score at each place's best heading, NaN without any, shape (p,)."""
        return np.where(
            self.known, np.where(np.isnan(self.scores), -np.inf, self.scores).max(1), np.nan
        )

    @property
    def best_headings_rad(self) -> Floats:
        """Each place's best heading, shape (p,)."""
        best = np.where(np.isnan(self.scores), -np.inf, self.scores).argmax(axis=1)
        return np.asarray(self.headings_rad[best])

    @property
    def poses(self) -> Floats:
        """Every pose, shape (p * h, 3)."""
        places = np.repeat(self.places_mm, len(self.headings_rad), axis=0)
        return np.column_stack([places, np.tile(self.headings_rad, len(self.places_mm))])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseSearch:
    """What a search has found."""

    landscape: PoseLandscape  # of its finest round all over the region
    pose: Floats  # the best found: x and y (mm), heading (rad); shape (3,)
    estimate: float  # mean score that the search chose it by: better than it is
    draws: int  # deployments behind that
    deployments: int  # of the whole search
    words: str  # where bases may stand
    starts: int = 1  # searches of their own that it consists of


@dataclass(slots=True)
class _Field:
    """Poses with the scores that they have so far; all at the same draws."""

    poses: Floats  # shape (n, 3)
    total: Floats  # sum of scores, shape (n,)
    draws: int

    @property
    def mean(self) -> Floats:
        return self.total / self.draws

    def best(self, count: int) -> "_Field":
        """Return the best ones, the best first; of equal ones the first."""
        order = np.argsort(-self.total, kind="stable")[:count]
        return _Field(self.poses[order], self.total[order], self.draws)

    def apart(self, count: int, away_mm: float, away_rad: float) -> "_Field":
        """Return the best ones of which no two are alike."""
        taken = list[int]()
        for index in np.argsort(-self.total, kind="stable").tolist():
            if len(taken) == count:
                break
            there = self.poses[taken]
            near = np.hypot(*(there[:, :2] - self.poses[index, :2]).T) < away_mm
            turned = np.abs(np.angle(np.exp(1j * (there[:, 2] - self.poses[index, 2])))) < away_rad
            if not (near & turned).any():
                taken.append(index)
        rows: Ints = np.array(taken, dtype=np.int64)
        return _Field(self.poses[rows], self.total[rows], self.draws)


def search_poses(
    trial: PoseTrial,
    task: Task,
    region: BaseRegion,
    errors: PoseErrors,
    deployments: int,
    count: DeploymentCounter = _count_nothing,
) -> PoseSearch:
    """Search a region for the pose with the best mean score, in searches from several starts.

    The searches have 1, 1, 2, 3, 5, ... times `FIRST_SEARCH` deployments, each a separate grid.
    So a longer search contains every shorter one, and it keeps the pose of that unless another is
    clearly better at the same draws: more deployments never find a pose that is clearly worse.

    Parameters
    ----------
    task
        In the form for searching.
    deployments
        At most about so many in all; one search is always made.
    """
    draws, done = errors.even(JUDGED_DRAWS), [0]

    def scored(poses: Floats, draws: PoseDraws) -> Floats:
        found = trial.scores(task, poses, draws, count)
        done[0] += found.size
        return found

    budgets, scores = _budgets(deployments), np.empty(0)
    for start, budget in enumerate(budgets):
        # The first search is never starved; the others pay for being judged.
        left = budget - JUDGED_DRAWS if start else budget
        landscape, pose = _search_from(scored, region, errors, left, start)
        (judged,) = scored(pose[None], draws)
        gains = judged - scores if start else judged
        # Clearly better: by more than two errors of the difference.
        if not start or gains.mean() > 2.0 * gains.std() / math.sqrt(len(gains)):
            best, scores = pose, judged
    return PoseSearch(
        landscape=landscape,
        pose=best,
        estimate=float(scores.mean()),
        draws=JUDGED_DRAWS,
        deployments=done[0],
        words=region.words,
        starts=len(budgets),
    )


def _budgets(deployments: int) -> list[int]:
    """Return how many deployments each search has: a longer row begins with the shorter one.

    >>> _budgets(8_000), _budgets(20_000), _budgets(100_000)
    ([5000], [5000, 5000, 10000], [5000, 5000, 10000, 15000, 25000, 40000])
    """
    found, budget, following = [min(deployments, FIRST_SEARCH)], FIRST_SEARCH, 2 * FIRST_SEARCH
    while sum(found) + budget <= deployments:
        found.append(budget)
        budget, following = following, budget + following
    return found


_Scored = Callable[[Floats, PoseDraws], Floats]
"""Returns the scores of poses at draws, shape (n, k)."""


def _search_from(
    scored: _Scored, region: BaseRegion, errors: PoseErrors, deployments: int, start: int
) -> tuple[PoseLandscape, Floats]:
    """Search all over a region, then around the best; ``start`` numbers the grid."""
    last_draws = 256  # draws that the last few poses are tried at
    draws = errors.even(last_draws)

    def tried(field_: _Field, until: int) -> _Field:
        if until <= field_.draws:
            return field_
        more = scored(field_.poses, draws.part(field_.draws, until))
        return _Field(field_.poses, field_.total + more.sum(axis=1), until)

    golden = 0.618034  # multiples of the golden section shift the grids of searches evenly
    phase = start * golden % 1.0
    landscape = _landscape(scored, region, draws, OVERALL * deployments, phase)
    flat = landscape.scores.ravel()
    known = np.isfinite(flat)
    found = _Field(landscape.poses[known], flat[known] * landscape.draws, landscape.draws)
    narrowing = (16, 64)  # draws that the best poses are tried at, round by round
    for until in narrowing:
        if until > found.draws:
            share = NARROWED * deployments / len(narrowing)
            found = tried(found.best(max(LAST_POSES, int(share / (until - found.draws)))), until)
    found = _refined(found, region, landscape, REFINED * deployments, tried)
    last = tried(found.best(LAST_POSES), last_draws).best(1)
    return landscape, last.poses[0]


def _landscape(
    scored: _Scored, region: BaseRegion, draws: PoseDraws, deployments: float, phase: float
) -> PoseLandscape:
    """Return the mean scores all over a region, on a grid that is shifted by a phase."""
    headings = region.headings_rad
    headings = headings + phase * (headings[1] - headings[0])
    # On the border half of the headings point outward.
    per_place = HEADINGS * FEWEST_DRAWS * (1.0 if region.border.is_empty else 0.5)
    finest_mm = max(0.5 * float(np.abs(draws.offset_mm).max()), LEAST_LOOK_MM)
    spacing_mm = max(region.spacing_mm(max(1, int(deployments / per_place))), finest_mm)
    places = region.places_mm(spacing_mm, phase)
    poses = np.column_stack([np.repeat(places, HEADINGS, axis=0), np.tile(headings, len(places))])
    allowed = region.allow(poses)
    most = int(deployments / max(1, allowed.sum()))
    number_of_draws = int(np.clip(most, FEWEST_DRAWS, MOST_DRAWS))
    scores = np.full(len(poses), np.nan)
    some = draws.part(0, number_of_draws)
    scores[allowed] = scored(poses[allowed], some).mean(axis=1)
    return PoseLandscape(
        places_mm=places,
        spacing_mm=spacing_mm,
        headings_rad=headings,
        scores=scores.reshape(-1, HEADINGS),
        draws=number_of_draws,
    )


AROUND = np.array(
    [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    + [(x, y, 0) for x in (-0.7, 0.7) for y in (-0.7, 0.7)]
)
"""Steps around a pose: in place and in heading."""


def _refined(
    found: _Field,
    region: BaseRegion,
    landscape: PoseLandscape,
    deployments: float,
    tried: Callable[[_Field, int], _Field],
) -> _Field:
    """Return the best poses after steps around them that become smaller round by round."""
    turn = abs(float(landscape.headings_rad[1] - landscape.headings_rad[0]))
    step = np.array([landscape.spacing_mm, landscape.spacing_mm, turn]) / 2.0
    parents = max(1, int(deployments / (ROUNDS * len(AROUND) * max(found.draws, 1))))
    for _ in range(ROUNDS):
        best = found.apart(parents, float(step[0]), float(step[2]))
        around = (best.poses[:, None] + AROUND * step).reshape(-1, 3)
        around[:, :2] = region.nearest_mm(around[:, :2])
        around = around[region.allow(around)]
        if len(around):
            more = tried(_Field(around, np.zeros(len(around)), 0), found.draws)
            found = _Field(
                np.concatenate([found.poses, more.poses]),
                np.concatenate([found.total, more.total]),
                found.draws,
            )
        step = step / 2.0
    return found
