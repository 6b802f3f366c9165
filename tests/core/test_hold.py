import os
import subprocess
import sys

import pytest

from vinefab.core.errors import CannotWriteError
from vinefab.core.hold import hold

PROGRAM = """
import sys
from pathlib import Path
from vinefab.core.hold import hold
handle = hold(Path(sys.argv[1]), "taken")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_folder_is_held_until_its_process_dies_and_nothing_is_left(tmp_path):
    other = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert other.stdout.readline() == b"held\n"
    with pytest.raises(CannotWriteError, match="taken"):
        hold(tmp_path, "taken")
    other.kill()
    other.communicate()
    handle = hold(tmp_path, "taken")
    assert handle is not None
    os.close(handle)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_no_matter_here(tmp_path):
    assert hold(tmp_path / "none", "taken") is None
