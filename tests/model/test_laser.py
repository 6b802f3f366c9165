import math
from collections.abc import Callable
from pathlib import Path

import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.files.shipped import names, shipped_root
from vinefab.model.laser import LaserProfile, RecipeStatus, read_machine, read_profile
from vinefab.model.machine import LaserMachine, Sealer
from vinefab.model.quantity import Standing
from vinefab.physics.tube import seam_load_n_mm, spot_at_mm

SHIPPED = "co2_60w__stretchlon_200"
MELT_J_CM2, CUT_J_CM2 = 2.8, 23.0


@pytest.fixture
def profiles_folder(tmp_path: Path) -> Path:
    """A copy of the shipped profiles that a test may spoil."""
    for kind in ("machines", "materials", "recipes"):
        (tmp_path / kind).mkdir()
        for path in (shipped_root() / "laser_profiles" / kind).glob("*.toml"):
            (tmp_path / kind / path.name).write_text(path.read_text(encoding="utf-8"))
    return tmp_path


def spoil(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count(old) >= 1, f"{old!r} is not in {path.name}"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def fluence(profile: LaserProfile, operation: str) -> float:
    """J/cm^2: 46 mJ along 1 mm, 0.2 mm wide, are 230 mJ/mm^2 or 23 J/cm^2."""
    settings = profile.settings(operation)
    return 0.1 * settings.line_energy_mj_mm(profile.machine) / settings.spot_mm.value


def test_the_shipped_recipe_is_unverified_and_says_so() -> None:
    profile = read_profile(SHIPPED)
    assert profile.recipe.status is RecipeStatus.UNVERIFIED
    assert profile.material.ply_mm.value == 0.0375
    assert profile.material.ply_mm.standing is Standing.PAPER
    seam = profile.material.seam
    assert (seam.pressure_kpa.value, seam.pressure_kpa.standing) == (70.0, Standing.PAPER)
    assert seam.width_mm.standing is Standing.ASSUMED
    assert not seam.burst
    assert profile.machine.usable_mm == (990.0, 590.0)


LASERED = [
    name for name in names("recipe") if "weldcut" in {beam for beam, *_ in read_profile(name).beams}
]
SEALED = [name for name in names("recipe") if read_profile(name).recipe.sealer is not None]


@pytest.mark.parametrize("name", LASERED)
def test_shipped_recipes_have_enough_energy_to_cut_and_little_enough_to_mark(name: str) -> None:
    profile = read_profile(name)
    assert MELT_J_CM2 < fluence(profile, "weld") < CUT_J_CM2 / 2
    assert CUT_J_CM2 < fluence(profile, "weldcut") < 3 * CUT_J_CM2
    assert fluence(profile, "cut") > CUT_J_CM2
    assert fluence(profile, "mark") < MELT_J_CM2


@pytest.mark.parametrize("name", LASERED)
@pytest.mark.parametrize("operation", ["weldcut", "weld", "cut", "mark"])
def test_computed_spots_agree_with_the_machine(name: str, operation: str) -> None:
    profile = read_profile(name)
    settings = profile.settings(operation)
    spot = spot_at_mm(
        profile.machine.spot_mm.value,
        settings.focus_offset_mm.value,
        profile.machine.rayleigh_mm.value,
    )
    assert settings.spot_mm.value == pytest.approx(spot, abs=0.005)


LASERS = [name for name in names("machine") if isinstance(read_machine(name), LaserMachine)]


@pytest.mark.parametrize("name", LASERS)
def test_computed_rayleigh_lengths_follow_from_the_spot(name: str) -> None:
    machine = read_machine(name)
    assert isinstance(machine, LaserMachine)
    expected = math.pi * (machine.spot_mm.value / 2) ** 2 / 10.6e-3
    assert machine.rayleigh_mm.value == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("name", SEALED)
def test_films_that_no_laser_welds_have_a_sealer_in_their_recipe(name: str) -> None:
    profile = read_profile(name)
    weld = profile.settings("weld")
    assert not profile.material.weldable
    assert isinstance(weld, Sealer)
    assert weld.seam_width_mm.value > 0.0
    assert weld.temperature_c.standing is Standing.ASSUMED


@pytest.mark.parametrize("name", names("recipe"))
def test_every_shipped_recipe_bonds_laps_with_numbers_that_nobody_measured(name: str) -> None:
    profile = read_profile(name)
    lap, seam = profile.recipe.lap, profile.material.seam
    assert lap is not None
    assert {lap.band_mm.standing, lap.load_n_per_mm.standing} == {Standing.ASSUMED}
    assert not lap.is_measured_limit
    # As its source says: not more than the side seam is taken to bear
    assert 0.9 * seam_load_n_mm(seam) < lap.load_n_per_mm.value + 0.05 < 1.05 * seam_load_n_mm(seam)


def lap_with(*lines: str) -> str:
    numbers = "".join(
        f'{line}, standing = "measured", source = "x" }}\n'
        for line in ("band_mm = { value = 4.0", *lines)
    )
    return f'[lap]\nmethod = "adhesive_film"\n{numbers}'


def test_a_recipe_without_a_lap_still_reads(profiles_folder: Path) -> None:
    path = profiles_folder / "recipes" / f"{SHIPPED}.toml"
    path.write_text(path.read_text(encoding="utf-8").split("[lap]")[0], encoding="utf-8")
    old, shipped = read_profile(path), read_profile(SHIPPED)
    assert old.recipe.lap is None
    # Reports of robots in one piece keep the fingerprint that this recipe had.
    assert repr(old) == repr(shipped)


@pytest.mark.parametrize(
    ("lines", "load", "is_limit"),
    [
        (["strength_n_per_mm = { value = 0.7"], 0.7, True),
        (["survived_n_per_mm = { value = 0.5"], 0.5, False),
        (["strength_n_per_mm = { value = 0.7", "survived_n_per_mm = { value = 0.9"], 0.7, True),
    ],
)
def test_laps_that_failed_are_a_limit_and_what_they_bore_is_a_bound(
    profiles_folder: Path, lines: list[str], load: float, *, is_limit: bool
) -> None:
    path = profiles_folder / "recipes" / f"{SHIPPED}.toml"
    text = path.read_text(encoding="utf-8").split("[lap]")[0]
    path.write_text(text + lap_with(*lines), encoding="utf-8")
    lap = read_profile(path).recipe.lap
    assert lap is not None
    assert (lap.method, lap.load_n_per_mm.value) == ("adhesive_film", load)
    assert lap.is_measured_limit is is_limit


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"impulse_seal"', '"glue"', "lap.method"),
        ("band_mm = { value = 5.0", "band_mm = { value = 0.0", "lap.band_mm"),
        ("band_mm = { value = 5.0", "band_mm = { value = nan", "lap.band_mm"),
        ("strength_n_per_mm", "strenght_n_per_mm", "strength_n_per_mm"),
        ("strength_n_per_mm = { value = 0.4", "strength_n_per_mm = { value = -0.4", "lap.strength"),
    ],
)
def test_a_wrong_lap_is_one_clear_line(
    profiles_folder: Path, old: str, new: str, words: str
) -> None:
    path = profiles_folder / "recipes" / f"{SHIPPED}.toml"
    head, lap = path.read_text(encoding="utf-8").split("[lap]")
    assert old in lap
    path.write_text(f"{head}[lap]{lap.replace(old, new, 1)}", encoding="utf-8")
    with pytest.raises(BadInputError) as caught:
        read_profile(path)
    assert words in str(caught.value)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_lap_without_a_load_is_refused(profiles_folder: Path) -> None:
    path = profiles_folder / "recipes" / f"{SHIPPED}.toml"
    text = path.read_text(encoding="utf-8").split("[lap]")[0]
    path.write_text(text + lap_with(), encoding="utf-8")
    with pytest.raises(
        BadInputError, match=r"lap\.strength_n_per_mm is missing; give strength_n_per_mm, surv"
    ):
        read_profile(path)


@pytest.mark.parametrize("kind", ["machine", "material", "recipe"])
def test_no_shipped_number_claims_to_be_measured(kind: str) -> None:
    for path in (shipped_root() / "laser_profiles" / f"{kind}s").glob("*.toml"):
        assert '"measured"' not in path.read_text(encoding="utf-8")


MEASURED_SEAMS = {
    "nothing": ("", (70.0, 20.0, False, False)),
    "burst": ("burst_kpa = 82.0, burst_width_mm = 30.0", (82.0, 30.0, True, True)),
    "burst, width assumed": ("burst_kpa = 82.0", (82.0, 20.0, True, False)),
    "width of an old file": ("burst_width_mm = 30.0", (70.0, 30.0, False, False)),
    "survived": ("survived_kpa = 90.0, survived_width_mm = 25.0", (90.0, 25.0, False, False)),
    "both": (
        "burst_kpa = 82.0, burst_width_mm = 30.0, survived_kpa = 60.0, survived_width_mm = 25.0",
        (82.0, 30.0, True, True),
    ),
}


@pytest.mark.parametrize("case", MEASURED_SEAMS)
def test_survived_and_burst_pressures_are_told_apart(profiles_folder: Path, case: str) -> None:
    given, expected = MEASURED_SEAMS[case]
    path = profiles_folder / f"recipes/{SHIPPED}.toml"
    lines = [pair.split(" = ") for pair in given.split(", ") if pair]
    table = "".join(
        f'{key} = {{ value = {value}, standing = "measured", source = "balloon" }}\n'
        for key, value in lines
    )
    path.write_text(f"{path.read_text(encoding='utf-8')}\n[measured]\n{table}", encoding="utf-8")
    seam = read_profile(path).material.seam
    found = (seam.pressure_kpa.value, seam.width_mm.value, seam.burst, seam.is_measured_limit)
    assert found == expected


def test_an_old_material_file_with_a_burst_pressure_is_read(profiles_folder: Path) -> None:
    path = profiles_folder / "materials/stretchlon_200.toml"
    spoil(path, "survived_kpa =", "burst_kpa =")
    spoil(path, "survived_width_mm =", "burst_width_mm =")
    seam = read_profile(profiles_folder / f"recipes/{SHIPPED}.toml").material.seam
    assert (seam.burst, seam.is_measured_limit) == (True, False)
    assert seam.words() == "a tube of 20 mm (assumed) burst at 70 kPa (paper)"


@pytest.mark.parametrize("kept", ["", "survived_kpa", "survived_width_mm"])
def test_a_material_with_half_a_test_is_refused(profiles_folder: Path, kept: str) -> None:
    path = profiles_folder / "materials/stretchlon_200.toml"
    lines = path.read_text(encoding="utf-8").splitlines()
    left = [line for line in lines if not line.startswith("survived_") or line.split()[0] == kept]
    path.write_text("\n".join(left), encoding="utf-8")
    with pytest.raises(BadInputError, match="burst_kpa with burst_width_mm") as caught:
        read_profile(profiles_folder / f"recipes/{SHIPPED}.toml")
    assert "stretchlon_200.toml" in str(caught.value)


def test_what_was_measured_takes_the_materials_place(profiles_folder: Path) -> None:
    path = profiles_folder / f"recipes/{SHIPPED}.toml"
    more = """
[measured]
friction = { value = 0.41, standing = "measured", source = "incline", uncertainty = 0.02 }
[growth]
yield_kpa = { value = 1.0, standing = "measured", source = "fit", uncertainty = 0.1 }
drag_kpa_m = { value = 0.5, standing = "measured", source = "fit", uncertainty = 0.1 }
storage_kpa = { value = 4.0, standing = "measured", source = "fit", uncertainty = 0.1 }
friction = { value = 0.2, standing = "measured", source = "fit", uncertainty = 0.1 }
width_mm = { value = 40.0, standing = "measured", source = "ruler" }
"""
    path.write_text(path.read_text(encoding="utf-8") + more, encoding="utf-8")
    profile = read_profile(path)
    assert profile.material.friction.value == 0.41
    assert profile.material.friction.uncertainty == 0.02
    assert profile.material.seam.pressure_kpa.value == 70.0
    growth = profile.recipe.growth
    assert [growth.yield_kpa.value, growth.storage_kpa.value] == [1.0, 4.0]
    assert [growth.drag_kpa_m.value, growth.friction.value] == [0.5, 0.2]
    assert growth.width_mm.value == 40.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("[sealer]", "[operations.weld]"), "no such key"),
        (lambda text: text[: text.index("[sealer]")], "weldcut, weld or a"),
    ],
)
def test_a_recipe_that_makes_no_seam_is_refused(
    profiles_folder: Path, change: Callable[[str], str], message: str
) -> None:
    path = profiles_folder / "recipes/co2_60w__stretchlon_800.toml"
    path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(BadInputError, match=message):
        read_profile(path)


def test_a_recipe_that_does_not_cut_is_refused(profiles_folder: Path) -> None:
    path = profiles_folder / f"recipes/{SHIPPED}.toml"
    before, after = path.read_text(encoding="utf-8").split("[operations.cut]")
    path.write_text(before + after[after.index("[operations.") :], encoding="utf-8")
    with pytest.raises(BadInputError, match=r"operations\.cut is missing"):
        read_profile(path)


def test_a_recipe_given_by_path_uses_the_machine_beside_it(profiles_folder: Path) -> None:
    spoil(profiles_folder / "machines/co2_60w.toml", "value = 1000.0", "value = 700.0")
    profile = read_profile(profiles_folder / f"recipes/{SHIPPED}.toml")
    assert profile.machine.bed_width_mm.value == 700.0


def test_a_recipe_outside_any_folder_uses_shipped_machines(tmp_path: Path) -> None:
    source = shipped_root() / f"laser_profiles/recipes/{SHIPPED}.toml"
    alone = tmp_path / "deep" / f"{SHIPPED}.toml"
    alone.parent.mkdir()
    alone.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
    assert read_profile(alone).machine.name == "co2_60w"


WELD_KERF = (
    'kerf_mm = { value = 0.0, standing = "assumed", source = "nothing is removed" }\n'
    "seam_width_mm = { value = 1.0"
)
REVERSED_WINDOW = """[[coupons.windows]]
operation = "weld"
focus_mm = 0.0
least_mj_mm = { value = 30.0, standing = "measured", source = "coupons" }
most_mj_mm = { value = 20.0, standing = "measured", source = "coupons" }
"""


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (f"recipes/{SHIPPED}.toml", "kerf_mm", "kerf_um", "kerf_um"),
        (f"recipes/{SHIPPED}.toml", "kerf_mm", "kerf_in", "did you mean 'kerf_mm'"),
        (f"recipes/{SHIPPED}.toml", '"unverified"', '"fine"', "burst_tested"),
        (f"recipes/{SHIPPED}.toml", "value = 12.0", "value = 120.0", "to 100"),
        (f"recipes/{SHIPPED}.toml", "value = 60.0", "value = nan", "finite"),
        (f"recipes/{SHIPPED}.toml", "[operations.cut]", "[operations.mark2]", "mark2"),
        (f"recipes/{SHIPPED}.toml", f'name = "{SHIPPED}"', 'name = "other"', "name of the file"),
        (f"recipes/{SHIPPED}.toml", "value = 12.0", "value = 0.0", "weldcut.power_percent"),
        (f"recipes/{SHIPPED}.toml", "value = 12.0", "value = 9.0", "min_power_percent is 10.0"),
        (f"recipes/{SHIPPED}.toml", "value = 0.4,", "value = 0.0,", "weldcut.seam_width_mm is 0.0"),
        (f"recipes/{SHIPPED}.toml", "value = 1.0,", "value = 0.0,", "weld.seam_width_mm is 0.0"),
        (f"recipes/{SHIPPED}.toml", WELD_KERF, WELD_KERF.replace("0.0", "0.1"), "weld.kerf_mm"),
        (f"recipes/{SHIPPED}.toml", "[lap]", f"{REVERSED_WINDOW}\n[lap]", "windows[1].least_mj_mm"),
        ("machines/co2_60w.toml", "value = 5.0", "value = 300.0", "margin_mm is 300.0"),
        ("machines/co2_60w.toml", ', standing = "assumed"', "", "standing"),
        ("machines/co2_60w.toml", '"assumed"', '"guessed"', "measured"),
        ("machines/co2_60w.toml", "value = 1000.0", "value = 0.0", "bed_width_mm"),
        ("machines/co2_60w.toml", "value = 1000.0", 'value = "1 m"', "number"),
        ("materials/stretchlon_200.toml", "plies = 2", "plies = 2\nline_energy_mj_mm = 3", "line"),
    ],
)
def test_a_spoilt_profile_is_refused_with_the_reason(
    profiles_folder: Path, file: str, old: str, new: str, message: str
) -> None:
    spoil(profiles_folder / file, old, new)
    with pytest.raises(BadInputError) as caught:
        read_profile(profiles_folder / f"recipes/{SHIPPED}.toml")
    assert message in str(caught.value)
    assert Path(file).name in str(caught.value)


def test_a_sealer_needs_a_table_and_bars_and_no_head(tmp_path: Path) -> None:
    number = '{ value = 300.0, standing = "assumed", source = "x" }'
    keys = ("bed_width_mm", "bed_height_mm", "bar_mm")
    lines = [f"{key} = {number}" for key in keys]
    lines.append('margin_mm = { value = 5.0, standing = "assumed", source = "x" }')
    head = 'schema = "vinefab/machine-1"\nkind = "sealer"\nname = "bars"\ntitle = "A sealer"\n'
    path = tmp_path / "bars.toml"
    path.write_text(head + "\n".join(lines), encoding="utf-8")
    assert read_machine(path).usable_mm == (290.0, 290.0)
    path.write_text(f"{head}power_w = {number}\n" + "\n".join(lines), encoding="utf-8")
    with pytest.raises(BadInputError, match="there is no such key"):
        read_machine(path)
    path.write_text(head.replace("sealer", "glue"), encoding="utf-8")
    with pytest.raises(BadInputError, match="kind is 'glue'; allowed: one of laser, hot_tip"):
        read_machine(path)


@pytest.mark.parametrize("bar", ["0.0", "-300.0", "inf", '"long"'])
def test_a_sealer_needs_the_length_of_its_bars(profiles_folder: Path, bar: str) -> None:
    path = profiles_folder / "machines" / "impulse_sealer_300.toml"
    spoil(path, "bar_mm = { value = 300.0", f"bar_mm = {{ value = {bar}")
    with pytest.raises(BadInputError, match="bar_mm"):
        read_machine(path)
