"""Readings that start from the one before, against the same ones that start at rest."""

from dataclasses import replace

import numpy as np
import pytest
from surface_bench import Load, Tail

from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.surface import SurfaceReader
from zeromethod.warp.jacobian import warp_flags
from zeromethod.warp.validity import Flag

FRAMES = 3


def ball(bench, shift_mm):
    """A dry ball whose rim folds."""
    return Mirror((Dent(Shape.BALL, bench.centre_mm + shift_mm, 0.0, 0.15, 3.5**2 / 0.15),))


DENTS = {
    "still": lambda bench, _: Load(0.0, bench.centre_mm, 0.0, 5.0),
    "pressed": lambda bench, _: Load(0.2, bench.centre_mm, 0.0, 5.0),
    "sliding": lambda bench, k: Load(0.2, bench.centre_mm + 0.16 * k, 0.0, 5.0),
    "pressed deeper": lambda bench, k: Load(0.1 + 0.012 * k, bench.centre_mm, 0.0, 5.0),
    "a far field": lambda bench, k: Tail(0.05 + 0.001 * k, bench.centre_mm, 0.0, 2.0),
    "folding": lambda bench, k: ball(bench, 0.07 * k),
    "contact": lambda bench, k: Load(0.1, bench.centre_mm + 0.07 * k, 0.0, 4.0),
}


def warps_of(bench, scene):
    """Noisy warps of a scene at 60 Hz, with the flags of a run."""
    generator = np.random.default_rng(3)
    rest_q = bench.optics.rest_map(*bench.grid.mesh())
    size = bench.rig.display.columns, bench.rig.display.rows
    for k in range(FRAMES):
        dent = DENTS[scene](bench, k)
        warp = bench.warp(dent, generator)
        flags = warp.flags | warp_flags(warp.q, rest_q, bench.grid.period_px, size)
        if scene == "contact":
            # the light is lost where it is deepest, and the rim of that flickers
            lost = bench.truth(dent) > 0.08 + 0.003 * generator.standard_normal(flags.shape)
            flags[lost] |= np.uint16(Flag.LIGHT_LOST)
        flags &= ~np.uint16(Flag.OFF_DISPLAY)
        yield replace(warp, flags=flags, time_ns=round(k * 1e9 / 60))


@pytest.mark.parametrize("scene", DENTS)
def test_it_is_what_a_reading_from_rest_gives(finer, scene):
    follower, cold = (SurfaceReader(finer.rig, finer.optics, finer.grid) for _ in range(2))
    for warp in warps_of(finer, scene):
        found, expected = follower.follow(warp), cold.read(warp)
        np.testing.assert_array_equal(found.valid, expected.valid)
        assert expected.valid.sum() > 2_500
        valid = expected.valid
        h = finer.reader.scale[valid[finer.grid.inner]]
        apart = (found.depth_mm - expected.depth_mm)[valid]
        constant = float((apart * h).sum() / (h * h).sum())
        # loads are those of the first frame, until they are learned again
        assert abs(constant) < 2.0 * max(found.anchor.sigma_mm, 3e-5)
        # second order: the constant over the distance to the LCD
        assert np.abs(apart - constant * h).max() < max(1e-7, 0.01 * abs(constant))
        ratio = found.sigma_depth_mm[valid] / expected.sigma_depth_mm[valid]
        assert ratio.min() > 0.98
        assert found.iterations <= expected.iterations
    if scene in {"pressed", "sliding"}:
        assert found.iterations < expected.iterations
