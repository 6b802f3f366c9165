"""A folder is replaced while everything that can go wrong does: nothing of the user's is gone."""

import errno
import os
import random
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from vinefab.core.atomic import INCOMPLETE_NAME, new_folder
from vinefab.core.errors import CannotWriteError, ForeignFileError
from vinefab.core.hashing import MANIFEST_NAME, digests_in, manifest_text, sha256_of

MARK = "job.json"
NAMES = (MARK, "outline.svg", "tiles/a.dxf", "tiles/deep/b.dxf", "README.txt", "part")
CALLS = ("replace", "unlink", "mkdir", "rmdir")


def _chance(seed: int) -> random.Random:
    return random.Random(seed)  # noqa: S311  nothing secret


class KilledError(BaseException):
    """From here on nothing works any more, as after SIGKILL."""


def write(out: Path, version: str, names, *, force: bool = False) -> None:
    with new_folder(out, MARK, force=force) as folder:
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(f"written by vinefab {version} {name}")


def tree(out: Path) -> dict[str, str]:
    """Return all that a person sees in a folder: files with content, links, empty folders."""
    seen = {}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        if name.startswith(".vinefab-new."):
            continue
        if path.is_symlink():
            seen[name] = f"-> {path.readlink()}"
        elif path.is_file():
            seen[name] = path.read_text()
        elif not any(path.iterdir()):
            seen[name] = "empty folder"
    return seen


def theirs(chance: random.Random, out: Path) -> dict[str, str]:
    """Put some things of a user into a folder and return them."""
    for number in range(chance.randrange(1, 6)):
        place = out / chance.choice((".", "tiles", "photos", "photos/of the robot"))
        place.mkdir(parents=True, exist_ok=True)
        (place / f"note {number}.txt").write_text(f"cut at {number} %")
    (out / "link").symlink_to("nowhere")
    (out / "empty").mkdir()
    return {
        name: content
        for name, content in tree(out).items()
        if "note" in name or name in {"link", "empty"}
    }


class Trouble:
    """Lets one call of the system fail, before or after it was done; later ones too if killed."""

    def __init__(self, monkeypatch, at: int, error: BaseException, *, after: bool) -> None:
        self.at, self.error, self.after, self.count = at, error, after, 0
        for name in CALLS:
            monkeypatch.setattr(os, name, self.wrapped(getattr(os, name)))

    def wrapped(self, call):
        def run(*given, **named):
            self.count += 1
            killed = isinstance(self.error, KilledError)
            now = self.count == self.at or (killed and self.count > self.at)
            if now and not (self.after and self.count == self.at):
                raise self.error
            result = call(*given, **named)
            if now:
                raise self.error
            return result

        return run


ERRORS = {
    "full disk": lambda: OSError(errno.ENOSPC, "No space left on device"),
    "Ctrl-C": KeyboardInterrupt,
    "SIGKILL": KilledError,
}


@pytest.mark.parametrize("after", [False, True], ids=["before", "after"])
@pytest.mark.parametrize("kind", ERRORS)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.thorough)])
def test_nothing_of_the_user_is_gone_whatever_call_fails(tmp_path, monkeypatch, kind, seed, after):
    chance = _chance(seed)
    old, new = (chance.sample(NAMES[1:], 3) for _ in range(2))
    at, done = 1, False
    while not done:
        out = tmp_path / "out"
        write(out, "1", [MARK, *old])
        mine = theirs(_chance(seed), out)
        before = tree(out)
        with monkeypatch.context() as patch:
            trouble = Trouble(patch, at, ERRORS[kind](), after=after)
            with suppress(OSError, KeyboardInterrupt, KilledError):
                write(out, "2", [MARK, *new])
            done = trouble.count < at
        left = tree(out)
        assert mine.items() <= left.items(), (at, kind)
        vouched = digests_in(left.get(MANIFEST_NAME, ""))
        if new[0] in vouched and new[0] not in old:  # the new manifest: it comes last
            found = {name: sha256_of((out / name).read_bytes()) for name in vouched}
            assert found == vouched, at
        incomplete = left.pop(INCOMPLETE_NAME, None)
        if not done and kind != "SIGKILL" and incomplete is None:
            versions = {left[name].split()[3] for name in (MARK, *old, *new) if name in left}
            assert left == before or versions == {"2"}, (at, kind)
        write(out, "3", [MARK, *new])
        final = tree(out)
        assert mine.items() <= final.items()
        written = {
            name: text
            for name, text in final.items()
            if name not in mine and text != "empty folder"
        }
        assert set(written) == {MARK, MANIFEST_NAME, *new}
        assert all(f"vinefab 3 {name}" in written[name] for name in (MARK, *new))
        assert not list(out.glob(".vinefab-new.*"))
        shutil.rmtree(out)
        at += 1
    assert at > 12


def test_an_interrupt_while_another_is_undone_loses_nothing(tmp_path, monkeypatch):
    for first in range(1, 25, 3):
        for second in range(1, 8):
            out = tmp_path / f"out {first} {second}"
            write(out, "1", [MARK, "outline.svg", "tiles/a.dxf"])
            mine = theirs(_chance(first), out)
            with monkeypatch.context() as patch:
                Trouble(patch, first + second, KeyboardInterrupt(), after=False)
                Trouble(patch, first, KeyboardInterrupt(), after=True)
                with suppress(KeyboardInterrupt):
                    write(out, "2", [MARK, "README.txt", "tiles/a.dxf"])
            assert mine.items() <= tree(out).items()
            write(out, "3", [MARK, "README.txt"])
            assert mine.items() <= tree(out).items()
            files = {name for name, text in tree(out).items() if text != "empty folder"}
            assert files - set(mine) == {MARK, "README.txt", MANIFEST_NAME}


def test_a_file_of_the_user_in_the_place_of_a_new_one_is_refused_before_anything_changes(tmp_path):
    out = tmp_path / "out"
    write(out, "1", [MARK])
    (out / "README.txt").write_text("mine")
    before = tree(out)
    with pytest.raises(ForeignFileError, match=r"README.txt: was not written by vinefab"):
        write(out, "2", [MARK, "README.txt"])
    assert tree(out) == before
    write(out, "2", [MARK, "README.txt"], force=True)
    assert "vinefab 2" in (out / "README.txt").read_text()


def test_a_file_that_the_user_changed_is_neither_replaced_nor_removed(tmp_path):
    out = tmp_path / "out"
    write(out, "1", [MARK, "outline.svg", "README.txt"])
    (out / "outline.svg").write_text("written by vinefab, then drawn over by hand")
    with pytest.raises(ForeignFileError, match=r"outline.svg: was changed since vinefab wrote it"):
        write(out, "2", [MARK, "outline.svg"])
    write(out, "2", [MARK])
    assert set(tree(out)) == {MARK, MANIFEST_NAME, "outline.svg"}


@pytest.mark.parametrize("force", [False, True])
def test_a_folder_of_the_user_in_the_place_of_a_file_is_kept(tmp_path, force):
    out = tmp_path / "out"
    write(out, "1", [MARK])
    (out / "part").mkdir()
    (out / "part" / "mine.txt").write_text("mine")
    (out / "tiles").write_text("a file, where a folder is to be")
    before = tree(out)
    for name in ("part", "tiles/a.dxf"):
        with pytest.raises(CannotWriteError, match="move the f"):
            write(out, "2", [MARK, name], force=force)
        assert tree(out) == before


def test_what_was_a_folder_may_become_a_file_and_back(tmp_path):
    out = tmp_path / "out"
    write(out, "1", [MARK, "part/a.stl", "part/deep/b.stl"])
    write(out, "2", [MARK, "part"])
    assert set(tree(out)) == {MARK, MANIFEST_NAME, "part"}
    write(out, "3", [MARK, "part/a.stl"])
    assert set(tree(out)) == {MARK, MANIFEST_NAME, "part/a.stl"}


def test_a_link_to_a_folder_stays_a_link(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").symlink_to("disk")
    write(tmp_path / "out", "1", [MARK])
    assert (tmp_path / "out").is_symlink()
    assert set(tree(tmp_path / "disk")) == {MARK, MANIFEST_NAME}


def test_two_processes_do_not_fill_one_folder(tmp_path):
    out = tmp_path / "out"
    write(out, "1", [MARK])
    with new_folder(out, MARK) as folder:
        (folder / MARK).write_text("written by vinefab first")
        with pytest.raises(CannotWriteError, match="another process"):
            write(out, "2", [MARK])
    assert (out / MARK).read_text() == "written by vinefab first"


def test_a_manifest_that_names_files_elsewhere_removes_nothing(tmp_path):
    out, mine = tmp_path / "out", tmp_path / "mine.txt"
    write(out, "1", [MARK])
    mine.write_text("mine")
    manifest = out / MANIFEST_NAME
    digest = sha256_of(b"mine")
    listed = digests_in(manifest.read_text())
    manifest.write_text(manifest_text(listed | {"../mine.txt": digest, str(mine): digest}))
    write(out, "2", [MARK])
    assert mine.read_text() == "mine"


def test_a_manifest_that_the_user_changed_is_refused_like_any_file(tmp_path):
    out = tmp_path / "out"
    write(out, "1", [MARK])
    manifest = out / MANIFEST_NAME
    whole = manifest.read_text()
    for edited in (f"{whole}{sha256_of(b'mine')}  my notes.txt\n", "my own list\n"):
        manifest.write_text(edited)
        with pytest.raises(ForeignFileError, match=f"{MANIFEST_NAME}: was changed since"):
            write(out, "2", [MARK])
        assert manifest.read_text() == edited
    write(out, "2", [MARK], force=True)
    assert "vinefab 2" in (out / MARK).read_text()
