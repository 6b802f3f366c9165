"""Compare the readers of two versions: ``python tests/maps/importers/compare_readers.py OLD 300``.

OLD is a checkout. Foreign files, examples and fuzzed drawings, some of them damaged, are imported
by both; free spaces that differ by more than 1e-6 of their area, and other refusals, are listed.
"""

import contextlib
import json
import math
import os
import random
import subprocess
import sys
import tempfile
from pathlib import Path

import ezdxf
import shapely

from vinefab.core.errors import VinefabError
from vinefab.maps.importers.import_options import PHOTO_SUFFIXES, ImportOptions
from vinefab.maps.importers.importers import import_suffixes

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
FILES = [*(HERE / "foreign").glob("*.*"), *(ROOT / "examples" / "imports").glob("*.*")]
LARGEST = 1e-6


def fuzzed_svg(rng: random.Random) -> bytes:
    def turn() -> str:
        one = rng.choice(["", "rotate({a})", "scale({s})", "skewX({k})", "translate({x} {y})"])
        words = one.format(
            a=rng.randint(-180, 180), s=round(rng.uniform(0.3, 2), 2), k=rng.randint(-30, 30),
            x=rng.randint(-40, 40), y=rng.randint(-40, 40),
        )  # fmt: skip
        return f' transform="{words}"' * bool(words)

    def path(x: float, y: float, r: float) -> str:
        flags = f"{rng.randint(0, 1)} {rng.randint(0, 1)}"
        half = rng.uniform(0.2, 1.5) * r
        piece = rng.choice(
            [f"a{r} {half} {rng.randint(0, 90)} {flags} {r} {half}", f"q{r} 0 {r} {half}",
             f"c{r} {-r} {half} {half} {r} {r}", f"t{r} {half}", f"s{half} 0 {r} {r}",
             f"h{r}v{half}"]
        )  # fmt: skip
        return f"m{x} {y}{piece}{rng.choice(['l-9 5', 'L0 0', ''])}z"

    body = []
    for _ in range(rng.randint(1, 8)):
        x, y, r = rng.randint(20, 480), rng.randint(20, 380), rng.randint(3, 60)
        shape = rng.choice(
            [f'<circle cx="{x}" cy="{y}" r="{r}"', f'<path d="{path(x, y, r)}"',
             f'<rect x="{x}" y="{y}" width="{r}" height="{2 * r}" rx="{rng.uniform(0, r):.3f}"',
             f'<rect x="{x}" y="{y}" width="{r}" height="{r}" rx="3" ry="{rng.uniform(0, r):.3f}"',
             f'<rect x="{x}" y="{y}" width="{r}" height="{r}"',
             f'<ellipse cx="{x}" cy="{y}" rx="{r}" ry="{0.4 * r}"',
             f'<polygon points="{x},{y} {x + r},{y} {x},{y + r}"']
        )  # fmt: skip
        shape += f' fill="{rng.choice(["none", "grey"])}"{turn()}/>'
        body.append(
            rng.choice([shape, f"<g{turn()}>{shape}</g>", f"<symbol>{shape}</symbol>{shape}"])
        )
        if rng.random() < 0.2:
            body.append(f'<defs><g id="d{x}">{shape}</g></defs><use href="#d{x}" x="9" y="{r}"/>')
    frame = '<rect x="-900" y="-900" width="2300" height="2300" fill="none"/>'
    size = rng.choice(['width="500mm" height="400mm" viewBox="0 0 500 400"', ""])
    ns = 'xmlns="http://www.w3.org/2000/svg"'
    return f"<svg {ns} {size}>{frame}{''.join(body)}</svg>".encode()


def fuzzed_dxf(rng: random.Random) -> bytes:
    version = rng.choice(["R2000", "R2010", "R2018"])
    document = ezdxf.new(version)
    document.units = rng.choice([0, 4, 5])
    space = document.modelspace()
    space.add_lwpolyline([(-900, -900), (1400, -900), (1400, 1400), (-900, 1400)], close=True)
    for number in range(rng.randint(1, 6)):
        x, y, r = rng.uniform(20, 480), rng.uniform(20, 380), rng.uniform(3, 60)
        block = document.blocks.new(f"B{number}") if rng.random() < 0.4 else None
        target = space if block is None else block
        below = {"extrusion": (0, 0, rng.choice([1, 1, -1]))}
        kind = rng.randrange(9)
        start, end = rng.uniform(0, 360), rng.uniform(0, 360)
        if kind == 0:
            target.add_circle((x, y), r, dxfattribs=below)
        elif kind == 1:
            corners = [(x, y, rng.uniform(-2, 2)), (x + r, y, rng.uniform(-1, 1)), (x, y + r, 0)]
            target.add_lwpolyline(corners, "xyb", close=True, dxfattribs=below)
        elif kind == 2:
            target.add_ellipse((x, y), (r, 0.3 * r), rng.uniform(0.1, 1))
        elif kind == 3:
            points = [(x + rng.uniform(0, r), y + rng.uniform(0, r), 0) for _ in range(5)]
            target.add_spline().set_closed(points, degree=rng.choice([2, 3]))
        elif kind == 4:
            points = [(x + rng.uniform(0, r), y + rng.uniform(0, r)) for _ in range(4)]
            target.add_spline([*points, points[0]])
        elif kind == 5:
            edges = target.add_hatch(dxfattribs=below).paths.add_edge_path()
            first, last = (
                (x + r * math.cos(math.radians(t)), y + r * math.sin(math.radians(t)))
                for t in (start, end)
            )
            edges.add_arc((x, y), r, start, end, ccw=rng.random() < 0.7)
            edges.add_line(last, first)
        elif kind == 6:
            edges = target.add_hatch().paths.add_edge_path()
            edges.add_ellipse((x, y), (r, 0.2 * r), 0.6, 0, 360)
        elif kind == 7:
            path = target.add_hatch().paths
            path.add_polyline_path([(x, y, rng.uniform(-1, 1)), (x + r, y), (x, y + r)])
            path.add_polyline_path([(x + 1, y + 1), (x + 0.3 * r, y + 1), (x + 1, y + 0.3 * r)])
        else:
            arc = target.add_arc((x, y), r, start, end)
            if rng.random() < 0.8:
                target.add_line(arc.end_point, arc.start_point)
        if block is not None:
            scales = {"xscale": rng.uniform(0.5, 2), "rotation": rng.uniform(0, 360)}
            scales["yscale"] = rng.choice([scales["xscale"], -scales["xscale"], 0.7])
            space.add_blockref(block.name, (rng.uniform(0, 99), 9), dxfattribs=scales)
    with tempfile.TemporaryDirectory() as folder:
        document.saveas(Path(folder) / "drawing.dxf")
        return (Path(folder) / "drawing.dxf").read_bytes()


def damaged(rng: random.Random, data: bytes) -> bytes:
    lines = data.split(b"\n" if data[:4] != b"<svg" else b" ")
    joint = b"\n" if data[:4] != b"<svg" else b" "
    at = rng.randrange(len(lines))
    return joint.join(rng.choice([lines[:at], [*lines[:at], *lines[at + 1 :]]]))


def read_all(folder: Path) -> None:
    """Print for every file its free space, or why it is refused, of the vinefab on PYTHONPATH."""
    readers = import_suffixes()
    kinds = set(readers) - set(PHOTO_SUFFIXES)
    for path in sorted(path for path in [*FILES, *folder.iterdir()] if path.suffix in kinds):
        for words in ({}, {"drawn": "free"}, {"wall_mm": 1.0, "open_lines": "drop"}):
            try:
                world = readers[path.suffix].read(path, ImportOptions(**words))
                area = world.bounds.difference(shapely.union_all(world.obstacles)).wkb_hex
                answer = ["read", area]
            except VinefabError as error:
                answer = [type(error).__name__, str(error)]
            sys.stdout.write(json.dumps([f"{path.name} {words}", *answer]) + "\n")


def answers(checkout: Path, folder: Path) -> dict[str, list[str]]:
    program = [sys.executable, __file__, "--read", str(folder)]
    environment = os.environ | {"PYTHONPATH": str(checkout), "PYTHONWARNINGS": "ignore"}
    lines = subprocess.check_output(program, env=environment, text=True, cwd=folder).splitlines()
    return {name: rest for name, *rest in map(json.loads, lines)}


def main(old: Path, count: int) -> int:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for seed in range(count):
            for kind, make in (("svg", fuzzed_svg), ("dxf", fuzzed_dxf)):
                rng = random.Random(f"{kind} {seed}")  # noqa: S311
                data = make(rng)
                (folder / f"{seed}.{kind}").write_bytes(data)
                if seed % 4 == 0:
                    (folder / f"{seed}_damaged.{kind}").write_bytes(damaged(rng, data))
        before, after = answers(old, folder), answers(ROOT, folder)
    read = listed = 0
    worst = 0.0
    for key, one in before.items():
        other = after[key]
        if one[0] == other[0] == "read":
            read += 1
            areas = [shapely.from_wkb(answer[1]) for answer in (one, other)]
            off = shapely.symmetric_difference(*areas).area / areas[0].area
            worst = max(worst, off)
            if off <= LARGEST:
                continue
            sys.stdout.write(f"{key}: differs by {off:.2g} of its area\n")
        elif one[0] == other[0]:
            continue
        else:
            shown = [answer[1][:200] if answer[0] != "read" else "read" for answer in (one, other)]
            sys.stdout.write(f"{key}: {one[0]} {shown[0]} -> {other[0]} {shown[1]}\n")
        listed += 1
    sys.stdout.write(
        f"{len(before)} imports, {read} read by both, worst {worst:.2g}, {listed} listed\n"
    )
    return listed


if __name__ == "__main__":
    with contextlib.suppress(BrokenPipeError):
        if sys.argv[1] == "--read":
            read_all(Path(sys.argv[2]))
        else:
            main(Path(sys.argv[1]), int(sys.argv[2]))
