"""What was lit on the LCD while a frame was exposed: presentation log, panel timing, strips, mixtures."""

from zeromethod.exposure.pairing import Observation, PanelTiming, pair
from zeromethod.exposure.presentation_log import PresentationLog

__all__ = ["Observation", "PanelTiming", "PresentationLog", "pair"]
