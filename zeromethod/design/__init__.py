"""What a bench can do, before or after it is built: figures from its rig file by the package's optics."""

from zeromethod.design.advice import design_warnings
from zeromethod.design.figures import design_figures, headline
from zeromethod.design.press_limits import DEFAULT_KINDS, PressKind, press_limit
from zeromethod.design.ray_paths import ray_paths
from zeromethod.design.sampled_view import SampledView
from zeromethod.design.vary import Variation, curves, varied

__all__ = [
    "DEFAULT_KINDS",
    "PressKind",
    "SampledView",
    "Variation",
    "curves",
    "design_figures",
    "design_warnings",
    "headline",
    "press_limit",
    "ray_paths",
    "varied",
]
