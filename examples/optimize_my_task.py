"""Optimize for a task of your own: how far up a map the highest tip gets, per metre of film.

Run it as ``python examples/optimize_my_task.py``. A task is a frozen dataclass with a name, the
lowest score that it can give, and ``evaluate``; its fields are its parameters.
"""

from dataclasses import dataclass
from typing import ClassVar

from vinefab.model.deployment import Deployment
from vinefab.search.run import Search, generated_maps
from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings, SearchSettings
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Height:
    """Share of the map's height that the highest tip reaches, minus a price for film."""

    name: ClassVar[str] = "height"
    lowest: ClassVar[float] = -1.0

    film_weight: float = 0.05

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the score and its terms."""
        _, y_min, _, y_max = context.free.bounds
        highest_mm = float(deployment.tips_mm[:, 1].max())
        height = (highest_mm - y_min) / (y_max - y_min)
        film_m = deployment.tree.total_length_mm / 1000.0
        return height - self.film_weight * film_m, {"height": height, "film_m": film_m}


def main() -> None:
    settings = RunSettings(
        name="climber",
        maps=MapSettings(environment="grid", count=3, seed=1),
        search=SearchSettings(population=20, generations=10, seed=1),
        evaluation=EvaluationSettings(fabricable=False),
    )
    result = Search.of(settings, generated_maps(settings.maps), task=Height()).run(workers=2)
    terms = result.finalists[0].score.evaluations[0].terms
    print(f"{result.best.name}: {result.best.branch_count} branches")
    print(f"mean score {result.score.composite['mean']:.3f}, one evaluation: {dict(terms)}")


if __name__ == "__main__":
    main()
