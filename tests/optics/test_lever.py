"""The lever's closed form against finite differences of the exact trace."""

import numpy as np
import pytest

from zeromethod.optics import Dented, Optics, Sphere

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


@pytest.mark.parametrize("seed", [None, 0, 1, 2, 3])
def test_the_closed_form_is_the_derivative(seed):
    optics = Optics(small() if seed is None else random_rig(np.random.default_rng(seed)))
    u, v = pixels(optics.rig, 12)
    expected = differences(optics, u, v, 1e-6)
    found = optics.sensitivity(u, v)
    seen = np.isfinite(expected).all(axis=(-2, -1))
    assert seen.mean() > 0.3
    # 1e-5 px/rad of some 1000: rounding of q (2e-13 px) by the step, times slack for steep exits
    np.testing.assert_allclose(found[seen], expected[seen], rtol=1e-7, atol=1e-5)


def test_the_closed_form_holds_on_a_curved_rest_surface():
    rest = small().prism.rest.model_copy(
        update={"shape": "sphere", "radius_mm": 900.0, "centre_mm": (38.0, 0.0)}
    )
    optics = Optics(small(prism={"rest": rest}))
    assert optics.rest == Sphere(900.0, (38.0, 0.0))
    u, v = pixels(optics.rig, 12)
    expected = differences(optics, u, v, 1e-6)
    seen = np.isfinite(expected).all(axis=(-2, -1))
    assert seen.mean() > 0.5
    np.testing.assert_allclose(optics.sensitivity(u, v)[seen], expected[seen], rtol=1e-7, atol=1e-5)
