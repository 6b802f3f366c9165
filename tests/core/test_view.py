"""Results as blocks: what is said once stands in every medium."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import pytest

from vinefab.core.errors import BadInputError
from vinefab.core.view import (
    Answer,
    Block,
    Data,
    Fact,
    Facts,
    Notes,
    Number,
    Origin,
    Remark,
    Result,
    Rows,
    plain_blocks,
)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Weighed(Result):
    """A small result."""

    origin: Origin | None = None
    schema: ClassVar[str] = "vinefab/weighed-1"

    def view(self) -> Iterator[Block]:
        yield Answer("It is <light>.", key="verdict")
        yield Facts((Fact("mass", Number(0.12345, "g", ".2f", standing="measured"), "mass_g"),))
        share = Number(0.5, "%", ".0f", (0.25, 0.75), per=0.01, decimals=1)
        yield Rows(
            caption="parts (simulated)",
            headings=("part", "share"),
            rows=(("film", share), ("rest", Number(float("nan")))),
            key="parts",
            keys=("name", "share.mean"),
            data=({"share.count": 3}, {}),
            most=1,
        )
        yield Remark("VF-X01  too thin", "warning", ("here",))
        yield Notes(("one thing to know",), "notes")
        yield Data({"inner.deep": 1})


def test_a_number_stands_in_every_medium():
    found = Weighed()
    assert found.summary == (
        "It is <light>.",
        "mass: 0.12 g (measured)",
        "parts (simulated):",
        "  part          share",
        "  film  50 [25, 75] %",
        "  ... and 1 more",
        "warn   VF-X01  too thin",
        "       here",
        "one thing to know",
    )
    assert repr(found) == "\n".join(["<Weighed>", *found.summary])
    notebook, page = found._repr_html_(), found.page()
    for shown in (notebook, page, json.dumps(plain_blocks(found.view()))):
        assert "0.12 g (measured)" in shown
        assert "50 [25, 75] %" in shown
    assert "It is &lt;light&gt;." in notebook
    assert ("rest" in page, "rest</td>" in notebook) == (True, False)


def test_json_holds_what_has_a_key_with_intervals_beside_their_means():
    content = Weighed().numbers
    assert content.pop("generator").startswith("written by vinefab")
    assert content == {
        "schema": "vinefab/weighed-1",
        "verdict": "It is <light>.",
        "mass_g": 0.12345,
        "parts": [
            {"name": "film", "share": {"mean": 0.5, "low": 0.2, "high": 0.8, "count": 3}},
            {"name": "rest", "share": {"mean": None}},
        ],
        "notes": ["one thing to know"],
        "inner": {"deep": 1},
    }


def test_how_to_get_a_result_again_stands_in_json_and_on_the_page():
    found = Weighed(origin=Origin(command="weigh it", inputs={"it": "1a"}, versions={"v": "2"}))
    assert found.numbers["reproduce"]["command"] == "weigh it"
    assert "<pre>weigh it</pre>" in found.page()
    assert "weigh it" not in found._repr_html_()


@pytest.mark.parametrize(
    ("number", "shown"),
    [
        (Number(1.0, interval=(float("nan"),) * 2, form="g"), "1 (no interval)"),
        (Number(None, "mm"), "-"),
        (Number(3, "%", "d"), "3 %"),
    ],
)
def test_a_number_says_what_is_not_known(number, shown):
    assert str(number) == shown


def test_a_row_has_a_cell_for_each_heading():
    with pytest.raises(BadInputError, match="1 cell per row"):
        Rows(caption="t", headings=("a",), rows=(("1", "2"),))
