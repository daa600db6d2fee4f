"""From an unknown bench to millimetres: geometry fitted to all that is known, with what remains unknown.

priors = Priors.of(rig)
reading = RestReading.of(grid, rest)
fitted = fit(priors, [RestPositions.of(grid, rest), Presses.of(reading, [press])])
error = depth_error(fitted, grid, reading)
verdict = judge(fitted, error, gains(fitted, error))
"""

from zeromethod.calibration.depth_error import DepthError, depth_error
from zeromethod.calibration.fit import Fit, Term, fit
from zeromethod.calibration.measurements import Direct, Intrinsics, Measurement, MirrorEdge, RestPositions
from zeromethod.calibration.parameters import PARAMETERS, Parameter, Priors, build, describe
from zeromethod.calibration.presses import KnownBall, KnownPress, Presses, RestReading
from zeromethod.calibration.uncertainty import Blend, Gain, gains, open_combinations
from zeromethod.calibration.verdict import CalibrationVerdict, judge

__all__ = [
    "PARAMETERS",
    "Blend",
    "CalibrationVerdict",
    "DepthError",
    "Direct",
    "Fit",
    "Gain",
    "Intrinsics",
    "KnownBall",
    "KnownPress",
    "Measurement",
    "MirrorEdge",
    "Parameter",
    "Presses",
    "Priors",
    "RestPositions",
    "RestReading",
    "Term",
    "build",
    "depth_error",
    "describe",
    "fit",
    "gains",
    "judge",
    "open_combinations",
]
