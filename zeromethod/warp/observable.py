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
from zeromethod.kernels import kernel, read
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


@kernel(read(numba.float64, 2), numba.int64, numba.float64[:, ::1], fastmath=REORDERED)
def _filter(lines: Float, step: int, out: Float) -> None:
    """Filter lines (n, m + 2 HALF_WIDTH step) whose neighbours are `step` apart into out (n, m)."""
    middle = HALF_WIDTH * step
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = TAPS[0] * lines[i, middle + j]
        for k in range(1, HALF_WIDTH + 1):
            before, after = lines[i, middle - k * step :], lines[i, middle + k * step :]
            for j in range(out.shape[1]):
                out[i, j] += TAPS[k] * (before[j] + after[j])


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
    rows, cols, n = *displacement.shape[:2], HALF_WIDTH
    lines = np.empty((rows, cols + 2 * n, 2))
    lines[:, n:-n] = displacement
    lines[:, :n] = 2.0 * lines[:, n : n + 1] - lines[:, 2 * n : n : -1]
    lines[:, -n:] = 2.0 * lines[:, -n - 1 : -n] - lines[:, -n - 2 : -2 * n - 2 : -1]
    once = np.empty((rows + 2 * n, 2 * cols))
    _filter(lines.reshape(rows, -1), 2, once[n:-n])
    once[:n] = 2.0 * once[n] - once[2 * n : n : -1]
    once[-n:] = 2.0 * once[-n - 1] - once[-n - 2 : -2 * n - 2 : -1]
    if out is None:
        out = np.empty_like(displacement)
    _filter(once.reshape(1, -1), 2 * cols, out.reshape(1, -1))
    return out
