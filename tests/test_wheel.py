"""The wheel carries all that the program needs, and works far from the checkout."""

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from vinefab.model.files.shipped import KINDS

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The content of the wheel in a folder of its own."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(ROOT)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")  # noqa: S202  it is ours
    return folder / "site"


def run(installed, cwd, *arguments):
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    program = [sys.executable, "-m", "vinefab", *arguments]
    return subprocess.run(
        program,
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )


def test_shipped_designs_and_profiles_are_found_by_name(installed, tmp_path):
    code = (
        "import vinefab, vinefab.model.files.shipped as s; print(vinefab.__file__); "
        "print(*[s.shipped_root(), *[len(s.names(kind)) for kind in s.KINDS]])"
    )
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        errors="replace",
        check=True,
    )
    where, listing = done.stdout.splitlines()
    root, *counts = listing.split()
    assert where.startswith(str(installed))
    assert root == str(installed / "vinefab" / "_shipped")
    shipped = [len(list((ROOT / folder).glob("*.toml"))) for folder in KINDS.values()]
    assert [int(count) for count in counts] == shipped
    empty = [kind for kind, count in zip(KINDS, shipped, strict=True) if not count]
    assert empty == ["contacts file"]  # nobody has measured any yet


def test_a_design_is_checked_and_cut_from_another_folder(installed, tmp_path):
    checked = run(installed, tmp_path, "check", "three_level_tree")
    assert (checked.returncode, checked.stderr) == (0, "")
    out = ["fabricate", "plain_vine", "--out", "package", "--allow-uncalibrated", "-q"]
    cut = run(installed, tmp_path, *out)
    assert (cut.returncode, cut.stderr) == (0, "")
    assert "<html" in (tmp_path / "package" / "report.html").read_text()


GROWN = """
import sys
import vinefab
from vinefab.app.searching import optimize
from vinefab.core.hashing import fingerprint
from vinefab.search.settings import read_run

settings = read_run(sys.argv[1])
settings = settings.changed(search=settings.search.changed(population=16, generations=2))
result = optimize(settings, progress=False)
print(vinefab.__file__)
print(fingerprint([[repr(one.fitness), repr(one.score)] for one in result.finalists]))
"""


@pytest.mark.thorough
def test_a_wheel_brings_code_with_the_same_results_to_the_bit(tmp_path):
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path)]
    environment = os.environ | {"VINEFAB_PURE_WHEEL": ""}
    subprocess.run([*build, str(ROOT)], check=True, capture_output=True, env=environment)
    (wheel,) = tmp_path.glob("*.whl")
    assert not wheel.name.endswith("-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")  # noqa: S202  it is ours
    run = ROOT / "examples" / "grid_coverage.toml"
    digests = []
    for place, compiled_here in ((tmp_path / "site", False), (ROOT, True)):
        cache = tmp_path / f"cache_of_{place.name}"
        done = subprocess.run(
            [sys.executable, "-c", GROWN, str(run)],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(place), "VINEFAB_CACHE_DIR": str(cache)},
            capture_output=True,
            text=True,
            check=True,
        )
        where, digest = done.stdout.splitlines()[-2:]
        assert where.startswith(str(place))
        assert bool(list(cache.rglob("*.code"))) == compiled_here
        digests.append(digest)
    assert digests[0] == digests[1]


@pytest.mark.thorough
def test_the_source_archive_makes_the_same_wheel(tmp_path):
    def built(kind, source, out):
        build = [sys.executable, "-m", "build", f"--{kind}", "--no-isolation", "--outdir", str(out)]
        subprocess.run([*build, str(source)], check=True, capture_output=True)
        (made,) = out.iterdir()
        return made

    archive = built("sdist", ROOT, tmp_path / "sdist")
    with tarfile.open(archive) as tar:
        tar.extractall(tmp_path / "unpacked", filter="data")
    (source,) = (tmp_path / "unpacked").iterdir()
    for name in ("CITATION.cff", "CONTRIBUTING.md", "SECURITY.md", "paper.md", "Makefile", "docs"):
        assert (source / name).exists(), name
    contents = []
    for root in (ROOT, source):
        with zipfile.ZipFile(built("wheel", root, tmp_path / f"wheel_{len(contents)}")) as wheel:
            contents.append({info.filename: info.CRC for info in wheel.infolist()})
    direct, through = contents
    assert set(direct) == set(through)
    changed = {name for name in direct if direct[name] != through[name]}
    assert changed <= {name for name in direct if name.endswith("/RECORD")}
