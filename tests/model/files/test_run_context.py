"""The recipe of a run, written beside its winner."""

import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.model.design import Design
from vinefab.model.files.run_context import RunContext, RunRecipe, shape_fingerprint
from vinefab.model.map import Map


def test_a_forged_record_leaves_nothing_behind(tmp_path):
    forged = RunRecipe(name="x", digest="0", files={"recipe_of_run/a.toml": "", "../b.toml": ""})
    with pytest.raises(BadInputError, match=r"recipe\.files"):
        forged.write(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("origin", "key"),
    [
        ({"task_parameters": {"targets": "x"}}, "origin.task_parameters.targets"),
        (
            {"targets": [{"point_mm": [1, 2], "tolerance_mm": "a"}]},
            "origin.targets[1].tolerance_mm",
        ),
        ({"run_name": "\x1b[31m"}, "origin.run_name"),
    ],
)
def test_a_wrong_place_or_name_of_a_run_is_named_by_its_key(origin, key):
    design = Design.read("plain_vine")
    with pytest.raises(BadInputError) as caught:
        _ = RunContext.of(design.changed(origin=origin)).places
    assert caught.value.key == key


WORLD = Map(name="w", bounds=shapely.box(0.0, 0.0, 90.0, 90.0))


@pytest.mark.parametrize(
    ("of_run", "of_map", "used"),
    [
        ({"targets": ({"point_mm": [9, 9]},)}, (), (9, 9)),
        ({"targets": ({"point_mm": [9, 9]},)}, ((5, 5),), (5, 5)),
        ({"task_parameters": {"targets": [[9, 9]]}}, ((5, 5),), (9, 9)),
    ],
)
def test_targets_of_a_task_take_the_place_of_a_maps_as_in_the_search(of_run, of_map, used):
    run = RunContext(maps=(shape_fingerprint(WORLD),), **of_run)
    (placed,) = run.with_places([WORLD.with_targets(*of_map)])
    assert [one.point_mm for one in placed.targets] == [used]
