"""Packages of every process: their own words alone, and every file explained."""

import csv
import io
import json
import re
from dataclasses import replace
from functools import cache

import pytest

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.fabrication.calibration.coupon_package import CouponSet, coupon_readme
from vinefab.fabrication.calibration.coupons import energy_matrix, results_text
from vinefab.fabrication.calibration.seal_grid import seal_grid
from vinefab.fabrication.package.prepare import Prepared, package, prepare
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Build, Design, Level, PieceSettings, default_fillets_mm
from vinefab.model.files.shipped import names
from vinefab.model.finding import CheckReport
from vinefab.model.laser import LaserProfile, RecipeStatus, read_material, read_profile
from vinefab.model.machine import Tool

FIRST = {read_profile(name).tools: name for name in reversed(names("recipe"))}.values()
RECIPES = [
    pytest.param(name, marks=() if name in FIRST else pytest.mark.thorough)
    for name in names("recipe")
]
"""All recipes; in the gate one of each set of tools."""
BY_HAND = "impulse_sealer_300__stretchlon_800"
THREE = ("co2_60w__stretchlon_200", "hot_tip_220_knife__stretchlon_200", BY_HAND)
WORDS_OF = {
    Tool.LASER: r"laser|\bbeam|focus|defocus|fused all around|MeerK40t|LightBurn",
    Tool.HOT_TIP: r"nozzle|hot.tip|extru|filament|slicer",
    Tool.KNIFE: r"knife|blade|swivel",
    Tool.IMPULSE_SEALER: r"\bbars?\b(?!, mbar)|impulse",
    Tool.SCISSORS: r"scissors",
}
"""What belongs to one process, as a pattern."""


def fork(**build: object) -> Design:
    widths = (20.0, 12.0)
    plain = Build(
        widths_mm=widths, fillet_mm=default_fillets_mm(widths), tail_mm=150.0, compensation="none"
    )
    level = Level(branches=2, length_mm=30.0, angle_deg=80.0)
    return Design(name="fork", trunk_length_mm=30.0, levels=(level,), build=plain.changed(**build))


@cache
def prepared(recipe: str) -> Prepared:
    return prepare(fork(), read_profile(recipe))


@cache
def files(recipe: str) -> dict[str, bytes]:
    return package(prepared(recipe))


def foreign_words(text: str, tools: frozenset[Tool]) -> list[str]:
    return [
        f"{tool}: {match[0]}"
        for tool, pattern in WORDS_OF.items()
        if tool not in tools
        for match in re.finditer(pattern, text, re.IGNORECASE)
    ]


def own_text(name: str, data: bytes, profile: LaserProfile) -> str:
    """Return a file's sentences, without the names of the recipe, its parts and laser layers."""
    text = data.decode()
    if name.endswith(".html"):
        text = re.sub(r"<(style|script).*?</\1>", "", text, flags=re.DOTALL)
    for part in (profile.recipe, *profile.machines, profile.material):
        text = text.replace(part.name, "").replace(part.title, "")
    return text.replace("impulse_seal or adhesive_film", "")  # what a cell of results may hold


@pytest.mark.parametrize("recipe", RECIPES)
def test_a_package_begins_with_the_coupon_and_has_no_word_of_another_process(recipe: str) -> None:
    profile = read_profile(recipe)
    # A lap may be sealed by hand whatever seals the robot; this one is in one piece.
    texts = ("README.txt", "job.json", "bom.csv", "checks.json", "report.html", "animation.svg")
    for name in texts:
        found = foreign_words(own_text(name, files(recipe)[name], profile), profile.tools)
        assert found == [], name
    for name, data in files(recipe).items():
        if name.endswith((".gcode", ".svg")):
            assert foreign_words(own_text(name, data, profile), profile.tools) == [], name
    first = " ".join(files(recipe)["README.txt"].decode().split()).partition("1. ")[2]
    assert first.startswith(f"Coupons first: vinefab coupon --recipe {recipe} --out coupons")


@pytest.mark.parametrize("recipe", RECIPES)
def test_no_text_of_coupons_has_a_word_of_another_process(recipe: str) -> None:
    profile = read_profile(recipe)
    report = CheckReport(design="", recipe="", run=(), skipped=(), findings=())
    welds = any(name.startswith("weld") for name, *_ in profile.beams)
    grid, matrix = seal_grid(profile), energy_matrix(profile) if welds else None
    coupons = CouponSet(
        profile=profile, sheets=(), matrix=matrix, grid=grid, left_out=(), report=report, laser={}
    )
    tools = profile.tools
    if profile.recipe.lap is not None and profile.recipe.lap.method == "impulse_seal":
        tools |= {Tool.IMPULSE_SEALER}
    for text in (
        coupon_readme(coupons),
        results_text(profile, matrix, grid.settings if grid else ()),
    ):
        assert foreign_words(own_text("", text.encode(), profile), tools) == []


def test_the_words_are_found_where_they_belong() -> None:
    """The test above can fail: every process has words in a package of its own."""
    readmes = {
        Tool.LASER: "co2_60w__stretchlon_200",
        Tool.HOT_TIP: "hot_tip_220__stretchlon_200",
        Tool.KNIFE: "hot_tip_220_knife__stretchlon_200",
        Tool.IMPULSE_SEALER: "co2_60w__stretchlon_800",
        Tool.SCISSORS: "hot_tip_220__stretchlon_200",
    }
    for tool, recipe in readmes.items():
        text = files(recipe)["README.txt"].decode()
        assert re.search(WORDS_OF[tool], text, re.IGNORECASE), tool


@pytest.mark.parametrize("recipe", THREE)
def test_the_readme_explains_the_files_that_are_there_and_no_others(recipe: str) -> None:
    text = " ".join(files(recipe)["README.txt"].decode().split())
    there = set(files(recipe)) - {"README.txt"}
    missing = {name for name in there if name not in text and name != "assembly.pdf"}
    assert missing == set()
    ends = "dxf|svg|lbrn2|gcode|pdf|png|json|csv|html|toml|sha256"
    named = set(re.findall(rf"\b[\w./]+\.(?:{ends})\b", text))
    assert named - there == {"your_recipe.toml"} | ({"results.csv"} & named)


def test_a_package_for_hands_has_the_pattern_on_paper_and_the_seam_list() -> None:
    made = files(BY_HAND)
    assert {"outline_a4.pdf", "seams.csv"} <= set(made)
    assert "outline_letter.pdf" not in made
    text = " ".join(made["README.txt"].decode().split())
    rows = list(csv.DictReader(io.StringIO(made["seams.csv"].decode())))
    shields = sum(row["shield"] == "yes" for row in rows)
    assert f"The seam is {len(rows) - 1} straight stretches" in text
    assert f"{rows[-1]['presses']} presses of the bar" in text
    assert f"at most {float(rows[-1]['gap_mm']):.2f} mm beside the seam's middle" in text
    assert f"First the stretches 1 to {shields} (dashed)" in text
    letter = prepare(fork(), read_profile(BY_HAND), paper="letter")
    assert "outline_letter.pdf" in letter.laser
    assert "outline_a4.pdf" not in letter.laser
    asked = prepare(fork(), read_profile("co2_60w__stretchlon_200"), paper="a4")
    assert "outline_a4.pdf" in asked.laser
    assert not any(name.endswith(".pdf") for name in prepared("co2_60w__stretchlon_200").laser)


@pytest.mark.parametrize("recipe", ["co2_60w__stretchlon_200", "hot_tip_220_knife__stretchlon_200"])
def test_job_json_names_the_files_of_each_operation_in_process_order(recipe: str) -> None:
    content = json.loads(files(recipe)["job.json"])
    operations = [one for one in content["operations"] if one["file"]]
    order = ["mark", "weld", "weldcut", "cut"]
    found = [one["name"] for one in operations]
    assert found == [name for name in order if name in found]
    for one in operations:
        assert one["file"] == f"outline_{one['name']}.dxf"
        assert set(one["files"]) <= set(files(recipe))
        assert one["paths"] > 0
        assert one["length_mm"] > 0.0
    alone = {name for name in files(recipe) if re.match(r"outline_(mark|weld|weldcut|cut)\b", name)}
    alone |= {name for name in files(recipe) if re.match(r"outline_\w+_polyline", name)}
    assert {name for one in operations for name in one["files"]} == alone


def test_every_file_of_one_operation_holds_its_layer_alone() -> None:
    made = files("co2_60w__stretchlon_200")
    for step, layer in (("mark", "10_MARK"), ("weldcut", "30_WELDCUT"), ("cut", "40_CUT")):
        for ending in (".dxf", "_polyline.dxf", ".svg"):
            text = made[f"outline_{step}{ending}"].decode()
            assert set(re.findall(r"VF_(\d\d_[A-Z]+)", text)) == {layer}


def test_sheets_of_a_robot_in_pieces_have_files_of_each_operation() -> None:
    pieces = PieceSettings(most=6)
    made = prepare(fork(pieces=pieces), read_profile("hot_tip_220__stretchlon_200"))
    assert made.report.blocking == ()
    names_there = set(made.laser)
    assert {name for name in names_there if name.endswith(".gcode")} == {
        f"{name.rpartition('/')[0]}/outline_weld.gcode" if "/" in name else "outline_weld.gcode"
        for name in names_there
        if name.endswith("outline.dxf")
    }


def test_another_film_makes_settings_stale_and_no_more_measured() -> None:
    profile = read_profile("hot_tip_220__stretchlon_200")
    tested = profile.recipe.changed(status=RecipeStatus.BURST_TESTED)
    known = replace(profile, recipe=tested)
    assert known.status is RecipeStatus.BURST_TESTED
    thicker = replace(known, material=read_material("stretchlon_800"))
    assert thicker.status is RecipeStatus.UNVERIFIED
    # Twice 0.05 mm over twice 0.0375 mm, squared, is 1.78: 5 mm/s become 2.8.
    assert "seal at about 2.8 mm/s in place of 5 (scaled" in thicker.stale_words
    (stale,) = [
        one
        for one in run_checks(Subject.of(fork(), thicker), only=("VF-L06",)).findings
        if one.title == "settings were derived for another film"
    ]
    assert "0.075 mm in all plies" in stale.message
    made = prepare(fork(), thicker)
    assert "no" in made.refusal(allow_uncalibrated=False)
    assert made.refusal(allow_uncalibrated=True) == ""
    sealed = read_profile("co2_60w__stretchlon_800")
    dwell = sealed.recipe.changed(derived_for={"film_mm": 0.05})
    words = replace(sealed, recipe=dwell).stale_words
    assert "hold the seam for about 4.0 s in place of 1" in words


def test_what_the_cutter_cannot_reach_is_an_error() -> None:
    profile = read_profile("hot_tip_220_knife__stretchlon_200")
    assert profile.cutter is not None
    narrow = profile.cutter.changed(bed_width_mm=profile.cutter.bed_width_mm.changed(value=150.0))
    (finding,) = run_checks(
        Subject.of(fork(), replace(profile, cutter=narrow)), only=("VF-S01",)
    ).findings
    assert "drag_knife_600" in finding.message
    assert finding.measured == pytest.approx(199.7 + 10.0 - 145.0, abs=1.0)
    assert run_checks(Subject.of(fork(), profile), only=("VF-S01",)).findings == ()


def test_a_recipe_without_the_machine_for_its_tool_is_refused() -> None:
    knife = read_profile("hot_tip_220_knife__stretchlon_200")
    with pytest.raises(UnfitInputError, match="cut takes a knife, and hot_tip_220 is none"):
        replace(knife, cutter=None)
    tip = read_profile("hot_tip_220__stretchlon_200")
    low = tip.machine.changed(travel_z_mm=tip.machine.travel_z_mm.changed(value=0.2))
    high = tip.recipe.hot_tip.changed(touch_z_mm=tip.recipe.hot_tip.touch_z_mm.changed(value=1.0))
    with pytest.raises(BadInputError, match=r"touch_z_mm is 1\.0; allowed: below travel_z_mm"):
        replace(tip, machine=low, recipe=tip.recipe.changed(hot_tip=high))


@pytest.mark.parametrize(
    "recipe", ["hot_tip_220_knife__stretchlon_200", "hot_tip_250__stretchlon_200"]
)
def test_a_package_in_tiles_speaks_of_its_own_machines_and_shows_every_cross(recipe: str) -> None:
    profile = read_profile(recipe)
    build = Build(widths_mm=(30.0,), tail_mm=150.0, compensation="none")
    vine = Design(name="long", trunk_length_mm=250.0, build=build)
    made = package(prepare(vine, profile))
    readme = made["README.txt"].decode()
    assert foreign_words(own_text("README.txt", readme.encode(), profile), profile.tools) == []
    text = " ".join(readme.split())
    tiles = json.loads(made["job.json"])["tiles"]
    assert [f"tile_{k}_outline_point.gcode" in made for k in range(1, len(tiles) + 1)] == [
        bool(tile["facts"]["targets_found_mm"] or tile["facts"]["targets_made_mm"])
        for tile in tiles
    ]
    named = set(re.findall(r"\btile_\w+\.gcode", text))
    assert named == {name for name in made if name.endswith(".gcode")}
    assert "Mark the crosses" not in text
    if profile.cutter is None:
        assert text.index(f"Tile {len(tiles)} of") < text.index(
            "Cut around the robot with scissors"
        )
    else:
        last = text.index(f"Tile {len(tiles)} of {len(tiles)}: the mouth")
        assert last < text.index("cuts across the mouth") < text.index("Part the bridges")
        # Both machines have the bed that their own file names.
        assert "(bed 220 x 220 mm)" in text
        assert "(bed 600 x 400 mm)" in text
