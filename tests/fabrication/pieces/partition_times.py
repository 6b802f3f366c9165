"""How long the fewest pieces of a tree take to find, and how often they are proven; on demand.

    python tests/fabrication/pieces/partition_times.py [TREES] [SEED]

Random trees of 10, 40, 100 and 341 branches, wide enough apart at their joints to be cut: long
branches of 24 mm trunks, on a bed without an end, so that crossings alone decide, and on a bed of
1000 x 600 mm. CPU seconds; the machine's own noise is that of its other work.
"""

import sys
import time
from dataclasses import replace

import numpy as np

from vinefab.fabrication.pieces.partition import partition_of
from vinefab.model.design import Build, Design, Level, PieceSettings
from vinefab.model.laser import read_profile

SHAPES = {10: (3, 2), 40: (3, 3, 3), 100: (3, 4, 7), 341: (4, 4, 4, 4)}


def tree(random, branches):
    """A random tree of one shape."""
    levels = tuple(
        Level.of(
            branches=count,
            length_mm=float(random.uniform(120, 205)),
            angle_deg=float(random.uniform(100, 160)),
            growth_percent=float(random.uniform(80, 120)),
        )
        for count in branches
    )
    build = Build.standard(1 + len(levels), 24.0, 0.65).changed(pieces=PieceSettings())
    return Design(
        name="tree", trunk_length_mm=float(random.uniform(120, 205)), levels=levels, build=build
    )


def main(trees=20, seed=1):
    """Cut trees of each size, and say how long it took."""
    profile = read_profile("co2_60w__stretchlon_200")
    machine = profile.machine
    wide = machine.changed(
        **{
            name: getattr(machine, name).changed(value=9000.0)
            for name in ("bed_width_mm", "bed_height_mm")
        },
    )
    beds = {"endless bed": replace(profile, machine=wide), "bed of 1000 x 600 mm": profile}
    for name, bed in beds.items():
        for size, shape in SHAPES.items():
            random, rows = np.random.default_rng(seed), []
            for _ in range(trees if size < 341 else max(1, trees // 5)):
                design = tree(random, shape)
                start = time.process_time()
                found = partition_of(design, bed)
                spent = time.process_time() - start
                rows.append((len(found.pieces), found.proven_least, spent, bool(found.unparted)))
            pieces, proven, spent, unparted = (np.array(one) for one in zip(*rows, strict=True))
            sys.stdout.write(
                f"{name}, {size} branches: {len(rows)} trees, {unparted.sum()} cannot be cut, "
                f"pieces median {np.median(pieces):.0f} most {pieces.max()}, proven least "
                f"{proven.mean():.0%}, CPU s median {np.median(spent):.3f} "
                f"worst {spent.max():.2f}\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
