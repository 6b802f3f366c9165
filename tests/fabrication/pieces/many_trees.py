"""Thousands of random trees cut in pieces, and how long that takes; run on demand.

    python tests/fabrication/pieces/many_trees.py [TREES] [SEED] [TRUNK_WIDTH_MM]

Every Table-1 tree must end in pieces that pass the rules about room, bed and labels, or in a named
reason (VF-J01, VF-J02); none in an exception. The exit code is 1 otherwise. By number of branches:
how many are cut, how many pieces, whether the number is proven least, and CPU seconds.
"""

import sys
import time
from collections import Counter, defaultdict
from dataclasses import replace

import numpy as np

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.pieces.partition import in_pieces, partition_of
from vinefab.fabrication.rules.catalog import rules_on, run_checks
from vinefab.fabrication.rules.rule import Scope, Subject
from vinefab.model.design import PieceSettings
from vinefab.model.laser import read_profile
from vinefab.search.space import BuildSettings, Space, SpaceSettings

LONG_S = 20.0
BINS = (10, 40, 100, 341)
CHECKED = rules_on(Scope.ROOM) | {"VF-W04", "VF-P05", "VF-S01", "VF-J01", "VF-J02"}
PROFILE = read_profile("co2_60w__stretchlon_200")


def timed(design):
    """A partition, and the CPU seconds that it took."""
    start = time.process_time()
    partition = partition_of(design, PROFILE)
    return partition, time.process_time() - start


def blocking(design, partition):
    """The rules that block a robot in its pieces."""
    # The paths of hundreds of pieces take minutes to nest: the rules about room suffice there.
    few = len(partition.pieces) <= design.build.pieces.most
    job = laser_job(design, PROFILE, partition=partition) if few else None
    subject = replace(Subject.of(design), profile=PROFILE, job=job)
    report = run_checks(in_pieces(subject, partition), only=CHECKED)
    return {finding.rule for finding in report.blocking}


def say(name, rows):
    """Print the figures of some partitions with their seconds."""
    pieces = np.array([len(found.pieces) for found, _ in rows])
    proven = np.mean([found.proven_least for found, _ in rows])
    spent, unparted = np.array([s for _, s in rows]), sum(bool(found.unparted) for found, _ in rows)
    sys.stdout.write(
        f"{name}: {len(rows)} trees, {unparted} cannot be cut, pieces median "
        f"{np.median(pieces):.0f} most {pieces.max()}, proven least {proven:.1%}, CPU s median "
        f"{np.median(spent):.3f} worst {spent.max():.2f}\n"
    )
    sys.stdout.flush()


def main(trees=2000, seed=1, width_mm=40.0):
    """Cut random trees, and say what they end in."""
    settings = BuildSettings(trunk_width_mm=width_mm, pieces=PieceSettings())
    space, random = Space(SpaceSettings(), settings), np.random.default_rng(seed)
    sizes, outcomes, bad = defaultdict(list), Counter(), 0
    for number in range(trees):
        design = space.design(random.random(len(space)), f"tree_{number}")
        partition, spent = timed(design)
        rules = blocking(design, partition)
        outcome = ", ".join(sorted(rules & {"VF-J01", "VF-J02"})) or "pieces that pass"
        if rules and outcome == "pieces that pass":
            # Crotches without room and branches that vanish are reasons of the robot as a whole.
            problems = {problem.kind.value for problem in Subject.of(design).outline.problems}
            outcome = "outline: " + ", ".join(sorted(problems))
            if not problems:
                bad += 1
                sys.stdout.write(f"tree {number}: {sorted(rules)} without a named reason\n")
        outcomes[outcome] += 1
        if spent > LONG_S:
            sys.stdout.write(f"tree {number}: {design.branch_count} branches took {spent:.0f} s\n")
        if number % 100 == 99:
            sys.stdout.write(f"{number + 1} trees: {dict(outcomes)}\n")
        place = next(limit for limit in BINS if design.branch_count <= limit)
        sizes[place].append((partition, spent))
    for place, rows in sorted(sizes.items()):
        say(f"to {place} branches", rows)
    sys.stdout.write(f"{dict(outcomes)}\n")
    return bool(bad)


if __name__ == "__main__":
    kinds = zip((int, int, float), sys.argv[1:], strict=False)
    sys.exit(main(*(kind(text) for kind, text in kinds)))
