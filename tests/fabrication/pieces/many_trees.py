"""Thousands of random Table-1 trees cut in pieces; run on demand.

    python tests/fabrication/pieces/many_trees.py [TREES] [SEED] [TRUNK_WIDTH_MM]

Every tree must end in pieces that pass the rules about room, bed and labels, or in a named reason
(VF-J01, VF-J02); none in an exception. The exit code is 1 otherwise. By number of branches: how
many are cut, how many pieces, whether the number is proven least, and how long it takes.
"""

import sys
import time
from collections import defaultdict
from dataclasses import replace

import numpy as np

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.pieces.partition import in_pieces, partition_of
from vinefab.fabrication.rules.catalog import ROOM_RULES, run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import PieceSettings
from vinefab.model.laser import read_profile
from vinefab.search.space import BuildSettings, Space, SpaceSettings

LONG_S = 20.0
BINS = (10, 40, 100, 341)
CHECKED = ROOM_RULES | {"VF-W04", "VF-P05", "VF-S01", "VF-J01", "VF-J02"}


def judged(design, profile):
    """Pieces, whether proven, seconds for them, and the rules that block: what it ends in."""
    start = time.process_time()
    partition = partition_of(design, profile)
    spent = time.process_time() - start
    # The paths of hundreds of pieces take minutes to nest: the rules about room suffice there.
    few = len(partition.pieces) <= design.build.pieces.most
    job = laser_job(design, profile, partition=partition) if few else None
    subject = replace(Subject.of(design), profile=profile, job=job)
    report = run_checks(in_pieces(subject, partition), only=CHECKED)
    return partition, spent, {finding.rule for finding in report.blocking}


def main(trees=2000, seed=1, width_mm=40.0):
    """Cut random trees, and say what they end in."""
    profile = read_profile("co2_60w__stretchlon_200")
    settings = BuildSettings(trunk_width_mm=width_mm, pieces=PieceSettings())
    space, random = Space(SpaceSettings(), settings), np.random.default_rng(seed)
    sizes, outcomes, bad = defaultdict(list), defaultdict(int), 0
    for number in range(trees):
        design = space.design(random.random(len(space)), f"tree_{number}")
        partition, spent, blocking = judged(design, profile)
        named = blocking & {"VF-J01", "VF-J02"}
        if blocking and not named:
            # Crotches without room and branches that vanish are reasons of the robot as a whole.
            problems = {problem.kind.value for problem in Subject.of(design).outline.problems}
            outcomes["outline: " + ", ".join(sorted(problems))] += 1
            if not problems:
                bad += 1
                sys.stdout.write(f"tree {number}: {sorted(blocking)} without a named reason" + "\n")
        else:
            outcomes[", ".join(sorted(named)) or "pieces that pass"] += 1
        count = design.branch_count
        if spent > LONG_S:
            sys.stdout.write(f"tree {number}: {count} branches took {spent:.0f} s\n")
        if number % 100 == 99:
            sys.stdout.write(f"{number + 1} trees: {dict(outcomes)}\n")
            sys.stdout.flush()
        place = next(limit for limit in BINS if count <= limit)
        sizes[place].append((len(partition.pieces), partition.proven_least, spent, bool(named)))
    for place in BINS:
        rows = sizes[place]
        if rows:
            pieces, proven, spent, _ = (np.array(column) for column in zip(*rows, strict=True))
            sys.stdout.write(
                f"to {place} branches: {len(rows)} trees, pieces {np.median(pieces):.0f} "
                f"(most {pieces.max()}), proven least {proven.mean():.1%}, CPU s median "
                f"{np.median(spent):.3f}, worst {spent.max():.2f}\n"
            )
    sys.stdout.write(f"{dict(outcomes)}\n")
    return bool(bad)


if __name__ == "__main__":
    sys.exit(
        main(*(kind(text) for kind, text in zip((int, int, float), sys.argv[1:], strict=False)))
    )
