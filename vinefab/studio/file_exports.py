"""Exports: what the user chooses, the command, and the files that the command would write."""

import os
import shlex
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

from vinefab.core.atomic import ensure_own_folder, ensure_writable, write_bytes, write_folder
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    ForeignFileError,
    UnknownNameError,
    VinefabError,
)
from vinefab.core.front_door import front_door
from vinefab.core.registry import with_parameters
from vinefab.core.validation import whole
from vinefab.core.verbs import Call
from vinefab.core.view import Block, plain_blocks
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.model.design import Design, design_text
from vinefab.model.files.shipped import DEFAULT_PRINTER, DEFAULT_RECIPE, path_inside
from vinefab.model.finding import CheckReport
from vinefab.model.laser import LaserProfile, RecipeStatus
from vinefab.model.map import Map, Pose, Start, map_text
from vinefab.studio.executors import Progress
from vinefab.studio.snapshot import SnapshotOptions, write_snapshot
from vinefab.studio.state import PAGE, StudioState, is_name, mapping_at

# ruff: noqa: PLC0415  what an export needs is loaded when it is made: a command line is quick


DESIGN_FILE, MAP_FILE = "design.toml", "map.geojson"
"""Names of the inputs of an export, in the folder next to it."""

_MOST_COPIES = 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExportSource:
    """The inputs of an export, with their names in its command."""

    design: Design
    design_name: str  # a path from the start folder, or a shipped design's name
    world: Map | None  # None where no map is open, or none is needed
    map_name: str
    pose: Pose | None  # None: the map's first start
    recipe: str
    profile: LaserProfile
    growth: GrowthOptions
    out: str  # what is written, as a path from the start folder
    inputs: Mapping[str, bytes]  # files that are written next to it first, by name

    @property
    def folder(self) -> Path:
        """The folder for its inputs."""
        return inputs_folder(Path(self.out))

    @property
    def growth_given(self) -> dict[str, object]:
        """The growth options that the design would not be grown with by itself."""
        usual = GrowthChoice.of([self.design]).options.values
        return {n: value for n, value in self.growth.values.items() if value != usual[n]}

    def as_read(self) -> "ExportSource":
        """Return the same with the design and the map that reading ``inputs`` gives."""
        with TemporaryDirectory() as name:
            for file, data in self.inputs.items():
                (Path(name) / file).write_bytes(data)
            design, world = self.design, self.world
            if DESIGN_FILE in self.inputs:
                design = Design.read(Path(name) / DESIGN_FILE)
            if MAP_FILE in self.inputs:
                world = Map.read(Path(name) / MAP_FILE)
        return replace(self, design=design, world=world)


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeExport:
    """An export that is ready to be written."""

    files: Mapping[str, bytes] = field(default_factory=dict)  # by name; of one file, by ""
    beside: Mapping[str, bytes] = field(default_factory=dict)  # further files, by path
    view: tuple[Block, ...] = ()  # what the command would say
    refused: str = ""  # why nothing may be written
    findings: tuple[Mapping[str, Any], ...] = ()  # as in ``vinefab/checks-1``


class Export(ABC):
    """One kind of export; its fields are the choices of the user."""

    verb: ClassVar[str]  # the function that its command calls, ``MODULE.NAME`` of `vinefab.app`
    mark: ClassVar[str] = ""  # the file by which its folder is known again; empty: it is one file
    endings: ClassVar[tuple[str, ...]] = ()  # of its name, if it is one file
    uses_map: ClassVar[bool] = True
    moves_start: ClassVar[bool] = False  # whether the page's start has to stand in the map

    @abstractmethod
    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""

    @abstractmethod
    def make(self, source: ExportSource, progress: Progress) -> MadeExport:
        """Return the files, or what forbids them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PackageExport(Export):
    """The fabrication package."""

    zip: bool = False  # also as an archive
    allow_uncalibrated: bool = False  # for a recipe that no coupon has confirmed
    r12: bool = False  # also a DXF of release 12
    copies: int = 1  # robots on the bed
    verb: ClassVar[str] = "making.fabricate"
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

    def make(self, source: ExportSource, progress: Progress) -> MadeExport:
        """Return the files of the package, or what forbids them."""
        from vinefab.fabrication.job.placement import SheetOptions
        from vinefab.fabrication.package.prepare import package, prepare, zip_bytes

        progress(0.1, "paths and rules")
        copies = whole("copies", self.copies, 1, _MOST_COPIES)
        sheet = SheetOptions(copies=copies)
        prepared = prepare(source.design, source.profile, sheet=sheet, r12=self.r12)
        made = MadeExport(
            view=tuple(prepared.report.view()),
            refused=prepared.refusal(allow_uncalibrated=self.allow_uncalibrated),
            findings=_findings(prepared.report),
        )
        if made.refused:
            return made
        progress(0.5, "pictures and pages")
        files, archive = package(prepared), Path(source.out)
        archive = archive.with_name(f"{archive.name}.zip")
        beside = {str(archive): zip_bytes(files, source.design.name)} if self.zip else {}
        return replace(made, files=files, beside=beside)


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
    verb: ClassVar[str] = "making.rig"
    mark: ClassVar[str] = "rig.json"
    moves_start: ClassVar[bool] = True

    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""
        return {
            "world": source.map_name,
            "printer": self.printer,
            "out": source.out,
            "design": source.design_name if self.check_robot else None,
            "fit_mm": self.fit_mm or None,
            "lid": self.lid,
            "pictures": self.pictures,
            "style": self.style,
            "height_mm": self.height_mm,
        }

    def make(self, source: ExportSource, progress: Progress) -> MadeExport:
        """Return the files of the rig, or what forbids them."""
        from vinefab.rig.make import RigRequest, make_rig
        from vinefab.rig.part import RigOptions, read_printer

        world = _map_of(source)
        options = RigOptions(style=self.style, height_mm=self.height_mm)
        if self.fit_mm:
            options = options.fitted(world, self.fit_mm)
        robot = source.design if self.check_robot else None
        request = RigRequest(design=robot, lid=self.lid, pictures=self.pictures)
        made = make_rig(world, read_printer(self.printer), options, request, progress=progress)
        blocking = ", ".join(sorted({finding.rule for finding in made.report.blocking}))
        return MadeExport(
            files=made.files,
            view=tuple((made.report if blocking else made).view()),
            refused=f"{blocking} forbid it" if blocking else "",
            findings=_findings(made.report),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureExport(Export):
    """The grown robot on its map, still or in motion."""

    animate: bool = False
    frames: int = 24  # of the moving picture
    label: bool = False  # write branch ids in the still one
    verb: ClassVar[str] = "predicting.grow"
    endings: ClassVar[tuple[str, ...]] = (".svg", ".png", ".gif")

    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""
        given: dict[str, Any] = {
            "design": source.design_name,
            "map": source.map_name,
            "pose": source.pose,
            "growth": _without_contacts(source.growth_given),
        }
        if self._moves(source):
            return {**given, "animate": source.out, "frames": self.frames}
        return {**given, "out": source.out, "label": self.label}

    def make(self, source: ExportSource, progress: Progress) -> MadeExport:
        """Return the picture."""
        from vinefab.prediction.deploy import MOST_FRAMES, deploy

        world, suffix = _map_of(source), Path(source.out).suffix
        whole("frames", self.frames, 1, MOST_FRAMES)
        progress(0.1, "growing")
        pose = source.pose
        if pose is not None:  # the command reads its heading in degrees
            pose = Pose.of((pose.x_mm, pose.y_mm, pose.heading_deg))
        found = deploy(source.design, world, pose, source.growth_given)
        progress(0.3, "drawing")
        if self._moves(source):
            data = found.animation(suffix, self.frames)
        else:
            data = found.picture(suffix, named=self.label)
        return MadeExport(files={"": data}, view=tuple(found.view()))

    def _moves(self, source: ExportSource) -> bool:
        """Tell whether it is a moving picture, which a GIF always is."""
        suffix = Path(source.out).suffix.lower()
        if self.animate and suffix == ".png":
            raise BadInputError("out", source.out, "a name ending in .svg or .gif, to move", PAGE)
        return self.animate or suffix == ".gif"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportExport(Export):
    """Predictions as one page."""

    poses: int = 3  # drawn per map
    seed: int = 0  # of poses and unseen maps
    environment: str = ""  # predict for unseen maps of it too; empty: for the open map alone
    count: int = 40  # how many of these
    verb: ClassVar[str] = "predicting.report"
    endings: ClassVar[tuple[str, ...]] = (".html",)
    moves_start: ClassVar[bool] = True

    def given(self, source: ExportSource) -> dict[str, Any]:
        """Return the arguments of the verb."""
        unseen = {"environment": self.environment, "count": self.count} if self.environment else {}
        return {
            "design": source.design_name,
            "recipe": source.recipe,
            "out": source.out,
            "maps": (source.map_name,) if source.world else (),
            **unseen,
            "poses": self.poses,
            "seed": self.seed,
            "growth": _without_contacts(source.growth_given),
        }

    def make(self, source: ExportSource, progress: Progress) -> MadeExport:
        """Return the page."""
        from vinefab.prediction.family_deployments import (
            PredictionPlan,
            map_families,
            origin_of,
            part_of,
            unseen_maps,
        )
        from vinefab.prediction.predict import predict

        unseen = None
        if self.environment:
            unseen = unseen_maps(self.environment, self.count, self.seed)
        families = map_families([source.world] if source.world else [], unseen)
        poses = whole("poses", self.poses, 1, 1000)
        plan = PredictionPlan(poses=poses, seed=self.seed, options=source.growth)
        found = predict(source.design, source.profile, families, plan, part_of(progress, 0.0, 0.6))
        origin = origin_of(command_of(self, source), [source.design], source.profile, families)
        page = replace(found, origin=origin).page(part_of(progress, 0.6, 1.0))
        return MadeExport(files={"": page.encode()}, view=tuple(found.view()))


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
    module, _, name = kind.verb.partition(".")
    verb = getattr(front_door(f"app.{module}"), name)
    return Call(function=verb, given=kind.given(source)).typed(name)


def _without_contacts(growth: Mapping[str, object]) -> dict[str, object]:
    """Return growth options without the contacts, which have their own file."""
    return {name: value for name, value in growth.items() if name != "contacts"}


def _map_of(source: ExportSource) -> Map:
    if source.world is None:
        raise BadInputError("map", None, "an open map", PAGE)
    return source.world


def _findings(report: CheckReport) -> tuple[Mapping[str, Any], ...]:

    return tuple([finding.content for finding in report.findings])


SNAPSHOT = "snapshot"
"""The export without a command: the page itself."""


def export_answer(state: StudioState, ask: Mapping[str, Any], progress: Progress) -> dict[str, Any]:
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
        given = mapping_at("exports", ask.get("exports"))
        commands: dict[str, dict[str, Any]] = {}
        for name, one in given.items():
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
    if what == SNAPSHOT:
        return _snapshot(ask, progress)
    kind = _kind(what, ask)
    source = _source(state, ask, kind, ask.get("out"))
    with _foreign_files_named():
        return _written(kind, source, progress)


def _written(kind: Export, source: ExportSource, progress: Progress) -> dict[str, Any]:
    out = Path(source.out)
    # Before any long work: may everything be written?
    if source.inputs:
        ensure_own_folder(source.folder, DESIGN_FILE)
    if kind.mark:
        ensure_own_folder(out, kind.mark)
    else:
        ensure_writable(out)
    if isinstance(kind, PackageExport) and kind.zip:
        ensure_writable(out.with_name(f"{out.name}.zip"))
    source = source.as_read()
    made = kind.make(source, progress)
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
    progress(0.99, "writing")
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
    world, map_name = None, ""
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


def _snapshot(ask: Mapping[str, Any], progress: Progress) -> dict[str, Any]:
    path = _snapshot_path(ask, ask)
    given = mapping_at("options", ask.get("options") or {})
    reference, file = ask.get("reference"), ask.get("design_file")
    options = SnapshotOptions(
        family=given.get("family") is True,
        file=file if isinstance(file, str) else "",
        date=str(given.get("date") or ""),
        reference=None if reference is None else mapping_at("reference", reference),
    )
    with _foreign_files_named():
        ensure_writable(path)
        write_snapshot(mapping_at("state", ask.get("state")), path, options, progress)
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
