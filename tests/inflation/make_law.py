"""Make the law of joints that ships: ``python tests/inflation/make_law.py rows.jsonl``.

Simulated joints are appended to a file, so that the work may stop and go on. With ``--fit`` the law
is fitted to six of seven rows, and its errors are those at the others within its range.
"""

import argparse
import io
import json
import math
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from vinefab.core.errors import VinefabError
from vinefab.core.validation import Floats, Ints
from vinefab.inflation.compensation import likely_flat_deg
from vinefab.inflation.joint import JointShape, inflated_joint
from vinefab.inflation.law import (
    ARRAYS,
    INPUTS,
    LEAST_GAP_DEG,
    MOST_ANGLE_DEG,
    MOST_CHILDREN,
    OUTPUTS,
    PATH,
    Joints,
    Network,
    Way,
    inputs,
    law_of,
    mirrored,
)
from vinefab.inflation.membrane import Bools
from vinefab.inflation.table import simulation_fingerprint

Row = dict[str, Any]

FIRST = 5340
"""Joints drawn blindly; later ones deploy, by the law, with children apart: three or four."""

KINDS = (0, 1, 2, 2, 3, 3, 3, 4, 4, 4)
"""Children of ten joints that follow each other; 0: a bend."""


def _log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return math.exp(random.uniform(math.log(low), math.log(high)))


def _angles_deg(random: np.random.Generator, count: int, outer: float, gap: float) -> Floats:
    """Return angles of so many children within an outer one, with a least gap between them."""
    room = 2.0 * outer - gap * (count - 1)
    return np.sort(random.uniform(0.0, room, count)) + gap * np.arange(count) - outer


def _fillets(random: np.random.Generator, widths: Floats) -> Floats:
    """Return the fillet radius in each gap."""
    if random.uniform() < 0.5:  # as designs have them unless they say otherwise
        least = random.uniform(0.03, 0.17)
        own = np.maximum(widths / 4.0, least)
    elif random.uniform() < 0.5:
        own = np.full(len(widths), _log_uniform(random, 0.04, 0.5))
    else:
        own = np.array([_log_uniform(random, 0.04, 0.5) for _ in widths])
    gaps = np.concatenate([own[:1], np.minimum(own[:-1], own[1:]), own[-1:]])
    if random.uniform() < 0.25:  # where branches are short there is less room
        gaps *= np.where(random.uniform(size=len(gaps)) < 0.4, random.uniform(0.4, 1.0), 1.0)
    return np.clip(gaps, 0.04, 0.5)


def drawn_joint(number: int) -> JointShape:
    """Return a flat joint to learn from, the same at every call."""
    random = np.random.default_rng([45, number])
    kind = KINDS[number % len(KINDS)] if number < FIRST else 3 + int(number % 3 > 0)
    count = max(kind, 1)
    if random.uniform() < 0.2:
        widths = np.full(count, random.uniform(0.38, 1.02))
    else:
        widths = random.uniform(0.38, 1.02, count)
    if kind == 0:
        widths = np.ones(1)
    outer = random.uniform(max(35.0, 12.0 * (count - 1)), 125.0)
    if random.uniform() < 0.3:  # flat gaps from 14 degrees on
        flat = _angles_deg(random, count, outer, 14.0)
    else:  # deployed ones, about
        wanted = _angles_deg(random, count, outer, 12.0)
        flat = likely_flat_deg(wanted) if kind else wanted
        flat = flat + random.normal(0.0, 3.0, count)
    fillets = _fillets(random, widths)
    if kind == 0:
        fillets[:] = fillets.min()
    strain = float(f"{_log_uniform(random, 0.0019, 0.31):.4g}")
    if number >= FIRST:
        outer = random.uniform(max(45.0, 9.0 * (count - 1)), 112.0)
        wanted = _angles_deg(random, count, outer, 14.0)
        aimed = JointShape(
            angles_deg=tuple(wanted.tolist()),
            widths=tuple(widths.tolist()),
            fillets=tuple(fillets.tolist()),
            hoop_strain=strain,
        )
        told = law_of("flat", Joints.of([aimed]))
        assert told is not None
        flat = told.angles_deg[0, :count] + random.normal(0.0, 1.5, count)
    return JointShape(
        angles_deg=tuple(np.round(flat, 3).tolist()),
        widths=tuple(np.round(widths, 4).tolist()),
        fillets=tuple(np.round(fillets, 4).tolist()),
        hoop_strain=strain,
        is_bend=kind == 0,
    )


def row_of(flat: JointShape) -> Row:
    """Return what becomes of a flat joint."""
    row: Row = {
        "cut_deg": flat.angles_deg,
        "widths": flat.widths,
        "fillets": flat.fillets,
        "strain": flat.hoop_strain,
        "is_bend": flat.is_bend,
    }
    try:
        found = inflated_joint(flat)
        slopes, loads, passages = found.sensitivity(), found.gap_loads, found.passages
    except VinefabError as error:
        return row | {"failed": str(error)[:120]}
    return row | {
        "deployed_deg": np.round(found.angles_deg, 4).tolist(),
        "slopes": np.round(slopes, 4).tolist(),
        "pull_backs": np.round(found.pull_backs, 5).tolist(),
        "side_offsets": np.round(found.side_offsets, 5).tolist(),
        "gap_loads": np.round(loads, 4).tolist(),
        "passages": np.round(passages, 4).tolist(),
    }


def simulate(path: Path, count: int, seconds: float) -> None:
    """Append rows of the joints that a file lacks."""
    known = {row["number"] for row in read(path)}
    end = time.monotonic() + seconds
    for number in range(count):
        if number not in known:
            try:
                joint = drawn_joint(number)
            except VinefabError:  # angles that cross
                continue
            row = row_of(joint) | {"number": number}
            with path.open("a") as file:
                file.write(json.dumps(row) + "\n")
        if time.monotonic() > end:
            return


def read(path: Path) -> list[Row]:
    """Return the rows of a file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


# --- The fit -----------------------------------------------------------------------------------

UNITS, STEPS, SMALL = 40, 2500, 5e-8
"""Of a layer of the network; of the fit, at most; how much large coefficients cost."""

SCALES = np.array([10.0, 0.1, 0.1, 0.1, 0.3], dtype=np.float32)
"""Of the outputs."""

BENDING = np.array([0.15, 0.3, 0.3, 0.3, 0.3], dtype=np.float32)
"""Scaled errors beyond which they count linearly: siblings that collapse have large ones."""

LEFT_OUT = 7
"""Of so many rows one is left out of the fit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Campaign:
    """Simulated joints as arrays; what lies beyond a joint's children is 0."""

    flat: Joints
    deployed_deg: Floats  # shape (m, 4)
    slopes: Floats  # d deployed / d flat, shape (m, 4, 4)
    lengths: Floats  # side offset, pull-back, passage, logarithm of crotch load, shape (m, 4, 4)
    is_fitted: Bools  # whether a row is not left out, shape (m,)

    @classmethod
    def of(cls, rows: list[Row]) -> "Campaign":
        """Return the rows that did not fail."""
        rows = [row for row in rows if "failed" not in row]
        joints = [
            JointShape(
                angles_deg=tuple(row["cut_deg"]),
                widths=tuple(row["widths"]),
                fillets=tuple(row["fillets"]),
                hoop_strain=row["strain"],
                is_bend=row["is_bend"],
            )
            for row in rows
        ]
        flat = Joints.of(joints)
        shape = (len(rows), MOST_CHILDREN)
        deployed, slopes, lengths = np.zeros(shape), np.zeros((*shape, 4)), np.zeros((*shape, 4))
        for k, row in enumerate(rows):
            n = int(flat.count[k])
            deployed[k, :n], slopes[k, :n, :n] = row["deployed_deg"], row["slopes"]
            loads = np.array(row["gap_loads"])
            if n > 1:
                loads[[0, -1]] = 0.0
            worst = np.log(np.maximum(loads[:-1], loads[1:]))
            own = row["side_offsets"], row["pull_backs"], row["passages"], worst
            lengths[k, :n] = np.column_stack(own)
        return cls(
            flat=flat,
            deployed_deg=deployed,
            slopes=slopes,
            lengths=lengths,
            is_fitted=np.array([row["number"] % LEFT_OUT != 3 for row in rows]),
        )

    def least_gap_deg(self, angles_deg: Floats) -> Floats:
        """Return the least angle between two children of each joint, shape (m,)."""
        gaps = np.diff(angles_deg, axis=1)
        there = np.arange(1, MOST_CHILDREN) < self.flat.count[:, None]
        found: Floats = np.where(there, gaps, 360.0).min(axis=1)
        return found

    def data(self, way: Way, turned: np.random.Generator | None = None) -> "Data":
        """Return what the children of all joints say; of slightly turned joints, if asked for.

        Those follow from the slopes, and say nothing but angles.
        """
        flat, deployed = self.flat.angles_deg, self.deployed_deg
        if turned is not None:
            there = np.arange(MOST_CHILDREN) < self.flat.count[:, None]
            by = turned.normal(size=flat.shape) * 2.5 * there
            flat = flat + by
            deployed = deployed + np.einsum("kij,kj->ki", self.slopes, by)
        told = replace(self.flat, angles_deg=deployed if way == "flat" else flat)
        x, row, child = inputs(told)
        wanted = np.column_stack([(deployed - flat)[row, child], self.lengths[row, child]])
        weight = np.ones_like(wanted)
        weight[:, 1:] = 0.4 if turned is None else 0.0
        gap = self.least_gap_deg(self.deployed_deg)[row]
        weight *= np.clip((gap + 25.0) / 40.0, 0.1, 1.0)[:, None]
        if turned is not None:
            weight *= 0.5
        return Data(x=x, wanted=wanted, weight=weight, row=row)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Data:
    """Children: inputs, outputs, how much they count, and the joint that each is of."""

    x: Floats
    wanted: Floats
    weight: Floats
    row: Ints

    def of(self, kept: Bools) -> "Data":
        """Return the children of some joints."""
        some = kept[self.row]
        return Data(
            x=self.x[some],
            wanted=self.wanted[some],
            weight=self.weight[some],
            row=self.row[some],
        )


def fitted(data: list[Data]) -> Network:
    """Return the network that tells most of some data, the same at every call."""
    x = np.concatenate([one.x for one in data])
    wanted = (np.concatenate([one.wanted for one in data]) / SCALES).astype(np.float32)
    weight = np.concatenate([one.weight for one in data])
    weight = (weight / weight.sum(axis=0)).astype(np.float32)
    both = np.concatenate([x, mirrored(x)])
    both = np.column_stack([both, np.ones(len(both))]).astype(np.float32)
    sign, n, k = np.where(np.arange(OUTPUTS) < 2, -1.0, 1.0).astype(np.float32), len(x), UNITS
    parts = np.cumsum([(INPUTS + 1) * k, (k + 1) * k])

    def layers(values: Floats) -> tuple[Floats, Floats, Floats]:
        one, two, three = np.split(values, parts)
        return one.reshape(-1, k), two.reshape(-1, k), three.reshape(-1, OUTPUTS)

    def cost(values: Floats) -> tuple[float, Floats]:
        first, second, last = layers(values.astype(np.float32))
        z1 = both @ first
        slope1 = 1.0 / np.sqrt(1.0 + z1 * z1)
        h1 = z1 * slope1
        z2 = h1 @ second[:-1] + second[-1]
        slope2 = 1.0 / np.sqrt(1.0 + z2 * z2)
        h2 = z2 * slope2
        out = h2 @ last[:-1] + last[-1]
        off = (out[:n] + sign * out[n:]) / 2.0 - wanted
        far = np.sqrt(1.0 + (off / BENDING) ** 2)
        total = 2.0 * float((weight * BENDING**2 * (far - 1.0)).sum())
        pull = weight * off / far
        pull = np.concatenate([pull, pull * sign])
        pull2 = (pull @ last[:-1].T) * slope2**3
        pull1 = (pull2 @ second[:-1].T) * slope1**3
        slopes = [
            both.T @ pull1,
            *(h1.T @ pull2, pull2.sum(axis=0)),
            *(h2.T @ pull, pull.sum(axis=0)),
        ]
        gradient = np.concatenate([one.ravel() for one in slopes]).astype(np.float64)
        return total + SMALL * float(values @ values), gradient + 2.0 * SMALL * values

    random = np.random.default_rng(0)
    start = np.concatenate(
        [
            0.4 * random.normal(size=(INPUTS + 1) * k),
            random.normal(size=(k + 1) * k) / math.sqrt(k),
            0.1 * random.normal(size=(k + 1) * OUTPUTS) / math.sqrt(k),
        ]
    )
    options = {"maxiter": STEPS, "maxfun": 2 * STEPS, "maxcor": 20}
    found = minimize(cost, start, jac=True, method="L-BFGS-B", options=options)
    first, second, last = layers(found.x)
    return Network(first=first, second=second, last=last * SCALES)


def errors(way: Way, campaign: Campaign, net: Network) -> tuple[Floats, Data]:
    """Return errors of the rows left out that are within the law's range, and these rows."""
    told = campaign.deployed_deg if way == "flat" else campaign.flat.angles_deg
    kept = (campaign.least_gap_deg(told) >= LEAST_GAP_DEG) & ~campaign.is_fitted
    # Siblings that deploy through each other are no joint.
    kept &= (campaign.least_gap_deg(campaign.deployed_deg) > 0.0) & (
        np.abs(told).max(axis=1) <= MOST_ANGLE_DEG
    )
    data = campaign.data(way).of(kept)
    return np.abs(net(data.x) - data.wanted), data


def fit(rows: list[Row], path: Path) -> list[str]:
    """Write the law of some rows; return its errors in lines."""
    campaign, lines = Campaign.of(rows), list[str]()
    arrays: dict[str, Any] = {"fingerprint": simulation_fingerprint()}
    for way, least_deg in WAYS.items():
        kept = campaign.least_gap_deg(campaign.deployed_deg) > least_deg
        kept &= campaign.is_fitted
        random = np.random.default_rng(0)
        net = fitted([campaign.data(way).of(kept), campaign.data(way, random).of(kept)])
        single = {name: getattr(net, name).astype(np.float32) for name in ARRAYS}
        found, data = errors(way, campaign, Network(**single))
        worst = np.zeros(len(campaign.is_fitted))
        np.maximum.at(worst, data.row, found[:, 0])
        for kind in ("all", "bends", 1, 2, 3, 4):
            own = np.zeros(len(worst), dtype=np.bool_)
            own[data.row] = True
            if kind != "all":
                bends = campaign.flat.is_bend
                own &= bends if kind == "bends" else ~bends & (campaign.flat.count == kind)
            some = worst[own]
            lines.append(
                f"{way} {kind}: {len(some)} joints, worst child {some.mean():.2f} deg in the mean, "
                f"{np.percentile(some, 95):.2f} in 19 of 20, {some.max():.2f} at most"
            )
            if kind == "all":
                arrays[f"{way}_within_deg"] = np.percentile(some, 95)
        means = ", ".join(f"{one:.4f}" for one in found.mean(axis=0))
        most = ", ".join(f"{one:.4f}" for one in np.percentile(found, 95, axis=0))
        lines.append(f"{way}: turn, offset, pull-back, passage, log load: {means}; 95 %: {most}")
        arrays |= {f"{way}_{name}": array for name, array in single.items()}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    path.write_bytes(buffer.getvalue())
    return lines


WAYS: dict[Way, float] = {"flat": 4.0, "deployed": -20.0}
"""What is told, and the least deployed gap of the joints that it is fitted to, in degrees."""


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path)
    parser.add_argument("--joints", type=int, default=5334, help="to simulate")
    parser.add_argument("--seconds", type=float, default=1e9, help="for simulations")
    parser.add_argument("--fit", action="store_true", help="make the law from all rows")
    options = parser.parse_args()
    if options.fit:
        sys.stdout.write("\n".join(fit(read(options.rows), PATH)) + "\n")
    else:
        simulate(options.rows, options.joints, options.seconds)


if __name__ == "__main__":
    main()
