"""The window at every point: as wide, along columns and along rows, as the displacement's bends allow.

A wide window averages noise, a narrow one follows bends. Fits with windows of all widths on both axes are
compared: where one differs from the fit of half its width, on either axis, by more than their noise
explains, the difference is its bias. Per point and component the window with the least
variance + `WEIGHT` bias^2 is taken.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.passive.moving_fit import blur, moving_fit

Window = tuple[float, float]

WIDTHS_PX = (4.0, 8.0, 16.0, 32.0)
"""Standard deviations of the Gaussian windows on each axis."""

WEIGHT = 4.0
"""How much worse a squared bias is than variance: later averaging takes noise away, but not bias."""

_ORDER = 2
"""Degree of the displacement within a window."""

_NOISE = 3.0
"""Squared differences, pooled over the wider window, are bias beyond this many times their noise."""

_MEDIAN = 0.455
"""Median of the square of a normal variable."""

_BY_CHANCE = 1.0
"""Excess over noise that all of a picture's differences may have without a bias."""

_WILD_PX2 = 1.0
"""Variance from which a fit does not even count as a guess."""

_FLUCTUATION_PX = 1.0
"""Two standard deviations of the relative fluctuation, times the window's width."""

_NOISE_AREA = 4.0 * np.pi / 2.5
"""1 / integral of the squared kernel of a quadratic fit under a Gaussian window, per product of widths."""


@functools.cache
def _difference_variance(ratio: float) -> float:
    """Variance of (wide fit - narrow fit) over the narrow fit's, windows wider by `ratio` on one axis.

    On even texture the quadratic fit's kernel transforms to (1 + q) exp(-q), q = (sigma k)^2 / 2 summed
    over both axes; the integrals over q of its products are taken numerically.
    """
    k = np.linspace(0.0, 8.0, 401)
    narrow = 0.5 * (k[:, None] ** 2 + k[None, :] ** 2)
    wide = 0.5 * ((ratio * k[:, None]) ** 2 + k[None, :] ** 2)
    of_narrow, of_wide = (1.0 + narrow) * np.exp(-narrow), (1.0 + wide) * np.exp(-wide)
    edge = np.where((k == 0.0)[:, None], 0.5, 1.0) * np.where((k == 0.0)[None, :], 0.5, 1.0)
    return float(np.sum(edge * (of_wide - of_narrow) ** 2) / np.sum(edge * of_narrow**2))


def adaptive_fit(
    sums: Float,
    noise: Float,
    field: Float,
    grey_variance: Float,
    size: int,
    widths_px: tuple[float, ...],
) -> tuple[Float, Float, Float]:
    """Displacement with the best window per cell: value, variance and how far its noise reaches.

    Returns (rows, cols, 2) px, (rows, cols, 2) px^2 and (rows, cols) px^2, the area over which errors go
    together (the integral of their autocorrelation, both components' mean).

    sums, noise, field: see `moving_fit`. grey_variance: (rows, cols) of the images' difference. size: of
    the cells in px. widths_px: rising. NaN where no window determines the displacement.
    """
    # (columns, rows) in px, every window after those that are narrower
    names: list[Window] = list(itertools.product(widths_px, widths_px))
    fits: dict[Window, Float] = {}
    variances: dict[Window, Float] = {}
    bias2: dict[Window, Float] = {}
    for name in names:
        fits[name], variance = moving_fit(
            sums, noise * _caution(name), grey_variance, field, (name[0] / size, name[1] / size), _ORDER
        )
        # Where texture hardly determines a fit, rounding can make its variance vanish, or the fit run away.
        variances[name] = np.where((variance > 0.0) & (variance < _WILD_PX2), variance, np.nan)
        bias2[name] = np.zeros_like(field)
        for axis in range(2):
            at = widths_px.index(name[axis])
            if at > 0:
                narrower = (widths_px[at - 1], name[1]) if axis == 0 else (name[0], widths_px[at - 1])
                extra = _bias2(fits, variances, narrower, name, size)
                bias2[name] = np.maximum(bias2[name], np.maximum(extra, bias2[narrower]))
    cost = np.stack([_pooled(variances[name], name, size) + WEIGHT * bias2[name] for name in names])
    cost = np.where(np.isfinite(cost), cost, np.inf)
    best = np.argmin(cost, axis=0)
    unresolved = _unresolved(fits, variances, widths_px)
    sigma, fit, area, total = (np.zeros_like(field) for _ in range(4))
    for k, name in enumerate(names):
        # blurred, so that a change of window leaves no step
        share = _blurred(best == k, (widths_px[0] / size,) * 2) * np.isfinite(cost[k])
        fit += share * np.nan_to_num(fits[name])
        sigma += share * np.sqrt(np.nan_to_num(variances[name] + unresolved))
        area += share * _NOISE_AREA * name[0] * name[1]
        total += share
    total = np.where(total > 0.0, total, np.nan)
    return fit / total, (sigma / total) ** 2, np.asarray((area / total).mean(axis=-1))


def _caution(window: Window) -> float:
    """Factor on the noise's share of the gradients, whose sum over few pixels fluctuates."""
    return 1.0 + _FLUCTUATION_PX / math.sqrt(window[0] * window[1])


def _apart(
    fits: dict[Window, Float], variances: dict[Window, Float], narrow: Window, wide: Window
) -> tuple[Float, Float]:
    """Squared difference of two fits in units of its noise, and that noise, px^2; NaN where either is.

    On even texture the wide fit has 1 / ratio of the narrow fit's variance, which is in both. Where it has
    less, as between dots far apart, less is in both.
    """
    ratio = max(wide[0] / narrow[0], wide[1] / narrow[1])
    even = _difference_variance(ratio)
    shared = (1.0 - even) * np.minimum(ratio * variances[wide], variances[narrow])
    noise = variances[narrow] - shared
    return (fits[wide] - fits[narrow]) ** 2 / noise, noise


def _pooled(variance: Float, window: Window, size: int) -> Float:
    """Mean variance over a window, where it is known: by its own, a cell would choose what seems the best."""
    known = np.isfinite(variance)
    pool = (window[0] / size, window[1] / size)
    mean = _blurred(np.where(known, variance, 0.0), pool) / np.maximum(_blurred(known, pool), 1e-9)
    return np.where(known, np.maximum(mean, variance), np.inf)


def _bias2(
    fits: dict[Window, Float], variances: dict[Window, Float], narrow: Window, wide: Window, size: int
) -> Float:
    """Squared bias of the wide fit against the narrow one; 0 where noise explains the difference."""
    # In units of the noise, so that badly determined cells do not drown their neighbours.
    ratio, noise = _apart(fits, variances, narrow, wide)
    known = np.isfinite(ratio)
    pool = (wide[0] / size, wide[1] / size)
    mean = _blurred(np.where(known, ratio, 0.0), pool) / np.maximum(_blurred(known, pool), 1e-9)
    return np.where(known, np.maximum(mean - _NOISE, 0.0) * noise, 0.0)


def _unresolved(
    fits: dict[Window, Float], variances: dict[Window, Float], widths_px: tuple[float, ...]
) -> Float:
    """Variance (rows, cols, 2) px^2 of what most of the picture has below the narrowest window.

    The way that pixels sample hard edges does so: each time too little to show in noise, but it is not noise.
    """
    out = np.zeros_like(next(iter(fits.values())))
    for wide in itertools.product(widths_px[:2], widths_px[:2]):
        if wide[0] == wide[1]:
            continue
        ratio, noise = _apart(fits, variances, (widths_px[0], widths_px[0]), wide)
        for c in range(2):
            known = np.isfinite(ratio[..., c])
            excess = np.median(ratio[known, c]) / _MEDIAN - 1.0 if known.any() else 0.0
            if excess > _BY_CHANCE:
                out[known, c] = np.maximum(out[known, c], excess * noise[known, c])
    return out


def _blurred(field: Float | Mask, sigma: tuple[float, float]) -> Float:
    """Both components of a field (rows, cols, 2), blurred."""
    return np.stack([blur(field[..., c].astype(np.float64), sigma) for c in range(2)], axis=-1)
