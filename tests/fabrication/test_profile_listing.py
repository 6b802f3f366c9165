import pytest

from vinefab.core.errors import UnknownNameError, UnreadableFileError
from vinefab.fabrication.profile_listing import (
    PROFILE_KINDS,
    ProfileListing,
    ProfileNumbers,
    kind_of,
)
from vinefab.model.files.shipped import USER_VARIABLE, names, shipped_root
from vinefab.model.laser import read_material, read_profile

RECIPE = "co2_60w__stretchlon_200"


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A user's folder with a film of their own and a recipe that shadows a shipped one."""
    monkeypatch.setenv(USER_VARIABLE, str(tmp_path))
    for kind in ("materials", "recipes"):
        (tmp_path / "laser_profiles" / kind).mkdir(parents=True)
    film = (shipped_root() / "laser_profiles/materials/stretchlon_200.toml").read_text()
    film = film.replace('name = "stretchlon_200"', 'name = "my_film"').replace("0.0375,", "0.03,")
    (tmp_path / "laser_profiles/materials/my_film.toml").write_text(film)
    recipe = (shipped_root() / f"laser_profiles/recipes/{RECIPE}.toml").read_text()
    recipe = recipe.replace('material = "stretchlon_200"', 'material = "my_film"')
    (tmp_path / f"laser_profiles/recipes/{RECIPE}.toml").write_text(recipe)
    return tmp_path


def test_everything_that_is_shipped_is_listed(tmp_path, monkeypatch):
    monkeypatch.setenv(USER_VARIABLE, str(tmp_path))
    text = "\n".join(ProfileListing().summary)
    for kind in PROFILE_KINDS:
        assert all(f"  {name} " in text for name in names(kind))
    assert "[unverified]" in text
    assert str(tmp_path) in text


@pytest.mark.parametrize("name", [name for kind in PROFILE_KINDS for name in names(kind)])
def test_every_number_of_every_profile_is_explained_with_its_standing(name):
    lines = ProfileNumbers(name=name).summary
    numbers = ProfileNumbers(name=name).numbers["numbers"]
    head = [line for line in lines if not line.startswith("  ")]
    assert [line.split(":")[0] for line in head[2:]] in ([], ["machine", "material"])
    for line, (key, number) in zip(lines[len(head) :], numbers.items(), strict=True):
        assert key in line
        assert line.split(number["standing"], 1)[1].strip() == number["source"]
        assert number["source"]


def test_line_energy_is_worked_out_for_the_laser_and_not_for_the_sealer():
    laser = ProfileNumbers(name=RECIPE).numbers["numbers"]
    # 60 W x 12 % at 60 mm/s.
    assert laser["weldcut.line_energy_mj_mm"]["value"] == pytest.approx(120.0)
    sealed = ProfileNumbers(name="co2_60w__tpu_nylon_70d").numbers["numbers"]
    assert [key for key in sealed if key.startswith("weld.")] == [
        "weld.temperature_c",
        "weld.dwell_s",
        "weld.seam_width_mm",
        "weld.pin_mm",
    ]


def test_the_users_own_files_come_first(own_folder):
    assert read_material("my_film").ply_mm.value == 0.03
    assert read_profile(RECIPE).material.name == "my_film"
    text = "\n".join(ProfileListing().summary)
    yours = [line.split()[0] for line in text.splitlines() if line.endswith("yours")]
    assert yours == ["my_film", RECIPE]
    assert ProfileListing().numbers["user_folder"] == str(own_folder)


def test_the_kind_of_a_file_follows_from_what_it_says(tmp_path):
    folder = shipped_root() / "laser_profiles"
    assert kind_of(str(folder / "machines/co2_60w.toml")) == "machine"
    assert kind_of(str(folder / f"recipes/{RECIPE}.toml")) == "recipe"
    moved = tmp_path / "machines.toml"
    moved.write_text((folder / "materials/stretchlon_200.toml").read_text())
    assert kind_of(str(moved)) == "material"
    with pytest.raises(UnreadableFileError, match="there is no such file"):
        kind_of(str(tmp_path / "film.toml"))


def test_an_unknown_profile_offers_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'stretchlon_800'"):
        kind_of("stretchlon_80")
