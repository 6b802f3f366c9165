import pytest

from vinefab.model.design import Build, Design, Level
from vinefab.model.tree import branch_tree
from vinefab.physics.growth_path import planned_growth_kpa, planned_paths, riding_mm
from vinefab.physics.growth_pressure import FITTED
from vinefab.physics.tube import inflated_diameter_mm


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_the_tree_at_once_is_what_each_path_gives(depth: int) -> None:
    fan = Level(branches=3, length_mm=80.0, fan_rad=2.0, growth=0.6)
    build = Build.standard(depth, 30.0)
    tree = branch_tree(
        Design(name="t", trunk_length_mm=150.0, levels=(fan,) * (depth - 1), build=build)
    )
    riding = riding_mm(tree, build.widths_mm)
    expected = [
        path.pressure_kpa(
            FITTED.at_diameter(inflated_diameter_mm(build.widths_mm[level - 1]), 25.0), ride
        )
        for path, level, ride in zip(
            planned_paths(tree), tree.level.tolist(), riding.tolist(), strict=True
        )
    ]
    found = planned_growth_kpa(tree, build.widths_mm, FITTED, 25.0)
    assert found.tolist() == pytest.approx(expected, rel=1e-12)
