"""Light of a lamp at the camera, predicted from a warp, against exact rays of a planted dent."""

import numpy as np
import pytest
from surface_bench import Gauss

from zeromethod.optics import Dented, Optics
from zeromethod.rig.load import load_rig
from zeromethod.surface.lamp_light import LampLight
from zeromethod.warp.rest import Rest

DENT = Gauss(0.1, 44.0, 3.0, 5.0)


@pytest.mark.parametrize("name", ["simulated", "paper"])
def test_it_is_reflected_twice_and_focused_as_the_rays_say(name):
    optics = Optics(load_rig(name))
    rest = Rest.of(optics.rig, optics)
    v, u = np.indices((optics.rig.camera.rows, optics.rig.camera.columns)).astype(float)
    light = []
    for surface in (optics.rest, Dented(optics.rest, DENT)):
        traced = optics.trace(u, v, surface)
        by_v, by_u = np.gradient(traced.q, axis=(0, 1))
        area = np.abs(by_u[..., 0] * by_v[..., 1] - by_u[..., 1] * by_v[..., 0])
        light.append(traced.reflectance**2 / area)
    truth = light[1] / light[0]
    nodes = optics.trace(*rest.grid.mesh(), Dented(optics.rest, DENT)).q
    lamp = LampLight(optics, rest)
    np.testing.assert_allclose(lamp.share(rest.q), 1.0, atol=2e-4)
    for _ in range(3):  # depth settles
        share = lamp.share(np.where(np.isfinite(nodes), nodes, rest.q))
    known = np.isfinite(truth)
    assert np.nanmin(truth) < 0.8
    assert np.nanmax(truth) > 1.1
    # at the paper's angle reflectance climbs to 1 with infinite slope, twice: as in test_expected_light
    assert np.sqrt(np.mean((share - truth)[known] ** 2)) < (0.001 if name == "simulated" else 0.006)
