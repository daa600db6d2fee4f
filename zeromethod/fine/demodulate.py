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
from zeromethod.rig.model import Noise

UNKNOWNS = 5
END_FRAMES = 4
"""Frames at either end whose misfit is told apart: what changed next to them hardly shows in that of all."""
BAND_ROWS = 32
"""Rows whose frames are brought together at a time: what they take stays in the processor's cache."""
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


@numba.njit(cache=True, inline="always")
def _quadratic(matrix: Float, values: Single, i: int) -> float:
    total = 0.0
    for a in range(5):
        part = 0.0
        for b in range(5):
            part += matrix[a, b] * values[b, i]
        total += part * values[a, i]
    return total


@numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
def _fit(
    images: Image,
    solution: Single,
    covariance: Float,
    normal: Float,
    basis: Float,
    table: Float,
    per_rad: float,
    noise: tuple[float, float, float],
    level: float,
    corner: tuple[int, int],
    d: Single,
    variance: Single,
    modulation: Single,
    mean: Single,
    misfit: Single,
    ends: Single,
) -> None:
    count, (rows, cols) = images.shape[0], mean.shape
    period, (top, left) = table.shape[0], corner
    still, per_grey, black = noise
    sums, squares = np.empty((5, cols), np.float32), np.empty(cols, np.float32)
    zero = np.float32(level)
    few = min(END_FRAMES, count)
    ranges = ((0, few), (count - few, count), (count - 1, count))
    for j in range(rows):
        row = top + j
        sums[:] = np.float32(0.0)
        squares[:] = np.float32(0.0)
        for t in range(count):
            line = images[t, j]
            w0, w1, w2 = solution[row, 0, t], solution[row, 1, t], solution[row, 2, t]
            w3, w4 = solution[row, 3, t], solution[row, 4, t]
            for i in range(cols):
                grey = np.float32(line[i]) - zero
                sums[0, i] += w0 * grey
                sums[1, i] += w1 * grey
                sums[2, i] += w2 * grey
                sums[3, i] += w3 * grey
                sums[4, i] += w4 * grey
                squares[i] += grey * grey
        for i in range(cols):
            misfit[j, i] = (squares[i] - _quadratic(normal[row], sums, i)) / (count - 5)
        for end in range(3):
            squares[:] = np.float32(0.0)
            free = 0.0
            for t in range(*ranges[end]):
                line, w = images[t, j], basis[row, t].astype(np.float32)
                free += 1.0
                for a in range(5):
                    for b in range(5):
                        free -= basis[row, t, a] * covariance[row, a, b] * basis[row, t, b]
                for i in range(cols):
                    off = np.float32(line[i]) - zero - w[0] * sums[0, i] - w[1] * sums[1, i]
                    off -= w[2] * sums[2, i] + w[3] * sums[3, i] + w[4] * sums[4, i]
                    squares[i] += off * off
            for i in range(cols):
                ends[j, i, end] = squares[i] / free
        for i in range(cols):
            mean[j, i] = sums[0, i] + zero
            grey2 = still + per_grey * max(mean[j, i] - black, 0.0)
            for axis in range(2):
                at = (row if axis else left + i) % period
                c, s = sums[1 + 2 * axis, i], sums[2 + 2 * axis, i]
                re, im = c * table[at, 0] + s * table[at, 1], s * table[at, 0] - c * table[at, 1]
                length2 = c * c + s * s
                m = 1 + 2 * axis
                across = s * s * covariance[row, m, m] + c * c * covariance[row, m + 1, m + 1]
                across -= 2.0 * s * c * covariance[row, m, m + 1]
                d[j, i, axis] = per_rad * math.atan2(im, re)
                variance[j, i, axis] = grey2 * per_rad * per_rad * across / (length2 * length2)
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
    turns = 2 * np.pi * np.arange(period_px) / period_px
    table = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    per_grey = 0.0 if noise.electrons_per_grey is None else 1.0 / noise.electrons_per_grey
    scales = noise.read_grey**2 + 1 / 12, per_grey, noise.black_grey
    d, variance, modulation = (np.empty((*shape, 2), np.float32) for _ in range(3))
    mean, misfit, ends = (np.empty((*shape, *more), np.float32) for more in ((), (), (3,)))
    out = Demodulated(d, variance, modulation, mean, misfit, ends)
    normal = np.swapaxes(design.basis, 1, 2) @ design.basis
    solution, per_rad, level = (
        design.solution.astype(np.float32),
        period_px / (2 * np.pi),
        middle_grey(images),
    )
    top, left = box[0].start or 0, box[1].start or 0
    for first in range(0, shape[0], BAND_ROWS):
        part = slice(first, min(first + BAND_ROWS, shape[0]))
        band = np.stack([one[top + part.start : top + part.stop, box[1]] for one in images])
        all_of = out.d, out.variance, out.modulation, out.mean, out.misfit, out.ends
        fields, corner = (one[part] for one in all_of), (top + first, left)
        fit = solution, design.covariance, normal, design.basis
        _fit(band, *fit, table, per_rad, scales, level, corner, *fields)
    return out


def middle_grey(images: Sequence[Image]) -> float:
    """Mean grey level of some pixels of all frames."""
    return float(np.mean([one[::64, ::64].mean() for one in images]))


def grey_variance(noise: Noise, grey: Single) -> Single:
    """Variance of a camera's grey levels where their mean is `grey`, of the same shape; grey^2."""
    per_grey = 0.0 if noise.electrons_per_grey is None else 1.0 / noise.electrons_per_grey
    light = np.maximum(grey - np.float32(noise.black_grey), np.float32(0.0))
    return np.asarray(noise.read_grey**2 + 1 / 12 + per_grey * light, np.float32)


@numba.njit(cache=True)
def _usable(
    d: Single,
    variance: Single,
    modulation: Single,
    mean: Single,
    ceiling: float,
    visibility: float,
    variance_px2: float,
    seen: Mask,
) -> None:
    rows, cols = mean.shape
    for j in range(rows):
        for i in range(cols):
            weakest = min(modulation[j, i, 0], modulation[j, i, 1])
            good = weakest > visibility * mean[j, i]
            good &= max(variance[j, i, 0], variance[j, i, 1]) < variance_px2
            seen[j, i] = good and mean[j, i] + modulation[j, i, 0] + modulation[j, i, 1] < ceiling
    for j in range(rows):
        for i in range(cols):
            for k in range(2):
                if i + 1 < cols and abs(d[j, i + 1, k] - d[j, i, k]) > _TORN_PX:
                    seen[j, i] = seen[j, i + 1] = False
                if j + 1 < rows and abs(d[j + 1, i, k] - d[j, i, k]) > _TORN_PX:
                    seen[j, i] = seen[j + 1, i] = False


def usable_pixels(found: Demodulated, ceiling: int, least_visibility: float, most_sigma_px: float) -> Mask:
    """(rows, cols) pixels whose carriers are seen well enough, and no whole period off their neighbours.

    Pixels that are overexposed in a frame do not count either.
    """
    seen = np.empty(found.mean.shape, np.bool_)
    fields = found.d, found.variance, found.modulation, found.mean
    _usable(*fields, float(ceiling), least_visibility, most_sigma_px**2, seen)
    return seen


def stood(found: Demodulated) -> Mask:
    """(rows, cols) pixels whose grey levels scatter about the fit as noise does: nothing moved there.

    Noise is what scatters in the middle of the view's pixels.
    """
    size = _POOLED_PX, _POOLED_PX
    pooled = np.asarray(cv2.boxFilter(found.misfit, -1, size, borderType=cv2.BORDER_REFLECT))
    return np.asarray(pooled < _MOVED_MISFIT * float(np.median(pooled[::8, ::8])))
