import pytest

from tests.oracles.inflation_flow import resting
from vinefab.inflation.joint import JointShape, inflated_joint


@pytest.mark.thorough
def test_the_minimum_is_where_a_damped_motion_comes_to_rest():
    joint = JointShape(angles_deg=(50.0,), widths=(0.6,), fillets=(0.3, 0.3), hoop_strain=0.03)
    found = inflated_joint(joint, across=4, trunk_stub=1.0, child_stub=1.5)
    sheet = found.sheet
    rested, left = resting(
        sheet.mesh.points,
        sheet.mesh.triangles,
        sheet.membrane.free,
        sheet.roof(),
        hoop_strain=joint.hoop_strain,
    )
    assert left < 1e-5
    assert rested == pytest.approx(found.equilibrium.positions, abs=2e-3)
    energy = sheet.membrane.energy(rested)
    assert energy == pytest.approx(found.equilibrium.energy, rel=1e-6)
