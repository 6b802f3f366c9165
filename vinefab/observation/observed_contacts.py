"""Observations of photos (``vinefab/observation-1``), read again as a fit needs them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from vinefab.core.errors import BadInputError, UnreadableFileError, VinefabError, values_hidden
from vinefab.core.table import TablePart, validated
from vinefab.core.units import rad
from vinefab.core.validation import Floats, frozen_floats
from vinefab.model.design import Design
from vinefab.model.files.shipped import read_text
from vinefab.model.map import Map, Pose
from vinefab.observation.meetings import WallContact
from vinefab.physics.tube import inflated_diameter_mm

LARGEST_OBSERVATION_BYTES = 1 << 26
MOST_CONTACTS = 10_000
MOST_TRACED = 200_000
"""Points of one traced branch."""

OTHER_STOPS = ("corner", "pressure", "full_length")
"""Reasons of stops at a wall that are not the contact's angle."""


Coordinate = Annotated[float, Field(ge=-1e7, le=1e7)]
Point = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]


class BranchWidthForm(TablePart):
    """How broad a branch should look from above."""

    nominal: Annotated[float, Field(gt=0, le=1e5)]


class TracedBranchForm(TablePart):
    """A branch as planned, seen and predicted."""

    id: str
    width_mm: BranchWidthForm | None = None
    level: Annotated[int, Field(ge=1, le=1000)]
    points_mm: Annotated[list[Point], Field(max_length=MOST_TRACED)] = Field(default_factory=list)
    stop_observed: str | None = None
    contacts: Annotated[list[WallContact], Field(max_length=MOST_CONTACTS)] = Field(
        default_factory=list
    )
    doubts: list[str] = Field(default_factory=list)


class BreadthForm(TablePart):
    """How broad the film is as seen from above."""

    measured: Annotated[float, Field(gt=0, le=1e5)]
    low: Annotated[float, Field(ge=0, le=1e5)]
    high: Annotated[float, Field(gt=0, le=1e5)]


class FilmForm(TablePart):
    """The film of a photo."""

    width_mm: BreadthForm | None = None


class PoseForm(TablePart):
    """Where the robot was launched."""

    x_mm: Coordinate
    y_mm: Coordinate
    heading_deg: float


class SummaryForm(TablePart):
    """What an observation says of the whole photo."""

    fits: bool = True


class ObservationForm(TablePart):
    """One observation."""

    schema_: Literal["vinefab/observation-1"] = Field(alias="schema")
    photo: str
    map: str
    design: str
    pose: PoseForm
    film: FilmForm | None = None
    summary: SummaryForm = Field(default_factory=SummaryForm)
    branches: list[TracedBranchForm]


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenContact:
    """A contact of a photo whose tip slid or stopped for its angle."""

    angle_deg: float  # from the wall's normal
    stopped: bool
    error_deg: float | None  # standard error of the angle, if the observation says


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObservedPhoto:
    """What one photo says, with its design and map where they were found."""

    file: Path
    photo: str
    contacts: tuple[SeenContact, ...]
    unclear: int  # contacts left out because it could not be seen what the tip did there
    has_verdict: bool  # whether the photo shows its design; without, no contact counts
    elsewise: int  # contacts left out because the tip stopped for another reason than the angle
    chains_mm: dict[str, Floats]  # traced centre lines by branch, shape (k, 2) each
    pose: Pose
    design: Design | None
    world: Map | None
    # distance of centre lines from each wall that they touch, against the nominal radius
    width_ratios: tuple[float, ...]
    # breadth of the film against the trunk's nominal diameter: value, low, high
    breadth_ratio: tuple[float, float, float] | None
    notes: tuple[str, ...] = ()


_NO_OBSERVATIONS = (".jpg", ".jpeg", ".png", ".html")
"""Of photos and pages, which are not what is fitted."""


def read_observations(paths: Sequence[Path]) -> tuple[ObservedPhoto, ...]:
    """Return observations, each once."""
    if not paths:
        raise BadInputError("observations", "none", "at least one JSON file of vinefab observe")
    texts: dict[str, Path] = {}
    for path in paths:
        if path.suffix.lower() in _NO_OBSERVATIONS:
            allowed = "the JSON of an observation: vinefab observe PHOTO ... --json one.json"
            raise BadInputError("observation", path.name, allowed)
        text = read_text(path, LARGEST_OBSERVATION_BYTES)
        if text in texts:
            raise BadInputError(str(path), f"the same as {texts[text]}", "each observation once")
        texts[text] = path
    return tuple(_observation(text, path) for text, path in texts.items())


def json_object(text: str, path: Path) -> dict[str, Any]:
    """Return the content of a JSON file, which has to be an object."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableFileError(path, f"is not JSON: {str(error)[:100]}") from error
    if not isinstance(content, dict):
        raise UnreadableFileError(path, "is no JSON object")
    return content


def _observation(text: str, path: Path) -> ObservedPhoto:
    form = validated(ObservationForm, json_object(text, path), path)
    design, world, notes = _found(form, path)
    contacts, unclear, elsewise = _contacts(form)
    return ObservedPhoto(
        file=path,
        photo=form.photo,
        contacts=contacts,
        unclear=unclear,
        has_verdict=form.summary.fits,
        elsewise=elsewise,
        chains_mm={
            branch.id: frozen_floats("points_mm", branch.points_mm, 2)
            for branch in form.branches
            if form.summary.fits and not branch.doubts
        },
        pose=Pose(x_mm=form.pose.x_mm, y_mm=form.pose.y_mm, heading_rad=rad(form.pose.heading_deg)),
        design=design,
        world=world,
        width_ratios=_width_ratios(form, design),
        breadth_ratio=_breadth_ratio(form, design) if form.summary.fits else None,
        notes=notes,
    )


def _contacts(form: ObservationForm) -> tuple[tuple[SeenContact, ...], int, int]:
    """Return contacts that a threshold can be fitted to, and how many are not among them and why.

    A branch ends once: of its contacts at most the last is the one that it stopped at. Nothing is
    known of contacts on a photo without a verdict, nor of those of a branch in doubt.
    """
    kept, unclear, elsewise = list[SeenContact](), 0, 0
    for branch in form.branches:
        for contact in branch.contacts:
            stopped, angle_deg = contact.outcome == "stopped", contact.angle_from_normal_deg
            is_seen = form.summary.fits and not branch.doubts
            if not is_seen or contact.outcome == "unclear" or angle_deg is None:
                unclear += 1
            elif angle_deg > 90.0 or (stopped and branch.stop_observed in OTHER_STOPS):
                elsewise += 1
            else:
                kept.append(
                    SeenContact(
                        angle_deg=angle_deg, stopped=stopped, error_deg=contact.angle_error_deg
                    )
                )
    return tuple(kept), unclear, elsewise


def _found(form: ObservationForm, path: Path) -> tuple[Design | None, Map | None, tuple[str, ...]]:
    """Return design and map of an observation where they still can be read, and what cannot."""
    notes = list[str]()
    design: Design | None = None
    world: Map | None = None
    try:
        with values_hidden():
            design = Design.read(_beside(form.design, path))
    except VinefabError as error:
        notes.append(f"{path.name}: its design is not read ({error})")
    try:
        with values_hidden():
            world = Map.read(Path(_beside(form.map, path)))
    except VinefabError as error:
        notes.append(f"{path.name}: its map is not read ({error})")
    return design, world, tuple(notes)


def _beside(name: str, path: Path) -> str:
    """Return a file named in an observation: as it stands, else beside the observation."""
    if "\0" in name or Path(name).is_file():
        return name
    for near in (path.parent / name, path.parent / Path(name).name):
        if near.is_file():
            return str(near)
    return name


def _width_ratios(form: ObservationForm, design: Design | None) -> tuple[float, ...]:
    """Return distances from walls against nominal radii, one for each branch and wall."""
    ratios: dict[tuple[str, object], float] = {}
    for branch in form.branches if form.summary.fits else ():
        nominal_mm = _nominal_mm(branch, design)
        if branch.doubts:
            continue
        for contact in branch.contacts:
            if nominal_mm and contact.distance_mm is not None and contact.outcome != "unclear":
                ratios[branch.id, contact.wall] = 2.0 * contact.distance_mm / nominal_mm
    return tuple(ratios.values())


def _nominal_mm(branch: TracedBranchForm, design: Design | None) -> float | None:
    """Return the nominal inflated diameter of a branch, by the observation or by the design."""
    if branch.width_mm is not None:
        return branch.width_mm.nominal
    if design is None or branch.level > len(design.build.widths_mm):
        return None
    return inflated_diameter_mm(design.build.widths_mm[branch.level - 1])


def _breadth_ratio(
    form: ObservationForm, design: Design | None
) -> tuple[float, float, float] | None:
    found = None if form.film is None else form.film.width_mm
    trunk = next((branch for branch in form.branches if branch.level == 1), None)
    nominal_mm = None if trunk is None else _nominal_mm(trunk, design)
    if found is None or nominal_mm is None:
        return None
    value, low, high = np.array([found.measured, found.low, found.high]) / nominal_mm
    return float(value), float(low), float(high)
