"""Coupon, calibrate and fabricate, one after the other, as a technician does it."""

import json
import math

import pytest

from vinefab.cli.main import main
from vinefab.model.files.shipped import shipped_root
from vinefab.model.laser import RecipeStatus, read_profile
from vinefab.model.quantity import Standing

RECIPE = "co2_60w__stretchlon_200"
READ = {
    "kerf_piece,weldcut": "49.74",
    "kerf_piece,cut": "49.83",
    "seam,weldcut": "0.50",
    "width,5": "4.88",
    "width,8": "7.92",
    "width,10": "9.86",
    "width,16": "15.9",
    "width,20": "19.84",
    "width,30": "29.9",
    "width,40": "39.86",
    "burst,20": "82",
}


def filled(folder):
    """Fill in the table that lies in a coupon folder, bursts and seams differing a little."""
    lines = []
    for number, line in enumerate((folder / "results.csv").read_text().splitlines()):
        cells = line.split(",")
        value = READ.get(",".join(cells[:2])) if line[0] != "#" else None
        if value is not None:
            spread = 0.01 * number if cells[0] in ("burst", "seam") else 0.0
            cells[2] = f"{float(value) + spread:.3f}"
        lines.append(",".join(cells))
    (folder / "results.csv").write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def coupons(tmp_path_factory):
    """A folder of coupons whose table is filled in."""
    folder = tmp_path_factory.mktemp("cut") / "coupons"
    assert main(["coupon", "--recipe", RECIPE, "--out", str(folder), "-q"]) == 0
    filled(folder)
    return folder


def test_coupons_are_cut_measured_and_given_back(vinefab, coupons, tmp_path):
    folder, mine = coupons, tmp_path / "mine.toml"
    code, words, complaint = vinefab("calibrate", folder / "results.csv", "--out", mine)
    assert (code, complaint) == (0, "")
    assert "weldcut.kerf_mm" in words
    assert "burst_tested" in words
    profile = read_profile(mine)
    assert profile.recipe.status is RecipeStatus.BURST_TESTED
    kerf = profile.settings("weldcut").kerf_mm
    assert kerf.standing is Standing.MEASURED
    assert kerf.value == pytest.approx(0.26, abs=0.1)
    assert 0.0 < kerf.uncertainty < 0.1
    assert profile.material.burst_kpa.standing is Standing.MEASURED
    out = tmp_path / "package"
    assert vinefab("fabricate", "plain_vine", "--recipe", mine, "--out", out, "-q") == (0, "", "")
    job = json.loads((out / "job.json").read_text())
    assert job["facts"]["recipe_status"] == "burst_tested"
    settings = profile.settings("weldcut")
    expected = settings.seam_width_mm.value + settings.kerf_mm.value / 2
    assert job["facts"]["weldcut_offset_mm"] == pytest.approx(expected)


@pytest.mark.thorough
def test_a_table_that_was_filled_in_is_not_lost(vinefab, coupons):
    before = {path.name: path.read_bytes() for path in coupons.iterdir()}
    code, said, complaint = vinefab("coupon", "--out", coupons)
    assert (code, complaint) == (0, "")
    assert "results.csv, filled in, is kept" in said
    assert {path.name: path.read_bytes() for path in coupons.iterdir()} == before
    # The coupons of another film are measured in another table.
    code, _, complaint = vinefab("coupon", "--recipe", "co2_60w__tpu_nylon_70d", "--out", coupons)
    assert (code, "filled in" in complaint) == (2, True)
    assert {path.name: path.read_bytes() for path in coupons.iterdir()} == before


def test_a_calibrated_recipe_is_calibrated_again_by_what_is_new(vinefab, tmp_path):
    table, mine, again = tmp_path / "r.csv", tmp_path / "mine.toml", tmp_path / "again.toml"
    table.write_text(
        "measure,setting,value,unit,uncertainty\n"
        "kerf_piece,weldcut,49.7,mm,0.02\nseam,weldcut,0.5,mm,0.05\n"
    )
    assert vinefab("calibrate", table, "--out", mine, "-q")[0] == 0
    assert read_profile(mine).recipe.status is RecipeStatus.COUPON_OK
    table.write_text(
        "measure,setting,value,unit,uncertainty\nburst,20,80,kPa,2\nburst,20,83,kPa,2\n"
        "burst,20,79,kPa,2\nfriction_incline,,20,deg,1\n"
    )
    assert vinefab("calibrate", table, "--recipe", mine, "--out", again, "-q")[0] == 0
    profile = read_profile(again)
    assert profile.recipe.status is RecipeStatus.BURST_TESTED
    assert profile.settings("weldcut").kerf_mm.value == pytest.approx(0.3)
    assert profile.material.friction.uncertainty == pytest.approx(0.0198, abs=1e-3)


def test_peel_crotches_and_energies_are_kept_in_the_recipe(vinefab, tmp_path):
    table, mine, again = tmp_path / "r.csv", tmp_path / "mine.toml", tmp_path / "again.toml"
    table.write_text(
        "measure,setting,value,unit,uncertainty\npeel,25,10,N,0.5\ncrotch_burst,8,45,kPa,\n"
        "matrix,46.8 6,weldcut,,\nmatrix,81.8 6,weldcut,,\nmatrix,143.0 6,cut,,\n"
    )
    record = tmp_path / "said.json"
    assert vinefab("calibrate", table, "--out", mine, "--json", record, "-q")[0] == 0
    (window,) = [
        w for w in json.loads(record.read_text())["windows"] if w["operation"] == "weldcut"
    ]
    assert (window["focus_mm"], window["most_mj_mm"]["value"]) == (6.0, 81.8)
    table.write_text("measure,setting,value,unit,uncertainty\nfriction_incline,,20,deg,1\n")
    assert vinefab("calibrate", table, "--recipe", mine, "--out", again, "-q")[0] == 0
    recipe = read_profile(again).recipe
    peel = recipe.coupons.peel_n_mm
    assert (peel.value, peel.uncertainty, peel.standing) == (0.4, 0.02, Standing.MEASURED)
    assert recipe.coupons.crotch_fillet_mm.value == 8.0
    (sealing,) = [w for w in recipe.coupons.windows if w.operation == "weldcut"]
    assert (sealing.least_mj_mm.value, sealing.most_mj_mm.value) == (46.8, 81.8)
    assert sealing.most_mj_mm.source.startswith("r.csv: energy matrix: 2 of 3 lines")
    code, words, _ = vinefab("profiles", again)
    assert code == 0
    assert "coupons.peel_n_mm" in words
    assert "weldcut.focus_6_mm.most_mj_mm" in words
    # 7.2 W at 60 mm/s: more than what the coupons call right
    code, words, _ = vinefab("check", "plain_vine", "--recipe", again)
    assert code == 0
    assert "weldcut runs 120.0 mJ/mm, but the coupons say" in words


def test_film_that_shrinks_is_measured_written_and_said_in_every_check(vinefab, tmp_path):
    table, mine, record = (tmp_path / name for name in ("r.csv", "mine.toml", "fitted.json"))
    lengths = (40.0, 40.1, 160.0, 280.1, 280.0)
    rows = [f"length,{round(mm, -1):g},{0.98 * mm + 0.3:.2f},mm" for mm in lengths]
    noise = [f"friction_incline,,{degrees},deg" for degrees in (20, 85)]
    table.write_text("measure,setting,value,unit\n" + "\n".join([*rows, *noise]) + "\n")
    code, words, complaint = vinefab("calibrate", table, "--out", mine, "--json", record)
    assert (code, complaint) == (0, "")
    assert "not fitted: friction: " in words
    assert "85 deg" in json.loads(record.read_text())["refused"]["friction"]
    shrinkage = read_profile(mine).material.shrinkage_percent
    assert shrinkage.value == pytest.approx(2.0, abs=0.05)
    assert shrinkage.standing is Standing.MEASURED
    # Three degrees of freedom: 3.18 standard deviations, not 1.96.
    assert shrinkage.uncertainty_95 == pytest.approx(3.18 * shrinkage.uncertainty, rel=1e-2)
    code, words, _ = vinefab("check", "plain_vine", "--recipe", mine)
    assert code == 0
    assert "film shrinks by 2" in words
    out = tmp_path / "package"
    given = ("fabricate", "plain_vine", "--out", out, "--allow-uncalibrated", "--force", "-q")
    assert vinefab(*given, "--recipe", mine)[0] == 0
    assert json.loads((out / "job.json").read_text())["material"]["shrinkage_percent"]["value"]
    assert vinefab(*given)[0] == 0
    assert "shrinkage" not in (out / "job.json").read_text() + (out / "report.html").read_text()


LAPS = "measure,setting,value,unit,uncertainty\n"


def severity_of_lap(recipe):
    """What VF-J03 would make of a load beyond that of a recipe."""
    return "error" if read_profile(recipe).recipe.lap.is_measured_limit else "warning"


def test_laps_that_were_burst_become_the_recipes_strength(vinefab, tmp_path):
    table, mine, again = tmp_path / "r.csv", tmp_path / "mine.toml", tmp_path / "again.toml"
    # None failed: what they bore takes the place of the assumed strength, and still warns.
    table.write_text(f"{LAPS}lap_survived,20,60,kPa,\nlap_survived,10,140,kPa,\n")
    code, words, _ = vinefab("calibrate", table, "--out", mine)
    assert code == 0
    assert "no lap failed" in words
    recipe = read_profile(mine).recipe
    assert recipe.status is RecipeStatus.UNVERIFIED
    assert recipe.lap.strength_n_per_mm is None
    assert recipe.lap.survived_n_per_mm.standing is Standing.MEASURED
    assert recipe.lap.survived_n_per_mm.value == pytest.approx(0.2069, abs=1e-4)
    assert recipe.lap.band_mm.standing is Standing.ASSUMED
    assert severity_of_lap(mine) == "warning"
    # Others failed: now it is known where.
    table.write_text(
        f"{LAPS}lap_band,adhesive_film,9,mm,\nlap_burst,20,80,kPa,\nlap_burst,20,88,kPa,\n"
    )
    assert vinefab("calibrate", table, "--recipe", mine, "--out", again, "-q")[0] == 0
    lap = read_profile(again).recipe.lap
    assert (lap.method, lap.band_mm.value) == ("adhesive_film", 9.0)
    assert lap.survived_n_per_mm is None  # it was of another bond
    assert lap.strength_n_per_mm.value == pytest.approx(84.0 * 20.0 / 2000.0 / math.pi, rel=1e-5)
    assert lap.strength_n_per_mm.uncertainty > 0.0
    assert severity_of_lap(again) == "error"
    # A measured strength stays where later laps of the same bond did not fail.
    table.write_text(f"{LAPS}lap_survived,20,40,kPa,\n")
    assert vinefab("calibrate", table, "--recipe", again, "--out", mine, "--force", "-q")[0] == 0
    assert read_profile(mine).recipe.lap.strength_n_per_mm == lap.strength_n_per_mm
    code, words, _ = vinefab("profiles", again)
    assert "lap.adhesive_film.strength_n_per_mm" in words


def test_a_recipe_without_a_lap_gets_one_only_with_its_bond(vinefab, tmp_path):
    own, table, out = tmp_path / "own.toml", tmp_path / "r.csv", tmp_path / "mine.toml"
    text = (shipped_root() / f"laser_profiles/recipes/{RECIPE}.toml").read_text()
    own.write_text(text.split("[lap]")[0].replace(f'name = "{RECIPE}"', 'name = "own"'))
    table.write_text(f"{LAPS}lap_burst,20,80,kPa,3\n")
    code, _, complaint = vinefab("calibrate", table, "--recipe", own, "--out", out)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "a row lap_band: recipe own has no [lap]" in complaint
    assert not out.exists()
    table.write_text(f"{LAPS}lap_burst,20,80,kPa,3\nlap_band,impulse_seal,5,mm,\n")
    assert vinefab("calibrate", table, "--recipe", own, "--out", out, "-q")[0] == 0
    assert read_profile(out).recipe.lap.is_measured_limit


def test_a_recipe_whose_machine_would_not_be_found_is_not_written(vinefab, tmp_path):
    recipes = tmp_path / "lab" / "recipes"
    recipes.mkdir(parents=True)
    machines = tmp_path / "lab" / "machines"
    machines.mkdir()
    root = shipped_root() / "laser_profiles"
    text = (root / f"recipes/{RECIPE}.toml").read_text().replace('"co2_60w"', '"ours"')
    (recipes / f"{RECIPE}.toml").write_text(text)
    machine = (root / "machines/co2_60w.toml").read_text().replace('"co2_60w"', '"ours"')
    (machines / "ours.toml").write_text(machine)
    table = tmp_path / "r.csv"
    table.write_text("measure,setting,value,unit,uncertainty\nseam,weldcut,0.5,mm,0.05\n")
    given = ("calibrate", table, "--recipe", recipes / f"{RECIPE}.toml")
    code, _, complaint = vinefab(*given, "--out", tmp_path / "elsewhere" / "mine.toml")
    assert code == 2
    assert "ours" in complaint
    assert vinefab(*given, "--out", recipes / "mine.toml", "-q") == (0, "", "")
    assert read_profile(recipes / "mine.toml").machine.name == "ours"
