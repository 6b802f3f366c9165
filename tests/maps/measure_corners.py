"""Time and peak memory of every command that takes a map, against the corners of its obstacles.

    python tests/maps/measure_corners.py 1000 4000 16000 64000 --limit-s 20
    python tests/maps/measure_corners.py 4000 --maps star --commands rig "map info"

Three maps of 600 x 400 mm, a row for each command and map, a column for each number of corners:
one jagged star, scattered triangles, and bounds with the smooth outline of a cave. A cell holds
processor seconds and peak MB of a process of its own, or how it ended: ``> 20 s`` where the limit
killed it, ``refused`` with exit code 2 (messages come last). ``x`` is the time of a cell over that
of the one to its left, each less the time that the command takes on the first map with 40 corners.
"""

import argparse
import math
import os
import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import shapely

from vinefab.core.errors import BadInputError
from vinefab.model.map import Map, Pose, Start, map_text

ROOT = Path(__file__).resolve().parents[2]
START = Start(pose=Pose.of((152, 132, 2)), spread_heading_rad=math.radians(10.0))
BOX = shapely.box(0, 0, 600, 400)
LEAST_CORNERS = 40
RUN = """schema = "vinefab/run-1"
name = "short"
[maps]
files = ["map.geojson"]
[space]
levels = [2, 2]
[optimizer]
population = 8
generations = 2
[evaluation]
poses_per_map = 2
finalists = 2
final_poses_per_map = 2
"""


def star(corners):
    """Return one obstacle whose corners lie on two circles in turn."""
    angle = np.arange(corners) * 2.0 * np.pi / corners
    radius_mm = np.where(np.arange(corners) % 2, 90.0, 130.0)[:, None]
    spikes = [430, 230] + radius_mm * np.column_stack([np.cos(angle), np.sin(angle)])
    return BOX, [shapely.Polygon(spikes)]


def triangles(corners):
    """Return triangles on a lattice of 350 x 380 mm, each turned at random."""
    count = corners // 3
    columns = math.ceil(math.sqrt(count * 350 / 380))
    pitch_mm = 350 / columns
    turn = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (count, 1))
    angle = turn + np.arange(3) * 2.0 * np.pi / 3.0
    row, column = np.divmod(np.arange(count), columns)
    middle = np.column_stack([235 + column * pitch_mm, 15 + row * pitch_mm])
    points = middle[:, None] + 0.35 * pitch_mm * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    return BOX, list(shapely.polygons(points))


def cave(corners):
    """Return bounds that wind smoothly, with three passages into side chambers."""
    angle = np.arange(corners) * 2.0 * np.pi / corners
    radius = 1.0 + 0.35 * np.cos(3.0 * angle) + 0.05 * np.sin(17.0 * angle + 1.0)
    points = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    points = (points - points.min(axis=0)) / np.ptp(points, axis=0) * [600, 400]
    return shapely.Polygon(points), []


MAPS = {"star": star, "triangles": triangles, "cave": cave}

PHOTO = str(ROOT / "examples" / "arena" / "grown_1.jpg")
SPRIG = str(ROOT / "examples" / "arena" / "sprig.toml")
COMMANDS = {
    "map info": "map info map.geojson --width-mm 20 --svg map.svg",
    "map import": "map import plain.geojson --start 152,132,2 --out imported.geojson",
    "map import, roomiest start": "map import plain.geojson --out imported.geojson",
    "map start": "map start map.geojson --out started.geojson --start",
    "grow": "grow grid_explorer_levels --map map.geojson --svg grown.svg",
    "score": "score grid_explorer_levels --map map.geojson --poses 3",
    "aim": "aim grid_explorer_levels --map map.geojson --deployments 5000 --out aim.html",
    "optimize": "optimize run.toml --out run",
    "compare": "compare grid_explorer_levels plain_vine --map map.geojson --out compared.html",
    "check --map": "check grid_explorer_levels --map map.geojson",
    "report": "report grid_explorer_levels --map map.geojson --out report.html",
    "rig": "rig map.geojson --out rig",
    "observe": f"observe {PHOTO} --map map.geojson --design {SPRIG} --pose 152,132,2 "
    "--obstacle-height 30 --out seen.html",
    "studio --snapshot": "studio grid_explorer_levels --map map.geojson --snapshot state.html",
}
GROUP_WORDS = {"map start": ["area 100,100 200,200, heading 0+-20"]}


def written(kind, corners, folder):
    """Write a map as ours and as plain polygons, and a run file that takes it."""
    bounds, obstacles = MAPS[kind](corners)
    world = Map(name=kind, bounds=bounds, obstacles=tuple(obstacles), starts=(START,))
    (folder / "map.geojson").write_text(map_text(world))
    plain = shapely.to_geojson(shapely.GeometryCollection([bounds, *obstacles]))
    (folder / "plain.geojson").write_text(plain)
    (folder / "run.toml").write_text(RUN)


def measured(command, folder, limit_s):
    """Return processor seconds, peak MB and how a command ended: "", "refused: ..." or "> 20 s"."""
    arguments = [*COMMANDS[command].split(), *GROUP_WORDS.get(command, [])]
    shown = folder / "said.txt"
    with shown.open("w") as said:
        running = subprocess.Popen(
            [sys.executable, "-m", "vinefab", *arguments],
            cwd=folder,
            stdout=said,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        resource.prlimit(running.pid, resource.RLIMIT_CPU, (limit_s, limit_s))
        _, status, used = os.wait4(running.pid, 0)
    code = running.returncode = os.waitstatus_to_exitcode(status)
    line = (shown.read_text().strip().splitlines() or [""])[-1]
    ended = "" if code in {0, 1} else f"> {limit_s} s" if code < 0 else f"refused: {line}"
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0, ended


def cell(command, kind, corners, limit_s):
    """Measure a command on one map, in a folder of its own."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        try:
            written(kind, corners, folder)
        except BadInputError as refused:  # as when a command reads such a map
            return 0.0, 0.0, f"refused: {refused}"
        return measured(command, folder, limit_s)


def row(command, kind, sizes, limit_s, base_s, notes):
    """Return the cells of a command on a kind of map; larger maps are not tried after a limit."""
    cells, before_s = [], 0.0
    for corners in sizes:
        seconds, peak_mb, ended = cell(command, kind, corners, limit_s)
        if ended.startswith("refused"):
            notes.append(f"{command}, {kind}, {corners} corners, {seconds:.1f} s: {ended}")
        times = (seconds - base_s) / before_s if before_s > 0.2 and not ended else math.nan
        factor = "" if math.isnan(times) else f" x{times:.1f}"
        before_s = seconds - base_s
        cells.append(
            ended
            if ended.startswith(">")
            else f"{ended[:7]} {seconds:.1f} s {peak_mb:.0f} MB{factor}".strip()
        )
        if ended.startswith(">"):
            break
    return [*cells, *["-"] * (len(sizes) - len(cells))]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("corners", type=int, nargs="*", default=[1000, 4000, 16000, 64000])
    parser.add_argument("--limit-s", type=int, default=20, help="processor time of a cell")
    parser.add_argument("--maps", nargs="*", default=list(MAPS))
    parser.add_argument("--commands", nargs="*", default=list(COMMANDS))
    given = parser.parse_args()
    notes = []
    sys.stdout.write("| command | map | " + " | ".join(map(str, given.corners)) + " |\n")
    sys.stdout.write("|---" * (2 + len(given.corners)) + "|\n")
    for command in given.commands:
        base_s, _, _ = cell(command, given.maps[0], LEAST_CORNERS, given.limit_s)
        for kind in given.maps:
            cells = row(command, kind, given.corners, given.limit_s, base_s, notes)
            sys.stdout.write(f"| {command} | {kind} | " + " | ".join(cells) + " |\n")
            sys.stdout.flush()
    sys.stdout.writelines(f"\n{note}" for note in notes)


if __name__ == "__main__":
    main()
