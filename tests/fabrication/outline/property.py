"""Thousands of random designs against an independent union of plain shapes; run on demand.

    python tests/fabrication/outline/property.py [--designs N] [--seed S] [--processes P]

Every design must give a valid outline or named problems, never an exception. Valid outlines are
compared with the union that the tests draw with Shapely: Hausdorff distance, area, radii, tangent
joins, segment lengths, arc angles. The exit code is 1 if any of them is beyond its limit.
"""

import argparse
import math
import sys
import time
from collections import Counter
from itertools import pairwise
from multiprocessing import Pool
from pathlib import Path

import numpy as np
import shapely

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from tests.oracles.body_outline import Twin
from vinefab.fabrication.outline.body_outline import body_outline
from vinefab.fabrication.outline.joint import LEAST_CUT_MM
from vinefab.model.design import Build, Collar, Design, Level, Pouch
from vinefab.model.outline import Part

FINE_MM = 2e-4
LIMITS = {
    "hausdorff_mm": 0.01,
    "area": 1e-5,
    "radius_mm": 1e-3,
    "arc_deg": 175.0,
    "corner_rad": 1e-6,
    "shortest_mm": 0.05,
}


def random_design(random):
    """A design within the bounds of the paper's Table 1, built in every way that there is."""
    levels = []
    for _ in range(random.integers(0, 4)):
        levels.append(
            Level(
                branches=int(random.integers(1, 5)),
                length_mm=float(random.uniform(20, 205)),
                fan_rad=math.radians(float(random.uniform(10, 200))),
                growth=float(random.uniform(0.5, 1.5)),
            )
        )
        if math.prod(level.branches for level in levels) > 40:
            levels.pop()
    widths = [float(random.uniform(10, 45))]
    for _ in levels:
        widths.append(widths[-1] * float(random.uniform(0.3, 0.7)))
    fillets = [float(random.choice([0.0, 1.0, 0.25, 0.6])) * width for width in widths[1:]]
    taper = tuple(random.uniform(0.6, 1.0, len(widths)).tolist())
    return Design(
        name="any",
        trunk_length_mm=float(random.uniform(20, 205)),
        levels=tuple(levels),
        build=Build(
            widths_mm=tuple(widths),
            fillet_mm=tuple(fillets),
            tail_mm=float(random.choice([60.0, 120.0, 200.0])),
            taper=taper if random.random() < 0.5 else (),
            pouch=random_pouch(random, widths[-1]),
            collar=random_collar(random),
        ),
    )


def random_pouch(random, width):
    kind = random.integers(0, 3)
    across = width * float(random.uniform(1.05, 3.0))
    if kind == 0:
        return None
    if kind == 1:
        return Pouch(shape="round", radius_mm=across / 2)
    along = width * float(random.uniform(0.2, 3.0))
    return Pouch(shape="rectangle", length_mm=along, width_mm=across)


def random_collar(random):
    if random.random() < 0.7:
        return None
    return Collar(
        clamp_diameter_mm=float(random.uniform(10, 50)),
        length_mm=float(random.choice([0.0, 15.0, 30.0])),
        flare_mm=float(random.uniform(5, 60)),
    )


def check_outline(number_and_seed):
    """Return what came of one design: a word, and the figures of a drawn one."""
    number, seed = number_and_seed
    design = random_design(np.random.default_rng([seed, number]))
    try:
        outline = body_outline(design)
    except Exception as error:
        return number, f"exception {error!r}", {}
    if outline.problems:
        good = all(problem.message and problem.branches for problem in outline.problems)
        return number, "named" if good else "a problem without words", {}
    contour = outline.contour
    shape = shapely.Polygon(contour.flattened_mm(FINE_MM))
    if not shape.is_valid:
        return number, "crosses itself", {}  # rule VF-T02 names it
    union = Twin(design, FINE_MM).body()
    if union.geom_type != "Polygon" or len(union.interiors):
        return number, "crosses itself", {}
    edges = shape.exterior, union.exterior
    figures = {
        "hausdorff_mm": max(farthest_mm(*edges), farthest_mm(*reversed(edges))),
        "area": abs(contour.signed_area_mm2 - union.area) / union.area,
        **details(design, contour),
    }
    return number, "drawn", figures


def farthest_mm(edge, other):
    """How far the points of one edge are from another edge at most."""
    points = shapely.points(shapely.get_coordinates(shapely.segmentize(edge, 2.0)))
    shapely.prepare(other)
    return float(shapely.distance(points, other).max())


def details(design, contour):
    segments = list(contour.segments)
    tips = {design.build.end_widths_mm[-1] / 2}
    if design.build.pouch is not None and design.build.pouch.shape == "round":
        tips.add(design.build.pouch.radius_mm)
    ends = [width / 2 for width in design.build.end_widths_mm]
    off = 0.0
    for arc in (segment for segment in segments if segment.bulge):
        designed = set(ends) | {design.build.widths_mm[0] / 2}
        if arc.part is Part.TIP or (arc.part is Part.POUCH and len(tips) > 1):
            designed = tips
        if arc.part in (Part.TIP, Part.JOINT) or (arc.part is Part.POUCH and len(tips) > 1):
            off = max(off, min(abs(arc.radius_mm - radius) for radius in designed))
    half = design.build.widths_mm[0] / 2
    sharp = 0.0
    for before, after in pairwise(segments):
        turn = after.direction_rad() - before.direction_rad(at_end=True)
        corner = abs(math.remainder(turn, math.tau))
        # Where the trunk begins to taper, an arc too short to cut is a corner.
        bend = {before.part, after.part} == {Part.TAIL, Part.SIDE}
        if not (bend and corner * half < LEAST_CUT_MM):
            sharp = max(sharp, corner)
    if min(design.build.fillet_mm, default=1.0) < 1.0:
        sharp = 0.0
    return {
        "radius_mm": off,
        "arc_deg": max(math.degrees(abs(segment.turn_rad)) for segment in segments),
        "corner_rad": sharp,
        "shortest_mm": min(segment.length_mm for segment in segments),
    }


def beyond(name, value):
    if name == "shortest_mm":
        return value < LIMITS[name] * (1 - 1e-6)
    return value > LIMITS[name]


def main():
    parser = argparse.ArgumentParser(description="Random designs against an independent union.")
    parser.add_argument("--designs", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    words, worst, bad = Counter(), {}, []
    began = time.monotonic()
    with Pool(given.processes) as pool:
        work = ((number, given.seed) for number in range(given.designs))
        for number, word, figures in pool.imap_unordered(check_outline, work, chunksize=20):
            words[word] += 1
            if word not in ("drawn", "named", "crosses itself"):
                bad.append((number, word))
            for name, value in figures.items():
                keep = min if name == "shortest_mm" else max
                worst[name] = keep(worst.get(name, (value, number)), (value, number))
                if beyond(name, value):
                    bad.append((number, f"{name} {value:.3g}"))
    sys.stdout.write(f"{dict(words)} in {time.monotonic() - began:.0f} s\n")
    for name, (value, number) in worst.items():
        sys.stdout.write(f"{name}: worst {value:.3g} (design {number}), limit {LIMITS[name]:g}\n")
    for number, word in bad[:20]:
        sys.stdout.write(f"design {number}: {word}\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
