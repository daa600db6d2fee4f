"""Arctangent and hierarchical unwrapping, the textbook decoder: C. Zuo et al. 2016, DOI 10.1016/j.optlaseng.2016.04.022.

The longest period is at least as long as the LCD and needs no order; every shorter one takes the order nearest to the
place that the longer one gave. The place is that of the shortest period alone; no pixel is judged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def places(frames: NDArray[np.generic], periods_px: tuple[float, ...]) -> NDArray[np.float32]:
    """LCD px (rows, cols, 2) from frames (2 axes x periods x shifts, rows, cols), equal shifts, columns first.

    periods_px: the longest first, as the frames.
    """
    _, rows, cols = frames.shape
    stacks = frames.reshape(2, len(periods_px), -1, rows * cols)
    shift = 2 * np.pi * np.arange(stacks.shape[2]) / stacks.shape[2]
    waves = np.stack([np.cos(shift), np.sin(shift)]).astype(np.float32)
    found = [_along(axis, waves, periods_px) for axis in stacks]
    return np.stack(found, axis=-1).reshape(rows, cols, 2)


def _along(
    stacks: NDArray[np.generic], waves: NDArray[np.float32], periods_px: tuple[float, ...]
) -> NDArray[np.float32]:
    place = np.zeros(stacks.shape[-1], np.float32)
    for n, (stack, period) in enumerate(zip(stacks, periods_px, strict=True)):
        cosine, sine = waves @ stack.astype(np.float32)
        within = np.arctan2(sine, cosine) * np.float32(period / (2 * np.pi))
        order = np.rint((place - within) / np.float32(period)) if n else within < 0
        place = within + order * np.float32(period)
    return place
