"""How much memory the process has taken."""

import importlib
import sys


def peak_mb() -> float | None:
    """Return the largest memory of this process so far, or None where the system does not tell."""
    try:
        resource = importlib.import_module("resource")
    except ModuleNotFoundError:
        return None
    # Bytes on a Mac, units of 1024 bytes elsewhere.
    per_mb = 2**20 if sys.platform == "darwin" else 2**10
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / per_mb)
