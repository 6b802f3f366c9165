import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.inflation.joint import inflated_joint
from vinefab.inflation.robot import inflated_robot, joints_of
from vinefab.model.design import Build, Design, Level


def test_a_plain_vine_stays_where_it_is():
    vine = Design(name="vine", trunk_length_mm=100.0, build=Build.standard(1, trunk_width_mm=24.0))
    found = inflated_robot(vine)
    assert found.center_lines_mm[0, :, 1] == pytest.approx(0.0, abs=0.01)
    # A rounded tip is pulled back by a part of the width.
    assert found.tip_errors_mm()[0] < 0.15 * 24.0


def test_a_robot_of_one_joint_deploys_as_its_joint():
    fork = Level(branches=2, length_mm=80.0, fan_rad=np.radians(100.0))
    build = Build(widths_mm=(24.0, 14.4), fillet_mm=(4.8,), tail_mm=40.0)
    design = Design(name="y", trunk_length_mm=60.0, levels=(fork,), build=build)
    found = inflated_robot(design)
    (joint,) = joints_of(design)
    assert joint.angles_deg == pytest.approx((-50.0, 50.0))
    assert (joint.widths, joint.hoop_strain) == ((pytest.approx(0.6),) * 2, 0.01)
    assert joint.fillets == pytest.approx((0.2, 0.2, 0.2))
    alone = inflated_joint(joint)
    assert np.degrees(found.deployed_offsets_rad[1:]) == pytest.approx(alone.angles_deg, abs=0.8)
    assert found.center_lines_mm.shape == (3, 33, 2)
    assert found.center_lines_mm[0, 0] == pytest.approx([0.0, 0.0], abs=1e-9)


CAVE = Design(
    name="cave",
    trunk_length_mm=40.0,
    levels=tuple(
        Level.of(branches=branches, length_mm=length, angle_deg=angle, growth_percent=growth)
        for branches, length, angle, growth in (
            (4, 86.02, 160.0, 136.85),
            (2, 97.95, 44.25, 155.41),
            (2, 87.03, 70.38, 125.36),
        )
    ),
    build=Build.standard(4, 24.0, 0.65),
)
"""The cave explorer of the trial: a winner of searches that did not know inflation."""


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("design", "mean_mm", "most_mm", "within"),
    [
        (CAVE, 45.0, 83.0, 0.1),
        (Design.read("grid_explorer_levels"), 19.0, 27.0, 0.25),
        (Design.read("three_level_tree"), 14.0, 23.0, 0.1),
    ],
    ids=["cave", "grid_explorer_levels", "three_level_tree"],
)
def test_tips_of_designs_are_off_as_the_trial_says(design, mean_mm, most_mm, within):
    """The trial was another program, with joints of its own."""
    errors = inflated_robot(design).tip_errors_mm()
    assert errors.mean() == pytest.approx(mean_mm, rel=within)
    assert errors.max() == pytest.approx(most_mm, rel=within)


def test_a_pattern_that_overlaps_itself_is_refused():
    around = Level(branches=3, length_mm=60.0, fan_rad=np.radians(359.0))
    design = Design(name="round", trunk_length_mm=120.0, levels=(around,), build=Build.standard(2))
    with pytest.raises(BadInputError):
        inflated_robot(design)
