"""The examples and the library snippet of the README, run as a user would run them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from vinefab.fabrication.checking import check_design
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.search.run_file import read_run

ROOT = Path(__file__).parents[1]

SCRIPTS = {
    "draw_cluster_scaling": (),
    "draw_environments": ("cave",),
    "draw_result": (),
}


TALKING = {
    "add_a_rule": "three_level_tree: warning: 1.54 m",
    "optimize_my_task": "climber",
    "read_a_run": "winner",
    "make_a_rig": "parts of pegs_4",
    "grow_on_my_map": "branches came out",
    "make_shipped_designs": "plain_vine: made",
}
"""What each script says when it has done its work."""

NEEDS = {
    "read_a_run": ("run",),
    "make_a_rig": ("rig",),
    "grow_on_my_map": ("grown.svg",),
    "make_shipped_designs": ("made", "plain_vine"),
}
"""What each is given; the first is what it writes."""


@pytest.mark.parametrize(("name", "arguments"), SCRIPTS.items(), ids=SCRIPTS)
def test_an_example_draws_its_picture(name, arguments, tmp_path):
    picture = tmp_path / "picture.png"
    script = ROOT / "examples" / f"{name}.py"
    subprocess.run([sys.executable, script, *arguments, picture], check=True, cwd=tmp_path)
    with Image.open(picture) as image:
        darkness = image.convert("L").histogram()
        # An empty page is nearly all white.
        assert sum(darkness[:250]) > 0.02 * image.width * image.height


@pytest.mark.parametrize("name", TALKING)
def test_an_example_does_what_it_says(name, tmp_path):
    script, given = ROOT / "examples" / f"{name}.py", NEEDS.get(name, ())
    ran = subprocess.run(
        [sys.executable, script, *given],
        check=True,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
    )
    assert TALKING[name] in ran.stdout
    assert all((tmp_path / written).exists() for written in given[:1])


def test_every_script_in_the_folder_is_tried():
    scripts = {path.stem for path in (ROOT / "examples").glob("*.py")}
    assert scripts == {*SCRIPTS, *TALKING}


@pytest.mark.parametrize("name", ["grid_explorer", "cave_explorer", "six_branch_anchor"])
def test_a_shipped_winner_is_what_its_run_file_says_and_can_be_made(name):
    design, run = read_design(name), read_run(ROOT / "examples" / f"{name}.toml")
    search = run.search
    made = (run.task.name, run.optimizer.name, search.seed, search.population, search.generations)
    origin = ("task", "optimizer", "seed", "population", "generations")
    assert tuple(design.origin[key] for key in origin) == made
    assert design.build == run.build.build(design.depth)
    assert not check_design(design, read_profile(DEFAULT_RECIPE)).blocking


def test_the_library_snippet_of_the_readme_runs(tmp_path):
    after = (ROOT / "README.md").read_text().split("## As a library")[1]
    (snippet,) = re.findall(r"```python\n(.*?)```", after, re.DOTALL)
    ran = subprocess.run(
        [sys.executable, "-c", snippet],
        check=True,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
    )
    assert len(ran.stdout.splitlines()) > 10
