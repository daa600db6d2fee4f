"""Phase shifting: absolute LCD positions from shifted fringes of several periods."""

from zeromethod.phase_shifting.fringes import FringeSequence, equal_shifts
from zeromethod.phase_shifting.masks import Reason
from zeromethod.phase_shifting.measuring import RestMeasurement, measure_rest
from zeromethod.phase_shifting.noise import NoiseModel
from zeromethod.phase_shifting.periods import choose_periods
from zeromethod.phase_shifting.rest_map import RestMap

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
