"""Files of 0.2.0 are read by every later version, with the same meaning (docs/files.md).

``of_0_2_0`` holds them as 0.2.0 wrote and read them, and the values in ``read.json``. Neither
changes any more; a version that gives a key another meaning gives it a new schema.
"""

import json
from dataclasses import asdict, is_dataclass
from pathlib import Path

import pytest

import vinefab as vf
from vinefab.core.table import Table
from vinefab.model.contacts import read_contacts
from vinefab.model.laser import read_machine, read_material, read_profile
from vinefab.rig.part import read_printer

HERE = Path(__file__).with_name("of_0_2_0")
READERS = {
    "design.toml": vf.Design.read,
    "pieces.toml": vf.Design.read,
    "run.toml": vf.RunSettings.read,
    "front.toml": vf.RunSettings.read,
    "co2_60w.toml": read_machine,
    "stretchlon_200.toml": read_material,
    "co2_60w__stretchlon_200.toml": lambda path: read_profile(path).recipe,
    "generic_220.toml": read_printer,
    "contacts.toml": read_contacts,
}
READ = HERE / "read.json"


def plain(noun):
    """Return what was read as JSON has it."""
    if isinstance(noun, Table):
        noun = noun.model_dump(by_alias=True, warnings=False)
    elif is_dataclass(noun):
        noun = asdict(noun)
    return json.loads(json.dumps(noun, default=lambda one: getattr(one, "value", str(one))))


def changed(before, now, where=""):
    """Yield the keys that are gone or say something else; new ones may come."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key, value in before.items():
            yield from changed(value, now.get(key, "no such key"), f"{where}.{key}")
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for number, pair in enumerate(zip(before, now, strict=True)):
            yield from changed(*pair, f"{where}[{number}]")
    elif before != now and not (isinstance(before, float) and now == pytest.approx(before)):
        yield f"{where}: {before!r} -> {now!r}"


def test_every_file_is_listed():
    assert {path.name for path in HERE.iterdir()} == {*READERS, "map.geojson", READ.name}


@pytest.mark.parametrize("name", READERS)
def test_a_file_is_read_with_the_same_meaning(name):
    kept = json.loads(READ.read_text(encoding="utf-8"))
    assert list(changed(kept[name], plain(READERS[name](HERE / name)), name)) == []


def test_a_map_is_read_with_the_same_meaning():
    world = vf.Map.read(HERE / "map.geojson")
    kept = json.loads((HERE / "map.geojson").read_text(encoding="utf-8"))
    roles = [feature["properties"]["role"] for feature in kept["features"]]
    assert world.bounds.bounds == (0.0, 0.0, 500.0, 500.0)
    assert len(world.obstacles) == roles.count("obstacle") > 0
    assert len(world.starts) == roles.count("start") > 0
    assert len(world.targets) == roles.count("target") > 0


def test_a_change_is_found():
    assert list(changed({"a": [1.0], "b": 2}, {"a": [1.5], "c": 3})) == [
        ".a[0]: 1.0 -> 1.5",
        ".b: 2 -> 'no such key'",
    ]
