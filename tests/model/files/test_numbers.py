"""Numbers that nobody means, for every key of every kind of file that is declared to be one."""

import math
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tomli_w

import vinefab
from vinefab.core.errors import VinefabError
from vinefab.model.contacts import ContactsFile, read_contacts
from vinefab.model.design import Design
from vinefab.model.files.shipped import shipped_root
from vinefab.model.laser import Material, Recipe, read_machine, read_material, read_profile
from vinefab.model.machine import LaserMachine
from vinefab.rig.part import PrinterForm, read_printer
from vinefab.search.settings import RunFile, read_run

HUGE = (1e300, -1e300)
"""What no number may be: each field declares its limits."""
NEVER = (math.nan, math.inf, 10**30, 10**400, True)
"""What no field has to refuse: all tables do."""
TINY = (1e-300, -0.0)
"""Allowed where zero is."""
FILES = {
    "designs/three_level_tree.toml": (Design, Design.read),
    "examples/grid_coverage.toml": (RunFile, read_run),
    "laser_profiles/recipes/co2_60w__stretchlon_200.toml": (Recipe, read_profile),
    "laser_profiles/machines/co2_60w.toml": (LaserMachine, read_machine),
    "laser_profiles/materials/stretchlon_200.toml": (Material, read_material),
    "laser_profiles/printers/generic_220.toml": (PrinterForm, read_printer),
    "contacts": (ContactsFile, read_contacts),
}
Schema = dict[str, Any]
Path_ = tuple[str | int, ...]


class Declared:
    """The keys that a form declares, as its JSON schema has them."""

    def __init__(self, schema: Schema) -> None:
        self.schema, self.parts = schema, schema.get("$defs", {})

    def resolved(self, schema: Schema) -> Schema:
        return self.parts[schema["$ref"].split("/")[-1]] if "$ref" in schema else schema

    def numbers(self, schema: Schema, path: Path_ = ()) -> Iterator[Path_]:
        """Yield the place of every number."""
        schema = self.resolved(schema)
        for one in schema.get("anyOf", schema.get("oneOf", ())):
            yield from self.numbers(one, path)
        if schema.get("type") in ("number", "integer"):
            yield path
        if "items" in schema:
            yield from self.numbers(schema["items"], (*path, 0))
        for name, inner in schema.get("properties", {}).items():
            if name != "method":  # words for readers
                yield from self.numbers(inner, (*path, name))

    def example(self, schema: Schema) -> Any:
        """Return the least that a key may hold."""
        schema = self.resolved(schema)
        if choices := schema.get("anyOf", schema.get("oneOf")):
            return self.example(choices[0])
        if "const" in schema or "enum" in schema:
            return schema.get("const", schema.get("enum", [None])[0])
        if schema.get("type") == "object":
            names = schema.get("required", ())
            return {name: self.example(schema["properties"][name]) for name in names}
        if schema.get("type") == "array":
            return [self.example(schema["items"])] * max(1, schema.get("minItems", 1))
        return {"number": 1.0, "integer": 1, "string": "x", "boolean": True}[schema["type"]]

    def put(self, content: Any, schema: Schema, path: Path_, value: object) -> Any:
        """Return content with another value at a place, and with what that needs around it."""
        schema = self.resolved(schema)
        if not path:
            return value
        for one in schema.get("anyOf", schema.get("oneOf", ())):
            if path in self.numbers(one):
                return self.put(content, one, path, value)
        first, *rest = path
        if first == 0:
            items = content if isinstance(content, list) and content else self.example(schema)
            return [self.put(items[0], schema["items"], tuple(rest), value), *items[1:]]
        table = content if isinstance(content, dict) else self.example(schema)
        inner = schema["properties"][first]
        return {**table, first: self.put(table.get(first), inner, tuple(rest), value)}


@pytest.mark.parametrize("name", FILES)
def test_numbers_that_nobody_means_are_refused_with_file_and_key(name: str, tmp_path: Path) -> None:
    form, read = FILES[name]
    for shipped in (shipped_root() / "laser_profiles").glob("m*/*.toml"):
        shutil.copy(shipped, tmp_path)
    declared = Declared(form.model_json_schema(by_alias=True))
    path, content = tmp_path / "mine.toml", {"schema": "vinefab/contacts-1"}
    if name != "contacts":
        path = tmp_path / Path(name).name
        content = tomllib.loads((shipped_root() / name).read_text())
    places = list(dict.fromkeys(declared.numbers(declared.schema)))
    assert len(places) >= 8
    for count, place in enumerate(places):
        for value in (*HUGE, NEVER[count % len(NEVER)], TINY[count % len(TINY)]):
            path.write_text(tomli_w.dumps(declared.put(content, declared.schema, place, value)))
            try:
                read(path)
            except VinefabError as error:
                keys = [key for key in place if isinstance(key, str)][-2:]
                words = str(error)
                assert str(path) in words, (place, value)
                # One key may be refused because of another beside it.
                assert any(key in words for key in (*keys, str(place[0]))), (place, words)
            else:
                assert value in TINY, (place, value)


@pytest.mark.parametrize("width_mm", [1e-300, 0.9e-6, 1e-6, 1e4])
def test_a_width_is_refused_by_its_reader_or_checked(width_mm: float, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    content = tomllib.loads((shipped_root() / "designs/plain_vine.toml").read_text())
    content["build"]["widths_mm"] = [width_mm]
    path.write_text(tomli_w.dumps(content))
    if width_mm < 1e-6:
        with pytest.raises(VinefabError, match=r"mine\.toml: build\.widths_mm"):
            Design.read(path)
    else:
        assert vinefab.check(path).blocking


def test_a_bed_without_room_inside_its_margin_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "co2_60w.toml"
    content = tomllib.loads((shipped_root() / "laser_profiles/machines/co2_60w.toml").read_text())
    content["bed_width_mm"]["value"] = 2.0 * content["margin_mm"]["value"]
    path.write_text(tomli_w.dumps(content))
    with pytest.raises(VinefabError, match=r"co2_60w\.toml: margin_mm"):
        read_machine(path)
