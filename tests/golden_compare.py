"""Compare two recordings of `golden.py`: numbers, drawings, solids, sentences, pictures."""

import csv
import difflib
import io
import json
import math
import re
import sqlite3
import tomllib
import zipfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from xml.etree import ElementTree

import ezdxf.path
import ezdxf.recover
import numpy as np
import scipy.spatial
import shapely
import svgelements
import trimesh

RELATIVE, FLOOR = 1e-12, 1e-12
"""Of numbers: ``|a - b| <= RELATIVE * max(|a|, |b|) + FLOOR``; integers are exact."""

_PARTS = ("loading", "evaluating", "making", "growth", "scoring", "optimizer", "store")
MASKED_KEYS = {
    "generator": "version of vinefab",
    "times": "a run's own timing",
    "seconds": "a run's own timing",
    "began_utc": "when a session began",
    **dict.fromkeys(
        (f"{what}_s" for what in (*_PARTS, "processor", "other", "beside")), "a session's timing"
    ),
}
"""Keys of JSON and columns of records whose values are no results, and why."""

MASKED_WORDS = [
    (r"written by vinefab [\w.+-]+( \[[0-9a-f]{16}\])?", "version of vinefab, digest of the file"),
    (r"\b(took|elapsed|in) \d[\d.]* (s|min)\b", "timing"),
    (r"\d[\d.,]* per second", "timing"),
    (r"\btime: \d.*", "timing"),
    (r"(/[^\s/\"',]+)+/(?=(vinefab|tests|examples|designs|laser_profiles)/)", "path of a checkout"),
]
"""Parts of sentences that are no results, and why."""

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@dataclass
class Result:
    """What was compared, what differs and what is only listed."""

    counts: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    listed: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    def text(self, most: int | None = None) -> str:
        """Return the lines to print, at most so many of each file."""
        lines = []
        for place, said in self.listed.items():
            left_out = max(0, len(said) - len(said[:most]))
            lines += [f"listed: {place}: {line}" for line in said[:most]]
            lines += [f"listed: {place}: and {left_out} more (--all)"] if left_out else []
        by_file: dict[str, list[str]] = defaultdict(list)
        for line in self.failures:
            by_file[line.partition(": ")[0]].append(line)
        for found in by_file.values():
            lines += [f"DIFFERS: {line}" for line in found[: most and 4 * most]]
            left_out = max(0, len(found) - 4 * most) if most else 0
            lines += [f"DIFFERS: and {left_out} more there (--all)"] if left_out else []
        counted = ", ".join(f"{count} {name}" for name, count in sorted(self.counts.items()))
        differing = sum(map(len, self.listed.values()))
        end = f"compared: {counted}; {len(self.failures)} differ, {differing} sentences or pictures"
        return "\n".join([*lines, f"{end} are only listed", ""])


# --- numbers: leaf by leaf


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def same_number(old: float, new: float) -> bool:
    """Tell whether two numbers are the same, integers exactly."""
    if isinstance(old, int) and isinstance(new, int):
        return old == new
    if math.isnan(old) or math.isnan(new):
        return math.isnan(old) and math.isnan(new)
    return old == new or abs(old - new) <= RELATIVE * max(abs(old), abs(new)) + FLOOR


def compare_values(place: str, old: object, new: object, result: Result) -> None:
    """Compare two values of JSON, names with names and lists in their order."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(old.keys() ^ new.keys()):
            result.failures.append(f"{place}.{key}: only {'before' if key in old else 'after'}")
        for key in [key for key in old if key in new and key not in MASKED_KEYS]:
            compare_values(f"{place}.{key}", old[key], new[key], result)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            result.failures.append(f"{place}: {len(old)} entries before, {len(new)} after")
        for number, (one, two) in enumerate(zip(old, new, strict=False)):
            compare_values(f"{place}.{number}", one, two, result)
    elif isinstance(old, str) and isinstance(new, str):
        _compare_strings(place, old, new, result)
    else:
        _compare_leaves(place, old, new, result)


def _compare_leaves(place: str, old: object, new: object, result: Result) -> None:
    result.counts["leaves"] += 1
    if _is_number(old) and _is_number(new):
        is_same = same_number(old, new)
    else:
        is_same = type(old) is type(new) and old == new
    if not is_same:
        result.failures.append(f"{place}: {old!r} before, {new!r} after")


def _compare_strings(place: str, old: str, new: str, result: Result) -> None:
    """Compare strings: drawings in them, numbers among the same words; other words are listed."""
    if re.match(r"\s*<(svg|g|path|\?xml)\b", old):
        compare_drawings(place, _svg_drawing(old), _svg_drawing(new), result)
        return
    old, new = _masked(old), _masked(new)
    is_sentence = " " in old.strip() or " " in new.strip()
    result.counts["sentences" if is_sentence else "leaves"] += 1
    if old == new:
        return
    if _NUMBER.sub("#", old) == _NUMBER.sub("#", new):
        pairs = zip(_NUMBER.findall(old), _NUMBER.findall(new), strict=True)
        if all(same_number(float(one), float(two)) for one, two in pairs):
            return
        result.failures.append(f"{place}: {old!r} before, {new!r} after")
    elif is_sentence:
        result.listed[place.partition(":")[0]].append(f"{old!r} is now {new!r}")
    else:
        result.failures.append(f"{place}: {old!r} before, {new!r} after")


def _cell(text: str) -> object:
    with_number = _NUMBER.fullmatch(text)
    return float(text) if with_number else text


def _csv(data: bytes) -> object:
    rows = csv.reader(io.StringIO(data.decode(), newline=""))
    return [[_cell(cell) for cell in row] for row in rows]


def _xml(data: bytes) -> object:
    def of(node: ElementTree.Element) -> object:
        cells = {name: _cell(value) for name, value in node.attrib.items()}
        return [node.tag, cells, (node.text or "").strip(), [of(child) for child in node]]

    return of(ElementTree.fromstring(data))  # noqa: S314  our own files


def _record(data: bytes) -> object:
    """Return the tables of a run's record; arrays of numbers as lists."""
    connection = sqlite3.connect(":memory:")
    connection.deserialize(data[:18] + b"\1\1" + data[20:])  # no log beside it is looked for
    tables = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")
    content = {}
    for (table,) in tables.fetchall():
        rows = connection.execute(f"SELECT * FROM {table}")  # noqa: S608  a name of the file's own
        names = [column[0] for column in rows.description]
        content[table] = [
            {name: _stored(cell) for name, cell in zip(names, row, strict=True)} for row in rows
        ]
    return content


def _stored(cell: object) -> object:
    if isinstance(cell, bytes):
        return np.frombuffer(cell).tolist() if len(cell) % 8 == 0 else cell.hex()
    try:
        return json.loads(cell) if isinstance(cell, str) else cell
    except ValueError:
        return cell


def _values(read: Callable[[bytes], object]) -> Callable[..., None]:
    def compare_files(place: str, old: bytes, new: bytes, result: Result) -> None:
        compare_values(f"{place}: ", read(old), read(new), result)

    return compare_files


def _toml(place: str, old: bytes, new: bytes, result: Result) -> None:
    texts = old.decode(), new.decode()
    compare_values(f"{place}: ", *map(tomllib.loads, texts), result)
    remarks = ("\n".join(re.findall(r"#.*", text)).encode() for text in texts)
    _compare_sentences(place, *remarks, result)


# --- drawings: lines with their layers and colours


@dataclass(frozen=True)
class Drawing:
    """Lines by layer and colour, in the order in which they are drawn."""

    lines: list[tuple[tuple[str, ...], np.ndarray]]
    tolerance_mm: float
    facts: object = None  # what is compared leaf by leaf: operations, tables of layers
    is_ordered: bool = True  # the order is the machine's; of pictures it says nothing
    words: tuple[str, ...] = ()


def compare_drawings(place: str, old: Drawing, new: Drawing, result: Result) -> None:
    """Compare layers and colours exactly, lines and areas within the format's tolerance."""
    result.counts["drawings"] += 1
    compare_values(f"{place}: facts", old.facts, new.facts, result)
    words = ("\n".join(drawing.words).encode() for drawing in (old, new))
    _compare_sentences(place.partition(":")[0], *words, result)
    groups = _grouped(old), _grouped(new)
    for key in sorted(groups[0].keys() | groups[1].keys()):
        one, two = (group.get(key, []) for group in groups)
        words = f"{place}: lines of {' '.join(key)}"
        if len(one) != len(two):
            result.failures.append(f"{words}: {len(one)} before, {len(two)} after")
        elif problem := _moved(one, two, old.tolerance_mm, is_ordered=old.is_ordered):
            result.failures.append(f"{words}: {problem}")
    order = [[key for key, _ in drawing.lines] for drawing in (old, new)]
    if old.is_ordered and groups[0].keys() == groups[1].keys() and order[0] != order[1]:
        result.failures.append(f"{place}: layers follow each other in another order")


def _grouped(drawing: Drawing) -> dict[tuple[str, ...], list[np.ndarray]]:
    groups = defaultdict(list)
    for key, points in drawing.lines:
        groups[key].append(points)
    return groups


def _moved(
    old: list[np.ndarray], new: list[np.ndarray], near: float, *, is_ordered: bool
) -> str | None:
    """Return how far as many lines lie from each other, if beyond the tolerance."""
    if all(map(_same_points, old, new, [near] * len(old))):
        return None
    pairs = [_apart(one, two) for one, two in zip(old, new, strict=True)]
    away = max(away for away, _ in pairs)
    most_mm2 = [near * _length(one) for one in old]
    if away <= near and all(area <= most for (_, area), most in zip(pairs, most_mm2, strict=True)):
        return None
    whole = max(_farthest(old, new), _farthest(new, old))
    if whole <= near:
        return "the same, in another order" if is_ordered else None
    area = sum(area for _, area in pairs)
    return f"up to {whole:.3g} mm apart (tolerance {near:g}), areas differ by {area:.3g} mm2"


def _same_points(old: np.ndarray, new: np.ndarray, near: float) -> bool:
    return old.shape == new.shape and bool((np.abs(old - new) <= near).all())


def _apart(old: np.ndarray, new: np.ndarray) -> tuple[float, float]:
    """Return the Hausdorff distance of two lines, and the area between two closed ones."""
    away = max(_farthest([old], [new]), _farthest([new], [old]))
    closed = all(len(ring) > 3 and np.allclose(ring[0], ring[-1]) for ring in (old, new))
    if not closed:
        return away, 0.0
    one, two = (shapely.Polygon(ring).buffer(0) for ring in (old, new))
    return away, one.symmetric_difference(two).area


def _length(points: np.ndarray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _farthest(old: Iterable[np.ndarray], new: Iterable[np.ndarray]) -> float:
    """Return the largest distance from the old lines, looked at each mm, to the new ones."""
    lines = shapely.linestrings
    target = [lines(points if len(points) > 1 else points[[0, 0]]) for points in new]
    source = np.array([lines(points if len(points) > 1 else points[[0, 0]]) for points in old])
    source[shapely.length(source) > 0.0] = shapely.segmentize(
        source[shapely.length(source) > 0.0], 1.0
    )
    points = shapely.points(shapely.get_coordinates(source))
    tree = shapely.STRtree(target)
    _, away = tree.query_nearest(points, return_distance=True, all_matches=False)
    return float(away.max(initial=0.0))


def _dxf_drawing(data: bytes) -> Drawing:
    document, _ = ezdxf.recover.read(io.BytesIO(data))
    lines, words = [], []
    for entity in document.modelspace():
        key = (entity.dxf.layer, str(entity.dxf.color), entity.dxf.linetype)
        if entity.dxftype() in ("TEXT", "MTEXT"):
            words.append([*key, entity.dxf.text, *map(float, entity.dxf.insert)])
            continue
        points = ezdxf.path.make_path(entity).flattening(1e-3)
        lines.append((key, np.array([(point.x, point.y) for point in points])))
    layers = [[one.dxf.name, one.dxf.color, one.dxf.linetype] for one in document.layers]
    facts = {"layers": layers, "units": document.header.get("$INSUNITS"), "words": words}
    return Drawing(lines, 1e-6, facts)


_FLAT = np.linspace(0.0, 1.0, 33)[1:]


for _short, _long in {
    "": "http://www.w3.org/2000/svg",
    "xlink": "http://www.w3.org/1999/xlink",
}.items():
    ElementTree.register_namespace(_short, _long)  # svgelements knows names, no spaces


def _svg_drawing(text: bytes | str) -> Drawing:
    """Return what an SVG draws, in mm or pixels; letters drawn as outlines are left out."""
    text = text.decode() if isinstance(text, bytes) else text
    if not re.search(r"<svg\b", text):
        text = f'<svg xmlns="http://www.w3.org/2000/svg">{text}</svg>'
    root = ElementTree.fromstring(text)  # noqa: S314  our own files
    for parent in list(root.iter()):
        for child in list(parent):
            is_empty = child.tag.endswith("}path") and not child.get("d")
            if is_empty or child.get("id", "").startswith("text_"):  # matplotlib's letters
                parent.remove(child)
    is_laser = 'groupmode="layer"' in text
    stream = io.StringIO(ElementTree.tostring(root, encoding="unicode"))
    drawn = svgelements.SVG.parse(stream, ppi=25.4 if is_laser else 96.0, reify=True)
    lines: list[tuple[tuple[str, ...], np.ndarray]] = []
    _walk(drawn, "", lines, is_laser=is_laser)
    said = [part for node in root.iter() for part in (node.text, node.get(_LABEL)) if part]
    words = tuple(line.strip() for part in said for line in part.splitlines())
    if is_laser:
        return Drawing(lines, 2e-3, words=words)
    steps = [step for step in root.iter() if "animate" in step.tag]
    moves = [{key: _cells(cell) for key, cell in step.attrib.items()} for step in steps]
    return Drawing(lines, 0.05, moves, is_ordered=False, words=words)


_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"


def _cells(text: str) -> list[object]:
    return [_cell(part) for part in re.split(r"[\s;,]+", text)]


def _walk(group: Iterable[object], layer: str, lines: list, *, is_laser: bool) -> None:
    for element in group:
        if isinstance(element, svgelements.Group | svgelements.Use):
            name = str(element.values.get("attributes", {}).get("id") or "")
            inner = name if name.startswith("layer_") else layer
            _walk(element, inner, lines, is_laser=is_laser)
        elif isinstance(element, svgelements.Shape):
            key = (layer, f"stroke {element.stroke}", f"fill {element.fill}")
            key += (f"width {element.stroke_width:g}",) if is_laser else ()
            parts = svgelements.Path(element).as_subpaths()
            lines += [(key, _flat(svgelements.Path(part))) for part in parts]


def _flat(path: Iterable[object]) -> np.ndarray:
    points = []
    for segment in path:
        if isinstance(segment, svgelements.Move | svgelements.Linear):
            points.append(segment.end)
        else:
            points += [segment.point(share) for share in _FLAT]
    return np.array([(point.x, point.y) for point in points if point is not None])


_VERTEX = re.compile(r"V(\S+?) (\S+?)(?=c0|c1|V|$)((?:c[01][xy]?[-\d.e]*)*)")


def _lightburn_drawing(data: bytes) -> Drawing:
    """Return the shapes of a LightBurn project; its operations are compared leaf by leaf."""
    root = ElementTree.fromstring(data)  # noqa: S314  our own files
    lines = []
    for shape in root.iter("Shape"):
        found = _VERTEX.findall(shape.findtext("VertList", ""))
        key = (shape.get("Type", ""), f"operation {shape.get('CutIndex')}")
        lines.append((key, _beziers(found, shape.findtext("PrimList", ""))))
    for shape in root.findall("Shape"):
        root.remove(shape)
    return Drawing(lines, 1e-4, _xml(ElementTree.tostring(root)))


def _beziers(vertices: list[tuple[str, str, str]], steps: str) -> np.ndarray:
    places = np.array([(float(x), float(y)) for x, y, _ in vertices])
    points = [places[:1]]
    for kind, start, end in re.findall(r"([LB])(\d+) (\d+)", steps):
        one, two = places[int(start)], places[int(end)]
        if kind == "L":
            points.append(two[None])
            continue
        out, back = _handle(vertices[int(start)], 0), _handle(vertices[int(end)], 1)
        t = _FLAT[:, None]
        curve = (1 - t) ** 3 * one + 3 * t * (1 - t) ** 2 * out + 3 * t**2 * (1 - t) * back
        points.append(curve + t**3 * two)
    return np.concatenate(points)


def _handle(vertex: tuple[str, str, str], which: int) -> np.ndarray:
    """Return a control point of a vertex: ``c0`` leaves it, ``c1`` comes in."""
    x, y, handles = vertex
    given = dict(re.findall(rf"c{which}([xy])([-\d.e]+)", handles))
    own = {"x": float(x), "y": float(y)}
    return np.array([float(given.get(axis, own[axis])) for axis in "xy"])


def _geojson_drawing(data: bytes) -> Drawing:
    content = json.loads(data)
    lines, facts = [], {key: part for key, part in content.items() if key != "features"}
    facts["features"] = [
        {key: part for key, part in one.items() if key != "geometry"} for one in content["features"]
    ]
    for number, one in enumerate(content["features"]):
        shape = shapely.geometry.shape(one["geometry"])
        for part in shapely.get_parts(shape):
            rings = shapely.get_rings(part) if shapely.get_type_id(part) == 3 else [part]
            key = (f"feature {number}", shape.geom_type)
            lines += [(key, shapely.get_coordinates(ring)) for ring in rings]
    return Drawing(lines, 1e-6, facts)


def _drawn(read: Callable[[bytes], Drawing]) -> Callable[..., None]:
    def compare_files(place: str, old: bytes, new: bytes, result: Result) -> None:
        if _unmarked(old) == _unmarked(new):
            result.counts["drawings"] += 1
        else:
            compare_drawings(place, read(old), read(new), result)

    return compare_files


def _unmarked(data: bytes) -> bytes:
    return re.sub(rb"written by vinefab [\w.+-]+", b"", data)


# --- solids


def _stl(data: bytes) -> dict[str, trimesh.Trimesh]:
    return {"solid": trimesh.load(io.BytesIO(data), file_type="stl")}


def _threemf(data: bytes) -> dict[str, trimesh.Trimesh]:
    """Return the objects of a 3MF as placed; trimesh's own reader wants two further packages."""
    space = {"m": "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"}
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        root = ElementTree.fromstring(archive.read("3D/3dmodel.model"))  # noqa: S314
    places = {
        item.get("objectid"): item.get("transform")
        for item in root.iter()
        if "objectid" in item.attrib
    }
    solids = {}
    for one in root.iterfind(".//m:object", space):
        vertices = [
            [float(v.get(axis)) for axis in "xyz"] for v in one.iterfind(".//m:vertex", space)
        ]
        faces = [
            [int(f.get(f"v{k}")) for k in (1, 2, 3)] for f in one.iterfind(".//m:triangle", space)
        ]
        turned = np.array((places.get(one.get("id")) or "1 0 0 0 1 0 0 0 1 0 0 0").split(), float)
        placed = np.array(vertices) @ turned[:9].reshape(3, 3) + turned[9:]
        solids[f"{one.get('id')} {one.get('name')}"] = trimesh.Trimesh(placed, faces, process=True)
    return solids


def _solids(read: Callable[[bytes], dict[str, trimesh.Trimesh]]) -> Callable[..., None]:
    def compare_files(place: str, old: bytes, new: bytes, result: Result) -> None:
        result.counts["solids"] += 1
        if old == new:
            return
        one, two = read(old), read(new)
        if list(one) != list(two):
            result.failures.append(f"{place}: parts {list(one)} before, {list(two)} after")
            return
        for name, solid in one.items():
            if problem := _another_solid(solid, two[name]):
                result.failures.append(f"{place}: {name}: {problem}")

    return compare_files


def _another_solid(old: trimesh.Trimesh, new: trimesh.Trimesh) -> str:
    """Return how two solids differ beyond single precision, if they do."""
    near = 1e-6 * float(np.abs(old.bounds).max())
    trees = [scipy.spatial.cKDTree(solid.vertices) for solid in (old, new)]
    away = max(trees[0].query(new.vertices)[0].max(), trees[1].query(old.vertices)[0].max())
    pairs = ((old, new), (new, old))
    rests = [one.difference(other, engine="manifold") for one, other in pairs]
    both = [rest.volume for rest in rests if len(rest.faces)]
    if away <= near and sum(both) <= near * old.area:
        return ""
    return f"corners up to {away:.3g} mm apart, volumes differ by {sum(both):.3g} mm3"


# --- sentences and pictures


def _masked(text: str) -> str:
    for pattern, _ in MASKED_WORDS:
        text = re.sub(pattern, "~", text)
    return text


def _compare_sentences(place: str, old: bytes, new: bytes, result: Result) -> None:
    texts = [
        [_masked(line) for line in data.decode("utf-8", "replace").splitlines()]
        for data in (old, new)
    ]
    result.counts["sentences"] += sum(bool(line.strip()) for line in texts[0])
    if texts[0] != texts[1]:
        changed = difflib.unified_diff(*texts, n=0, lineterm="")
        result.listed[place] += [
            line for line in changed if not line.startswith(("---", "+++", "@@"))
        ]


def _compare_pages(place: str, old: bytes, new: bytes, result: Result) -> None:
    """Compare the words of two pages, a line for each element; their pictures are only named."""
    words, pictures = [], []
    for data in (old, new):
        text = data.decode()
        pictures.append(re.findall(r"(?s)<svg\b.*?</svg>|data:image[^\"')]*", text))
        text = re.sub(r"(?s)<(svg|style|script)\b.*?</\1>", " ", text)
        lines = re.sub(r"<[^>]*>", "\n", text).splitlines()
        words.append("\n".join(line.strip() for line in lines if line.strip()).encode())
    _compare_sentences(place, *words, result)
    result.counts["pictures"] += len(pictures[0])
    for number, (one, two) in enumerate(zip_longest(*pictures)):
        if one is None or two is None or _masked(one) != _masked(two):
            result.listed[place].append(f"picture {number} differs")


def _compare_pictures(place: str, old: bytes, new: bytes, result: Result) -> None:
    result.counts["pictures"] += 1
    if _unmarked(old) != _unmarked(new):
        result.listed[place].append("the picture differs")


def _left_out(_place: str, _old: bytes, _new: bytes, result: Result) -> None:
    result.counts["left out"] += 1


# --- files and recordings

KINDS: dict[str, Callable[[str, bytes, bytes, Result], None]] = {
    ".json": _values(json.loads),
    ".csv": _values(_csv),
    ".sqlite": _values(_record),
    ".toml": _toml,
    ".dxf": _drawn(_dxf_drawing),
    ".svg": _drawn(_svg_drawing),
    ".lbrn2": _drawn(_lightburn_drawing),
    ".geojson": _drawn(_geojson_drawing),
    ".stl": _solids(_stl),
    ".3mf": _solids(_threemf),
    ".txt": _compare_sentences,
    ".md": _compare_sentences,
    ".html": _compare_pages,
    ".png": _compare_pictures,
    ".gif": _compare_pictures,
    ".pdf": _compare_pictures,
    ".sha256": _left_out,  # hashes of files that are compared themselves, times and all
}
"""What compares a file, by the end of its name; another end is an error."""


def compare(old: Path, new: Path, names: Iterable[str]) -> Result:
    """Compare the cases that stand in the old recording with those of the new one."""
    result = Result()
    for name in names:
        if (old / name).is_dir() or (new / name).is_dir():
            result.counts["cases"] += 1
            _compare_case(old, new, name, result)
    if not result.counts["cases"]:
        raise SystemExit(f"{old}: no recorded case")
    return result


def _compare_case(old: Path, new: Path, name: str, result: Result) -> None:
    before, after = (
        {str(path.relative_to(folder)) for path in (folder / name).rglob("*") if path.is_file()}
        for folder in (old, new)
    )
    for place in sorted(before | after):
        kind = KINDS.get(Path(place).suffix)
        if kind is None:
            result.failures.append(f"{place}: no comparator for {Path(place).suffix!r} in KINDS")
        elif place not in before & after:
            result.failures.append(f"{place}: only {'before' if place in before else 'after'}")
        else:
            result.counts["files"] += 1
            kind(place, (old / place).read_bytes(), (new / place).read_bytes(), result)
