"""All loads that may press: Gaussian pressures of several widths, on lattices over the view and beyond it."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.mechanics.gaussian_load import Loads

_RATIO = 1.5
"""Of one width to the next: with 2 the constant's errors are up to twice as large."""
_NARROWEST, _WIDEST = 0.8, 24.0
"""Widths over the size of a block of nodes: narrower ones look the same from one block to the next."""
_BEYOND, _FARTHEST = 3.0, 48.0
"""How far beyond the view loads lie: over their width, and over the size of a block, at most."""


def possible_loads(low_mm: Float, high_mm: Float, block_mm: float) -> Loads:
    """Loads over a view between corners (2,), mm, whose blocks of nodes are block_mm large."""
    found = []
    width = _NARROWEST * block_mm
    while width <= _WIDEST * block_mm:
        beyond = min(_BEYOND * width, _FARTHEST * block_mm)
        axes = []
        for low, high in zip(low_mm, high_mm, strict=True):
            half = 0.5 * (high - low) + beyond
            steps = int(half / width)
            axes.append(0.5 * (low + high) + width * np.arange(-steps, steps + 1))
        x, y = (axis.ravel() for axis in np.meshgrid(*axes))
        found.append(np.stack([x, y, np.full_like(x, width)]))
        width *= _RATIO
    return Loads(*np.concatenate(found, axis=1))
