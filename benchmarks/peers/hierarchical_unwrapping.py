"""Arctangent and hierarchical unwrapping: C. Zuo et al. 2016, DOI 10.1016/j.optlaseng.2016.04.022.

The longest period is at least as long as the LCD and needs no order; every shorter one takes the order
nearest to the place that the longer one gave. The place is that of the shortest period; no pixel is judged.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def places(frames: NDArray[Any], periods_px: tuple[float, ...], kind: Any = np.float64) -> NDArray[Any]:
    """LCD px (rows, cols, 2) from frames (2 axes x periods x shifts, rows, cols), columns first.

    The shifts are equal, the periods of both axes the same, the longest first. kind: of the numbers.
    """
    _, rows, cols = frames.shape
    stacks = frames.reshape(2, len(periods_px), -1, rows * cols)
    shift = 2 * np.pi * np.arange(stacks.shape[2]) / stacks.shape[2]
    waves = np.stack([np.cos(shift), np.sin(shift)]).astype(kind)
    found = [_along(axis, waves, periods_px) for axis in stacks]
    return np.stack(found, axis=-1).reshape(rows, cols, 2)


def _along(stacks: NDArray[Any], waves: NDArray[Any], periods_px: tuple[float, ...]) -> NDArray[Any]:
    place = np.zeros(stacks.shape[-1], waves.dtype)
    for n, (stack, period) in enumerate(zip(stacks, periods_px, strict=True)):
        cosine, sine = waves @ stack.astype(waves.dtype)
        within = np.arctan2(sine, cosine) * waves.dtype.type(period / (2 * np.pi))
        order = np.rint((place - within) / waves.dtype.type(period)) if n else within < 0
        place = within + order * waves.dtype.type(period)
    return place
