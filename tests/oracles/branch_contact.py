"""Branches that stop at each other, in small steps: the oracle of the compiled rule.

All tips move together, step by step, along the paths that they have alone. The distance of every
tip from what is laid of every other body says when it meets one.
"""

from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment, Stop


@dataclass
class Body:
    """A branch on its way."""

    chain_mm: Floats
    begin_mm: float  # when it sets out
    end_mm: float  # when it ends if nothing is in its way
    radius_mm: float
    state: str = "waiting"  # then growing; in the end whole, cut or inside

    def laid_mm(self, now_mm: float) -> Floats:
        """Return the chain up to where the tip is."""
        left = min(now_mm, self.end_mm) - self.begin_mm
        points = [self.chain_mm[0]]
        for one, two in zip(self.chain_mm, self.chain_mm[1:], strict=False):
            size = float(np.hypot(*(two - one)))
            if size >= left:
                points.append(one + (two - one) * (left / size if size > 0.0 else 0.0))
                break
            points.append(two)
            left -= size
        return np.array(points)


def distance_mm(point: Floats, chain: Floats) -> float:
    """Return how far a point is from a chain."""
    if len(chain) == 1:
        return float(np.hypot(*(point - chain[0])))
    one, way = chain[:-1], np.diff(chain, axis=0)
    square = (way**2).sum(axis=1)
    along = ((point - one) * way).sum(axis=1)
    share = np.clip(np.divide(along, square, out=np.zeros_like(along), where=square > 0.0), 0, 1)
    return float(np.hypot(*(one + share[:, None] * way - point).T).min())


def stopped_in_steps(alone: Deployment, radii_mm: Floats, step_mm: float) -> list[Body]:
    """Return what becomes of branches that were grown alone.

    Parameters
    ----------
    alone
        Every branch as it grows where bodies pass through each other.
    radii_mm
        Radius of each branch's body.
    step_mm
        How far tips move at once.
    """
    parent = alone.tree.parent.tolist()
    begin_mm = alone.base_mm
    bodies = [
        Body(
            chain_mm=alone.chain_mm(k),
            begin_mm=float(begin_mm[k]),
            end_mm=float(begin_mm[k] + alone.grown_mm[k]),
            radius_mm=float(radii_mm[k]),
            state="waiting" if alone.stop[k] != Stop.NOT_DEPLOYED else "inside",
        )
        for k in range(len(parent))
    ]
    free = dict[tuple[int, int], bool]()
    now_mm = 0.0
    while any(body.state in {"waiting", "growing"} for body in bodies):
        _set_out(bodies, parent, now_mm)
        out = [k for k, body in enumerate(bodies) if body.state in {"growing", "whole", "cut"}]
        laid = {k: bodies[k].laid_mm(now_mm) for k in out}
        met = []
        for one in out:
            if bodies[one].state != "growing":
                continue
            for other in out:
                if one == other:
                    continue
                reach = bodies[one].radius_mm + bodies[other].radius_mm
                touches = distance_mm(laid[one][-1], laid[other]) <= reach
                # Who touch as the later one sets out are free of each other until they were apart.
                free[one, other] = free.get((one, other), True) and touches
                if touches and not free[one, other]:
                    met.append(one)
        for one in met:
            bodies[one].state, bodies[one].end_mm = "cut", now_mm
        for body in bodies:
            if body.state == "growing" and now_mm >= body.end_mm:
                body.state = "whole"
        now_mm += step_mm
    return bodies


def _set_out(bodies: list[Body], parent: list[int], now_mm: float) -> None:
    for k, body in enumerate(bodies):
        if body.state != "waiting":
            continue
        above = bodies[parent[k]].state if parent[k] >= 0 else "whole"
        if above in {"cut", "inside"}:
            body.state = "inside"
        elif above == "whole" and body.begin_mm <= now_mm:
            body.state = "growing"
