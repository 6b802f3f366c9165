"""What the page exports: the files that a command would write, and that command.

The command beside a button, run in the folder where the studio was started, writes the same bytes.
What is not in a file yet, or not as the page shows it, is written beside the export first: the
folder ``OUT.inputs`` with ``design.toml`` and, if needed, ``map.geojson``. The export is made of
what these files say when read back, rounding included.
"""

import os
import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from vinefab.core.atomic import ensure_own_folder, ensure_writable, write_bytes, write_folder
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    ForeignFileError,
    UnknownNameError,
    VinefabError,
)
from vinefab.core.registry import with_parameters
from vinefab.core.view import plain_blocks
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_text
from vinefab.model.files.map_geojson import map_text
from vinefab.model.files.shipped import path_inside
from vinefab.model.laser import RecipeStatus
from vinefab.model.map import Map, Start
from vinefab.studio.edited_map import PAGE
from vinefab.studio.exports import (
    DESIGN_FILE,
    EXPORTS,
    MAP_FILE,
    Export,
    ExportSource,
    PackageExport,
    command_of,
    inputs_folder,
)
from vinefab.studio.panels import Tell
from vinefab.studio.snapshot import SnapshotOptions, write_snapshot
from vinefab.studio.state import StudioState

SNAPSHOT = "snapshot"
"""The export that is no command: what the page shows."""


def export_answer(state: StudioState, ask: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    """Write what the page asks for, or say by which commands it can be written.

    Parameters
    ----------
    ask
        ``what`` (a key of `EXPORTS`, `SNAPSHOT`, or ``command``), ``out``, ``options``; the
        files that design and map come from, ``design_file`` and ``map_file``; and from the server
        ``roots``, the folders that may be written to, and the ``state`` as it was sent. For
        ``command``, ``exports`` has ``out`` and ``options`` by kind.
    """
    what = ask.get("what")
    if what == "command":
        given = _mapping("exports", ask.get("exports"))
        commands = {name: _command(state, ask, name, given[name]) for name in given}
        unverified = state.profile.recipe.status is RecipeStatus.UNVERIFIED
        return {"commands": commands, "unverified": unverified}
    if what == SNAPSHOT:
        return _snapshot(ask, tell)
    kind = _kind(what, ask)
    source = _source(state, ask, kind, ask.get("out"))
    with _foreign_files_named():
        return _written(kind, source, tell)


def _written(kind: Export, source: ExportSource, tell: Tell) -> dict[str, Any]:
    out = Path(source.out)
    _ensure(kind, source, out)
    source = source.as_read()
    made = kind.make(source, tell)
    answer: dict[str, Any] = {
        "command": command_of(kind, source),
        "written": [],
        "inputs": [],
        "view": plain_blocks(made.view),
        "refused": made.refused,
        "findings": list(made.findings),
    }
    if made.refused:
        return answer
    tell(0.99, "writing")
    if source.inputs:
        write_folder(source.folder, source.inputs, DESIGN_FILE)
        answer["inputs"] = [str(source.folder / name) for name in source.inputs]
    if kind.mark:
        write_folder(out, made.files, kind.mark)
        answer["written"] = [str(out / name) for name in made.files]
    else:
        answer["written"] = [str(write_bytes(out, made.files[""]))]
    for name, data in made.beside.items():
        answer["written"] += [str(write_bytes(Path(name), data))]
    return answer


def _ensure(kind: Export, source: ExportSource, out: Path) -> None:
    """Check, before any long work, that everything may be written."""
    if source.inputs:
        ensure_own_folder(source.folder, DESIGN_FILE)
    if kind.mark:
        ensure_own_folder(out, kind.mark)
    else:
        ensure_writable(out)
    if isinstance(kind, PackageExport) and kind.zip:
        ensure_writable(out.with_name(f"{out.name}.zip"))


def _command(
    state: StudioState, ask: Mapping[str, Any], name: str, given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a command line and what would be written for it first, or why there is none."""
    try:
        if name == SNAPSHOT:
            return {"command": _opens(_snapshot_path(ask, given)), "inputs": []}
        kind = _kind(name, _mapping(f"exports.{name}", given))
        source = _source(state, ask, kind, given.get("out"))
        command = command_of(kind, source)
    except VinefabError as error:
        return {"error": str(error)}
    return {"command": command, "inputs": [str(source.folder / file) for file in source.inputs]}


def _kind(name: object, given: Mapping[str, Any]) -> Export:
    if not isinstance(name, str) or name not in EXPORTS:
        raise UnknownNameError("export", str(name), EXPORTS, PAGE)
    options = _mapping("options", given.get("options") or {})
    return with_parameters(EXPORTS[name], name, options)


def _source(state: StudioState, ask: Mapping[str, Any], kind: Export, out: object) -> ExportSource:
    roots = _roots(ask)
    path = allowed_path("out", out, roots)
    if kind.endings and path.suffix.lower() not in kind.endings:
        allowed = f"a file name ending in {' or '.join(kind.endings)}"
        raise BadInputError("out", str(path), allowed, PAGE)
    inputs: dict[str, bytes] = {}
    folder = inputs_folder(path)
    design_name = _saved_design(state.design, ask.get("design_file"), roots)
    world, map_name = None, ""
    if kind.uses_map and (world := _world(state, kind)):
        map_name = _saved_map(world, ask.get("map_file"), roots)
        if not map_name:
            map_name = str(folder / MAP_FILE)
            inputs[MAP_FILE] = map_text(world).encode()
    if inputs or not design_name:
        inputs = {DESIGN_FILE: design_text(state.design).encode(), **inputs}
    return ExportSource(
        design=state.design,
        design_name=design_name or str(folder / DESIGN_FILE),
        world=world,
        map_name=map_name,
        pose=state.pose,
        recipe=state.recipe,
        profile=state.profile,
        growth=state.growth,
        out=str(path),
        inputs=inputs,
    )


def _world(state: StudioState, kind: Export) -> Map | None:
    """Return the open map; where it matters, its first start is where the page shows it."""
    world, pose = state.world, state.pose
    if world is None or pose is None or not kind.moves_start:
        return world
    first = world.starts[0] if world.starts else Start(pose=pose)
    if first.pose == pose and world.starts:
        return world
    # A start that was moved away from its line or area stands where it is shown.
    moved = (first.pose.x_mm, first.pose.y_mm) != (pose.x_mm, pose.y_mm)
    first = replace(first, pose=pose, area=None if moved else first.area)
    return replace(world, starts=(first, *world.starts[1:]))


def _saved_design(design: Design, given: object, roots: tuple[Path, ...]) -> str:
    """Return what a command calls the design, or nothing if no file has it as it is."""
    if not isinstance(given, str):
        return ""
    try:
        bare = Path(given).name == given and not Path(given).suffix
        name = given if bare else str(allowed_path("design_file", given, roots))
        saved = Design.read(name)
    except VinefabError:
        return ""
    return name if design_text(saved) == design_text(design) else ""


def _saved_map(world: Map, given: object, roots: tuple[Path, ...]) -> str:
    """Return what a command calls the map, or nothing if no file has it as it is."""
    if not isinstance(given, str):
        return ""
    try:
        path = allowed_path("map_file", given, roots)
        saved = Map.read(path)
    except VinefabError:
        return ""
    return str(path) if map_text(saved) == map_text(world) else ""


def allowed_path(key: str, given: object, roots: tuple[Path, ...]) -> Path:
    """Return a path that lies in one of the folders, as it is called in the start folder."""
    if not isinstance(given, str) or not given or not given.isprintable() or len(given) > 4096:
        raise BadInputError(key, given, "a path", PAGE)
    real = path_inside(key, given, roots, PAGE, Path.cwd())
    if real in roots:  # beside an export lies the folder of its inputs
        allowed = f"a path in {' or '.join(map(str, roots))}"
        raise BadInputError(key, given, allowed, PAGE)
    here = Path(os.path.realpath(Path.cwd()))
    shown = real.relative_to(here) if real.is_relative_to(here) else real
    return real if str(shown).startswith("-") else shown


def _roots(ask: Mapping[str, Any]) -> tuple[Path, ...]:
    given = ask.get("roots") or [str(Path.cwd())]
    return tuple(Path(os.path.realpath(root)) for root in given)


def _snapshot(ask: Mapping[str, Any], tell: Tell) -> dict[str, Any]:
    path = _snapshot_path(ask, ask)
    given = _mapping("options", ask.get("options") or {})
    reference, file = ask.get("reference"), ask.get("design_file")
    options = SnapshotOptions(
        family=given.get("family") is True,
        file=file if isinstance(file, str) else "",
        date=str(given.get("date") or ""),
        reference=None if reference is None else _mapping("reference", reference),
    )
    with _foreign_files_named():
        ensure_writable(path)
        write_snapshot(_mapping("state", ask.get("state")), path, options, tell)
    command = _opens(path)
    return {"command": command, "written": [str(path)], "inputs": [], "view": [], "refused": ""}


def _snapshot_path(ask: Mapping[str, Any], given: Mapping[str, Any]) -> Path:
    path = allowed_path("out", given.get("out"), _roots(ask))
    if path.suffix.lower() != ".html":
        raise BadInputError("out", str(path), "a file name ending in .html", PAGE)
    return path


def _opens(path: Path) -> str:
    """Return the command that opens a snapshot in the studio."""
    return shlex.join(["vinefab", "studio", str(path)])


@contextmanager
def _foreign_files_named() -> Iterator[None]:
    """Say of a file that is not vinefab's what the page can do about it: nothing is forced."""
    try:
        yield
    except ForeignFileError as error:
        problem = f"it {error.problem}; choose another name"
        raise CannotWriteError(error.path, problem) from error


def _mapping(key: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise BadInputError(key, value, "names with values", PAGE)
    return value
