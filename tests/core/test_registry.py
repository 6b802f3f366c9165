from importlib.metadata import EntryPoint

import pytest

from vinefab.core import registry as module
from vinefab.core.errors import UnknownNameError
from vinefab.core.registry import Registry


def test_unknown_name_is_refused_with_the_kind_and_what_there_is():
    shades = Registry("shade", {"dark": 1})
    with pytest.raises(UnknownNameError, match="no shade is called 'drak'; did you mean 'dark'"):
        shades["drak"]
    assert "drak" not in shades


def test_plugins_are_added_and_a_broken_one_is_kept_as_words(monkeypatch):
    offered = [
        EntryPoint("tau", "math:tau", "vinefab.shades"),
        EntryPoint("broken", "no_such_module_here:thing", "vinefab.shades"),
        EntryPoint("dark", "math:pi", "vinefab.shades"),
    ]
    monkeypatch.setattr(module, "entry_points", lambda group: offered if group else [])
    shades = Registry("shade", {"dark": 1}, group="vinefab.shades")
    assert len(shades) == 1
    assert shades["tau"] == 6.283185307179586
    assert dict(shades) == {"dark": 1, "tau": 6.283185307179586}
    assert "no_such_module_here" in shades.broken["broken"]
    assert "taken" in shades.broken["dark"]
    with pytest.raises(UnknownNameError, match=r"shade 'broken' does not load \(ModuleNotFound"):
        shades["broken"]
