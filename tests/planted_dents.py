"""Dents of hard objects in closed form, and a contact as round as they are."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.contact import Contact, Probability

RADIUS_MM = 0.9


def round_contact(x_mm: float = 0.0, y_mm: float = 0.0, radius_mm: float = RADIUS_MM) -> Contact:
    angle = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    outline = np.stack([x_mm + radius_mm * np.cos(angle), y_mm + radius_mm * np.sin(angle)], axis=-1)
    nothing = Probability(0, 0, np.zeros((1, 1), np.float32))
    return Contact(
        id=1, x_mm=x_mm, y_mm=y_mm, sigma_x_mm=0.01, sigma_y_mm=0.01, area_mm2=np.pi * radius_mm**2,
        sigma_area_mm2=0.05, major_mm=2 * radius_mm, minor_mm=2 * radius_mm, angle_deg=0.0,
        sigma_edge_mm=0.01, scattered=0.1, outline_mm=outline, outline_px=outline, probability=nothing,
    )  # fmt: skip


def ball(r: Float, a: float) -> Float:
    """Dent of a ball over its depth in the middle; Johnson 1985, 3.42."""
    rho = np.maximum(r / a, 1.0)
    outside = ((2 - rho**2) * np.arcsin(1 / rho) + np.sqrt(rho**2 - 1)) / np.pi
    return np.where(r < a, 1 - (r / a) ** 2 / 2, outside)


def punch(r: Float, a: float) -> Float:
    """The same of a flat punch; Johnson 1985, 3.37 and 3.38."""
    return 2 / np.pi * np.arcsin(np.minimum(a / np.maximum(r, 1e-9), 1.0))


def cone(r: Float, a: float) -> Float:
    """The same of a cone; Sneddon 1965, doi:10.1016/0020-7225(65)90019-4."""
    rho = np.maximum(r / a, 1.0)
    outside = np.arcsin(1 / rho) + np.sqrt(rho**2 - 1) - rho
    return np.where(r < a, np.pi / 2 - r / a, outside) * 2 / np.pi


DENTS = {"ball": (ball, 0.75), "punch": (punch, 0.5), "cone": (cone, 1.0)}
"""Shape, and depth in the middle over force / (E* radius)."""
