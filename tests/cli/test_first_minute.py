"""The first command on a computer: what a user sees while it compiles."""

import itertools
import os
import re
import subprocess
import sys
import time

import pytest

RUN = """
schema = "vinefab/run-1"
[maps]
environment = "grid"
count = 2
[optimizer]
population = 8
generations = 3
"""

PHASE = re.compile(r"^optimize: (?P<phase>[^,(]+)")


@pytest.mark.thorough
def test_no_line_of_a_search_stands_still_on_an_empty_cache(tmp_path):
    """Compiling takes half a minute: its lines count functions and the time that is left."""
    (tmp_path / "run.toml").write_text(RUN)
    with subprocess.Popen(
        [sys.executable, "-m", "vinefab", "optimize", "run.toml", "--out", "run", "--no-page"],
        cwd=tmp_path,
        env={**os.environ, "VINEFAB_CACHE_DIR": str(tmp_path / "cache")},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
    ) as program:
        heard = [(time.monotonic(), "")]
        heard += [(time.monotonic(), line) for line in program.stderr]
    assert program.wait() in (0, 1)
    lines = [line for _, line in heard if line.startswith("optimize: ")]
    assert any("compiling once on this computer, functions" in line for line in lines)
    assert len({PHASE.match(line)["phase"] for line in lines}) > 1
    assert not [line for line in lines if "100 %" in line or "about 0 s left" in line]
    assert all(one != two for one, two in itertools.pairwise(lines))
    # Asked are 10 s; a loaded computer may take longer to write a line.
    assert max(two - one for (one, _), (two, _) in itertools.pairwise(heard)) < 25.0


def test_what_is_refused_is_refused_before_anything_is_compiled(tmp_path):
    (tmp_path / "run.toml").write_text(RUN.replace("= 8", "= 3"))
    refused = subprocess.run(
        [sys.executable, "-m", "vinefab", "optimize", "run.toml", "--out", "run"],
        cwd=tmp_path,
        env={**os.environ, "VINEFAB_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "optimizer.population is 3" in refused.stderr
    assert not (tmp_path / "cache" / "code").exists()
