"""Verbs about files: the shipped ones, new ones, and the facts about profiles and rules."""

from __future__ import annotations

import shlex
from functools import partial
from typing import TYPE_CHECKING, Annotated

from vinefab.app.common import Names, WrittenFile
from vinefab.core.errors import UnfitInputError
from vinefab.core.verbs import (
    IN_PLACE,
    Force,
    Kind,
    also,
    numbers_from,
    registered_names,
    verb,
    wrote,
)
from vinefab.model.inputs import FOLDER, PathText, all_names, as_path

if TYPE_CHECKING:
    from pathlib import Path

    from vinefab.fabrication.profile_listing import ProfileListing, ProfileNumbers
    from vinefab.fabrication.rules.catalog import RuleBook
    from vinefab.model.design import Design

_NEXT_STEPS = {
    "design": "vinefab studio {0}, or edit it and: vinefab check {0}",
    "run": "vinefab optimize {0} --out run",
    "recipe": "vinefab coupon --recipe {0} --out coupons, then vinefab calibrate",
    "machine": 'put its numbers in; vinefab new recipe mine.toml next to it, with machine = "{1}"',
    "material": (
        'put its numbers in; vinefab new recipe mine.toml next to it, with material = "{1}"'
    ),
    "map": "vinefab map info {0}, or: vinefab grow three_level_tree --map {0} --svg grown.svg",
}


@verb
def new(
    kind: Annotated[
        str, Kind(metavar="KIND", known=registered_names("vinefab.app.files:_NEXT_STEPS"))
    ],
    file: PathText,
    *,
    original: Annotated[str | None, Kind(metavar="NAME"), also("--from")] = None,
    branches: bool = False,
    skeleton: Annotated[PathText | None, Kind(metavar="FILE")] = None,
    base: Annotated[
        tuple[float, float] | None,
        Kind(
            metavar="X,Y",
            read=partial(numbers_from, count=2),
            words=lambda place: [",".join(f"{one!r}" for one in place)],
            hyphen=True,
        ),
    ] = None,
    trunk_width_mm: float | None = None,
    snap_mm: float = 1.0,
    chord_mm: float | None = None,
    scale_mm_per_unit: float | None = None,
    layer: Annotated[tuple[str, ...], Kind(metavar="NAME", several=True)] = (),
    force: Force = False,
) -> WrittenFile:
    """Write a commented file to begin with, as a design or a map; its name is the file's.

    Parameters
    ----------
    kind
        ``design``, ``run``, ``map``, ``recipe``, ``machine`` (a laser) or ``material`` (a film).
    file
        The file to write: ``.geojson`` for a map, else ``.toml``.
    original
        The shipped or own file to copy; default: a usual one.
    branches
        Write a design branch by branch, so that each one may be changed alone.
    skeleton
        Make the design of the lines in this file: DXF, SVG, GeoJSON, or CSV with
        x1,y1,x2,y2[,width] in mm.
    base
        The loose end of the skeleton where the trunk begins; default: the one that a layer, group
        or point named base marks, else the lowest.
    trunk_width_mm
        Lay-flat width of the trunk of a skeleton; default: that of its first line, else 40 mm.
    snap_mm
        Ends of a skeleton's lines no further apart are one joint.
    chord_mm
        Curves of a skeleton become straight parts within this distance; default: a tenth of the
        trunk's width.
    scale_mm_per_unit
        Millimetres per unit of the drawing, in place of the unit that it names.
    layer
        Layers of a DXF or groups of an SVG to read; default: all.
    force
        Overwrite the file, also one of another program.

    Returns
    -------
    WrittenFile
        What was written; it can be passed as a path. A file that the same call wrote, changed since
        or not, is left as it is.

    Raises
    ------
    BadInputError
        If there is no such kind, or the name ends in something else.
    ForeignFileError
        If the place is taken.

    Examples
    --------
    $ vinefab new design mine.toml
    $ vinefab new map table.geojson
    $ vinefab grow scout --out skeleton.dxf
    $ vinefab new design drawn.toml --skeleton skeleton.dxf
    $ vinefab new design free.toml --from grid_explorer_levels --branches

    >>> from tempfile import TemporaryDirectory
    >>> from vinefab.model.design import Design
    >>> with TemporaryDirectory() as folder:
    ...     Design.read(new("design", f"{folder}/mine.toml")).name
    'mine'
    """
    from vinefab.model.files.starters import write_starter

    path = as_path("file", file)
    drawn: Design | None = None
    told: tuple[str, ...] = ()
    of_drawings = {
        "base": base,
        "trunk_width_mm": trunk_width_mm,
        "chord_mm": chord_mm,
        "scale_mm_per_unit": scale_mm_per_unit,
        "layer": layer or None,
    }
    if skeleton is not None:
        if kind != "design" or original is not None or branches:
            problem = "a drawing makes a new design alone, without --from and --branches"
            raise UnfitInputError("skeleton", problem, "leave one of them out")
        source = as_path("skeleton", skeleton)
        drawn, told = _of_skeleton(
            source,
            base=base,
            trunk_width_mm=trunk_width_mm,
            snap_mm=snap_mm,
            chord_mm=chord_mm,
            scale_mm_per_unit=scale_mm_per_unit,
            layers=layer,
        )
    for key, value in of_drawings.items():
        if value is not None and drawn is None:
            raise UnfitInputError(key, "needs a drawing", "give --skeleton too")
    name, is_new = write_starter(
        kind, path, original=original, branches=branches, drawn=drawn, force=force
    )
    if is_new:
        wrote(path, "" if name == path.stem else f", named {name}")
    there = f"{path} is there already and left as it is; --force writes it anew"
    steps = (f"next: {_NEXT_STEPS[kind].format(shlex.quote(str(path)), name)}",)
    summary = (*told, *steps) if is_new else (there, *steps)
    return WrittenFile(path=path, summary=summary, is_new=is_new)


def _of_skeleton(
    source: Path,
    *,
    base: tuple[float, float] | None,
    trunk_width_mm: float | None,
    snap_mm: float,
    chord_mm: float | None,
    scale_mm_per_unit: float | None,
    layers: tuple[str, ...],
) -> tuple[Design, tuple[str, ...]]:
    """Return the design that the lines in a file draw, and a line about the drawing."""
    from vinefab.core.errors import located
    from vinefab.core.plain_text import counted
    from vinefab.maps.importers.skeleton_lines import read_skeleton
    from vinefab.model.design import DEFAULT_TRUNK_WIDTH_MM, Build, Design
    from vinefab.model.skeleton import place_text

    build = Build() if trunk_width_mm is None else Build(trunk_width_mm=trunk_width_mm)
    width_mm = DEFAULT_TRUNK_WIDTH_MM if trunk_width_mm is None else trunk_width_mm
    lines = read_skeleton(
        source,
        chord_mm=0.1 * width_mm if chord_mm is None else chord_mm,
        layers=layers,
        scale_mm_per_unit=scale_mm_per_unit,
    )
    with located(source):
        marked = lines.base_mm(snap_mm) if base is None else base
        drawn = Design.of_segments(
            lines.segments_mm,
            base=marked,
            snap_mm=snap_mm,
            widths_mm=lines.widths_mm,
            build=build,
        )
    x, y, heading = drawn.origin["drawn_at"]
    why = "as given" if base is not None else "the lowest" if marked is None else "as marked"
    count = len(drawn.tree.bend_mm)
    told = (
        f"read {counted(len(lines.segments_mm), 'line')}, unit {lines.unit}: "
        f"{counted(drawn.branch_count, 'branch')}, {counted(count, 'bend')}, "
        f"{drawn.tree.total_length_mm:.6g} mm; base at {place_text((x, y))} ({why}), "
        f"heading {heading:.6g} degrees"
    )
    return drawn, (told,)


@verb
def examples(
    *names: Annotated[str, Kind(metavar="NAME")],
    out: Annotated[PathText | None, FOLDER] = None,
    force: Force = False,
) -> Names:
    """List the examples that ship with vinefab, or copy them to try and change.

    Parameters
    ----------
    *names
        Examples, with or without folder and ending, or folders of them; all if none is named.
    out
        Copy them into this folder; what is there already and unchanged stays.

    Raises
    ------
    ForeignFileError
        If a file is in the way.
    UnknownNameError
        If there is no such example.

    Examples
    --------
    $ vinefab examples --out examples

    >>> examples("grid_coverage")
    ('grid_coverage.toml',)
    """
    from vinefab.model.files.starters import about_example, copy_examples, examples_named

    chosen = examples_named([str(name) for name in names])
    if out is None:
        lines = [f"  {name}{about_example(path)}" for name, path in chosen.items()]
        return Names.of(chosen, [*lines, "vinefab examples --out examples copies them"])
    folder = as_path("out", out)
    missing = copy_examples(chosen, folder, force=force)
    there = len(chosen) - len(missing)
    lines = [
        f"wrote {len(missing)} {'file' if len(missing) == 1 else 'files'} to {folder}/"
        + (f", {there} unchanged" if there else "")
    ]
    return Names.of(chosen, lines)


@verb
def designs() -> Names:
    """Return the names of the shipped designs and of the user's own.

    Examples
    --------
    $ vinefab designs

    >>> "grid_explorer" in designs()
    True
    """
    return Names.of(all_names("design"))


@verb
def recipes() -> Names:
    """Return the names of the shipped recipes (laser, film, settings) and of the user's own.

    Examples
    --------
    $ vinefab recipes

    >>> recipes()[0]
    'co2_40w__stretchlon_200'
    """
    return Names.of(all_names("recipe"))


@verb
def printers() -> Names:
    """Return the names of the shipped 3-D printers and of the user's own.

    Examples
    --------
    $ vinefab printers

    >>> printers()
    ('generic_220', 'generic_256', 'generic_large')
    """
    return Names.of(all_names("printer"))


@verb
def profiles(
    name: Annotated[
        PathText | None, Kind(metavar="NAME", files=partial(all_names, "recipe")), IN_PLACE
    ] = None,
) -> ProfileNumbers | ProfileListing:
    """List machines, materials and recipes, or explain one: every number with its standing.

    Parameters
    ----------
    name
        A shipped name, one of your own, or a path; default: list all.

    Raises
    ------
    UnknownNameError
        If there is no such profile.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab profiles co2_60w__stretchlon_200

    >>> profiles("co2_60w__stretchlon_200").summary[0].startswith("recipe ")
    True
    """
    from vinefab.fabrication.profile_listing import ProfileListing, ProfileNumbers, kind_of

    if name is None:
        return ProfileListing()
    found = ProfileNumbers(name=str(as_path("name", name, "a name, or a path")))
    kind_of(found.name)  # an unknown name is refused here
    return found


profile = profiles


@verb
def rules(
    rule: Annotated[str | None, Kind(metavar="ID"), IN_PLACE] = None,
) -> RuleBook:
    """List the design rules, or explain one: limits, reason and remedy.

    Parameters
    ----------
    rule
        The id of a rule, or a word of titles; default: all, those of other packages too.

    Returns
    -------
    RuleBook
        Rules by id; each has a ``title``, ``limits`` in its ``unit``, a ``reason`` and a
        ``remedy``.

    Raises
    ------
    UnknownNameError
        If there is no such rule.

    Examples
    --------
    $ vinefab rules VF-C01

    >>> rules()["VF-C01"].limits
    {'error': 0.0, 'warning': 2.0}
    """
    from vinefab.fabrication.rules.catalog import RuleBook

    return RuleBook.of(rule)
