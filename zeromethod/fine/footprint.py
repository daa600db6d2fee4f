"""The pupil's footprint on the mirror, and the lens's blur, divided out where the rig file states them.

A pixel sees the mean of the mirror over the footprint of the camera's pupil, an ellipse that varies slowly
over the view: in waves, depth is multiplied by F = 2 J1(r) / r, r = |M' k| (`optics.pupil`), which reaches 0.
It is divided by it as far as that does not multiply noise: by G = F / (F^2 + (c (1 - F))^2), which is 1 for
waves much longer than the footprint, and 0 for those beyond the first at which F is 0: of those the pupil
shows at most an eighth, inverted. As seen through the pupil, depth has what is left of it when it is
multiplied by F again: waves that no pupil shows are noise. The lens blurs what the shown picture leaves of
the displacement, not what it nulls, so that this is sharpened in the displacement itself.

The LCD's pixels are seen as waves of nearly two camera pixels, the same in all frames: 25 thousandths of a
pixel, as much as the noise of a second. They are smoothed away by 1 - (sin(k / 2) / sin(q / 2))^6 along u and
v, q their own wave number.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from scipy.fft import dctn, idctn, next_fast_len
from scipy.special import j1, jn_zeros

from zeromethod.arrays import Float, Mask, Single
from zeromethod.fine.lattice import PixelLattice
from zeromethod.optics import Optics
from zeromethod.optics.pupil import footprint_terms, quadratic_terms
from zeromethod.rig.model import Rig

NOISE_LIMIT = 0.15
"""C above: noise is multiplied by 1 / (2 c) = 3.3 at most."""
_FIRST_ZERO = float(jn_zeros(1, 1)[0])
"""Least r at which F is 0."""
_PIXEL_PX2 = 1 / 12
"""Variance of a camera pixel's square, px^2."""
_SINE_6 = np.array([-1.0, 6.0, -15.0, 20.0, -15.0, 6.0, -1.0]) / 64.0
"""Weights of pixels by which cosines are multiplied by sin^6(k / 2)."""
_SHORT_WAVES = 0.35
"""Cycles per camera px from which waves of the LCD's pixels are smoothed away: the mirror has longer ones."""
_SIZES = 4
"""Footprints by which the whole view is divided, from the smallest to the largest in equal steps of area."""


def response(radius: Float) -> Float:
    """F of the module for r, 1 at 0."""
    r = np.maximum(radius, 1e-6)
    return np.asarray(2.0 * j1(r) / r)


def regularised_inverse(radius: Float) -> Float:
    """G of the module for r."""
    share = response(radius)
    return np.where(radius < _FIRST_ZERO, share / (share**2 + (NOISE_LIMIT * (1.0 - share)) ** 2), 0.0)


def _smoothing(rig: Rig, optics: Optics) -> list[Float]:
    """Weights (7,) of pixels along u and v that leave nothing of the LCD's pixels."""
    u, v = ((n - 1) / 2 for n in (rig.camera.columns, rig.camera.rows))
    at, along_u, along_v = optics.trace(np.array([u, u + 1, u]), np.array([v, v, v + 1]), optics.rest).q
    out = []
    for per_px in (along_u[0] - at[0], along_v[1] - at[1]):
        seen = abs(per_px - np.rint(per_px))
        shortest = np.sin(np.pi * (seen if seen > _SHORT_WAVES else 0.5))
        out.append(np.eye(7)[3] - _SINE_6 / shortest**6)
    return out


class Footprint:
    """A rig's footprint and blur on one lattice of pixels: divided out, or what both leave without noise.

    divide: whether they are divided out, as far as the rig states them.
    """

    def __init__(self, rig: Rig, optics: Optics, lattice: PixelLattice, divide: bool = True) -> None:
        rows, cols = lattice.grid.image_shape
        v, u = np.ogrid[lattice.box[0], lattice.box[1]]
        s, t = np.broadcast_arrays(2.0 * u / (cols - 1) - 1.0, 2.0 * v / (rows - 1) - 1.0)
        sharpening = 0.5 * (rig.camera.psf_px**2 + _PIXEL_PX2) if divide else 0.0
        sharper = [-sharpening, 1.0 + 2.0 * sharpening, -sharpening]
        self._kernels = [np.convolve(one, sharper) for one in _smoothing(rig, optics)]
        self._known = rig.camera.pupil_mm > 0.0
        self.divides = self._known and divide
        self._shape = lattice.shape
        if not self._known:
            return
        shift = np.einsum("rck,kij->rcij", quadratic_terms(s, t), footprint_terms(rig))
        across2, down2 = ((shift[..., i, :] ** 2).sum(axis=-1) for i in (0, 1))
        size2 = across2 + down2
        least, step = float(size2.min()), max(float(np.ptp(size2)) / (_SIZES - 1), 1e-6)
        self._place = ((size2 - least) / step).astype(np.float32)
        self._sizes: list[tuple[float, float]] = []
        for k in range(_SIZES):
            # the level's own shape; that of all where none is so large
            near = self._share(k).astype(np.float64) + 1e-6
            of_size = (least + k * step) / float((near * size2).sum())
            across, down = (float(np.sqrt(of_size * (near * one).sum())) for one in (across2, down2))
            self._sizes.append((across, down))
        self._fast = tuple(next_fast_len(n, real=True) for n in lattice.shape)
        fast_down, fast_across = (np.pi * np.arange(n) / n for n in self._fast)
        self._gains = [self._gain(*one, fast_across, fast_down).astype(np.float32) for one in self._sizes]

    def _share(self, size: int) -> Single:
        """Weight (rows, cols) of a size of the footprint: exact to second order in the wave number."""
        share: Single = np.maximum(np.float32(1.0) - np.abs(self._place - np.float32(size)), np.float32(0.0))
        return share

    def gains(self) -> Iterator[tuple[Single | float, Float]]:
        """(rows, cols) by which the cosines' noise is multiplied, and the share of each in every pixel."""
        k_down, k_across = (np.pi * np.arange(n) / n for n in self._shape)
        reach = np.arange(len(self._kernels[0])) - len(self._kernels[0]) // 2
        both = zip((k_down, k_across), self._kernels[::-1], strict=True)
        gain: Float = np.outer(*(np.cos(np.outer(k, reach)) @ kernel for k, kernel in both))
        if not self._known:
            yield 1.0, gain
            return
        for k, one in enumerate(self._sizes):
            yield self._share(k), gain * self._gain(*one, k_across, k_down)

    def _gain(self, across: float, down: float, k_across: Float, k_down: Float) -> Float:
        """G, or F G, (rows, cols) of the cosines for a footprint of these half widths, px."""
        radius = np.hypot(across * k_across, (down * k_down)[:, None])
        return regularised_inverse(radius) * (1.0 if self.divides else response(radius))

    def without_grid(self, d: Single, usable: Mask) -> Single:
        """Displacement (rows, cols, 2), px, without the LCD's pixels, and the lens's and the camera's blur.

        It stays next to pixels that are not usable, where it is 0 from then on.
        """
        d[~usable] = 0.0
        kernels, around = self._kernels, np.ones((len(self._kernels[0]),) * 2, np.uint8)
        smooth = cv2.sepFilter2D(d, -1, kernels[0], kernels[1], borderType=cv2.BORDER_REFLECT_101)
        out: Single = np.asarray(smooth, np.float32)
        if not usable.all():
            beside = cv2.erode(usable.view(np.uint8), around) == 0
            out[beside] = d[beside]
        return out

    def applied(self, depth_mm: Single) -> Single:
        """Depth (rows, cols), finite, divided by the footprint, or without what it does not show."""
        if not self._known:
            return depth_mm
        rows, cols = depth_mm.shape
        more = self._fast[0] - rows, self._fast[1] - cols
        # mirrored at the border, as the transform itself has it
        whole = cv2.copyMakeBorder(depth_mm, 0, more[0], 0, more[1], borderType=cv2.BORDER_REFLECT)
        waves = dctn(np.asarray(whole), norm="ortho", overwrite_x=True)
        out = np.zeros((rows, cols), np.float32)
        for k, gain in enumerate(self._gains):
            out += self._share(k) * idctn(waves * gain, norm="ortho", overwrite_x=True)[:rows, :cols]
        return out
