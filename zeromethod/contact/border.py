"""How likely the light across a contact's border is, for every place that the border may have.

Inside, the object scatters one level. Outside is a picture whose phase is not known beside a contact, but
which changes little within a few pixels: a random function with a length and a contrast of its own, and the
mirror may be darker there. Between, the lens's pupil blurs the border and mixes both. So the first light that
comes out from behind the border counts most, by as much as the picture beside is bright.
Source of such likelihoods: Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, 5.4.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from zeromethod.arrays import Float
from zeromethod.contact.flank import OUT_PX

IN_PX = 5
"""Pixels that are looked at inside; OUT_PX outside."""
STEP_PX, WAY = 0.25, 12
"""Step of the places, and how many there are to either side."""
_LENGTHS_PX = 1.2, 2.5, 5.0
_CONTRASTS = 0.2, 0.45
"""Of the picture, which may be blurred by steep slopes."""
_MEAN = 0.5
"""Standard deviation of the light beside a border, over the picture's mean."""
_OTHER = 0.025
"""The same of all that is not modelled."""
_BETWEEN_PX2 = 1 / 6
"""Variance that reading levels between pixels adds to a blur."""
_LEAST_KNOWN = 0.5


class BorderModels(NamedTuple):
    """Gaussians of the levels (k,) across a border, -IN_PX to OUT_PX, by model and place.

    white: (..., k, k x places) makes of levels what is independent and of variance 1, for each place. meant:
    (..., 1, k x places) that of the mean levels. log: (..., 1, places) of the determinants. ...: by model.
    """

    white: Float
    meant: Float
    log: Float

    def one(self, model: int) -> BorderModels:
        """One of the models alone."""
        return BorderModels(*(part[model] for part in self))


@lru_cache(maxsize=32)
def border_models(scattered: float, blur_px: float, noise: tuple[float, float]) -> BorderModels:
    """Models for an object's level and a blur's standard deviation; all levels over the picture's mean.

    noise: (variance without light, variance per level).
    """
    at = np.arange(-IN_PX, OUT_PX + 1.0)
    place = STEP_PX * np.arange(-WAY, WAY + 1)[:, None]
    blur = np.sqrt(blur_px**2 + _BETWEEN_PX2)
    z = (at - place) / blur
    open_share = np.maximum(ndtr(z), 1e-6)
    # where the pupil is that still sees the picture
    seen = at + blur * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi) / open_share
    mean = open_share + (1 - open_share) * scattered
    apart2 = (seen[:, :, None] - seen[:, None, :]) ** 2
    both = open_share[:, :, None] * open_share[:, None, :]
    own = (noise[0] + noise[1] * mean + _OTHER**2)[:, :, None] * np.eye(len(at))
    covariance = np.stack(
        [
            both * (contrast**2 * np.exp(-0.5 * apart2 / length**2) + _MEAN**2) + own
            for length in _LENGTHS_PX
            for contrast in _CONTRASTS
        ]
    )
    white = np.linalg.inv(np.linalg.cholesky(covariance))
    meant = np.einsum("mwab,wb->maw", white, mean).reshape(len(white), 1, -1)
    log = np.log(np.diagonal(white, axis1=2, axis2=3)).sum(axis=2)[:, None]
    return BorderModels(white.transpose(0, 3, 2, 1).reshape(len(white), len(at), -1), meant, log)


def likeliest_model(levels: Float, known: Float, models: BorderModels) -> int:
    """By which of the models levels (n, k) across a border are likeliest."""
    return int(scores(levels, known, models).max(axis=-1).sum(axis=-1).argmax())


def scores(levels: Float, known: Float, models: BorderModels) -> Float:
    """(..., n, places) log-likelihood of levels (n, k) across a border; 0 where dirt lies on it."""
    apart = levels @ models.white - models.meant
    apart = apart.reshape(*apart.shape[:-1], levels.shape[1], 2 * WAY + 1)
    score = models.log - 0.5 * (apart * apart).sum(axis=-2)
    return np.where(known.min(axis=1, keepdims=True) < _LEAST_KNOWN, 0.0, score)
