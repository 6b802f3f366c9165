"""The half-angle at which tips stop, from contacts that slid and contacts that stopped.

A tip that meets a wall at an angle ``a`` from its normal stops if ``|a| <= T`` and slides if not.
What is seen of a contact is the angle with an error and on which side of the threshold it was: an
interval-censored observation of ``T``. The threshold of a contact is ``T = theta + photo + tip``:
the half-angle, what the tips of one photo share (film, floor, light, hand), and what each tip has
of its own, both normal with mean 0. The likelihood of a photo is integrated over what its tips
share, so that many contacts on one photo count for less than as many on different photos.

All distributions are sums on one grid of angles, so that both integrals are Gaussian filters.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.validation import Floats
from vinefab.model.contacts import Side

STEP_DEG = 0.25
_LEAST_DEG, _MOST_DEG = -30.0, 120.0
"""Grid of thresholds; below 0 every tip slides, above 90 every tip stops."""

TIP_SPREADS_DEG = (0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
PHOTO_SPREADS_DEG = (0.0, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)
"""Standard deviations of thresholds that are tried [assumed: at most 10 degrees]."""

TWO_SIDED, ONE_SIDED = 3.841, 2.706
"""Falls of twice the log likelihood at the ends of a 95 % interval, and at a 95 % bound."""

_LEAST_SHARE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdFit:
    """The threshold between tips that stopped and tips that slid, with what it rests on."""

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
    inside = _theta_deg()[fall <= (TWO_SIDED if side == "both" else ONE_SIDED)]
    # Separable contacts leave a plateau: its middle says more than its first point.
    top = _theta_deg()[fall <= 0.1]
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


@cache
def _grid_deg() -> Floats:
    return np.arange(_LEAST_DEG, _MOST_DEG + STEP_DEG / 2.0, STEP_DEG)


@cache
def _theta_deg() -> Floats:
    grid = _grid_deg()
    return grid[(grid >= 0.0) & (grid <= 90.0)]


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
    threshold = np.maximum(_grid_deg(), 0.0)
    error = np.maximum(np.broadcast_to(error_deg, angle_deg.shape), STEP_DEG)[:, None]
    away = angle_deg[:, None]
    # The true angle has a sign that the measured one has lost: both sides of the normal count.
    stops = scipy.special.ndtr((threshold - away) / error) - scipy.special.ndtr(
        (-threshold - away) / error
    )
    photos = int(group.max()) + 1
    spreads = PHOTO_SPREADS_DEG if photos > 1 else PHOTO_SPREADS_DEG[:1]
    inside = (_grid_deg() >= 0.0) & (_grid_deg() <= 90.0)
    table = np.empty((len(TIP_SPREADS_DEG), len(spreads), int(inside.sum())))
    for row, tip_deg in enumerate(TIP_SPREADS_DEG):
        share = np.clip(_averaged(stops, tip_deg), _LEAST_SHARE, 1.0 - _LEAST_SHARE)
        logs = np.log(np.where(stopped[:, None], share, 1.0 - share))
        each = np.zeros((photos, logs.shape[1]))
        np.add.at(each, group, logs)
        peak = each.max(axis=1, keepdims=True)
        likely = np.exp(each - peak)
        for column, photo_deg in enumerate(spreads):
            whole = np.log(np.maximum(_averaged(likely, photo_deg), 1e-300)) + peak
            table[row, column] = whole.sum(axis=0)[inside]
    return table
