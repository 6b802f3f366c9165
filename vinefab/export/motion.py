"""How a laser's head moves along a contour: speed limits, stops, and the time that it takes.

The head changes speed at one acceleration. It stops fully where a path turns by more than
`CORNER_RAD` at a point (no cornering speed is assumed), and in an arc of radius r it keeps below
sqrt(a r). Between those limits it is as fast as it can be: speeds are lowered from the end
backwards and raised from the start forwards, as a controller that looks ahead does.
"""

import math
from itertools import pairwise

from vinefab.model.outline import Contour, Segment

CORNER_RAD = math.radians(5.0)
"""The head is taken to stop where a path turns by more than this at a point."""


def move_time_s(length_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Return the time of a straight move from rest to rest.

    >>> move_time_s(100.0, 50.0, 1000.0)
    2.05
    >>> move_time_s(0.4, 50.0, 1000.0)  # too short to reach full speed
    0.04
    """
    if length_mm < speed_mm_s**2 / acceleration_mm_s2:
        return 2.0 * math.sqrt(length_mm / acceleration_mm_s2)
    return length_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2


def segment_times_s(
    contour: Contour, speed_mm_s: float, acceleration_mm_s2: float
) -> tuple[float, ...]:
    """Return the time that each line and arc of a contour takes in one pass.

    Parameters
    ----------
    contour
        The path.
    speed_mm_s
        Speed asked for.
    acceleration_mm_s2
        Of the machine, along the path and across it.
    """
    segments = list(contour.segments)
    lengths = [segment.length_mm for segment in segments]
    tops = [min(speed_mm_s, math.sqrt(acceleration_mm_s2 * s.radius_mm)) for s in segments]
    speeds = _joint_speeds(segments, lengths, tops, acceleration_mm_s2)
    return tuple(
        _time_s(length, top, ends, acceleration_mm_s2)
        for length, top, ends in zip(lengths, tops, pairwise(speeds), strict=True)
    )


def _joint_speeds(
    segments: list[Segment], lengths: list[float], tops: list[float], acceleration: float
) -> list[float]:
    """Return the speed at the start, at every joint between segments and at the end."""
    speeds = [0.0]
    speeds += [
        0.0 if _turn_rad(*pair) > CORNER_RAD else min(two)
        for pair, two in zip(pairwise(segments), pairwise(tops), strict=True)
    ]
    speeds.append(0.0)
    for at, length in enumerate(lengths):
        speeds[at + 1] = min(speeds[at + 1], _reached(speeds[at], length, acceleration))
    for at in range(len(lengths) - 1, -1, -1):
        speeds[at] = min(speeds[at], _reached(speeds[at + 1], lengths[at], acceleration))
    return speeds


def _reached(speed: float, length: float, acceleration: float) -> float:
    return math.sqrt(speed**2 + 2.0 * acceleration * length)


def _turn_rad(before: Segment, after: Segment) -> float:
    turn = after.direction_rad() - before.direction_rad(at_end=True)
    return abs(math.remainder(turn, math.tau))


def _time_s(length: float, top: float, ends: tuple[float, float], acceleration: float) -> float:
    """Return the time of one segment between two speeds: up, along at the top, down."""
    if length == 0.0:
        return 0.0
    first, last = ends
    peak = min(top, math.sqrt((first**2 + last**2) / 2.0 + acceleration * length))
    ramps = (2.0 * peak**2 - first**2 - last**2) / (2.0 * acceleration)
    return (2.0 * peak - first - last) / acceleration + max(0.0, length - ramps) / peak
