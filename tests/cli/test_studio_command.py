"""`vinefab studio` says in one line what it cannot do, before anything is served."""

import json
import re
import socket

import pytest

from vinefab.cli.main import main


@pytest.fixture(autouse=True)
def never_served(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)

    def served(*_):
        pytest.fail("the server was started")

    monkeypatch.setattr("vinefab.studio.server._until_stopped", served)


def refused(capsys, *words):
    assert main(["studio", "--no-browser", *words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    return line


def test_a_missing_package_is_named_with_the_extra(capsys, monkeypatch):
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name: None if name == "uvicorn" else name
    )
    line = refused(capsys)
    assert "without uvicorn" in line
    assert "vinefab[studio]" in line


def test_what_cannot_be_opened_is_one_line(capsys, tmp_path):
    (tmp_path / "broken.toml").write_text('schema = "vinefab/design-1"\nname = ')
    (tmp_path / "state.html").write_text("<html></html>")
    assert "no design is called 'moon'" in refused(capsys, "moon")
    assert "broken.toml" in refused(capsys, "broken.toml")
    assert "moon.geojson" in refused(capsys, "plain_vine", "--map", "moon.geojson")
    assert "moon" in refused(capsys, "plain_vine", "--environment", "moon")
    assert "moon" in refused(capsys, "plain_vine", "--recipe", "moon")
    assert "no snapshot" in refused(capsys, "state.html")


def test_a_port_that_is_taken_or_none_is_one_line(capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        number = str(taken.getsockname()[1])
        assert f"--port is {number}" in refused(capsys, "plain_vine", "--port", number)
    assert "0 to 65535" in refused(capsys, "plain_vine", "--port", "99999")


def test_a_snapshot_is_written_without_a_server(capsys, tmp_path):
    command = ["studio", "plain_vine", "--environment", "pegs", "--snapshot"]
    assert main([*command, "one.html"]) == main([*command, "two.html"]) == 0
    assert capsys.readouterr().out == "wrote one.html\nwrote two.html\n"
    one = (tmp_path / "one.html").read_bytes()
    assert one == (tmp_path / "two.html").read_bytes()
    stored = json.loads(re.search(rb'id="stored">(.*?)</script>', one, re.DOTALL)[1])
    assert set(stored["answers"]) == {"live", "cut", "rules"}
    assert stored["hello"]["state"]["map"]["source"] == {"environment": "pegs", "seed": 3}
    assert "ending in .html" in refused(capsys, "plain_vine", "--snapshot", "one.txt")
    (tmp_path / "mine.html").write_text("<html>mine</html>")
    assert "mine.html" in refused(capsys, "plain_vine", "--snapshot", "mine.html")
    assert "--family" in refused(capsys, "plain_vine", "--family")
