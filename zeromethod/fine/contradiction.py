"""Where the last frames contradict each other at pixels: a narrow dent came or went that nodes cannot see.

What moves within the frames scatters their grey levels about the fit of all. Noise does, too, and what nodes
have seen move; where the scatter of the pixels in a cell between nodes is beyond both, they do not show one
mirror, and neither their mean nor the nodes say what is there now.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.fine.demodulate import END_FRAMES, UNKNOWNS, Demodulated, grey_variance
from zeromethod.fine.lattice import PixelLattice
from zeromethod.rig.model import Noise

_CHANCE = 5.0
"""Deviations of chance from which frames contradict each other: one false cell in 20 full views."""
_SEEN_MOTION = 0.5
"""Share of a motion's amplitude that nodes see from which it counts as theirs. Of dents up to 0.6 mm they see
less. (At 0.9, pads of centimetres that move lose 5 % of their pixels, which are right within sigma.)"""
_POOLED_CELLS = 1, 3
"""Cells along each side over which scatter is averaged: narrow dents show in one, faint ones in some."""
_FROM_MAD = 1.4826
"""Standard deviation over the median distance from the median, of normal numbers."""


class Scatter(NamedTuple):
    """Means over each cell between nodes, (rows, cols).

    misfits: (4, rows, cols) of the grey levels about the fit, grey^2: in all frames, and `Demodulated.ends`.
    of_noise: of them by noise alone. amplitude2: (rows, cols, 2) square of the carriers' amplitude. free:
    frames less unknowns of each misfit.
    """

    misfits: Float
    of_noise: Float
    amplitude2: Float
    free: tuple[int, ...]

    @classmethod
    def of(cls, lattice: PixelLattice, found: Demodulated, frames: int, noise: Noise) -> Scatter:
        """Of the fit of so many frames."""
        misfits = np.stack(
            [lattice.cell_means(one) for one in (found.misfit, *np.moveaxis(found.ends, -1, 0))]
        )
        of_noise = lattice.cell_means(grey_variance(noise, found.mean))
        free = max(frames - UNKNOWNS, 1), END_FRAMES, END_FRAMES, 1
        return cls(misfits, of_noise, lattice.cell_means(found.modulation**2), free)


def contradicted(lattice: PixelLattice, seen: Scatter, moved2: Float) -> Mask:
    """(rows, cols) of pixels at which the frames contradict each other, and those of the cells around.

    moved2: (4, node rows, node cols, 2) variance of what nodes saw move, camera px^2, in the frames of each
    misfit.
    """
    per_px2 = 0.5 * (2 * np.pi / lattice.grid.period_px / _SEEN_MOTION) ** 2
    beyond = np.zeros(seen.of_noise.shape, bool)
    for misfit, moved, free in zip(seen.misfits, moved2, seen.free, strict=True):
        corners = moved[:-1, :-1], moved[1:, :-1], moved[:-1, 1:], moved[1:, 1:]
        # a phase that scatters takes from the amplitude what it adds to the misfit
        by_nodes = (np.mean(corners, axis=0) * (seen.amplitude2 + misfit[..., None])).sum(axis=-1) * per_px2
        for cells in _POOLED_CELLS:
            pooled = (np.asarray(cv2.blur(one, (cells, cells))) for one in (misfit, seen.of_noise + by_nodes))
            scatter = np.divide(*pooled)
            # a camera may be noisier than stated, and codes and timing scatter all over the view
            usual = max(float(np.median(scatter)), 1.0)
            # the cube root of a mean square is normal (Wilson and Hilferty)
            spread2 = 2.0 / (9.0 * free * (cells * lattice.grid.spacing_px) ** 2)
            sigmas = (np.cbrt(scatter / usual) - 1.0 + spread2) / np.sqrt(spread2)
            spread = _FROM_MAD * float(np.median(np.abs(sigmas - np.median(sigmas))))
            beyond |= sigmas > _CHANCE * max(spread, 1.0)
    return lattice.of_cells(cv2.dilate(beyond.view(np.uint8), np.ones((3, 3), np.uint8)).view(np.bool_))
