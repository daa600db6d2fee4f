"""Slopes that pressures on contacts make all over the mirror, fast."""

from __future__ import annotations

import numba
import numpy as np
from numpy.polynomial import chebyshev

from zeromethod.arrays import Float
from zeromethod.contact.loads import SHAPES, Loads

_STANDING = ((1.2, 8), (2.5, 5), (5.0, 4))
"""Half diagonals of a contact beyond which few forces stand for those of all its cells, and how many along
each side; 1e-3 of the slope is lost where they begin, 1e-4 further away."""


def load_slopes(loads: Loads, at_mm: Float) -> Float:
    """Mean slope (n, 2, SHAPES) at points (n, 4, 2), mm, of a half-space, in 1 / (pi E*) of a newton.

    By each of a contact's pressures.
    """
    low, high = loads.cells.min(axis=0), loads.cells.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    cells, own2, forces, starts = [loads.cells], [loads.own2_mm2], [loads.forces], [0, len(loads.cells)]
    for _, count in _STANDING:
        points = chebyshev.chebpts1(count)
        inverse = np.linalg.inv(chebyshev.chebvander(points, count - 1))
        along, across = (
            chebyshev.chebvander((loads.cells[:, k] - middle[k]) / half[k], count - 1) @ inverse
            for k in (0, 1)
        )
        x, y = np.meshgrid(middle[0] + half[0] * points, middle[1] + half[1] * points)
        cells.append(np.stack([x.ravel(), y.ravel()], axis=-1))
        own2.append(np.zeros(count**2))
        by_row = loads.forces[:, None, :] * across.T
        forces.append(np.einsum("sbc,ca->sba", by_row, along).reshape(SHAPES, -1))
        starts.append(starts[-1] + count**2)
    return np.asarray(
        _slopes(
            at_mm, np.concatenate(cells), np.concatenate(own2), np.concatenate(forces, axis=1).T.copy(),
            np.array(starts), middle, np.array([np.hypot(*half) * away for away, _ in _STANDING]),
        )
    )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _slopes(
    at: Float, cells: Float, own2: Float, forces: Float, starts: Float, middle: Float, away: Float
) -> Float:
    """forces: (cells, SHAPES). starts: first cell of each set; beyond `away` the next one counts."""
    out = np.zeros((len(at), 2, SHAPES))
    for n in range(len(at)):
        points = 1 if at[n, 0, 0] == at[n, 3, 0] and at[n, 0, 1] == at[n, 3, 1] else at.shape[1]
        along, across = np.zeros(SHAPES), np.zeros(SHAPES)
        for p in range(points):
            distance = np.hypot(at[n, p, 0] - middle[0], at[n, p, 1] - middle[1])
            level = 0
            while level < len(away) and distance > away[level]:
                level += 1
            for c in range(starts[level], starts[level + 1]):
                x, y = at[n, p, 0] - cells[c, 0], at[n, p, 1] - cells[c, 1]
                near2 = 1.0 / (x * x + y * y + own2[c])
                pull = near2 * np.sqrt(near2)
                for s in range(SHAPES):
                    along[s] += pull * x * forces[c, s]
                    across[s] += pull * y * forces[c, s]
        out[n, 0] = along / -points
        out[n, 1] = across / -points
    return out


@numba.njit(cache=True, nogil=True)
def normal_equations(terms: Float, wanted: Float) -> tuple[Float, Float]:
    """(t, t) products of terms (n, t), and (t,) with wanted (n,). No library's threads change a bit."""
    count = terms.shape[1]
    normal, right = np.zeros((count, count)), np.zeros(count)
    for n in range(len(terms)):
        for t in range(count):
            for u in range(count):
                normal[t, u] += terms[n, t] * terms[n, u]
            right[t] += terms[n, t] * wanted[n]
    return normal, right


@numba.njit(cache=True, nogil=True)
def followed(
    terms: Float,
    gain: Float,
    kept: Float,
    limit: Float,
    slopes: Float,
    share: Float,
    mean: Float,
    passes: int,
) -> Float:
    """Shares (t,) by slopes (2 n,) of another frame: each pass takes what the last says where none is known.

    terms, gain: (2 n, t) kernels, and what slopes add to shares. kept: (t, t) what the fit makes of its own
    slopes. limit: (2 n,) beyond which residuals are cut off, but for the first pass. share: (n,) of each
    block that is read.
    """
    count = len(mean)
    for p in range(passes):
        found = np.zeros(count)
        for t in range(count):
            for u in range(count):
                found[t] += kept[t, u] * mean[u]
        for n in range(len(slopes)):
            read = share[n // 2]
            if read == 0.0:
                continue
            left = slopes[n]
            for t in range(count):
                left -= read * terms[n, t] * mean[t]
            if p > 0:
                left = min(max(left, -limit[n]), limit[n])
            for t in range(count):
                found[t] += gain[n, t] * left
        mean = found
    return mean


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    line, place = np.ones(1), np.ones(2)
    _slopes(np.ones((1, 4, 2)), np.zeros((1, 2)), line, np.ones((1, SHAPES)), np.array([0, 1]), place, line)
    one = np.ones((1, 1))
    normal_equations(one, line)
    followed(np.ones((2, 1)), np.ones((2, 1)), one, place, place, line, line, 1)
