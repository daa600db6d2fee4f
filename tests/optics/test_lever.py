"""The lever's closed form against finite differences of the exact trace."""

import numpy as np
import pytest

from zeromethod.optics import Dented, Optics
from zeromethod.rig.model import RestSurface

from .optics_shapes import Ramp, pixels, random_rig, small


def differences(optics, u, v, step):
    """Central differences of q by the slope, each pixel's mirror point held."""
    point = optics.trace(u, v, optics.rest).point
    columns = []
    for sx, sy in ((step, 0.0), (0.0, step)):
        ends = []
        for sign in (1, -1):
            ramp = Ramp(sign * sx, sign * sy, point[..., 0], point[..., 1])
            ends.append(optics.trace(u, v, Dented(optics.rest, ramp)).q)
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=-1)


REST = RestSurface(shape="sphere", radius_mm=900.0, centre_mm=(38.0, 0.0))


@pytest.mark.parametrize("bench", ["flat", "curved", 0, 1, 2, 3])
def test_the_closed_form_is_the_derivative(bench):
    rest = {"prism": {"rest": REST}} if bench == "curved" else {}
    rig = small(**rest) if isinstance(bench, str) else random_rig(np.random.default_rng(bench))
    optics = Optics(rig)
    u, v = pixels(optics.rig, 12)
    expected = differences(optics, u, v, 1e-6)
    known = np.isfinite(expected).all(axis=(-2, -1))
    assert known.mean() > (0.5 if bench == "curved" else 0.3)
    # 1e-5 px/rad of some 1000: rounding of q (2e-13 px) by the step, times slack for steep exits
    np.testing.assert_allclose(optics.sensitivity(u, v)[known], expected[known], rtol=1e-7, atol=1e-5)
