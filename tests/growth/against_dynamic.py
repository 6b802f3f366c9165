"""Vines among boxes: the growth model and its knee experiment against a dynamic chain.

``python tests/growth/against_dynamic.py SIDE_MM FIRST LAST HEADINGS [FOLDER] [NAME=VALUE ...]``
grows a vine of 1200 mm at some headings from 45 to 135 degrees on maps FIRST to LAST of 20 boxes,
and prints one row per heading and the sums. With a folder, pictures; with names and values, another
chain (fields of ``Vine``). What came out, and what follows, is in docs/studies/knee.md.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from dynamic import Arena, Floats, Vine, arena_of, grow_chain, start_of, vine_of
from knee import KneeBranch, Push, TurningBranch, grow_with_rule

from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Build, Design

LENGTH_MM = 1200.0
WIDTH_MM = 20.0
STATIONS = 241
TOUCH_MM = 1.0


class Case(NamedTuple):
    """One heading: what each model says, as joints from base to tip."""

    seed: int
    heading_deg: float
    stop: Stop
    push_n: float  # that the dynamic chain needed at most
    dynamic: Floats
    stopped: Floats
    shifted: Floats  # dynamic, from a start 1 mm aside: how sure the comparison itself is
    knees: list[KneeBranch]  # both sides
    turns: list[KneeBranch]
    follows: bool = False  # the dynamic chain passes the boxes where the growth model does


def points_of(branch: KneeBranch) -> Floats:
    chain = np.array([*branch.pivots, branch.tip])
    return np.column_stack([chain.real, chain.imag])


def length_mm(chain: Floats) -> float:
    return float(np.hypot(*np.diff(chain, axis=0).T).sum())


def stations(chain: Floats) -> Floats:
    """Return points at equal steps of the planned length; beyond the tip, the tip."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(chain, axis=0).T))])
    at = np.linspace(0.0, LENGTH_MM, STATIONS)
    return np.column_stack([np.interp(at, along, chain[:, k]) for k in range(2)])


def errors(one: Floats, other: Floats) -> tuple[float, float]:
    """Return the distance of the tips (mm), and of the shapes (mean, as a share of the length)."""
    apart = np.hypot(*(stations(one) - stations(other)).T)
    return float(apart[-1]), float(apart.mean() / LENGTH_MM)


def contacts(arena: Arena, chain: Floats) -> list[str]:
    """Return what a body touches, from base to tip: numbers of boxes, sides of the arena."""
    radius_mm = vine_of(WIDTH_MM).radius_mm
    fine = stations(chain)
    near: list[tuple[int, str]] = []
    for number, one in enumerate(arena.boxes):
        turned = (fine - [one.x_mm, one.y_mm]) @ rotation(one.turn_rad)
        outside = np.maximum(np.abs(turned) - [one.half_width_mm, one.half_height_mm], 0.0)
        near += first_touch(np.hypot(*outside.T) - radius_mm, str(number))
    for k, names in enumerate(("WE", "SN")):
        near += first_touch(fine[:, k] - radius_mm, names[0])
        near += first_touch(arena.side_mm - fine[:, k] - radius_mm, names[1])
    return [name for _, name in sorted(near)]


def rotation(turn_rad: float) -> Floats:
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    return np.array([[c, -s], [s, c]])


def first_touch(gap_mm: Floats, name: str) -> list[tuple[int, str]]:
    touching = np.flatnonzero(gap_mm[1:] <= TOUCH_MM)
    return [(int(touching[0]), name)] if len(touching) else []


def case_of(arena: Arena, terrain: Terrain, seed: int, heading_deg: float, chain: Vine) -> Case:
    pose = start_of(arena.side_mm, heading_deg)
    vine = Design(name="vine", trunk_length_mm=LENGTH_MM, build=Build.standard(1, WIDTH_MM))
    grown = grow_on(vine, terrain, pose, GrowthOptions(body="inflated"))
    push, aside = Push(WIDTH_MM), replace(pose, x_mm=pose.x_mm + 1.0)
    knees, turns = (
        [grow_with_rule(rule, terrain, pose, LENGTH_MM, push, side) for side in (1, -1)]
        for rule in (KneeBranch, TurningBranch)
    )
    forced = grow_chain(arena, pose, LENGTH_MM, chain)
    return Case(
        push_n=forced.push_n,
        seed=seed,
        heading_deg=heading_deg,
        stop=Stop(int(grown.stop[0])),
        dynamic=forced.points_mm,
        stopped=np.asarray(grown.chain_mm(0)),
        shifted=grow_chain(arena, aside, LENGTH_MM, chain).points_mm,
        knees=knees,
        turns=turns,
    )


def row(arena: Arena, case: Case) -> str:
    """Return a heading, its stop; tip and shape error of each rule; the orders of contacts."""
    cells = [
        f"{case.seed} {case.heading_deg:5.1f} {case.stop.name:12s} {length_mm(case.stopped):5.0f}"
    ]
    cells.append(f"{case.push_n:5.2f} N {'same' if case.follows else 'other'}")
    cells += [cell(chain, case) for chain in (case.shifted, case.stopped)]
    for branch in (*case.knees, *case.turns):
        ended = "-" if branch.stop is None else branch.stop.name
        chain = points_of(branch)
        cells.append(f"{ended:11s} {branch.folds:2d} {length_mm(chain):5.0f} {cell(chain, case)}")
    orders = (case.dynamic, case.stopped, points_of(case.knees[0]), points_of(case.turns[0]))
    cells += [">".join(contacts(arena, chain)) for chain in orders]
    return " | ".join(cells)


def cell(chain: Floats, case: Case) -> str:
    tip, shape = errors(chain, case.dynamic)
    return f"{tip:4.0f} {100 * shape:5.1f}"


def draw(arena: Arena, cases: list[Case], path: Path) -> None:
    import matplotlib as mpl  # noqa: PLC0415  seldom needed

    mpl.use("Agg")
    from matplotlib import pyplot as plt  # noqa: PLC0415

    figure, axes = plt.subplots(4, 5, figsize=(25, 20))
    for ax, case in zip(axes.ravel(), cases, strict=False):
        for one in arena.boxes:
            ax.fill(*one.polygon.exterior.xy, color="0.85")
        ax.plot(*case.dynamic.T, "r")
        for branch in case.knees:
            ax.plot(*points_of(branch).T, "0.6", linewidth=0.7)
        for branch, colour in zip(case.turns, "gm", strict=True):
            ax.plot(*points_of(branch).T, colour + ".-")
        ax.plot(*case.stopped.T, "b.-")
        ax.set(xlim=(0, arena.side_mm), ylim=(0, arena.side_mm), aspect="equal")
        ax.set_title(f"{case.heading_deg} deg, {case.stop.name}")
    figure.tight_layout()
    figure.savefig(path, dpi=50)
    plt.close(figure)


def mean_and_median(values: list[float]) -> str:
    return f"mean {np.mean(values):6.1f} median {np.median(values):6.1f}"


def follows(arena: Arena, case: Case) -> bool:
    """Tell whether the dynamic chain has passed all boxes where the growth model did.

    As far as that grew: no box lies between the two bodies.
    """
    grown = round(length_mm(case.stopped) / LENGTH_MM * (STATIONS - 1)) + 1
    one, other = (stations(chain)[:grown] for chain in (case.stopped, case.dynamic))
    loop = np.concatenate([one, other[::-1], one[:1]]) @ [1.0, 1.0j]
    for box in arena.boxes:
        seen = loop - complex(box.x_mm, box.y_mm)
        if abs(np.angle(seen[1:] / seen[:-1]).sum()) > 1.0:
            return False
    return True


def summary(cases: list[Case], name: str) -> list[str]:
    lines = [f"{name}: {len(cases)} headings"]
    if not cases:
        return lines
    stop = errors_of(cases, lambda case: [case.stopped])
    rules = {"stop": stop, "dynamic, 1 mm aside": errors_of(cases, lambda case: [case.shifted])}
    for rule in ("knees", "turns"):
        rules[f"{rule}, mean of sides"] = errors_of(cases, sides_of(rule))
        rules[f"{rule}, better side"] = errors_of(cases, sides_of(rule), np.min)
    for rule, error in rules.items():
        tip, shape = mean_and_median(error[:, 0]), mean_and_median(100 * error[:, 1])
        wins, losses = (error[:, 1] < stop[:, 1]).sum(), (error[:, 1] > stop[:, 1]).sum()
        lines.append(f"  {rule:20s} tip {tip}  shape % {shape}  nearer {wins} farther {losses}")
    push = [case.push_n for case in cases]
    lines.append(
        f"  push of the dynamic chain: median {np.median(push):.2f} N, most {max(push):.2f} N"
    )
    return lines


def sides_of(rule: str) -> Callable[[Case], list[Floats]]:
    return lambda case: [points_of(branch) for branch in getattr(case, rule)]


def errors_of(
    cases: list[Case], chains: Callable[[Case], list[Floats]], over: Callable[..., Floats] = np.mean
) -> Floats:
    """Return tip distance and shape error of each case, over the sides of a rule."""
    return np.array(
        [over([errors(chain, case.dynamic) for chain in chains(case)], axis=0) for case in cases]
    )


def main() -> int:
    """Print rows and sums."""
    side_mm, first, last, headings = float(sys.argv[1]), *(int(word) for word in sys.argv[2:5])
    changes = dict(word.split("=") for word in sys.argv[5:] if "=" in word)
    chain = vine_of(WIDTH_MM, **{name: float(value) for name, value in changes.items()})
    folder = next((Path(word) for word in sys.argv[5:] if "=" not in word), None)
    cases: list[Case] = []
    for seed in range(first, last + 1):
        arena = arena_of(seed, side_mm)
        terrain = Terrain.of(arena.map())
        for heading_deg in np.linspace(45.0, 135.0, headings).tolist():
            case = case_of(arena, terrain, seed, heading_deg, chain)
            cases.append(case._replace(follows=follows(arena, case)))
            sys.stdout.write(row(arena, cases[-1]) + "\n")
            sys.stdout.flush()
        if folder is not None:
            draw(arena, cases[-headings:], folder / f"boxes{side_mm:.0f}_{seed}.png")
    full = [case for case in cases if case.stop is Stop.FULL_LENGTH]
    stuck = [case for case in cases if case.stop is not Stop.FULL_LENGTH]
    same = [case for case in stuck if case.follows]
    other = [case for case in stuck if not case.follows]
    lines = [*summary(full, "full length"), *summary(stuck, "stopped")]
    lines += summary(same, "stopped, same path until then")
    lines += summary(other, "stopped, another path before")
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
