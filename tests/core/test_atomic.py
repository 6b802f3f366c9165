import os
from pathlib import Path

import pytest

from vinefab.core import atomic
from vinefab.core.atomic import ensure_writable, is_ours, new_folder, write_bytes, write_text
from vinefab.core.errors import CannotWriteError, ForeignFileError

OURS = "# written by vinefab 0\n"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_our_own_file_is_overwritten_and_nothing_else_is_left(tmp_path):
    path = tmp_path / "deep" / "a.toml"
    write_text(path, OURS + "1")
    write_text(path, OURS + "2")
    assert path.read_text() == OURS + "2"
    assert names(path.parent) == ["a.toml"]


def test_a_foreign_file_is_kept_unless_forced(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("my own notes")
    with pytest.raises(ForeignFileError, match="--force"):
        write_text(path, OURS)
    assert path.read_text() == "my own notes"
    write_text(path, OURS, force=True)
    assert path.read_text() == OURS


def test_the_mark_is_found_at_either_end_of_a_large_file(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(b"x" * 50_000 + atomic.OWN_MARK)
    assert is_ours(path)
    path.write_bytes(atomic.OWN_MARK + b"x" * 50_000)
    assert is_ours(path)
    path.write_bytes(b"x" * 25_000 + atomic.OWN_MARK + b"x" * 25_000)
    assert not is_ours(path)


def test_a_failing_write_leaves_the_old_file_whole(tmp_path, monkeypatch):
    path = tmp_path / "a"
    write_text(path, OURS + "old")

    def no_space(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(CannotWriteError, match="No space left on device"):
        write_bytes(path, b"new")
    assert path.read_text() == OURS + "old"
    assert names(tmp_path) == ["a"]


def test_a_folder_in_the_place_of_the_file_is_refused(tmp_path):
    with pytest.raises(CannotWriteError, match="is a folder"):
        ensure_writable(tmp_path)


def test_a_file_in_the_place_of_a_parent_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(CannotWriteError):
        ensure_writable(tmp_path / "file" / "below.toml")


def fill(path: Path, content: str) -> None:
    with new_folder(path) as folder:
        (folder / "job.json").write_text(OURS + content)


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    fill(tmp_path / "out", "1")

    def interrupted() -> None:
        with new_folder(tmp_path / "out") as folder:
            (folder / "job.json").write_text(OURS + "half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert (tmp_path / "out" / "job.json").read_text() == OURS + "1"
    assert names(tmp_path) == ["out"]


def test_notes_that_a_user_put_into_our_folder_survive_a_second_run(tmp_path):
    fill(tmp_path / "out", "1")
    (tmp_path / "out" / "my notes.txt").write_text("cut at 30 %")
    (tmp_path / "out" / "stale.svg").write_text(OURS)
    fill(tmp_path / "out", "2")
    assert (tmp_path / "out" / "my notes.txt").read_text() == "cut at 30 %"
    assert (tmp_path / "out" / "job.json").read_text() == OURS + "2"
    assert not (tmp_path / "out" / "stale.svg").exists()
    assert names(tmp_path) == ["out"]


def test_somebody_elses_folder_is_refused(tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter1.tex").write_text("...")
    with pytest.raises(ForeignFileError):
        fill(tmp_path / "thesis", "1")
    assert names(tmp_path / "thesis") == ["chapter1.tex"]


def test_an_empty_folder_is_filled(tmp_path):
    (tmp_path / "out").mkdir()
    fill(tmp_path / "out", "1")
    assert names(tmp_path / "out") == ["job.json"]
