"""Files made to break a reader: one clear line and exit code 2, in bounded time and memory."""

import json
import subprocess
import sys
import textwrap
import time
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest

from vinefab.core.errors import BadInputError
from vinefab.fabrication.calibration.coupons import read_results
from vinefab.studies.paper_charts import blank, house_style, svg_bytes

LONGEST_S = 10.0  # of one refusal, in processor time
MOST_BYTES = 2 << 30

PLAIN = 'schema = "vinefab/design-1"\nname = "d"\n[trunk]\nlength = 120.0\n'
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="500mm" height="500mm" viewBox="0 0 500 500">'
    '%s<rect width="400" height="400"/></svg>'
)
ROS = "image: x.pgm\nresolution: %s\norigin: [0, 0, 0]\n"


def alias_bomb():
    """A list of ten lists of ten lists: 10^9 entries in half a kilobyte."""
    levels = [f"k{n}: &k{n} [{', '.join([f'*k{n - 1}'] * 10)}]" for n in range(1, 9)]
    return "\n".join(["k0: &k0 [x, x, x]", *levels, "image: *k8", "resolution: 0.05"])


def merge_chain():
    levels = [f"k{n}: &k{n} {{<<: [{', '.join([f'*k{n - 1}'] * 10)}]}}" for n in range(1, 9)]
    return "\n".join(["k0: &k0 {x: 1}", *levels, "resolution: 0.05"])


def nested_uses(content):
    """A drawing of 10^11 copies of something."""
    groups = "".join(
        f'<g id="g{n}">' + f'<use href="#g{n - 1}"/>' * 10 + "</g>" for n in range(1, 12)
    )
    return f'<defs><g id="g0">{content}</g>{groups}</defs><use href="#g11"/>'


def deep_uses():
    """Groups 200 deep, each in the use of the one before."""
    return "".join(
        f'<g id="g{n}">{"<g>" * 200}<use href="#g{n + 1}"/>{"</g>" * 200}</g>' for n in range(20)
    )


def dxf(*entities):
    """A drawing of release 12: (type, group codes and values) per entity, blocks among them."""
    plain = [("SECTION", {2: "BLOCKS"})] if entities[0][0] == "BLOCK" else []
    tags = [*plain, *entities, ("ENDSEC", {}), ("EOF", {})]
    return "".join(
        f"0\n{kind}\n" + "".join(f"{code}\n{value}\n" for code, value in values.items())
        for kind, values in tags
    )


def dxf_blocks(levels, insert):
    """Blocks of ten copies of the block before; the last one is inserted."""
    entities = [("BLOCK", {8: 0, 2: "B0"}), ("LINE", {8: 0, 11: 9, 21: 9}), ("ENDBLK", {8: 0})]
    for level in range(1, levels + 1):
        copy = ("INSERT", {8: 0, 2: f"B{level - 1}", 10: 0, 20: 0})
        entities += [("BLOCK", {8: 0, 2: f"B{level}"}), *[copy] * 10, ("ENDBLK", {8: 0})]
    entities += [("ENDSEC", {}), ("SECTION", {2: "ENTITIES"})]
    return dxf(*entities, ("INSERT", {8: 0, 2: f"B{levels}", 10: 0, 20: 0, **insert}))


def long_polyline():
    marks = "100\nAcDbEntity\n8\n0\n100\nAcDbPolyline\n"
    return f"0\nLWPOLYLINE\n{marks}" + "10\n1\n20\n1\n" * 10_000


def geojson(facts="{}", name='"d"'):
    """A square map with its facts as they stand in the file."""
    ring = "[[0, 0], [300, 0], [300, 300], [0, 300]]"
    start = '{"role": "start", "heading_deg": 90}'
    return (
        '{"type": "FeatureCollection", "vinefab": {"schema": "vinefab/map-1", '
        f'"name": {name}, "facts": {facts}}}, "features": ['
        '{"type": "Feature", "properties": {"role": "bounds"}, '
        f'"geometry": {{"type": "Polygon", "coordinates": [{ring}]}}}}, '
        f'{{"type": "Feature", "properties": {start}, '
        '"geometry": {"type": "Point", "coordinates": [150, 20]}}]}'
    )


OVER_LIMITS = "cannot be read within"
"""Said of files that the limits of the reading process end."""

REFUSED = {
    "alias bomb": ("m.yaml", alias_bomb, "anchors (&) and aliases (*)"),
    "merge chain": ("m.yaml", merge_chain, "anchors (&) and aliases (*)"),
    "int of letters": ("m.yaml", lambda: ROS % "!!int abc", "line 2: 'abc' is not a valid int"),
    "no such day": (
        "m.yaml",
        lambda: ROS % "2001-99-99",
        "line 2: '2001-99-99' is not a valid timestamp",
    ),
    "date": ("m.yaml", lambda: ROS % "2001-01-01", "resolution is datetime.date"),
    "long YAML integer": ("m.yaml", lambda: ROS % ("9" * 5000), "line 2: '9999"),
    "long integer": ("d.toml", lambda: PLAIN + "x = " + "9" * 5000, "line 5: an integer of over"),
    "long hexadecimal": (
        "d.toml",
        lambda: PLAIN.replace("120.0", "0x" + "f" * 4000),
        "trunk.length is a whole number of about 4816 digits",
    ),
    "dotted key": ("d.toml", lambda: PLAIN + ".".join(["a"] * 20_000) + " = 1", "line 5: a key"),
    "dotted table": ("d.toml", lambda: PLAIN + f"[{'.'.join(['a'] * 20_000)}]", "line 5: a key"),
    "million keys": (
        "d.toml",
        lambda: PLAIN + "".join(f"k{n} = 1\n" for n in range(1_000_000)),
        "is larger than",
    ),
    "keys of a megabyte": (
        "d.toml",
        lambda: PLAIN + "".join(f"k{n} = 1\n" for n in range(80_000)),
        "trunk.k0: there is no such key",
    ),
    "deep origin": ("d.toml", lambda: PLAIN + "[origin]\nx = " + "[" * 60 + "]" * 60, "nested"),
    "NaN in origin": ("d.toml", lambda: PLAIN + "[origin]\nx = nan", "origin.x is nan"),
    "date in origin": ("d.toml", lambda: PLAIN + "[origin]\nx = 2001-01-01", "origin.x is"),
    "wide body": (
        "d.toml",
        lambda: PLAIN + "[build]\nwidths_mm = [1e7]",
        "build.widths_mm[1] is 10000000.0; allowed: less than or equal to 10000",
    ),
    "key in capitals": (
        "d.toml",
        lambda: PLAIN.replace("length", "LENGTH"),
        "trunk.LENGTH: there is no such key; did you mean 'length'?",
    ),
    "long key": ("d.toml", lambda: PLAIN + f'"{"k" * 100_000}" = 1', "no such key"),
    "half a letter": ("m.geojson", lambda: geojson(name='"x\\ud800"'), "vinefab.name is 'x"),
    "NaN facts": ("m.geojson", lambda: geojson('{"a": [1, NaN]}'), "vinefab.facts.a[2] is nan"),
    "infinite facts": ("m.geojson", lambda: geojson('{"a": 1e999}'), "vinefab.facts.a is inf"),
    "huge arc": ("m.svg", lambda: SVG % '<path d="M0 0A1e308 1e308 0 0 1 9 9"/>', "1e308 1e308"),
    "huge circle": ("m.svg", lambda: SVG % '<circle r="1e308"/>', "r is '1e308'"),
    "long length": ("m.svg", lambda: SVG % f'<circle r="{"9" * 300_000}!"/>', "r is '9999"),
    "huge scale": ("m.svg", lambda: SVG % '<g transform="scale(1e200)"/>', "transform is '1e200'"),
    "overflow in groups": (
        "m.svg",
        lambda: (
            SVG % ('<g transform="scale(1e12)">' * 40 + '<path d="M1 1L9 9V1z"/>' + "</g>" * 40)
        ),
        "not finite",
    ),
    "nested uses": (
        "m.svg",
        lambda: SVG % nested_uses('<path d="M0 0h1v1z"/>'),
        OVER_LIMITS,
    ),
    "nested empty uses": ("m.svg", lambda: SVG % nested_uses(""), OVER_LIMITS),
    "deep uses": ("m.svg", lambda: SVG % deep_uses(), "nested too deep"),
    "array of blocks": (
        "m.dxf",
        lambda: dxf_blocks(0, {70: 10**9, 71: 10**9, 44: 1, 45: 1}),
        OVER_LIMITS,
    ),
    "blocks of blocks": ("m.dxf", lambda: dxf_blocks(12, {}), OVER_LIMITS),
    "polyline in blocks": (
        "m.dxf",
        lambda: dxf_blocks(0, {}).replace("0\nLINE\n", f"{long_polyline()}0\nLINE\n"),
        "a line does not close",
    ),
}


def command_for(path):
    if path.suffix == ".toml":
        return ["check", str(path)]
    if path.suffix == ".geojson":
        return ["map", "info", str(path)]
    return ["map", "import", str(path), "--out", str(path.with_name("out.geojson"))]


@pytest.fixture(scope="module")
def refusals(tmp_path_factory):
    """Every file of the table in one process whose memory is limited: (code, words, seconds)."""
    folder = tmp_path_factory.mktemp("hostile")
    commands = {}
    for number, (case, (name, content, _)) in enumerate(REFUSED.items()):
        path = folder / str(number) / name
        path.parent.mkdir()
        path.write_text(content())
        commands[case] = command_for(path)
    program = textwrap.dedent(
        """
        import contextlib, io, json, resource, sys, time
        from vinefab.cli.main import main
        from vinefab.core import bounded
        bounded._CPU_S = 1  # what takes for ever takes longer
        resource.setrlimit(resource.RLIMIT_DATA, (int(sys.argv[1]),) * 2)
        for case, command in json.loads(sys.stdin.read()).items():
            words, begin = io.StringIO(), time.process_time()
            with contextlib.redirect_stderr(words):
                code = main(command)
            seconds = time.process_time() - begin
            print(json.dumps([case, code, words.getvalue(), seconds]), flush=True)
        """
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(MOST_BYTES)],
        input=json.dumps(commands),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith('["')]
    assert done.stderr == ""
    return {case: result for case, *result in lines}


@pytest.mark.parametrize("case", REFUSED)
def test_hostile_files_are_refused_in_one_line(refusals, case):
    code, words, seconds = refusals[case]
    assert code == 2, words
    assert words.startswith("error: ")
    assert words.count("\n") == 1
    assert len(words) < 600
    name, _, expected = REFUSED[case]
    assert f"/{name}: " in words
    assert expected in words
    assert seconds < LONGEST_S


STYLES = {
    "no braces": "a " * 150_000,
    "open comments": "text {fill: none} " + "/* " * 200_000,
    "many selectors": ",".join(f"s{n}" for n in range(20_000))
    + "{"
    + "".join(f"p{n}: 1;" for n in range(20_000))
    + "}",
}


@pytest.mark.parametrize("sheet", STYLES.values(), ids=STYLES)
def test_style_sheets_are_read_in_time_that_grows_with_their_length(vinefab, tmp_path, sheet):
    path = tmp_path / "m.svg"
    path.write_text(SVG % f"<style>{sheet}</style>")
    begin = time.monotonic()
    assert vinefab("map", "import", path, "--out", tmp_path / "m.geojson")[0] == 0
    assert time.monotonic() - begin < LONGEST_S


def test_rules_in_rules_are_refused_in_time_that_grows_with_their_length(vinefab, tmp_path):
    path = tmp_path / "m.svg"
    path.write_text(SVG % f"<style>{'a{' * 200_000}</style>")
    begin = time.monotonic()
    code, _, complaint = vinefab("map", "import", path, "--out", tmp_path / "m.geojson")
    assert (code, complaint.count("\n")) == (2, 1)
    assert "a rule in a rule is not read" in complaint
    assert time.monotonic() - begin < LONGEST_S


def test_a_sheet_with_comments_and_media_still_hides(vinefab, tmp_path):
    path = tmp_path / "m.svg"
    sheet = "/* } */ @media screen { .a {fill: red} .b, .c /* x */ {display: none} } .d{}"
    path.write_text(SVG % f'<style>{sheet}</style><rect class="c" width="9" height="9"/>')
    _, output, _ = vinefab("map", "import", path, "--out", tmp_path / "m.geojson")
    assert "'display:none': 1" in output


NAMES = {
    "dollars": "cost $\\foo$ map",
    "no glyph": "map \U0010ffff \u4e2d\u6587 \U0001f600",
    "long": "x" * 100_000,
    "many lines": "x\n" * 1_000,
}


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_names_are_drawn_as_they_are(recwarn, name):
    with house_style():
        figure, axes = blank()
        axes.set_title(name)
        axes.plot([0.0, 1.0], label=name)
        axes.legend()
    assert svg_bytes(figure).startswith(b"<?xml")
    assert not recwarn.list


OBEYED = "a\0b\x1b]0;own\x07\x9b2J\u202e\ufffe[/red]<script>"
"""What terminals, XML and rich's markup do not take as text."""


def test_no_name_is_obeyed_by_xml_or_a_terminal(vinefab, tmp_path):
    path, picture = tmp_path / "m.geojson", tmp_path / "m.svg"
    path.write_text(geojson(name=json.dumps(OBEYED)))
    code, said, words = vinefab("map", "info", path, "--svg", picture)
    assert (code, words) == (0, "")
    assert "[/red]<script>" in said
    assert all(letter.isprintable() or letter == "\n" for letter in said)
    assert ElementTree.fromstring(picture.read_bytes()).tag.endswith("svg")  # noqa: S314  our own


def test_no_path_in_an_error_is_obeyed_by_a_terminal(vinefab, tmp_path):
    code, _, words = vinefab("map", "info", tmp_path / "a\x1b]0;own\x07.geojson")
    assert code == 2
    assert words.strip().isprintable()


def test_a_rig_of_such_a_name_is_made(vinefab, tmp_path):
    path, rig = tmp_path / "m.geojson", tmp_path / "rig"
    path.write_text(geojson(name=json.dumps(OBEYED)))
    options = ("--fit-mm", 100, "--allow-empty", "--no-pictures")
    code, said, words = vinefab("rig", path, "--out", rig, *options)
    assert (code, words) == (0, ""), said
    with ZipFile(rig / "bed_01.3mf") as archive:
        root = ElementTree.fromstring(archive.read("3D/3dmodel.model"))  # noqa: S314  our own
    assert "[/red]<script>" in root[0].text


@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_maps_of_such_names_are_described(vinefab, tmp_path, name):
    path = tmp_path / "m.geojson"
    path.write_text(geojson(name=json.dumps(name)))
    code, _, words = vinefab("map", "info", path, "--svg", tmp_path / "m.svg")
    assert (code, words) == (0, "")


def test_a_cell_longer_than_the_csv_reader_allows(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text(f"measure,setting,value,unit\n{'a' * 140_000},1,1,mm\n")
    with pytest.raises(
        BadInputError, match=r"line 2: the line cannot be read as cells .field larger"
    ) as refused:
        read_results(path)
    assert len(str(refused.value)) < 300


def test_equal_outlines_by_the_thousand_are_one(vinefab, tmp_path):
    path = tmp_path / "m.svg"
    path.write_text(SVG % ('<circle cx="200" cy="200" r="80"/>' * 4_000))
    begin = time.process_time()
    code, output, words = vinefab("map", "import", path, "--out", tmp_path / "m.geojson")
    assert (code, words) == (0, "")
    assert "repeated_outlines_removed: 3999" in output
    assert time.process_time() - begin < LONGEST_S


def test_sizes_at_the_limit_of_floats_bring_no_warning(vinefab, tmp_path, recwarn):
    path = tmp_path / "m.csv"
    room = "r,0,0\nr,100,0\nr,100,60\nr,0,1e-308\n"
    path.write_text(room + "p,40,20\np,60,20\np,60,40\np,40,40\n")
    code, _, words = vinefab("map", "import", path, "--out", tmp_path / "m.geojson")
    assert code == 2
    assert words.count("\n") == 1
    assert not recwarn.list


@pytest.mark.parametrize("value", ["1e308", "-1", "nan", "inf", "9" * 5000])
def test_readings_are_numbers_that_can_be_fitted(tmp_path, value):
    path = tmp_path / "results.csv"
    path.write_text(f"measure,setting,value,unit\nseam,weldcut,{value},m\n")
    with pytest.raises(BadInputError, match="0 or more, at most 1e"):
        read_results(path)


def test_a_quote_that_does_not_end_hides_no_reading(tmp_path):
    path = tmp_path / "results.csv"
    path.write_text('measure,setting,value,unit\nseam,"weldcut,0.4,mm\n')
    with pytest.raises(
        BadInputError, match=r"line 2: the line cannot be read as cells \(.*mend its quotes"
    ):
        read_results(path)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("m.dxf", "there is no such file"),
        ("/dev/zero", "is a device or a pipe"),
        ("/dev/null", "is a device or a pipe"),
        ("/proc/self/mem", "is part of the system (proc)"),
        ("/proc/kmsg", "is part of the system (proc)"),
    ],
)
def test_links_to_what_is_no_file(vinefab, tmp_path, target, words):
    path = tmp_path / "m.dxf"
    path.symlink_to(target)
    code, _, said = vinefab("map", "import", path, "--out", tmp_path / "m.geojson")
    assert code == 2
    assert said.startswith(f"error: {path}: ")
    assert words in said


def test_a_value_is_never_printed_whole():
    whole = [[["x" * 100] * 1000] * 1000] * 1000
    assert len(str(BadInputError("key", whole, "less"))) < 100
    assert "digits" in str(BadInputError("key", 10**5000, "less"))


def test_thousands_of_obstacles_are_imported(vinefab, tmp_path):
    path = tmp_path / "m.svg"
    places = [(2 * column, 2 * row) for column in range(1, 51) for row in range(1, 41)]
    path.write_text(
        SVG % "".join(f'<rect x="{x}" y="{y}" width="1" height="1"/>' for x, y in places)
    )
    code, output, _ = vinefab("map", "import", path, "--out", tmp_path / "m.geojson")
    assert code == 0
    assert "2000 obstacles, 8004 walls, free area 0.158 m2" in output
