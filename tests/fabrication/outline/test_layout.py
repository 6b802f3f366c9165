import math

import numpy as np
import pytest

from vinefab.fabrication.outline.body_outline import flat_layout
from vinefab.fabrication.outline.ends import level_fillets_mm


def test_trunk_lies_along_x_and_children_turn_by_the_fan(make_plan, make_fan):
    layout = flat_layout(make_plan((40.0, 20.0), levels=[make_fan(3, 50, 90)], trunk=100.0))
    assert layout.start_mm[0].tolist() == [0.0, 0.0]
    assert layout.end_mm[0] == pytest.approx([100.0, 0.0])
    assert np.degrees(layout.heading_rad[1:]) == pytest.approx([-45.0, 0.0, 45.0])
    leg = 50 / math.sqrt(2)
    assert layout.end_mm[1:] == pytest.approx(
        np.array([[100 + leg, -leg], [150.0, 0.0], [100 + leg, leg]])
    )


def test_grandchildren_start_where_their_parents_end_and_turns_add_up(make_plan, make_fan):
    levels = [make_fan(2, 80, 60, 0.5), make_fan(2, 30, 40)]
    layout = flat_layout(make_plan((40.0, 20.0, 10.0), levels=levels))
    parents = layout.tree.parent[3:]
    assert np.array_equal(layout.start_mm[3:], layout.end_mm[parents])
    assert np.degrees(layout.heading_rad[3:]) == pytest.approx([-50.0, -10.0, 10.0, 50.0])
    lengths = np.hypot(*(layout.end_mm - layout.start_mm).T)
    assert lengths == pytest.approx([120.0, 80.0, 40.0, 30.0, 30.0, 30.0, 30.0])


def test_widths_fillets_and_leaves_go_by_level(make_plan, make_fan):
    layout = flat_layout(make_plan((40.0, 20.0), (3.0,), [make_fan(2, 80, 60)], tail=75.0))
    assert layout.width_mm.tolist() == [40.0, 20.0, 20.0]
    assert layout.is_leaf.tolist() == [False, True, True]
    assert layout.tail_mm == 75.0


def test_arrays_cannot_be_written(make_plan):
    layout = flat_layout(make_plan((40.0,)))
    for array in (layout.start_mm, layout.heading_rad, layout.width_mm):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_trunk_has_the_default_fillet_for_its_pouch(make_plan):
    assert level_fillets_mm(make_plan((4.0,)).build) == (2.0,)
    assert level_fillets_mm(make_plan((40.0,)).build) == (10.0,)
