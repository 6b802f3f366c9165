"""Exports: what the user chooses, the command, and the files that the command would write.

A snapshot is the state of the studio as one HTML file that needs neither server nor network. It is
the same page: its styles stand in the file, its modules as ``data:`` addresses of an import map,
and the state with the answers of the panels as JSON. Nothing in it depends on the day or the
computer, so the same state gives the same bytes. The map is in it too, so that it opens elsewhere.
"""

import base64
import json
import os
import re
import shlex
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, cast

from vinefab.core import __version__
from vinefab.core.atomic import (
    ensure_own_folder,
    ensure_writable,
    write_bytes,
    write_folder,
    write_text,
)
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    ExportRefusedError,
    ForeignFileError,
    UnknownNameError,
    UnreadableFileError,
    VinefabError,
)
from vinefab.core.front_door import ABOVE
from vinefab.core.hashing import marked
from vinefab.core.plain_text import GENERATOR, plain
from vinefab.core.progress import each
from vinefab.core.registry import with_parameters
from vinefab.core.validation import check_plain, whole
from vinefab.core.verbs import SHELL, Call, Shell
from vinefab.core.view import Block, Notes, lines, plain_blocks
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.model.design import Design, design_text
from vinefab.model.files.shipped import (
    DEFAULT_PRINTER,
    DEFAULT_RECIPE,
    path_inside,
    read_bytes,
    read_text,
)
from vinefab.model.finding import CheckReport
from vinefab.model.laser import RecipeStatus
from vinefab.model.map import Map, Pose, Start, map_text
from vinefab.pages.plan_svg import legend_rows
from vinefab.studio.executors import answer_of
from vinefab.studio.live_answers import load_kernel
from vinefab.studio.server import MODULES, PAGE_FOLDER
from vinefab.studio.state import (
    PAGE,
    StudioState,
    design_form,
    growth_form,
    is_name,
    mapping_at,
    world_of,
)

DESIGN_FILE, MAP_FILE = "design.toml", "map.geojson"
"""Names of the inputs of an export, in the folder next to it."""


@dataclass(frozen=True, slots=True)
class InputFile(os.PathLike[str]):
    """An input that a command names by the place where it will lie, and that is read elsewhere."""

    name: str
    path: Path

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExportSource:
    """The inputs of an export, with their names in its command."""

    design: Design
    design_name: str | InputFile  # a path from the start folder, or a shipped design's name
    map_name: str | InputFile  # empty where no map is open, or none is needed
    pose: Pose | None  # None: the map's first start
    recipe: str
    growth: GrowthOptions
    out: str  # what is written, as a path from the start folder
    inputs: Mapping[str, bytes]  # files that are written next to it first, by name

    @property
    def folder(self) -> Path:
        """The folder for its inputs."""
        return inputs_folder(Path(self.out))

    @property
    def open_map(self) -> str | InputFile:
        """The map, which some exports cannot do without."""
        if not self.map_name:
            raise BadInputError("map", None, "an open map", PAGE)
        return self.map_name

    @property
    def growth_given(self) -> dict[str, object]:
        """The growth options that the design would not be grown with by itself.

        Measured contacts are not among them: they have their own file.
        """
        usual = GrowthChoice.of([self.design]).options.values
        return {
            name: value
            for name, value in self.growth.values.items()
            if value != usual[name] and name != "contacts"
        }

    def read_from(self, folder: Path) -> "ExportSource":
        """Return the same with its ``inputs`` read from a folder until they are written."""
        for name, data in self.inputs.items():
            (folder / name).write_bytes(data)

        def read(name: str | InputFile, file: str) -> str | InputFile:
            lies_there = file in self.inputs and name == str(self.folder / file)
            return InputFile(str(name), folder / file) if lies_there else name

        return replace(
            self,
            design_name=read(self.design_name, DESIGN_FILE),
            map_name=read(self.map_name, MAP_FILE),
        )


class Export(ABC):
    """One kind of export; its fields are the choices of the user."""

    verb: ClassVar[str]  # its command
    mark: ClassVar[str] = ""  # the file by which its folder is known again; empty: it is one file
    endings: ClassVar[tuple[str, ...]] = ()  # of its name, if it is one file
    uses_map: ClassVar[bool] = True
    moves_start: ClassVar[bool] = False  # whether the page's start has to stand in the map

    @abstractmethod
    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageExport(Export):
    """The fabrication package."""

    zip: bool = False  # also as an archive
    allow_uncalibrated: bool = False  # for a recipe that no coupon has confirmed
    r12: bool = False  # also a DXF of release 12
    copies: int = 1  # robots on the bed
    verb: ClassVar[str] = "fabricate"
    mark: ClassVar[str] = "job.json"
    uses_map: ClassVar[bool] = False

    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""
        usual = source.recipe == DEFAULT_RECIPE and "recipe" not in source.design.origin
        return {
            "design": source.design_name,
            "recipe": None if usual else source.recipe,
            "out": source.out,
            "allow_uncalibrated": self.allow_uncalibrated,
            "copies": self.copies,
            "r12": self.r12,
            "make_zip": self.zip,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class RigExport(Export):
    """Printable obstacles."""

    printer: str = DEFAULT_PRINTER
    style: str = "auto"
    height_mm: float = 30.0
    fit_mm: float = 0.0  # length of the rig's longer side; 0: the map's size
    lid: bool = False
    check_robot: bool = True  # check corridors and heights for the design
    pictures: bool = True  # draw the plan and sheets; report.html
    verb: ClassVar[str] = "rig"
    mark: ClassVar[str] = "rig.json"
    moves_start: ClassVar[bool] = True

    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""
        return {
            "world": source.open_map,
            "printer": self.printer,
            "out": source.out,
            "design": source.design_name if self.check_robot else None,
            "fit_mm": self.fit_mm or None,
            "lid": self.lid,
            "pictures": self.pictures,
            "style": self.style,
            "height_mm": self.height_mm,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureExport(Export):
    """The grown robot on its map, still or in motion."""

    animate: bool = False
    frames: int = 24  # of the moving picture
    label: bool = False  # write branch ids in the still one
    verb: ClassVar[str] = "grow"
    endings: ClassVar[tuple[str, ...]] = (".svg", ".png", ".gif")

    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""
        pose = source.pose
        given: dict[str, Any] = {
            "design": source.design_name,
            "map": source.open_map,
            # As the command reads it: its heading in degrees.
            "pose": pose and (pose.x_mm, pose.y_mm, pose.heading_deg),
            "growth": source.growth_given,
        }
        suffix = Path(source.out).suffix.lower()
        if self.animate and suffix == ".png":
            raise BadInputError("out", source.out, "a name ending in .svg or .gif, to move", PAGE)
        if self.animate or suffix == ".gif":  # which always moves
            return {**given, "animate": source.out, "frames": self.frames}
        return {**given, "svg": source.out, "label": self.label}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportExport(Export):
    """Predictions as one page."""

    poses: int = 3  # drawn per map
    seed: int = 0  # of poses and unseen maps
    environment: str = ""  # predict for unseen maps of it too; empty: for the open map alone
    count: int = 40  # how many of these
    verb: ClassVar[str] = "report"
    endings: ClassVar[tuple[str, ...]] = (".html",)
    moves_start: ClassVar[bool] = True

    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""
        unseen = {"environment": self.environment, "count": self.count} if self.environment else {}
        most_poses = 1000
        return {
            "design": source.design_name,
            "recipe": source.recipe,
            "out": source.out,
            "maps": (source.map_name,) if source.map_name else (),
            **unseen,
            "poses": whole("poses", self.poses, 1, most_poses),
            "seed": self.seed,
            "growth": source.growth_given,
        }


EXPORTS: dict[str, type[Export]] = {
    "package": PackageExport,
    "report": ReportExport,
    "rig": RigExport,
    "picture": PictureExport,
}
"""Kinds of exports that are a command, by the name that the page asks for."""


def inputs_folder(out: Path) -> Path:
    """Return the folder for the design and the map that an export is made of."""
    return out.with_name(f"{out.name}.inputs")


def command_of(kind: Export, source: ExportSource) -> str:
    """Return the command line that makes an export."""
    verb = ABOVE.verb(kind.verb)
    return Call(function=verb, given=kind.given(source)).typed(kind.verb)


SNAPSHOT = "snapshot"
"""The export without a command: the page itself."""


def export_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Write an export, or return the commands that write the exports.

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
        return _commands(state, ask)
    try:
        if what == SNAPSHOT:
            path, given = _snapshot_path(ask, ask), mapping_at("options", ask.get("options") or {})
            reference, file = ask.get("reference"), ask.get("design_file")
            options = SnapshotOptions(
                family=given.get("family") is True,
                file=file if isinstance(file, str) else "",
                date=str(given.get("date") or ""),
                reference=None if reference is None else mapping_at("reference", reference),
            )
            ensure_writable(path)
            write_snapshot(mapping_at("state", ask.get("state")), path, options)
            written = {"command": _opens(path), "written": [str(path)]}
            return {**written, "inputs": [], "view": [], "refused": ""}
        kind = _kind(what, ask)
        return _export(kind, _source(state, ask, kind, ask.get("out")))
    except ForeignFileError as error:
        # What the page can do about a file that is not vinefab's: nothing is forced.
        problem = f"it {error.problem}; choose another name"
        raise CannotWriteError(error.path, problem) from None


def _commands(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    commands: dict[str, dict[str, Any]] = {}
    for name, one in mapping_at("exports", ask.get("exports")).items():
        try:
            if name == SNAPSHOT:
                commands[name] = {"command": _opens(_snapshot_path(ask, one)), "inputs": []}
                continue
            kind = _kind(name, mapping_at(f"exports.{name}", one))
            source = _source(state, ask, kind, one.get("out"))
            beside = [str(source.folder / file) for file in source.inputs]
            commands[name] = {"command": command_of(kind, source), "inputs": beside}
        except VinefabError as error:
            commands[name] = {"error": str(error)}
    unverified = state.profile.recipe.status is RecipeStatus.UNVERIFIED
    return {"commands": commands, "unverified": unverified}


def _export(kind: Export, source: ExportSource) -> dict[str, Any]:
    """Call the verb as its command would, and write the inputs that no file has."""
    out, verb = Path(source.out), ABOVE.verb(kind.verb)
    if source.inputs:  # before any long work: may they be written?
        ensure_own_folder(source.folder, DESIGN_FILE)
    answer: dict[str, Any] = {
        "command": command_of(kind, source),
        "written": [],
        "inputs": [],
        "view": [],
        "refused": "",
        "findings": [],
    }
    # The page hears the progress of the verb.
    shell = Shell(
        command=kind.verb, say=lambda _text: None, progress=lambda _title: nullcontext(_silent)
    )
    token = SHELL.set(shell)
    try:
        with TemporaryDirectory() as folder, _named(source, Path(folder)):
            found = verb(**kind.given(source.read_from(Path(folder))))
    except ExportRefusedError as error:
        findings = cast("CheckReport", error.report).findings
        return {
            **answer,
            "refused": error.reason,
            "findings": [one.content for one in findings],
        }
    finally:
        SHELL.reset(token)
    if source.inputs:
        write_folder(source.folder, source.inputs, DESIGN_FILE)
    written, view, findings = [out], found.view(), ()
    if kind.mark:
        written, view = [out / name for name in found.files], _told(found.summary, found.report)
        findings = found.report.findings
    archive = out.with_name(f"{out.name}.zip")
    if isinstance(kind, PackageExport) and kind.zip:
        written.append(archive)
    return {
        **answer,
        "written": [str(path) for path in written],
        "inputs": [str(source.folder / name) for name in source.inputs],
        "view": plain_blocks(view),
        "findings": [one.content for one in findings],
    }


def _told(summary: Sequence[str], report: CheckReport) -> Iterator[Block]:
    """Yield the summary of a folder, with the blocks of its report in place of their lines."""
    every = [(block, set(lines([block]))) for block in report.view()]
    shown = [block for block, said in every if said and said <= set(summary)]
    told = set(lines(shown))
    yield Notes(tuple(line for line in summary if line not in told))
    yield from shown


@contextmanager
def _named(source: ExportSource, folder: Path) -> Iterator[None]:
    """Let errors about inputs that are read from a folder name them as the command does."""
    names = {str(folder / name): source.folder / name for name in source.inputs}
    try:
        yield
    except (BadInputError, UnknownNameError) as error:
        if error.source not in names:
            raise
        raise error.at(names[error.source]) from None


def _kind(name: object, given: Mapping[str, Any]) -> Export:
    if not isinstance(name, str) or name not in EXPORTS:
        raise UnknownNameError("export", str(name), EXPORTS, PAGE)
    options = mapping_at("options", given.get("options") or {})
    return with_parameters(EXPORTS[name], name, options)


def _source(state: StudioState, ask: Mapping[str, Any], kind: Export, out: object) -> ExportSource:
    roots = _roots(ask)
    path = allowed_path("out", out, roots)
    if kind.endings and path.suffix.lower() not in kind.endings:
        allowed = f"a file name ending in {' or '.join(kind.endings)}"
        raise BadInputError("out", str(path), allowed, PAGE)
    inputs: dict[str, bytes] = {}
    folder = inputs_folder(path)
    design_name = ""  # nothing where no file has the design as it is
    if isinstance(given := ask.get("design_file"), str):
        with suppress(VinefabError):
            name = given if is_name(given) else str(allowed_path("design_file", given, roots))
            if design_text(Design.read(name)) == design_text(state.design):
                design_name = name
    map_name = ""
    if kind.uses_map and (world := _world(state, kind)):
        if isinstance(given := ask.get("map_file"), str):
            with suppress(VinefabError):
                file = allowed_path("map_file", given, roots)
                if map_text(Map.read(file)) == map_text(world):
                    map_name = str(file)
        if not map_name:
            map_name = str(folder / MAP_FILE)
            inputs[MAP_FILE] = map_text(world).encode()
    if inputs or not design_name:
        inputs = {DESIGN_FILE: design_text(state.design).encode(), **inputs}
    return ExportSource(
        design=state.design,
        design_name=design_name or str(folder / DESIGN_FILE),
        map_name=map_name,
        pose=state.pose,
        recipe=state.recipe,
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


def allowed_path(key: str, given: object, roots: tuple[Path, ...]) -> Path:
    """Return a path that lies in one of the folders, as it is called in the start folder."""
    if not isinstance(given, str) or not given or not given.isprintable() or len(given) > 4096:
        raise BadInputError(key, given, "a path", PAGE)
    real = path_inside(key, given, roots, PAGE, Path.cwd())
    if real in roots:  # the folder of its inputs lies next to an export
        allowed = f"a path in {' or '.join(map(str, roots))}"
        raise BadInputError(key, given, allowed, PAGE)
    here = Path(os.path.realpath(Path.cwd()))
    shown = real.relative_to(here) if real.is_relative_to(here) else real
    return real if str(shown).startswith("-") else shown


def _roots(ask: Mapping[str, Any]) -> tuple[Path, ...]:
    given = ask.get("roots") or [str(Path.cwd())]
    return tuple(Path(os.path.realpath(root)) for root in given)


def _snapshot_path(ask: Mapping[str, Any], given: Mapping[str, Any]) -> Path:
    path = allowed_path("out", given.get("out"), _roots(ask))
    if path.suffix.lower() != ".html":
        raise BadInputError("out", str(path), "a file name ending in .html", PAGE)
    return path


def _opens(path: Path) -> str:
    """Return the command that opens a snapshot in the studio."""
    return shlex.join(["vinefab", "studio", str(path)])


# --- Snapshots ----------------------------------------------------------------------------------

_SCHEMA = "vinefab/snapshot-1"
MOST_BYTES = 1 << 27
_TEMPLATES = Path(__file__).parents[1] / "pages" / "templates"

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
    options = options or SnapshotOptions()
    load_kernel()  # what has to wait for it on the page is in the file
    panels = ("live", "cut", "rules", *(("family",) if options.family else ()))
    answers = {}
    for panel in each("panels", panels, str):
        answers[panel] = answer_of(panel, state, {})
    if options.reference is not None:
        before = {**state, "design": options.reference}
        again = each("panels of the version before", panels, str)
        found = {panel: answer_of(panel, before, {"ground": False}) for panel in again}
        answers["reference"] = {"design": options.reference, "answers": found}
    return write_bytes(path, snapshot_html(state, answers, options), force=force)


def snapshot_html(
    state: Mapping[str, Any], answers: Mapping[str, Any], options: SnapshotOptions | None = None
) -> bytes:
    """Return a state with the answers of its panels as one HTML file."""
    options = options or SnapshotOptions()
    portable: dict[str, Any] = json.loads(json.dumps(state, allow_nan=False))
    # Its files are called by their names alone: paths are private.
    if "file" in (shown := map_source(portable)):
        shown["file"] = Path(str(shown["file"])).name
    family = portable.get("family")
    if isinstance(family, dict) and family.get("files"):
        family["files"] = [Path(str(name)).name for name in family["files"]]
    if portable.get("recipe"):
        portable["recipe"] = Path(str(portable["recipe"])).name
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
    source = map_source(state)  # of the map that the state's edits are made to
    stored = {
        "schema": _SCHEMA,
        "date": options.date,
        "hello": hello,
        "map": map_text(world_of({"source": source})) if "file" in source else None,
        "answers": answers,
    }

    def style(link: re.Match[str]) -> str:  # as it stands in its file; an icon stays as it is
        if not link[1].endswith(".css"):
            return link[0]
        name = link[1].rpartition("/")[2]
        folder = _TEMPLATES if name == "plan.css" else PAGE_FOLDER
        text = (folder / name).read_text(encoding="utf-8").replace("</", "<\\/")
        return f"<style>\n{text}</style>"

    page = (PAGE_FOLDER / "index.html").read_text(encoding="utf-8")
    page = _LINK.sub(style, page.replace(_CHARSET, f"{_CHARSET}\n{_HEAD}", 1))
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
        raise UnreadableFileError(path, f"its state is not JSON: {error}") from None
    schema = stored.get("schema") if isinstance(stored, dict) else None
    if schema != _SCHEMA:
        raise BadInputError("schema", schema, _SCHEMA, path)
    hello = stored.get("hello")
    state = hello.get("state") if isinstance(hello, dict) else None
    if not isinstance(state, dict):
        raise BadInputError("state", state, "names with values", path)
    source = map_source(state)
    if "file" in source and not isinstance(stored.get("map"), str):
        raise BadInputError("map", stored.get("map"), "the text of a map file", path)
    try:
        check_plain(state, finite=False)
        if isinstance(state.get("family"), dict):
            state["family"].pop("files", None)
        if (recipe := state.get("recipe")) and not is_name(recipe):
            # It lies next to the snapshot, or where the command was started.
            folders = (path.parent, Path.cwd())
            found = [path_inside("recipe", recipe, folders, path, base) for base in folders]
            state["recipe"] = str(next((file for file in found if file.is_file()), found[0]))
        if "file" not in source:
            StudioState.of(state)
            return state
        with TemporaryDirectory() as folder:
            source["file"] = str(Path(folder) / "map.geojson")
            Path(source["file"]).write_text(stored["map"], encoding="utf-8")
            try:  # as it is written, once it has shown that it can be read
                text = map_text(Map.read(source["file"]))
            except BadInputError as error:
                raise error.under(f"map.{error.key}", path) from None
            except UnreadableFileError as error:
                raise UnreadableFileError(path, f"its map {error.problem}") from None
            StudioState.of(state)  # before anything is written
    except (BadInputError, UnknownNameError) as error:  # the snapshot is named, not the page
        raise (error.at(path) if error.source in {None, PAGE} else error) from error
    source["file"] = str(_map_beside(path, text))
    return state


def _map_beside(path: Path, text: str) -> Path:
    """Write the map of a snapshot next to it; a file with another content stays."""
    most_maps = 100
    for number in range(1, most_maps):
        file = path.with_name(f"{path.stem}.map{'' if number == 1 else f'-{number}'}.geojson")
        if not file.exists():
            return write_text(file, text)
        if read_bytes(file, MOST_BYTES) == marked(text.encode()):
            return file
    raise CannotWriteError(file, "too many maps of this snapshot lie next to it")


def map_source(state: Mapping[str, Any]) -> dict[str, Any]:
    """Return the source of a state's map; empty if none is open."""
    world = state.get("map")
    source = world.get("source") if isinstance(world, dict) else None
    return source if isinstance(source, dict) else {}


def _silent(_progress: object) -> None:
    """Show no progress."""
