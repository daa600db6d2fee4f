"""Dents of hard objects in closed form, a contact as round as they are, and mirrors that they press."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zeromethod import Rig, load_rig
from zeromethod.arrays import Float
from zeromethod.contact import Contact, Probability
from zeromethod.surface import Anchor, Surface
from zeromethod.warp.overlap import component_correlation

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

E_MPA, POISSON = 1.6, 0.49
E_STAR = E_MPA / (1 - POISSON**2)
NOISE = 3e-6
"""Slope noise of a node of the packaged bench, rad."""
LINE = np.arange(-60, 61) * 0.3


def rig(**rubber: object) -> Rig:
    given = {"youngs_modulus_mpa": E_MPA, "poisson": POISSON, "support": "free", **rubber}
    return load_rig("simulated").replace({f"rubber.{key}": value for key, value in given.items()})


def overlapping(seed: int) -> Float:
    """Noise (rows, cols, 2) of variance 1 of nodes whose windows overlap, as on the packaged bench."""
    own, other = component_correlation(16, 8, "cosines")
    spectrum = []
    for correlation in (own, other):
        around = np.zeros(LINE.size)
        around[: len(correlation)] = correlation
        around[1:] += around[:0:-1]
        spectrum.append(np.maximum(np.fft.fft(around).real, 0))
    white = np.fft.fft2(np.random.default_rng(seed).normal(size=(LINE.size, LINE.size, 2)), axes=(0, 1))
    across = np.stack([np.outer(spectrum[1], spectrum[0]), np.outer(*spectrum)], axis=-1)
    return np.asarray(np.fft.ifft2(np.sqrt(across) * white, axes=(0, 1)).real)


def surface(
    slope_outwards: Callable[[Float], Float],
    *middles: tuple[float, float],
    noise: float = NOISE,
    seed: int = 3,
) -> Surface:
    """A mirror pressed at middles, with slopes away from each as a function of the distance."""
    x, y = np.meshgrid(LINE, LINE)
    slope, hole = noise * overlapping(seed), np.zeros(x.shape, bool)
    for mx, my in middles:
        r = np.maximum(np.hypot(x - mx, y - my), 1e-6)
        slope += (slope_outwards(r) / r)[..., None] * np.stack([x - mx, y - my], axis=-1)
        hole |= r < RADIUS_MM + 0.15
    sigma = np.full(slope.shape, max(noise, 1e-7))
    nothing = Anchor("none", np.zeros(x.shape, bool), 0.0)
    return Surface(np.zeros(x.shape), slope, x, y, sigma[..., 0], sigma, ~hole, hole, nothing, 0, 1)


def outwards(dent: Callable[[Float, float], Float], depth_mm: float) -> Callable[[Float], Float]:
    def slope(r: Float) -> Float:
        return depth_mm * (dent(r + 1e-5, RADIUS_MM) - dent(r - 1e-5, RADIUS_MM)) / 2e-5

    return slope
