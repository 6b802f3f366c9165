"""Drawings whose areas are the free space."""

import json

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map
from vinefab.model.map import Pose


def saved(folder, *areas, roles=()):
    """Write areas as GeoJSON; None instead of a role for none."""
    roles = [*roles, *([None] * (len(areas) - len(roles)))]
    features = [
        {
            "type": "Feature",
            "properties": {"role": role} if role else {},
            "geometry": json.loads(shapely.to_geojson(area)),
        }
        for area, role in zip(areas, roles, strict=True)
    ]
    path = folder / "cave.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def free_map(folder, *areas, roles=(), **options):
    return import_map(
        saved(folder, *areas, roles=roles), ImportOptions(**{"drawn": "free", **options})
    )


RING = (box(0, 0, 100, 20), box(80, 0, 100, 100), box(0, 80, 100, 100), box(0, 0, 20, 100))
"""Four passages around a rock."""


def test_the_union_is_free_and_its_holes_are_obstacles(tmp_path):
    world = free_map(tmp_path, *RING)
    assert world.bounds.equals(box(0, 0, 100, 100))
    assert [rock.bounds for rock in world.obstacles] == [(20, 20, 80, 80)]
    assert world.facts["areas_united"] == 4
    assert world.facts["drawn"].startswith("free (as asked for)")
    assert world.facts["bounds_are"] == "the outline of 4 united areas"


@given(st.integers(0, 10**6), st.integers(1, 12))
def test_the_area_is_that_of_the_cells_covered(tmp_path_factory, seed, count):
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, 18, (count, 2))
    sizes = rng.integers(2, 9, (count, 2))
    cells = np.zeros((30, 30), dtype=bool)
    for (x, y), (wide, high) in zip(corners, sizes, strict=True):
        cells[y : y + high, x : x + wide] = True
    areas = [
        box(x, y, x + wide, y + high) for (x, y), (wide, high) in zip(corners, sizes, strict=True)
    ]
    world = free_map(tmp_path_factory.mktemp("cells"), *areas, join_mm=0.0)
    kept = world.free_space.area
    assert kept == pytest.approx(cells.sum() * world.facts.get("connected_share", 1.0), rel=1e-3)
    if "separate_parts" not in world.facts:
        assert kept == pytest.approx(cells.sum())


def test_an_area_that_crosses_itself_is_repaired_and_counted(tmp_path):
    loop = Polygon([(0, 0), (90, 0), (90, 60), (30, 60), (30, -30), (60, -30), (60, 90), (0, 90)])
    world = free_map(tmp_path, loop, box(85, 0, 200, 10))
    assert world.facts["self_crossings_repaired"] == 1
    assert world.facts["enclosed_twice_inside_by_nonzero_mm2"] == 1800.0
    assert world.free_space.is_valid


def test_separate_parts_are_said_and_the_largest_is_kept(tmp_path):
    parts = (box(0, 0, 100, 10), box(90, 0, 100, 60), box(200, 0, 230, 10))
    world = free_map(tmp_path, *parts)
    assert world.facts["separate_parts"] == 2
    assert world.facts["connected_share"] == round(1500 / 1800, 4)
    assert world.facts["parts_left_out"] == ["300 mm2 at (215, 5), 100 mm away"]
    assert "its largest part" in world.facts["bounds_are"]
    other = free_map(tmp_path, *parts, start=Pose(x_mm=215.0, y_mm=5.0, heading_rad=0.0))
    assert other.bounds.equals(parts[2])


def test_gaps_between_areas_are_closed_up_to_the_width_to_join(tmp_path):
    halls = (box(0, 0, 100, 10), box(100.01, 0, 200, 10))
    world = free_map(tmp_path, *halls)
    assert world.facts["gaps_between_areas_closed"] == 1
    assert world.free_space.area == pytest.approx(2000.0, abs=0.5)
    assert "separate_parts" in free_map(tmp_path, *halls, join_mm=0.001).facts


def test_outlines_in_areas_and_named_obstacles_are_obstacles(tmp_path):
    rock = shapely.LinearRing([(40, 4), (44, 4), (44, 6), (40, 6)])
    world = free_map(tmp_path, box(0, 0, 100, 10), box(90, 0, 190, 10), rock)
    assert world.facts["outlines_in_areas_made_obstacles"] == 1
    assert [item.area for item in world.obstacles] == [8.0]
    world = free_map(tmp_path, box(40, 4, 44, 6), *RING, roles=("obstacle",))
    assert world.free_space.area == pytest.approx(6400.0 - 8.0)


def test_plain_passages_are_guessed_and_said(tmp_path):
    chain = [box(90 * k, 0, 90 * k + 100, 20) for k in range(4)]
    world = free_map(tmp_path, *chain, drawn=None)
    assert world.facts["drawn"].startswith("free (guessed: no outline contains the others")
    assert "--drawn obstacles" in world.facts["drawn"]
    assert world.free_space.area == pytest.approx(370 * 20)
    with pytest.raises(BadInputError, match="outside of the largest outline"):
        free_map(tmp_path, *chain, drawn="obstacles")


NOT_PLAIN = {
    "an obstacle half outside": ((box(0, 0, 100, 60), box(90, 20, 130, 40)), True),
    "walls around rooms": (RING, True),
    "obstacles without bounds": (tuple(box(30 * k, 0, 30 * k + 20, 20) for k in range(5)), False),
    "one area in another": (
        (*(box(k, 0, k + 100, 20) for k in (0, 90, 180)), box(5, 5, 9, 9)),
        True,
    ),
}


@pytest.mark.parametrize("kind", NOT_PLAIN)
def test_what_may_be_meant_otherwise_is_not_guessed(tmp_path, kind):
    areas, hint = NOT_PLAIN[kind]
    with pytest.raises(BadInputError, match="outside of the largest outline") as caught:
        free_map(tmp_path, *areas, drawn=None)
    assert ("--drawn free" in str(caught.value)) == hint
    if hint:
        assert free_map(tmp_path, *areas).facts["drawn"].startswith("free (as asked")


def test_a_drawing_with_bounds_is_read_as_ever(tmp_path):
    world = free_map(
        tmp_path, box(0, 0, 100, 100), *(box(k, 9, k + 30, 19) for k in (9, 30)), drawn=None
    )
    assert "drawn" not in world.facts
    assert len(world.obstacles) == 1


@pytest.mark.parametrize(
    ("options", "roles", "message"),
    [
        ({"bounds": "box"}, (), "bounds means nothing with --drawn free"),
        ({"wall_mm": 2.0}, (), "wall_mm means nothing with --drawn free"),
        ({"drawn": "solid"}, (), "drawn is 'solid'; allowed: obstacles or free"),
        (
            {},
            ("bounds",),
            r"drawn: the source calls features\[1\]",
        ),
    ],
)
def test_what_contradicts_free_areas_is_refused(tmp_path, options, roles, message):
    with pytest.raises(BadInputError, match=message):
        free_map(tmp_path, *RING, roles=roles, **options)


def test_painted_elements_of_an_svg_are_areas_with_their_holes(tmp_path):
    path = tmp_path / "cave.svg"
    shapes = (
        '<path d="M0 0H100V60H0Z M40 20H60V40H40Z" fill="#ccc" fill-rule="evenodd"/>'
        '<rect x="95" y="20" width="100" height="10" fill="grey" stroke="none"/>'
        '<rect x="190" y="0" width="40" height="60" style="fill:#ccc"/>'
    )
    head = (
        '<svg xmlns="http://www.w3.org/2000/svg" width="240mm" height="60mm" viewBox="0 0 240 60">'
    )
    path.write_text(f"{head}{shapes}</svg>")
    world = import_map(path, ImportOptions(drawn="free"))
    assert world.free_space.area == pytest.approx(6000 - 400 + 900 + 2400)
    assert [rock.bounds for rock in world.obstacles] == [(40, 20, 60, 40)]


def test_what_is_cut_at_the_bounds_is_named_with_its_share(tmp_path):
    areas = (box(0, 0, 100, 60), box(90, 20, 130, 40), box(5, 5, 9, 9), box(200, 0, 210, 9))
    world = free_map(tmp_path, *areas, drawn=None, bounds="largest")
    assert world.facts["reaching_over_bounds"] == ["features[2]: 75 % of it outside"]
    assert world.facts["outlines_outside_left_out"] == 1
