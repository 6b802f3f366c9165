import string

import numpy as np
import pytest

from vinefab.fabrication.job.marks import text_strokes_mm, text_width_mm


def test_every_letter_and_digit_has_strokes_of_its_own_inside_its_cell():
    seen = set()
    for letter in string.ascii_uppercase + string.digits + "-_.+/:=":
        strokes = text_strokes_mm(letter, 6.0)
        points = np.concatenate(strokes)
        assert points.min() >= 0.0
        assert points[:, 0].max() <= 4.0
        assert points[:, 1].max() <= 6.0
        for stroke in strokes:
            assert np.hypot(*np.diff(stroke, axis=0).T).min() >= 1.0
        seen.add(tuple(map(bytes, strokes)))
    assert len(seen) == 26 + 10 + 7


def test_text_is_as_wide_as_its_letters():
    points = np.concatenate(text_strokes_mm("HxH", 3.0))
    assert points.max(axis=0) == pytest.approx([text_width_mm("HXH", 3.0), 3.0])
    assert text_strokes_mm("\u00e9 ", 3.0) == []
