import errno
import io
import os
import stat
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from vinefab.core.atomic import (
    ensure_own_folder,
    ensure_writable,
    is_filled_in,
    is_ours,
    lock_folder,
    new_folder,
    write_files,
    write_folder,
    write_text,
)
from vinefab.core.errors import CannotWriteError, ForeignFileError
from vinefab.core.hashing import ROOMY_GENERATOR, Authorship, authorship, marked
from vinefab.core.plain_text import OWN_MARK, json_text

OURS = "# written by vinefab 0\n"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_our_own_file_is_overwritten_and_nothing_else_is_left(tmp_path):
    path = tmp_path / "deep" / "a.toml"
    write_text(path, OURS + "1")
    write_text(path, OURS + "2")
    assert path.read_bytes() == marked(f"{OURS}2".encode())
    assert names(path.parent) == ["a.toml"]


def test_a_foreign_file_is_kept_unless_forced(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("my own notes")
    with pytest.raises(ForeignFileError, match="--force"):
        write_text(path, OURS)
    assert path.read_text() == "my own notes"
    write_text(path, OURS, force=True)
    assert path.read_bytes() == marked(OURS.encode())


def test_the_mark_is_found_at_either_end_of_a_large_file(tmp_path):
    path = tmp_path / "large"
    path.write_bytes(b"x" * 50_000 + OWN_MARK)
    assert is_ours(path)
    path.write_bytes(OWN_MARK + b"x" * 50_000)
    assert is_ours(path)
    path.write_bytes(b"x" * 25_000 + OWN_MARK + b"x" * 25_000)
    assert not is_ours(path)


def png(text: str) -> bytes:
    facts = PngInfo()
    facts.add_text("Software", text)
    stream = io.BytesIO()
    Image.new("L", (9, 9)).save(stream, "PNG", pnginfo=facts)
    return stream.getvalue()


def archive() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as made:
        made.writestr("inner.png", png(ROOMY_GENERATOR))
        made.writestr("inner.toml", marked(OURS.encode()))
        made.comment = ROOMY_GENERATOR.encode()
    return stream.getvalue()


WRITTEN = {
    "toml": OURS.encode() + b"length = 120.0\n",
    "json": json_text("vinefab/x-1", {"length": 120.0}).encode(),
    "svg": b"<svg><desc>written by vinefab 1.2.3-rc.1; plays 2 s</desc></svg>",
    "png": png(ROOMY_GENERATOR),
    "zip": archive(),
}


@pytest.mark.parametrize("data", WRITTEN.values(), ids=WRITTEN)
def test_the_mark_holds_a_digest_of_the_rest_whatever_the_format(data):
    sealed = marked(data)
    assert marked(sealed) == sealed
    assert authorship(data) is Authorship.CHANGED
    assert authorship(sealed) is Authorship.OURS
    for place in range(0, len(sealed), 7):
        changed = sealed[:place] + bytes([sealed[place] ^ 1]) + sealed[place + 1 :]
        assert authorship(changed) is not Authorship.OURS
    assert authorship(sealed + b"\n") is Authorship.CHANGED


def test_a_marked_picture_and_a_marked_archive_are_read_as_before():
    picture = Image.open(io.BytesIO(marked(WRITTEN["png"])))
    picture.load()
    assert picture.text["Software"].startswith("written by vinefab")
    assert zipfile.ZipFile(io.BytesIO(marked(WRITTEN["zip"]))).testzip() is None
    old = png("written by vinefab 0")  # no room: bytes stay as they are
    assert marked(old) == old


def test_a_file_that_was_changed_is_kept_unless_forced(tmp_path):
    path = write_text(tmp_path / "a.toml", OURS + "1")
    path.write_text(path.read_text() + "by hand")
    for write in (ensure_writable, lambda path: write_text(path, OURS + "2")):
        with pytest.raises(ForeignFileError, match=r"changed since.*--force"):
            write(path)
    assert path.read_text().endswith("1by hand")


def test_a_file_with_a_mark_but_no_digest_is_a_person_s_work(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(OURS + "by hand")
    for write in (ensure_writable, lambda path: write_text(path, OURS + "new")):
        with pytest.raises(ForeignFileError, match=r"changed since.*--force"):
            write(path)
    assert path.read_text() == OURS + "by hand"


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755])
def test_permissions_are_kept(tmp_path, mode):
    path = write_text(tmp_path / "a.toml", OURS)
    path.chmod(mode)
    write_text(path, OURS + "2")
    assert stat.S_IMODE(path.stat().st_mode) == mode
    fill(tmp_path / "out", "1")
    (tmp_path / "out" / "job.json").chmod(mode)
    fill(tmp_path / "out", "2")
    assert stat.S_IMODE((tmp_path / "out" / "job.json").stat().st_mode) == mode


@pytest.mark.parametrize("force", [False, True])
def test_write_protected_files_are_refused(tmp_path, force):
    path = write_text(tmp_path / "a.toml", OURS)
    fill(tmp_path / "out", "1")
    for place in (path, tmp_path / "out" / "job.json"):
        place.chmod(0o444)
    for write in (
        lambda: ensure_writable(path, force=force),
        lambda: write_text(path, OURS + "2", force=force),
        lambda: fill(tmp_path / "out", "2", force=force),
    ):
        with pytest.raises(CannotWriteError, match="write-protected"):
            write()
    assert path.read_bytes() == marked(OURS.encode())
    assert names(tmp_path / "out") == ["MANIFEST.sha256", "job.json"]


@pytest.mark.parametrize("force", [False, True])
def test_a_loop_of_links_is_refused(tmp_path, force):
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    for write in (
        lambda: ensure_writable(loop, force=force),
        lambda: write_text(loop / "deep" / "a.toml", OURS, force=force),
        lambda: ensure_own_folder(loop, "job.json", force=force),
        lambda: write_folder(loop / "deep", {"job.json": b"{}"}, "job.json", force=force),
    ):
        with pytest.raises(CannotWriteError, match="symbolic links"):
            write()
    assert loop.is_symlink()


def test_a_failing_write_leaves_the_old_file_whole(tmp_path, monkeypatch):
    path = tmp_path / "a"
    write_text(path, OURS + "old")

    def no_space(_handle):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", no_space)
    with pytest.raises(CannotWriteError, match="No space left on device"):
        write_text(path, OURS + "new")
    assert path.read_bytes() == marked(f"{OURS}old".encode())
    assert names(tmp_path) == ["a"]


def test_a_folder_in_the_place_of_the_file_is_refused(tmp_path):
    with pytest.raises(CannotWriteError, match="is a folder"):
        ensure_writable(tmp_path)


def fill(path: Path, content: str, mark: str = "job.json", *, force: bool = False) -> None:
    with new_folder(path, mark, force=force) as folder:
        (folder / mark).write_text(OURS + content)


def test_a_folder_appears_whole_or_not_at_all(tmp_path):
    fill(tmp_path / "out", "1")

    def interrupted() -> None:
        with new_folder(tmp_path / "out", "job.json") as folder:
            (folder / "job.json").write_text(OURS + "half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert (tmp_path / "out" / "job.json").read_text() == OURS + "1"
    assert names(tmp_path) == ["out"]


def test_a_folder_of_another_kind_is_refused_and_kept_when_forced(tmp_path):
    out = tmp_path / "out"
    fill(out, "a rig", mark="rig.json")
    with pytest.raises(ForeignFileError):
        fill(out, "a package")
    assert (out / "rig.json").read_text() == OURS + "a rig"


def test_a_file_that_the_user_replaced_by_a_link_is_kept(tmp_path):
    out = tmp_path / "out"
    fill(out, "1")
    (out / "job.json").rename(tmp_path / "moved.json")
    (out / "job.json").symlink_to("../moved.json")
    with pytest.raises(ForeignFileError, match="was changed"):
        fill(out, "2")
    assert (out / "job.json").is_symlink()


def test_a_table_that_nobody_filled_in_may_be_replaced(tmp_path):
    fill(tmp_path / "out", "1")
    assert not is_filled_in(tmp_path / "out" / "job.json", {"job.json": b"of another recipe"})


def test_the_current_folder_is_refused_even_when_forced(tmp_path, monkeypatch):
    below = tmp_path / "work" / "deep"
    below.mkdir(parents=True)
    monkeypatch.chdir(below)
    for place in (Path(), Path("..")):
        with pytest.raises(CannotWriteError, match="current folder"):
            fill(place, "1", force=True)


def test_one_kind_of_our_files_does_not_replace_another(tmp_path):
    path = tmp_path / "map.geojson"
    ours = '{"generator": "written by vinefab 0", "schema": "vinefab/map-1"}'
    write_text(path, ours)
    with pytest.raises(ForeignFileError, match="another kind"):
        write_text(path, ours.replace("map-1", "score-1"))
    assert path.read_bytes() == marked(ours.encode())
    write_text(path, ours + " ")
    assert path.read_bytes() == marked(f"{ours} ".encode())


def test_a_link_is_followed_and_a_pipe_is_refused(tmp_path):
    write_text(tmp_path / "real.toml", OURS + "1")
    (tmp_path / "link.toml").symlink_to("real.toml")
    write_text(tmp_path / "link.toml", OURS + "2")
    assert (tmp_path / "real.toml").read_bytes() == marked(f"{OURS}2".encode())
    assert (tmp_path / "link.toml").is_symlink()
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(CannotWriteError, match="not a plain file"):
        write_text(tmp_path / "pipe", OURS, force=True)


def test_somebody_elses_folder_is_refused(tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter1.tex").write_text("...")
    with pytest.raises(ForeignFileError):
        fill(tmp_path / "thesis", "1")
    assert names(tmp_path / "thesis") == ["chapter1.tex"]


@pytest.mark.parametrize("deeper", ["", "/deep/er"])
@pytest.mark.parametrize("force", [False, True])
def test_a_file_is_no_folder_and_is_kept(tmp_path, deeper, force):
    (tmp_path / "mine.toml").write_text("five years of work")
    place = tmp_path / f"mine.toml{deeper}"
    with pytest.raises(CannotWriteError, match="it is a file; name a folder"):
        ensure_own_folder(place, "job.json", force=force)
    with pytest.raises(CannotWriteError, match="it is a file; name a folder"):
        write_folder(place, {"job.json": b"{}"}, "job.json", force=force)
    with pytest.raises(CannotWriteError, match="it is a file; name a folder"):
        write_text(tmp_path / f"mine.toml{deeper}" / "a.txt", "", force=force)
    assert (tmp_path / "mine.toml").read_text() == "five years of work"


def test_lists_of_files_are_utf8_in_any_locale(tmp_path):
    out = tmp_path / "out"
    program = (
        "from pathlib import Path\n"
        "from vinefab.core.atomic import is_filled_in, write_folder\n"
        f"out, files = Path({str(out)!r}), {{'\u0159ez.csv': b'1'}}\n"
        "write_folder(out, files, 'MANIFEST.sha256')\n"
        "assert not is_filled_in(out / '\u0159ez.csv', files)\n"
    )
    # What leaves the encoding to the locale is an error then.
    strict = ("-X", "warn_default_encoding", "-W", "error::EncodingWarning:vinefab.core.atomic")
    subprocess.run([sys.executable, *strict, "-c", program], check=True)
    assert "  \u0159ez.csv\n" in (out / "MANIFEST.sha256").read_text(encoding="utf-8")


HOLDER = """
import sys
from pathlib import Path
from vinefab.core.atomic import lock_folder
handle = lock_folder(Path(sys.argv[1]), "taken")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_folder_is_held_until_its_process_dies_and_nothing_is_left(tmp_path):
    other = subprocess.Popen(
        [sys.executable, "-c", HOLDER, tmp_path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert other.stdout.readline() == b"held\n"
    with pytest.raises(CannotWriteError, match="taken"):
        lock_folder(tmp_path, "taken")
    other.kill()
    other.communicate()
    handle = lock_folder(tmp_path, "taken")
    assert handle is not None
    os.close(handle)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_no_matter_here(tmp_path):
    assert lock_folder(tmp_path / "none", "taken") is None


def test_several_files_are_written_or_none(tmp_path, monkeypatch):
    kept = tmp_path / "kept.txt"
    write_files({kept: b"old, vinefab"}, force=True)
    real, count = os.fsync, iter(range(9))

    def full(handle):
        if next(count) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(handle)

    monkeypatch.setattr(os, "fsync", full)
    files = {tmp_path / "a" / "one": b"1", kept: b"new", tmp_path / "b" / "two": b"2"}
    with pytest.raises(CannotWriteError, match="No space left"):
        write_files(files, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["kept.txt"]
    assert kept.read_bytes() == b"old, vinefab"


def test_errors_name_the_place_and_not_a_hidden_folder(tmp_path):
    out = tmp_path / "package"
    for _ in range(2):  # beside, and in place
        with pytest.raises(CannotWriteError) as caught, new_folder(out, "mark") as folder:
            raise OSError(errno.ENOSPC, "full", str(folder / "sheet_1" / "outline.dxf"))
        assert str(caught.value) == f"{out}/sheet_1/outline.dxf: cannot be written: full"
        out.mkdir(exist_ok=True)
