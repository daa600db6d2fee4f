"""Ridges and bars in a contact's image: how far apart, which way, at what contrast."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
import scipy

from zeromethod.arrays import Float
from zeromethod.contact.contact import Contact

_LEAST_PERIODS = 3.0
"""Periods across the contact from which on something counts as periodic."""
_FINEST_PX = 3.0
"""Shortest period that is looked for."""
_FINE = 4
"""Zero padding of the spectrum: its step is a fourth of the image's own."""
_PHASES = 16
"""Parts of a period in which the mean stripe is known."""
_UNLIKE = 0.08
"""Difference from the object's own light from which on a place is as unlike it as can be."""
_FEWEST_PX = 200
"""Pixels of the smallest image in which stripes are looked for."""


class Stripes(NamedTuple):
    """Stripes of a contact.

    pitch_mm: from one to the next. angle_deg: the way across them, from x towards y, 0 to 180.
    contrast: (bright - dark) / (bright + dark) of the mean stripe.
    """

    pitch_mm: float
    angle_deg: float
    contrast: float


def stripes(contact: Contact) -> Stripes | None:
    """The strongest stripes in a contact's image.

    Parameters
    ----------
    contact : Contact
        A contact with an image.

    Returns
    -------
    Stripes or None
        None where it has no image, or one too small for three periods.
    """
    image = contact.image
    if image is None:
        return None
    inside = image.inside(contact.outline_mm) & np.isfinite(image.light)
    away = cv2.distanceTransform(np.pad(inside.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    if np.count_nonzero(inside) < _FEWEST_PX:
        return None
    # smooth to 0 at the border, whose own frequencies would count else
    weight = np.sqrt(away / away.max())
    # how much of the rubber between is bright, and where, depends on what it happens to reflect
    unlike = np.minimum(np.abs(np.nan_to_num(image.light) - contact.scattered), _UNLIKE)
    light = np.where(inside, unlike, 0.0)
    light = weight * (light - float((weight * light).sum() / weight.sum()))
    found = strongest(light)
    if found is None:
        return None
    cycles = refined(light, found)
    rows, cols = np.nonzero(inside)
    per_px = float(np.hypot(*cycles))
    angle = float(np.degrees(np.arctan2(cycles[1], cycles[0])) % 180)
    phase = (np.stack((cols, rows), axis=-1) @ cycles) % 1
    bins = (phase * _PHASES).astype(int) % _PHASES
    share = np.bincount(bins, weight[inside], _PHASES)
    total = np.bincount(bins, weight[inside] * np.nan_to_num(image.light)[inside], _PHASES)
    profile = total / np.maximum(share, 1e-9)
    bright, dark = float(profile.max()), max(float(profile.min()), 0.0)
    return Stripes(image.mm_per_px / per_px, angle, (bright - dark) / max(bright + dark, 1e-9))


def strongest(light: Float, least_periods: float = _LEAST_PERIODS) -> Float | None:
    """(2,) cycles per pixel along columns and rows of the highest peak of the spectrum."""
    rows, cols = (scipy.fft.next_fast_len(_FINE * side, real=True) for side in light.shape)
    power = np.abs(scipy.fft.rfft2(light.astype(np.float32), (rows, cols)))
    down, across = (
        one.astype(np.float32)
        for one in (scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(cols)[None, :])
    )
    cycles = np.hypot(down, across)
    power[(cycles < least_periods / max(light.shape)) | (cycles > 1 / _FINEST_PX)] = 0
    if not power.any():
        return None
    row, col = np.unravel_index(int(np.argmax(power)), power.shape)
    return np.array([across[0, col], down[row, 0]])


def wave(light: Float, cycles: Float) -> float:
    """Size of the sum of light (rows, cols) times a wave of (2,) cycles per pixel along columns and rows."""
    down, across = (
        np.exp(-2j * np.pi * c * np.arange(n)) for c, n in zip(cycles[::-1], light.shape, strict=True)
    )
    # real, as sums of so few real numbers are left to one thread: BLAS' threads cost more than they give
    real, imaginary = np.stack((down.real, down.imag)) @ light
    return float(np.abs((real + 1j * imaginary) @ across))


def refined(light: Float, cycles: Float) -> Float:
    """The strongest wave's (2,) cycles, of light (rows, cols), to a fraction of the spectrum's step."""
    size = max(light.shape)
    found = scipy.optimize.minimize(
        lambda off: -wave(light, cycles + off / size), np.zeros(2), method="Nelder-Mead",
        options={"initial_simplex": np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.2]])},
    )  # fmt: skip
    return np.asarray(cycles + found.x / size)
