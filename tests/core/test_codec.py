"""Frozen values as JSON: fields are keys, types are the validation."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import pytest

from vinefab.core.codec import IF_KNOWN, Record, exact
from vinefab.core.statistics import MeanValue
from vinefab.model.map import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class Part(Record):
    mean: MeanValue
    poses: tuple[Pose, ...]
    terms: Mapping[str, float] = field(default_factory=dict)
    note: str = ""
    count: Annotated[int | None, IF_KNOWN] = None


PART = Part(
    mean=MeanValue(mean=0.1 + 0.2, low=math.nan, high=math.nan, over="1 map"),
    poses=(Pose(x_mm=1 / 3, y_mm=-0.0, heading_rad=1e-300),),
    terms={"area": 5e-324},
)


def test_values_read_back_to_the_bit_and_unknown_ones_are_left_out() -> None:
    # By their texts: from Python 3.13 on, a NaN makes a dataclass differ from itself.
    assert repr(Part.of_json(PART.as_json)) == repr(PART)
    assert list(PART.content) == ["mean", "poses", "terms", "note"]
    assert PART.content["mean"] == {"mean": 0.1 + 0.2, "low": None, "high": None, "over": "1 map"}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"note": 3}, "^note: Input should be a valid string"),
        ({"count": 1.5}, "^count: Input should be a valid integer"),
        ({"counts": 1}, "^counts: Unexpected keyword argument"),
        ({"poses": [{"x_mm": 1.0, "y_mm": 2.0}]}, r"^poses\[1\].heading_rad: Field required"),
        ({"terms": {"area": math.inf}}, "^terms.area: Input should be a finite number"),
        ({"mean": None}, "^mean: Input should be"),
    ],
)
def test_another_type_is_named_with_its_place(change: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Part.of_json(json.dumps(PART.content | change))


def test_text_that_is_no_json_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^Invalid JSON"):
        Part.of_json(PART.as_json[:-1])


def test_a_value_that_no_json_has_is_not_written() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        _ = Part(mean=PART.mean, poses=(), terms={"area": math.nan}).as_json


@dataclass(frozen=True, slots=True, kw_only=True)
class Found(Record):
    __pydantic_config__ = exact(infinite_as_null=True, rule="id")

    rule: str
    measured: float | None = None


def test_a_field_may_have_another_name_in_json_and_be_infinite() -> None:
    assert Found(rule="VF-C01", measured=math.inf).content == {"id": "VF-C01", "measured": None}
    assert Found.of_json('{"id": "a", "measured": 0.1}') == Found(rule="a", measured=0.1)
    with pytest.raises(ValueError, match=r"^rule: Unexpected"):
        Found.of_json('{"id": "a", "rule": "b"}')
