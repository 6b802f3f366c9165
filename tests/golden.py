"""Record what every command writes for shipped designs and fixed seeds; compare recordings.

    python tests/golden.py record OUT        # with the vinefab that is installed
    python tests/golden.py compare OLD NEW   # names what differs; exit code 1 if anything

A change that is meant to move code and not results records before and after. Records of runs
(SQLite) are left out: they hold times. So are lines about times and commits.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DESIGNS = (
    "cave_explorer",
    "cave_explorer_pieces",
    "grid_explorer",
    "grid_explorer_pieces",
    "plain_vine",
    "six_branch_anchor",
    "three_level_tree",
)
RUN = """schema = "vinefab/run-1"
name = "golden"
[maps]
environment = "{environment}"
count = 3
seed = 5
[task]
name = "{task}"
{extra}
[optimizer]
name = "{optimizer}"
population = 12
generations = 6
seed = 3
[evaluation]
fabricable = {fabricable}
finalists = 3
"""
RUNS = {
    "cmaes_makeable": ("grid", "coverage", "", "cmaes", "true"),
    "cmaes_sight": ("grid", "coverage", 'clip = "sight"', "cmaes", "false"),
    "pso": ("cave", "reach", "", "pso", "false"),
    "particleswarm": ("cave", "coverage", "", "particleswarm", "false"),
    "evolution": ("rubble", "coverage", "", "evolution", "false"),
    "random": ("pegs", "reach", "", "random", "true"),
    "anchoring": ("grid", "anchoring", "", "cmaes", "false"),
    "front": (
        "corridors",
        "coverage",
        'objectives = ["coverage", "film_length"]',
        "nsga2",
        "false",
    ),
}


def _commands(designs: tuple[str, ...] = DESIGNS) -> list[str]:
    """Every command line of the recording, in order; later ones read what earlier ones wrote."""
    kinds = ("grid", "cave", "rubble", "corridors", "pegs")
    lines = [
        f"map {kind} --seed {seed} --out {kind}{seed}.geojson" for kind in kinds for seed in (1, 2)
    ]
    lines += [
        f"map info {kind}1.geojson --width-mm 20 --json {kind}_info.json --svg {kind}.svg"
        for kind in kinds
    ]
    for design in designs:
        for kind in kinds:
            name = f"{design}_{kind}"
            lines.append(f"grow {design} --map {kind}1.geojson --json {name}.json --svg {name}.svg")
            lines.append(
                f"grow {design} --map {kind}2.geojson --body inflated --json {name}_wide.json"
            )
        for task in ("coverage", "reach", "anchoring"):
            lines.append(
                f"score {design} --task {task} --maps grid1.geojson --maps cave1.geojson --poses 3"
                f" --json {design}_{task}.score.json"
            )
        lines.append(f"check {design} --json {design}.checks.json --svg {design}.checks.svg")
        lines.append(f"check {design} --map grid1.geojson --json {design}_map.checks.json")
        lines.append(f"fabricate {design} --out {design}_package --allow-uncalibrated")
        lines.append(
            f"fabricate {design} --out {design}_two --process weld+cut --allow-uncalibrated --r12"
        )
    lines += [
        "grow grid_explorer --map grid1.geojson --animate grown.svg --history 100,300"
        " --json history.json",
        "grow grid_explorer --map grid1.geojson --animate grown.gif --frames 8",
        "fabricate six_branch_anchor --copies 2 --with plain_vine --out nested"
        " --allow-uncalibrated",
        "fabricate long.toml --out tiled --allow-uncalibrated",
        "check broken.toml --fix mended.toml --json broken.json",
        "coupon --out coupons",
        "profiles --json profiles.json",
        "profiles co2_60w__stretchlon_200 --json profile.json",
        "rig grid1.geojson --fit-mm 300 --out rig",
        "rig cave1.geojson --style board --lid --fit-mm 300 --out rig_board",
        "report grid_explorer --environment grid --count 6 --out report.html --json report.json",
        "report six_branch_anchor --environment cave --count 4 --out anchor.html"
        " --json anchor.json",
        "compare grid_explorer plain_vine --environment grid --count 6 --out compare.html"
        " --json compare.json",
        "map import drawing.svg --scale-mm-per-unit 1 --out drawing.geojson",
        "map import points.csv --out points.geojson",
        "map import world.yaml --scale-mm-per-unit 100 --out world.geojson",
    ]
    for name in RUNS:
        lines.append(f"optimize run_{name}.toml --out run_{name} --json run_{name}.json")
    return lines


DRAWING = """<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="200mm" \
viewBox="0 0 300 200">
<rect x="5" y="5" width="290" height="190"/><circle cx="80" cy="80" r="20"/>
<path d="M150 60 L200 70 L180 120 Z M220 120 q 20 -30 40 0 a 15 15 0 0 1 -40 0 z"/></svg>
"""
POINTS = "polygon,x_mm,y_mm\n" + "".join(
    f"{name},{x},{y}\n"
    for name, ring in {
        "bounds": ((0, 0), (200, 0), (200, 150), (0, 150)),
        "a": ((50, 60), (80, 60), (70, 90)),
        "b": ((120, 70), (150, 80), (140, 110), (110, 100)),
    }.items()
    for x, y in ring
)
LONG = """schema = "vinefab/design-1"
name = "long"
[trunk]
length = 1500.0
[[level]]
branches = 2
length = 300.0
angle_deg = 80.0
[build]
widths_mm = [40.0, 24.0]
"""
BROKEN = LONG.replace("1500.0", "200.0").replace("80.0", "14.0").replace("24.0", "38.0")


def _ros_map(folder: Path) -> None:
    cells = bytearray(b"\xfe" * 3600)
    for row in range(60):
        for column in range(60):
            border = row in (0, 59) or column in (0, 59)
            block = (row // 12 + column // 12) % 2 and row % 12 < 5 and column % 12 < 5
            if border or block:
                cells[60 * row + column] = 0
    (folder / "world.pgm").write_bytes(b"P5\n60 60\n255\n" + bytes(cells))
    (folder / "world.yaml").write_text(
        "image: world.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def record(folder: Path) -> None:
    """Run every command in ``folder``; what each prints stands in ``said.txt``."""
    folder.mkdir(parents=True)
    for name, (environment, task, extra, optimizer, fabricable) in RUNS.items():
        text = RUN.format(
            environment=environment,
            task=task,
            extra=extra,
            optimizer=optimizer,
            fabricable=fabricable,
        )
        (folder / f"run_{name}.toml").write_text(text)
    (folder / "drawing.svg").write_text(DRAWING)
    (folder / "points.csv").write_text(POINTS)
    (folder / "long.toml").write_text(LONG)
    (folder / "broken.toml").write_text(BROKEN)
    _ros_map(folder)
    environment_variables = os.environ | {
        "PYTHONHASHSEED": "0",
        "SOURCE_DATE_EPOCH": "0",
        "COLUMNS": "100",
        "NO_COLOR": "1",
    }
    with (folder / "said.txt").open("w", encoding="utf-8") as said:
        for line in _commands():
            done = subprocess.run(
                [sys.executable, "-m", "vinefab", *line.split()],
                cwd=folder,
                env=environment_variables,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
            )
            said.write(f"$ vinefab {line}\n{done.stdout}{done.stderr}exit {done.returncode}\n\n")
            said.flush()


_DIGEST = re.compile(r"(written by vinefab [\w.]+) \[[0-9a-f]{16}\]")
_TIMED = re.compile(r"^time: |elapsed|took|commit|/tmp/|^file /|^ \"file\": |busy|per second")


def _without_times(value: object) -> object:
    """Take what a run measured of itself out of its JSON."""
    if isinstance(value, dict):
        kept = {key: _without_times(part) for key, part in value.items()}
        return {key: part for key, part in kept.items() if key not in {"times", "seconds"}}
    return [_without_times(part) for part in value] if isinstance(value, list) else value


def _content(path: Path) -> str:
    """A hash of what must not change: without times, versions of packages and paths."""
    data = path.read_bytes()
    if path.name.startswith("run_") and path.suffix == ".json":
        text = json.dumps(_without_times(json.loads(data)))
        data = _DIGEST.sub(r"\1", text).encode()
    elif path.suffix in {".html", ".json", ".txt", ".toml", ".svg", ".dxf", ".csv", ".geojson"}:
        text = _DIGEST.sub(r"\1", data.decode("utf-8", "replace"))
        lines = text.splitlines(keepends=True)
        text = "".join(line for line in lines if len(line) > 2000 or not _TIMED.search(line))
        data = text.encode()
    return hashlib.sha256(data).hexdigest()


def compare(old: Path, new: Path) -> int:
    """Print every file that stands in one recording only, or with other content."""

    def files(folder: Path) -> set[str]:
        return {
            str(path.relative_to(folder))
            for path in folder.rglob("*")
            if path.is_file() and ".sqlite" not in path.name and path.name != "MANIFEST.sha256"
        }

    before, after = files(old), files(new)
    different = sorted(before ^ after)
    different += [
        name for name in sorted(before & after) if _content(old / name) != _content(new / name)
    ]
    for name in different:
        place = (
            ""
            if name in before & after
            else (" (only before)" if name in before else " (only after)")
        )
        sys.stdout.write(f"differs: {name}{place}\n")
    sys.stdout.write(f"{len(before & after)} files compared, {len(different)} differ\n")
    return 1 if different else 0


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] == "record":
        record(Path(sys.argv[2]))
    elif len(sys.argv) == 4 and sys.argv[1] == "compare":
        raise SystemExit(compare(Path(sys.argv[2]), Path(sys.argv[3])))
    else:
        raise SystemExit(__doc__)
