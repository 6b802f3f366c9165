"""What is cut and what deploys, said once: page, README and job.json of a package."""

import json

import pytest

from vinefab.fabrication.formats.laser_drawing import package_spec
from vinefab.fabrication.package.package_texts import job_text, readme_text
from vinefab.fabrication.package.prepare import pattern_section, prepare
from vinefab.fabrication.package.sheet_pictures import pattern_plan
from vinefab.inflation.pattern import pattern_of
from vinefab.model.design import Build, Design, Level
from vinefab.model.laser import read_profile


def pair(choice, angle_deg=60.0, branches=2):
    level = Level.of(branches=branches, length_mm=60.0, angle_deg=angle_deg)
    build = Build.standard(2).changed(compensation=choice)
    return Design(name="pair", trunk_length_mm=80.0, levels=(level,), build=build)


@pytest.fixture(scope="module")
def prepared():
    return prepare(pair("inflation"), read_profile("co2_60w__stretchlon_200"))


def test_page_readme_and_job_hold_the_same_angles_and_lengths(prepared):
    table = pattern_section(prepared.pattern).tables[0]
    left = dict(zip(table.keys, table.rows[1], strict=True))
    assert left["designed_deg"].text == "-30.0"
    assert abs(left["cut_deg"].value) > 30.0
    assert left["expected_deg"].value == pytest.approx(-30.0, abs=1.5)
    spec = package_spec(prepared.job, prepared.profile)
    readme = " ".join(readme_text(prepared.design, spec, None, prepared.pattern).split())
    assert (
        f"Level 2, child 1: angle designed -30.0, cut {left['cut_deg']}, "
        f"expected {left['expected_deg']}; length designed 60.0, cut {left['cut_mm']}"
    ) in readme
    job = json.loads(job_text(prepared.design, spec, prepared.pattern))["pattern"]
    assert job["standing"] == "simulated"
    assert job["branches"][1]["cut_deg"] == left["cut_deg"].data
    assert job["joints"][0]["sensitivity"] > 1.0
    assert job["problems"] == []


def test_the_flat_outline_stands_beside_the_deployed_shape(prepared):
    (flat, deployed) = pattern_plan(prepared.pattern).panels
    assert flat.title == "flat, as cut"
    assert deployed.title == "deployed (simulated, unverified)"
    assert {"level 1, inflated", "level 2, inflated", "as designed"} == set(deployed.legend)


def test_a_pattern_cut_as_designed_is_shown_as_it_deploys():
    pattern = pattern_of(pair("none"), read_profile("co2_60w__stretchlon_200"))
    section = pattern_section(pattern)
    assert "cut as designed" in section.paragraphs[0]
    left = dict(zip(section.tables[0].keys, section.tables[0].rows[1], strict=True))
    assert left["cut_deg"].value == pytest.approx(-30.0)
    assert abs(left["expected_deg"].value) < 28.0


def test_children_that_cannot_be_held_apart_are_said():
    pattern = pattern_of(pair("inflation", 20.0, 4), read_profile("co2_60w__stretchlon_200"))
    assert any(
        "level 2: no flat joint deploys" in one for one in pattern_section(pattern).paragraphs
    )
