"""Sensing: camera image to residual, the displacement against the target per node, in camera px."""

from zeromethod.sensing.residual import Limits, Residual
from zeromethod.sensing.sensor import ResidualSensor
from zeromethod.sensing.window import transfer

__all__ = ["Limits", "Residual", "ResidualSensor", "transfer"]
