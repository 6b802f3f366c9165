"""The public functions of vinefab over its rooms; users find them in ``import vinefab as vf``.

Each takes what a user has (a name, a path, an object), calls the functions that the command of its
name calls, and imports them when it is called: checking a design must not wait for the simulator.
Degrees and millimetres throughout.
"""
# ruff: noqa: PLC0415, PLR0913  imports as said above; the options of a function are its parameters

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vinefab.core.atomic import (
    ensure_own_folder,
    ensure_writable,
    write_bytes,
    write_folder,
    write_text,
)
from vinefab.core.errors import BadInputError, ExportRefusedError, located
from vinefab.core.front_door import as_parameters, python_words
from vinefab.core.plain_text import counted
from vinefab.core.validation import number, whole
from vinefab.inputs import (
    ContactsLike,
    DesignLike,
    MapLike,
    PoseLike,
    RecipeLike,
    all_names,
    call_text,
    design_given,
    flags_given,
    growth_given,
    limits_given,
    listed_given,
    map_given,
    mapping_given,
    maps_given,
    name_given,
    name_or_path,
    progress_given,
    recipe_for,
    recipe_given,
    run_given,
    several_given,
    task_given,
)
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_PRINTER, DEFAULT_RECIPE, path_given
from vinefab.model.finding import CheckReport
from vinefab.model.map import Map, Pose

if TYPE_CHECKING:
    from vinefab.fabrication.profile_listing import ProfileNumbers
    from vinefab.fabrication.rules.rule import Rule
    from vinefab.model.score import Score
    from vinefab.prediction.aiming import AimResult
    from vinefab.prediction.comparison import DesignComparison
    from vinefab.prediction.family_deployments import MapFamily
    from vinefab.rig.rig_options import Printer
    from vinefab.search.record.generations import Progress
    from vinefab.search.record.result import RunResult
    from vinefab.search.run_pages import RunListing
    from vinefab.search.settings import RunSettings
    from vinefab.tasks.task import Task

_MOST_SEED = 2**31
_MOST_POSES = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenFolder:
    """A folder of files that `fabricate`, `rig` or `coupon` wrote.

    Parameters
    ----------
    path
        The folder.
    files
        Names of the files in it.
    report
        What the design rules say.
    """

    path: Path
    files: tuple[str, ...]
    report: CheckReport

    def __fspath__(self) -> str:
        """Return the path: the folder can be passed where one is expected."""
        return str(self.path)

    def __repr__(self) -> str:
        return f"<WrittenFolder {self.path}: {counted(len(self.files), 'file')}>\n{self.report!r}"

    def _repr_html_(self) -> str:
        """Show the files and the findings in a notebook."""
        from vinefab.noun_methods import html_table

        files = html_table(f"written: {self.path}", ("file",), [(name,) for name in self.files])
        return files + self.report._repr_html_()


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenReport:
    """A page that `report` wrote, or a recipe that `calibrate` wrote.

    Parameters
    ----------
    path
        The page (HTML) or the recipe (TOML).
    summary
        The verdict and the numbers to take away, a line each.
    numbers
        Every number as plain values, schema ``vinefab/prediction-1`` or ``vinefab/calibration-1``.
    """

    path: Path
    summary: tuple[str, ...]
    numbers: Mapping[str, Any]

    def __fspath__(self) -> str:
        """Return the path: a calibrated recipe is passed as ``recipe``."""
        return str(self.path)

    def __repr__(self) -> str:
        return "\n".join([f"<WrittenReport {self.path}>", *self.summary])

    def _repr_html_(self) -> str:
        """Show the lines to take away in a notebook."""
        from vinefab.noun_methods import html_table

        return html_table(
            f"written: {self.path}", ("what to take away",), [(s,) for s in self.summary]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposedFix:
    """What `fix` found.

    Parameters
    ----------
    design
        The changed design, or None where nothing had to or could be changed.
    report
        Its check; without a changed design that of the nearest one found, or of the design itself.
    summary
        What was changed, and what it costs, a line each.
    """

    design: Design | None
    report: CheckReport
    summary: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join(["<ProposedFix>", *self.summary])

    def _repr_html_(self) -> str:
        """Show the changes and the changed design in a notebook."""
        from vinefab.noun_methods import html_table, svg_of

        table = html_table(self.summary[0], ("",), [(line,) for line in self.summary[1:]])
        return table + ((self.design and svg_of(self.design)) or "")


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoReport:
    """What `observe` read off a photo, or `fit_observations` off several.

    Parameters
    ----------
    path
        The page (HTML), the observation (JSON) or the fitted numbers (TOML); None if none was
        asked for.
    summary
        The numbers to take away, a line each.
    numbers
        Every number as plain values, schema ``vinefab/observation-1`` or ``vinefab/contacts-1``.
    """

    path: Path | None
    summary: tuple[str, ...]
    numbers: Mapping[str, Any]

    def __fspath__(self) -> str:
        """Return the path: fitted numbers are passed as ``contacts``, observations to the fit."""
        if self.path is None:
            raise BadInputError("path", None, "a file: observe or fit with out=")
        return str(self.path)

    def __repr__(self) -> str:
        return "\n".join(["<PhotoReport>", *self.summary])

    def _repr_html_(self) -> str:
        """Show the lines to take away in a notebook."""
        from vinefab.noun_methods import html_table

        title = "not written" if self.path is None else f"written: {self.path}"
        return html_table(title, ("what was measured",), [(line,) for line in self.summary])


def _file_to_write(
    key: str, given: str | PathLike[str], endings: tuple[str, ...], *, force: bool
) -> Path:
    """Return the file to write, once its kind and place will do."""
    path = path_given(key, given)
    if path.suffix.lower() not in endings:
        raise BadInputError(key, str(path), f"a file name ending in {' or '.join(endings)}")
    ensure_writable(path, force=force)
    return path


def _file_asked_for(
    key: str, given: str | PathLike[str] | None, endings: tuple[str, ...], *, force: bool
) -> Path | None:
    """Return the file to write, if one is asked for."""
    return None if given is None else _file_to_write(key, given, endings, force=force)


def designs() -> tuple[str, ...]:
    """Return the names of the shipped designs and of the user's own.

    Examples
    --------
    >>> "grid_explorer" in designs()
    True
    """
    return all_names("design")


def recipes() -> tuple[str, ...]:
    """Return the names of the shipped recipes (laser, film, settings) and of the user's own.

    Examples
    --------
    >>> recipes()[0]
    'co2_40w__stretchlon_200'
    """
    return all_names("recipe")


def printers() -> tuple[str, ...]:
    """Return the names of the shipped 3-D printers and of the user's own.

    Examples
    --------
    >>> printers()
    ('generic_220', 'generic_256', 'generic_large')
    """
    return all_names("printer")


def profile(name: str | PathLike[str]) -> ProfileNumbers:
    """Explain a machine, a material or a recipe: every number with its standing and source.

    Parameters
    ----------
    name
        A shipped name, one of your own, or a path.

    Raises
    ------
    UnknownNameError
        If there is no such profile.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    >>> profile("co2_60w__stretchlon_200").summary[0].startswith("recipe ")
    True
    """
    from vinefab.fabrication.profile_listing import ProfileNumbers, kind_of

    found = ProfileNumbers(name=str(path_given("name", name, "a name, or a path")))
    kind_of(found.name)
    return found


def examples(
    *names: str, out: str | PathLike[str] | None = None, force: bool = False
) -> tuple[str, ...]:
    """Return the names of the shipped examples, or copy them to try and change.

    Parameters
    ----------
    *names
        Examples, with or without folder and ending; all of them if none is named.
    out
        Copy them into this folder; what is there already and unchanged stays.
    force
        Overwrite files that vinefab did not write, or that were changed.

    Raises
    ------
    ForeignFileError
        If a file is in the way.
    UnknownNameError
        If there is no such example.

    Examples
    --------
    >>> examples("grid_coverage")
    ('grid_coverage.toml',)
    """
    from vinefab.model.files.starters import copy_examples, examples_named

    flags_given(force=force)
    chosen = examples_named([name_given("names", name) for name in names])
    if out is not None:
        copy_examples(chosen, path_given("out", out), force=force)
    return tuple(chosen)


def new(
    kind: str, file: str | PathLike[str], *, original: str | None = None, force: bool = False
) -> Path:
    """Write a commented file to begin with, as a design or a map; its name is the file's.

    Parameters
    ----------
    kind
        ``design``, ``run``, ``map``, ``recipe``, ``machine`` (a laser) or ``material`` (a film).
    file
        The file to write: ``.geojson`` for a map, else ``.toml``.
    original
        The shipped or own file to copy; None for a usual one.
    force
        Overwrite what is there, whoever wrote it.

    Returns
    -------
    Path
        What was written.

    Raises
    ------
    BadInputError
        If there is no such kind, or the name ends in something else.
    ForeignFileError
        If the place is taken.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     Design.read(new("design", f"{folder}/mine.toml")).name
    'mine'
    """
    from vinefab.model.files.starters import write_starter

    flags_given(force=force)
    path = path_given("file", file)
    source = None if original is None else name_given("original", original)
    write_starter(name_given("kind", kind), path, original=source, force=force)
    return path


def score(
    design: DesignLike,
    task: str | Task = "coverage",
    *,
    maps: MapLike | Iterable[MapLike],
    poses: int = 3,
    seed: int = 0,
    body: str | None = None,
    head_on_half_angle_deg: float | tuple[float, float] | None = None,
    contacts: ContactsLike | None = None,
    growth: Mapping[str, object] | None = None,
    **parameters: object,
) -> Score:
    """Score a design on a task over maps and poses (simulated).

    Parameters
    ----------
    design
        A design, its path or its name.
    task
        ``coverage``, ``reach``, ``anchoring``, the name of a plug-in's task, or a task of your own:
        an object with ``name``, ``lowest`` and ``evaluate``.
    maps
        Maps or paths of map files, at least one; poses are drawn around their starts.
    poses
        Poses drawn per map.
    seed
        Seed of the poses; map ``i`` gets ``seed + i``.
    body
        ``inflated`` or ``centerline``, as in ``Design.grow``; None: as the design was trained.
    head_on_half_angle_deg
        As in ``Design.grow``; a range ``(low, high)`` gives every deployment a value of its own.
    contacts
        Numbers that photos measured, as in ``Design.grow``.
    growth
        Any growth options by name, as in ``Design.grow``.
    **parameters
        Parameters of a task that is named, such as ``radius_mm=60``.

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
    >>> from vinefab import maps
    >>> found = score("plain_vine", "reach", maps=maps.pegs(seed=1), poses=2)
    >>> found.scores.shape
    (2,)
    """
    from vinefab.growth.options import GrowthChoice
    from vinefab.prediction.scoring import ScorePlan, score_design_on_task

    worlds = maps_given(maps)
    if not worlds:
        raise BadInputError("maps", "none", "at least one map")
    plan = ScorePlan(
        task=task_given(task, parameters),
        poses=whole("poses", poses, 1, _MOST_POSES),
        seed=whole("seed", seed, 0, _MOST_SEED),
    )
    given = growth_given(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    robot = design_given(design)
    return score_design_on_task(robot, worlds, plan, GrowthChoice.of([robot], given).options)


def aim(
    design: DesignLike,
    world: MapLike,
    task: str | Task = "reach",
    *,
    where: str = "border",
    robots: int = 1,
    against: DesignLike | None = None,
    alone: bool = False,
    placing_mm: float = 5.0,
    placing_deg: float = 3.0,
    deployments: int = 100_000,
    seed: int = 0,
    body: str | None = None,
    head_on_half_angle_deg: float | tuple[float, float] | None = None,
    contacts: ContactsLike | None = None,
    growth: Mapping[str, object] | None = None,
    out: str | PathLike[str] | None = None,
    progress: Callable[[float, str], None] | bool = True,
    force: bool = False,
    **parameters: object,
) -> AimResult:
    """Search a map for the pose from which a robot scores best (simulated).

    Parameters
    ----------
    design
        A design, its path or its name.
    world
        A map, or the path of a map file.
    task
        As in `score`.
    where
        Where the base may stand: ``border`` (of the free space, growing in, and where the map's
        starts are), ``anywhere``, ``starts``, or a start in words such as ``left side``.
    robots
        How many poses to choose that together cover most; for ``reach``, ``coverage`` and tasks
        with a method ``cover``.
    against
        A design to hold it against; None: a plain vine of the same total length.
    alone
        Hold it against nothing.
    placing_mm, placing_deg
        A base is placed within so much (assumed).
    deployments
        About so many for the search of each design.
    seed
        Seed of the fresh deployments that reported scores come from.
    body
        ``inflated`` or ``centerline``, as in ``Design.grow``; None: as the design was trained.
    head_on_half_angle_deg
        As in ``Design.grow``; None: over the range that contacts may have.
    contacts
        Numbers that photos measured, as in ``Design.grow``.
    growth
        Any growth options by name, as in ``Design.grow``.
    out
        A page (``.html``) or a picture (``.svg``, ``.png``) to write.
    progress
        True: a line in notebooks and on terminals after two seconds; False: nothing; a function:
        called with the share of the work that is done and a few words.
    force
        Overwrite a file that vinefab did not write.
    **parameters
        Parameters of a task that is named, such as ``buffer_mm=60``.

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
    >>> from vinefab import maps
    >>> found = aim("plain_vine", maps.pegs(seed=1), deployments=5000)
    >>> 0.0 < found.mean <= 1.0
    True
    """
    from vinefab.prediction.aiming import AimPlan, aim_growth, aim_robots, held_against
    from vinefab.prediction.family_deployments import MapFamily
    from vinefab.prediction.provenance import origin_of

    flags_given(alone=alone, force=force)
    path = _file_asked_for("out", out, (".html", ".svg", ".png"), force=force)
    place, scored_on = map_given(world, "world"), task_given(task, parameters)
    other = None if against is None else design_given(against, "against")
    given = growth_given(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    with python_words():
        designs = held_against(design_given(design), other, alone=alone)
        choice = aim_growth(designs, given)
        plan = AimPlan(
            where=name_given("where", where),
            deployments=deployments,
            placing_mm=placing_mm,
            placing_deg=placing_deg,
            robots=robots,
            seed=seed,
            options=choice.options,
        )
        with progress_given("aim", progress) as tell:
            found = aim_robots(designs, place, scored_on, plan, tell)
    if path is not None:
        call = f"vf.aim({call_text(design)}, {call_text(world)}, {scored_on.name!r}, {where=}, "
        call += f"{robots=}, {alone=}, {placing_mm=}, {placing_deg=}, {deployments=}, {seed=}, "
        call += f"growth={choice.options.content}, out={str(path)!r})"
        family = MapFamily(label=place.name, worlds=(place,))
        origin = origin_of(call, designs, None, [family])
        found = replace(found, origin=origin, growth_notes=choice.notes)
        is_page = path.suffix.lower() == ".html"
        document = found.page().encode() if is_page else found.picture(path.suffix)
        write_bytes(path, document, force=force)
    return replace(found, growth_notes=choice.notes)


def compare(
    designs: Iterable[DesignLike],
    maps: MapLike | Iterable[MapLike] = (),
    *,
    environment: str | None = None,
    count: int = 100,
    options: Mapping[str, object] | None = None,
    measure: str = "coverage_score",
    poses: int = 3,
    seed: int = 0,
    body: str | None = None,
    head_on_half_angle_deg: float | tuple[float, float] | None = None,
    contacts: ContactsLike | None = None,
    growth: Mapping[str, object] | None = None,
    out: str | PathLike[str] | None = None,
    progress: Callable[[float, str], None] | bool = True,
    force: bool = False,
) -> DesignComparison:
    """Compare designs on the same maps and poses, with paired statistics (simulated).

    Parameters
    ----------
    designs
        Two to twelve designs, their paths or their names.
    maps
        Maps or paths of map files to compare on.
    environment
        Compare on unseen maps of this environment too: ``grid``, ``cave``, ...
    count
        How many unseen maps.
    options
        The environment's options, such as ``{"size_mm": 300}``.
    measure
        What counts most, such as ``reach_percent``.
    poses
        Poses drawn per map.
    seed
        Seed of unseen maps and poses.
    body
        ``inflated`` or ``centerline``, as in ``Design.grow``; None: as the designs were trained.
    head_on_half_angle_deg
        As in ``Design.grow``; a range ``(low, high)`` gives every deployment a value of its own.
    contacts
        Numbers that photos measured, as in ``Design.grow``.
    growth
        Any growth options by name, as in ``Design.grow``.
    out
        A page (HTML) to write.
    progress
        True: a line in notebooks and on terminals after two seconds; False: nothing; a function:
        called with the share of the work that is done and a few words.
    force
        Overwrite a file that vinefab did not write.

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
    >>> from vinefab import maps
    >>> found = compare(["plain_vine", "three_level_tree"], maps.pegs(seed=1), poses=1)
    >>> sorted(found.means)
    ['plain_vine', 'three_level_tree']
    """
    from vinefab.growth.options import GrowthChoice
    from vinefab.prediction.comparison import compare_designs, measure_named
    from vinefab.prediction.family_deployments import PredictionPlan
    from vinefab.prediction.provenance import origin_of

    flags_given(force=force)
    path = _file_asked_for("out", out, (".html",), force=force)
    named = several_given(designs, Design)
    robots = [design_given(one, "designs") for one in named]
    main = measure_named(name_given("measure", measure))
    given = growth_given(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    choice = GrowthChoice.of(robots, given)
    plan = PredictionPlan(
        poses=whole("poses", poses, 1, _MOST_POSES),
        seed=whole("seed", seed, 0, _MOST_SEED),
        options=choice.options,
    )
    families, places = _families(maps, environment, count, seed, options)
    with progress_given("compare", progress) as tell:
        found = compare_designs(
            robots, families, plan, tell, measure=main, growth_notes=choice.notes
        )
    if path is not None:
        call = f"vf.compare([{', '.join(map(call_text, named))}], {places}, "
        call += f"measure={main.key!r}, {poses=}, {seed=}, growth={choice.options.content}, "
        call += f"out={str(path)!r})"
        found = replace(found, origin=origin_of(call, robots, None, families))
        write_text(path, found.page(), force=force)
    return found


def _families(
    maps: MapLike | Iterable[MapLike],
    environment: str | None,
    count: int,
    seed: int,
    options: Mapping[str, object] | None,
) -> tuple[tuple[MapFamily, ...], str]:
    """Return the maps given and unseen ones as families, and the parameters that name them."""
    from vinefab.prediction.family_deployments import map_families, unseen_maps

    given = several_given(maps, Map)
    words = f"maps=[{', '.join(map(call_text, given))}]"
    with python_words():
        chosen, unseen = mapping_given("options", options), None
        if environment is not None:
            unseen = unseen_maps(name_given("environment", environment), count, seed, chosen)
            words += f", {environment=}, {count=}, options={dict(chosen)}"
        return map_families([map_given(one, "maps") for one in given], unseen), words


def optimize(
    run: RunSettings | str | PathLike[str],
    *,
    out: str | PathLike[str] | None = None,
    workers: int = 1,
    seed: int | None = None,
    task: str | Task | None = None,
    resume: bool = False,
    generations: int | None = None,
    evaluations: int | None = None,
    wall_time_s: float | None = None,
    page: bool = True,
    progress: Callable[[Progress], None] | bool = True,
    force: bool = False,
) -> RunResult:
    """Search for the best design of a run.

    Parameters
    ----------
    run
        The path of a run file (TOML, ``vinefab/run-1``), the name of a shipped one, or settings.
    out
        A folder for the record (``run.sqlite``), ``best.toml``, the page ``index.html`` with its
        pictures and, for several objectives, the front; None keeps the result in memory.
    workers
        Threads; no result depends on it.
    seed
        Seed of the search in place of the run's.
    task
        A task in place of the run's: its name, or a task of your own.
    resume
        Go on with the run in ``out``.
    generations, evaluations, wall_time_s
        With ``resume``: limits to raise, also of a run that has ended; 0 lifts the last two.
    page
        Whether to write the page, also while the run is going on.
    progress
        True: a line in notebooks and on terminals after two seconds; False: nothing; a function:
        called after every generation.
    force
        Overwrite files that vinefab did not write.

    Returns
    -------
    RunResult
        The winner is ``best``; ``history`` holds every generation, ``score`` the winner's score on
        fresh poses, and ``prediction`` what the winner does on unseen maps, over contacts and
        placed off, in plain values.

    Raises
    ------
    BadInputError
        If a setting cannot be used, or no design of the space can be made.
    ForeignFileError
        If ``out`` holds something else, or a run and ``resume`` is not set.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    >>> from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings
    >>> from vinefab.search.settings import SearchSettings
    >>> found = optimize(
    ...     RunSettings(
    ...         maps=MapSettings(count=1, options={"columns": 3, "rows": 3}),
    ...         search=SearchSettings(population=4, generations=2),
    ...         evaluation=EvaluationSettings(fabricable=False),
    ...     )
    ... )
    >>> len(found.history)
    2
    """
    from vinefab.search.live_page import PAGE_NAME
    from vinefab.search.settings import PartSettings, RunLimits

    settings, source = run_given(run)
    flags_given(resume=resume, page=page, force=force)
    whole("workers", workers, 1, 1024)
    own_task = None if task is None or isinstance(task, str) else task_given(task, {})
    if isinstance(task, str):
        settings = settings.changed(task=PartSettings(name=task))
    if seed is not None:
        search = settings.search.changed(seed=whole("seed", seed, 0, _MOST_SEED))
        settings = settings.changed(search=search)
    limits = RunLimits(generations=generations, evaluations=evaluations, wall_time_s=wall_time_s)
    if not resume and limits.given:
        name, value = next(iter(limits.given.items()))
        raise BadInputError(name, value, "together with resume; else it is a setting of the run")
    if out is None:
        if resume:
            raise BadInputError("resume", resume, "together with out, the folder of the run")
        with _told("optimize", progress) as tell:
            return _searched(settings, own_task, workers, tell)

    from vinefab.prediction.run_folder import run_in_folder

    folder = path_given("out", out)
    for name in ("best.toml", *((PAGE_NAME,) if page else ())):
        ensure_writable(folder / name, force=force)
    given = "..." if source is None else call_text(source)
    with python_words(), _told("optimize", progress) as tell:
        result = run_in_folder(
            settings,
            folder,
            again=f"vf.optimize({given}, out={str(folder)!r}, resume=True)",
            page=page,
            resume=resume,
            limits=limits if limits.given else None,
            workers=workers,
            progress=tell,
            source=source,
            task=own_task,
        )
    _write_result(folder, result, settings, page=page, force=force)
    return result


@contextmanager
def _told(
    title: str,
    given: Any,  # noqa: ANN401  judged by `progress_given`
) -> Iterator[Callable[[Progress], None]]:
    """Return what a run tells its generations to."""
    if callable(given):
        yield given
        return
    with progress_given(title, given) as tell:
        yield lambda now: tell(
            now.share, f"generation {now.generation} of {now.generations}, best {now.best:.4f}"
        )


def _write_result(
    folder: Path, result: RunResult, settings: RunSettings, *, page: bool, force: bool
) -> None:
    """Write the winner of a run, its page and its front."""
    result.write_winner(folder, force=force)
    if page:
        from vinefab.prediction.run_page import EndedRun, write_run_page

        write_run_page(folder, EndedRun.read(folder, result), force=force)
    if settings.objectives:
        from vinefab.search.front_files import write_front

        write_front(result, settings, folder, force=force)


def runs(*folders: str | PathLike[str]) -> RunListing:
    """List the records of runs in folders and below, with mean and deviation over seeds.

    Parameters
    ----------
    *folders
        Folders of runs, or folders above them.

    Returns
    -------
    RunListing
        ``rows`` as plain values, and ``lines``; `RunResult.read` reads one of them.

    Raises
    ------
    BadInputError
        If a folder has no run in it or below.

    Examples
    --------
    >>> runs("night")  # doctest: +SKIP
    """
    from vinefab.search.run_pages import list_runs

    if not folders:
        raise BadInputError("folders", None, "folders of runs, or folders above them")
    return list_runs([path_given("folders", folder) for folder in folders])


def check(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    maps: MapLike | Iterable[MapLike] = (),
    rig: str | PathLike[str] | None = None,
    limits: Mapping[str, Mapping[str, float]] | None = None,
    growth: Mapping[str, object] | None = None,
    out: str | PathLike[str] | None = None,
    force: bool = False,
) -> CheckReport:
    """Check a design against the rules of making and deploying it.

    Parameters
    ----------
    design
        A design, its path or its name.
    recipe
        A recipe's name or path, or a laser profile; None for that of the run that found the design,
        or else the default.
    maps
        Maps or paths of map files; the design is deployed from their starts first (simulated).
    rig
        A folder that `rig` or ``vinefab rig`` wrote.
    limits
        Limits in place of the rules' own: ``{"VF-C01": {"warning": 6.0}}``.
    growth
        Growth options by name for the maps, as in ``Design.grow``; there no pressure stops it.
    out
        The robot with the findings in place, to write: ``.svg`` or ``.png``, or ``.dxf`` on layers
        that are not cut.
    force
        Overwrite a file that vinefab did not write.

    Returns
    -------
    CheckReport
        All findings; ``blocking`` are those that stand in the way of cutting.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    UnknownNameError
        If there is no such design, recipe or rule.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    >>> check("plain_vine").blocking
    ()
    """
    from vinefab.fabrication.checking import check_design, findings_file

    flags_given(force=force)
    picture = _file_asked_for("out", out, (".svg", ".png", ".dxf"), force=force)
    robot, worlds = design_given(design), maps_given(maps)
    profile = recipe_for(robot, recipe).profile
    changed = limits_given(limits)
    facts, deployed = None, tuple[tuple[str, Deployment], ...]()
    if rig is not None:
        from vinefab.rig.rig_json import read_rig

        facts = read_rig(path_given("rig", rig, "a folder that vinefab rig wrote"))
    options = growth_given(growth)
    if worlds:
        from vinefab.prediction.deploy import deploy_from_starts

        with python_words():
            deployed = deploy_from_starts(robot, worlds, options)
    with python_words():
        report = check_design(robot, profile, changed, deployed, worlds, facts)
    if picture is not None:
        write_bytes(picture, findings_file(robot, profile, report, picture), force=force)
    return report


def fix(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    maps: MapLike | Iterable[MapLike] = (),
    keep: str | Iterable[str] = (),
    limits: Mapping[str, Mapping[str, float]] | None = None,
    growth: Mapping[str, object] | None = None,
    progress: Callable[[float, str], None] | bool = True,
) -> ProposedFix:
    """Propose the smallest change of a design that clears its errors.

    Fillets are tried first, then widths, tapers, lengths and angles, fewer branches last.

    Parameters
    ----------
    design
        A design, its path or its name.
    recipe
        A recipe's name or path, or a laser profile; None for that of the run that found the design,
        or else the default.
    maps
        As in `check`; with maps the ``summary`` says what the fix costs in score, too.
    keep
        What must not change: ``branches``, ``length``, ``angle``, ``width``, one or several.
    limits, growth
        As in `check`.
    progress
        True: a line in notebooks and on terminals after two seconds; False: nothing; a function:
        called with the share of the work that is done and a few words.

    Returns
    -------
    ProposedFix
        The changed ``design``, None where nothing had to or could be changed, and its ``report``.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    UnknownNameError
        If there is no such design, recipe or rule.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    >>> fix("plain_vine").summary
    ('fix: no errors, nothing to fix',)
    """
    from vinefab.fabrication.rules.fix import parsed_keeps
    from vinefab.prediction.fix_proposal import propose_fix, score_change_lines

    robot, worlds = design_given(design), maps_given(maps)
    profile = recipe_for(robot, recipe).profile
    changed, options = limits_given(limits), growth_given(growth)
    words = [name_given("keep", word) for word in several_given(keep, str)]
    with python_words(), progress_given("fix", progress) as tell:
        found = propose_fix(
            robot, profile, changed, worlds, lambda share: tell(share, ""),
            growth=options, keep=parsed_keeps(words),
        )  # fmt: skip
        lines = found.lines()
        if found.design is not None and worlds:
            lines += score_change_lines(robot, found.design, worlds, options)
    return ProposedFix(
        design=found.design,
        report=found.after or found.before,
        summary=tuple(as_parameters(line.strip()) for line in lines),
    )


def rules() -> Mapping[str, Rule]:
    """Return the design rules by id, those of other packages too.

    Each has a ``title``, ``limits`` in its ``unit``, a ``reason`` and a ``remedy``.

    Examples
    --------
    >>> rules()["VF-C01"].limits
    mappingproxy({'error': 0.0, 'warning': 2.0})
    """
    from vinefab.fabrication.rule_listing import RuleBook

    return RuleBook.of()


def fabricate(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    out: str | PathLike[str],
    allow_uncalibrated: bool = False,
    copies: int = 1,
    beside: DesignLike | Iterable[DesignLike] = (),
    process: str = "auto",
    pass_through: bool = False,
    r12: bool = False,
    make_zip: bool = False,
    force: bool = False,
) -> WrittenFolder:
    """Write the fabrication package of a design: laser files, checks, report, instructions.

    Parameters
    ----------
    design
        A design, its path or its name.
    recipe
        A recipe's name or path, or a laser profile; None for that of the run that found the design,
        or else the default.
    out
        The folder to write; one of an earlier package is replaced.
    allow_uncalibrated
        Write files for a recipe that no coupon has confirmed.
    copies
        How many robots to nest on one bed.
    beside
        Further designs for the same sheet.
    process
        ``weldcut`` (one pass), ``weld+cut``, or ``auto``: what the recipe has.
    pass_through
        Whether the film may be fed along the bed's width, and be longer than the bed.
    r12
        Also write a DXF of release 12.
    make_zip
        Also write the folder as ``OUT.zip``.
    force
        Overwrite what vinefab did not write.

    Returns
    -------
    WrittenFolder
        Its ``path``, its ``files`` and the ``report`` of the check.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    ExportRefusedError
        If a rule forbids the design, or the recipe is not calibrated; it carries the report.
    ForeignFileError
        If ``out`` holds something else.
    UnknownNameError
        If there is no such design or recipe.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     made = fabricate("plain_vine", out=f"{folder}/vine", allow_uncalibrated=True)
    >>> "outline.dxf" in made.files
    True
    """
    from vinefab.fabrication.job.placement import SheetOptions
    from vinefab.fabrication.package.prepare import PACKAGE_MARK, package, prepare, zip_bytes

    flags_given(
        allow_uncalibrated=allow_uncalibrated,
        pass_through=pass_through,
        r12=r12,
        make_zip=make_zip,
        force=force,
    )
    folder = path_given("out", out)
    archive = folder.with_name(f"{folder.name}.zip")
    ensure_own_folder(folder, PACKAGE_MARK, force=force)
    if make_zip:
        ensure_writable(archive, force=force)
    others = tuple(design_given(other, "beside") for other in several_given(beside, Design))
    sheet = SheetOptions(copies=copies, beside=others, process=process, pass_through=pass_through)
    robot = design_given(design)
    prepared = prepare(robot, recipe_for(robot, recipe).profile, sheet=sheet, r12=r12)
    if why := prepared.refusal(allow_uncalibrated=allow_uncalibrated):
        raise ExportRefusedError(prepared.design.name, as_parameters(why), prepared.report)
    files = package(prepared)
    write_folder(folder, files, PACKAGE_MARK, force=force)
    if make_zip:
        write_bytes(archive, zip_bytes(files, prepared.design.name), force=force)
    return WrittenFolder(path=folder, files=tuple(files), report=prepared.report)


def _forbidding(report: CheckReport) -> str:
    """Return which rules forbid what was checked."""
    return f"{', '.join(sorted({finding.rule for finding in report.blocking}))} forbid it"


def coupon(
    recipe: RecipeLike = DEFAULT_RECIPE, *, out: str | PathLike[str], force: bool = False
) -> WrittenFolder:
    """Write test pieces for a recipe: laser files, what to measure, and a table to fill in.

    Parameters
    ----------
    recipe
        A recipe's name or path, or a laser profile.
    out
        The folder to write; ``README.txt`` in it says what to do, ``results.csv`` is the table.
    force
        Overwrite what vinefab did not write, and a table that was filled in.

    Returns
    -------
    WrittenFolder
        Its ``path``, its ``files`` and the ``report`` of the check.

    Raises
    ------
    BadInputError
        If a value cannot be used, or a coupon is larger than the machine's bed.
    ExportRefusedError
        If a rule forbids the coupons; it carries the report.
    ForeignFileError
        If ``out`` holds something else, or its table was filled in.
    UnknownNameError
        If there is no such recipe.

    Examples
    --------
    >>> coupon("co2_60w__stretchlon_200", out="coupons")  # doctest: +SKIP
    """
    from vinefab.fabrication.calibration.coupon_package import (
        COUPON_MARK,
        coupon_files,
        ensure_results_not_filled_in,
        make_coupons,
    )

    flags_given(force=force)
    folder = path_given("out", out)
    ensure_own_folder(folder, COUPON_MARK, force=force)
    ensure_results_not_filled_in(folder, force=force)
    made = make_coupons(recipe_given(recipe))
    if made.report.blocking:
        raise ExportRefusedError("coupons", _forbidding(made.report), made.report)
    files = coupon_files(made)
    write_folder(folder, files, COUPON_MARK, force=force)
    return WrittenFolder(path=folder, files=tuple(files), report=made.report)


def calibrate(
    results: str | PathLike[str],
    recipe: str | PathLike[str] = DEFAULT_RECIPE,
    *,
    out: str | PathLike[str],
    force: bool = False,
) -> WrittenReport:
    """Fit kerf, seam, shrinkage, burst loads, friction, growth pressure; write a recipe with them.

    Parameters
    ----------
    results
        The table that `coupon` wrote, filled in.
    recipe
        The recipe that the coupons were cut with, its name or path.
    out
        The recipe to write, ``NAME.toml``: what is returned can be passed as ``recipe``.
    force
        Overwrite a file that vinefab did not write.

    Returns
    -------
    WrittenReport
        The recipe's ``path``, the fitted numbers (measured) as ``summary`` and as ``numbers``.

    Raises
    ------
    BadInputError
        If a row cannot be read, or no kind of readings can be fitted; the summary names those
        that cannot.
    ForeignFileError
        If ``out`` is something else.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    >>> mine = calibrate("coupons/results.csv", out="mine.toml")  # doctest: +SKIP
    >>> fabricate("grid_explorer", mine, out="package")  # doctest: +SKIP
    """
    from vinefab.fabrication.calibration.calibrated_recipe import (
        calibrated_recipe,
        calibration_json,
        calibration_lines,
    )
    from vinefab.fabrication.calibration.coupon_results import read_results
    from vinefab.fabrication.calibration.fit_recipe import fitted_recipe

    flags_given(force=force)
    path, table = path_given("out", out), path_given("results", results)
    ensure_writable(path, force=force)
    before = name_or_path("recipe", recipe, "a recipe's path or name")
    profile = read_profile(before)
    with located(table):
        found = fitted_recipe(read_results(table), profile)
    with python_words():
        write_text(path, calibrated_recipe(found, before, path, table), force=force)
    return WrittenReport(
        path=path,
        summary=tuple(calibration_lines(found)),
        numbers=json.loads(calibration_json(found)),
    )


def rig(
    world: MapLike,
    printer: Printer | str | PathLike[str] = DEFAULT_PRINTER,
    *,
    out: str | PathLike[str],
    design: DesignLike | None = None,
    fit_mm: float | None = None,
    lid: bool = False,
    allow_empty: bool = False,
    pictures: bool = True,
    progress: Callable[[float, str], None] | bool = True,
    force: bool = False,
    **sizes: Any,  # noqa: ANN401  each has its own type, see `RigOptions`
) -> WrittenFolder:
    """Write a map as a test rig: printable solids, sheets for the laser, pictures, ``rig.json``.

    Parameters
    ----------
    world
        A map, or the path of a map file.
    printer
        A printer's name or path, or a printer.
    out
        The folder to write; one of an earlier rig is replaced.
    design
        The robot that will be tried on it: its corridors and heights are checked too.
    fit_mm
        Length of the rig's longer side; sets the scale.
    lid
        Add a transparent lid (DXF).
    allow_empty
        Make a bare tray of a map without anything to steer around.
    pictures
        Draw the rig and its beds, and write a page about them.
    progress
        True: a line in notebooks and on terminals after two seconds; False: nothing; a function:
        called with the share of the work that is done and a few words.
    force
        Overwrite what vinefab did not write.
    **sizes
        Such as ``style="board"``, ``height_mm``, ``plate_mm``, ``scale``; all of them:
        `vinefab.rig.rig_options.RigOptions`.

    Returns
    -------
    WrittenFolder
        Its ``path``, its ``files`` and the ``report`` of the rules about rigs.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    ExportRefusedError
        If a rule forbids the rig; it carries the report.
    ForeignFileError
        If ``out`` holds something else.
    UnknownNameError
        If there is no such printer or design.

    Examples
    --------
    >>> from vinefab import maps
    >>> made = rig(maps.pegs(seed=4), "generic_220", out="rig", fit_mm=300)  # doctest: +SKIP
    """
    from vinefab.rig.make import RIG_MARK, RigRequest, make_rig
    from vinefab.rig.rig_options import Printer, RigOptions, read_printer

    flags_given(lid=lid, allow_empty=allow_empty, pictures=pictures, force=force)
    folder = path_given("out", out)
    ensure_own_folder(folder, RIG_MARK, force=force)
    place, machine = map_given(world, "world"), printer
    if not isinstance(machine, Printer):
        allowed = f"a Printer, a path, or one of {', '.join(printers())}"
        machine = read_printer(name_or_path("printer", machine, allowed))
    options = RigOptions(**sizes)
    request = RigRequest(
        design=None if design is None else design_given(design),
        allow_empty=allow_empty,
        pictures=pictures,
        lid=lid,
    )
    with python_words(), progress_given("rig", progress) as tell:
        if fit_mm is not None:
            options = options.fitted(place, number("fit_mm", fit_mm, 0.0, 1e6, "mm"))
        made = make_rig(place, machine, options, request, progress=tell)
    if made.report.blocking:
        raise ExportRefusedError(f"rig of {place.name}", _forbidding(made.report), made.report)
    write_folder(folder, made.files, RIG_MARK, force=force)
    return WrittenFolder(path=folder, files=tuple(made.files), report=made.report)


def observe(
    photo: str | PathLike[str],
    map: MapLike,
    design: DesignLike,
    pose: PoseLike | None = None,
    *,
    rig: str | PathLike[str] | None = None,
    corners_px: Iterable[float] | None = None,
    obstacle_height_mm: float | None = None,
    film_colour: tuple[int, int, int] | None = None,
    outline: str | PathLike[str] | None = None,
    growth: Mapping[str, object] | None = None,
    out: str | PathLike[str] | None = None,
    force: bool = False,
) -> PhotoReport:
    """Trace a grown robot on a photo from above (measured) and compare it with its prediction.

    Parameters
    ----------
    photo
        A JPEG or PNG file.
    map
        The map that the rig was made from, or the path of its file.
    design
        A design, its path or its name.
    pose
        Where the robot was launched, ``(x_mm, y_mm, heading_deg)``; the map's first start if None.
    rig
        The rig's ``rig.json``: where its markers lie and how high its obstacles are. Without it,
        markers are looked for where `vinefab rig` puts them.
    corners_px
        Instead of markers: column and row of the lower left, lower right, upper right and upper
        left corner of the bounds' box in the photo, eight numbers.
    obstacle_height_mm
        Height of the obstacles, which hide what lies behind them.
    film_colour
        Red, green and blue of the film, 0 to 255; None: as it is at the base.
    outline
        The film outlined by hand: GeoJSON in map millimetres, or SVG in pixels of the photo.
    growth
        Growth options of the prediction by name, as in ``Design.grow``.
    out
        A page (``.html``) to write, or the numbers (``.json``), which `fit_observations` reads.
    force
        Overwrite a file that vinefab did not write.

    Returns
    -------
    PhotoReport
        A ``summary`` in lines, all ``numbers``, and the ``path`` of what was written.

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
    >>> seen = observe("photo.jpg", "grid.geojson", "grid_explorer")  # doctest: +SKIP
    >>> seen.numbers["summary"]["shape_error_mm"]  # doctest: +SKIP
    """
    from vinefab.observation.observe_photo import observe_photo
    from vinefab.observation.photo_setup import PhotoSetup
    from vinefab.photos.photo import read_photo
    from vinefab.prediction.deploy import first_start

    flags_given(force=force)
    page = _file_asked_for("out", out, (".html", ".json"), force=force)
    world, robot = map_given(map), design_given(design)
    corners = "columns and rows of four corners, eight numbers"
    colour = "red, green and blue, 0 to 255"
    with python_words():
        setup = PhotoSetup.of(
            rig=None if rig is None else path_given("rig", rig),
            corners_px=None
            if corners_px is None
            else listed_given("corners_px", corners_px, corners),
            obstacle_mm=obstacle_height_mm,
            film_colour=None
            if film_colour is None
            else listed_given("film_colour", film_colour, colour),
            outline=None if outline is None else path_given("outline", outline),
        )
        start = first_start(world) if pose is None else Pose.of(pose)
        seen = observe_photo(
            read_photo(path_given("photo", photo)),
            world,
            robot,
            start,
            setup,
            growth=growth_given(growth),
            map_file=world.name if isinstance(map, Map) else str(map),
            design_file=robot.name if isinstance(design, Design) else str(design),
        )
    text = seen.json_text()
    if page is not None:
        is_json = page.suffix.lower() == ".json"
        write_text(page, text if is_json else seen.page(), force=force)
    numbers = json.loads(text)
    return PhotoReport(path=page, summary=seen.summary, numbers=numbers)


def fit_observations(
    observations: str | PathLike[str] | Iterable[str | PathLike[str]],
    *,
    angle_error_deg: float = 2.0,
    out: str | PathLike[str] | None = None,
    force: bool = False,
) -> PhotoReport:
    """Fit several observations: half-angle, friction of the tip and widths, with 95 % intervals.

    Parameters
    ----------
    observations
        JSON files of observations, one for each photo, or what `observe` returned for such ``out``.
    angle_error_deg
        Standard error of the angles of contacts where an observation does not give it (assumed).
    out
        A file (TOML) to write; predictions read it with ``contacts=out``.
    force
        Overwrite a file that vinefab did not write.

    Returns
    -------
    PhotoReport
        A ``summary`` in lines, all ``numbers``, and the file's ``path``.

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
    >>> fitted = fit_observations(["one.json", "two.json"], out="mine.toml")  # doctest: +SKIP
    >>> fitted.numbers["head_on_half_angle_deg"]["low"]  # doctest: +SKIP
    """
    from vinefab.observation.contact_fit import fit_files

    flags_given(force=force)
    file = None if out is None else path_given("out", out)
    if file is not None:
        ensure_writable(file, force=force)
    paths = [path_given("observations", one) for one in several_given(observations, Path)]
    with python_words():
        found = fit_files(paths, angle_error_deg)
    if file is not None:
        write_text(file, found.text(), force=force)
    return PhotoReport(
        path=file, summary=tuple(found.lines()), numbers=json.loads(found.json_text())
    )


def report(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    out: str | PathLike[str],
    maps: MapLike | Iterable[MapLike] = (),
    environment: str | None = None,
    count: int = 100,
    options: Mapping[str, object] | None = None,
    poses: int = 3,
    seed: int = 0,
    body: str | None = None,
    head_on_half_angle_deg: float | tuple[float, float] | None = None,
    contacts: ContactsLike | None = None,
    growth: Mapping[str, object] | None = None,
    progress: Callable[[float, str], None] | bool = True,
    force: bool = False,
) -> WrittenReport:
    """Write predictions (simulated), rules and materials of a design as one HTML page.

    Parameters
    ----------
    design
        A design, its path or its name.
    recipe
        A recipe's name or path, or a laser profile; None for that of the run that found the design,
        or else the default.
    out
        The page to write.
    maps
        Maps or paths of map files to predict for.
    environment
        Predict for unseen maps of this environment too: ``grid``, ``cave``, ...
    count
        How many unseen maps.
    options
        The environment's options, such as ``{"size_mm": 300}``.
    poses
        Poses drawn per map.
    seed
        Seed of unseen maps and poses.
    body
        ``inflated`` or ``centerline``, as in ``Design.grow``; None: as the design was trained.
    head_on_half_angle_deg
        As in ``Design.grow``; a range ``(low, high)`` gives every deployment a value of its own.
    contacts
        Numbers that photos measured, as in ``Design.grow``.
    growth
        Any growth options by name, as in ``Design.grow``.
    progress
        True: a line in notebooks and on terminals after two seconds; False: nothing; a function:
        called with the share of the work that is done and a few words.
    force
        Overwrite a file that vinefab did not write.

    Returns
    -------
    WrittenReport
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
    >>> page = report("grid_explorer", environment="grid", out="page.html")  # doctest: +SKIP
    >>> print(page.summary[0])  # doctest: +SKIP
    """
    from vinefab.growth.options import GrowthChoice
    from vinefab.prediction.family_deployments import PredictionPlan
    from vinefab.prediction.predict import part_of, predict
    from vinefab.prediction.provenance import origin_of

    flags_given(force=force)
    path = _file_to_write("out", out, (".html",), force=force)
    robot = design_given(design)
    chosen = recipe_for(robot, recipe)
    profile = chosen.profile
    given = growth_given(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    grown = GrowthChoice.of([robot], given).options
    plan = PredictionPlan(
        poses=whole("poses", poses, 1, _MOST_POSES),
        seed=whole("seed", seed, 0, _MOST_SEED),
        options=grown,
    )
    families, places = _families(maps, environment, count, seed, options)
    made = call_text(chosen.recipe or profile)
    call = f"vf.report({call_text(design)}, {made}, out={str(path)!r}, {places}, "
    call += f"{poses=}, {seed=}, growth={grown.content})"
    origin = origin_of(call, [robot], profile, families)
    with progress_given("report", progress) as tell:
        found = predict(robot, profile, families, plan, part_of(tell, 0.0, 0.6))
        found = replace(found, origin=origin)
        page = found.page(part_of(tell, 0.6, 1.0))
    write_text(path, page, force=force)
    return WrittenReport(
        path=path,
        summary=found.summary,
        numbers=found.numbers,
    )


def _searched(
    settings: RunSettings,
    task: Task | None,
    workers: int,
    progress: Callable[[Progress], None],
) -> RunResult:
    """Return the result of a search that is not recorded."""
    from vinefab.prediction.run_winner import predict_winner
    from vinefab.search.loop import Search
    from vinefab.search.run import fresh_maps, penalty_of, recipe_of, training_maps

    maps, fresh = training_maps(settings), fresh_maps(settings)
    search = Search.of(settings, maps, penalty_of(settings), task=task, fresh_maps=fresh)
    result, recipe = search.run(progress=progress, workers=workers), recipe_of(settings)
    if recipe is not None:
        result = result.with_recipe(recipe)
    return result.with_prediction(predict_winner(search, result))
