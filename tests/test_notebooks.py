"""The notebooks that ship: each runs in this process, and every cell shows something."""

import ast
import json
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import pandas as pd
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import vinefab as vf
from vinefab.model.files.starters import shipped_examples

ROOT = Path(__file__).resolve().parent.parent
STUDIES = sorted({path.stem for path in (ROOT / "docs" / "studies").glob("*.md")} - {"index"})


def cells_of(place):
    notebook = json.loads((ROOT / "examples" / place).read_text(encoding="utf-8"))
    names = [cell["id"] for cell in notebook["cells"]]
    assert len(set(names)) == len(names)
    return notebook["cells"]


def shown_by(place):
    """Run a notebook and return the value at the end of each of its cells."""
    names: dict[str, object] = {}
    shown = []
    for cell in cells_of(place):
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == []  # what was computed once may be out of date
        tree = ast.parse("".join(cell["source"]))
        last = tree.body.pop()
        exec(compile(tree, "cell", "exec"), names)  # noqa: S102  it is ours
        assert isinstance(last, ast.Expr), "a cell ends with what it shows"
        shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))  # noqa: S307
    return shown


@pytest.fixture(autouse=True)
def no_window(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("Agg")
    yield
    plt.close("all")


def test_the_first_robot_is_found_too_narrow_and_written():
    shown = [
        (type(value).__name__, (getattr(value, "_repr_svg_", None) or value._repr_html_)())
        for value in shown_by("first_robot.ipynb")
    ]
    kinds = [name for name, _ in shown]
    assert kinds == ["Map", "Design", "Deployment", "Score", *["CheckReport"] * 2, "WrittenFolder"]
    texts = dict(shown)
    assert "(simulated)" in texts["Score"]
    assert "VF-W01" in texts["CheckReport"], "the narrow level is found"
    assert "outline.dxf" in texts["WrittenFolder"]
    assert all(text.startswith("<") for _, text in shown)


def far_from_head_on_robots_see_less(table):
    mean = table["mean"]
    return mean[1] > 1.2 * mean[15] > 1.2 * mean[30]


def most_workers_for_few_designs_are_worth_nothing(table):
    few, many = table.iloc[:, 0], table.iloc[:, 2]
    return few.loc[256] < few.max() and (few <= table.index + 1e-9).all() and many[16] > few[16]


TRUE_OF = {
    "accuracy": lambda table: (
        table.loc["count", "off by"] == 20 and table["off by"].abs()[["min", "max"]].max() < 0.003
    ),
    "cluster": most_workers_for_few_designs_are_worth_nothing,
    "contact": far_from_head_on_robots_see_less,
    "free_trees": lambda table: (
        [*table.index] == ["grid_explorer", "grid_explorer_levels"]
        and table.loc["grid_explorer"].iloc[0] > table.loc["grid_explorer_levels"].iloc[0]
    ),
    "knee": lambda table: table.sum(axis=1).tolist() == [15] * 4 and table["corner"].sum() > 0,
    "optimizers": lambda table: (
        [*table.index] == ["cmaes", "particleswarm", "random"]
        and table["unseen.mean"].between(table["unseen.low"], table["unseen.high"]).all()
    ),
    "paper": lambda table: len(table) == 5 and set(table["kind"]) == {"of the paper"},
    "pieces": lambda table: len(table) == 2 and (table > 0.0).to_numpy().all(),
    "price": lambda table: (
        [*table.index] == ["free", "flat"]
        and table.loc["free", "unseen.mean"] > table.loc["flat", "unseen.mean"]
    ),
    "speed": lambda table: (
        table["branches"].iloc[[0, -1]].tolist() == [1, 33] and (table["ms"] > 0.0).all()
    ),
}
"""What the table of a study's notebook must show; by studies of `docs/studies`."""


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_has_a_notebook_with_its_table_and_its_chart(name):
    place = f"notebooks/{name}.ipynb"
    assert place in shipped_examples()
    text = "".join("".join(cell["source"]) for cell in cells_of(place))
    assert f"](../../docs/studies/{name}.md)" in text
    assert "## The full run" in text
    shown = shown_by(place)
    (table,) = (value for value in shown if isinstance(value, pd.DataFrame))
    assert TRUE_OF[name](table), table
    charts = [value for value in shown if isinstance(value, Axes)]
    assert charts
    assert all(axes.has_data() for axes in charts)


def test_what_users_named_is_text_in_a_notebook():
    world = replace(vf.maps.pegs(seed=1), name="<script>x</script>")
    shown = vf.score("plain_vine", "coverage", maps=[world], poses=1)._repr_html_()
    assert "<script>" not in shown
    assert "&lt;script&gt;" in shown
