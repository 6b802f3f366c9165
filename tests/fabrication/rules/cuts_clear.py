"""Random robots by every recipe and process: no written cut comes near a seam that is not its own.

    python tests/fabrication/rules/cuts_clear.py [ROBOTS] [SEED]

Branches are brought to within a millimetre of the least clearance. What may be cut is written as
DXF, read by ezdxf, and measured by Shapely alone: the area that a closed cut frees is one without
holes even when half a kerf is added to it; a cut made apart frees an area around all of its seam,
a kerf or more away from it. The exit code is 1 if any robot breaks that.
"""

import io
import sys
from collections import Counter

import ezdxf
import ezdxf.path
import numpy as np
import shapely
from scipy.optimize import brentq

from vinefab.fabrication.formats.dxf_format import DXF
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec
from vinefab.fabrication.job.passes import WEB_MM, in_one_pass, taken_mm
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.fabrication.rules.spacing import capsules_of, spacing
from vinefab.model.design import Build, Design, Level
from vinefab.model.files.shipped import names
from vinefab.model.laser import read_profile
from vinefab.outline.body_outline import flat_layout

GEOMETRY = {
    f"VF-{name}" for name in ("T01", "T02", "T03", "T04", "C01", "C02", "C03", "C05", "L02")
}
SLACK_MM = 0.05


def ways():
    """Every recipe that ships, by every process that it has."""
    for name in names("recipe"):
        profile = read_profile(name)
        yield profile, "auto"
        if in_one_pass(profile) and "weld" in profile.recipe.by_operation:
            yield profile, "weld+cut"


def gap_mm(design):
    """The least distance between the lumens of branches that share no joint; at most 40."""
    found = spacing(capsules_of(flat_layout(design), design.build), 40.0)
    return float(found.gap_mm[~found.joined].min(initial=40.0))


def near_the_limit(random, least_gap_mm):
    """A random tree of three levels, grown until its tightest gap is next to the least."""
    widths = tuple(random.uniform(22.0, 40.0) * np.cumprod([1.0, *random.uniform(0.5, 0.7, 2)]))
    levels = [
        Level(
            branches=int(random.integers(2, 4)),
            length_mm=random.uniform(1.5, 4.0) * widths[level],
            fan_rad=np.radians(random.uniform(70.0, 200.0)),
            growth=random.uniform(0.7, 1.4),
        )
        for level in (0, 1)
    ]
    build = Build(widths_mm=widths, fillet_mm=tuple(w / 4 for w in widths[1:]), tail_mm=200.0)
    whole = Design(name="tree", trunk_length_mm=150.0, levels=tuple(levels), build=build)
    target = least_gap_mm + random.uniform(-0.5, 1.0)

    def grown(factor):
        last = levels[1].changed(length_mm=levels[1].length_mm * factor)
        return whole.changed(levels=(levels[0], last))

    factors = np.linspace(0.6, 4.0, 35)
    gaps = np.array([gap_mm(grown(factor)) for factor in factors]) - target
    below = np.flatnonzero(gaps < 0.0)
    if not len(below) or not below[0]:
        return whole
    row = below[0]
    factor = brentq(lambda f: gap_mm(grown(f)) - target, factors[row - 1], factors[row], xtol=1e-6)
    return grown(factor)


def lines_of(dxf):
    """The lines of a DXF by layer, each as Shapely sees it."""
    found = {}
    for entity in ezdxf.read(io.StringIO(dxf)).modelspace():
        points = [(p.x, p.y) for p in ezdxf.path.make_path(entity).flattening(0.002)]
        found.setdefault(entity.dxf.layer, []).append(shapely.LineString(points))
    return found


def broken(dxf, profile):
    """What a written robot breaks; None if it keeps clear."""
    lines, cut = lines_of(dxf), profile.recipe.by_operation["cut"]
    apart = lines.get("VF_20_WELD")
    outer = lines["VF_40_CUT"] if apart else lines["VF_30_WELDCUT"]
    half = (cut if apart else profile.recipe.by_operation["weldcut"]).kerf_mm.value / 2.0
    area = shapely.Polygon(max(outer, key=shapely.length))
    overcut = cut.overcut_mm.value if apart else 0.0
    # The overcut runs along the first straight again: a line of no width, which is no crossing.
    area = shapely.Polygon(shapely.get_coordinates(area)[: -2 if overcut else None])
    if not area.is_valid:
        return "a cut crosses itself"
    if shapely.get_num_interior_rings(area.buffer(half - SLACK_MM / 4)):
        return "kerfs of two branches meet"
    if not apart:
        return None
    seam = shapely.Polygon(apart[0])
    if not area.buffer(SLACK_MM).contains(seam):
        return "the cut runs through the seam"
    mouth = shapely.MultiPoint([apart[0].coords[0], apart[0].coords[-1]]).buffer(2 * WEB_MM + 20.0)
    away = shapely.distance(area.exterior.difference(mouth), apart[0])
    # A kerf from any seam; a corner in place of a small fillet lies nearer to its own than the web.
    away -= half + profile.recipe.by_operation["weld"].seam_width_mm.value / 2.0
    return None if away > 2.0 * half else f"a kerf is {away:.3f} mm from a seam"


def main(robots=2000, seed=1):
    """Try random robots, and count what comes of them."""
    random, counts, bad = np.random.default_rng(seed), Counter(), []
    every = list(ways())
    for number in range(robots):
        profile, process = every[number % len(every)]
        sheet = SheetOptions(process=process)
        least_mm = 2.0 * taken_mm(profile, separate=process == "weld+cut")
        design = near_the_limit(random, least_mm)
        near = gap_mm(design) < least_mm + 1.0
        subject = Subject.of(design, profile, sheet=sheet)
        blocked = run_checks(subject, only=GEOMETRY).blocking
        counts["near the limit"] += near
        counts["forbidden" if blocked else "may be cut"] += 1
        # What C01 alone would let pass is what the rule on the written paths is for.
        counts["forbidden by VF-L02 alone"] += {one.rule for one in blocked} == {"VF-L02"}
        counts["near the limit, may be cut"] += near and not blocked
        if not blocked:
            why = broken(DXF.write(LaserFileSpec(job=subject.job)), profile)
            if why:
                bad.append(f"robot {number} ({profile.recipe.name}, {process}): {why}")
    sys.stdout.write(f"{robots} robots, {len(every)} ways: {dict(counts)}; {len(bad)} broken\n")
    sys.stdout.write("".join(f"{line}\n" for line in bad))
    return len(bad)


if __name__ == "__main__":
    sys.exit(bool(main(*map(int, sys.argv[1:]))))
