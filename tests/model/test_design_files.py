import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.core.limits import rad
from vinefab.model.design import Build, Collar, Design, Level, Pouch, Waiver, design_text
from vinefab.model.files.shipped import names

EXAMPLE = """
schema = "vinefab/design-1"
name = "six"
scale_mm_per_unit = 2.0
[trunk]
length = 120
[[level]]
branches = 3
length = 90.0
angle_deg = 100.0
growth_percent = 80.0
[build]
widths_mm = [40.0, 24.0]
fillet_mm = [6.0]
tail_mm = 250.0
pressure_kpa = 30.0
pouch = { shape = "round", radius_mm = 16.0 }
[[waive]]
fingerprint = "abc"
reason = "tested on the bench"
[limits.VF-C01]
warning = 6
[origin]
run = "r1"
"""


@pytest.fixture
def write(tmp_path):
    def write(text: str):
        path = tmp_path / "design.toml"
        path.write_text(text)
        return path

    return write


def test_every_key_arrives_and_the_scale_multiplies_lengths_only(write):
    design = Design.read(write(EXAMPLE))
    assert design.trunk_length_mm == 240.0
    assert design.levels == (Level(branches=3, length_mm=180.0, fan_rad=rad(100.0), growth=0.8),)
    assert design.build == Build(
        widths_mm=(40.0, 24.0),
        fillet_mm=(6.0,),
        tail_mm=250.0,
        pressure_kpa=30.0,
        pouch=Pouch(shape="round", radius_mm=16.0),
    )
    assert design.waivers == (Waiver(fingerprint="abc", reason="tested on the bench"),)
    assert dict(design.origin) == {"run": "r1"}
    assert {rule: dict(named) for rule, named in design.limits.items()} == {
        "VF-C01": {"warning": 6.0}
    }
    assert Design.read(write(design_text(design))).limits == design.limits


def test_a_file_without_build_gets_the_documented_defaults(write):
    text = 'schema = "vinefab/design-1"\nname = "v"\n[trunk]\nlength = 700.0\n'
    assert Design.read(write(text)).build == Build.standard(1)


def test_width_ratio_and_fillet_ratio_stand_for_lists(write):
    text = EXAMPLE.replace("widths_mm = [40.0, 24.0]", "trunk_width_mm = 30.0\nwidth_ratio = 0.5")
    text = text.replace("fillet_mm = [6.0]", "fillet_ratio = 0.4")
    build = Design.read(write(text)).build
    assert (build.widths_mm, build.fillet_mm) == ((30.0, 15.0), (6.0,))


def test_taper_and_collar_arrive_and_are_written_again(write, tmp_path):
    more = "taper = [1.0, 0.7]\ncollar = { clamp_diameter_mm = 50.0, flare_mm = 45 }\n[[waive]]"
    design = Design.read(write(EXAMPLE.replace("[[waive]]", more)))
    assert design.build.end_widths_mm == pytest.approx((40.0, 16.8))
    assert design.build.collar == Collar(clamp_diameter_mm=50.0, length_mm=30.0, flare_mm=45.0)
    assert design.build.mouth_width_mm == pytest.approx(78.54, abs=0.01)
    path = tmp_path / "again.toml"
    path.write_text(design_text(design))
    assert Design.read(path).build == design.build


BAD = {
    "taper for too few levels": ("[build]", "[build]\ntaper = [0.9]", "build.taper is [0.9]"),
    "branches that widen": ("[build]", "[build]\ntaper = [1.2, 1.0]", "build.taper[1] is 1.2"),
    "collar without clamp": ("[build]", "[build]\ncollar = {}", "collar.clamp_diameter_mm"),
    "fraction of a branch": ("branches = 3", "branches = 3.5", "level[1].branches is 3.5"),
    "infinite": ("length = 90.0", "length = inf", "level[1].length is inf"),
    "huge after scaling": ("= 2.0", "= 1e7", "allowed: 1e-06 to 1e+07 mm"),
    "too few widths": ("[40.0, 24.0]", "[40.0]", "from level 2 on, as widths_mm has 1"),
    "two ways at once": (
        "[build]",
        "[build]\nwidth_ratio = 0.5",
        "given together with build.widths_mm",
    ),
    "waiver without reason": ('"tested on the bench"', '" "', "waive[1].reason is ' '"),
    "unknown mounting": ("[build]", '[build]\nmounting = "folded"', "'tail_inverted' or 'turned'"),
    "pouch of no shape": ('"round"', '"heart"', "'round' or 'rectangle'"),
    "name as a path": ('"six"', '"../six"', "name is '../six'"),
    "fan beyond a circle": ("100.0", "400.0", "level[1].angle_deg is 400.0"),
}


@pytest.mark.parametrize(("old", "new", "words"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line_with_file_key_and_value(write, old, new, words):
    assert old in EXAMPLE
    path = write(EXAMPLE.replace(old, new, 1))
    with pytest.raises(BadInputError) as caught:
        Design.read(path)
    assert words in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_files_that_are_no_designs(tmp_path, write):
    with pytest.raises(UnreadableFileError, match="is not TOML"):
        Design.read(write("schema : design"))
    with pytest.raises(UnreadableFileError, match="there is no such file"):
        Design.read(tmp_path / "none.toml")
    with pytest.raises(UnreadableFileError, match="is a folder"):
        Design.read(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UnreadableFileError, match="not UTF-8"):
        Design.read(tmp_path / "binary.toml")
    with pytest.raises(UnknownNameError, match="no design is called 'nonesuch'"):
        Design.read("nonesuch")


levels = st.builds(
    Level.of,
    branches=st.integers(1, 4),
    length_mm=st.floats(0.1, 1000.0),
    angle_deg=st.floats(0, 360),
    growth_percent=st.floats(10, 160),
)


@given(st.lists(levels, max_size=4), st.floats(1.0, 500.0), st.none() | st.just({"seed": 3}))
def test_written_designs_read_back_the_same(tmp_path_factory, tree, trunk, origin):
    design = Design(
        name="r",
        trunk_length_mm=trunk,
        levels=tuple(tree),
        build=Build.standard(1 + len(tree)),
        origin=origin or {},
    )
    path = tmp_path_factory.mktemp("round") / "d.toml"
    path.write_text(design_text(design))
    again = Design.read(path)
    assert again == design


@pytest.mark.parametrize("name", names("design"))
def test_shipped_designs_can_be_read(name):
    assert Design.read(name).name == name
