"""Latency, scan-out and rise of a panel, from frames taken while its picture changes.

Each frame after a change shows how much of the new light its exposure saw, band by band down the panel's
rows: `pairing.lit_share` of the panel's timing. Camera and panel run on clocks of their own, so that frames
fall on every part of the change, and the timing follows by least squares. Where they run in step, frames fall
on few parts of it; sigma then says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from zeromethod.arrays import Float, Mask
from zeromethod.errors import MeasurementError
from zeromethod.exposure.pairing import PanelTiming, lit_share

LEAST_FRAMES = 8
"""Frames within a change that a result needs."""

LEAST_BANDS = 2
LEAST_SWING = 10.0
"""Change of a band's grey, over its scatter while the picture does not change, that makes it usable."""

KNOWN_SCANOUT_S = 1e-3
KNOWN_RISE_S = 5e-4
KNOWN_RISE_SHARE = 0.2
"""Standard deviations below which scan-out and rise count as known."""

_OUTLIER_SIGMAS = 5.0
_LEAST_TAU_S = 1e-5
_LEAST_SIGMA_S = 1e-9
_LOG9 = math.log(9.0)


@dataclass(frozen=True)
class PanelSteps:
    """Frames during changes between two evenly lit pictures.

    since_s: (n,) mid-exposure less the change's presentation. exposure_s: (n,). rising: (n,) towards the
    brighter picture. grey: (n, bands) mean of each band of rows, NaN where it is not seen. place: (bands,)
    of the band's middle, 0 at the first row of the panel, 1 at the last.
    """

    since_s: Float
    exposure_s: Float
    rising: Mask
    grey: Float
    place: Float


@dataclass(frozen=True)
class StepTiming:
    """Timing of the panel with standard deviations, s.

    latency_s: presentation to the first scanned row's beginning, by the camera's stamps. scanout_s: to the
    last row's. upwards: the last row is scanned first. rise_s, fall_s: 10 to 90 % towards bright and towards
    dark. frames: taken during a change.
    """

    latency_s: float
    latency_sigma_s: float
    scanout_s: float
    scanout_sigma_s: float
    upwards: bool
    rise_s: float
    rise_sigma_s: float
    fall_s: float
    fall_sigma_s: float
    frames: int

    @property
    def mean_rise_s(self) -> float:
        """One time for both directions, weighted by what is known of each; NaN: nothing is."""
        a, b = self.rise_sigma_s**-2, self.fall_sigma_s**-2
        return (a * self.rise_s + b * self.fall_s) / (a + b) if a + b > 0 else math.nan

    @property
    def mean_rise_sigma_s(self) -> float:
        """Its standard deviation; what the directions differ by is not in it."""
        known = self.rise_sigma_s**-2 + self.fall_sigma_s**-2
        return float(known**-0.5) if known > 0 else math.inf

    def rig_values(self) -> dict[str, float | str]:
        """Keys and values for `save_values`, of what is known well enough to replace a data sheet's."""
        values: dict[str, float | str] = {}
        if self.scanout_sigma_s < KNOWN_SCANOUT_S:
            values["display.scanout_s"] = round(self.scanout_s, 6)
            values["display.scan"] = "up" if self.upwards else "down"
        least_s = KNOWN_RISE_SHARE * min(self.rise_s, self.fall_s)
        if self.mean_rise_sigma_s < max(KNOWN_RISE_S, least_s):
            values["display.rise_s"] = round(self.mean_rise_s, 6)
        return values


def fit_steps(steps: PanelSteps, timing: PanelTiming) -> StepTiming:
    """Timing by least squares; `timing` is where the search for scan-out and rise begins.

    Raises MeasurementError where too few frames fall on a change, or none can be made out.
    """
    seen = _changing(steps)
    if np.count_nonzero(seen) < LEAST_BANDS:
        raise MeasurementError("panel timing: the camera does not see the panel change")
    grey, place = steps.grey[:, seen], steps.place[seen]
    start = _start(steps, grey, place, timing)
    used = np.ones(len(grey), bool)
    for _ in range(2):
        found = least_squares(
            lambda p, used: _misfit(p, steps, grey, place, used).ravel(),
            start,
            x_scale=1e-3,
            method="lm",
            args=(used,),
        )
        start = found.x
        misfit = np.sqrt(np.mean(_misfit(start, steps, grey, place, np.ones_like(used)) ** 2, axis=1))
        used = misfit <= _OUTLIER_SIGMAS * max(float(np.median(misfit)), 1e-6)
    shares = _shares(start, steps, place)[used]
    inside = int(np.count_nonzero(((shares > 0.02) & (shares < 0.98)).any(axis=1)))
    if inside < LEAST_FRAMES:
        raise MeasurementError(
            f"panel timing: {inside} frames fall on a change of picture, {LEAST_FRAMES} are needed: measure "
            "longer, or let camera and panel run at other rates"
        )
    return _timing(start, _sigmas(found.jac, found.fun, len(place)), inside)


def _changing(steps: PanelSteps) -> Mask:
    """(bands,) whose grey follows the picture: late frames of rises are brighter than those of falls."""
    late = steps.since_s > 0.75 * steps.since_s.max()
    up, down = steps.grey[late & steps.rising], steps.grey[late & ~steps.rising]
    if len(up) < 2 or len(down) < 2:
        return np.zeros(len(steps.place), bool)
    scatter = np.hypot(up.std(axis=0), down.std(axis=0))
    swing: Float = up.mean(axis=0) - down.mean(axis=0)
    return np.asarray(swing > np.maximum(LEAST_SWING * scatter, 1e-6))


def _timing(found: Float, sigma: Float, frames: int) -> StepTiming:
    latency, scanout, rise, fall = found
    return StepTiming(
        latency_s=float(min(latency, latency + scanout)),
        latency_sigma_s=float(sigma[0]),
        scanout_s=float(abs(scanout)),
        scanout_sigma_s=float(sigma[1]),
        upwards=bool(scanout < 0),
        rise_s=float(abs(rise) * _LOG9),
        rise_sigma_s=float(sigma[2] * _LOG9),
        fall_s=float(abs(fall) * _LOG9),
        fall_sigma_s=float(sigma[3] * _LOG9),
        frames=frames,
    )


def _shares(parameters: Float, steps: PanelSteps, place: Float) -> Float:
    """(n, bands) share of the new picture's light in each exposure."""
    latency, scanout, rise, fall = parameters
    change = latency + scanout * place
    start, end = (steps.since_s + side * steps.exposure_s for side in (-0.5, 0.5))
    out = np.empty((len(start), len(place)))
    for mine, tau in ((steps.rising, rise), (~steps.rising, fall)):
        out[mine] = lit_share(start[mine, None], end[mine, None], change, max(abs(tau), _LEAST_TAU_S))
    return out


def _misfit(parameters: Float, steps: PanelSteps, grey: Float, place: Float, used: Mask) -> Float:
    """(frames used, bands) grey less the model's over the band's swing; black and white are fitted in it."""
    lit = _shares(parameters, steps, place)
    lit = np.where(steps.rising[:, None], lit, 1.0 - lit)[used]
    seen = grey[used]
    mean_lit, mean_seen = lit.mean(axis=0), seen.mean(axis=0)
    away = lit - mean_lit
    square = np.sum(away**2, axis=0)
    swing = np.sum(away * (seen - mean_seen), axis=0) / np.maximum(square, 1e-12)
    # where the model sees no change at all, everything seen is misfit
    whole = np.ptp(grey, axis=0)
    return np.asarray((seen - mean_seen - swing * away) / whole)


def _start(steps: PanelSteps, grey: Float, place: Float, timing: PanelTiming) -> Float:
    """Best of a lattice of latencies, scanned either way."""
    tau = max(1e-9 * timing.tau_ns, 1e-3)
    scanout = 1e-9 * timing.scanout_ns
    step = 0.25 * float(np.median(steps.exposure_s)) + 1e-3
    every = np.ones(len(grey), bool)
    best, least = np.zeros(4), math.inf
    for latency in np.arange(-scanout, float(steps.since_s.max()), step):
        for signed in (scanout, -scanout):
            first = latency if signed >= 0 else latency + scanout
            trial = np.array([first, signed, tau, tau])
            cost = float(np.sum(_misfit(trial, steps, grey, place, every) ** 2))
            if cost < least:
                best, least = trial, cost
    return best


def _sigmas(jacobian: Float, misfit: Float, bands: int) -> Float:
    """Standard deviations; bands of one frame share its stamp's error, and count as one."""
    freedom = max(misfit.size - jacobian.shape[1] - 2 * bands, 1)
    variance = bands * float(np.sum(misfit**2)) / freedom
    normal = jacobian.T @ jacobian
    if np.linalg.cond(normal) > 1e12:
        return np.full(jacobian.shape[1], np.inf)
    return np.asarray(np.sqrt(variance * np.diag(np.linalg.inv(normal))) + _LEAST_SIGMA_S)
