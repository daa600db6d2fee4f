"""Motion within the last frames: how far ahead of their mean nodes are in the newest one.

What a node's coarse readings do over the frames is fitted by a line, a parabola or a cubic in time, whose end
is where the node is now. They are noisier than the mean, by 2, 3 and 4, and so they are fitted only if
something moves: all over the view then, as motion that a node's noise hides adds up to depth. A line counts
as seen if its coefficients are beyond chance in the mean square over some nodes, against that of the view, or
in the mean over more, against what that scatters by.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single

MOST_DEGREE = 3
"""Largest degree of the polynomial in time."""
POOL_NODES = 9
"""Nodes along each side over which scatter is averaged."""
INDEPENDENT = 9.0
"""Nodes that share their noise, as their windows overlap (`warp.overlap.shared_nodes`)."""
_BROAD_NODES = 13
"""Nodes along each side in whose mean motion is looked for."""
_SEEN = 5.0
"""Standard deviations of chance beyond which motion is seen."""
_LEFT_S = 1e-5
"""Standard deviation of a lateness that pictures in single pixels leave."""
_FEW = 18
"""Frames below which they are too few to tell waves from motion."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Readings by the constant, perhaps waves (`_waves`), and powers of time beside those.

    excess: (rows, cols) sum over readings of the mean square along u and v, less constant and waves.
    powers: (MOST_DEGREE, rows, cols, 2) coefficients of the orthonormal powers, from degree 1 on. free:
    readings less unknowns but for the powers. left: (MOST_DEGREE + 1,) share of the square of each power that
    those before it leave.
    """

    excess: Float
    powers: Single
    free: float
    left: Float

    @classmethod
    def of(cls, still: Single, basis: Float) -> Fit:
        """Of `Readings.still`; basis: (2, rows, N, k), the powers last."""
        q, r = np.linalg.qr(basis)
        found = np.swapaxes(q, -1, -2).astype(np.float32) @ still
        first = basis.shape[-1] - MOST_DEGREE - 1
        excess = 0.5 * ((still**2).sum(axis=(0, 2)) - (found[:, :, :first] ** 2).sum(axis=(0, 2)))
        powers = np.moveaxis(found[:, :, first:-1], (0, 2), (-1, 0))
        left = (np.diagonal(r, axis1=-2, axis2=-1)[..., first:] ** 2).mean(axis=(0, 1))
        return cls(excess.astype(np.float64), powers, float(still.shape[2] - first), left)


@dataclass(frozen=True, slots=True)
class Readings:
    """Coarse readings of the frames against the same warp.

    still: (2, rows, N, cols) less their mean, over their noise, along u and v; 0 off `good`, (rows, cols).
    powers: (N, MOST_DEGREE + 2) orthonormal ones of time. fits: without the waves of a fine shape, and beside
    them.
    """

    still: Single
    good: Mask
    powers: Float
    fits: tuple[Fit, Fit]

    @classmethod
    def of(cls, d: Float, variance: Float, valid: Mask, turns: Float, times: Float) -> Readings:
        """Of displacements d (N, rows, cols, 2), px, of variance (rows, cols, 2); valid: (rows, cols).

        turns: (N, rows, 2) phases of the target, rad. times: (N,), in any unit.
        """
        good = valid & np.isfinite(d).all(axis=(0, -1)) & np.isfinite(variance).all(axis=-1)
        noise = np.sqrt(np.where(good[..., None], variance, 1.0))
        off = np.where(good[..., None], (d - d.mean(axis=0)) / noise, 0.0).astype(np.float32)
        still = np.ascontiguousarray(np.moveaxis(off, (-1, 1), (0, 1)))
        powers = powers_of_time(times, MOST_DEGREE + 1)
        every = np.broadcast_to(powers, (2, turns.shape[1], *powers.shape))
        waves = np.concatenate([every[..., :1], _waves(turns), every[..., 1:]], axis=-1)
        return cls(still, good, powers, (Fit.of(still, every), Fit.of(still, waves)))

    def around(self, nodes: int = POOL_NODES) -> Float:
        """(rows, cols) good nodes among so many along each side around, 1 at least."""
        return np.maximum(pooled(self.good.astype(np.float64), nodes), 1.0)


@dataclass(frozen=True, slots=True)
class Motion:
    """The polynomial in time by which nodes are read.

    degree: 0 where nothing moves. ends: (N,) weights of the frames' readings in its end. ahead: (rows, cols,
    2) by which that is off the readings' mean of given weights. excess: (2,) variance of the end over that of
    one frame, less that of the mean.
    """

    degree: int
    ends: Float
    ahead: Float
    excess: Float

    @classmethod
    def of(cls, seen: Readings, variance: Float, weights: Float) -> Motion:
        """Of readings each of variance (rows, cols, 2), px^2. weights: (2, N) of those in the mean."""
        degree = _degree(seen)
        basis = seen.powers[:, : degree + 1]
        ends = basis @ basis[-1]
        if not degree:
            return cls(0, ends, np.zeros(variance.shape), np.zeros(2))
        ahead = np.einsum("kt,krtc->rck", ends - weights, seen.still)
        ahead *= np.where(seen.good[..., None], np.sqrt(variance), 0.0)
        return cls(degree, ends, ahead, np.maximum((ends**2).sum() - (weights**2).sum(axis=1), 0.0))


def _degree(seen: Readings) -> int:
    """Degree of the polynomial that readings ask for."""
    plain, beside = seen.fits
    # where more than a polynomial is left, it may be what a fine shape scatters by
    left = plain.excess - 0.5 * (plain.powers**2).sum(axis=(0, -1))
    free, nodes = plain.free - MOST_DEGREE, seen.around()
    rough = pooled(left) / nodes > free + _SEEN * np.sqrt(free * INDEPENDENT / nodes)
    found, chance2 = np.where(rough[..., None], beside.powers, plain.powers), _chance2(seen)
    for degree in range(MOST_DEGREE, 0, -1):
        one = found[degree - 1]
        energy = pooled(0.5 * (one**2).sum(axis=-1)) / nodes
        sums = np.stack([pooled(one[..., axis], _BROAD_NODES) for axis in (0, 1)])
        # noise drifts a little, too: what the loop shows of earlier frames' noise stays for some of them
        usual = max(float(np.median(energy[seen.good])), 1.0) if seen.good.any() else 1.0
        if (energy > usual * _most_by_chance(2.0 * nodes / INDEPENDENT))[seen.good].any():
            return degree
        if (sums**2 > _SEEN**2 * chance2)[:, seen.good].any():
            return degree
    return 0


def _most_by_chance(count: Float) -> Float:
    """Mean square of so many (rows, cols) numbers of variance 1 that is as rare as `_SEEN` of one.

    By Wilson and Hilferty: squares have more large ones than their own standard deviation says.
    """
    spread2 = 2.0 / (9.0 * count)
    return np.asarray((1.0 - spread2 + _SEEN * np.sqrt(spread2)) ** 3)


def _chance2(seen: Readings) -> Float:
    """(2, rows, cols) variance of sums over `_BROAD_NODES` along u and v: of noise, or what they scatter by.

    What frames have in common, as the noise of their lateness, is not in that of nodes.
    """
    noise2, powers = INDEPENDENT * seen.around(_BROAD_NODES), seen.powers[:, : MOST_DEGREE + 1]
    out = []
    for one in seen.still:
        sums = pooled(np.ascontiguousarray(np.moveaxis(one, 1, -1)), _BROAD_NODES)
        left = (sums**2).sum(axis=-1) - ((sums @ powers) ** 2).sum(axis=-1)
        out.append(np.maximum(left / (len(powers) - powers.shape[1]), noise2))
    return np.stack(out)


def left_late_s(d: Float, per_late: Float, valid: Mask, times: Float) -> float:
    """Lateness, s, that readings d (N, rows, cols, 2), px, still have all over the view.

    A few us of it at the target's turns look like a line in time where a view has few nodes to average.
    per_late: (N, rows, cols, 2) px/s. valid: (rows, cols). times: (N,), in any unit.
    """
    if not valid.any():
        return 0.0
    # the median: what touches some of the view is no lateness
    both = np.stack([np.nanmedian(one[:, valid], axis=1) for one in (d, per_late)])
    powers = powers_of_time(times, MOST_DEGREE)
    seen, late = both - powers @ (powers.T @ both)
    noise2 = (seen**2).mean() + 1e-12
    return float((late * seen).sum() / ((late**2).sum() + noise2 / _LEFT_S**2))


def seen_motion(
    d: Float, per_late: Float, variance: Float, valid: Mask, turns: Float, times: Float, weights: Float
) -> tuple[Readings, Motion]:
    """Readings without the lateness that they still have, and their motion; see there for the arguments."""

    def judged(*parts: slice) -> tuple[Readings, Motion]:
        """With each part of the view's rows as late as it is by itself."""
        timely = d.copy()
        for of in parts:
            timely[:, of] -= left_late_s(d[:, of], per_late[:, of], valid[of], times) * per_late[:, of]
        seen = Readings.of(timely, variance, valid, turns, times)
        return seen, Motion.of(seen, variance, weights)

    whole = judged(slice(None))
    if not whole[1].degree:
        return whole
    # halves of a view come late by different times where the panel's rate is not quite the rig file's
    middle = d.shape[1] // 2
    halves = judged(slice(middle), slice(middle, None))
    return whole if halves[1].degree else halves


def powers_of_time(times: Float, degree: int) -> Float:
    """(N, degree + 1) orthonormal polynomials of times (N,), in any unit."""
    first, last = times[0], times[-1]
    powers = ((2.0 * times - first - last) / (last - first))[:, None] ** np.arange(degree + 1)
    return np.asarray(np.linalg.qr(powers)[0])


def _waves(turns: Float) -> Float:
    """(2, rows, N, k) waves of time that a fine shape makes along u and v; none where frames are few.

    They are of the target's phases p along the same axis, and of 2 p and p +- q. turns: (N, rows, 2), rad.
    """
    own, other = np.moveaxis(turns, -1, 0), np.moveaxis(turns[..., ::-1], -1, 0)
    phases = np.stack([own, 2 * own, own + other, own - other], axis=-1).swapaxes(1, 2)
    few = turns.shape[0] < _FEW
    return np.concatenate([np.cos(phases), np.sin(phases)], axis=-1)[..., : 0 if few else None]


def pooled(values: Float, nodes: int = POOL_NODES) -> Float:
    """Sums (rows, cols) over so many nodes along each side."""
    return np.asarray(
        cv2.boxFilter(values, -1, (nodes, nodes), normalize=False, borderType=cv2.BORDER_CONSTANT)
    )
