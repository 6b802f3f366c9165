"""The panels of many maps and of contacts: how a design does on a family of maps."""

import base64
import itertools
import json
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from threading import Thread
from typing import Annotated, Any

import numpy as np
import shapely
from annotated_types import Interval
from pydantic import Field
from typing_extensions import Doc

from vinefab.core.errors import BrokenPluginError
from vinefab.core.hashing import fingerprint
from vinefab.core.progress import Progress, announce, each
from vinefab.core.statistics import PAIRED_TAILS, group_means, mean_interval
from vinefab.core.table import Table, validated
from vinefab.core.validation import Floats
from vinefab.core.view import Rows, plain_blocks
from vinefab.growth.batch import Batch, GrowthBlock, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design
from vinefab.model.map import Map, Pose, Start
from vinefab.model.start import start_record
from vinefab.pages.panel import HEAT_COLOURS
from vinefab.pages.plan import body_cells
from vinefab.pages.plan_svg import ground_svg, robot_svg, view_box
from vinefab.prediction.family_deployments import PreparedFamily
from vinefab.prediction.measures import COVERAGE, REACH, SEEN, Measure
from vinefab.prediction.prediction_width import ContactRange, contact_range
from vinefab.studio.live_answers import not_followed, prepared_map
from vinefab.studio.state import PAGE, Family, StudioState, world_of
from vinefab.tasks import make_task
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.evaluate import PreparedMap, poses_on
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import (
    Task,
    TaskOutcomes,
    check_on_map,
    concatenated_outcomes,
    outcomes,
    search_form,
)

QUICK_S, FIRST_S = 0.15, 0.5
"""Time to build walls for new widths while something is dragged, and before the simulator is
compiled: some maps must do then."""

LEAST_MAPS = 4
"""Number of maps that are always evaluated."""

MOST_FAMILY_INTERPRETED = 1500
"""Branches that the interpreter grows, in a fifth of a second, until the simulator is compiled."""

MOST_WALLS = 1000
"""Pairs of a map and a body radius whose walls are kept, half a megabyte each."""

SILENT_S = 0.3
"""Shorter work is not announced."""

COMPILING = "compiling the simulator, once on this computer"

_Score = Annotated[float, Interval(ge=-1e12, le=1e12)]


class FamilyRequest(Table):
    """The request of the panel."""

    quick: Annotated[bool, Doc("something is dragged: fast areas, as many maps as time allows")] = (
        False
    )
    soon: Annotated[bool, Doc("as many maps as the interpreter can do until code is loaded")] = (
        False
    )
    compiled: Annotated[bool, Doc("false: another process compiles just now, not done twice")] = (
        True
    )
    heat: Annotated[bool, Doc("the page shows where bodies lie")] = True
    have: Annotated[
        tuple[str, ...], Field(strict=False), Doc("keys of maps whose ground the page holds")
    ] = ()
    draw: Annotated[
        tuple[str, ...] | None, Field(strict=False), Doc("keys of maps that it shows; null: all")
    ] = None
    scores_before: Annotated[
        Mapping[str, _Score],
        Field(alias="before"),
        Doc("by the maps' keys, of the version to compare with"),
    ] = {}


def family_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scores of a design on many maps: an entry for each, and their statistics.

    Scores are those of `vinefab.score` on the same maps and as many poses, all simulated.

    Parameters
    ----------
    state
        What is open on the page; its map and pose play no part.
    ask
        A `FamilyRequest`.
    """
    asked = validated(FamilyRequest, ask, PAGE)
    places = _CACHE.places(state.family)
    trial = _tried(state, asked, places)
    by_map = [list(trial.deployments[rows]) for rows in trial.rows]
    means = trial.means
    before = asked.scores_before
    pairs = [(before[key], mean) for key, mean in means.items() if key in before]
    widths_mm = state.growth.drawn_widths_mm(state.design.tree)
    entries: list[dict[str, Any]] = []
    for place in places:
        world, ground = place.prepared.world, None
        if place.key not in asked.have:
            ground = ground_svg(world, detail=False)
        entries.append(
            {
                "key": place.key,
                "name": world.name,
                "source": place.source,
                "view_box": view_box(world.bounds.bounds),
                "ground_svg": ground,
                "robot_svg": None,
                "score": None,
            }
        )
    for entry, grown, rows in zip(entries, by_map, trial.rows, strict=False):
        first, pose = grown[0], grown[0].pose  # the one that is drawn
        shares = [one.grown_mm.sum() / one.tree.total_length_mm for one in grown]
        entry |= {
            "score": means[entry["key"]],
            "scores": trial.scores[rows].tolist(),
            "pose": {"x_mm": pose.x_mm, "y_mm": pose.y_mm, "heading_deg": pose.heading_deg},
            "grown_share": float(np.mean(shares)),
            "branches": len(first.tree),
            "deployed": int(first.deployed.sum()),
        }
        if asked.draw is None or entry["key"] in asked.draw:
            entry["robot_svg"] = robot_svg(first, widths_mm, detail=False)
    is_ideal = state.task == Anchoring.name and state.design.build.pouch is None
    # Scores while something is dragged count as equal within this: fast areas are approximations.
    quick_error = 1e-3
    return {
        "task": state.task,
        "title": f"{state.task}, ideal case" if is_ideal else state.task,
        "poses": state.family.poses,
        "standing": "simulated",
        "quick": asked.quick,
        "compiling": COMPILING if trial.compiling else None,
        "maps": entries,
        "evaluated": len(by_map),
        "environments": list(ENVIRONMENTS.names()),
        "distribution": _distribution(list(means.values()), list(before.values())),
        "difference": _difference(pairs, quick_error if asked.quick else 0.0),
        "grown_share": float(np.mean([entry["grown_share"] for entry in entries[: len(by_map)]])),
        "heat": heat_cells(places, by_map, widths_mm) if asked.heat else None,
    }


# --- Maps, prepared once ------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FamilyMap:
    """One map of a family."""

    key: str  # names the map and its content: another one after its file has changed
    source: Mapping[str, Any]  # as in the page's state
    prepared: PreparedMap

    def start_of(self, index: int) -> Pose:
        """Return the middle of the range that a pose was drawn from."""
        starts = self.prepared.world.starts
        return starts[index % len(starts)].pose


@dataclass(slots=True)
class _Cache:
    """Maps and their walls, kept: designs change often, maps seldom."""

    places_of: dict[str, FamilyMap] = field(default_factory=dict)  # by their source, as text
    walls: set[tuple[str, float]] = field(default_factory=set)  # keys and radii built so far
    # the latest, by its maps and radii: every set of radii is one more copy of all walls
    terrains: dict[tuple[Any, ...], TerrainSet] = field(default_factory=dict)

    def places(self, family: Family) -> list[FamilyMap]:
        """Return the maps of a family, prepared."""
        if family.files:
            sources: list[dict[str, Any]] = [{"file": p} for p in dict.fromkeys(family.files)]
        else:
            seeds = range(family.seed, family.seed + family.count)
            sources = [{"environment": family.environment, "seed": seed} for seed in seeds]
        places = list[FamilyMap]()
        for source in each("maps prepared", sources):
            name, world = json.dumps(source), world_of({"source": source})
            held = self.places_of.get(name)
            if held is None or held.prepared.world is not world:
                solid = shapely.to_wkb([world.bounds, *world.obstacles], hex=True).tolist()
                starts = [start_record(start) for start in world.starts]
                key = f"{world.name}:{fingerprint(name, solid, starts)}"
                held = FamilyMap(key=key, source=source, prepared=PreparedMap.of(world))
                self.places_of[name] = held
            places.append(held)
        return places

    def with_walls(
        self,
        places: Sequence[FamilyMap],
        radii_mm: Sequence[float],
        most_s: float,
    ) -> Sequence[FamilyMap]:
        """Build the walls for some body radii; return the maps that have them when time is up."""
        if len(self.walls) > MOST_WALLS:
            self.places_of = {json.dumps(place.source): place for place in places}
            for place in places:
                place.prepared.terrain.keep_only(radii_mm)
            self.walls = {(place.key, radius_mm) for place in places for radius_mm in radii_mm}
        began = time.monotonic()
        for index, place in enumerate(each("walls of maps for these widths", places)):
            if index >= LEAST_MAPS and time.monotonic() - began > most_s:
                return places[:index]
            for radius_mm in radii_mm:
                place.prepared.terrain.walls(radius_mm)
                self.walls.add((place.key, radius_mm))
        return places

    def terrain_set(self, places: Sequence[FamilyMap], radii_mm: Sequence[float]) -> TerrainSet:
        """Return the terrains of some maps, whose walls are put one after the other but once."""
        wanted = (*(place.key for place in places), *radii_mm)
        if wanted not in self.terrains:
            terrains = TerrainSet([place.prepared.terrain for place in places])
            self.terrains = {wanted: terrains}
        return self.terrains[wanted]


_CACHE = _Cache()


# --- Growth and scores --------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Trial:
    """A design's deployments on the maps that there was time for."""

    places: Sequence[FamilyMap]
    counts: Sequence[int]  # poses on each
    deployments: Sequence[Deployment]  # map by map, pose by pose
    scores: Floats  # one for each
    compiling: bool  # whether the interpreter grew them

    @property
    def rows(self) -> list[slice]:
        """The deployments of each map, as slices."""
        ends = np.cumsum([0, *self.counts]).tolist()
        return [slice(one, two) for one, two in itertools.pairwise(ends)]

    @property
    def means(self) -> dict[str, float]:
        """Mean score on each map, by its key."""
        keys = [place.key for place in self.places]
        groups = np.repeat(np.arange(len(keys)), self.counts).tolist()
        return dict(zip(keys, group_means(self.scores, groups).tolist(), strict=True))


def _tried(state: StudioState, asked: FamilyRequest, places: Sequence[FamilyMap]) -> _Trial:
    """Grow a design and score it, on all maps or, where that would take too long, on the first."""
    task = make_task(state.task)
    compiled = _COMPILER.has(task, wait=not (asked.quick or asked.soon))
    count = state.family.poses
    if not compiled:
        most = MOST_FAMILY_INTERPRETED // (count * state.design.branch_count)
        places = places[: max(LEAST_MAPS, most)]
    options, plans = state.growth, Plans.of([state.grown], state.growth)
    radii_mm = plans.spans.radii_mm
    most_s = math.inf if compiled else FIRST_S
    most_s = QUICK_S if asked.quick else most_s
    places = _CACHE.with_walls(places, radii_mm, most_s)
    for place in places:
        check_on_map(task, place.prepared.world, place.prepared.context)
    prepared = [place.prepared for place in places]
    poses = poses_on(prepared, count, range(len(places)), repeats=options.draws)
    launches = Launches.of(_CACHE.terrain_set(places, radii_mm), poses)
    batch = Batch(plans, launches, options, engine="kernel" if compiled else "interpreted")
    chosen = search_form(task) if asked.quick and compiled else task
    scores, deployments = _evaluated(batch, chosen, [place.context for place in prepared])
    if asked.compiled:
        _COMPILER.start(task)
    return _Trial(
        places=places,
        counts=[len(poses_here) for poses_here in poses],
        deployments=deployments,
        scores=scores,
        compiling=not compiled,
    )


_BLOCK = 8
"""Deployments between two words of progress."""


def _evaluated(
    batch: Batch, task: Task, contexts: Sequence[MapContext]
) -> tuple[Floats, list[Deployment]]:
    """Return the score of every growth of a batch, and the growths."""

    def both(block: GrowthBlock) -> tuple[TaskOutcomes, list[Deployment]]:
        grown = [block.deployment(index) for index in range(len(block))]
        return outcomes(task, block, contexts), grown

    parts, deployments = list[TaskOutcomes](), list[Deployment]()
    for scored, grown in batch.each(both, size=_BLOCK):
        parts.append(scored)
        deployments += grown
    return concatenated_outcomes(parts).score, deployments


@dataclass(slots=True)
class _Compiler:
    """Compiled code, loaded in a thread: a second, or half a minute where none is cached."""

    threads: dict[str, Thread] = field(default_factory=dict)  # by the task that they load

    def start(self, task: Task) -> None:
        """Begin to load the code of a task, unless that has been done."""

        def load() -> None:  # by growing a robot on an empty map and scoring it
            start = Start(pose=Pose(x_mm=500.0, y_mm=500.0, heading_rad=0.0))
            bounds = shapely.box(0.0, 0.0, 1000.0, 1000.0)
            room = PreparedMap.of(Map(name="room", bounds=bounds, starts=(start,)))
            vine = Design(name="vine", trunk_length_mm=100.0, build=Build.standard(1))
            options = GrowthOptions()
            launches = Launches.of(TerrainSet([room.terrain]), [[start.pose]])
            batch = Batch(Plans.of([vine], options), launches, options)
            with suppress(BrokenPluginError):  # which the answer names
                _evaluated(batch, search_form(task), [room.context])

        if task.name not in self.threads:
            self.threads[task.name] = Thread(target=load, daemon=True)
            self.threads[task.name].start()

    def has(self, task: Task, *, wait: bool) -> bool:
        """Tell whether the code of a task is loaded; one without a slower form is waited for."""
        if wait or search_form(task) == task:
            self.start(task)
            if self.threads[task.name].is_alive():
                announce(Progress(phase=COMPILING))
                self.threads[task.name].join()
        return task.name in self.threads and not self.threads[task.name].is_alive()


_COMPILER = _Compiler()


# --- What they say together ---------------------------------------------------------------------

QUANTILES_PERCENT = (5, 25, 50, 75, 95)

BINS = 12
"""About so many bins stand between the least and the greatest score."""


def _distribution(scores: Sequence[float], before: Sequence[float]) -> dict[str, Any]:
    """Return the distribution of scores over maps, in bins shared with the version before."""
    low, high = mean_interval(scores)
    quantiles = np.percentile(scores, QUANTILES_PERCENT).tolist()
    least, most = min([*scores, *before]), max([*scores, *before])
    raw = max((most - least) / BINS, 1e-3 * max(abs(most), 1e-3))
    decade = 10.0 ** math.floor(math.log10(raw))
    step = decade * next(part for part in (1.0, 2.0, 5.0, 10.0) if part * decade >= raw)
    first = math.floor(least / step)  # of the bins, which have round edges
    count = math.floor(most / step) - first + 1
    counts, counts_before = (
        np.bincount(np.floor(np.divide(values, step)).astype(int) - first, minlength=count)
        for values in (scores, before)
    )
    return {
        "maps": len(scores),
        "mean": float(np.mean(scores)),
        "low": _finite(low),
        "high": _finite(high),
        "quantiles": dict(zip(map(str, QUANTILES_PERCENT), quantiles, strict=True)),
        "bins": {
            "low": first * step,
            "step": step,
            "counts": counts.tolist(),
            "before": counts_before.tolist(),
        },
    }


def _difference(pairs: Sequence[tuple[float, float]], within: float) -> dict[str, Any] | None:
    """Return the paired difference to the version before, None where no map is shared."""
    if not pairs:
        return None
    gains = np.array([after - before for before, after in pairs])
    low, high = mean_interval(gains, tails=PAIRED_TAILS)
    return {
        "maps": len(gains),
        "mean": float(gains.mean()),
        "low": _finite(low),
        "high": _finite(high),
        "better": int((gains > within).sum()),
        "worse": int((gains < -within).sum()),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


# --- Where bodies lie ---------------------------------------------------------------------------

HEAT_CELLS = 320
"""Cells along the longer side that bodies are drawn in; every four make one that is shown."""


def heat_cells(
    places: Sequence[FamilyMap],
    by_map: Sequence[Sequence[Deployment]],
    widths_mm: Floats,
) -> dict[str, Any]:
    """Return the share of the maps on which a body covers each place, as seen from the start.

    Maps are laid on each other with their starts at the origin, launching upwards.

    Parameters
    ----------
    places
        All maps of the family.
    by_map
        Deployments on each of the first of them.

    Returns
    -------
    dict
        ``share``: 0 to 255 for each cell, row by row from below, in base64; 0 means on no map.
    """
    corners = np.concatenate(
        [
            _as_from_start(
                shapely.get_coordinates(shapely.box(*place.prepared.world.bounds.bounds)),
                start.pose,
            )
            for place in places
            for start in place.prepared.world.starts
        ]
    )
    low_mm, size_mm = corners.min(axis=0), np.ptp(corners, axis=0)
    cell_mm = float(size_mm.max()) / HEAT_CELLS
    columns, rows = (2 * np.ceil(size_mm / (2.0 * cell_mm)).astype(int)).tolist()
    total = np.zeros((rows, columns))
    for place, grown in zip(places, by_map, strict=False):
        for index, deployment in enumerate(grown):
            moved_mm = _as_from_start(deployment.points_mm, place.start_of(index))
            moved = replace(deployment, points_mm=moved_mm)
            corner = (float(low_mm[0]), float(low_mm[1]))
            cells = body_cells(moved, widths_mm, corner, cell_mm, (rows, columns))
            total += cells / (len(grown) * len(by_map))
    share = total.reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3))
    sizes = {tuple(np.round(place.prepared.world.size_mm, 3).tolist()) for place in places}
    return {
        "low_mm": low_mm.tolist(),
        "cell_mm": 2.0 * cell_mm,
        "columns": columns // 2,
        "rows": rows // 2,
        "share": base64.b64encode(np.ceil(255.0 * share - 1e-9).astype(np.uint8)).decode(),
        "most": float(share.max()),
        "maps": len(by_map),
        "same_size": len(sizes) == 1,
        "colours": HEAT_COLOURS,
    }


def _as_from_start(points_mm: Floats, start: Pose) -> Floats:
    """Return points moved and turned so that the start is the origin and launches upwards."""
    turn = math.pi / 2.0 - start.heading_rad
    cosine, sine = math.cos(turn), math.sin(turn)
    away = points_mm - np.array([start.x_mm, start.y_mm])
    return np.asarray(away @ np.array([[cosine, sine], [-sine, cosine]]))


def width_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG001  one form
    """Return the ends of coverage and reach from the page's start (simulated), as in a report.

    Returns
    -------
    dict
        ``text``: the first measure in one line; ``blocks``: a table of all; both empty where
        nothing grows.
    """
    if state.world is None or state.start is None or not_followed(state.design):
        return {"text": "", "blocks": []}
    family = PreparedFamily(
        label="the open map", maps=(prepared_map(state),), poses=((state.start,),)
    )
    found = contact_range(state.grown, family, state.growth)
    low, high = (f"{angle:g}" for angle in (found.angles_deg[0], found.angles_deg[-1]))
    headings = (
        f"half-angle {low} to {high} deg",
        *(
            f"{rule.option.replace('_', ' ')} {rule.choices[0]} → {rule.choices[-1]}"
            for rule in found.rules
        ),
    )
    table = Rows(
        caption="From this start, over what is not known of contacts (simulated; "
        f"{found.standing.partition(':')[0]})",
        headings=("measure", *headings),
        rows=tuple((m.label, *_ends(found, m)) for m in (COVERAGE, SEEN, REACH)),
    )
    first = ", ".join(
        f"{ends} ({heading})"
        for heading, ends in zip(headings, _ends(found, COVERAGE), strict=True)
    )
    return {"text": f"{COVERAGE.title}: {first}", "blocks": plain_blocks([table])}


def _ends(found: ContactRange, measure: Measure) -> tuple[str, ...]:
    """Return a measure's ends over the half-angle, then over each other choice."""
    low, high = (measure.number(value) for value in found.ends(measure))
    values = (rule.values[measure.key] for rule in found.rules)
    rules = (f"{measure.number(v[0].mean)} → {measure.number(v[-1].mean)}" for v in values)
    return (f"{low} to {high}", *rules)
