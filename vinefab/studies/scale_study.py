"""Which scale of map gives the paper's Fig. 4? All settings that were looked at, none chosen."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.search.settings import MapSettings, PartSettings, RunSettings
from vinefab.studies.claims import (
    PaperNumber,
    StudyResult,
    interval,
    interval_text,
    percent_text,
    share_interval,
)
from vinefab.studies.deployment_studies import (
    BUFFER_MM,
    PAPER_REACH,
    VINE_MM,
    RedeploymentJob,
    reach_run,
)
from vinefab.studies.study_runs import (
    FIRST_TEST_SEED,
    NAMES,
    QUICK_SIZE,
    USUAL_MM,
    JobStore,
    StudySize,
    design_words,
    plain_vine,
    trained,
)

SETTINGS: Mapping[str, tuple[dict[str, float], ...]] = {
    "grid": tuple(
        {"columns": cells, "rows": cells, "size_mm": size_mm}
        for size_mm, cells in product((500.0, 800.0, 950.0, 1250.0), (6, 4))
    ),
    "cave": tuple(
        {"loops": loops, "size_mm": size_mm}
        for size_mm, loops in product((500.0, 900.0), (1.0, 0.4))
    ),
}
"""Options of the maps of every setting; the first of each are those of other experiments."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaleSetting:
    """Maps of one size; the buffer grows with them, lengths of Table 1 do not."""

    environment: str
    options: Mapping[str, float]

    @property
    def size_mm(self) -> float:
        """Width and height of its maps."""
        return self.options["size_mm"]

    @property
    def words(self) -> str:
        """The setting in a row's head."""
        name, value = next(iter(self.options.items()))  # a Grid's columns are its rows
        return f"{NAMES[self.environment]}, {self.size_mm:g} mm, {name} {value:g}"

    @property
    def buffer_mm(self) -> float:
        """Distance from a body that counts as reached."""
        return BUFFER_MM * self.size_mm / USUAL_MM

    def maps(self, first: int, count: int) -> MapSettings:
        """Return maps from the seed of the first."""
        return MapSettings(
            environment=self.environment, count=count, seed=first, options=self.options
        )

    def run(self, size: StudySize) -> RunSettings:
        """Return the search for a tree that reaches as much as possible."""
        run = reach_run(size, self.environment, 0)
        maps = self.maps(run.maps.seed, run.maps.count)
        task = PartSettings(name="reach", parameters={"buffer_mm": self.buffer_mm})
        return run.changed(name=f"scale_{self.environment}", maps=maps, task=task)

    def jobs(self, size: StudySize, design: Design, headings: int) -> list[RedeploymentJob]:
        """Return a robot's deployments on the unseen maps, the same for every setting."""
        return [
            RedeploymentJob(
                design=design,
                worlds=self.maps(FIRST_TEST_SEED + index, 1),
                headings=headings,
                buffer_mm=self.buffer_mm,
            )
            for index in range(size.reach_maps)
        ]


def scale_settings(size: StudySize) -> Iterator[ScaleSetting]:
    """Yield every setting; a smoke run looks at one of each environment."""
    for environment, settings in SETTINGS.items():
        for options in settings if size.seeds > QUICK_SIZE.seeds else settings[:1]:
            yield ScaleSetting(environment=environment, options=options)


def scale_study(store: JobStore) -> StudyResult:
    """Redeploy a plain vine, and deploy a tree once, on maps of other sizes."""
    size, rows, data = store.size, list[PaperNumber](), {}
    settings = tuple(scale_settings(size))
    trees = [run.design for run in trained(store, [setting.run(size) for setting in settings])]
    for setting, tree in zip(settings, trees, strict=True):
        vine = plain_vine(VINE_MM * setting.size_mm / USUAL_MM)
        again = store.do(setting.jobs(size, vine, size.headings), "redeploying")
        once = store.do(setting.jobs(size, tree, 1), "redeploying")
        many, one = _row(part.share for part in again), _row(part.share for part in once)
        shapes = _row(part.shapes for part in again)
        paper = PAPER_REACH[setting.environment]
        rows += [
            PaperNumber(
                what=f"{setting.words}: {size.headings} of a plain vine; final shapes; one tree",
                ours="; ".join(
                    (
                        percent_text(share_interval(many)),
                        interval_text(interval(shapes), 1),
                        percent_text(share_interval(one)),
                    )
                ),
                paper=f"{paper['many']}; {paper['shapes']}; {paper['one']}",
            ),
            PaperNumber(what=f"{setting.words}: the tree", ours=design_words(tree)),
        ]
        data[setting.words] = {
            "many": many.ravel().tolist(),
            "shapes": shapes.ravel().tolist(),
            "one": one.ravel().tolist(),
        }
    return StudyResult(
        name="scale",
        title="The scale of Fig. 4",
        protocol=(
            "The paper states lengths of robots (Table 1) and no size of its maps. Here maps grow, "
            f"with a buffer of {BUFFER_MM / USUAL_MM:.0%} of their size and a plain vine of "
            f"{VINE_MM / USUAL_MM:g} sizes, while lengths of Table 1 stay. {size.reach_maps} "
            "unseen maps a setting, intervals over maps; one search for each tree, trained in its "
            "setting.",
        ),
        rows=tuple(rows),
        remarks=(
            "No setting is chosen by these numbers: the experiments stay at "
            f"{USUAL_MM:g} mm, unless large maps are asked for. The paper's figures are of one "
            "example of each environment.",
        ),
        data=data,
    )


def _row(values: Iterator[float]) -> Floats:
    return np.array([*values], dtype=float).reshape(1, -1, 1)
