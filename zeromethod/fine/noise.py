"""Noise of the fine depth, in closed form.

Slopes of independent pixels, integrated by least squares on a rectangle: every cosine of the transform gets
noise of its own, of variance v. A pixel's depth has the variance sum v c^2 over all cosines, c their value at
the pixel. Waves that the sensing window passes are in the nodes' noise already; the others are summed here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.fine.integrate import eigenvalues
from zeromethod.sensing.window import transfer

_SAME = 0.1
"""Relative steps of what the noise beyond the window is computed for."""
_SAMPLED_PX = 4
"""From one pixel to the next of which the noise is taken, and for which it is computed."""
Gains = Callable[[], Iterable[tuple[Single | float, Float]]]
_POINTS = np.array([11.0, -93.0, 802.0, 802.0, -93.0, 11.0]) / 1440.0
"""Weights of pixels in the integral from one to the next, as `surface.differences` has them."""


def _rule(count: int) -> Float:
    """Squared gain (count,) of the integral over one interval, by the transform's wave numbers."""
    k = np.pi * np.arange(count) / count
    gain = 2.0 * (_POINTS[3] * np.cos(0.5 * k) + _POINTS[4] * np.cos(1.5 * k) + _POINTS[5] * np.cos(2.5 * k))
    return np.asarray(gain**2)


def wave_variance(
    shape: tuple[int, int],
    step_mm: tuple[float, float],
    slope2: tuple[float, float],
) -> Float:
    """Variance v (rows, cols), mm^2, of the depth's cosines, orthonormal.

    step_mm: of a pixel along columns, along rows. slope2: variance of the slope along the same, rad^2.
    """
    rows, cols = shape
    weight = [1.0 / (s2 * step * step) for s2, step in zip(slope2, step_mm, strict=True)]
    total = eigenvalues(shape, weight[0], weight[1])
    total[0, 0] = np.inf
    # each axis adds w^2 |2 sin|^2 var = w |2 sin|^2, with the rule's gain
    noise = weight[0] * eigenvalues(shape, 1.0, 0.0) * _rule(cols)
    noise = noise + weight[1] * eigenvalues(shape, 0.0, 1.0) * _rule(rows)[:, None]
    return np.asarray(noise / total**2)


def _squares(wave: Float, every: int) -> Float:
    """Sum over all orthonormal cosines of v c^2, (rows, cols), at the middle of every `every` pixels."""
    out = wave
    for axis, count in enumerate(wave.shape):
        k, x = np.arange(count), np.minimum(np.arange(every // 2, count + every // 2, every), count - 1)
        norm = np.where(k == 0, 1.0 / count, 2.0 / count)
        # cos^2 = (1 + cos 2) / 2; at k = 0 it is 1
        squared = norm * np.cos(np.pi * np.outer(2 * x + 1, k) / (2 * count)) ** 2
        out = np.moveaxis(np.tensordot(squared, out, axes=(1, axis)), 0, axis)
    return out


class DetailNoise:
    """Variance of depth by the pixels' noise beyond the sensing window.

    Computed once for each ratio of the two slopes' noise, in steps, and again when the pixels' steps change.

    period_px: of the carriers, and so of the window. gains: (rows, cols) of what is done to the cosines'
    amplitude, and the share of each in the pixels.
    """

    def __init__(self, period_px: int, gains: Gains | None = None) -> None:
        self._period_px, self._gains = period_px, gains
        self._steps_mm = 0.0, 0.0
        self._units: dict[int, list[tuple[Single | float, Single]]] = {}

    def variance(self, slope2: Single, x_mm: Single, y_mm: Single, valid: Mask) -> Single:
        """Variance (rows, cols), mm^2.

        slope2: (2, rows, cols) variance of the slope, rad^2, which varies slowly over the view: the variance
        goes with it, as most of it comes from nearby. valid: (rows, cols), some.
        """
        some = slice(None, None, _SAMPLED_PX), slice(None, None, _SAMPLED_PX)
        among = some if valid[some].any() else (slice(None), slice(None))
        x2, y2 = (float(np.mean(one[among][valid[among]])) for one in slope2)
        steps, variances = [], []
        for axis in (1, 0):
            dx, dy = (_mean_step(one, axis) for one in (x_mm, y_mm))
            steps.append(float(np.hypot(dx, dy)))
            variances.append((x2 * dx * dx + y2 * dy * dy) / (dx * dx + dy * dy))
        if not np.allclose(steps, self._steps_mm, rtol=_SAME):
            self._units, self._steps_mm = {}, (steps[0], steps[1])
        key = round(math.log(variances[1] / variances[0]) / _SAME)
        if key not in self._units:
            self._units[key] = list(self._beyond_window(valid.shape, math.exp(key * _SAME)))
        out: Single = slope2[0] + slope2[1]
        out *= _at_pixels(self._units[key], valid.shape)
        out *= np.float32(variances[0] / (x2 + y2))
        return out

    def _beyond_window(self, shape: tuple[int, ...], ratio: float) -> Iterator[tuple[Single | float, Single]]:
        """Variance where slopes along columns have variance 1, along rows this one, and shares of each.

        Of every pixel in the middle of some.
        """
        rows, cols = shape
        wave = wave_variance((rows, cols), self._steps_mm, (1.0, ratio))
        down, across = (transfer(self._period_px, np.maximum(np.arange(n), 1e-6) / (2 * n)) for n in shape)
        wave *= 1.0 - np.outer(down, across) ** 2
        for share, gain in [(1.0, None)] if self._gains is None else self._gains():
            yield share, _squares(wave if gain is None else wave * gain**2, _SAMPLED_PX).astype(np.float32)


def _at_pixels(units: list[tuple[Single | float, Single]], shape: tuple[int, ...]) -> Single:
    """(rows, cols) of units that stand for squares of pixels, by their shares."""
    rows, cols = shape
    out = np.zeros(shape, np.float32)
    for share, unit in units:
        out += share * unit.repeat(_SAMPLED_PX, axis=0)[:rows].repeat(_SAMPLED_PX, axis=1)[:, :cols]
    return out


def _mean_step(values: Single, axis: int) -> float:
    """Mean difference of neighbours along an axis."""
    ends = np.take(values, [0, -1], axis=axis).mean(axis=1 - axis, dtype=np.float64)
    return float((ends[1] - ends[0]) / (values.shape[axis] - 1))
