"""The pupil's footprint on the mirror, and the lens's blur, divided out where the rig file states them.

A pixel sees the mean of the mirror over the footprint of the camera's pupil, an ellipse that varies slowly
over the view: in waves, depth is multiplied by F = 2 J1(r) / r, r = |M' k| (`optics.pupil`), which reaches 0.
It is divided by it as far as that does not multiply noise: by G = F / (F^2 + (c (1 - F))^2), which is 1 for
waves much longer than the footprint. The lens blurs what the shown picture leaves of the displacement, not
what it nulls, so that this is sharpened in the displacement itself.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.fft import dctn, idctn, next_fast_len
from scipy.special import j1

from zeromethod.arrays import Float, Mask, Single
from zeromethod.fine.lattice import PixelLattice
from zeromethod.optics.pupil import footprint_terms, quadratic_terms
from zeromethod.rig.model import Rig

NOISE_LIMIT = 0.15
"""C above: noise is multiplied by 1 / (2 c) = 3.3 at most."""
_PIXEL_PX2 = 1 / 12


def response(radius: Float) -> Float:
    """F of the module for r, 1 at 0."""
    r = np.maximum(radius, 1e-6)
    return np.asarray(2.0 * j1(r) / r)


def regularised_inverse(share: Float) -> Float:
    """G of the module for F."""
    return np.asarray(share / (share**2 + (NOISE_LIMIT * (1.0 - share)) ** 2))


class Footprint:
    """Division by a rig's footprint and blur on one lattice of pixels."""

    def __init__(self, rig: Rig, lattice: PixelLattice) -> None:
        rows, cols = lattice.grid.image_shape
        v, u = np.ogrid[lattice.box[0], lattice.box[1]]
        s, t = np.broadcast_arrays(2.0 * u / (cols - 1) - 1.0, 2.0 * v / (rows - 1) - 1.0)
        self._sharpening = 0.5 * (rig.camera.psf_px**2 + _PIXEL_PX2)
        self.divides = rig.camera.pupil_mm > 0.0
        self._shape, self._middle = lattice.shape, (0.0, 0.0)
        if not self.divides:
            return
        shift = np.einsum("rck,kij->rcij", quadratic_terms(s, t), footprint_terms(rig))
        across, down = (np.hypot(shift[..., i, 0], shift[..., i, 1]) for i in (0, 1))
        ends = [(float(one.min()), max(float(one.max()), float(one.min()) + 1e-6)) for one in (across, down)]
        self._parts: list[Single] = [
            ((one - low) / (high - low)).astype(np.float32)
            for one, (low, high) in zip((across, down), ends, strict=True)
        ]
        self._fast = tuple(next_fast_len(n, real=True) for n in lattice.shape)
        fast_down, fast_across = (np.pi * np.arange(n) / n for n in self._fast)
        self._inverses: list[tuple[int, int, Single]] = [
            (i, j, self._inverse(a, b, fast_across, fast_down).astype(np.float32))
            for i, a in enumerate(ends[0])
            for j, b in enumerate(ends[1])
        ]
        middle = tuple(n // 2 for n in lattice.shape)
        self._middle = float(across[middle]), float(down[middle])

    def gain(self) -> Float:
        """(rows, cols) by which the cosines' noise is multiplied, in the middle of the view."""
        k_down, k_across = (np.pi * np.arange(n) / n for n in self._shape)
        sharp = [1.0 + 2.0 * self._sharpening * (1.0 - np.cos(k)) for k in (k_down, k_across)]
        gain: Float = np.outer(*sharp)
        if self.divides:
            gain *= self._inverse(*self._middle, k_across, k_down)
        return gain

    def _inverse(self, across: float, down: float, k_across: Float, k_down: Float) -> Float:
        """G (rows, cols) of the cosines for a footprint of these half widths, px."""
        return regularised_inverse(response(np.hypot(across * k_across, (down * k_down)[:, None])))

    def sharpened(self, d: Single, usable: Mask) -> Single:
        """Displacement (rows, cols, 2), px, without the lens's and the pixel's blur.

        Where it is not usable it is 0 from then on.
        """
        kernel = np.array([-self._sharpening, 1.0 + 2.0 * self._sharpening, -self._sharpening])
        d[~usable] = 0.0
        return np.asarray(cv2.sepFilter2D(d, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT))

    def divided(self, depth_mm: Single) -> Single:
        """Depth (rows, cols), finite, divided by the footprint."""
        rows, cols = depth_mm.shape
        more = self._fast[0] - rows, self._fast[1] - cols
        # mirrored at the border, as the transform itself has it
        whole = cv2.copyMakeBorder(depth_mm, 0, more[0], 0, more[1], borderType=cv2.BORDER_REFLECT)
        waves = dctn(np.asarray(whole), norm="ortho", overwrite_x=True)
        out = np.zeros((rows, cols), np.float32)
        right, lower = self._parts
        for i, j, inverse in self._inverses:
            part = idctn(waves * inverse, norm="ortho", overwrite_x=True)[:rows, :cols]
            part *= right if i else 1.0 - right
            part *= lower if j else 1.0 - lower
            out += part
        return out
