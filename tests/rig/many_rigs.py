"""Rigs of many maps in many variants, each looked at with trimesh and shapely, not with vinefab.

    python tests/rig/many_rigs.py OUT [MAP.geojson ...] [--only VARIANT,...]

Without map files it makes its own. One line per rig goes to OUT/rigs.csv: map, variant, exit code,
processor and wall time (s), printed parts, worst share by which a solid's volume and the plan of
the walls are off, and what is wrong. Folders of rigs with a problem are kept.
"""

import csv
import json
import multiprocessing
import os
import resource
import shutil
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import shapely
import trimesh
from shapely import Polygon, box
from shapely.affinity import rotate, translate

VARIANTS = {
    "plate_shells": ("--style", "plate"),
    "plate_solid": ("--style", "plate", "--wall-mm", "0", "--markers", "paper", "--joint", "none"),
    "board_shells": ("--style", "board", "--lid"),
    "board_tops": ("--style", "board", "--top-mm", "1.2", "--markers", "print"),
    "board_solid": ("--style", "board", "--wall-mm", "0", "--markers", "paper"),
    "auto_fitted": ("--fit-mm", "400", "--printer", "generic_256", "--design", "grid_explorer"),
}
LIMIT_S = 240.0
LEAST_FREE = 0.05  # mm around walls: what counts as a cavity does not reach the free space
MOST_SHARE = 1e-3


def special_maps() -> dict[str, tuple[Polygon, list[Polygon], list[str]]]:
    """Return bounds, obstacles and ``--start`` words of maps that no generator makes."""
    room = box(0, 0, 400, 300)
    stones = [
        rotate(box(x, y, x + 50, y + 30), 7 * x + y) for x in (80, 200, 300) for y in (70, 190)
    ]
    ring = box(120, 100, 280, 200) - box(130, 110, 270, 190)
    alcove = shapely.union_all([room, box(-60, 130, 0, 170)])
    touching = [
        box(0, 100, 90, 130),
        box(310, 200, 400, 300),
        box(150, 0, 170, 80),
        box(0, 0, 30, 30),
    ]
    far = [translate(stone, 5e5, -3e5) for stone in stones]
    return {
        "side_left": (room, stones, ["left side"]),
        "side_right": (room, stones, ["right side"]),
        "side_top": (room, stones, ["top side"]),
        "side_bottom": (room, stones, ["bottom side"]),
        "area_start": (room, stones, ["area 140,40 190,140, heading 90+-20"]),
        "line_start": (room, stones, ["line 20,60 20,240, heading 0+-20"]),
        "middle_start": (room, stones, ["160,150,30"]),
        "four_starts": (room, stones, ["15,150,0", "385,150,180", "200,15,90", "160,285,270"]),
        "corner_start": (room, stones, ["20,20,45"]),
        "no_start": (room, stones, []),
        "bounds_with_holes": (
            room - box(100, 100, 160, 160) - box(250, 60, 330, 110),
            [],
            ["15,150,0"],
        ),
        "hollow_obstacle": (room, [ring], ["15,150,0"]),
        "walls_touch_border": (room, touching, ["200,15,90"]),
        "over_the_border": (room, [box(-20, 100, 90, 130), box(350, 250, 450, 350)], ["200,15,90"]),
        "corners_touch": (room, [box(100, 100, 150, 150), box(150, 150, 200, 200)], ["200,15,90"]),
        "overlapping": (room, [box(100, 100, 200, 200), box(150, 150, 250, 260)], ["200,15,90"]),
        "round_hall": (
            shapely.Point(200, 200).buffer(200),
            [box(150, 180, 240, 230)],
            ["200,20,90"],
        ),
        "l_shaped": (room - box(200, 150, 400, 300), [box(60, 80, 100, 120)], ["15,250,270"]),
        "alcove": (alcove, stones, ["-45,150,0"]),
        "thin_walls": (room, [box(100, 0, 100.3, 200), box(200, 100, 200.6, 300)], ["15,150,0"]),
        "narrow_slits": (room, [box(100, 50, 150, 250), box(150.4, 50, 200, 250)], ["15,150,0"]),
        "far_away": (translate(room, 5e5, -3e5), far, ["500015,-299850,0"]),
        "tiny": (box(0, 0, 60, 60), [box(20, 25, 34, 40), box(44, 10, 50, 30)], ["30,6,90"]),
        "turned": (
            rotate(room, 23),
            [rotate(s, 23, origin=(200, 150)) for s in stones],
            ["200,130,23"],
        ),
    }


def make_maps(folder: Path) -> list[Path]:
    """Write the maps, and return their files."""
    for name, (bounds, obstacles, starts) in special_maps().items():
        features = [("bounds", bounds), *(("obstacle", one) for one in obstacles)]
        content = {
            "type": "FeatureCollection",
            "features": [
                {
                    "type": "Feature",
                    "properties": {"role": role},
                    "geometry": shapely.geometry.mapping(shape),
                }
                for role, shape in features
            ],
        }
        plain = folder / f"{name}_plain.json"
        plain.write_text(json.dumps(content))
        words = [word for one in starts for word in ("--start", one)]
        vinefab("map", "import", str(plain), *words, "--out", str(folder / f"{name}.geojson"))
        plain.unlink()
    for kind, seeds in (("grid", 5), ("cave", 5), ("corridors", 5), ("pegs", 4), ("rubble", 5)):
        for seed in range(seeds):
            vinefab(
                "map", kind, "--seed", str(seed), "--out", str(folder / f"{kind}_{seed}.geojson")
            )
    for name, words in {
        "grid_concave": ("grid", "--concavity", "1", "--seed", "3"),
        "grid_tiny": ("grid", "--size-mm", "60", "--columns", "2", "--rows", "2", "--gap-mm", "3",
                      "--start-clearance-mm", "2", "--start-spread-x-mm", "1"),
        "grid_3m": ("grid", "--size-mm", "3000", "--columns", "8", "--rows", "8"),
        "rubble_2m": ("rubble", "--size-mm", "2000"),
    }.items():  # fmt: skip
        vinefab("map", *words, "--out", str(folder / f"{name}.geojson"))
    return sorted(folder.glob("*.geojson"))


def vinefab(*words: str, log: Path = Path(os.devnull)) -> tuple[int, float]:
    """Run a command line in a process of its own; return exit code and processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = multiprocessing.get_context("fork").Process(target=_in_child, args=(words, log))
    process.start()
    process.join(LIMIT_S * 2.5)
    if process.is_alive():
        process.kill()
        process.join()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    code = process.exitcode if process.exitcode is not None else -1
    if code and log.name == os.devnull:
        sys.stderr.write(f"failed: {' '.join(words)}\n")
    return code, spent


def _in_child(words: tuple[str, ...], log: Path) -> None:
    from vinefab.cli.main import main  # noqa: PLC0415

    resource.setrlimit(resource.RLIMIT_CPU, (int(LIMIT_S), int(LIMIT_S) + 5))
    with log.open("w") as file, redirect_stdout(file), redirect_stderr(file):
        code = main(words)
    os._exit(code)


def problems_of(folder: Path, world: Path) -> tuple[list[str], dict[str, float]]:
    """Return what is wrong with a rig's files, and its figures."""
    rig = json.loads((folder / "rig.json").read_text())
    printer, options = rig["printer"], rig["options"]
    margin = 2.0 * options["bed_margin_mm"]
    room = np.array([printer[f"bed_{side}_mm"] - margin for side in ("width", "depth")])
    problems: list[str] = []
    walls: list[shapely.Geometry] = []
    printed = [part for part in [*rig["parts"], *rig["extras"]] if part["file"].endswith(".stl")]
    worst = 0.0
    for part in printed:
        mesh = trimesh.load(folder / part["file"], force="mesh")
        if not (mesh.is_watertight and mesh.is_winding_consistent and mesh.is_volume):
            problems.append(f"{part['file']} is no closed oriented solid")
        off = abs(mesh.volume / part["volume_mm3"] - 1.0)
        worst = max(worst, off)
        if off > 1e-4:
            problems.append(f"{part['file']} has a volume {off:.2%} off")
        if (mesh.extents > [*(room + 1e-3), printer["height_mm"]]).any():
            problems.append(f"{part['file']} does not fit the printer")
        if part in rig["parts"]:
            walls.append(cut(mesh, np.array(part["transform_to_map"]), options))
    named = {Path(part["file"]).name for part in printed} | {bed["file"] for bed in rig["beds"]}
    missing = [name for name in named if not (folder / name).is_file()]
    problems += [f"{name} is missing" for name in missing]
    figures = {"parts": len(printed), "volume_off": worst}
    inside, solid, thick_mm2 = plan_of(world, rig)
    free = inside.difference(solid).buffer(-LEAST_FREE / options["scale"], join_style="mitre")
    shapes = shapely.get_parts(shapely.union_all(walls))
    built = shapely.union_all([filled(shape, free) for shape in shapes]).intersection(inside)
    off_mm2 = built.symmetric_difference(solid).area
    figures["plan_off"] = max(0.0, off_mm2 - thick_mm2) / max(solid.area, 0.01 * inside.area)
    if figures["plan_off"] > MOST_SHARE:
        problems.append(f"walls differ from the map by {figures['plan_off']:.3%}")
    return problems, figures


def filled(shape: Polygon, free: shapely.Geometry) -> Polygon:
    """Return a cross-section without the holes that no free space reaches."""
    return Polygon(
        shape.exterior, [hole for hole in shape.interiors if free.intersects(Polygon(hole))]
    )


def cut(mesh: trimesh.Trimesh, to_map: np.ndarray, options: dict[str, float]) -> shapely.Geometry:
    """Return a part's cross-section at half the obstacles' height, in map coordinates."""
    z = (0.5 * options["height_mm"] / options["scale"] - to_map[2, 3]) / to_map[2, 2]
    lines = trimesh.intersections.mesh_plane(mesh, (0.0, 0.0, 1.0), (0.0, 0.0, z))[:, :, :2]
    if not len(lines):
        return Polygon()
    lines = np.round(lines, 6)
    faces = shapely.get_parts(shapely.polygonize(list(shapely.linestrings(lines))))
    shape = shapely.union_all([face for face in faces if is_within(face, lines)])
    return shapely.transform(shape, lambda points: points @ to_map[:2, :2].T + to_map[:2, 3])


def is_within(face: Polygon, lines: np.ndarray) -> bool:
    """Return whether a face of a drawing of lines lies inside the solid: odd crossings of a ray."""
    x, y = face.representative_point().coords[0]
    (x_1, y_1), (x_2, y_2) = lines[:, 0].T, lines[:, 1].T
    above = (y_1 > y) != (y_2 > y)
    at = x_1[above] + (y - y_1[above]) / (y_2 - y_1)[above] * (x_2 - x_1)[above]
    return bool((at > x).sum() % 2)


def plan_of(world: Path, rig: dict) -> tuple[Polygon, shapely.Geometry, float]:
    """Return a map's bounds without holes, its walls within them, and what was made thicker."""
    content = json.loads(world.read_text())
    shapes: dict[str, list[shapely.Geometry]] = {"bounds": [], "obstacle": []}
    for feature in content["features"]:
        role = feature["properties"].get("role") or feature["properties"].get("kind")
        if role in shapes:
            shapes[role].append(shapely.geometry.shape(feature["geometry"]))
    (bounds,) = shapes["bounds"]
    inside = Polygon(bounds.exterior)
    solid = inside - (bounds - shapely.union_all(shapes["obstacle"]))
    return inside, solid, rig["against_map"]["thickened_mm2"]


def main(arguments: list[str]) -> None:
    """Make and look at every rig."""
    out = Path(arguments[0])
    out.mkdir(parents=True, exist_ok=True)
    only = list(VARIANTS)
    if "--only" in arguments:
        at = arguments.index("--only")
        only = arguments.pop(at + 1).split(",")
        arguments.pop(at)
    maps = [Path(name) for name in arguments[1:]]
    if not maps:
        (out / "maps").mkdir(exist_ok=True)
        maps = make_maps(out / "maps")
    with (out / "rigs.csv").open("a", newline="") as file:
        table = csv.writer(file)
        for world in maps:
            for name in only:
                folder = out / f"{world.stem}__{name}"
                shutil.rmtree(folder, ignore_errors=True)
                log = out / f"{folder.name}.log"
                words = ("rig", str(world), "--out", str(folder), "--no-pictures", "--allow-empty")
                begun = time.perf_counter()
                code, spent = vinefab(*words, *VARIANTS[name], log=log)
                took = time.perf_counter() - begun
                problems, figures = problems_of(folder, world) if code == 0 else ([], {})
                said = log.read_text().strip().splitlines() if code else problems[:3]
                spread = (f"{figures.get(key, 0):.2e}" for key in ("volume_off", "plan_off"))
                row = [world.stem, name, code, f"{spent:.2f}", f"{took:.2f}"]
                row += [figures.get("parts", 0), *spread, said[-1] if said else ""]
                table.writerow(row)
                file.flush()
                sys.stdout.write(" ".join(map(str, row)) + "\n")
                sys.stdout.flush()
                if code == 0 and not problems:
                    shutil.rmtree(folder)
                    log.unlink()


if __name__ == "__main__":
    main(sys.argv[1:])
