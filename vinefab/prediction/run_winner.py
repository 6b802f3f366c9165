"""A run in a folder, and the expected scores of its winner elsewhere.

A winner is tried on unseen maps, over what contacts may be like, and placed off.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError, VinefabError
from vinefab.core.plain_text import counted
from vinefab.core.progress import each, heard_by, phase
from vinefab.core.statistics import MeanValue
from vinefab.core.validation import Floats
from vinefab.core.view import Answer, Block, Fact, Facts, Number, Picture, Rows, Section
from vinefab.fabrication.checking import check_design
from vinefab.fabrication.findings_picture import findings_picture
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.pieces.partition import pieces_of
from vinefab.fabrication.rules.catalog import RULES, by_rule, changed_limits
from vinefab.growth.batch import Batch
from vinefab.growth.options import GrowthOptions, on_maps
from vinefab.growth.plan import Plans
from vinefab.inflation.pattern import pattern_of
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.files.run_context import ChosenRecipe
from vinefab.model.finding import CheckReport, Finding, Severity
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map, Pose
from vinefab.model.score import FAILED_PERCENT, HARDLY_GROWN, NOTHING_TOUCHED, Failures
from vinefab.model.start import StartPlace, start_text, with_starts
from vinefab.pages.html import page
from vinefab.pages.page_files import page_svg
from vinefab.pages.plan import STOP_WORDS
from vinefab.prediction.family_deployments import (
    TOO_FINE,
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deployment_picture,
    stop_table,
    unseen_maps,
)
from vinefab.prediction.measures import worst_pressures_of
from vinefab.prediction.prediction_width import (
    COST_CAPTION,
    ContactRange,
    cost_chart,
    cost_row,
    moved_poses,
    placings,
    range_over_contacts,
)
from vinefab.prediction.pressure_window import PressureWindow, window_over
from vinefab.search.evaluator import PointEvaluator, final_seed, with_pose_range
from vinefab.search.free_space import space_of
from vinefab.search.manufacturability import run_profile
from vinefab.search.optimizers.optimizer import OptimizerConfig
from vinefab.search.record.generations import curve_of
from vinefab.search.record.result import (
    RECORD_FILE,
    RunArchive,
    RunResult,
    resumed_limits,
)
from vinefab.search.record.winner import (
    FamilyScores,
    PlacedOff,
    RuleScores,
    WinnerPieces,
    WinnerPrediction,
)
from vinefab.search.run import FRESH_MAPS, Search, chooses_on_fresh_maps, run_search, violations_of
from vinefab.search.run_pages import PAGE_NAME, LivePage, run_facts, search_section
from vinefab.search.settings import RunSettings, has_own_targets, run_task
from vinefab.tasks.evaluate import PreparedMap, score_designs, trunks_with_room
from vinefab.tasks.reach import design_touches, touched_targets
from vinefab.tasks.task import Task


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EndedRun:
    """A run that has ended, with the values that its page needs."""

    result: RunResult
    settings: RunSettings
    maps: tuple[Map, ...]  # the training maps
    # the winner's families, where they were prepared in this session: training maps and elsewhere
    prepared: tuple[PreparedFamily, PreparedFamily] | None = None

    @classmethod
    def read(cls, folder: Path, result: RunResult | None = None) -> "EndedRun":
        """Return a run from the record in its folder.

        Parameters
        ----------
        result
            Its result, where it is known with the times and notes of this session.
        """
        archive = RunArchive.read(folder / RECORD_FILE)
        settings = archive.settings
        run = cls(result=result or archive.result(), settings=settings, maps=archive.maps)
        if result is None and not run.result.fabricable:
            profile = run.profile() if run.result.checked else None
            broken = violations_of(run.result, settings, profile)
            run = replace(run, result=replace(run.result, violations=broken))
        return run

    @property
    def design(self) -> Design:
        """The winner."""
        return self.result.best

    @property
    def growth(self) -> GrowthOptions:
        """How it is grown to be drawn: as in the run, at the low end of a range of contacts."""
        return self.settings.growth.at_one_angle

    def families(self) -> tuple[PreparedFamily, PreparedFamily]:
        """Return the training maps with their first starts, and the maps of the prediction."""
        if self.prepared is not None:
            return self.prepared
        share = self.settings.evaluation.pose_range
        maps = tuple(PreparedMap.of(with_pose_range(world, share)) for world in self.maps)
        training = first_starts(maps)
        return training, unseen_family(self.settings, training)[0]

    def grown(self, family: PreparedFamily) -> Sequence[Deployment]:
        """Return the winner deployed from every pose of a family."""
        plans = Plans.of([self.design], self.growth)
        return Batch(plans, family.launches(), self.growth).regrown()

    def profile(self) -> LaserProfile:
        """Return the recipe that the winner is checked with."""
        if self.result.recipe:
            return ChosenRecipe.of(self.design).profile
        return run_profile(self.settings.evaluation)


def run_in_folder(  # noqa: PLR0913  options by keyword
    settings: RunSettings,
    folder: Path,
    *,
    again: str,
    page: bool = True,
    resume: bool = False,
    limits: Mapping[str, float] | None = None,
    workers: int | PointEvaluator = 1,
    source: Path | None = None,
    task: Task | None = None,
    optimizer: OptimizerConfig | None = None,
) -> EndedRun:
    """Run the optimizer with its record, and predict what its winner does elsewhere.

    Parameters
    ----------
    again
        The command that resumes the run.
    page
        Whether to keep a page of the run current while it is going on.
    resume, limits, workers, source, task, optimizer
        As in `vinefab.search.run.run_search`.
    """
    ended: EndedRun | None = None

    def predict(run: Search, result: RunResult) -> WinnerPrediction:
        nonlocal ended
        found, elsewhere = predicted(run, result)
        prepared = first_starts(run.evaluator.maps), elsewhere
        ended = EndedRun(result=result, settings=run.settings, maps=run.maps, prepared=prepared)
        return found

    def search() -> EndedRun:
        result = run_search(
            settings,
            folder,
            resume=resume,
            limits=limits,
            workers=workers,
            predict=predict,
            source=source,
            task=task,
            optimizer=optimizer,
        )
        return EndedRun.read(folder, result) if ended is None else replace(ended, result=result)

    if not page:
        return search()
    shown = resumed_limits(folder, settings) if resume else settings
    with LivePage(folder, shown, again) as live, heard_by(live.update):
        return search()


UNSEEN_DEPLOYMENTS = 50
"""Deployments that a winner is tried in elsewhere, each on a separate map where maps are
generated: the same maps for every run of an environment, so that runs can be compared."""


def predict_winner(search: Search, result: RunResult) -> WinnerPrediction:
    """Return the expected scores of a run's winner elsewhere (simulated)."""
    return predicted(search, result)[0]


def predicted(search: Search, result: RunResult) -> tuple[WinnerPrediction, PreparedFamily]:
    """Return the prediction of `predict_winner`, and the maps elsewhere with their poses.

    A winner is scored by the task of its run, areas as in the search (within 0.001).
    """
    settings, evaluator = search.settings, search.evaluator
    design, task = result.finalists[0].design, evaluator.spec.search_task
    trained = on_maps(settings.growth, [prepared.world for prepared in evaluator.maps])
    usual = trained.at_one_angle.changed(emergence=trained.emergence)
    fresh = PreparedFamily(
        label=counted(len(evaluator.maps), "training map"),
        maps=evaluator.maps,
        poses=evaluator.final_conditions(settings.search.seed).poses,
    ).distinct
    unseen, note = unseen_family(settings, fresh)
    families = {"unseen": unseen, "training": fresh}

    @cache
    def scores(family: PreparedFamily, growth: GrowthOptions) -> Floats:
        (score,) = score_designs([design], family.maps, family.launches(), task, growth)
        return score.scores

    def range_of(family: PreparedFamily) -> ContactRange:
        return range_over_contacts(
            design, family, usual, lambda growth: {"score": scores(family, growth)}
        )

    tried = each("families of maps for the winner", families, lambda name: f"{name} maps")
    ranges = {name: range_of(families[name]) for name in tried}

    def scores_on(name: str) -> FamilyScores:
        family = families[name]
        found, names = scores(family, usual), family.launch_names
        return FamilyScores(
            label=family.label,
            maps=len(family.maps),
            deployments=len(found),
            score=MeanValue.of(found, names),
            scores=tuple(round(score, 4) for score in found.tolist()),
            failed=_failures(design, family, usual, task),
            over_contacts=ranges[name].values["score"],
        )

    placed = []
    for knob, step, unit, move in each("places a little off", list(placings())):
        count, change = _placed_off(design, unseen, usual, move, partial(scores, growth=usual))
        placed.append(
            PlacedOff(
                knob=knob,
                step=step,
                unit=unit,
                deployments=count,
                change=change.mean,
                low=change.low,
                high=change.high,
                over=change.over,
            )
        )
    rules = zip(ranges["unseen"].rules, ranges["training"].rules, strict=True)
    found = WinnerPrediction(
        task=settings.task.name,
        title=result.score.title_of_task,
        head_on_half_angles_deg=trained.contact_angles_deg,
        head_on_half_angles_standing=trained.contact_angles_standing,
        trained_half_angle_deg=settings.growth.half_angle_deg,
        unseen=scores_on("unseen"),
        training=scores_on("training"),
        rules=tuple(
            RuleScores(
                option=rule.option,
                choices=rule.choices,
                standing=rule.standing,
                unseen=rule.values["score"],
                training=trained.values["score"],
            )
            for rule, trained in rules
        ),
        placed_off=tuple(placed),
        note=note,
    )
    if evaluator.penalty is not None and (window := window_on(design, unseen, settings)):
        found = replace(found, pressure_window=window.of_winner)
    if design.build.pieces is not None:
        profile = run_profile(settings.evaluation)
        with phase("flat pieces of the winner"):
            cut = pieces_of(pattern_of(design, profile), profile)
        pieces = WinnerPieces(
            count=None if cut.unparted else len(cut.pieces),
            proven_least=cut.proven_least and not cut.unparted,
        )
        found = replace(found, pieces=pieces)
    return found, unseen


def window_on(
    design: Design, family: PreparedFamily, settings: RunSettings
) -> PressureWindow | None:
    """Return the pressure window of a winner on some maps; None where nothing emerged."""
    # What growth to every tip needs is known only where no pressure stops it.
    free = settings.growth.at_one_angle.changed(pressure_stop=False)
    grown = Batch(Plans.of([design], free), family.launches(), free).regrown()
    loose, tight = worst_pressures_of(grown)
    return window_over(design, run_profile(settings.evaluation), loose, tight)


def _failures(
    design: Design, family: PreparedFamily, growth: GrowthOptions, task: Task
) -> Failures:
    """Return in how many deployments a robot touches no target, or hardly leaves its base."""
    launches, names = family.launches(), family.launch_names
    worlds = [place.world for place in family.maps]
    touched = design_touches(design, worlds, launches, growth, task)
    if touched is not None and all(len(one.touched) == len(names) for one in touched.outcomes):
        nothing = np.sum([one.touched for one in touched.outcomes], axis=0) == 0.0
        return Failures.of(nothing, names, NOTHING_TOUCHED)
    batch = Batch(Plans.of([design], growth), launches, growth)
    grown = batch.each(
        lambda one: np.add.reduceat(one.growth.grown, one.branch[:-1]) / one.planned_mm()
    )
    hardly = 100.0 * np.concatenate(list(grown)) < FAILED_PERCENT
    return Failures.of(hardly, names, HARDLY_GROWN)


def _placed_off(
    design: Design,
    family: PreparedFamily,
    growth: GrowthOptions,
    move: Callable[[Pose], Pose],
    scores: Callable[[PreparedFamily], Floats],
) -> tuple[int, MeanValue]:
    """Return from how many poses the body is placed elsewhere, and the change; NaN without any."""
    # Not where the trunk has no room there, or had none before.
    poses = [
        [
            pose is not None
            and all(trunks_with_room(design, [place], ((before, pose),), growth))
            and pose
            for before, pose in zip(places, row, strict=True)
        ]
        for place, places, row in zip(
            family.maps, family.poses, moved_poses(family, move), strict=True
        )
    ]
    free = np.array([bool(pose) for row in poses for pose in row])
    if not free.any():
        return 0, MeanValue(mean=math.nan, low=math.nan, high=math.nan, over="")
    kept = tuple(tuple(pose for pose in row if pose) for row in poses)
    exact = scores(family)
    values = np.full(len(exact), np.nan)
    values[free] = scores(family.with_poses(kept))
    return int(free.sum()), MeanValue.of(values - exact, family.launch_names)


def first_starts(maps: tuple[PreparedMap, ...]) -> PreparedFamily:
    """Return training maps with their first starts."""
    poses = tuple((prepared.world.starts[0].pose,) for prepared in maps)
    return PreparedFamily(label="training maps", maps=maps, poses=poses)


def unseen_family(settings: RunSettings, fresh: PreparedFamily) -> tuple[PreparedFamily, str]:
    """Return unseen maps of a run's environment, or other poses on its own maps and why.

    Parameters
    ----------
    fresh
        The training maps.
    """
    start, note = settings.maps.start, ""
    if has_own_targets(settings):
        note = "on no unseen maps, because the run's targets are given points"
    elif start is not None and not (isinstance(start, StartPlace) and start.side):
        note = "on no unseen maps, because the run's start is a place on its own"
    share = settings.evaluation.pose_range
    if not settings.maps.files and not note:
        environment, options = settings.maps.environment, settings.maps.options
        try:
            family = unseen_maps(environment, UNSEEN_DEPLOYMENTS, 0, options)
            if start is not None:  # from the side that the run starts from
                worlds = tuple(with_starts(one, (start,), "maps.start") for one in family.worlds)
                label = f"{family.label} from the {start_text(start)}"
                family = MapFamily(label=label, worlds=worlds)
            worlds = tuple(with_pose_range(world, share) for world in family.worlds)
            return _prepared(replace(family, worlds=worlds), settings, 1, 0), note
        except BadInputError as error:
            note = f"on no unseen maps, because one of them cannot be used: {error}"
    worlds = tuple(prepared.world for prepared in fresh.maps)
    count = math.ceil(UNSEEN_DEPLOYMENTS / len(worlds))
    label = f"other poses on the {counted(len(worlds), 'training map')}"
    family = MapFamily(label=label, worlds=worlds)
    # Poses by which the winner was not chosen.
    seed = final_seed(settings.search.seed) + len(worlds)
    return _prepared(family, settings, count, seed), note


def _prepared(family: MapFamily, settings: RunSettings, poses: int, seed: int) -> PreparedFamily:
    plan = PredictionPlan(poses=poses, seed=seed, options=settings.growth.at_one_angle)
    return PreparedFamily.of(family, plan).distinct


# --- The page of a run that has ended, with its folder of pictures --------------------------------


PICTURES = "pictures"
"""The folder with the pictures of the page, next to it."""


MOST_TRAINING_SHOWN = 3
"""Training maps that the winner is drawn on."""

NEAR = 0.1
"""A rule is close to its limit where a limit stricter by this share would be broken."""

EDGE = 0.01
"""A winner touches a bound that it is nearer to than this share of the range."""


def write_run_page(folder: Path, run: EndedRun, *, force: bool = False) -> Path:
    """Write the page of a run that has ended, and its pictures next to it."""
    blocks = list(run_blocks(run))
    pictures = [block for block in blocks if isinstance(block, Picture)]
    pictures += [one for block in blocks if isinstance(block, Section) for one in block.pictures]
    for picture in each("pictures of the page", pictures):
        write_bytes(folder / PICTURES / picture.file_name, picture.drawn, force=force)
    title = f"{run.settings.name}: the best design found"
    return write_text(folder / PAGE_NAME, page(title, blocks), force=force)


def run_blocks(run: EndedRun) -> Iterator[Block]:
    """Yield the page of a run that has ended, the answer and a picture first."""
    try:
        checked: CheckReport | str = check_design(run.design, run.profile())
    except VinefabError as error:
        checked = str(error)
    training, unseen = run.families()
    elsewhere = run.grown(unseen)
    pictures, sections = _shown(run, training, unseen, elsewhere)
    # The winner is drawn on maps first, and flat with the rules below.
    view = [one for one in run.result.view() if not isinstance(one, Picture)]
    answers: list[Block] = [one for one in view if isinstance(one, Answer)]
    lead: list[Block] = [one for one in view if isinstance(one, Facts) and one.lead]
    yield from (*answers, *pictures, *lead)
    if run.result.prediction is not None:
        yield _cost_picture(run.result.prediction)
    above = {id(one) for one in (*answers, *lead)}
    yield from (one for one in view if id(one) not in above)
    by = "on these poses"
    if run.settings.evaluation.finalists_by == "contact_range":
        by = "over the range of contacts"
    elif chooses_on_fresh_maps(run.settings):
        by = f"on {FRESH_MAPS} other maps that the search did not see"
    chosen = Fact("winner chosen", f"among the finalists by fitness {by}")
    yield Facts((*run_facts(run.settings), chosen))
    yield _sheet_section(run, checked)
    yield from sections
    if run.result.prediction is not None:
        yield _width_section(run.result.prediction)
    yield _limit_section(run, checked, unseen.label, elsewhere)
    yield _found_section(run)
    rows = (
        ("best.toml", "the winner: vinefab grow, score, check, report and fabricate take it"),
        ("run.sqlite", "the record: every generation, maps, settings; vinefab runs reads it"),
        (f"{PICTURES}/", "the pictures of this page"),
    )
    yield Section(
        title="Files and time",
        paragraphs=(f"The last session: {run.result.times.summary}.",),
        tables=(Rows(caption="In this folder", headings=("file", "what"), rows=rows),),
        folded=True,
    )


def _cost_picture(found: WinnerPrediction) -> Picture:
    """Return the cost of contacts to the winner's score, as one picture."""
    score, standing = found.unseen.score, found.head_on_half_angles_standing
    ranges = [
        ("", found.head_on_half_angles_deg, found.unseen.over_contacts, standing),
        *((rule.option, rule.choices, rule.unseen, rule.standing) for rule in found.rules),
    ]
    rows = [
        cost_row(option, choices, [value.mean for value in values], known_by)
        for option, choices, values, known_by in ranges
    ]
    known = [score.mean, *((score.low, score.high) if score.has_interval else ())]
    chart = cost_chart(f"{found.title} score, simulated", known, rows)
    return Picture(image=page_svg(chart), caption=COST_CAPTION, file="contacts")


def _shown(
    run: EndedRun,
    training: PreparedFamily,
    unseen: PreparedFamily,
    elsewhere: Sequence[Deployment],
) -> tuple[tuple[Picture, ...], tuple[Section, ...]]:
    """Return the winner on unseen maps, worst, median and best, and the rest of its deployments."""
    kept = min(len(training.maps), MOST_TRAINING_SHOWN)
    grown = run.grown(training)
    places = unseen.launches().terrain.tolist()
    typical = [(0, "unseen_1", "the first pose")]
    found = run.result.prediction
    scores = () if found is None else found.unseen.scores
    if len(scores) == (count := len(places)):
        order = np.argsort(scores, kind="stable").tolist()
        chosen = {order[0]: "worst", order[len(order) // 2]: "median", order[-1]: "best"}
        typical = [
            (index, f"unseen_{name}", f"{name} of {count}, {scores[index]:.3f}")
            for index, name in chosen.items()
        ]
    pictures = tuple(
        _drawn(run, name, unseen.maps[places[index]].world, elsewhere[index], words)
        for index, name, words in typical
    )
    on_training = tuple(
        _drawn(run, f"training_{index + 1}", training.maps[index].world, grown[index], "its start")
        for index in range(kept)
    )
    # A run with given maps has no unseen ones.
    where = unseen.label if unseen.label.startswith("other poses") else "unseen maps"
    ended = stop_table(unseen.label, elsewhere)
    return pictures, (
        Section(title="The winner on its training maps", pictures=on_training, folded=True),
        Section(title=f"How branches end on {where}", tables=(ended,), folded=True),
    )


def _drawn(run: EndedRun, name: str, world: Map, deployment: Deployment, words: str) -> Picture:
    touched = touched_targets([(deployment, world)], run_task(run.settings))
    image = deployment_picture(
        run.design, world, deployment, run.growth, whole=True, touched=touched
    )
    return Picture(image=image, caption=f"{world.name}, {words} (simulated).", file=name)


_KNOWN = {
    True: "Whether a tip that meets a wall slides on or stops there is not known,",
    False: "Whether a tip that meets a wall slides on or stops there is measured only as far as "
    "the range says,",
}


def _width_section(found: WinnerPrediction) -> Section:
    """Return how wide a prediction is."""
    standing = found.head_on_half_angles_standing
    signed = partial(Number, form="+.3f")
    placed = Rows(
        caption=f"Change of the mean {found.title} score on {found.unseen.label} when the body is "
        "placed elsewhere than meant, with its 95 % interval over maps (simulated)",
        headings=("placed off by", "change", "95 % interval", "deployments"),
        rows=tuple(
            (
                f"{one.knob} {one.step:+g} {one.unit}",
                signed(one.change),
                f"{one.low:+.3f} to {one.high:+.3f}; {one.over}" if math.isfinite(one.low) else "-",
                one.deployments,
            )
            for one in found.placed_off
        ),
    )
    words = (
        f"{_KNOWN[not standing.startswith('measured')]} nor how well a "
        "body is placed: what a robot will do lies in these ranges. Positive headings turn the "
        "base to its left, positive positions move it to its left; places without room for the "
        "trunk are left out."
    )
    return Section(
        title="How wide the score is", paragraphs=(words,), tables=(placed,), folded=True
    )


def _sheet_section(run: EndedRun, checked: CheckReport | str) -> Section:
    """Return the flat robot with the findings at their places."""
    title = "The flat sheet and the findings of the rules"
    if isinstance(checked, str):
        return Section(title=title, paragraphs=(f"Not checked: {checked}.",))
    asked = "" if run.settings.evaluation.fabricable else " The search did not ask for it."
    words = (f"{checked.verdict}; recipe {run.profile().recipe.name}.{asked}",)
    if run.design.branch_count > TOO_FINE:
        return Section(
            title=title,
            paragraphs=(*words, "Too many branches to be drawn here: vinefab check --svg does."),
        )
    image = page_svg(findings_picture(run.design, run.profile(), checked))
    caption = "The body with its seam, as it is cut, and every finding at its place (computed)."
    picture = Picture(image=image, caption=caption, file="sheet")
    return Section(title=title, paragraphs=words, pictures=(picture,))


def _limit_section(
    run: EndedRun, checked: CheckReport | str, where: str, elsewhere: Sequence[Deployment]
) -> Section:
    """Return the limits of the winner: walls and pressure, rules, bounds of the space."""
    bounds = list[tuple[str, str, str]]()  # variables that lie at an end of their ranges
    space = space_of(run.settings.space, run.settings.build)
    for one in space.values(run.result.finalists[0].x):
        near = EDGE * (one.high - one.low) if not one.is_whole else 0.0
        for name, end in (("least", one.low), ("most", one.high)):
            if abs(one.value - end) <= near:
                bounds.append((one.name, f"{one.value:g}", f"{name}, {end:g}"))
    tables = [
        Rows(
            caption=f"Rules that the winner breaks, or would if limits were {100 * NEAR:.0f} % "
            "stricter (computed)",
            headings=("rule", "what", "measured", "limit", "branches"),
            rows=() if isinstance(checked, str) else _rule_rows(run, checked),
        ),
        Rows(
            caption="Variables of the search in which the winner lies at an end of its range",
            headings=("variable", "winner", "end of its range"),
            rows=tuple(bounds),
        ),
    ]
    stops = np.concatenate([deployment.stop for deployment in elsewhere])
    shares = [
        f"{100 * share:.0f} % {STOP_WORDS[stop]}"
        for stop in Stop
        if (share := float(np.mean(stops == stop))) > 0.0
    ]
    empty = [table.caption for table in tables if not table.rows]
    kept = space.limits_text(run.design)
    return Section(
        title="What limits it",
        paragraphs=(
            f"How its branches end on {where} (simulated): {', '.join(shares)}.",
            *([f"Limits of the space: {kept} (planned)."] if kept else []),
            *_bed_words(run, checked),
            *(f"{caption}: none." for caption in empty),
        ),
        tables=tuple(table for table in tables if table.rows),
        folded=True,
    )


def _bed_words(run: EndedRun, checked: CheckReport | str) -> tuple[str, ...]:
    """Return how much of the bed the flat robot takes, where it is nearly all of a side."""
    if isinstance(checked, str) or run.design.branch_count > TOO_FINE:
        return ()
    machine = run.profile().machine
    facts = laser_job(run.design, run.profile()).facts
    if "box_width_mm" not in facts:
        return ()  # in tiles, as it is larger than the bed
    wide, high = (float(str(facts[f"box_{side}_mm"])) for side in ("width", "height"))
    most_wide, most_high = machine.usable_mm
    if max(wide / most_wide, high / most_high) < 1.0 - NEAR:
        return ()
    return (
        f"The bed of {machine.name}: the flat robot takes {wide:.0f} x {high:.0f} mm of its "
        f"{most_wide:g} x {most_high:g} mm (computed). A larger bed, a shorter tail "
        "(build.tail_mm) or pieces (build.pieces) leave more room.",
    )


def _rule_rows(run: EndedRun, checked: CheckReport) -> tuple[tuple[str, ...], ...]:
    """Return the findings of the rules, and of the same rules a little stricter."""
    found = {finding.rule: (finding, finding.limit) for finding in reversed(checked.findings)}
    close: dict[str, tuple[Finding, float | None]] = {}
    if run.design.branch_count <= TOO_FINE:
        profile = run.profile()
        changed = by_rule(changed_limits(run.design, profile))
        for factor in (1.0 - NEAR, 1.0 + NEAR):
            scaled = {
                rule.id: {
                    name: factor * value
                    for name, value in {**rule.limits, **changed.get(rule.id, {})}.items()
                    if name.endswith(("error", "warning"))
                }
                for rule in RULES.values()
            }
            stricter = check_design(run.design, profile, scaled)
            for finding in stricter.findings:
                if finding.rule not in found and finding.limit is not None:
                    close.setdefault(finding.rule, (finding, finding.limit / factor))
    ranks = list(Severity)
    return tuple(
        (
            one.rule,
            f"{how} ({one.severity}): {one.title if kind is found else RULES[one.rule].title}",
            Number(one.measured, one.unit).text,
            Number(limit, one.unit).text,
            ", ".join(one.branches[:4]),
        )
        for how, kind in (("broken", found), ("close", close))
        for one, limit in sorted(kind.values(), key=lambda pair: ranks.index(pair[0].severity))
    )


def _found_section(run: EndedRun) -> Section:
    """Return how the winner was found."""
    history = run.result.history
    section = search_section(run.result, ())
    pictures = tuple(replace(picture, file="curve") for picture in section.pictures)
    best, _, _ = curve_of(history)
    last = int(np.argmax(best == best[-1])) + 1 if np.isfinite(best[-1]) else len(history)
    words = [f"The best fitness improved for the last time in generation {last} of {len(history)}."]
    if run.settings.evaluation.fabricable:
        share = 100.0 * float(np.mean([g.fabricable_share for g in history]))
        end = 100.0 * history[-1].fabricable_share
        words.append(
            f"By the quick rules {share:.0f} % of all designs were manufacturable, {end:.0f} % in "
            "the last generation."
        )
    paragraphs = (*section.paragraphs, *words)
    return replace(section, paragraphs=paragraphs, pictures=pictures, folded=True)
