"""What a search of the paper's size does with its time."""

import tempfile
from pathlib import Path

from vinefab.optimize.identity import RunIdentity
from vinefab.optimize.loop import Search
from vinefab.optimize.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.optimize.store import RunStore
from vinefab.optimize.timing import TimeSplit
from vinefab.optimize.training import generated_maps

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
    maps = generated_maps(settings.maps)
    search, identity = Search.of(settings, maps, None), RunIdentity.of(settings, maps, None)
    with (
        tempfile.TemporaryDirectory() as folder,
        RunStore.open(Path(folder) / "run", identity, maps=maps, resume=False) as store,
    ):
        return search.run(store=store, workers=threads).times
