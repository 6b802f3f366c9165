"""LightBurn's files, read by independent code that follows public findings about the format."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import OWN_MARK
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, file_problems
from vinefab.fabrication.formats.lightburn_format import (
    LIGHTBURN,
    PALETTE,
    lightburn_text,
)
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import Sealer

MACHINED = (Operation.MARK, Operation.WELD, Operation.WELDCUT, Operation.CUT)


def project_problems(text: str, job: Job, profile: LaserProfile) -> tuple[str, ...]:
    return file_problems(LIGHTBURN, text.encode(), LaserFileSpec(job=job, profile=profile))


def tree(text: str) -> ET.Element:
    return ET.fromstring(text.encode())  # noqa: S314


def values(cut: ET.Element) -> dict[str, str]:
    return {child.tag: child.get("Value", "") for child in cut}


def line(shape: ET.Element) -> tuple[str, shapely.Geometry]:
    """Follow the primitives one by one, as a laser program does."""
    records = re.findall(r"V(\S+) ([^cV]+)", shape.findtext("VertList") or "")
    vertices = [(float(x), float(y)) for x, y in records]
    joins = re.findall(r"([A-Z])(\d+) (\d+)", shape.findtext("PrimList") or "")
    assert {kind for kind, *_ in joins} == {"L"}
    pieces = [shapely.LineString([vertices[int(a)], vertices[int(b)]]) for _, a, b in joins]
    return shape.get("CutIndex", ""), shapely.MultiLineString(pieces)


def test_every_machined_path_is_there_with_its_length_and_box(
    job: Job, profile: LaserProfile
) -> None:
    shapes = [line(shape) for shape in tree(lightburn_text(job, profile)).findall("Shape")]
    meant = [path for path in job.paths if path.operation is not Operation.DOC]
    assert len(shapes) == len(meant)
    for (_, shape), path in zip(shapes, meant, strict=True):
        assert shape.length == pytest.approx(path.contour.length_mm, rel=2e-3)
        assert np.allclose(shape.bounds, path.contour.box_mm, atol=0.011)
        polyline = shapely.LineString(path.contour.flattened_mm(1e-4))
        assert max(shapely.distance(polyline, shapely.get_parts(shape))) < 0.0101


def test_layers_carry_the_recipe_and_run_in_process_order(job: Job, profile: LaserProfile) -> None:
    cuts = tree(lightburn_text(job, profile)).findall("CutSetting")
    found = {values(cut)["name"]: values(cut) for cut in cuts if cut.get("type") == "Cut"}
    assert list(found) == [op.layer for op in MACHINED]
    assert [found[op.layer]["index"] for op in MACHINED] == ["0", "1", "7", "2"]
    for order, operation in enumerate(MACHINED):
        layer = found[operation.layer]
        assert layer["priority"] == str(order)
        assert (layer["maxPower"], layer["minPower"], layer["speed"]) == ("50", "10", "100")
        assert (layer["numPasses"], layer["runBlower"], layer["frequency"]) == ("2", "0", "5000")
        assert "kerf" not in layer
        assert "zOffset" not in layer


def test_what_is_never_cut_lies_on_a_tool_layer(job: Job, profile: LaserProfile) -> None:
    root = tree(lightburn_text(job, profile))
    tools = [values(cut) for cut in root.findall("CutSetting") if cut.get("type") == "Tool"]
    assert [(tool["index"], tool["name"]) for tool in tools] == [("30", "VF_90_REG")]
    assert "maxPower" not in tools[0]
    assert "VF_91_DOC" not in lightburn_text(job, profile)


def test_seams_for_a_sealer_lie_on_a_tool_layer(job: Job, profile: LaserProfile) -> None:
    cut = profile.settings("cut")
    sealer = Sealer(temperature_c=cut.spot_mm, dwell_s=cut.spot_mm, seam_width_mm=cut.spot_mm)
    operations = profile.recipe.operations.changed(weld=None)
    sealed = replace(profile, recipe=profile.recipe.changed(operations=operations, sealer=sealer))
    text = lightburn_text(job, sealed)
    tools = [values(c)["name"] for c in tree(text).findall("CutSetting") if c.get("type") == "Tool"]
    assert tools == ["VF_20_WELD", "VF_90_REG"]
    assert project_problems(text, job, sealed) == ()
    assert project_problems(text, job, profile) != ()


def test_the_same_job_gives_the_same_bytes_and_is_known_as_ours(
    job: Job, profile: LaserProfile
) -> None:
    data = lightburn_text(job, profile).encode()
    assert OWN_MARK in data[:8192] or OWN_MARK in data[-8192:]
    assert lightburn_text(job, profile) == lightburn_text(job, profile)
    assert b"| offset_mm: 0.65 |" in data


def test_variants_have_layers_and_settings_of_their_own(job: Job, profile: LaserProfile) -> None:
    slow = profile.settings("cut").changed(passes=7)
    contour = job.paths[0].contour
    paths = tuple(
        LaserPath(operation=Operation.CUT, contour=contour, variant=name, settings=slow)
        for name in ("A", "B")
    )
    trial = Job(name="t", sheet_width_mm=150, sheet_height_mm=80, paths=paths)
    text = lightburn_text(trial, profile)
    cuts = [values(cut) for cut in tree(text).findall("CutSetting")]
    assert [cut["name"] for cut in cuts] == ["VF_40_CUT_A", "VF_40_CUT_B"]
    assert len({cut["index"] for cut in cuts}) == 2
    assert [cut["numPasses"] for cut in cuts] == ["7", "7"]
    assert project_problems(text, trial, profile) == ()
    assert all(PALETTE[int(cut["index"])] != "#000000" for cut in cuts)


DAMAGE = [
    ('maxPower Value="50"', 'maxPower Value="60"', "maxPower is 60, not 50"),
    ('speed Value="100"', 'speed Value="10"', "speed"),
    ('numPasses Value="2"', 'numPasses Value="1"', "numPasses"),
    ('CutIndex="7"', 'CutIndex="2"', "layers"),
    ('priority Value="2"', 'priority Value="9"', "settings are for"),
    ("V130 40", "V130.01 40", "point"),
    ("L0 1L1 2", "L0 2L1 2", "joined"),
    ('VertID="1"', 'VertID="0"', "share"),
    ("1 0 0 1 0 0", "2 0 0 2 0 0", "transformed"),
    ('type="Tool"', 'type="Cut"', "VF_90_REG: type is Cut, not Tool"),
    ("<Notes", "<Thumbnail /><Notes", "Thumbnail"),
    ("<LightBurnProject", "<!DOCTYPE x><LightBurnProject", "declarations"),
]


@pytest.mark.parametrize(("old", "new", "word"), DAMAGE)
def test_a_damaged_project_is_found_out(
    old: str, new: str, word: str, job: Job, profile: LaserProfile
) -> None:
    text = lightburn_text(job, profile)
    assert old in text
    assert word in "; ".join(project_problems(text.replace(old, new), job, profile))


def test_an_operation_that_the_recipe_lacks_is_an_error(job: Job, profile: LaserProfile) -> None:
    poorer = {k: v for k, v in profile.recipe.by_operation.items() if k != "weld"}
    with pytest.raises(BadInputError, match="weld"):
        lightburn_text(job, replace(profile, recipe=profile.recipe.changed(operations=poorer)))
