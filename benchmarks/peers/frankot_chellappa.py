"""Depth from slopes in the Fourier domain: Frankot and Chellappa 1988, DOI 10.1109/34.3909.

Mirrored at its borders first, so that a depth that differs from border to border is not taken for periodic.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray


def integrate(step_across: NDArray[np.float64], step_down: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth (rows, cols), mean 0, from its derivatives per node along columns and rows, each (rows, cols).

    Knows neither masks nor weights: every node must have a slope.
    """
    across = _mirrored(step_across, odd_axis=1)
    down = _mirrored(step_down, odd_axis=0)
    rows, cols = across.shape
    wv = 2 * np.pi * np.fft.fftfreq(rows)[:, None]
    wu = 2 * np.pi * np.fft.rfftfreq(cols)[None, :]
    square = wu**2 + wv**2
    square[0, 0] = np.inf
    spectrum = -1j * (wu * scipy.fft.rfft2(across) + wv * scipy.fft.rfft2(down)) / square
    depth = scipy.fft.irfft2(spectrum, s=(rows, cols))[: rows // 2, : cols // 2]
    return np.asarray(depth - depth.mean())


def _mirrored(values: NDArray[np.float64], odd_axis: int) -> NDArray[np.float64]:
    """(2 rows, 2 cols): even about the borders of one axis, odd about those of `odd_axis`."""
    for axis in (0, 1):
        sign = -1 if axis == odd_axis else 1
        values = np.concatenate([values, sign * np.flip(values, axis)], axis=axis)
    return values
