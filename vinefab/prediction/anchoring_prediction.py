"""Anchoring over many deployments: amplification always, newtons where there are pouches."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design, Pouch
from vinefab.model.laser import Material
from vinefab.pages.html import Section, Table
from vinefab.physics.anchoring import (
    ASSUMED_FRICTION,
    amplification,
    branch_force_n,
    branch_limit_n,
    payload_over_mass,
    pouch_contact_mm2,
    tip_force_n,
)
from vinefab.physics.seam import allowed_line_load_n_mm
from vinefab.prediction.family_deployments import FamilyDeployments
from vinefab.prediction.measures import pouch_size_mm
from vinefab.tasks.anchoring_force import path_turn_rad, tip_gaps_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldForces:
    """Mean amplification for one share of engaged leaves and one coefficient of friction."""

    friction: float  # the coefficient
    engaged_percent: float  # share of the deployed leaves that hold, those that turned least first
    # mean over deployments of the force over that of one pouch without any turn
    amplification: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Forces:
    """Forces of a design that has pouches, over deployments."""

    friction: Floats  # coefficients, rising, shape (k,)
    # mean_n, p05_n, p95_n: for each coefficient, over deployments, shape (k,)
    mean_n: Floats
    p05_n: Floats
    p95_n: Floats
    # share of the leaves whose inflated pouch is wider than the gap that it ended in
    engaged_percent: float
    # share of the engaged leaves that film or seam limit at the greatest coefficient
    limited_percent: float
    pressure_kpa: float  # working pressure that they are for
    mass_g: float  # film of the robot; 0 when it is not known


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchoringPrediction:
    """Anchoring as an interval over friction and over which leaves are engaged."""

    label: str  # of the map family
    leaves: int  # leaves of the design
    table: tuple[HeldForces, ...]  # every combination of friction and engaged share
    forces: Forces | None = None  # in newtons, where the design has pouches

    def at(self, friction: float, engaged_percent: float) -> float:
        """Return the amplification of one combination."""
        return next(
            held.amplification
            for held in self.table
            if held.friction == friction and held.engaged_percent == engaged_percent
        )


FRICTIONS = (ASSUMED_FRICTION.low, ASSUMED_FRICTION.value, ASSUMED_FRICTION.high)

ENGAGED_PERCENT = (100.0, 66.7, 33.3)
"""Two thirds held in the paper's test of six branches: one touched nothing, one hung slack."""


def predict_anchoring(
    design: Design, result: FamilyDeployments, material: Material, mass_g: float = 0.0
) -> AnchoringPrediction:
    """Return what a design is expected to hold in one prepared."""
    turns = [leaf_turns_rad(deployment) for deployment in result.deployments]
    table = tuple(
        HeldForces(
            friction=friction,
            engaged_percent=percent,
            amplification=float(np.mean([_held(found, percent, friction) for found in turns])),
        )
        for friction in FRICTIONS
        for percent in ENGAGED_PERCENT
    )
    leaves = int(result.deployments[0].tree.is_leaf.sum())
    pouch = design.build.pouch
    forces = _forces(design, pouch, result, material, mass_g) if pouch else None
    return AnchoringPrediction(
        label=result.prepared.label, leaves=leaves, table=table, forces=forces
    )


def leaf_turns_rad(deployment: Deployment) -> Floats:
    """Return the turn on the way to each leaf's tip that came out, rising, shape (m,)."""
    return np.sort(path_turn_rad(deployment)[_leaves(deployment)])


def _leaves(deployment: Deployment) -> Ints:
    out = deployment.tree.is_leaf & deployment.deployed & (deployment.grown_mm > 0.0)
    return np.flatnonzero(out)


def _held(turns_rad: Floats, percent: float, friction: float) -> float:
    """Return the amplification with the straightest share of the leaves engaged."""
    count = math.ceil(percent / 100.0 * len(turns_rad) - 0.01)
    return amplification(turns_rad[:count].tolist(), friction)


def _forces(
    design: Design, pouch: Pouch, result: FamilyDeployments, material: Material, mass_g: float
) -> Forces:
    length_mm, width_mm = pouch_size_mm(pouch)
    limit_n = branch_limit_n(
        design.build.widths_mm[-1],
        material.ply_mm.value,
        material.strength_mpa.value,
        allowed_line_load_n_mm(material.burst_kpa.value, material.burst_width_mm.value),
    )
    totals = np.zeros((len(result.deployments), len(FRICTIONS)))
    leaves = engaged = limited = 0
    for index, deployment in enumerate(result.deployments):
        rows = _leaves(deployment)
        gaps = tip_gaps_mm(deployment, rows, result.prepared_map(index).context)
        contact = [pouch_contact_mm2(length_mm, width_mm, gap_mm) for gap_mm in gaps.tolist()]
        turns = path_turn_rad(deployment)[rows]
        forces = np.array(
            [
                [
                    branch_force_n(
                        tip_force_n(design.build.pressure_kpa, area, mu), float(turn), mu, limit_n
                    )
                    for mu in FRICTIONS
                ]
                for area, turn in zip(contact, turns, strict=True)
            ]
        ).reshape(-1, len(FRICTIONS))
        totals[index] = forces.sum(axis=0)
        leaves += int(deployment.tree.is_leaf.sum())
        engaged += int(np.count_nonzero(contact))
        limited += int(np.count_nonzero(forces[:, -1] >= limit_n))
    p05, p95 = np.percentile(totals, [5.0, 95.0], axis=0)
    return Forces(
        friction=np.array(FRICTIONS),
        mean_n=totals.mean(axis=0),
        p05_n=p05,
        p95_n=p95,
        engaged_percent=100.0 * engaged / leaves,
        limited_percent=100.0 * limited / max(1, engaged),
        pressure_kpa=design.build.pressure_kpa,
        mass_g=mass_g,
    )


ANCHORING_NOTE = (
    "Force of all leaf pouches over that of one pouch without any turn: the sum of e^(mu gamma) "
    "over the leaves that hold, gamma the turn at contacts and hinges on the way (equations 1 and "
    "2 of the paper). Which leaves hold is not known beforehand: of six branches in the paper's "
    "test one touched nothing and one hung slack. The friction of film on the obstacles is "
    "assumed, 0.2 to 0.8; measure yours."
)


def anchoring_section(anchoring: Sequence[AnchoringPrediction]) -> Section:
    """Return anchoring amplification by friction and engaged leaves, and forces where known."""
    tables = [_amplification_table(holding) for holding in anchoring]
    tables += [
        _force_table(holding.label, holding.forces) for holding in anchoring if holding.forces
    ]
    without = () if anchoring[0].forces else (
        "The design has no pouches, so forces in newtons are not predicted.",
    )  # fmt: skip
    return Section(title="Anchoring", paragraphs=(ANCHORING_NOTE, *without), tables=tuple(tables))


def _amplification_table(holding: AnchoringPrediction) -> Table:
    frictions = sorted({held.friction for held in holding.table})
    shares = sorted({held.engaged_percent for held in holding.table}, reverse=True)
    rows = tuple(
        (
            f"{share:g} % of the leaves hold",
            *(f"{holding.at(friction, share):.2f}" for friction in frictions),
        )
        for share in shares
    )
    return Table(
        caption=f"Mean amplification on {holding.label}, {holding.leaves} leaves, those that "
        "turned least hold first (simulated paths, assumed friction)",
        headings=("engaged", *(f"friction {friction:g}" for friction in frictions)),
        rows=rows,
    )


def _force_table(label: str, forces: Forces) -> Table:
    rows = []
    for index, friction in enumerate(forces.friction.tolist()):
        cells = (forces.mean_n[index], forces.p05_n[index], forces.p95_n[index])
        over = payload_over_mass(cells[0], forces.mass_g) if forces.mass_g else None
        ratio = "-" if over is None else f"{over:.0f}"
        rows.append((f"{friction:g}", *(f"{value:.2f}" for value in cells), ratio))
    return Table(
        caption=f"Force on {label} at {forces.pressure_kpa:g} kPa: {forces.engaged_percent:.1f} % "
        "of the leaves end in a gap narrower than their inflated pouch, and only those hold; "
        f"{forces.limited_percent:.1f} % of them are limited by film or seam at the highest "
        "friction (simulated paths, computed contact, assumed friction)",
        headings=("friction", "mean N", "5 % N", "95 % N", "times its own mass"),
        rows=tuple(rows),
    )
