"""Contactless sensing: approaching objects, seen from below through the rubber by a watch camera."""

from zeromethod.approach.approach import FAULTY, Approach, Watching
from zeromethod.approach.reader import WatchReader
from zeromethod.approach.watch import Watch

__all__ = ["FAULTY", "Approach", "Watch", "WatchReader", "Watching"]
