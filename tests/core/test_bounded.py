"""What reads a foreign file ends within its time and memory."""

import os
import signal
import sys
import time
from types import MappingProxyType

import pytest

from vinefab.core import bounded as limits
from vinefab.core.bounded import bounded
from vinefab.core.errors import BadInputError, UnreadableFileError

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="limits hold on Linux alone")


def endless():
    while True:
        pass


def growing():
    held = []
    while True:
        held.append(list(range(10_000)))


def large():
    return len(bytes(2 << 30))


def dying():
    os.kill(os.getpid(), signal.SIGKILL)


def refusing():
    raise BadInputError("line 3", "x", "a number")


def facts():
    return MappingProxyType({"read": 3})


@pytest.mark.parametrize("read", [endless, growing, large, dying])
def test_a_reader_without_end_is_a_refusal(tmp_path, monkeypatch, read):
    monkeypatch.setattr(limits, "_CPU_S", 1)
    path = tmp_path / "plan.svg"
    path.write_text("x")
    begin = time.process_time()
    with pytest.raises(UnreadableFileError, match=r"plan\.svg: cannot be read within 1 s and 1\.5"):
        bounded(path, read)
    assert time.process_time() - begin < 1.0


def test_a_larger_file_has_more_time(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "_CPU_S_PER_MB", 1)
    monkeypatch.setattr(limits, "_CPU_S", -2)
    path = tmp_path / "plan.svg"
    path.write_bytes(bytes(3_000_000))
    with pytest.raises(UnreadableFileError, match="within 1 s"):
        bounded(path, endless)


def test_results_and_errors_come_back(tmp_path):
    assert bounded(tmp_path, facts) == {"read": 3}
    with pytest.raises(BadInputError, match="line 3 is 'x'; allowed: a number"):
        bounded(tmp_path, refusing)
    with pytest.raises(ZeroDivisionError):
        bounded(tmp_path, divmod, 1, 0)
