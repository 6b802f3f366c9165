import pytest

from vinefab.model.laser import (
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    Recipe,
    RecipeStatus,
    Standing,
)


def _known(value):
    return Quantity(value=value, standing=Standing.ASSUMED, source="a test's own number")


def _settings(seam_mm, kerf_mm, overcut_mm):
    number = {"power_percent", "min_power_percent", "speed_mm_s", "frequency_hz", "spot_mm"}
    return OperationSettings(
        **{name: _known(10.0) for name in number},
        focus_offset_mm=_known(0.0),
        passes=1,
        air_assist=False,
        seam_width_mm=_known(seam_mm),
        kerf_mm=_known(kerf_mm),
        overcut_mm=_known(overcut_mm),
    )


@pytest.fixture
def profile():
    """A 600 x 400 mm bed with 10 mm margins; seam 0.4, kerf 0.3, overcut of cuts 2 mm."""
    machine = {
        "bed_width_mm": 600.0,
        "bed_height_mm": 400.0,
        "margin_mm": 10.0,
        "power_w": 60.0,
        "spot_mm": 0.2,
        "rayleigh_mm": 3.0,
        "speed_max_mm_s": 500.0,
        "acceleration_mm_s2": 3000.0,
    }
    material = ("ply_mm", "roll_width_mm", "density_kg_m3", "modulus_mpa", "strength_mpa")
    material += ("friction", "burst_kpa", "burst_width_mm")
    return LaserProfile(
        machine=Machine(
            name="bed", title="A bed", **{name: _known(value) for name, value in machine.items()}
        ),
        material=Material(
            name="film",
            title="A film",
            plies=2,
            weldable=True,
            **{name: _known(1.0) for name in material},
        ),
        recipe=Recipe(
            name="bed__film",
            title="A film on a bed",
            machine="bed",
            material="film",
            status=RecipeStatus.UNVERIFIED,
            source="a test",
            operations={"weldcut": _settings(0.4, 0.3, 3.0), "cut": _settings(0.0, 0.2, 2.0)},
        ),
    )
