"""The files of the studio: which may be opened, saving, changes from outside, autosaves.

One store serves all tabs. It reads and writes only in its folders: where the command was started,
and where the files lie that were named there; shipped and own designs and recipes are read only.
Unsaved work of a tab is kept in a file of the user's folder until it is saved.
"""

import asyncio
import json
import os
import re
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import TYPE_CHECKING, Any

from vinefab.core.atomic import PROTECTED, is_protected, keep_aside, write_bytes
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    UnfitInputError,
    UnreadableFileError,
    VinefabError,
    located,
)
from vinefab.core.front_door import imported_later
from vinefab.core.hashing import sha256_of
from vinefab.core.plain_text import counted, json_text
from vinefab.core.registry import parameter_values
from vinefab.core.validation import check_plain
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import Design, design_content, design_of, design_text
from vinefab.model.files.design_edit import edited_text
from vinefab.model.files.run_context import ChosenRecipe, RunContext
from vinefab.model.files.shipped import (
    KINDS,
    existing_file,
    locate,
    names,
    path_inside,
    read_bytes,
    read_text,
    shipped_root,
    user_names,
    user_root,
)
from vinefab.model.files.toml import LARGEST_TOML_BYTES, toml_content
from vinefab.model.laser import read_profile
from vinefab.model.map import Map, map_text
from vinefab.studio.state import (
    PAGE,
    files_named_in,
    is_name,
    mapping_at,
    member,
    start_of,
    world_of,
)
from vinefab.tasks import TASKS

if TYPE_CHECKING:
    import watchfiles
else:  # of the extra
    watchfiles = imported_later("watchfiles")

AUTOSAVE_SCHEMA = "vinefab/recovery-1"
MOST_AUTOSAVES = 20
LARGEST_AUTOSAVE_BYTES = 4 << 20

_WORK = ("design", "map")
"""What of a state would be lost."""

_KEY = re.compile(r"[a-z0-9]{6,40}")


def autosave_folder() -> Path:
    """Return the folder of autosaves."""
    return user_root() / "studio"


def _autosave(key: object) -> Path:
    if not isinstance(key, str) or not _KEY.fullmatch(key):
        raise BadInputError("key", key, "6 to 40 small letters and digits", PAGE)
    return autosave_folder() / f"recovery-{key}.json"


def _autosaves() -> list[Path]:
    """Return the recovery files, the newest first."""
    times = []
    for path in autosave_folder().glob("recovery-*.json"):
        with suppress(OSError):  # another server may just have removed it
            times.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(times, reverse=True)]


LARGEST_MAP_BYTES = 32 << 20
"""Of a map that is opened on the page; commands read larger ones."""


_HIDDEN = (".", "node_modules", "__pycache__")
_MOST_LOOKED_AT = 5000
_HEAD_BYTES = 4096
_SCHEMA = re.compile(rb'^schema\s*=\s*["\']vinefab/(design|recipe)-1["\']', re.MULTILINE)

Broadcast = Callable[[Mapping[str, Any]], None]
"""Sends an event to every tab."""


@dataclass(frozen=True, slots=True)
class _Version:
    """The present content of a design file."""

    stamp: str  # SHA-256 of its bytes; empty where there is no file
    text: str | None = None  # with the mark of its byte order, if it has one
    design: Design | None = None
    problem: str | None = None  # why it gives no design

    @property
    def content(self) -> dict[str, Any] | None:
        return None if self.design is None else design_content(self.design)


class FileStore:
    """The files that the user opened, and where more may be.

    Parameters
    ----------
    start
        Where the command was started.
    named
        Files named on the command line; their folders are open as well.
    """

    def __init__(self, start: Path, named: Iterable[Path] = ()) -> None:
        self.start = start.resolve()
        real = (Path(os.path.realpath(self.start / path)) for path in named)
        folders = [self.start, *(path.parent for path in real)]
        self.roots = tuple(dict.fromkeys(folders))
        self._lock = Lock()
        self._watched: dict[Path, str] = {}  # file -> its kind
        self._known: dict[Path, str] = {}  # file -> the stamp that the tabs know
        self._texts: dict[Path, str] = {}  # file -> the last text that was a design
        self._checked: dict[tuple[str, str], float] = {}
        self._more: Callable[[], object] = lambda: None

    def choices(self, _: Mapping[str, Any]) -> dict[str, Any]:
        """Return the files to open: designs, maps, recipes, and environments with options."""
        paths, is_complete = _listed(self.roots)
        found: dict[str, list[dict[str, str]]] = {"design": [], "recipe": [], "map": []}
        most_listed = 300  # files of each kind in the list of choices
        for path in paths:
            kind = "" if _is_library(path) else _kind(path)
            if not kind:
                continue
            if len(found[kind]) < most_listed:
                shown = self.shown(path)
                found[kind].append({"name": path.stem, "path": shown, "where": "folder"})
            else:
                is_complete = False
        for kind in ("design", "recipe"):
            own = [{"name": name, "path": name, "where": "own"} for name in user_names(kind)]
            taken = {entry["name"] for entry in own}
            shipped = [
                {"name": name, "path": name, "where": "shipped"}
                for name in names(kind)
                if name not in taken
            ]
            found[kind] += [*own, *shipped]
        environments = [
            {"name": name, "about": made.description, "options": parameter_values(made.options())}
            for name, made in ((name, ENVIRONMENTS[name]) for name in ENVIRONMENTS.names())
        ]
        return {
            "designs": found["design"],
            "maps": found["map"],
            "recipes": found["recipe"],
            "environments": environments,
            "folders": [str(root) for root in self.roots],
            "complete": is_complete,
        }

    def open_design(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return a design with its file; ``design`` is a path or a name."""
        path = self._named("design", ask.get("design"))
        version = _version(path)
        if version.design is None or version.text is None:
            raise UnreadableFileError(path, (version.problem or "").removeprefix(f"{path}: "))
        self._texts[path] = version.text
        self._watch(path, "design", version.stamp)
        return {
            "design": version.content,
            "path": path.stem if _is_library(path) else self.shown(path),
            "name": path.stem,
            "writable": self.is_writable(path),
            "stamp": version.stamp,
            "text": version.text,
            **self._of_run(version.design.changed(folder=path.parent)),
        }

    def _of_run(self, design: Design) -> dict[str, Any]:
        """Return task and recipe of a design's run, and a line on what is used of it."""
        found: dict[str, Any] = {}
        try:
            run = RunContext.of(design)
            used = ["growth options"] if run.growth else []
            if run.task in TASKS:
                found["task"] = run.task
                used.insert(0, f"task {run.task}")
            line = f"{', '.join(used)} of {run.title}" if used else ""
            if run.recipe is not None:
                chosen = ChosenRecipe.of(design)
                file = Path(chosen.recipe)
                opened = {} if _is_library(file) else self.open_recipe({"recipe": str(file)})
                found["recipe"] = opened.get("recipe", file.stem)
                line = "; ".join(filter(None, (chosen.note, line)))
        except VinefabError as error:
            line = str(error)
        return {**found, **({"run_note": line} if line else {})}

    def open_map(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return the source of a map file that can be read; ``path`` is its path."""
        path = self.allowed_path("map", ask.get("path"))
        stamp = _stamp(path, LARGEST_MAP_BYTES)
        world = Map.read(path)
        self._watch(path, "map", stamp)
        return {
            "source": {"file": self.shown(path), "stamp": stamp},
            "name": world.name,
            "obstacles": len(world.obstacles),
            "starts": len(world.starts),
            "stamp": stamp,
        }

    def open_recipe(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return name and title of a recipe that can be read; ``recipe`` is a path or a name."""
        given = ask.get("recipe")
        path = self._named("recipe", given)
        title = read_profile(path).recipe.title
        self._watch(path, "recipe", _stamp(path, LARGEST_TOML_BYTES))
        name = str(given) if is_name(given) else self.shown(path)
        return {"recipe": name, "title": title}

    def save_design(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Write a design into a file; nothing is written where the file is another than expected.

        Parameters
        ----------
        ask
            ``path``, ``design`` (content), ``stamp`` of the version that is known, ``force`` to
            write all the same, ``from``: the file whose comments a new one takes over, and
            ``autosave``: the key of the autosave that is no longer needed.
        """
        path = self._target(ask.get("path"))
        design = design_of(mapping_at("design", ask.get("design")), PAGE)
        with self._lock:
            now = _version(path)
            if now.stamp and now.stamp != ask.get("stamp") and not ask.get("force"):
                return {
                    "saved": False,
                    "why": "changed" if ask.get("stamp") else "exists",
                    "path": self.shown(path),
                    "stamp": now.stamp,
                    "design": now.content,
                    "problem": now.problem,
                }
            is_broken = bool(now.stamp) and now.design is None
            if is_broken and (path not in self._texts or now.stamp == "unreadable"):
                raise CannotWriteError(self.shown(path), "it is not a design; choose another name")
            text, note = self._new_text(path, now, design, ask.get("from"))
            if is_broken:
                note = f"the version on disk was broken; it is kept as {keep_aside(path).name}"
            write_bytes(path, text.encode(), force=True, sealed=False)  # a person's work
            self._texts[path] = text
        stamp = sha256_of(text.encode())
        self._watch(path, "design", stamp)
        if ask.get("autosave"):
            self.drop_autosave({"key": ask["autosave"]})
        answer = {"saved": True, "path": self.shown(path), "stamp": stamp, "text": text}
        return {**answer, "writable": True, "note": note}

    def save_map(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Write the page's map into a file; nothing is written where it is another than expected.

        Parameters
        ----------
        ask
            ``path``; ``map``, as `edited_map` and ``targets`` have it; ``pose``, which becomes the
            first start; ``stamp`` of the version that is known, and ``autosave``, as for a design.
        """
        path = self._target(ask.get("path"), ".geojson")
        content = mapping_at("map", ask.get("map"))
        self.check_paths({"map": content})
        with self._lock:
            now = _stamp(path, LARGEST_MAP_BYTES) if path.exists() else ""
            if now and now != ask.get("stamp"):
                why = "changed" if ask.get("stamp") else "exists"
                about = {"path": self.shown(path), "stamp": now, "design": None, "problem": None}
                return {"saved": False, "why": why, **about}
            world = world_of(content)
            pose = start_of(ask.get("pose"))
            if pose is not None:
                world = replace(world, starts=(*world.with_start(pose).starts, *world.starts[1:]))
            text = map_text(world)
            write_bytes(path, text.encode(), force=True, sealed=False)  # a person's work
        stamp = sha256_of(text.encode())
        self._watch(path, "map", stamp)
        if ask.get("autosave"):
            self.drop_autosave({"key": ask["autosave"]})
        source = {"file": self.shown(path), "stamp": stamp}
        return {"saved": True, "path": source["file"], "stamp": stamp, "source": source}

    def keep_autosave(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Keep unsaved work: ``key`` of the tab, its ``state`` and ``file``; the oldest goes.

        Its paths are kept whole: another server, started in another folder, may find it.


        ``instead`` is the key of a closed tab whose work this one took over: removed once the
        new copy stands, so that no reload between the two loses the work or offers it twice.
        """
        path, state = _autosave(ask.get("key")), mapping_at("state", ask.get("state"))
        kept_at = datetime.now(UTC).isoformat("T", "seconds")
        state, file = self._with_paths(state, ask.get("file"), self._whole)
        content = {"kept_at": kept_at, "state": state, "file": file}
        text = json_text(AUTOSAVE_SCHEMA, content)
        if len(text) > LARGEST_AUTOSAVE_BYTES:
            allowed = f"at most {LARGEST_AUTOSAVE_BYTES} bytes for the recovery file"
            raise BadInputError("state", counted(len(text), "byte"), allowed, PAGE)
        write_bytes(path, text.encode(), force=True, private=True)
        for old in _autosaves()[MOST_AUTOSAVES:]:
            old.unlink(missing_ok=True)
        if ask.get("instead") not in (None, ask.get("key")):
            self.drop_autosave({"key": ask["instead"]})
        return {"kept": str(path)}

    def autosaves(self, _: Mapping[str, Any]) -> dict[str, Any]:
        """Return the autosaves, the newest first, each with its design; no broken ones."""
        found = []
        for path in _autosaves()[:MOST_AUTOSAVES]:
            with suppress(UnreadableFileError, BadInputError):
                kept = self.open_autosave({"key": path.stem.removeprefix("recovery-")})
                state = kept.pop("state")
                shown = {k: state.get(k) if isinstance(state, dict) else None for k in _WORK}
                name = member(shown, "design").get("name")
                found.append({**kept, "name": name, **shown})
        return {"autosaves": found}

    def open_autosave(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Return unsaved work: ``key``, ``kept_at``, ``state``, ``file`` and ``left``.

        What lies in another folder is not opened here: without its file the work is a copy, and
        ``left`` names the files that it was made with.
        """
        path = _autosave(ask.get("key"))
        try:
            content = json.loads(read_text(path, 2 * LARGEST_AUTOSAVE_BYTES))
        except (ValueError, RecursionError) as error:
            raise UnreadableFileError(path, f"is not JSON: {error}") from None
        if not isinstance(content, dict) or content.get("schema") != AUTOSAVE_SCHEMA:
            raise UnreadableFileError(path, f"is not a recovery file ({AUTOSAVE_SCHEMA})")
        with located(path):
            check_plain(content)
        left: list[str] = []

        def here(key: str, given: str) -> str | None:
            try:
                if not Path(given).is_absolute():  # of a version that did not say in which folder
                    raise BadInputError(key, given, "a whole path", path)
                return self.shown(self.allowed_path(key, given))
            except VinefabError:
                left.append(given)
                return None

        state, file = self._with_paths(content.get("state"), content.get("file"), here)
        return {
            "key": ask["key"], "kept_at": content.get("kept_at"), "state": state, "file": file,
            "left": list(dict.fromkeys(left)),
        }  # fmt: skip

    def _whole(self, key: str, given: str) -> str:
        """Return a path of the page as it is from any folder."""
        with suppress(VinefabError):  # kept all the same
            return str(self.allowed_path(key, given, to_write=True))
        return given

    def _with_paths(
        self,
        state: Any,  # noqa: ANN401  JSON
        file: Any,  # noqa: ANN401  JSON
        path_of: Callable[[str, str], str | None],
    ) -> tuple[Any, Any]:
        """Return a state and its file with other paths; what has none any more is left out.

        Names, as of shipped designs and recipes, are no paths.
        """

        def changed(key: str, given: object) -> Any:  # noqa: ANN401  JSON
            is_path = isinstance(given, str) and given and not is_name(given)
            return path_of(key, str(given)) if is_path else given

        if isinstance(file, dict) and "path" in file:
            file = {**file, "path": changed("design", file["path"])}
        if not isinstance(state, dict):
            return state, file
        state = {**state, **{k: changed(k, state[k]) for k in ("opened", "recipe") if k in state}}
        source = member(member(state, "map"), "source")
        if "file" in source:
            path = changed("map", source["file"])
            state["map"] = path and {**state["map"], "source": {**source, "file": path}}
        family = member(state, "family")
        if isinstance(family.get("files"), list):
            files = [changed("family.files", name) for name in family["files"]]
            state["family"] = {**family, "files": [name for name in files if name]}
        return state, file

    def drop_autosave(self, ask: Mapping[str, Any]) -> dict[str, Any]:
        """Remove unsaved work."""
        _autosave(ask.get("key")).unlink(missing_ok=True)
        return {}

    def check_paths(self, state: Mapping[str, Any]) -> None:
        """Raise BadInputError unless every file that a state names may be read."""
        now = monotonic()
        checked_for_s = 1.0
        for key, given in files_named_in(state):
            if self._checked.get((key, str(given)), -1.0) > now:
                continue  # every move of the pointer asks
            if key == "recipe" and not self._is_path(key, given):
                continue
            path = self.allowed_path(key, given)
            if path not in self._watched:
                stamp = _stamp(path, LARGEST_MAP_BYTES)
                self._watch(path, "recipe" if key == "recipe" else "map", stamp)
            if len(self._checked) > 1000:
                self._checked.clear()
            self._checked[key, str(given)] = now + checked_for_s

    def allowed_path(self, key: str, given: object, *, to_write: bool = False) -> Path:
        """Return the file that a path of the page leads to, or raise BadInputError."""
        library = () if to_write else _library()
        real = path_inside(key, given, self.roots, PAGE, self.start, library)
        return real if to_write else existing_file(real)

    def is_writable(self, path: Path) -> bool:
        """Tell whether a file may be saved where it lies."""
        may_be = os.access(path.parent, os.W_OK) and not is_protected(path)
        return may_be and not _is_library(path)

    def shown(self, path: Path) -> str:
        """Return a path as the user would type it where the command was started."""
        return str(path.relative_to(self.start) if path.is_relative_to(self.start) else path)

    async def watch(self, broadcast: Broadcast) -> None:
        """Tell when an opened file changes on disk, until cancelled."""
        loop, polls = asyncio.get_running_loop(), False
        while True:
            more = asyncio.Event()
            self._more = lambda more=more: loop.call_soon_threadsafe(more.set)  # type: ignore[misc]
            await self._send_changes(list(self._watched), broadcast)
            folders = {path.parent for path in list(self._watched) if path.parent.is_dir()}
            if not folders:
                await more.wait()
                continue
            try:
                async for changes in watchfiles.awatch(
                    *sorted(folders),
                    watch_filter=None,
                    debounce=300,
                    step=50,
                    stop_event=more,
                    recursive=False,
                    force_polling=polls,
                ):
                    await self._send_changes([Path(path) for _, path in changes], broadcast)
            except OSError:
                # The folder went, or the system watches no more of them.
                polls = True
                await asyncio.sleep(1.0)

    async def _send_changes(self, paths: Sequence[Path], broadcast: Broadcast) -> None:
        for path in dict.fromkeys(path for path in paths if path in self._watched):
            event = await asyncio.to_thread(self._change, path)
            if event and not event["stamp"]:
                await asyncio.sleep(0.15)  # some editors move the old file away first
                event = await asyncio.to_thread(self._change, path)
            if event:
                self._known[path] = event["stamp"]
                broadcast(event)

    def _change(self, path: Path) -> dict[str, Any] | None:
        """Return the event of a file that is another than the tabs know; None if it is not."""
        kind = self._watched[path]
        design, problem = None, None
        if kind == "design":
            version = _version(path)
            stamp, design, problem = version.stamp, version.content, version.problem
            if version.text is not None and version.design is not None:
                self._texts[path] = version.text
        else:
            stamp = ""
            try:
                stamp = _stamp(path, LARGEST_MAP_BYTES)
                if stamp != self._known.get(path):
                    (Map.read if kind == "map" else read_profile)(path)
            except VinefabError as error:
                problem = str(error)
        if stamp == self._known.get(path):
            return None
        about = {"event": "file_changed", "kind": kind, "path": self.shown(path), "stamp": stamp}
        return {**about, "design": design, "problem": problem}

    def _watch(self, path: Path, kind: str, stamp: str) -> None:
        if path in self._watched:
            return
        self._known[path] = stamp
        self._watched[path] = kind
        self._more()

    def _named(self, kind: str, given: object) -> Path:
        """Return the file of a design or a recipe, given by its path or its name."""
        if not self._is_path(kind, given):
            given = locate(kind, str(given))
        return self.allowed_path(kind, given)

    def _is_path(self, key: str, given: object) -> bool:
        """Tell whether this is a path and no name of a shipped or own file."""
        return not is_name(given) or self.allowed_path(key, given, to_write=True).is_file()

    def _target(self, given: object, suffix: str = ".toml") -> Path:
        """Return the file that a design or a map may be written to."""
        path = self.allowed_path("path", given, to_write=True)
        if path.suffix.lower() != suffix:
            raise BadInputError("path", given, f"a name ending in {suffix}", PAGE)
        if _is_library(path):
            raise UnfitInputError(
                "path", "shipped and own designs are read only here", "give another name", PAGE
            )
        if not path.parent.is_dir():
            raise CannotWriteError(self.shown(path), "its folder does not exist")
        if os.path.lexists(path) and not path.is_file():
            raise CannotWriteError(self.shown(path), "not a plain file")
        if is_protected(path):
            raise CannotWriteError(self.shown(path), PROTECTED)
        return path

    def _new_text(
        self, path: Path, now: _Version, design: Design, source: object
    ) -> tuple[str, str]:
        """Return the text to write, and a note on it for the user."""
        if now.design is not None and now.text is not None:
            return edited_text(now.text, design, path), ""
        base = self._texts.get(path)
        if base is None and source is not None:
            opened = self._named("design", source)  # its text, if it still gives a design
            base = self._texts.get(opened) or _version(opened).text
        if base is None:
            return design_text(design), ""
        with suppress(CannotWriteError):
            return edited_text(base, design, path), ""
        return design_text(design), "its comments could not be taken over"


FILE_REQUESTS: dict[str, Callable[[FileStore, Mapping[str, Any]], dict[str, Any]]] = {
    "choices": FileStore.choices,
    "open_design": FileStore.open_design,
    "open_map": FileStore.open_map,
    "open_recipe": FileStore.open_recipe,
    "save_design": FileStore.save_design,
    "save_map": FileStore.save_map,
    "keep_autosave": FileStore.keep_autosave,
    "autosaves": FileStore.autosaves,
    "open_autosave": FileStore.open_autosave,
    "drop_autosave": FileStore.drop_autosave,
}
"""The requests of the page about files, by name."""


def _library() -> tuple[Path, ...]:
    """Return the folders of shipped and own files."""
    roots = [shipped_root(), user_root()]
    return tuple(
        Path(os.path.realpath(root / folder)) for root in roots for folder in KINDS.values()
    )


def _is_library(path: Path) -> bool:
    return any(path.is_relative_to(folder) for folder in _library())


def _version(path: Path) -> _Version:
    """Return the present content of a file, also if it gives no design or does not exist."""
    if not path.exists():
        return _Version("", problem=f"{path}: there is no such file")
    try:
        data = read_bytes(path, LARGEST_TOML_BYTES)
    except UnreadableFileError as error:
        return _Version("unreadable", problem=str(error))
    stamp = sha256_of(data)
    try:
        text = data.decode("utf-8")
        design = design_of(toml_content(text.removeprefix("\ufeff"), path), path)
        return _Version(stamp, text, design)
    except UnicodeDecodeError as error:
        return _Version(stamp, problem=f"{path}: is not UTF-8 text (byte {error.start})")
    except VinefabError as error:
        return _Version(stamp, problem=str(error))


def _stamp(path: Path, most_bytes: int) -> str:
    return sha256_of(read_bytes(path, most_bytes))


def _listed(roots: Sequence[Path]) -> tuple[list[Path], bool]:
    """Return the files below some folders, the nearest first, and whether these are all.

    Hidden ones and links are left out.
    """
    files: dict[Path, None] = {}
    left, open_folders = _MOST_LOOKED_AT, deque((root, 0) for root in roots)
    deepest_folder = 3
    while open_folders:
        folder, depth = open_folders.popleft()
        with suppress(OSError), os.scandir(folder) as entries:
            found = sorted(islice(entries, left + 1), key=lambda entry: entry.name)
            left -= len(found)
            if left < 0:
                return list(files), False
            shown = [e for e in found if not e.name.startswith(_HIDDEN) and not e.is_symlink()]
            files.update(dict.fromkeys(Path(entry.path) for entry in shown if entry.is_file()))
            if depth < deepest_folder:
                open_folders.extend((Path(e.path), depth + 1) for e in shown if e.is_dir())
    return list(files), True


def _kind(path: Path) -> str:
    """Return the kind of a file, by its name and its head."""
    if path.suffix.lower() == ".geojson":
        return "map"
    if path.suffix.lower() != ".toml":
        return ""
    with suppress(OSError), path.open("rb") as stream:
        found = _SCHEMA.search(stream.read(_HEAD_BYTES))
        return found.group(1).decode() if found else ""
    return ""
