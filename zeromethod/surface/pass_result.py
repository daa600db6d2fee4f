"""What one pass of a reading read."""

from __future__ import annotations

from dataclasses import dataclass

from zeromethod.arrays import Float, Mask


@dataclass(frozen=True, slots=True)
class PassResult:
    """What one pass read, (rows, cols): depth, slopes (..., 2) and their variance, points (..., 2 or 3)."""

    slope: Float
    variance: Float
    point: Float
    island: Mask
    depth: Float
