"""Make the joints table that ships: ``python tests/inflation/make_table.py rows.jsonl``.

Simulated joints are appended to a file, so that the work may stop and go on. With ``--fit`` the
table is made from all rows, with ``--compare 500`` its errors are found by direct simulations.
"""

import argparse
import io
import json
import math
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import cho_solve
from scipy.optimize import minimize
from scipy.stats import qmc

from vinefab.core.errors import VinefabError
from vinefab.core.validation import Floats
from vinefab.inflation.compensation import FlatJoint
from vinefab.inflation.joint import JointShape, inflated_joint
from vinefab.inflation.table import (
    CHILDREN,
    FILLET,
    PATH,
    RATIO,
    STRAIN,
    JointRows,
    Process,
    Scales,
    fan_table,
    figure_groups,
    scaled,
    simulation_fingerprint,
)

SHARES = (1, 3, 3, 4, 3)
"""Of the simulations, for so many children."""

FAN_DEG = {1: (0.0, 0.0), 2: (18.0, 220.0), 3: (30.0, 220.0), 4: (44.0, 220.0), 5: (60.0, 220.0)}
"""Flat fans."""

EVEN_ROWS = {1: 1 << 30, 2: 1 << 30, 3: 1 << 30, 4: 120, 5: 60}
"""So many flat fans are even; the others are those that deploy evenly by what these tell."""

_REFITTED = 25  # rows after which the fans that deploy evenly are fitted again

Row = dict[str, Any]


def sampled(children: int, count: int) -> list[JointShape]:
    """Return flat joints that fill the table's ranges evenly, the same at every call."""
    points = qmc.Sobol(4, seed=children).random(1 << (count - 1).bit_length())
    low, high = FAN_DEG[children]

    def log(ends: tuple[float, float], share: float) -> float:
        return float(f"{ends[0] * (ends[1] / ends[0]) ** share:.4g}")

    return [
        JointShape.fan(
            children,
            round(low + (high - low) * float(a) ** 1.25, 3),
            width=round(RATIO[0] + (RATIO[1] - RATIO[0]) * float(b), 4),
            fillet=log(FILLET, float(c)),
            hoop_strain=log(STRAIN, float(d)),
        )
        for a, b, c, d in points[:count]
    ]


def row_of(flat: JointShape) -> Row:
    """Return what becomes of a flat fan."""
    row: Row = {
        "children": len(flat.angles_deg),
        "cut_deg": flat.angles_deg,
        "ratio": flat.widths[0],
        "fillet": flat.fillets[0],
        "strain": flat.hoop_strain,
    }
    try:
        figures = FlatJoint.of(inflated_joint(flat))
    except VinefabError as error:
        return row | {"failed": str(error)[:120]}
    return row | {
        "deployed_deg": np.round(figures.deployed_deg, 4).tolist(),
        "pull_backs": np.round(figures.pull_backs, 5).tolist(),
        "side_offsets": np.round(figures.side_offsets, 5).tolist(),
        "sensitivity": round(figures.sensitivity, 4),
        "crotch_load": round(figures.crotch_load, 4),
        "passage": round(figures.passage, 4),
    }


def table_of(rows: list[Row], children: int) -> Floats:
    """Return the array of the rows of so many children; see `JointRows`."""
    half = children // 2

    def left(values: list[float], count: int = half) -> list[float]:
        return values[::-1][:count]

    return np.array(
        [
            [
                *(row["ratio"], row["fillet"], row["strain"]),
                *(left(row["cut_deg"]) + left(row["deployed_deg"])),
                *(left(row["pull_backs"], (children + 1) // 2) + left(row["side_offsets"])),
                *(math.log(row["sensitivity"]), math.log(row["crotch_load"]), row["passage"]),
            ]
            for row in rows
            if row["children"] == children and "failed" not in row
        ]
    )


def left_out(process: Process) -> Floats:
    """Return by how much each row differs from what the others say, shape (n, quantities)."""
    inverse = cho_solve((process.factor, True), np.eye(len(process.factor)))
    return process.weights / np.diag(inverse)[:, None]


def log_likelihood(process: Process) -> float:
    """Return how likely the rows are, each quantity's amplitude being what fits best."""
    count = len(process.factor)
    rest = process.factor @ (process.factor.T @ process.weights)
    variance = (rest * process.weights).sum(axis=0) / count + 1e-12
    logs = np.log(np.diag(process.factor)).sum()
    return float(-0.5 * count * np.log(variance).sum() - logs * len(variance))


def fitted(x: Floats, y: Floats) -> Scales:
    """Return the likeliest scales of some rows."""
    usual = np.log([0.8, 0.8, 0.8, 0.8, 0.05])

    def at(logs: Floats) -> Scales:
        return Scales(lengths=np.exp(logs[:4]), noise=float(np.exp(logs[4])))

    def cost(logs: Floats) -> float:
        return -log_likelihood(Process(x, y, at(logs))) + 0.05 * float(((logs - usual) ** 2).sum())

    bounds = [(-2.0, 2.0)] * 4 + [(-4.5, 0.0)]
    return at(minimize(cost, usual, method="L-BFGS-B", bounds=bounds).x)


class _Compensator:
    """Flat fans of many children that deploy nearly evenly, by the rows of even flat fans."""

    def __init__(self, rows: list[Row], children: int) -> None:
        known = JointRows.of(children, table_of(rows, children))
        self._even = known.even
        x, y = known.deployment
        self._deployed = Process(x, y, fitted(x, y))
        x, y = known.compensation
        self._flat = Process(x, y, fitted(x, y))

    def __call__(self, joint: JointShape) -> JointShape | None:
        place = np.array([[joint.widths[0], joint.fillets[0], joint.hoop_strain]])
        flat_fan = joint.angles_deg[-1] - joint.angles_deg[0]
        outer = flat_fan / 2.0 + float(self._deployed(scaled(np.array([flat_fan]), place))[0, 0])
        if outer < 1.3 * (len(joint.angles_deg) - 1):
            return None
        fan = np.array([2.0 * outer])
        left = (fan * self._even + self._flat(scaled(fan, place))[0]).round(3).tolist()
        middle = [0.0] * (len(joint.angles_deg) % 2)
        angles = [*(-angle for angle in left), *middle, *reversed(left)]
        if any(two - one < 5.0 for one, two in pairwise(angles)):
            return None
        return joint.with_angles(tuple(angles))


def simulate(path: Path, rounds: int, seconds: float) -> None:
    """Append rows of the joints that a file lacks."""
    rows = _read(path)
    known = {(row["children"], row["number"]) for row in rows}
    joints = {n: sampled(n, rounds * share) for n, share in zip(CHILDREN, SHARES, strict=True)}
    compensators: dict[int, _Compensator] = {}
    end = time.monotonic() + seconds
    for turn in range(rounds):
        for n, share in zip(CHILDREN, SHARES, strict=True):
            for number in range(turn * share, (turn + 1) * share):
                if (n, number) in known:
                    continue
                flat: JointShape | None = joints[n][number]
                if number >= EVEN_ROWS[n]:
                    if n not in compensators or number % _REFITTED == 0:
                        compensators[n] = _Compensator(_read(path), n)
                    flat = compensators[n](joints[n][number])
                if flat is None:
                    continue
                row = row_of(flat) | {"number": number}
                with path.open("a") as file:
                    file.write(json.dumps(row) + "\n")
                if time.monotonic() > end:
                    return


def _read(path: Path) -> list[Row]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def fit(rows: list[Row], path: Path, bounds: Floats) -> None:
    """Write the table of some rows.

    Parameters
    ----------
    bounds
        Largest and typical error in degrees and number of joints compared: of compensation, of
        deployment.
    """
    arrays: dict[str, Any] = {"fingerprint": simulation_fingerprint(), "bounds": bounds}
    for n in CHILDREN:
        table = table_of(rows, n)
        known = JointRows.of(n, table)
        x, kept = scaled(known.deployed_fan_deg, known.places)[known.is_open], known.is_open
        data = [known.compensation, known.deployment]
        data += [(x, known.figures[kept, columns]) for columns in figure_groups(n)]
        scales = [fitted(*one) for one in data]
        arrays[f"rows_{n}"] = table.astype(np.float32)
        arrays[f"scales_{n}"] = np.array([[*one.lengths, one.noise] for one in scales])
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    path.write_bytes(buffer.getvalue())


def drawn_joints(count: int) -> list[JointShape]:
    """Return joints of random designs of the paper's Table 1, as recipes may have them."""
    random = np.random.default_rng(32)
    joints: list[JointShape] = []
    while len(joints) < count:
        width_mm, ratio = random.uniform(12.0, 60.0), random.uniform(0.35, 1.0)
        radius_mm = max(2.0, ratio * width_mm / 4.0)
        joints.append(
            JointShape.fan(
                int(random.integers(2, 5)),
                round(float(random.uniform(20.0, 160.0)), 2),
                width=round(float(ratio), 4),
                fillet=round(float(radius_mm / width_mm), 3),
                hoop_strain=float(
                    f"{math.exp(random.uniform(math.log(0.002), math.log(0.3))):.2g}"
                ),
            )
        )
    return joints


def compared(count: int, seconds: float) -> tuple[Floats, list[str]]:
    """Return the table's errors against direct simulation, for `fit`, and a line for each joint."""
    end, lines = time.monotonic() + seconds, []
    errors: tuple[list[float], list[float]] = ([], [])
    for number, joint in enumerate(drawn_joints(count)):
        children = len(joint.angles_deg)
        fan_deg = joint.angles_deg[-1] - joint.angles_deg[0]
        place = (joint.widths[0], joint.fillets[0], joint.hoop_strain)
        table = fan_table(children)
        assert table is not None
        ways = (table.compensated(fan_deg, place), table.deployed(fan_deg, place))
        for way, (fan, found) in enumerate(zip(ways, errors, strict=True)):
            name = f"{('compensated', 'deployed')[way]} {children} {fan_deg} {place}"
            if way == 1 and number % 3:
                continue
            if fan is None:
                lines.append(f"{name}: not by the table")
                continue
            try:
                direct = FlatJoint.of(inflated_joint(joint.with_angles(fan.flat_deg)))
            except VinefabError as error:
                lines.append(f"{name}: {error}")
                continue
            found.append(float(np.abs(np.subtract(direct.deployed_deg, fan.deployed_deg)).max()))
            back = float(np.abs(np.subtract(direct.pull_backs, fan.pull_backs)).max())
            lines.append(
                f"{name}: {found[-1]:.2f} deg, {back:.4f} W, sensitivity {direct.sensitivity:.1f} "
                f"({fan.sensitivity:.1f}), load {direct.crotch_load:.2f} ({fan.crotch_load:.2f}), "
                f"passage {direct.passage:.2f} ({fan.passage:.2f})"
            )
        if time.monotonic() > end:
            break
    bounds = [(max(one), float(np.sqrt(np.mean(np.square(one)))), len(one)) for one in errors]
    return np.array(bounds), lines


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path)
    parser.add_argument("--rounds", type=int, default=150)
    parser.add_argument("--seconds", type=float, default=1e9, help="for simulations")
    parser.add_argument("--fit", action="store_true", help="make the table from all rows")
    parser.add_argument("--compare", type=int, default=0, help="joints simulated for its bounds")
    options = parser.parse_args()
    if not options.fit:
        simulate(options.rows, options.rounds, options.seconds)
        return
    rows = _read(options.rows)
    fit(rows, PATH, np.zeros((2, 3)))
    if options.compare:
        bounds, lines = compared(options.compare, options.seconds)
        fit(rows, PATH, bounds)
        sys.stdout.write("\n".join([*lines, str(bounds)]) + "\n")


if __name__ == "__main__":
    main()
