"""N-step phase shifting: Bruning et al. 1974, DOI 10.1364/AO.13.002693.

N pictures of one carrier, each shifted by 1/N of a period, give its phase at every pixel alone: no window,
but 2 N frames of a mirror that must hold still.

Convention: picture n shows cos(2 pi x / P + 2 pi n / N) along its axis x; image(u, v) = target((u, v) + d).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def displacement(frames: NDArray[np.uint8], period_px: float) -> NDArray[np.float32]:
    """Displacement d (rows, cols, 2) in px from frames (2 N, rows, cols), the N shifted along u first.

    N >= 3. Beyond a quarter period anywhere it is unwrapped along a column and from there along the rows.
    """
    steps = len(frames) // 2
    _, rows, cols = frames.shape
    turn = 2j * np.pi / period_px
    along_u = _phase(frames[:steps], np.exp(-turn * np.arange(cols)).astype(np.complex64)[None, :])
    along_v = _phase(frames[steps:], np.exp(-turn * np.arange(rows)).astype(np.complex64)[:, None])
    return np.asarray(np.stack([along_u, along_v], axis=-1) * np.float32(period_px / (2 * np.pi)))


def _phase(frames: NDArray[np.uint8], unturned: NDArray[np.complex64]) -> NDArray[np.float32]:
    """Phase (rows, cols) against the target's own, whose conjugated carrier is `unturned`."""
    delta = 2 * np.pi * np.arange(len(frames)) / len(frames)
    signal = np.zeros(frames.shape[1:], np.complex64)
    for frame, weight in zip(frames, np.exp(-1j * delta).astype(np.complex64), strict=True):
        signal += frame * weight
    phase: NDArray[np.float32] = np.angle(signal * unturned)
    if np.abs(phase).max() > np.pi / 2:
        rows = np.unwrap(phase, axis=1)
        phase = rows + (np.unwrap(rows[:, :1], axis=0) - rows[:, :1])
    return phase
