"""The examples and the library snippet of the README, run as a user would run them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[1]

SCRIPTS = {
    "draw_environments": ("cave",),
    "draw_result": (),
}


@pytest.mark.parametrize(("name", "arguments"), SCRIPTS.items(), ids=SCRIPTS)
def test_an_example_draws_its_picture(name, arguments, tmp_path):
    picture = tmp_path / "picture.png"
    script = ROOT / "examples" / f"{name}.py"
    subprocess.run([sys.executable, script, *arguments, picture], check=True, cwd=tmp_path)
    with Image.open(picture) as image:
        darkness = image.convert("L").histogram()
        # An empty page is nearly all white.
        assert sum(darkness[:250]) > 0.02 * image.width * image.height


def test_every_script_in_the_folder_is_tried():
    assert {path.stem for path in (ROOT / "examples").glob("*.py")} == set(SCRIPTS)


def test_the_library_snippet_of_the_readme_runs(tmp_path):
    (snippet,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    ran = subprocess.run(
        [sys.executable, "-c", snippet], check=True, cwd=tmp_path, capture_output=True, text=True
    )
    assert len(ran.stdout.splitlines()) > 10
