"""Verbs that simulate robots on maps, and that compare photos of grown ones with predictions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vinefab.app.common import (
    SKELETON_ENDS,
    EitherParameters,
    EnvironmentOptions,
    PageFile,
    PoseCount,
    TaskLike,
    TaskParameters,
    UnseenCount,
    UnseenEnvironment,
    Workers,
    context_of,
    ensure_apart,
    families_of,
    note_seen,
    note_surface,
    page_path,
    parted,
    with_origin,
    write_page,
    write_shown,
)
from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.progress import phase
from vinefab.core.verbs import (
    IN_PLACE,
    Force,
    Kind,
    ProgressLike,
    Seed,
    Within,
    also,
    numbers_from,
    this_call,
    told,
    verb,
)
from vinefab.model.inputs import (
    PICTURE_ENDS,
    BodyWidth,
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
    StuckChildren,
    TargetsLike,
    as_design,
    as_map,
    as_mapping,
    as_path,
    as_several,
    as_starts,
    as_tuple,
    several_numbers,
    written,
)

if TYPE_CHECKING:
    from vinefab.observation.contact_fit import ContactFit
    from vinefab.observation.observe_photo import Observation
    from vinefab.observation.surface_fit import SurfaceFit

if TYPE_CHECKING:
    from vinefab.model.design import Design
    from vinefab.model.score import Score
    from vinefab.prediction.aiming import AimResult
    from vinefab.prediction.comparison import DesignComparison
    from vinefab.prediction.deploy import DeployedDesign
    from vinefab.prediction.predict import Predicted
    from vinefab.prediction.skeleton_files import Skeleton
    from vinefab.studies.frozen_problems import BenchmarkResults


_IN_FREE_SPACE = ("design", "pose", "out", "progress", "force")
"""Parameters of `grow` that mean something without a map."""


def _fronts(text: str) -> int | tuple[float, ...]:
    numbers = numbers_from(text)
    steps = len(numbers) == 1 and numbers[0].is_integer() and "." not in text
    return int(numbers[0]) if steps else numbers


@verb
def grow(
    design: DesignLike,
    map: Annotated[MapLike | None, IN_PLACE] = None,
    pose: PoseLike | None = None,
    *,
    start: StartsLike = (),
    targets: TargetsLike = (),
    growth: GrowthLike | None = None,
    body: BodyWidth | None = None,
    head_on_half_angle_deg: HalfAngle | None = None,
    contacts: ContactsLike | None = None,
    children_of_stuck: StuckChildren | None = None,
    out: Annotated[PathText | None, written(*SKELETON_ENDS)] = None,
    svg: Annotated[PathText | None, written(*PICTURE_ENDS)] = None,
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
    frames: int | None = None,
    progress: ProgressLike = True,
    force: Force = False,
) -> DeployedDesign | Skeleton:
    """Deploy a design on a map and say where every branch ended.

    Parameters
    ----------
    map
        A map, or the path of a map file; left out: the skeleton where nothing is in the way.
    pose
        Where the base is; without a map 0,0,90.
    out
        A drawing of the skeleton to write, as deployed or without a map as designed: lines in mm.
    svg
        A picture of the deployment to write.
    label
        Write branch ids in the picture.
    history
        Add to the JSON the shapes at these lengths of the growing front, in mm along the body from
        the base; a whole number alone: so many equal steps.
    animate
        The deployment as a moving picture.
    frames
        Frames of the moving picture; default: 40.

    Returns
    -------
    DeployedDesign | Skeleton
        What `Design.grow` returns is the ``deployment`` of the first; without a map a skeleton.

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
    $ vinefab grow scout --out skeleton.dxf

    >>> from vinefab import maps
    >>> grow("plain_vine", maps.pegs(seed=1)).summary[0].startswith("plain_vine on pegs_1")
    True
    """
    from vinefab.core.limits import positive, whole
    from vinefab.model.map import Pose
    from vinefab.prediction.deploy import MOST_FRAMES, deploy

    drawing = page_path("out", out, force=force)
    if map is None:
        for key, value in this_call().changed.items():
            if key not in _IN_FREE_SPACE and value is not None:
                raise UnfitInputError(key, "needs a map", "give --map too, or leave it out")
        return _in_free_space(as_design(design), pose, drawing, force=force)
    from vinefab.prediction.skeleton_files import Skeleton

    frames = 40 if frames is None else frames
    picture = page_path("svg", svg, force=force)
    film = page_path("animate", animate, force=force)
    if film is not None:
        whole("frames", frames, 1, MOST_FRAMES)
    if history is not None and (shell := this_call().shell) and not shell.gives_json:
        raise UnfitInputError("history", "shows itself in JSON alone", "give --json too")
    if isinstance(history, int):
        whole("history", history, 1, MOST_FRAMES)
    elif history is not None:
        whole("history", len(history), 1, MOST_FRAMES)
        history = tuple(positive("history", one) for one in history)
    if pose is not None and as_starts(start):
        raise UnfitInputError("pose", "is given together with a start", "leave one of them out")
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
    note_surface(context)
    (robot,), here = context.as_grown, None if pose is None else Pose.of(pose)
    with told(progress):
        found = deploy(robot, context.worlds[0], here, context.given)
        if drawing is not None:
            where = f"on {context.worlds[0].name}"
            lines = Skeleton.of_deployment(found.deployment, robot, where)
            write_page(drawing, lines.file(drawing.suffix), force=force)
        if picture is not None:
            write_page(picture, found.picture(picture.suffix, named=label), force=force)
        if film is not None:
            write_page(film, found.animation(film.suffix, frames), force=force)
    return replace(found, fronts=history)


def _in_free_space(
    design: Design, pose: PoseLike | None, drawing: Path | None, *, force: bool
) -> Skeleton:
    """Return the skeleton of a design where nothing is in the way, and write it."""
    from vinefab.model.map import Pose
    from vinefab.prediction.skeleton_files import FREE_POSE, Skeleton

    shell = this_call().shell
    if drawing is None and shell and not shell.gives_json:
        remedy = "give --map FILE, or --out FILE for the skeleton where nothing is in the way"
        raise UnfitInputError("map", "is missing", remedy)
    found = Skeleton.of_design(design, FREE_POSE if pose is None else Pose.of(pose))
    if drawing is not None:
        write_page(drawing, found.file(drawing.suffix), force=force)
    return found


@verb
def score(
    design: DesignLike,
    task: TaskLike | None = None,
    *,
    maps: MapsLike = (),
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
    progress: ProgressLike = True,
    **parameters: EitherParameters,
) -> Score:
    """Score a design on a task over maps and poses (simulated).

    Parameters
    ----------
    task
        The name of a task, in Python also a task of your own; default: that of the run that found
        the design, with its parameters where you give no others, else reach where all maps have
        targets, else coverage.
    maps
        Maps or paths of map files: --maps *.geojson. Poses are drawn around their starts.
    seed
        Seed of the poses; map ``i`` gets ``seed + i``.

    Returns
    -------
    Score
        One evaluation per map and pose, and composites such as ``composite["mean"]``.

    Raises
    ------
    BadInputError
        If a value cannot be used, or there are neither maps nor an environment.
    UnknownNameError
        If there is no such design, task or environment.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab score three_level_tree --task coverage --maps grid.geojson pegs.geojson
    $ vinefab score three_level_tree --task coverage --environment grid --count 50

    >>> from vinefab import maps
    >>> found = score("plain_vine", "reach", maps=maps.pegs(seed=1), poses=2)
    >>> found.scores.shape
    (2,)
    """
    from vinefab.prediction.family_deployments import ScorePlan, score_design_on_task

    chosen, of_task = parted(environment, options, parameters)
    with told(progress):
        families = families_of(maps, start, environment, count, seed, chosen, targets=targets)
        worlds = [world for family in families for world in family.worlds]
        context = context_of(
            design,
            task=task,
            parameters=of_task,
            worlds=worlds,
            targets=targets,
            growth=growth,
            body=body,
            head_on_half_angle_deg=head_on_half_angle_deg,
            contacts=contacts,
        )
        note_surface(context)
        plan = ScorePlan(task=context.task, poses=poses, seed=seed)
        (robot,) = context.as_grown
        found = score_design_on_task(robot, context.worlds, plan, context.growth.options)
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
    out: Annotated[PathText | None, written(".html", ".htm", *PICTURE_ENDS)] = None,
    progress: ProgressLike = True,
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
    from vinefab.prediction.aimed_robot import AimPlan
    from vinefab.prediction.aiming import aim_growth, aim_robots, held_against
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
    compared = held_against(*context.as_grown, alone=alone)
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
    with told(progress):
        found = aim_robots(compared, place, context.task, plan, workers)
    family = MapFamily(label=place.name, worlds=(place,))
    found = with_origin(replace(found, growth_notes=choice.notes), compared, [family])
    write_shown(page, found, force=force)
    return found


@verb
def compare(
    designs: DesignsLike,
    maps: MapsLike = (),
    *,
    task: TaskLike | None = None,
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
    progress: ProgressLike = True,
    force: Force = False,
    **parameters: EitherParameters,
) -> DesignComparison | BenchmarkResults:
    """Compare designs on the same maps and poses, with paired statistics (simulated).

    Parameters
    ----------
    designs
        Two to twelve designs, their paths or their names; or results of ``study benchmark``, which
        are ranked by their problems.
    task
        Whose score, ``task_score``, is compared too: a name, in Python also a task of your own;
        default: that of the run that found the first design, where it is a plug-in's.
    measure
        What counts most, such as reach_percent; default: the score of ``task``, else targets
        touched where all maps have targets, else coverage_score.

    Returns
    -------
    DesignComparison or BenchmarkResults
        The ``means`` by name, best first, the paired ``differences``, and a ``summary`` in lines;
        of results of the benchmark ``ranking(problem)``.

    Raises
    ------
    BadInputError
        If a value cannot be used, or there are neither maps nor an environment.
    ForeignFileError
        If ``out`` is something else.
    UnknownNameError
        If there is no such design, task, environment or measure.

    Examples
    --------
    $ vinefab compare grid_explorer three_level_tree --environment grid --count 50

    >>> from vinefab import maps
    >>> found = compare(["plain_vine", "three_level_tree"], maps.pegs(seed=1), poses=1)
    >>> sorted(found.means)
    ['plain_vine', 'three_level_tree']
    """
    from vinefab.growth.options import on_surface, shown_growth
    from vinefab.prediction.comparison import compare_designs, measure_named
    from vinefab.prediction.family_deployments import PredictionPlan
    from vinefab.prediction.measures import TASK_SCORE

    page = page_path("out", out, force=force)
    named = as_several(designs)
    if any(str(one).endswith(".json") for one in named):
        return _ranked(named)
    if task is None and measure is not None and measure != TASK_SCORE:
        measure_named(measure)  # refused before any work
    with told(progress):
        chosen, of_task = parted(environment, options, parameters)
        families = families_of(maps, start, environment, count, seed, chosen)
        context = context_of(
            named,
            key="designs",
            task=task,
            usual_task="",
            parameters=of_task,
            growth=on_surface(
                as_mapping("growth", growth),
                [world for family in families for world in family.worlds],
            ),
            body=body,
            head_on_half_angle_deg=head_on_half_angle_deg,
            contacts=contacts,
        )
        choice, robots = shown_growth(context.growth, context.given), context.as_grown
        note_seen(context, families)
        main = None if measure is None else measure_named(measure, context.task)
        plan = PredictionPlan(poses=poses, seed=seed, options=choice.options, task=context.task)
        found = compare_designs(robots, families, plan, measure=main, growth_notes=choice.notes)
        found = with_origin(found, robots, families)
        content = "" if page is None else found.page()
    if page is not None:
        write_page(page, content, force=force)
    return found


def _ranked(files: Sequence[object]) -> BenchmarkResults:
    """Return results of the benchmark together."""
    from vinefab.studies.frozen_problems import together

    for one in files:
        if not str(one).endswith(".json"):
            problem = "is among results of the benchmark"
            raise UnfitInputError(
                str(one), problem, "score designs by: vinefab study benchmark --designs"
            )
    return together([as_path("designs", one) for one in files])


@verb
def report(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    out: PageFile,
    task: TaskLike | None = None,
    maps: MapsLike = (),
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
    tip_speed_mm_s: Annotated[float | None, Within(0.01, 1e5, "mm/s")] = None,
    progress: ProgressLike = True,
    force: Force = False,
    **parameters: EitherParameters,
) -> Predicted:
    """Write predictions (simulated), rules and materials of a design as one HTML page.

    Parameters
    ----------
    task
        Whose score the page begins with: a name, in Python also a task of your own; default: what
        the run that found the design asked for.
    tip_speed_mm_s
        How fast tips are to grow: the page says how many litres of air a minute that takes.

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
        If there is no such design, recipe, task or environment.

    Examples
    --------
    $ vinefab report three_level_tree --environment grid --count 100 --out report.html

    >>> page = report("grid_explorer", environment="grid", out="page.html")  # doctest: +SKIP
    >>> print(page.summary[0])  # doctest: +SKIP
    """
    from dataclasses import replace

    from vinefab.growth.options import shown_growth
    from vinefab.prediction.family_deployments import PredictionPlan
    from vinefab.prediction.predict import predict

    path = page_path("out", out, force=force)
    assert path is not None  # noqa: S101  it is required
    with told(progress):
        chosen, of_task = parted(environment, options, parameters)
        families = families_of(maps, start, environment, count, seed, chosen, targets=targets)
        context = context_of(
            design,
            recipe=recipe,
            task=task,
            usual_task="",
            parameters=of_task,
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
        choice = shown_growth(context.growth, context.given)
        plan = PredictionPlan(
            poses=poses,
            seed=seed,
            options=choice.options,
            task=context.task,
            tip_speed_mm_s=tip_speed_mm_s,
        )
        found = replace(predict(robot, profile, families, plan), growth_notes=choice.notes)
        found = replace(with_origin(found, [robot], families, profile), path=path)
        content = found.page()
    write_page(path, content, force=force)
    return found


@verb
def observe(
    photo: Annotated[PathText, Kind(metavar="PHOTO")],
    map: MapLike,
    design: DesignLike,
    pose: PoseLike | None = None,
    *,
    rig: PathText | None = None,
    corners_px: Annotated[
        tuple[float, ...] | None, several_numbers("X,Y,X,Y,..."), also("--corners")
    ] = None,
    obstacle_height_mm: Annotated[float | None, also("--obstacle-height")] = None,
    film_colour: Annotated[tuple[int, int, int] | None, several_numbers("R,G,B")] = None,
    outline: PathText | None = None,
    growth: GrowthLike | None = None,
    results: PathText | None = None,
    pressure_kpa: Annotated[float, Within(0.1, 1000.0, "kPa")] = 20.0,
    out: Annotated[PathText | None, written(".html", ".htm", ".json")] = None,
    progress: ProgressLike = True,
    force: Force = False,
) -> Observation:
    """Trace a grown robot on a photo from above (measured) and compare it with its prediction.

    Parameters
    ----------
    photo
        A photo from above, JPEG or PNG.
    map
        The map that the rig was made from, or the path of its file.
    rig
        The rig's ``rig.json``: where its markers lie and how high its obstacles are. Without it,
        markers are looked for where `rig` puts them.
    corners_px
        Instead of markers: column and row of the lower left, lower right, upper right and upper
        left corner of the bounds' box in the photo, eight numbers.
    obstacle_height_mm
        Height of the obstacles, which hide what lies behind them.
    film_colour
        Red, green and blue of the film, 0 to 255; default: as it is at the base.
    outline
        The film outlined by hand: GeoJSON in map millimetres, or SVG in pixels of the photo.
    results
        Of a photo of a joint coupon: the table, from `coupon`, that its angle is entered in for
        `calibrate`. ``design`` is the coupon's name then, PAIR-80-W20.
    pressure_kpa
        Pressure in the joint coupon.
    out
        A page (.html) to write, or the numbers (.json), which `fit_observations` reads.

    Returns
    -------
    Observation
        A ``summary`` in lines, all ``numbers``, and the ``path`` of the written file.

    Raises
    ------
    BadInputError
        If a value cannot be used, no markers are seen, or no film is found.
    ForeignFileError
        If ``out`` is something else.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab observe examples/arena/grown_1.jpg --map arena.geojson
      --design examples/arena/sprig.toml --pose 152,132,2 --obstacle-height 30 --json seen.json

    >>> coupon = ("joints.jpg", "coupons/joints_W20.geojson", "PAIR-80-W20")
    >>> seen = observe(*coupon, results="coupons/results.csv")  # doctest: +SKIP

    >>> seen = observe("photo.jpg", "grid.geojson", "grid_explorer")  # doctest: +SKIP
    >>> seen.numbers["summary"]["shape_error_mm"]  # doctest: +SKIP
    """
    from vinefab.model.map import Map, Pose
    from vinefab.observation.observe_photo import PhotoSetup, observe_photo
    from vinefab.photos.photo import read_photo
    from vinefab.prediction.deploy import first_start

    page = page_path("out", out, force=force)
    picture = as_path("photo", photo)
    if page is not None:
        ensure_apart("out", page, picture, "the photo")
    world = as_map(map)
    if results is not None:
        from vinefab.fabrication.calibration.coupons import joint_coupon

        design = joint_coupon(str(getattr(design, "name", design)))
    context = context_of(design, growth=growth)
    (robot,) = context.as_grown
    eight, three = (
        "columns and rows of four corners, eight numbers",
        "red, green and blue, 0 to 255",
    )
    setup = PhotoSetup.of(
        rig=None if rig is None else as_path("rig", rig),
        corners_px=None if corners_px is None else as_tuple("corners_px", corners_px, eight),
        obstacle_mm=obstacle_height_mm,
        film_colour=None if film_colour is None else as_tuple("film_colour", film_colour, three),
        outline=None if outline is None else as_path("outline", outline),
    )
    with told(progress), phase("film and branches on the photo"):
        seen = observe_photo(
            read_photo(picture),
            world,
            robot,
            first_start(world) if pose is None else Pose.of(pose),
            setup,
            growth=context.given,
            map_file=world.name if isinstance(map, Map) else str(map),
            design_file=robot.name if not isinstance(design, str | Path) else str(design),
        )
        if results is not None:
            seen = _with_reading(seen, as_path("results", results), pressure_kpa)
        if page is not None:
            is_json = page.suffix.lower() == ".json"
            write_page(page, seen.json_text() if is_json else seen.page(), force=force)
    return replace(seen, path=page)


def _with_reading(seen: Observation, table: Path, pressure_kpa: float) -> Observation:
    """Enter the angle of a joint coupon in a table of coupon results, which may be a new file."""
    from vinefab.fabrication.calibration.coupons import read_results
    from vinefab.model.files.shipped import read_text
    from vinefab.observation.observe_photo import joint_reading

    before = ""
    if table.exists():
        read_results(table)  # nothing is added to a file that `calibrate` does not read
        before = read_text(table, 16 << 20)
    reading = joint_reading(seen, pressure_kpa)
    write_page(table, reading.entered(before), force=True)
    return replace(seen, reading=reading)


@verb
def fit_observations(
    observations: Annotated[PathText | tuple[PathText, ...], Kind(metavar="FILE", several=True)],
    *,
    angle_error_deg: Annotated[float, Within(0.1, 30.0, "deg")] = 2.0,
    film: str = "",
    tube_diameter_mm: Annotated[float | None, Within(0.1, 1e4, "mm")] = None,
    out: Annotated[PathText | None, written(".toml")] = None,
    progress: ProgressLike = True,
    force: Force = False,
) -> ContactFit | SurfaceFit:
    """Fit observed contacts: half-angle, friction of the tip and widths, with 95 % intervals.

    Parameters
    ----------
    observations
        JSON files of observations, one for each photo, in Python also what `observe` returned for
        such ``out``; or one CSV table of contacts, from ``rig --contact-test``: its columns are
        angle_from_head_on_deg, grew_on (yes or no) and, if you like, surface.
    angle_error_deg
        Standard error of the angles of contacts where an observation does not give it (assumed).
    film
        Of the tubes of a table.
    tube_diameter_mm
        Of the tubes of a table.
    out
        A file to write; predictions read it as ``contacts``. The surfaces of a table are added to
        what it holds.

    Returns
    -------
    ContactFit | SurfaceFit
        A ``summary`` in lines, all ``numbers``, and the file's ``path``; of a table the
        ``surfaces``.

    Raises
    ------
    BadInputError
        If a value cannot be used, or the observations say nothing of contacts.
    ForeignFileError
        If ``out`` is something else.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab fit-observations seen.json --out contacts.toml
    $ vinefab fit-observations coupon/contacts.csv --out contacts.toml

    >>> fitted = fit_observations(["one.json", "two.json"], out="mine.toml")  # doctest: +SKIP
    >>> fitted.numbers["head_on_half_angle_deg"]["low"]  # doctest: +SKIP
    """
    from vinefab.observation.contact_fit import fit_files

    file = page_path("out", out, force=force)
    paths = [as_path("observations", one) for one in as_several(observations)]
    if not paths:
        raise BadInputError("observations", None, "JSON files of observations")
    for path in paths if file is not None else ():
        ensure_apart("out", file or path, path, "an observation")
    tables = [path for path in paths if path.suffix.lower() == ".csv"]
    if tables and len(paths) > 1:
        problem = f"{tables[0]} is a table of contacts, given with other files"
        raise UnfitInputError("observations", problem, "give it alone, all contacts in one table")
    for name in ("film", "tube_diameter_mm") if not tables else ():
        if this_call().changed.get(name):
            raise UnfitInputError(name, "goes with a table of contacts", "leave it out")
    if tables:
        return _fit_table(tables[0], file, film, tube_diameter_mm, force=force)
    with told(progress), phase("contacts of all observations"):
        found = fit_files(paths, angle_error_deg)
    if file is not None:
        write_page(file, found.text(), force=force)
    return replace(found, path=file)


def _fit_table(
    table: Path, file: Path | None, film: str, tube_diameter_mm: float | None, *, force: bool
) -> SurfaceFit:
    """Fit a table of contacts, and add its surfaces to a file, which may be a new one."""
    from vinefab.model.contacts import contacts_with
    from vinefab.observation.surface_fit import fit_contact_table

    found = fit_contact_table(table, film=film, tube_diameter_mm=tube_diameter_mm)
    if file is not None:
        write_page(file, contacts_with(file, surfaces=found.surfaces), force=force)
    return replace(found, path=file)
