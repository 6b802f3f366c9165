"""Shaded pictures: what is in front hides what is behind, and nothing is left out."""

import io

import numpy as np
import pytest
from PIL import Image
from shapely import Polygon, box

from vinefab.rig.relief import Label, Prism, relief_png
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import stacked

RED, BLUE, GREEN = (200, 0, 0), (0, 0, 200), (0, 160, 0)
SMALL_PX = 420
"""Wide enough to tell shares of a picture to a hundredth; a whole one takes ten times as long."""


def _block(low, high, height_mm, colour):
    vertices, faces = stacked(
        polygon_parts(box(*low, *high)), polygon_parts(Polygon()), height_mm, 0.0
    )
    return Prism(vertices_mm=vertices, faces=faces, colour=colour)


def _drawn(solids, **view):
    return relief_png(solids, width_px=SMALL_PX, **view)


def _pixels(data):
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)


def _share(pixels, colour):
    """Share of pixels of a hue, however bright."""
    unit = np.array(colour) / np.linalg.norm(colour)
    length = np.linalg.norm(pixels, axis=2)
    return float(((pixels @ unit > 0.97 * length) & (length > 40) & (length < 400)).mean())


def test_a_high_block_in_front_hides_a_low_one_behind():
    low = _block((0, 40), (20, 60), 5.0, RED)
    hidden = _pixels(_drawn([low, _block((-20, 0), (40, 30), 60.0, BLUE)], turn_deg=0.0))
    seen = _pixels(_drawn([low, _block((-20, 0), (40, 30), 2.0, BLUE)], turn_deg=0.0))
    assert _share(hidden, RED) == 0.0
    assert _share(seen, RED) > 0.02


@pytest.mark.parametrize("order", [1, -1])
def test_the_order_of_the_solids_does_not_matter(order):
    solids = [_block((0, 0), (20, 20), 30.0, RED), _block((30, 5), (60, 40), 10.0, GREEN)]
    first, again = _drawn(solids[::order]), _drawn(solids)
    assert np.abs(_pixels(first) - _pixels(again)).mean() < 0.5
    assert _drawn(solids) == again


def test_areas_are_those_of_the_projection():
    # Seen at 30 degrees: the top of 40 x 40 counts half, the front of 40 x 20 by cos 30.
    data = _drawn([_block((0, 0), (40, 40), 20.0, RED)], turn_deg=0.0, rise_deg=30.0)
    pixels = _pixels(data)
    width_mm = 40.0 + 2.0 * 0.03 * 40.0
    mm2 = (width_mm / pixels.shape[1]) ** 2
    drawn_mm2 = (pixels.min(axis=2) < 250).sum() * mm2
    assert drawn_mm2 == pytest.approx(40.0 * 20.0 + 40.0 * 20.0 * np.cos(np.pi / 6), rel=0.02)


def test_labels_are_written():
    solid = _block((0, 0), (100, 100), 2.0, GREEN)
    plain = _pixels(relief_png([solid]))
    named = _pixels(relief_png([solid], [Label(text="12", at_mm=(50.0, 50.0, 2.0))]))
    changed = np.argwhere(np.abs(plain - named).max(axis=2) > 50)
    assert len(changed) > 100
    assert np.abs(changed.mean(axis=0) - np.array(plain.shape[:2]) / 2).max() < 30
