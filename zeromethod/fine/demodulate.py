"""Demodulation in time: each pixel's displacement along u and v from its grey levels in N frames.

A pixel sees, in frame t of known phases (p, q) and contrasts (a, b),

    g_t = mean + Re[Cu a_t exp(i p_t)] + Re[Cv b_t exp(i q_t)],

five unknowns that least squares finds from five frames or more. arg Cu = k (u + d_u), where the pixel looks
on the target: d is the pixel's own displacement against what was shown, without a window in space. Phases
depend on frame and row alone, so one matrix serves a whole row. The variance of d is that of the fit: phases
that hardly distinguish the unknowns (frames around the turn of a to and fro) show there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numba
import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.errors import InputError
from zeromethod.fine.frames import Steps
from zeromethod.fine.lattice import BAND_ROWS
from zeromethod.kernels import kernel, piece, read
from zeromethod.rig.model import Noise

UNKNOWNS = 5
END_FRAMES = 4
"""Frames at either end whose misfit is told apart: what changed next to them hardly shows in that of all."""
_TORN_PX = 6.0
"""Step of displacement between neighbouring pixels, camera px, above which one is a whole period off."""
_POOLED_PX = 5
_MOVED_MISFIT = 1.6
"""Misfit over its median from which frames disagree; chance makes 1.3 of 25 pixels in 24 frames."""
_WORST_GAIN = 1000.0
"""Largest noise gain of a row's fit over that of ideal phases at which it counts as solvable."""


@dataclass(frozen=True, slots=True)
class Design:
    """The fit of N frames, for every image row.

    basis: (rows, N, 5), from unknowns to grey levels. solution: (rows, 5, N), back. covariance: (rows, 5, 5)
    of the unknowns at unit noise. weights: (2, N) of the frames' displacements in the fit's, along u and v,
    in the mean over rows; each adds up to 1.
    """

    basis: Float
    solution: Float
    covariance: Float
    weights: Float

    @classmethod
    def of(cls, steps: Sequence[Steps], late_s: Float | None = None) -> Design:
        """Of the frames' phases; late_s: (N, rows) by which each frame's pictures came late.

        Raises InputError where the phases do not determine the five unknowns.
        """
        late = np.zeros((len(steps), 1)) if late_s is None else late_s
        phases = (s.phase_rad + x[:, None] * s.per_late_rad for s, x in zip(steps, late, strict=True))
        phase = np.stack(list(phases), axis=1)
        wave = np.stack([s.contrast for s in steps], axis=1) * np.exp(1j * phase)
        one = np.ones(phase.shape[:2])
        u, v = wave[..., 0], wave[..., 1]
        basis = np.stack([one, u.real, -u.imag, v.real, -v.imag], axis=-1)
        normal = np.swapaxes(basis, 1, 2) @ basis
        if len(steps) < UNKNOWNS or np.linalg.cond(normal).max() > _WORST_GAIN**2:
            raise InputError(f"target.step: the phases of {len(steps)} frames do not determine every pixel")
        covariance = np.linalg.inv(normal)
        solution = covariance @ np.swapaxes(basis, 1, 2)
        pairs = solution[:, 1::2] + 1j * solution[:, 2::2]
        weights = 0.5 * np.real(pairs * np.swapaxes(wave, 1, 2)).mean(axis=0)
        return cls(basis, solution, covariance, weights)


@dataclass(frozen=True, slots=True)
class Demodulated:
    """Every pixel's displacement against the target as shown, (rows, cols) each, last axis along u, v.

    d: (rows, cols, 2) camera px, within half a period. variance: (rows, cols, 2) px^2. modulation:
    (rows, cols, 2) amplitude of the carriers, grey levels. mean: (rows, cols) grey level. misfit: (rows,
    cols) variance of the grey levels about the fit, grey^2: noise alone where nothing moved. ends: (rows,
    cols, 3) the same by the oldest `END_FRAMES`, by as many of the newest, and by the newest one alone.
    """

    d: Single
    variance: Single
    modulation: Single
    mean: Single
    misfit: Single
    ends: Single


@piece(inline="always")
def _quadratic(matrix: Float, values: Single, i: int) -> float:
    total = 0.0
    for a in range(5):
        part = 0.0
        for b in range(5):
            part += matrix[a, b] * values[b, i]
        total += part * values[a, i]
    return total


@kernel(
    read(numba.float32, 3),
    numba.float32,
    read(numba.float32, 3),
    read(numba.float64, 3),
    read(numba.float64, 3),
    read(numba.float32, 3),
    read(numba.float32, 2),
    read(numba.float64, 2),
    read(numba.float64, 2),
    numba.float64,
    numba.float32[:, ::1],
    numba.float32[:, :, ::1],
    numba.float32[:, :, ::1],
    numba.float32[:, :, ::1],
    numba.float32[:, ::1],
    numba.float32[:, ::1],
    numba.float32[:, :, ::1],
    fastmath={"contract"},
)
def _fit(
    images: Single,
    level: float,
    solution: Single,
    covariance: Float,
    normal: Float,
    basis: Single,
    free: Single,
    u: Float,
    v: Float,
    per_rad: float,
    sums: Single,
    d: Single,
    variance: Single,
    modulation: Single,
    mean: Single,
    misfit: Single,
    ends: Single,
) -> None:
    """Fields of `Demodulated` in rows of N frames, the variance at unit noise.

    level: about that of the images, which rounding is the smaller for. solution, covariance, normal, basis:
    of `Design`. free: (rows, 3) degrees of freedom of the ends. u: (cols, 2), v: (rows, 2) cosine and sine of
    the carriers without displacement. sums: (6, cols), for use within.
    """
    count, rows, cols = images.shape
    few = min(END_FRAMES, count)
    for j in range(rows):
        sums[:] = 0.0
        for t in range(count):
            line = images[t, j]
            w0, w1, w2 = solution[j, 0, t], solution[j, 1, t], solution[j, 2, t]
            w3, w4 = solution[j, 3, t], solution[j, 4, t]
            for i in range(cols):
                grey = line[i] - level
                sums[0, i] += w0 * grey
                sums[1, i] += w1 * grey
                sums[2, i] += w2 * grey
                sums[3, i] += w3 * grey
                sums[4, i] += w4 * grey
                sums[5, i] += grey * grey
        for i in range(cols):
            misfit[j, i] = (sums[5, i] - _quadratic(normal[j], sums, i)) / (count - 5)
            mean[j, i] = sums[0, i] + level
        for end in range(3):
            first, last = 0, few
            if end > 0:
                first, last = (count - few if end == 1 else count - 1), count
            sums[5] = 0.0
            for t in range(first, last):
                line = images[t, j]
                w0, w1, w2 = basis[j, t, 0], basis[j, t, 1], basis[j, t, 2]
                w3, w4 = basis[j, t, 3], basis[j, t, 4]
                for i in range(cols):
                    off = line[i] - level - w0 * sums[0, i] - w1 * sums[1, i]
                    off -= w2 * sums[2, i] + w3 * sums[3, i] + w4 * sums[4, i]
                    sums[5, i] += off * off
            for i in range(cols):
                ends[j, i, end] = sums[5, i] / free[j, end]
        for i in range(cols):
            for axis in range(2):
                m = 1 + 2 * axis
                c, s = sums[m, i], sums[m + 1, i]
                along, across = (v[j, 0], v[j, 1]) if axis else (u[i, 0], u[i, 1])
                length2 = c * c + s * s
                turned2 = s * s * covariance[j, m, m] + c * c * covariance[j, m + 1, m + 1]
                turned2 -= 2.0 * s * c * covariance[j, m, m + 1]
                d[j, i, axis] = per_rad * math.atan2(s * along - c * across, c * along + s * across)
                variance[j, i, axis] = per_rad * per_rad * turned2 / (length2 * length2)
                modulation[j, i, axis] = math.sqrt(length2)


def demodulate(
    images: Sequence[Image],
    design: Design,
    period_px: int,
    noise: Noise,
    box: tuple[slice, slice] = (slice(0, None), slice(0, None)),
) -> Demodulated:
    """Displacement of every pixel from N frames.

    Parameters
    ----------
    images : sequence of (rows, cols) uint8 or uint16
        Grey levels, oldest first.
    design : Design
        Of the same frames.
    period_px : int
        Of the target's carriers along u and v, camera px.
    noise : Noise
        Of the camera.
    box : (slice, slice)
        Rows and columns of the image to be read.

    Returns
    -------
    Demodulated
        Of the box.
        Convention: observed(u, v) = target((u, v) + d).
    """
    shape = images[0][box].shape
    d, variance, modulation = (np.empty((*shape, 2), np.float32) for _ in range(3))
    mean, misfit, ends = (np.empty((*shape, *more), np.float32) for more in ((), (), (3,)))
    level, per_rad = np.float32(middle_grey(images)), period_px / (2 * np.pi)
    top, left = box[0].start or 0, box[1].start or 0
    v, u = (
        np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        for turn in (np.arange(top, top + shape[0]) / per_rad, np.arange(left, left + shape[1]) / per_rad)
    )
    sums = np.empty((UNKNOWNS + 1, shape[1]), np.float32)
    for first in range(0, shape[0], BAND_ROWS):
        part = slice(first, min(first + BAND_ROWS, shape[0]))
        rows = slice(top + part.start, top + part.stop)
        band = np.stack([one[rows, box[1]] for one in images], dtype=np.float32, casting="unsafe")
        basis, covariance = design.basis[rows], design.covariance[rows]
        fit = design.solution[rows], covariance, np.swapaxes(basis, 1, 2) @ basis, basis
        fields = d[part], variance[part], modulation[part], mean[part], misfit[part], ends[part]
        _fit(band, level, *fit, _free(basis, covariance), u, v[part], per_rad, sums, *fields)
        grey2 = grey_variance(noise, mean[part])
        for axis in range(2):
            variance[part, :, axis] *= grey2
    return Demodulated(d, variance, modulation, mean, misfit, ends)


def _free(basis: Float, covariance: Float) -> Float:
    """(rows, 3) degrees of freedom of `Demodulated.ends`."""
    each = 1.0 - np.einsum("rta,rab,rtb->rt", basis, covariance, basis)
    ends = each[:, :END_FRAMES], each[:, -END_FRAMES:], each[:, -1:]
    return np.stack([one.sum(axis=1) for one in ends], axis=-1)


def middle_grey(images: Sequence[Image]) -> float:
    """Mean grey level of some pixels of all frames."""
    return float(np.mean([one[::64, ::64].mean() for one in images]))


def grey_variance(noise: Noise, grey: Single) -> Single:
    """Variance of a camera's grey levels where their mean is `grey`, of the same shape; grey^2."""
    per_grey = 0.0 if noise.electrons_per_grey is None else 1.0 / noise.electrons_per_grey
    light = np.maximum(grey - np.float32(noise.black_grey), np.float32(0.0))
    return np.asarray(noise.read_grey**2 + 1 / 12 + per_grey * light, np.float32)


def usable_pixels(found: Demodulated, ceiling: int, least_visibility: float, most_sigma_px: float) -> Mask:
    """(rows, cols) pixels whose carriers are seen well enough, and no whole period off their neighbours.

    Pixels that are overexposed in a frame do not count either.
    """
    amplitude, variance = (np.moveaxis(one, -1, 0) for one in (found.modulation, found.variance))
    seen = np.minimum(*amplitude) > least_visibility * found.mean
    seen &= np.maximum(*variance) < most_sigma_px**2
    seen &= found.mean + amplitude[0] + amplitude[1] < ceiling
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        step = np.abs(found.d[other] - found.d[one]) > _TORN_PX
        whole = ~(step[..., 0] | step[..., 1])
        seen[one] &= whole
        seen[other] &= whole
    return np.asarray(seen)


def stood(found: Demodulated) -> Mask:
    """(rows, cols) pixels whose grey levels scatter about the fit as noise does: nothing moved there.

    Noise is what scatters in the middle of the view's pixels.
    """
    size = _POOLED_PX, _POOLED_PX
    pooled = np.asarray(cv2.boxFilter(found.misfit, -1, size, borderType=cv2.BORDER_REFLECT))
    return np.asarray(pooled < _MOVED_MISFIT * float(np.median(pooled[::8, ::8])))
