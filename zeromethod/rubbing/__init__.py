"""Rubbing: the state of contact of cloth, brushes, pile and grains that slide along the mirror."""

from zeromethod.rubbing.reader import RubbingReader
from zeromethod.rubbing.status import ContactStatus, Motion

__all__ = ["ContactStatus", "Motion", "RubbingReader"]
