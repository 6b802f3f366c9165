"""Corner markers found in a photo, with OpenCV (extra ``vision``)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from scipy.optimize import least_squares

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.model.corner_marker import MARKER_SIDE_CELLS, CornerMarker
from vinefab.photos.photo import CAMERA_GAMMA, Photo
from vinefab.photos.photo_camera import ControlPoints, fitted_homography, inverse, projected

FEWEST_MARKERS = 2
"""Of the four: the corners of two lie far enough apart to hold the plane between all four."""

_LARGEST_SEARCHED = 2400
"""Pixels of the longer side in which markers are searched; their corners are then found in the
whole photo."""


def find_markers(photo: Photo, dictionary: str = "DICT_4X4_50") -> dict[int, Floats]:
    """Return the corners of each marker that a photo shows, by its number.

    Parameters
    ----------
    dictionary
        OpenCV's name of the ArUco dictionary.

    Returns
    -------
    dict
        Arrays of shape (4, 2): (column, row) of the upper left corner of the marker's black frame,
        as it was printed, and the others clockwise; middles of pixels end in .5.

    Raises
    ------
    BadInputError
        If a number is seen twice, or OpenCV is not installed.
    """
    try:
        cv2: Any = import_module("cv2")
    except ImportError as error:
        allowed = "together with OpenCV: pip install 'vinefab[vision]'"
        raise BadInputError("markers", "asked for", allowed, photo.name) from error
    # How much light fell on each pixel.
    light = np.round(255.0 * (np.arange(256) / 255.0) ** CAMERA_GAMMA).astype(np.uint8)
    grey = np.asarray(light[np.asarray(Image.fromarray(photo.pixels).convert("L"))])
    times = max(1, -(-max(grey.shape) // _LARGEST_SEARCHED))
    small = np.asarray(Image.fromarray(grey).reduce(times)) if times > 1 else grey
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    corners, numbers, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(small)
    found: dict[int, Floats] = {}
    for number, square in zip([] if numbers is None else numbers.ravel(), corners, strict=True):
        if int(number) in found:
            raise BadInputError("marker", f"{number} twice in the photo", "each once", photo.name)
        rough = (square.reshape(4, 2).astype(np.float64) + 0.5) * times
        found[int(number)] = _refined(grey, rough)
    return found


def _refined(grey: NDArray[np.uint8], corners: Floats) -> Floats:
    """Return corners of a marker to a fraction of a pixel: where lines through its sides meet.

    A corner of an image that is not perfectly sharp is round, so what looks for corners themselves
    finds them too far inside.
    """
    for _ in range(2):
        sides = [_side(grey, corners[index], corners[index - 3]) for index in range(4)]
        corners = np.array([_meeting(sides[index - 1], sides[index]) for index in range(4)])
    return corners


_SIDE_PARTS = 64
_AVERAGED = 8
_ACROSS = 33
_NEAR_ENDS = 0.1
_REACH_CELLS = 0.45
_FAR_OFF = 3.0


def _side(grey: NDArray[np.uint8], start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Return a point and the direction of the line through a marker's side; white is to its left.

    Rows run down, so the left side of a clockwise square, as one looks at it, is outside.
    """
    along = end - start
    outwards = np.array([along[1], -along[0]]) / np.hypot(*along)
    reach = _REACH_CELLS * float(np.hypot(*along)) / MARKER_SIDE_CELLS
    places = start + np.linspace(_NEAR_ENDS, 1.0 - _NEAR_ENDS, _SIDE_PARTS)[:, None] * along
    steps = np.linspace(-reach, reach, _ACROSS)
    spots = places[:, None] + steps[:, None] * outwards - 0.5
    bright = ndimage.map_coordinates(
        grey, spots[..., ::-1].reshape(-1, 2).T, np.float64, order=1, mode="nearest"
    )
    # Neighbours are averaged first: of noise, what rises would be taken and what falls left out.
    bright = bright.reshape(-1, _AVERAGED, _ACROSS).mean(axis=1)
    places = places.reshape(-1, _AVERAGED, 2).mean(axis=1)
    rise = np.clip(np.diff(bright, axis=1), 0.0, None)
    rise = np.clip(rise - 0.25 * rise.max(axis=1, keepdims=True), 0.0, None) + 1e-9
    middles = 0.5 * (steps[1:] + steps[:-1])
    edge = places + (rise @ middles / rise.sum(axis=1))[:, None] * outwards
    middle, direction = _line(edge)
    off = np.abs((edge - middle) @ np.array([direction[1], -direction[0]]))
    return _line(edge[off <= _FAR_OFF * max(float(np.median(off)), 1e-6)])


def _line(points: Floats) -> tuple[Floats, Floats]:
    middle = points.mean(axis=0)
    return middle, np.linalg.svd(points - middle)[2][0]


def _meeting(one: tuple[Floats, Floats], two: tuple[Floats, Floats]) -> Floats:
    """Return where two lines, each a point and a direction, cross."""
    sides = np.column_stack([one[1], -two[1]])
    share = np.linalg.lstsq(sides, two[0] - one[0], rcond=None)[0]
    return np.asarray(one[0] + share[0] * one[1])


def marker_points(
    photo: Photo, markers: Sequence[CornerMarker], fewest: int = FEWEST_MARKERS
) -> ControlPoints:
    """Return the corners of a map's markers in a photo, as control points.

    Raises
    ------
    BadInputError
        If fewer than ``fewest`` of the markers are seen (those missing are named), or they do not
        lie at one height.
    """
    found = find_markers(photo)
    seen = [marker for marker in markers if marker.number in found]
    missing = sorted(marker.number for marker in markers if marker.number not in found)
    if len(seen) < fewest:
        numbers = ", ".join(map(str, missing))
        raise BadInputError(
            "markers",
            f"{len(seen)} of {len(markers)} (not seen: {numbers})",
            f"at least {fewest} seen whole and sharp, with white around them",
            photo.name,
        )
    heights = {marker.z_mm for marker in seen}
    if len(heights) > 1:
        raise BadInputError("markers", f"at heights {sorted(heights)}", "one height", photo.name)
    return ControlPoints(
        points_px=np.concatenate([found[marker.number] for marker in seen]),
        points_mm=np.concatenate([marker.corners_mm for marker in seen]),
        z_mm=heights.pop(),
    )


_LEAST_SPREAD_MM, _CLEAR = 0.5, 2.5
_LENS_EXPLAINED = 0.65


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
        them: about half of what it does looks like another distance.
        """
        return self.is_clear and self.explained > _LENS_EXPLAINED


def marker_spread(control: ControlPoints) -> MarkerSpread:
    """Return how much farther apart the markers of control points lie, from `marker_points`."""
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
    fit = least_squares(off, still, x_scale="jac", method="lm", max_nfev=2000)
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


def square_points(found: Mapping[int, Floats], side_mm: float) -> ControlPoints:
    """Return the corners of markers of one size that lie anywhere on a plane, as control points.

    The map's axes are those of the marker with the lowest number; the lower left corner of the box
    around all is the origin. Where the others lie and the perspective are fitted together.

    Parameters
    ----------
    found
        From `find_markers`; at least one.
    """
    seen = np.array([found[number] for number in sorted(found)])
    placed = side_mm * _placed_squares(seen).reshape(-1, 2)
    return ControlPoints(points_px=seen.reshape(-1, 2), points_mm=placed - placed.min(axis=0))


_SQUARE = np.array([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)])


def _placed_squares(seen: Floats) -> Floats:
    """Return the corners of squares of side one, shape (n, 4, 2); the first is upright."""
    first = fitted_homography(ControlPoints(points_px=seen[0], points_mm=_SQUARE))
    if len(seen) == 1:
        return _SQUARE[None]
    rough = projected(inverse(first), seen[1:].reshape(-1, 2)).reshape(-1, 4, 2)
    middles = rough.mean(axis=1)
    along = rough[:, 1] - rough[:, 0] + rough[:, 2] - rough[:, 3]
    turns = np.arctan2(along[:, 1], along[:, 0])
    begin = np.concatenate([(first / first[2, 2]).ravel()[:8], middles.ravel(), turns])

    def off(values: Floats) -> Floats:
        matrix = np.append(values[:8], 1.0).reshape(3, 3)
        return (
            projected(matrix, _squares(values[8:]).reshape(-1, 2)) - seen.reshape(-1, 2)
        ).ravel()

    fit = least_squares(off, begin, x_scale="jac", method="lm", max_nfev=5000)
    return _squares(fit.x[8:])


def _squares(values: Floats) -> Floats:
    """Return the first square and those whose middles, then turns, are given."""
    count = len(values) // 3
    middles, turns = values[: 2 * count].reshape(-1, 2), values[2 * count :]
    cosine, sine = np.cos(turns), np.sin(turns)
    rotations = np.array([[cosine, sine], [-sine, cosine]]).transpose(2, 0, 1)
    others = (_SQUARE - 0.5) @ rotations + middles[:, None]
    return np.concatenate([_SQUARE[None], others])
