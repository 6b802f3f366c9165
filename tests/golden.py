"""Record what every command, the Python door and the studio give, and compare recordings.

    python tests/golden.py record DIR [--only NAME]       # of the vinefab on PYTHONPATH
    python tests/golden.py compare OLD [NEW] [--only NAME]

NAME is a case of `golden_cases.CASES` or a pattern (``fabricate_*``), also several. Without NEW
the cases of OLD are recorded afresh. Numbers and drawings that differ give exit code 1; sentences
and pictures are listed (`golden_compare.KINDS` says which file is what). Linux and macOS only.
"""

import argparse
import contextlib
import json
import os
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from fnmatch import fnmatchcase
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from golden_cases import BESIDE, CASES, inputs
from golden_compare import compare
from golden_values import plain

from vinefab.core.user_cache import cache_root

SAID, EXITS = "said.txt", "exits.json"
SETTINGS = {
    "SOURCE_DATE_EPOCH": "0",
    "COLUMNS": "100",
    "NO_COLOR": "1",
    "TZ": "UTC",
    "VINEFAB_PROFILES": os.devnull,  # no designs and recipes of the user's own
    "XDG_STATE_HOME": os.devnull,
    "OPENBLAS_NUM_THREADS": "1",
}
LOADED_ONCE = (  # takes most of a command's start; nothing of vinefab's
    "matplotlib.backends.backend_svg",
    "numba",
    "pydantic",
    "rich.console",
    "scipy.optimize",
    "scipy.stats",
    "svgwrite",
)


def record(folder: Path, names: list[str]) -> None:
    """Run cases, each in a folder of its own that must not be there."""
    for module in LOADED_ONCE:
        import_module(module)
    given = inputs()
    spec = find_spec("vinefab")
    sys.stdout.write(f"vinefab of {Path(spec.origin).parent if spec else '?'}\n")
    for name in names:
        place, text = folder / name, CASES[name]
        place.mkdir(parents=True)
        read = {file: data for file, data in given.items() if file in text}
        for file in list(read):
            read |= BESIDE.get(file, {})
        for file, data in read.items():
            (place / file).write_bytes(data)
        steps = [text] if text.startswith("import") else text.splitlines()
        codes = [_said(place, step) for step in steps]
        (place / EXITS).write_text(json.dumps(codes))
        for file, data in read.items():  # what was read is no result, unless it was changed
            if (place / file).is_file() and (place / file).read_bytes() == data:
                (place / file).unlink()
        failed = [step for step, code in zip(steps, codes, strict=True) if code > 1]
        sys.stdout.write(f"{name}: {os.times().children_user:.0f} s of processor time so far\n")
        sys.stdout.writelines(f"  failed: {step}\n" for step in failed)
        sys.stdout.flush()


def _said(place: Path, step: str) -> int:
    """Run a step in a process of its own; what it prints is added to ``said.txt``."""
    shown = f"$ vinefab {step}" if not step.startswith("import") else step
    with (place / SAID).open("a", encoding="utf-8") as said:
        said.write(f"{shown}\n")
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.chdir(place)
            out = os.open(SAID, os.O_WRONLY | os.O_APPEND)
            for number, stream in enumerate((os.open(os.devnull, os.O_RDONLY), out, out)):
                os.dup2(stream, number)
            code = _run(step)
        finally:
            with contextlib.suppress(OSError):
                sys.stdout.flush()
                sys.stderr.flush()
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _run(step: str) -> int:
    """Run a command line as ``python -m vinefab`` does, or a piece of Python."""
    try:
        if step.startswith("import"):
            exec(compile(step, "case", "exec"), {"show": show})  # noqa: S102  our own table
        else:
            sys.argv = ["vinefab", *shlex.split(step)]
            runpy.run_module("vinefab", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # as the interpreter ends a program
        sys.excepthook(*sys.exc_info())
        return 3
    return 0


def show(name: str, value: object) -> None:
    """Write the public attributes of a value as ``name.json``; of a result on file its numbers."""
    if isinstance(value, os.PathLike) and hasattr(value, "numbers"):
        value = {key: getattr(value, key) for key in ("path", "summary", "numbers")}
    Path(f"{name}.json").write_text(json.dumps(plain(value), indent=1))


@contextlib.contextmanager
def _newer(old: Path, new: Path | None, names: list[str]) -> Iterator[Path]:
    """Give the newer recording; without one, that of the vinefab on the path."""
    if new is not None:
        yield new
        return
    with tempfile.TemporaryDirectory() as folder:
        there = [name for name in names if (old / name).is_dir()]
        _in_fresh_process(["record", folder, *[f"--only={name}" for name in there]])
        yield Path(folder)


def _in_fresh_process(words: list[str]) -> None:
    """Run this program with the settings of a recording, which are read when Python starts."""
    path = os.environ.get("PYTHONPATH") or str(Path(__file__).resolve().parents[1])
    with tempfile.TemporaryDirectory() as cache:  # no joints simulated before
        code = cache_root() / "code"
        code.mkdir(parents=True, exist_ok=True)
        (Path(cache) / "code").symlink_to(code, target_is_directory=True)
        settings = os.environ | SETTINGS | {"PYTHONPATH": path, "VINEFAB_CACHE_DIR": cache}
        subprocess.run([sys.executable, __file__, *words], env=settings, check=True)


def _names(patterns: list[str]) -> list[str]:
    unknown = [one for one in patterns if not any(fnmatchcase(name, one) for name in CASES)]
    if unknown:
        raise SystemExit(f"no case {', '.join(unknown)}; there are: {' '.join(CASES)}")
    return [name for name in CASES if any(fnmatchcase(name, one) for one in patterns or ["*"])]


def main(words: list[str]) -> int:
    """Run one of the two commands and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("command", choices=("record", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("new", type=Path, nargs="?")
    parser.add_argument("--only", action="append", default=[], metavar="NAME")
    parser.add_argument("--all", action="store_true", help="list every sentence that differs")
    given = parser.parse_args(words)
    names = _names(given.only)
    if given.command == "record":
        if os.environ | SETTINGS != os.environ:
            _in_fresh_process(words)
            return 0
        for name in names if given.only else []:
            if (given.folder / name / SAID).is_file():
                shutil.rmtree(given.folder / name)
        record(given.folder, names)
        return 0
    with _newer(given.folder, given.new, names) as new:
        result = compare(given.folder, new, names)
    sys.stdout.write(result.text(None if given.all else 5))
    return int(bool(result.failures))


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
