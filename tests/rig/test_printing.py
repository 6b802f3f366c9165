import numpy as np
import pytest
import shapely
from shapely import box

from vinefab.rig.build import build_rig
from vinefab.rig.part import RigOptions
from vinefab.rig.part_files import packed_on_beds, print_estimate, printing_of


@pytest.mark.parametrize("seed", range(5))
def test_boxes_lie_on_the_bed_and_apart(seed):
    sizes = np.random.default_rng(seed).uniform(5, 90, (40, 2)).tolist()
    beds = packed_on_beds(sizes, (200.0, 150.0), 5.0)
    assert sorted(at.index for bed in beds for at in bed) == list(range(40))
    for bed in beds:
        boxes = [
            box(at.x_mm, at.y_mm, at.x_mm + sizes[at.index][0], at.y_mm + sizes[at.index][1])
            for at in bed
        ]
        assert shapely.box(0, 0, 200.001, 150.001).covers(shapely.union_all(boxes))
        grown = [shapely.box(*np.add(one.bounds, (-2.49, -2.49, 2.49, 2.49))) for one in boxes]
        tree = shapely.STRtree(grown)
        assert len(tree.query(grown, predicate="intersects")[0]) == len(grown)
    # Shelves waste some, but not more than about half.
    assert len(beds) <= 2 + 2 * sum(w * h for w, h in sizes) / (200.0 * 150.0)


def test_every_part_lies_on_one_bed(crooked_map, make_printer):
    rig = build_rig(crooked_map(3, 7, 5), make_printer(120.0, 95.0))
    printing = printing_of(rig)
    assert sorted(at.index for bed in printing.beds for at in bed.places) == list(
        range(len(rig.printed))
    )
    for bed in printing.beds:
        for at in bed.places:
            size = rig.printed[at.index].size_mm
            assert 5.0 <= at.x_mm <= 120.0 - 5.0 - size[0] + 0.01
            assert 5.0 <= at.y_mm <= 95.0 - 5.0 - size[1] + 0.01


def test_the_estimate_is_the_formula(make_map, make_printer):
    printer = make_printer(infill=0.2, shell_mm=1.0, flow_mm3_s=5.0, layer_change_s=2.0)
    cube = build_rig(make_map(), printer).extras[0]
    volume_mm3, skin_mm3 = cube.volume_mm3, cube.area_mm2 * 1.0
    plastic_mm3 = skin_mm3 + 0.2 * (volume_mm3 - skin_mm3)
    found = print_estimate([cube], printer)
    assert cube.area_mm2 == pytest.approx(2400.0, rel=0.05)
    assert found.plastic_mm3 == pytest.approx(plastic_mm3)
    assert found.time_s == pytest.approx(plastic_mm3 / 5.0 + 100 * 2.0)
    assert found.mass_g == pytest.approx(1.24e-3 * plastic_mm3)
    assert found.filament_m == pytest.approx(1e-3 * plastic_mm3 / (np.pi * 0.875**2))


def test_thin_parts_are_all_skin(make_map, make_printer):
    printer = make_printer(shell_mm=3.0)
    rig = build_rig(make_map(), printer, RigOptions(mark_depth_mm=0.0, wall_mm=0.0))
    assert print_estimate(rig.parts, printer).plastic_mm3 == pytest.approx(rig.volume_mm3)
