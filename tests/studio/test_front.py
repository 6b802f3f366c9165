"""The robot at a length of its front is the one that the simulator grows so far."""

import json
import math
import re

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_content
from vinefab.prediction.deploy import deploy
from vinefab.studio.live_answers import front_answer
from vinefab.studio.state import StudioState

DESIGN = Design.read("grid_explorer")
MAP = {"source": {"environment": "cave", "seed": 1}, "edits": []}


@pytest.fixture(scope="module")
def state():
    content = json.loads(json.dumps(design_content(DESIGN)))
    return StudioState.of({"design": content, "map": MAP})


def chains(text):
    """Return the points of every centreline, by branch."""
    lines = "".join(re.findall(r'<g class="line">(.*?)</g>', text))
    found = re.findall(r'data-branch="([\d.]+)"[^>]* d="M([^"]*)"', lines)
    return {name: np.array(re.findall(r"-?[\d.]+", path), float) for name, path in found}


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 1.0, 2.0])
def test_the_shape_is_that_of_the_history(state, share):
    history = deploy(DESIGN, state.world, state.start, state.growth.content).history
    answer = front_answer(state, {"front_mm": share * history.full_mm}, print)
    frame = history.at(share * history.full_mm)
    shown = chains(answer["robot_svg"])
    assert answer["front_mm"] == pytest.approx(min(1.0, share) * history.full_mm)
    assert answer["full_mm"] == history.full_mm
    out = [name for name, is_out in zip(frame.deployment.tree.ids, frame.deployment.deployed,
                                        strict=True) if is_out]  # fmt: skip
    assert sorted(shown) == sorted(out)
    for branch, name in enumerate(frame.deployment.tree.ids):
        if name in shown:
            wanted = (frame.deployment.chain_mm(branch) * [1.0, -1.0]).ravel()
            assert shown[name] == pytest.approx(wanted, abs=1e-3)
    assert answer["robot_svg"].count('class="mark') == len(out) - int(
        (frame.is_growing & frame.deployment.deployed).sum()
    )


@pytest.mark.parametrize("front_mm", [None, 0, -3.0, math.nan, "far", [1.0]])
def test_a_length_that_is_none_is_refused_by_name(state, front_mm):
    with pytest.raises(BadInputError, match="front_mm"):
        front_answer(state, {"front_mm": front_mm}, print)
