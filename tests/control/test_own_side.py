"""What is drawn next to a saw's seam, by exact warps of dents beside it."""

from dataclasses import replace

import numpy as np
import pytest
from surface_bench import Bench, Gauss

from zeromethod import binned, load_rig
from zeromethod.control.composition import Composition
from zeromethod.sensing.residual import Residual
from zeromethod.warp.rest import Rest
from zeromethod.warp.validity import Flag


@pytest.fixture(scope="module")
def thin():
    bench = Bench(binned(load_rig("thin"), 2))
    return bench, Rest.of(bench.rig, bench.optics)


@pytest.mark.parametrize(("sigma_mm", "x_mm"), [(2.0, 37.4), (2.0, 38.0), (3.0, 37.0), (5.0, 38.0)])
def test_the_picture_goes_on_to_a_seam_as_on_its_own_side(thin, sigma_mm, x_mm):
    bench, rest = thin
    exact = bench.warp(Gauss(0.0075 * sigma_mm**2, x_mm, 0.0, sigma_mm))
    seam = rest.flags & np.uint16(Flag.SEAM) != 0
    first = seam & ~(np.roll(seam, 1, axis=1) & np.roll(seam, -1, axis=1))

    def worst_px(known: Rest) -> float:
        controller = Composition(known)
        controller.update(Residual.empty(bench.grid), replace(exact, flags=exact.flags | rest.flags))
        return float(np.nanmax(np.abs(controller.commanded - exact.q)[first]))

    # a cubic leaves the fourth derivative; one continuation from side to side is 1.6 to 2.4 LCD px off
    assert worst_px(rest) < 0.5 * worst_px(replace(rest, seams=None))
