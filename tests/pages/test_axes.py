"""Nouns and results on axes of Matplotlib: shapes, places and colours as in our pictures."""

import json

import matplotlib as mpl
import numpy as np
import pytest
import shapely
from matplotlib import pyplot
from matplotlib.colors import to_hex
from matplotlib.patches import PathPatch

import vinefab as vf
from vinefab.core.errors import BadInputError, MissingPackageError
from vinefab.pages.axes import plot_panel
from vinefab.pages.panel import ROCK, Ink, Panel, level_colour


@pytest.fixture(autouse=True)
def closed():
    """No window opens, and no figure is left behind."""
    with mpl.rc_context({"backend": "agg"}):
        yield
        pyplot.close("all")


@pytest.fixture(scope="module")
def world():
    return vf.maps.grid(seed=1, size_mm=300.0, columns=3, rows=3)


def filled(ax, colour):
    """The area that patches of a colour cover."""
    rings = [
        shapely.polygons(ring)
        for patch in ax.patches
        if isinstance(patch, PathPatch) and to_hex(patch.get_facecolor()) == colour
        for ring in patch.get_path().to_polygons()
    ]
    return shapely.union_all(rings)


def lines_in(ax, colour):
    return [
        points
        for patch in ax.patches
        if patch.get_facecolor()[3] == 0.0 and to_hex(patch.get_edgecolor()) == colour
        for points in patch.get_path().to_polygons(closed_only=False)
    ]


def test_a_map_lies_on_axes_in_its_own_millimetres(world):
    ax = world.plot()
    obstacles = shapely.union_all(list(world.obstacles))
    assert filled(ax, ROCK).symmetric_difference(obstacles).area < 1e-3 * obstacles.area
    assert ax.get_aspect() == 1.0
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    assert shapely.box(x0, y0, x1, y1).covers(world.bounds)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (mm)", "y (mm)")


def test_a_deployment_has_its_centre_lines_in_the_colours_of_their_levels(world):
    grown = vf.Design.read("three_level_tree").grow(world)
    _, mine = pyplot.subplots()
    ax = grown.plot(mine)
    assert ax is mine
    for branch in np.flatnonzero(grown.deployed):
        chain = grown.chain_mm(branch)
        drawn = lines_in(ax, level_colour(int(grown.tree.level[branch])))
        assert any(len(one) == len(chain) and np.allclose(one, chain) for one in drawn)
    words = [text.get_text() for text in ax.get_legend().get_texts()]
    assert any(text.startswith("level 1") for text in words)
    assert grown.plot(legend=False).get_legend() is None


def test_a_design_and_its_contour_are_drawn_as_they_are_cut():
    design = vf.Design.read("plain_vine")
    ax = design.plot()
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    assert x1 - x0 > design.trunk_length_mm
    assert y1 - y0 > design.build.widths_mm[0]


def test_signs_words_dashes_and_turned_axes_are_kept():
    panel = Panel(box=(0.0, 4.0, 2.0, -1.0), width_pt=100.0, height_pt=50.0, frame=True,
                  title="a", x_ticks=[(0.5, "half")])  # fmt: skip
    for sign in ("o", "X", "^", "s", "D", "+", "x"):
        panel.marks([(1.0, 1.0)], sign, 6.0, Ink(fill="#ff0000", line="#0000ff"), label=sign)
    panel.words((1.0, 2.0), "price in $", anchor="middle", halo=True, turned=True)
    panel.line([(0.0, 0.0), (1.0, 1.0)], Ink(line="#00ff00", width_pt=2.0, dash_pt=(4.0, 2.0)))
    ax = plot_panel(panel)
    assert ax.get_ylim() == (4.0, -1.0)
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["half"]
    assert len(ax.lines) == 7
    (text,) = (one for one in ax.texts if "price" in one.get_text())
    assert (text.get_rotation(), text.xy) == (90.0, (1.0, 2.0))
    (dashed,) = ax.patches
    assert (dashed.get_linewidth(), to_hex(dashed.get_edgecolor())) == (2.0, "#00ff00")
    ax.figure.canvas.draw()


# --- results


@pytest.fixture(scope="module")
def compared(world):
    return vf.compare(["plain_vine", "three_level_tree"], world, poses=2, progress=False)


def test_a_score_is_a_table_of_its_deployments(world):
    found = vf.score("plain_vine", "reach", maps=world, poses=3)
    table = found.to_pandas()
    assert table["score"].mean() == pytest.approx(found.composite["mean"])
    assert table["pose.x_mm"].tolist() == [one.pose.x_mm for one in found.evaluations]
    assert [row["score"] for row in found] == table["score"].tolist()
    json.dumps(list(found), allow_nan=False)
    ax = found.plot()
    (dots,) = ax.lines
    assert sorted(dots.get_ydata()) == pytest.approx(sorted(found.scores))


def test_a_comparison_is_a_table_of_all_deployments(compared):
    table = compared.to_pandas()
    means = table.groupby("design")["coverage_score"].mean()
    assert means.to_dict() == pytest.approx(compared.means)
    assert compared.plot().get_xlabel().startswith("difference in sensor coverage score")
    json.dumps(compared.records, allow_nan=False)


def test_what_has_no_picture_says_so_in_one_line(tmp_path):
    made = vf.new("design", tmp_path / "mine.toml")
    assert list(made) == []
    with pytest.raises(BadInputError, match="plot: a WrittenFile has no picture"):
        made.plot()


def test_results_are_taken_whole_where_several_things_may_be_given(compared, world):
    with pytest.raises(BadInputError, match="design"):
        vf.score(compared, maps=world)


def test_rules_iterate_over_their_ids_as_before():
    book = vf.rules()
    assert list(book) == list(book.keys())
    assert "VF-C01" in book


@pytest.mark.parametrize(("call", "package"), [("to_pandas", "pandas"), ("plot", "matplotlib")])
def test_a_missing_package_is_named_with_its_extra(compared, monkeypatch, call, package):
    real = __import__("importlib.util").util.find_spec
    monkeypatch.setattr(
        "vinefab.core.extras.find_spec", lambda name: None if name == package else real(name)
    )
    with pytest.raises(MissingPackageError, match=package):
        getattr(compared, call)()


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_figures_are_written_in_each_form(world, tmp_path, suffix):
    begins = {".svg": b"<?xml", ".png": b"\x89PNG", ".pdf": b"%PDF"}[suffix]
    vf.grow("plain_vine", world, svg=tmp_path / f"grown{suffix}")
    vf.maps.info(world, out=tmp_path / f"info{suffix}")
    vf.check("plain_vine", out=tmp_path / f"found{suffix}")
    world.info().write(tmp_path / f"again{suffix}")
    written = list(tmp_path.glob(f"*{suffix}"))
    assert len(written) == 4
    assert all(path.read_bytes().startswith(begins) for path in written)
