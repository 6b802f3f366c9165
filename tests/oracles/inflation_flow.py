"""Inflation by damped motion: a second way to the equilibrium that `inflation.membrane` finds.

Every corner has a mass and a drag; the sheet moves until it rests. Strains, stresses and pressure
are written a second time, triangle by triangle in tensors, and no second derivative is used.
"""

import numpy as np


def resting(points, triangles, free, start, *, hoop_strain, poisson=0.45, most_steps=200_000):
    """Return corners at rest, shape (n, 3), and the largest force left over p W^2."""
    stiffness = 1.0 / (np.pi * hoop_strain)
    a = points[triangles[:, 1]] - points[triangles[:, 0]]
    b = points[triangles[:, 2]] - points[triangles[:, 0]]
    flat = np.stack([a, b], axis=2)
    inverse, area = np.linalg.inv(flat), np.linalg.det(flat) / 2.0

    def forces(x):
        edges = np.stack(
            [x[triangles[:, 1]] - x[triangles[:, 0]], x[triangles[:, 2]] - x[triangles[:, 0]]],
            axis=2,
        )
        bent = edges @ inverse
        strain = (bent.transpose(0, 2, 1) @ bent - np.eye(2)) / 2.0
        values, ways = np.linalg.eigh(strain)
        low, high = values[:, 0], values[:, 1]
        taut = low + poisson * high > 0.0
        plane = 1.0 / (1.0 - poisson**2)
        pull_low = np.where(taut & (high > 0.0), plane * (low + poisson * high), 0.0)
        pull_high = np.where(
            taut & (high > 0.0), plane * (high + poisson * low), np.maximum(high, 0.0)
        )
        stress = np.einsum("mik,mk,mjk->mij", ways, np.stack([pull_low, pull_high], 1), ways)
        pulled = bent @ stress @ inverse.transpose(0, 2, 1) * (area * stiffness)[:, None, None]
        total = np.zeros_like(x)
        np.add.at(total, triangles[:, 1], -pulled[:, :, 0])
        np.add.at(total, triangles[:, 2], -pulled[:, :, 1])
        np.add.at(total, triangles[:, 0], pulled.sum(axis=2))
        # Half the cross product of two edges is area times normal; a linear height weighs the
        # corners of its shadow unevenly.
        height = x[triangles, 2].sum(axis=1) / 6.0
        for corner in range(3):
            after, before = x[triangles[:, (corner + 1) % 3]], x[triangles[:, (corner + 2) % 3]]
            push = np.column_stack(
                [
                    height * (after[:, 1] - before[:, 1]),
                    height * (before[:, 0] - after[:, 0]),
                    np.linalg.det(edges[:, :2]) / 6.0,
                ]
            )
            np.add.at(total, triangles[:, corner], push)
        return np.where(free, total, 0.0)

    # A time step of 1 is stable for masses above half the stiffness around a corner.
    lengths = np.sqrt((a**2).sum(1)), np.sqrt((b**2).sum(1)), np.sqrt(((a - b) ** 2).sum(1))
    around = stiffness * sum(length**2 for length in lengths) / area / 2.0 + 1.0
    mass = np.zeros(len(points))
    for corner in range(3):
        np.add.at(mass, triangles[:, corner], 1.2 * around)
    x, speed = start.copy(), np.zeros_like(start)
    energy_before = 0.0
    for step in range(most_steps):
        force = forces(x)
        if step % 100 == 0 and np.abs(force).max() < 1e-6:
            break
        speed = speed + force / mass[:, None]
        x = x + speed
        moving = float((mass[:, None] * speed**2).sum())
        # Kinetic damping: stop dead whenever the motion is past its peak.
        if moving < energy_before:
            speed[:] = 0.0
            moving = 0.0
        energy_before = moving
    return x, float(np.abs(force).max())
