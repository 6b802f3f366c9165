"""Inflated shapes that are known in closed form."""

import math

import numpy as np
import pytest

from tests.inflation import shapes
from vinefab.inflation.joint import JointShape, inflated_joint
from vinefab.inflation.membrane import POISSON
from vinefab.inflation.mesh import tube_stretch


def test_a_tube_is_round_and_its_wall_bears_hoop_and_half_as_much_along():
    strain = 0.01
    sheet = shapes.tube(hoop_strain=strain)
    found = sheet.inflated()
    (right, left), positions = sheet.mesh.sides[0], found.positions
    middle = len(right) // 3
    wide = np.hypot(*(positions[left[middle]] - positions[right[middle]])[:2])
    # The wall is stretched by the hoop load less the contraction by the load along it.
    stretched = 2.0 / math.pi * (1.0 + strain * (1.0 - 0.45 / 2.0))
    assert wide == pytest.approx(stretched, rel=0.01)
    assert positions[:, 2].max() == pytest.approx(wide / 2.0, rel=0.02)
    straight = sheet.mesh.points[sheet.mesh.triangles].mean(axis=1)[:, 0]
    loads = sheet.membrane.stresses(positions)[:, (straight > 0.5) & (straight < 2.5)].mean(axis=1)
    assert loads[1] == pytest.approx(1.0 / math.pi, rel=0.02)
    assert loads[0] == pytest.approx(0.5 / math.pi, rel=0.02)
    assert sheet.seam_loads(found)[right[middle]] == pytest.approx(1.0 / math.pi, rel=0.02)


def test_a_disc_becomes_a_mylar_balloon():
    sheet = shapes.disc(across=16, hoop_strain=0.0005, width=2.0)
    found = sheet.inflated()
    seam = found.positions[sheet.mesh.seam, :2]
    radius = np.hypot(*(seam - seam.mean(axis=0)).T).mean()
    assert radius == pytest.approx(0.7627, rel=0.005)
    assert found.positions[:, 2].max() / radius == pytest.approx(0.599, rel=0.015)
    assert 2.0 * sheet.membrane.volume(found.positions) == pytest.approx(1.2185, rel=0.01)


def turned_over(strain, radius=12.0, turn=1.2):
    """Return the turn of a slender ring sector under pressure over its flat turn."""
    sheet = shapes.ring(radius, turn, hoop_strain=strain, across=12)
    found = sheet.inflated()
    flat, seam = sheet.mesh.points[sheet.mesh.seam], sheet.mesh.seam
    at = np.arctan2(flat[:, 0], radius - flat[:, 1])
    side = np.hypot(flat[:, 0], radius - flat[:, 1])
    middle = (at > 0.2 * turn) & (at < 0.8 * turn)
    turns = []
    for edge in (radius - 0.5, radius + 0.5):
        on = np.flatnonzero(middle & (np.abs(side - edge) < 1e-6))
        on = on[np.argsort(at[on])]
        bent = found.positions[seam[on], :2]
        # The curvature of a circle through the points.
        design = np.column_stack([2.0 * bent, np.ones(len(bent))])
        x, y, _ = np.linalg.lstsq(design, (bent**2).sum(axis=1), rcond=None)[0]
        ways = np.unwrap(np.arctan2(bent[:, 1] - y, bent[:, 0] - x))
        turns.append((ways[-1] - ways[0]) / (at[on[-1]] - at[on[0]]))
    return float(np.mean(turns))


@pytest.mark.thorough
def test_a_slender_ring_turns_farther_the_stiffer_its_film():
    # 1 / max((1 - cos x) / x) = 1.380 for film that does not stretch. Edges do not lie along the
    # ring, so the last part of the gap is that of the triangles.
    gaps = [1.380 - turned_over(strain) for strain in (0.01, 0.000625)]
    assert 0.0 < gaps[1] < 0.08 < gaps[0] < 0.14


def test_three_equal_tubes_at_120_degrees_stay():
    found = inflated_joint(JointShape.fan(2, 120.0, width=1.0, fillet=0.125))
    assert found.angles_deg == pytest.approx([-60.0, 60.0], abs=0.4)


@pytest.mark.parametrize("strain", [0.01, 0.3, 0.6, 1.0])
def test_the_stretched_tube_is_in_equilibrium(strain):
    # Alternating between both directions came to rest at nonsense above 0.55.
    around, along = tube_stretch(strain)
    hoop, axial = strain * along, strain * around**2 / (2.0 * along)
    assert around**2 == pytest.approx(1.0 + 2.0 * (hoop - POISSON * axial))
    assert along**2 == pytest.approx(1.0 + 2.0 * (axial - POISSON * hoop))
