"""The next levels: those that bring the light at the detectors back to that at rest."""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float
from zeromethod.kernels import kernel, piece, read
from zeromethod.light_array.estimate import Look
from zeromethod.light_array.optics import COUNT
from zeromethod.light_array.rig import SIDE
from zeromethod.rounding import REORDERED

_PASSES = 12
"""Steps of conjugate gradients for the next levels, at most; noise alone takes one."""

_DAMPING = 0.03
"""Patterns of levels of which less than the root of this share reaches the detectors take several frames:
where the mirror gathers light, several detectors look at one LED, and it cannot show what all should."""

_COVERED = 0.75
"""Share of what a detector looks at that working LEDs must cover, so that levels can null it."""


@piece(fastmath=REORDERED)
def _sum(along: Float, across: Float, levels: Float) -> float:
    """Light that one detector sees of levels (256,)."""
    total = 0.0
    for row in range(SIDE):
        if across[row] != 0.0:
            light = 0.0
            for column in range(SIDE):
                light += along[column] * levels[SIDE * row + column]
            total += across[row] * light
    return total


@piece(fastmath=REORDERED)
def _slope(along: Float, across: Float, left: Float, gain: Float, change: Float, slope: Float) -> float:
    """Set the slope (256,) of what `_correct` makes least, and return its square."""
    for led in range(COUNT):
        slope[led] = 0.0
    for k in range(COUNT):
        for row in range(SIDE):
            share = across[k, row] * left[k]
            if share != 0.0:
                for column in range(SIDE):
                    slope[SIDE * row + column] += share * along[k, column]
    size = 0.0
    for led in range(COUNT):
        slope[led] = gain[led] * slope[led] - _DAMPING * change[led]
        size += slope[led] * slope[led]
    return size


@piece(fastmath=REORDERED)
def _correct(
    along: Float, across: Float, missing: Float, gain: Float, enough: float, change: Float, work: Float
) -> None:
    """Change of levels (256,) that adds the light `missing` at the detectors, by conjugate gradients.

    gain: of each LED, 0 for none. enough: square of the slope that noise leaves.
    """
    left, slope, way, lit, adds = work[0], work[1], work[2], work[3], work[4]
    for k in range(COUNT):
        left[k] = missing[k]
        change[k] = 0.0
    size = 0.0
    for done in range(_PASSES + 1):
        before, size = size, _slope(along, across, left, gain, change, slope)
        if size <= (enough if done else 0.0) or done == _PASSES:
            break
        power = 0.0
        for led in range(COUNT):
            way[led] = slope[led] + (size / before * way[led] if done else 0.0)
            lit[led] = gain[led] * way[led]
            power += _DAMPING * way[led] * way[led]
        for k in range(COUNT):
            adds[k] = _sum(along[k], across[k], lit) if missing[k] != 0.0 else 0.0
            power += adds[k] * adds[k]
        step = size / power
        for k in range(COUNT):  # as many LEDs as detectors
            change[k] += step * way[k]
            left[k] -= step * adds[k]


@kernel(
    read(numba.float64, 2),
    read(numba.float64, 2),
    read(numba.float64, 1),
    read(numba.float64, 1),
    read(numba.float64, 1),
    read(numba.float64, 1),
    numba.float64,
    numba.float64,
    numba.float64[::1],
    numba.float64[::1],
    numba.float64[:, ::1],
    fastmath=REORDERED,
)
def _next(
    along: Float,
    across: Float,
    missing: Float,
    gain: Float,
    shown: Float,
    newest: Float,
    share: float,
    enough: float,
    wanted: Float,
    light: Float,
    work: Float,
) -> None:
    """Set levels `wanted` and light (2,) as `next_levels` returns them; enough: of `_correct`.

    work: (9, 256), for use within.
    """
    lit, wants, lacks, change, free = work[3], work[5], work[6], work[7], work[8]
    for led in range(COUNT):
        lit[led] = 1.0 if gain[led] > 0.0 else 0.0
    for k in range(COUNT):
        wants[k] = missing[k] if _sum(along[k], across[k], lit) > _COVERED else 0.0
    for led in range(COUNT):
        lit[led] = gain[led] * (newest[led] - shown[led])
        free[led] = gain[led]
    for k in range(COUNT):
        lacks[k] = wants[k] - _sum(along[k], across[k], lit) if wants[k] != 0.0 else 0.0
    for _ in range(2):  # what LEDs at their limit cannot give, the others around them may
        _correct(along, across, lacks, free, enough, change, work)
        stuck = False
        for led in range(COUNT):
            low, high = newest[led] <= 0.0 and change[led] < 0.0, newest[led] >= 1.0 and change[led] > 0.0
            if low or high:
                free[led] = 0.0
                stuck = True
        if not stuck:
            break
    for led in range(COUNT):
        whole = min(max(newest[led] + change[led], 0.0), 1.0)
        lit[led] = gain[led] * (whole - shown[led])
        wanted[led] = min(max(newest[led] + share * change[led], 0.0), 1.0) if gain[led] > 0.0 else 0.0
    used = adds2 = wants2 = 0.0
    for k in range(COUNT):
        if wants[k] != 0.0:
            used += 1.0
            adds2 += _sum(along[k], across[k], lit) ** 2
            wants2 += wants[k] ** 2
    light[0], light[1] = math.sqrt(adds2 / max(used, 1.0)), math.sqrt(wants2 / max(used, 1.0))


def next_levels(
    at: Look, missing: Float, gain: Float, shown: Float, newest: Float, share: float, sigma: float
) -> tuple[Float, float, float]:
    """Levels (256,) that bring detectors to rest, what they can still add to a frame, and what it lacks, rms.

    Detectors that look beyond the LEDs, or at dead ones, are not counted: nothing brings them to rest.

    missing: (256,) light at the detectors, 0 where one is not used. gain: of the LEDs, 0 for those left out.
    shown, newest: levels lit in the frame, and those sent last, whose light is on its way. share: of a
    correction that is applied. sigma: noise of a reading.
    """
    enough = sigma**2 * np.vdot(at.along, at.along) * np.vdot(at.across, at.across) / COUNT
    wanted, light, work = np.empty(COUNT), np.empty(2), np.empty((9, COUNT))
    _next(at.along, at.across, missing, gain, shown, newest, share, enough, wanted, light, work)
    return wanted, float(light[0]), float(light[1])
