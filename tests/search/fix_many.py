"""Fix many random designs, and count how many pass the check afterwards.

Run it as a script: ``python tests/search/fix_many.py [HOW_MANY_FAILING [KIND [KEEP]]]``, where
KIND is ``levels``, as in the paper's Table 1, or ``trees`` that are written branch by branch, and
KEEP is what a fix must not change, such as ``branches,length``.
"""

import math
import sys
import time
from dataclasses import dataclass

import numpy as np

from vinefab.core.rng import child
from vinefab.model.design import Branch, Build, Design, Level
from vinefab.model.laser import read_profile
from vinefab.prediction.fix_proposal import propose_fix
from vinefab.search.fix_changes import DesignChange
from vinefab.search.fix_space import parsed_keeps

SEED = 7


@dataclass(frozen=True, kw_only=True)
class Case:
    design: Design
    fixed: Design | None
    changes: tuple[DesignChange, ...]
    webbed: bool  # whether VF-C03 is among the errors
    seconds: float  # of the processor

    @property
    def size(self):
        return math.fsum(change.cost for change in self.changes)


def random_design(rng, deepest=5):
    """Draw levels, lengths, angles, branches and growth from the ranges of Table 1."""
    depth = int(rng.integers(2, deepest + 1))
    levels = tuple(
        Level(
            branches=int(rng.integers(2, 5)),
            length_mm=float(rng.uniform(10.0, 205.0)),
            fan_rad=math.radians(rng.uniform(20.0, 160.0)),
            growth=float(rng.uniform(0.1, 1.6)),
        )
        for _ in range(depth - 1)
    )
    trunk_mm = float(rng.uniform(10.0, 205.0))
    build = Build.standard(depth)
    return Design(name="random", trunk_length_mm=trunk_mm, levels=levels, build=build)


def random_tree(rng, most=25):
    """Draw branches with any angles and lengths, some with bends, on at most five levels."""
    depth, turns, branches = {"trunk": 1}, {"trunk": []}, []
    for number in range(int(rng.integers(4, most + 1))):
        of = str(rng.choice([name for name in depth if depth[name] < 5 and len(turns[name]) < 3]))
        angle_deg = round(float(rng.uniform(-90.0, 90.0)), 1)
        if angle_deg in turns[of]:
            continue
        length_mm = round(float(rng.uniform(40.0, 200.0)), 1)
        bends = [(round(0.5 * length_mm, 1), round(float(rng.uniform(-40.0, 40.0)), 1))]
        name = f"b{number}"
        branches.append(
            Branch(
                name=name,
                of=of,
                angle_deg=angle_deg,
                length_mm=length_mm,
                bends=bends if rng.random() < 0.1 else None,
            )
        )
        turns[of].append(angle_deg)
        depth[name], turns[name] = depth[of] + 1, []
    build = Build.standard(max(depth.values()))
    return Design.of_branches(branches, trunk_length_mm=150.0, build=build, name="random")


def fix_many(count, profile, deepest=5, keep=frozenset(), kind="levels", heard=lambda _: None):
    """Fix the first designs that have errors; a function hears of each case."""
    cases: list[Case] = []
    number = 0
    while len(cases) < count:
        rng = child(SEED, deepest, number)
        design = random_tree(rng) if kind == "trees" else random_design(rng, deepest)
        number += 1
        began = time.process_time()
        found = propose_fix(design, profile, keep=keep)
        if not (errors := {finding.rule for finding in found.before.blocking}):
            continue
        cases.append(
            Case(
                design=design,
                fixed=found.design,
                changes=found.changes,
                webbed="VF-C03" in errors,
                seconds=time.process_time() - began,
            )
        )
        heard(cases[-1])
    return cases


def report(line):
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def report_case(case):
    what = f"{len(case.changes)} changes, size {case.size:.2f}" if case.fixed else "no fix"
    report(f"{case.design.branch_count} branches: {what}, {case.seconds:.1f} s")


def main(count, kind, keep):
    profile = read_profile("co2_60w__stretchlon_200")
    cases = fix_many(count, profile, keep=keep, kind=kind, heard=report_case)
    fixed = [case for case in cases if case.fixed]
    pruned = [case for case in fixed if case.fixed.branch_count < case.design.branch_count]
    sizes = np.array([case.size for case in fixed])
    kept = np.array([case.fixed.branch_count / case.design.branch_count for case in fixed])
    times_s = np.array([case.seconds for case in cases])
    report(f"{len(fixed)} of {len(cases)} fixed; {len(pruned)} of them by pruning")
    webbed = [case for case in cases if case.webbed]
    report(f"with VF-C03: {sum(bool(case.fixed) for case in webbed)} of {len(webbed)} fixed")
    if not fixed:
        return
    report(f"branches kept: median {np.median(kept):.0%}, least {kept.min():.0%}")
    report(f"weighted size of the change: median {np.median(sizes):.2f}, most {sizes.max():.2f}")
    report(f"values changed: median {np.median([len(case.changes) for case in fixed]):.0f}")
    unpruned = np.array([case.size for case in fixed if case not in pruned])
    if len(unpruned):
        report(f"without pruning: {len(unpruned)}, median size {np.median(unpruned):.2f}")
    report(f"processor seconds: median {np.median(times_s):.1f}, most {times_s.max():.1f}")


if __name__ == "__main__":
    count, kind, *keep = *sys.argv[1:], *("300", "levels")[len(sys.argv[1:3]) :]
    main(int(count), kind, parsed_keeps(keep))
