"""Declared tables: made in Python, read from files, described to pages and sliders."""

from typing import Annotated, Literal

import numpy as np
import pytest
from annotated_types import Ge, Interval, Le, Unit
from pydantic import Field, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.table import Slider, Table, declared_keys, validated


class Branch(Table):
    length_mm: Annotated[
        float, Ge(1), Le(100), Unit("mm"), Slider(1, 50), Field(alias="length"), Doc("Its length.")
    ]
    tip_mm: Annotated[float | None, Interval(ge=0, le=9), Unit("mm"), Doc("Its tip.")] = None

    @model_validator(mode="after")
    def _tip_fits(self):
        if self.tip_mm is not None and self.tip_mm > self.length_mm:
            raise BadInputError("tip_mm", self.tip_mm, f"at most length, {self.length_mm:g}")
        return self


class Tree(Table):
    schema_: Annotated[Literal["vinefab/tree-1"], Field(alias="schema")] = "vinefab/tree-1"
    name: Annotated[str, Doc("Its name.")]
    branch: Annotated[tuple[Branch, ...], Field(strict=False), Doc("Its branches.")] = ()


SCHEMA = {"schema": "vinefab/tree-1"}


def test_a_table_is_the_same_from_python_and_from_a_file():
    read = validated(Tree, SCHEMA | {"name": "a", "branch": [{"length": 3, "tip_mm": 1.0}]})
    made = Tree(name="a", branch=[Branch(length_mm=np.int64(3), tip_mm=np.float64(1.0))])
    assert read == made
    assert hash(read) == hash(made)
    assert type(made.branch[0].length_mm) is float
    with pytest.raises(ValueError, match="frozen"):
        made.name = "b"
    assert made.changed(name="b") == Tree(name="b", branch=made.branch)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ({}, "f.toml: name is missing; give it"),
        ({"name": 3}, "f.toml: name is 3; allowed: a valid string"),
        ({"name": "a", "brnch": []}, "brnch: there is no such key; did you mean 'branch'?"),
        ({"name": "a", "branch": [{"length": 0}]}, "branch[1].length is 0; allowed: greater than"),
        (
            {"name": "a", "branch": [{"length_mm": 3}]},
            "branch[1].length_mm: there is no such key; did you mean 'length'?",
        ),
        ({"name": "a", "branch": [{"length": float("nan")}]}, "branch[1].length is nan; allowed: "),
        (
            {"name": "a", "branch": [{"length": 2, "tip_mm": 3}]},
            "f.toml: branch[1].tip_mm is 3.0; allowed: at most length, 2",
        ),
    ],
)
def test_what_a_file_may_not_hold_is_one_line_with_its_key(content, line):
    with pytest.raises(BadInputError) as error:
        validated(Tree, SCHEMA | content, "f.toml")
    assert line in str(error.value)
    assert "\n" not in str(error.value)


def test_what_python_may_not_give_is_the_same_line():
    with pytest.raises(BadInputError, match=r"length_mm is 0; allowed: greater than or equal to 1"):
        Branch(length_mm=0)
    with pytest.raises(BadInputError, match=r"^tip_mm is 3.0; allowed: at most length, 2$"):
        Branch(length_mm=2, tip_mm=3)
    tree = Tree(name="a")
    with pytest.raises(BadInputError, match=r"name is 3"):
        tree.changed(name=3)


def test_a_file_must_say_its_kind():
    with pytest.raises(
        BadInputError, match=r"f: schema is missing; give schema = 'vinefab/tree-1'"
    ):
        validated(Tree, {"name": "a"}, "f")
    assert next(declared_keys(Tree)).required


class Amount(Table):
    value: float

    def __ge__(self, least):
        return self.value >= least

    def __le__(self, most):
        return self.value <= most


class Dose(Table):
    salt: Annotated[Amount | None, Interval(ge=1, le=5)] = None


def test_a_range_of_inline_tables_is_that_of_their_numbers():
    assert validated(Dose, {"salt": {"value": 5.0}}).salt.value == 5.0
    with pytest.raises(BadInputError, match=r"salt.value is 9.0; allowed: less than or equal to 5"):
        validated(Dose, {"salt": {"value": 9.0}})
    with pytest.raises(BadInputError, match=r"salt.value is 0.0; allowed: greater than or equal"):
        Dose(salt=Amount(value=0.0))


def test_keys_tell_what_is_declared():
    length, tip = declared_keys(Branch)
    assert (length.name, length.field, length.unit) == ("length", "length_mm", "mm")
    assert length.limits == (Ge(1), Le(100))
    assert (length.slider, length.required) == (Slider(1, 50), True)
    assert tip.limits == (Ge(0), Le(9))
    assert (tip.meaning, tip.default, tip.required) == ("Its tip.", None, False)
