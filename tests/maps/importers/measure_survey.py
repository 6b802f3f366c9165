"""Import of a synthetic cave survey: time, peak memory, narrowest passage.

python tests/maps/importers/measure_survey.py 10000 500000 --formats geojson dxf gpkg

Passages are strips of known half-width along wandering lines, their walls rough outward only, in
a tree with loops. One strip is the narrowest: its two straight walls are known by construction.
Each import runs in a process of its own.
"""

import argparse
import json
import math
import subprocess
import sys
import time
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import ezdxf
import numpy as np
import shapely
from pyogrio import raw

from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map
from vinefab.maps.passages import narrow_passages

NECK_MM = 180.0
"""Width of the narrowest passage, of a survey about 60 m wide."""
_HALF_MM = 700.0
_STEP_MM = 5000.0
_JAGGED_MM = 120.0


def survey(vertices, seed=1):
    """Return polygons, each (n, 2) mm: the passages of a cave, about so many vertices in all."""
    rng = np.random.default_rng(seed)
    side = 12
    nodes = {
        (i, j): np.array([i, j]) * _STEP_MM + rng.uniform(-800.0, 800.0, 2)
        for i in range(side)
        for j in range(side)
    }
    edges = _tree_with_loops(list(nodes), rng)
    per_wall = max(4, vertices // (2 * len(edges)))
    polygons = [_strip(nodes[one], nodes[other], per_wall, rng) for one, other in edges]
    return [*polygons, *_neck(nodes[(side - 1, side - 1)])]


def _tree_with_loops(cells, rng):
    reached, edges = {cells[0]}, []
    while len(reached) < len(cells):
        i, j = cells[rng.integers(len(cells))]
        near = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        inside = [cell for cell in near if cell in reached]
        if (i, j) not in reached and inside:
            edges.append((inside[rng.integers(len(inside))], (i, j)))
            reached.add((i, j))
    known = {frozenset(edge) for edge in edges}
    for i, j in cells:
        other = (i + 1, j)
        if other in reached and frozenset([(i, j), other]) not in known and rng.random() < 0.15:
            edges.append(((i, j), other))
    return edges


def _strip(begin, end, per_wall, rng):
    along = (end - begin) / math.dist(begin, end)
    aside = np.array([-along[1], along[0]])
    begin, end = begin - 0.6 * _HALF_MM * along, end + 0.6 * _HALF_MM * along
    share = np.linspace(0.0, 1.0, per_wall)[:, None]
    wander = 250.0 * np.sin(np.pi * share) * np.sin(rng.uniform(1, 4) * np.pi * share)
    middle = begin + share * (end - begin) + wander * aside
    walls = (_HALF_MM + _rough(per_wall, math.dist(begin, end), rng)[:, None] for _ in range(2))
    left, right = middle + next(walls) * aside, middle - next(walls) * aside
    return np.vstack([left, right[::-1]])


def _rough(count, length_mm, rng):
    """Return how far a wall is out at each of its points: a walk with slopes up to 0.5.

    Towards the ends it is smooth, so that no slits arise where walls of two strips cross.
    """
    step_mm = length_mm / count
    walk = np.abs(np.cumsum(rng.uniform(-0.5, 0.5, count)) * step_mm) % (2.0 * _JAGGED_MM)
    out_mm = np.where(walk > _JAGGED_MM, 2.0 * _JAGGED_MM - walk, walk)
    share = np.linspace(0.0, 1.0, count)
    return out_mm * np.clip(8.0 * np.minimum(share, 1.0 - share) - 2.0, 0.0, 1.0)


def _neck(corner):
    """Return a straight passage of the narrowest width out of a node, and a chamber behind it."""
    x, y = corner
    half, far = 0.5 * NECK_MM, x + 6000.0
    neck = [(x, y - half), (far, y - half), (far, y + half), (x, y + half)]
    chamber = [
        (far - 10, y - 900),
        (far + 2000, y - 900),
        (far + 2000, y + 900),
        (far - 10, y + 900),
    ]
    return [np.array(neck), np.array(chamber)]


def write(polygons, path):
    """Write polygons as a file of the kind that the suffix says, in mm."""
    rings = [np.round(np.vstack([points, points[:1]]), 3) for points in polygons]
    if path.suffix == ".geojson":
        features = [
            {
                "type": "Feature",
                "properties": {"survey": number},
                "geometry": {"type": "Polygon", "coordinates": [ring.tolist()]},
            }
            for number, ring in enumerate(rings)
        ]
        path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    elif path.suffix == ".dxf":
        _write_dxf(rings, path)
    else:
        wkb = shapely.to_wkb(shapely.polygons([shapely.linearrings(ring) for ring in rings]))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # no reference system: mm
            raw.write(str(path), wkb, [], [], geometry_type="Polygon", crs=None)


def _write_dxf(rings, path):
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    for ring in rings:
        hatch = space.add_hatch()
        hatch.paths.add_polyline_path(ring[:-1].tolist(), is_closed=True)
    document.saveas(path)


def imported(path):
    """Import a file, as the process that is measured does, and write what came out."""
    begin = time.process_time()
    world = import_map(Path(path), ImportOptions(drawn="free"))
    seconds = time.process_time() - begin
    # Not rusage, which counts what the parent held.
    peak = Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()
    peak_mb = int(peak[0]) / 1024.0 if peak else math.nan
    begin = time.process_time()
    narrowest = narrow_passages(world.free_space, 1)[0]
    found = {
        "cpu_s": seconds,
        "peak_mb": peak_mb,
        "obstacles": len(world.obstacles),
        "walls": world.wall_count,
        "narrowest_mm": narrowest.width_mm,
        "passages_cpu_s": time.process_time() - begin,
        "facts": {key: world.facts.get(key) for key in ("areas_united", "separate_parts")},
    }
    sys.stdout.write(json.dumps(found))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("vertices", type=int, nargs="*", default=[10_000])
    parser.add_argument("--formats", nargs="*", default=["geojson", "dxf", "gpkg"])
    parser.add_argument("--of", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.of:
        imported(given.of)
        return
    for vertices in given.vertices:
        polygons = survey(vertices)
        drawn = sum(map(len, polygons))
        with TemporaryDirectory() as folder:
            for suffix in given.formats:
                path = Path(folder) / f"survey.{suffix}"
                write(polygons, path)
                command = [sys.executable, __file__, "--of", str(path)]
                done = subprocess.run(command, check=False, capture_output=True, text=True)
                if done.returncode:
                    sys.exit(f"{vertices} {suffix}: {done.stderr.strip().splitlines()[-1]}")
                found = json.loads(done.stdout)
                sys.stdout.write(
                    f"{drawn} vertices, {len(polygons)} areas, {suffix}: "
                    f"{found['cpu_s']:.1f} s CPU, peak {found['peak_mb']:.0f} MB; narrowest "
                    f"{found['narrowest_mm']:.3f} mm, built {NECK_MM:g} "
                    f"({found['passages_cpu_s']:.1f} s); {found['obstacles']} obstacles, "
                    f"{found['walls']} walls; {found['facts']}\n"
                )
                sys.stdout.flush()


if __name__ == "__main__":
    main()
