import csv
import io
import json
import re
import subprocess
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from vinefab.core.errors import ReadBackError
from vinefab.core.plain_text import OWN_MARK
from vinefab.core.registry import Registry
from vinefab.fabrication.formats import laser_formats
from vinefab.fabrication.formats.laser_drawing import PRESETS, LaserFileSpec, package_spec
from vinefab.fabrication.formats.svg_format import SVG
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.package.bom import bom_text, fluence_mj_mm2, operation_energy_mj_mm
from vinefab.fabrication.package.package_texts import job_text, readme_text
from vinefab.fabrication.package.prepare import Prepared, package, page_blocks, prepare, zip_bytes
from vinefab.model.design import Build, Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile, RecipeStatus, read_profile
from vinefab.model.machine import LaserSettings
from vinefab.model.quantity import Standing

NAMES = [
    "README.txt",
    "design.toml",
    "design_2.toml",
    "job.json",
    *(
        f"outline{step}{suffix}"
        for suffix in (".dxf", "_polyline.dxf", ".svg")
        for step in ("", "_mark", "_weld", "_weldcut", "_cut")
    ),
    "outline.lbrn2",
    "preview.png",
    "animation.svg",
    "checks.json",
    "report.html",
    "bom.csv",
    "assembly.svg",
    "assembly.pdf",
    "MANIFEST.sha256",
]


@pytest.fixture(scope="module")
def files(prepared: Prepared) -> dict[str, bytes]:
    other = prepared.design.changed(name="other")
    return package(replace(prepared, others=(other,), beside=(prepared.report,)))


def test_a_package_holds_the_agreed_files_in_order_and_says_whose_they_are(files) -> None:
    assert list(files) == NAMES
    for name, data in files.items():
        assert OWN_MARK in data[:8192] or OWN_MARK in data[-8192:], name


def test_the_package_can_be_made_again_from_its_own_design(files, prepared, tmp_path) -> None:
    other = prepared.design.changed(name="other")
    for name, design in (("design.toml", prepared.design), ("design_2.toml", other)):
        (tmp_path / name).write_bytes(files[name])
        assert Design.read(tmp_path / name) == design
    readme = " ".join(files["README.txt"].decode().split())
    assert "[operations.weldcut] and [operations.cut] of a copy of recipe" in readme
    assert "vinefab fabricate design.toml --recipe your_recipe.toml" in readme


def test_sha256sum_accepts_the_manifest_and_sees_a_change(
    files, tmp_path: Path, program: Callable[[str, str], str]
) -> None:
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    command = [program("sha256sum", "coreutils"), "--strict", "-c", "MANIFEST.sha256"]
    done = check_in(tmp_path, command)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(": OK") == len(NAMES) - 1
    (tmp_path / "outline.svg").write_text("changed")
    done = check_in(tmp_path, command)
    assert done.returncode == 1


def test_the_zip_unpacks_to_the_same_files_in_one_folder_whenever_it_is_made(files) -> None:
    data = zip_bytes(files, "plain")
    assert data == zip_bytes(files, "plain")
    assert OWN_MARK in data[-8192:]
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.testzip() is None
        assert {name: archive.read(f"plain/{name}") for name in NAMES} == files
        entries = archive.infolist()
    assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}
    assert {entry.external_attr >> 16 for entry in entries} == {0o100644}


def test_a_package_with_a_wrong_file_is_never_made(monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(spec: LaserFileSpec) -> str:
        return SVG.write(spec).replace(" A ", " A 9", 1)

    broken = {**laser_formats.LASER_FORMATS, "svg": replace(SVG, write=wrong)}
    monkeypatch.setattr(laser_formats, "LASER_FORMATS", Registry("laser format", broken))
    made = prepare(Design.read("plain_vine"), read_profile("co2_60w__stretchlon_200"))
    with pytest.raises(ReadBackError, match=r"outline\.svg"):
        package(made)


def test_line_energy_and_fluence_are_worked_out(
    profile: LaserProfile, settings: LaserSettings
) -> None:
    # 30 W at 100 mm/s is 300 mJ/mm, twice; over a spot of 0.5 mm.
    energy = operation_energy_mj_mm(profile.machine, settings)
    assert energy.value == pytest.approx(600.0)
    assert fluence_mj_mm2(profile.machine, settings).value == pytest.approx(1200.0)
    assert energy.standing is Standing.COMPUTED


def test_job_json_holds_the_bond_of_laps_for_robots_in_pieces_only(
    design: Design, profile: LaserProfile, job: Job
) -> None:
    bond = read_profile("co2_60w__stretchlon_200").recipe.lap
    bonded = replace(profile, recipe=profile.recipe.changed(lap=bond))
    specs = package_spec(job, bonded), package_spec(job, profile)
    assert job_text(design, specs[0]) == job_text(design, specs[1])
    facts = {**job.facts, "pieces": [], "joints": []}
    cut = replace(job, sheets=(replace(job),), facts=facts)
    lap = json.loads(job_text(design, package_spec(cut, bonded)))["recipe"]["lap"]
    assert lap["method"] == "impulse_seal"
    assert lap["strength_n_per_mm"]["standing"] == "assumed"
    assert json.loads(job_text(design, package_spec(cut, profile)))["recipe"]["lap"] is None


def test_job_json_holds_every_setting_with_its_standing(files) -> None:
    read = json.loads(files["job.json"])
    assert read["schema"] == "vinefab/job-1"
    assert read["units"] == "mm"
    assert read["facts"]["offset_mm"] == 0.65
    names = {*LaserSettings.model_fields, "tool", "temperature_c", "dwell_s"}
    for operation in read["operations"][:4]:
        assert names < set(operation["settings"])
        kerf = operation["settings"]["kerf_mm"]
        value = 0.0 if operation["operation"] == "weld" else 0.3  # a weld removes nothing
        assert kerf == {"value": value, "standing": "assumed", "source": "a test"}
    assert [op["operation"] for op in read["operations"]] == [
        "mark",
        "weld",
        "weldcut",
        "cut",
        "reg",
        "doc",
    ]
    assert "settings" not in read["operations"][4]
    assert read["material"]["burst_kpa"]["standing"] == "paper"
    assert read["recipe"]["status"] == "unverified"
    assert [path["order"] for path in read["paths"]] == list(range(1, 9))
    assert read["paths"][3]["box_mm"] == pytest.approx([10.0, 20.0, 130.0, 60.0])
    assert read["design"]["build"]["tail_mm"] == 200.0


def test_the_readme_warns_of_an_untried_recipe_and_keeps_standings(
    prepared: Prepared,
) -> None:
    text = words(prepared)
    assert "UNVERIFIED RECIPE" in text
    assert "kerf of 0.3 mm (assumed) and a seam of 0.4 mm (measured)" in text
    assert "Kerf, offset and beam compensation 0" in text
    assert "2 plies of 0.05 mm (measured)" in text
    assert "at least 150 x 80 mm" in text
    assert "70 kPa (paper)" in text
    assert "all paths together measure 140.00 x 70.00 mm" in text
    assert "WARNING" not in text
    machined = [op for op in PRESETS["default"].styles if op.is_machined]
    layers = [text.index(f"Run {op.layer} (") for op in machined]
    assert layers == sorted(layers)


def test_the_readme_names_no_offset_of_an_operation_that_the_files_do_not_hold(
    prepared: Prepared,
) -> None:
    one = tuple(path for path in prepared.job.paths if path.operation is not Operation.WELD)
    text = words(replace(prepared, job=replace(prepared.job, paths=one)))
    assert "The weldcut paths are offset for a kerf of 0.3 mm (assumed) and a seam of" in text
    assert "The weld paths" not in text
    two = tuple(path for path in prepared.job.paths if path.operation is not Operation.WELDCUT)
    text = words(replace(prepared, job=replace(prepared.job, paths=two)))
    assert "The weldcut paths" not in text
    assert "The weld paths are offset for a seam of 0.4 mm (measured)." in text
    assert "The cut paths are offset for that seam and a kerf of 0.3 mm (assumed)." in text


STEPS = {
    "co2_60w__stretchlon_200": (
        "Lay Import Check Set Run:MARK Refocus Run:WELDCUT Refocus Run:CUT Lift"
    ),
    "weld+cut": "Lay Import Check Set Run:MARK Run:WELD Refocus Run:CUT Lift",
    "co2_60w__stretchlon_800": (
        "Tape Lay Import Check Set Run:MARK Refocus Run:MARK_holes Switch Seal Let Put Run:CUT Lift"
    ),
}
"""Words that the numbered steps of a sheet begin with, by process."""


@pytest.mark.parametrize("process", STEPS)
def test_a_sheet_is_one_list_of_its_passes(process: str) -> None:
    separate = process == "weld+cut"
    profile = read_profile("co2_60w__stretchlon_200" if separate else process)
    sheet = SheetOptions(process=process if separate else "auto")
    prepared = prepare(Design.read("plain_vine"), profile, sheet=sheet)
    assert prepared.report.blocking == ()
    text = package(prepared)["README.txt"].decode()
    section = text.split("\nThe sheet\n")[1].split("\nCheck\n")[0]
    steps = re.findall(r"^ ?\d+\. (?:(Run) VF_\d\d_(\w+)|(\w+))", section, re.MULTILINE)
    found = " ".join(f"{run}:{layer}" if run else word for run, layer, word in steps)
    assert found == STEPS[process]
    numbers = re.findall(r"^ ?(\d+)\. ", section, re.MULTILINE)
    assert numbers == [str(number + 1) for number in range(len(numbers))]


def test_the_readme_warns_where_colours_are_not_enough(prepared: Prepared) -> None:
    machine = prepared.profile.machine.changed(colours="shop_single")
    text = words(replace(prepared, profile=replace(prepared.profile, machine=machine)))
    assert "weldcut and cut have the same layer and colour" in text
    assert "does not write: mark, weld, reg, doc" in text


def test_titles_are_text_in_readme_and_bill(prepared: Prepared) -> None:
    profile = prepared.profile
    titled = replace(profile, material=profile.material.changed(title="=1+1\x1b[2J\0\n0\nLINE"))
    readme = readme_text(prepared.design, package_spec(prepared.job, titled))
    bill = bom_text(prepared.job, titled)
    assert all(letter.isprintable() or letter == "\n" for letter in readme)
    assert "\n0\n" not in readme
    cells = [cell for row in csv.reader(io.StringIO(bill)) for cell in row]
    assert not [cell for cell in cells if cell.startswith(tuple("=+-@\t\r"))]


def test_the_readme_warns_of_a_robot_larger_than_the_bed(prepared: Prepared) -> None:
    assert "beyond the bed" not in words(prepared)
    small = Job(name="s", sheet_width_mm=144.9, sheet_height_mm=80, paths=prepared.job.paths)
    assert "beyond the bed" in words(replace(prepared, job=small))


def test_the_readme_says_how_often_paths_are_run(prepared: Prepared) -> None:
    assert "2 passes, air" in words(prepared)  # the fixture's recipe, for everything


def test_the_readme_says_where_the_film_of_tiles_lies(prepared: Prepared) -> None:
    own = "targets_made_mm", "robot_targets_found_mm", "robot_targets_made_mm"
    shared = {"overlap_mm": 12.0, **{key: [[30.0, 40.0]] for key in own}}
    facts = [
        {"tile": 1, "window_x_mm": -190.2, "window_y_mm": -100.4, "aligned_to_tile": None},
        {"tile": 2, "window_x_mm": 290.0, "window_y_mm": -20.0, "aligned_to_tile": 1},
    ]
    tiles = tuple(replace(prepared.job, facts={**shared, **fact}) for fact in facts)
    text = words(replace(prepared, job=replace(prepared.job, tiles=tiles)))
    assert "its lower left corner is 190 mm right of the bed's lower" in text
    assert "left corner and 100 mm above it" in text
    assert "its lower left corner is 290 mm left of the bed's" in text
    # the fixture marks an arrow, but no targets
    assert "before anything is cut: 1 large cross beside the robot and 1 small cross on" in text
    assert "small crosses on the robot must lie right as well" in text
    assert "Until the last one film and robot stay in one piece" in text
    assert "put tape across the cut on both sides of the robot" in text
    assert text.index("Take the tape off") > text.index("Tile 2 of 2")
    # half of the fixture's seam of 0.4 mm
    assert "within 0.2 mm (half the seam, computed)" in text


def test_the_page_is_no_good_news_while_no_coupon_confirmed_the_recipe(
    prepared: Prepared,
) -> None:
    profile = prepared.profile
    prepared = replace(prepared, job=laser_job(prepared.design, prepared.profile))
    answer, notes, *_ = page_blocks(prepared)
    assert answer.tone == "caution"
    assert answer.text.endswith("; laser recipe unverified")
    assert notes.notes == ("No coupon has confirmed the laser recipe: cut and burst one first.",)
    tried = replace(profile, recipe=profile.recipe.changed(status=RecipeStatus.COUPON_OK))
    answer, notes, *_ = page_blocks(replace(prepared, profile=tried))
    assert (answer.tone, notes.notes) == ("good", ())
    assert "unverified" not in answer.text


def test_a_package_for_a_film_that_the_settings_are_not_for_says_so_at_every_step() -> None:
    """0.05 mm in place of 0.0375 mm: by the thickness it takes 31 J/cm2, and gets 27."""
    known = read_profile("co2_40w__stretchlon_200")
    ply = known.material.ply_mm.changed(value=0.05)
    other = replace(known, material=known.material.changed(ply_mm=ply))
    design = Design.read("plain_vine")
    texts, answers = [], []
    for profile in (known, other):
        made = prepare(design, profile)
        texts.append(" ".join(readme_text(design, package_spec(made.job, profile)).split()))
        answers.append(list(page_blocks(made))[:2])
    assert "seals and cuts the outline in one pass." in texts[0]
    assert "stale" not in texts[0].lower()
    assert "seals and cuts" not in texts[1]
    assert "is to seal and cut the outline in one pass; its settings are stale" in texts[1]
    assert "!! STALE SETTINGS: the settings were derived for film of 0.075 mm" in texts[1]
    assert "takes about 31 J/cm^2" in texts[1]
    (usual, _), (answer, notes) = answers
    assert usual.text.endswith("; laser recipe unverified")
    assert answer.text.endswith("; laser recipe unverified and stale")
    assert "31 J/cm^2" in notes.notes[1]


def check_in(folder: Path, command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        cwd=folder,
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=30,
    )


def words(prepared: Prepared) -> str:
    profile = prepared.profile
    spec = package_spec(prepared.job, profile)
    return " ".join(readme_text(prepared.design, spec).split())


def test_the_readme_of_tiles_names_the_layer_that_verifies_their_place() -> None:
    vine = Design(name="long", trunk_length_mm=1300.0, build=Build.standard(1))
    prepared = prepare(vine, read_profile("co2_60w__stretchlon_200"))
    files = package(prepared)
    words = " ".join(files["README.txt"].decode().split())
    assert "Run VF_10_MARK_verify (#00E000, 4 paths, " in words
    for suffix in (".dxf", ".svg", ".lbrn2", "_polyline.dxf"):
        assert b"VF_10_MARK_verify" in files[f"tile_2_outline{suffix}"]
        assert b"VF_10_MARK_verify" not in files[f"tile_1_outline{suffix}"]
