"""Designs that the tests of several rooms share."""

import math
from functools import cache

import pytest

from tests.oracles.body_outline import Twin
from vinefab.model.design import Build, Collar, Design, Level, Pouch


def fan(branches, length_mm, angle_deg, growth=1.0):
    return Level(
        branches=branches, length_mm=length_mm, fan_rad=math.radians(angle_deg), growth=growth
    )


def plan(widths, fillets=None, levels=(), *, trunk=120.0, tail=60.0, **build):
    if fillets is None:
        fillets = tuple(max(2.0, width / 4) for width in widths[1:])
    build = Build(widths_mm=widths, fillet_mm=fillets, tail_mm=tail, **build)
    return Design(name="plan", trunk_length_mm=trunk, levels=tuple(levels), build=build)


NAMED_DESIGNS = {
    "plain_vine": plan((40.0,)),
    "plain_vine_with_pouch": plan((30.0,), pouch=Pouch(shape="round", radius_mm=25.0)),
    "one_straight_child": plan((40.0, 24.0), levels=[fan(1, 110, 0)]),
    "three_levels": plan((40.0, 24.0, 14.0), levels=[fan(3, 120, 110), fan(2, 70, 70, 0.7)]),
    "wide_fan": plan((40.0, 20.0), levels=[fan(4, 110, 285)]),
    "backward_pair": plan((40.0, 16.0), levels=[fan(2, 150, 270)], trunk=200.0),
    "narrow_pair": plan((40.0, 24.0), (5.0,), levels=[fan(2, 160, 50)]),
    "large_fillets": plan((40.0, 20.0), (25.0,), levels=[fan(2, 150, 90)]),
    "capped_fillets": plan((40.0, 24.0), (30.0,), levels=[fan(2, 150, 45)]),
    "no_fillets": plan((40.0, 12.0), (0.0,), levels=[fan(3, 110, 150)]),
    "round_pouches": plan(
        (40.0, 20.0), levels=[fan(3, 110, 120, 0.6)], pouch=Pouch(shape="round", radius_mm=18.0)
    ),
    "rectangular_pouches": plan(
        (40.0, 20.0),
        levels=[fan(2, 110, 90)],
        pouch=Pouch(shape="rectangle", length_mm=50.0, width_mm=44.0),
    ),
    "slight_pouches": plan(
        (40.0, 20.0),
        levels=[fan(2, 110, 90)],
        pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=26.0),
    ),
    "tapered_tree": plan(
        (40.0, 22.0, 12.0),
        levels=[fan(3, 120, 110), fan(2, 70, 70, 0.7)],
        taper=(0.9, 0.8, 0.6),
    ),
    "tapered_backward_pair": plan(
        (40.0, 16.0), levels=[fan(2, 150, 270)], trunk=200.0, taper=(0.8, 0.7)
    ),
    "tapered_with_round_pouches": plan(
        (40.0, 20.0),
        levels=[fan(3, 110, 120, 0.6)],
        pouch=Pouch(shape="round", radius_mm=18.0),
        taper=(1.0, 0.7),
    ),
    "tapered_with_rectangular_pouches": plan(
        (40.0, 20.0),
        levels=[fan(2, 110, 90, 0.8)],
        pouch=Pouch(shape="rectangle", length_mm=40.0, width_mm=34.0),
        taper=(0.95, 0.7),
    ),
    "wide_collar": plan(
        (30.0, 16.0),
        levels=[fan(2, 110, 90)],
        tail=100.0,
        collar=Collar(clamp_diameter_mm=30.0, length_mm=25.0, flare_mm=30.0),
    ),
    "narrow_collar_without_a_straight_part": plan(
        (40.0,), tail=100.0, collar=Collar(clamp_diameter_mm=20.0, length_mm=0.0, flare_mm=40.0)
    ),
    "narrow_collar_that_reaches_the_trunk": plan(
        (44.0,),
        trunk=25.0,
        tail=60.0,
        pouch=Pouch(shape="round", radius_mm=31.0),
        collar=Collar(clamp_diameter_mm=12.0, length_mm=30.0, flare_mm=28.0),
    ),
    "tapered_trunk_with_a_collar": plan(
        (40.0,), tail=100.0, taper=(0.5,), collar=Collar(clamp_diameter_mm=32.0)
    ),
}


@pytest.fixture(scope="session")
def make_plan():
    """Return how to make a small design: widths, fillets, levels."""
    return plan


@pytest.fixture(scope="session")
def make_fan():
    """Return how to make a level: branches, length in mm, fan in degrees, growth."""
    return fan


@pytest.fixture(params=NAMED_DESIGNS.values(), ids=NAMED_DESIGNS.keys())
def sound_design(request):
    """Each kind of joint and tip in a design that has an exact outline."""
    return request.param


@cache
def _drawn_twice(name, beyond_mm):
    return Twin(NAMED_DESIGNS[name], 1e-4).body(beyond_mm)


@pytest.fixture
def sound_body(sound_design):
    """Return a function that draws a sound design with Shapely, once for all tests."""
    (name,) = (name for name, one in NAMED_DESIGNS.items() if one is sound_design)
    return lambda beyond_mm=0.0: _drawn_twice(name, beyond_mm)
