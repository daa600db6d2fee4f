"""Where pixels look on the LCD, read from the pictures of a burst; then at nodes, with sigma.

Every pixel is read for itself: where the mirror folds, several pixels see one place of the LCD, and each is
given its own. The phase of a period says its place up to whole periods; the order is the one for which both
periods agree, within `REACH_LCD_PX` of where the pixel is thought to look. It is checked by what lies around:
a mirror that bends does not tear, so pixels count in patches without steps, and a patch counts that reaches
out to where it is known where pixels look, and agrees. Of these a pixel that is much darker than those around
sees the gap between pixels of the LCD, and with the rest of its footprint it sees beside its middle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.pattern.coded import PERIODS_LCD_PX, SHIFTS

REACH_LCD_PX = 65.0
"""How far from where it is thought to look a pixel may look."""

AGREE_LCD_PX = 1.2
"""Most difference between the two periods' places: a wrong order is 3 or more off, noise 0.1."""

MOST_STEP_LCD_PX = 6.0
"""Most difference between neighbours: of a caustic; a wrong order is 20 or more off."""

STILL_SHARE = 0.05
"""Most difference of opposite shifts' sums, over the light of all, of a mirror at rest: five times noise."""

SURE_LCD_PX, SURE_SHARE, SURE_PIXELS = 3.0, 0.8, 20
"""A patch agrees where so many of its pixels, and such a share, see what they are known to see, to this."""

LEAST_CONTRAST = 0.1
"""Amplitude over mean light of fringes that are believed."""

RADIUS_PX, CORE_PX = 4, 3
"""Pixels around a node to which a quadratic is fitted, twice: what the fits disagree by is in sigma."""

LEAST_SHARE = 0.6
"""Of these, share that must have been read."""

EVEN_SHARE, EVEN_PX = 0.75, 7
"""Light over the mean of so many pixels along and across from which a pixel sees with all of its footprint:
where a fold squeezes that to a line, one with half the light is off by up to 1.5 LCD px."""

STAIR_LCD_PX, LEAST_SIGMA_LCD_PX = 0.29, 0.01
"""Rms by which fringes in whole LCD px are off their place, which a window over several of them averages out,
and what the panel's 8 bits leave."""

SHARED = 2.0
"""Neighbours share much of a node's error, which then counts for more where depth adds them up."""

BENT = 0.25
"""Error over second differences, LCD px, of a fit in a window where the mirror bends strongly."""


def pixel_places(pictures: Single, black_grey: float, thought: Float, sure: Mask) -> tuple[Float, Mask]:
    """Place (rows, cols, 2) LCD px that every pixel sees, and whether it is known.

    pictures: (16, rows, cols) grey, as `pattern.coded` numbers them. thought: (rows, cols, 2) LCD px, where
    the pixels are thought to look; sure: (rows, cols) where that is known.
    """
    shape = pictures.shape[1:]
    turn = np.exp(2j * np.pi * np.arange(SHIFTS) / SHIFTS)
    stacks = pictures.reshape(2, len(PERIODS_LCD_PX), SHIFTS, *shape)
    moved = np.any([moves(stack, black_grey) for stack in stacks.reshape(-1, SHIFTS, *shape)], axis=0)
    # grey = mean + a cos(phase - shift): the sum with exp(i shift) is 2 a exp(i phase) of four
    waves = np.einsum("apsij,s->apij", stacks, turn) * (2 / SHIFTS)
    light = stacks.mean(axis=2) - black_grey
    known = (np.abs(waves) > LEAST_CONTRAST * np.maximum(light, 1.0)).all(axis=(0, 1))
    known &= ~moved
    places = np.empty((*shape, 2))
    for axis in range(2):
        one, other = (
            period * np.angle(wave) / (2 * np.pi)
            for wave, period in zip(waves[axis], PERIODS_LCD_PX, strict=True)
        )
        places[..., axis], agree = _both(one, other, thought[..., axis])
        known &= agree
    joined = _joined(places, known, np.abs(places - thought).max(axis=-1), sure)
    return places, joined & _evenly_lit(light.mean(axis=(0, 1)), joined)


def moves(pictures: Single, black_grey: float) -> Mask:
    """Pixels (rows, cols) at which something moved between the four shifts of one period, (4, rows, cols).

    Opposite shifts add up to the same light: 0.3 LCD px of motion make a tenth of difference.
    """
    odd: Single = pictures[0] - pictures[1] + pictures[2] - pictures[3]
    light = pictures.sum(axis=0) - SHIFTS * black_grey
    out: Mask = np.abs(odd) > STILL_SHARE * np.maximum(light, SHIFTS)
    return out


def _joined(places: Float, known: Mask, away: Float, sure: Mask) -> Mask:
    """Pixels of patches without steps that reach out to where they agree with what is sure."""
    whole = known.copy()
    for axis in range(2):
        step = np.abs(np.diff(places, axis=axis)).max(axis=-1) > MOST_STEP_LCD_PX
        low, high = [slice(None)] * 2, [slice(None)] * 2
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        both = step & known[tuple(low)] & known[tuple(high)]
        whole[tuple(low)] &= ~both
        whole[tuple(high)] &= ~both
    count, labels = cv2.connectedComponents(whole.astype(np.uint8), connectivity=4)
    held = np.bincount(labels[sure], minlength=count)
    agree = np.bincount(labels[sure & (away < SURE_LCD_PX)], minlength=count)
    joined: Mask = (agree >= SURE_PIXELS) & (agree > SURE_SHARE * held)
    joined[0] = False
    out: Mask = joined[labels]
    return out


def _evenly_lit(light: Single, known: Mask) -> Mask:
    """Pixels (rows, cols) hardly darker than those known around them."""
    window, share = (EVEN_PX, EVEN_PX), known.astype(np.float32)
    around = cv2.blur(light * share, window)
    return np.asarray(light * cv2.blur(share, window) >= EVEN_SHARE * around)


def _both(one: Float, other: Float, thought: Float) -> tuple[Float, Mask]:
    """Place that both periods' phases, as places within them, agree on; whether they do."""
    first, second = PERIODS_LCD_PX
    orders = math.ceil(REACH_LCD_PX / first)
    start = np.rint((thought - one) / first)
    best, place = np.full(one.shape, np.inf), np.zeros(one.shape)
    for order in range(-orders, orders + 1):
        here = one + first * (start + order)
        apart = other - here
        apart -= second * np.rint(apart / second)
        better = (np.abs(apart) < best) & (np.abs(here - thought) < REACH_LCD_PX)
        best = np.where(better, np.abs(apart), best)
        # each phase is as sure as the other: a longer period is less so in px
        weight = first**2 / (first**2 + second**2)
        place = np.where(better, here + weight * apart, place)
    return place, best < AGREE_LCD_PX


def node_places(places: Float, known: Mask, nodes: Sequence[tuple[int, int]]) -> tuple[Float, Float]:
    """Places (n, 2) LCD px at nodes, and their sigma (n, 2); NaN and infinite where too little is known.

    places, known: of `pixel_places`. nodes: (row, column) of each node's pixel in them.
    """
    padded = np.pad(places, ((RADIUS_PX, RADIUS_PX), (RADIUS_PX, RADIUS_PX), (0, 0)))
    inside = np.pad(known, RADIUS_PX)
    v, u = np.mgrid[-RADIUS_PX : RADIUS_PX + 1, -RADIUS_PX : RADIUS_PX + 1].reshape(2, -1) / RADIUS_PX
    design = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=-1)
    core = np.maximum(np.abs(u), np.abs(v)) * RADIUS_PX <= CORE_PX
    side = 2 * RADIUS_PX + 1
    out, sigma = np.full((len(nodes), 2), np.nan), np.full((len(nodes), 2), np.inf)
    for k, (row, column) in enumerate(nodes):
        window = slice(row, row + side), slice(column, column + side)
        used, read = inside[window].ravel(), padded[window].reshape(-1, 2)
        if np.count_nonzero(used & core) < LEAST_SHARE * np.count_nonzero(core):
            continue
        wide = _middle(design[used], read[used])[0]
        out[k], noise, bends = _middle(design[used & core], read[used & core])
        stair = STAIR_LCD_PX / (1 + 4 * np.ptp(read[used & core], axis=0) ** 2)
        parts = noise, out[k] - wide, stair, BENT * bends, np.full(2, LEAST_SIGMA_LCD_PX)
        sigma[k] = SHARED * np.linalg.norm(parts, axis=0)
    return out, sigma


def _middle(terms: Float, read: Float) -> tuple[Float, Float, Float]:
    """A least-squares fit's value (2,) in the middle, its noise by what is left, and second differences.

    A pixel sees the mean over its area, which is (q_uu + q_vv) / 24 more than its middle.
    """
    inverse = np.linalg.pinv(terms.T @ terms)
    numbers = inverse @ (terms.T @ read)
    left = np.sum((read - terms @ numbers) ** 2, axis=0) / (len(read) - terms.shape[1])
    second = 2 * numbers[[3, 5]] / RADIUS_PX**2
    middle: Float = numbers[0] - second.sum(axis=0) / 24
    return middle, np.sqrt(left * inverse[0, 0]), np.abs(second).sum(axis=0)
