"""Vines among boxes: the growth model against a dynamic chain.

``python tests/growth/against_dynamic.py SIDE_MM FIRST LAST HEADINGS [FOLDER] [NAME=VALUE ...]``
grows a vine of 1200 mm at some headings from 45 to 135 degrees on maps FIRST to LAST of 20 boxes,
and prints one row per heading and the sums. With a folder, pictures; with names and values, another
chain (fields of ``Vine``). What came out, and what follows, is in docs/studies/knee.md.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.growth.dynamic import Arena, Floats, Vine, arena_of, grow_chain, start_of, vine_of
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
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
    follows: bool = False  # the dynamic chain passes the boxes where the growth model does


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
    aside = replace(pose, x_mm=pose.x_mm + 1.0)
    forced = grow_chain(arena, pose, LENGTH_MM, chain)
    return Case(
        push_n=forced.push_n,
        seed=seed,
        heading_deg=heading_deg,
        stop=Stop(int(grown.stop[0])),
        dynamic=forced.points_mm,
        stopped=np.asarray(grown.chain_mm(0)),
        shifted=grow_chain(arena, aside, LENGTH_MM, chain).points_mm,
    )


def row(arena: Arena, case: Case) -> str:
    """Return a heading, its stop; tip and shape error; the orders of contacts."""
    cells = [
        f"{case.seed} {case.heading_deg:5.1f} {case.stop.name:12s} {length_mm(case.stopped):5.0f}"
    ]
    cells.append(f"{case.push_n:5.2f} N {'same' if case.follows else 'other'}")
    cells += [cell(chain, case) for chain in (case.shifted, case.stopped)]
    cells += [">".join(contacts(arena, chain)) for chain in (case.dynamic, case.stopped)]
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


def summary(cases: list[Case], title: str) -> list[str]:
    lines = [f"{title}: {len(cases)} headings"]
    if not cases:
        return lines
    for name, model in (("growth model", "stopped"), ("dynamic, 1 mm aside", "shifted")):
        error = np.array([errors(getattr(case, model), case.dynamic) for case in cases])
        tip, shape = mean_and_median(error[:, 0]), mean_and_median(100 * error[:, 1])
        lines.append(f"  {name:20s} tip {tip}  shape % {shape}")
    push = [case.push_n for case in cases]
    lines.append(
        f"  push of the dynamic chain: median {np.median(push):.2f} N, most {max(push):.2f} N"
    )
    return lines


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
