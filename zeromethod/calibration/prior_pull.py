"""Pulls: how far what was measured by hand lies from what everything else says of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtri

from zeromethod.calibration.fitting import Fit
from zeromethod.calibration.parameters import PARAMETERS

PULL_SIGMA = 3.0
"""Pull from which something is wrong: the value, or the sigma that was stated for it."""

KEPT_MOST = 0.99
"""Share of a prior's variance beyond which a pull is more rounding than measurement: the data say nothing."""


@dataclass(frozen=True)
class Pull:
    """One parameter's value by hand against what all other data say of it.

    sigmas: distance over the root of both variances. given, given_sigma: by hand. found, found_sigma: by the
    rest, without it.
    """

    name: str
    sigmas: float
    given: float
    given_sigma: float
    found: float
    found_sigma: float

    @property
    def words(self) -> str:
        """What disagrees, by how much, and what to do."""
        parameter = PARAMETERS[self.name]
        unit = f" {parameter.unit}" if parameter.unit else ""
        return (
            f"{parameter.words} is {self.sigmas:.1f} sigma away from what was measured by hand "
            f"({self.given:.5g} +- {self.given_sigma:.2g}{unit}; all else says {self.found:.5g} +- "
            f"{self.found_sigma:.2g}): measure it again, or raise its sigma in [priors]"
        )


def pulls(fitted: Fit) -> list[Pull]:
    """Pulls beyond `PULL_SIGMA`, largest first.

    With posterior variance c (in units of the prior's) and value z, the other data alone give z / (1 - c)
    with variance c / (1 - c), so that prior and data are z / sqrt(1 - c) standard deviations apart.
    """
    priors = fitted.priors
    kept = np.diag(fitted.covariance)
    known = kept < KEPT_MOST
    free = np.where(known, 1.0 - kept, 1.0)
    size = np.where(known, np.abs(fitted.z) / np.sqrt(free), 0.0)
    found = priors.mean + priors.sigma * fitted.z / free
    spread = priors.sigma * np.sqrt(kept / free)
    numbers = np.stack([size, priors.mean, priors.sigma, found, spread], axis=-1)
    beyond = [i for i in np.argsort(-size) if size[i] > PULL_SIGMA]
    return [Pull(priors.names[i], *map(float, numbers[i])) for i in beyond]


def pull_together(fitted: Fit) -> float:
    """Pull of all combinations that the data determine, as the sigmas of one that is as improbable."""
    values, vectors = np.linalg.eigh(fitted.covariance)
    known = values < KEPT_MOST
    squares = (vectors.T @ fitted.z)[known] ** 2 / (1.0 - values[known])
    improbable = float(chdtrc(max(len(squares), 1), squares.sum()))
    return float(-ndtri(0.5 * improbable)) if improbable > 0.0 else float("inf")
