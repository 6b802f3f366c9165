from dataclasses import replace

import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.fabrication.formats.laser_drawing import (
    DEFAULT,
    PRESETS,
    Style,
    metadata,
    operations_by_style,
    operations_left_out,
    styled_paths,
)
from vinefab.model.job import Job, Operation

AS_SPECIFIED = {
    Operation.MARK: ("VF_10_MARK", "#000000", 7),
    Operation.WELD: ("VF_20_WELD", "#0000FF", 5),
    Operation.WELDCUT: ("VF_30_WELDCUT", "#FF00FF", 6),
    Operation.CUT: ("VF_40_CUT", "#FF0000", 1),
    Operation.REG: ("VF_90_REG", "#F36926", 30),
    Operation.DOC: ("VF_91_DOC", "#0C96D9", 140),
}


def test_default_colours_are_the_specified_ones() -> None:
    found = {op: (s.layer, s.rgb, s.aci) for op, s in DEFAULT.styles.items()}
    assert found == AS_SPECIFIED


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_changes_no_geometry(name: str, job: Job) -> None:
    drawn = styled_paths(job, PRESETS[name])
    assert [styled.path for styled in drawn] == [
        path for path in job.paths if path.operation in PRESETS[name].styles
    ]


def test_the_mouth_is_not_cut_with_the_colour_that_seals(job: Job) -> None:
    for name in ("default", "red_cut"):
        styles = PRESETS[name].styles
        assert styles[Operation.CUT].rgb != styles[Operation.WELDCUT].rgb
    assert operations_by_style(job, PRESETS["shop_single"]) == ((Operation.WELDCUT, Operation.CUT),)


def test_presets_for_simple_programs_write_nothing_that_must_not_be_cut(job: Job) -> None:
    assert operations_left_out(job, DEFAULT) == ()
    assert operations_left_out(job, PRESETS["red_cut"]) == (Operation.REG, Operation.DOC)
    assert Operation.MARK in operations_left_out(job, PRESETS["shop_single"])


def test_an_unknown_preset_offers_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="red_cut"):
        PRESETS["redcut"]


@pytest.mark.parametrize(("rgb", "aci"), [("#000000", 0), ("#000000", 256), ("red", 1)])
def test_a_style_refuses_colours_that_cannot_be_written(rgb: str, aci: int) -> None:
    with pytest.raises(BadInputError):
        Style(layer="x", rgb=rgb, aci=aci)


def test_a_fact_cannot_hide_who_wrote_the_file(job: Job) -> None:
    found = metadata(replace(job, facts={"generator": "somebody", "units": "inch"}), DEFAULT)
    assert found["generator"].startswith("written by vinefab")
    assert found["units"] == "mm"
