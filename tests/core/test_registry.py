from importlib.metadata import EntryPoint

import pytest

from vinefab.core import registry as module
from vinefab.core.errors import BrokenPluginError, UnknownNameError, VinefabError
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
        EntryPoint("twice", "math:pi", "vinefab.shades"),
        EntryPoint("twice", "math:e", "vinefab.shades"),
    ]
    monkeypatch.setattr(module, "entry_points", lambda group: offered if group else [])
    shades = Registry("shade", {"dark": 1}, group="vinefab.shades")
    assert len(shades) == 1
    assert shades["tau"] == 6.283185307179586
    assert dict(shades) == {"dark": 1, "tau": 6.283185307179586}
    assert "no_such_module_here" in shades.broken["broken"]
    assert "taken" in shades.broken["dark"]
    assert "twice" not in shades
    assert all(value in shades.broken["twice"] for value in ("math:pi", "math:e"))
    with pytest.raises(UnknownNameError, match=r"shade 'broken' does not load \(ModuleNotFound"):
        shades["broken"]


BREAKDOWNS = {
    "raise RuntimeError('a b' * 9000)": "RuntimeError",
    "def f(): f()\nf()": "RecursionError",
    "import sys\nsys.exit(0)": "SystemExit",
    "raise BaseException": "BaseException",
    "raise GeneratorExit": "GeneratorExit",
    "raise OSError(2, 'gone')": "[Errno 2] gone",
    "class E(Exception):\n    def __str__(self): raise E\nraise E": "E: <exception str() failed>",
}


@pytest.mark.parametrize("source", BREAKDOWNS)
def test_a_plugin_that_breaks_down_is_one_line_each_time(source, tmp_path, monkeypatch):
    (tmp_path / "their_shades.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    offered = [
        EntryPoint("tau", "math:tau", "vinefab.shades"),
        EntryPoint("wild", "their_shades:X", "vinefab.shades"),
    ]
    monkeypatch.setattr(module, "entry_points", lambda group: offered if group else [])
    shades = Registry("shade", {"dark": 1}, group="vinefab.shades")
    for name in ("tau", "wild", "tau"):
        with pytest.raises(BrokenPluginError) as raised:
            shades[name]
        assert isinstance(raised.value, VinefabError)
        words = str(raised.value)
        assert "'wild' (vinefab.shades: their_shades:X)" in words
        assert BREAKDOWNS[source] in words
        assert len(words) < 400
    assert shades["dark"] == 1


def test_the_users_interrupt_stays_one_and_prints_go_to_stderr(tmp_path, monkeypatch, capsys):
    (tmp_path / "their_slow.py").write_text("print('hello')\nraise KeyboardInterrupt")
    monkeypatch.syspath_prepend(tmp_path)
    offered = [EntryPoint("slow", "their_slow:X", "vinefab.shades")]
    monkeypatch.setattr(module, "entry_points", lambda group: offered if group else [])
    with pytest.raises(KeyboardInterrupt):
        Registry("shade", {}, group="vinefab.shades").load_plugins()
    assert capsys.readouterr() == ("", "hello\n")
