"""Closest points of many pairs of segments at once."""

from dataclasses import dataclass

import numpy as np

from vinefab.model.checked import Floats

_TINY = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closest:
    """Where k pairs of segments are closest.

    Parameters
    ----------
    distance_mm
        Between the closest points, shape (k,); 0 where the segments cross.
    along_a, along_b
        Place of the closest points on each segment, 0 at its start and 1 at its end, shape (k,).
    """

    distance_mm: Floats
    along_a: Floats
    along_b: Floats


def closest(start_a_mm: Floats, end_a_mm: Floats, start_b_mm: Floats, end_b_mm: Floats) -> Closest:
    """Return the closest points of pairs of segments.

    Parameters
    ----------
    start_a_mm, end_a_mm, start_b_mm, end_b_mm
        Ends of the segments, shape (k, 2) each; a segment may be a single point.

    Notes
    -----
    The closest points of two segments by clamping first one and then the other parameter
    (Ericson, Real-Time Collision Detection, section 5.1.9).

    Examples
    --------
    >>> square = np.array([[0.0, 0.0]]), np.array([[10.0, 0.0]])
    >>> closest(*square, np.array([[4.0, 3.0]]), np.array([[4.0, 9.0]])).distance_mm.tolist()
    [3.0]
    """
    ax, ay = (end_a_mm - start_a_mm).T
    bx, by = (end_b_mm - start_b_mm).T
    rx, ry = (start_a_mm - start_b_mm).T
    aa = np.maximum(ax * ax + ay * ay, _TINY)
    bb = np.maximum(bx * bx + by * by, _TINY)
    ab, ar, br = ax * bx + ay * by, ax * rx + ay * ry, bx * rx + by * ry
    cross = aa * bb - ab * ab
    flat = cross <= _TINY * aa * bb  # parallel, or a point: any place on a will do at first
    along_a = np.where(flat, 0.0, (ab * br - ar * bb) / np.where(flat, 1.0, cross)).clip(0.0, 1.0)
    along_b = ((ab * along_a + br) / bb).clip(0.0, 1.0)
    along_a = ((ab * along_b - ar) / aa).clip(0.0, 1.0)
    gap_x = rx + along_a * ax - along_b * bx
    gap_y = ry + along_a * ay - along_b * by
    return Closest(
        distance_mm=np.sqrt(gap_x * gap_x + gap_y * gap_y), along_a=along_a, along_b=along_b
    )
