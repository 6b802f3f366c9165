"""Snapshots: the state of the studio as one HTML file that needs neither server nor network.

It is the same page: its styles stand in the file, its modules as ``data:`` addresses of an import
map, and the state with the answers of the panels as JSON. Nothing in it depends on the day or the
computer, so the same state gives the same bytes. The map is in it too, so that it opens elsewhere.
"""

import base64
import html
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vinefab.core import __version__
from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    UnknownNameError,
    UnreadableFileError,
)
from vinefab.core.hashing import marked
from vinefab.core.plain_text import GENERATOR, plain
from vinefab.core.validation import check_plain
from vinefab.model.files.shipped import path_inside, read_bytes, read_text
from vinefab.model.map import Map, map_text
from vinefab.pages.plan_svg import legend_rows
from vinefab.studio.executors import Progress, answer_of
from vinefab.studio.live_answers import load_kernel
from vinefab.studio.server import MODULES, PAGE_FOLDER
from vinefab.studio.state import PAGE, StudioState, design_form, growth_form, is_name, world_of

_SCHEMA = "vinefab/snapshot-1"
MOST_BYTES = 1 << 27
_MOST_MAPS = 100
_PLAN_STYLE = Path(__file__).parents[1] / "pages" / "templates" / "plan.css"

_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' data:; style-src 'unsafe-inline'; "
    "img-src data: blob:"
)
"""The browser holds the file to it: whatever is in it, it can reach no network."""

_CHARSET = '<meta charset="utf-8">'
_HEAD = (
    f'<meta name="generator" content="{GENERATOR}">\n<meta name="schema" content="{_SCHEMA}">\n'
    f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
)

_LINK = re.compile(r'<link\b[^>]*href="([^"]*)">')
_STORED = re.compile(r'<script type="application/json" id="stored">(.*?)</script>', re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapshotOptions:
    """Further content of a snapshot."""

    family: bool = False  # compute the many maps too
    file: str = ""  # what the page calls the design's file; empty: the design's name
    date: str = ""  # what the page says of its day; nothing is said if empty
    reference: Mapping[str, Any] | None = None  # content of a design to compare with


def write_snapshot(
    state: Mapping[str, Any],
    path: Path,
    options: SnapshotOptions | None = None,
    progress: Progress | None = None,
    *,
    force: bool = False,
) -> Path:
    """Compute the answers of the panels to a state, and write all as one HTML file.

    Parameters
    ----------
    state
        What is open, as the page sends it (`StudioState.of`).
    force
        Overwrite a file that vinefab did not write.

    Raises
    ------
    VinefabError
        If something in the state cannot be used, or the file cannot be written.
    """
    options, progress = options or SnapshotOptions(), progress or _silent
    progress(0.0, "loading the simulator")
    load_kernel()  # what has to wait for it on the page is in the file
    panels = ("live", "cut", "rules", *(("family",) if options.family else ()))
    answers = {}
    for number, panel in enumerate(panels):
        progress(0.1 + 0.5 * number / len(panels), panel)
        answers[panel] = answer_of(panel, state, {}, _silent)
    if options.reference is not None:
        progress(0.6, "the version before")
        before = {**state, "design": options.reference}
        found = {panel: answer_of(panel, before, {"ground": False}, _silent) for panel in panels}
        answers["reference"] = {"design": options.reference, "answers": found}
    return write_bytes(path, snapshot_html(state, answers, options), force=force)


def snapshot_html(
    state: Mapping[str, Any], answers: Mapping[str, Any], options: SnapshotOptions | None = None
) -> bytes:
    """Return a state with the answers of its panels as one HTML file."""
    options = options or SnapshotOptions()
    portable = _portable(state)
    named = "" if options.file.lower().endswith(".html") else Path(options.file).name
    hello = {
        "version": __version__,
        "folder": "",
        "state": portable,
        "form": design_form(),
        "growth_form": growth_form(),
        "legend": legend_rows(),
        "file": {"path": named or portable["design"]["name"], "writable": False},
    }
    source = _source(state)  # of the map that the state's edits are made to
    stored = {
        "schema": _SCHEMA,
        "date": options.date,
        "hello": hello,
        "map": map_text(world_of({"source": source})) if "file" in source else None,
        "answers": answers,
    }
    page = (PAGE_FOLDER / "index.html").read_text(encoding="utf-8")
    page = _LINK.sub(_style, page.replace(_CHARSET, f"{_CHARSET}\n{_HEAD}", 1))
    # In a script that is none; no reader finds an end or a comment in it.
    text = json.dumps(stored, allow_nan=False, default=plain, separators=(",", ":"))
    text = text.replace("<", "\\u003c")
    imports = {
        f"studio/{module.name}": "data:text/javascript;base64,"
        + base64.b64encode(module.read_bytes()).decode()
        for module in sorted(PAGE_FOLDER.glob("*.js"))
    }
    scripts = (
        f'<script type="application/json" id="stored">{text}</script>\n'
        f'<script type="importmap">{json.dumps({"imports": imports})}</script>\n'
        '<script type="module">import "studio/app.js";</script>'
    )
    return page.replace(MODULES, scripts, 1).encode()


def stored_state(path: Path) -> dict[str, Any]:
    """Return the state in a snapshot.

    A map that came from a file is written next to the snapshot, as ``NAME.map.geojson``, because
    the file that it came from may be on another computer. Maps of a family that came from files
    are not in a snapshot: the usual family takes their place.

    Raises
    ------
    VinefabError
        If the file is not a snapshot, or something in its state cannot be used here.
    """
    script = _STORED.search(read_text(path, MOST_BYTES))
    if script is None:
        raise UnreadableFileError(path, "is not a snapshot of the studio")
    try:
        stored = json.loads(script[1])
    except (ValueError, RecursionError) as error:
        raise UnreadableFileError(path, f"its state is not JSON: {error}") from error
    schema = stored.get("schema") if isinstance(stored, dict) else None
    if schema != _SCHEMA:
        raise BadInputError("schema", schema, _SCHEMA, path)
    hello = stored.get("hello")
    state = hello.get("state") if isinstance(hello, dict) else None
    if not isinstance(state, dict):
        raise BadInputError("state", state, "names with values", path)
    with _naming(path):
        check_plain(state, finite=False)
        if isinstance(state.get("family"), dict):
            state["family"].pop("files", None)
        recipe, source = state.get("recipe"), _source(state)
        if recipe and not is_name(recipe):
            # It lies next to the snapshot, or where the command was started.
            folders = (path.parent, Path.cwd())
            found = [path_inside("recipe", recipe, folders, path, base) for base in folders]
            state["recipe"] = str(next((file for file in found if file.is_file()), found[0]))
        if "file" not in source:
            StudioState.of(state)
            return state
        with TemporaryDirectory() as folder:
            source["file"] = str(Path(folder) / "map.geojson")
            if not isinstance(stored.get("map"), str):
                raise BadInputError("map", stored.get("map"), "the text of a map file")
            Path(source["file"]).write_text(stored["map"], encoding="utf-8")
            try:  # as it is written, once it has shown that it can be read
                text = map_text(Map.read(source["file"]))
            except BadInputError as error:
                raise BadInputError(f"map.{error.key}", error.value, error.allowed, path) from error
            except UnreadableFileError as error:
                raise UnreadableFileError(path, f"its map {error.problem}") from error
            StudioState.of(state)  # before anything is written
        source["file"] = str(_written(path, text))
    return state


def snapshot_frame(
    state: Mapping[str, Any], answers: Mapping[str, Any], *, height_px: int = 720
) -> str:
    """Return a snapshot as a frame, for a cell of a notebook."""
    page = html.escape(snapshot_html(state, answers).decode())
    return (
        f'<iframe srcdoc="{page}" width="100%" height="{height_px}" title="vinefab studio" '
        'sandbox="allow-scripts"></iframe>'
    )


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Name the snapshot where an error would name the page."""
    try:
        yield
    except (BadInputError, UnknownNameError) as error:
        raise (error.at(path) if error.source in {None, PAGE} else error) from error


def _written(path: Path, text: str) -> Path:
    """Write the map of a snapshot next to it; a file with another content stays."""
    for number in range(1, _MOST_MAPS):
        file = path.with_name(f"{path.stem}.map{'' if number == 1 else f'-{number}'}.geojson")
        if not file.exists():
            return write_text(file, text)
        if read_bytes(file, MOST_BYTES) == marked(text.encode()):
            return file
    raise CannotWriteError(file, "too many maps of this snapshot lie next to it")


def _source(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return the source of a state's map; empty if none is open."""
    world = state.get("map")
    source = world.get("source") if isinstance(world, dict) else None
    return source if isinstance(source, dict) else {}


def _portable(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return a state whose files are called by their names alone: paths are private."""
    given: dict[str, Any] = json.loads(json.dumps(state, allow_nan=False))
    source, family = _source(given), given.get("family")
    if "file" in source:
        source["file"] = Path(str(source["file"])).name
    if isinstance(family, dict) and family.get("files"):
        family["files"] = [Path(str(name)).name for name in family["files"]]
    if given.get("recipe"):
        given["recipe"] = Path(str(given["recipe"])).name
    return given


def _style(link: re.Match[str]) -> str:
    """Return a linked style as it stands in its file; an icon stays as it is."""
    address = link[1]
    if not address.endswith(".css"):
        return link[0]
    name = address.rpartition("/")[2]
    path = _PLAN_STYLE if name == _PLAN_STYLE.name else PAGE_FOLDER / name
    text = path.read_text(encoding="utf-8").replace("</", "<\\/")
    return f"<style>\n{text}</style>"


def _silent(_share: float, _text: str) -> None:
    """Report no progress."""
