"""What messages advise can be done, and does not lead to the same message."""

import json
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map

LAYERS = ("one", "two")

ADVICE = {
    r"--wall-mm ([\d.e+-]+) --open wall --bounds box --margin-mm 0 --out": lambda m, _: {
        "wall_mm": float(m[1]),
        "open_lines": "wall",
        "bounds": "box",
        "margin_mm": 0.0,
    },
    r"here --join-mm ([0-9.e+-]+) would do": lambda match, _: {"join_mm": float(match[1])},
    r"smaller --join-mm": lambda _, options: {"join_mm": 0.1 * (options.join_mm or 1e-3)},
    r"--wall-mm": lambda *_: {"wall_mm": 0.5},
    r"--open drop": lambda *_: {"open_lines": "drop"},
    r"--bounds largest": lambda *_: {"bounds": "largest"},
    r"--bounds box": lambda *_: {"bounds": "box"},
    r"--drawn free": lambda *_: {"drawn": "free"},
    r"--layer": lambda *_: {"layers": LAYERS},
    r"--scale-mm-per-unit": lambda *_: {"scale_mm_per_unit": 1000.0},
    r"larger --simplify-mm": lambda *_: {"simplify_mm": 1.0},
}
"""What each option in a message asks for."""

_OPTIONS = ("join_mm", "wall_mm", "layer", "drawn", "bounds", "open")


def refused(path, options):
    try:
        import_map(path, options)
    except BadInputError as error:
        return error
    return None


def followed(path, options):
    """Follow every advice of a message once, and return how many there were."""
    error = refused(path, options)
    if error is None:
        return 0
    known = "|".join(f"(?:{pattern})" for pattern in ADVICE)
    assert re.findall(r"--[a-z]+(?:-mm)?", re.sub(known, "", error.allowed)) in (
        [],
        ["--join-mm"],  # the option whose value is shown
    )
    count = 0
    single, _, command = error.allowed.partition("; or, as of a room")
    for pattern, change in ADVICE.items():
        match = re.search(pattern, command if "--out" in pattern else single)
        if match is None:
            continue
        count += 1
        now = {name: getattr(options, name) for name in ImportOptions.__dataclass_fields__}
        changed = change(match, options)
        choices = [{"layers": (name,)} for name in LAYERS] if "layers" in changed else [changed]
        after = [refused(path, ImportOptions(**{**now, **choice})) for choice in choices]
        assert any(again is None or str(again) != str(error) for again in after)
        assert all(again is None or again.key not in _OPTIONS for again in after)
    return count


def svg(shapes):
    body = [
        f'<path fill="{"grey" if closed else "none"}" stroke="black" d="M'
        + " L".join(f"{x:.5g},{y:.5g}" for x, y in points)
        + ("Z" if closed else "")
        + '"/>'
        for points, closed in shapes
    ]
    size = 'width="600mm" height="600mm" viewBox="0 0 600 600"'
    groups = f'<g id="one">{"".join(body[:1])}</g><g id="two">{"".join(body[1:])}</g>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{groups}</svg>'


def geojson(shapes):
    geometries = [
        {"type": "Polygon", "coordinates": [[*map(list, points), list(points[0])]]}
        if closed
        else {"type": "LineString", "coordinates": [*map(list, points)]}
        for points, closed in shapes
    ]
    return json.dumps({"type": "GeometryCollection", "geometries": geometries})


def drawing(seed):
    """Return shapes as points and whether they are closed: some cannot be read as they are."""
    rng = np.random.default_rng(seed)
    shapes = []
    for _ in range(rng.integers(1, 5)):
        kind, spot, size = rng.integers(6), rng.uniform(0, 400, 2), rng.uniform(1, 300, 2)
        corners = spot + np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * size
        gap = rng.choice([1e-7, 0.01, 1.0, 30.0, 100.0])
        if kind < 2:
            shapes.append((corners, True))
        elif kind == 2:  # an outline with a gap
            shapes.append((np.vstack([corners, corners[:1] + np.array([0.0, gap])]), False))
        elif kind == 3:  # a line that ends short of another one
            across = np.array([(0.0, 0.0), (size[0], 0.0)])
            up = np.array([(9.0, gap), (9.0, gap + size[1])])
            shapes += [(spot + across, False), (spot + up, False)]
        elif kind == 4:  # crosses itself, or has no area
            shapes.append((spot + rng.uniform(0, 200, (rng.integers(3, 8), 2)), True))
        else:
            shapes.append((np.array([spot, spot + size, spot]), bool(rng.integers(2))))
    return [(points.tolist(), closed) for points, closed in shapes]


@pytest.mark.parametrize(("write", "suffix"), [(svg, ".svg"), (geojson, ".geojson")])
@settings(max_examples=20)
@given(st.integers(0, 10**6))
def test_every_advice_leads_on(tmp_path_factory, write, suffix, seed):
    path = tmp_path_factory.getbasetemp() / f"advised{suffix}"
    path.write_text(write(drawing(seed)))
    followed(path, ImportOptions())


def test_a_gap_that_may_not_be_joined_is_not_advised(tmp_path):
    path = tmp_path / "plan.geojson"
    path.write_text(
        geojson([([(0, 120), (0, 0), (600, 0), (600, 600), (0, 600), (0, 240)], False)])
    )
    error = refused(path, ImportOptions())
    assert "would do" not in error.allowed
    path.write_text(
        geojson([([(0, 120), (0, 0), (600, 0), (600, 600), (0, 600), (0, 170)], False)])
    )
    error = refused(path, ImportOptions())
    assert "here --join-mm 50.05 would do" in error.allowed
    assert followed(path, ImportOptions()) == 3
    assert import_map(path, ImportOptions(join_mm=50.05)).free_space.area > 3e5


def test_layers_are_advised_only_where_there_are_some(tmp_path):
    apart = [([(0, 0), (9, 0), (9, 9)], True), ([(20, 0), (29, 0), (29, 9)], True)]
    for write, suffix in ((svg, ".svg"), (geojson, ".geojson")):
        path = tmp_path / f"plan{suffix}"
        path.write_text(write(apart))
        assert ("--layer" in refused(path, ImportOptions()).allowed) == (suffix == ".svg")


def test_no_scale_is_advised_for_a_single_point(tmp_path):
    path = tmp_path / "plan.geojson"
    path.write_text(geojson([([(5, 5), (5, 5)], False)]))
    assert "--scale" not in refused(path, ImportOptions()).allowed
