"""Files to begin with: a design, run file, map or profile of one's own, and shipped examples."""

import re
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path, PurePosixPath

import shapely

from vinefab.core.atomic import ensure_writable, write_files, write_text
from vinefab.core.errors import (
    BadInputError,
    ForeignFileError,
    UnfitInputError,
    UnknownNameError,
    nearest,
)
from vinefab.core.limits import rad
from vinefab.core.plain_text import one_line, readable
from vinefab.model.design import Design, design_text
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate, read_text, shipped_root
from vinefab.model.files.toml import LARGEST_TOML_BYTES
from vinefab.model.map import Map, Pose, Start, map_text

_STARTERS = {
    "design": ("design", "three_level_tree"),
    "run": ("run file", "grid_coverage"),
    "recipe": ("recipe", DEFAULT_RECIPE),
    "machine": ("machine", "co2_60w"),
    "material": ("material", "stretchlon_200"),
}
"""Kind and name of the shipped file that a new one is a copy of; a map is made here."""

_STARTER_KINDS = ("design", "run", "map", "recipe", "machine", "material")

CALLED_AS_FILES = ("recipe", "machine", "material")
"""Kinds that other files refer to by the file's name."""


def write_starter(
    kind: str,
    out: Path,
    *,
    original: str | None = None,
    branches: bool = False,
    drawn: Design | None = None,
    force: bool = False,
) -> tuple[str, bool]:
    """Write a file to begin with; return the name that stands in it, and whether it is new.

    One that began the same is left as it is: it may hold a day of work.

    Parameters
    ----------
    original
        The shipped or own file to copy, by name or path; None for a usual one.
    branches
        Write a design branch by branch.
    drawn
        The design to write, in place of a copy.
    """
    if kind not in _STARTER_KINDS:
        allowed = f"one of {', '.join(_STARTER_KINDS)}{nearest(kind, _STARTER_KINDS)}"
        raise BadInputError("kind", kind, allowed)
    if kind == "map" and original is not None:
        problem = "a map is copied from no other"
        raise UnfitInputError("original", problem, "make or import one: vinefab map")
    if branches and kind != "design":
        raise UnfitInputError("branches", f"a {kind} has none", "leave it out")
    suffix = ".geojson" if kind == "map" else ".toml"
    if out.suffix.lower() != suffix:
        raise BadInputError("file", str(out), f"a file name ending in {suffix}")
    stem = readable(out.stem)
    if kind in CALLED_AS_FILES and _plain(stem) != stem:
        allowed = f"for a {kind} a file name of letters, digits, '_', '-' and '.'"
        raise BadInputError("file", str(out), allowed)
    name = (one_line(stem) if kind == "map" else _plain(stem)) or kind
    if kind == "map":
        text = map_text(starter_map(name))
    elif drawn is not None:
        text = f"# Of a drawing, to change as you like.\n{design_text(drawn.changed(name=name))}"
    else:
        text = _named_copy(kind, original or _STARTERS[kind][1], name, branches=branches)
    if out.exists() and not force:
        if _beginning(kind, text) != _beginning(kind, read_text(out, LARGEST_TOML_BYTES)):
            raise ForeignFileError(out, "exists")
        return name, False
    ensure_writable(out, force=force)
    write_text(out, text, force=force)
    return name, True


_DIGEST = re.compile(r" \[[0-9a-f]{16}\]")


def _beginning(kind: str, text: str) -> str:
    """Return the line with a file's origin: of a map its second, without the digest."""
    lines = text.splitlines()[:2]
    return _DIGEST.sub("", lines[-1]) if kind == "map" and lines else "".join(lines[:1])


def starter_map(name: str) -> Map:
    """Return a table of 600 x 400 mm with three blocks and a start that is placed by hand."""
    blocks = (
        (150.0, 120.0, 230.0, 190.0),
        (300.0, 60.0, 360.0, 160.0),
        (380.0, 240.0, 470.0, 300.0),
    )
    pose = Pose(x_mm=30.0, y_mm=100.0, heading_rad=rad(20.0))
    start = Start(pose=pose, spread_x_mm=5.0, spread_y_mm=5.0, spread_heading_rad=rad(5.0))
    return Map(
        name=name,
        bounds=shapely.box(0.0, 0.0, 600.0, 400.0),
        obstacles=tuple(shapely.box(*block) for block in blocks),
        starts=(start,),
        environment="table",
    )


def _plain(stem: str) -> str:
    """Return the stem of a file as the name of a design, run or recipe may be."""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", stem).lstrip("_.-")


def _named_copy(kind: str, original: str, name: str, *, branches: bool) -> str:
    """Return the text of a shipped or own file under another name."""
    path = locate(_STARTERS[kind][0], original)
    text = read_text(path, LARGEST_TOML_BYTES)
    if not re.search(rf'(?m)^schema = "vinefab/{kind}-', text):
        raise UnfitInputError(
            "schema", f"{path.name} is not a {kind}", f"name a file of the kind {kind}", path
        )
    if branches:
        free = Design.read(path).by_branches.changed(name=name)
        first = f"# A copy of {one_line(original)}, branch by branch, to change as you like."
        return f"{first}\n{design_text(free)}"
    top, table, rest = text.partition("\n[")  # a run file need not name itself, its parts do
    named = re.sub(r'(?m)^name = "[^"]*"', f'name = "{name}"', top, count=1) + table + rest
    return (
        f"# A copy of {one_line(original)} to change as you like, title and comments too.\n{named}"
    )


_EXAMPLES_FOLDER = "examples"
_EXAMPLE_ENDINGS = (
    ".toml", ".py", ".sbatch", ".ipynb", ".md", ".dxf", ".jpg", ".png", ".gpkg", ".yaml",
)  # fmt: skip
_PICTURES_FOLDER = "pictures"
"""Folder of the README's pictures; it is not copied."""


def shipped_examples() -> dict[str, Path]:
    """Return the shipped examples by their path below the folder of examples."""
    root = shipped_root() / _EXAMPLES_FOLDER
    found = sorted(path for path in root.rglob("*") if path.suffix in _EXAMPLE_ENDINGS)
    shown = (path for path in found if path.parent.name != _PICTURES_FOLDER)
    return {path.relative_to(root).as_posix(): path for path in shown}


def examples_named(names: Sequence[str]) -> dict[str, Path]:
    """Return the examples of some names, with or without folder and ending; all for no names.

    The name of a folder stands for all that lies in it.
    """
    known = shipped_examples()
    chosen: dict[str, Path] = {}
    for name in names:
        fits = [place for place in known if name in _names_of(PurePosixPath(place))]
        if not fits:
            raise UnknownNameError("example", name, {place.split("/")[0] for place in known})
        chosen |= {place: known[place] for place in fits}
    return chosen or known


def _names_of(place: PurePosixPath) -> set[str]:
    return {str(place), place.name, place.stem, *map(str, place.parents[:-1])}


def copy_examples(chosen: Mapping[str, Path], out: Path, *, force: bool = False) -> list[Path]:
    """Copy examples into a folder and return what was written: what is there already stays."""
    missing = {
        out / name: path
        for name, path in chosen.items()
        if not (out / name).is_file() or (out / name).read_bytes() != path.read_bytes()
    }
    for place in missing:
        ensure_writable(place, force=force)
    write_files({place: path.read_bytes() for place, path in missing.items()}, force=force)
    return list(missing)


_TEXTS = (".toml", ".py", ".sbatch", ".md")


def about_example(path: Path) -> str:
    """Return a text file's heading or first sentence, behind a colon; else nothing."""
    if path.suffix not in _TEXTS:
        return ""
    lines = [line for line in read_text(path).splitlines() if not line.startswith("#!")]
    comment = " ".join(line[2:] for line in takewhile(lambda line: line[:2] == "# ", lines))
    first = next((words for line in lines if (words := line.strip("#\" '-"))), "")
    return f": {(comment or first).partition('. ')[0].rstrip('.')}"
