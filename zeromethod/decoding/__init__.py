"""Absolute decoding by phase shifting: LCD positions from shifted fringes of several periods."""

from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import measure_rest
from zeromethod.decoding.periods import choose_periods
from zeromethod.warp.rest_map import Reason, RestMap

__all__ = ["FringeSequence", "Reason", "RestMap", "choose_periods", "equal_shifts", "measure_rest"]
