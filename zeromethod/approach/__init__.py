"""Contactless sensing: what comes, seen by a watch camera from below through the rubber."""

from zeromethod.approach.approach import FAULTY, Approach, Watching
from zeromethod.approach.reader import WatchReader
from zeromethod.approach.watch import Watch

__all__ = ["FAULTY", "Approach", "Watch", "WatchReader", "Watching"]
