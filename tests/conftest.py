"""What all tests share."""

import os
import shutil

import pytest
from hypothesis import settings

# Timings on shared machines say nothing, so no deadline; the same examples every run.
settings.register_profile("vinefab", deadline=None, derandomize=True)
settings.load_profile("vinefab")


@pytest.fixture
def program():
    """Return the path of an outside program; skip without it, but fail where CI must have it."""

    def find(name: str) -> str:
        path = shutil.which(name)
        if path is None and os.environ.get("CI") == "true":
            pytest.fail(f"{name} must be installed where CI runs")
        if path is None:
            pytest.skip(f"{name} is not installed")
        return path

    return find
