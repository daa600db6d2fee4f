"""Light that varies over the image: expected variation is divided out, edges of the light are flagged.

A gradient of the light across the window biases the phase in second order only, but a kink or a step does
so in first order. Variation that the optics predict is divided out before the carrier is read (`level`);
then the image is that of an evenly lit target, and all rules about light judge only what is left.

A step of the light inside the window (contact, lost reflection) moves the phase by up to 2.5 px times the
step's share of the light (near null; more elsewhere). It bends the mean from node to node: by a quarter of
the step half a period away from it, while at the step itself the two neighbours bend in opposite directions.
A linear gradient causes no bend. While the residual still varies (strain e), the carrier itself leaks e^2 of
its amplitude into the mean; the limit allows for that.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Mask, Single
from zeromethod.rig.model import Noise
from zeromethod.sensing.demodulate import FAST, Image
from zeromethod.warp.grid import PADDING
from zeromethod.warp.validity import Flag

LIGHT_LOST, OUTSIDE = int(Flag.LIGHT_LOST), int(Flag.OUTSIDE)
LARGEST_BEND = 0.02
"""Second difference of the mean over the mean; a step of more than about 10 % of the light shows."""
LARGEST_SLOPE = 0.25
"""Half the first difference of the mean over the mean: limit where strain explains the bend."""
LARGEST_STRAIN = 0.4
"""Largest strain allowed for: next to an edge the phase itself is wrong and looks like strain. 0.5 instead
keeps 0.7 % more of the steepest press, and 1.7 times the nodes that are > 2 px wrong next to a dark hole
(120 random presses with a hole each)."""
STEADY_BEND = 0.01
"""Second difference of a carrier's amplitude over it, along the other's way, of which no edge of the light is
the cause: half the bend of the mean that shows one."""


@numba.njit(cache=True)
def _bend(mean: Single, r: int, c: int, way: int) -> float:
    """Second difference along a row (way 0) or a column (1); 0 where a neighbour is OUTSIDE."""
    y, x = way, 1 - way
    rows, cols = mean.shape
    if not (PADDING + y <= r < rows - PADDING - y and PADDING + x <= c < cols - PADDING - x):
        return 0.0
    return float(mean[r - y, c - x] - 2 * mean[r, c] + mean[r + y, c + x])


@numba.njit(cache=True)
def _step(d: Float, flags: Flags, period: float, k: int, r: int, c: int, y: int, x: int) -> float:
    """Change of d, px, from node (r, c) to (y, x) to the nearest period; 0 where that one is flagged."""
    if flags[y, x] != 0:
        return 0.0
    step = d[y, x, k] - d[r, c, k]
    return float(step - period * np.rint(step / period))


@numba.njit(cache=True)
def leak(modulation: Single, d: Float, flags: Flags, period: float, r: int, c: int, way: int) -> float:
    """Largest leak of the carrier into the mean by the local strain, grey levels.

    The window of the view's last node reaches two nodes further, where none is measured: strain goes straight
    on there. That takes nothing from the other carrier, as lost light does.
    """
    leaked, y, x = 0.0, way, 1 - way
    first, last = flags[r - 2 * y, c - 2 * x] & OUTSIDE, flags[r + 2 * y, c + 2 * x] & OUTSIDE
    other = modulation[..., x]
    beyond = (first | last) and abs(_bend(other, r, c, way)) < STEADY_BEND * other[r, c]
    for k in range(2):
        before = _step(d, flags, period, k, r, c, r - y, c - x)
        after = _step(d, flags, period, k, r, c, r + y, c + x)
        step = max(abs(before), abs(after))
        if beyond and k == way:
            step = max(step, abs(3 * after + 2 * before if last else 3 * before + 2 * after))
        leaked += modulation[r, c, k] * min(step / (period / 2), LARGEST_STRAIN) ** 2
    return leaked


@numba.njit(cache=True, fastmath=FAST)
def _suspects(above: Single, row: Single, below: Single, inside: float, black: float, out: Mask) -> bool:
    """Nodes of a row with a bend or slope near the limit, by a quick test that ignores the leak; whether any.

    inside: 0 where the row has no other on one side, else 1.
    """
    bent, sloping = np.float32(0.3 * LARGEST_BEND), np.float32(1.99 * LARGEST_SLOPE)
    dark, two, known, last = np.float32(black), np.float32(2), np.float32(inside), row.size - 1
    for i in range(row.size):
        bend, slope = known * abs(above[i] - two * row[i] + below[i]), abs(below[i] - above[i])
        light = row[i] - dark
        out[i] = (bend > bent * light) | (slope > sloping * light)
    for i in range(1, last):
        bend, slope = abs(row[i - 1] - two * row[i] + row[i + 1]), abs(row[i + 1] - row[i - 1])
        light = row[i] - dark
        out[i] |= (bend > bent * light) | (slope > sloping * light)
    found = False
    for i in range(row.size):
        found |= out[i]
    return found


@numba.njit(cache=True)
def _is_edge(
    mean: Single, modulation: Single, d: Float, flags: Flags, black: float, period: float, r: int, c: int
) -> bool:
    """Whether a node lies next to an edge of the light."""
    light = max(mean[r, c] - black, 0.0)
    for way in range(2):
        y, x = way, 1 - way
        if flags[r - y, c - x] & OUTSIDE or flags[r + y, c + x] & OUTSIDE:
            continue
        bend, slope = abs(_bend(mean, r, c, way)), 0.5 * abs(mean[r + y, c + x] - mean[r - y, c - x])
        if bend <= LARGEST_BEND * light:
            before = _bend(mean, r - y, c - x, way)
            if abs(before) > LARGEST_BEND * light:
                after = _bend(mean, r + y, c + x, way)
                if before * after < 0:
                    bend = min(abs(before), abs(after))
        if bend <= LARGEST_BEND * light and slope <= LARGEST_SLOPE * light:
            continue
        leaked = leak(modulation, d, flags, period, r, c, way)
        if bend > LARGEST_BEND * light + 4 * leaked or slope > LARGEST_SLOPE * light + 2 * leaked:
            return True
    return False


@numba.njit(cache=True)
def flag_light_edges(
    mean: Single, modulation: Single, d: Float, flags: Flags, black: float, period: float, near: Mask
) -> None:
    """Add LIGHT_LOST to nodes next to an edge of the light. Arrays as in `Residual`, d still wrapped.

    near: (rows, cols) work space, False in the padding.
    """
    first, last, end = PADDING, flags.shape[0] - PADDING - 1, flags.shape[1] - PADDING
    rows = np.zeros(flags.shape[0], np.bool_)
    for r in range(first, last + 1):
        above, below = mean[max(r - 1, first), first:end], mean[min(r + 1, last), first:end]
        inside = 1.0 if first < r < last else 0.0
        rows[r] = _suspects(above, mean[r, first:end], below, inside, black, near[r, first:end])
    for r in range(first, last + 1):
        if not (rows[r - 1] or rows[r] or rows[r + 1]):
            continue
        for c in range(first, end):
            if flags[r, c] & LIGHT_LOST:
                continue
            # an edge at the node itself bends its neighbours alone
            around = near[r, c] | near[r - 1, c] | near[r + 1, c] | near[r, c - 1] | near[r, c + 1]
            if around and _is_edge(mean, modulation, d, flags, black, period, r, c):
                flags[r, c] |= LIGHT_LOST


@numba.njit(cache=True, fastmath=True)
def level(image: Image, share: Single, black: float, ceiling: int, out: Single) -> None:
    """Grey levels (rows, cols) at light share 1, in `out`; clipped pixels stay at the ceiling.

    Pixels that reach the ceiling only by levelling stay just below it, so that they do not count as clipped.
    """
    dark, most = np.float32(black), np.float32(ceiling - 1)
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            grey = np.float32(image[row, col])
            levelled = min(dark + (grey - dark) / share[row, col], most)
            out[row, col] = grey if image[row, col] >= ceiling else levelled


def noise_factor(mean_grey: Single, share: Single, noise: Noise) -> Float:
    """Standard deviation of levelled grey over that of an equally bright image; arrays of one shape.

    Levelling by s multiplies the variance of read noise by 1/s^2 and of shot noise by 1/s.
    """
    still = noise.read_grey**2 + 1 / 12
    per_grey = 0.0 if noise.electrons_per_grey is None else 1.0 / noise.electrons_per_grey
    light = per_grey * np.maximum(mean_grey.astype(float) - noise.black_grey, 0.0)
    factor: Float = np.sqrt((still / share**2 + light / share) / (still + light))
    return factor
