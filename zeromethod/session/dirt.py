"""Effect of dirt on single nodes: learned while the mirror rests, subtracted, its uncertainty added to sigma.

Dust or a scratch in a node's window moves its phase by as much in every nulled frame, as the camera then sees
the same picture whatever presses. At rest it shows as nodes that are off against all around them, which no
rubber at rest is. How far a node is off is held against how it scatters from frame to frame: the sigma that a
node beside a dark speck states has that speck's error in it, which is what is looked for.

A node that is off by no more than a press that counts as rest is not corrected, and one that light rarely
lets through at rest is not known: both are left open by all that they, or nodes around, are off.

Threads of a cloth move every node, most by less than one shows. Together they show it: the mean square of
what such nodes are off beyond noise is left open of each; before any rest, that of the first frame.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter, median_filter, uniform_filter

from zeromethod.arrays import Float, Mask
from zeromethod.loop.rest_memory import REST_WITHIN_LCD_PX, is_at_rest
from zeromethod.loop.state import State
from zeromethod.warp.warp import Warp

FRAMES = 16
"""Frames at rest that are averaged: taking off their mean adds 3 % to one frame's noise. Until there are as
many, the mean of the first 1, 2, 4 or 8 is used."""
_SCATTER_FRAMES = 4
"""Number of frames from which on their scatter, over a window's nodes, is known to within a quarter."""
_USUAL = 2.0
"""Least scatter that is assumed, over the median of the stated sigmas: noise that the null itself has
gathered in fine patterns decays slowly, and does not show as scatter."""
_STATED = 2.0
"""The first frame is left out if it states more than this many times the sigma of the second."""
_AROUND = 11
"""Side, in nodes, of the square whose median a node is compared with: dirt disturbs four nodes across."""
_NOISES = 4.0
"""A node differs from its surroundings if it does by more than this many standard deviations of the mean."""
_GROWN = 6.0
"""Dirt stays as it is: a difference counts as dirt only above this many times its growth, beyond noise, since
half as many frames."""
_EVERYWHERE = 0.1
"""Mean square of the differences that do not show at single nodes, over one frame's variance, from which on
it goes into sigma: less changes sigma by under 5 %."""
_OPEN = 0.3
"""Share of a correction that remains as its sigma: under a press the light around dirt differs."""


class DirtCorrection:
    """Correction of single nodes for dirt, learned at rest. rest_q: (rows, cols, 2) LCD px of the rest map.

    under_cloth: whether threads move all nodes.
    """

    def __init__(self, rest_q: Float, *, under_cloth: bool = False) -> None:
        self._rest_q, self._under_cloth = rest_q, under_cloth
        self._zero: Float | None = None
        self._before: Warp | None = None
        self._forget()

    def _forget(self) -> None:
        self._frames = 0
        self._seen = np.zeros(self._rest_q.shape[:2])
        self._sum, self._square, self._variance = np.zeros((3, *self._rest_q.shape))
        self._away: Float | None = None
        self._off: Float | None = None
        self._open: Float | None = None

    def corrected(self, measured: Warp, state: State, zero: Float | None) -> Warp:
        """A measured warp, from a zero, without the effect of dirt; learns from warps at rest.

        state: of the loop in this step. zero: (rows, cols, 2) LCD px; None for the rig's.
        """
        same = zero is self._zero or (
            zero is not None and self._zero is not None and np.array_equal(zero, self._zero)
        )
        if not same:
            self._zero = zero
            self._forget()
        if self._frames < FRAMES and state is State.RESTING and self._still(measured):
            self._learn(measured)
        if self._under_cloth and self._frames == 0 and self._open is None:
            self._guess(measured)
        self._before = measured
        if self._off is None or self._open is None:
            return measured
        return replace(measured, q=measured.q - self._off, sigma=np.hypot(measured.sigma, self._open))

    def _guess(self, measured: Warp) -> None:
        """Before any rest: widen all sigmas by what one frame's nodes, together, differ by beyond noise."""
        valid, sigma = measured.valid, measured.sigma
        if valid.any():
            off = _against_around(measured.q - self._rest_q, valid)
            small = valid[..., None] & (np.abs(off) < _NOISES * sigma)
            usual2 = np.broadcast_to(np.median(sigma[valid], axis=0) ** 2, off.shape)
            self._off, self._open = np.zeros_like(off), self._everywhere(off, sigma, small, usual2)

    def _still(self, measured: Warp) -> bool:
        """Whether the mirror is where it was: the state follows a filter, and a press may outrun it."""
        if self._frames > 0:
            away, seen = self._mean(), self._known
        elif self._before is not None:
            away, seen = self._before.q - self._rest_q, self._before.valid
        else:
            return False
        return is_at_rest(measured.q, self._rest_q + away, measured.sigma, seen & measured.valid)

    @property
    def _known(self) -> Mask:
        """(rows, cols) nodes that were measured in at least half of the frames."""
        known: Mask = 2 * self._seen > self._frames
        return known

    def _mean(self) -> Float:
        mean: Float = self._sum / np.maximum(self._seen, 1.0)[..., None]
        return mean

    def _learn(self, measured: Warp) -> None:
        valid = measured.valid
        if self._frames == 1 and (self._variance > _STATED**2 * measured.sigma**2)[valid].any():
            # until a rest is known sigma has in it what is to be learned (`loop.lost_light`)
            self._frames = 0
            self._seen[:], self._sum[:], self._square[:], self._variance[:] = 0.0, 0.0, 0.0, 0.0
        away = np.where(valid[..., None], measured.q - self._rest_q, 0.0)
        self._sum += away
        self._square += away**2
        self._variance += np.where(valid[..., None], measured.sigma**2, 0.0)
        self._seen += valid
        self._frames += 1
        if self._frames & (self._frames - 1) == 0:
            self._find(self._mean(), self._sigma(), self._known)

    def _sigma(self) -> Float:
        """(rows, cols, 2) of the mean, as stated or by how nodes scatter."""
        seen = np.maximum(self._seen, 1.0)[..., None]
        least2: Float = self._variance / seen
        if self._frames >= _SCATTER_FRAMES:
            scatter2 = ((self._square - self._sum**2 / seen) / np.maximum(seen - 1.0, 1.0)).mean(axis=-1)
            around2 = uniform_filter(np.where(self._known, scatter2, 0.0), 3)
            around2 /= np.maximum(uniform_filter(self._known.astype(np.float64), 3), 0.1)
            usual2 = _USUAL**2 * np.median(least2[self._known]) if self._known.any() else 0.0
            least2 = np.minimum(least2, np.maximum(around2[..., None], usual2))
        return np.asarray(np.sqrt(least2 / seen))

    def _find(self, displaced: Float, sigma: Float, known: Mask) -> None:
        self._off = self._open = None
        if not known.any():
            return
        off = _against_around(displaced, known)
        if self._away is None and self._before is not None:
            self._away = _against_around(self._before.q - self._rest_q, self._before.valid & known)
        uneven = (np.abs(off) > _NOISES * sigma) & known[..., None]
        # dirt stays as it is; a press that creeps grows, and one that begins may count as rest: left open
        grown = np.zeros_like(off) if self._away is None else np.abs(off - self._away)
        self._away = off
        frame2 = self._variance / np.maximum(self._seen, 1.0)[..., None]
        everywhere = self._everywhere(off, sigma, known[..., None] & ~uneven, frame2)
        if not uneven.any() and not everywhere.any():
            return
        most = REST_WITHIN_LCD_PX + _GROWN * np.maximum(grown - 0.5 * _NOISES * sigma, 0.0)
        # next to it, too, it is more than noise
        dirt = maximum_filter(np.any(uneven & (np.abs(off) > most), axis=-1), 3)[..., None]
        self._off = np.where(dirt, off, 0.0)
        alone = np.where(uneven, np.abs(off), 0.0)
        largest = maximum_filter(np.where(dirt, np.abs(off), alone).max(axis=-1), 3)[..., None]
        taken = _OPEN * maximum_filter(np.abs(self._off).max(axis=-1), 3)[..., None]
        left = np.where(dirt, np.hypot(taken, sigma), np.maximum(taken, alone))
        self._open = np.maximum(np.where(known[..., None], left, largest), everywhere)

    @staticmethod
    def _everywhere(off: Float, sigma: Float, nodes: Mask, frame2: Float) -> Float:
        """(rows, cols, 2) standard deviation of what the nodes (rows, cols, 2) are off beyond noise.

        frame2: (rows, cols, 2) variance of one frame.
        """
        off2, usual2 = (np.where(nodes, each, 0.0).sum(axis=(0, 1)) for each in (off**2 - sigma**2, frame2))
        share = off2 / np.maximum(usual2, 1e-30)
        return np.asarray(np.sqrt(np.where(share > _EVERYWHERE, share, 0.0) * frame2))


def _against_around(displaced: Float, valid: Mask) -> Float:
    """Displacements (rows, cols, 2) of valid nodes less the median around each; else 0."""
    off = np.zeros_like(displaced)
    for k in range(2):
        away = np.where(valid, displaced[..., k], np.median(displaced[valid, k]))
        off[..., k] = np.where(valid, away - median_filter(away, _AROUND, mode="nearest"), 0.0)
    return off
