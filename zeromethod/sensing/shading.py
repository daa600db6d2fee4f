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

import cv2
import numba
import numpy as np

from zeromethod.arrays import Flags, Float, Image, Ints, Mask, Single
from zeromethod.kernels import kernel, piece, read
from zeromethod.rig.model import Noise
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import INNER, PADDING
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


@piece
def _bend(values: Single, r: int, c: int, k: int, way: int) -> float:
    """Second difference of component k along a row (way 0) or column (1); 0 where a neighbour is OUTSIDE."""
    y, x = way, 1 - way
    rows, cols = values.shape[:2]
    if not (PADDING + y <= r < rows - PADDING - y and PADDING + x <= c < cols - PADDING - x):
        return 0.0
    return float(values[r - y, c - x, k] - 2 * values[r, c, k] + values[r + y, c + x, k])


@piece
def _leak(modulation: Single, d: Float, flags: Flags, period: float, r: int, c: int, way: int) -> float:
    """Largest leak of the carrier into the mean by the local strain, grey levels.

    The window of the view's last node reaches two nodes further, where none is measured: strain goes straight
    on there. That takes nothing from the other carrier, as lost light does.
    """
    leaked, y, x = 0.0, way, 1 - way
    first, last = flags[r - 2 * y, c - 2 * x] & OUTSIDE, flags[r + 2 * y, c + 2 * x] & OUTSIDE
    beyond = (first | last) and abs(_bend(modulation, r, c, x, way)) < STEADY_BEND * modulation[r, c, x]
    for k in range(2):
        before = after = 0.0  # changes of d to the nearest period, unless the neighbour is flagged
        if flags[r - y, c - x] == 0:
            before = d[r - y, c - x, k] - d[r, c, k]
            before -= period * np.rint(before / period)
        if flags[r + y, c + x] == 0:
            after = d[r + y, c + x, k] - d[r, c, k]
            after -= period * np.rint(after / period)
        step = max(abs(before), abs(after))
        if beyond and k == way:
            step = max(step, abs(3 * after + 2 * before if last else 3 * before + 2 * after))
        leaked += modulation[r, c, k] * min(step / (period / 2), LARGEST_STRAIN) ** 2
    return leaked


@kernel(
    read(numba.float32, 3), read(numba.float64, 3), read(numba.uint16, 2), read(numba.int64, 1),
    read(numba.int64, 1), numba.float64, numba.int64, numba.float64[::1],
)  # fmt: skip
def _leaks(
    modulation: Single, d: Float, flags: Flags, r: Ints, c: Ints, period: float, way: int, out: Float
) -> None:
    for n in range(len(r)):
        out[n] = _leak(modulation, d, flags, period, r[n], c[n], way)


def leaks(residual: Residual, period_px: float, r: Ints, c: Ints, way: int) -> Float:
    """Largest leak (n,) of the carrier into the mean at nodes r, c along a row (way 0) or a column."""
    out = np.empty(len(r))
    _leaks(residual.modulation, residual.d, residual.flags, r, c, period_px, way, out)
    return out


def _suspects(mean: Single, black: float) -> Mask:
    """Measured nodes with a bend or slope near the limit, by a quick test that ignores the leak."""
    light = mean - np.float32(black)
    bent, sloping, twice = 0.3 * LARGEST_BEND * light, 1.99 * LARGEST_SLOPE * light, 2 * mean
    near = np.zeros(mean.shape, np.bool_)
    for first, middle, last in (
        ((slice(None, -2),), (slice(1, -1),), (slice(2, None),)),
        ((..., slice(None, -2)), (..., slice(1, -1)), (..., slice(2, None))),
    ):
        near[middle] |= np.abs(mean[first] + mean[last] - twice[middle]) > bent[middle]
        near[middle] |= np.abs(mean[last] - mean[first]) > sloping[middle]
    # the first and last row have another on one side alone
    near[0] |= np.abs(mean[1:2] - mean[0]).max(axis=0, initial=0.0) > sloping[0]
    near[-1] |= np.abs(mean[-2:-1] - mean[-1]).max(axis=0, initial=0.0) > sloping[-1]
    return near


@kernel(
    read(numba.float32, 3),
    read(numba.float32, 3),
    read(numba.float64, 3),
    read(numba.int64, 1),
    numba.float64,
    numba.float64,
    numba.uint16[:, ::1],
)
def _flag_edges(
    mean: Single, modulation: Single, d: Float, nodes: Ints, black: float, period: float, flags: Flags
) -> None:
    """Add LIGHT_LOST to those of the nodes, by their flat index, that lie next to an edge of the light.

    mean: (rows, cols, 1).
    """
    for node in nodes:
        r, c = node // flags.shape[1], node % flags.shape[1]
        light = max(mean[r, c, 0] - black, 0.0)
        for way in range(2):
            y, x = way, 1 - way
            if flags[r - y, c - x] & OUTSIDE or flags[r + y, c + x] & OUTSIDE:
                continue
            bend, slope = (
                abs(_bend(mean, r, c, 0, way)),
                0.5 * abs(mean[r + y, c + x, 0] - mean[r - y, c - x, 0]),
            )
            if bend <= LARGEST_BEND * light:
                before, after = _bend(mean, r - y, c - x, 0, way), _bend(mean, r + y, c + x, 0, way)
                if abs(before) > LARGEST_BEND * light and before * after < 0:
                    bend = min(abs(before), abs(after))
            if bend <= LARGEST_BEND * light and slope <= LARGEST_SLOPE * light:
                continue
            leaked = _leak(modulation, d, flags, period, r, c, way)
            if bend > LARGEST_BEND * light + 4 * leaked or slope > LARGEST_SLOPE * light + 2 * leaked:
                flags[r, c] |= LIGHT_LOST
                break


def flag_light_edges(
    mean: Single, modulation: Single, d: Float, flags: Flags, black: float, period: float
) -> None:
    """Add LIGHT_LOST to nodes next to an edge of the light. Arrays as in `Residual`, d still wrapped."""
    near = np.zeros(flags.shape, np.bool_)
    near[INNER] = _suspects(mean[INNER], black)
    if near.any():
        # an edge at the node itself bends its neighbours alone
        around = cv2.dilate(near.view(np.uint8), cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3)))
        unknown = around.view(np.bool_)[INNER] & ((flags[INNER] & np.uint16(LIGHT_LOST)) == 0)
        r, c = np.nonzero(unknown)
        nodes = (r + PADDING) * flags.shape[1] + c + PADDING
        _flag_edges(mean[..., None], modulation, d, nodes, black, period, flags)


def level(image: Image, share: Single, black: float, ceiling: int, out: Single) -> None:
    """Grey levels (rows, cols) at light share 1, in `out`; clipped pixels stay at the ceiling.

    Pixels that reach the ceiling only by levelling stay just below it, so that they do not count as clipped.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        np.divide(image - np.float32(black), share, out=out)
    out += np.float32(black)
    np.minimum(out, np.float32(ceiling - 1), out=out)
    if image.max() >= ceiling:
        np.copyto(out, image, where=image >= ceiling)


def noise_factor(mean_grey: Single, share: Single, noise: Noise) -> Float:
    """Standard deviation of levelled grey over that of an equally bright image; arrays of one shape.

    Levelling by s multiplies the variance of read noise by 1/s^2 and of shot noise by 1/s.
    """
    still = noise.read_grey**2 + 1 / 12
    per_grey = 0.0 if noise.electrons_per_grey is None else 1.0 / noise.electrons_per_grey
    light = per_grey * np.maximum(mean_grey.astype(float) - noise.black_grey, 0.0)
    factor: Float = np.sqrt((still / share**2 + light / share) / (still + light))
    return factor
