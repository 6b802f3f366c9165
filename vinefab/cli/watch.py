"""``vinefab watch``: everything about a design, after every save."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vinefab.cli.common_options import (
    EXIT_FINDINGS,
    CommandOutput,
    DesignIn,
    DesignRecipeIn,
    Force,
    GrowthIn,
    Quiet,
    growth_choice,
    growth_from,
)
from vinefab.core.atomic import ensure_writable, write_bytes
from vinefab.core.errors import VinefabError
from vinefab.core.interruption import stops_expected
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.model.files.run_recipe import ChosenRecipe
from vinefab.model.files.shipped import DEFAULT_RECIPE, existing_file, locate

if TYPE_CHECKING:
    from vinefab.prediction.design_version import DesignVersion

LOOK_EVERY_S = 0.2
"""Files are looked at so often; a change counts when the next look finds no other."""

Stamp = tuple[tuple[int, int, int], ...]


def watch_command(
    *,
    design: DesignIn,
    map_file: Annotated[Path, typer.Option("--map", help="The map file.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the pictures; default: the design's name and _watch."),
    ] = None,
    recipe: DesignRecipeIn = None,
    task: Annotated[str, typer.Option(help="coverage, reach or anchoring.")] = "coverage",
    growth: GrowthIn = None,
    once: Annotated[
        bool, typer.Option("--once", help="Look once; exit code 1 if an error forbids cutting it.")
    ] = False,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """Grow, score and check a design at once and after every save of it, the map or the recipe.

    Each time it says what changed, and replaces the pictures grown.svg and sheet.svg. A file that
    cannot be read costs one line; Ctrl-C ends the command.

    Example: vinefab watch mine.toml --map table.geojson --out pictures
    """
    output = CommandOutput(quiet=quiet, force=force)
    watched = _Watched(
        design=design, map_file=map_file, recipe=recipe, task=task, given=growth_from(growth)
    )
    watched.check()
    folder = out or Path(f"{Path(design).stem}_watch")
    for name in ("grown.svg", "sheet.svg"):
        ensure_writable(folder / name, force=force)
    if once:
        version = _shown(output, watched, None, folder)
        return EXIT_FINDINGS if version.report.blocking else 0
    with stops_expected():
        try:
            _watch(output, watched, folder)
        except KeyboardInterrupt:
            output.say(f"no longer watching {design}")
    return 0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Watched:
    """What is looked at."""

    design: str
    map_file: Path
    recipe: str | None  # None: as the design says
    task: str
    given: Mapping[str, object]  # growth options

    @property
    def files(self) -> tuple[Path, ...]:
        """The files, followed to where they are."""
        found = (
            locate("design", self.design),
            existing_file(self.map_file),
            locate("recipe", self._recipe),
        )
        return tuple(path.resolve() for path in found)

    @property
    def _recipe(self) -> str:
        """What the recipe is read by; the default where the design cannot be read, as is shown."""
        try:
            return self.recipe or ChosenRecipe.of(read_design(self.design)).recipe
        except VinefabError:
            return DEFAULT_RECIPE

    def check(self) -> None:
        """Refuse what no save could mend: files that are not there, unknown names."""
        from vinefab.growth.options import GrowthOptions  # noqa: PLC0415  as below
        from vinefab.tasks.shipped_tasks import make_task  # noqa: PLC0415  as below

        _stamp(self.files)
        make_task(self.task)
        GrowthOptions.of(self.given)

    def version(self, output: CommandOutput) -> "DesignVersion":
        """Return what the files give now."""
        # The simulator is loaded when it is needed.
        from vinefab.prediction.design_version import DesignVersion  # noqa: PLC0415
        from vinefab.prediction.scoring import ScorePlan  # noqa: PLC0415

        robot, world = read_design(self.design), read_map(self.map_file)
        growth_choice([self.design], [robot], self.given)
        plan = ScorePlan(task=self.task)
        profile = output.recipe_of(robot, self.recipe).profile
        return DesignVersion.of(robot, world, profile, plan, self.given)


def _watch(output: CommandOutput, watched: _Watched, folder: Path) -> None:
    """Show a version now, and another after every change."""
    before: DesignVersion | None = None
    for _ in _changes(watched.files):
        try:
            before = _shown(output, watched, before, folder)
        except VinefabError as error:
            kept = "; the pictures are those of the version before" if before else ""
            output.say(f"{time.strftime('%H:%M:%S')} error: {' '.join(str(error).split())}{kept}")


def _shown(
    output: CommandOutput, watched: _Watched, before: "DesignVersion | None", folder: Path
) -> "DesignVersion":
    """Show what the files give now beside what they gave before, and replace the pictures."""
    began = time.monotonic()
    version = watched.version(output)
    for name, draw in version.pictures().items():
        write_bytes(folder / name, draw(), force=output.force)
    lines = version.lines(before)
    took = f"{time.monotonic() - began:.1f} s"
    name, where = version.design.name, version.deployed.world.name
    output.say(f"{time.strftime('%H:%M:%S')} {name} on {where}, pictures in {folder} ({took})")
    for line in lines:
        output.say(line)
    return version


def _changes(paths: Sequence[Path]) -> Iterator[None]:
    """Give a turn at once, and one after every change of a file that is over."""
    seen: Stamp | None = None
    while True:
        now = _stamp(paths)
        if now != seen:
            # Some editors empty a file before they fill it, or move it away.
            time.sleep(LOOK_EVERY_S / 2)
            if _stamp(paths) != now:
                continue
            seen = now
            yield
        time.sleep(LOOK_EVERY_S)


def _stamp(paths: Sequence[Path]) -> Stamp:
    """Return what changes when a file does; zeros for one that is away."""
    stamps = []
    for path in paths:
        try:
            found = path.stat()
            stamps.append((found.st_mtime_ns, found.st_size, found.st_ino))
        except OSError:
            stamps.append((0, 0, 0))
    return tuple(stamps)
