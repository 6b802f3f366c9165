"""The simulated cluster: cases with known ends, bounds, and where searches saturate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from examples import draw_cluster_scaling
from examples.draw_cluster_scaling import (
    LATENCIES_S,
    Network,
    Scaling,
    SearchLoad,
    UnitCosts,
    alone_s,
    load_of,
    simulated_run_s,
    simulated_s,
)
from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings, SearchSettings

COSTS = UnitCosts(submit_s=0.001, receive_s=0.002, worker_s=0.003)
NEAR = Network(latency_s=0.0001)


def load(work_s, points=1000, loop_s=0.003):
    weights = [np.random.default_rng(k).lognormal(sigma=0.5, size=points) for k in range(3)]
    return SearchLoad(
        name="load",
        generations=weights,
        work_s=work_s / float(np.mean([each.sum() for each in weights])),
        result_bytes=1000.0,
        loop_s=loop_s,
    )


def test_one_unit_and_one_worker():
    network = Network(latency_s=0.1, bytes_per_s=1000.0)
    one = simulated_s([5.0], workers=1, costs=COSTS, network=network, result_bytes=500.0)
    assert one == pytest.approx(0.001 + 0.1 + 0.003 + 5.0 + 0.1 + 0.002 + 0.2 + 0.5)
    # The second unit waits at the worker: its way is not waited for.
    two = simulated_s([5.0, 5.0], workers=1, costs=COSTS, network=network)
    assert two == pytest.approx(0.001 + 0.1 + 2 * 5.003 + 0.1 + 0.002 + 0.2)


@pytest.mark.parametrize("workers", [1, 3, 40])
def test_no_cluster_is_faster_than_its_workers(workers):
    units_s = np.random.default_rng(1).random(200).tolist()
    took_s = simulated_s(units_s, workers=workers, costs=COSTS, network=NEAR)
    least_s = max(sum(units_s) / workers, *units_s)
    assert least_s < took_s < sum(units_s) / workers + max(units_s) + 200 * 0.007
    far = Network(latency_s=1.0)
    assert simulated_s(units_s, workers=workers, costs=COSTS, network=far) > took_s + 3.0


def test_a_search_saturates_where_units_cost_as_much_as_they_save():
    heavy, costs = load(4.0), UnitCosts()
    result = Scaling.of(heavy, LATENCIES_S[0])
    # n units of a work W that cost c each take at least 2 sqrt(W c).
    cost_s = costs.submit_s + costs.receive_s
    assert 0.5 * math.sqrt(4.0 / cost_s) < result.speedups.max() < math.sqrt(4.0 / cost_s)
    assert 16 <= result.saturation <= 128
    assert (np.diff(result.speedups) > -0.02 * result.speedups[:-1]).all()
    cheap = UnitCosts(submit_s=costs.submit_s / 10, receive_s=costs.receive_s / 10)
    assert simulated_run_s(heavy, 256, cheap, NEAR) < 0.6 * simulated_run_s(heavy, 256, costs, NEAR)
    # What happens between generations helps nobody.
    slow_loop = replace(heavy, loop_s=4.0)
    assert alone_s(slow_loop) / simulated_run_s(slow_loop, 256, costs, NEAR) < 2.0


def test_a_load_is_measured():
    settings = RunSettings(
        maps=MapSettings(count=2),
        search=SearchSettings(population=10, generations=2),
        evaluation=EvaluationSettings(fabricable=False),
    )
    found = load_of("ten", settings)
    assert [len(weights) for weights in found.generations] == [10] * 3
    assert found.work_s > 0.0
    assert found.loop_s > 0.0
    assert found.result_bytes == 8.0 * 6 * 2  # the score and five terms, on two maps
    assert Scaling.of(found, LATENCIES_S[-1]).speedups[0] == pytest.approx(1.0)


@pytest.mark.thorough
def test_the_figure_is_drawn(monkeypatch, tmp_path):
    whole = draw_cluster_scaling.load_of

    def of_a_part(name, settings):
        population = max(10, settings.search.population // 40)
        return whole(name, settings.changed(search=settings.search.changed(population=population)))

    monkeypatch.setattr(draw_cluster_scaling, "load_of", of_a_part)
    draw_cluster_scaling.draw(tmp_path / "picture.png")
    with Image.open(tmp_path / "picture.png") as image:
        darkness = image.convert("L").histogram()
        assert sum(darkness[:250]) > 0.02 * image.width * image.height
