"""Which changes let designs pass: each that is named is tried here again."""

from dataclasses import replace

import pytest

from vinefab.model.files.profile_toml import read_profile
from vinefab.model.laser import Quantity, Standing
from vinefab.search.advice import has_design, relaxations
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.record.generations import Progress
from vinefab.search.run import Search, progress_line, training_maps
from vinefab.search.settings import MapSettings, RunSettings, SearchSettings
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings


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


@pytest.fixture(scope="module")
def seen():
    """What a run reports that finds nothing."""
    reports = list[Progress]()
    Search.of(SMALL_ARCS, training_maps(SMALL_ARCS), PENALTY).run(progress=reports.append)
    return reports


def test_a_run_without_a_manufacturable_design_names_rule_and_key_in_its_first_tenth(seen):
    first = next(one for one in seen if one.advice)
    assert first.share <= 0.2
    assert "VF-L02" in first.advice
    assert "build.trunk_width_mm = " in first.advice
    assert {one.advice for one in seen if one.generation > first.generation} == {first.advice}
    assert "manufacturable: not yet" in progress_line(first, checked=True)


def test_every_change_that_is_named_lets_a_design_pass_and_the_run_itself_does_not():
    found = relaxations(SMALL_ARCS, PENALTY)
    assert found
    assert len({change.key for change in found}) == len(found)
    assert not has_design(SMALL_ARCS, PENALTY)
    for change in found:
        assert change.settings != SMALL_ARCS
        assert change.text.startswith(f"{change.key} = ")
        reports = list[Progress]()
        short = change.settings.changed(search=SearchSettings(population=12, generations=2))
        Search.of(short, training_maps(short), PENALTY).run(progress=reports.append)
        assert any(one.passes for one in reports)


def test_a_run_that_finds_designs_needs_no_advice():
    search = SearchSettings(population=12, generations=3)
    wide = SMALL_ARCS.changed(build=SMALL_ARCS.build.changed(trunk_width_mm=40.0), search=search)
    reports = list[Progress]()
    result = Search.of(wide, training_maps(wide), PENALTY).run(progress=reports.append)
    assert result.fabricable
    assert not any(one.advice for one in reports)
    assert PENALTY.passes(result.best)
