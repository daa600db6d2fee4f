"""From a frame and what was lit while it was exposed to the warp that it measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Mask
from zeromethod.devices.protocols import Frame
from zeromethod.exposure.mixture import unmix
from zeromethod.exposure.pairing import Shown
from zeromethod.loop.islands import doubtful
from zeromethod.sensing.residual import Residual
from zeromethod.warp.compose import compose
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag
from zeromethod.warp.warp import Warp

SUDDEN_PERIODS = 0.25
"""Change between frames, in carrier periods, above which orders known before may have slipped."""

_MIXED = np.uint16(Flag.MIXED)
_AMBIGUOUS = np.uint16(Flag.AMBIGUOUS)


@dataclass(frozen=True, slots=True)
class Observation:
    """A frame, the warp shown in it, and how far what was seen is from the target.

    residual: against the mix shown.q, that is with the mixture's bias taken out of what was read. Its sigma
    needs nothing of the kind: it goes by the carrier's amplitude as found, which the mixing has lowered.
    """

    frame: Frame
    shown: Shown
    residual: Residual


@numba.njit(cache=True)
def _blank(q: Float, flags: Flags) -> None:
    for j in range(flags.shape[0]):
        for i in range(flags.shape[1]):
            if flags[j, i]:
                q[j, i, 0] = math.nan
                q[j, i, 1] = math.nan


@numba.njit(cache=True)
def _propagate(shown: Float, sigma_px: Float, inverse_spacing: float, sigma: Float) -> None:
    """sigma_i^2 = sum_j (dq_i/du_j sigma_j)^2, central differences (one-sided at the grid's edge)."""
    rows, cols = shown.shape[0], shown.shape[1]
    for j in range(rows):
        j0, j1 = max(j - 1, 0), min(j + 1, rows - 1)
        dv = inverse_spacing / (j1 - j0)
        for i in range(cols):
            i0, i1 = max(i - 1, 0), min(i + 1, cols - 1)
            du = inverse_spacing / (i1 - i0)
            su, sv = sigma_px[j, i, 0], sigma_px[j, i, 1]
            if not (math.isfinite(su) and math.isfinite(sv)):
                sigma[j, i, 0] = sigma[j, i, 1] = math.inf
                continue
            for k in range(2):
                a = du * (shown[j, i1, k] - shown[j, i0, k]) * su
                b = dv * (shown[j1, i, k] - shown[j0, i, k]) * sv
                sigma[j, i, k] = math.sqrt(a * a + b * b)


@numba.njit(cache=True)
def _expected(shown: Float, known: Float, trusted: Mask, inverse_spacing: float, out: Float) -> None:
    """Solve to first order shown((u, v) + d) = known for d, camera px; NaN where not trusted."""
    rows, cols = shown.shape[0], shown.shape[1]
    for j in range(rows):
        j0, j1 = max(j - 1, 0), min(j + 1, rows - 1)
        dv = inverse_spacing / (j1 - j0)
        for i in range(cols):
            i0, i1 = max(i - 1, 0), min(i + 1, cols - 1)
            du = inverse_spacing / (i1 - i0)
            out[j, i, 0] = out[j, i, 1] = math.nan
            if trusted[j, i]:
                xu, yu = du * (shown[j, i1, 0] - shown[j, i0, 0]), du * (shown[j, i1, 1] - shown[j, i0, 1])
                xv, yv = dv * (shown[j1, i, 0] - shown[j0, i, 0]), dv * (shown[j1, i, 1] - shown[j0, i, 1])
                area = xu * yv - xv * yu
                if area != 0.0:
                    dx, dy = known[j, i, 0] - shown[j, i, 0], known[j, i, 1] - shown[j, i, 1]
                    out[j, i, 0] = (yv * dx - xv * dy) / area
                    out[j, i, 1] = (xu * dy - yu * dx) / area


@numba.njit(cache=True)
def _changes(d: Float, expected: Float, flags: Flags, seen: Mask) -> tuple[float, int]:
    """(largest |d - expected| over valid nodes, how many nodes seen at rest are not valid)."""
    largest = 0.0
    missing = 0
    for j in range(flags.shape[0]):
        for i in range(flags.shape[1]):
            if flags[j, i] == 0:
                for k in range(2):
                    change = abs(d[j, i, k] - expected[j, i, k])
                    if change > largest:  # noqa: PLR1730 - max() would let NaN (no expectation) through
                        largest = change
            else:
                missing += seen[j, i]
    return largest, missing


def expected_residual(shown: Shown, known_q: Float, trusted: Mask, rest: Rest) -> Float:
    """Residual (rows, cols, 2) px that the next frame should have if nothing moved; NaN if not `trusted`.

    known_q: (rows, cols, 2) LCD px where the nodes looked last. It settles the order of regions that are
    cut off from the border of the view.
    """
    out = np.empty_like(known_q)
    _expected(shown.q, known_q, trusted, 1 / rest.grid.spacing_px, out)
    return out


def unmixed(residual: Residual, shown: Shown, grid: NodeGrid) -> Residual:
    """Residual against the mix, from the one read by the sensor; shares all but d with it."""
    if shown.mixture is None or shown.mixture.bias_px is None:
        return residual
    return replace(residual, d=unmix(residual.d, shown.mixture.bias_px, grid.spacing_px))


def measure(seen: Observation, rest: Rest, expected: Float, trusted: Mask) -> Warp:
    """Measured warp q(u, v) = q_shown((u, v) + d) at mid-exposure, with sigma in LCD px and flags.

    expected, trusted: as for `expected_residual`. Flags are the residual's, those of rest (NO_RAY), those
    of the warp itself, MIXED, and AMBIGUOUS for islands whose order is not known. q is NaN where the
    residual means nothing. Delay does not enter: the measurement is absolute. sigma is noise alone; after
    a sudden press the residual bends within the window and is off by up to tenths of a px until the next
    picture (`sensing.window.curvature_bias_px2`).

    Convention: residual d as observed(u, v) = T((u, v) + d), camera px.
    """
    grid = rest.grid
    residual = seen.residual
    q = compose(seen.shown.q, residual.d, grid.spacing_px)
    flags = residual.flags | rest.flags
    _blank(q, flags)
    flags |= warp_flags(q, rest.q, grid.period_px, rest.display_size, spacing_px=grid.spacing_px)
    if seen.shown.mixture is not None:
        flags[seen.shown.mixture.mixed] |= _MIXED
    change, missing = _changes(residual.d, expected, flags, rest.seen)
    if missing:
        sudden = change > SUDDEN_PERIODS * grid.period_px
        doubt = doubtful(flags == 0, np.zeros_like(trusted) if sudden else trusted)
        if doubt is not None:
            flags[doubt] |= _AMBIGUOUS
    sigma = np.empty_like(q)
    _propagate(seen.shown.q, residual.sigma, 1 / grid.spacing_px, sigma)
    return Warp(q, sigma, flags, seen.frame.time_ns)
