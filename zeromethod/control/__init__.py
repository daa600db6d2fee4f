"""Controllers: from the measured warp to the commanded one."""

from zeromethod.control.composition import Composition, Controller
from zeromethod.control.integrator import Integrator
from zeromethod.control.stability_margin import Margin, stability_margin

__all__ = ["Composition", "Controller", "Integrator", "Margin", "stability_margin"]
