from time import process_time

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.inflation.joint import JointShape, inflated_joint, joint_outline
from vinefab.inflation.mesh import mesh_of

FORK = JointShape.fan(2, 80.0, width=0.6, fillet=0.125)
UNEVEN = JointShape(angles_deg=(0.0, 60.0), widths=(0.6, 0.5), fillets=(0.2, 0.3, 0.1))


def test_a_fork_deploys_as_other_codes_say():
    # The trial and a second code, independent in method, both gave 39.
    found = inflated_joint(FORK)
    assert found.angles_deg == pytest.approx([-39.2, 39.2], abs=0.7)
    assert found.pull_backs == pytest.approx([0.09, 0.09], abs=0.02)
    assert found.side_offsets[0] == pytest.approx(-found.side_offsets[1], abs=0.01)
    assert 2.0 < found.crotch_load < 4.0
    assert found.crotch_load == pytest.approx(found.gap_loads[1])
    assert (found.passages > 0.8).all()
    assert (found.passages <= 1.0).all()


def test_narrow_siblings_close():
    found = inflated_joint(JointShape.fan(2, 40.0, width=0.6, fillet=0.125))
    assert found.angles_deg == pytest.approx([-6.0, 6.0], abs=1.0)


def test_a_mirrored_joint_deploys_mirrored():
    one, other = inflated_joint(UNEVEN), inflated_joint(UNEVEN.mirrored)
    # Triangles are not mirrored: this is their error.
    assert other.angles_deg == pytest.approx(-one.angles_deg[::-1], abs=0.7)
    assert other.pull_backs == pytest.approx(one.pull_backs[::-1], abs=0.01)
    assert other.side_offsets == pytest.approx(-one.side_offsets[::-1], abs=0.01)


def test_sensitivity_is_the_slope_of_deployed_over_flat():
    soft = JointShape.fan(2, 100.0, width=0.6, fillet=0.3, hoop_strain=0.05)
    slopes = inflated_joint(soft).sensitivity()
    assert slopes.shape == (2, 2)
    turned = [inflated_joint(soft.with_angles((-50.0, 50.0 + by))) for by in (-3.0, 3.0)]
    assert slopes[1, 1] == pytest.approx(
        (turned[1].angles_deg[1] - turned[0].angles_deg[1]) / 6.0, abs=0.15
    )


@pytest.mark.thorough
@pytest.mark.parametrize("joint", [FORK, UNEVEN, JointShape.fan(4, 160.0, width=0.6, fillet=0.125)])
def test_finer_triangles_turn_children_by_little(joint):
    usual = inflated_joint(joint).angles_deg
    finer = inflated_joint(joint, across=16).angles_deg
    finest = inflated_joint(joint, across=32).angles_deg
    assert np.abs(finer - usual).max() < 0.8
    assert np.abs(finest - finer).max() < 0.4


@pytest.mark.thorough
def test_longer_stubs_change_nothing():
    short = inflated_joint(FORK)
    long = inflated_joint(FORK, trunk_stub=3.0, child_stub=5.0)
    assert long.angles_deg == pytest.approx(short.angles_deg, abs=0.3)
    assert long.pull_backs == pytest.approx(short.pull_backs, abs=0.01)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"angles_deg": (40.0, -40.0)}, "angles_deg"),
        ({"widths": (0.6,)}, "widths"),
        ({"fillets": (0.1, -0.1, 0.1)}, "fillets"),
        ({"hoop_strain": 0.0}, "hoop_strain"),
    ],
)
def test_joints_that_cannot_be_are_refused(changes, key):
    given = {"angles_deg": (-40.0, 40.0), "widths": (0.6, 0.6), "fillets": (0.1, 0.1, 0.1)}
    with pytest.raises(BadInputError, match=key):
        JointShape(**(given | changes))


def test_siblings_that_hardly_part_are_refused():
    close = JointShape(angles_deg=(-1.0, 1.0), widths=(0.6, 0.6), fillets=(0.1, 0.1, 0.1))
    with pytest.raises(BadInputError, match="angles_deg"):
        inflated_joint(close)


def test_a_fillet_that_takes_minutes_is_refused_at_once():
    with pytest.raises(BadInputError, match=r"fillets.* smaller fillet or wider angles"):
        inflated_joint(JointShape.fan(2, 60.0, width=0.6, fillet=8.3))


def test_a_child_of_a_fiftieth_of_the_trunk_is_meshed_in_no_time():
    # 11 s when the finest lattice was laid over all of the joint.
    outline, begun = joint_outline(JointShape.fan(2, 60.0, width=0.02, fillet=0.08)), process_time()
    mesh = mesh_of(
        outline.contour,
        outline.straights,
        np.where([name == "0" for name in outline.contour.branches], 0.08, 0.0016),
        across=8,
    )
    assert process_time() - begun < 2.0
    assert len(mesh.points) < 3000
