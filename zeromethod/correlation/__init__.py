"""Image correlation: where every part of a reference image has gone in a second one."""

from zeromethod.correlation.correlate import correlate
from zeromethod.correlation.displacement import Displacement, Doubt

__all__ = ["Displacement", "Doubt", "correlate"]
