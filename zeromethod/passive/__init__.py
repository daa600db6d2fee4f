"""Image correlation: where every part of a reference image has gone in a second one."""

from zeromethod.passive.correlate import correlate
from zeromethod.passive.displacement import Displacement, PointFlag

__all__ = ["Displacement", "PointFlag", "correlate"]
