"""Verbs that simulate: growing, scoring, aiming, comparing, predicting, and maps looked at."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

from vinefab.app.common import (
    BodyWidth,
    Context,
    EnvironmentOptions,
    PageFile,
    PictureFile,
    PoseCount,
    TaskLike,
    TaskParameters,
    UnseenCount,
    UnseenEnvironment,
    Workers,
    context_of,
    families_of,
    note_seen,
    page_path,
    with_origin,
    write_page,
)
from vinefab.core.errors import BadInputError
from vinefab.core.verbs import (
    Force,
    Kind,
    Progress,
    Seed,
    also,
    numbers_from,
    this_call,
    told,
    verb,
)
from vinefab.model.inputs import (
    ContactsLike,
    DesignLike,
    DesignsLike,
    GrowthLike,
    HalfAngle,
    MapLike,
    MapsLike,
    PathText,
    PoseLike,
    RecipeLike,
    StartsLike,
    TargetsLike,
    as_design,
    as_map,
    as_maps,
    as_several,
    as_starts,
    written,
)

if TYPE_CHECKING:
    from vinefab.model.design import Design
    from vinefab.model.score import Score
    from vinefab.prediction.aiming import AimResult
    from vinefab.prediction.comparison import DesignComparison
    from vinefab.prediction.deploy import DeployedDesign
    from vinefab.prediction.predict import Predicted


def _fronts(text: str) -> int | tuple[float, ...]:
    numbers = numbers_from(text)
    steps = len(numbers) == 1 and numbers[0].is_integer() and "." not in text
    return int(numbers[0]) if steps else numbers


def _grown(context: Context) -> list[Design]:
    """Return designs as they deploy, the first with the film of its context."""
    from vinefab.prediction.deploy import as_grown

    first, *others = context.robots
    return [as_grown(first, context.recipe), *map(as_grown, others)]


@verb
def grow(
    design: DesignLike,
    map: MapLike,
    pose: PoseLike | None = None,
    *,
    start: StartsLike = (),
    targets: TargetsLike = (),
    growth: GrowthLike | None = None,
    body: BodyWidth | None = None,
    head_on_half_angle_deg: HalfAngle | None = None,
    contacts: ContactsLike | None = None,
    children_of_stuck: str | None = None,
    out: PictureFile = None,
    label: bool = False,
    history: Annotated[
        int | tuple[float, ...] | None,
        Kind(
            metavar="N|L1,L2,...",
            read=_fronts,
            words=lambda fronts: [
                str(fronts) if isinstance(fronts, int) else ",".join(f"{one!r}" for one in fronts)
            ],
        ),
    ] = None,
    animate: Annotated[PathText | None, written(".svg", ".gif")] = None,
    frames: int = 40,
    force: Force = False,
) -> DeployedDesign:
    """Deploy a design on a map and say where every branch ended.

    Parameters
    ----------
    children_of_stuck
        stop: they never emerge; deploy: they grow from there.
    label
        Write branch ids in the picture.
    history
        Add to the JSON the shapes at these lengths of the growing front, in mm along the body from
        the base; a whole number alone: so many equal steps.
    animate
        The deployment as a moving picture.
    frames
        Frames of the moving picture.

    Returns
    -------
    DeployedDesign
        What `Design.grow` returns is its ``deployment``.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    UnknownNameError
        If there is no such design.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab grow three_level_tree --map grid.geojson --svg grown.svg --animate grows.gif

    >>> from vinefab import maps
    >>> grow("plain_vine", maps.pegs(seed=1)).summary[0].startswith("plain_vine on pegs_1")
    True
    """
    from vinefab.core.limits import positive, whole
    from vinefab.model.map import Pose
    from vinefab.prediction.deploy import MOST_FRAMES, as_grown, deploy

    picture = page_path("out", out, force=force)
    film = page_path("animate", animate, force=force)
    if film is not None:
        whole("frames", frames, 1, MOST_FRAMES)
    if history is not None and (shell := this_call().shell) and not shell.gives_json:
        raise BadInputError("history", history, "to be given together with --json")
    if isinstance(history, int):
        whole("history", history, 1, MOST_FRAMES)
    elif history is not None:
        whole("history", len(history), 1, MOST_FRAMES)
        history = tuple(positive("history", one) for one in history)
    if pose is not None and as_starts(start):
        raise BadInputError("pose", pose, "not together with start")
    context = context_of(
        design,
        worlds=[as_map(map, start=start, targets=targets)],
        targets=targets,
        growth=growth,
        body=body,
        head_on_half_angle_deg=head_on_half_angle_deg,
        contacts=contacts,
        children_of_stuck=children_of_stuck,
    )
    (robot,), here = context.robots, None if pose is None else Pose.of(pose)
    grown = as_grown(robot, context.recipe)
    found = deploy(grown, context.worlds[0], here, context.given)
    if picture is not None:
        write_page(picture, found.picture(picture.suffix, named=label), force=force)
    if film is not None:
        write_page(film, found.animation(film.suffix, frames), force=force)
    return replace(found, fronts=history)


@verb
def score(
    design: DesignLike,
    task: TaskLike | None = None,
    *,
    maps: Annotated[MapsLike, also("--map")],
    start: StartsLike = (),
    targets: TargetsLike = (),
    poses: PoseCount = 3,
    seed: Seed = 0,
    body: BodyWidth | None = None,
    head_on_half_angle_deg: HalfAngle | None = None,
    contacts: ContactsLike | None = None,
    growth: GrowthLike | None = None,
    **parameters: TaskParameters,
) -> Score:
    """Score a design on a task over maps and poses (simulated).

    Parameters
    ----------
    task
        The name of a task, in Python also a task of your own; default: that of the run that found
        the design, with its parameters where you give no others, else reach where all maps have
        targets, else coverage.
    maps
        Maps or paths of map files, at least one: --maps *.geojson. Poses are drawn around their
        starts.
    seed
        Seed of the poses; map ``i`` gets ``seed + i``.

    Returns
    -------
    Score
        One evaluation per map and pose, and composites such as ``composite["mean"]``.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    UnknownNameError
        If there is no such design or task.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab score three_level_tree --task coverage --maps grid.geojson pegs.geojson

    >>> from vinefab import maps
    >>> found = score("plain_vine", "reach", maps=maps.pegs(seed=1), poses=2)
    >>> found.scores.shape
    (2,)
    """
    from vinefab.prediction.deploy import as_grown
    from vinefab.prediction.family_deployments import ScorePlan, score_design_on_task

    worlds = as_maps(maps, start, targets)
    if not worlds:
        raise BadInputError("maps", "none", "at least one map")
    context = context_of(
        design,
        task=task,
        parameters=parameters,
        worlds=worlds,
        targets=targets,
        growth=growth,
        body=body,
        head_on_half_angle_deg=head_on_half_angle_deg,
        contacts=contacts,
    )
    plan = ScorePlan(task=context.task, poses=poses, seed=seed)
    grown = as_grown(context.robots[0], context.recipe)
    found = score_design_on_task(grown, context.worlds, plan, context.growth.options)
    seen = context.run.seen_words(worlds)
    return replace(found, notes=(*found.notes, *([seen] * bool(seen))))


@verb
def aim(
    design: DesignLike,
    world: Annotated[MapLike, also("--map")],
    task: TaskLike | None = None,
    *,
    targets: TargetsLike = (),
    where: Annotated[str, Kind(metavar="PLACE")] = "border",
    robots: int = 1,
    against: DesignLike | None = None,
    alone: bool = False,
    placing_mm: float = 5.0,
    placing_deg: float = 3.0,
    deployments: int = 100_000,
    seed: Seed = 0,
    workers: Workers | None = None,
    body: BodyWidth | None = None,
    head_on_half_angle_deg: HalfAngle | None = None,
    contacts: ContactsLike | None = None,
    growth: GrowthLike | None = None,
    out: Annotated[PathText | None, written(".html", ".htm", ".svg", ".png")] = None,
    progress: Progress = True,
    force: Force = False,
    **parameters: TaskParameters,
) -> AimResult:
    """Search a map for the pose from which a robot scores best (simulated).

    Parameters
    ----------
    task
        As in `score`; without a run: reach.
    where
        Where the base may stand: border (of the free space, growing in, and where the map's starts
        are), anywhere, starts, or the text of a start: 'left side', 'area 0,0 50,480'.
    robots
        How many poses to choose that together cover most; for reach, coverage and tasks with a
        method ``cover``.
    against
        A design to hold it against; default: a plain vine of the same total length.
    alone
        Hold it against nothing.
    placing_mm
        A base is placed within so many mm (assumed).
    placing_deg
        A base is turned within so many degrees (assumed).
    deployments
        About so many for the search of each design.
    seed
        Seed of the fresh deployments that reported scores come from.
    workers
        Threads; no result depends on it. Default: the processors.
    head_on_half_angle_deg
        As in `score`; default: over the range that contacts may have.
    out
        A page or a picture to write.

    Returns
    -------
    AimResult
        The best ``pose``, its expected score ``mean``, the ``poses`` of several robots, and a
        ``summary`` in lines.

    Raises
    ------
    BadInputError
        If a value cannot be used, or there is no room for the trunk.
    ForeignFileError
        If ``out`` is something else.
    UnknownNameError
        If there is no such design or task.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab aim grid_explorer --map grid.geojson --task reach --out aim.html

    >>> from vinefab import maps
    >>> found = aim("plain_vine", maps.pegs(seed=1), deployments=5000)
    >>> 0.0 < found.mean <= 1.0
    True
    """
    from vinefab.prediction.aiming import AimPlan, aim_growth, aim_robots, held_against
    from vinefab.prediction.family_deployments import MapFamily

    page = page_path("out", out, force=force)
    context = context_of(
        [design] if against is None else [design, as_design(against, "against")],
        task=task,
        usual_task="reach",
        parameters=parameters,
        worlds=[as_map(world, "world", targets=targets)],
        targets=targets,
        growth=growth,
        body=body,
        head_on_half_angle_deg=head_on_half_angle_deg,
        contacts=contacts,
    )
    (place,) = context.worlds
    compared = held_against(*_grown(context), alone=alone)
    choice = aim_growth(compared, context.given)
    plan = AimPlan(
        where=where,
        deployments=deployments,
        placing_mm=placing_mm,
        placing_deg=placing_deg,
        robots=robots,
        seed=seed,
        options=choice.options,
    )
    with told("aim", progress) as tell:
        found = aim_robots(compared, place, context.task, plan, tell, workers)
    family = MapFamily(label=place.name, worlds=(place,))
    found = with_origin(replace(found, growth_notes=choice.notes), compared, [family])
    if page is not None:
        is_page = page.suffix.lower() in (".html", ".htm")
        content = found.page() if is_page else found.picture(page.suffix)
        write_page(page, content, force=force)
    return found


@verb
def compare(
    designs: DesignsLike,
    maps: Annotated[MapsLike, also("--map")] = (),
    *,
    start: StartsLike = (),
    environment: UnseenEnvironment | None = None,
    count: UnseenCount = 100,
    options: EnvironmentOptions = None,
    measure: str | None = None,
    poses: PoseCount = 3,
    seed: Seed = 0,
    body: BodyWidth | None = None,
    head_on_half_angle_deg: HalfAngle | None = None,
    contacts: ContactsLike | None = None,
    growth: GrowthLike | None = None,
    out: PageFile | None = None,
    progress: Progress = True,
    force: Force = False,
) -> DesignComparison:
    """Compare designs on the same maps and poses, with paired statistics (simulated).

    Parameters
    ----------
    designs
        Two to twelve designs, their paths or their names.
    measure
        What counts most, such as reach_percent; default: targets touched where all maps have
        targets, else coverage_score.

    Returns
    -------
    DesignComparison
        The ``means`` by name, best first, the paired ``differences``, and a ``summary`` in lines.

    Raises
    ------
    BadInputError
        If a value cannot be used, or there are neither maps nor an environment.
    ForeignFileError
        If ``out`` is something else.
    UnknownNameError
        If there is no such design, environment or measure.

    Examples
    --------
    $ vinefab compare grid_explorer three_level_tree --environment grid --count 50

    >>> from vinefab import maps
    >>> found = compare(["plain_vine", "three_level_tree"], maps.pegs(seed=1), poses=1)
    >>> sorted(found.means)
    ['plain_vine', 'three_level_tree']
    """
    from vinefab.prediction.comparison import compare_designs, measure_named
    from vinefab.prediction.family_deployments import PredictionPlan

    page = page_path("out", out, force=force)
    main = None if measure is None else measure_named(measure)
    with told("compare", progress) as tell:
        context = context_of(
            as_several(designs),
            key="designs",
            growth=growth,
            body=body,
            head_on_half_angle_deg=head_on_half_angle_deg,
            contacts=contacts,
        )
        choice, robots = context.growth, _grown(context)
        families = families_of(maps, start, environment, count, seed, options)
        note_seen(context, families)
        plan = PredictionPlan(poses=poses, seed=seed, options=choice.options)
        found = compare_designs(
            robots, families, plan, tell, measure=main, growth_notes=choice.notes
        )
        found = with_origin(found, robots, families)
        content = "" if page is None else found.page()
    if page is not None:
        write_page(page, content, force=force)
    return found


@verb
def report(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    out: PageFile,
    maps: Annotated[MapsLike, also("--map")] = (),
    start: StartsLike = (),
    targets: TargetsLike = (),
    environment: UnseenEnvironment | None = None,
    count: UnseenCount = 100,
    options: EnvironmentOptions = None,
    poses: PoseCount = 3,
    seed: Seed = 0,
    body: BodyWidth | None = None,
    head_on_half_angle_deg: HalfAngle | None = None,
    contacts: ContactsLike | None = None,
    growth: GrowthLike | None = None,
    progress: Progress = True,
    force: Force = False,
) -> Predicted:
    """Write predictions (simulated), rules and materials of a design as one HTML page.

    Returns
    -------
    Predicted
        The page's ``path``, a ``summary`` in lines, and all ``numbers``.

    Raises
    ------
    BadInputError
        If a value cannot be used, or there are neither maps nor an environment.
    ForeignFileError
        If ``out`` is something else.
    UnknownNameError
        If there is no such design, recipe or environment.

    Examples
    --------
    $ vinefab report three_level_tree --environment grid --count 100 --out report.html

    >>> page = report("grid_explorer", environment="grid", out="page.html")  # doctest: +SKIP
    >>> print(page.summary[0])  # doctest: +SKIP
    """
    from dataclasses import replace

    from vinefab.prediction.family_deployments import PredictionPlan, part_of
    from vinefab.prediction.predict import predict

    path = page_path("out", out, force=force)
    assert path is not None  # noqa: S101  it is required
    with told("report", progress) as tell:
        tell(0.0, "reading and generating maps")
        families = families_of(maps, start, environment, count, seed, options, targets=targets)
        context = context_of(
            design,
            recipe=recipe,
            worlds=[world for family in families for world in family.worlds],
            targets=targets,
            growth=growth,
            body=body,
            head_on_half_angle_deg=head_on_half_angle_deg,
            contacts=contacts,
        )
        (robot,), profile, placed = context.robots, context.recipe, iter(context.worlds)
        families = tuple(
            replace(family, worlds=tuple(next(placed) for _ in family.worlds))
            for family in families
        )
        note_seen(context, families)
        plan = PredictionPlan(poses=poses, seed=seed, options=context.growth.options)
        found = predict(robot, profile, families, plan, part_of(tell, 0.0, 0.6))
        found = with_origin(found, [robot], families, profile)
        content = found.page(part_of(tell, 0.6, 1.0))
    write_page(path, content, force=force)
    return replace(found, path=path)
