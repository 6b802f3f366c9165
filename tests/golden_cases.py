"""What `golden.py` records: every case by name, what it reads, and what stands in each folder.

A case is a text. Each of its lines is a command line of ``vinefab``, run in the case's own empty
folder; what it needs it makes itself. A text that begins with ``import`` is Python:
``show(name, value)`` writes a value's public attributes as ``name.json``.
"""

import io
import struct
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DESIGNS = (
    "cave_explorer_levels",
    "cave_explorer_pieces_levels",
    "grid_explorer_levels",
    "grid_explorer_pieces_levels",
    "plain_vine",
    "six_branch_anchor",
    "three_level_tree",
)
KINDS = ("grid", "cave", "rubble", "corridors", "pegs")

# --- what cases read

DRAWING = """<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="200mm" \
viewBox="0 0 300 200">
<rect x="5" y="5" width="290" height="190"/><circle cx="80" cy="80" r="20"/>
<path d="M150 60 L200 70 L180 120 Z M220 120 q 20 -30 40 0 a 15 15 0 0 1 -40 0 z"/></svg>
"""
RINGS = {
    "bounds": ((0, 0), (200, 0), (200, 150), (0, 150)),
    "a": ((50, 60), (80, 60), (70, 90)),
    "b": ((120, 70), (150, 80), (140, 110), (110, 100)),
}
POINTS = "polygon,x_mm,y_mm\n" + "".join(
    f"{name},{x},{y}\n" for name, ring in RINGS.items() for x, y in ring
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
RESULTS = """measure,setting,value,unit,uncertainty
kerf_piece,weldcut,49.74,mm,0.02
kerf_piece,cut,49.83,mm,0.02
seam,weldcut,0.5,mm,0.05
width,5,4.88,mm,0.05
width,20,19.84,mm,0.05
width,40,39.86,mm,0.05
burst,20,80,kPa,2
burst,20,83,kPa,2
burst,20,79,kPa,2
peel,25,10,N,0.5
crotch_burst,8,45,kPa,
lap_survived,20,60,kPa,
matrix,46.8 6,weldcut,,
matrix,81.8 6,weldcut,,
matrix,143.0 6,cut,,
friction_incline,,20,deg,1
"""
RUN = """schema = "vinefab/run-1"
name = "golden"
[maps]
environment = "grid"
options = {{ size_mm = 250.0, columns = 3, rows = 3 }}
count = 2
seed = 5
[task]
name = "{task}"
{extra}
[optimizer]
population = 8
generations = 4
seed = 3
{optimizer}
[evaluation]
fabricable = {fabricable}
finalists = 2
"""
PIECES = "[build]\ntrunk_width_mm = 24.0\nwidth_ratio = 0.65\npieces = { most = 6 }"
RUNS = {  # task, more of the task and the design, optimizer, makeable only
    "islands": ("coverage", "", "", "true"),
    "islands_free": ("reach", "", 'name = "islands"', "false"),
    "pieces": ("coverage", PIECES, "", "true"),
    "cmaes_makeable": ("coverage", "", 'name = "cmaes"', "true"),
    "cmaes_sight": ("coverage", 'clip = "sight"', 'name = "cmaes"', "false"),
    "pso": ("reach", "", 'name = "pso"', "false"),
    "particleswarm": ("coverage", "", 'name = "particleswarm"', "false"),
    "evolution": ("coverage", "", 'name = "evolution"', "false"),
    "random": ("reach", "", 'name = "random"', "true"),
    "anchoring": ("anchoring", "", 'name = "cmaes"', "false"),
    "front": (
        "coverage",
        'objectives = ["coverage", "film_length"]',
        'name = "nsga2"',
        "false",
    ),
}


def _run_file(name: str) -> str:
    keys = ("task", "extra", "optimizer", "fabricable")
    return RUN.format(**dict(zip(keys, RUNS[name], strict=True)))


def _world() -> bytes:
    """Return a ROS map's cells: a walled field of 60 by 60 with blocks."""
    cells = bytearray(b"\xfe" * 3600)
    for row in range(60):
        for column in range(60):
            border = row in (0, 59) or column in (0, 59)
            if border or ((row // 12 + column // 12) % 2 and row % 12 < 5 and column % 12 < 5):
                cells[60 * row + column] = 0
    return b"P5\n60 60\n255\n" + bytes(cells)


def _shapefile() -> dict[str, bytes]:
    """Return a Shapefile of `RINGS` with its index and its table (ESRI's description, 1998)."""
    records, index, offset = io.BytesIO(), io.BytesIO(), 50
    box = struct.pack("<4d", 0, 0, 200, 150)
    for number, ring in enumerate(RINGS.values(), 1):
        closed = [*ring[:1], *ring[:0:-1], ring[0]]  # clockwise
        points = b"".join(struct.pack("<2d", *point) for point in closed)
        body = struct.pack("<i", 5) + box + struct.pack("<3i", 1, len(closed), 0) + points
        records.write(struct.pack(">2i", number, len(body) // 2) + body)
        index.write(struct.pack(">2i", offset, len(body) // 2))
        offset += 4 + len(body) // 2

    def headed(content: bytes) -> bytes:
        length = struct.pack(">7i", 9994, 0, 0, 0, 0, 0, 50 + len(content) // 2)
        return length + struct.pack("<2i", 1000, 5) + box + bytes(32) + content

    field = b"ID".ljust(11, b"\0") + b"N" + bytes(4) + bytes([1, 0]) + bytes(14)
    count = len(RINGS)
    table = struct.pack("<4BIHH20x", 3, 100, 1, 1, count, 65, 2) + field + b"\r"
    rows = b"".join(b" %d" % number for number in range(count))
    return {
        "rings.shp": headed(records.getvalue()),
        "rings.shx": headed(index.getvalue()),
        "rings.dbf": table + rows + b"\x1a",
    }


def inputs() -> dict[str, bytes]:
    """Return every file that cases may name; a case gets those whose names stand in its text."""
    texts = {f"run_{name}.toml": _run_file(name) for name in RUNS} | {
        "drawing.svg": DRAWING,
        "points.csv": POINTS,
        "long.toml": LONG,
        "broken.toml": BROKEN,
        "results.csv": RESULTS,
        "world.yaml": "image: world.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
    }
    examples = "imports/cave.dxf imports/survey.gpkg imports/scan.png arena/table.jpg"
    examples += " arena/sprig.toml arena/grown_1.jpg arena/grown_2.jpg"
    files = {"rings.shp": _shapefile()["rings.shp"]}
    files |= {Path(name).name: (ROOT / "examples" / name).read_bytes() for name in examples.split()}
    return files | {name: text.encode() for name, text in texts.items()}


BESIDE = {
    "world.yaml": {"world.pgm": _world()},
    "rings.shp": {name: data for name, data in _shapefile().items() if name != "rings.shp"},
}
"""What lies beside a file that names it or needs it."""

# --- the cases

GRID = "map grid --seed 1 --out grid1.geojson"
CAVE = "map cave --seed 1 --out cave1.geojson"
TABLE = (
    "map import table.jpg --marker-mm 30 --height-mm 30 --obstacles 50,84,176,75"
    " --crop 42,42,642,442 --preview preview.png --out arena.geojson"
)
SEEN = (
    "observe grown_{0}.jpg --map arena.geojson --design sprig.toml --pose={1} --obstacle-height 30"
    " --json seen_{0}.json --out seen_{0}.html"
)


def _map_case(kind: str) -> str:
    return "\n".join(
        [f"map {kind} --seed {seed} --out {kind}{seed}.geojson" for seed in (1, 2)]
        + [f"map info {kind}1.geojson --width-mm 20 --json info.json --svg {kind}.svg"]
    )


def _grow_case(design: str) -> str:
    lines = []
    for kind in KINDS:
        lines.append(f"map {kind} --seed 1 --out {kind}.geojson")
        out = f"--json {kind}.json" + (f" --svg {kind}.svg" if kind in ("grid", "cave") else "")
        lines.append(f"grow {design} --map {kind}.geojson {out}")
    lines.append(f"grow {design} --map cave.geojson --body centerline --json line.json")
    return "\n".join(lines)


def _score_case(design: str) -> str:
    maps = "--maps grid1.geojson --maps cave1.geojson --poses 3"
    tasks = ("coverage", "reach", "anchoring")
    lines = [f"score {design} --task {task} {maps} --json {task}.json" for task in tasks]
    return "\n".join([GRID, CAVE, *lines])


def _check_case(design: str) -> str:
    on_map = f"check {design} --map grid1.geojson --json on_map.json"
    return "\n".join([GRID, f"check {design} --json flat.json --svg flat.svg", on_map])


CASES = {
    **{f"map_{kind}": _map_case(kind) for kind in KINDS},
    "map_start": f"""{GRID}
map start grid1.geojson --start "left side, heading 0+-20" --out left.geojson
map start grid1.geojson --start "area 0,0 50,480, clear 20" --out area.geojson
map start grid1.geojson --start "250,20,90" --out pose.geojson
map info area.geojson --json info.json""",
    "import_svg": "map import drawing.svg --scale-mm-per-unit 1 --out drawing.geojson",
    "import_csv": "map import points.csv --out points.geojson",
    "import_ros": "map import world.yaml --scale-mm-per-unit 100 --out world.geojson",
    "import_dxf": "map import cave.dxf --drawn free --out cave.geojson",
    "import_gpkg": "map import survey.gpkg --layer passages --drawn free --scale-mm-per-unit 10"
    " --out survey.geojson",
    "import_shp": "map import rings.shp --scale-mm-per-unit 1 --out rings.geojson",
    "import_scan": "map import scan.png --points 0,1240;1754,1240 --distance-mm 742.5"
    " --out scan.geojson",
    "import_photo": TABLE,
    **{f"grow_{design}": _grow_case(design) for design in DESIGNS},
    "grow_history": f"""{GRID}
grow grid_explorer --map grid1.geojson --animate grown.svg --history 100,300 --json history.json
grow grid_explorer_levels --map grid1.geojson --animate grown.gif --frames 8""",
    **{f"score_{design}": _score_case(design) for design in DESIGNS},
    **{f"check_{design}": _check_case(design) for design in DESIGNS},
    **{
        f"inflate_{design}": f"inflate {design} --out page.html --mesh body.stl --json shape.json"
        for design in ("plain_vine", "three_level_tree", "six_branch_anchor")
    },
    "inflate_alone": "inflate long.toml --alone --mesh body.stl --json shape.json",
    "check_fix": "fix broken.toml --out mended.toml --json broken.json",
    **{
        f"fabricate_{design}": f"fabricate {design} --out package --allow-uncalibrated --r12"
        for design in DESIGNS
    },
    "fabricate_two": "fabricate three_level_tree --out package --process weld+cut"
    " --allow-uncalibrated --r12",
    "fabricate_nested": "fabricate six_branch_anchor --copies 2 --with plain_vine --out package"
    " --allow-uncalibrated",
    "fabricate_tiled": "fabricate long.toml --out package --allow-uncalibrated",
    "coupon": "coupon --out coupons",
    "calibrate": """calibrate results.csv --out mine.toml --json mine.json
profiles mine.toml --json profile.json""",
    "profiles": """profiles --json profiles.json
profiles co2_60w__stretchlon_200 --json profile.json""",
    "rules": "rules --json rules.json",
    "rig": f"{GRID}\nrig grid1.geojson --fit-mm 300 --out rig",
    "rig_board": f"{CAVE}\nrig cave1.geojson --style board --lid --fit-mm 300 --out rig",
    "observe": f"""{TABLE}
{SEEN.format(1, "152,132,2")}
{SEEN.format(2, "152,152,-5")}
fit-observations seen_1.json seen_2.json --out contacts.toml
score sprig.toml --task reach --maps arena.geojson --contacts contacts.toml --json score.json""",
    "aim": f"""{GRID}
aim plain_vine --map grid1.geojson --deployments 5000 --out aim.html --json aim.json
aim grid_explorer --map grid1.geojson --task coverage --robots 2 --alone --deployments 5000"""
    " --out two.svg --json two.json",
    "report": "report grid_explorer --environment grid --count 4 --out page.html --json page.json",
    "report_anchor": "report six_branch_anchor --environment cave --count 3 --out page.html"
    " --json page.json",
    "compare": "compare grid_explorer plain_vine --environment grid --count 4 --out page.html"
    " --json page.json",
    **{
        f"optimize_{name}": f"optimize run_{name}.toml --out run --json run.json\n"
        "runs run --rebuild rebuilt\nruns . --json runs.json"
        for name in RUNS
    },
    "python_grow": """import vinefab as vf
design, world = vf.Design.read("three_level_tree"), vf.maps.grid(seed=3)
show("design", design)
show("map", world)
show("info", world.info(width_mm=20.0))
show("deployment", design.grow(world))
show("line", design.grow(world, (250.0, 15.0, 60.0), body="centerline"))
show("score", vf.score(design, "reach", maps=[world, vf.maps.cave(seed=2)], poses=2, buffer_mm=9))
show("lists", [vf.designs(), vf.recipes(), vf.printers(), vf.examples()])
show("rules", vf.rules())
show("profile", vf.profile("co2_60w__stretchlon_200"))""",
    "python_search": """import vinefab as vf
world = vf.maps.grid(seed=3)
aimed = vf.aim("plain_vine", world, deployments=5000, progress=False, alone=True)
show("aim", aimed)
show("compare", vf.compare(["plain_vine", "grid_explorer"], [world], poses=2, progress=False))
show("run", vf.optimize("run_islands.toml", out="run", page=False, progress=False))
show("runs", vf.runs("run"))
show("settings", vf.RunSettings.read("run_pieces.toml"))
show("report", vf.report("plain_vine", out="page.html", maps=[world], poses=2, progress=False))""",
    "python_make": """import vinefab as vf
show("check", vf.check("grid_explorer_pieces_levels", maps=[vf.maps.grid(seed=3)]))
show("fix", vf.fix("broken.toml", progress=False))
show("package", vf.fabricate("plain_vine", out="package", allow_uncalibrated=True))
show("calibrate", vf.calibrate("results.csv", out="mine.toml"))
quick = {"pictures": False, "progress": False}
show("rig", vf.rig(vf.maps.grid(seed=3), out="rig", fit_mm=200.0, **quick))""",
    "python_observe": """import vinefab as vf
world = vf.maps.import_("table.jpg", marker_mm=30.0, height_mm=30.0,
    obstacles="50,84,176,75", crop_mm=(42.0, 42.0, 642.0, 442.0))
show("map", world)
for number, pose in enumerate([(152, 132, 2), (152, 152, -5)], 1):
    file = f"grown_{number}.jpg"
    seen = vf.observe(file, world, "sprig.toml", pose, obstacle_height_mm=30.0, out=f"{file}.json")
    show(f"seen_{number}", seen)
show("fit", vf.fit_observations(["grown_1.jpg.json", "grown_2.jpg.json"]))""",
    "python_coupon": """import vinefab as vf
show("coupon", vf.coupon(out="coupons"))""",
    "studio": """import tomllib
from vinefab.studio.executors import answer_of
from vinefab.studio.live_answers import load_kernel
load_kernel()
design = tomllib.loads(open("broken.toml").read())
source = {"environment": "grid", "seed": 3, "options": {"columns": 3, "rows": 3}}
state = {
    "design": design,
    "map": {"source": source, "edits": [["move", 0, 5.0, -3.0], ["remove", 1]]},
    "pose": {"x_mm": 101.3, "y_mm": 12.1, "heading_deg": 97.3},
    "task": "reach",
    "family": {"environment": "cave", "count": 3, "seed": 1000, "poses": 2},
}
asked = {
    "live": {},
    "before": {},
    "front": {"front_mm": 200.0},
    "rules": {},
    "fix": {"keep": ["angle"]},
    "family": {},
}
for panel, ask in asked.items():
    show(panel, answer_of(panel, state, ask))
exports = {
    "package": {"allow_uncalibrated": True},
    "picture": {},
    "rig": {"fit_mm": 120.0, "pictures": False},
}
outs = {"package": "package", "picture": "grown.svg", "rig": "rig"}
for what, options in exports.items():
    ask = {"what": what, "out": outs[what], "options": options}
    show(f"export_{what}", answer_of("export", state, ask))""",
}
