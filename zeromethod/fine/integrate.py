"""Integration on every pixel: conjugate gradients, preconditioned by the cosine transform.

Minimises sum w (e_b - e_a - m)^2 over the steps between neighbouring pixels, as `surface.integrate` does
between nodes. With equal weights on a whole rectangle the cosine transform solves it at once; holes and
uneven weights take some iterations more. (Multigrid needs seconds to set up at a million pixels, factors more
memory than a computer has to spare.)
"""

from __future__ import annotations

from typing import Any

import cv2
import numba
import numpy as np
from scipy.fft import dctn, idctn, next_fast_len

from zeromethod.arrays import Mask, Single

ENOUGH = 1e-5
"""Residual over that of no solution, preconditioned, at which it is solved: errors of depth are below it."""
_MOST_ITERATIONS = 60
_EVENED_PX = 31
"""Pixels over which weights are averaged for the preconditioner."""


@numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _apply(x: Single, across: Single, down: Single, out: Single) -> float:
    """Laplacian of the weighted steps, out = L x, and x . L x."""
    rows, cols = x.shape
    total = 0.0
    for i in range(rows):
        out[i] = np.float32(0.0)
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


@numba.njit(cache=True, error_model="numpy")
def _divergence(across: Single, down: Single, of_across: Single, of_down: Single, out: Single) -> None:
    """Weighted steps (rows, cols-1), (rows-1, cols) that lead to each pixel less those that lead away."""
    rows, cols = out.shape
    for i in range(rows):
        out[i] = np.float32(0.0)
    for i in range(rows):
        for j in range(cols - 1):
            flow = of_across[i, j] * across[i, j]
            out[i, j + 1] += flow
            out[i, j] -= flow
        if i + 1 < rows:
            for j in range(cols):
                flow = of_down[i, j] * down[i, j]
                out[i + 1, j] += flow
                out[i, j] -= flow


def eigenvalues(shape: tuple[int, ...], across: float, down: float, kind: type = np.float64) -> Any:
    """Of the Laplacian with these weights of all steps, by the wave numbers of the cosine transform."""
    rows, cols = (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in shape)
    return (down * rows[:, None]).astype(kind) + (across * cols).astype(kind)


def largest_part(valid: Mask) -> Mask:
    """Largest set of valid pixels connected along rows and columns."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(valid.view(np.uint8), connectivity=4)
    if count <= 2:
        return valid.copy()
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


class PixelIntegrator:
    """Integrator of steps on one lattice of pixels; starts from the last solution."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        # a transform of 1249 pixels takes five times as long as one of 1250
        self._fast = tuple(next_fast_len(n, real=True) for n in shape)
        self.iterations = 0
        """Of the last solution."""

    def solve(self, steps: tuple[Single, Single], weights: tuple[Single, Single], start: Single) -> Single:
        """E (rows, cols), up to a constant, that makes these steps.

        steps, weights: (rows, cols-1) across and (rows-1, cols) down; steps of weight 0 count nothing. start:
        (rows, cols), where to begin. Pixels without steps get what the smooth continuation gives.
        """
        across, down = weights
        scale, ratio = _evened(across, down)
        inverse, (rows, cols) = eigenvalues(self._fast, 1.0, ratio, np.float32), self._shape
        inverse[0, 0] = np.inf
        np.reciprocal(inverse, out=inverse)
        whole = np.empty(self._fast, np.float32)
        right, x, product = np.empty(self._shape, np.float32), start.copy(), np.empty(self._shape, np.float32)
        _divergence(*steps, across, down, right)

        def conditioned(left: Single) -> Single:
            whole[rows:] = whole[:, cols:] = np.float32(0.0)
            np.multiply(left, scale, out=whole[:rows, :cols])
            waves = dctn(whole, norm="ortho", overwrite_x=True)
            waves *= inverse
            found = np.asarray(idctn(waves, norm="ortho", overwrite_x=True))[:rows, :cols]
            return found * scale

        enough = ENOUGH**2 * _dot(right, conditioned(right))
        _apply(x, across, down, product)
        left = right - product
        guess = conditioned(left)
        size = _dot(left, guess)
        way = guess.copy()
        self.iterations = 0
        while size > enough and self.iterations < _MOST_ITERATIONS:
            energy = _apply(way, across, down, product)
            if not energy > 0.0:
                break
            by = np.float32(size / energy)
            x += by * way
            left -= by * product
            guess = conditioned(left)
            before, size = size, _dot(left, guess)
            way *= np.float32(size / before)
            way += guess
            self.iterations += 1
        return x


def _evened(across: Single, down: Single) -> tuple[Single, float]:
    """Factor (rows, cols) that evens weights out from both sides, and the weight down over that across.

    Over the smooth mean of weights around: L is about S^-1 L' S^-1, L' with even ones.
    """
    rows, cols = across.shape[0], down.shape[1]
    total, known = np.zeros((rows, cols), np.float32), np.zeros((rows, cols), np.float32)
    total[:, :-1] = across
    known[:, :-1] = across > 0.0
    size = _EVENED_PX, _EVENED_PX
    sums = [np.asarray(cv2.boxFilter(one, -1, size, normalize=False)) for one in (total, known)]
    middle = float(total.sum() / max(known.sum(), 1.0))
    around = np.where(sums[1] > 0.5, sums[0] / np.maximum(sums[1], 0.5), middle)
    both = down[down > 0.0]
    ratio = float(both.mean()) / middle if both.size and middle > 0.0 else 1.0
    return (1.0 / np.sqrt(np.maximum(around, 1e-6 * middle))).astype(np.float32), ratio


def _dot(one: Single, other: Single) -> float:
    return float(np.vdot(one, other))


@numba.njit(cache=True)
def _gradient(z: Single, x: Single, y: Single, out: Single) -> None:
    rows, cols = z.shape
    for j in range(rows):
        above, below = max(j - 1, 0), min(j + 1, rows - 1)
        for i in range(cols):
            left, right = max(i - 1, 0), min(i + 1, cols - 1)
            xu, xv = x[j, right] - x[j, left], x[below, i] - x[above, i]
            yu, yv = y[j, right] - y[j, left], y[below, i] - y[above, i]
            du, dv = z[j, right] - z[j, left], z[below, i] - z[above, i]
            area = xu * yv - xv * yu
            out[0, j, i] = (yv * du - yu * dv) / area
            out[1, j, i] = (xu * dv - xv * du) / area


def gradient(depth_mm: Single, x: Single, y: Single) -> Single:
    """Slope (2, rows, cols) of a depth at points x, y, (rows, cols) each."""
    out = np.empty((2, *depth_mm.shape), np.float32)
    _gradient(depth_mm, x, y, out)
    return out


@numba.njit(cache=True, error_model="numpy")
def _weigh(slope2: Single, x: Single, y: Single, valid: Mask, across: Single, down: Single) -> None:
    for j in range(valid.shape[0]):
        for way, out in ((0, across), (1, down)):
            below = j + way
            if below == valid.shape[0]:
                continue
            for i in range(out.shape[1]):
                beyond = i + 1 - way
                dx, dy = x[below, beyond] - x[j, i], y[below, beyond] - y[j, i]
                x2, y2 = (
                    slope2[0, j, i] + slope2[0, below, beyond],
                    slope2[1, j, i] + slope2[1, below, beyond],
                )
                noise2 = np.float32(0.5) * (x2 * dx * dx + y2 * dy * dy)
                both = valid[j, i] and valid[below, beyond]
                out[j, i] = np.float32(1.0) / noise2 if both else np.float32(0.0)


def step_weights(slope2: Single, x_mm: Single, y_mm: Single, valid: Mask) -> tuple[Single, Single]:
    """Weights (rows, cols-1), (rows-1, cols) of the steps by their noise, of mean 1; 0 at invalid pixels.

    slope2: (2, rows, cols) variance of the slope, rad^2.
    """
    rows, cols = valid.shape
    across, down = np.empty((rows, cols - 1), np.float32), np.empty((rows - 1, cols), np.float32)
    _weigh(slope2, x_mm, y_mm, valid, across, down)
    total = 0.5 * float(across.mean(dtype=np.float64) + down.mean(dtype=np.float64))
    per = np.float32(1.0 / max(total, 1e-30))
    across *= per
    down *= per
    return across, down


@numba.njit(cache=True, error_model="numpy")
def take_out(level_mm: Single, scale: Single, across: Single, down: Single) -> None:
    """Make steps of depth those of what it has beyond a level, over the scale h; in place."""
    for j in range(level_mm.shape[0]):
        for way, out in ((0, across), (1, down)):
            below = j + way
            if below == level_mm.shape[0]:
                continue
            for i in range(out.shape[1]):
                beyond = i + 1 - way
                step = out[j, i] - (level_mm[below, beyond] - level_mm[j, i])
                out[j, i] = step / np.sqrt(scale[j, i] * scale[below, beyond])
