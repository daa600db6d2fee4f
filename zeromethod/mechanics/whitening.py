"""Correlated noise made white: data with noise of a known covariance, over that covariance's root."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from zeromethod.arrays import Float


class Whitening:
    """Turns data of two halves, each with correlated noise, into data of white noise of variance 1."""

    def __init__(self, noise: tuple[Float, Float], more: Float) -> None:
        """noise: covariances (n, n) of either half; more: (2 n,) variances besides."""
        halves = zip(noise, np.split(more, 2), strict=True)
        self._roots = [np.asarray(np.linalg.cholesky(one + np.diag(part))) for one, part in halves]

    @property
    def log_size(self) -> float:
        """Logarithm of the volume that data lose."""
        return float(sum(np.log(np.diag(root)).sum() for root in self._roots))

    def __call__(self, values: Float) -> Float:
        """White values (2 n, ...)."""
        return self._halves(values, lambda r, h: solve_triangular(r, h, lower=True, check_finite=False))

    def back(self, white: Float) -> Float:
        """Values (2 n,) before whitening."""
        return self._halves(white, lambda r, h: r @ h)

    def weights(self, white: Float) -> Float:
        """Weights (2 n,) for values that do what these do for white ones."""
        return self._halves(
            white, lambda r, h: solve_triangular(r, h, lower=True, trans=1, check_finite=False)
        )

    def _halves(self, values: Float, of: Callable[[Float, Float], Float]) -> Float:
        halves = zip(self._roots, np.split(values, 2), strict=True)
        return np.concatenate([of(root, half) for root, half in halves])
