"""The straight tube in closed form: how far its film stretches around and along."""

import math

from vinefab.inflation.membrane import POISSON


def tube_stretch(hoop_strain: float, poisson: float = POISSON) -> tuple[float, float]:
    """Return by how much the film of a closed tube is stretched around and along, as ratios.

    Parameters
    ----------
    hoop_strain
        p W / (pi E t) of the flat tube.

    Notes
    -----
    St. Venant and Kirchhoff film in plane stress. With the radius R = h W / pi, h and a the
    stretches around and along, equilibrium per flat length is ``h S_h = p a R`` around and
    ``2 W a S_a = p pi R^2`` along.

    Examples
    --------
    >>> [round(stretch, 4) for stretch in tube_stretch(0.01)]
    [1.0077, 1.0006]
    """
    along = 1.0
    for _ in range(200):
        # Around in closed form for a length: both in turn diverge above a strain of 0.55.
        square = (1.0 + 2.0 * hoop_strain * along) / (1.0 + poisson * hoop_strain / along)
        axial = hoop_strain * (square / (2.0 * along) - poisson * along)
        new = math.sqrt(max(0.01, 1.0 + 2.0 * axial))
        if abs(new - along) < 1e-14:
            break
        along = new
    return math.sqrt(square), new
