"""The constant of depth: by the loads that the rig's rubber bears, or by places that are known to be at rest."""

import numpy as np
import pytest
from surface_bench import Bench, Gauss, Load, Several, Tail, small_rig

from benchmarks.loads import Pressed
from benchmarks.loads import Load as Pressing
from zeromethod.rig.model import KnownRest

NOISE_MM = 6e-5
"""Of depth itself: at a node of this coarse bench, one frame."""


def read(bench, dent, generator=None):
    """The surface, and the multiple of h in its depth's error, mm at the view's middle (h = 1)."""
    surface = bench.reader.read(bench.warp(dent, generator))
    h = bench.reader.scale[surface.valid[bench.grid.inner]]
    return surface, float((bench.error(surface, dent) * h).sum() / (h * h).sum())


@pytest.mark.parametrize("dx", [-32.0, -25.0, -6.0, 6.0, 15.0, 25.0, 32.0])
@pytest.mark.parametrize("y", [0.0, 10.0, 18.0])
def test_a_load_near_or_over_the_border_does_not_move_zero(small, dx, y):
    dent = Load(0.2, small.centre_mm + dx, y, 5.0)
    surface, wrong = read(small, dent)
    assert surface.anchor.mode == "loads"
    print("BORDER", dx, y, wrong, surface.anchor.sigma_mm)
    assert abs(wrong) < 1e-4


