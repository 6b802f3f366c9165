"""Damaged files by the thousand: ``python tests/attack/files.py 3000``, or KIND SEED for one;
names of kinds after the count select some.

Every kind of file that a command reads is taken from the repository or made by a command, then
damaged at random (`mutations`) and given to a command that reads it. What must come of it stands
in `attempts`.
"""

import random
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import ezdxf
import numpy as np
import pyogrio
import shapely
from PIL import Image

from vinefab.core.compiling import all_compiled, precompile

sys.path.insert(0, str(Path(__file__).resolve().parent))

from attempts import READ_BACK, VINEFAB, Attempt, Tally, judged
from mutations import mutated

ROOT = Path(__file__).resolve().parents[2]
DESIGN = "designs/plain_vine.toml"
WIDE_CPU_S = 60.0  # for what works long on good input
RUN = """schema = "vinefab/run-1"
name = "tiny"
[maps]
environment = "grid"
count = 1
seed = 1
options = { size_mm = 300.0, columns = 3, rows = 3 }
[task]
name = "coverage"
radius_mm = 50.0
[space]
levels = [2, 2]
length_mm = [10, 205]
angle_deg = [20, 160]
branches = [2, 2]
[build]
trunk_width_mm = 20.0
[growth]
head_on_half_angle_deg = 1.0
[optimizer]
name = "cmaes"
population = 4
generations = 2
seed = 1
[evaluation]
poses_per_map = 1
finalists = 2
final_poses_per_map = 1
"""
IMAGE = b"P5 10 6 255\n" + bytes([254] * 24 + [0] * 2 + [254] * 34)
PLAIN_IMAGE = (
    b"P2\n# cells\n4 4\n255\n" + b"254 254 254 254\n" * 2 + b"254 0 0 254\n254 254 254 254\n"
)
ROS = """image: {image}
resolution: 0.05
origin: [0.0, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="60mm" viewBox="0 0 100 60">
<style>.gone {display: none} #b, .c {fill: none}</style>
<g id="walls" transform="translate(0 0) rotate(0)">
<rect x="0" y="0" width="100" height="60"/><circle cx="50" cy="30" r="8"/>
<path d="M10 10 h8 v6 q2 3 -4 4 A5 5 0 0 1 10 10 Z"/><polygon points="70,10 80,10 75,18"/>
<defs><ellipse id="e" cx="3" cy="3" rx="3" ry="2"/></defs><use href="#e" x="80" y="40"/>
<rect class="gone" width="9" height="9"/></g></svg>
"""
CSV = "".join(
    f"{name},{x},{y}\n"
    for name, ring in (
        ("room", [(0, 0), (100, 0), (100, 60), (0, 60)]),
        ("pillar", [(40, 20), (60, 20), (60, 40), (40, 40)]),
    )
    for x, y in ring
)
GEOJSON = (
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, '
    '"geometry": {"type": "Polygon", "coordinates": [[[0, 0], [100, 0], [100, 60], [0, 60], '
    "[0, 0]], [[40, 20], [60, 20], [60, 40], [40, 20]]]}}]}"
)
RESULTS = """measure,setting,value,unit,uncertainty,note
kerf_piece,weldcut,49.74,mm,,side
kerf_piece,cut,49.83,mm,,side
seam,weldcut,0.50,mm,,rim
seam,weldcut,0.52,mm,,rim
width,10,9.86,mm,,
width,20,19.84,mm,,
burst,20,82,kPa,,seam
burst,20,84,kPa,,seam
burst,20,80,kPa,,seam
friction_incline,,15,deg,,
friction_incline,,16,deg,,
"""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of file, and the commands that read it."""

    targets: tuple[str, ...]  # patterns in the stock: one of these files is damaged
    commands: tuple[str, ...]  # {file} is the damaged one
    beside: tuple[str, ...] = ()  # patterns in the stock: what lies in the folder as well
    rewrites: bool = False
    endless: bool = False
    cpu_s: float = 10.0


IMPORT = ("map import {file} --out out.geojson -q",)
ON_GRID = "grid.geojson"
KINDS: dict[str, Kind] = {
    "design": Kind(
        ("designs/*.toml", "run/best.toml"),
        (
            "check {file} -q --json out.json",
            "check {file} -q --svg out.svg --dxf out.dxf",
            "fix {file} -q --out out.toml",
            "grow {file} --map grid.geojson --json out.json --svg out.svg -q",
            "score {file} --maps grid.geojson --json out.json -q",
            "fabricate {file} --out out --allow-uncalibrated -q",
        ),
        (ON_GRID,),
        cpu_s=WIDE_CPU_S,
    ),
    "run": Kind(
        ("tiny.toml", "short/*.toml"),
        ("optimize {file} --out out -q",),
        endless=True,
        cpu_s=20.0,
    ),
    "recipe": Kind(
        ("laser_profiles/recipes/*.toml",),
        (
            "profiles {file} -q --json out.json",
            "check designs/plain_vine.toml --recipe {file} -q --json out.json",
            "fabricate designs/plain_vine.toml --recipe {file} --allow-uncalibrated --out out -q",
            "coupon --recipe {file} --out out -q",
        ),
        ("laser_profiles/*/*.toml", DESIGN),
    ),
    "machine": Kind(
        ("laser_profiles/machines/co2_60w.toml", "laser_profiles/materials/stretchlon_200.toml"),
        (
            "profiles {file} -q --json out.json",
            "check designs/plain_vine.toml --recipe laser_profiles/recipes/"
            "co2_60w__stretchlon_200.toml -q --json out.json",
            "coupon --recipe laser_profiles/recipes/co2_60w__stretchlon_200.toml --out out -q",
        ),
        ("laser_profiles/*/*.toml", DESIGN),
    ),
    "printer": Kind(
        ("laser_profiles/printers/*.toml",),
        ("rig grid.geojson --printer {file} --out out -q --no-pictures",),
        (ON_GRID,),
        cpu_s=WIDE_CPU_S,
    ),
    "map": Kind(
        ("grid.geojson", "cave.geojson"),
        (
            "map info {file} --json out.json -q",
            "map info {file} --svg out.svg -q",
            "grow plain_vine --map {file} --json out.json --svg out.png -q",
            "score plain_vine --maps {file} --json out.json -q",
            "map import {file} --out out.geojson -q",
            "check plain_vine --map {file} --json out.json -q",
        ),
    ),
    "rig map": Kind(
        ("grid.geojson",), ("rig {file} --out out --no-pictures -q",), cpu_s=WIDE_CPU_S
    ),
    "geojson": Kind(("plan.geojson",), IMPORT),
    "svg": Kind(("plan.svg",), IMPORT),
    "dxf": Kind(
        ("plan.dxf", "plan.dxf", "pkg/outline_r12.dxf"),
        (*IMPORT, "map import {file} --out out.geojson -q --open drop"),
    ),
    "csv": Kind(("plan.csv",), IMPORT),
    "ros": Kind(("*.yaml",), IMPORT, ("*.pgm", "*.png")),
    "ros image": Kind(
        ("cells.pgm", "plain.pgm", "picture.png"),
        ("map import {stem}.yaml --out out.geojson -q",),
        ("*.yaml",),
    ),
    "photo": Kind(
        ("floor.png", "floor.jpg"),
        (
            "map import {file} --points 0,0;160,0 --distance-mm 320 --out out.geojson -q",
            "map import {file} --points 9,99;150,99;150,9;9,9 --rectangle-mm 280,180 "
            "--out out.geojson --preview out.png -q",
            "map import {file} --marker-mm 30 --out out.geojson -q",
        ),
    ),
    "layers": Kind(
        ("layers.gpkg", "layers.fgb", "layers.shp"), (*IMPORT, f"{IMPORT[0]} --drawn free")
    ),
    "shapefile": Kind(
        ("layers.shx", "layers.dbf", "layers.prj", "layers.cpg"),
        ("map import layers.shp --out out.geojson -q",),
        ("layers.s*", "layers.[dpc]*"),
    ),
    "robot photo": Kind(
        ("robot.png",),
        (
            "observe {file} --map grid.geojson --design plain_vine --json out.json -q "
            "--out out.html --corners 10,310,310,310,310,10,10,10",
        ),
        (ON_GRID,),
        cpu_s=20.0,
    ),
    "rig of a photo": Kind(
        ("rig/rig.json",),
        ("observe robot.png --map grid.geojson --design plain_vine --rig {file} -q",),
        (ON_GRID, "robot.png"),
        cpu_s=20.0,
    ),
    "film outline": Kind(
        ("film.geojson", "film.svg"),
        (
            "observe robot.png --map grid.geojson --design plain_vine --outline {file} -q "
            "--json out.json --corners 10,310,310,310,310,10,10,10",
        ),
        (ON_GRID, "robot.png"),
        cpu_s=20.0,
    ),
    "observation": Kind(
        ("seen.json",),
        ("fit-observations {file} --out out.toml --json out.json -q",),
        (ON_GRID,),
        cpu_s=20.0,
    ),
    "contacts": Kind(
        ("contacts.toml",),
        (
            "grow plain_vine --map grid.geojson --contacts {file} --json out.json -q",
            "score plain_vine --maps grid.geojson --contacts {file} --json out.json -q",
            "aim plain_vine --map grid.geojson --contacts {file} --deployments 5000 -q "
            "--json out.json",
        ),
        (ON_GRID,),
        cpu_s=30.0,
    ),
    "started map": Kind(
        ("started.geojson",),
        (
            "map info {file} --json out.json --svg out.svg -q",
            "grow plain_vine --map {file} --json out.json -q",
            "aim plain_vine --map {file} --where starts --deployments 5000 --json out.json -q",
        ),
        cpu_s=20.0,
    ),
    "results": Kind(
        ("results.csv", "coup/results.csv"), ("calibrate {file} --out out.toml --json out.json -q",)
    ),
    "record": Kind(
        ("run/run.sqlite",),
        (
            "runs run --json out.json -q",
            "runs run --rebuild out -q",
            "optimize tiny.toml --out run --resume -q",
        ),
        ("tiny.toml", "run/*"),
        rewrites=True,
    ),
    "own run": Kind(
        ("run/*.toml", "run/*.json", "run/*.csv", "run/MANIFEST*"),
        ("runs run --json out.json -q", "optimize tiny.toml --out run --resume -q"),
        ("tiny.toml", "run/*"),
        rewrites=True,
    ),
    "package": Kind(
        ("pkg/MANIFEST.sha256", "pkg/checks.json", "pkg/job.json", "pkg/outline.svg"),
        ("fabricate designs/plain_vine.toml --out pkg --allow-uncalibrated -q",),
        (DESIGN, "pkg/*", "mine.txt"),
        rewrites=True,
    ),
    "rig": Kind(
        ("rig/rig.json", "rig/*.stl", "rig/MANIFEST.sha256"),
        ("check designs/plain_vine.toml --rig rig -q --json out.json",),
        (DESIGN, "rig/*"),
    ),
    "growth": Kind(
        ("g.json", "pkg/job.json", "k.json"),
        ("map import {file} --out out.geojson -q", "map info {file} -q"),
    ),
    "read back": Kind(("pkg/outline.*", "rig/*.stl", "rig/*.3mf"), (f"{READ_BACK} {{file}}",)),
}

OBSERVE = "observe robot.png --map grid.geojson --design plain_vine --json seen.json -q"
MAKE = (
    "map grid --columns 3 --rows 3 --size 300 --out grid.geojson -q",
    "map cave --size 300 --out cave.geojson -q",
    "map start grid.geojson --start left|side,heading|0+-20 --out started.geojson -q",
    f"{OBSERVE} --corners 10,310,310,310,310,10,10,10",
    "fit-observations seen.json --out contacts.toml -q",
    "grow plain_vine --map grid.geojson --json g.json -q",
    "check plain_vine --json k.json -q",
    "fabricate plain_vine --out pkg --allow-uncalibrated --r12 -q",
    "coupon --out coup -q",
    "rig grid.geojson --out rig --no-pictures -q",
    "optimize tiny.toml --out run -q",
)


def words_of(line: str) -> tuple[str, ...]:
    """Return the words of a command line, where ``|`` stands for a space in a word."""
    return tuple(word.replace("|", " ") for word in line.split())


def write_drawings(folder: Path) -> None:
    """Write the sources of maps, and other small files."""
    texts = {"tiny.toml": RUN, "plan.svg": SVG, "plan.csv": CSV, "plan.geojson": GEOJSON}
    for name, text in (texts | {"results.csv": RESULTS, "mine.txt": "mine"}).items():
        (folder / name).write_text(text)
    for image in ("cells.pgm", "plain.pgm", "picture.png"):
        (folder / image).with_suffix(".yaml").write_text(ROS.format(image=image))
    Image.frombytes("L", (10, 6), IMAGE[-60:]).save(folder / "picture.png")
    drawing = ezdxf.new("R2010")
    for ring in ([(0, 0), (100, 0), (100, 60), (0, 60)], [(20, 20), (40, 20), (40, 40, 0.3)]):
        drawing.modelspace().add_lwpolyline(ring, close=True)
    drawing.blocks.new("PILLAR").add_circle((0, 0), 3)
    drawing.modelspace().add_blockref("PILLAR", (70, 30))
    drawing.saveas(folder / "plan.dxf")
    (folder / "cells.pgm").write_bytes(IMAGE)
    (folder / "plain.pgm").write_bytes(PLAIN_IMAGE)


def _write_surveys(folder: Path) -> None:
    """Write photos of a floor and of a robot, outlines of its film, and layers of a survey."""
    floor = Image.new("RGB", (160, 120), (200, 200, 196))
    floor.paste((20, 20, 20), (60, 40, 90, 70))
    for name in ("floor.png", "floor.jpg"):
        floor.save(folder / name)
    photo = Image.new("RGB", (320, 320), (180, 180, 176))
    photo.paste((214, 88, 40), (147, 240, 173, 300))
    photo.save(folder / "robot.png")
    (folder / "film.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="320" height="320" viewBox="0 0 320 320">'
        '<rect x="147" y="240" width="26" height="60"/></svg>'
    )
    ring = [[137, 10], [163, 10], [163, 70], [137, 70], [137, 10]]
    (folder / "film.geojson").write_text(f'{{"type": "Polygon", "coordinates": [{ring}]}}')
    shapes = shapely.to_wkb([shapely.box(0, 0, 100, 60), shapely.box(40, 20, 60, 40)])
    names = np.array(["room", "pillar"], dtype=object)
    for suffix in ("gpkg", "shp", "fgb"):
        pyogrio.raw.write(
            folder / f"layers.{suffix}",
            np.asarray(shapes, dtype=object),
            [names],
            ["name"],
            geometry_type="Polygon",
            crs="EPSG:25832",
        )


def stock(folder: Path, make: Sequence[str] = MAKE) -> Path:
    """Fill a folder with a good file of every kind."""
    for name in ("designs", "laser_profiles"):
        shutil.copytree(ROOT / name, folder / name)
    (folder / "short").mkdir()
    for path in (ROOT / "examples").glob("*.toml"):
        text = re.sub(r"(generations|population) = \d+", r"\1 = 3", path.read_text())
        if 'schema = "vinefab/run' in text:
            (folder / "short" / path.name).write_text(text)
    write_drawings(folder)
    _write_surveys(folder)
    commands = (
        Attempt(name=line, arguments=words_of(line), folder=str(folder), rewrites=True, cpu_s=99)
        for line in make
    )
    # An attempt that compiles is ended before it has said anything, and so is the next.
    precompile(all_compiled())
    for verdict in judged(commands):
        if verdict.outcome not in ("accepted", "findings"):
            raise RuntimeError(f"{verdict.name}: {verdict.reason} {verdict.words}")
    return folder


def attempt_of(kind_name: str, seed: int, good: Path, folder: Path) -> Attempt:
    """Damage one file of a kind in a new folder."""
    kind, rng = KINDS[kind_name], random.Random(f"{kind_name} {seed}")  # noqa: S311
    targets = sorted({path for one in kind.targets for path in good.glob(one) if path.is_file()})
    target = rng.choice(targets)
    work = folder / "work"
    for path in {target, *(path for one in kind.beside for path in good.glob(one))}:
        if path.is_file():
            copy = work / path.relative_to(good)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)
    name = str(target.relative_to(good))
    command = rng.choice(kind.commands)
    (work / name).write_bytes(mutated(rng, target.read_bytes()))
    return Attempt(
        name=f"{kind_name.replace(' ', '_')} {seed}",
        arguments=tuple(command.format(file=name, stem=Path(name).stem).split()),
        folder=str(work),
        rewrites=kind.rewrites,
        endless=kind.endless,
        cpu_s=kind.cpu_s,
    )


def attempts(plan: Sequence[tuple[str, int]], good: Path, folder: Path) -> Iterator[Attempt]:
    """Yield attempts, each in a folder that is removed when the next one is asked for."""
    for number, (kind, seed) in enumerate(plan):
        own = folder / str(number)
        yield attempt_of(kind, seed, good, own)
        shutil.rmtree(own, ignore_errors=True)


def attack(plan: Sequence[tuple[str, int]], good: Path, program: str = VINEFAB) -> Tally:
    """Try damaged files, and count."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        verdicts = judged(attempts(plan, good, Path(folder)), program)
        for (kind, _), verdict in zip(plan, verdicts, strict=True):
            tally.add(kind, verdict)
            if verdict.outcome == "failed":
                sys.stderr.write(f"{verdict.name}: {verdict.reason}\n")
    return tally


def plan_of(total: int, kinds: Sequence[str], first_seed: int = 0) -> list[tuple[str, int]]:
    """Return which kinds are tried with which seeds, the kinds in turn."""
    numbers = count(first_seed)
    rounds = [next(numbers) for _ in range(-(-total // len(kinds)))]
    return [(kind, seed) for kind in kinds for seed in rounds][: total or None]


def show(kind: str, seed: int, good: Path) -> int:
    """Do one attempt again, keep its files, and print all about it."""
    folder = Path(tempfile.mkdtemp(prefix="attack-"))
    attempt = attempt_of(kind, seed, good, folder)
    (verdict,) = judged(iter([attempt]))
    sys.stdout.write(f"cd {attempt.folder}; vinefab {' '.join(attempt.arguments)}\n{verdict}\n")
    return 1 if verdict.outcome == "failed" else 0


def main(arguments: Sequence[str]) -> int:
    """Print the counts; return 1 if anything failed."""
    with tempfile.TemporaryDirectory() as folder:
        good = stock(Path(folder) / "good")
        if len(arguments) == 2 and arguments[1].isdigit():
            return show(arguments[0].replace("_", " "), int(arguments[1]), good)
        kinds = [name.replace("_", " ") for name in arguments[1:]] or list(KINDS)
        tally = attack(plan_of(int(arguments[0]) if arguments else 3_000, kinds), good)
    sys.stdout.write(tally.report("tests/attack/files.py"))
    return 1 if tally.failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
