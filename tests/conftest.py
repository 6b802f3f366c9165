"""What all tests share."""

import atexit
import os
import shutil
import signal
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from hypothesis import settings

# Read when NumPy is first imported, here or in what tests start: as the program does, and two
# workers on two processors have no other to wait with.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from vinefab.core.compiling import all_compiled, precompile
from vinefab.core.user_cache import cache_root

# Timings on shared machines say nothing, so no deadline; the same examples every run.
settings.register_profile("vinefab", deadline=None, derandomize=True)
settings.load_profile("vinefab")

# Tests in the background, or under nohup, ignore these, and so would the programs that they start.
for name, usual in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    number = getattr(signal, name, None)
    if number is not None and signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)

# Hundreds of processes start here: each would read every module from its text again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Simulated joints are kept for the other workers of this run, not for a user's. Compiled code is
# the user's: its content is part of its name.
if "PYTEST_XDIST_WORKER" not in os.environ:
    folder = Path(tempfile.mkdtemp(prefix="vinefab-cache-"))
    code = cache_root() / "code"
    code.mkdir(parents=True, exist_ok=True)
    with suppress(OSError):  # Windows lets few users link
        (folder / "code").symlink_to(code, target_is_directory=True)
    os.environ["VINEFAB_CACHE_DIR"] = str(folder)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)

# Wheels of tests are pure ones: compiling takes a minute. `test_wheel` makes one that is not.
os.environ.setdefault("VINEFAB_PURE_WHEEL", "1")


def pytest_sessionstart(session):
    """Compile for the workers what the cache lacks: at once each of them would compile all."""
    if session.config.getoption("numprocesses", None):
        precompile(all_compiled())


@pytest.fixture
def program():
    """Return a function that finds a program; missing, it skips, or fails where CI must have it."""

    def find(name: str, package: str) -> str:
        found = shutil.which(name)
        if found is None and os.environ.get("CI") == "true":
            pytest.fail(f"{name} is missing; install {package}")
        if found is None:
            pytest.skip(f"{name} is not installed (Debian package {package})")
        return found

    return find


@pytest.hookimpl(wrapper=True)
def pytest_collect_file():
    """Look for examples in docstrings only where they stand, in vinefab: tests have none."""
    found = yield
    return [one for one in found if not isinstance(one, DoctestModule)]


@pytest.fixture(scope="module")
def browser():
    """One browser for a module; Playwright's loop must not outlive it."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None and os.environ.get("CI") == "true":
        pytest.fail("chromium is missing; install chromium")
    if path is None:
        pytest.skip("chromium is not installed (Debian package chromium)")
    from playwright.sync_api import sync_playwright  # noqa: PLC0415  only where there is a browser

    with sync_playwright() as playwright:
        # Root and containers have no sandbox for it.
        opened = playwright.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--disable-gpu"], timeout=60_000
        )
        try:
            yield opened
        finally:
            opened.close()
