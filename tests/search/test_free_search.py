"""The search of free trees: stages, structure, resuming, and what it refuses."""

from contextlib import contextmanager

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.design import Branch, Design
from vinefab.search.evaluator import ThreadEvaluator
from vinefab.search.free_search import TRIAL_EVERY, TRIALS, FreeSearch
from vinefab.search.free_space import FreeSpace
from vinefab.search.optimizers.islands import IslandsConfig
from vinefab.search.record.result import state_from_text, state_to_text
from vinefab.search.run import Search, fresh_maps, penalty_of, run_search, training_maps
from vinefab.search.settings import MAP_SETS, RunSettings
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings

FREE = {
    "levels": Bounds(low=2, high=3),
    "length_mm": Bounds(low=40, high=150),
    "angle_deg": Bounds(low=40, high=160),
    "branches": Bounds(low=2, high=3),
    "tree": "free",
}
BUILD = {"trunk_width_mm": 24.0, "width_ratio": 0.65, "compensation": "none"}


def settings(**changes):
    """A small run on free trees."""
    given = {
        "maps": {"count": 2},
        "space": FREE,
        "build": BUILD,
        "growth": {"pressure_stop": False},
        "search": {"population": 12, "generations": 12, "seed": 3},
        "evaluation": {"finalists": 3, "finalists_by": "training"},
    }
    return RunSettings(**(given | changes))


def search(run):
    return Search.of(run, training_maps(run), penalty_of(run), fresh_maps=fresh_maps(run))


def optimizer(population=12, level_generations=2, seed=5, penalty=None):
    """A search of its own, and how well its points would do: as long branches as possible."""
    space = FreeSpace(SpaceSettings(**FREE), BuildSettings(**BUILD))
    levels = IslandsConfig().start(space.levels.axes, population, seed)
    if penalty:
        levels.screen_by(lambda x: np.array([penalty(space.levels.design(one).tree) for one in x]))
    return space, FreeSearch(space, levels, level_generations, population, seed)


def film(space, x):
    """Fitness with its best at a film of 900 mm."""
    return -np.abs(space.batch(x).sums(space.batch(x).length_mm) - 900.0)


def run_on(space, found, generations):
    asked = []
    for _ in range(generations):
        x = found.ask()
        asked.append(x)
        found.tell(x, film(space, x))
    return asked


@pytest.fixture(scope="module")
def result():
    return search(settings()).run()


def test_a_run_ends_in_a_free_tree_that_passes_the_check(result):
    best = result.best
    assert best.branches is not None
    assert result.finalists[0].penalty == 0.0
    assert penalty_of(settings()).passes(best)
    assert {len(generation.x) for generation in result.history[:4]} <= set(range(1, 13))


@pytest.mark.thorough
def test_a_run_does_not_depend_on_its_workers(result):
    again = search(settings()).run(workers=2)
    assert again.best.tree.key == result.best.tree.key
    assert again.finalists[0].fitness == result.finalists[0].fitness


def test_a_run_that_was_stopped_goes_on_as_it_would_have(result, tmp_path):
    run = settings(search={"population": 12, "generations": 5, "seed": 3, "evaluations": 0})
    whole = settings()
    folder = tmp_path / "run"
    # Levels take a third of twelve generations, or of five: the record holds which.
    with pytest.raises(KeyboardInterrupt):
        run_search(whole, folder, workers=_Stopping(5))
    assert run != whole
    found = run_search(whole, folder, resume=True)
    assert found.best.tree.key == result.best.tree.key
    assert [g.fitness.tolist() for g in found.history] == [
        g.fitness.tolist() for g in result.history
    ]


class _Stopping:
    """A point evaluator that is interrupted after some generations."""

    count, notes = 1, ()

    def __init__(self, generations):
        self._left = generations

    def started(self, evaluator, ledger):
        threads = ThreadEvaluator(1)

        @contextmanager
        def entered():
            with threads.started(evaluator, ledger) as begin:

                def stopping(x, conditions):
                    self._left -= 1
                    if self._left < 0:
                        raise KeyboardInterrupt
                    return begin(x, conditions)

                yield stopping

        return entered()


def test_every_state_continues_exactly():
    generations = 2 + 4 + TRIAL_EVERY + TRIALS + 6
    space, whole = optimizer()
    wanted = run_on(space, whole, generations)
    stages = set()
    for stop in range(generations):
        space, first = optimizer()
        run_on(space, first, stop)
        state = state_from_text(state_to_text(first.state()))
        stages |= {*state} & {"levels", "race", "trees", "trial"}
        space, second = optimizer()
        second.restore(state)
        assert np.array_equal(second.ask(), wanted[stop])
    assert stages == {"levels", "race", "trees", "trial"}


def test_the_search_of_trees_comes_nearer_than_levels():
    space, found = optimizer(level_generations=4)
    asked = run_on(space, found, 40)
    levels = max(film(space, x).max() for x in asked[:4])
    (best, *_) = found.recommended()
    assert film(space, best[None])[0] > max(levels, -3.0)


def too_long(tree):
    """A penalty of branches beyond 120 mm."""
    return max(0.0, float(tree.length_mm.max()) - 120.0)


def test_rules_draw_points_back_and_the_middle_keeps_them():
    space, found = optimizer(level_generations=1, penalty=too_long)

    def penalty(x):
        return np.array([too_long(space.tree(one)) for one in x])

    found.screen_by(penalty)
    for x in run_on(space, found, 12):
        assert penalty(x).max() == 0.0 or len(x) == 1
    assert penalty(np.array(found.recommended())).max() == 0.0


def test_branches_that_cost_go_and_those_that_earn_come():
    space, found = optimizer(level_generations=1)
    found.screen_by(lambda x: np.zeros(len(x)))
    for aim in (4.0, 12.0):
        for _ in range(6 * (TRIAL_EVERY + TRIALS)):
            x = found.ask()
            found.tell(x, -np.abs(space.batch(x).sizes - aim))
        assert abs(len(space.tree(found.recommended()[0])) - aim) <= 1


def test_it_begins_at_given_trees_in_place_of_levels():
    space, found = optimizer()
    given = Design.of_branches(
        [
            Branch(name="a", angle_deg=-40.0, length_mm=90.0),
            Branch(name="b", angle_deg=31.0, length_mm=70.0),
        ],
        trunk_length_mm=100.0,
    )
    found.start_from([space.vector(given)])
    first = space.tree(found.ask()[0])
    assert np.degrees(first.offset_rad).tolist() == pytest.approx([0.0, -40.0, 31.0], abs=0.006)


def test_a_mirrored_search_with_trials_of_structure_stays_mirrored():
    space = FreeSpace(SpaceSettings(**FREE, mirrored=True), BuildSettings(**BUILD))
    levels = IslandsConfig().start(space.levels.axes, 12, 5)
    found, sizes = FreeSearch(space, levels, 2, 12, 5), set()
    found.screen_by(lambda x: np.zeros(len(x)))
    for generation in range(4 + 2 * (TRIAL_EVERY + TRIALS)):
        x = found.ask()
        for tree in space.batch(x).trees:
            ahead = tree.parent[1:] == 0
            angles = np.sort(tree.offset_rad[1:][ahead])
            assert angles == pytest.approx(-angles[::-1], abs=1e-12)
            sizes.add(len(tree))
        found.tell(x, film(space, x) if generation < 30 else -np.abs(space.batch(x).sizes - 9.0))
    assert len(sizes) > 3


def test_a_search_of_one_branch_changes_no_other():
    space = FreeSpace(SpaceSettings(**FREE, only=("0.1",)), BuildSettings(**BUILD))
    levels = IslandsConfig().start(space.levels.axes, 12, 5)
    found = FreeSearch(space, levels, 2, 12, 5)
    given = Design.of_branches(
        [
            Branch(name="a", angle_deg=-40.0, length_mm=90.0),
            Branch(name="b", angle_deg=31.0, length_mm=70.0),
            Branch(name="c", of="b", angle_deg=10.0, length_mm=50.0),
        ],
        trunk_length_mm=100.0,
    )
    found.start_from([space.vector(given)])
    for _ in range(2 * TRIAL_EVERY):
        x = found.ask()
        for tree in space.batch(x).trees:
            assert tree.length_mm[[0, 1, 3]].tolist() == [100.0, 90.0, 50.0]
            assert np.degrees(tree.offset_rad[[1, 3]]).tolist() == pytest.approx([-40.0, 10.0])
        found.tell(x, -np.abs(space.batch(x).length_mm.reshape(len(x), -1)[:, 2] - 123.0))
    (best, *_) = found.recommended()
    assert space.tree(best).length_mm[2] == pytest.approx(123.0, abs=1.0)


def test_each_generation_has_fresh_maps_where_maps_are_generated():
    assert settings().map_count == 2 * MAP_SETS
    assert settings().maps_per_generation == 2
    assert len(training_maps(settings())) == 2 * MAP_SETS
    placed = settings(maps={"count": 2, "start": "left side"})
    assert (placed.map_count, placed.maps_per_generation) == (2, 0)
    levels = settings(space=FREE | {"tree": "levels"})
    assert (levels.map_count, levels.maps_per_generation) == (2, 0)


def test_several_objectives_are_refused():
    run = settings(
        objectives=("coverage", "film_length"), optimizer={"name": "nsga2", "parameters": {}}
    )
    with pytest.raises(BadInputError, match=r"space\.tree"):
        search(run)


def test_a_design_of_branches_may_begin_a_search_of_free_trees_alone(tmp_path):
    Design.read("grid_explorer_levels").by_branches.write(tmp_path / "mine.toml")
    text = 'schema = "vinefab/run-1"\n[space]\ntree = "{}"\nlevels = [2, 4]\n'
    text += '[optimizer]\nstart_from = ["mine.toml"]\n'
    for tree in ("free", "levels"):
        (tmp_path / f"{tree}.toml").write_text(text.format(tree), encoding="utf-8")
    assert RunSettings.read(tmp_path / "free.toml").start_from
    with pytest.raises(BadInputError, match='tree = "free"'):
        RunSettings.read(tmp_path / "levels.toml")
