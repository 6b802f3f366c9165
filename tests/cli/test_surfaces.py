"""Surfaces of walls: what maps, rigs and contacts files name, and what predictions make of it."""

import json
import math
import re
import tomllib

import pytest

from vinefab.core.errors import UnknownNameError
from vinefab.growth.options import GrowthOptions
from vinefab.model.contacts import (
    SURFACES,
    MeasuredContacts,
    Surface,
    SurfaceAngle,
    contacts_of,
    contacts_text,
)
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.rig.part_files import RIG_NAME

OURS = """schema = "vinefab/contacts-1"
[[surfaces]]
surface = "grey_pla"
contacts = 40
tube_diameter_mm = 12.7
source = "our coupon"
[surfaces.half_angle_deg]
value = 12.0
low = 9.0
high = 16.0
"""


@pytest.fixture
def ours(tmp_path):
    path = tmp_path / "contacts.toml"
    path.write_text(OURS)
    return path


@pytest.fixture
def on(edited, grid):
    """The small map with a surface of some name."""
    return lambda name: edited(grid, lambda document: document["vinefab"].update(surface=name))


def prediction(vinefab, tmp_path, *arguments):
    page = tmp_path / "page.html"
    code, words, _ = vinefab("report", *arguments, "--out", page, "--json", "-", "--force")
    assert code == 0
    return json.loads(words[words.index("{") :])


def seen_percent(vinefab, world, angle):
    """The covered share by `score`, which knows nothing of ranges."""
    more = ("--task", "coverage", "--poses", 4, "--head-on-half-angle-deg", angle, "--json", "-")
    code, words, _ = vinefab("score", "plain_vine", "--map", world, *more)
    assert code == 0
    found = json.loads(words[words.index("{") :])["evaluations"]
    return 100.0 * sum(one["terms"]["area"] for one in found) / len(found)


def test_what_ships_says_how_little_it_rests_on():
    smooth, rough = SURFACES
    assert (smooth.half_angle_deg.low, smooth.half_angle_deg.high, smooth.contacts) == (1, 15, 17)
    assert (rough.half_angle_deg.low, rough.half_angle_deg.high, rough.contacts) == (15, 45, 0)
    assert {one.standing for one in SURFACES} == {"assumed"}
    assert GrowthOptions().half_angle_deg == 1.0  # what searches train at
    assert GrowthOptions(surface="rough").half_angle_deg == 1.0


def test_a_report_leads_with_the_middle_of_the_range_and_shows_the_range(vinefab, grid, tmp_path):
    found = prediction(vinefab, tmp_path, "plain_vine", "--map", grid, "--poses", 4)
    means = [seen_percent(vinefab, grid, angle) for angle in (1, 8.25, 15.5, 22.75, 30)]
    assert f"sees {means[2]:.1f} % of the free space where tips stop within " in found["verdict"]
    ends = re.search(
        r"within 15.5 deg of head-on, (\S+) to (\S+) % over", found["verdict"]
    ).groups()
    # Areas of the range are the fast ones, within 0.1 %.
    assert [*map(float, ends)] == pytest.approx([min(means), max(means)], abs=0.15)
    assert min(means) < max(means)
    assert "over head-on half-angles of 1 to 30 deg (assumed)" in found["verdict"]
    contacts = found["width"]["contacts"]
    assert contacts["head_on_half_angle_deg"] == [1.0, 8.25, 15.5, 22.75, 30.0]
    assert contacts["means"]["seen_percent"][2] == pytest.approx(means[2], abs=0.11)
    assert found["growth"]["head_on_half_angle_deg"] == 15.5
    cone = f"growth.friction_of_half_angle</td><td>{math.tan(math.radians(15.5)):.3g}"
    assert cone in re.sub(r"<(/?td)[^>]*>", r"<\1>", (tmp_path / "page.html").read_text())


def test_a_given_half_angle_leads_instead(vinefab, grid):
    angle = ("--map", grid, "--poses", 1, "--head-on-half-angle-deg", 4)
    _, words, _ = vinefab("compare", "three_level_tree", "plain_vine", *angle)
    assert " at 4 deg, " in words


def test_a_map_that_names_its_surface_is_predicted_over_it(vinefab, on, tmp_path):
    found = prediction(vinefab, tmp_path, "plain_vine", "--map", on("rough"), "--poses", 1)
    contacts = found["width"]["contacts"]
    assert contacts["head_on_half_angle_deg"] == [15.0, 22.5, 30.0, 37.5, 45.0]
    assert contacts["standing"].startswith("assumed: on rough, ")
    assert found["growth"]["head_on_half_angle_deg"] == 30.0
    assert found["growth"]["surface"] == "rough"
    assert GrowthOptions(surface="smooth").contact_angles_deg == (1.0, 4.5, 8.0, 11.5, 15.0)


def test_a_score_on_a_surface_says_that_it_is_grown_at_the_kind_end(vinefab, on):
    _, notes, _ = vinefab("score", "plain_vine", "--map", on("rough"), "--poses", 1)
    assert "walls are rough, half-angles of 15 to 45 deg (assumed: on rough," in notes
    assert "grown at 1 deg" in notes


def test_a_measured_surface_is_grown_at_and_predicted_over_its_interval(
    vinefab, on, grid, ours, tmp_path
):
    more = ("--contacts", ours, "--poses", 1)
    found = prediction(vinefab, tmp_path, "plain_vine", "--map", on("grey_pla"), *more)
    assert found["growth"]["head_on_half_angle_deg"] == 12.0
    standing = "measured: on grey_pla, 40 contacts, 95 % interval 9 to 16 deg"
    assert found["width"]["contacts"]["standing"] == standing
    angles = found["width"]["contacts"]["head_on_half_angle_deg"]
    assert angles == [9.0, 10.5, 12.0, 14.0, 16.0]
    # One surface in the file holds for maps that name none.
    _, words, _ = vinefab("grow", "plain_vine", "--map", grid, "--contacts", ours)
    assert "head-on half-angle 12 deg (measured: on grey_pla" in words


def test_only_bounds_leave_the_rest_assumed():
    def options(**angle):
        surface = Surface(
            surface="a", half_angle_deg=SurfaceAngle(**angle), contacts=40, source="b"
        )
        return GrowthOptions.of({"contacts": MeasuredContacts(surfaces=(surface,))})

    assert options(low=0.0, high=5.0).half_angle_deg == [1.0, 5.0]
    assert options(low=20.0, high=90.0).half_angle_deg == [20.0, 30.0]
    assert options(low=40.0, high=90.0).half_angle_deg == [40.0, 90.0]


@pytest.mark.parametrize("verb", ["report", "compare", "score", "grow", "aim"])
def test_an_unknown_surface_is_one_line(vinefab, on, verb):
    more = ["--out", "page.html"] if verb == "report" else []
    more = ["three_level_tree"] if verb == "compare" else more
    code, _, complaint = vinefab(verb, "plain_vine", *more, "--map", on("ruogh"))
    assert code == 2
    (line,) = complaint.splitlines()
    assert "no surface is called 'ruogh'; did you mean 'rough'?; there are: rough, smooth" in line


def test_a_run_on_an_unknown_surface_is_refused_before_it_begins(vinefab, on, tmp_path):
    world = on("ruogh")
    run = tmp_path / "run.toml"
    run.write_text(f'schema = "vinefab/run-1"\n[maps]\nfiles = ["{world.name}"]\n')
    code, _, complaint = vinefab("optimize", run, "--out", tmp_path / "run", "-q")
    assert (code, complaint.count("\n")) == (2, 1)
    assert "no surface is called 'ruogh'" in complaint
    assert not (tmp_path / "run").exists()


def test_growth_in_python_knows_the_surface_of_the_map(on, ours):
    world, vine = Map.read(on("grey_pla")), Design.read("plain_vine")
    grown = vine.grow(world, contacts=ours)
    assert grown.growth["head_on_half_angle_deg"] == 12.0
    with pytest.raises(UnknownNameError, match="grey_pla"):
        vine.grow(world)


def test_maps_of_different_surfaces_are_not_mixed(vinefab, on, grid):
    code, _, complaint = vinefab("score", "plain_vine", "--maps", on("rough"), grid)
    assert code == 2
    assert len(complaint.splitlines()) == 1
    assert "different surfaces: rough, none" in complaint
    code, *_ = vinefab(
        "score", "plain_vine", "--maps", on("rough"), grid, "--growth", "surface=rough"
    )
    assert code == 0


def test_surfaces_are_written_by_the_commands_that_make_maps(vinefab, tmp_path):
    path = tmp_path / "pegs.geojson"
    vinefab("map", "pegs", "--surface", "smooth", "--out", path)
    assert Map.read(path).surface == "smooth"
    assert json.loads(path.read_text())["vinefab"]["surface"] == "smooth"
    vinefab("map", "pegs", "--out", path, "--force")
    assert "surface" not in json.loads(path.read_text())["vinefab"]


def test_a_rig_names_its_surface(vinefab, grid, ours, tmp_path):
    more = ("--printer", "generic_220", "--fit-mm", 150, "--no-pictures", "--force")
    folder = tmp_path / "rig"
    code, _, complaint = vinefab("rig", grid, *more, "--surface", "grey_pla", "--out", folder)
    assert code == 2
    assert complaint.splitlines() == [
        "error: no surface is called 'grey_pla'; there are: rough, smooth"
    ]
    vinefab("rig", grid, *more, "--surface", "grey_pla", "--contacts", ours, "--out", folder)
    assert json.loads((folder / RIG_NAME).read_text())["options"]["surface"] == "grey_pla"


def test_a_comparison_says_whether_the_order_survives(vinefab, grid):
    designs = ("three_level_tree", "plain_vine")
    _, words, _ = vinefab("compare", *designs, "--map", grid, "--poses", 2, "--json", "-")
    found = json.loads(words[words.index("{") :])
    angles = [row["head_on_half_angle_deg"] for row in found["orders"]]
    assert angles == [1.0, 8.25, 15.5, 22.75, 30.0]
    for row in found["orders"]:
        score = {}
        for name in designs:
            more = ("--poses", 2, "--head-on-half-angle-deg", row["head_on_half_angle_deg"])
            _, text, _ = vinefab(
                "score", name, "--task", "coverage", "--map", grid, *more, "--json", "-"
            )
            score[name] = json.loads(text[text.index("{") :])["composite"]["mean"]
        assert row["designs"] == sorted(designs, key=score.get, reverse=True)
    _, words, _ = vinefab("compare", *designs, "--map", grid, "--poses", 2)
    survives = len({tuple(row["designs"]) for row in found["orders"]}) == 1
    said = "the order of the means is the same over" if survives else "the order does not survive"
    assert said in words


def test_files_of_surfaces_are_read_as_they_are_written():
    surface = Surface(
        surface="a", half_angle_deg=SurfaceAngle(low=1.0, high=2.0), contacts=3, source="b"
    )
    text = contacts_text(MeasuredContacts(surfaces=(surface,)), {})
    content = tomllib.loads(text)
    assert contacts_of({"surfaces": content["surfaces"]}).surfaces == (surface,)
