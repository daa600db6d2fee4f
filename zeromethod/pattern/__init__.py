"""The picture on the LCD: target, panel response, and the mesh that draws the warped target."""

from zeromethod.pattern.renderer import PatternRenderer
from zeromethod.pattern.response import Response
from zeromethod.pattern.strips import Strips
from zeromethod.pattern.target import Target

__all__ = ["PatternRenderer", "Response", "Strips", "Target"]
