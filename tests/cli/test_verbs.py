"""One table over all verbs: what Python offers, the command line offers, with the same words."""

import inspect
import re
import shlex

import pytest

import vinefab as vf
from vinefab.app.verbs import VERBS
from vinefab.cli.commands import Command, all_options, completions, flags_of
from vinefab.core.verbs import REQUIRED, Call, Shell, options_of, parameter_words
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.tasks import TASKS

MAPS = {"map import": "import_", "map start": "start", "map info": "info"}
NO_VERB = {"profile"}  # another name of `profiles`


def python_function(name):
    """Return the public function of a verb, as users of Python find it."""
    if name in MAPS:
        return getattr(vf.maps, MAPS[name])
    found = getattr(vf, name.split()[-1].replace("-", "_"))
    return Command.named("rig").function if found is vf.rig else found


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_is_one_function_with_one_set_of_words(name):
    command, function = Command.named(name), python_function(name)
    assert inspect.unwrap(command.function) is inspect.unwrap(function)
    typed = {option.name for option in command.options}
    for option in options_of(function):
        assert option.help, f"{option.name} of {name} is not documented"
        assert option.name in typed or option.kind.in_python, option.name
    parameters = inspect.signature(function).parameters
    assert list(parameter_words(command.function)) == list(parameters), "what help() lists"
    for option in command.options:
        if option.name in parameters:
            assert option.default is parameters[option.name].default or option.starred
    flags = [flag for option in all_options(command) for flag in flags_of(option)]
    assert len(flags) == len(set(flags))


def test_every_public_function_is_a_command():
    functions = {name for name in vf.__all__ if name.islower()} - {"maps"} - NO_VERB
    assert functions == {name.split()[-1].replace("-", "_") for name in VERBS if name not in MAPS}


@pytest.mark.parametrize("name", [*VERBS, "map grid", "map cave"])
def test_every_option_stands_in_the_help(vinefab, name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    code, shown, complaint = vinefab(*name.split(), "-h")
    assert (code, complaint) == (0, "")
    for option in all_options(Command.named(name)):
        for flag in flags_of(option):
            assert re.search(rf"(?<![\w-]){re.escape(flag)}(?![\w-])", shown), flag
    assert max(map(len, shown.splitlines())) <= 100


WRONG = {int: ["1.5", "0x10", "three", "", "1_000"], float: ["20mm", "1,5", "", "1_0"]}


def wrong_values():
    """Yield one wrong value of every option, and of the first of each kind all of them."""
    known = set()
    for name in [*VERBS, "map grid"]:
        for option in Command.named(name).options:
            if option.positional:
                continue
            texts = WRONG.get(option.base, [])
            for text in texts[:1] if option.base in known else texts:
                yield name, option, text
            known.add(option.base)
            if option.choices:
                yield name, option, "moon"


@pytest.mark.parametrize(("name", "option", "text"), list(wrong_values()))
def test_a_wrong_kind_of_value_is_one_line_and_code_2(
    vinefab, tmp_path, monkeypatch, name, option, text
):
    monkeypatch.chdir(tmp_path)
    command = Command.named(name)
    places = ["x"] * sum(one.positional and one.required for one in command.options)
    needed = [word for one in command.options if one.required and not one.positional
              for word in (one.flag, "out.html")]  # fmt: skip
    words = [*name.split(), *places, *needed, f"{option.flag}={text}"]
    code, _, complaint = vinefab(*words)
    assert (code, complaint.count("\n")) == (2, 1)
    assert complaint.startswith(f"error: {option.flag} is {text!r}; allowed: ")


LINES = {
    "score vine.toml --maps a.geojson b.geojson --poses 2 --set radius_mm=60 --body inflated": (
        "vinefab score vine.toml --maps a.geojson --maps b.geojson --poses 2 --body inflated "
        "--set radius_mm=60"
    ),
    "aim vine.toml --map a.geojson --where 'left side' --seed 0 --growth contacts=c.toml": (
        "vinefab aim vine.toml a.geojson --where 'left side' --growth contacts=c.toml"
    ),
    "compare a b --environment grid --head-on-half-angle-deg 1,15 --out page.html": (
        "vinefab compare a b --environment grid --head-on-half-angle-deg 1,15 --out page.html"
    ),
    "grow vine --map a.geojson --pose=-3,4,90 --no-label": (
        "vinefab grow vine a.geojson --pose=-3,4,90"
    ),
    "optimize run.toml --out run --no-page --generations 9": (
        "vinefab optimize run.toml --out run --generations 9 --no-page"
    ),
    "check vine --limit VF-C01.warning=6 --svg a.svg --png a.png": (
        "vinefab check vine --limits VF-C01.warning=6 --out a.svg --out a.png"
    ),
    "observe p.jpg --map m --design d --film-colour 1,2,3 --corners 0,0,9,0,9,9,0,9": (
        "vinefab observe p.jpg m d --corners-px 0,0,9,0,9,9,0,9 --film-colour 1,2,3"
    ),
    "map import p.jpg --points '1,2;3,4' --distance-mm 9 --out m.geojson": (
        "vinefab map import p.jpg --out m.geojson --points-px '1,2;3,4' --distance-mm 9"
    ),
}


@pytest.mark.parametrize(("typed", "again"), LINES.items())
def test_how_to_get_it_again_is_the_call_itself(typed, again):
    words = shlex.split(typed.replace(" --no-label", ""))
    name = " ".join(words[:2]) if words[0] == "map" else words[0]
    command = Command.named(name)
    given = command.understood(words[len(name.split()) :])
    shell = Shell(command=name, say=print, progress=lambda _: None)
    call = Call(function=command.function, given=given, shell=shell)
    assert call.text() == again
    once_more = shlex.split(again)[1 + len(name.split()) :]
    assert (
        Call(function=command.function, given=command.understood(once_more), shell=shell).text()
        == again
    )


def test_the_call_of_python_names_objects_and_leaves_defaults_out():
    vine, world = vf.Design.read("plain_vine"), vf.maps.pegs(seed=1, columns=5, rows=5)
    given = {"design": vine, "maps": [world], "poses": 3, "radius_mm": 60}
    call = Call(function=vf.score, given=given)
    assert call.text() == "vf.score(<Design plain_vine>, maps=[<Map pegs_1>], radius_mm=60)"
    call = Call(function=vf.maps.import_, given={"path": "a.svg", "wall_mm": 9.0})
    assert call.text() == "vf.maps.import_('a.svg', wall_mm=9.0)"


OTHERWISE = {
    "out": "every verb writes another kind of file",
    "recipe": "the shipped one, where no design is given; a file to change",
    "map": "the studio and growth in free space need none",
    "base": "`new` is told where the base of a drawing is, `rig` whether to print one",
    "design": "of a rig none, of the studio a shipped one",
    "designs": "`compare` needs some, the benchmark takes them in place of searches",
    "optimizers": "a contest needs some",
    "environment": "`map` is told which one to make, the studio begins with one",
    "contacts": "`calibrate` adds to the file",
    "seed": "a run has its own, the demonstration a tried one",
    "workers": "threads of a run, of a search for poses, processes of a study",
    "generations": "a limit of a run, a setting of the demonstration",
    "names": "of parts from different registries",
    "options": "of an environment by name, or the fields of several classes",
    "parameters": "of a task alone, or of an environment too",
    "results": "`observe` may begin the table",
    "rig": "its folder, or its file",
    "start": "`map start` needs one",
    "world": "the contact test of `rig` needs none",
}


def test_a_parameter_that_verbs_share_is_declared_once():
    ways = {}
    for name in VERBS:
        function = inspect.unwrap(Command.named(name).function)
        for one in inspect.signature(function).parameters.values():
            ways.setdefault(one.name, set()).add((str(one.annotation), str(one.default)))
    several = {name for name, found in ways.items() if len(found) > 1}
    assert several == set(OTHERWISE), "else one alias with its words and range, and one default"


def test_required_values_are_the_same_on_both_doors():
    for name in VERBS:
        function = python_function(name)
        needed = {
            one.name
            for one in inspect.signature(function).parameters.values()
            if one.default is REQUIRED and one.kind not in (one.VAR_KEYWORD, one.VAR_POSITIONAL)
        }
        assert {one.name for one in Command.named(name).options if one.required} == needed


def test_a_registered_part_is_everywhere_by_its_registration(vinefab, monkeypatch, tmp_path):
    monkeypatch.setitem(TASKS._parts, "farthest", TASKS["reach"])
    monkeypatch.setitem(OPTIMIZERS._parts, "walk", OPTIMIZERS["random"])
    monkeypatch.setitem(ENVIRONMENTS._parts, "yard", ENVIRONMENTS["pegs"])
    assert "farthest" in vinefab("score", "-h")[1]
    assert "walk" in vinefab("study", "contest", "-h")[1]
    assert "  yard " in vinefab("map", "-h")[1]
    assert completions(["score", "vine", "--task", "far"]) == ["farthest"]
    assert completions(["map", "ya"]) == ["yard"]
    assert "yard" in dir(vf.maps)
    assert vf.maps.yard(seed=1).name == vf.maps.pegs(seed=1).name
    out = tmp_path / "yard.geojson"
    assert vinefab("map", "yard", "--columns", 5, "--out", out, "-q") == (0, "", "")
    assert vinefab("score", "plain_vine", "--task", "farthest", "--map", out, "-q")[0] == 0


QUICK_VERBS = (
    "designs", "examples", "map info", "map start", "new", "printers", "profiles", "recipes",
    "rules", "runs",
)  # fmt: skip


@pytest.mark.parametrize("name", [name for name in VERBS if name not in QUICK_VERBS])
def test_every_verb_that_takes_time_takes_progress_in_the_same_words(name):
    (option,) = (one for one in options_of(Command.named(name).function) if one.name == "progress")
    assert option.default is True
    assert "called with a Progress" in option.help
