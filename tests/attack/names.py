"""Hostile names through every command: ``python tests/attack/names.py``, or WAY NUMBER for one.

Each name of `NAMES` takes each of the `WAYS`: as the name of a design, a map, a recipe or a run,
as text in it, as the name of a file that is read or written, as an argument. What must come of it
stands in `attempts`: above all, files stay sound and inside their folder.
"""

import io
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

sys.path.insert(0, str(Path(__file__).resolve().parent))

from attempts import VINEFAB, Attempt, Tally, judged
from files import RESULTS, ROOT, RUN, SVG

NAMES = (
    "a\nb\rc",
    "cost $\\foo$ map",
    "$x_{",
    "map \U0010ffff \u4e2d\u6587 \U0001f600",
    "\x1b[31mred\x07",
    "\x00",
    "\x7f\x85\x9f",
    "\u202eabc\u2066\u200f",
    "x" * 300,
    "x" * 100_000,
    "word " * 20_000,
    "../../outside",
    "/var/../outside",
    "-q",
    "--force",
    "'\"`$(touch outside)",
    "<script>alert(1)</script>",
    "\"'><img src=x onerror=alert(1)>",
    "]]>&amp;&#10;<!-- --><g/>",
    "=1+1",
    "@SUM(A1)",
    "[bold]x[/bold][/]",
    "{0}{name}%s%n",
    "\ud800",
    "\udcff",
    "CON",
    "nul.txt",
    " ",
    "",
    ".",
    "..",
    "e\u0301 \u00e9",
    "0\nSECTION\n2\nENTITIES\n0\nLINE",
    "%%c{\\fArial|b0;x}^J^M\\P",
    "\ufeff\u2028\u2029\ufffe",
    "javascript:alert(1)",
)
TEXTS = {"design.toml": 'schema = "vinefab/design-1"\nname = {name}\n[trunk]\nlength = 120.0\n'}
RECIPE = "laser_profiles/recipes/co2_60w__stretchlon_200.toml"
MACHINE = "laser_profiles/machines/co2_60w.toml"
MATERIAL = "laser_profiles/materials/stretchlon_200.toml"
PRINTER = "laser_profiles/printers/generic_220.toml"
ANY_TEXT = ("title", "source", "note")

Files = dict[str, bytes]


def quoted(name: str) -> str:
    """Return a name as a TOML string."""
    return json.dumps(name, ensure_ascii=False).replace("\x7f", "\\u007f")


def encoded(text: str) -> bytes:
    return text.encode("utf-8", errors="surrogatepass")


def design(name: str) -> Files:
    return {"design.toml": encoded(TEXTS["design.toml"].replace("{name}", quoted(name)))}


def tree(name: str) -> Files:
    text = (ROOT / "designs/three_level_tree.toml").read_text()
    return {"design.toml": encoded(text.replace('"three_level_tree"', quoted(name)))}


def geojson(name: str) -> Files:
    def feature(role: str, shape: str, coordinates: object, **facts: object) -> object:
        return {
            "type": "Feature",
            "properties": {"role": role, **facts},
            "geometry": {"type": shape, "coordinates": coordinates},
        }

    document = {
        "type": "FeatureCollection",
        "vinefab": {
            "schema": "vinefab/map-1",
            "name": name,
            "environment": name,
            "facts": {name: name, "source": name},
        },
        "features": [
            feature("bounds", "Polygon", [[[0, 0], [200, 0], [200, 200], [0, 200], [0, 0]]]),
            feature("obstacle", "Polygon", [[[80, 90], [110, 90], [95, 120], [80, 90]]]),
            feature("start", "Point", [100, 20], heading_deg=90),
        ],
    }
    return {"map.geojson": json.dumps(document).encode()}


def retitled(path: str) -> Callable[[str], Files]:
    """Return files of which one profile has a name in every text of its own."""

    def files(name: str) -> Files:
        found = {
            str(one.relative_to(ROOT)): one.read_bytes()
            for one in (ROOT / "laser_profiles").rglob("*.toml")
        }
        lines = []
        for line in found[path].decode().splitlines():
            key, _, _ = line.partition(" = ")
            before, is_sourced, _ = line.partition("source = ")
            if key in ANY_TEXT:
                lines.append(f"{key} = {quoted(name)}")
            else:
                lines.append(f"{before}source = {quoted(name)} }}" if is_sourced else line)
        return found | {path: encoded("\n".join(lines))}

    return files


def run(name: str) -> Files:
    return {"tiny.toml": encoded(RUN.replace('"tiny"', quoted(name)))}


def drawing(name: str) -> Files:
    label = name.translate({ord(c): f"&#{ord(c)};" for c in "<>&\"'\n\r"})
    text = SVG.replace("walls", label).replace("none", label, 1)
    return {"plan.svg": encoded(text)}


def rings(name: str) -> Files:
    cell = '"' + name.replace('"', '""') + '"'
    places = [(0, 0), (100, 0), (100, 60), (0, 60)]
    return {"plan.csv": encoded("".join(f"{cell},{x},{y}\n" for x, y in places))}


def results(name: str) -> Files:
    cell = '"' + name.replace('"', '""') + '"'
    return {"results.csv": encoded(RESULTS.replace("side\n", f"{cell}\n").replace("seam\n", "\n"))}


def photo(name: str) -> Files:
    """Return a photo of a robot on a floor, whose text is a name."""
    image = Image.new("RGB", (320, 320), (180, 180, 176))
    image.paste((214, 88, 40), (147, 240, 173, 300))
    text = PngInfo()
    text.add_text("Comment", name.encode("latin-1", errors="replace").decode("latin-1")[:1000])
    data = io.BytesIO()
    image.save(data, "png", pnginfo=text)
    return {"photo.png": data.getvalue()}


def nothing(name: str) -> Files:
    del name
    return {}


def named(content: Callable[[str], Files], file: str) -> Callable[[str], Files]:
    """Return files of which one has the hostile name, before its suffix."""

    def files(name: str) -> Files:
        made = content("plain")
        return {target_of(file, name) if key == file else key: made[key] for key in made}

    return files


def target_of(file: str, name: str) -> str:
    """Return the path of a file whose stem is a name; it stays in its folder."""
    path = Path(file)
    return str(path.with_name("stem")).replace("stem", name.replace("/", "_")) + path.suffix


@dataclass(frozen=True, slots=True)
class Way:
    """How a name comes into a command."""

    files: Callable[[str], Files]
    arguments: tuple[str, ...]  # {name}: the name; {stem}: the name without slashes
    cpu_s: float = 10.0


GROW = ("grow", "design.toml", "--map", "map.geojson", "--frames", "2")
ON_MAP = ("--maps", "map.geojson", "--poses", "1")
FABRICATE = ("fabricate", "design.toml", "--allow-uncalibrated", "--out", "out", "-q")
BY_RECIPE = ("fabricate", "plain_vine", "--recipe", RECIPE, *FABRICATE[2:])
AIMED = ("--map", "map.geojson", "--deployments", "5000")
SCALED = ("--points", "0,0;300,0", "--distance-mm", "300")
CORNERS = "10,310,310,310,310,10,10,10"
OBSERVED = ("--map", "map.geojson", "--design", "design.toml", "--corners", CORNERS)
WAYS: dict[str, Way] = {
    "check": Way(design, ("check", "design.toml", "--json", "o.json", "--svg", "o.svg", "-q")),
    "check-dxf": Way(tree, ("fix", "design.toml", "--out", "fixed.toml")),
    "package": Way(tree, (*FABRICATE, "--zip", "--r12"), 30.0),
    "nested": Way(design, (*FABRICATE, "--with", "plain_vine", "--copies", "2"), 30.0),
    "grow": Way(
        lambda name: design(name) | geojson(name),
        (*GROW, "--json", "o.json", "--svg", "o.svg", "--label", "--animate", "o.gif"),
        20.0,
    ),
    "grow-png": Way(
        lambda name: design(name) | geojson(name),
        (*GROW, "--svg", "o.png", "--animate", "o.svg"),
        20.0,
    ),
    "score": Way(
        lambda name: design(name) | geojson(name),
        ("score", "design.toml", "--maps", "map.geojson", "--json", "o.json"),
    ),
    "info": Way(geojson, ("map", "info", "map.geojson", "--svg", "o.svg", "--json", "o.json")),
    "info-png": Way(geojson, ("map", "info", "map.geojson", "--svg", "o.png")),
    "reimport": Way(geojson, ("map", "import", "map.geojson", "--out", "o.geojson")),
    "rig": Way(geojson, ("rig", "map.geojson", "--out", "out"), 60.0),
    "rig-printer": Way(
        lambda name: retitled(PRINTER)(name) | geojson("m"),
        ("rig", "map.geojson", "--out", "out", "--printer", PRINTER, "--no-pictures", "--lid"),
        60.0,
    ),
    "report": Way(
        lambda name: design(name) | geojson(name),
        ("report", "design.toml", *ON_MAP, "--out", "o.html", "--json", "o.json"),
        60.0,
    ),
    "compare": Way(
        lambda name: design(name) | geojson(name),
        ("compare", "design.toml", "plain_vine", *ON_MAP, "--out", "o.html", "--json", "o.json"),
        60.0,
    ),
    "recipe": Way(retitled(RECIPE), BY_RECIPE, 20.0),
    "machine": Way(retitled(MACHINE), BY_RECIPE, 20.0),
    "material": Way(retitled(MATERIAL), BY_RECIPE, 20.0),
    "profiles": Way(retitled(RECIPE), ("profiles", RECIPE, "--json", "o.json")),
    "coupon": Way(retitled(RECIPE), ("coupon", "--recipe", RECIPE, "--out", "out"), 20.0),
    "results": Way(results, ("calibrate", "results.csv", "--out", "o.toml", "--json", "o.json")),
    "run": Way(run, ("optimize", "tiny.toml", "--out", "out"), 30.0),
    "drawing": Way(drawing, ("map", "import", "plan.svg", "--out", "o.geojson")),
    "rings": Way(rings, ("map", "import", "plan.csv", "--out", "o.geojson")),
    "layer": Way(drawing, ("map", "import", "plan.svg", "--out", "o.geojson", "--layer", "{name}")),
    "aim": Way(
        lambda name: design(name) | geojson(name),
        ("aim", "design.toml", *AIMED, "--out", "o.html", "--json", "o.json"),
        30.0,
    ),
    "observe": Way(
        lambda name: design(name) | geojson(name) | photo(name),
        ("observe", "photo.png", *OBSERVED, "--out", "o.html", "--json", "o.json"),
        30.0,
    ),
    "photo-file": Way(
        named(lambda name: design(name) | geojson(name) | photo(name), "photo.png"),
        ("observe", "./{stem}.png", *OBSERVED, "--out", "o.html", "--json", "o.json"),
        30.0,
    ),
    "floor-file": Way(
        named(photo, "photo.png"),
        ("map", "import", "./{stem}.png", *SCALED, "--out", "o.geojson", "--preview", "o.png"),
    ),
    "new-file": Way(nothing, ("new", "design", "./{stem}.toml")),
    "an-example": Way(nothing, ("examples", "{name}", "--out", "out")),
    "a-rule": Way(nothing, ("rules", "{name}", "--json", "o.json")),
    "a-start": Way(
        geojson, ("map", "start", "map.geojson", "--start", "{name}", "--out", "o.geojson")
    ),
    "a-place": Way(geojson, ("aim", "plain_vine", *AIMED, "--where", "{name}", "--json", "o.json")),
    "design-file": Way(
        named(design, "design.toml"),
        ("fabricate", "./{stem}.toml", "--allow-uncalibrated", "--out", "out", "-q"),
        20.0,
    ),
    "map-file": Way(named(geojson, "map.geojson"), ("map", "info", "./{stem}.geojson")),
    "svg-file": Way(
        named(drawing, "plan.svg"), ("map", "import", "./{stem}.svg", "--out", "o.geojson")
    ),
    "recipe-file": Way(
        named(retitled(RECIPE), RECIPE),
        ("coupon", "--recipe", "laser_profiles/recipes/{stem}.toml", "--out", "out"),
        20.0,
    ),
    "run-file": Way(named(run, "tiny.toml"), ("optimize", "./{stem}.toml", "--out", "out"), 30.0),
    "results-file": Way(
        named(results, "results.csv"), ("calibrate", "./{stem}.csv", "--out", "./{stem}.toml")
    ),
    "out-package": Way(
        nothing, ("fabricate", "plain_vine", "--allow-uncalibrated", "--out", "./{stem}", "--zip")
    ),
    "out-rig": Way(geojson, ("rig", "map.geojson", "--out", "./{stem}", "--no-pictures"), 60.0),
    "out-coupon": Way(nothing, ("coupon", "--out", "./{stem}"), 20.0),
    "out-map": Way(nothing, ("map", "grid", "--out", "./{stem}.geojson")),
    "out-run": Way(run, ("optimize", "tiny.toml", "--out", "./{stem}"), 30.0),
    "out-json": Way(nothing, ("check", "plain_vine", "--json", "./{stem}.json", "-q")),
    "out-svg": Way(geojson, ("map", "info", "map.geojson", "--svg", "./{stem}.svg")),
    "command": Way(nothing, ("{name}",)),
    "argument": Way(nothing, ("check", "{name}")),
    "option": Way(nothing, ("check", "plain_vine", "--{name}")),
    "a-recipe": Way(nothing, ("check", "plain_vine", "--recipe", "{name}")),
    "a-limit": Way(nothing, ("check", "plain_vine", "--limit", "{name}=1", "-q")),
    "a-task": Way(geojson, ("score", "plain_vine", "--maps", "map.geojson", "--task", "{name}")),
    "a-set": Way(geojson, ("score", "plain_vine", "--maps", "map.geojson", "--set", "{name}=1")),
    "a-pose": Way(geojson, ("grow", "plain_vine", "--map", "map.geojson", "--pose", "{name}")),
    "an-environment": Way(
        nothing, ("compare", "plain_vine", "plain_vine", "--environment", "{name}")
    ),
    "a-profile": Way(nothing, ("profiles", "{name}")),
    "an-optimizer": Way(
        run, ("study", "contest", "tiny.toml", "--optimizer", "{name}", "--out", "out"), 20.0
    ),
    "an-address": Way(run, ("optimize", "tiny.toml", "--cluster", "{name}", "--out", "out")),
}


def attempt_of(way_name: str, number: int, folder: Path) -> Attempt | None:
    """Write the files of one attempt; None if no file or argument can be called so."""
    way, name = WAYS[way_name], NAMES[number]
    work = folder / "work"
    work.mkdir(parents=True)
    try:
        for file, data in way.files(name).items():
            path = work / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    except (OSError, ValueError):
        return None
    arguments = tuple(
        one.replace("{name}", name).replace("{stem}", name.replace("/", "_"))
        for one in way.arguments
    )
    if any("\x00" in one or "\ud800" in one or len(one) > 130_000 for one in arguments):
        return None  # no program can be started with it
    return Attempt(
        name=f"{way_name} {number}", arguments=arguments, folder=str(work), cpu_s=way.cpu_s
    )


def attempts(plan: Sequence[tuple[str, int]], folder: Path) -> Iterator[Attempt]:
    """Yield attempts, each in a folder that is removed when the next one is asked for."""
    for way, number in plan:
        own = folder / f"{way}_{number}"
        attempt = attempt_of(way, number, own)
        if attempt is not None:
            yield attempt
        shutil.rmtree(own, ignore_errors=True)


def attack(plan: Sequence[tuple[str, int]], program: str = VINEFAB) -> Tally:
    """Try names, and count."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        for verdict in judged(attempts(plan, Path(folder)), program):
            tally.add(verdict.name.split()[0], verdict)
            if verdict.outcome == "failed":
                sys.stderr.write(f"{verdict.name}: {verdict.reason}\n")
    return tally


def show(way: str, number: int) -> int:
    """Do one attempt again, keep its files, and print all about it."""
    attempt = attempt_of(way, number, Path(tempfile.mkdtemp(prefix="attack-")))
    if attempt is None:
        sys.stdout.write("no file or argument can be called so\n")
        return 0
    (verdict,) = judged(iter([attempt]))
    sys.stdout.write(f"in {attempt.folder}: {attempt.arguments}\n{verdict}\n")
    return 1 if verdict.outcome == "failed" else 0


def main(arguments: Sequence[str]) -> int:
    """Print the counts; return 1 if anything failed."""
    if len(arguments) == 2 and arguments[1].isdigit():
        return show(arguments[0], int(arguments[1]))
    ways = arguments or WAYS  # names of ways select some
    tally = attack([(way, number) for way in ways for number in range(len(NAMES))])
    sys.stdout.write(tally.report("tests/attack/names.py"))
    return 1 if tally.failures else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
