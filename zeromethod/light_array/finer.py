"""Dents finer than the modes of depth: found in the residuals of the fit, and how much depth they hide."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from zeromethod.arrays import Float, Ints, Mask
from zeromethod.light_array.devices import FULL_SCALE
from zeromethod.light_array.estimate import light_by_place, look, place_by
from zeromethod.light_array.modes import Modes
from zeromethod.light_array.optics import COUNT, ArrayOptics
from zeromethod.light_array.rig import LightArrayRig
from zeromethod.light_array.start import Start, footprints

_STEP_MM = 1.0
"""Pitch of the points on which the depth that the modes miss of a dent is worked out."""

_NARROWEST_MM = 1.5
"""Sigma of the narrowest dents that are looked for: narrower ones may lie between the detectors' places."""

_WIDTHS = 5
"""So many widths of dents are tried, from the narrowest to those that the modes read."""

_SEEN = 1e-3
"""Sum of the squares that a failed channel leaves, in variances of a reading, below which it is not seen."""

_CHANNEL_SHARE = 0.8
"""A dent must have at least this share of the evidence for a failed channel: a true dent lies between those
that are tried, and so has less evidence than it should."""

_TRUE_TO = 50.0
"""Evidence, in squares of sigmas, above which a true dent differs from the nearest one tried by more than
noise does: then evidence is taken for less."""

_SURE = 30.0
"""Evidence, in squares of sigmas, from which a dent is certain: noise reaches it once in 10,000 readings."""

_MOST = 64
"""So many of the dents that explain a residual, at most, go into a map's sigma."""


class Finer(NamedTuple):
    """What finer dents may hide.

    sure: there certainly is one, at x_mm, y_mm. hidden_mm: standard deviation of the depth that the modes
    miss. dents, amplitude_mm: (n,) numbers and depths of those that explain the residual, each as if it were
    the only one.
    """

    sure: bool
    hidden_mm: float
    x_mm: float
    y_mm: float
    dents: Ints
    amplitude_mm: Float


class FinerDents:
    """Dents of sigma 1.5 mm and more, everywhere in view, and the residual that each would leave.

    The same is worked out for each detector and each LED that fails: together they are the templates.
    """

    def __init__(self, rig: LightArrayRig) -> None:
        self._modes, self._frame = Modes.of(rig), (rig.frame.x_mm, rig.frame.y_mm)
        optics = ArrayOptics.of(rig)
        view = optics.mirror_mm[:, :2]
        self._places, self._sigma = _dents(view, rig.reading.dent_mm)
        # a dent that one frame sees less well than its expected depth is not in view
        self._least = np.repeat([rig.reading.depth_mm**-2, _SEEN], [len(self._sigma), 2 * COUNT])
        self._moved = place_by(optics, self._fields(view, np.arange(len(self._sigma))))
        low, high = view.min(axis=0), view.max(axis=0)
        self._grid = np.mgrid[low[0] : high[0] : _STEP_MM, low[1] : high[1] : _STEP_MM].reshape(2, -1).T

    def _fields(self, points_mm: Float, which: Ints) -> Float:
        """(3, n, k) depth and slopes at points (n, 2) of k dents, 1 mm deep, with their images."""
        parts = []
        for axis, (low, high) in enumerate(self._frame):
            place, sigma = self._places[which, axis], self._sigma[which]
            depth, slope = np.zeros((2, len(points_mm), len(which)))
            for centre, sign in ((place, 1.0), (2 * low - place, -1.0), (2 * high - place, -1.0)):
                off = (points_mm[:, axis, None] - centre) / sigma
                one = sign * np.exp(-(off**2) / 2)
                depth += one
                slope -= off / sigma * one
            parts.append((depth, slope))
        (x, by_x), (y, by_y) = parts
        return np.array([x * y, by_x * y, x * by_y])

    def begin(self, start: Start) -> None:
        """Take the light at rest, and which detectors are read, as measured at the start."""
        count, alive, model = len(self._modes.size_mm), np.isfinite(start.detector), start.model
        lit = start.led * start.levels / FULL_SCALE
        _, by_place = light_by_place(model, look(model, np.zeros(count)), lit)
        modes, dents = (np.einsum("ik,ikn->kn", by_place, by) for by in (model.by_mode, self._moved))
        jacobian = np.concatenate([modes, np.ones((COUNT, 2)) / model.sigma], axis=1)
        seen = np.concatenate([dents, np.eye(COUNT), footprints(model) * lit / model.sigma], axis=1)
        jacobian[~alive], seen[~alive] = 0.0, 0.0
        read = np.linalg.solve(jacobian.T @ jacobian + np.diag(model.prior), jacobian.T @ seen)
        self._left = np.ascontiguousarray((seen - jacobian @ read).T)
        self._read = read[:count, : len(self._sigma)]
        true = self._fields(self._grid, np.arange(len(self._sigma)))[0]
        self._missed = np.abs(true - self._modes.derivatives(self._grid)[0] @ self._read).max(axis=0)
        self.use(alive)

    def use(self, alive: Mask) -> None:
        """From now on, only these detectors (256,) are read."""
        self._shown = np.ascontiguousarray(self._left * alive, np.float32)
        power = np.sum(self._shown**2, axis=1, dtype=float)
        self._variance = np.divide(1.0, power, out=np.zeros(len(power)), where=power > self._least)

    def _evidence(self, left: Float, frames: int) -> tuple[Float, Float]:
        """Size of each template in a mean residual of so many frames; its evidence, in squares of sigmas."""
        share = (self._shown @ left.astype(np.float32)).astype(float)
        return share * self._variance, frames * share**2 * self._variance

    def channel(self, left: Float, frames: int) -> tuple[int, bool] | None:
        """Detector, or LED (then with True), that explains a mean residual (256,) better than any dent."""
        _, evidence = self._evidence(left, frames)
        dents = len(self._sigma)
        best = int(np.argmax(evidence[dents:]))
        if evidence[dents + best] <= evidence[:dents].max():
            return None
        return best % COUNT, best >= COUNT

    def find(self, left: Float, frames: int) -> Finer:
        """What may hide, by the mean residual (256,) of so many frames, in sigmas of one reading."""
        share, evidence = self._evidence(left, frames)
        dents = len(self._sigma)
        channel = _CHANNEL_SHARE * max(frames * float(np.max(left**2)), float(evidence[dents:].max()))
        share, evidence, variance = share[:dents], evidence[:dents], self._variance[:dents]
        best = int(np.argmax(evidence))
        top = float(evidence[best])
        tempered = 2 * max(top / _TRUE_TO, 1.0)
        odds = np.exp((evidence - top) / tempered)
        others = dents * np.exp(-top / tempered) + COUNT * np.exp(min(channel - top, 0.0) / tempered)
        hidden = self._missed**2 * (share**2 + variance / frames)
        kept = np.flatnonzero(evidence > max(_SURE, channel, top / 4))
        kept = kept[np.argsort(evidence[kept])[-_MOST:]]
        x, y = self._places[best]
        mean = np.sqrt(odds @ hidden / (odds.sum() + others))
        return Finer(top > max(_SURE, channel), float(mean), float(x), float(y), kept, share[kept])

    def hidden(self, finer: Finer, points_mm: Float, fields: Float) -> Float:
        """(3, n) standard deviations of depth, mm, and slopes along x and y that may hide at points (n, 2).

        fields: (3, n, modes) of `Modes.derivatives` there.
        """
        missed = self._fields(points_mm, finer.dents) - fields @ self._read[:, finer.dents]
        return np.asarray(np.max(np.abs(missed * finer.amplitude_mm), axis=2, initial=0.0))


def _dents(view: Float, widest_mm: float) -> tuple[Float, Float]:
    """Places (n, 2) and sigmas (n,), mm, of the dents that are tried."""
    places, sigmas = [], []
    for sigma in np.geomspace(_NARROWEST_MM, max(widest_mm, 1.1 * _NARROWEST_MM), _WIDTHS):
        axes = [
            np.linspace(low, high, int(np.ceil((high - low) / sigma)) + 1)
            for low, high in zip(view.min(axis=0), view.max(axis=0), strict=True)
        ]
        places.append(np.stack([part.ravel() for part in np.meshgrid(*axes)], axis=1))
        sigmas.append(np.full(len(places[-1]), sigma))
    return np.concatenate(places), np.concatenate(sigmas)
