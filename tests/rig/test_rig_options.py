import math

import pytest

from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.model.files.shipped import locate, names
from vinefab.rig.part import RigOptions, read_printer


@pytest.fixture
def edited(tmp_path):
    """Makes a copy of a shipped profile with some text replaced."""

    def edit(old, new):
        text = locate("printer", "generic_220").read_text()
        assert old in text
        path = tmp_path / "mine.toml"
        path.write_text(text.replace(old, new, 1))
        return path

    return edit


@pytest.mark.parametrize("name", names("printer"))
def test_every_shipped_printer_can_be_read(name):
    printer = read_printer(name)
    assert printer.name == name
    assert printer.least_wall_mm >= printer.nozzle_mm
    assert printer.bed_width_mm > 100


def test_a_copy_of_ones_own(edited):
    printer = read_printer(edited("value = 220.0", "value = 305"))
    assert (printer.name, printer.bed_width_mm) == ("mine", 305.0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("bed_width_mm", "bed_width_cm", r"bed_width_cm: .* did you mean 'bed_width_mm'"),
        ("value = 0.4, ", "", r"nozzle_mm.value is missing"),
        ("value = 220.0", "value = -220.0", r"bed_width_mm is -220"),
        ('"assumed"', '"guessed"', r"bed_width_mm.standing is 'guessed'; allowed: 'measured'"),
        ("printer-1", "printer-2", r"schema is 'vinefab/printer-2'"),
        ("height_mm", "height", r"height: .* did you mean 'height_mm'"),
    ],
)
def test_what_cannot_be_used_is_named_with_its_file(edited, old, new, message):
    path = edited(old, new)
    with pytest.raises(BadInputError, match=message) as caught:
        read_printer(path)
    assert str(path) in str(caught.value)


def test_unknown_name_and_missing_file(tmp_path):
    with pytest.raises(UnknownNameError, match="generic_220"):
        read_printer("generic_20")
    with pytest.raises(UnreadableFileError):
        read_printer(tmp_path / "none.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("schema = ")
    with pytest.raises(UnreadableFileError, match="not TOML"):
        read_printer(broken)


@pytest.mark.parametrize(
    ("value", "fields"),
    [
        *((value, RigOptions.model_fields) for value in (1e300, -1e300, math.nan)),
        (0.0, ("plate_mm", "height_mm", "border_mm", "scale", "peg_mm", "most_parts")),
    ],
)
def test_no_size_of_a_rig_may_be_anything(value, fields):
    for name in fields:
        with pytest.raises(BadInputError, match=f"^{name} is"):
            RigOptions(**{name: value})
