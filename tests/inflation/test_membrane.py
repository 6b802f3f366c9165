import math

import numpy as np
import pytest
from scipy.spatial import Delaunay

from vinefab.core.errors import BadInputError
from vinefab.inflation.membrane import Membrane


def patch(*, stretch=0.02, count=60, seed=0):
    """Return a sheet with some held coordinates, in a shape with all three states."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(count, 2))
    triangles = Delaunay(points).simplices.astype(np.int64)
    a, b = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    triangles[a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]] = triangles[
        a[:, 0] * b[:, 1] < a[:, 1] * b[:, 0]
    ][:, ::-1]
    free = np.ones((count, 3), dtype=bool)
    free[:8, 2] = free[0] = False
    membrane = Membrane(points, triangles, free, hoop_strain=0.05)
    height = rng.normal(scale=0.01, size=count) * free[:, 2]
    shape = points * [1.0 + stretch, 1.0 - stretch] + rng.normal(scale=1e-3, size=points.shape)
    return membrane, np.column_stack([shape, height])


def moved(positions, place, by):
    there = positions.copy()
    there[tuple(place)] += by
    return there


@pytest.mark.parametrize("stretch", [0.02, -0.02, 0.1])
def test_gradient_and_hessian_are_those_of_finite_differences(stretch):
    membrane, positions = patch(stretch=stretch)
    assert set(membrane.states(positions)) >= {0, 1} or stretch == 0.1
    step, places = 1e-6, np.argwhere(membrane.free)
    gradient, hessian = membrane.gradient(positions), membrane.hessian(positions).toarray()
    rate = [
        (
            membrane.energy(moved(positions, place, step))
            - membrane.energy(moved(positions, place, -step))
        )
        / (2 * step)
        for place in places
    ]
    assert gradient == pytest.approx(np.array(rate), abs=1e-7 * np.abs(gradient).max())
    bend = [
        (
            membrane.gradient(moved(positions, place, step))
            - membrane.gradient(moved(positions, place, -step))
        )
        / (2 * step)
        for place in places
    ]
    assert hessian == pytest.approx(np.array(bend), abs=1e-6 * np.abs(hessian).max())
    assert (hessian == hessian.T).all()


def one_triangle(e1, e2, nu=0.45):
    """Return energy density over the modulus, and the state, of film with principal strains."""
    points, triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([[0, 1, 2]])
    membrane = Membrane(points, triangle, np.ones((3, 3), dtype=bool), hoop_strain=0.1, poisson=nu)
    x, y = (math.sqrt(1.0 + 2.0 * strain) for strain in (e1, e2))
    positions = np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0], [0.0, y, 0.0]])
    return 2.0 * membrane.energy(positions) / membrane.stiffness, int(membrane.states(positions)[0])


def test_film_is_taut_wrinkled_or_slack():
    nu = 0.45
    taut = (0.02**2 + 0.01**2 + 2 * nu * 0.02 * 0.01) / (2 * (1 - nu**2))
    assert one_triangle(0.02, 0.01) == (pytest.approx(taut, rel=1e-9), 2)
    assert one_triangle(0.02, -0.1) == (pytest.approx(0.02**2 / 2, rel=1e-9), 1)
    assert one_triangle(-0.02, -0.1) == (pytest.approx(0.0, abs=1e-15), 0)
    # Energies meet where film starts to wrinkle.
    for gap in (1e-9, -1e-9):
        energy, state = one_triangle(0.02, -nu * 0.02 + gap)
        assert state == (2 if gap > 0 else 1)
        assert energy == pytest.approx(0.02**2 / 2, rel=1e-7)


def test_moving_a_sheet_within_its_plane_changes_nothing():
    membrane, positions = patch()
    energy, states = membrane.energy(positions), membrane.states(positions)
    cos, sin = math.cos(0.7), math.sin(0.7)
    turned = positions @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]]) + [3, -2, 0]
    assert membrane.energy(turned) == pytest.approx(energy, rel=1e-11)
    assert (membrane.states(turned) == states).all()


def test_a_strain_is_a_positive_number():
    points, triangle = np.zeros((3, 2)), np.array([[0, 1, 2]])
    with pytest.raises(BadInputError, match="hoop_strain"):
        Membrane(points, triangle, np.ones((3, 3), dtype=bool), hoop_strain=0.0)
