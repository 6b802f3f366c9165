"""A few of the drawings of `against_chromium`, which `make thorough` tries by the hundred."""

from shutil import which

import pytest

from tests.maps.importers.against_chromium import MOST_SHARE, browser, differing_share, drawing

FEW = (3, 13, 14, 19)
"""Seeds whose drawings have every feature."""


@pytest.mark.skipif(which("chromium") is None, reason="chromium is not installed")
def test_the_map_of_a_drawing_is_what_a_browser_shows():
    pytest.importorskip("playwright")
    with browser() as page:
        for seed in FEW:
            assert differing_share(page, drawing(seed)) <= MOST_SHARE, seed
