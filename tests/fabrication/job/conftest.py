from dataclasses import replace

import pytest


@pytest.fixture
def profile(profile, settings):
    """A 600 x 400 mm bed with 10 mm margins; seam 0.4, kerf 0.3, overcut of cuts 2 mm."""

    def known(**values):
        return {name: getattr(settings, name).changed(value=v) for name, v in values.items()}

    machine = profile.machine.changed(margin_mm=profile.machine.margin_mm.changed(value=10.0))
    cut = settings.changed(**known(seam_width_mm=0.0, kerf_mm=0.2, overcut_mm=2.0))
    operations = {"weldcut": settings, "cut": cut}
    recipe = profile.recipe.changed(operations=operations, name="bed__film")
    return replace(profile, machine=machine, recipe=recipe)
