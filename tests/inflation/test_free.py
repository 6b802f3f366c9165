"""Joints without the plane that holds their seam: which bow, and by how much."""

import numpy as np
import pytest

from tests.inflation.shapes import tube
from vinefab.inflation.joint import JointShape, both_sheets, free_joint


def step(hoop_strain):
    """Return the straight step from 24 to 14.4 mm."""
    return JointShape(
        angles_deg=(0.0,), widths=(0.6,), fillets=(0.125, 0.125), hoop_strain=hoop_strain
    )


@pytest.fixture(scope="module")
def sheets():
    sheet = tube(length=2.0, across=4, hoop_strain=0.02)
    planar = sheet.inflated()
    return sheet, planar, *both_sheets(sheet, planar)


def test_two_flat_halves_have_twice_the_energy_and_are_at_rest(sheets):
    sheet, planar, membrane, start = sheets
    upper = len(sheet.mesh.points)
    flat = start.copy()
    flat[:upper] = planar.positions
    flat[upper:, 2] = -planar.positions[~np.isin(np.arange(upper), sheet.is_seam), 2]
    assert membrane.energy(flat) == pytest.approx(2.0 * planar.energy, rel=1e-12)
    assert membrane.volume(flat) == pytest.approx(
        2.0 * sheet.membrane.volume(planar.positions), rel=1e-12
    )
    assert np.abs(membrane.gradient(flat)).max() < 1e-7


def test_forces_and_their_slopes_are_those_of_finite_differences(sheets):
    _, _, membrane, start = sheets
    random = np.random.default_rng(1)
    at = start + 0.01 * random.normal(size=start.shape)
    gradient, hessian = membrane.gradient(at), membrane.hessian(at)
    for _ in range(3):
        way = random.normal(size=membrane.unknowns)
        ahead, back = at.copy(), at.copy()
        ahead[membrane.free] += 1e-6 * way
        back[membrane.free] -= 1e-6 * way
        slope = (membrane.energy(ahead) - membrane.energy(back)) / 2e-6
        assert gradient @ way == pytest.approx(slope, rel=1e-6, abs=1e-7)
        turned = (membrane.gradient(ahead) - membrane.gradient(back)) / 2e-6
        lower = hessian @ way
        assert lower == pytest.approx(turned, rel=1e-4, abs=1e-4 * np.abs(turned).max())


def test_a_tube_stays_straight():
    plain = JointShape(angles_deg=(0.0,), widths=(1.0,), fillets=(0.1, 0.1))
    found = free_joint(plain, across=4)
    assert found.bow_deg[0] < 0.1
    assert abs(found.gain) < 1e-9


def test_a_straight_step_of_stiff_film_bows():
    """By 15 degrees, as a second code found (specification), and lower energy is why."""
    found = free_joint(step(0.01), across=6)
    assert found.bow_deg[0] == pytest.approx(15.0, abs=4.0)
    assert found.angles_deg[0] == pytest.approx(0.0, abs=0.5)
    assert found.gain > 1e-5


def test_softer_film_stays_in_its_plane():
    found = free_joint(step(0.05), across=6)
    assert found.bow_deg[0] < 0.1
    assert found.gain == pytest.approx(0.0, abs=1e-9)


def test_a_pair_of_stiff_film_bows_to_one_side():
    found = free_joint(JointShape.fan(2, 80.0, width=0.6, fillet=0.125, hoop_strain=0.01), across=6)
    assert ((found.bow_deg > 12.0) & (found.bow_deg < 31.0)).all()
    assert found.gain > 1e-4
    assert found.angles_deg == pytest.approx(found.planar.angles_deg, abs=2.0)
