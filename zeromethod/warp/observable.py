"""Observable part of a displacement: a low-pass filter that removes modes which the sensor cannot observe.

The residual is measured through the window box_P * box_P, whose response on nodes half a period
apart is W(f) = sinc(2 f)^2 per axis (f in cycles per node): 0.5 at f = 0.22, 0.15 at 0.34, 0.1 at 0.37, 0 at
the Nyquist frequency 0.5. A mode with W near 0 is measured as whatever was shown and would random-walk
in the commanded warp.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.rounding import REORDERED

HALF_WIDTH = 8
PASS_TO = 0.225
STOP_FROM = 0.37


def _design() -> Float:
    """(HALF_WIDTH + 1,) taps h_0, h_1, ...; H(f) = h_0 + 2 sum h_k cos(2 pi f k).

    Weighted least squares over pass and stop band under the equalities H(0) = 1, H''(0) = 0 (so cubics
    pass unchanged), H(1/2) = 0.
    """
    order = np.arange(HALF_WIDTH + 1)
    multiplicity = np.where(order == 0, 1.0, 2.0)

    def rows(f: Float) -> Float:
        return multiplicity * np.cos(2 * np.pi * np.outer(f, order))

    low = np.linspace(0.0, PASS_TO, 200)
    high = np.linspace(STOP_FROM, 0.5, 200)
    weight = np.concatenate([np.full(low.size, 30.0), np.full(high.size, 1.0)])[:, None]
    A = weight * np.concatenate([rows(low), rows(high)])
    b = weight[:, 0] * np.concatenate([np.ones(low.size), np.zeros(high.size)])
    C = np.stack([multiplicity, multiplicity * order**2, multiplicity * (-1.0) ** order])
    system = np.block([[A.T @ A, C.T], [C, np.zeros((3, 3))]])
    taps = np.linalg.solve(system, np.concatenate([A.T @ b, [1.0, 0.0, 0.0]]))[: HALF_WIDTH + 1]
    taps[0] = 1.0 - 2.0 * math.fsum(taps[1:])
    return taps


TAPS = _design()


def gain(f_cycles_per_node: float | Float) -> Float:
    """Gain of the filter along one axis; the filter's gain is the product over both axes."""
    k = np.arange(1, HALF_WIDTH + 1)
    f = np.asarray(f_cycles_per_node, dtype=np.float64)
    return np.asarray(TAPS[0] + 2.0 * np.cos(2 * np.pi * f[..., None] * k) @ TAPS[1:])


@numba.njit(cache=True, fastmath=REORDERED)
def _filter_line(flat: Float, middle: int, step: int, out: Float) -> None:
    """Filter into `out` (n,) the entries of `flat` from `middle` on, neighbours `step` apart.

    One tap after the other, so that the compiler vectorises the line.
    """
    n = out.size
    line = flat[middle : middle + n]
    for i in range(n):
        out[i] = TAPS[0] * line[i]
    for k in range(1, HALF_WIDTH + 1):
        before, after = flat[middle - k * step :][:n], flat[middle + k * step :][:n]
        for i in range(n):
            out[i] += TAPS[k] * (before[i] + after[i])


@numba.njit(cache=True)
def _reflect(flat: Float, first: int, last: int, step: int) -> None:
    """Continue lines `step` apart beyond `first` and `last` by point reflection: straight stays straight."""
    for k in range(step, (HALF_WIDTH + 1) * step, step):
        for i in range(step):
            flat[first - k + i] = 2.0 * flat[first + i] - flat[first + k + i]
            flat[last + k + i] = 2.0 * flat[last + i] - flat[last - k + i]


@numba.njit(cache=True)
def _filter(field: Float, out: Float) -> None:
    rows, cols, step = field.shape  # a 2 would be compiled as a case of its own
    width, start = 2 * cols, 2 * HALF_WIDTH
    padded = np.empty((rows + 2 * HALF_WIDTH) * width)
    line = np.empty(width + 2 * start)
    flat, filtered = field.reshape(rows * width), out.reshape(rows * width)
    top = HALF_WIDTH * width
    for j in range(rows):
        for i in range(width):
            line[start + i] = flat[j * width + i]
        _reflect(line, start, start + width - 2, step)
        _filter_line(line, start, step, padded[top + j * width :][:width])
    _reflect(padded, top, top + (rows - 1) * width, width)
    for j in range(rows):
        _filter_line(padded, top + j * width, width, filtered[j * width :][:width])


def observable_part(displacement: Float, out: Float | None = None) -> Float:
    """Displacement without the node modes that the residual cannot observe.

    displacement: (rows, cols, 2) float64, C-contiguous, any unit, finite, at least 9 nodes per axis:
    q - q_rest, never q itself (rest must not be filtered). `out` may be `displacement`.

    A separable symmetric FIR of 17 taps. Its gain per axis is 1 within 1e-3 where the window passes more
    than half (f <= 0.22), 0.8 at f = 0.28, below 0.05 where the window passes less than a tenth
    (f >= 0.37) and 0 at Nyquist; so an unobservable mode along an axis is gone in one frame, one along
    the diagonal (W = 0.1 at 0.28, 0.28) keeps 0.7 per frame and cannot random-walk either. Fewer taps do not
    suffice: 13 leave 2e-3 and 0.17. Gain 1 at f = 0 to rounding, and cubic polynomials pass
    unchanged, so no depth leaks. At the grid's edge the field is continued by point
    reflection: planes stay exact there, an edge node keeps its value along that axis.
    """
    if out is None:
        out = np.empty_like(displacement)
    _filter(displacement, out)
    return out
