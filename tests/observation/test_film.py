"""Film told from floor, obstacles and shadows by colour."""

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.model.map import Map, Pose
from vinefab.observation.film import Sight, found_film
from vinefab.photos.photo import PlanView

WORLD = Map(
    name="bench", bounds=shapely.box(0, 0, 60, 40), obstacles=(shapely.box(42, 2, 58, 15.5),)
)
POSE = Pose(x_mm=5.0, y_mm=20.0, heading_rad=0.0)


def view_of(film, floor=(180, 180, 175), shadow=0.45):
    """Return a plan with a straight tube, a shadow beside it and an obstacle."""
    rng = np.random.default_rng(3)
    pixels = np.full((80, 120, 3), floor, dtype=np.float64)
    pixels[50:79, 10:90] *= shadow
    pixels[32:48, 4:100] = film
    pixels[49:76, 84:116] = (90, 110, 140)
    pixels += rng.normal(0.0, 3.0, pixels.shape)
    return PlanView(
        pixels=pixels.clip(0, 255).astype(np.uint8), mm_per_pixel=0.5, left_mm=0.0, top_mm=40.0
    )


@pytest.mark.parametrize("film", [(214, 88, 40), (60, 150, 70), (70, 90, 200)])
def test_film_is_found_and_a_hard_shadow_is_not(film):
    found = found_film(view_of(film), WORLD, POSE, (8.0, 8.0), Sight())
    truth = np.zeros((80, 120), dtype=bool)
    truth[32:48, 4:100] = True
    assert ((found.share > 0.5) != truth).mean() < 0.01
    assert not found.cautions


def test_white_film_is_found_by_lightness_and_that_is_said():
    view = view_of((250, 250, 243), floor=(150, 150, 146))
    found = found_film(view, WORLD, POSE, (8.0, 8.0), Sight())
    assert (found.share[34:46, 10:95] > 0.5).mean() > 0.95
    assert (found.share[55:75, 15:80] > 0.5).mean() < 0.02
    assert "shadows" in found.cautions[0]


def test_a_given_colour_is_looked_for_where_the_base_shows_none():
    away = Pose(x_mm=30.0, y_mm=37.0, heading_rad=0.0)
    found = found_film(
        view_of((214, 88, 40)), WORLD, away, (8.0, 8.0), Sight(), colour=(200, 80, 40)
    )
    assert (found.share[34:46, 10:95] > 0.5).mean() > 0.95


def test_a_floor_without_film_is_refused():
    with pytest.raises(BadInputError, match="--film-colour"):
        found_film(view_of((180, 180, 175)), WORLD, POSE, (8.0, 8.0), Sight())
