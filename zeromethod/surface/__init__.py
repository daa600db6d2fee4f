"""Surface reading: slope and depth per node from a measured warp, with their uncertainty."""

from zeromethod.surface.covariance import Covariances, DepthCovariance, Variance
from zeromethod.surface.peak import Peak, Where, peak
from zeromethod.surface.reader import SurfaceReader
from zeromethod.surface.surface import Anchor, Surface, check_surface

__all__ = [
    "Anchor",
    "Covariances",
    "DepthCovariance",
    "Peak",
    "Surface",
    "SurfaceReader",
    "Variance",
    "Where",
    "check_surface",
    "peak",
]
