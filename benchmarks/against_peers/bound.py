"""The Cramer-Rao bound of a displacement, with the window that a method is measured to have.

A displacement averaged with weights w over pixels of noise s cannot have less noise than

    s sqrt(sum w^2) / rms(dI/du),    s^2 = sigma^2 + 1/12 (the rounding to whole grey levels),

where several pictures of one reading add up their squared gradients. A method with a wider window may be
quieter and sees less, so w has to be its own. It is measured alike for all, from outside: a displacement
that holds every spatial frequency of a band at once, of random phases and small against the carrier's
period, is planted in frames as noisy as those that the noise is measured on. Output over input per frequency
is the transfer function H, which is the Fourier transform of the impulse response averaged over all places
on the carrier; by Parseval sum w^2 is the integral of |H|^2. |H|^2 is the product of two independent
realisations' H, so that noise and crosstalk average out instead of adding up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.against_peers.frames import PERIOD_PX, SIGMA_GREY, Pattern
from benchmarks.against_peers.methods import Contender
from zeromethod.arrays import Float

Complex = NDArray[np.complex128]

PLANTED_RMS_PER_BAND_PX2 = 0.8
"""Planted rms over the band's width: 0.05 px for nodes 8 px apart, 2 % of a radian of the carrier's phase."""

MARGIN_PX = 3 * PERIOD_PX
"""Nearer to the border of the frame nothing is judged: windows and pyramids reach beyond it."""

FEWEST_REALISATIONS, ERROR_SHARE = 3, 0.01
"""A window's sum w^2 is known well enough when its standard error is this share of it: 0.5 % of the bound."""


def bound_px(window_power: float, pattern: Pattern, sigma_grey: float = SIGMA_GREY) -> float:
    """Least standard deviation (px, mean square over u and v) for a window of sum w^2 = `window_power`."""
    variance = sigma_grey**2 + 1 / 12
    return float(np.sqrt(variance * window_power * np.mean([1 / i for i in pattern.information()])))


def tile_px(shape: tuple[int, int]) -> int:
    """Side of the square that repeats over a planted frame: the largest power of 2 inside its margins."""
    return 1 << int(np.log2(min(shape) - 2 * MARGIN_PX - 1))


def random_field(tile: int, band: float, rng: np.random.Generator) -> Float:
    """(tile, tile) px: all frequencies below `band` cycles per px on both axes alike, of random phases.

    Frequencies are whole numbers of cycles per tile; the mean is zero and the rms goes with the band.
    """
    low = np.abs(np.fft.fftfreq(tile)) < band - 1e-9
    spectrum = np.fft.fft2(rng.standard_normal((tile, tile)))
    spectrum /= np.maximum(np.abs(spectrum), 1e-300)
    spectrum *= low[:, None] & low[None, :]
    spectrum[0, 0] = 0.0
    field = np.fft.ifft2(spectrum).real
    return np.asarray(field * (PLANTED_RMS_PER_BAND_PX2 * band / np.sqrt(np.mean(field**2))))


def _lines(tile: int, band: float) -> NDArray[np.intp]:
    """Cycles per tile that lie inside the band, from the most negative up."""
    most = int(np.ceil(band * tile - 1e-9)) - 1
    return np.arange(-most, most + 1)


def transfer(contender: Contender, planted: Float, read: Float) -> Complex:
    """H (n, n) on frequencies of the band, v then u, from -band up, one component.

    planted: (tile, tile) px, repeated over the frame from pixel (0, 0). read: that component of what the
    method gave for the frame, on its lattice.
    """
    tile, spacing, first = planted.shape[0], contender.spacing_px, contender.first_px
    n = tile // spacing
    skip = -(-max(MARGIN_PX - first, 0) // spacing)
    counts = [(size - 2 * skip) // n for size in read.shape]
    part = read[skip : skip + counts[0] * n, skip : skip + counts[1] * n]
    mean = part.reshape(counts[0], n, counts[1], n).mean(axis=(0, 2))
    lines = _lines(tile, contender.band)
    ramp = np.exp(-2j * np.pi * lines * (first + skip * spacing) / tile)
    out = np.fft.fft2(mean)[np.ix_(lines, lines)] / n**2 * ramp[:, None] * ramp[None, :]
    into = np.fft.fft2(planted)[np.ix_(lines, lines)] / tile**2
    into[lines == 0, lines == 0] = np.inf  # the mean is not planted
    return np.asarray(out / into)


def window_power(transfers: list[Complex], tile: int) -> float:
    """Sum of w^2 from at least two realisations' transfer functions.

    H at zero frequency, which a frame's mean cannot give, is taken from its neighbours.
    """
    total = np.sum(transfers, axis=0)
    pairs = np.abs(total) ** 2 - np.sum(np.abs(transfers) ** 2, axis=0)
    square = pairs / (len(transfers) * (len(transfers) - 1))
    middle = square.shape[0] // 2
    around = square[middle - 1 : middle + 2, middle - 1 : middle + 2]
    return float((square.sum() - square[middle, middle] + (around.sum() - around[1, 1]) / 8) / tile**2)


@dataclass(frozen=True)
class WindowPower:
    """Sum of w^2 as measured, mean of both components, and its standard error (jackknife)."""

    value: float
    error: float
    realisations: int


def measured_window_power(
    contender: Contender, shape: tuple[int, int], most: int, rng: np.random.Generator
) -> WindowPower:
    """Sum of w^2 on frames of `shape`, from as many realisations as it takes, `most` at most (>= 3)."""
    tile = tile_px(shape)
    repeats = [-(-size // tile) for size in shape]
    transfers: list[list[Complex]] = [[], []]
    power = WindowPower(float("nan"), float("inf"), 0)
    for count in range(1, most + 1):
        planted = [random_field(tile, contender.band, rng) for _ in range(2)]
        field = np.stack([np.tile(one, repeats)[: shape[0], : shape[1]] for one in planted], axis=-1)
        read = contender.read(contender.pattern.frames(field, SIGMA_GREY, rng))
        for component in range(2):
            found = np.asarray(read[..., component], float)
            transfers[component].append(transfer(contender, planted[component], found))
        if count >= FEWEST_REALISATIONS:
            power = _jackknife(transfers, tile)
            if power.error < ERROR_SHARE * power.value:
                break
    return power


def _jackknife(transfers: list[list[Complex]], tile: int) -> WindowPower:
    count = len(transfers[0])
    value = float(np.mean([window_power(some, tile) for some in transfers]))
    without = [
        np.mean([window_power(some[:i] + some[i + 1 :], tile) for some in transfers]) for i in range(count)
    ]
    return WindowPower(value, float(np.sqrt((count - 1) * np.var(without))), count)
