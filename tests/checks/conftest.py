import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from vinefab.files.profile import read_profile
from vinefab.model.design import Build, Design, Level, default_fillets_mm
from vinefab.model.laser import LaserProfile

Fan = tuple[int, float, float]
"""Branches, length in mm, whole angle in degrees."""


def make_design(
    *fans: Fan, trunk_mm: float = 300.0, widths_mm: tuple[float, ...] = (), **build: object
) -> Design:
    widths = widths_mm or Build.standard(1 + len(fans)).widths_mm
    plain = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths))
    levels = tuple(
        Level(branches=branches, length_mm=length, fan_rad=math.radians(angle))
        for branches, length, angle in fans
    )
    return Design(
        name="case", trunk_length_mm=trunk_mm, levels=levels, build=replace(plain, **build)
    )


@pytest.fixture(scope="session")
def make() -> Callable[..., Design]:
    """Return a design from fans (branches, length in mm, whole angle in degrees)."""
    return make_design


@pytest.fixture(scope="session")
def profile() -> LaserProfile:
    """The shipped recipe: 0.0375 mm film, 70 kPa at 20 mm, 1000 x 600 mm bed."""
    return read_profile("co2_60w__stretchlon_200")
