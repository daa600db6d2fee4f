"""Textures and planted displacements: images whose motion is known exactly, because both are formulas."""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Float = NDArray[np.float64]
Texture = Callable[[Float, Float], Float]
Field = Callable[[Float, Float], tuple[Float, Float]]

SHAPE = (200, 260)


def speckle(sigma_px: float = 2.0, seed: int = 5, margin: int = 60) -> Texture:
    """Smoothed noise, mean 120, standard deviation 40; sampled by a quintic spline."""
    noise = np.random.default_rng(seed).normal(size=(SHAPE[0] + 2 * margin, SHAPE[1] + 2 * margin))
    grey = cv2.GaussianBlur(noise, (0, 0), sigma_px)
    grey = 120.0 + 40.0 * grey / grey.std()
    return lambda u, v: map_coordinates(grey, [v + margin, u + margin], order=5, mode="mirror")


def lattice(period_px: float = 16.0) -> Texture:
    k = 2 * np.pi / period_px
    return lambda u, v: 120.0 + 40.0 * np.cos(k * u) + 40.0 * np.cos(k * v)


def checker(side_px: float = 14.0, turn_deg: float = 20.0) -> Texture:
    """Squares with edges about two pixels soft, turned."""
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    k, soft = np.pi / side_px, 1.0 / (np.pi / side_px)

    def grey(u: Float, v: Float) -> Float:
        x, y = c * u + s * v, c * v - s * u
        return 120.0 + 80.0 * np.tanh(soft * np.sin(k * x)) * np.tanh(soft * np.sin(k * y))

    return grey


def pair(texture: Texture, field: Field, noise_grey: float = 0.0, seed: int = 0) -> tuple[Float, Float]:
    """(reference, image) with image(x + d(x)) = reference(x) = texture(x), and white noise in both."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    x, y = u.copy(), v.copy()
    for _ in range(100):
        du, dv = field(x, y)
        x, y = u - du, v - dv
    rng = np.random.default_rng(seed)
    return (
        texture(u, v) + noise_grey * rng.normal(size=SHAPE),
        texture(x, y) + noise_grey * rng.normal(size=SHAPE),
    )


def bump(height_px: float, width_px: float, centre: tuple[float, float] = (130.0, 100.0)) -> Field:
    """Gaussian bumps of both components, that of dv half as high."""

    def field(u: Float, v: Float) -> tuple[Float, Float]:
        r2 = (u - centre[0]) ** 2 + (v - centre[1]) ** 2
        h = height_px * np.exp(-0.5 * r2 / width_px**2)
        return h, 0.5 * h

    return field


def lens(strength: float, centre: tuple[float, float] = (130.0, 100.0)) -> Field:
    """Magnification by 1 + strength about a centre that does not move: what a dome does."""
    return lambda u, v: (strength * (u - centre[0]), strength * (v - centre[1]))
