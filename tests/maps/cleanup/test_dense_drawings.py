"""Drawings so dense that comparing or cutting their lines takes minutes: the limits end it."""

import numpy as np
import pytest

from vinefab.core import bounded
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map

ROOM = "room,0,0\nroom,300,0\nroom,300,200\nroom,0,200\n"
WAYS = np.arange(20_000)
TANGLED = {
    "at random": np.random.default_rng(1).uniform(10.0, 190.0, (20_000, 2)),
    "over itself": np.column_stack([50 + WAYS % 7, 50 + WAYS % 11]),
    "star": 100.0 + 80.0 * np.column_stack([np.cos(2.4 * WAYS), np.sin(2.4 * WAYS)]),
}
ENDS = np.random.default_rng(2).uniform(10.0, 190.0, (5_000, 4)).round(4).tolist()
CROSSING = "".join(f'<line x1="{a}" y1="{b}" x2="{c}" y2="{d}"/>' for a, b, c, d in ENDS)
MEETING = "".join(
    f'<line x1="150" y1="100" x2="{x / 50}" y2="{1 + y}"/>' for x in range(5_000) for y in range(2)
)
NESTED = "".join(f'<circle cx="150" cy="100" r="{1 + 0.04 * k}"/>' for k in range(2_000))


@pytest.mark.parametrize("kind", TANGLED)
def test_an_outline_that_crosses_itself_everywhere_is_refused(tmp_path, kind):
    path = tmp_path / "m.csv"
    path.write_text(ROOM + "".join(f"q,{x},{y}\n" for x, y in TANGLED[kind].tolist()))
    with pytest.raises(BadInputError, match=r"m.csv: polygon q .*walls across.*clean the drawing"):
        import_map(path, ImportOptions())


OTHERS = {"meeting": MEETING, "nested": NESTED, "nested lines": f'<g fill="none">{NESTED}</g>'}


@pytest.mark.parametrize(
    "body",
    [
        pytest.param(CROSSING, id="crossing"),
        *(pytest.param(OTHERS[kind], id=kind, marks=pytest.mark.thorough) for kind in OTHERS),
    ],
)
def test_lines_that_cross_or_meet_everywhere_and_outlines_in_each_other(tmp_path, limits, body):
    limits.setattr(bounded, "_CPU_S", 1)
    limits.setattr(bounded, "_CPU_S_PER_MB", 0)
    path = tmp_path / "m.svg"
    path.write_text(
        f'<svg stroke="red" viewBox="0 0 300 200"><rect width="300" height="200"/>{body}</svg>'
    )
    with pytest.raises(UnreadableFileError, match=r"m\.svg: cannot be read within 1 s and 1"):
        import_map(path, ImportOptions())
