"""The hook of a wheel's build: compiled code for every processor of the platform goes into it.

Without it the first command of a user compiles for half a minute. It needs numba and vinefab's
other packages (``python -m build --wheel --no-isolation``); where they are missing, or compiling
fails, or ``VINEFAB_PURE_WHEEL`` is set, the wheel is a pure one. Editable installs and source
archives are made without it.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_COMPILE = "import vinefab.core.compiling as c; c.precompile(c.all_compiled())"


class CompiledCode(BuildHookInterface):  # type: ignore[type-arg]
    """Adds compiled code, found by its content, to wheels."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say that the wheel belongs to this platform and Python."""
        if version == "editable" or os.environ.get("VINEFAB_PURE_WHEEL"):
            return
        self._folder = tempfile.TemporaryDirectory(prefix="vinefab-code-")
        settings = {
            "NUMBA_CPU_NAME": "generic",
            "NUMBA_CPU_FEATURES": "",
            "PYTHONPATH": self.root,
            "VINEFAB_CACHE_DIR": self._folder.name,
        }
        done = subprocess.run(  # noqa: S603  this interpreter, on our own code
            [sys.executable, "-c", _COMPILE],
            cwd=self.root,
            env=os.environ | settings,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        code = Path(self._folder.name) / "code"
        if done.returncode != 0 or not code.is_dir():
            reason = done.stderr.strip().rpartition("\n")[2]
            self.app.display_warning(f"nothing is compiled, the wheel is a pure one: {reason}")
            return
        build_data["force_include"][str(code)] = "vinefab/_shipped/code"
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, _version: str, _build_data: dict[str, Any], _artifact: str) -> None:
        """Remove the code where it was compiled."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()
