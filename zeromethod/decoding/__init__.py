"""Absolute decoding by phase shifting: LCD positions from shifted fringes of several periods."""

from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import RestMeasurement, measure_rest
from zeromethod.decoding.noise import NoiseModel
from zeromethod.decoding.periods import choose_periods
from zeromethod.warp.rest_map import Reason, RestMap

__all__ = [
    "FringeSequence",
    "NoiseModel",
    "Reason",
    "RestMap",
    "RestMeasurement",
    "choose_periods",
    "equal_shifts",
    "measure_rest",
]
