"""The numbers that one deployment comes to."""

import math

import numpy as np

from vinefab.model.checked import Floats
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design, Pouch
from vinefab.pipeline.predict_pressure import growth_pressures_kpa
from vinefab.tasks.anchoring import Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.ground import Ground
from vinefab.tasks.reach import Reach

STUCK_STOPS = (Stop.HEAD_ON, Stop.CORNER)


def measure_deployment(deployment: Deployment, design: Design, ground: Ground) -> Floats:
    """Return the measures of a deployment, in the order of `vinefab.model.measure.MEASURES`.

    Parameters
    ----------
    deployment
        Where the robot ended.
    design
        The robot, for its widths.
    ground
        The map's free space.
    """
    score, terms = Coverage().evaluate(deployment, ground)
    reached, _ = Reach().evaluate(deployment, ground)
    amplification, _ = _anchoring(design.build.pouch).evaluate(deployment, ground)
    return np.array(
        [
            score,
            100.0 * terms["area"],
            100.0 * reached,
            amplification,
            *shares_percent(deployment),
            *worst_pressures_kpa(deployment, design),
        ]
    )


def pouch_size_mm(pouch: Pouch) -> tuple[float, float]:
    """Return length and width of a pouch; of a round one, of the square of the same area."""
    side_mm = math.sqrt(math.pi) * (pouch.radius_mm or 0.0)
    return pouch.length_mm or side_mm, pouch.width_mm or side_mm


def _anchoring(pouch: Pouch | None) -> Anchoring:
    """Return the anchoring task for a design's pouches; without any, every leaf counts."""
    if pouch is None:
        return Anchoring()
    length_mm, width_mm = pouch_size_mm(pouch)
    return Anchoring(pouch_length_mm=length_mm, pouch_width_mm=width_mm)


def shares_percent(deployment: Deployment) -> tuple[float, float, float]:
    """Return length grown, branches stopped by walls and branches never emerged, in percent."""
    grown = deployment.grown_mm.sum() / deployment.tree.total_length_mm
    stuck = np.isin(deployment.stop, STUCK_STOPS).mean()
    return 100.0 * float(grown), 100.0 * float(stuck), 100.0 * float((~deployment.deployed).mean())


def worst_pressures_kpa(deployment: Deployment, design: Design) -> tuple[float, float]:
    """Return the pressure that growth to the worst tip takes with film stored loosely and tightly.

    NaN if nothing emerged.
    """
    deployed = deployment.deployed
    if not deployed.any():
        return float("nan"), float("nan")
    loose_kpa, tight_kpa = growth_pressures_kpa(deployment, design)[:, deployed].max(axis=1)
    return float(loose_kpa), float(tight_kpa)
