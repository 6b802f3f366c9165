from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from vinefab.studies.study_runs import QUICK_SIZE
from vinefab.studies.training_studies import convergence


def test_convergence_shows_first_and_last_generations_and_the_winners_spread():
    best = np.linspace(0.0, 1.9, 20)
    runs = [SimpleNamespace(best=best, mean=0.5 * best, fitness=fitness) for fitness in (0.4, 0.6)]
    size = replace(QUICK_SIZE, repeats=2, generations=20)
    found = convergence(SimpleNamespace(size=size, train=lambda _: runs))
    first, last, winners = found.rows
    assert first.ours == "0.000 [0.000, 0.000]"
    # The last tenth of 20 generations: 1.8 and 1.9.
    assert last.ours.startswith("1.850 [")
    assert winners.ours == "0.100 around 0.500"
    (claim,) = found.claims
    assert claim.tested.value == pytest.approx(1.85)
