import pytest

from vinefab.core.errors import (
    BadInputError,
    UnknownNameError,
    UnreadableFileError,
    VinefabError,
    located,
)


def test_bad_input_says_file_key_value_and_what_is_allowed():
    error = BadInputError("level[1].branches", -3, "a whole number from 1 to 1000").at("tree.toml")
    assert str(error) == (
        "tree.toml: level[1].branches is -3; allowed: a whole number from 1 to 1000"
    )
    assert (error.source, error.key, error.value) == ("tree.toml", "level[1].branches", -3)


def test_bad_input_keeps_to_one_short_line():
    text = str(BadInputError("key", "line\nbreak " + "x" * 500, "less"))
    assert "\n" not in text
    assert len(text) < 100


@pytest.mark.parametrize(
    "error",
    [
        BadInputError("k" * 10_000, 1, "less"),
        UnknownNameError("key", "k" * 10_000, ["colour"]),
        UnreadableFileError("a.svg", "<g>" * 10_000),
    ],
)
def test_long_names_are_shortened(error):
    assert len(str(error)) < 1_100


def test_missing_value_is_called_missing():
    assert str(BadInputError("trunk", None, "a table")) == "trunk is missing; give a table"


def test_unknown_name_offers_the_nearest_spelling():
    error = UnknownNameError("design", "plain_vin", ["plain_vine", "tree"])
    assert "did you mean 'plain_vine'?" in str(error)
    assert "plain_vine, tree" in str(error)


@pytest.mark.parametrize(
    "error", [BadInputError("length", 3, "less"), UnknownNameError("task", "reech", ["reach"])]
)
def test_a_block_names_its_file_unless_the_error_comes_from_another(error):
    with pytest.raises(VinefabError, match=r"^run\.toml: "), located("run.toml"):
        raise error
    with pytest.raises(VinefabError, match=r"^map\.geojson: "), located("run.toml"):
        raise error.at("map.geojson")
