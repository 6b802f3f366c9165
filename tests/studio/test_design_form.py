"""The rows of the page's form: what the tables of a design declare."""

from vinefab.core.table import declared_keys, inner_table
from vinefab.model.design import Design
from vinefab.studio.state import design_form


def keys_with_sliders(table, prefix=""):
    for key in declared_keys(table):
        inner = inner_table(key.annotation)
        if inner is not None:
            yield from keys_with_sliders(inner, f"{prefix}{key.name}.")
        elif key.slider is not None:
            yield f"{prefix}{key.name}"


def rows_of(rows, prefix=""):
    for row in rows:
        if "rows" in row:
            yield from rows_of(row["rows"], f"{prefix}{row['key']}.")
        elif "slider" in row:
            yield f"{prefix}{row['key']}", row


def test_every_key_with_a_slider_is_a_row_with_its_unit_range_and_meaning():
    rows = dict(rows_of(design_form()["rows"]))
    assert set(rows) == set(keys_with_sliders(Design))
    for row in rows.values():
        low, high = row["slider"]
        assert row["least"] <= low < high <= row["most"]
        assert row["about"]
    fan = rows["level.angle_deg"]
    assert (fan["label"], fan["unit"], fan["default"], fan["whole"]) == ("Fan", "°", 0.0, False)
    assert rows["build.pressure_kpa"]["label"] == "Pressure"
    assert (rows["build.taper"]["first"], rows["build.taper"]["absent"]) == (1, 1.0)
    assert rows["build.pieces.most"]["whole"]
