"""The documentation: it is built without a warning, and what it tells a user to type works."""

import ast
import inspect
import json
import math
import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from itertools import combinations, pairwise
from pathlib import Path

import pytest
import shapely

import vinefab as vf
from tests.cli.test_calibration import filled
from vinefab.app.verbs import GROUPS, SHORT, VERBS
from vinefab.cli.commands import Command, UsageError, all_options, command_for, flags_of
from vinefab.cli.main import command_help
from vinefab.core.table import declared_keys
from vinefab.fabrication.rules.catalog import RULES
from vinefab.model.start import StartTable
from vinefab.search.optimizers.optimizer import SearchAxes

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
sys.path[:0] = [str(DOCS), str(ROOT / "tests")]

import draw_rules  # noqa: E402  lies in docs/, which is no package
import python_pages  # noqa: E402  as above
import reference_pages  # noqa: E402  as above
from rule_sketch import long_px  # noqa: E402  as above
from written_lines import (  # noqa: E402  as above
    BANNED,
    PAGES,
    WrittenLine,
    help_examples,
    mentioned_on,
    written_on,
)


def pages_below(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8")
        for path in folder.rglob("*.md")
    }


def test_reference_pages_are_what_the_code_says(tmp_path):
    reference_pages.write_reference(tmp_path)
    written = pages_below(tmp_path)
    kept = pages_below(DOCS / "reference")
    del kept["map.md"]  # written by hand, as maps are read
    stale = [name for name in written if kept.get(name) != written[name]]
    assert (stale, sorted(kept)) == ([], sorted(written)), "run: python docs/reference_pages.py"


def test_every_key_of_every_file_has_a_meaning():
    bare = [
        (page.name, title, key.name)
        for page in reference_pages.FORMATS
        for title, form in reference_pages.tables_of(page.form)
        for key in reference_pages.keys_of(form)
        if not key.meaning
    ]
    assert bare == []


def test_every_key_of_a_start_stands_on_the_page_of_map_files():
    page = (DOCS / "reference" / "map.md").read_text(encoding="utf-8")
    of_geometry = {"line", "area"}
    keys = {key.name for key in declared_keys(StartTable)} - of_geometry
    missing = [key for key in keys if f"`{key}`" not in page]
    assert missing == []


def test_every_parameter_of_every_part_has_a_meaning():
    page = reference_pages.parts_page()
    assert re.findall(r"^- `(\w+)` \([^)]*\): *$", page, re.MULTILINE) == []
    assert len(re.findall(r"^- `\w+` \(", page, re.MULTILINE)) > 80


WORD_PICTURES = ("anatomy", "growth")
RULE_PICTURES = DOCS / "pictures" / "rules"


def test_every_rule_has_a_picture_on_its_page_and_every_picture_a_rule():
    drawn = {path.stem for path in RULE_PICTURES.iterdir()}
    assert drawn == set(draw_rules.SCENES) == {name for name in RULES if name.startswith("VF-")}
    page = reference_pages.rules_page()
    shown = re.findall(r"^### (.*?): .*\n\n!\[.*?\]\(\.\./pictures/rules/(.*?)\.svg\)", page, re.M)
    assert dict(shown) == {rule: rule for rule in drawn}


OF_NO_ONE_NUMBER = {"VF-T03", "VF-W04", "VF-I04", "VF-J05", "VF-S01", "VF-L02"}
"""Rules whose pictures show an area, a difference or what is missing."""


def words_of(drawing):
    return re.findall(r"<text.*?>(.*?)</text>", drawing)


@pytest.mark.thorough
def test_pictures_of_rules_show_what_the_rules_measure():
    """Each rule fires on one side of its picture and not on the other: else it is not drawn."""
    stale, silent = [], []
    for rule in draw_rules.SCENES:
        sides = draw_rules.sides_of(rule)
        words = words_of(draw_rules.rule_picture(rule, sides))
        if words_of((RULE_PICTURES / f"{rule}.svg").read_text(encoding="utf-8")) != words:
            stale.append(rule)
        measured = sides[0].finding.measured
        if measured is not None and rule not in OF_NO_ONE_NUMBER:
            numbers = [float(one) for text in words[:-1] for one in re.findall(r"[\d.]*\d", text)]
            if not any(one == pytest.approx(measured, rel=0.01) for one in numbers):
                silent.append(rule)
    assert (stale, silent) == ([], []), "run: python docs/draw_pictures.py"


def test_a_picture_whose_sides_do_not_differ_is_refused(monkeypatch):
    scene = draw_rules.SCENES["VF-C01"]
    monkeypatch.setitem(draw_rules.SCENES, "VF-C01", replace(scene, right=scene.wrong))
    with pytest.raises(ValueError, match="VF-C01: its right side"):
        draw_rules.sides_of("VF-C01")


def test_words_too_long_for_a_picture_are_refused():
    sides = draw_rules.sides_of("VF-B02")
    sides[0].sketch.says = "a mouth much too wide for its clamp"
    with pytest.raises(ValueError, match="too long for a panel"):
        draw_rules.rule_picture("VF-B02", sides)


LINE_PX = 11.0
"""Height of words in pictures, about."""


def places_of_words(panel):
    """Return the words of a panel as boxes: left, top, right, bottom."""
    shift = {"start": 0.0, "middle": 0.5, "end": 1.0}
    form = r'<text class="halo" text-anchor="(\w+)" x="(\d+)" y="(\d+)">(.+?)</text>'
    for anchor, x, y, words in re.findall(form, panel):
        long = 0.95 * long_px(words)
        left = float(x) - shift[anchor] * long
        yield words, shapely.box(left, float(y) - LINE_PX, left + long, float(y))


def test_no_words_in_pictures_lie_over_others():
    pictures = [*RULE_PICTURES.iterdir(), *(DOCS / "pictures" / f"{n}.svg" for n in WORD_PICTURES)]
    over, count = [], 0
    for path in pictures:
        for panel in path.read_text(encoding="utf-8").split("<svg x=")[-2:]:
            placed = [one for one in places_of_words(panel) if one[0].strip()]
            count += len(placed)
            over += [
                (path.stem, one, two)
                for (one, here), (two, there) in combinations(placed, 2)
                if here.buffer(-1.0).intersects(there.buffer(-1.0))
            ]
    assert over == []
    assert count > 100


@pytest.mark.thorough
def test_the_site_is_built_without_a_warning(tmp_path):
    build = ["-b", "html", "-q", "-W", "--keep-going", "-d", str(tmp_path / "trees"), str(DOCS)]
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *build, str(tmp_path / "site")],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    home = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert "Your first robot" in home
    index = (tmp_path / "site" / "genindex.html").read_text(encoding="utf-8")
    assert "tips_mm (vf.Deployment property)" in index
    assert not re.search(r'(src|href)="https?://[^"]+\.(js|css)"', home), "nothing from elsewhere"


def anchors_of(page: Path) -> set[str]:
    """Return what headings of a page are called in links, as GitHub and the site name them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    names = (
        re.sub(r"\[(.*?)\]\(.*?\)", r"\1", one) for one in re.findall(r"^#+ (.*)$", text, re.M)
    )
    return {re.sub(r"[^\w\- ]", "", name.lower()).strip().replace(" ", "-") for name in names}


def broken_links(page: Path) -> list[str]:
    """Return the links of a page, to files and headings of the project, that lead nowhere."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in link:
            continue
        name, _, anchor = link.partition("#")
        goal = (page.parent / name).resolve() if name else page
        if not goal.exists() or (anchor and anchor not in anchors_of(goal)):
            broken.append(link)
    return broken


def test_a_link_that_leads_nowhere_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# Who, `what` 1\n[a](page.md#who-what-1) [b](#who) [c](none.md)\n")
    assert broken_links(page) == ["#who", "none.md"]


def test_every_link_of_the_pages_leads_somewhere():
    pages = [*ROOT.glob("*.md"), ROOT / "vinefab" / "README.md", *sorted(DOCS.rglob("*.md"))]
    pages = [page for page in pages if "_build" not in page.parts]
    assert {page.name: broken for page in pages if (broken := broken_links(page))} == {}


def test_the_readme_and_the_glossary_stay_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 600
    terms = re.findall(r"^- \*\*", (DOCS / "glossary.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert 30 < len(terms) <= 60


# --- Language -----------------------------------------------------------------------------------


def public_docstrings():
    """Yield the names of the public face with their docstrings, methods of classes included."""
    for name in vf.__all__:
        public = getattr(vf, name)
        if inspect.ismodule(public):
            continue  # its function is a command
        yield name, inspect.getdoc(public) or ""
        for method, found in vars(public).items() if inspect.isclass(public) else ():
            if not method.startswith("_") and (callable(found) or isinstance(found, property)):
                yield f"{name}.{method}", inspect.getdoc(found) or ""


def written_texts():
    """Yield the pages, the helps and the docstrings of the public face, with their names."""
    pages = [
        ROOT / "README.md",
        *(page for page in DOCS.rglob("*.md") if "_build" not in page.parts),
    ]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        yield (
            page.relative_to(ROOT).as_posix(),
            re.sub(r"^ *```.*?^ *```|^:{3,}\{py:.*?$", "", text, flags=re.S | re.M),
        )
    for name in VERBS:
        yield f"vinefab {name} --help", command_help(Command.named(name), 10_000)
    yield from public_docstrings()


@pytest.mark.parametrize(
    "text",
    ["It lies beside the wall", "Say what is wrong of what was made", "It is no path", "In words"],
)
def test_banned_turns_are_found(text):
    assert BANNED.search(text)


@pytest.mark.parametrize(
    "text",
    ["There is no such file", "Further designs: --beside DESIGN", "beside\n    Further designs."],
)
def test_plain_turns_are_not_banned(text):
    assert not BANNED.search(text)


def test_no_page_help_or_public_docstring_has_a_banned_turn():
    texts = dict(written_texts())
    assert len(texts) > 150
    found = {name: match[0] for name, text in texts.items() if (match := BANNED.search(text))}
    assert found == {}


# --- What a user types --------------------------------------------------------------------------


TYPED = [
    line
    for page in PAGES
    if page.stem != "plugins" and page.parent.name != "plugin_template"  # of a package of one's own
    for line in written_on(page)
    if line.text.startswith("vinefab ")
]
MENTIONED = [line for page in PAGES for line in mentioned_on(page)]


def understood(line):
    """Read a line as the program does, without running the command."""
    words = [word.replace("NAME", "grid") for word in shlex.split(line.text)[1:]]
    name, typed = command_for(words)
    if name not in GROUPS:
        Command.named(name).understood([word for word in typed if word not in ("-h", "--help")])


def unknown_options(line):
    """Return the options of a line in a sentence, which may leave out the rest, that are none."""
    words = [word.replace("NAME", "grid") for word in shlex.split(line.text)[1:]]
    given = {word.partition("=")[0] for word in words if word.startswith("--")}
    name, typed = command_for(words)
    if name in GROUPS:
        return given - {"--help"}
    given = {word.partition("=")[0] for word in typed if word.startswith("--")}
    known = {flag for one in all_options(Command.named(name)) for flag in flags_of(one)}
    return given - known - {"--help"}


def test_pages_have_commands():
    assert len(TYPED) > 100
    assert {line.text.split()[1] for line in TYPED} >= {"new", "map", "grow", "optimize", "rig"}
    assert len(MENTIONED) > 20


def test_a_wrong_line_is_found():
    with pytest.raises(UsageError, match="--optimizers is missing"):
        understood(WrittenLine(Path("x"), "vinefab study contest a.toml --out b"))
    assert unknown_options(WrittenLine(Path("x"), "vinefab study bench --quick")) == {"--quick"}


def test_every_command_line_of_pages_and_helps_is_understood():
    for line in (*TYPED, *help_examples()):
        try:
            understood(line)
        except vf.VinefabError as error:
            pytest.fail(f"{line.page}: {line.text}: {error}")
    for line in MENTIONED:
        assert unknown_options(line) == set(), (str(line.page), line.text)


def test_no_page_types_a_name_that_is_no_longer_listed():
    old = [line for line in (*TYPED, *MENTIONED) if line.text.split()[1] in SHORT]
    assert [(str(line.page), line.text) for line in old] == []


def test_every_command_shows_an_example():
    shown = {str(line.page) for line in help_examples()}
    assert [name for name in VERBS if f"vinefab {name} --help" not in shown] == []


def test_examples_of_helps_take_only_files_that_ones_before_make():
    """What they name is made by `new`, `examples` or another example above."""
    made, missing = {"examples", "."}, []
    for line in help_examples():
        words = shlex.split(line.text)
        for before, word in pairwise(words):
            is_file = re.fullmatch(r"[\w/]+\.(toml|geojson|csv|json|jpg|html|dxf)", word)
            if before in WRITTEN or words[1] == "new":
                made.add(word)
            elif is_file and word not in made and word.partition("/")[0] not in made:
                missing.append((word, line.text))
    assert missing == []


WRITTEN = {"--out", "--json", "--svg", "--snapshot", "--animate"}
"""Options whose file is written."""


def test_the_version_is_the_same_everywhere():
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.M)
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    newest = re.search(r"^## (\S+) \((\d{4}-\d\d-\d\d)\)$", changes, re.M)
    assert (cited[1], newest[1]) == (vf.__version__, vf.__version__)
    headings = re.findall(r"^### (.+)$", changes.partition("\n## 0.1.0")[0], re.M)
    assert len(headings) == len(set(headings))


def test_every_file_with_tests_that_the_gate_leaves_out_is_named():
    page = (DOCS / "testing.md").read_text(encoding="utf-8")
    marked = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "tests").rglob("test_*.py")
        if re.search(r"pytest\.mark\.thorough", path.read_text("utf-8"))
    }
    assert len(marked) > 10
    section = page.partition("## Tests that the gate leaves out")[2].partition("\n## ")[0]
    assert {path for path in marked if Path(path).name not in section} == set()
    named = {Path(name).name for name in re.findall(r"`((?:tests/)?[\w/]*test_\w+\.py)`", section)}
    assert named == {Path(path).name for path in marked}


WHERE = {
    "dataclasses": "dataclass replace",
    "pathlib": "Path",
    "typing": "ClassVar",
    "vinefab.fabrication.formats.laser_drawing": "LaserFileSpec LaserFormat ReadDrawing",
    "vinefab.fabrication.rules.rule": "Limits RuleApplied Subject design_rule",
    "vinefab.maps.importers.importers": "MapImporter",
    "vinefab.maps.importers.import_options": "ImportOptions",
    "vinefab.model.deployment": "Deployment",
    "vinefab.model.map": "Map",
    "vinefab.search.optimizers.optimizer": "Optimizer SearchAxes",
    "vinefab.tasks.map_context": "MapContext",
    "vinefab.tasks.task": "Outcome",
}
"""Modules of the names in the sketches of the code's map, which leave out their imports."""


def test_the_sketches_of_parts_run():
    names = {
        name: getattr(import_module(module), name)
        for module, listed in WHERE.items()
        for name in listed.split()
    }
    sketches = [
        line for line in written_on(ROOT / "vinefab" / "README.md") if line.text.count("\n") > 2
    ]
    for sketch in sketches:
        exec(compile(sketch.text, "sketch", "exec"), names)  # noqa: S102  it is ours
    assert len(sketches) >= 5
    assert names["check_mass"].title == "the robot is light enough for its clamp"
    assert names["HPGL"].suffix == ".plt"


# --- A package of one's own ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def with_template(tmp_path_factory):
    """An environment in which the template of a package is installed."""
    site = tmp_path_factory.mktemp("template")
    quiet = ["--quiet", "--disable-pip-version-check", "--no-index"]
    plain = ["--no-deps", "--no-build-isolation", "--target", str(site)]
    template = str(ROOT / "examples" / "plugin_template")
    install = [sys.executable, "-m", "pip", "install", *quiet, *plain, template]
    subprocess.run(install, check=True, capture_output=True)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}


RUN_WITH_HILLCLIMB = """schema = "vinefab/run-1"
maps = { environment = "posts", count = 1 }
optimizer = { name = "hillclimb", shrnik = 0.5 }
"""


def test_the_optimizer_of_the_template_climbs_and_goes_on_where_it_was(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "plugin_template"))
    config = import_module("vinefab_mylab.hillclimb").HillClimbConfig()

    def climbed(climber, generations):
        best = -math.inf
        for _ in range(generations):
            x = climber.ask()
            fitness = -((x - 0.3) ** 2).sum(axis=1)
            climber.tell(x, fitness)
            best = max(best, float(fitness.max()))
        return best

    axes = SearchAxes.continuous(3)
    climber, again = config.start(axes, 8, 1), config.start(axes, 8, 1)
    first = climbed(climber, 3)
    again.restore(climber.state())
    assert (again.ask() == climber.ask()).all()
    assert climbed(climber, 30) > max(first, -1e-3)


def test_parts_of_the_template_are_found(with_template, tmp_path):
    def typed(line):
        return subprocess.run(
            [sys.executable, "-m", *shlex.split(line)],
            cwd=tmp_path,
            env=with_template,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )

    made = typed("vinefab map posts --seed 1 --posts 5 --out posts.geojson")
    assert (made.returncode, made.stderr) == (0, "")
    asked = "vinefab score plain_vine --task farthest --maps posts.geojson --json s.json"
    assert typed(asked).returncode == 0
    scored = json.loads((tmp_path / "s.json").read_text())
    assert scored["task"] == "farthest"
    assert all(0.0 < one["score"] < 2.0 for one in scored["evaluations"])
    (tmp_path / "run.toml").write_text(RUN_WITH_HILLCLIMB)
    assert "did you mean 'shrink'" in typed("vinefab optimize run.toml --out run").stderr
    assert "remedy: shorten" in typed("vinefab rules MYLAB-01").stdout
    assert "MYLAB-01" in typed("vinefab check three_level_tree").stdout


# --- Python of the tutorials ---------------------------------------------------------------------


TUTORIALS = {
    "first_robot": ("first_robot",),
    "search_to_laser": ("search_to_laser",),
    "arena_and_rig": ("my_arena", "rig_and_reality"),
}
"""Tutorials whose Python is typed one after the other in one folder."""


@pytest.mark.parametrize(
    "story",
    [pytest.param(name, marks=() if name == "first_robot" else pytest.mark.thorough)
     for name in TUTORIALS],
)  # fmt: skip
def test_the_python_of_a_tutorial_needs_no_command_line(story, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # Seventy unseen maps take longer than a run here.
    monkeypatch.setattr("vinefab.prediction.run_winner.UNSEEN_DEPLOYMENTS", 3)
    monkeypatch.setattr("vinefab.search.run.FRESH_MAPS", 2)
    for page in TUTORIALS[story]:
        blocks = [w for w in written_on(DOCS / "tutorials" / f"{page}.md") if w.python]
        assert blocks
        for block in blocks:
            assert set(re.findall(r"(?:import|from) (\w+)", block.text)) == {"vinefab"}
            if block.left_out:
                filled(tmp_path / "own_coupons")
            exec(compile(block.text, page, "exec"), {})  # noqa: S102  it is ours
    printed = capsys.readouterr().out
    assert "(simulated)" in printed
    assert "<vinefab" not in printed
    assert " object at 0x" not in printed  # what is printed says what it is


# --- The front door on one page -----------------------------------------------------------------

ROOTS = {"vf": vf, "world": vf.Map, "design": vf.Design, "deployment": vf.Deployment}
"""What the names in the pages' words stand for."""


def calls_in_words(page: Path) -> list[ast.Call]:
    """Return the calls of the library that a page has between backticks."""
    text = re.sub(r"^ *```.*?^ *```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    calls = []
    for words in re.findall(r"`([^`\n]+)`", text):
        try:
            tree = ast.parse(words.replace(", ...", ""))
        except SyntaxError:
            continue
        calls += [one for one in ast.walk(tree) if isinstance(one, ast.Call)]
    return [call for call in calls if ast.unparse(call.func).split(".")[0] in ROOTS]


def wrong_call(call: ast.Call) -> str:
    """Return what is wrong with a call: no such name or no such parameter; else nothing."""
    root, *names = ast.unparse(call.func).split(".")
    function = ROOTS[root]
    for name in names:
        if not hasattr(function, name):
            return f"{ast.unparse(call)}: no {name}"
        function = getattr(function, name)
    given = [None] * (len(call.args) + isinstance(ROOTS[root], type))
    try:
        inspect.signature(function).bind_partial(
            *given, **{word.arg: None for word in call.keywords if word.arg}
        )
    except TypeError as error:
        return f"{ast.unparse(call)}: {error}"
    return ""


def test_a_wrong_call_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "`vf.maps.gird(seed=1)` `vf.check(design, map=world)` `world.info(width_mm=1)` `vf.rules()`"
    )
    found = [wrong_call(call) for call in calls_in_words(page)]
    assert ["gird" in found[0], "'map'" in found[1], *found[2:]] == [True, True, "", ""]


def test_calls_that_pages_name_can_be_made():
    calls = [call for page in PAGES for call in calls_in_words(page)]
    assert len(calls) > 15
    assert [words for call in calls if (words := wrong_call(call))] == []


VERB_PAGES = {path.stem: path for path in (DOCS / "reference" / "verbs").iterdir()}


def test_every_command_has_a_page_with_its_function_and_an_example():
    wanted = {**{name: name for name in VERBS}, reference_pages.GENERATE: "map grid"}
    assert {reference_pages.page_name(name) for name in wanted} == set(VERB_PAGES)
    for name, command in wanted.items():
        page = VERB_PAGES[reference_pages.page_name(name)].read_text(encoding="utf-8")
        (call,) = re.findall(r"^```text\nvf\.([\w.]+)\(", page, re.MULTILINE)
        function = vf
        for part in call.split("."):
            function = getattr(function, part)
        shown = inspect.ismodule(function)  # rooms that are functions too
        assert callable(function), name
        assert shown or function is Command.named(command).function, name
        assert f"```sh\n{Command.named(command).examples()[0]}\n```" in page


def test_every_option_of_a_command_stands_on_its_page_or_among_the_shared_ones():
    shared = (DOCS / "reference" / "commands.md").read_text(encoding="utf-8")
    for name in VERBS:
        page = VERB_PAGES[reference_pages.page_name(name)].read_text(encoding="utf-8")
        for option in all_options(Command.named(name)):
            named = option.metavar if option.positional else option.flags[0]
            listed = re.compile(rf"^- `{re.escape(named)}[` ]", re.MULTILINE)
            assert listed.search(page) or listed.search(shared), (name, option.name)


def test_every_public_name_and_member_stands_on_a_page():
    pages = pages_below(DOCS / "reference")
    functions = pages["python.md"]
    for name in python_pages.public_functions():
        assert f"}} vf.{name}(" in functions
    for name, kind in python_pages.public_classes().items():
        page = pages[f"python/{name}.md"]
        assert f"(python/{name}.md)" in functions
        shown = {word for word in dir(kind) if not word.startswith("_")} & set(vars(kind))
        members = {word for word in shown if word != "schema" and not word.startswith("model_")}
        listed = set(re.findall(r"^:::\{py:\w+\} (\w+)", page, re.MULTILINE))
        assert members | dict(python_pages.fields_of(kind)).keys() <= listed, name
    assert "{py:property} tips_mm\n" in pages["python/Deployment.md"]
    assert "{py:attribute} points_mm\n" in pages["python/Deployment.md"]
    assert "{py:method} with_level(level: int, *, branches: " in pages["python/Design.md"]


@pytest.mark.parametrize(
    "body", ["def bare(self): ...", "bare: int = 3", "@property\n    def bare(self): ..."]
)
def test_a_public_member_without_words_ends_the_build(body, tmp_path, monkeypatch):
    source = f"import dataclasses\n@dataclasses.dataclass\nclass Part:\n    'A part.'\n    {body}\n"
    (tmp_path / "vinefab_part.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    kinds = {"Part": import_module("vinefab_part").Part}
    sys.modules.pop("vinefab_part")
    with pytest.raises(python_pages.UndocumentedError, match=r"vf\.Part\.bare has no "):
        python_pages.class_page("Part", kinds["Part"], kinds)


def test_every_public_function_stands_on_a_page():
    pages = [DOCS / "library.md", *VERB_PAGES.values()]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    assert [name for name in vf.__all__ if name.islower() and f"vf.{name}" not in text] == []
