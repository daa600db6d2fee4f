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

import numba
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

    mean: (k, places). white: (models, k, k, places) lower triangles that make deviations independent and of
    variance 1. log: (models, places) of their determinants.
    """

    mean: Float
    white: Float
    log: Float


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
    log = np.log(np.diagonal(white, axis1=2, axis2=3)).sum(axis=2)
    return BorderModels(mean.T.copy(), np.moveaxis(white, 1, 3).copy(), log)


@numba.njit(cache=True, nogil=True)
def likeliest_model(levels: Float, known: Float, mean: Float, white: Float, log: Float, every: int) -> int:
    """The model of `BorderModels` by which every so many points' levels are likeliest."""
    few, share = levels[::every].copy(), known[::every].copy()
    best, most = 0, -np.inf
    for m in range(len(white)):
        score = scores(few, share, mean, white[m], log[m])
        total = 0.0
        for i in range(len(few)):
            total += score[i].max()
        if total > most:
            best, most = m, total
    return best


@numba.njit(cache=True, nogil=True)
def scores(levels: Float, known: Float, mean: Float, white: Float, log: Float) -> Float:
    """(n, places) log-likelihood of levels (n, k) across a border by one model; 0 where dirt lies on it."""
    n, k = levels.shape
    places = mean.shape[1]
    result, off, part = np.zeros((n, places)), np.empty((k, places)), np.empty(places)
    for i in range(n):
        if known[i].min() < _LEAST_KNOWN:
            continue
        result[i] = log
        # all places at once
        for a in range(k):
            part[:] = 0.0
            for w in range(places):
                off[a, w] = levels[i, a] - mean[a, w]
            for b in range(a + 1):
                for w in range(places):
                    part[w] += white[a, b, w] * off[b, w]
            for w in range(places):
                result[i, w] -= 0.5 * part[w] * part[w]
    return result


def compile_ahead() -> None:
    """Have the compiled functions ready before the first contact."""
    models = border_models(0.1, 1.0, (1.0, 1.0))
    line = np.ones((1, len(models.mean)))
    likeliest_model(line, line, *models, 1)
    scores(line, line, models.mean, models.white[0], models.log[0])
