"""The public functions: what they take, what they refuse, and that none changes unnoticed.

After an intended change, ``python tests/test_api.py`` writes the list of public names anew.
"""

import ast
import dataclasses
import inspect
import json
import pydoc
import re
import subprocess
import sys
from collections import defaultdict
from dataclasses import dataclass
from html import escape
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image
from shapely import Point, box

import vinefab as vf
from vinefab.app import making
from vinefab.cli.main import main
from vinefab.core.table import Table
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.maps.generators.grid import grid_map
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.outline.body_outline import body_outline
from vinefab.pages.panel import INK, LEVEL_COLOURS, ROCK
from vinefab.rig.part import read_printer
from vinefab.search.manufacturability import with_build_for_film

SNAPSHOT = Path(__file__).with_name("public_api.txt")
HEAVY = {
    "numpy",
    "numba",
    "shapely",
    "scipy",
    "matplotlib",
    "pydantic",
    "rich",
    "pymoo",
}


# --- what is public


def _kind(annotation: object) -> str:
    """Return a type as text that no version of Python or numpy changes."""
    text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
    if text.startswith("Annotated["):  # how a shell types it is shown by the help
        text = ast.unparse(ast.parse(text).body[0].value.slice.elts[0])
    # Where a class lives is nobody's business.
    return "array" if "numpy" in text else re.sub(r"\b(?:[a-z_]+\.)+(?=[A-Z])", "", text)


def _value(default: object) -> str:
    plain = isinstance(default, bool | int | float | str | tuple | None)
    return repr(default) if plain else "..."


def _signature(function: object) -> str:
    signature = inspect.signature(function)
    parts, starred = [], False
    for parameter in signature.parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        mark = {parameter.VAR_KEYWORD: "**", parameter.VAR_POSITIONAL: "*"}.get(parameter.kind, "")
        if parameter.kind is parameter.KEYWORD_ONLY and not starred:
            parts, starred = [*parts, "*"], True
        default = parameter.default
        given = "" if default is parameter.empty else f" = {_value(default)}"
        parts.append(f"{mark}{parameter.name}: {_kind(parameter.annotation)}{given}")
    return f"({', '.join(parts)}) -> {_kind(signature.return_annotation)}"


def _class_lines(name: str, kind: type) -> list[str]:
    lines = [f"class {name}({', '.join(base.__name__ for base in kind.__bases__)})"]
    if dataclasses.is_dataclass(kind):
        for field in dataclasses.fields(kind):
            has = field.default is not dataclasses.MISSING
            made = field.default_factory is not dataclasses.MISSING
            given = f" = {_value(field.default)}" if has else " = ..." if made else ""
            lines.append(f"{name}.{field.name}: {_kind(field.type)}{given}")
    if issubclass(kind, Table):
        for field in inspect.signature(kind).parameters.values():
            given = "" if field.default is field.empty else f" = {_value(field.default)}"
            lines.append(f"{name}.{field.name}: {_kind(field.annotation)}{given}")
    fields = {line.split(":")[0].rpartition(".")[2] for line in lines[1:]}
    for own, member in sorted(vars(kind).items()):
        if (own.startswith("_") and own != "_repr_svg_") or own in fields:
            continue
        bound = getattr(kind, own)
        if isinstance(member, property):
            returned = inspect.signature(member.fget).return_annotation
            lines.append(f"{name}.{own}: {_kind(returned)} (property)")
        elif callable(bound) and not isinstance(member, kind):
            lines.append(f"{name}.{own}{_signature(bound)}")
        elif isinstance(member, kind):
            lines.append(f"{name}.{own} = {member.value!r}")
    return lines


def surface() -> str:
    """Return every public name with its signature, a line each."""
    lines = []
    for name in sorted(vf.__all__):
        thing = getattr(vf, name)
        if isinstance(thing, type):
            lines += _class_lines(name, thing)
        elif isinstance(thing, ModuleType) and not callable(thing):
            lines += [f"{name}.{own}{_signature(getattr(thing, own))}" for own in thing.__all__]
        else:
            lines.append(f"{name}{_signature(thing)}")
    return "\n".join(lines) + "\n"


def test_the_public_names_and_signatures_are_those_of_the_list():
    assert surface() == SNAPSHOT.read_text(), "intended? python tests/test_api.py"


def test_editors_and_mypy_see_the_names_that_python_loads():
    tree = ast.parse(Path(vf.__file__).with_suffix(".pyi").read_text())
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.asname for node in imports for alias in node.names}
    assert seen == {*vf.__all__, "__version__"}
    assert set(dir(vf)) == {*vf.__all__, "__version__"}
    assert set(dir(vf.maps)) == set(vf.maps.__all__)


def test_every_public_function_says_units_errors_and_an_example():
    functions = [getattr(vf, name) for name in vf.__all__ if name.islower() and name != "maps"]
    functions += [getattr(vf.maps, name) for name in vf.maps.__all__]
    functions += [vf.Design.read, vf.Design.write, vf.Design.grow, vf.Map.read, vf.Map.write]
    functions += [vf.Map.info, vf.MapInfo.write, vf.RunResult.read, vf.RunSettings.read]
    for function in functions:
        text = inspect.getdoc(getattr(function, "__wrapped__", function))
        assert ">>>" in text, function
        if inspect.signature(function).parameters:
            assert "Parameters\n---" in text, function
            assert "Raises\n---" in text, function


def test_every_environment_has_a_function():
    assert set(ENVIRONMENTS) <= set(vf.maps.__all__)
    assert all(callable(getattr(vf.maps, name)) for name in vf.maps.__all__)


def _loaded_after(code: str) -> set[str]:
    script = f"{code}; import sys; print(' '.join(sys.modules))"
    ran = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
    return set(ran.stdout.split())


def test_the_import_loads_nothing_that_takes_time():
    loaded = _loaded_after("import vinefab as vf; dir(vf); vf.maps")
    assert not loaded & HEAVY
    assert "vinefab.core.errors" not in loaded


def test_a_check_and_a_picture_of_a_design_load_no_simulator():
    code = "import vinefab as vf; vf.check('plain_vine'); vf.Design.read('plain_vine')._repr_svg_()"
    loaded = _loaded_after(code)
    assert "numba" not in loaded
    assert "matplotlib" not in loaded
    assert not any(name.startswith(("vinefab.growth", "vinefab.search")) for name in loaded)


def test_the_rig_is_a_function_and_a_room_whatever_was_loaded_before():
    code = "import vinefab as vf; a = callable(vf.rig); import vinefab.rig.make as make"
    _loaded_after(f"{code}; assert a and callable(vf.rig) and vf.rig.make is make")
    _loaded_after("import vinefab.rig.make, vinefab as vf; assert callable(vf.rig)")


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'gorw'"):
        _ = vf.gorw
    with pytest.raises(AttributeError, match="no attribute 'moon'"):
        _ = vf.maps.moon


# --- the happy paths, with a name, a path and an object


@pytest.fixture(scope="module")
def world():
    return vf.maps.pegs(seed=1, columns=6, rows=6)


@pytest.fixture(scope="module")
def map_file(world, tmp_path_factory):
    return world.write(tmp_path_factory.mktemp("maps") / "pegs.geojson")


@pytest.fixture(scope="module")
def vine():
    return vf.Design.read("plain_vine")


def command(line):
    assert main([*line.split(), "--quiet"]) == 0


def same_map(one, other):
    return one.name == other.name and one.bounds.equals(other.bounds) and one.starts == other.starts


def test_a_map_is_generated_and_read_back(tmp_path):
    world = vf.maps.grid(seed=3, columns=4, rows=4)
    path = world.write(tmp_path / "library.geojson")
    for read in (vf.maps.read, vf.Map.read):
        assert same_map(read(path), world)
        assert same_map(read(str(path)), world)
    assert same_map(vf.maps.generate("grid", 3), grid_map(3))


def test_a_growth_is_that_of_the_command(world, map_file, tmp_path):
    design = vf.Design.read("three_level_tree")
    grown = design.grow(world, pose=(150, 20, 80), body="inflated", children_of_stuck="deploy")
    out = tmp_path / "command.json"
    options = "--pose 150,20,80 --body inflated --children-of-stuck deploy"
    command(f"grow three_level_tree --map {map_file} {options} --json {out}")
    assert grown.write(tmp_path / "library.json").read_bytes() == out.read_bytes()
    assert sum(grown.stops.values()) == len(grown.tree) == len(grown.grown_mm) == 10
    assert grown.stops == json.loads(out.read_text())["metrics"]["stops"]


def test_numbers_of_numpy_are_taken_and_written(tmp_path):
    plain = vf.Design(
        name="a", trunk_length_mm=200.0, levels=(vf.Level.of(3, 100.0, 60.0),),
        build=vf.Build(widths_mm=(40.0, 20.0), fillet_mm=(5.0,)),
    )  # fmt: skip
    own = vf.Design(
        name="a",
        trunk_length_mm=np.float32(200.0),
        levels=[vf.Level.of(np.int64(3), np.float32(100.0), np.float64(60.0))],
        build=vf.Build(widths_mm=np.array([40.0, 20.0]), fillet_mm=np.array([5.0])),
    )
    assert own == plain
    assert vf.Design.read(own.write(tmp_path / "a.toml")) == plain
    world = vf.maps.grid(seed=np.int64(3), columns=np.int32(4), size_mm=np.float32(400.0))
    assert same_map(world, vf.maps.grid(seed=3, columns=4, size_mm=400.0))
    assert vf.Map.read(world.write(tmp_path / "a.geojson")).size_mm == (400.0, 600.0)


def test_a_start_is_a_pose_or_words_wherever_one_is_given(tmp_path):
    source = tmp_path / "room.svg"
    source.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><rect id="a" width="40" height="30"/></svg>'
    )
    for given in ((100, -50, 90), vf.Pose.of((100, -50, 90)), np.array([100.0, -50.0, 90.0])):
        room = vf.maps.import_(source, scale_mm_per_unit=10.0, start=given)
        assert room.with_start(given).starts == room.starts == (vf.Start(pose=vf.Pose.of(given)),)
    along = vf.maps.import_(source, scale_mm_per_unit=10.0, start="left side, heading 0+-20")
    assert along.starts == room.with_start("left side, heading 0+-20").starts
    assert along.starts[0].area.geom_type == "LineString"


@pytest.mark.parametrize("radians", [1.57, 3.14, -np.pi / 3, 2 * np.pi])
def test_an_angle_that_looks_like_radians_is_asked_about(radians):
    with pytest.warns(UserWarning, match="degrees are meant") as told:
        assert vf.Pose.of((1, 2, radians)).heading_deg == pytest.approx(radians)
    assert f"pose.heading_deg is {radians:.4g}" in str(told[0].message)
    assert told[0].filename == __file__
    for degrees in (0.0, 1.0, 1.5, 3.0, -6.0, 45.0, 90.0, 0.5, 5.5, 1.6):
        vf.Pose.of((1, 2, degrees))  # a warning would be an error here


def test_what_became_of_a_robot_is_said(map_file):
    lost = vf.Design.read("three_level_tree").grow(map_file, (0.13, 0.015, 90))  # metres
    assert any("no room for its inflated body" in line for line in lost.summary)


def test_a_growth_takes_a_map_or_a_path_and_a_pose_of_any_form(vine, world, map_file):
    start = world.starts[0].pose
    wanted = grow_on(vine, Terrain.of(world), start).tips_mm
    degrees = (start.x_mm, start.y_mm, start.heading_deg)
    for place in (world, map_file, str(map_file)):
        for pose in (None, start, degrees, np.array(degrees)):
            assert np.array_equal(vine.grow(place, pose).tips_mm, wanted)


@pytest.mark.parametrize("suffix", [".svg", ".png", ".gif"])
def test_a_deployment_is_written_as_a_picture(suffix, vine, world, tmp_path):
    data = vine.grow(world).write(tmp_path / f"grown{suffix}").read_bytes()
    assert data.startswith({".svg": b"<?xml", ".png": b"\x89PNG", ".gif": b"GIF8"}[suffix])


@dataclass(frozen=True, slots=True, kw_only=True)
class Height:
    """A task of a user: how high the highest tip gets, in metres."""

    name: str = "height"
    lowest: float = 0.0

    def evaluate(self, deployment, _ground):
        height_m = float(deployment.tips_mm[:, 1].max()) / 1000.0
        return height_m, {"height_m": height_m}


def test_a_score_takes_maps_and_a_task_object(vine, world, map_file):
    found = vf.score(vine, Height(), maps=world, poses=2)
    assert found.task == "height"
    assert found.evaluations[0].terms["height_m"] == found.scores[0]
    found = vf.score("plain_vine", maps=[world, map_file], poses=3, seed=5, radius_mm=60)
    assert len(found.evaluations) == 6
    assert found.scores[:3].tolist() == pytest.approx(found.scores[3:].tolist(), abs=0.2)


def run_settings(**more):
    return vf.RunSettings(
        name="short",
        maps=vf.MapSettings(environment="pegs", count=1, options={"columns": 6, "rows": 6}),
        search=vf.SearchSettings(population=4, generations=2),
        evaluation=vf.EvaluationSettings(fabricable=False, finalists=2, final_poses_per_map=1),
        **more,
    )


@pytest.fixture(autouse=True)
def few_unseen_maps(monkeypatch):
    """A run's winner is chosen and tried on few maps: seventy take longer than a run here."""
    monkeypatch.setattr("vinefab.prediction.run_winner.UNSEEN_DEPLOYMENTS", 3)
    monkeypatch.setattr("vinefab.search.run.FRESH_MAPS", 2)


def test_a_run_is_the_same_in_memory_on_disk_and_from_a_file(tmp_path):
    settings, told = run_settings(), []
    result = vf.optimize(settings, progress=told.append)
    kept = vf.optimize(settings, out=tmp_path / "run", workers=2, page=False)
    assert [one.done for one in told if one.phase == "generations"] == [0, 1, 2]
    phases = list(dict.fromkeys(one.chain[0].phase for one in told))
    assert phases[:1] == ["maps"]
    assert phases[-2:] == ["families of maps for the winner", "places a little off"]
    assert phases.index("generations") < phases.index("finalists on fresh poses")
    assert kept.best == result.best == vf.Design.read(tmp_path / "run" / "best.toml")
    again = vf.optimize(settings, out=str(tmp_path / "run"), resume=True, page=False)
    assert again.best == result.best
    run_file = tmp_path / "short.toml"
    run_file.write_text(
        'schema = "vinefab/run-1"\n[maps]\nenvironment = "pegs"\ncount = 1\n'
        "options = { columns = 6, rows = 6 }\n"
        '[optimizer]\nname = "islands"\npopulation = 4\ngenerations = 2\n'
        "[evaluation]\nfabricable = false\nfinalists = 2\nfinal_poses_per_map = 1\n"
    )
    assert vf.optimize(run_file).best == result.best


def test_a_run_takes_another_task_by_name_or_as_an_object(tmp_path):
    assert vf.optimize(run_settings(), task="reach").score.task == "reach"
    assert vf.optimize(run_settings(), task=Height()).score.task == "height"
    recorded = vf.optimize(run_settings(), out=tmp_path / "run", task=Height(), page=False)
    assert recorded.score.task == "height"
    assert recorded.best == vf.Design.read(tmp_path / "run" / "best.toml")


def test_a_check_takes_names_paths_objects_and_maps(vine, map_file, world, tmp_path):
    path = vine.write(tmp_path / "vine.toml")
    reports = [
        vf.check(vine, read_profile(DEFAULT_RECIPE)),
        vf.check(str(path)),
        vf.check("plain_vine", DEFAULT_RECIPE),
    ]
    assert reports[0] == reports[1] == reports[2]
    more = vf.check(vine, maps=[map_file, world])
    assert len(more.run) > len(reports[0].run)
    limited = vf.check(vine, limits={"VF-C01": {"warning": 6.0}})
    assert [limit.rule for limit in limited.limits] == ["VF-C01"]


def test_a_package_names_its_files(vine, tmp_path):
    made = vf.fabricate(vine, out=tmp_path / "library", allow_uncalibrated=True, make_zip=True)
    assert {path.name for path in made.path.iterdir()} == set(made.files)
    assert not made.report.blocking
    assert (tmp_path / "library.zip").is_file()


def test_a_refused_package_is_an_error_that_carries_the_report(vine, tmp_path):
    with pytest.raises(vf.ExportRefusedError, match="; allow_uncalibrated writes") as caught:
        vf.fabricate(vine, out=tmp_path / "package")
    assert caught.value.report.design == "plain_vine"
    assert not (tmp_path / "package").exists()


def test_a_check_reads_a_rig(world, vine, tmp_path):
    made = vf.rig(
        world, read_printer("generic_220"), out=tmp_path / "rig", fit_mm=200, pictures=False
    )
    assert not made.report.blocking
    plain = vf.check(vine)
    for folder in (made, made.path, str(made.path)):
        assert len(vf.check(vine, rig=folder).run) > len(plain.run)


def test_a_report_names_the_call(world, tmp_path):
    found = vf.report("plain_vine", maps=world, poses=1, out=tmp_path / "page.html")
    assert "maps=<Map pegs_1>" in found.numbers["reproduce"]["command"]
    assert "<html" in found.path.read_text()
    assert found.summary[0] == found.numbers["verdict"]


def test_a_comparison_ranks_designs_and_shows_itself(world, tmp_path):
    page = tmp_path / "page.html"
    found = vf.compare(
        ("plain_vine", vf.Design.read("three_level_tree")), (one for one in [world]),
        measure="reach_percent", poses=2, out=page,
    )  # fmt: skip
    assert list(found.means) == ["three_level_tree", "plain_vine"]
    for name, mean in found.means.items():
        written = found.numbers["designs"][name]["reach_percent"]["mean"]
        assert found.measure.content(mean) == written
    assert "maps=&lt;generator" in page.read_text()
    shown = found._repr_html_()
    (main,) = found.in_measure(found.measure)
    assert f">{main.interval}</td>" in shown
    assert "(simulated)" in shown
    assert repr(found).splitlines()[1].startswith("three_level_tree has the best mean free space")


def test_figures_of_a_map_are_written_and_shown(world, tmp_path):
    found = world.info(width_mm=20, passages=2)
    written = json.loads(found.write(tmp_path / "library.json").read_text())
    assert written["passages"] == found.numbers["passages"]
    assert repr(found) == "\n".join(["<MapInfo>", *found.summary])
    shown = found._repr_html_()
    assert 'src="data:image/svg+xml;base64,' in shown
    assert all(escape(word.strip(":")) in shown for line in found.summary for word in line.split())


def test_a_robot_grows_from_the_poses_that_aiming_found():
    """A trunk of 28 mm touches a wall 8.9127 mm away: rounded, 8.91 would stand in it."""
    sides = box(0, 0, 300, 200)
    world = vf.Map(name="box", bounds=sides).with_start("150,100,90")
    design = vf.Design.read("plain_vine").with_level(1, width_mm=28.0)
    found = vf.aim(design, world, deployments=5000, robots=2)
    assert any(abs(one.x_mm - 150.0) > 140.0 or abs(one.y_mm - 100.0) > 90.0 for one in found.poses)
    for pose in found.poses:
        grown = design.grow(world, (round(pose.x_mm, 2), round(pose.y_mm, 2), pose.heading_deg))
        assert grown.deployed.all()
        assert sides.exterior.distance(Point(pose.x_mm, pose.y_mm)) < 8.95


def test_files_to_begin_with_are_written_once(tmp_path):
    for kind, name in (("design", "a.toml"), ("run", "b.toml"), ("map", "c.geojson")):
        assert vf.new(kind, tmp_path / name).path == tmp_path / name
    assert vf.RunSettings.read(tmp_path / "b.toml").name == "b"
    with pytest.raises(vf.VinefabError, match=r"a.toml: exists; .*force=True"):
        vf.new("design", tmp_path / "a.toml", original="plain_vine")
    assert not vf.new("design", tmp_path / "a.toml").is_new
    assert "arena/sprig.toml" in vf.examples()
    assert vf.examples("sprig", "table.jpg", out=tmp_path / "ex") == (
        "arena/sprig.toml",
        "arena/table.jpg",
    )
    assert vf.Design.read(tmp_path / "ex" / "arena" / "sprig.toml").name == "sprig"


@pytest.mark.thorough
def test_coupons_are_measured_and_a_recipe_is_fitted(tmp_path):
    made = vf.coupon(out=tmp_path / "coupons")
    table = made.path / "results.csv"
    assert {"README.txt", "results.csv"} <= set(made.files)
    assert not made.report.blocking
    with pytest.raises(vf.BadInputError, match=f"^{table}: "):
        vf.calibrate(table, out=tmp_path / "mine.toml")
    rows = table.read_text().splitlines()
    place = next(i for i, row in enumerate(rows) if row.startswith("seam,weldcut,,"))
    rows[place] = "seam,weldcut,0.5,mm,0.05,read under a lens"
    table.write_text("\n".join(rows))
    mine = vf.calibrate(table, out=tmp_path / "mine.toml")
    assert mine.numbers["numbers"]["weldcut.seam_width_mm"]["value"] == 0.5
    assert any("measured" in line for line in mine.summary)
    assert vf.check("plain_vine", mine).recipe == "mine"
    assert "measured" in mine._repr_html_()


def test_a_run_is_read_again_listed_and_seeded(tmp_path):
    result = vf.optimize(run_settings(), out=tmp_path / "one", seed=7, page=False)
    again = vf.RunResult.read(tmp_path / "one")
    assert (again.best, again.run_id) == (result.best, result.run_id)
    assert repr(dataclasses.replace(again, again=result.again)) == repr(result)
    assert f"vf.score('{tmp_path / 'one' / 'best.toml'}', maps=('pegs_" in result.again
    assert "on 3 unseen pegs maps (simulated); " in repr(again)
    assert f">{again.finalists[0].fitness:.4f}</td>" in again._repr_html_()
    assert "unseen pegs maps" in again._repr_html_()
    listing = vf.runs(tmp_path)
    assert [row.seed for row in listing.rows] == [7]
    assert listing.summary[-1] in repr(listing)
    assert listing.rows[0].folder in listing._repr_html_()
    with pytest.raises(OSError, match=r"none/run\.sqlite: there is no such file"):
        vf.RunResult.read(tmp_path / "none")


def test_a_shipped_run_is_found_by_its_name(monkeypatch):
    seen = []
    monkeypatch.setattr(
        "vinefab.app.searching._searched", lambda settings, *_: seen.append(settings)
    )
    vf.optimize("grid_coverage", seed=9)
    shipped = with_build_for_film(vf.RunSettings.read("grid_coverage"))
    assert seen[0] == shipped.changed(search=shipped.search.changed(seed=9))


def test_findings_are_drawn_in_place_and_shown(tmp_path):
    design = vf.Design.read("three_level_tree").with_level(3, width_mm=4.0, name="thin")
    report = vf.check(design, out=tmp_path / "library.svg")
    assert (tmp_path / "library.svg").read_bytes().startswith(b"<?xml")
    finding = report.blocking[0]
    assert repr(finding).startswith(f"<Finding {finding.rule} error at ")
    assert escape(finding.message) in finding._repr_html_()
    rule = vf.rules()[finding.rule]
    assert f">{rule.id}</td>" in vf.rules()._repr_html_()
    assert repr(rule).startswith(f"<Rule {rule.id}: {rule.title}")
    assert rule.reason.split("'")[0] in rule._repr_html_()


def test_the_names_of_what_is_shipped_are_listed():
    assert {"grid_explorer_levels", "plain_vine"} <= set(vf.designs())
    assert DEFAULT_RECIPE in vf.recipes()
    assert vf.profile(DEFAULT_RECIPE).summary[0].startswith("recipe ")
    assert "generic_220" in vf.printers()


# --- pictures for notebooks


@pytest.fixture(scope="module")
def nouns(vine, world):
    grown = vf.Design.read("three_level_tree").grow(world)
    bare = dataclasses.replace(grown, design=None, world=None)
    square = vf.Contour.polyline(np.array([[0.0, 0], [9, 0], [9, 9]]), closed=True)
    line = vf.Contour.polyline(np.array([[0.0, 0], [9, 0]]), closed=False)
    return {"design": vine, "map": world, "grown": grown, "bare": bare, "square": square,
            "line": line}  # fmt: skip


def parsed(svg):
    return ElementTree.fromstring(svg)  # noqa: S314  our own


SVG = "{http://www.w3.org/2000/svg}"


def shown(noun):
    """Return a noun's picture: its root, the paths painted in a colour, all words."""
    root = parsed(noun._repr_svg_())
    assert root.tag == f"{SVG}svg"
    painted = defaultdict(list)
    for node in root.iter(f"{SVG}path"):
        painted[node.get("fill")].append(node.get("d"))
    return root, painted, [node.text for node in root.iter(f"{SVG}text")]


def test_a_map_shows_its_obstacles_and_starts_in_a_notebook(nouns):
    world = nouns["map"]
    _, painted, words = shown(world)
    assert f"{world.name}: 260 x 260 mm" in words
    assert painted[ROCK][0].count("Z") == len(world.obstacles) > 10
    assert len(painted[INK]) == len(world.starts)  # heads of arrows
    bare = shown(dataclasses.replace(world, starts=()))
    assert "start" in words
    assert "start" not in bare[2]
    assert not bare[1][INK]


def test_a_robot_shows_levels_tips_and_reasons_in_a_notebook(nouns):
    for name in ("grown", "bare"):
        grown, (_, painted, words) = nouns[name], shown(nouns[name])
        assert int(np.count_nonzero(grown.deployed)) > 3
        for count in grown.stops.values():
            assert any(word.endswith(f" ({count})") for word in words) or not count
        for level in (1, 2, 3):
            here = grown.tree.level == level
            entry = f"level {level} ({np.count_nonzero(here & grown.deployed)} of {here.sum()})"
            assert entry in words
            bodies = painted[LEVEL_COLOURS[level - 1]]  # no design, no widths
            assert len(bodies) == (name == "grown" and (here & grown.deployed).any())
        assert (ROCK in painted) == (name == "grown")
        assert any("(simulated)" in word for word in words)


def test_a_robot_on_a_much_larger_map_is_shown_with_its_surroundings_only():
    design, world = vf.Design.read("three_level_tree"), vf.maps.grid(seed=1, size_mm=3000)
    _, _, words = shown(design.grow(world))
    ticks = [float(word) for word in words if re.fullmatch(r"-?\d+", word)]
    assert max(ticks) < 2200
    assert any("part of grid_1, 3000 x 3000 mm" in word for word in words)


def sides(path):
    """Return how wide and how high a path is, in points."""
    numbers = [float(one) for one in re.findall(r"[\d.]+", path)]
    return np.ptp(np.array(numbers).reshape(-1, 2), axis=0)


def test_an_outline_shows_itself_in_a_notebook(nouns):
    for name, corners, (fill, end) in (("square", 3, (ROCK, "Z")), ("line", 2, ("none", ""))):
        root, painted, words = shown(nouns[name])
        drawn = painted[fill][-1]
        assert drawn.count(" ") == 2 * corners - 1
        assert drawn.endswith("Z") == (end == "Z")
        wide, high = sides(drawn)
        assert high == pytest.approx(wide if name == "square" else 0.0, abs=0.02)
        assert "x (mm)" in words
        assert float(root.get("height")[:-2]) > 50  # a straight line has room


def test_a_design_shows_its_flat_outline_in_a_notebook(nouns):
    design = nouns["design"]
    _, painted, words = shown(design)
    x0, y0, x1, y1 = body_outline(design).contour.box_mm
    assert f"{design.name}: 1 branch, {x1 - x0:.0f} x {y1 - y0:.0f} mm flat" in words
    (drawn,) = painted[ROCK]
    wide, high = sides(drawn)
    assert high / wide == pytest.approx((y1 - y0) / (x1 - x0), rel=1e-3)
    tree = vf.Design.read("three_level_tree")
    assert f"three_level_tree: {tree.branch_count} branches," in " ".join(shown(tree)[2])


def test_a_robot_that_never_emerged_has_a_picture_too(world):
    design = vf.Design.read("six_branch_anchor")
    grown = design.grow(world, pose=(150, 1, 90), body="inflated")
    assert grown.stops["not_deployed"] == len(grown.tree)
    for deployment in (grown, dataclasses.replace(grown, design=None, world=None)):
        root, _, words = shown(deployment)
        assert f"never emerged ({len(grown.tree)})" in words
        rings = [one for one in root.iter(f"{SVG}circle") if one.get("r") == "4.5"]
        assert len(rings) == 2  # a ring at the base, and one in the legend


# --- wrong things


ROOM = vf.Map(name="room", bounds=box(0, 0, 100, 100))  # without a start
VINE = vf.Design.read("plain_vine")

PEGS = vf.maps.pegs(seed=1, columns=5, rows=5)


def _photo(folder):
    path = folder / "empty.png"
    Image.new("RGB", (40, 30), "white").save(path)
    return path


WRONG = {
    "a parameter of a noun": (
        lambda _: vf.Design(name="a", trunk_mm=200.0),
        "trunk_mm: there is no such parameter; did you mean 'trunk_length_mm'? (parameters: name",
    ),
    "a value of a parameter": (
        lambda _: vf.Design(name="a", trunk_length_mm=-1.0),
        "trunk_length_mm is -1.0; allowed: ",
    ),
    "a list of a parameter": (
        lambda _: vf.Design(name="a", trunk_length_mm=9.0, levels=[{"branches": 0}]),
        "levels[1].branches is 0",
    ),
    "a map as a design": (lambda _: vf.check(ROOM), "design"),
    "a number as a path": (lambda _: VINE.write(5), "path"),
    "a design as a map": (lambda _: VINE.grow(VINE), "map"),
    "an environment that is none": (lambda _: vf.maps.generate("moon"), "environment"),
    "an environment that is no name": (lambda _: vf.maps.generate(3), "environment"),
    "an unknown option": (lambda _: vf.maps.grid(seed=1, sise_mm=3), "size_mm"),
    "a text as a number": (lambda _: vf.maps.grid(seed=1, size_mm="3"), "size_mm"),
    "a text as a seed": (lambda _: vf.maps.grid(seed="3"), "seed"),
    "an unknown option of import": (
        lambda out: vf.maps.import_(out / "a.svg", scale=2),
        "scale_mm_per_unit",
    ),
    "no start": (lambda _: VINE.grow(ROOM), "pose: map 'room' has no start; give (x_mm"),
    "a pose of two": (lambda _: VINE.grow(ROOM, pose=(1, 2)), "heading_deg"),
    "a pose of words": (lambda _: VINE.grow(ROOM, pose=("a", 2, 3)), "pose.x_mm"),
    "a pose in a wall": (lambda _: VINE.grow(ROOM, pose=(-5, 2, 3)), "(-5, 2)"),
    "an unknown body": (lambda _: VINE.grow(ROOM, pose=(5, 5, 0), body="thick"), "body"),
    "an angle of words": (
        lambda _: VINE.grow(ROOM, (5, 5, 0), head_on_half_angle_deg="x"),
        "head_on_half_angle_deg",
    ),
    "an unknown ending": (lambda out: VINE.grow(ROOM, (5, 5, 0)).write(out / "a.bmp"), ".gif"),
    "no maps": (lambda _: vf.score(VINE, maps=[]), "maps"),
    "a design among maps": (lambda _: vf.score(VINE, maps=[ROOM, VINE]), "maps"),
    "an unknown task": (lambda _: vf.score(VINE, "covrage", maps=ROOM), "coverage"),
    "a class as a task": (lambda _: vf.score(VINE, Height, maps=ROOM), "task"),
    "an unknown parameter": (lambda _: vf.score(VINE, maps=ROOM, radius=3), "radius_mm"),
    "parameters of an object": (lambda _: vf.score(VINE, Height(), maps=ROOM, a=3), "a goes with"),
    "no start to score from": (lambda _: vf.score(VINE, maps=ROOM), "start"),
    "a design as a run": (lambda _: vf.optimize(VINE), "run"),
    "no run file": (lambda out: vf.optimize(out / "none.toml"), "no such file"),
    "workers of words": (lambda _: vf.optimize(run_settings(), workers="2"), "workers"),
    "resumed without a folder": (lambda _: vf.optimize(run_settings(), resume=True), "resume"),
    "an unknown design": (lambda _: vf.check("grid_exploror"), "grid_explorer_levels"),
    "an unknown recipe": (lambda _: vf.check(VINE, "co2"), "recipe"),
    "a design as a recipe": (lambda _: vf.check(VINE, VINE), "recipe"),
    "an unknown rule": (lambda _: vf.check(VINE, limits={"VF-X": {"a": 1}}), "VF-X"),
    "limits of words": (lambda _: vf.check(VINE, limits="VF-C01.warning=6"), "limits"),
    "limits without names": (lambda _: vf.check(VINE, limits={"VF-C01": 6}), "limits.VF-C01"),
    "no rig": (lambda out: vf.check(VINE, rig=out), "rig.json"),
    "a map beside": (lambda out: vf.fabricate(VINE, out=out / "p", beside=[ROOM]), "beside"),
    "an unknown printer": (lambda out: vf.rig(ROOM, "generic", out=out / "r"), "generic_220"),
    "an unknown size": (lambda out: vf.rig(ROOM, out=out / "r", hight_mm=3), "height_mm"),
    "too small a fit": (lambda out: vf.rig(ROOM, out=out / "r", fit_mm=1, allow_empty=True),
                        "fit_mm is 1"),
    "an empty rig": (lambda out: vf.rig(ROOM, out=out / "r"), "give allow_empty for a bare tray"),
    "nowhere to predict": (lambda out: vf.report(VINE, out=out / "p.html"), "maps is missing"),
    "no unseen maps": (
        lambda out: vf.report(VINE, out=out / "p.html", environment="grid", count=0),
        "count is 0",
    ),
    "a map as an environment": (
        lambda out: vf.report(VINE, out=out / "p.html", environment=ROOM),
        "environment",
    ),
    "options of words": (
        lambda out: vf.report(VINE, out=out / "p.html", environment="grid", options="a=3"),
        "options",
    ),
    "a text as yes": (lambda out: vf.fabricate(VINE, out=out / "p", make_zip="no"), "make_zip"),
    "a number as a force": (lambda out: vf.report(VINE, out=out / "p.html", force=1), "force is 1"),
    "a text as progress": (
        lambda out: vf.report(VINE, out=out / "p.html", maps=PEGS, progress="yes"),
        "progress",
    ),
    "no contacts file": (
        lambda out: VINE.grow(PEGS, contacts=out / "none.toml"), "none.toml: there is no such file"
    ),
    "contacts of a number": (lambda _: vf.score(VINE, maps=PEGS, contacts=3), "contacts is 3"),
    "contacts twice": (
        lambda _: vf.score(VINE, maps=PEGS, contacts="a", growth={"contacts": "b"}), "contacts"
    ),
    "an observation that was not written": (
        lambda _: vf.fit_observations([vf.WrittenResult()]), "out="
    ),
    "no observations": (lambda _: vf.fit_observations([]), "observations"),
    "a number as an observation": (lambda _: vf.fit_observations(3), "observations"),
    "no photo": (lambda out: vf.observe(out / "none.jpg", PEGS, VINE), "none.jpg"),
    "a number as a photo": (lambda _: vf.observe(3, PEGS, VINE), "photo"),
    "a word that nothing keeps": (lambda _: vf.fix(VINE, keep="lenght"), "keep is 'lenght'"),
    "a number to keep": (lambda _: vf.fix(VINE, keep=3), "keep is 3"),
    "an unknown design to fix": (lambda _: vf.fix("plain_vin"), "did you mean 'plain_vine'"),
    "no such level": (lambda _: VINE.with_level(2, width_mm=3.0), "level is 2"),
    "a trunk with branches": (lambda _: VINE.with_level(1, branches=3), "branches is 3"),
    "a width of words": (lambda _: VINE.with_level(1, width_mm="3"), "width_mm is '3'"),
    "a negative length": (lambda _: VINE.with_level(1, length_mm=-3), "length_mm is -3"),
    "a number as a name": (lambda _: VINE.with_level(1, name=3), "name is 3"),
    "a number as layers": (lambda _: vf.maps.import_("a.svg", layers=3), "layers is 3"),
    "an unknown growth option": (
        lambda _: vf.score(VINE, maps=PEGS, growth={"bodi": 1}), "did you mean 'body'"
    ),
    "a text as growth of a check": (lambda _: vf.check(VINE, growth="x"), "growth"),
    "a start of a number": (lambda _: PEGS.with_start(3), "start is 3"),
    "one design to compare": (lambda _: vf.compare(VINE, PEGS), "designs is '1 design'"),
    "a map among designs": (lambda _: vf.compare([VINE, ROOM], PEGS), "designs is <Map"),
    "nowhere to compare": (lambda _: vf.compare([VINE, VINE]), "maps is missing"),
    "an unknown measure": (lambda _: vf.compare([VINE, VINE], PEGS, measure="reech"), "'reech'"),
    "a number as a measure": (lambda _: vf.compare([VINE, VINE], PEGS, measure=3), "measure is 3"),
    "a page that is none": (lambda _: vf.compare([VINE, VINE], PEGS, out=3), "out is 3"),
    "a negative width": (lambda _: PEGS.info(width_mm=-3), "width_mm is -3"),
    "figures in a picture of no kind": (lambda out: PEGS.info().write(out / "a.bmp"), ".json"),
    "the name of an environment as a map": (lambda _: VINE.grow("grid"), "vf.maps.grid(seed=1)"),
    "a box of numbers as bounds": (lambda _: vf.Map(name="a", bounds=(0, 0, 9, 9)), "bounds is (0"),
    "one obstacle": (
        lambda _: vf.Map(name="a", bounds=box(0, 0, 9, 9), obstacles=box(1, 1, 2, 2)),
        "obstacles is",
    ),
    "a pose among starts": (
        lambda _: vf.Map(name="a", bounds=box(0, 0, 9, 9), starts=((1, 2, 3),)), "starts is ((1"
    ),
    "one level": (
        lambda _: vf.Design(name="a", trunk_length_mm=9, levels=vf.Level.of(2, 9),
                            build=vf.Build.standard(2)),
        "angle_deg, growth_percent, bends; in Python also an instance of Level",
    ),
    "a width as a build": (lambda _: vf.Design(name="a", trunk_length_mm=9, build=3), "build is 3"),
    "one width": (lambda _: vf.Build(widths_mm=3.0, fillet_mm=()), "widths_mm is 3.0"),
    "a map among settings": (lambda _: vf.RunSettings(maps=[ROOM]), "instance of MapSettings"),
    "a map among map files": (lambda _: vf.MapSettings(files=(ROOM,)), "files is <Map"),
    "a scale that is missing": (
        lambda out: vf.maps.import_(_photo(out.parent)), "give points 'X,Y;X,Y'"
    ),
    "photo options twice": (
        lambda out: vf.maps.import_(out / "a.jpg", marker_mm=3, photo={"height_mm": 2}),
        "marker_mm is given together with photo",
    ),
    "one corner": (
        lambda out: vf.observe(_photo(out.parent), PEGS, VINE, corners_px=3), "corners_px is 3"
    ),
    "a colour by name": (
        lambda out: vf.observe(_photo(out.parent), PEGS, VINE, film_colour="red"),
        "film_colour is 'red'",
    ),
    "an observation as PDF": (lambda out: vf.observe("a.jpg", PEGS, VINE, out=out / "a.pdf"),
                              ".htm or .json"),
    "an unknown limit": (
        lambda _: vf.check(VINE, limits={"VF-C01": {"warn": 6}}), "limits.VF-C01.warn is 6"
    ),
    "a rule that is none": (lambda _: vf.rules()["VF-C99"], "no rule is called 'VF-C99'"),
    "a report as PDF": (lambda out: vf.report(VINE, out=out / "a.pdf", maps=ROOM), ".html"),
    "no run to list": (lambda _: vf.runs(), "folders is missing"),
    "an unknown kind of file": (lambda out: vf.new("robot", out / "a.toml"), "kind is 'robot'"),
    "an unknown profile": (lambda _: vf.profile("co2_60"), "no profile is called 'co2_60'"),
    "a number as a profile": (lambda _: vf.profiles(3), "name is 3"),
}  # fmt: skip


def test_an_error_in_python_is_one_exception(tmp_path):
    """No chain of pydantic's, readers' and inner errors before it."""
    path = tmp_path / "d.toml"
    path.write_text('schema = "vinefab/design-1"\nname = "d"\ntrunk = { length_cm = 3 }\n')
    for call in (lambda: vf.check(path), lambda: vf.Design.read(path), lambda: vf.Design(nam="d")):
        with pytest.raises(vf.BadInputError) as caught:
            call()
        assert (caught.value.__cause__, caught.value.__suppress_context__) == (None, True)


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_thing_is_one_line_that_names_it(name, tmp_path):
    call, named = WRONG[name]
    with pytest.raises(vf.VinefabError) as caught:
        call(tmp_path)
    message = str(caught.value)
    assert "\n" not in message
    assert named in message
    assert "--" not in message.replace("--force overwrites it (force=True in Python)", "")
    assert not any(tmp_path.iterdir())


def test_an_unknown_parameter_of_any_function_is_an_error_that_names_it():
    functions = [getattr(vf, name) for name in vf.__all__ if name.islower() and name != "maps"]
    functions += [getattr(vf.maps, name) for name in vf.maps.__all__]
    for function in functions:
        given = [VINE if name == "design" else PEGS if name in ("world", "map") else "x"
                 for name, one in inspect.signature(
                     making.rig if function is vf.rig else function).parameters.items()
                 if one.default is one.empty and one.kind is one.POSITIONAL_OR_KEYWORD]  # fmt: skip
        writing = (
            vf.rig,
            vf.fabricate,
            vf.report,
            vf.coupon,
            vf.calibrate,
            vf.contest,
            vf.benchmark,
            vf.reproduce,
        )
        needed = {"out": Path("none")} if function in writing else {}
        needed |= {"out": Path("none.html")} if function is vf.report else {}
        needed |= {"maps": PEGS} if function in (vf.score, vf.compare, vf.report) else {}
        needed |= {"optimizers": "x"} if function is vf.contest else {}
        needed |= {"start": "x"} if function is vf.maps.start else {}
        with pytest.raises((vf.VinefabError, TypeError)) as caught:
            function(*given, **needed, unheard_of=3)
        assert "\n" not in str(caught.value)
        assert "unheard_of" in str(caught.value) or "'x'" in str(caught.value), function
    assert not Path("none").exists()


def test_help_shows_what_the_constructor_of_a_table_takes():
    shown = pydoc.plain(pydoc.render_doc(vf.Design))
    head = "Design(*, name: str, scale_mm_per_unit: float = 1.0, trunk_length_mm: float, levels: "
    assert head in shown
    assert "build: vinefab.model.design.Build = Build()" in shown
    assert "\n |  trunk_length_mm, mm\n" in shown
    assert "schema_" not in shown.partition("Method resolution order")[0]
    tree = vf.Design.read("grid_explorer_pieces_levels")
    taken = {name: getattr(tree, name) for name in inspect.signature(vf.Design).parameters}
    assert vf.Design(**taken) == tree


def test_a_level_of_a_design_is_changed_and_nothing_else():
    tree = vf.Design.read("three_level_tree")
    changed = tree.with_level(
        3, branches=1, length_mm=50.0, angle_deg=30.0, growth_percent=120.0,
        width_mm=7.0, taper=0.8, fillet_mm=3.0, name="other",
    )  # fmt: skip
    level = vf.Level.of(1, 50.0, 30.0, 120.0)
    assert changed.levels == (tree.levels[0], level)
    assert changed.build.widths_mm == (*tree.build.widths_mm[:2], 7.0)
    assert changed.build.taper == (1.0, 1.0, 0.8)
    assert changed.build.fillet_mm == (tree.build.fillet_mm[0], 3.0)
    assert changed.name == "other"
    back = changed.with_level(1, length_mm=9.0, width_mm=50.0)
    assert (back.trunk_length_mm, back.build.widths_mm[0]) == (9.0, 50.0)
    assert back.levels == changed.levels
    assert tree.with_level(2) == tree


def test_a_fix_is_written_and_shows_itself(vine, tmp_path):
    short = vine.changed(build=vine.build.changed(tail_mm=100.0), name="short")
    out = tmp_path / "fixed.toml"
    found = vf.fix(short, keep=["branches", "length"], out=out, progress=False)
    assert found.design == vf.Design.read(tmp_path / "fixed.toml")
    assert not found.report.blocking
    assert vf.check(short).blocking
    assert "the tail" in found._repr_html_()
    assert 'src="data:image/svg+xml;base64,' in found._repr_html_()
    assert any(line.startswith("fix: ") for line in found.summary)


def test_contacts_are_taken_as_a_parameter_as_among_growth_options(world):
    measured = {"value": 8.0, "low": 6.0, "high": 10.0, "count": 4, "photos": 2,
                "source": "made up for a test"}  # fmt: skip
    contacts = {"head_on_half_angle_deg": measured}
    one = vf.score("plain_vine", "reach", maps=world, poses=2, contacts=contacts)
    other = vf.score("plain_vine", "reach", maps=world, poses=2, growth={"contacts": contacts})
    assert one.growth == other.growth
    assert one.growth["contacts"]


def test_a_file_of_somebody_else_is_kept(tmp_path, vine):
    path = tmp_path / "vine.toml"
    path.write_text("mine")
    with pytest.raises(vf.VinefabError, match="not written by vinefab"):
        vine.write(path)
    assert vine.write(path, force=True) == path


if __name__ == "__main__":
    SNAPSHOT.write_text(surface())
