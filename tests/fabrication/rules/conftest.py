import math
from dataclasses import replace

import pytest

from vinefab.model.design import Build, Design, Level, Pouch, default_fillets_mm
from vinefab.model.laser import read_profile
from vinefab.model.quantity import Quantity, Standing

Fan = tuple[int, float, float]
"""Branches, length in mm, whole angle in degrees."""


def make_design(*fans, trunk_mm=300.0, widths_mm=(), **build):
    widths = widths_mm or Build.standard(1 + len(fans)).widths_mm
    plain = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths))
    levels = tuple(
        Level(branches=branches, length_mm=length, fan_rad=math.radians(angle))
        for branches, length, angle in fans
    )
    return Design(
        name="case", trunk_length_mm=trunk_mm, levels=levels, build=plain.changed(**build)
    )


def random_tree(rng, *, shortest_mm=60.0, pouched=False):
    depth = int(rng.integers(2, 5))
    widths = tuple((float(rng.uniform(20, 50)) * rng.uniform(0.45, 0.8, depth).cumprod()).tolist())
    levels = tuple(
        Level(
            branches=int(rng.integers(1, 4)),
            length_mm=float(rng.uniform(shortest_mm, 220)),
            fan_rad=float(rng.uniform(0.2, 3.5)),
            growth=float(rng.uniform(0.5, 1.5)),
        )
        for _ in range(depth - 1)
    )
    pouch = None
    if pouched:
        radius_mm = float(rng.uniform(0.55, 2.5) * widths[-1])
        pouch = Pouch(shape="round", radius_mm=radius_mm) if rng.random() < 0.4 else None
    build = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths), pouch=pouch)
    return Design(
        name="random", trunk_length_mm=float(rng.uniform(80, 300)), levels=levels, build=build
    )


@pytest.fixture(scope="session")
def random_design():
    """Return a maker of random trees, some manufacturable and some not."""
    return random_tree


@pytest.fixture(scope="session")
def make():
    """Return a design from fans (branches, length in mm, whole angle in degrees)."""
    return make_design


@pytest.fixture(scope="session")
def profile():
    """The shipped recipe: 0.0375 mm film, 70 kPa survived at 20 mm, 1000 x 600 mm bed."""
    return read_profile("co2_60w__stretchlon_200")


def measured(value):
    return Quantity(value=value, standing=Standing.MEASURED, source="a test")


LOOSE_FIT = {
    "yield_kpa": measured(1.92),
    "drag_kpa_m": measured(0.771),
    "storage_kpa": measured(0.0),
    "friction": measured(0.234),
    "width_mm": measured(25.0 * math.pi / 2.0),
}
"""The published growth constants of a loosely stored tube, as if they were one's own."""


@pytest.fixture(scope="session")
def burst_profile(profile):
    """The same where a tube of 20 mm burst at 70 kPa, measured."""
    seam = {"burst_kpa": measured(70.0), "burst_width_mm": measured(20.0)}
    none = {"survived_kpa": None, "survived_width_mm": None}
    return replace(profile, material=profile.material.changed(**seam, **none))


@pytest.fixture(scope="session")
def grown_profile(burst_profile):
    """The same with the published growth constants of loosely stored film, as if measured."""
    return replace(burst_profile, recipe=burst_profile.recipe.changed(growth=LOOSE_FIT))
