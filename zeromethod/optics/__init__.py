"""Exact rays of the bench: prism, mirror, layers, camera and LCD, both ways."""

from zeromethod.optics.bench import Optics
from zeromethod.optics.check import check_geometry
from zeromethod.optics.fresnel import critical_angle_rad, fresnel
from zeromethod.optics.mirror import (
    Cylinder,
    Dented,
    DepthField,
    Flat,
    GridHeight,
    HeightField,
    Sphere,
    rest_surface,
)
from zeromethod.optics.trace import Lost, Trace
from zeromethod.optics.vectors import reflect

__all__ = [
    "Cylinder",
    "Dented",
    "DepthField",
    "Flat",
    "GridHeight",
    "HeightField",
    "Lost",
    "Optics",
    "Sphere",
    "Trace",
    "check_geometry",
    "critical_angle_rad",
    "fresnel",
    "reflect",
    "rest_surface",
]
