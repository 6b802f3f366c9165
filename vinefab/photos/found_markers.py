"""Corner markers found in a photo, with OpenCV (extra ``vision``)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
import scipy  # its parts load at their first use
from numpy.typing import NDArray
from PIL import Image

from vinefab.core.errors import UnfitInputError
from vinefab.core.extras import ensure_extra
from vinefab.core.validation import Floats
from vinefab.model.map import MARKER_SIDE_CELLS, CornerMarker
from vinefab.photos.photo import (
    CAMERA_GAMMA,
    ControlPoints,
    Photo,
    fitted_homography,
    inverse,
    projected,
)


def _mean_side(corners: Floats) -> float:
    return float(np.hypot(*(corners - np.roll(corners, 1, axis=0)).T).mean())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundMarker:
    """A marker as it is seen in a photo."""

    # of its black frame, shape (4, 2): (column, row) of the upper left one, as it was
    # printed, and the others clockwise; middles of pixels end in .5
    corners_px: Floats
    noise_px: float  # how far they may be off: standard deviation, from the residuals of the fit
    blur_px: float  # how far light is spread over its edges: standard deviation
    # exponent by which mixed light is stored: 1 / 2.2 of a lens out of focus, 1 of a picture
    # that was smoothed or made smaller as it was stored. Between, the middle of an edge lies
    # at another brightness
    mixing: float
    # root mean square of the residuals of the fit, over the contrast of black and white
    misfit: float

    @property
    def side_px(self) -> float:
        """Mean length of its sides."""
        return _mean_side(self.corners_px)


def measured_markers(photo: Photo, dictionary: str = "DICT_4X4_50") -> dict[int, FoundMarker]:
    """Return each marker that a photo shows, by its number, with how well it is seen.

    Parameters
    ----------
    dictionary
        OpenCV's name of the ArUco dictionary.

    Raises
    ------
    BadInputError
        If a number is seen twice.
    MissingPackageError
        If OpenCV is not installed.
    """
    ensure_extra("vision", f"{photo.name} with markers")
    cv2: Any = import_module("cv2")
    stored = np.asarray(Image.fromarray(photo.pixels).convert("L"))
    # How much light fell on each pixel.
    light = np.round(255.0 * (np.arange(256) / 255.0) ** CAMERA_GAMMA).astype(np.uint8)
    grey = np.asarray(light[stored])
    # Pixels of the longer side in which markers are searched; their corners are then found in the
    # whole photo.
    largest_searched = 2400
    times = max(1, -(-max(grey.shape) // largest_searched))
    small = np.asarray(Image.fromarray(grey).reduce(times)) if times > 1 else grey
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    corners, numbers, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(small)
    found: dict[int, FoundMarker] = {}
    for number, square in zip([] if numbers is None else numbers.ravel(), corners, strict=True):
        if int(number) in found:
            problem = "stands twice in the photo"
            raise UnfitInputError(f"marker {number}", problem, "show each once", photo.name)
        rough = (square.reshape(4, 2).astype(np.float64) + 0.5) * times
        bits = np.asarray(cv2.aruco.generateImageMarker(known, int(number), MARKER_SIDE_CELLS))
        found[int(number)] = _fitted(stored, rough, bits > 0)
    return found


# --- A marker's picture, fitted to the pixels


_MIXING = 0.35, 1.1
"""Least and most exponent of stored light."""

_LEAST_NOISE_PX, _OF_BLUR = 0.05, 0.035
"""Least error of corners, and its share of the blur, whose shape is not known
[assumed, above what rendered photos show]."""


def _fitted(stored: NDArray[np.uint8], rough: Floats, bits: NDArray[np.bool_]) -> FoundMarker:
    """Return a marker by the picture of it, out of focus, that fits the photo's pixels best.

    Edges of a blurred marker lie where mixed light is stored as half of it, and where that is
    depends on camera and software: a border looks wider or narrower by some tenths of the blur.
    The cells inside are moved the other way, so that both together tell size from blur.
    """
    grid = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]) * MARKER_SIDE_CELLS
    rim_cells = 0.8  # of the white around a marker that is looked at
    pad = (1.0 + 2.0 * rim_cells / MARKER_SIDE_CELLS) * (rough - rough.mean(axis=0))
    box = rough.mean(axis=0) + pad
    rows, columns = stored.shape
    low = np.floor(box.min(axis=0)).astype(int).clip(0)
    high = np.ceil(box.max(axis=0)).astype(int).clip(0, (columns, rows))
    x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
    pixels = np.column_stack([x.ravel(), y.ravel()])
    seen = stored[low[1] : high[1], low[0] : high[0]].ravel().astype(np.float64)
    cells = projected(inverse(_square_to(rough, grid)), pixels)
    near = ((cells > -rim_cells) & (cells < MARKER_SIDE_CELLS + rim_cells)).all(axis=1)
    most_fitted = 1200  # pixels of one marker; of a large one some are left out
    step = max(1, int(near.sum()) // most_fitted)
    chosen = np.flatnonzero(near)[::step]
    pixels, seen = pixels[chosen], seen[chosen]
    middle, size = rough.mean(axis=0), float(np.ptp(rough, axis=0).max())
    pattern = np.ones((MARKER_SIDE_CELLS + 4,) * 2)  # white, two cells around
    pattern[2:-2, 2:-2] = bits
    black, white = np.percentile(seen, (5.0, 95.0))
    contrast = max(float(white - black), 1.0)

    def shown(values: Floats) -> Floats:
        corners = rough + values[:8].reshape(4, 2)
        matrix = inverse(_square_to(corners, grid))
        places = projected(matrix, pixels)
        scale = MARKER_SIDE_CELLS / _mean_side(corners)
        mixed = _blurred_cells(places, pattern, math.exp(values[8]) * scale)
        low_light, exponent = values[10], values[9]
        dark = max(low_light, 0.0) ** (1.0 / exponent)
        light = (dark + (1.0 - dark) * mixed) ** exponent
        slope = 1.0 + ((pixels - middle) / size) @ values[12:14]
        return np.asarray(values[11] * light * slope)

    def off(values: Floats) -> Floats:
        return (shown(values) - seen) / contrast

    begin = np.concatenate(
        [np.zeros(8), [0.0, 0.6, max(0.02, black / white), max(white, 1.0)], (0.0, 0.0)]
    )
    least = np.concatenate([np.full(8, -0.2 * size), [math.log(0.2), _MIXING[0], 0.0, 1.0, -1, -1]])
    most = np.concatenate(
        [np.full(8, 0.2 * size), [math.log(size / 6.0), _MIXING[1], 0.9, 400, 1, 1]]
    )
    begin = np.clip(begin, least + 1e-6, most - 1e-6)
    fit = scipy.optimize.least_squares(
        off, begin, bounds=(least, most), x_scale=np.maximum(1e-3, 0.1 * (most - least)),
        loss="soft_l1", f_scale=0.1, xtol=1e-4, ftol=1e-4, max_nfev=20,
    )  # fmt: skip
    misfit = float(np.sqrt(np.mean(off(fit.x) ** 2)))
    slopes = np.asarray(fit.jac)
    spread = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12)
    # What the fit leaves is alike in neighbouring pixels (grain and JPEG): its errors are larger
    # than of independent pixels by about this factor [assumed].
    correlated = 2.0
    noise = correlated * misfit * math.sqrt(float(np.diag(spread)[:8].mean()))
    blur = float(math.exp(fit.x[8]))
    return FoundMarker(
        corners_px=rough + fit.x[:8].reshape(4, 2),
        noise_px=max(_LEAST_NOISE_PX, math.hypot(noise, _OF_BLUR * blur)),
        blur_px=blur,
        mixing=float(fit.x[9]),
        misfit=misfit,
    )


def _square_to(corners_px: Floats, grid: Floats) -> Floats:
    """Return the homography from four corners of a grid to four of a photo."""
    rows, values = [], []
    for (u, v), (x, y) in zip(grid, corners_px, strict=True):
        rows += [[u, v, 1, 0, 0, 0, -x * u, -x * v], [0, 0, 0, u, v, 1, -y * u, -y * v]]
        values += [x, y]
    return np.append(np.linalg.solve(np.array(rows), np.array(values)), 1.0).reshape(3, 3)


def _blurred_cells(places: Floats, pattern: Floats, spread: float) -> Floats:
    """Return the whiteness of a pattern of cells at places (in cells), spread by a normal blur."""
    edges = np.arange(-1.0, MARKER_SIDE_CELLS + 2.0)
    across, down = (scipy.special.ndtr((places[:, axis, None] - edges) / spread) for axis in (0, 1))
    shares = []
    for beyond in (across, down):
        first, last = 1.0 - beyond[:, :1], beyond[:, -1:]
        shares.append(np.hstack([first, beyond[:, :-1] - beyond[:, 1:], last]))
    return np.asarray(((shares[1] @ pattern) * shares[0]).sum(axis=1))


def marker_points(photo: Photo, markers: Sequence[CornerMarker]) -> ControlPoints:
    """Return the corners of a map's markers in a photo, as control points.

    Raises
    ------
    BadInputError
        If fewer than two of the markers are seen (those missing are named), or they do not lie at
        one height.
    """
    found = measured_markers(photo)
    seen = [marker for marker in markers if marker.number in found]
    missing = sorted(marker.number for marker in markers if marker.number not in found)
    # Of the four: the corners of two lie far enough apart to hold the plane between all four.
    fewest_markers = 2
    if len(seen) < fewest_markers:
        numbers = ", ".join(map(str, missing))
        problem = f"{len(seen)} of {len(markers)} are seen (not {numbers})"
        remedy = f"show {fewest_markers} or more whole and sharp, with white around them"
        raise UnfitInputError("markers", problem, remedy, photo.name)
    heights = {marker.z_mm for marker in seen}
    if len(heights) > 1:
        problem = f"they lie at heights {sorted(heights)}"
        raise UnfitInputError("markers", problem, "lay them at one height", photo.name)
    return ControlPoints(
        points_px=np.concatenate([found[marker.number].corners_px for marker in seen]),
        points_mm=np.concatenate([marker.corners_mm for marker in seen]),
        z_mm=heights.pop(),
    )


_LEAST_SPREAD_MM, _CLEAR = 0.5, 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerSpread:
    """How much farther apart markers lie than they are said to, by how large they are seen.

    A homography fits four squares to the middles of any four others that lie as a rectangle: only
    the size in which each is seen says how far apart they are.
    """

    # how much farther from the middle of all each marker lies along x and y; less than 0: nearer
    out_mm: tuple[float, float]
    noise_mm: float  # of these, one standard deviation
    explained: (
        float  # share of the squared distances between seen and said places that they explain
    )
    size: float  # how large the markers are seen, over the size that they are said to have

    @property
    def most_mm(self) -> float:
        """The larger of the two distances, its sign dropped."""
        return float(np.nanmax(np.abs(self.out_mm)))

    @property
    def is_clear(self) -> bool:
        """Whether they lie elsewhere, beyond what noise explains."""
        return self.most_mm > max(_LEAST_SPREAD_MM, _CLEAR * self.noise_mm)

    @property
    def is_wrong_layout(self) -> bool:
        """Whether they clearly lie elsewhere, and it is not a lens that bends straight lines.

        A lens moves corners along rays from the middle, but hardly makes squares wider across
        them: about half of its effect looks like another distance.
        """
        lens_explained = 0.65
        return self.is_clear and self.explained > lens_explained


def marker_spread(control: ControlPoints) -> MarkerSpread:
    """Return the extra spread of the markers of control points, from `marker_points`."""
    corners = control.points_mm.reshape(-1, 4, 2)
    middles = corners.mean(axis=1)
    middle = 0.5 * (middles.min(axis=0) + middles.max(axis=0))
    outwards = np.repeat(np.sign(np.round(middles - middle, 6)), 4, axis=0)
    apart = np.ptp(middles, axis=0)
    is_seen = apart > 0.0
    axes = np.eye(2)[is_seen]
    begin = fitted_homography(control)
    begin = (begin / begin[2, 2]).ravel()[:8]

    def off(values: Floats) -> Floats:
        moved = control.points_mm + outwards * (values[8:] @ axes)
        seen = projected(np.append(values[:8], 1.0).reshape(3, 3), moved)
        return np.asarray((seen - control.points_px).ravel())

    still = np.append(begin, np.zeros(len(axes)))
    fit = scipy.optimize.least_squares(off, still, x_scale="jac", method="lm", max_nfev=2000)
    before, after = float((off(still) ** 2).sum()), float((fit.fun**2).sum())
    freedom = max(1, len(fit.fun) - len(fit.x))
    noise_px = max(control.noise_px, math.sqrt(after / freedom))
    slopes = np.asarray(fit.jac)
    unit = np.linalg.norm(slopes, axis=0)
    spread = np.linalg.pinv(slopes / unit, rcond=1e-14)[8:] / unit[8:, None]
    out_mm = np.full(2, np.nan)
    out_mm[is_seen] = fit.x[8:]
    narrower = np.abs(apart / (apart + 2.0 * out_mm))[is_seen]
    return MarkerSpread(
        out_mm=(float(out_mm[0]), float(out_mm[1])),
        noise_mm=noise_px * float(np.linalg.norm(spread, axis=1).max()),
        explained=1.0 - after / before if before > 0.0 else 0.0,
        size=float(np.exp(np.log(narrower).mean())),
    )


_SQUARE = np.array([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)])


def square_points(found: Mapping[int, Floats], side_mm: float) -> ControlPoints:
    """Return the corners of markers of one size that lie anywhere on a plane, as control points.

    The map's axes are those of the marker with the lowest number; the lower left corner of the box
    around all is the origin. Where the others lie and the perspective are fitted together.

    Parameters
    ----------
    found
        `FoundMarker.corners_px` by number; at least one.
    """
    seen = np.array([found[number] for number in sorted(found)])
    first = fitted_homography(ControlPoints(points_px=seen[0], points_mm=_SQUARE))
    squares = _SQUARE[None]  # of side one; the first is upright
    if len(seen) > 1:
        rough = projected(inverse(first), seen[1:].reshape(-1, 2)).reshape(-1, 4, 2)
        along = rough[:, 1] - rough[:, 0] + rough[:, 2] - rough[:, 3]
        turns = np.arctan2(along[:, 1], along[:, 0])
        middles = rough.mean(axis=1)
        begin = np.concatenate([(first / first[2, 2]).ravel()[:8], middles.ravel(), turns])

        def off(values: Floats) -> Floats:
            matrix = np.append(values[:8], 1.0).reshape(3, 3)
            placed = _squares(values[8:]).reshape(-1, 2)
            return np.asarray((projected(matrix, placed) - seen.reshape(-1, 2)).ravel())

        fit = scipy.optimize.least_squares(off, begin, x_scale="jac", method="lm", max_nfev=5000)
        squares = _squares(fit.x[8:])
    placed_mm = side_mm * squares.reshape(-1, 2)
    return ControlPoints(points_px=seen.reshape(-1, 2), points_mm=placed_mm - placed_mm.min(axis=0))


def _squares(values: Floats) -> Floats:
    """Return the first square and those whose middles, then turns, are given."""
    count = len(values) // 3
    middles, turns = values[: 2 * count].reshape(-1, 2), values[2 * count :]
    cosine, sine = np.cos(turns), np.sin(turns)
    rotations = np.array([[cosine, sine], [-sine, cosine]]).transpose(2, 0, 1)
    others = (_SQUARE - 0.5) @ rotations + middles[:, None]
    return np.concatenate([_SQUARE[None], others])
