"""Correction of the harmonic that too few shifts alias onto the fundamental, from the periods' disagreement.

N equal shifts cannot separate harmonic N - 1 from the fundamental with reversed phase: with a share e of it,
the phasor comes out as z + e |z| exp(-i (N - 1) phase), its phase off by -e sin(N phase). An LCD drawn
without its inverse response has e = 0.2 for N = 3, 0.01 for N = 4, 0.001 for N = 5 (gamma 2.2). As e is the
same at all phases, it is the component of the phases' misfit along sin(N phase) over the whole view.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.decoding.decoding import Phasors
from zeromethod.decoding.unwrapping import Places

LEAST_SHARE = 0.002
"""Below this a harmonic moves a place by less than a 3000th of the period."""

_SAMPLES = 100_000
_LEAST_SAMPLES = 1000
_ROUNDS = 6


def equally_shifted(shifts_rad: tuple[float, ...]) -> bool:
    """Whether the shifts divide the turn evenly, in any order."""
    turns = np.sort(np.mod(np.asarray(shifts_rad) - shifts_rad[0] + 1e-9, 2 * np.pi))
    return bool(np.allclose(np.diff(turns), 2 * np.pi / len(turns), atol=1e-6))


def folded_harmonic(phasors: Phasors, places: list[Places], sound: Mask) -> Float:
    """Share e of the aliased harmonic, (2, periods), over the pixels `sound` (rows, cols)."""
    sequence = phasors.sequence
    count = len(sequence.shifts_rad)
    shares = np.zeros((2, len(sequence.periods_px)))
    index = np.flatnonzero(sound)
    index = index[:: max(1, len(index) // _SAMPLES)]
    if (
        len(index) < _LEAST_SAMPLES
        or not equally_shifted(sequence.shifts_rad)
        or len(sequence.periods_px) < 2
    ):
        return shares
    weight = 1.0 / np.asarray(sequence.periods_px) ** 2
    free = 1.0 - weight / weight.sum()  # share of a phase error that does not move the place
    for axis, place in enumerate(places):
        x = place.x_px.ravel()[index]
        for n, period in enumerate(sequence.periods_px):
            phase = np.arctan2(phasors.sine[axis, n].ravel()[index], phasors.cosine[axis, n].ravel()[index])
            misfit = np.angle(np.exp(1j * (phase - 2 * np.pi * x / period)))
            wave = np.sin(count * phase)
            shares[axis, n] = -float(np.mean(wave * misfit) / np.mean(wave * wave)) / free[n]
    return shares


def without_harmonic(phasors: Phasors, shares: Float) -> Phasors:
    """Phasors without the aliased harmonic of these shares (2, periods)."""
    folded = len(phasors.sequence.shifts_rad) - 1
    cosine, sine = phasors.cosine.copy(), phasors.sine.copy()
    for axis, n in np.ndindex(shares.shape):
        measured = phasors.cosine[axis, n] + 1j * phasors.sine[axis, n]
        z = measured
        for _ in range(_ROUNDS):  # the error falls by the share in each round
            z = measured - np.float32(shares[axis, n]) * np.abs(z) * np.exp(-1j * folded * np.angle(z))
        cosine[axis, n], sine[axis, n] = z.real, z.imag
    return replace(phasors, cosine=cosine, sine=sine)
