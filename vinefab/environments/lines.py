"""Lines and segments in bulk: every argument holds one row per line, point or segment."""

import numpy as np
from numpy.typing import NDArray

from vinefab.model.checked import Floats, Ints

Flags = NDArray[np.bool_]
_PARALLEL_SINE = float(np.sin(np.radians(12.0)))


def cross(first: Floats, second: Floats) -> Floats:
    """Return the cross products of plane vectors, shape (n,)."""
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


def unit(vectors: Floats) -> Floats:
    """Return vectors of length 1; zero vectors stay zero."""
    return np.asarray(vectors / np.maximum(np.hypot(*vectors.T), 1e-30)[:, None])


def distance_to_segments(points: Floats, first: Floats, last: Floats) -> Floats:
    """Return the distance of each point to its segment."""
    step = last - first
    length_2 = np.maximum(np.sum(step * step, axis=1), 1e-30)
    share = np.clip(np.sum((points - first) * step, axis=1) / length_2, 0.0, 1.0)
    return np.asarray(np.hypot(*(first + share[:, None] * step - points).T))


def feet_on_lines(points: Floats, on_line: Floats, direction: Floats) -> Floats:
    """Return the foot of each point on its line; directions are unit vectors."""
    along = np.sum((points - on_line) * direction, axis=1)
    return np.asarray(on_line + along[:, None] * direction)


def principal_directions(centred: Floats, starts: Ints) -> Floats:
    """Return the direction of the largest second moment of each run of centred points.

    Parameters
    ----------
    centred
        Shape (n, 2).
    starts
        Shape (m,), increasing: where each run begins.

    Returns
    -------
    array
        Shape (m, 2), unit vectors.
    """
    x, y = centred.T
    xx, yy, xy = (np.add.reduceat(values, starts) for values in (x * x, y * y, x * y))
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def meeting_points(
    first: tuple[Floats, Floats], second: tuple[Floats, Floats], near: Floats
) -> Floats:
    """Return where pairs of lines meet.

    Parameters
    ----------
    first, second
        Points on the lines and their directions, unit vectors.
    near
        For lines within 12 degrees of parallel the answer is the middle of this point's two
        feet: where they meet says nothing then.
    """
    sine = cross(first[1], second[1])
    parallel = np.abs(sine) < _PARALLEL_SINE
    along = cross(second[0] - first[0], second[1]) / np.where(parallel, 1.0, sine)
    meeting = first[0] + along[:, None] * first[1]
    between = 0.5 * (feet_on_lines(near, *first) + feet_on_lines(near, *second))
    return np.where(parallel[:, None], between, meeting)
