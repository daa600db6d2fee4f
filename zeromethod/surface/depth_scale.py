"""Scale of depth: the field h of which slopes fix depth up to a multiple."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.rays import MirrorRays

_PROBE_DEPTH_MM = 1e-3
"""Change of depth by which that of the slope is found."""


def depth_scale(rays: MirrorRays, usable: Mask, slope: Float, point: Float) -> tuple[Float, Float]:
    """Scale h (rows, cols), median 1, from K = d(slope)/d(depth) at fixed q, integrated; its gradient.

    usable: (rows, cols). slope, point: (rows, cols, 2 and 3) of the mirror at rest.
    """
    deeper, _ = rays.slope(np.full(slope.shape[:-1], _PROBE_DEPTH_MM), rays.rest_q)
    rate = (deeper - slope) / _PROBE_DEPTH_MM
    usable = usable & np.isfinite(rate).all(axis=-1)
    plain = SlopeIntegrator(point[..., 0], point[..., 1])
    plain.prepare(usable, np.ones((*usable.shape, 2)))
    kappa = plain.integrate(rate, point[..., 0], point[..., 1])
    kappa -= np.median(kappa[plain.island])
    scale = np.where(plain.island, np.exp(kappa), 1.0)
    return scale, np.where(usable[..., None], rate, 0.0) * scale[..., None]
