"""What a search of the paper's size does with its time."""

import tempfile
from pathlib import Path

from vinefab.optimize.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.optimize.timing import TimeSplit
from vinefab.pipeline.optimize import search

SEARCHES = ("particleswarm", "cmaes")
"""The paper's optimizer, and the default."""

MAPS, DESIGNS = 5, 100


def search_split(optimizer: str, threads: int, generations: int) -> TimeSplit:
    """Return where the time of a search goes: coverage of five Grids, Table 1, with a record.

    Parameters
    ----------
    optimizer
        Its name.
    threads
        Who evaluates.
    generations
        Of 100 designs each.
    """
    settings = RunSettings(
        name="bench",
        maps=MapSettings(count=MAPS),
        optimizer=PartSettings(name=optimizer),
        search=SearchSettings(population=DESIGNS, generations=generations),
        evaluation=EvaluationSettings(fabricable=False),
    )
    with tempfile.TemporaryDirectory() as folder:
        return search(settings, Path(folder), workers=threads).times
