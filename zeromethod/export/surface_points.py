"""Points of a surface in the world, mm."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.optics.mirror import HeightField
from zeromethod.surface import Surface


def surface_points(surface: Surface, rest: HeightField) -> Float:
    """World points (rows, cols, 3) in mm of every node; z NaN where not valid.

    Convention: origin P0, x along the mirror, z = h_rest(x, y) - depth out of the rubber.
    """
    x, y = (np.asarray(values, dtype=np.float64) for values in (surface.x_mm, surface.y_mm))
    z = rest.height(x, y) - np.where(surface.valid, surface.depth_mm, np.nan)
    return np.stack([x, y, z], axis=-1)
