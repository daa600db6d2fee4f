"""One comparison of a reference with an image warped by a field: how alike, and what the fit needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.passive.cells import (
    AA,
    AR,
    AX,
    AY,
    GX,
    GY,
    RR,
    XX,
    XY,
    YY,
    A,
    N,
    R,
    X,
    Y,
    grey_sums,
    normal_sums,
)
from zeromethod.passive.interpolation import noise_gain, spline_coefficients, warp_image
from zeromethod.passive.moving_fit import blur

PADDING = 2
"""Cells added round a field, so that the cubic between cells reaches the image's border."""

ALIKE = 0.7
"""Correlation coefficient from which parts of two images count as the same."""

LIGHT_PX = 10.0
"""Gaussian window over which brightness and contrast may differ between the images."""

_LEAST_NEAR = 0.1
"""Share of a window's pixels that must be left for those ignored to be left out."""


@dataclass(frozen=True, slots=True)
class CellMatches:
    """Sums per cell (see `cells.normal_sums`) and how well the images agree round it.

    match: (rows, cols) correlation coefficient in a window. alike: (rows, cols) cells that both images show,
    and show alike. shown: (rows, cols) cells with pixels in both images. grey_variance: (rows, cols) of the
    difference of two matched pixels, both images' noise counted. pixels: (rows, cols) how many were compared.
    """

    sums: Float
    match: Float
    alike: Mask
    shown: Mask
    grey_variance: Float
    pixels: Float


def padded(field: Float) -> Float:
    """Field (rows, cols, 2) with `PADDING` more cells on every side, continued along straight lines."""
    for axis in (0, 1):
        line = np.moveaxis(field, axis, 0)
        step = np.arange(1, PADDING + 1)[:, None, None]
        before, after = (
            line[:1] + step[::-1] * (line[:1] - line[1:2]),
            line[-1:] + step * (line[-1:] - line[-2:-1]),
        )
        field = np.moveaxis(np.concatenate([before, line, after]), 0, axis)
    return np.ascontiguousarray(field)


class Matcher:
    """Compares one pair of images repeatedly, for ever better fields. Keeps its buffers."""

    def __init__(self, reference: Single, image: Single, size: int) -> None:
        """reference, image: (rows, cols) grey. size: of the cells in px."""
        self._reference = reference
        self._coefficients = spline_coefficients(image)
        self._warped = np.empty_like(reference)
        self.size = size
        self.shape = -(-reference.shape[0] // size), -(-reference.shape[1] // size)
        self._sums = np.empty((*self.shape, 5))
        self._more = np.empty((*self.shape, 10))
        self._grey = np.empty((*self.shape, 6))

    def compare(self, field: Float, *, final: bool = False, ignored: Mask | None = None) -> CellMatches:
        """Warp the image by field (cell rows, cell cols, 2) px and compare it with the reference.

        final: for a fit whose variance counts, and not just its direction. ignored: (cell rows, cell cols)
        cells that say nothing of their neighbours' brightness, contrast and noise.
        """
        warp_image(self._coefficients, padded(field), PADDING, self.size, self._warped)
        grey_sums(self._reference, self._warped, self.size, self._grey)
        shown = self._grey[..., 0] > 0.5 * self.size**2
        light, match, contrast = self._light(self._blurred(self._grey))
        if ignored is not None and ignored.any():
            light = self._light(self._near(self._grey, ignored))[0]
        normal_sums(self._reference, self._warped, light, self.size, self._sums, self._more)
        near = self._near(self._more, ignored)
        count = near[N]
        if final:
            self._without_light(near)
        # Interpolation has smoothed the image's noise, but not the part of it that the fit feels.
        gain = light[..., 0] ** 2
        variance = near[RR] / np.maximum(count, 1.0) * (1.0 + gain) / (1.0 + noise_gain(field) * gain)
        # The rim of a hole is alike in a window, but not in its own pixels.
        own = self._more[..., RR] <= 2.0 * (1.0 - ALIKE) * contrast * self._more[..., N]
        alike = shown & (match > ALIKE) & own
        variance = np.where(count > 0.0, variance, np.nan)
        return CellMatches(self._sums, match, alike, shown, variance, self._more[..., N])

    def _blurred(self, sums: Float) -> list[Float]:
        """Every channel (rows, cols) of sums (rows, cols, n) in the window of `LIGHT_PX`."""
        sigma = (LIGHT_PX / self.size, LIGHT_PX / self.size)
        return [blur(np.ascontiguousarray(sums[..., k]), sigma) for k in range(sums.shape[-1])]

    def _near(self, sums: Float, ignored: Mask | None) -> list[Float]:
        """Sums (rows, cols, n), the first of which counts pixels, in that window, without cells ignored."""
        near = self._blurred(sums)
        if ignored is None or not ignored.any():
            return near
        others = self._blurred(np.where(ignored[..., None], 0.0, sums))
        enough = others[0] > _LEAST_NEAR * near[0]
        return [np.where(enough, other, one) for other, one in zip(others, near, strict=True)]

    def _without_light(self, near: list[Float]) -> None:
        """Take out of the gradients g what brightness and contrast, free to change, make up for.

        A displacement d changes r by (g - mean g - slope (a - mean a)) d only, slope being that of the
        regression of g on a in the window: a pure ramp determines nothing. That part stands in for g.
        """
        n = np.maximum(near[N], 1e-3)
        a = near[A] / n
        variance = np.maximum(near[AA] / n - a * a, 1e-6)
        own = [self._more[..., k] for k in range(10)]
        spread = own[AA] - 2.0 * a * own[A] + own[N] * a * a
        mean = [near[k] / n for k in (GX, GY)]
        slope = [(near[ak] / n - a * g) / variance for ak, g in zip((AX, AY), mean, strict=True)]
        along = [own[ak] - a * own[k] for ak, k in ((AX, GX), (AY, GY))]
        for channel, i in ((X, 0), (Y, 1)):
            self._sums[..., channel] -= mean[i] * own[R] + slope[i] * (own[AR] - a * own[R])
        for channel, i, k in ((XX, 0, 0), (XY, 0, 1), (YY, 1, 1)):
            self._sums[..., channel] += (
                own[N] * mean[i] * mean[k]
                - mean[i] * own[GX + k]
                - mean[k] * own[GX + i]
                - slope[i] * along[k]
                - slope[k] * along[i]
                + slope[i] * slope[k] * spread
                + (mean[i] * slope[k] + mean[k] * slope[i]) * (own[A] - a * own[N])
            )

    @staticmethod
    def _light(near: list[Float]) -> tuple[Float, Float, Float]:
        """(gain, offset) of the warped image per cell; correlation and reference's variance in its window."""
        n, a, b, aa, ab, bb = near
        n = np.maximum(n, 1e-3)
        a, b = a / n, b / n
        var_a, var_b = np.maximum(aa / n - a * a, 1e-6), np.maximum(bb / n - b * b, 1e-6)
        # The ratio of contrasts, unlike a regression, is not pulled to zero by noise.
        gain = np.clip(np.sqrt(var_a / var_b), 0.2, 5.0)
        match = (ab / n - a * b) / np.sqrt(var_a * var_b)
        return np.stack([gain, a - gain * b], axis=-1), match, var_a
