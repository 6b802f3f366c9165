"""Design files: TOML, schema ``vinefab/design-1``."""

from collections.abc import Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import Field

from vinefab.core.errors import BadInputError, located
from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import counted
from vinefab.core.units import deg, rad
from vinefab.core.validation import LARGEST_MM, SMALLEST, check_plain
from vinefab.model.design import (
    DEFAULT_FILLET_RATIO,
    DEFAULT_MOUNTING,
    DEFAULT_PRESSURE_KPA,
    DEFAULT_TAIL_MM,
    DEFAULT_TRUNK_WIDTH_MM,
    DEFAULT_WIDTH_RATIO,
    MOST_PIECES,
    Build,
    Collar,
    Design,
    Level,
    Mounting,
    PieceSettings,
    Pouch,
    Waiver,
    default_fillets_mm,
)
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import Form, read_toml, validated

WIDEST_BODY_MM = 1e4
"""Wider ones are a mixed-up unit, and their outlines would take gigabytes."""
_SCHEMA = "vinefab/design-1"
Positive = Annotated[float, Field(ge=SMALLEST, le=LARGEST_MM)]
Width = Annotated[float, Field(ge=SMALLEST, le=WIDEST_BODY_MM)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST_MM)]
Taper = Annotated[float, Field(ge=0.01, le=1)]


class TrunkForm(Form):
    """Table ``[trunk]``."""

    length: Positive  # of the trunk, times scale_mm_per_unit


class LevelForm(Form):
    """Table ``[[level]]``: one level after the trunk."""

    branches: Annotated[int, Field(ge=1, le=1000)]  # children per parent (SPL of the paper)
    length: Positive  # of the first child (BL), times scale_mm_per_unit
    # the whole fan (theta), first child to last
    angle_deg: Annotated[float, Field(ge=0, le=360)] = 0.0
    # last child's length over the first's (LGF)
    growth_percent: Annotated[float, Field(ge=0.1, le=10_000)] = 100.0


class PouchForm(Form):
    """Inline table ``pouch``."""

    shape: Literal["round", "rectangle"]  # round: a disc; rectangle: along the branch
    radius_mm: Positive | None = None  # of a round one
    length_mm: Positive | None = None  # of a rectangle, along the branch
    width_mm: Positive | None = None  # of a rectangle, across it


class CollarForm(Form):
    """Inline table ``collar``."""

    clamp_diameter_mm: Width  # of the pipe that the mouth is pulled over
    # of the straight part at the mouth
    length_mm: Annotated[float, Field(ge=0, le=WIDEST_BODY_MM)] = 30.0
    flare_mm: Width = 40.0  # over which the width changes to that of the tail


class PiecesForm(Form):
    """Inline table ``pieces``."""

    # pieces that may be cut
    most: Annotated[int, Field(ge=1, le=MOST_PIECES)] = PieceSettings().most
    # that socket and plug lie on each other, along the branch (assumed)
    lap_mm: Annotated[float, Field(ge=1, le=1000)] = PieceSettings().lap_mm
    # added to the flat width of a socket (assumed)
    ease_mm: Annotated[float, Field(ge=0, le=100)] = PieceSettings().ease_mm


class BuildForm(Form):
    """Table ``[build]``: every key may be left out."""

    # lay-flat lumen width of each level, trunk first; inflates to 2 w / pi
    widths_mm: list[Width] | None = None
    trunk_width_mm: Width | None = None  # in place of widths_mm, with width_ratio
    # of a level over the one before
    width_ratio: Annotated[float, Field(ge=SMALLEST, le=1)] | None = None
    # width at the end of each level's branches over that at their beginning
    taper: list[Taper] | None = None
    fillet_mm: list[NotNegative] | None = None  # radius in each level's joints, level 2 first
    # in place of fillet_mm: radius over the child's width
    fillet_ratio: Annotated[float, Field(ge=0, le=10)] | None = None
    tail_mm: NotNegative = DEFAULT_TAIL_MM  # below the trunk, inverted over the base and clamped
    # working gauge pressure; 0: not known
    pressure_kpa: Annotated[float, Field(ge=0, le=10_000)] = DEFAULT_PRESSURE_KPA
    pouch: PouchForm | None = None  # at the tip of every leaf
    collar: CollarForm | None = None  # fits the tail to a clamp
    # may be cut in flat pieces, joined by sleeves; left out: one outline
    pieces: PiecesForm | None = None
    # tail_inverted: mounted as cut, faces inside end outside; turned: first turned inside out
    mounting: Mounting = DEFAULT_MOUNTING


class WaiveForm(Form):
    """Table ``[[waive]]``."""

    fingerprint: str  # of the finding, as `vinefab check` shows it
    reason: str  # why it is accepted; stands in every report


class DesignForm(Form):
    """A whole design file."""

    schema_: Literal["vinefab/design-1"] = Field(alias="schema")  # kind of file and its version
    name: str  # in reports and on the sheet
    scale_mm_per_unit: Positive = 1.0  # multiplies lengths of trunk and levels
    trunk: TrunkForm  # level 1
    # one per level after the trunk; none: a plain vine
    level: list[LevelForm] = Field(default_factory=list)
    build: BuildForm = BuildForm()  # how it is made
    waive: list[WaiveForm] = Field(default_factory=list)  # findings that are accepted
    # how the design was made; written by `vinefab optimize`
    origin: dict[str, Any] = Field(default_factory=dict)
    # limits of rules for this design: [limits.VF-C01] warning = 6.0
    limits: dict[str, dict[str, float]] = Field(default_factory=dict)


def read_design(name_or_path: str | PathLike[str]) -> Design:
    """Return the design in a file, or a shipped one by name.

    Lengths in ``[trunk]`` and ``[[level]]`` are multiplied by ``scale_mm_per_unit``; everything
    in ``[build]`` is in millimetres already.
    """
    path = locate("design", name_or_path)
    return replace(design_of(read_toml(path), path), folder=path.parent)


def design_of(content: Mapping[str, Any], source: str | Path) -> Design:
    """Return the design in the content of a design file.

    Parameters
    ----------
    content
        Tables and values as `design_content` gives them.
    source
        What messages call the content.

    Raises
    ------
    BadInputError
        If a value cannot be used; its key is dotted, ``level.1.length``.
    """
    form = validated(DesignForm, content, source)
    with located(source):
        check_plain({"origin": form.origin})
        return _design(form)


def design_content(design: Design) -> dict[str, Any]:
    """Return a design as tables and values of a design file; lengths are in millimetres."""
    content: dict[str, Any] = {"schema": _SCHEMA, "name": design.name, "scale_mm_per_unit": 1.0}
    content["trunk"] = {"length": design.trunk_length_mm}
    content["level"] = [_level_table(level) for level in design.levels]
    content["build"] = _build_table(design.build)
    content["waive"] = [{"fingerprint": w.fingerprint, "reason": w.reason} for w in design.waivers]
    content["limits"] = {rule: dict(named) for rule, named in design.limits.items()}
    content["origin"] = dict(design.origin)
    return content


def design_text(design: Design) -> str:
    """Return a design as the text of a design file; reading it gives the same design."""
    content = design_content(design)
    head = {key: content[key] for key in ("schema", "name", "scale_mm_per_unit")}
    blocks = [f"# {GENERATOR}\n{tomli_w.dumps(head)}", tomli_w.dumps({"trunk": content["trunk"]})]
    blocks += [f"[[level]]\n{tomli_w.dumps(table)}" for table in content["level"]]
    blocks.append(tomli_w.dumps({"build": content["build"]}))
    blocks += [f"[[waive]]\n{tomli_w.dumps(table)}" for table in content["waive"]]
    given = [name for name in ("limits", "origin") if content[name]]
    blocks += [tomli_w.dumps({name: content[name]}) for name in given]
    return "\n".join(blocks)


def _level_table(level: Level) -> dict[str, Any]:
    return {
        "branches": level.branches,
        "length": level.length_mm,
        "angle_deg": deg(level.fan_rad),
        "growth_percent": round(100.0 * level.growth, 9),
    }


def _design(form: DesignForm) -> Design:
    scale = form.scale_mm_per_unit
    levels = tuple(
        Level(
            branches=level.branches,
            length_mm=level.length * scale,
            fan_rad=rad(level.angle_deg),
            growth=level.growth_percent / 100.0,
        )
        for level in form.level
    )
    return Design(
        name=form.name,
        trunk_length_mm=form.trunk.length * scale,
        levels=levels,
        build=_build(form.build, 1 + len(levels)),
        waivers=tuple(Waiver(fingerprint=w.fingerprint, reason=w.reason) for w in form.waive),
        origin=form.origin,
        limits=form.limits,
    )


def _build(form: BuildForm, depth: int) -> Build:
    widths = _widths_mm(form, depth)
    if form.fillet_mm is not None and form.fillet_ratio is not None:
        raise BadInputError("build.fillet_ratio", form.fillet_ratio, "not beside build.fillet_mm")
    ratio = DEFAULT_FILLET_RATIO if form.fillet_ratio is None else form.fillet_ratio
    given = form.fillet_mm
    fillets = default_fillets_mm(widths, ratio) if given is None else tuple(given)
    pouch = None if form.pouch is None else Pouch(**form.pouch.model_dump())
    return Build(
        widths_mm=widths,
        fillet_mm=fillets,
        tail_mm=form.tail_mm,
        pressure_kpa=form.pressure_kpa,
        pouch=pouch,
        taper=() if form.taper is None else tuple(form.taper),
        collar=None if form.collar is None else Collar(**form.collar.model_dump()),
        pieces=None if form.pieces is None else PieceSettings(**form.pieces.model_dump()),
        mounting=form.mounting,
    )


def _widths_mm(form: BuildForm, depth: int) -> tuple[float, ...]:
    if form.widths_mm is not None:
        for key in ("trunk_width_mm", "width_ratio"):
            if getattr(form, key) is not None:
                raise BadInputError(
                    f"build.{key}", getattr(form, key), "not beside build.widths_mm"
                )
        if len(form.widths_mm) != depth:
            raise BadInputError(
                "build.widths_mm",
                form.widths_mm,
                f"{counted(depth, 'width')}, one per level, trunk first",
            )
        return tuple(form.widths_mm)
    first = DEFAULT_TRUNK_WIDTH_MM if form.trunk_width_mm is None else form.trunk_width_mm
    ratio = DEFAULT_WIDTH_RATIO if form.width_ratio is None else form.width_ratio
    return tuple(first * ratio**level for level in range(depth))


def _build_table(build: Build) -> dict[str, Any]:
    table: dict[str, Any] = {
        "widths_mm": list(build.widths_mm),
        "fillet_mm": list(build.fillet_mm),
        "tail_mm": build.tail_mm,
        "pressure_kpa": build.pressure_kpa,
    }
    if build.taper:
        table["taper"] = list(build.taper)
    if build.collar is not None:
        names = ("clamp_diameter_mm", "length_mm", "flare_mm")
        table["collar"] = {name: getattr(build.collar, name) for name in names}
    if build.pieces is not None:
        table["pieces"] = {
            name: getattr(build.pieces, name) for name in ("most", "lap_mm", "ease_mm")
        }
    if build.mounting != DEFAULT_MOUNTING:
        table["mounting"] = build.mounting
    if build.pouch is not None:
        pouch = build.pouch
        sizes = {name: getattr(pouch, name) for name in ("radius_mm", "length_mm", "width_mm")}
        given = {name: size for name, size in sizes.items() if size is not None}
        table["pouch"] = {"shape": pouch.shape, **given}
    return table
