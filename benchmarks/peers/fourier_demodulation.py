"""Fourier demodulation of a crossed carrier (FCD): Wildeman 2018, DOI 10.1007/s00348-018-2553-9.

The picture's spectrum has one peak per carrier. What lies round a peak, brought back to space, is the carrier
with the displacement in its phase; the same of the reference picture is divided out. All in complex64.

Convention: image(u, v) = reference((u, v) + d).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray


@dataclass(frozen=True)
class Carriers:
    """Two carriers of a reference: filters (2, rows, cols) float32 and conjugated signals complex64."""

    period_px: float
    filters: NDArray[np.float32]
    conjugates: NDArray[np.complex64]


def carriers_of(reference: NDArray[np.uint8], period_px: float) -> Carriers:
    """Carriers along u and v of a reference picture (rows, cols), of that period in px.

    Sharp circular filters round the peaks, of half the distance between the two peaks, as published.
    """
    rows, cols = reference.shape
    fv, fu = np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(cols)[None, :]
    carrier = 1 / period_px
    radius = carrier / np.sqrt(2)
    peaks = ((carrier, 0.0), (0.0, carrier))
    filters = np.array([np.hypot(fu - pu, fv - pv) < radius for pu, pv in peaks], np.float32)
    return Carriers(period_px, filters, np.conj(_signals(reference, filters)))


def displacement(image: NDArray[np.uint8], carriers: Carriers) -> NDArray[np.float32]:
    """Displacement d (rows, cols, 2) in px, at every pixel of an image (rows, cols).

    Beyond a quarter period anywhere it is unwrapped along a column and from there along the rows.
    """
    phases = np.angle(_signals(image, carriers.filters) * carriers.conjugates)
    if np.abs(phases).max() > np.pi / 2:
        phases = np.stack([unwrapped(phase) for phase in phases])
    return np.asarray(np.moveaxis(phases, 0, -1) * np.float32(carriers.period_px / (2 * np.pi)))


def unwrapped(phase: NDArray[np.float32]) -> NDArray[np.float32]:
    """Phase (rows, cols) without jumps, where neighbours differ by less than half a turn; first corner kept.

    Itoh 1982, DOI 10.1364/AO.21.002470.
    """
    rows = np.unwrap(phase, axis=1)
    first = np.unwrap(rows[:, :1], axis=0)
    return np.asarray(rows + (first - rows[:, :1]), np.float32)


def _signals(image: NDArray[np.uint8], filters: NDArray[np.float32]) -> NDArray[np.complex64]:
    """(2, rows, cols) complex64 signals of the two carriers."""
    spectrum = scipy.fft.fft2(image.astype(np.float32), workers=1)
    return np.stack([scipy.fft.ifft2(spectrum * one, workers=1, overwrite_x=True) for one in filters])
