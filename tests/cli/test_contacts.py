"""Measured contacts, as each command that predicts reads them."""

import json
import math
import re
from base64 import b64decode

import pytest

from vinefab.growth.options import GrowthOptions, growth_text
from vinefab.growth.plan import Plan
from vinefab.model.contacts import read_contacts
from vinefab.model.design import Design, design_text
from vinefab.model.inputs import as_growth
from vinefab.search.settings import plain_settings, read_run, settings_from_plain

HALF_ANGLE = """
[head_on_half_angle_deg]
value = 4.5
low = 3.0
high = 6.0
count = 12
photos = 4
standing = "measured"
source = "5 tips stopped, 7 slid"
"""
WIDTH = """
[body_width_ratio]
value = 1.05
low = 1.0
high = 1.1
count = 7
photos = 4
standing = "measured"
source = "distance of centre lines from walls"
"""
BOUND = """
[head_on_half_angle_deg]
{end}
side = "{side}"
count = 3
photos = 2
standing = "measured"
source = "photos"
"""
SCHEMA = 'schema = "vinefab/contacts-1"\n'
WORDS = "12 contacts on 4 photos, 95 % interval 3 to 6 deg; too few photos, from 5 on"


@pytest.fixture
def measured(tmp_path):
    path = tmp_path / "contacts.toml"
    path.write_text(SCHEMA + HALF_ANGLE + WIDTH)
    return path


@pytest.fixture
def bounded(tmp_path):
    def write(side, low, high):
        path = tmp_path / f"{side}.toml"
        path.write_text(SCHEMA + BOUND.format(side=side, end=f"low = {low}\nhigh = {high}"))
        return path

    return write


def test_one_growth_uses_the_measured_value(vinefab, grid, plain, measured):
    code, words, _ = vinefab("grow", plain, "--map", grid, "--contacts", measured, "--json", "-")
    assert code == 0
    metrics = json.loads(words)["metrics"]
    assert metrics["head_on_half_angle_deg"] == 4.5
    assert metrics["body_width_ratio"] == 1.05
    assert metrics["contacts"]["head_on_half_angle_deg"]["low"] == 3.0
    code, words, _ = vinefab("grow", plain, "--map", grid, "--contacts", measured)
    assert f"head-on half-angle 4.5 deg (measured: {WORDS})" in words
    assert "1.05 of the nominal radius from walls (measured: 7 contacts on 4 photos" in words
    assert "the measured value of its range" in words


def test_scores_are_drawn_over_the_measured_interval(vinefab, grid, plain, measured):
    code, words, _ = vinefab("score", plain, "--map", grid, "--poses", 2, "--contacts", measured)
    assert code == 0
    assert f"head-on half-angle 3 to 6 deg (measured: {WORDS})" in words


def test_reports_say_measured_on_their_page_and_in_their_numbers(
    vinefab, grid, plain, measured, tmp_path
):
    page = tmp_path / "page.html"
    more = ("--map", grid, "--poses", 2, "--contacts", measured, "--out", page, "--json", "-")
    code, words, _ = vinefab("report", plain, *more)
    assert code == 0
    width = json.loads(words[words.index("{") :])["width"]["contacts"]
    assert width["head_on_half_angle_deg"] == [3.0, 3.75, 4.5, 5.25, 6.0]
    assert width["standing"] == f"measured: {WORDS}"
    text = page.read_text()
    charts = [b64decode(one).decode() for one in re.findall(r"svg\+xml;base64,([^\"]+)", text)]
    assert any("tips stop within 3 to 6 deg, measured: " in chart for chart in charts)
    assert "slides on or stops there was measured (12 contacts on 4 photos" in text
    assert "growth.body_width_ratio" in text


def test_comparisons_and_poses_are_of_the_measured_interval(vinefab, grid, plain, measured):
    more = ("--map", grid, "--contacts", measured, "--json", "-")
    _, words, _ = vinefab("compare", plain, "plain_vine", *more, "--poses", 1)
    assert json.loads(words)["growth"]["contacts"]["head_on_half_angle_deg"]["value"] == 4.5
    _, words, _ = vinefab("aim", plain, *more, "--deployments", 5000, "--alone")
    found = json.loads(words)
    assert found["growth"]["head_on_half_angle_deg"] == [3.0, 6.0]
    assert f"--contacts {measured}" in found["reproduce"]["command"]


def test_a_given_half_angle_is_assumed_again(vinefab, grid, plain, measured):
    more = ("--contacts", measured, "--head-on-half-angle-deg", 10)
    _, words, _ = vinefab("grow", plain, "--map", grid, *more)
    assert "head-on half-angle 10 deg (assumed)" in words


def test_bounds_leave_the_other_end_assumed(bounded):
    upper = GrowthOptions.of({"contacts": read_contacts(bounded("upper", 0.0, 8.0))})
    assert upper.half_angle_deg == [1.0, 8.0]
    assert upper.contact_angles_deg[-1] == 8.0
    vine = Design.read("plain_vine")
    assert "at most 8 deg; too few photos, from 5 on; 1 deg assumed)" in growth_text(upper, [vine])
    lower = GrowthOptions.of({"contacts": read_contacts(bounded("lower", 12.0, 90.0))})
    assert lower.half_angle_deg == [12.0, 30.0]
    assert "at least 12 deg; too few photos, from 5 on; 30 deg assumed)" in growth_text(
        lower, [vine]
    )
    loose = GrowthOptions.of({"contacts": read_contacts(bounded("upper", 0.0, 40.0))})
    assert loose.half_angle_deg == [1.0, 30.0]
    few = "too few photos, from 5 on"
    assert f"at most 40 deg; {few}; 1 to 30 deg assumed)" in growth_text(loose, [vine])
    assert upper.at_one_angle.half_angle_deg == 1.0


def test_a_name_is_looked_for_in_the_users_own_folder(measured, monkeypatch, tmp_path):
    monkeypatch.setenv("VINEFAB_PROFILES", str(tmp_path))
    (tmp_path / "contacts").mkdir()
    measured.rename(tmp_path / "contacts" / "our_film.toml")
    assert as_growth({"contacts": "our_film"})["contacts"].head_on_half_angle_deg.value == 4.5


@pytest.mark.usefixtures("measured")
def test_run_files_name_it_relative_to_themselves_and_records_keep_it(tmp_path):
    run = tmp_path / "run.toml"
    run.write_text('schema = "vinefab/run-1"\n[growth]\ncontacts = "contacts.toml"\n')
    settings = read_run(run)
    assert settings.growth.half_angle_deg == [3.0, 6.0]
    assert settings.growth.body_width_ratio == 1.05
    record = json.loads(json.dumps(plain_settings(settings)))
    assert settings_from_plain(record) == settings
    run.write_text('schema = "vinefab/run-1"\n[growth]\ncontacts = "other.toml"\n')
    with pytest.raises(Exception, match="there is no such file"):
        read_run(run)


def test_designs_that_were_trained_with_it_are_grown_with_it(measured, tmp_path):
    growth = GrowthOptions.of({"contacts": read_contacts(measured)})
    vine = Design.read("plain_vine")
    trained = tmp_path / "trained.toml"
    content = design_text(vine)
    trained.write_text(content)
    design = Design.read(trained)
    object.__setattr__(design, "origin", {"growth": growth.content})
    trained.write_text(design_text(design))
    again = GrowthOptions.of(Design.read(trained).origin["growth"])
    assert again == growth


def test_without_measured_contacts_nothing_changes():
    plain = GrowthOptions()
    assert "contacts" not in plain.content
    assert plain.contact_angles_deg == (1.0, 8.25, 15.5, 22.75, 30.0)
    tree = Design.read("three_level_tree")
    radii_mm = Plan.of(tree, plain).radii_mm
    assert radii_mm == Plan.of(tree, GrowthOptions.of({"body_width_ratio": 1.0})).radii_mm
    wider = Plan.of(tree, GrowthOptions.of({"body_width_ratio": 1.5})).radii_mm
    assert wider == pytest.approx([1.5 * radius_mm for radius_mm in radii_mm])


def test_a_body_too_wide_for_its_start_is_reported_as_such(vinefab, grid, plain, tmp_path):
    page = tmp_path / "page.html"
    wide = ("--map", grid, "--growth", "body_width_ratio=2")
    code, words, _ = vinefab("report", plain, *wide, "--poses", 1, "--out", page, "--json", "-")
    assert code == 0
    assert all(
        reach["needed_kpa"] is None for reach in json.loads(words)["width"]["pressure"]["reaches"]
    )
    width_mm = Design.read(plain).build.widths_mm[0]
    room = f"no room for its inflated body of {2 * 2 * width_mm / math.pi:.0f} mm"
    assert room in vinefab("grow", plain, *wide)[1]


# --- vinefab fit-observations


@pytest.fixture
def observed(seen, tmp_path):
    """Observations of two photos in files."""
    files = [tmp_path / f"seen_{number}.json" for number in range(len(seen))]
    for file, document in zip(files, seen, strict=True):
        file.write_text(json.dumps(document))
    return files


def test_observations_are_fitted_and_the_file_is_read(vinefab, grid, plain, observed, tmp_path):
    file = tmp_path / "mine.toml"
    code, words, _ = vinefab("fit-observations", *observed, "--out", file)
    assert code == 0
    assert "head-on half-angle" in words
    assert "6 contacts on 2 photos, 3 stopped, 3 slid" in words
    assert "2 photos with contacts: too few" in words
    assert "centre lines keep from walls, against lay-flat width / pi: 1.04" in words
    assert "its map is not read" in words
    assert "not compared: only one of the two ways" in words
    again = file.read_bytes()
    assert (
        vinefab("fit-observations", *observed, "--out", file)[0] == 0
    )  # its own file, not a foreign one
    assert file.read_bytes() == again
    assert (
        "(measured: 6 contacts on 2 photos"
        in vinefab("grow", plain, "--map", grid, "--contacts", file)[1]
    )
