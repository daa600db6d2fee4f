"""From a camera image to the residual per node: how far what is seen is from the target, in camera px."""

from zeromethod.sensing.residual import Limits, Residual
from zeromethod.sensing.sensor import ResidualSensor
from zeromethod.sensing.window import noise_correlation, transfer

__all__ = ["Limits", "Residual", "ResidualSensor", "noise_correlation", "transfer"]
