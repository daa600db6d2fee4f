"""Taking a light that is expected to vary out of an image, before its carrier is read.

A gradient of the light across the window biases the phase in second order only, but a kink or a step does so
in first. What the optics foretell need not be suffered: divided by it, the image is that of an evenly lit
target, and every rule about light (lost, edges) judges what nobody foretold.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.rig.model import Noise
from zeromethod.sensing.demodulate import Image


@numba.njit(cache=True, fastmath=True)
def level(image: Image, share: Single, black: float, ceiling: int, out: Single) -> None:
    """Grey levels (rows, cols) as they would be with light share 1; clipped pixels stay at the ceiling.

    What lands at the ceiling without having been clipped stays just below it, so that it is not counted.
    """
    dark, most = np.float32(black), np.float32(ceiling - 1)
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            grey = np.float32(image[row, col])
            levelled = min(dark + (grey - dark) / share[row, col], most)
            out[row, col] = grey if image[row, col] >= ceiling else levelled


def noise_factor(mean_grey: Single, share: Single, noise: Noise) -> Float:
    """Standard deviation of levelled grey over that of an image as bright by itself; arrays of one shape.

    Levelled by s, read noise counts 1/s^2 and light's own noise 1/s: dim places are noisier.
    """
    still = noise.read_grey**2 + 1 / 12
    per_grey = 0.0 if noise.electrons_per_grey is None else 1.0 / noise.electrons_per_grey
    light = per_grey * np.maximum(mean_grey.astype(float) - noise.black_grey, 0.0)
    factor: Float = np.sqrt((still / share**2 + light / share) / (still + light))
    return factor
