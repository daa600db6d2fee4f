"""Contacts with made-up images of textures: dark spots in a lit patch, a carrier around it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from zeromethod.arrays import Float, Single
from zeromethod.contact.contact import Contact, ContactImage, Probability

MM_PER_PX = 0.033
BLUR_PX = 0.8
RADIUS_MM = 3.0
"""Of the patch; the border that is outlined lies 1 mm further out, as where the carrier is lost."""


def square_places(pitch_mm: float, stray_mm: float, seed: int, turn_deg: float = 0.0) -> Float:
    """(n, 2) mm, places of a square array in the patch, each astray by a standard deviation."""
    draw = np.random.default_rng(seed)
    steps = pitch_mm * np.arange(-30, 31)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    turn = np.radians(turn_deg)
    places = np.stack((np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y), axis=-1)
    places += stray_mm * draw.standard_normal(places.shape)
    return places[np.hypot(*places.T) < RADIUS_MM]


def random_places(count: int, seed: int) -> Float:
    """(n, 2) mm, places anywhere in the patch."""
    places = np.random.default_rng(seed).uniform(-RADIUS_MM, RADIUS_MM, (count, 2))
    return places[np.hypot(*places.T) < RADIUS_MM]


def planted(
    places_mm: Float, radius_mm: Float | float, at_mm: Float, seed: int = 0, number: int = 1
) -> Contact:
    """Contact of round spots at `places_mm` about the patch's middle `at_mm`."""
    outer = RADIUS_MM + 1.0
    side = round(2 * (outer + 0.3) / MM_PER_PX)
    first = at_mm - outer - 0.3
    cols, rows = np.meshgrid(np.arange(side), np.arange(side))
    x, y = first[0] + MM_PER_PX * cols, first[1] + MM_PER_PX * rows
    away = np.hypot(x - at_mm[0], y - at_mm[1])
    carrier = 1 + 0.45 * np.cos(2 * np.pi * x / 0.9) + 0.45 * np.cos(2 * np.pi * y / 0.5)
    light = np.where(away < RADIUS_MM, 1.9, carrier)
    apart, nearest = cKDTree(at_mm + places_mm).query(np.stack((x, y), axis=-1))
    light[apart < np.broadcast_to(radius_mm, len(places_mm))[nearest]] = 0.06
    draw = np.random.default_rng(seed)
    seen: Single = gaussian_filter(light, BLUR_PX).astype(np.float32)
    seen += np.float32(0.03) * draw.standard_normal(seen.shape).astype(np.float32)
    turn = np.linspace(0, 2 * np.pi, 120)[:-1]
    outline = at_mm + outer * np.stack((np.cos(turn), np.sin(turn)), axis=-1)
    return Contact(
        id=number, x_mm=at_mm[0], y_mm=at_mm[1], area_mm2=float(np.pi * outer**2), outline_mm=outline,
        sigma_x_mm=0.0, sigma_y_mm=0.0, sigma_area_mm2=0.0, major_mm=2 * outer,
        minor_mm=2 * outer, angle_deg=0.0, sigma_edge_mm=0.0, scattered=0.06, force_n=0.5,
        sigma_force_n=0.01, outline_px=outline,
        probability=Probability(0, 0, np.zeros((0, 0), np.float32)),
        image=ContactImage(seen, MM_PER_PX, float(first[0]), float(first[1])),
    )  # fmt: skip
