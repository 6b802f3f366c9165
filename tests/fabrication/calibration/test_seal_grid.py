"""Coupons of a hot tip: the grid of temperatures and speeds, and the recipe that it makes."""

import csv
import itertools
import re
from pathlib import Path

import numpy as np
import pytest
import shapely

import vinefab as vf
from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.fabrication.calibration.coupon_package import CouponSet, coupon_files, make_coupons
from vinefab.fabrication.calibration.coupons import read_results
from vinefab.fabrication.calibration.fit_recipe import fitted_recipe
from vinefab.fabrication.calibration.seal_grid import seal_grid
from vinefab.model.job import Operation
from vinefab.model.laser import RecipeStatus, read_profile

RECIPE = "hot_tip_220__stretchlon_200"


@pytest.fixture(scope="module")
def coupons() -> CouponSet:
    return make_coupons(read_profile(RECIPE))


@pytest.fixture(scope="module")
def files(coupons: CouponSet) -> dict[str, bytes]:
    return coupon_files(coupons)


def filled(files: dict[str, bytes], folder: Path, **values: dict[str, str]) -> Path:
    """Write the table of results with values by measure and setting."""
    lines = files["results.csv"].decode().splitlines()
    head = [line for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    out = folder / "results.csv"
    with out.open("w", newline="") as stream:
        stream.write("\n".join(head) + "\n")
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        for row in rows:
            row["value"] = values.get(row["measure"], {}).get(row["setting"], "")
            writer.writerow(row)
    return out


def test_the_grid_is_in_gcode_the_coolest_first_each_line_at_its_speed(files) -> None:
    text = files["seal_grid_weld.gcode"].decode()
    heats = [float(one) for one in re.findall(r"M109 S([\d.]+)", text)]
    assert heats == sorted(heats) == [160.0, 170.0, 180.0, 190.0, 200.0]
    feeds = [float(one) for one in re.findall(r"^G1 X.* F([\d.]+)$", text, re.MULTILINE)]
    assert feeds == [60.0 * speed for speed in (1.25, 2.5, 5.0, 10.0, 20.0)] * 5


def test_every_line_and_coupon_lies_on_the_bed_and_apart(coupons: CouponSet) -> None:
    grid = seal_grid(read_profile(RECIPE))
    assert grid is not None
    lines = [path.contour.points_mm for path in grid.job.paths]
    assert np.concatenate(lines).min() >= 10.0
    assert np.concatenate(lines).max() <= 210.0
    for one, two in itertools.combinations(lines, 2):
        assert shapely.LineString(one).distance(shapely.LineString(two)) >= 5.0
    for job in coupons.sheets:
        for path in job.along(Operation.WELD):
            x0, y0, x1, y1 = path.contour.box_mm
            assert min(x0, y0) >= 10.0
            assert max(x1, y1) <= 210.0


def test_balloons_and_joints_are_there_and_what_the_bed_cannot_hold_is_named(
    files, coupons: CouponSet
) -> None:
    text = " ".join(files["README.txt"].decode().split())
    assert "larger than this bed: L280-1, L280-2, PAIR-60-W40, PAIR-80-W40." in text
    labels = {path.of for job in coupons.sheets for path in job.paths}
    assert {"BURST-1", "BURST-2", "BURST-3", "PAIR-60-W20", "ELBOW-60-W40", "W5"} <= labels
    assert not any(label.startswith("L280") for label in labels)


def test_the_grid_chooses_the_middle_of_the_widest_row(files, tmp_path: Path) -> None:
    seals = {"160 1.25": "seals", "160 2.5": "peels", "170 1.25": "seals", "170 2.5": "seals"}
    seals |= {"180 1.25": "burnt", "180 2.5": "seals", "180 5": "seals", "180 10": "seals"}
    seals |= {"180 20": "nothing", "190 5": "seals", "190 10": "seals", "200 10": "burnt"}
    results = read_results(filled(files, tmp_path, grid=seals))
    found = fitted_recipe(results, read_profile(RECIPE))
    assert found.fitted["hot_tip.seal_temperature_c"].value == 180.0
    assert found.fitted["hot_tip.seal_speed_mm_s"].value == pytest.approx(5.0)  # root of 2.5 x 10
    assert found.status is RecipeStatus.UNVERIFIED  # the seam was not measured


def test_calibrate_writes_a_recipe_with_what_was_measured(files, tmp_path: Path) -> None:
    seals = {f"170 {speed}": "seals" for speed in ("1.25", "2.5", "5")}
    widths = {"5": "4.8", "10": "9.8", "20": "19.8", "40": "39.8"}
    table = filled(
        files, tmp_path, grid=seals, seam={"weld": "1.2"}, width=widths, burst={"20": "60"}
    )
    out = tmp_path / "mine.toml"
    vf.calibrate(table, RECIPE, out=out)
    mine = read_profile(out)
    tip = mine.recipe.hot_tip
    assert tip is not None
    assert (tip.seal_temperature_c.value, tip.seal_temperature_c.standing) == (170.0, "measured")
    assert tip.seal_speed_mm_s.value == pytest.approx(2.5)
    assert tip.seam_width_mm.value == pytest.approx(1.2, abs=0.01)
    assert mine.recipe.status is RecipeStatus.BURST_TESTED
    assert mine.material.burst_kpa is not None
    assert mine.material.burst_kpa.value == pytest.approx(60.0)


def test_a_grid_on_which_nothing_sealed_is_refused(files, tmp_path: Path) -> None:
    results = read_results(filled(files, tmp_path, grid={"160 5": "peels", "200 5": "burnt"}))
    with pytest.raises(UnfitInputError, match="no line of the grid sealed; try other temperatures"):
        fitted_recipe(results, read_profile(RECIPE))


def test_an_unknown_outcome_is_refused(files, tmp_path: Path) -> None:
    table = filled(files, tmp_path, grid={"160 5": "weld"})
    with pytest.raises(BadInputError, match="nothing, peels, seals, burnt"):
        read_results(table)


def test_a_recipe_of_a_laser_has_no_grid() -> None:
    assert seal_grid(read_profile("co2_60w__stretchlon_200")) is None
