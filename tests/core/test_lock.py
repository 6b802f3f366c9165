import os
import subprocess
import sys

import pytest

from vinefab.core.errors import CannotWriteError
from vinefab.core.lock import lock_folder

PROGRAM = """
import sys
from pathlib import Path
from vinefab.core.lock import lock_folder
handle = lock_folder(Path(sys.argv[1]), "taken")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_folder_is_held_until_its_process_dies_and_nothing_is_left(tmp_path):
    other = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert other.stdout.readline() == b"held\n"
    with pytest.raises(CannotWriteError, match="taken"):
        lock_folder(tmp_path, "taken")
    other.kill()
    other.communicate()
    handle = lock_folder(tmp_path, "taken")
    assert handle is not None
    os.close(handle)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_no_matter_here(tmp_path):
    assert lock_folder(tmp_path / "none", "taken") is None
