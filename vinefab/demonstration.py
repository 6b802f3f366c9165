"""The main job at small size: from training maps to files for the laser and the printer."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from vinefab.core.atomic import fill_folder
from vinefab.core.compiling import precompile
from vinefab.core.plain_text import counted, json_text
from vinefab.core.statistics import MeanValue
from vinefab.core.verbs import this_call
from vinefab.core.view import Number, Rows, Section
from vinefab.fabrication.package.prepare import package, zip_bytes
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.design import Design, PieceSettings, design_text
from vinefab.model.files.shipped import DEFAULT_PRINTER, DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.map import Map, map_text
from vinefab.model.score import Score
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    ScorePlan,
    origin_of,
    score_design_on_task,
)
from vinefab.prediction.measures import REACH
from vinefab.prediction.predict import Predicted, predict
from vinefab.rig.make import RigFiles, make_rig
from vinefab.rig.part import RigOptions, read_printer
from vinefab.search.needed_code import PREDICTION, needed_code
from vinefab.search.record.result import RunResult
from vinefab.search.run import run_search, training_maps
from vinefab.search.run_pages import search_section
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings

_POSES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoSettings:
    """How large the demonstration is.

    Parameters
    ----------
    seed
        Seed of maps, search and poses.
    training, unseen
        Number of maps to train on and to test on.
    population, generations
        Size of the search.
    workers
        Threads of the search; no result depends on it.
    """

    seed: int = 1
    training: int = 4
    unseen: int = 6
    population: int = 32
    generations: int = 40
    workers: int = 2

    def run(self) -> RunSettings:
        """Return the run of the optimizer.

        Narrower than Table 1 of the paper: at most three levels and four children, so that the
        winner has a size that a person can cut, mount and deploy on a bench. It may be cut in three
        pieces.
        """
        pieces = 3  # most flat pieces of the winner: two joints are an hour's work
        return RunSettings(
            name="demo_winner",
            maps=MapSettings(environment="grid", count=self.training, seed=self.seed),
            task=PartSettings(name="coverage"),
            space=SpaceSettings(
                levels=Bounds(low=2, high=3),
                length_mm=Bounds(low=40.0, high=180.0),
                angle_deg=Bounds(low=40.0, high=160.0),
                branches=Bounds(low=2, high=4),
                growth_percent=Bounds(low=60.0, high=140.0),
            ),
            build=BuildSettings(
                trunk_width_mm=24.0, width_ratio=0.65, pieces=PieceSettings(most=pieces)
            ),
            search=SearchSettings(
                population=self.population, generations=self.generations, seed=self.seed
            ),
            evaluation=EvaluationSettings(poses_per_map=2, fabricable=True),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Demo:
    """Results of the demonstration."""

    result: RunResult  # the search
    # training, unseen, baseline: scores of the winner on the training maps and on unseen ones, and
    # of a plain vine on the unseen ones
    training: Score
    unseen: Score
    baseline: Score
    predicted: Predicted  # deployments on unseen maps, job and check
    rig: RigFiles  # the rig of the first unseen map
    files: tuple[str, ...]  # what was written, as paths relative to the folder

    @property
    def is_manufacturable(self) -> bool:
        """Whether no design rule blocks the winner."""
        return not self.predicted.prepared.report.blocking

    def table(self) -> Rows:
        """Return the result as a table of names and values."""
        best, report = self.result.best, self.predicted.prepared.report
        reach = self.predicted.main.outcomes.spread(REACH)
        partition, pieces = self.predicted.prepared.partition, "1"
        if partition is not None:
            least = "no fewer possible" if partition.proven_least else "fewer may be possible"
            pieces = f"{len(partition.pieces)}, {least}"
        rows = (
            ("winner", f"{counted(best.branch_count, 'branch')} on {counted(best.depth, 'level')}"),
            ("flat pieces to cut", pieces),
            ("coverage score, training maps", f"{demo_interval_text(self.training)} (simulated)"),
            ("coverage score, unseen maps", f"{demo_interval_text(self.unseen)} (simulated)"),
            (
                "coverage score, plain vine, unseen",
                f"{demo_interval_text(self.baseline)} (simulated)",
            ),
            ("growth model", self.predicted.growth),
            (
                "free space reached, unseen maps",
                f"{REACH.text(reach.mean)} (simulated)" if reach else "none",
            ),
            ("design rules", f"{len(report.blocking)} block the cut, {len(report.run)} run"),
            ("rig", f"{counted(len(self.rig.rig.parts), 'part')} to print"),
        )
        caption = "Means with 95 % intervals over maps"
        return Rows(caption=caption, headings=("", ""), rows=rows)


def run_demo(
    folder: Path,
    settings: DemoSettings,
    announce: Callable[[str], None],
) -> Demo:
    """Run the main job and write everything into a folder."""
    run = settings.run()
    announce(
        f"training on {run.maps.count} generated maps: "
        f"{counted(run.search.generations, 'generation')} "
        f"of {counted(run.search.population, 'design')}"
    )
    first_unseen = 100_001
    unseen = tuple(
        grid_map(first_unseen + settings.seed + index, GridOptions())
        for index in range(settings.unseen)
    )
    precompile((*needed_code(run, training_maps(run)), *PREDICTION))
    result = run_search(run, folder / "run", workers=settings.workers)
    announce(f"testing the winner on {counted(len(unseen), 'map')} that it never saw")
    plan = ScorePlan(task=run.task.name, poses=_POSES, seed=run.search.seed)
    best, vine = result.best, Design.read("plain_vine")
    scores = {
        "training": score_design_on_task(best, training_maps(run), plan, run.growth),
        "unseen": score_design_on_task(best, unseen, plan, run.growth),
        "baseline": score_design_on_task(vine, unseen, plan, run.growth),
    }
    predicted = predict(
        result.best,
        read_profile(DEFAULT_RECIPE),
        [MapFamily(label=f"{len(unseen)} unseen grid maps", worlds=unseen)],
        PredictionPlan(poses=_POSES, seed=settings.seed, options=run.growth),
    )
    announce(f"making the printable rig of {unseen[0].name}")
    rig = make_rig(unseen[0], read_printer(DEFAULT_PRINTER), RigOptions())
    announce("writing the fabrication package and the report")
    demo = Demo(result=result, predicted=predicted, rig=rig, files=(), **scores)
    return replace(demo, files=_write(folder, demo, run, unseen))


def demo_interval_text(score: Score) -> str:
    """Return a mean with its 95 % interval over maps, as reports have it."""
    mean = MeanValue.of(score.scores, [one.map_name for one in score.evaluations])
    return Number(mean.mean, form=".3f", interval=(mean.low, mean.high), over=mean.over).text


def _write(folder: Path, demo: Demo, run: RunSettings, unseen: tuple[Map, ...]) -> tuple[str, ...]:
    training = training_maps(run)
    texts = {f"maps/training_{world.name}.geojson": map_text(world) for world in training}
    texts |= {f"maps/unseen_{world.name}.geojson": map_text(world) for world in unseen}
    texts["run/best.toml"] = design_text(demo.result.best)
    table = demo.table()
    result = Section(title="Result", tables=(table,))
    more = (result, search_section(demo.result, training), demo.rig.section)
    family = MapFamily(label=demo.predicted.main.prepared.label, worlds=unseen)
    command = this_call().text(out="demo")  # the files are the same in any folder
    origin = origin_of(command, [demo.result.best], demo.predicted.prepared.profile, [family])
    texts["report.html"] = replace(demo.predicted, origin=origin, more=more).page()
    texts["results.json"] = json_text(
        "vinefab/demo-1", {"results": {str(name): str(value) for name, value in table.rows}}
    )
    files = {name: text.encode() for name, text in texts.items()}
    files |= {f"rig/{name}": data for name, data in demo.rig.files.items()}
    if demo.is_manufacturable:
        parts = package(demo.predicted.prepared)
        files |= {f"package/{name}": data for name, data in parts.items()}
        files["package.zip"] = zip_bytes(parts, "package")
    fill_folder(folder, files)
    return ("run/run.sqlite", *files)
