"""A photo of a grown robot, from the file to its comparison with the prediction."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from pydantic import Field
from shapely import Polygon
from shapely.errors import ShapelyError
from shapely.geometry.base import BaseGeometry

from vinefab.core.bounded import bounded
from vinefab.core.errors import BadInputError, UnfitInputError, UnreadableFileError, located
from vinefab.core.limits import DEFAULT_MARKER_MM
from vinefab.core.plain_text import counted, rounded
from vinefab.core.table import TablePart, validated
from vinefab.core.validation import Floats, number, whole
from vinefab.core.view import (
    Answer,
    Block,
    Data,
    Fact,
    Facts,
    Notes,
    Number,
    Picture,
    Rows,
    Section,
    WrittenResult,
)
from vinefab.fabrication.calibration.coupons import JointReading
from vinefab.growth.options import growth_text
from vinefab.maps.importers.svg_document import Node, after, read_nodes, transform
from vinefab.maps.importers.svg_shapes import svg_outlines
from vinefab.model.deployment import Stop
from vinefab.model.design import Design
from vinefab.model.files.shipped import json_object, read_text
from vinefab.model.map import (
    DEFAULT_MARKER_GAP_MM,
    CornerMarker,
    Map,
    Pose,
    corner_markers,
)
from vinefab.observation.beside_prediction import (
    NO_VERDICT,
    Compared,
    ComparedBranch,
    branch_sights,
    compare_with_prediction,
)
from vinefab.observation.centre_lines import TracedBranch, TracedTree, trace
from vinefab.observation.film import FilmColour, SeenFilm, Sight, found_film, outlined_film
from vinefab.pages.page_files import page_png
from vinefab.pages.panel import ALERT, TICK_PT, Ink, Panel, level_colour, page_of, photo, plan_panel
from vinefab.photos.found_markers import MarkerSpread, marker_points, marker_spread
from vinefab.photos.photo import ControlPoints, Photo, PhotoCamera, fit_camera, rectified
from vinefab.physics.tube import inflated_diameter_mm, inflated_radius_mm

_MOST_OUTLINE_BYTES = 1 << 26
_SHAPES = ("path", "polygon", "polyline", "rect", "circle", "ellipse")
_NOT_DRAWN = ("defs", "metadata", "namedview", "image", "clipPath", "mask", "symbol", "style")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhotoSetup:
    """How a photo is to be read."""

    # markers by which it is rectified; those of the map if None
    markers: tuple[CornerMarker, ...] | None = None
    # where the corners of the box of the bounds are in the photo, (column, row), shape (4,
    # 2): lower left, lower right, upper right, upper left; instead of markers
    corners_px: Floats | None = None
    # height of the obstacles, which hide what lies behind them; None if unknown
    obstacle_mm: float | None = None
    film_colour: FilmColour | None = None  # red, green and blue of the film, if it is to be given
    outline: BaseGeometry | None = None  # areas of film outlined by hand, instead of its colour
    # whether the outline is in pixels of the photo; else it is in map millimetres
    outline_in_pixels: bool = False

    @classmethod
    def of(
        cls,
        *,
        rig: Path | None = None,
        corners_px: tuple[float, ...] | None = None,
        obstacle_mm: float | None = None,
        film_colour: tuple[float, ...] | None = None,
        outline: Path | None = None,
    ) -> "PhotoSetup":
        """Return the setup that options of the command say.

        Raises
        ------
        BadInputError
            If a value cannot be used, or options contradict each other.
        UnreadableFileError
            If a file cannot be read.
        """
        if rig is not None and corners_px is not None:
            raise UnfitInputError(
                "--corners",
                "are given together with --rig, whose markers say more",
                "leave them out",
            )
        if outline is not None and film_colour is not None:
            raise UnfitInputError(
                "--film-colour",
                "is given together with --outline, which needs none",
                "leave it out",
            )
        markers: tuple[CornerMarker, ...] | None = None
        height: float | None = None
        if rig is not None:
            content = json_object(read_text(rig, _MOST_OUTLINE_BYTES), rig)
            if "markers" not in content:
                remedy = "give the rig.json of one that does"
                raise UnfitInputError("", "the rig carries no corner markers", remedy, rig)
            form = validated(_RigForm, content, rig)
            markers, height = tuple(form.markers), form.options.height_mm / form.options.scale
        if obstacle_mm is not None:
            height = number("--obstacle-height", obstacle_mm, 0.0, 10_000.0, "mm")
        if corners_px is not None and len(corners_px) != 8:
            allowed = "eight numbers: X,Y of four corners"
            raise BadInputError("--corners", list(corners_px), allowed)
        if film_colour is not None and len(film_colour) != 3:
            raise BadInputError("--film-colour", list(film_colour), "three numbers: R,G,B")
        corners = [number("--corners", part, -1e6, 1e6, "px") for part in corners_px or ()]
        red, green, blue = (
            whole("--film-colour", int(part) if part == int(part) else -1, 0, 255)
            for part in film_colour or (0, 0, 0)
        )
        is_svg = outline is not None and outline.suffix.lower() == ".svg"
        return cls(
            markers=markers,
            corners_px=np.array(corners).reshape(4, 2) if corners else None,
            obstacle_mm=height,
            film_colour=None if film_colour is None else (red, green, blue),
            outline=None if outline is None else bounded(outline, _outline, outline, is_svg=is_svg),
            outline_in_pixels=is_svg,
        )

    @property
    def content(self) -> dict[str, object]:
        """As it stands in JSON."""
        return {
            "film_colour": None if self.film_colour is None else list(self.film_colour),
            "outlined": self.outline is not None,
            "corners_px": None if self.corners_px is None else self.corners_px.tolist(),
            "obstacle_height_mm": self.obstacle_mm,
        }


# --- The rig --------------------------------------------------------------------------------------


class _OptionsForm(TablePart):
    height_mm: Annotated[float, Field(gt=0, le=1e5)]
    scale: Annotated[float, Field(gt=0, le=1e5)] = 1.0


class _RigForm(TablePart):
    """The part of rig.json that a photo of it needs; other keys are left alone."""

    options: _OptionsForm
    markers: Annotated[list[CornerMarker], Field(min_length=1, max_length=4)]


# --- Outlines -------------------------------------------------------------------------------------


def _outline(path: Path, *, is_svg: bool) -> BaseGeometry:
    """Return the areas in a file, as one."""
    with located(path):
        if is_svg:
            areas = list(_svg_areas(path))
        else:
            content = json_object(read_text(path, _MOST_OUTLINE_BYTES), path)
            try:
                found = shapely.from_geojson(json.dumps(content))
            except (ShapelyError, ValueError, TypeError) as error:
                raise UnreadableFileError(path, f"is not GeoJSON: {str(error)[:100]}") from None
            parts = shapely.get_parts(shapely.get_parts(found))
            areas = [one for one in parts if isinstance(one, Polygon) and not one.is_empty]
        if not areas:
            remedy = "draw closed ones: polygons of GeoJSON, or paths, polygons, rects of SVG"
            raise UnfitInputError("--outline", "holds no areas", remedy)
    return shapely.union_all([shapely.make_valid(area) for area in areas])


def _svg_areas(path: Path) -> Iterator[Polygon]:
    """Yield the areas of an SVG file, in its user units: pixels of the photo under it."""
    identity = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    waiting: list[tuple[Node, Floats]] = [(read_nodes(path), identity)]
    flat_px = 0.2
    while waiting:
        node, outer = waiting.pop()
        if node.tag in _NOT_DRAWN:
            continue
        frame = after(outer, transform(node))
        for run in svg_outlines(node) if node.tag in _SHAPES else ():
            ring = np.vstack([piece.flat(flat_px) for piece in run.pieces])
            if len(ring) > 2:
                yield Polygon(ring @ frame[:, :2].T + frame[:, 2])
        waiting += [(child, frame) for child in node.children]


_ENDINGS = {
    Stop.FULL_LENGTH.label: "grown in full",
    Stop.HEAD_ON.label: "stopped head-on at a wall",
    Stop.CORNER.label: "stopped in a corner",
    Stop.NOT_DEPLOYED.label: "not deployed",
    Stop.PRESSURE.label: "out of pressure",
    Stop.BRANCH.label: "stopped at another branch",
    Stop.NOT_EVERTED.label: "did not come out",
}
"""How a branch ended, for the user."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Observation(WrittenResult):
    """A photo's robot, traced and compared."""

    # how they are called
    photo: str
    map_file: str
    design_file: str
    world: Map
    design: Design
    rectified_by: str  # the features by which the photo was rectified
    # root mean square distance, in the map, of the points that it was rectified by; None
    # where they are just enough, so that no error shows
    error_mm: float | None
    # what was found
    film: SeenFilm
    traced: TracedTree
    compared: Compared
    cautions: tuple[str, ...]  # what makes it uncertain, a sentence each
    settings: Mapping[str, object] = field(default_factory=dict)  # how the photo was read
    reading: JointReading | None = None  # the angle of a joint coupon; None for a robot
    path: Path | None = None  # the page (HTML) or the numbers (JSON); None if none was asked for

    @property
    def trunk_width_mm(self) -> dict[str, float] | None:
        """Inflated diameter of the trunk (measured), with the range that its edges leave."""
        trunk = self.compared.branches[0]
        if trunk.width_mm is None:
            return None
        # Two edges, each found to about a third of a pixel, and the scale's error.
        slack = 0.5 * self.film.view.mm_per_pixel + 2.0 * (self.error_mm or 0.0)
        return {
            "measured": round(trunk.width_mm, 3),
            "low": round(max(0.0, trunk.width_mm - slack), 3),
            "high": round(trunk.width_mm + slack, 3),
        }

    @property
    def both(self) -> list[ComparedBranch]:
        """Branches that were seen and predicted."""
        return [b for b in self.compared.branches if b.mean_mm is not None]

    @property
    def mean_error_mm(self) -> float:
        """Mean distance from the prediction over the length of these."""
        if not self.both:
            return 0.0
        weights = [branch.traced.length_mm for branch in self.both]
        means = [branch.mean_mm or 0.0 for branch in self.both]
        return float(np.average(means, weights=weights))

    @property
    def error_share(self) -> float:
        """The same over the length of the way to the farthest tip seen."""
        way = [0.0] * len(self.compared.branches)
        for index, branch in enumerate(self.compared.branches):
            parent = int(self.traced.tree.parent[index])
            way[index] = branch.traced.length_mm + (way[parent] if parent >= 0 else 0.0)
        return self.mean_error_mm / max(1e-9, *way)

    @property
    def not_as_predicted(self) -> list[str]:
        """Branches that were seen without being predicted, or predicted without being seen."""
        return [b.id for b in self.compared.branches if b.deployed_observed != b.deployed_predicted]

    schema = "vinefab/observation-1"

    @property
    def title(self) -> str:
        """Which robot on which map."""
        return f"{self.design.name} on {self.world.name}: seen and predicted"

    def view(self) -> Iterator[Block]:
        """Yield the verdict, the lines on the photo, and how far they lie from the prediction."""
        compared, film, branches = self.compared, self.film, self.compared.branches
        count, good = len(branches), self.fits and not self.not_as_predicted
        out = sum(b.came_out for b in branches)
        same_stops = sum(b.same_stop for b in branches)
        same_walls = sum(b.same_walls for b in branches)
        angles = ", ".join(f"{angle:g}" for angle in compared.best_half_angles_deg)
        yield Answer(
            f"{self.verdict[0].upper()}{self.verdict[1:]}.",
            "good" if good else ("caution" if self.fits else "bad"),
        )
        yield Picture(
            image=lambda: _overlay_picture(self),
            caption="The photo as from straight above. Yellow: lines traced on the film "
            "(measured); blue, dashed: the prediction (simulated); crosses: where tips met walls.",
            file="overlay",
        )
        doubted = [branch.id for branch in branches if branch.sight.doubts]
        if self.reading is not None:
            angle = Number(self.reading.angle_deg, "deg", ".1f", decimals=2)
            yield Facts((Fact("joint angle", angle, "joint_angle_deg", "measured"),), lead=True)
        yield Facts(
            (
                Fact(
                    "mean distance from the prediction",
                    Number(self.mean_error_mm, "mm", ".1f", decimals=3),
                    "summary.shape_error_mm",
                    "at equal arc lengths, measured against simulated",
                ),
                Fact(
                    "of the way to the farthest tip",
                    Number(self.error_share, "%", ".1f", per=0.01, decimals=5),
                    "summary.shape_error_share",
                ),
                Fact(
                    "branches seen",
                    f"{sum(b.sight.tip_and_base for b in branches)} of {count}",
                    "summary.deployed_observed",
                    "measured: tip and base on film",
                    "plain" if good else "caution",
                    sum(b.sight.tip_and_base for b in branches),
                ),
                Fact(
                    "branches in doubt",
                    f"{len(doubted)} of {count}",
                    "summary.in_doubt",
                    "nothing is claimed of their stops and contacts; cautions say why"
                    if doubted
                    else "",
                    "caution" if doubted else "plain",
                    doubted,
                ),
                Fact(
                    "branches predicted",
                    f"{sum(b.deployed_predicted for b in branches)} of {count}",
                    "summary.deployed_predicted",
                    "simulated",
                    data=sum(b.deployed_predicted for b in branches),
                ),
                Fact(
                    "same stop",
                    f"{same_stops} of {out}",
                    "summary.same_stop",
                    "of those that came out, measured against simulated",
                    data=same_stops,
                ),
                Fact(
                    "same walls met",
                    f"{same_walls} of {out}",
                    "summary.same_contact_order",
                    "of those that came out, measured against simulated",
                    data=same_walls,
                ),
                Fact(
                    "film explained",
                    Number(self.traced.film_explained, "%", ".0f", per=0.01, decimals=4),
                    "summary.film_explained",
                    "share of the film in the lines",
                ),
                Fact(
                    "half-angles with this shape",
                    f"{angles} deg",
                    "summary.best_half_angles_deg",
                    "by the shape's likelihood, errors assumed",
                    data=list(compared.best_half_angles_deg),
                ),
            ),
            lead=True,
        )
        yield Notes(self.cautions, "cautions")
        yield Notes(tuple(compared.notes))
        yield Facts(
            (
                Fact("photo", self.photo, "photo"),
                Fact("rectified by", self.rectified_by, "rectified.by", self.error_text),
                Fact("film", film.how, "film.how"),
                Fact("growth", growth_text(compared.options, [self.design])),
            )
        )
        yield Rows(
            caption="Predictions over the contact range, against the shape seen",
            headings=("half-angle deg", "mean distance mm", "same stops", "log likelihood"),
            rows=tuple(
                (Number(fit.half_angle_deg, form="g"), Number(fit.mean_mm, form=".2f", decimals=3),
                 fit.same_stops, Number(fit.log_likelihood, form=".1f", decimals=3))
                for fit in compared.fits
            ),
            key="half_angles",
            keys=("head_on_half_angle_deg", "mean_mm", "same_stops", "log_likelihood"),
            folded=True,
        )  # fmt: skip
        # Measured where it comes from the photo, simulated where it is called predicted.
        yield Data(
            {
                "map": self.map_file,
                "design": self.design_file,
                "pose": compared.prediction.pose.content,
                "rectified": rounded(
                    {
                        "by": self.rectified_by,
                        "error_mm": self.error_mm,
                        "mm_per_pixel": film.view.mm_per_pixel,
                        "plane_mm": film.sight.plane_mm,
                        "heights_corrected": film.sight.camera is not None,
                    },
                    3,
                )
                | {"obstacle_height_mm": film.sight.obstacle_mm or None},
                "film": {
                    "colour": None if film.colour is None else list(film.colour),
                    "how": film.how,
                    "width_mm": self.trunk_width_mm,
                },
                "branches": [branch.content for branch in branches],
                "summary.branches": len(branches),
                "summary.not_deployed_observed": [
                    b.id for b in branches if not b.deployed_observed
                ],
                "summary.deployed_otherwise_than_predicted": self.not_as_predicted,
                "summary.lines_on_film": round(self.traced.lines_supported, 4),
                "summary.fits": self.fits,
                "summary.not_told_apart": [b.id for b in branches if b.is_ambiguous],
                "settings": {"growth": dict(compared.options.content), **self.settings},
            }
        )

        def film_png() -> bytes:
            grey = np.clip(np.rint(255.0 * film.share), 0, 255).astype(np.uint8)
            return page_png(page_of(_photo_panel(self, grey, 324.0)), dpi=100)

        film_found = Picture(
            image=film_png,
            caption="Where film was found (white: film).",
        )
        yield Section(title="Film", pictures=(film_found,), folded=True)
        yield _branch_section(self.compared.branches)

    @property
    def fits(self) -> bool:
        """Whether this design from this pose can be what the photo shows."""
        return self.compared.is_read

    @property
    def error_text(self) -> str:
        """The accuracy of the rectified photo, as text."""
        if self.error_mm is None:
            return "error unknown: four points fit exactly"
        return f"error {self.error_mm:.2f} mm, measured"

    @property
    def verdict(self) -> str:
        """Whether the robot did what was predicted; if not, the first branch that did not."""
        if not self.fits:
            return "no verdict: the photo hardly shows this design from this pose"
        clear = [branch for branch in self.compared.branches if not branch.sight.doubts]
        for branch in clear:  # parents come before their children
            if branch.stop_observed != branch.stop_predicted:
                return (
                    f"not as predicted: branch {branch.id} "
                    f"{_ending(branch.stop_observed, branch.traced.length_mm)} (measured), "
                    f"predicted {_ending(branch.stop_predicted, branch.predicted_mm)} (simulated)"
                )
        doubtful = [branch.id for branch in self.compared.branches if branch.sight.doubts]
        if doubtful:
            return (
                f"as predicted where it is clear: {counted(len(clear), 'branch')} ended as "
                f"simulated, {len(doubtful)} are in doubt: {', '.join(doubtful)}"
            )
        return (
            "as predicted: every branch ended as simulated, "
            f"{self.mean_error_mm:.1f} mm off its predicted line in the mean (measured)"
        )


def _branch_section(branches: Sequence[ComparedBranch]) -> Section:
    """Return lengths, stops, distances and contacts of every branch."""
    mm, percent = partial(Number, form=".1f"), partial(Number, form=".1f", per=0.01)
    rows = tuple(
        (
            branch.id,
            mm(branch.planned_mm),
            mm(branch.traced.length_mm if branch.deployed_observed else None),
            mm(branch.predicted_mm if branch.deployed_predicted else None),
            branch.stop_observed.replace("_", " "),
            branch.stop_predicted.replace("_", " "),
            mm(branch.mean_mm),
            mm(branch.hausdorff_mm),
            percent(branch.share),
            mm(branch.width_mm),
        )
        for branch in branches
    )
    orders = tuple(
        (
            branch.id,
            ", ".join(branch.order_observed) or "-",
            ", ".join(branch.order_predicted) or "-",
            "yes" if branch.same_walls else "no",
        )
        for branch in branches
        if branch.order_observed or branch.order_predicted
    )
    contacts = tuple(
        (branch.id, one.wall, mm(one.x_mm), mm(one.y_mm), mm(one.angle_from_normal_deg),
         mm(one.angle_error_deg), one.outcome)
        for branch in branches
        for one in branch.contacts
    )  # fmt: skip
    return Section(
        title="Branch by branch",
        paragraphs=(
            "Observed lengths, stops, distances and widths are measured on the photo; predicted "
            "ones are simulated.",
        ),
        tables=(
            Rows(
                caption="Branches: lengths in mm; distances at equal arc lengths, in mm "
                "and in percent of the length seen",
                headings=(
                    "branch", "planned", "observed", "predicted", "stop observed",
                    "stop predicted", "mean mm", "Hausdorff mm", "mean %", "diameter mm",
                ),
                rows=rows,
            ),
            Rows(
                caption="Walls that tips met, in their order: seen (measured) and predicted "
                "(simulated)",
                headings=("branch", "seen", "predicted", "same"),
                rows=orders,
                folded=len(orders) > 12,
            ),
            Rows(
                caption="Contacts: angle between the tip's heading and the wall's normal "
                "(measured, with an assumed standard error)",
                headings=("branch", "wall", "x mm", "y mm", "angle deg", "error deg", "tip"),
                rows=contacts,
                folded=len(contacts) > 12,
            ),
        ),
        folded=True,
    )  # fmt: skip


def _ending(stop: str, length_mm: float) -> str:
    """Return the ending of a branch, as text."""
    words = _ENDINGS.get(stop, "ended early without a wall")
    return words if stop == Stop.NOT_DEPLOYED.label else f"{words} after {length_mm:.0f} mm"


# --- Pictures: the photo from straight above, lines seen and predicted

SEEN, PREDICTED = "#ffe600", "#00e5ff"


def _photo_panel(seen: Observation, pixels: NDArray[np.uint8], longest_pt: float) -> Panel:
    """Return a panel with pixels where the photo lies on the map."""
    view = seen.film.view
    rows, columns = view.pixels.shape[:2]
    right = view.left_mm + columns * view.mm_per_pixel
    box = (view.left_mm, view.top_mm - rows * view.mm_per_pixel, right, view.top_mm)
    panel = plan_panel(box, longest_pt)
    panel.add(photo(pixels, box), 0.0)
    return panel


def _overlay_picture(seen: Observation) -> bytes:
    """Return the photo from straight above, with the lines seen and predicted."""
    panel = _photo_panel(seen, seen.film.view.pixels, 432.0)
    for branch in seen.compared.branches:
        z_mm = branch.nominal_width_mm / 2.0
        shown = partial(seen.film.moved, from_mm=z_mm, to_mm=seen.film.sight.plane_mm)
        if len(branch.predicted_points_mm) > 1:
            dashed = Ink(line=PREDICTED, width_pt=1.3, dash_pt=(5.2, 3.9))
            panel.line(shown(branch.predicted_points_mm), dashed, rank=4.0)
        if not branch.deployed_observed:
            continue
        places = shown(branch.traced.points_mm)
        panel.line(places, Ink(line=level_colour(branch.level), width_pt=2.6), rank=3.0)
        panel.line(places, Ink(line=SEEN, width_pt=1.1), rank=3.0)
        x, y = places[len(places) // 2].tolist()
        panel.words((x, y), branch.id, TICK_PT, shift_pt=(3.0, 5.5), halo=True)
        contacts = [(c.x_mm, c.y_mm) for c in branch.contacts if c.outcome != "unclear"]
        if contacts:
            cross = Ink(line=ALERT, width_pt=1.4)
            panel.marks(shown(np.array(contacts)), "x", 5.0, cross, rank=5.0)
    return page_png(page_of(panel), dpi=130)


# --- From the file to the result


def observe_photo(  # noqa: PLR0913
    photo: Photo,
    world: Map,
    design: Design,
    pose: Pose,
    setup: PhotoSetup | None = None,
    *,
    growth: Mapping[str, object] | None = None,
    map_file: str = "",
    design_file: str = "",
) -> Observation:
    """Return the observation of a photo, with the prediction.

    Parameters
    ----------
    growth
        Growth options of the prediction by name.
    map_file, design_file
        What map and design are called in the files written.

    Raises
    ------
    BadInputError
        If the photo cannot be rectified, or no film is found on it.
    """
    setup = setup or PhotoSetup()
    camera, by, spread = _camera(photo, world, setup)
    widths = design.tree.width_mm.tolist()
    plane = inflated_radius_mm(widths[0])
    left, low, right, top = world.bounds.bounds
    around_bounds_mm = 10.0  # of the plan around the bounds
    area = (
        left - around_bounds_mm,
        low - around_bounds_mm,
        right + around_bounds_mm,
        top + around_bounds_mm,
    )
    size = (area[2] - area[0]) * (area[3] - area[1])
    most_plan_pixels = 4_000_000  # larger maps get a coarser plan
    mm_per_pixel = 0.5  # of the plan that film is looked for on; edges are found to a tenth of that
    step = max(mm_per_pixel, float(np.sqrt(size / most_plan_pixels)))
    view = rectified(photo, camera, area, plane_mm=plane, mm_per_pixel=step)
    knows_heights = camera.focal_px is not None
    sight = Sight(
        plane_mm=plane,
        camera=camera if knows_heights else None,
        obstacle_mm=setup.obstacle_mm or 0.0,
    )
    if setup.outline is not None:
        outline = setup.outline
        if setup.outline_in_pixels:
            outline = shapely.transform(outline, lambda px: camera.to_map(px, plane))
        film = outlined_film(view, world, outline, sight)
    else:
        sizes = (inflated_diameter_mm(max(widths)), inflated_diameter_mm(min(widths)))
        film = found_film(view, world, pose, sizes, sight, colour=setup.film_colour)
    traced = trace(film, design, world, pose)
    if not traced.branches[0].deployed:
        problem = f"no film is at the base ({pose.x_mm:g}, {pose.y_mm:g}) mm"
        raise UnfitInputError("", problem, "give the pose where the trunk leaves it", photo.name)
    sights = branch_sights(film, traced)
    compared = compare_with_prediction(traced, design, world, pose, growth, sights)
    seen = Observation(
        photo=photo.name,
        map_file=map_file or world.name,
        design_file=design_file or design.name,
        world=world,
        design=design,
        rectified_by=by,
        error_mm=camera.residual_mm if setup.corners_px is None else None,
        film=film,
        traced=traced,
        compared=compared,
        cautions=(),
        settings=setup.content,
    )
    spread_cautions = () if spread is None or not spread.is_clear else (
        f"markers look {100.0 * spread.size:.1f} % as large as their distances say (measured), as "
        "through a lens that bends straight lines: places may be off by about "
        f"{spread.most_mm:.1f} mm",
    )  # fmt: skip
    cautions = (*spread_cautions, *film.cautions, *_cautions(seen, camera, setup))
    return replace(seen, cautions=cautions)


def _camera(
    photo: Photo, world: Map, setup: PhotoSetup
) -> tuple[PhotoCamera, str, MarkerSpread | None]:
    """Return the camera, the source of its data, and the offsets of markers from their places."""
    if setup.corners_px is not None:
        left, low, right, top = world.bounds.bounds
        corners = np.array([(left, low), (right, low), (right, top), (left, top)])
        control = ControlPoints(points_px=setup.corners_px, points_mm=corners, noise_px=2.0)
        return fit_camera(photo, control), "four corners given", None
    markers = setup.markers if setup.markers is not None else corner_markers(world)
    control = marker_points(photo, markers)
    spread, camera = marker_spread(control), fit_camera(photo, control)
    side_mm = float(np.hypot(*(control.points_mm[1] - control.points_mm[0])))
    # Root mean square distance of markers' corners from where they should be, over a marker's side,
    # up to which a photo is read: a lens that bends straight lines by 5 % makes half of it.
    most_off_side = 0.05
    if spread.is_wrong_layout or camera.residual_mm > most_off_side * side_mm:
        x_mm, y_mm = spread.out_mm
        if not spread.is_wrong_layout:
            where = f"{camera.residual_mm:.1f} mm off (measured)"
        elif abs(x_mm - y_mm) <= max(0.5, 0.1 * spread.most_mm):
            where = f"{spread.most_mm:.1f} mm farther {'out' if x_mm > 0.0 else 'in'}"
        else:
            axes = zip("xy", spread.out_mm, strict=True)
            known = [f"{axis} {off_mm:+.1f}" for axis, off_mm in axes if math.isfinite(off_mm)]
            where = f"{', '.join(known)} mm farther out"
        if spread.is_wrong_layout:
            where += ", by how large they look (measured)"
        other = "--corners goes without markers"
        allowed = (
            f"{DEFAULT_MARKER_MM:g} mm wide, {DEFAULT_MARKER_GAP_MM:g} mm outside the bounds' box; "
            f"a rig's own places: --rig RIG/rig.json; {other}"
        )
        if setup.markers is not None:
            allowed = f"where --rig says, {side_mm:g} mm wide: is it the file of this rig? {other}"
        raise BadInputError("markers", where, allowed, photo.name)
    return camera, f"{len(control.points_px) // 4} corner markers", spread


def _cautions(seen: Observation, camera: PhotoCamera, setup: PhotoSetup) -> list[str]:
    """Return the causes of an observation's uncertainty, a sentence each."""
    found: list[str] = []
    branches = seen.compared.branches
    if not seen.fits:
        found.append(
            f"{100 * seen.traced.film_explained:.0f} % of the film lies in the lines, "
            f"{100 * seen.traced.lines_supported:.0f} % of the lines on film, and "
            f"{sum(set(b.sight.doubts) > {NO_VERDICT} for b in branches)} of "
            f"{counted(len(branches), 'branch')} are in doubt: "
            "this design from this pose hardly is what the photo shows"
        )
    if setup.obstacle_mm is None and seen.world.obstacles:
        found.append(
            "the height of the obstacles is not known: what they hide looks as if the film "
            "ended there; --obstacle-height tells"
        )
    radii = [inflated_radius_mm(width) for width in seen.design.tree.width_mm.tolist()]
    away = camera.parallax_mm_per_mm * max(abs(seen.film.sight.plane_mm - camera.z_mm), *radii)
    least_parallax_mm = 0.5  # less is not worth a caution
    if camera.focal_px is None and away > least_parallax_mm:
        found.append(
            "the camera's focal length is not known: what lies higher or lower than the points "
            f"that the photo was rectified by may be up to {away:.1f} mm off"
        )
    if camera.focal_px is not None and away > least_parallax_mm:
        found.append(f"the camera's place leaves {away:.1f} mm of parallax (95 %)")
    why: dict[str, list[str]] = {}
    for branch in branches:
        for doubt in branch.sight.doubts:
            why.setdefault(doubt, []).append(branch.id)
    why.pop(NO_VERDICT, None)
    found += [f"{doubt}: {', '.join(ids)}" for doubt, ids in why.items()]
    hardly = [b.id for b in branches if b.deployed_observed and b.traced.seen < 0.3]
    if hardly:
        found.append(f"hidden for most of their length: {', '.join(hardly)}")
    return found


_TRUNK, _CHILD = (0.1, 0.7), (0.5, 0.92)
"""Stretch of a line that counts: away from the joint, where film is wider than a tube, and tip."""


_EDGE_POINTS, _EDGE_STEPS = 40, 81
"""Places along an edge, and points across it at each."""

_LEAST_EXPLAINED, _LEAST_SUPPORTED = 0.82, 0.9
"""Share of the film in the lines, and of the lines on film, of a coupon: 0.93 and 0.98 at least on
rendered photos; an elbow explains 0.71 of a pair."""


def joint_reading(seen: Observation, kpa: float) -> JointReading:
    """Return the angle of a joint coupon on a photo, as a row of the coupons' results.

    Parameters
    ----------
    kpa
        Pressure in the coupon.

    Raises
    ------
    BadInputError
        If the photo hardly shows the coupon.
    """
    traced = seen.traced
    shares = traced.film_explained, traced.lines_supported
    if shares[0] < _LEAST_EXPLAINED or shares[1] < _LEAST_SUPPORTED:
        problem = f"only {100.0 * shares[0]:.0f} % of its film is in lines of {seen.design.name}"
        remedy = "take a photo of this coupon alone, launched from --pose"
        raise UnfitInputError("photo", problem, remedy, seen.photo)
    return JointReading(
        coupon=seen.design.name,
        kpa=kpa,
        angle_deg=joint_angle_deg(traced, seen.film),
        source=Path(seen.photo).name,
    )


def joint_angle_deg(traced: TracedTree, film: SeenFilm) -> float:
    """Return the angle between the axes of a pair, or from a trunk to its only child.

    It is the reading ``joint_angle`` of a table of coupon results.

    Raises
    ------
    BadInputError
        If the design is not a trunk with one or two children, or one of them was not seen.
    """
    count = len(traced.branches)
    if count not in (2, 3):
        problem = f"it has {counted(count, 'branch')}"
        raise UnfitInputError("design", problem, "give a trunk with one or two children")
    if count == 2:
        trunk, child = (branch.points_mm for branch in traced.branches)
        one, other = _heading_rad(trunk, _TRUNK), _heading_rad(child, _CHILD)
    else:
        pair = traced.branches[1], traced.branches[2]
        headings = [_heading_rad(child.points_mm, _CHILD) for child in pair]
        turn = math.remainder(headings[1] - headings[0], math.tau)
        one, other = (
            _outer_heading_rad(film, child, heading, side)
            for child, heading, side in zip(
                pair, headings, (-np.sign(turn), np.sign(turn)), strict=True
            )
        )
    return abs(math.degrees(math.remainder(other - one, math.tau)))


def _outer_heading_rad(
    film: SeenFilm, child: TracedBranch, heading_rad: float, side: float
) -> float:
    """Return the direction of the edge of a child that its sibling does not hide.

    Where tubes touch, the lines of both are drawn apart; their outer edges are not.

    Parameters
    ----------
    side
        1 for its left edge, -1 for its right one.
    """
    points, radius = child.points_mm, child.width_mm / 2.0
    along = np.array([math.cos(heading_rad), math.sin(heading_rad)])
    across = side * np.array([-along[1], along[0]])
    end = points[-1] @ along
    places = np.linspace(*_CHILD, _EDGE_POINTS) * (end - points[0] @ along) + points[0] @ along
    # Out from the line, which may stand off the axis by half a radius, past its edge.
    outward = np.linspace(0.0, 2.0 * radius, _EDGE_STEPS)
    middle = np.interp(places, points @ along, points @ across)
    grid = places[:, None, None] * along + (middle[:, None] + outward)[..., None] * across
    share = film.at(grid.reshape(-1, 2), film.sight.plane_mm).reshape(len(places), -1)
    first = np.argmax(share < 0.5, axis=1)
    rows = np.flatnonzero(first > 0)
    if len(rows) < _EDGE_POINTS // 2:
        raise UnfitInputError(
            "film", "no child has an outer edge", "take a photo of the whole coupon"
        )
    inner, outer = share[rows, first[rows] - 1], share[rows, first[rows]]
    steps = first[rows] - 1 + (inner - 0.5) / (inner - outer)
    off = middle[rows] + steps * outward[1]
    # The median of slopes leaves out what shadows and creases add at some places.
    slope = float(scipy.stats.theilslopes(off, places[rows])[0])
    return heading_rad + side * math.atan(slope)


def _heading_rad(line_mm: Floats, stretch: tuple[float, float]) -> float:
    """Return the direction of the straight line through a stretch of a centre line."""
    first, last = (round(share * len(line_mm)) for share in stretch)
    least_points = 3
    if last - first < least_points:
        raise UnfitInputError("film", "a branch is not seen", "take a photo of the whole coupon")
    points = line_mm[first:last]
    along = np.linalg.svd(points - points.mean(axis=0))[2][0]
    along = along * np.sign(along @ (points[-1] - points[0]))
    return math.atan2(along[1], along[0])
