"""The compiled rays against the model in numpy."""

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod import Optics, load_rig
from zeromethod.rig.model import Layer

STACKS = {
    "rubber alone": (),
    "air gap": (Layer(index=1.0, thickness_mm=0.5),),
    "glass, air": (Layer(index=1.52, thickness_mm=1.1), Layer(index=1.0, thickness_mm=0.3)),
    "glass, oil, glass": (
        Layer(index=1.52, thickness_mm=1.1),
        Layer(index=1.47, thickness_mm=0.2),
        Layer(index=1.62, thickness_mm=0.7),
    ),
}


@pytest.mark.parametrize("layers", STACKS.values(), ids=STACKS)
def test_slopes_are_those_of_the_model(layers):
    tilted = {"tilt_deg": (0.4, -0.3), "turn_deg": 2.0}
    optics = Optics(with_tables(load_rig("simulated"), pattern_layers=layers, display=tilted))
    generator = np.random.default_rng(0)
    count = 1000  # whole blocks and a part of one
    x, y = generator.uniform(5.0, 70.0, count), generator.uniform(-15.0, 15.0, count)
    point = np.stack([x, y, generator.uniform(-0.3, 0.1, count)], axis=-1)
    # beyond the LCD too, where rays graze the faces; points above the pattern face and unknown ones
    q = generator.uniform(-2000.0, 4000.0, (count, 2))
    point[::50, 0] = -5.0
    q[1::50] = np.nan
    incoming = np.stack([np.full(count, -0.5), np.zeros(count), np.full(count, np.sqrt(0.75))], axis=-1)
    normal = optics.normal_between(incoming, optics.rubber_direction_to_lcd(point, q))
    expected = normal[:, :2] / normal[:, 2:]
    way = np.broadcast_to(np.array([0.3, -0.2, -1.0]), point.shape)
    rays = [np.ascontiguousarray(one.T) for one in (incoming, point, q, way)]
    slope, rate = np.zeros((2, count)), np.zeros((2, count))
    optics.joinings[0].add_slope(*rays, slope, rate)
    assert np.isnan(expected).any()
    assert np.isfinite(expected).any()
    np.testing.assert_array_equal(np.isnan(slope.T), np.isnan(expected))
    # rounding, amplified where incoming and outgoing rays are nearly one
    np.testing.assert_allclose(slope.T, expected, rtol=1e-9, atol=1e-13)
    ahead, back = (np.zeros((2, count)) for _ in range(2))
    step_mm = 1e-5
    optics.joinings[0].add_slope(rays[0], rays[1] + step_mm * rays[3], *rays[2:], ahead, np.zeros((2, count)))
    optics.joinings[0].add_slope(rays[0], rays[1] - step_mm * rays[3], *rays[2:], back, np.zeros((2, count)))
    # the difference loses 1e-16 / step_mm to rounding, and step_mm^2 to the third order
    smooth = np.abs(slope).max(axis=0) < 1.0
    assert np.count_nonzero(smooth) > 100
    np.testing.assert_allclose(
        rate[:, smooth], ((ahead - back) / (2 * step_mm))[:, smooth], rtol=1e-5, atol=1e-8
    )
