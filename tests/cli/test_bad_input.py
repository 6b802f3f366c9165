"""What a user gets wrong: one line that names it, exit code 2, and no file written or changed."""

import json
import os
import shlex
import socket
import sys
from functools import partial

import pytest
import shapely

import vinefab as vf
from tests.cli.conftest import PLAIN, RUN
from vinefab.cli.main import main

FORK = """schema = "vinefab/design-1"
name = "d"
[trunk]
length = 120.0
[[level]]
branches = 2
length = 60.0
angle_deg = 60.0
[build]
widths_mm = [20.0, 12.0]
"""
FOREST = "\n[[level]]\nbranches = 90\nlength = 5.0\nangle_deg = 10.0"
CONTACTS = """schema = "vinefab/contacts-1"
[head_on_half_angle_deg]
value = 4.5
low = 3.0
high = 6.0
count = 12
photos = 4
standing = "measured"
source = "5 tips stopped, 7 slid"
"""
RESULTS = "measure,setting,value,unit,uncertainty\n"
RUN_HEAD = 'schema = "vinefab/run-1"\n'

GROWING = ("grow {} --map grid.geojson", "score {} --map grid.geojson")
PREDICTING = (*GROWING, "check {} --map grid.geojson", "compare {} plain_vine --map grid.geojson",
              "report {} --map grid.geojson --out out.html")  # fmt: skip
CHECKING = ("check {}",)
READING = ("check {}", *GROWING)
CALIBRATING = ("calibrate {} --out out.toml",)
CONTACTED = tuple(f"{line} --contacts {{}}".replace("{}", "plain.toml", 1) for line in GROWING)
RUNNING = (
    "optimize {} --out deep/out",
    "study contest {} --optimizer cmaes --seeds 1 --out deep/out",
)
SINGLE = ("optimize {} --out deep/out",)
DEPLOYED = ("grow plain_vine --map {}",)


def fork(old, new):
    return FORK.replace(old, new, 1)


def contacts(old, new):
    return CONTACTS.replace(old, new, 1)


def origin(text):
    return f"{PLAIN}[origin]\n{text}\n"


FILES = {
    "not_toml.toml": (fork("schema", "schema schema"), READING, "is not TOML"),
    "unknown_key.toml": (fork("branches", "brunches"), READING, "did you mean 'branches'"),
    "unit.toml": (fork("widths_mm", "widths_cm"), READING, "did you mean 'widths_mm'"),
    "nan.toml": (fork("60.0\nangle", "nan\nangle"), READING, "is nan"),
    "negative.toml": (fork("12.0", "-12.0"), READING, "is -12.0"),
    "huge.toml": (fork("120.0", "1e300"), READING, "1e+300"),
    "million.toml": (fork("branches = 2", "branches = 1000000"), READING, "1000000"),
    "text.toml": (fork("120.0", '"long"'), READING, "'long'"),
    "no_trunk.toml": (fork("[trunk]\nlength = 120.0", ""), READING, "trunk is missing"),
    "schema.toml": (fork("design-1", "map-1"), READING, "vinefab/design-1"),
    "later.toml": (fork("design-1", "design-2"), CHECKING, f"is vinefab {vf.__version__}, and"),
    "forest.toml": (
        fork("[build]\nwidths_mm = [20.0, 12.0]", FOREST).replace("= 2", "= 999"),
        ("check {}", "fabricate {} --out out"), "90910 branches",
    ),
    "pressure.toml": (
        origin("growth = { pressure_stop = 3 }"), PREDICTING,
        "pressure.toml: origin.growth.pressure_stop is 3; allowed: a valid boolean",
    ),
    "task.toml": (origin("task = 3"), GROWING, "origin.task"),
    "maps.toml": (origin("maps = [3]"), GROWING, "origin.maps"),
    "parameters.toml": (origin("task_parameters = 2"), GROWING, "origin.task_parameters"),
    "run_of.toml": (origin("run = []"), GROWING, "origin.run"),
    "recipe_text.toml": (origin('recipe = "mine"'), CHECKING, "origin.recipe"),
    "recipe_name.toml": (origin("recipe = { name = 3 }"), CHECKING, "origin.recipe"),
    "recipe_empty.toml": (origin("recipe = {}"), CHECKING, "origin.recipe"),
    "no_json.geojson": ("{ not json", DEPLOYED, "JSON"),
    "empty.csv": ("", CALIBRATING, "empty in every row"),
    "header.csv": ("a,b\n", CALIBRATING, "measure,setting,value,unit"),
    "kerf.csv": (f"{RESULTS}kerf_piece,cut,50.4,mm,0.02", CALIBRATING, "kerf of -0.400 mm"),
    "apart.csv": (f"{RESULTS}width,20,19.9,mm,0.05", CALIBRATING, "apart"),
    "ell.csv": (f"{RESULTS}seam,weldcut,1,ell,0.1", CALIBRATING, "line 2: unit of seam"),
    "c_value.toml": (contacts("value = 4.5", "value = 9"), CONTACTED, "is 9.0; allowed: 3 to 6"),
    "c_key.toml": (contacts("low = 3.0", "lwo = 3.0"), CONTACTED, "did you mean 'low'?"),
    "c_kind.toml": (contacts('"measured"', '"guessed"'), CONTACTED, "allowed: 'measured'"),
    "c_none.toml": (contacts("value = 4.5\n", ""), CONTACTED, "value is missing"),
    "c_photos.toml": (contacts("photos = 4", "photos = 0"), CONTACTED, "photos is 0"),
    "c_nan.toml": (contacts("high = 6.0", "high = nan"), CONTACTED, "high is nan"),
    "c_high.toml": (contacts("high = 6.0", "high = 120.0"), CONTACTED, "high is 120.0; allowed: l"),
    "c_schema.toml": (contacts("contacts-1", "contacts-2"), CONTACTED, "'vinefab/contacts-2'"),
    "c_table.toml": (contacts("[head", "[haed"), CONTACTED, "no such key"),
    "c_empty.toml": (CONTACTS.partition("\n")[0], CONTACTED, "contacts hold no number"),
    "narrow_run.toml": (f"{RUN_HEAD}[build]\ntrunk_width_mm = 2.0\n", RUNNING, "narrow_run.toml"),
    "few_run.toml": (f"{RUN_HEAD}[optimizer]\npopulation = 3\n", RUNNING, "few_run.toml"),
    "cmaes_run.toml": (f'{RUN_HEAD}[optimizer]\nname = "cmaes"\npopulation = 3\n', SINGLE,
                       "optimizer.population is 3; allowed: at least 4"),
    "maps_run.toml": (f"{RUN_HEAD}[evaluation]\nmaps_per_generation = 9\n", RUNNING, "maps_run"),
    "wide_run.toml": (
        f"{RUN_HEAD}[growth]\nbody = 'inflated'\n[build]\ntrunk_width_mm = 99.0\n"
        "pressure_kpa = 2.0\n", RUNNING, "wide_run.toml",
    ),
    "task_run.toml": (f"{RUN_HEAD}[task]\nname = 'covrage'\n", RUNNING, "task_run.toml"),
    "recipe_run.toml": (f"{RUN_HEAD}[evaluation]\nrecipe = 'co3'\n", RUNNING, "co3"),
    "file_run.toml": (f"{RUN_HEAD}[maps]\nfiles = ['none.geojson']\n", RUNNING, "none.geojson"),
    "fixed_run.toml": (f"{RUN_HEAD}[space]\nlevels = 1\nlength_mm = 100\n", RUNNING, "fixed_run"),
}  # fmt: skip
"""Damaged files: what is in them, the commands that read them, words of the complaint."""

NAMED_OTHERWISE = ("origin.", "90910 branches", "start", "co3")
"""Complaints that name a design, a map or a recipe in place of the file."""


def ring(low, high):
    return [[[low, low], [high, low], [high, high], [low, high], [low, low]]]


def shape(index, coordinates):
    return lambda document: document["features"][index]["geometry"].update(coordinates=coordinates)


def walled_start(document):
    wall = {"type": "Polygon", "coordinates": ring(0.0, 299.0)}
    document["features"].append(
        {"type": "Feature", "properties": {"role": "obstacle"}, "geometry": wall}
    )


def without_start(document):
    document["features"] = [
        one for one in document["features"] if one["properties"].get("role") != "start"
    ]


BOW_TIE = [[[10, 10], [60, 60], [60, 10], [10, 60], [10, 10]]]
MAPS = {
    "bow_tie": (shape(1, BOW_TIE), "35"),
    "nan": (shape(1, [[[float("nan"), 1.0], [9.0, 1.0], [9.0, 9.0], [0.0, 1.0]]]), "nan"),
    "huge": (shape(0, ring(0, 1e300)), "1e+300"),
    "walled_start": (walled_start, "start"),
    "empty": (lambda document: document.update(features=[]), "polygon"),
    "two_bounds": (lambda document: document["features"].append(document["features"][0]), "bounds"),
    "no_collection": (lambda document: document.update(type="Polygon"), "FeatureCollection"),
    "no_start": (without_start, "start"),
}
"""Damaged maps: how the grid is changed, words of the complaint."""
FILES |= {f"{name}.geojson": (None, DEPLOYED, words) for name, (_, words) in MAPS.items()}

LINES = {
    # what newcomers guess
    "grow": "DESIGN is missing; for example: vinefab grow three_level_tree --map",
    "grow plain_vine": "map is missing; give --map FILE, or --out FILE for the skeleton",
    "grow plain_vine --map m.geojson --pose 100 20 90": "for example: vinefab grow",
    "grow plain_vine --map m.geojson --dpi x": "no option --dpi; vinefab grow --help lists them",
    "grow plain_vine --hlep": "there is no option --hlep; did you mean --help?",
    "grow plain_vine --head-on-half-angl 5": "did you mean --head-on-half-angle-deg or",
    "map import a --scale 2 --out c.json": "did you mean --scale-mm-per-unit?",
    "map grid --size 300mm --out g.json": "--size-mm is '300mm'; allowed: a number, without a unit",
    "map grid --size=abc --out g.json": "--size-mm is 'abc'; allowed: a number",
    "map grid --seed -1 --out g.json": "--seed is -1; allowed: a whole number, 0 or more",
    "map grid --seed 1.5 --out g.json": "--seed is '1.5'; allowed: a whole number",
    "map grid --out g.svg": "--out is 'g.svg'; allowed: a file name ending in .geojson or .json",
    "map import a.svg --out g.png": "--out is 'g.png'; allowed: a file name ending in .geojson",
    "report plain_vine --out r.pdf": "--out is 'r.pdf'; allowed: a file name ending in .html",
    "--map m.geojson grow vine": "no option --map before a command; vinefab COMMAND --map ...",
    "simulate vine": "there is no command 'simulate'; there are: new, examples,",
    "fabricate plain_vine -o x": "no option -o; vinefab fabricate --help lists them",
    "optimise run.toml": "did you mean 'optimize'?",
    "chek": "'check'",
    "map maze": "there is no command 'maze'; there are: grid, cave,",
    "map": "a command is missing; there are: grid, cave,",
    "new vine.toml": "for example: vinefab new design mine.toml",
    "rules VF-C01 VF-C02": "for example: vinefab rules VF-C01",
    "study contest run.toml": "--optimizer random --seeds 2",
    "study reproduce --out out": "NAME is missing; give transfer, ",
    "check plain_vine --colour red": "--colour",
    "check plain_vine --keep length": "there is no option --keep",
    # names that lead nowhere, with the nearest
    "grow no/such.toml --map grid.geojson": "no such file",
    "grow three_levle_tree --map grid.geojson": "did you mean 'three_level_tree'",
    "grow plian --map grid.geojson": "did you mean 'plain'?",
    "grow plain.tml --map grid.geojson": "did you mean 'plain.toml'?",
    "grow plain --map gird": "did you mean 'grid.geojson'?",
    "grow plain --map gird.geojson": "did you mean 'grid.geojson'?",
    "grow plain_vine --map no_such.geojson": "no such file",
    "check plain_vin": "did you mean 'plain_vine'?",
    "check plain_vine --recipe no_such_recipe": "there are:",
    "check plain_vine --map no_such.geojson": "no_such.geojson",
    "rig grid.geojson --printer no_such_printer --out out": "there are:",
    "optimize no_such_run.toml --out out": "no such file",
    "optimize tniy --out out": "did you mean 'tiny'?",
    "map import no_such.yaml --out out.geojson": "no such file",
    "map import drawing.docx --out out.geojson": "allowed:",
    "map info no.geojson": "no such file",
    "score plain_vine --maps grid.geojson --task covrage": "'coverage'",
    "runs .": "DIR: no run.sqlite is in . or below; name the folder",
    "runs none": "none",
    "rules VF-C99": "VF-C99",
    "examples grid_coverge --out out": "did you mean ",
    "calibrate missing.csv --out out.toml": "no such file",
    "grow plain --map grid.geojson --contacts none.toml": "there is no such file",
    "grow plain --map grid.geojson --contacts my_robots": "no contacts file is called 'my_robots'",
    # poses, starts and sizes
    "grow plain_vine --map grid.geojson --pose 1,2": "pose",
    "grow plain_vine --map grid.geojson --pose 1,2,3,4": "pose",
    "grow plain_vine --map grid.geojson --pose a,b,c": "pose",
    "grow plain_vine --map grid.geojson --pose nan,1,2": "pose",
    "grow plain_vine --map grid.geojson --pose 1e99,0,0": "pose",
    "grow plain_vine --map grid.geojson --pose ''": "pose",
    "grow plain_vine --map grid.geojson --pose -5,5,90": "(-5, 5) mm is outside the bounds",
    "grow plain_vine --map grid.geojson --start left --pose 9,9,0": "given together with a start",
    "map start grid.geojson --out x.geojson": "--start is missing; for example: ",
    "map start grid.geojson --start leftt --out x.geojson": "mean 'left'?",
    "map import grid.geojson --start 1e9,0,0 --out x.geojson": "1e",
    "map grid --start 'left, inset 20, clear 900' --out x.geojson": "at least 900 mm from walls",
    "score plain_vine --maps grid.geojson --start -5,5,0": "outside the bounds",
    "score plain_vine --maps grid.geojson --start 'area 900,0 999,9'": "free space",
    "check plain_vine --start 'left side'": "nothing without maps; give maps",
    "map grid --seed one --out x.geojson": "--seed",
    "map grid --starts 500 --out x.geojson": "starts",
    "map grid --size inf --out x.geojson": "size",
    "map grid --size 0 --out x.geojson": "size",
    "map grid --size nan --out x.geojson": "size",
    "map grid --gap 500 --out x.geojson": "gap",
    "map info grid.geojson --width-mm -3": "--width-mm",
    "map import cave.geojson --drawn rooms --out x.geojson": "drawn is 'rooms'; allowed: one of",
    # growth options and parameters
    "grow plain_vine --map grid.geojson --body round": "--body",
    "grow plain_vine --map grid.geojson --head-on-half-angle-deg 91": "--head-on-half-angle-deg",
    "grow plain --map grid.geojson --head-on-half-angle-deg 1,2,3": "or a range LOW,HIGH",
    "grow plain --map grid.geojson --growth body": "--growth is 'body'; allowed: NAME=VALUE",
    "score plain --map grid.geojson --growth bodi=inflated": "did you mean 'body'",
    "grow plain --map grid.geojson --growth body=fat": "body is 'fat'",
    "score plain --map grid.geojson --growth pressure_stop=perhaps": "pressure_stop is 'perhaps'",
    "grow plain --map grid.geojson --growth head_on_half_angle_deg=1,2,3": "a range [low, high]",
    "score plain --map grid.geojson --growth storage_kpa=1,2": "storage_kpa is [1, 2]",
    "grow plain --map grid.geojson --growth body=inflated --growth body=centerline": "given twice",
    "grow plain --map grid.geojson --growth body=inflated --body centerline": "'centerline'",
    "check plain --growth body=inflated": "--map",
    "check photos/robot.jpg": "is a JPEG picture; vinefab map import makes a map of one",
    "grow plain --map photos/robot.jpg": "vinefab observe reads a photo of a grown robot",
    "score plain_vine --maps grid.geojson --set radius_mm": "--set",
    "score plain_vine --maps grid.geojson --set radius=3": "radius_mm",
    "score plain_vine --maps grid.geojson --poses 0": "--poses",
    # limits, fixes, rigs, sheets
    "check plain_vine --limit VF-B1.error=3": "VF-B01",
    "check plain_vine --limit VF-B01.eror=3": "error, warning",
    "check plain_vine --limit VF-B01=3": "--limits is 'VF-B01=3'; allowed: RULE.NAME=NUMBER",
    "check plain_vine --limit VF-C01": "--limits is 'VF-C01'; allowed: RULE.NAME=NUMBER",
    "check plain_vine --limit VF-C01.warning=": "allowed: RULE.NAME=NUMBER",
    "check plain_vine --limit VF-C01.warning=six": "allowed: RULE.NAME=NUMBER",
    "check plain_vine --limit VF-B01.error=nan": "VF-B01.error",
    "check plain --svg findings.txt": ".svg",
    "check plain --png findings.txt": ".png",
    "check plain --dxf findings.txt": ".dxf",
    "fix plain --out out.toml --keep widths": "--keep is 'widths'; allowed: branches, length, an",
    "fix plain --out out.toml --keep ''": "--keep is",
    "fix plain --out out.toml --keep branches,": "--keep is",
    f"fix plain --out out.toml --keep {'x' * 10_000}": "--keep is",
    "fix plain --out plain.toml --force": "another file",
    "fix plain --out link.toml --force": "another file",
    "rig grid.geojson --out out --height-mm 0": "height",
    "rig grid.geojson --out out --height-mm 900": "height",
    "rig grid.geojson --out out --scale 100": "parts",
    "rig jagged.geojson --out out": "jagged.geojson: map 'jagged': it has 12004 corners",
    "inflate plain_vine --across 7": "--across",
    "inflate plain_vine --across 400": "--across",
    "inflate plain_vine --out shape.gif": "--out",
    "inflate plain_vine --mesh shape.glb": "--mesh",
    "inflate plain_vine --recipe moon": "moon",
    "inflate grid_explorer --across 32": "--across is 32; allowed: 4 to 20 for grid_explorer",
    # predictions
    "grow plain --map grid.geojson --history 5": "--json",
    "grow plain --map grid.geojson --json - --history 0": "--history is 0; allowed: a whole number",
    "grow plain --map grid.geojson --json - --history 5000": "--history is 5000; allowed: a whole",
    "grow plain --map grid.geojson --json - --history=-3,4": "--history is -3.0; allowed: 1e-06 to",
    "grow plain --map grid.geojson --json - --history nan": "--history is nan; allowed: 1e-06 to",
    "grow plain --map grid.geojson --json - --history 10;20": "--history is '10;20'; allowed: fin",
    "grow plain --map grid.geojson --json - --history ''": "--history is ''; allowed: finite",
    "grow plain --map grid.geojson --animate a.mp4": "--animate",
    "grow plain --map grid.geojson --animate a.svg --frames 0": "--frames",
    "grow plain --map grid.geojson --animate a.svg --frames 100000": "--frames",
    "grow plain_vine --map grid.geojson --svg a.out": "'a.out'; allowed: a file name ending in",
    "report plain_vine --out out.html": "--environment",
    "report plain_vine --environment gird --out out.html": "did you mean 'grid'",
    "report plain_vine --environment grid --count 0 --out out.html": "--count is 0",
    "report plain_vine --environment grid --set sise=3 --out out.html": "of the environment",
    "compare plain_vine --environment grid": "design",
    "compare plain plain_vine --map grid.geojson --measure growth_pressure": "growth_pressure_",
    "aim plain --map grid.geojson --where moon": "--where",
    "aim plain --map grid.geojson --robots 0": "--robots",
    "aim plain --map grid.geojson --robots 2 --task anchoring": "anchoring",
    "aim plain --map grid.geojson --alone --against plain_vine": "--alone",
    "aim plain --map grid.geojson --deployments 5": "--deployments",
    "aim plain --map grid.geojson --placing-mm nan": "--placing-mm",
    "aim plain --map grid.geojson --task moon": "moon",
    "aim plain --map grid.geojson --out aim.gif": "--out",
    "aim plain --map grid.geojson --set targets=[[900,900]]": "targets",
    "aim plain --map grid.geojson --growth head_on_half_angle_deg=15,1": "head-on-half-angle-deg",
    # runs
    "study contest tiny.toml --optimizer pso:inertai=1 --out out": "did you mean 'inertia'",
    "optimize tiny.toml --out out --generations 3": "changes a run that is resumed",
    "optimize tiny.toml --out out --seed 9223372036854775808": "seed is 9223372036854775808",
    "optimize tiny.toml --out out --cluster tcp://127.0.0.1:9": "--cluster",
    "optimize tiny.toml --out out --cluster local:2000": "--cluster",
    "optimize tiny.toml --out out --cluster none.json": "--cluster",
    "optimize tiny.toml --out out --cluster dead.json": "--cluster",
    "optimize tiny.toml --out out --cluster thesis.json": "--cluster",
    "optimize tiny.toml --out own": "index.html",
    "optimize tiny.toml --out out --json thesis.json": "thesis.json: exists and was not written by",
    "demo --out deep/demo --population 2 -q": "population",
    # files of another kind, and files that vinefab did not write
    "check grid.geojson": "grid.geojson: is not TOML, but JSON, as maps are (--map):",
    "map info plain.toml": "plain.toml: is not JSON, but TOML, as designs are:",
    "check tiny.toml": "this is a run file: vinefab optimize takes it",
    "check machine.toml": "this is a machine: a recipe names it",
    "optimize plain.toml --out out": "this is a design: vinefab grow, check, fabricate",
    "new thing a.toml": "kind is ",
    "new design a.json": "file is ",
    "new map a.toml": "file is ",
    "new map a.geojson --from table": "--from: a map is copied from no",
    "new map a.geojson --branches": "--branches: a map has none; leave it out",
    "new recipe 'my film.toml'": "for a recipe a file name of letters",
    "new run a.toml --from contest/bench_reach.toml": "contest/bench_reach.toml",
    "new design plain.toml --from cave_explorer": "plain.toml: exists; --force overwrites it",
    "map import grid.geojson --out grid.geojson --force": "another file",
    "grow plain_vine --map grid.geojson --json thesis.json": "--force",
    "grow plain_vine --map grid.geojson --animate foreign.gif": "foreign.gif",
    "grow plain_vine --map grid.geojson --json /proc/nothing/a.json": "cannot be written",
    "fabricate plain_vine --allow-uncalibrated --out photos": "--force",
    "fabricate plain_vine --paper a5 --out x": "no paper is called 'a5'; there are: a4",
    "rig grid.geojson --out photos": "--force",
    "demo --out photos": "--force",
    "fabricate plain_vine --out plain.toml --force": "plain.toml: cannot be written: it is a file",
    "rig grid.geojson --out plain.toml/rig": "plain.toml: cannot be written: it is a file",
    "examples --out plain.toml": "plain.toml: cannot be written: it is a file; name a folder",
    # photos that were observed
    "observe seen.json": "MAP is missing",
    "observe seen.json --angle-error-deg 3": "there is no option --angle-error-deg",
    "fit-observations seen.json --out out.toml --map x.geojson": "there is no option --map",
    "fit-observations seen.json --out out.json": "ending in .toml",
    "fit-observations seen.json seen.json --out out.toml": "each observation once",
    "fit-observations no.json --out out.toml": "there is no such file",
    "fit-observations seen.json --out out.toml --angle-error-deg -1": "allowed: 0.1 to 30 deg",
    "fit-observations seen.json --out notes.toml": "not written by vinefab",
    # the studio, before anything is served
    "studio --no-browser moon": "no design is called 'moon'",
    "studio --no-browser not_toml.toml": "not_toml.toml",
    "studio --no-browser plain_vine --map moon.geojson": "moon.geojson",
    "studio --no-browser plain_vine --environment moon": "moon",
    "studio --no-browser plain_vine --recipe moon": "moon",
    "studio --no-browser state.html": "not a snapshot",
    "studio --no-browser plain_vine --port 99999": "0 to 65535",
    "studio --no-browser plain_vine --snapshot one.txt": "ending in .html",
    "studio --no-browser plain_vine --snapshot state.html": "state.html",
    "studio --no-browser plain_vine --family": "--family",
}
"""Command lines in a folder of files, and words of the complaint."""

LINES |= {
    command.format(name): words
    for name, (_, commands, words) in FILES.items()
    for command in commands
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory, seen):
    """A folder with sound, damaged and foreign files."""
    place = tmp_path_factory.mktemp("refused")
    write = {name: text for name, (text, *_) in FILES.items() if text is not None}
    write |= {
        "plain.toml": PLAIN, "tiny.toml": RUN, "thesis.json": '{"place": "five years of work"}',
        "notes.toml": "mine", "foreign.gif": "GIF89a", "state.html": "<html></html>",
        "dead.json": '{"address": "tcp://127.0.0.1:9"}', "photos/robot.jpg": "jpg",
        "own/index.html": "my own page", "seen.json": json.dumps(seen[0]),
        "cave.geojson": json.dumps({"type": "Polygon", "coordinates": ring(0, 100)}),
    }  # fmt: skip
    for name, text in write.items():
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_text(text)
    (place / "photos" / "robot.jpg").write_bytes(b"\xff\xd8\xff\xe0")
    (place / "link.toml").symlink_to("plain.toml")
    grid = vf.maps.grid(columns=3, rows=3, size_mm=300.0).write(place / "grid.geojson")
    for name, (change, _) in MAPS.items():
        document = json.loads(grid.read_text())
        change(document)
        (place / f"{name}.geojson").write_text(json.dumps(document))
    disc = shapely.Point(200, 150).buffer(80, quad_segs=3_000)
    jagged = vf.Map(name="jagged", bounds=shapely.box(0, 0, 400, 300), obstacles=(disc,))
    jagged.write(place / "jagged.geojson")
    vf.new("machine", place / "machine.toml")
    return place


def state(folder):
    return {path: path.is_file() and path.read_bytes() for path in folder.rglob("*")}


@pytest.fixture(scope="module")
def before(folder):
    return state(folder)


@pytest.fixture
def refused(vinefab, folder, before, monkeypatch):
    """Return a function that runs a command line that must be refused, and returns its line."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr("vinefab.search.dask_cluster.CONNECT_S", 0.2)
    monkeypatch.setattr(
        "vinefab.studio.server._until_stopped", partial(pytest.fail, "the server was started")
    )

    def run(*words):
        code, output, complaint = vinefab(*words)
        assert (code, complaint.count("\n")) == (2, 1), (output, complaint)
        assert complaint.startswith("error: ")
        assert len(complaint) < 1500
        assert state(folder) == before
        return complaint

    return run


@pytest.mark.parametrize("line", LINES)
def test_what_is_wrong_is_said_in_one_line_and_nothing_is_written(refused, line):
    complaint = refused(*shlex.split(line))
    assert LINES[line] in complaint
    for name in FILES.keys() & {*shlex.split(line)}:
        assert name in complaint or LINES[line].startswith(NAMED_OTHERWISE)


def test_a_missing_package_of_the_studio_is_named_with_the_extra(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    line = refused("studio", "--no-browser")
    assert "the studio needs uvicorn: pip install 'vinefab[studio]'" in line


def test_a_port_that_is_taken_is_named(refused):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        number = str(taken.getsockname()[1])
        assert f"--port is {number}" in refused("studio", "--no-browser", "--port", number)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into any folder")
def test_a_folder_without_permission_is_named(vinefab, grid, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    code, _, line = vinefab("grow", "plain_vine", "--map", grid, "--json", locked / "a.json")
    assert (code, "cannot be written" in line) == (2, True)


def test_a_foreign_file_is_overwritten_with_force_alone(vinefab, grid, tmp_path):
    thesis = tmp_path / "thesis.json"
    thesis.write_text("five years of work")
    words = ("grow", "plain_vine", "--map", grid, "--json", thesis)
    assert vinefab(*words)[0] == 2
    assert vinefab(*words, "--force", "-q")[0] == 0
    assert json.loads(thesis.read_text())["design"] == "plain_vine"


def test_the_program_gives_its_exit_code_too():
    assert main(["grow"]) == 2
