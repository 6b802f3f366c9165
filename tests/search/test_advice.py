"""Rules before and while a run goes on: trunk and targets, full checks, helpful changes."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from tests.search.conftest import followed, optimize
from tests.search.target_cases import SPACE, cases, thick_film
from vinefab.core.progress import heard_by
from vinefab.model.design import Design
from vinefab.model.finding import Finding, Severity
from vinefab.model.laser import read_profile
from vinefab.model.quantity import Quantity, Standing
from vinefab.search.finalists import RepairBudget
from vinefab.search.manufacturability import (
    FAILED,
    BestCheck,
    ManufacturabilityPenalty,
    has_design,
    relaxations,
    said_before,
    with_build_for_film,
)
from vinefab.search.record.generations import RunIdentity, SearchProgress
from vinefab.search.record.result import RECORD_FILE, RunArchive
from vinefab.search.record.store import RunStore
from vinefab.search.run import Search, penalty_of, training_maps
from vinefab.search.settings import MapSettings, RunSettings, SearchSettings
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings


def run_file(folder, text):
    """Read a run of the space of the target cases with film of 0.1 mm, and more tables."""
    ranges = "".join(f"{name} = {ends}\n" for name, ends in SPACE.items())
    path = folder / "run.toml"
    recipe = f'[evaluation]\nrecipe = "{thick_film(folder)}"\n'
    path.write_text(f'schema = "vinefab/run-1"\n[space]\n{ranges}{recipe}{text}', "utf-8")
    return with_build_for_film(RunSettings.read(path))


@pytest.mark.parametrize(
    ("text", "width_mm"),
    [
        ("fabricable = true\n[build]\nwidth_ratio = 0.65", 40.0),
        ("fabricable = true\n[build]\nwidth_ratio = 0.8", 61.0),
        ("fabricable = true\n[build]\nwidth_ratio = 0.8\ntrunk_width_mm = 24", 24.0),
        ("fabricable = false\n[build]\nwidth_ratio = 0.8", 40.0),
    ],
)
def test_a_run_file_without_a_trunk_width_gets_one_that_its_film_takes(tmp_path, text, width_mm):
    assert run_file(tmp_path, text).build.trunk_width_mm == width_mm


@pytest.mark.parametrize(
    ("text", "kpa"),
    [
        ("fabricable = true\n[build]\nwidth_ratio = 0.65", 33.3),  # 100 * 20 / 40 / 1.5: its seam
        ("fabricable = true\n[build]\ntrunk_width_mm = 24", 55.5),
        ("fabricable = true\n[build]\ntrunk_width_mm = 24\npressure_kpa = 20", 20.0),
        ("fabricable = false\n[build]\nwidth_ratio = 0.65", 20.0),
    ],
)
def test_a_run_file_without_a_pressure_gets_the_most_that_its_widest_part_takes(
    tmp_path, text, kpa
):
    assert run_file(tmp_path, text).build.pressure_kpa == kpa


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    """The target cases, by kind and number."""
    found = cases(tmp_path_factory.mktemp("cases"), 2)
    return {(kind, number): settings for kind, number, settings in found}


def searched(settings):
    return Search.of(settings, training_maps(settings), penalty_of(settings))


def test_a_narrow_trunk_and_a_small_sheet_are_named_before_anything_is_searched(asked):
    flat, pieces = (asked[f"0.1 mm, 300 mm roll, {kind}", 1] for kind in ("flat", "pieces"))
    narrow = pieces.changed(build=pieces.build.changed(trunk_width_mm=24.0))
    named = {
        kind: said_before(searched(settings).evaluator)
        for kind, settings in {"flat": flat, "pieces": pieces, "narrow": narrow}.items()
    }
    assert named["pieces"] == ""
    assert "40 mm holds them (build.trunk_width_mm)" in named["narrow"]
    assert "VF-W03" in named["narrow"]
    assert "478 x 278 mm (VF-S01)" in named["flat"]
    assert "[build.pieces] most" in named["flat"]
    # Near targets, and shipped film on a large bed, leave nothing to say.
    assert said_before(searched(asked["0.1 mm, 300 mm roll, flat", 6]).evaluator) == ""
    assert said_before(searched(asked["shipped film, flat", 1]).evaluator) == ""


@pytest.mark.thorough
def test_a_run_says_it_with_its_first_generation_and_where_targets_are_missed(
    asked, tmp_path, monkeypatch
):
    settings, seen = asked["0.1 mm, 300 mm roll, flat", 1], list[SearchProgress]()
    settings = settings.changed(
        search=settings.search.changed(population=12),
        evaluation=settings.evaluation.changed(finalists=1),
    )
    monkeypatch.setattr("vinefab.search.finalists.RepairBudget", lambda: RepairBudget(steps=20))
    maps = training_maps(settings)
    with RunStore.open(tmp_path, RunIdentity.of(settings, maps), maps=maps) as store:
        result = optimize(settings, maps, penalty_of(settings), store=store, progress=seen.append)
    assert "VF-S01" in seen[0].advice
    assert result.targets is not None
    assert result.targets.missed
    assert any("allow pieces" in note for note in result.notes)
    recorded = RunArchive.read(tmp_path / RECORD_FILE)
    assert recorded.notes
    assert set(recorded.notes) <= set(result.notes)
    assert recorded.result().notes == recorded.notes


FOUND = (Finding(rule="VF-X99", severity=Severity.ERROR, message="odd", fingerprint="1"),)


@dataclass
class Tabled:
    """A penalty of nothing, a check by the table, and one that simulates and counts its calls."""

    passing: Callable[[Design], bool]
    by_table: Callable[[Design], bool | None]
    simulated: list[Design] = field(default_factory=list)

    def __call__(self, _):
        return 0.0

    def broken(self, design):
        found = self.by_table(design)
        return None if found is None else () if found else FOUND

    def passes(self, design):
        self.simulated.append(design)
        return self.passing(design)


def even(design):
    return int(design.trunk_length_mm) % 2 == 0


def test_no_best_design_fails_a_rule_that_the_penalty_does_not_know(fabricable, maps):
    penalty, seen = Tabled(even, even), list[SearchProgress]()
    search = Search.of(fabricable, maps, penalty)
    with followed(seen.append):
        result = search.run()
    failed = [(g, row) for g in result.history for row in range(6) if g.penalty[row] == FAILED]
    assert failed
    for generation, row in failed:
        assert not even(search.evaluator.space.design(generation.x[row]))
    best = max(result.history, key=lambda generation: generation.best)
    assert even(search.evaluator.space.design(best.x[best.fitness.argmax()]))
    assert all(even(finalist.design) for finalist in result.finalists)
    # Only the winner's joints are simulated.
    assert penalty.simulated == [result.best.changed(name=penalty.simulated[0].name, origin={})]
    assert {one.passes for one in seen} <= {True, False}
    assert seen[-1].passes


def test_one_that_fails_when_simulated_makes_room_for_the_next(fabricable, maps):
    table = Tabled(even, lambda _: True)
    result = Search.of(fabricable, maps, table).run()
    assert even(result.finalists[0].design)
    assert result.fabricable
    assert not even(table.simulated[0])
    assert result.best.trunk_length_mm in [design.trunk_length_mm for design in table.simulated]


def test_where_only_a_simulation_tells_the_quick_rules_decide(fabricable, maps):
    seen = list[SearchProgress]()
    result = optimize(fabricable, maps, Tabled(even, lambda _: None), progress=seen.append)
    assert even(result.finalists[0].design)
    assert not any((generation.penalty > 0.0).any() for generation in result.history)
    assert seen[-1].passes is None


def test_a_run_without_rules_asks_nothing(small, maps):
    seen = list[SearchProgress]()
    penalty = Tabled(even, even)
    optimize(small, maps, penalty, progress=seen.append)
    assert penalty.simulated == []
    assert seen[-1].passes is None


def test_checks_depend_neither_on_workers_nor_on_stops(fabricable, maps):
    search = Search.of(fabricable, maps, Tabled(even, even))
    history = search.run().history
    again = Search.of(fabricable, maps, Tabled(even, even)).run(workers=2).history
    assert [g.penalty.tolist() for g in history] == [g.penalty.tolist() for g in again]
    assert BestCheck(search.evaluator, history).passes
    assert not BestCheck(search.evaluator, ()).passes
    for number, generation in enumerate(history):
        check = BestCheck(search.evaluator, history[:number])
        none = np.zeros(len(generation.x))
        found = check.penalties(generation.x, generation.composite, none, none)
        assert found.tolist() == generation.penalty.tolist()


def thick():
    """Two plies of 0.1 mm, sealed by hand, on a bed of 500 x 300 mm."""
    profile = read_profile("co2_60w__tpu_nylon_70d")

    def measured(value):
        return Quantity(value=value, standing=Standing.MEASURED, source="gauge")

    film = profile.material.changed(ply_mm=measured(0.1), modulus_mpa=measured(30.0))
    bed = profile.machine.changed(bed_width_mm=measured(500.0), bed_height_mm=measured(300.0))
    return replace(profile, material=film, machine=bed)


PENALTY = ManufacturabilityPenalty(profile=thick())
SMALL_ARCS = RunSettings(
    maps=MapSettings(count=1),
    space=SpaceSettings(
        levels=Bounds(low=3, high=3),
        length_mm=Bounds(low=40, high=205),
        branches=Bounds(low=1, high=2),
        angle_deg=Bounds(low=30, high=160),
    ),
    build=BuildSettings(trunk_width_mm=26.5, width_ratio=0.65),
    search=SearchSettings(population=12, generations=10),
)
"""On the seam, 2.5 mm outside the lumen, fillets of 2.8 mm are arcs too small to be run."""


class Searched(Exception):  # noqa: N818  a run that is ended before it repairs designs
    pass


def reports_of(settings):
    """Return what a run reports of its generations; its winner is not chosen."""
    reports = list[SearchProgress]()

    def hear(progress):
        if isinstance(progress, SearchProgress):
            reports.append(progress)
        elif reports:
            raise Searched

    with pytest.raises(Searched), heard_by(hear):
        Search.of(settings, training_maps(settings), PENALTY).run()
    return reports


@pytest.fixture(scope="module")
def seen():
    """What a run reports that finds nothing."""
    return reports_of(SMALL_ARCS)


def test_a_run_without_a_manufacturable_design_names_rule_and_key_in_its_first_tenth(seen):
    first = next(one for one in seen if one.advice)
    assert first.share <= 0.2
    assert "VF-L02" in first.advice
    assert "build.trunk_width_mm = " in first.advice
    assert {one.advice for one in seen if one.done > first.done} == {first.advice}
    assert "manufacturable: not yet" in first.words


def test_every_change_that_is_named_lets_a_design_pass_and_the_run_itself_does_not():
    found = relaxations(SMALL_ARCS, PENALTY)
    assert found
    assert len({change.key for change in found}) == len(found)
    assert not has_design(SMALL_ARCS, PENALTY)
    for change in found:
        assert change.settings != SMALL_ARCS
        assert change.text.startswith(f"{change.key} = ")
        short = change.settings.changed(search=SearchSettings(population=12, generations=2))
        assert any(one.passes for one in reports_of(short))


def test_a_run_that_finds_designs_needs_no_advice():
    search = SearchSettings(population=12, generations=3)
    wide = SMALL_ARCS.changed(build=SMALL_ARCS.build.changed(trunk_width_mm=40.0), search=search)
    reports = list[SearchProgress]()
    result = optimize(wide, training_maps(wide), PENALTY, progress=reports.append)
    assert result.fabricable
    assert not any(one.advice for one in reports)
    assert PENALTY.passes(result.best)
