"""Several photos together: measured contacts with intervals, and whether two ways agree.

The half-angle comes from the contacts (`ThresholdFit`), and once more from the whole shapes: every
robot is grown again at many half-angles and compared with its photo. Observations are read from
files of the kind ``vinefab/observation-1``.

The threshold of contacts. A tip that meets a wall at an angle ``a`` from its normal stops if
``|a| <= T`` and slides if not. A contact shows the angle with an error and the side of the
threshold that it was on: an interval-censored observation of ``T = theta + photo + tip``. These are
the half-angle, the share that all tips of a photo have (film, floor, light, hand), and the share of
each tip, both normal with mean 0. The likelihood of a photo is integrated over the former, so that
many contacts on one photo count for less than as many on different photos. All distributions are
sums on one grid of angles, so that both integrals are Gaussian filters.
"""

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import scipy  # its parts load at their first use
from pydantic import Field

from vinefab.core.errors import BadInputError, UnfitInputError, VinefabError, values_hidden
from vinefab.core.limits import rad
from vinefab.core.plain_text import counted
from vinefab.core.table import TablePart, validated
from vinefab.core.validation import Floats, frozen_floats, number
from vinefab.core.view import Answer, Block, Data, Fact, Facts, Notes, WrittenResult
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthChoice
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.model.contacts import (
    CONTACTS_SCHEMA,
    FEW_PHOTOS,
    MeasuredContacts,
    MeasuredNumber,
    Side,
    contacts_text,
)
from vinefab.model.design import Design
from vinefab.model.files.shipped import json_object, read_text
from vinefab.model.map import Map, Pose, Start
from vinefab.model.start import StartTable
from vinefab.observation.beside_prediction import WallContact
from vinefab.physics.anchoring import ASSUMED_FRICTION
from vinefab.physics.tube import inflated_diameter_mm

STEP_DEG = 0.25
_GRID_DEG = np.arange(-30.0, 120.0 + STEP_DEG / 2.0, STEP_DEG)
"""Of thresholds; below 0 every tip slides, above 90 every tip stops."""

_IS_ANGLE = (_GRID_DEG >= 0.0) & (_GRID_DEG <= 90.0)
_THETA_DEG = _GRID_DEG[_IS_ANGLE]

TIP_SPREADS_DEG = (0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
PHOTO_SPREADS_DEG = (0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
"""Standard deviations of thresholds that are tried [assumed: at most 10 degrees]."""

TWO_SIDED, ONE_SIDED = 3.841, 2.706
"""Falls of twice the log likelihood at the ends of a 95 % interval, and at a 95 % bound."""

_LEAST_SHARE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdFit:
    """The threshold between tips that stopped and tips that slid, with its evidence."""

    value_deg: float | None  # most likely half-angle; None where there is only a bound
    # 95 % interval by profile likelihood, or a one-sided 95 % bound and the end of the scale
    low_deg: float
    high_deg: float
    side: Side
    stopped: int
    slid: int
    photos: int
    greatest_stopped_deg: float | None
    least_slid_deg: float | None
    # most likely standard deviations of thresholds among the tips of a photo, and among photos
    tip_spread_deg: float
    photo_spread_deg: float

    @property
    def is_separable(self) -> bool:
        """Whether one angle parts all tips that stopped from all that slid."""
        stopped, slid = self.greatest_stopped_deg, self.least_slid_deg
        return stopped is None or slid is None or stopped < slid


def fit_threshold(
    angles_deg: Sequence[float],
    stopped: Sequence[bool],
    photos: Sequence[Hashable],
    error_deg: float | Sequence[float],
) -> ThresholdFit:
    """Return the half-angle that parts tips that stopped from tips that slid.

    Parameters
    ----------
    angles_deg
        Measured angle of each contact from the wall's normal, at least one, 0 to 90.
    stopped
        Whether the tip stopped there.
    photos
        On which photo it was seen.
    error_deg
        Standard error of the angles.
    """
    angle, has_stopped = np.abs(np.asarray(angles_deg, dtype=np.float64)), np.asarray(stopped)
    groups = {photo: place for place, photo in enumerate(dict.fromkeys(photos))}
    group = np.array([groups[photo] for photo in photos])
    table = _log_likelihood(angle, has_stopped, group, error_deg)
    profile = table.max(axis=(0, 1))
    best = np.unravel_index(int(table.argmax()), table.shape)
    side: Side = "both" if has_stopped.any() else "upper"
    side = "lower" if has_stopped.all() else side
    fall = 2.0 * (profile.max() - profile)
    inside = _THETA_DEG[fall <= (TWO_SIDED if side == "both" else ONE_SIDED)]
    # Separable contacts leave a plateau: its middle says more than its first point.
    top = _THETA_DEG[fall <= 0.1]
    return ThresholdFit(
        value_deg=float(0.5 * (top[0] + top[-1])) if side == "both" else None,
        low_deg=0.0 if side == "upper" else float(inside[0]),
        high_deg=90.0 if side == "lower" else float(inside[-1]),
        side=side,
        stopped=int(has_stopped.sum()),
        slid=int((~has_stopped).sum()),
        photos=len(groups),
        greatest_stopped_deg=float(angle[has_stopped].max()) if has_stopped.any() else None,
        least_slid_deg=None if has_stopped.all() else float(angle[~has_stopped].min()),
        tip_spread_deg=TIP_SPREADS_DEG[int(best[0])],
        photo_spread_deg=PHOTO_SPREADS_DEG[int(best[1])],
    )


def _averaged(values: Floats, spread_deg: float) -> Floats:
    """Return functions of the threshold averaged over a normal spread of it, shape (n, grid)."""
    if spread_deg == 0.0:
        return values
    return np.asarray(
        scipy.ndimage.gaussian_filter1d(values, spread_deg / STEP_DEG, axis=1, mode="nearest")
    )


def _log_likelihood(
    angle_deg: Floats, stopped: np.ndarray, group: np.ndarray, error_deg: float | Sequence[float]
) -> Floats:
    """Return the log likelihood over spreads of tips, spreads of photos, and half-angles."""
    threshold = np.maximum(_GRID_DEG, 0.0)
    error = np.maximum(np.broadcast_to(error_deg, angle_deg.shape), STEP_DEG)[:, None]
    away = angle_deg[:, None]
    # The true angle has a sign that the measured one has lost: both sides of the normal count.
    stops = scipy.special.ndtr((threshold - away) / error) - scipy.special.ndtr(
        (-threshold - away) / error
    )
    photos = int(group.max()) + 1
    spreads = PHOTO_SPREADS_DEG if photos > 1 else PHOTO_SPREADS_DEG[:1]
    table = np.empty((len(TIP_SPREADS_DEG), len(spreads), len(_THETA_DEG)))
    for row, tip_deg in enumerate(TIP_SPREADS_DEG):
        share = np.clip(_averaged(stops, tip_deg), _LEAST_SHARE, 1.0 - _LEAST_SHARE)
        logs = np.log(np.where(stopped[:, None], share, 1.0 - share))
        each = np.zeros((photos, logs.shape[1]))
        np.add.at(each, group, logs)
        peak = each.max(axis=1, keepdims=True)
        likely = np.exp(each - peak)
        for column, photo_deg in enumerate(spreads):
            whole = np.log(np.maximum(_averaged(likely, photo_deg), 1e-300)) + peak
            table[row, column] = whole.sum(axis=0)[_IS_ANGLE]
    return table


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


class SummaryForm(TablePart):
    """What an observation says of the whole photo."""

    fits: bool = True


class ObservationForm(TablePart):
    """One observation."""

    schema_: Literal["vinefab/observation-1"] = Field(alias="schema")
    photo: str
    map: str
    design: str
    pose: StartTable
    film: FilmForm | None = None
    summary: SummaryForm = Field(default_factory=SummaryForm)
    branches: list[TracedBranchForm]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObservedPhoto:
    """What one photo says, with its design and map where they were found."""

    file: Path
    photo: str
    contacts: tuple[WallContact, ...]  # whose tip slid, or stopped for its angle
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
        raise UnfitInputError("observations", "are missing", "give JSON files of vinefab observe")
    texts: dict[str, Path] = {}
    largest_observation_bytes = 1 << 26
    for path in paths:
        if path.suffix.lower() in _NO_OBSERVATIONS:
            remedy = "give the JSON of one: vinefab observe PHOTO ... --json one.json"
            raise UnfitInputError("observations", f"{path.name} is not an observation", remedy)
        text = read_text(path, largest_observation_bytes)
        if text in texts:
            raise UnfitInputError(
                str(path), f"is the same as {texts[text]}", "give each observation once"
            )
        texts[text] = path
    return tuple(_observation(text, path) for text, path in texts.items())


def _observation(text: str, path: Path) -> ObservedPhoto:
    """Return an observation, with the contacts that a threshold can be fitted to.

    A branch ends once: of its contacts at most the last is the one that it stopped at. Nothing is
    known of contacts on a photo without a verdict, nor of those of a branch in doubt.
    """
    form = validated(ObservationForm, json_object(text, path), path)
    start = form.pose.start
    if not isinstance(start, Start):
        raise BadInputError("pose", start.text, "x_mm, y_mm and heading_deg", path)
    design, world, notes = _found(form, path)
    kept, unclear, elsewise = list[WallContact](), 0, 0
    chains_mm: dict[str, Floats] = {}
    ratios: dict[tuple[str, object], float] = {}  # of each branch and wall
    for branch in form.branches:
        is_seen = form.summary.fits and not branch.doubts
        nominal_mm = _nominal_mm(branch, design)
        if is_seen:
            chains_mm[branch.id] = frozen_floats("points_mm", branch.points_mm, 2)
        for contact in branch.contacts:
            if not is_seen or contact.outcome == "unclear":
                unclear += 1
                continue
            if nominal_mm and contact.distance_mm is not None:
                ratios[branch.id, contact.wall] = 2.0 * contact.distance_mm / nominal_mm
            if contact.angle_from_normal_deg is None:
                unclear += 1
            elif contact.angle_from_normal_deg > 90.0 or (
                contact.outcome == "stopped" and branch.stop_observed in OTHER_STOPS
            ):
                elsewise += 1
            else:
                kept.append(contact)
    trunk = next((branch for branch in form.branches if branch.level == 1), None)
    nominal_mm = None if trunk is None else _nominal_mm(trunk, design)
    breadth: tuple[float, float, float] | None = None
    if form.summary.fits and form.film and form.film.width_mm and nominal_mm is not None:
        film = form.film.width_mm
        breadth = film.measured / nominal_mm, film.low / nominal_mm, film.high / nominal_mm
    return ObservedPhoto(
        file=path,
        photo=form.photo,
        contacts=tuple(kept),
        unclear=unclear,
        has_verdict=form.summary.fits,
        elsewise=elsewise,
        chains_mm=chains_mm,
        pose=start.pose,
        design=design,
        world=world,
        width_ratios=tuple(ratios.values()),
        breadth_ratio=breadth,
        notes=notes,
    )


def _found(form: ObservationForm, path: Path) -> tuple[Design | None, Map | None, tuple[str, ...]]:
    """Return design and map of an observation if still readable, and notes on the rest."""
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
    """Return a file named in an observation: as it stands, else next to the observation."""
    if "\0" in name or Path(name).is_file():
        return name
    for near in (path.parent / name, path.parent / Path(name).name):
        if near.is_file():
            return str(near)
    return name


def _nominal_mm(branch: TracedBranchForm, design: Design | None) -> float | None:
    """Return the nominal inflated diameter of a branch, by the observation or by the design."""
    if branch.width_mm is not None:
        return branch.width_mm.nominal
    if design is None:
        return None
    tree = design.tree
    alike = tree.level == branch.level  # of a design of levels; others have the branch's own width
    if design.branches is not None:
        alike = np.array([one == branch.id for one in tree.ids])
    return inflated_diameter_mm(float(tree.width_mm[alike][0])) if alike.any() else None


ANGLE_ERROR_DEG = 2.0
"""Standard error of the angle of a contact where an observation does not give one [assumed]."""

SHAPE_STEP_DEG = 0.5
SHAPE_ANGLES_DEG = tuple(np.arange(0.0, 45.01, SHAPE_STEP_DEG).tolist())
"""Half-angles at which robots are grown again."""

SHAPE_ERRORS_MM = tuple(np.geomspace(2.0, 64.0, 11).tolist())
"""Errors of shapes that are tried: at least what tracing leaves [assumed]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeFit:
    """Half-angles at which robots that are grown again look like those on the photos."""

    value_deg: float
    # 95 % interval by profile likelihood, photos as the independent units
    low_deg: float
    high_deg: float
    photos: int
    branches: int
    error_mm: float  # median over branches of the distance at the best half-angle

    @property
    def says_nothing(self) -> bool:
        """Whether shapes are alike at all half-angles."""
        return (self.low_deg, self.high_deg) == (SHAPE_ANGLES_DEG[0], SHAPE_ANGLES_DEG[-1])


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ContactFit(WrittenResult):
    """The numbers that photos measured together, with notes for the user."""

    contacts: MeasuredContacts
    threshold: ThresholdFit | None  # None without any contact that slid or stopped
    shapes: ShapeFit | None  # None where designs and maps are not available
    photos: tuple[str, ...]  # their names
    left_out: Mapping[str, int]  # contacts that were not counted, by reason
    notes: tuple[str, ...]
    path: Path | None = None  # the file that predictions read

    @property
    def agreement(self) -> str:
        """Whether contacts and whole shapes give the same half-angle, as text."""
        one, two = self.threshold, self.shapes
        if one is None or two is None:
            return "not compared: only one of the two ways can be gone"
        if two.says_nothing:
            return "not compared: the shapes are the same at all half-angles"
        apart = two.low_deg > one.high_deg or two.high_deg < one.low_deg
        return "the intervals do not meet" if apart else "both ways agree"

    def text(self) -> str:
        """Return the file that predictions read."""
        return contacts_text(self.contacts, self._method())

    def _method(self) -> dict[str, object]:
        method: dict[str, object] = {"photos": list(self.photos)}
        if (fit := self.threshold) is not None:
            method |= {"stopped": fit.stopped, "slid": fit.slid, "separable": fit.is_separable}
            ends = {"greatest_stopped_deg": fit.greatest_stopped_deg}
            ends["least_slid_deg"] = fit.least_slid_deg
            method |= {name: round(end, 3) for name, end in ends.items() if end is not None}
            method["tip_spread_deg"] = fit.tip_spread_deg
            method["photo_spread_deg"] = fit.photo_spread_deg
        if (shapes := self.shapes) is not None:
            method["shapes_half_angle_deg"] = shapes.value_deg
            method["shapes_low_deg"] = shapes.low_deg
            method["shapes_high_deg"] = shapes.high_deg
        method["agreement"] = self.agreement
        return {**method, "notes": list(self.notes)}

    schema = CONTACTS_SCHEMA

    def view(self) -> Iterator[Block]:
        """Yield the numbers that the photos measured, each with its interval and notes."""
        found, photos = self.contacts, counted(len(self.photos), "photo")
        out = ", ".join(f"{count} {why}" for why, count in self.left_out.items() if count)
        yield Answer(f"{photos}{f'; contacts left out: {out}' if out else ''}")
        facts = list[Fact]()
        if self.threshold is not None and found.head_on_half_angle_deg is not None:
            half, tips = found.head_on_half_angle_deg, self.threshold
            told = f"measured: {half.counted}, {tips.stopped} stopped, {tips.slid} slid"
            facts.append(Fact("head-on half-angle", _shown(half, " deg"), detail=told))
        if (fit := self.shapes) is not None:
            told = f"{counted(fit.branches, 'branch')} on {counted(fit.photos, 'photo')}"
            shown = "the same at all half-angles"
            if not fit.says_nothing:
                shown = f"{fit.value_deg:g} deg, 95 % interval {fit.low_deg:g} to {fit.high_deg:g}"
                told += f", {fit.error_mm:.1f} mm from the photos there, measured against simulated"
            facts.append(Fact("whole shapes grown again", shown, detail=told))
        facts.append(Fact("contacts and whole shapes", self.agreement))
        if found.tip_friction is not None:
            told = (
                "measured: the tangent of the half-angle; anchoring keeps its friction of "
                f"{ASSUMED_FRICTION.value:g}, assumed: a body pulled around an obstacle is another "
                "state of the surface"
            )
            facts.append(
                Fact("friction of a tip on a wall", _shown(found.tip_friction), detail=told)
            )
        for name, words in (
            ("body_width_ratio", "centre lines keep from walls, against lay-flat width / pi"),
            ("film_breadth_ratio", "breadth of the film, against 2 lay-flat width / pi"),
        ):
            measured: MeasuredNumber | None = getattr(found, name)
            if measured is not None:
                facts.append(Fact(words, _shown(measured), detail="measured"))
        yield Facts(tuple(facts))
        yield Notes(self.notes)
        yield Data({**found.content, "method": self._method()})


def fit_files(paths: Sequence[Path], error_deg: float = ANGLE_ERROR_DEG) -> ContactFit:
    """Return the joint fit of the observations in some files.

    Parameters
    ----------
    error_deg
        Standard error of the angles of contacts, where an observation does not give it.
    """
    number("--angle-error-deg", error_deg, 0.1, 30.0, "deg")
    photos = read_observations(paths)
    notes = [note for photo in photos for note in photo.notes]
    notes += [
        f"{photo.photo}: no verdict, so that none of its contacts counts"
        for photo in photos
        if not photo.has_verdict
    ]
    seen = [(contact, place) for place, photo in enumerate(photos) for contact in photo.contacts]
    threshold = None
    if seen:
        threshold = fit_threshold(
            [contact.angle_from_normal_deg or 0.0 for contact, _ in seen],
            [contact.outcome == "stopped" for contact, _ in seen],
            [place for _, place in seen],
            [error_deg if c.angle_error_deg is None else c.angle_error_deg for c, _ in seen],
        )
    ratio, ratio_notes = _over_photos([photo.width_ratios for photo in photos], photos)
    broad = [photo for photo in photos if photo.breadth_ratio is not None]
    breadth: MeasuredNumber | None = None
    if broad:  # against the nominal diameter; with its own interval where that is wider
        table = np.array([photo.breadth_ratio for photo in broad])
        value, low, high = _t_interval(table[:, 0])
        own = 0.5 * (table[:, 2] - table[:, 1]).mean()
        breadth = MeasuredNumber(
            value=round(value, 4),
            low=round(min(low, value - own), 4),
            high=round(max(high, value + own), 4),
            count=len(broad),
            photos=len(broad),
            source=f"{_few(len(broad))}breadth of the film from above; photos: "
            + ", ".join(photo.photo for photo in broad),
        )
    # Robots are grown again as wide as the nominal ones unless they clearly are not.
    clear = ratio is not None and not ratio.low <= 1.0 <= ratio.high
    shapes = _shape_fit(photos, ratio.value if clear and ratio and ratio.value else 1.0)
    if threshold is None and ratio is None and breadth is None:
        problem = "no contact slid or stopped, and no breadth of film was seen"
        raise UnfitInputError("observations", problem, "add such photos", photos[0].file)
    half_angle = friction = None
    if (fit := threshold) is not None:
        names = ", ".join(photo.photo for photo in photos if photo.contacts)
        half_angle = MeasuredNumber(
            value=fit.value_deg,
            low=fit.low_deg,
            high=fit.high_deg,
            side=fit.side,
            count=fit.stopped + fit.slid,
            photos=fit.photos,
            source=f"{_few(fit.photos)}{counted(fit.stopped, 'tip')} stopped, {fit.slid} slid; "
            f"photos: {names}",
        )
        low, high = (_tangent(angle_deg) for angle_deg in (fit.low_deg, fit.high_deg))
        friction = half_angle.changed(
            value=None if fit.value_deg is None else _tangent(fit.value_deg),
            low=low,
            high=high,
            source=f"tangent of the half-angle; {half_angle.source}",
        )
    return ContactFit(
        contacts=MeasuredContacts(
            head_on_half_angle_deg=half_angle,
            tip_friction=friction,
            body_width_ratio=ratio,
            film_breadth_ratio=breadth,
        ),
        threshold=threshold,
        shapes=shapes,
        photos=tuple(photo.photo for photo in photos),
        left_out={
            "unclear": sum(photo.unclear for photo in photos),
            "stopped for another reason than the angle": sum(p.elsewise for p in photos),
        },
        notes=(*notes, *_threshold_notes(threshold, photos, error_deg), *ratio_notes),
    )


def _few(photos: int) -> str:
    """Return the prefix of a source with too few photos: the words go with the number."""
    return f"too few photos ({photos}, from {FEW_PHOTOS} on); " if photos < FEW_PHOTOS else ""


# --- The half-angle from contacts -----------------------------------------------------------------


def _tangent(angle_deg: float) -> float:
    # Tangents end here: no friction is measured by a tip that stops at every angle.
    steep_deg = 89.0
    return round(math.tan(rad(min(angle_deg, steep_deg))), 4)


def _threshold_notes(
    fit: ThresholdFit | None, photos: Sequence[ObservedPhoto], error_deg: float
) -> list[str]:
    """Return the notes for a user about the half-angle, a sentence each."""
    if fit is None:
        return ["no contact slid or stopped: the half-angle stays assumed"]
    notes = list[str]()
    if fit.side != "both":
        did = "slid" if fit.side == "upper" else "stopped"
        bound = "an upper" if fit.side == "upper" else "a lower"
        notes.append(f"all tips {did}: contacts give {bound} bound of the half-angle, no estimate")
    if fit.photos < FEW_PHOTOS:
        notes.append(
            f"{counted(fit.photos, 'photo')} with contacts: too few to tell how photos differ "
            f"(from {FEW_PHOTOS} on); other photos may lie outside the interval"
        )
    if not fit.is_separable:
        notes.append(
            f"a tip stopped at {fit.greatest_stopped_deg:.1f} deg and one slid at "
            f"{fit.least_slid_deg:.1f} deg: no one angle parts them; spread of the thresholds "
            f"{fit.tip_spread_deg:g} deg among tips, {fit.photo_spread_deg:g} deg among photos"
        )
    if any(contact.angle_error_deg is None for photo in photos for contact in photo.contacts):
        notes.append(f"standard error of a contact's angle {error_deg:g} deg (assumed)")
    return notes


# --- The half-angle from whole shapes -------------------------------------------------------------


def _shape_fit(photos: Sequence[ObservedPhoto], width_ratio: float) -> ShapeFit | None:
    tables = [_distances_mm2(photo, width_ratio) for photo in photos]
    known = [table for table in tables if table is not None and len(table)]
    if not known:
        return None
    squared = np.concatenate(known)
    # Children follow their parents: the branches of a photo count as one observation together.
    weight = np.concatenate([np.full(len(table), 1.0 / len(table)) for table in known])
    likely = np.full(len(SHAPE_ANGLES_DEG), -np.inf)
    # Degrees of freedom of the distribution of shape errors [assumed]: outliers are expected.
    tails = 3.0
    for error_mm in SHAPE_ERRORS_MM:
        # A t distribution of two coordinates: a branch that went another way for a different
        # reason is an outlier, and does not decide alone.
        far = np.log1p(squared / (tails * error_mm**2))
        log = -weight @ (0.5 * (tails + 2.0) * far + 2.0 * math.log(error_mm))
        likely = np.maximum(likely, log)
    fall = 2.0 * (likely.max() - likely)
    angles = np.array(SHAPE_ANGLES_DEG)
    # As many independent observations as photos: the few give a wide interval.
    most_fall = float(scipy.stats.t.ppf(0.975, max(1, len(known) - 1))) ** 2
    inside, top = angles[fall <= most_fall], angles[fall <= 0.1]
    at_best = squared[:, likely.argmax()]
    both = at_best[at_best > 0.0]  # branches that are there in both
    return ShapeFit(
        value_deg=float(0.5 * (top[0] + top[-1])),
        # Between two half-angles that were grown anything may be.
        low_deg=max(angles[0], float(inside[0]) - SHAPE_STEP_DEG),
        high_deg=min(angles[-1], float(inside[-1]) + SHAPE_STEP_DEG),
        photos=len(known),
        branches=len(squared),
        error_mm=float(np.median(np.sqrt(both))) if len(both) else 0.0,
    )


def _distances_mm2(photo: ObservedPhoto, width_ratio: float) -> Floats | None:
    """Return the mean squared distance of each branch from its photo, shape (branches, angles)."""
    if photo.design is None or photo.world is None:
        return None
    options = GrowthChoice.of([photo.design]).options.changed(body_width_ratio=width_ratio)
    poses = [photo.pose] * len(SHAPE_ANGLES_DEG)
    atlas = TerrainSet([Terrain.of(photo.world)])
    launches = Launches.of(atlas, [poses], [rad(angle) for angle in SHAPE_ANGLES_DEG])
    grown = Batch(Plans.of([photo.design], options), launches, options, engine="auto").deployments()
    rows = [
        [_mean_square_mm2(photo.chains_mm[name], one.chain_mm(branch)) for one in grown]
        for branch, name in enumerate(grown[0].tree.ids)
        if name in photo.chains_mm
    ]
    table = np.array(rows).reshape(-1, len(grown))
    # What never emerges, neither on the photo nor at any half-angle, says nothing.
    return np.asarray(table[table.any(axis=1)])


def _mean_square_mm2(one_mm: Floats, other_mm: Floats) -> float:
    """Return the mean squared distance of two chains at the same ways along them.

    Beyond its tip a chain stays at its tip; one that never emerged stays where the other begins.
    """
    if not len(one_mm) and not len(other_mm):
        return 0.0
    one_mm = one_mm if len(one_mm) else other_mm[:1]
    other_mm = other_mm if len(other_mm) else one_mm[:1]
    chains = one_mm, other_mm
    ways = [
        np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(chain, axis=0).T))]) for chain in chains
    ]
    compared = 64  # places along a branch at which two shapes are compared
    along = np.linspace(0.0, max(float(way[-1]) for way in ways), compared)
    one, other = (
        np.column_stack([np.interp(along, way, chain[:, axis]) for axis in (0, 1)])
        for way, chain in zip(ways, chains, strict=True)
    )
    return float(np.mean(np.sum((one - other) ** 2, axis=1)))


# --- Ratios of widths -----------------------------------------------------------------------------


def _over_photos(
    values: Sequence[Sequence[float]], photos: Sequence[ObservedPhoto]
) -> tuple[MeasuredNumber | None, list[str]]:
    """Return the ratio of widths with its t interval over photos, and notes about it."""
    each = [np.array(some) for some in values if len(some)]
    count = sum(len(some) for some in each)
    fewest_ratios = 3  # so many contacts give a ratio of widths
    if count < fewest_ratios:
        few = f"{counted(count, 'contact')} with a distance from a wall: too few for a body width"
        return None, [f"{few} (from {fewest_ratios} on)"]
    notes, units = list[str](), np.array([float(np.median(some)) for some in each])
    if len(units) == 1:
        units = each[0]
        notes.append("body width from one photo: its interval is over contacts, not over photos")
    value, low, high = _t_interval(units)
    names = ", ".join(photo.photo for photo, some in zip(photos, values, strict=True) if len(some))
    if not 0.5 <= value <= 2.0:
        return None, [f"body width {value:.2f} of the nominal one is left out: it must be wrong"]
    return (
        MeasuredNumber(
            value=round(value, 4),
            low=round(max(0.5, min(low, value)), 4),
            high=round(min(2.0, max(high, value)), 4),
            count=count,
            photos=len(each),
            source=f"{_few(len(each))}distance of centre lines from walls at contacts; "
            f"photos: {names}",
        ),
        notes,
    )


def _t_interval(values: Floats) -> tuple[float, float, float]:
    """Return the mean of values with its 95 % t interval; of one value, the value alone."""
    mean = float(values.mean())
    if len(values) < 2:
        return mean, mean, mean
    half = float(
        scipy.stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values))
    )
    return mean, mean - half, mean + half


# --- As they are shown ----------------------------------------------------------------------------


def _shown(found: MeasuredNumber, unit: str = "") -> str:
    ends: Mapping[Side, str] = {
        "both": f"{found.value:g}{unit}, 95 % interval {found.low:g} to {found.high:g}"
        if found.value is not None
        else "",
        "upper": f"at most {found.high:g}{unit} (95 %)",
        "lower": f"at least {found.low:g}{unit} (95 %)",
    }
    return ends[found.side]
