"""Planted camera images for the sensing tests."""

import numpy as np

from zeromethod.rig.model import Noise
from zeromethod.warp.grid import NodeGrid

SHAPE = (256, 320)
PERIOD = 16
GRID = NodeGrid(SHAPE, PERIOD)
QUIET = Noise()
NOISE = Noise(read_grey=2.0, electrons_per_grey=150.0, black_grey=4.0)
INNER = GRID.inner


def pixels(shape=SHAPE):
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    return u, v


def cosines(u, v, period=PERIOD, contrast=0.9):
    return 0.5 * (1 + contrast / 2 * (np.cos(2 * np.pi * u / period) + np.cos(2 * np.pi * v / period)))


def checker(u, v, period=PERIOD):
    return 0.5 * (1 + 0.9 * np.sign(np.cos(2 * np.pi * u / period) * np.cos(2 * np.pi * v / period) + 1e-12))


def lattice(u, v, period=PERIOD):
    """Dark lines a quarter of a period wide, bright in between."""
    dark = np.maximum(np.cos(2 * np.pi * u / period), np.cos(2 * np.pi * v / period)) > np.cos(np.pi / 4)
    return np.where(dark, 0.05, 0.95)


def bump(width, centre=(160, 128)):
    """Gaussian of height 1 at `centre` (u, v), px."""
    u, v = pixels()
    return np.exp(-((u - centre[0]) ** 2 + (v - centre[1]) ** 2) / (2 * width**2))


def observed(light, du=0.0, dv=0.0, shape=SHAPE, samples=1):
    """Light averaged over each pixel's area (`samples` per axis) of target((u, v) + d)."""
    u, v = pixels(shape)
    part = (np.arange(samples) + 0.5) / samples - 0.5
    return np.mean([light(u + du + a, v + dv + b) for a in part for b in part], axis=0)


def observed_periodic(light, du, dv, samples=40):
    """As `observed` for a uniform shift and a periodic light: one tile, finely averaged."""
    tile = observed(light, du, dv, (PERIOD, PERIOD), samples)
    return np.tile(tile, [n // PERIOD for n in SHAPE])


def exposed(light, bits=16, full=0.8, black=0.0, rng=None, noise=QUIET):
    """Camera image of a light 0..1."""
    top = 2**bits - 1
    grey = black + full * top * light
    if rng is not None:
        variance = noise.read_grey**2 + (grey - black) / (noise.electrons_per_grey or np.inf)
        grey = grey + rng.standard_normal(grey.shape) * np.sqrt(variance)
    return np.clip(np.rint(grey), 0, top).astype(np.uint8 if bits == 8 else np.uint16)


def camera(light, seed=1, noise=NOISE):
    """Eight bits of a light with noise, black at 4 grey levels."""
    return exposed(light, 8, black=4.0, rng=np.random.default_rng(seed), noise=noise)


def at_nodes(field, grid=GRID):
    """Image field (rows, cols) at the measurable nodes."""
    rows, cols = (axis[s].astype(int) for axis, s in zip((grid.v_px, grid.u_px), grid.inner, strict=True))
    return field[np.ix_(rows, cols)]
