"""Image correlation of still images: where every part of a reference image has gone in a second one.

`zeromethod measure` is built on it. A passive *run* is something else: the loop with a pattern that stays
(`zeromethod.control.passive`).
"""

from zeromethod.passive.correlate import correlate
from zeromethod.passive.displacement import Displacement, PointFlag

__all__ = ["Displacement", "PointFlag", "correlate"]
