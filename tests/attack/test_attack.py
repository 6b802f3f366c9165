"""A little of ``make fuzz`` in every run of the tests."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

HERE = Path(__file__).parent
CHEAP = ("design", "recipe", "printer", "geojson", "svg", "csv", "ros", "ros image", "results")


@pytest.fixture(scope="module")
def attack():
    """Return a function that loads a module of the attack by name."""
    sys.path.insert(0, str(HERE))

    def load(name: str) -> ModuleType:
        return importlib.import_module(name)

    yield load
    sys.path.remove(str(HERE))


@pytest.fixture(scope="module")
def good(attack, tmp_path_factory):
    """Good files of the kinds that need no long work."""
    files = attack("files")
    return files.stock(tmp_path_factory.mktemp("stock") / "good", files.MAKE[:1])


def test_damaged_files_are_refused_or_read(attack, good):
    files = attack("files")
    plan = [(kind, 1) for kind in CHEAP]
    tally = files.attack(plan, good)
    assert not tally.failures, tally.report("tests/attack/files.py")
    assert sum(counts.total() for counts in tally.counts.values()) == len(plan)
    assert sum(counts["refused"] for counts in tally.counts.values()) > len(plan) // 4


def test_hostile_names_are_words_only(attack):
    names = attack("names")
    ways = ("check", "info", "rings", "argument", "out-json")
    tally = names.attack([(way, number) for way in ways for number in (0, 16)])
    assert not tally.failures, tally.report("tests/attack/names.py")
    assert sum(counts.total() for counts in tally.counts.values()) == 10


BROKEN = {
    "raise ValueError('x')": "ValueError left the program",
    "print('error: one\\nerror: two', file=sys.stderr); return 2": "2 lines of complaint",
    "print('UserWarning', file=sys.stderr); return 0": "complaints of a success",
    "return 3": "exit code 3",
    "return 1": "exit code 1 of a command without findings",
    "open('../outside.txt', 'w').close(); return 0": "wrote outside its folder",
    "open('plan.csv', 'w').close(); return 0": "plan.csv was changed or lost",
    "open('o.txt', 'w').close(); print('error: x', file=sys.stderr); return 2": "refused, but left",
    "open('o.json', 'w').write('NaN'); return 0": "o.json: ValueError: NaN in JSON",
    "open('o.html', 'w').write('<p onclick=x>'); return 0": "o.html: ValueError: <p onclick>",
    "open('o.html', 'w').write('<script>x()</script>'); return 0": "a foreign script in a page",
    "open('o.csv', 'w').write('a,=1+1'); return 0": "a cell that computes",
    "os._exit(7)": "the process ended with 7",
}


@pytest.mark.parametrize("body", BROKEN)
def test_a_broken_command_is_a_failure(attack, good, tmp_path, monkeypatch, body):
    lines = "\n    ".join(body.split("; "))
    (tmp_path / "broken_command.py").write_text(
        f"import os, sys\ndef main(arguments):\n    {lines}\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    tally = attack("files").attack([("csv", 1)], good, "broken_command:main")
    assert [BROKEN[body] in failure.reason for failure in tally.failures] == [True]
    assert "python tests/attack/files.py csv 1 " in tally.report("tests/attack/files.py")


def test_a_command_that_does_not_end_is_a_failure(attack, good, tmp_path, monkeypatch):
    (tmp_path / "endless_command.py").write_text("def main(arguments):\n    while True: pass\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    files = attack("files")
    slow = files.Kind(("plan.csv",), ("map import {file}",), cpu_s=0.2)
    monkeypatch.setitem(files.KINDS, "csv", slow)
    tally = files.attack([("csv", 1), ("csv", 2)], good, "endless_command:main")
    assert [failure.reason for failure in tally.failures] == ["out of processor time"] * 2


def test_a_command_that_takes_all_memory_is_a_failure(attack, good, tmp_path, monkeypatch):
    (tmp_path / "greedy_command.py").write_text("def main(arguments):\n    bytes(3 << 30)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    tally = attack("files").attack([("csv", 1)], good, "greedy_command:main")
    assert "MemoryError" in tally.failures[0].reason


def test_an_attempt_is_the_same_every_time(attack, good, tmp_path):
    files = attack("files")
    one, other = (files.attempt_of("svg", 3, good, tmp_path / name) for name in ("a", "b"))
    assert one.arguments == other.arguments
    assert (tmp_path / "a/work/plan.svg").read_bytes() == (
        tmp_path / "b/work/plan.svg"
    ).read_bytes()
