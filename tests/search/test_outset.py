"""What is said of trunk and targets before a search, and the trunk that film is given."""

import pytest

from tests.search.target_cases import SPACE, cases, thick_film
from vinefab.fabrication.checking import subject_of
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.model.design import Design, Level
from vinefab.model.files.profile_toml import read_profile
from vinefab.search.advice import said_before, with_trunk_for_film
from vinefab.search.record.generations import Progress, RunIdentity
from vinefab.search.record.result import RECORD_FILE, RunArchive
from vinefab.search.record.store import RunStore
from vinefab.search.run import Search, penalty_of, training_maps
from vinefab.search.settings import RunSettings
from vinefab.search.space import BuildSettings


def run_file(folder, text):
    """Read a run of the space of the target cases with film of 0.1 mm, and more tables."""
    ranges = "".join(f"{name} = {ends}\n" for name, ends in SPACE.items())
    path = folder / "run.toml"
    recipe = f'[evaluation]\nrecipe = "{thick_film(folder)}"\n'
    path.write_text(f'schema = "vinefab/run-1"\n[space]\n{ranges}{recipe}{text}', "utf-8")
    return with_trunk_for_film(RunSettings.read(path))


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


@pytest.mark.parametrize(("width_mm", "passes"), [(61.0, True), (59.0, False)])
def test_the_width_is_the_narrowest_that_three_levels_of_the_film_keep_the_rule_with(
    tmp_path, width_mm, *, passes
):
    build = BuildSettings(trunk_width_mm=width_mm, width_ratio=0.8, compensation="none").build(3)
    levels = tuple(Level.of(branches=3, length_mm=150.0, angle_deg=120.0) for _ in range(2))
    design = Design(name="tree", trunk_length_mm=150.0, levels=levels, build=build)
    subject = subject_of(design, read_profile(thick_film(tmp_path)))
    assert (not run_checks(subject, only={"VF-W03"}).blocking) is passes


def searched(settings):
    return Search.of(settings, training_maps(settings), penalty_of(settings))


def test_a_narrow_trunk_and_a_small_sheet_are_named_before_anything_is_searched(tmp_path):
    asked = {(kind, number): settings for kind, number, settings in cases(tmp_path, 2)}
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


def test_a_run_says_it_with_its_first_generation_and_where_targets_are_missed(tmp_path):
    asked = {(kind, number): settings for kind, number, settings in cases(tmp_path, 2)}
    settings, seen = asked["0.1 mm, 300 mm roll, flat", 1], list[Progress]()
    settings = settings.changed(search=settings.search.changed(population=12))
    maps = training_maps(settings)
    with RunStore.open(tmp_path, RunIdentity.of(settings, maps), maps=maps) as store:
        result = Search.of(settings, maps, penalty_of(settings)).run(
            store=store, progress=seen.append
        )
    assert "VF-S01" in seen[0].advice
    assert result.targets is not None
    assert result.targets.missed
    assert any("allow pieces" in note for note in result.notes)
    recorded = RunArchive.read(tmp_path / RECORD_FILE)
    assert recorded.notes
    assert set(recorded.notes) <= set(result.notes)
    assert recorded.result().notes == recorded.notes
