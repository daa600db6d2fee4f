from .depth_modes import DepthError, depth_error
from .fitting import Fit, Term, fit
from .measurements import Direct, Intrinsics, Measurement, MirrorEdge, RestPositions
from .parameters import PARAMETERS, Parameter, Priors, build, describe
from .presses import KnownBall, KnownPress, Presses, RestReading
from .tooth_seams import ToothSeams
from .uncertainty import Blend, Gain, gains, open_combinations
from .verdict import CalibrationVerdict, judge

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
    "ToothSeams",
    "build",
    "depth_error",
    "describe",
    "fit",
    "gains",
    "judge",
    "open_combinations",
]
