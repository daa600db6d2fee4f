"""Flicker: light that changes from frame to frame, found in the frames' mean level and taken out.

A change d_k of frame k adds (m + a cos(phase - shift_k)) d_k to a pixel of mean m and amplitude a. Through
the fit of the shifts m d_k adds (u m, v m) to cosine and sine, with the same u and v in all pixels. The
fringes themselves average out over many turns, the more so in a window that fades at its ends: what is left
of the mean cosine and sine is u and v. They are taken out; what a d_k does is not known, and goes into sigma.
Longer periods, of which the view shows too few turns, stay as they are: they give orders, not places.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.decoding.decoding import Phasors, fit_matrices
from zeromethod.decoding.unwrapping import Places

LEAST_TURNS = 4.0
"""Turns in view from which a fringe averages out to some thousandths in a window."""

LEAST_SHARE = 0.006
"""Smaller changes are not distinguished from what is left of the fringes."""

FINEST_PX = 4.0
"""Camera px per turn from which pixels sample a fringe evenly."""

_LINES = 16

_SPREAD = 0.25
"""Variance of cos(a) sin(a) over the turn, times two: the part of a change that is not taken out."""


@dataclass(frozen=True, slots=True)
class Flicker:
    """share: change of the light from frame to frame, rms. phasors: without it."""

    share: float
    phasors: Phasors

    @property
    def phase_variance(self) -> float:
        """Variance, rad^2, that is left in every phase."""
        return _SPREAD * self.share**2 * _gain(self.phasors)

    def counted(self, place: Places) -> Places:
        """Places with what is left of the flicker in their sigma, and in what periods may disagree."""
        left = self.phase_variance
        stiffness = place.stiffness[np.isfinite(place.stiffness)]
        if left == 0.0 or not stiffness.size:
            return place
        more = left * float(np.median(stiffness)) / place.degrees
        sigma = np.sqrt(place.sigma_px**2 + np.float32(left) * place.leverage_px2)
        return replace(place, sigma_px=sigma, coherent=place.coherent + more)


def _gain(phasors: Phasors) -> float:
    """Variance of a mean cosine and sine, both together, per variance of a frame's light."""
    return float(np.sum(fit_matrices(phasors.sequence.shifts_rad)[1][1:3] ** 2)) / phasors.sequence.repeats


def _extent(x_px: Float) -> tuple[float, float]:
    """Step of the places (rows, cols) from pixel to pixel, and from end to end of the view, LCD px."""
    some = tuple(max(1, n // _LINES) for n in x_px.shape)
    lines = x_px[:: some[0]], x_px[:, :: some[1]].T
    steps = [np.abs(np.diff(line, axis=1)) for line in lines]
    usual = [float(np.median(one[np.isfinite(one)])) if np.isfinite(one).any() else np.inf for one in steps]
    return max(usual), max(usual[0] * x_px.shape[1], usual[1] * x_px.shape[0])


def find_flicker(phasors: Phasors, places: list[Places], sound: Mask) -> Flicker:
    """Flicker in the frames, by the pixels `sound` with these places along both axes."""
    none = Flicker(0.0, phasors)
    if not sound.any():
        return none
    rows, cols = (np.flatnonzero(sound.any(axis=axis)) for axis in (1, 0))
    part = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    fading = [np.hanning(n + 2)[1:-1] for n in sound[part].shape]
    window = (np.outer(*fading) * sound[part]).astype(np.float32)
    changes: list[tuple[int, int, list[float], Single]] = []
    steps_px, reach_px = zip(*(_extent(place.x_px[part]) for place in places), strict=True)
    for fringes, mean in zip(phasors.sequence.sets(), phasors.mean, strict=True):
        axis, n = int(fringes.axis == "rows"), fringes.period
        period = phasors.sequence.periods[axis][n]
        light = float(np.vdot(window, mean[part]))
        averaged = LEAST_TURNS * period <= reach_px[axis] and FINEST_PX * steps_px[axis] <= period
        if fringes.repeat or not averaged or light <= 0.0:
            continue
        found = [float(np.vdot(window, of[axis][n][part])) / light for of in (phasors.cosine, phasors.sine)]
        changes.append((axis, n, found, mean))
    squares = [sum(value**2 for value in found) for _, _, found, _ in changes]
    share = float(np.sqrt(np.mean(squares) / _gain(phasors))) if squares else 0.0
    if share < LEAST_SHARE:
        return none
    cosine, sine = ((of[0].copy(), of[1].copy()) for of in (phasors.cosine, phasors.sine))
    for axis, n, found, mean in changes:
        for of, value in zip((cosine, sine), found, strict=True):
            of[axis][n] -= np.float32(value) * mean
    return Flicker(share, replace(phasors, cosine=cosine, sine=sine))
