import math

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.search.optimizers.optimizer import SearchAxes
from vinefab.search.optimizers.swarms import _ADAPTIVE_STREAM, AdaptiveSwarm, AdaptiveSwarmConfig

SHAPE = (9, 4)


def worth(x):
    return -np.abs(x - 0.37).sum(axis=1) + 0.2 * np.cos(25.0 * x[:, 0])


class ScalarSwarm:
    """The published algorithm, one particle and one coordinate at a time."""

    def __init__(self, seed, *, adapt_always):
        rng = child(seed, _ADAPTIVE_STREAM, 0)
        self.seed, self.always = seed, adapt_always
        self.x = rng.random(SHAPE).tolist()
        self.v = rng.uniform(-1.0, 1.0, SHAPE).tolist()
        self.best = [list(row) for row in self.x]
        self.value = [-math.inf] * SHAPE[0]
        self.least = max(2, math.floor(0.25 * SHAPE[0]))
        self.near, self.w, self.c, self.generation = self.least, 1.1, 0, 0

    def tell(self, fitness):
        before = max(self.value)
        for i, value in enumerate(fitness):
            if value > self.value[i]:
                self.value[i], self.best[i] = value, list(self.x[i])
        if self.generation > 0:
            if improved := max(self.value) > before:
                self.c, self.near = max(0, self.c - 1), self.least
            else:
                self.c, self.near = self.c + 1, min(self.near + self.least, SHAPE[0] - 1)
            if (improved or self.always) and self.c < 2:
                self.w = min(1.1, 2.0 * self.w)
            elif (improved or self.always) and self.c > 5:
                self.w = max(0.1, 0.5 * self.w)
        self.generation += 1
        self.move()

    def move(self):
        rng = child(self.seed, _ADAPTIVE_STREAM, self.generation)
        lots = rng.random((SHAPE[0], SHAPE[0]))
        u1, u2 = rng.random((2, *SHAPE))
        leaders = []
        for i in range(SHAPE[0]):
            others = sorted((j for j in range(SHAPE[0]) if j != i), key=lambda j: lots[i, j])
            leaders.append(max(others[: self.near], key=lambda j: self.value[j]))
        for i, g in enumerate(leaders):
            for k in range(SHAPE[1]):
                own = 1.49 * u1[i, k] * (self.best[i][k] - self.x[i][k])
                social = 1.49 * u2[i, k] * (self.best[g][k] - self.x[i][k])
                self.v[i][k] = self.w * self.v[i][k] + own + social
                self.x[i][k] += self.v[i][k]
                if not 0.0 <= self.x[i][k] <= 1.0:
                    self.x[i][k] = min(1.0, max(0.0, self.x[i][k]))
                    self.v[i][k] = 0.0


@pytest.mark.parametrize(("seed", "adapt_always"), [(1, True), (2, True), (1, False)])
def test_the_swarm_moves_as_its_scalar_twin(seed, *, adapt_always):
    """Clipped coordinates stop at their face, and move on at the next pull."""
    config = AdaptiveSwarmConfig(adapt_always=adapt_always)
    fast, slow = AdaptiveSwarm(config, SHAPE, seed), ScalarSwarm(seed, adapt_always=adapt_always)
    inertias, stopped = set(), 0
    for _ in range(60):
        x = fast.ask()
        np.testing.assert_allclose(x, slow.x, rtol=0.0, atol=1e-9)
        slow.x = x.tolist()
        fast.tell(x, worth(x))
        slow.tell(worth(x).tolist())
        assert (fast.inertia, fast.neighbours, fast.failures) == (slow.w, slow.near, slow.c)
        np.testing.assert_allclose(fast.velocity, slow.v, rtol=0.0, atol=1e-9)
        stopped += np.count_nonzero(fast.velocity == 0.0)
        inertias.add(fast.inertia)
        # Differences in rounding would grow from generation to generation.
        slow.v = fast.velocity.tolist()
    assert len(inertias) > 2
    assert stopped > 20


def test_reevaluation_corrects_lucky_personal_bests():
    rng = np.random.default_rng(5)
    kept = {}
    for reevaluate in (False, True):
        swarm = AdaptiveSwarmConfig(reevaluate=reevaluate).start(
            SearchAxes.continuous(3), 20, seed=1
        )
        assert isinstance(swarm, AdaptiveSwarm)
        assert len(swarm.position) == (10 if reevaluate else 20)
        for _ in range(40):
            x = swarm.ask()
            swarm.tell(x, rng.normal(0.0, 1.0, len(x)))
        kept[reevaluate] = swarm._best_means().mean()
    assert kept[False] > 1.8  # the largest of 40 draws of noise is about 2.2
    assert kept[True] < 0.8 * kept[False]


def test_the_range_of_the_inertia_must_be_in_order():
    with pytest.raises(BadInputError, match=r"least_inertia is 2\.0"):
        AdaptiveSwarmConfig(least_inertia=2.0)
