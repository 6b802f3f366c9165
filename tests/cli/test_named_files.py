"""What a file names elsewhere is not read, and what a named file holds is not shown."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from PIL import Image

from vinefab.model.design import Design, design_content
from vinefab.model.files.shipped import locate
from vinefab.studio.file_exports import snapshot_html

SECRET = "TOPSECRET"  # noqa: S105  of nobody
RUN_HEAD = 'schema = "vinefab/run-1"\n'
ROS = "image: {image}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\n"


@pytest.fixture
def secret(tmp_path, monkeypatch):
    """Files of the user that none of the files below, which somebody sent, may show."""
    (tmp_path / "sent").mkdir()
    monkeypatch.chdir(tmp_path / "sent")
    (tmp_path / "home").mkdir()
    path = tmp_path / "home" / "key.toml"
    path.write_text(f"secret_key = '{SECRET}'\n")
    path.with_suffix(".json").write_text(json.dumps({"type": SECRET, "features": [SECRET]}))
    Image.new("L", (40, 40), 255).save(path.with_suffix(".png"))
    return path


def design_file(secret):
    origin = f'[origin]\ngrowth = {{ contacts = "{secret}" }}\n'
    text = f'schema = "vinefab/design-1"\nname = "x"\n{origin}[trunk]\nlength = 120.0\n'
    Path("x.toml").write_text(text)
    return "grow x.toml --map ../grid.geojson"


def run_file(text):
    def make(secret):
        Path("run.toml").write_text(RUN_HEAD + text.format(secret=secret, folder=secret.parent))
        return "optimize run.toml --out run"

    return make


def observation(secret):
    branch = {"id": "1", "level": 1, "stop_observed": "stuck", "points_mm": [], "contacts": []}
    content = {
        "schema": "vinefab/observation-1",
        "photo": "p",
        "map": str(secret.with_suffix(".json")),
        "design": str(secret),
        "pose": {"x_mm": 200.0, "y_mm": 15.0, "heading_deg": 90.0},
        "branches": [branch],
    }
    Path("seen.json").write_text(json.dumps(content))
    return "fit-observations seen.json --out contacts.toml"


def ros_map(secret):
    Path("world.yaml").write_text(
        ROS.format(image=secret.with_suffix(".png")) + "free_thresh: 0.2\n"
    )
    return "map import world.yaml --out world.geojson"


def ros_map_with_a_link(secret):
    Path("cells.png").symlink_to(secret.with_suffix(".png"))
    Path("world.yaml").write_text(ROS.format(image="cells.png") + "free_thresh: 0.2\n")
    return "map import world.yaml --out world.geojson"


def recipe(secret):
    text = locate("recipe", "co2_60w__stretchlon_200").read_text()
    text = text.replace('name = "co2_60w__stretchlon_200"', 'name = "r"', 1)
    Path("r.toml").write_text(text.replace('machine = "co2_60w"', 'machine = "m"', 1))
    Path("m.toml").symlink_to(secret)
    return "check plain_vine --recipe r.toml"


def archive(key):
    def make(secret):
        with closing(sqlite3.connect("../run/run.sqlite")) as connection, connection:
            (text,) = connection.execute("SELECT value FROM run WHERE key = 'settings'").fetchone()
            settings = json.loads(text)
            settings[key[0]][key[1]] = str(secret)
            value = json.dumps(settings)
            connection.execute("UPDATE run SET value = ? WHERE key = 'settings'", (value,))
        return "runs ../run --rebuild again"

    return make


def snapshot(change):
    def make(secret):
        design = design_content(Design.read("plain_vine"))
        state = {"design": design, "map": {"source": {"environment": "grid", "seed": 1}}}
        page = snapshot_html(state, {}).decode()
        start = page.index('id="stored">') + len('id="stored">')
        stored = json.loads(page[start : page.index("</script>", start)])
        stored["map"] = Path("../grid.geojson").read_text()
        state = stored["hello"]["state"]
        state["map"] = {"source": {"file": "sent.geojson"}, "edits": []}
        change(state, str(secret))
        text = json.dumps(stored).replace("<", "\\u003c")
        rest = page[page.index("</script>", start) :]
        Path("sent.html").write_text(page[:start] + text + rest)
        return "studio sent.html --no-browser --snapshot again.html"

    return make


CASES = {
    "contacts of an origin": design_file,
    "contacts of a run": run_file('[growth]\ncontacts = "{secret}"\n'),
    "maps of a run": run_file('[maps]\nfiles = ["{folder}/key.json"]\n'),
    "start of a run": run_file('[optimizer]\nstart_from = ["{secret}"]\n'),
    "recipe of a run": run_file('[evaluation]\nrecipe = "{secret}"\nfabricable = true\n'),
    "observation": observation,
    "image": ros_map,
    "link to an image": ros_map_with_a_link,
    "link to a machine": recipe,
    "contacts of a record": archive(("growth", "contacts")),
    "recipe of a snapshot": snapshot(lambda state, path: state.update(recipe=path)),
    "contacts of a snapshot": snapshot(lambda state, path: state.update(growth={"contacts": path})),
    "origin in a snapshot": snapshot(
        lambda state, path: state["design"].update(origin={"growth": {"contacts": path}})
    ),
    "locks of a snapshot": snapshot(lambda state, _: state.update(locks=5)),
}


@pytest.mark.parametrize("case", CASES)
def test_nothing_of_a_file_elsewhere_is_shown(vinefab, grid, secret, request, case):
    if "record" in case:
        words = ("optimize", request.getfixturevalue("run_file"), "--no-page", "--out", "../run")
        assert vinefab(*words, "-q")[0] == 0
    command = CASES[case](secret)
    before = sorted(Path().rglob("*"))
    code, output, complaint = vinefab(*command.split())
    assert SECRET not in output + complaint
    assert (code, complaint.count("\n")) == (2, 1), (output, complaint)
    assert sorted(Path().rglob("*")) == before
    assert grid.exists()


def test_a_run_file_of_the_user_names_maps_where_they_are(vinefab, grid, tmp_path, run_file):
    folder = tmp_path / "runs"
    folder.mkdir()
    for name in ("../grid.geojson", str(grid)):
        text = run_file.read_text().replace("count = 1", f'files = ["{name}"]')
        (folder / "mine.toml").write_text(text)
        out = tmp_path / f"run{len(name)}"
        assert vinefab("optimize", folder / "mine.toml", "--no-page", "--out", out, "-q")[0] == 0
