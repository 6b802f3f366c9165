"""The recipe of a run, written beside its winner."""

import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.files.run_context import RunRecipe


def test_a_forged_record_leaves_nothing_behind(tmp_path):
    forged = RunRecipe(name="x", digest="0", files={"recipe_of_run/a.toml": "", "../b.toml": ""})
    with pytest.raises(BadInputError, match=r"recipe\.files"):
        forged.write(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []
