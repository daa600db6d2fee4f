"""Integration on every pixel: conjugate gradients, preconditioned by a direct solution.

Minimises sum w (e_b - e_a - m)^2 over the steps between neighbouring pixels, as `surface.integrate` does
between nodes. With weights that vary along one axis alone, as the lever's do by two orders of magnitude, the
cosine transform along the other leaves one tridiagonal system for each of its waves; holes and what else is
uneven takes some iterations more. (Multigrid needs seconds to set up at a million pixels, factors more memory
than a computer has to spare.)
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
from scipy.fft import dct, idct, next_fast_len

from zeromethod.arrays import Float, Mask, Single
from zeromethod.errors import MeasurementError
from zeromethod.kernels import kernel, read
from zeromethod.rounding import REORDERED

ENOUGH = 1e-5
"""Residual over that of no solution, preconditioned, at which it is solved: errors of depth are below it."""
_MOST_ITERATIONS = 200
"""Iterations after which it is given up: whole views take 5 to 10, holes and uneven weights up to 50."""

Part = tuple[slice, slice]
_ALONG: tuple[tuple[Part, Part], ...] = ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :]))
"""Pixels that steps across and down lead from, and to."""


@kernel(
    read(numba.float32, 2),
    read(numba.float32, 2),
    read(numba.float32, 2),
    numba.float32[:, ::1],
    fastmath=REORDERED,
)
def _apply(x: Single, across: Single, down: Single, out: Single) -> float:
    """Laplacian of the weighted steps, out = L x, and x . L x."""
    rows, cols = x.shape
    total = 0.0
    for i in range(rows):
        for j in range(cols):
            out[i, j] = 0.0
    for i in range(rows):
        energy = 0.0
        for j in range(cols - 1):
            step = x[i, j + 1] - x[i, j]
            flow = across[i, j] * step
            energy += flow * step
            out[i, j + 1] += flow
            out[i, j] -= flow
        if i + 1 < rows:
            for j in range(cols):
                step = x[i + 1, j] - x[i, j]
                flow = down[i, j] * step
                energy += flow * step
                out[i + 1, j] += flow
                out[i, j] -= flow
        total += energy
    return total


def sources(steps: tuple[Single, Single], weights: tuple[Single, Single]) -> Single:
    """(rows, cols) weighted steps leading to each pixel less those away; across (rows, cols-1), and down."""
    out = np.zeros((len(steps[0]), steps[1].shape[1]), np.float32)
    for step, weight, (one, other) in zip(steps, weights, _ALONG, strict=True):
        # what has no weight may be NaN, as beyond the mirror's edge
        flow = np.where(weight > 0.0, weight * step, np.float32(0.0))
        out[other] += flow
        out[one] -= flow
    return out


def eigenvalues(shape: tuple[int, ...], across: float, down: float) -> Float:
    """Of the Laplacian with these weights of all steps, by the wave numbers of the cosine transform."""
    rows, cols = (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in shape)
    return np.asarray(down * rows[:, None] + across * cols)


def largest_part(valid: Mask) -> Mask:
    """Largest set of valid pixels connected along rows and columns."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(valid.view(np.uint8), connectivity=4)
    if count <= 2:
        return valid.copy()
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def _pivots(across: Float, down: Float, waves: Float) -> Single:
    """1 over the pivots of each wave's tridiagonal system, (waves, cols); 0 where it leaves a constant open.

    across (cols - 1,), down (cols,): weights. waves: eigenvalues of the steps down.
    """
    around = np.pad(across, 1)
    inverse, last = np.empty((len(down), len(waves)), np.float32), np.zeros(len(waves))
    for i, own in enumerate(down):
        pivot = around[i] + around[i + 1] + waves * own - around[i] ** 2 * last
        last = 1.0 / pivot if i < len(down) - 1 else np.divide(1.0, pivot, where=waves > 0.0, out=0.0 * waves)
        inverse[i] = last
    return np.ascontiguousarray(inverse.T)


@kernel(numba.float32[:, ::1], read(numba.float64, 1), read(numba.float32, 2), fastmath={"contract"})
def _eliminate(waves: Single, across: Float, inverse: Single) -> None:
    """Solve the systems of `_pivots` for each wave's right side (waves, cols), in place."""
    cols = waves.shape[1]
    line = np.empty(cols)
    for k in range(waves.shape[0]):
        line[0] = waves[k, 0]
        for i in range(1, cols):
            line[i] = waves[k, i] + across[i - 1] * inverse[k, i - 1] * line[i - 1]
        value = line[cols - 1] * inverse[k, cols - 1]
        waves[k, cols - 1] = value
        for i in range(cols - 2, -1, -1):
            value = (line[i] + across[i] * value) * inverse[k, i]
            waves[k, i] = value


class PixelIntegrator:
    """Integrator of steps on one lattice of pixels; starts from the last solution."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self.iterations = 0
        """Of the last solution."""

    def solve(self, left: Single, weights: tuple[Single, Single], x: Single) -> None:
        """Make x (rows, cols), where to begin, what makes the steps of these sources, up to a constant.

        left: of `sources`, used up. weights: (rows, cols-1) across and (rows-1, cols) down; steps of weight 0
        count nothing. Pixels without steps get what the smooth continuation gives.

        Raises MeasurementError where the residual does not become small enough; x is of no use then.
        """
        across, down = weights
        nearly = _Nearly(across, down)
        product = np.empty(self._shape, np.float32)
        enough = ENOUGH**2 * _dot(left, nearly.solved(left))
        _apply(x, across, down, product)
        left -= product
        guess = nearly.solved(left)
        size = _dot(left, guess)
        way = guess.copy()
        self.iterations = 0
        while size > enough and self.iterations < _MOST_ITERATIONS:
            energy = _apply(way, across, down, product)
            if not energy > 0.0:
                break
            by = np.float32(size / energy)
            x += by * way
            product *= by
            left -= product
            guess = nearly.solved(left)
            before, size = size, _dot(left, guess)
            way *= np.float32(size / before)
            way += guess
            self.iterations += 1
        if not size <= enough:  # nor where it is NaN
            raise MeasurementError(f"depth of every pixel: not solved in {self.iterations} iterations")


class _Nearly:
    """Direct solution with the weights' means along the axis along which they vary less."""

    def __init__(self, across: Single, down: Single) -> None:
        along_rows = _profile(across, 0), _profile(down, 0)
        along_cols = _profile(down, 1), _profile(across, 1)
        self._turned = bool(np.ptp(np.log(along_cols[1])) > np.ptp(np.log(along_rows[1])))
        self._across, own = along_cols if self._turned else along_rows
        self._count = across.shape[0] if not self._turned else down.shape[1]
        # a transform of 1249 pixels takes five times as long as one of 1250
        fast = next_fast_len(self._count, real=True)
        waves = 2.0 - 2.0 * np.cos(np.pi * np.arange(fast) / fast)
        self._inverse = _pivots(self._across, own, waves)
        self._whole = np.empty_like(self._inverse)

    def solved(self, left: Single) -> Single:
        """(rows, cols) for a right side (rows, cols)."""
        whole = self._whole
        whole[: self._count] = left.T if self._turned else left
        whole[self._count :] = np.float32(0.0)
        waves = dct(whole, axis=0, norm="ortho", overwrite_x=True)
        _eliminate(waves, self._across, self._inverse)
        found = np.asarray(idct(waves, axis=0, norm="ortho", overwrite_x=True))[: self._count]
        return np.ascontiguousarray(found.T) if self._turned else found


def _profile(weights: Single, axis: int) -> Float:
    """Mean of those weights along an axis that count; where none does, that between the next that do."""
    count = np.count_nonzero(weights, axis=axis)
    total = weights.sum(axis=axis, dtype=np.float64)
    known = count > 0
    if not known.any():
        return np.ones(len(count))
    at = np.arange(len(count))
    return np.asarray(np.interp(at, at[known], total[known] / count[known]))


def _dot(one: Single, other: Single) -> float:
    return float(np.vdot(one, other))


def gradient(depth_mm: Single, x: Single, y: Single) -> Single:
    """Slope (2, rows, cols) of a depth at points x, y, (rows, cols) each."""
    padded = [np.pad(part, 1, mode="edge") for part in (x, y, depth_mm)]
    xu, yu, zu = (part[1:-1, 2:] - part[1:-1, :-2] for part in padded)
    xv, yv, zv = (part[2:, 1:-1] - part[:-2, 1:-1] for part in padded)
    area = xu * yv - xv * yu
    return np.stack([(yv * zu - yu * zv) / area, (xu * zv - xv * zu) / area])


def step_weights(
    slope2: Single, x_mm: Single, y_mm: Single, scale: Single, valid: Mask
) -> tuple[Single, Single]:
    """Weights (rows, cols-1), (rows-1, cols) of steps of depth over the scale, by their noise, of mean 1.

    0 at invalid pixels. slope2: (2, rows, cols) variance of the slope, rad^2. scale: h (rows, cols).
    """
    across, down = (_weights(slope2, x_mm, y_mm, scale, valid, one, other) for one, other in _ALONG)
    total = 0.5 * float(across.mean(dtype=np.float64) + down.mean(dtype=np.float64))
    per = np.float32(1.0 / max(total, 1e-30))
    across *= per
    down *= per
    return across, down


def _weights(
    slope2: Single, x: Single, y: Single, scale: Single, valid: Mask, one: Part, other: Part
) -> Single:
    """h^2 over the variance of steps from one part of the pixels to the other; 0 at invalid pixels."""
    x2, y2 = slope2[:, *one] + slope2[:, *other]
    noise2 = np.float32(0.5) * (x2 * (x[other] - x[one]) ** 2 + y2 * (y[other] - y[one]) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = scale[one] * scale[other] / noise2
    return np.where(valid[one] & valid[other], weight, np.float32(0.0))


def take_out(level_mm: Single, scale: Single, across: Single, down: Single) -> None:
    """Make steps of depth those of what it has beyond a level, over the scale h; in place."""
    for steps, (one, other) in zip((across, down), _ALONG, strict=True):
        steps[:] = (steps - (level_mm[other] - level_mm[one])) / np.sqrt(scale[one] * scale[other])
