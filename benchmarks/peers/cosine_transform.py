"""Depth from slopes by a Poisson equation with free borders, solved by cosine transforms.

Simchony, Chellappa and Shao 1990, DOI 10.1109/34.55103: least squares over node-to-node differences by the
trapezoid rule, all weighted alike.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray


def integrate(step_across: NDArray[np.float64], step_down: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth (rows, cols), mean 0, from its derivatives per node along columns and rows, each (rows, cols).

    Knows neither masks nor weights: every node must have a slope.
    """
    rows, cols = step_across.shape
    across = 0.5 * (step_across[:, 1:] + step_across[:, :-1])
    down = 0.5 * (step_down[1:] + step_down[:-1])
    divergence = np.diff(across, axis=1, prepend=0, append=0) + np.diff(down, axis=0, prepend=0, append=0)
    eigenvalues = (2 * np.cos(np.pi * np.arange(rows) / rows) - 2)[:, None] + (
        2 * np.cos(np.pi * np.arange(cols) / cols) - 2
    )
    eigenvalues[0, 0] = np.inf
    depth = scipy.fft.idctn(scipy.fft.dctn(divergence, type=2) / eigenvalues, type=2)
    return np.asarray(depth)
