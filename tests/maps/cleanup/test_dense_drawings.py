"""Drawings so dense that comparing or cutting their lines would take minutes."""

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map

ROOM = "room,0,0\nroom,300,0\nroom,300,200\nroom,0,200\n"
SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 300 200"><rect width="300" height="200"/>'
)
WAYS = np.arange(20_000)
TANGLED = {
    "at random": np.random.default_rng(1).uniform(10.0, 190.0, (20_000, 2)),
    "over itself": np.column_stack([50 + WAYS % 7, 50 + WAYS % 11]),
    "star": 100.0 + 80.0 * np.column_stack([np.cos(2.4 * WAYS), np.sin(2.4 * WAYS)]),
}


@pytest.mark.parametrize("kind", TANGLED)
def test_an_outline_that_crosses_itself_everywhere_is_refused(tmp_path, kind):
    path = tmp_path / "m.csv"
    path.write_text(ROOM + "".join(f"q,{x},{y}\n" for x, y in TANGLED[kind].tolist()))
    with pytest.raises(
        BadInputError, match=r"m.csv: polygon q .*(crossings|walls across).*clean the drawing"
    ):
        import_map(path, ImportOptions())


@pytest.mark.parametrize("options", [ImportOptions(), ImportOptions(wall_mm=0.5)])
def test_lines_that_cross_everywhere_are_refused(tmp_path, options):
    path = tmp_path / "m.svg"
    ends = np.random.default_rng(2).uniform(10.0, 190.0, (5_000, 4)).round(4).tolist()
    lines = (f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}"/>' for a, b, c, d in ends)
    path.write_text(f"{SVG}{''.join(lines)}</svg>")
    with pytest.raises(BadInputError, match=r"5\d\d\d segments with over .*rarely cross"):
        import_map(path, options)


def test_lines_that_all_meet_are_refused(tmp_path):
    path = tmp_path / "m.svg"
    lines = (f'<line x1="150" y1="100" x2="{x / 50}" y2="1"/>' for x in range(5_000))
    path.write_text(f"{SVG}{''.join(lines)}</svg>")
    with pytest.raises(BadInputError, match=r"pairs of ends within .* few meet"):
        import_map(path, ImportOptions())


@pytest.mark.parametrize("fill", ["none", "red"])
def test_thousands_of_outlines_in_each_other_are_refused(tmp_path, fill):
    path = tmp_path / "m.svg"
    rings = (f'<circle cx="150" cy="100" r="{1 + 0.04 * k}"/>' for k in range(2_000))
    path.write_text(f'{SVG}<g fill="{fill}">{"".join(rings)}</g></svg>')
    with pytest.raises(BadInputError, match=r"2000 outlines, over \d+ pairs overlap.*leave out"):
        import_map(path, ImportOptions())
